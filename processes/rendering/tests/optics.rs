//! What lens, lamp and camera head do to a picture, by their formulas. Compared are a picture and one whose gain makes up for what is to be
//! found out, so that no test has to know the curve between light and pixels.
mod stand;

use rendering::{Appearance, Camera, Material, Renderer, View, shapes};
use stand::*;

/// Metal that gives light of its own: as bright from everywhere, with the lamp or without.
fn glowing() -> Appearance {
    Appearance { glow: 1.0, ..Appearance::of(Material::Metal) }
}

/// A glowing wall at 10 mm without a lamp, metered, whose exposure the returned view keeps.
fn glowing_wall(r: &mut Renderer) -> View {
    put_plain(r, CAVITY, &wall(0.010, 0.030), glowing());
    let mut view = View { light: 0.0, ..straight() };
    picture(r, &view);
    view.adaptation = 0.0;
    view
}

/// Distance of a pixel from the middle, as a share of the round field's radius.
fn radius([x, y]: [u32; 2]) -> f32 {
    let [dx, dy] = [x as f32 + 0.5 - 0.5 * WIDTH as f32, y as f32 + 0.5 - 0.5 * HEIGHT as f32];
    dx.hypot(dy) / (0.5 * HEIGHT as f32)
}

/// Pixels whose radius is in this range.
fn ring(range: std::ops::Range<f32>) -> impl Iterator<Item = [u32; 2]> {
    middle([WIDTH / 2, HEIGHT / 2]).filter(move |at| range.contains(&radius(*at)))
}

/// The radius at which the lens draws what is so far off its line of sight: its polynomial, solved by halving.
fn drawn_at(off_rad: f32, half_rad: f32, [first, second]: [f32; 2]) -> f32 {
    let wanted = off_rad.tan() / half_rad.tan();
    let (mut low, mut high) = (0.0_f32, 2.0_f32);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let square = middle * middle;
        let seen = middle * (1.0 + first * square + second * square * square) / (1.0 + first + second);
        if seen < wanted { low = middle } else { high = middle }
    }
    low
}

#[test]
fn what_lies_at_half_the_field_of_view_is_on_the_rim_and_what_lies_beyond_is_not_seen() {
    const SIZE_RAD: f32 = 0.04;
    let Some(mut r) = renderer() else { return };
    let mut view = glowing_wall(&mut r);
    r.stage().remove_object(CAVITY);
    for degrees in [60.0_f32, 90.0, 110.0] {
        let half_rad = 0.5 * degrees.to_radians();
        let Camera::Endoscope(scope) = &mut view.camera else { unreachable!() };
        scope.field_of_view_rad = 2.0 * half_rad;
        let lens = scope.distortion;
        // Radii of what is seen of a ball so far off the line of sight, in this direction from it.
        let mut seen = |off_rad: f32, turn: f32| {
            let along = glam::Vec3::new(off_rad.sin() * turn.cos(), off_rad.sin() * turn.sin(), off_rad.cos());
            let ball = shapes::ball((0.020 * along).to_array(), 0.020 * SIZE_RAD.sin(), 24, 32);
            put_plain(&mut r, TOOL, &ball, glowing());
            let shot = picture(&mut r, &view);
            ring(0.0..2.0).filter(|[x, y]| pixel(&shot, *x, *y)[0] > 30).map(radius).collect::<Vec<f32>>()
        };
        for turn in [0.0, 2.0, 3.1, 4.7] {
            let [inner, rim, outer] = [-1.6_f32, 0.0, 1.3].map(|sizes| seen(half_rad + sizes * SIZE_RAD, turn));
            let reach = |radii: &[f32]| radii.iter().fold([2.0_f32, 0.0], |[low, high], r| [low.min(*r), high.max(*r)]);
            let [low, high] = [-2.6_f32, -0.6].map(|sizes| drawn_at(half_rad + sizes * SIZE_RAD, half_rad, lens));
            let found = reach(&inner);
            println!("{degrees} degrees, {turn}: {} px in {found:?} of {low}..{high}; {} at the rim", inner.len(), rim.len());
            assert!((found[0] - low).abs() < 0.03 && (found[1] - high).abs() < 0.03, "{degrees}: {found:?} and {low}..{high}");
            assert!(!rim.is_empty() && rim.len() < inner.len() && reach(&rim)[0] > high - 0.08, "{degrees}: {:?}", reach(&rim));
            assert!(outer.is_empty(), "{degrees}: {:?}", reach(&outer));
        }
    }
}

