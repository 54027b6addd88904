//! How surfaces are drawn: what sticks to them, what is finer than a pixel, the lobes of growths, where they come close to others, and the lines of their
//! meshes.
mod stand;

use rendering::{Appearance, Camera, External, Material, RenderError, Renderer, SurfaceMesh, Without, shapes};
use stand::*;

/// Colour and vessels alone, under a light that nothing bends.
const FLAT: Without = Without { vessels: false, bump: true, wet: true, softness: false };

/// How alike two rows of numbers are, -1 to 1.
fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let mean = |row: &[f32]| row.iter().sum::<f32>() / row.len() as f32;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sum = |of: &dyn Fn(f32, f32) -> f32| a.iter().zip(b).map(|(x, y)| of(x - mean_a, y - mean_b)).sum::<f32>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

#[test]
fn what_is_drawn_on_a_wall_that_is_stretched_goes_with_its_vertices() {
    let Some(mut r) = lacking(FLAT) else { return };
    let lining = wall(0.006, 0.007);
    put(&mut r, CAVITY, &lining, Material::MucosaTissue);
    let before = picture(&mut r, &close_up(0.006));
    let wide: Vec<[f32; 3]> = lining.positions_m.iter().map(|[x, y, z]| [2.0 * x, *y, *z]).collect();
    r.stage().update_positions(CAVITY, &wide).unwrap();
    let after = picture(&mut r, &close_up(0.006));
    // What a pixel differs by from those about it, then where it has gone to, which lies between two pixels, and where it was.
    let places: Vec<[u32; 2]> = middle([30, 45]).collect();
    let of = |at: &dyn Fn([u32; 2]) -> f32| places.iter().map(|place| at(*place)).collect::<Vec<f32>>();
    let drawn = of(&|at| detail(&before, 1, at, [5, 5]));
    let [left, right] = [80, 79].map(|less| of(&|[x, y]| detail(&after, 1, [2 * x - less, y], [10, 5])));
    let gone: Vec<f32> = left.iter().zip(&right).map(|(left, right)| 0.5 * (left + right)).collect();
    let stayed = of(&|at| detail(&after, 1, at, [5, 5]));
    let (sticks, slides) = (correlation(&drawn, &gone), correlation(&drawn, &stayed));
    println!("as before {sticks} at the vertices, {slides} at the pixels");
    assert!(sticks > 0.8 && slides < 0.75 && sticks > slides + 0.15, "{sticks} {slides}");
    let (darkest, depth) = drawn.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).expect("there are places");
    assert!(*depth < -8.0 && gone[darkest] < 0.4 * depth, "the darkest spot, of {depth}, is {} there", gone[darkest]);
}

/// A picture of four times the size on each side, as one of whose pixels each is the mean of 16.
fn shrunk(large: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(large.len() / 16);
    for (y, x) in (0..HEIGHT as usize).flat_map(|y| (0..WIDTH as usize).map(move |x| (y, x))) {
        for channel in 0..4 {
            let texel = |k: usize| u32::from(large[4 * ((4 * y + k / 4) * 4 * WIDTH as usize + 4 * x + k % 4) + channel]);
            out.push(((0..16).map(texel).sum::<u32>() / 16) as u8);
        }
    }
    out
}

#[test]
fn what_is_finer_than_a_pixel_is_drawn_as_its_mean_and_not_as_grain() {
    let Some(mut r) = renderer() else { return };
    // How steep a picture is from pixel to pixel, as a share of its brightness.
    let roughness = |shot: &[u8]| steps(shot, middle([28, 28]))[0] / mean(shot, 1, middle([28, 28]));
    put(&mut r, CAVITY, &wall(0.006, 0.010), Material::MucosaTissue);
    let near = roughness(&picture(&mut r, &straight()));
    put(&mut r, CAVITY, &wall(0.030, 0.040), Material::MucosaTissue);
    let far = roughness(&picture(&mut r, &straight()));
    r.resize(4 * WIDTH, 4 * HEIGHT);
    let truth = roughness(&shrunk(&picture(&mut r, &straight())));
    println!("from pixel to pixel {near} at 6 mm, {far} at 30 mm, where 16 samples of each pixel make {truth}");
    assert!(far < 1.3 * truth && far > 0.25 * truth, "{far} {truth}");
    assert!(far < 1.4 * near, "{far} {near}");
}

