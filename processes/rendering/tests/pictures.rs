//! Statements about pictures: what a trainee would miss at once if it were broken.
mod stand;

use rendering::{
    Appearance, Arrow, Camera, Gpu, MAX_SPOTS, Marks, Material, Overlay, Prefer, RenderError, Renderer, SurfaceMesh, shapes,
};
use stand::*;

#[test]
fn the_mask_is_black_outside_and_the_field_shows_pink_tissue() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let shot = picture(&mut r, &through_scope());
    let [inside, outside] = round_field();
    assert!(outside.iter().all(|&(x, y)| pixel(&shot, x, y) == [0, 0, 0]));
    let mean = inside.iter().fold([0; 3], |sum, &(x, y)| std::array::from_fn(|c| sum[c] + pixel(&shot, x, y)[c]));
    let [red, green, blue] = mean.map(|sum| sum / inside.len() as i32);
    assert!((80..235).contains(&red) && red > green + 25 && red > blue + 25, "{red} {green} {blue}");
    let reddish = inside.iter().filter(|&&(x, y)| pixel(&shot, x, y)[0] > pixel(&shot, x, y)[2]).count();
    assert!(reddish * 100 > inside.len() * 95, "{reddish} of {}", inside.len());
}

#[test]
fn the_notch_follows_the_camera_head() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let mut view = through_scope();
    let upright = picture(&mut r, &view);
    assert_eq!(pixel(&upright, WIDTH / 2, 1), [0, 0, 0]);
    let Camera::Endoscope(scope) = &mut view.camera else { unreachable!() };
    scope.head_rad = std::f32::consts::PI;
    let turned = picture(&mut r, &view);
    assert_eq!(pixel(&turned, WIDTH / 2, HEIGHT - 2), [0, 0, 0]);
    assert_ne!(pixel(&turned, WIDTH / 2, 2), [0, 0, 0]);
}

#[test]
fn the_tool_covers_pixels_from_outside_follows_its_pose_and_leaves_no_trace() {
    let Some(mut r) = renderer() else { return };
    let empty = picture(&mut r, &from_outside());
    put(&mut r, TOOL, &shapes::scope(0.004, 0.1, 0.5), Material::Metal);
    r.stage().set_pose(TOOL, [0.0, 0.0, 0.05], [0.0, 0.0, 0.0, 1.0]).unwrap();
    let here = picture(&mut r, &from_outside());
    let covered = changed(&empty, &here);
    assert!((300..9_000).contains(&covered), "{covered} pixels");
    r.stage().set_pose(TOOL, [0.0, 0.02, 0.05], [0.0, 0.0, 0.0, 1.0]).unwrap();
    assert!(changed(&here, &picture(&mut r, &from_outside())) > covered / 2);
    r.stage().set_pose(TOOL, [f32::NAN; 3], [0.0; 4]).unwrap();
    assert!(changed(&empty, &picture(&mut r, &from_outside())) > 300, "a pose that is none leaves it where it was");
    assert!(r.stage().remove_object(TOOL) && !r.stage().remove_object(TOOL));
    assert_eq!(changed(&empty, &picture(&mut r, &from_outside())), 0);
}

#[test]
fn edges_are_smooth_with_several_samples() {
    let Some(mut plain) = renderer() else { return };
    let gpu = Gpu::new(Prefer::Software).expect("the adapter of before").smooth(true);
    let mut smooth = Renderer::new(gpu, WIDTH, HEIGHT).expect("the software adapter takes several samples");
    let [plain, smooth] = [&mut plain, &mut smooth].map(|r| {
        put(r, TOOL, &shapes::scope(0.004, 0.1, 0.5), Material::Metal);
        let turn = glam::Quat::from_rotation_y(0.3) * glam::Quat::from_rotation_x(0.3);
        r.stage().set_pose(TOOL, [0.0, 0.0, 0.05], turn.to_array()).unwrap();
        picture(r, &from_outside())
    });
    // Steep steps from one pixel to the next: an edge without samples between is made of nothing else.
    let steps = |shot: &[u8]| {
        let steep = |x: u32, y: u32| (pixel(shot, x, y)[1] - pixel(shot, x + 1, y)[1]).abs() > 60;
        (0..HEIGHT).flat_map(|y| (0..WIDTH - 1).map(move |x| (x, y))).filter(|&(x, y)| steep(x, y)).count()
    };
    let (rough, fine) = (steps(&plain), steps(&smooth));
    println!("{rough} steep steps, {fine} with several samples; {} pixels differ", changed(&plain, &smooth));
    assert!(rough > 50 && 4 * fine < 3 * rough, "{rough} and {fine}");
}

