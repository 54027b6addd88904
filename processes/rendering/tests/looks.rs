//! What each part of the tissue's looks does: the picture of a device that leaves it out lacks just that. Golden pictures, whose blocks
//! hold sixteen pixels, would not miss it.
mod stand;

use glam::Vec3;
use rendering::{Appearance, Material, Renderer, SurfaceMesh, View, Without, shapes};
use stand::*;

/// Nothing but colour and light.
const PLAIN: Without = Without { vessels: true, bump: true, wet: true, softness: false };
/// Light of the lamp of `close_up(0.020)` with which a ball at 10 mm gets about as much as it lights at its own distance.
const ASIDE: f32 = 0.33;
const BALL_M: Vec3 = Vec3::new(0.0, 0.0, 0.010);
const BALL_RADIUS_M: f32 = 0.003;

/// The picture of what `set` puts up, by a device with these looks.
fn shot(without: Without, view: &View, set: impl Fn(&mut Renderer)) -> Option<Vec<u8>> {
    let mut r = lacking(without)?;
    set(&mut r);
    Some(picture(&mut r, view))
}

fn lining(r: &mut Renderer) {
    put(r, CAVITY, &wall(0.008, 0.010), Material::MucosaTissue);
}

#[test]
fn vessels_are_lines_redder_and_darker_than_what_lies_about_them() {
    let bare = Without { vessels: false, ..PLAIN };
    let view = close_up(0.008);
    let Some(with) = shot(bare, &view, lining) else { return };
    let Some(without) = shot(PLAIN, &view, lining) else { return };
    let inner = middle([70, 50]);
    let all = inner.clone().count() as f32;
    let is_dark = |shot: &[u8], at: [u32; 2]| detail(shot, 1, at, [8, 8]) < -12.0;
    let [dark, spared] = [&with, &without].map(|shot| inner.clone().filter(|at| is_dark(shot, *at)).count() as f32 / all);
    let fall = |[x, y]: [u32; 2], channel: usize| pixel(&without, x, y)[channel] - pixel(&with, x, y)[channel];
    let vessels: Vec<[u32; 2]> = inner.clone().filter(|at| fall(*at, 1) > 12).collect();
    let share = vessels.len() as f32 / all;
    let [red, green] = [0, 1].map(|channel| vessels.iter().map(|at| fall(*at, channel)).sum::<i32>());
    println!("dark beside others: {dark}, without vessels {spared}; {share} of the pixels are vessels, fallen by {red}, {green}");
    assert!(dark > 0.012 && spared < 0.3 * dark, "{dark} {spared}");
    assert!((0.01..0.5).contains(&share) && 3 * red < 2 * green, "{share}: red falls by {red}, green by {green}");
    assert!(middle([70, 50]).all(|at| fall(at, 1) > -4), "a vessel lightens nothing");
}

#[test]
fn the_wall_is_uneven_where_light_grazes_it() {
    // The lamp stands as for what is at 20 mm, so that its light comes from aside.
    let view = View { light: 0.5 * ASIDE, ..close_up(0.020) };
    let Some(with) = shot(Without { bump: false, ..PLAIN }, &view, lining) else { return };
    let Some(without) = shot(PLAIN, &view, lining) else { return };
    // Red, of which the colours differ least from place to place.
    let uneven = |shot: &[u8]| {
        let squares = middle([70, 50]).map(|at| detail(shot, 0, at, [4, 4]).powi(2));
        squares.sum::<f32>() / middle([70, 50]).count() as f32
    };
    let (with, without) = (uneven(&with), uneven(&without));
    println!("{with} of unevenness, {without} without");
    assert!(with > 3.0 && with > 2.0 * without, "{with} {without}");
}

#[test]
fn a_wet_wall_has_glints_and_is_no_lighter_beside_them() {
    let dry = Without { wet: true, ..Without::default() };
    let view = close_up(0.008);
    let Some(with) = shot(Without::default(), &view, lining) else { return };
    let Some(without) = shot(dry, &view, lining) else { return };
    // Blue, of which tissue gives back least.
    let sorted = |shot: &[u8]| {
        let mut all: Vec<i32> = middle([40, 40]).map(|[x, y]| pixel(shot, x, y)[2]).collect();
        all.sort_unstable();
        all
    };
    let (wet, dry) = (sorted(&with), sorted(&without));
    let count = wet.len();
    let brightest = |all: &[i32]| all[count - count / 100..].iter().sum::<i32>() as f32 / (count / 100) as f32;
    let rise = brightest(&wet) - brightest(&dry);
    let usual = wet[count / 2] - dry[count / 2];
    println!("the brightest hundredth is {rise} brighter, the median {usual}");
    assert!(rise > 12.0 && (usual as f32) < 0.5 * rise, "{rise} {usual}");
}