/// Radii of what is redder than the background behind it, px, all around the middle of the picture.
fn silhouette_px(shot: &[u8]) -> Vec<f32> {
    let redder = |x: u32, y: u32| {
        let [red, _, blue] = pixel(shot, x, y);
        (red - blue) as f32
    };
    let between = |x: f32, y: f32| {
        let (left, top) = (x.floor() as u32, y.floor() as u32);
        let [along, down] = [x.fract(), y.fract()];
        let row = |y: u32| (1.0 - along) * redder(left, y) + along * redder(left + 1, y);
        (1.0 - down) * row(top) + down * row(top + 1)
    };
    let radius = |angle: f32| {
        let is_inside = |radius: &f32| {
            let [x, y] = [0.5 * WIDTH as f32 + radius * angle.cos(), 0.5 * HEIGHT as f32 + radius * angle.sin()];
            between(x - 0.5, y - 0.5) > 20.0
        };
        (0..580).map(|tenth| 58.0 - 0.1 * tenth as f32).find(is_inside).unwrap_or(0.0)
    };
    (0..120).map(|part| radius(part as f32 / 120.0 * std::f32::consts::TAU)).collect()
}

/// Mean radius of what stands at the origin as it is seen from afar along x, and the most that its outline is beside that, mm.
fn outline_mm(r: &mut Renderer) -> [f32; 2] {
    let (far_m, field_of_view_rad) = (0.060, 0.175);
    let outside = External { eye_m: [far_m, 0.0, 0.0], target_m: [0.0; 3], field_of_view_rad, clip: None, ..External::default() };
    let mut view = straight();
    view.camera = Camera::External(outside);
    let mm_per_px = 1e3 * 2.0 * far_m * (0.5 * field_of_view_rad).tan() / HEIGHT as f32;
    let radii = silhouette_px(&picture(r, &view));
    let mean = radii.iter().sum::<f32>() / radii.len() as f32;
    let most = radii.iter().map(|radius| (radius - mean).abs()).fold(0.0, f32::max);
    [mean, most].map(|px| px * mm_per_px)
}

#[test]
fn a_growth_has_lobes_of_some_tenths_of_a_millimetre_and_the_lining_has_none() {
    let Some(mut r) = renderer() else { return };
    let [lobed, round] = [Material::Polyp, Material::MucosaTissue].map(|material| {
        put(&mut r, TOOL, &shapes::ball([0.0; 3], 0.004, 64, 96), material);
        outline_mm(&mut r)
    });
    println!("a ball of 4 mm: mean radius and most beside it {lobed:?} mm with lobes, {round:?} mm without");
    assert!((round[0] - 4.0).abs() < 0.1 && round[1] < 0.07, "{round:?}");
    assert!((0.1..0.4).contains(&lobed[1]) && (lobed[0] - 4.0).abs() < 0.35, "{lobed:?}");
}

/// At the rim of a cut the lobes stood out over the wound, and one looked in under them.
#[test]
fn the_skin_of_a_growth_ends_on_the_rim_of_its_wound() {
    const BANDS: u32 = 12;
    const AROUND: u32 = 96;
    let Some(mut r) = renderer() else { return };
    // From pole to pole along x: the outline is that of the middle row of vertices.
    let mut growth = shapes::ball([0.0; 3], 0.004, BANDS + 1, AROUND);
    growth.positions_m.iter_mut().for_each(|place| place.rotate_right(1));
    put(&mut r, TOOL, &growth, Material::Polyp);
    let whole = outline_mm(&mut r);
    // The half that looks at the eye is a wound, with vertices of its own.
    let skin = growth.positions_m.len() as u32;
    growth.positions_m.extend_from_within(..);
    for corners in &mut growth.triangles[(BANDS * AROUND) as usize..] {
        *corners = corners.map(|corner| corner + skin);
    }
    let raw: Vec<u32> = (0..2 * skin).map(|vertex| u32::from(vertex >= skin)).collect();
    let appearance = Appearance::of(Material::Polyp);
    let mesh = SurfaceMesh { triangles: &growth.triangles, rest_m: &growth.positions_m, raw: &raw, appearance };
    r.stage().set_object(TOOL, mesh).unwrap();
    let cut = outline_mm(&mut r);
    println!("mean radius and most beside it {whole:?} mm where it is whole, {cut:?} mm at the rim");
    assert!(whole[1] > 0.1 && cut[1] < 0.08 && (cut[0] - 4.0).abs() < 0.1, "{whole:?} {cut:?}");
}

