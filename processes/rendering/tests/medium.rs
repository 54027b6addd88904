//! What is in the medium: blood along the ray, and bubbles.
mod stand;

use rendering::{Bubbles, Camera, External, FluidField, Material, RenderError, View};
use stand::*;

/// A density that fills the cavity, 8 × 8 × 6 cells.
fn field(density: &[f32]) -> FluidField<'_> {
    let (min_m, max_m) = ([-0.02, -0.02, 0.0], [0.02, 0.02, 0.06]);
    FluidField { dims: [8, 8, 6], min_m, max_m, density, extinction_per_m: 600.0 }
}

/// Through the scope with nothing blurred and nothing glowing.
fn sharp() -> View {
    let mut view = through_scope();
    (view.quality.bloom, view.quality.focus) = (false, false);
    view
}

#[test]
fn blood_hides_the_view_and_a_clear_medium_does_not() {
    let Some((mut r, _)) = in_cavity() else {
        return;
    };
    let mut view = through_scope();
    view.adaptation = 0.0; // the exposure of the first frame stays
    let clear = picture(&mut r, &view);
    r.set_fluid(Some(field(&[0.0; 384]))).unwrap();
    assert_eq!(changed(&clear, &picture(&mut r, &view)), 0);
    r.set_fluid(Some(field(&[1.0; 384]))).unwrap();
    let bloody = picture(&mut r, &view);
    let [inside, _] = round_field();
    let green = |p: &[u8]| inside.iter().map(|&(x, y)| pixel(p, x, y)[1]).sum::<i32>();
    assert!(2 * green(&bloody) < green(&clear), "{} {}", green(&bloody), green(&clear));
    assert!(matches!(r.set_fluid(Some(field(&[1.0; 383]))), Err(RenderError::BadField { .. })));
    r.set_fluid(Some(field(&[f32::NAN; 384]))).unwrap();
    assert_eq!(changed(&clear, &picture(&mut r, &view)), 0);
    r.set_fluid(None).unwrap();
    assert_eq!(changed(&clear, &picture(&mut r, &view)), 0);
}

#[test]
fn a_veil_of_blood_takes_green_and_blue_before_red_and_much_of_it_is_dark_red() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = sharp();
    picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let [inside, _] = round_field();
    let mut colour = |density: f32| {
        r.set_fluid(Some(field(&[density; 384]))).unwrap();
        let shot = picture(&mut r, &view);
        [0, 1, 2].map(|channel| mean(&shot, channel, inside.iter().map(|&(x, y)| [x, y])))
    };
    let [clear, veil, thick] = [0.0, 0.05, 1.0].map(&mut colour);
    println!("clear {clear:?}, through a veil {veil:?}, much blood {thick:?}");
    assert!(veil[0] > 0.9 * clear[0] && veil[1] < 0.85 * clear[1] && veil[2] < 0.85 * clear[2], "{clear:?} {veil:?}");
    assert!(thick[0] + 10.0 < veil[0] && thick[0] > 2.5 * thick[1] && thick[1] >= thick[2], "{veil:?} {thick:?}");
}

#[test]
fn cells_that_are_coarse_are_smoothed_and_fine_ones_are_as_they_are() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = sharp();
    picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let mut shot = |dims: [u32; 3], of: &dyn Fn([usize; 2]) -> f32| {
        let [nx, ny, nz] = dims.map(|cells| cells as usize);
        let density: Vec<f32> = (0..nx * ny * nz).map(|cell| of([cell % nx, cell / nx % ny])).collect();
        let (min_m, max_m) = ([-0.024, -0.024, 0.0], [0.024, 0.024, 0.06]);
        let field = FluidField { dims, min_m, max_m, density: &density, extinction_per_m: 70.0 };
        r.set_fluid(Some(field)).unwrap();
        picture(&mut r, &view)
    };
    // Columns of 6 mm along the line of sight, of blood and of none by turns, in cells of 6 mm and of 0.75 mm.
    let chequered = |wide: usize| move |[x, y]: [usize; 2]| ((x / wide + y / wide) % 2) as f32;
    let even = shot([8, 8, 8], &|_| 0.5);
    let coarse = shot([8, 8, 8], &chequered(1));
    let fine = shot([64, 64, 17], &chequered(8));
    let [inside, _] = round_field();
    let off = |shot: &[u8]| {
        let green = |&(x, y): &(u32, u32)| (pixel(shot, x, y)[1] - pixel(&even, x, y)[1]).abs();
        inside.iter().map(green).sum::<i32>() as f32 / inside.len() as f32
    };
    // Read along straight lines coarse cells would differ from their mean by a quarter to 0.4 of what the columns do, and smoothed by a third of that.
    println!("green is {} off an even field's in coarse cells, {} in fine ones", off(&coarse), off(&fine));
    assert!(off(&fine) > 5.0 && off(&coarse) < 0.17 * off(&fine), "{} {}", off(&coarse), off(&fine));
}