/// The pixels of the ball for which this holds of its normal.
fn on_ball(is_meant: impl Fn(Vec3, Vec3) -> bool) -> Vec<[u32; 2]> {
    let meant = |at: &[u32; 2]| {
        let ray = ray(*at);
        let along = ray.dot(BALL_M);
        let square = along * along - BALL_M.length_squared() + BALL_RADIUS_M * BALL_RADIUS_M;
        // A little inside of the rim, where polygon and ball differ.
        square > 1.0e-7 && {
            let place = ray * (along - square.sqrt());
            is_meant(place, (place - BALL_M).normalize())
        }
    };
    middle([60, 58]).filter(meant).collect()
}

fn ball_of(material: Material) -> impl Fn(&mut Renderer) {
    move |r: &mut Renderer| put(r, TOOL, &shapes::ball(BALL_M.to_array(), BALL_RADIUS_M, 64, 96), material)
}

/// By how much red and green are brighter in one picture than in the other.
fn rises([with, without]: [&[u8]; 2], places: &[[u32; 2]]) -> [f32; 2] {
    let places = || places.iter().copied();
    [0, 1].map(|channel| mean(with, channel, places()) - mean(without, channel, places()))
}

#[test]
fn a_wet_ball_mirrors_the_light_at_its_rim() {
    let view = close_up(0.010);
    let wet = Without { wet: false, ..PLAIN };
    let Some(with) = shot(wet, &view, ball_of(Material::MucosaTissue)) else { return };
    let Some(without) = shot(PLAIN, &view, ball_of(Material::MucosaTissue)) else { return };
    // Where it is seen at a glance, and where it looks half away, with no glint in either: those lie towards the lamp.
    let facing = |place: Vec3, normal: Vec3| -place.normalize().dot(normal);
    let rim = on_ball(|place, normal| facing(place, normal) < 0.30);
    let inner = on_ball(|place, normal| (0.45..0.6).contains(&facing(place, normal)));
    let [rim, inner] = [rim, inner].map(|places| (places.len(), rises([&with, &without], &places)[1]));
    println!("at the rim {rim:?} greener, inside {inner:?}");
    assert!(rim.0 > 60 && inner.0 > 200 && rim.1 > 2.0 && rim.1 > 2.0 * inner.1, "{rim:?} {inner:?}");
}

#[test]
fn through_the_lens_the_rim_of_a_wet_ball_mirrors_the_walls_about_it_and_no_white() {
    let shot = |without: Without| {
        let mut r = lacking(without)?;
        // What is empty for the most part is exposed as long as can be.
        let mut view = View { gain: 0.06, ..straight() };
        ball_of(Material::Metal)(&mut r);
        picture(&mut r, &view); // which sets the exposure
        view.adaptation = 0.0;
        ball_of(Material::MucosaTissue)(&mut r);
        Some(picture(&mut r, &view))
    };
    let Some(wet) = shot(Without { wet: false, ..PLAIN }) else { return };
    let Some(dry) = shot(PLAIN) else { return };
    // A ball whose limb is 17.5 degrees off the line of sight is drawn with 23.3 of the 60 pixels; at 21 it is seen at a cosine of 0.4.
    let radius = |[x, y]: [u32; 2]| (x as f32 + 0.5 - 0.5 * WIDTH as f32).hypot(y as f32 + 0.5 - 0.5 * HEIGHT as f32);
    let rim: Vec<[u32; 2]> = middle([28, 28]).filter(|at| (21.0..23.0).contains(&radius(*at))).collect();
    let light = |shot: &[u8], channel: usize| {
        let of = |&[x, y]: &[u32; 2]| (pixel(shot, x, y)[channel] as f32 / 255.0).powf(2.2);
        rim.iter().map(of).sum::<f32>() / rim.len() as f32
    };
    let [red, blue] = [0, 2].map(|channel| light(&wet, channel) - light(&dry, channel));
    println!("red light is {red} more at the rim, blue {blue}");
    assert!(red > 0.002 && red > 1.9 * blue, "{red} {blue}");
}