#[test]
fn a_scope_does_not_see_its_own_shaft() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let without = picture(&mut r, &through_scope());
    put(&mut r, TOOL, &shapes::ball([0.0, 0.0, 0.025], 0.002, 16, 24), Material::Metal);
    assert!(changed(&without, &picture(&mut r, &through_scope())) > 100);
    r.stage().set_appearance(TOOL, Appearance { external_only: true, ..Appearance::of(Material::Metal) }).unwrap();
    assert_eq!(changed(&without, &picture(&mut r, &through_scope())), 0);
}

#[test]
fn a_loop_before_the_lens_is_seen_and_glows_with_current_in_it() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let without = picture(&mut r, &through_scope());
    put(&mut r, TOOL, &shapes::loop_ring(0.0022, 0.000_15), Material::Metal);
    r.stage().set_pose(TOOL, [0.0, 0.0, 0.031], [0.0, 0.0, 0.0, 1.0]).unwrap();
    let cold = picture(&mut r, &through_scope());
    let seen = changed(&without, &cold);
    assert!((50..4_000).contains(&seen), "{seen} pixels");
    let glowing = |glow: f32| Appearance { glow, ..Appearance::of(Material::Metal) };
    r.stage().set_appearance(TOOL, glowing(1.0)).unwrap();
    let hot = picture(&mut r, &through_scope());
    let is_wire = |x: u32, y: u32| (0..3).any(|c| pixel(&without, x, y)[c].abs_diff(pixel(&cold, x, y)[c]) > 12);
    let wire: Vec<(u32, u32)> =
        (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).filter(|&(x, y)| is_wire(x, y)).collect();
    let mean =
        |shot: &[u8], channel: usize| wire.iter().map(|&(x, y)| pixel(shot, x, y)[channel]).sum::<i32>() / wire.len() as i32;
    let [[red, blue], [hot_red, hot_blue]] = [&cold, &hot].map(|shot| [0, 2].map(|channel| mean(shot, channel)));
    assert!(hot_red > red + 30 && hot_red - hot_blue > red - blue + 30, "red {red} to {hot_red}, blue {blue} to {hot_blue}");
    r.stage().set_appearance(TOOL, glowing(f32::NAN)).unwrap();
    assert_eq!(changed(&cold, &picture(&mut r, &through_scope())), 0);
}

#[test]
fn tissue_that_moves_shows_and_texture_sticks_to_it() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let before = picture(&mut r, &through_scope());
    assert_eq!(changed(&before, &picture(&mut r, &through_scope())), 0, "the same scene gives the same picture");
    let mut pushed = cavity.positions_m.clone();
    for p in pushed.iter_mut().filter(|p| p[2] > 0.02 && p[2] < 0.03 && p[1] > 0.0) {
        p[1] -= 0.003;
    }
    r.stage().update_positions(CAVITY, &pushed).unwrap();
    assert!(changed(&before, &picture(&mut r, &through_scope())) > 200);
    // scope and tissue moved together: the same picture, because texture is looked up at rest positions
    let shifted: Vec<[f32; 3]> = cavity.positions_m.iter().map(|p| [p[0] + 0.5, p[1], p[2]]).collect();
    r.stage().update_positions(CAVITY, &shifted).unwrap();
    let mut view = through_scope();
    let Camera::Endoscope(scope) = &mut view.camera else { unreachable!() };
    scope.tip_m[0] += 0.5;
    let after = changed(&before, &picture(&mut r, &view));
    assert!(after < 200, "{after} pixels differ");
}