#[test]
fn a_bubble_is_seen_where_it_is_and_nonsense_is_not() {
    let Some((mut r, _)) = in_cavity() else { return };
    let view = through_scope();
    let before = picture(&mut r, &view);
    let mut bubbles = Bubbles::new(77);
    // 1e-3 ml is a ball of 1.24 mm, which hangs from its place, here 8 mm before the lens: some 12 of the 120 pixels of 90°, so an area of about a hundred.
    let parcels =
        [[0.0, 6.2e-4, 0.023, 1e-3], [0.0; 4], [f32::NAN, 0.0, 0.02, 1e-3], [0.0, 0.0, 0.023, 1e9], [0.0, 0.0, 0.02, -1.0]];
    assert!(bubbles.show(r.stage(), &parcels).unwrap() > 0);
    let with = picture(&mut r, &view);
    let seen = changed(&before, &with);
    assert!((30..1_000).contains(&seen), "{seen} pixels");
    let about = |x: u32, y: u32| {
        pixel(&before, WIDTH / 2 + x - 10, HEIGHT / 2 + y - 10) != pixel(&with, WIDTH / 2 + x - 10, HEIGHT / 2 + y - 10)
    };
    let there = (0..20).flat_map(|x| (0..20).map(move |y| (x, y))).filter(|(x, y)| about(*x, *y)).count();
    assert!(there > seen / 2, "{there} of {seen} pixels are where it is");
    // More than there was room for, then more than are ever drawn, then none: nothing is left of them.
    for count in [100, 5_000] {
        let behind = vec![[0.0, 0.0, -0.05, 1e-3]; count];
        bubbles.show(r.stage(), &[&parcels[..1], &behind[..]].concat()).unwrap();
        assert_eq!(changed(&with, &picture(&mut r, &view)), 0, "{count} behind the lens");
    }
    assert_eq!(bubbles.show(r.stage(), &parcels[1..]).unwrap(), 0);
    assert!(!r.stage().ids().any(|id| id == 77));
    picture(&mut r, &view); // the exposure comes back
    assert_eq!(changed(&before, &picture(&mut r, &view)), 0);
}

#[test]
fn a_bubble_under_the_wall_hangs_from_it_and_is_seen_nearly_whole() {
    const RADIUS_M: f32 = 1.24e-3;
    let Some((mut r, cavity)) = in_cavity() else { return };
    let mut view = sharp();
    picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let before = picture(&mut r, &view);
    let is_above = |[x, y, z]: &&[f32; 3]| x.abs() < 1.5e-3 && *y > 0.0 && (z - 0.033).abs() < 1e-3;
    let ceiling_m = cavity.positions_m.iter().filter(is_above).map(|place| place[1]).fold(f32::INFINITY, f32::min);
    let mut bubbles = Bubbles::new(77);
    let mut seen = |top_m: f32| {
        bubbles.show(r.stage(), &[[0.0, top_m, 0.033, 8e-3]]).unwrap();
        changed(&before, &picture(&mut r, &view))
    };
    // As far below the axis and clear of the floor it is as large in the picture.
    let [under, free] = [seen(ceiling_m), seen(2.0 * RADIUS_M + 1e-3 - ceiling_m)];
    println!("{under} pixels of a bubble under the wall at {ceiling_m} m, {free} of one that is free");
    assert!(free > 40 && 10 * under > 7 * free, "{under} of {free}");
}

#[test]
fn a_bubble_is_clear_in_its_middle_has_a_dark_ring_and_shows_the_lamp() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = sharp();
    let before = picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    // 8e-3 ml is a ball of 2.5 mm, 8 mm before the lens: its radius is 11.9 of the 60 pixels of 45°, whose middle is drawn at 1.27 of its size.
    Bubbles::new(77).show(r.stage(), &[[0.0, 1.24e-3, 0.023, 8e-3]]).unwrap();
    let with = picture(&mut r, &view);
    let radius = |[x, y]: [u32; 2]| (x as f32 + 0.5 - 0.5 * WIDTH as f32).hypot(y as f32 + 0.5 - 0.5 * HEIGHT as f32);
    let ring: Vec<[u32; 2]> = middle([14, 14]).filter(|at| (9.0..10.3).contains(&radius(*at))).collect();
    let [dark, usual] = [&with, &before].map(|shot| mean(shot, 1, ring.iter().copied()));
    let lamp = middle([2, 2]).map(|[x, y]| pixel(&with, x, y)[1] - pixel(&before, x, y)[1]).max().unwrap_or(0);
    let clear = [[76, 59], [76, 60], [83, 59], [83, 60]].map(|[x, y]: [u32; 2]| {
        let (with, before) = (pixel(&with, x, y), pixel(&before, x, y));
        (0..3).map(|channel| (with[channel] - before[channel]).abs()).max().unwrap_or(0)
    });
    println!("the ring is {dark} where there was {usual}; the lamp is {lamp} brighter; the middle is {clear:?} off");
    assert!(dark < usual - 12.0 && lamp > 40 && clear.iter().all(|off| *off <= 12), "{dark} {usual}, {lamp}, {clear:?}");
    // Beside it nothing is other than before: it throws no shadow.
    let beside = middle([40, 40]).filter(|at| radius(*at) > 14.0);
    let other = beside
        .filter(|[x, y]| (0..3).any(|channel| (pixel(&with, *x, *y)[channel] - pixel(&before, *x, *y)[channel]).abs() > 12));
    assert_eq!(other.count(), 0);
}