#[test]
fn light_goes_around_an_edge_in_the_tissue_red_the_farthest_and_a_growths_limb_glows() {
    let far_m = 0.020;
    let view = View { light: ASIDE, ..close_up(far_m) };
    let lamp = far_m * Vec3::new(0.35, 0.45, 0.0);
    let lit = |place: Vec3, normal: Vec3| (lamp - place).normalize().dot(normal);
    let edge = on_ball(|place, normal| (-0.3..0.0).contains(&lit(place, normal)));
    let day = on_ball(|place, normal| lit(place, normal) > 0.9);
    let night = on_ball(|place, normal| lit(place, normal) < -0.44);
    assert!(edge.len() > 200 && day.len() > 100 && night.len() > 15, "{} {} {}", edge.len(), day.len(), night.len());
    let hard = Without { softness: true, ..PLAIN };
    // Flakes are shaped by no relief, and else shaded as growths are.
    for (material, glows) in [(Material::MucosaTissue, false), (Material::Flake, true)] {
        let Some(soft) = shot(PLAIN, &view, ball_of(material)) else { return };
        let Some(hard) = shot(hard, &view, ball_of(material)) else { return };
        let [edge, day, night] = [&edge, &day, &night].map(|places| rises([&soft, &hard], places));
        println!("{material:?}: soft is brighter by {edge:?} at the edge of the shadow, {day:?} in the light, {night:?} behind");
        assert!(edge[0] > 12.0 && edge[0] > 2.0 * edge[1], "{material:?}: {edge:?}");
        assert!(day.iter().all(|rise| rise.abs() < 4.0), "{material:?}: {day:?}");
        assert_eq!(night[0] > 12.0, glows, "{material:?}: {night:?}");
        assert!(glows || night[0].abs() < 2.0, "{material:?}: {night:?}");
    }
}

/// Puts up the wall of [`lining`], of a material, laid open where this holds of a place across it, m.
fn laid_open(material: Material, is_open: impl Fn(f32) -> bool) -> impl Fn(&mut Renderer) {
    move |r: &mut Renderer| {
        let wall = wall(0.008, 0.010);
        let raw: Vec<u32> = wall.positions_m.iter().map(|place| u32::from(is_open(place[0]))).collect();
        let appearance = Appearance::of(material);
        let mesh = SurfaceMesh { triangles: &wall.triangles, rest_m: &wall.positions_m, raw: &raw, appearance };
        r.stage().set_object(CAVITY, mesh).expect("a sound mesh");
    }
}

#[test]
fn what_is_laid_open_is_of_strands_and_paler_in_a_myoma() {
    let view = close_up(0.008);
    let shoot = |material: Material, is_open: bool| shot(PLAIN, &view, laid_open(material, |_| is_open));
    let Some(lining) = shoot(Material::MucosaTissue, false) else { return };
    let Some(wall) = shoot(Material::MucosaTissue, true) else { return };
    let Some(capsule) = shoot(Material::Myoma, false) else { return };
    let Some(myoma) = shoot(Material::Myoma, true) else { return };
    let [lining, wall, capsule, myoma] = [&lining, &wall, &capsule, &myoma].map(|shot| {
        let places = || middle([70, 50]);
        (steps(shot, places())[1], mean(shot, 1, places()))
    });
    println!("steps and green: lining {lining:?}, laid open {wall:?}; capsule {capsule:?}, laid open {myoma:?}");
    // Of stumps and coagulum alone it is three times as uneven as the lining, and a myoma a fifth as its capsule.
    assert!(wall.0 > 5.0 * lining.0 && myoma.0 > 4.0 * capsule.0, "{lining:?} {wall:?} {capsule:?} {myoma:?}");
    assert!(myoma.1 > wall.1 + 15.0, "{wall:?} {myoma:?}");
}

#[test]
fn the_wire_blanches_the_lining_beside_a_wound_and_scorches_the_edge() {
    let view = close_up(0.008);
    let Some(whole) = shot(PLAIN, &view, laid_open(Material::MucosaTissue, |_| false)) else { return };
    // +x is on the picture's left. The edge lies between the middle, pixel 80, and 2.5 mm beside it, pixel 112.
    let Some(cut) = shot(PLAIN, &view, laid_open(Material::MucosaTissue, |x_m| x_m > -1e-6)) else { return };
    let columns = |from: u32, to: u32| (from..to).flat_map(|x| (20..100).map(move |y| [x, y]));
    let scorched = |from: u32, to: u32| {
        let fallen = |&[x, y]: &[u32; 2]| pixel(&whole, x, y)[0] - pixel(&cut, x, y)[0] > 40;
        columns(from, to).filter(fallen).count()
    };
    let [wound, edge, lining] = [scorched(20, 80), scorched(84, 100), scorched(108, 150)];
    let [beside, far] = [columns(100, 106), columns(114, 150)].map(|places| {
        let paler = |channel: usize| mean(&cut, channel, places.clone()) - mean(&whole, channel, places.clone());
        [paler(0), paler(2)]
    });
    println!(
        "{edge} pixels of the edge are scorched, {wound} of the wound, {lining} of the lining; red and blue beside it {beside:?}, far {far:?}"
    );
    assert!(edge > 30 && wound < 5 && lining == 0, "{wound} {edge} {lining}");
    assert!(
        beside[1] > 5.0 && beside[0].abs() < 0.5 * beside[1] && far.iter().all(|rise| rise.abs() < 1.0),
        "{beside:?} {far:?}"
    );
}