#[test]
fn each_optic_has_its_line_of_sight_in_the_middle_and_what_lies_ahead_of_the_scope_as_far_below_as_it_looks_aside() {
    let Some(mut r) = renderer() else { return };
    let mut view = glowing_wall(&mut r);
    r.stage().remove_object(CAVITY);
    for degrees in [0.0_f32, 12.0, 30.0, 70.0] {
        let Camera::Endoscope(scope) = &mut view.camera else { unreachable!() };
        scope.oblique_rad = degrees.to_radians();
        let (lens, half_rad) = (scope.distortion, 0.5 * scope.field_of_view_rad);
        // How far from the middle a ball is drawn that lies so far from the scope's axis, to the side to which the optic looks; none if it is not.
        let mut seen = |off_rad: f32| {
            let along = glam::Vec3::new(0.0, off_rad.sin(), off_rad.cos());
            put_plain(&mut r, TOOL, &shapes::ball((0.020 * along).to_array(), 0.001, 24, 32), glowing());
            let shot = picture(&mut r, &view);
            let lit: Vec<[u32; 2]> = ring(0.0..2.0).filter(|[x, y]| pixel(&shot, *x, *y)[0] > 30).collect();
            let middle = |axis: usize| lit.iter().map(|at| at[axis] as f32 + 0.5).sum::<f32>() / lit.len() as f32;
            let side = 0.5 * HEIGHT as f32;
            (!lit.is_empty()).then(|| [middle(0) / side - WIDTH as f32 / HEIGHT as f32, middle(1) / side - 1.0])
        };
        let [sight, ahead] = [degrees.to_radians(), 0.0].map(&mut seen);
        println!("{degrees} degrees: {sight:?} on the line of sight, {ahead:?} ahead");
        assert!(sight.is_some_and(|[right, down]| right.abs() < 0.03 && down.abs() < 0.03), "{degrees}: {sight:?}");
        let wanted = (degrees < 45.0).then(|| drawn_at(degrees.to_radians(), half_rad, lens));
        assert_eq!(ahead.is_some(), wanted.is_some(), "{degrees}: {ahead:?}");
        let is_there = ahead.zip(wanted).is_none_or(|([right, down], wanted)| right.abs() < 0.03 && (down - wanted).abs() < 0.05);
        assert!(is_there, "{degrees}: {ahead:?}, wanted {wanted:?}");
    }
}

#[test]
fn light_falls_off_with_the_square_of_the_distance_softened_near_the_lamp() {
    let Some(mut r) = renderer() else { return };
    // Grey, matte, without vessels, dark enough to mirror hardly anything of the cavity's own light.
    let matte = Appearance { base_colour: [0.2; 3], roughness: 1.0, ..Appearance::of(Material::Flake) };
    let mut view = View { light: 0.5, ..straight() };
    put_plain(&mut r, CAVITY, &wall(0.010, 0.030), matte);
    picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let red = |r: &mut Renderer, view: &View| mean(&picture(r, view), 0, middle([6, 6]));
    let near = red(&mut r, &view);
    put_plain(&mut r, CAVITY, &wall(0.020, 0.060), matte);
    // The lamp is 1.3 mm beside the lens, and its fibres are as if 5 mm wide.
    let got = |far_m: f32| 1.0 / (far_m * far_m + 0.0013 * 0.0013 + 0.005 * 0.005);
    let ratio = got(0.010) / got(0.020);
    let mut far = |gain: f32| {
        view.gain = gain;
        red(&mut r, &view)
    };
    let [less, same, more] = [ratio / 1.12, ratio, 1.12 * ratio].map(&mut far);
    println!("red {near} at 10 mm; at 20 mm {same} with {ratio} times the gain, {less} and {more} with an eighth less and more");
    assert!((60.0..230.0).contains(&near), "the curve is steep there: {near}");
    assert!(less < near && near < more, "{near}: {less} {same} {more}");
    assert!(far(1.0) + 30.0 < near, "without more gain it is darker");
}

#[test]
fn exposure_comes_back_from_four_times_the_light_without_a_swing() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = View { light: 0.4, ..through_scope() };
    view.quality.bloom = false;
    let bright = |shot: &[u8]| mean(shot, 1, ring(0.0..0.85));
    let usual = bright(&picture(&mut r, &view));
    (view.light, view.adaptation) = (1.6, 0.3);
    let row: Vec<f32> = (0..16).map(|_| bright(&picture(&mut r, &view))).collect();
    println!("green {usual}, then {row:?}");
    assert!(row[0] > usual + 20.0, "{usual} {row:?}");
    assert!(row.windows(2).all(|pair| pair[1] < pair[0] + 0.2), "{row:?}");
    assert!((row[15] - usual).abs() < 12.0 && (row[15] - row[14]).abs() < 1.0, "{usual} {row:?}");
    // Back again, and from below.
    view.light = 0.4;
    let back: Vec<f32> = (0..16).map(|_| bright(&picture(&mut r, &view))).collect();
    assert!(back[0] < row[15] - 12.0 && back.windows(2).all(|pair| pair[1] > pair[0] - 0.2), "{back:?}");
    assert!((back[15] - usual).abs() < 2.5, "{usual} {back:?}");
}