#[test]
fn a_wound_looks_otherwise_than_the_skin_about_it_and_only_where_it_is() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let whole = picture(&mut r, &through_scope());
    let mut show = |raw: &[u32]| {
        let appearance = Appearance::of(Material::MucosaTissue);
        let mesh = SurfaceMesh { triangles: &cavity.triangles, rest_m: &cavity.positions_m, raw, appearance };
        r.stage().set_object(CAVITY, mesh).map(|()| picture(&mut r, &through_scope()))
    };
    let vertices = cavity.positions_m.len();
    assert_eq!(changed(&whole, &show(&vec![0; vertices]).unwrap()), 0, "without a wound it is the same picture");
    let above: Vec<u32> = cavity.positions_m.iter().map(|place| u32::from(place[1] > 0.002)).collect();
    let wounded = show(&above).unwrap();
    let is_other = |rows: std::ops::Range<u32>| {
        let places = rows.flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        places.filter(|&(x, y)| pixel(&whole, x, y).iter().zip(pixel(&wounded, x, y)).any(|(a, b)| (a - b).abs() > 12)).count()
    };
    let (upper, lower) = (is_other(0..HEIGHT / 4), is_other(3 * HEIGHT / 4..HEIGHT));
    assert!(upper > 500 && lower * 20 < upper, "{upper} pixels differ above, {lower} below");
    assert!(matches!(show(&[1, 0]), Err(RenderError::WrongLength { got: 2, .. })), "flags for other vertices");
}

#[test]
fn the_mouth_of_a_tube_is_a_dark_pit_in_the_lining_where_it_lies_and_nowhere_else() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let plain = picture(&mut r, &through_scope());
    let ahead = cavity.positions_m.iter().max_by(|a, b| a[2].total_cmp(&b[2])).expect("a cavity");
    let mut show = |mouths_m: [[f32; 4]; 2]| {
        r.stage().set_mouths(CAVITY, mouths_m).expect("it is there");
        picture(&mut r, &through_scope())
    };
    let none = [0.0; 4];
    let pitted = show([none, [ahead[0], ahead[1], ahead[2], 0.002]]);
    let light = |shot: &[u8], x: u32, y: u32| pixel(shot, x, y).iter().sum::<i32>();
    let (middle, is_lit) = ((WIDTH / 2, HEIGHT / 2), light(&plain, WIDTH / 2, HEIGHT / 2));
    assert!(3 * light(&pitted, middle.0, middle.1) < is_lit, "{} of {is_lit}", light(&pitted, middle.0, middle.1));
    let other = changed(&plain, &pitted);
    assert!((20..2_500).contains(&other), "{other} pixels");
    assert_eq!(changed(&plain, &show([none, [f32::NAN, 0.0, 0.0, 0.002]])), 0);
    assert_eq!(changed(&plain, &show([none; 2])), 0);
    assert!(matches!(r.stage().set_mouths(99, [none; 2]), Err(RenderError::UnknownObject(99))));
}

#[test]
fn a_coagulated_spot_is_pale_where_it_lies_and_nowhere_else() {
    let Some((mut r, cavity)) = in_cavity() else {
        return;
    };
    let mut view = through_scope();
    let plain = picture(&mut r, &view);
    view.adaptation = 0.0; // the exposure of the first frame stays
    let ahead = cavity.positions_m.iter().max_by(|a, b| a[2].total_cmp(&b[2])).expect("a cavity");
    let mut show = |spots_m: &[[f32; 4]]| {
        r.stage().set_spots(CAVITY, spots_m).expect("it is there");
        picture(&mut r, &view)
    };
    let spot = [ahead[0], ahead[1], ahead[2], 0.002];
    let marked = show(&[spot]);
    let redness = |shot: &[u8]| {
        let [red, _, blue] = pixel(shot, WIDTH / 2, HEIGHT / 2);
        red - blue
    };
    assert!(4 * redness(&marked) < 3 * redness(&plain), "{} of {}", redness(&marked), redness(&plain));
    let other = changed(&plain, &marked);
    assert!((20..2_500).contains(&other), "{other} pixels");
    assert_eq!(changed(&marked, &show(&[[f32::NAN; 4], spot])), 0, "one that cannot be hides no other");
    assert_eq!(changed(&marked, &show(&[spot; 2 * MAX_SPOTS])), 0);
    assert_eq!(changed(&plain, &show(&[])), 0);
    assert!(matches!(r.stage().set_spots(99, &[spot]), Err(RenderError::UnknownObject(99))));
}

/// How sharp a picture of 640 × 480 is between two distances from its middle, px: the mean square of its steps in green from one pixel to the next.
fn sharpness(shot: &[u8], from_px: f32, to_px: f32) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for (x, y) in (0..480_usize).flat_map(|y| (1..640_usize).map(move |x| (x, y))) {
        if (from_px..to_px).contains(&(x as f32 - 320.0).hypot(y as f32 - 240.0)) {
            let [here, before] = [x, x - 1].map(|x| f32::from(shot[4 * (640 * y + x) + 1]));
            (sum, count) = (sum + (here - before).powi(2), count + 1);
        }
    }
    sum / count as f32
}