#[test]
fn large_vessels_run_over_a_myoma() {
    let bare = Without { vessels: false, ..PLAIN };
    let view = close_up(0.008);
    let share = |material: Material| {
        let with = shot(bare, &view, laid_open(material, |_| false))?;
        let without = shot(PLAIN, &view, laid_open(material, |_| false))?;
        let fallen = |[x, y]: [u32; 2]| pixel(&without, x, y)[1] - pixel(&with, x, y)[1] > 25;
        Some(middle([70, 50]).filter(|at| fallen(*at)).count() as f32 / middle([70, 50]).count() as f32)
    };
    let (Some(polyp), Some(myoma)) = (share(Material::Polyp), share(Material::Myoma)) else { return };
    println!("{myoma} of a myoma is a vessel to be seen from afar, {polyp} of a polyp");
    assert!(myoma > 1.6 * polyp && (0.02..0.15).contains(&myoma), "{polyp} {myoma}");
}

#[test]
fn a_wire_that_has_cut_is_dark_with_what_has_burnt_on_it_and_glows_beside_that() {
    let view = close_up(0.006);
    // Eschar and glow of a loop before the lining, if there is one.
    let seen = |wire: Option<[f32; 2]>| {
        let set = |r: &mut Renderer| {
            lining(r);
            let Some([eschar, glow]) = wire else { return };
            put(r, TOOL, &shapes::loop_ring(0.0022, 0.000_15), Material::Metal);
            let appearance = Appearance { eschar, glow, roughness: 0.85, ..Appearance::of(Material::Metal) };
            r.stage().set_appearance(TOOL, appearance).expect("it is there");
            r.stage().set_pose(TOOL, [0.0, -0.001, 0.006], [0.0, 0.0, 0.0, 1.0]).expect("it is there");
        };
        shot(Without::default(), &view, set)
    };
    let Some(none) = seen(None) else { return };
    let wires = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [f32::NAN, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let all = wires.map(|wire| seen(Some(wire)).expect("as the first"));
    let is_wire =
        |[x, y]: &[u32; 2]| (0..3).any(|channel| pixel(&none, *x, *y)[channel].abs_diff(pixel(&all[0], *x, *y)[channel]) > 12);
    let places: Vec<[u32; 2]> = middle([78, 58]).filter(is_wire).collect();
    let green = all.each_ref().map(|shot| mean(shot, 1, places.iter().copied()));
    println!("{} pixels of wire, of a green of {green:?} with eschar and glow of {wires:?}", places.len());
    let [clean, some, full, nonsense, hot, hot_full] = green;
    assert!(places.len() > 200 && some < 0.97 * clean && full < 0.6 * clean, "{green:?}");
    assert!((nonsense - clean).abs() < 0.01 && hot_full > full + 30.0 && hot_full < 0.9 * hot, "{green:?}");
}

#[test]
fn a_coagulated_spot_is_charred_in_the_middle_white_about_it_and_fades_into_the_lining() {
    let view = close_up(0.008);
    let marked = |r: &mut Renderer| {
        lining(r);
        r.stage().set_spots(CAVITY, &[[0.0, 0.0, 0.008, 0.003]]).expect("it is there");
    };
    let Some(spot) = shot(PLAIN, &view, marked) else { return };
    let Some(plain) = shot(PLAIN, &view, lining) else { return };
    // By how much it is redder and greener than the lining between these shares of its radius, which is 39 pixels.
    let ring = |from: f32, to: f32| {
        let radius =
            |[x, y]: &[u32; 2]| (*x as f32 + 0.5 - 0.5 * WIDTH as f32).hypot(*y as f32 + 0.5 - 0.5 * HEIGHT as f32) / 39.0;
        let places: Vec<[u32; 2]> = middle([58, 58]).filter(|at| (from..to).contains(&radius(at))).collect();
        rises([&spot, &plain], &places)
    };
    let [core, white, rim, lining] = [ring(0.0, 0.15), ring(0.40, 0.55), ring(0.70, 0.95), ring(1.25, 1.45)];
    println!("red and green: core {core:?}, white {white:?}, rim {rim:?}, lining {lining:?}");
    assert!(core[0] < -12.0 && core[1] < 0.6 * white[1] && white[0].abs() < 8.0 && white[1] > 35.0, "{core:?} {white:?}");
    assert!((4.0..0.5 * white[1]).contains(&rim[1]) && lining[1].abs() < 2.0, "{white:?} {rim:?} {lining:?}");
}

/// The end of a horn as `close_up(0.008)` sees it, with this place of the tube's mouth in its middle, and with the mouth or without.
fn end_of_horn(mouth_m: Vec3, has_mouth: bool) -> impl Fn(&mut Renderer) {
    move |r: &mut Renderer| {
        let end = wall(0.008, 0.010);
        // In the organ it lies across the cavity's width.
        let rest_m: Vec<[f32; 3]> =
            end.positions_m.iter().map(|[x, y, _]| (mouth_m + Vec3::new(0.0, *y, *x)).to_array()).collect();
        let appearance = Appearance::of(Material::MucosaTissue);
        let mesh = SurfaceMesh { triangles: &end.triangles, rest_m: &rest_m, raw: &[], appearance };
        r.stage().set_object(CAVITY, mesh).expect("a sound mesh");
        r.stage().update_positions(CAVITY, &end.positions_m).expect("as many as before");
        let radius_m = if has_mouth { 0.0015 } else { 0.0 };
        r.stage().set_mouths(CAVITY, [mouth_m.extend(radius_m).to_array(), [0.0; 4]]).expect("it is there");
    }
}

/// How long some pixels lie in one direction, of how wide they lie across it: the root of their largest variance over their least.
fn elongation(pixels: &[[u32; 2]]) -> f32 {
    let mean =
        |of: &dyn Fn([f32; 2]) -> f32| pixels.iter().map(|at| of(at.map(|px| px as f32))).sum::<f32>() / pixels.len() as f32;
    let (x, y) = (mean(&|[x, _]| x), mean(&|[_, y]| y));
    let [xx, yy, xy] = [mean(&|[a, _]| (a - x).powi(2)), mean(&|[_, b]| (b - y).powi(2)), mean(&|[a, b]| (a - x) * (b - y))];
    let (half, apart) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    ((half + apart) / (half - apart).max(1e-3)).sqrt()
}

/// Both were black dots, as round and as large, in a pale ring.
#[test]
fn the_mouths_of_the_tubes_are_slits_in_a_red_dimple_and_the_two_are_unlike() {
    let view = close_up(0.008);
    // Those of the default organ.
    let mouths_m = [Vec3::new(0.014_609, -0.000_441, 0.045_152), Vec3::new(-0.014_525, 0.000_137, 0.045_775)];
    let mut slits: Vec<Vec<[u32; 2]>> = Vec::new();
    for mouth_m in mouths_m {
        let Some(with) = shot(PLAIN, &view, end_of_horn(mouth_m, true)) else { return };
        let Some(without) = shot(PLAIN, &view, end_of_horn(mouth_m, false)) else { return };
        let is_pit = |[x, y]: &[u32; 2]| 2 * pixel(&with, *x, *y)[1] < pixel(&without, *x, *y)[1];
        slits.push(middle([78, 58]).filter(is_pit).collect());
        // Its radius is 19.5 pixels.
        let off = |[x, y]: &[u32; 2]| (*x as f32 + 0.5 - 0.5 * WIDTH as f32).hypot(*y as f32 + 0.5 - 0.5 * HEIGHT as f32) / 19.5;
        let rises_at = |from: f32, to: f32| {
            let places: Vec<[u32; 2]> = middle([78, 58]).filter(|at| (from..to).contains(&off(at)) && !is_pit(at)).collect();
            rises([&with, &without], &places)
        };
        let [dimple, rim] = [rises_at(1.2, 1.6), rises_at(1.8, 2.2)];
        println!(
            "{} pixels of slit; red and green of the dimple {dimple:?}, farther out {rim:?}",
            slits.last().map_or(0, Vec::len)
        );
        assert!(
            dimple[1] < -15.0 && dimple[0] > 0.85 * dimple[1] && rim[1] < -4.0 && rim[1] > 0.7 * dimple[1],
            "{dimple:?} {rim:?}"
        );
    }
    let long = [0, 1].map(|which: usize| elongation(&slits[which]));
    let both = slits[0].iter().filter(|at| slits[1].contains(at)).count();
    let any = slits[0].len() + slits[1].len() - both;
    println!("{long:?} times as long as wide; {both} of {any} pixels in both");
    assert!(long.iter().all(|long| (1.7..6.0).contains(long)) && 2 * both < any, "{long:?}, {both} of {any}");
}
