//! Promises of the closing: at the parting pressure and above it nothing of it is left, to the last bit; below it follows the pressure at its own pace; the
//! closed shape is a slit that leaves canal and outside where they are, makes room for what grows, and is made of no cavity that is none.

use super::*;
use crate::world::Workshop;
use hyst_scene::load_embedded;
use hyst_tissue::Isa;

const TICK_S: f32 = 1e-3;
/// The default scene's walls part there, Pa.
const PARTING_PA: f32 = 40.0 * MMHG_PA;

/// How far a cavity is closed after so many ticks at a pressure.
fn after(closing: &Closing, closed: f32, pressure_pa: f32, ticks: usize) -> f32 {
    (0..ticks).fold(closed, |closed, _| closing.after(closed, pressure_pa, TICK_S))
}

#[test]
fn it_follows_the_pressure_at_its_own_pace_and_is_nothing_from_the_parting_pressure_on() {
    let closing = Closing::of(&load_embedded().unwrap());
    assert!((closing.parting_pa - PARTING_PA).abs() < 1.0, "{} Pa", closing.parting_pa);
    for pressure_pa in [closing.parting_pa, PARTING_PA + 1.0, 9_333.0, 20_000.0] {
        assert_eq!(after(&closing, 0.0, pressure_pa, 10).to_bits(), 0, "{pressure_pa} Pa");
        assert_eq!(after(&closing, 1.0, pressure_pa, 501).to_bits(), 0, "{pressure_pa} Pa: half a second opens it");
        assert!(after(&closing, 1.0, pressure_pa, 490) > 0.0, "{pressure_pa} Pa: not sooner");
    }
    let low_pa = 10.0 * MMHG_PA;
    assert_eq!(share(after(&closing, 0.0, low_pa, 95)), 0.0, "a tenth of a second moves nothing");
    assert!(share(after(&closing, 0.0, low_pa, 105)) > 0.0);
    assert_eq!(share(after(&closing, 0.0, low_pa, 501)), 1.0);
    let steady = [40.0, 36.0, 32.5, 29.0, 25.0, 5.0].map(|mmhg| share(after(&closing, 0.3, mmhg * MMHG_PA, 1_000)));
    assert!(steady[..5].windows(2).all(|pair| pair[1] > pair[0]), "less pressure, closer: {steady:?}");
    assert!(steady[0] < 1e-6 && (steady[2] - 0.5).abs() < 1e-3 && steady[4] > 0.9999 && steady[5] == 1.0, "{steady:?}");
    let by_four = closing.after(0.0, low_pa, 4.0 * TICK_S);
    assert!((by_four - after(&closing, 0.0, low_pa, 4)).abs() < 1e-6, "a step of four ticks: {by_four}");
}

#[test]
fn closed_it_is_a_slit_between_canal_and_rim_and_the_rest_stays_where_it_is() {
    let (_, world) = Workshop::open(&load_embedded().unwrap(), Isa::detect()).unwrap();
    let slit = world.case.closing.slit.as_ref().expect("the uterus has a slit");
    let (rest_m, shape_m) = (&world.body.rest.positions_m, slit.shape_m(&world.body));
    let owners = world.body.owners();
    let mut wall: Vec<usize> = world.wall.as_flattened().iter().map(|node| *node as usize).collect();
    wall.sort_unstable();
    wall.dedup();
    // The polyp hangs on the patient's right.
    let is_left = |[x, _, z]: [f32; 3]| (-6e-3..0.0).contains(&x) && (20e-3..40e-3).contains(&z);
    let middle: Vec<usize> = wall.iter().copied().filter(|node| is_left(rest_m[*node])).collect();
    assert!(middle.len() > 10, "{} nodes", middle.len());
    for node in middle {
        let (open_m, half_m) = (rest_m[node][1], shape_m[node][1] * rest_m[node][1].signum());
        assert!(open_m.abs() > 3e-3 && (0.3e-3..1.2e-3).contains(&half_m), "{:?}: {half_m} m", rest_m[node]);
    }
    for (node, (rest, shape)) in rest_m.iter().zip(&shape_m).enumerate() {
        let stays = owners[node] != Some(0) || world.body.fixed[node] || rest[2] < 1e-3;
        assert!(rest[0] == shape[0] && rest[2] == shape[2] && (!stays || rest[1] == shape[1]), "{rest:?}: {shape:?}");
    }
    assert!(wall.iter().all(|node| shape_m[*node][1] * rest_m[*node][1] >= 0.0), "no wall is beyond the middle");
    // Where the polyp is it has room: beside it, over its head, the walls stay farther apart than in the middle.
    let is_over_polyp = |[x, _, z]: [f32; 3]| (6e-3..9e-3).contains(&x) && (43e-3..48e-3).contains(&z);
    let over: Vec<f32> = wall.iter().filter(|node| is_over_polyp(rest_m[**node])).map(|node| shape_m[*node][1].abs()).collect();
    assert!(!over.is_empty() && over.iter().all(|half_m| *half_m > 2.5e-3), "{over:?}");
    assert!(world.notes.iter().any(|note| note == "uterus: below 40 mmHg its cavity closes to a slit, in 0.5 s"));
}