/// The lamp lies below the lens, so that what stands close before it throws its shadow upwards on the wall far behind.
#[test]
fn what_stands_before_the_wall_shades_it_on_the_side_away_from_the_lamp_and_gas_and_flakes_do_not() {
    let Some((mut r, _)) = in_cavity() else { return };
    let side = HEIGHT as f32 / 2.0;
    let bright = |shot: &[u8], [right, up]: [f32; 2]| -> f32 {
        let near = (0..49).map(|at| [at % 7 - 3, at / 7 - 3]);
        let spots = near.map(|[dx, dy]| {
            let [x, y] = [WIDTH as f32 / 2.0 + right * side, side - up * side].map(|at| at as i32);
            pixel(shot, (x + dx) as u32, (y + dy) as u32).iter().sum::<i32>()
        });
        spots.sum::<i32>() as f32
    };
    let view = through_scope();
    let clear = picture(&mut r, &view);
    let (above, beside) = ([0.0, 0.50], [[0.50, 0.0], [-0.50, 0.0], [0.0, -0.50]]);
    let mut shaded = |material: Material, shadows: bool| {
        put(&mut r, TOOL, &shapes::ball([0.0, 0.0, 0.019], 0.0008, 16, 24), material);
        let mut view = view.clone();
        view.quality.shadows = shadows;
        let shot = picture(&mut r, &view);
        let of = |place: [f32; 2]| bright(&shot, place) / bright(&clear, place);
        // The exposure follows the whole picture: what is beside says by how much.
        of(above) / (beside.map(of).iter().sum::<f32>() / 3.0)
    };
    let [solid, gas, flake] = [Material::Polyp, Material::Gas, Material::Flake].map(|material| shaded(material, true));
    let given_up = shaded(Material::Polyp, false);
    let is_none = |share: f32| (share - 1.0).abs() < 0.08;
    assert!(is_none(given_up), "{given_up} of a solid where shadows have given way");
    assert!(solid < 0.75 && is_none(gas) && is_none(flake), "{solid} of a solid, {gas} of gas, {flake} of a flake");
}

#[test]
fn what_the_focus_is_turned_to_is_sharp_and_the_rest_is_not() {
    let Some((mut r, _)) = in_cavity() else { return };
    r.resize(640, 480);
    picture(&mut r, &through_scope()); // which sets the exposure
    r.stage().remove_object(CAVITY);
    // A wire at 6 mm, some 115 pixels from the middle, and a ball at 26 mm in it.
    put(&mut r, TOOL, &shapes::loop_ring(0.002, 0.000_15), Material::Metal);
    r.stage().set_pose(TOOL, [0.0, 0.0, 0.021], [0.0, 0.0, 0.0, 1.0]).unwrap();
    put(&mut r, 9, &shapes::ball([0.0, 0.0, 0.043], 0.002, 16, 24), Material::Metal);
    let mut shoot = |focus_m: f32, is_focused: bool| {
        let mut view = through_scope();
        let Camera::Endoscope(scope) = &mut view.camera else { unreachable!() };
        scope.focus_m = focus_m;
        view.quality.focus = is_focused;
        let stats = r.render(&view).expect("a frame");
        assert_eq!(stats.passes_ms[2] > 0.0, is_focused, "the pass is drawn, and timed: {stats:?}");
        let shot = r.read_rgba().expect("a picture");
        [sharpness(shot, 95.0, 140.0), sharpness(shot, 0.0, 60.0)]
    };
    let [near, far, all] = [shoot(0.006, true), shoot(0.030, true), shoot(0.006, false)];
    println!("wire and ball: {near:?} set to 6 mm, {far:?} to 30 mm, {all:?} without focus");
    assert!(near[0] > 1.5 * far[0] && far[1] > 1.5 * near[1], "{near:?} {far:?}");
    // Against nothing an edge loses some of its sharpness, because the blur is drawn at half the resolution.
    assert!(near[0] > 0.65 * all[0] && far[1] > 0.65 * all[1], "what is in focus stays sharp: {near:?} {far:?} {all:?}");
    assert_eq!(all, shoot(0.030, false), "without the pass the focus does nothing");
    let nonsense = shoot(f32::NAN, true);
    assert_eq!(nonsense, shoot(hyst_messages::controls::FOCUS_M, true), "a focus that is no number is the usual one");
}