/// The organ from its right side, of which all to that side is cut away.
fn section() -> View {
    let (eye_m, target_m) = ([0.060, 0.0, 0.025], [0.0, 0.0, 0.025]);
    View::new(Camera::External(External { eye_m, target_m, clip: Some(([1.0, 0.0, 0.0], 0.0)), ..External::default() }))
}

/// Blood of the half that is cut away lay red over the section, and its bubbles hung before that.
#[test]
fn a_section_shows_neither_blood_nor_gas_of_the_half_that_is_cut_away_and_both_of_the_other() {
    let Some((mut r, _)) = in_cavity() else { return };
    let view = section();
    let clear = picture(&mut r, &view);
    // Farther from the cut than blood frays.
    let mut with_blood = |[low_m, high_m]: [f32; 2]| {
        let (min_m, max_m) = ([low_m, -0.02, 0.0], [high_m, 0.02, 0.06]);
        r.set_fluid(Some(FluidField { dims: [8, 8, 6], min_m, max_m, density: &[1.0; 384], extinction_per_m: 600.0 })).unwrap();
        let shot = picture(&mut r, &view);
        r.set_fluid(None).unwrap();
        changed(&clear, &shot)
    };
    let [gone, left] = [[0.006, 0.020], [-0.020, -0.004]].map(&mut with_blood);
    println!("{gone} pixels of blood that is cut away, {left} of what is left");
    assert!(gone == 0 && left > 1_000, "{gone} {left}");
    let across = with_blood([-0.020, 0.020]);
    assert!(10 * across > 9 * left, "what is cut through shows where it is left: {across} and {left}");
    let mut bubbles = Bubbles::new(77);
    let mut with_gas = |x_m: f32| {
        bubbles.show(r.stage(), &[[x_m, 0.002, 0.030, 0.03]]).unwrap();
        changed(&clear, &picture(&mut r, &view))
    };
    let [gone, left] = [0.006, -0.006].map(&mut with_gas);
    println!("{gone} pixels of gas that is cut away, {left} of what is left");
    assert!(gone == 0 && left > 20, "{gone} {left}");
}

#[test]
fn from_outside_without_a_section_blood_shows_wherever_it_is() {
    let Some(mut r) = renderer() else { return };
    let mut view = section();
    let Camera::External(outside) = &mut view.camera else { unreachable!() };
    outside.clip = None;
    let mut behind = wall(0.0, 0.020);
    behind.positions_m.iter_mut().for_each(|place| *place = [-0.021, place[1], place[0] + 0.025]);
    put(&mut r, CAVITY, &behind, Material::Polyp);
    let clear = picture(&mut r, &view);
    let mut with_blood = |[low_m, high_m]: [f32; 2]| {
        let (min_m, max_m) = ([low_m, -0.02, 0.0], [high_m, 0.02, 0.06]);
        r.set_fluid(Some(FluidField { dims: [8, 8, 6], min_m, max_m, density: &[1.0; 384], extinction_per_m: 600.0 })).unwrap();
        changed(&clear, &picture(&mut r, &view))
    };
    let sides = [[0.006, 0.020], [-0.020, -0.004]].map(&mut with_blood);
    assert!(sides.iter().all(|pixels| *pixels > 1_000), "{sides:?}");
}

/// Each parcel was one ball, all of them of one size, and a string of them a row of pearls.
#[test]
fn parcels_that_are_alike_are_bubbles_that_are_not() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = sharp();
    let before = picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let mut bubbles = Bubbles::new(77);
    // The others of the row lie behind the lens.
    let mut shown = |number: usize| {
        let mut parcels = [[0.0, 0.0, -0.05, 4e-3]; 16];
        parcels[number] = [0.0, 1e-3, 0.023, 4e-3];
        bubbles.show(r.stage(), &parcels).unwrap();
        picture(&mut r, &view)
    };
    let all: Vec<Vec<u8>> = (0..16).map(&mut shown).collect();
    let pixels = all.iter().map(|shot| changed(&before, shot)).collect::<Vec<_>>();
    let alike = (1..16).filter(|number| changed(&all[number - 1], &all[*number]) < 20).count();
    println!("{pixels:?} pixels of each, {alike} of 15 like the one before");
    assert!(pixels.iter().all(|pixels| *pixels > 40) && alike < 4, "{pixels:?}, {alike} alike");
    let again = shown(1);
    assert_eq!(changed(&all[1], &again), 0, "it stays as it is");
}