#[test]
fn what_holds_it_shut_presses_the_walls_together_and_pushes_nothing_else() {
    let (_, world) = Workshop::open(&load_embedded().unwrap(), Isa::detect()).unwrap();
    let (held_n, owners) = (world.shut_n(), world.body.owners());
    assert_eq!(held_n.len(), world.model.node_count());
    let of_wall = |of: fn(f32) -> bool| -> f32 {
        let nodes = world.wall.as_flattened().iter().map(|node| *node as usize);
        let mut nodes: Vec<usize> = nodes.filter(|node| of(world.body.rest.positions_m[*node][1])).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.into_iter().map(|node| held_n[node][1]).sum()
    };
    let [anterior_n, posterior_n] = [of_wall(|y| y > 1e-3), of_wall(|y| y < -1e-3)];
    assert!(anterior_n < -1.0 && posterior_n > 1.0, "{anterior_n} N in front, {posterior_n} N behind");
    let most_n = held_n.iter().map(|[x, y, z]| (x * x + y * y + z * z).sqrt()).fold(0.0, f32::max);
    assert!(most_n < 10.0, "{most_n} N at a node");
    assert!((0..held_n.len()).all(|node| owners[node] == Some(0) || held_n[node] == [0.0; 3]), "the polyp is pushed by nothing");
    let mut force_n = vec![[0.5f32; 3]; held_n.len()];
    world.shut(0.0, &mut force_n);
    assert!(force_n.iter().all(|force| *force == [0.5; 3]));
    world.shut(0.25, &mut force_n);
    let is_quarter =
        |(force, held): (&[f32; 3], &[f32; 3])| (0..3).all(|axis| (force[axis] - 0.5 - 0.25 * held[axis]).abs() < 1e-5);
    assert!(force_n.iter().zip(held_n).all(is_quarter));
}

#[test]
fn the_mirror_image_closes_to_the_mirror_image() {
    let scene = load_embedded().unwrap();
    let mut mirrored = scene.clone();
    for object in &mut mirrored.objects {
        object.mesh.positions_m.iter_mut().for_each(|place| place[1] = -place[1]);
        object.mesh.tets.iter_mut().for_each(|tet| tet.swap(1, 2));
    }
    let [own, other] = [&scene, &mirrored].map(|scene| Slit::of(scene, 0).unwrap());
    for place in &scene.objects[0].mesh.positions_m {
        let [x, y, z] = *place;
        let apart_m = own.closed_m([x, y, z])[1] + other.closed_m([x, -y, z])[1];
        assert!(apart_m.abs() < 1e-6, "{place:?}: {apart_m} m");
    }
}

#[test]
fn a_cavity_that_is_no_slit_stays_open_and_says_so_and_a_solid_organ_says_nothing() {
    let scene = load_embedded().unwrap();
    // As deep as wide.
    let mut round = scene.clone();
    round.objects[0].mesh.positions_m.iter_mut().for_each(|place| place[0] *= 0.33);
    let closing = Closing::of(&round);
    assert!(closing.slit.is_none() && closing.notes.len() == 1 && closing.notes[0].contains("stays open: it is no slit"));
    assert_eq!(after(&closing, 0.0, 100.0, 1_000), 0.0);
    assert_eq!(after(&closing, 1.0, 100.0, 501), 0.0, "whoever closed it, it opens");
    let mut solid = scene.clone();
    solid.objects[0].hollow = false;
    let closing = Closing::of(&solid);
    assert!(closing.slit.is_none() && closing.notes.is_empty());
    // Meshes that are open at 20 mmHg part there at the latest.
    let mut open = scene;
    open.fluid.rest_pressure_pa = 20.0 * MMHG_PA;
    let closing = Closing::of(&open);
    assert_eq!(after(&closing, 0.0, 20.0 * MMHG_PA, 1_000), 0.0);
    assert!(after(&closing, 0.0, 10.0 * MMHG_PA, 1_000) > 0.9);
}