#[test]
fn the_picture_darkens_towards_its_rim_and_from_outside_it_does_not() {
    let Some(mut r) = renderer() else { return };
    let mut view = glowing_wall(&mut r);
    let mut red = |gain: f32, range: std::ops::Range<f32>| {
        view.gain = gain;
        mean(&picture(&mut r, &view), 0, ring(range))
    };
    let shade = |radius: f32| 1.0 - 0.48 * radius.powi(4);
    for radius in [0.5_f32, 0.7, 0.9] {
        let here = red(1.0, radius - 0.02..radius + 0.02);
        let [less, more] = [0.93_f32, 1.07].map(|part| red(part * shade(radius), 0.0..0.15));
        println!("at {radius} red is {here}, in the middle with {} of the light {less} to {more}", shade(radius));
        assert!(less < here && here < more, "{radius}: {here} is not in {less}..{more}");
    }
    let [inside, rim] = [0.94..0.97, 0.99..1.0].map(|range| red(1.0, range));
    assert!(rim < 0.8 * inside, "it ends softly: {inside} {rim}");
    let wide = View { gain: 0.3, light: 0.0, ..close_up(0.010) };
    let shot = picture(&mut r, &wide);
    let [middle, corner] = [ring(0.0..0.15), ring(0.9..1.0)].map(|places| mean(&shot, 0, places));
    assert!((middle - corner).abs() < 0.04 * middle, "{middle} {corner}");
}

#[test]
fn what_is_brighter_than_white_glows_over_what_lies_beside_it() {
    let Some(mut r) = renderer() else { return };
    put(&mut r, TOOL, &shapes::ball([0.0, 0.0, 0.010], 0.003, 32, 48), Material::Metal);
    r.stage().set_appearance(TOOL, glowing()).expect("it is there");
    let mut view = close_up(0.010);
    let without = picture(&mut r, &view);
    view.quality.bloom = true;
    let with = picture(&mut r, &view);
    // A limb that is 17.5 degrees off the line of sight is drawn at 0.545 of the way to the upper rim, 60 pixels; its light goes less than 30 beyond it.
    let rise = |range: std::ops::Range<f32>| {
        let [with, without] = [&with, &without].map(|shot| mean(shot, 0, ring(range.clone())));
        with - without
    };
    let [beside, far] = [rise(0.58..0.66), rise(1.2..1.32)];
    println!("red is {beside} more beside it, {far} far off");
    assert!(beside > 8.0 && far.abs() < 1.0, "{beside} {far}");
}

#[test]
fn what_is_drawn_coarsely_is_as_bright_all_over_the_field_as_what_is_drawn_finely_and_ends_where_that_does() {
    let Some((mut r, _)) = in_cavity() else { return };
    let mut view = through_scope();
    (view.quality.bloom, view.quality.focus) = (false, false);
    picture(&mut r, &view); // which sets the exposure
    view.adaptation = 0.0;
    let fine = picture(&mut r, &view);
    let [inside, outside] = round_field();
    let is_lit = |shot: &[u8], [x, y]: [u32; 2]| pixel(shot, x, y)[0] > 25;
    for scale in [0.625_f32, 0.5, 0.375] {
        view.quality.scale = scale;
        let stats = r.render(&view).expect("a frame");
        let coarse = r.read_rgba().expect("a picture").to_vec();
        assert!(stats.passes_ms[4] > 0.0, "the lens is timed: {stats:?}");
        for (from, to) in [(0.0, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 0.95)] {
            let [fine, coarse] = [&fine, &coarse].map(|shot| mean(shot, 1, ring(from..to)));
            println!("at {scale}, from {from} to {to} of the field, green is {coarse} and finely {fine}");
            assert!((fine - coarse).abs() < 7.0, "{scale}, {from} to {to}: {coarse} and {fine}");
        }
        let [fine_dark, dark] = [&fine, &coarse].map(|shot| inside.iter().filter(|&&(x, y)| !is_lit(shot, [x, y])).count());
        assert!(dark < fine_dark + inside.len() / 50, "{scale}: {dark} pixels of the field are dark, finely {fine_dark}");
        assert!(outside.iter().all(|&(x, y)| pixel(&coarse, x, y) == [0; 3]), "{scale}: nothing is drawn outside of the field");
        let notch =
            [[WIDTH / 2, 2], [WIDTH / 2, HEIGHT - 3], [WIDTH / 2 + 6, 3]].map(|at| [&fine, &coarse].map(|shot| is_lit(shot, at)));
        assert!(notch.iter().all(|[fine, coarse]| fine == coarse) && !notch[0][0] && notch[1][0], "{scale}: {notch:?}");
    }
}