#[test]
fn the_lines_of_a_mesh_are_drawn_from_outside_where_the_device_draws_lines() {
    let Some(mut r) = renderer() else { return };
    let ball = shapes::ball([0.0, 0.0, 0.022], 0.012, 9, 12);
    put_plain(&mut r, CAVITY, &ball, Appearance::of(Material::MucosaTissue));
    let mut view = from_outside();
    let plain = picture(&mut r, &view);
    view.has_lines = true;
    let lined = picture(&mut r, &view);
    let all = changed(&plain, &lined);
    if !r.gpu().draws_lines() {
        assert_eq!(all, 0);
        eprintln!("not tested: {} draws no lines", r.gpu().name());
        return;
    }
    let pixels = plain.chunks_exact(4).zip(lined.chunks_exact(4));
    let darker = pixels.filter(|(plain, lined)| i32::from(lined[0]) + 12 < i32::from(plain[0])).count();
    println!("{all} pixels of lines, {darker} of them darker");
    assert!((60..2_000).contains(&all) && 10 * darker > 7 * all, "{all} {darker}");
    let mut inside = straight();
    let plain = picture(&mut r, &inside);
    inside.has_lines = true;
    assert_eq!(changed(&plain, &picture(&mut r, &inside)), 0, "they are not for the surgeon");
}

/// Where a growth meets the wall it was as light as everywhere.
#[test]
fn where_it_is_not_open_it_is_darker_and_redder_and_what_is_no_number_is_open() {
    let Some(mut r) = renderer() else { return };
    let (lining, view) = (wall(0.008, 0.010), close_up(0.008));
    let appearance = Appearance::of(Material::MucosaTissue);
    put_plain(&mut r, CAVITY, &lining, appearance);
    let open = picture(&mut r, &view);
    // +x is on the picture's left.
    let shares: Vec<f32> = lining.positions_m.iter().map(|place| if place[0] > 1e-6 { 0.3 } else { 1.0 }).collect();
    r.stage().set_openness(CAVITY, &shares).unwrap();
    let shut = picture(&mut r, &view);
    let of = |shot: &[u8], channel: usize, from: u32, to: u32| {
        mean(shot, channel, (20..100).flat_map(|y| (from..to).map(move |x| [x, y])))
    };
    let [red, green] = [0, 1].map(|channel| of(&shut, channel, 10, 45) / of(&open, channel, 10, 45));
    let beside = of(&shut, 1, 84, 150) - of(&open, 1, 84, 150);
    println!("{red} of the red and {green} of the green are left, beside it green is {beside} more");
    assert!(green < 0.85 && green + 0.08 < red && red < 0.95 && beside.abs() < 0.5, "{red} {green} {beside}");
    r.stage().set_openness(CAVITY, &vec![f32::NAN; shares.len()]).unwrap();
    assert_eq!(changed(&open, &picture(&mut r, &view)), 0);
    r.stage().set_openness(CAVITY, &shares).unwrap();
    put_plain(&mut r, CAVITY, &lining, appearance);
    assert_eq!(changed(&open, &picture(&mut r, &view)), 0, "what is made anew is open");
    assert!(matches!(r.stage().set_openness(CAVITY, &shares[1..]), Err(RenderError::WrongLength { .. })));
    assert!(matches!(r.stage().set_openness(99, &shares), Err(RenderError::UnknownObject(99))));
}