#[test]
fn from_outside_nothing_is_out_of_focus() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = from_outside();
    let with = picture(&mut r, &view);
    view.quality.focus = false;
    assert_eq!(with, picture(&mut r, &view));
}

#[test]
fn contacts_and_the_force_are_arrows_of_their_own_colours_from_outside_and_the_lens_sees_none() {
    let Some(mut r) = renderer() else { return };
    let mut marks = Marks::new([71, 72]);
    let [outside, inside] = [close_up(0.03), straight()];
    let [plain, dark] = [&outside, &inside].map(|view| picture(&mut r, view));
    // Across the middle, a third of the picture high.
    let (across, none) = ([0.0, 0.010, 0.0], Arrow { from_m: [0.0; 3], along_m: [0.0; 3] });
    let arrow = Arrow { from_m: [0.0, -0.005, 0.03], along_m: across };
    let mut gained = |contacts: &[Arrow], force: Arrow| {
        marks.show(r.stage(), contacts, force).expect("there is room for them");
        assert_eq!(changed(&dark, &picture(&mut r, &inside)), 0, "it is not for the surgeon");
        let shot = picture(&mut r, &outside);
        let by = |channel: usize| {
            let pixels = plain.chunks_exact(4).zip(shot.chunks_exact(4));
            pixels.map(|(before, after)| i64::from(after[channel]) - i64::from(before[channel])).sum::<i64>()
        };
        (changed(&plain, &shot), [0, 1, 2].map(by))
    };
    let (contact_px, [red, green, blue]) = gained(&[arrow], none);
    assert!(contact_px > 20 && green > red && green > blue, "{contact_px} pixels, {red} {green} {blue}");
    let (force_px, [red, green, blue]) = gained(&[], arrow);
    assert!(force_px > 20 && red > blue && green > blue, "{force_px} pixels, {red} {green} {blue}");
    assert_eq!(gained(&[], none).0, 0, "an arrow of no length is none");
    gained(&[arrow], arrow);
    marks.clear(r.stage());
    assert_eq!(picture(&mut r, &outside), plain, "nothing of them stays");
}

#[test]
fn text_and_sign_are_written_and_wiped() {
    let Some(mut r) = renderer() else { return };
    let mut view = through_scope();
    let plain = picture(&mut r, &view);
    view.overlay = Overlay { lines: vec!["P 62".into()], sign: "!".into() };
    let written = picture(&mut r, &view);
    let ink = changed(&plain, &written);
    assert!((30..400).contains(&ink), "{ink} pixels of ink");
    let amber = written.chunks_exact(4).filter(|p| p[0] > 200 && p[2] < 100).count();
    assert!((3..40).contains(&amber), "{amber} pixels of the sign");
    view.overlay = Overlay::default();
    assert_eq!(picture(&mut r, &view), plain);
}

#[test]
fn a_smaller_inner_picture_shows_the_same_scene() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let mut view = through_scope();
    let full = picture(&mut r, &view);
    view.quality.scale = 0.5;
    let stats = r.render(&view).unwrap();
    assert_eq!(stats.inner_px, [60, 60]);
    let half = r.read_rgba().unwrap();
    let apart: u64 = full.iter().zip(half).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    assert!(apart / (full.len() as u64) < 8, "mean difference {}", apart / full.len() as u64);
    // A blurred one is as near in the mean, and lacks what is steep.
    let [all, left] = [&full[..], half].map(|shot| steps(shot, middle([40, 40]))[1]);
    println!("{left} of {all} of what is steep from pixel to pixel is left");
    assert!(left > 0.3 * all, "{left} of {all}");
}

#[test]
fn the_first_picture_is_not_overexposed_by_the_empty_stage_before_it() {
    let Some(mut r) = renderer() else { return };
    let mut view = through_scope();
    view.adaptation = 0.1;
    picture(&mut r, &view); // as the process draws before it has heard of any tissue
    put(&mut r, CAVITY, &shapes::cavity(0.045, 40, 48), Material::MucosaTissue);
    let first = picture(&mut r, &view);
    view.adaptation = 1.0;
    let metered = picture(&mut r, &view);
    assert_eq!(changed(&first, &metered), 0);
}
