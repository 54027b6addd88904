//! Promise of the Main Loop about tissue that lies on other tissue: it stays where it is until it is pushed with more than friction holds, and slides then by what
//! is left over; what it sticks to is in the state, and no number there does harm.

use super::lattice::{self, Lattice};
use super::pieces::{flow, sunk, velocity_m_s};
use super::*;
use crate::contacts::{LAW, Stuck};
use crate::state::{STUCK, stuck_of};
use glam::Vec3;
use hyst_scene::LoadedScene;
use hyst_tissue::Isa;

/// Edge of the cells, m. A layer of them is held; a cube of so many on a side, one cell above it, is free.
pub(super) const EDGE_M: f32 = 2e-3;
const SIDE: usize = 5;
/// The cube's number.
pub(super) const CUBE: u32 = 1;
/// Its way down onto the layer, m, about as deep as its weight presses it in; and to the side, so that their nodes are not above each other.
const DOWN_M: Vec3 = Vec3::new(0.3 * EDGE_M, -EDGE_M - 3e-5, 0.4 * EDGE_M);
/// Far denser than any tissue, so that it is pressed on by more than rounding, kg/m³; and the medium.
const DENSITY_KG_M3: f64 = 5_000.0;
const MEDIUM_KG_M3: f64 = 1_000.0;
/// Ticks until it lies still, in which the medium flows past it slowly, and fast.
const SETTLES: u64 = 300;
const STAYS: u64 = 300;
const SLIDES: u64 = 100;
/// How fast that is, m/s: it drags with half of what friction holds, and with nearly three times that.
const SLOW_M_S: f64 = 0.2;
const FAST_M_S: f64 = 0.5;
/// What stays does not go farther than this, m.
const STILL_M: f32 = 2e-5;

/// What friction holds for each kg of the cube, N.
fn held_m_s2() -> f64 {
    f64::from(LAW.friction) * 9.806_65 * (1.0 - MEDIUM_KG_M3 / DENSITY_KG_M3)
}

/// What the medium drags each kg of it with where it flows past it so fast, N: the drag on a ball of its volume (Abraham 1970).
fn drag_m_s2(past_m_s: f64) -> f64 {
    let side_m = SIDE as f64 * f64::from(EDGE_M);
    let diameter_m = (6.0 * side_m.powi(3) / std::f64::consts::PI).cbrt();
    let width = past_m_s.sqrt() + 9.06 * (1e-6 / diameter_m).sqrt();
    0.75 * 24.0 / 9.06f64.powi(2) * MEDIUM_KG_M3 / (DENSITY_KG_M3 * diameter_m) * width * width * past_m_s
}

/// The layer and the cube, of tissue that is stiff for its weight and comes to rest soon.
pub(super) fn scene(name: &str) -> LoadedScene {
    let cells = Lattice { cells: [15, 2 + SIDE, 8], edge_m: [EDGE_M; 3], low_m: [0.0; 3] };
    let is_there = |[x, y, z]: [usize; 3]| y == 0 || y >= 2 && (2..2 + SIDE).contains(&x) && (1..=SIDE).contains(&z);
    let layer = format!("{{ box = {{ min_m = [-0.001, -0.001, -0.001], max_m = [0.1, {:.4}, 0.1] }} }}", 1.1 * EDGE_M);
    let folder = lattice::scene_of(name, "pathology", &cells, is_there, &layer);
    let mut scene = crate::world::load_scene(Some(folder.scene().as_path())).unwrap();
    for object in &mut scene.objects {
        object.material.density_kg_m3 = DENSITY_KG_M3;
        object.material.youngs_modulus_pa *= 10.0;
        object.material.damping_per_s = 30.0;
    }
    scene
}

/// An engine of that scene.
pub(super) fn engine_of<'a>(scene: &LoadedScene, station: &Station, life: &'a Life, inbox: &mut Inbox) -> MainLoop<'a> {
    let (workshop, world) = Workshop::open(scene, Isa::detect()).unwrap();
    assert!(world.objects[CUBE as usize].is_free_piece());
    let mut main = MainLoop::new(life, workshop, world).unwrap();
    main.arrival(page_of(station, Role::Device), inbox);
    main
}

/// A flow past the cube.
fn along(speed_m_s: f64) -> PieceFlow {
    PieceFlow { object: CUBE, velocity_m_s: [speed_m_s as f32, 0.0, 0.0] }
}

/// The cube lies on the layer, and is at rest.
fn lying(main: &mut MainLoop<'_>, device: &OwnedPage) -> Vec<u64> {
    let first = first_state(main);
    let now = moved(main, &first, DOWN_M);
    flow(main, device, now, PieceFlow::default(), 1..SETTLES)
}

/// A state in which the cube is elsewhere.
fn moved(main: &MainLoop<'_>, state: &[u64], by_m: Vec3) -> Vec<u64> {
    let (range, owners, mut state) = (place_of(state, 1), main.world.body.owners(), state.to_vec());
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut state);
    let positions_m: &mut [[f32; 3]] = bytemuck::cast_slice_mut(&mut bytes[range]);
    for (place_m, _) in positions_m.iter_mut().zip(owners).filter(|(_, owner)| *owner == Some(CUBE)) {
        *place_m = (Vec3::from(*place_m) + by_m).to_array();
    }
    state
}

/// What the nodes of a state stick to.
pub(super) fn stuck(state: &[u64]) -> &[Stuck] {
    stuck_of(&Message::parse(bytemuck::cast_slice(state), Kind::TissueState).unwrap())
}

/// A state in which that is changed.
fn sticking(state: &[u64], change: impl Fn(&mut Stuck)) -> Vec<u64> {
    let (range, mut state) = (place_of(state, STUCK), state.to_vec());
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut state);
    let stuck: &mut [Stuck] = bytemuck::cast_slice_mut(&mut bytes[range]);
    stuck.iter_mut().for_each(change);
    state
}

/// A state whose sections are these, or as much of them.
fn shortened(state: &[u64], sizes: &[usize]) -> Vec<u64> {
    let message = Message::parse(bytemuck::cast_slice(state), Kind::TissueState).unwrap();
    let mut shorter = vec![0u64; message_bytes(sizes) / 8];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut shorter);
    let parts = MessageMut::format(bytes, Kind::TissueState, *message.header(), sizes).unwrap().split();
    for (index, part) in parts.into_iter().enumerate().take(sizes.len()) {
        let whole: &[u8] = message.section(index).unwrap();
        part.copy_from_slice(&whole[..part.len()]);
    }
    shorter
}

#[test]
fn what_lies_on_tissue_stays_under_half_of_what_friction_holds_and_slides_by_what_is_more() {
    let (station, pages, life, mut inbox) = begun("slides");
    let mut main = engine_of(&scene("slides"), &station, &life, &mut inbox);
    let share = drag_m_s2(SLOW_M_S) / held_m_s2();
    assert!((0.4..0.6).contains(&share), "it is dragged with {share} of what friction holds");
    let now = lying(&mut main, &pages[1]);
    let lay = sunk(&main, &now, CUBE).1;
    let now = flow(&mut main, &pages[1], now, along(SLOW_M_S), SETTLES..SETTLES + STAYS);
    let crept_m = (sunk(&main, &now, CUBE).1 - lay).x;
    println!("crept by {:.2} µm in {STAYS} ms", 1e6 * crept_m);
    assert!(crept_m.abs() < STILL_M, "{crept_m} m in {STAYS} ms");

    let now = flow(&mut main, &pages[1], now, along(FAST_M_S), SETTLES + STAYS..SETTLES + STAYS + SLIDES);
    let speed_m_s = velocity_m_s(&main, &now, CUBE).x;
    let speeds_up = |speed_m_s: f64| drag_m_s2(FAST_M_S - speed_m_s) - held_m_s2();
    let expected_m_s = (0..SLIDES).fold(0.0, |speed_m_s, _| speed_m_s + 1e-3 * speeds_up(speed_m_s));
    println!("slides with {speed_m_s} m/s after {SLIDES} ms, expected {expected_m_s}");
    assert!((f64::from(speed_m_s) / expected_m_s - 1.0).abs() < 0.1, "{speed_m_s} m/s, not {expected_m_s}");
    drop(main);
}

#[test]
fn who_goes_on_from_a_state_of_tissue_that_sticks_is_rubbed_alike_and_nothing_there_does_harm() {
    let (station, pages, life, mut inbox) = begun("sticks");
    let scene = scene("sticks");
    let [mut holder, mut successor] = [(); 2].map(|()| engine_of(&scene, &station, &life, &mut inbox));
    let mut now = lying(&mut holder, &pages[1]);
    let end = SETTLES + 40;
    for tick in SETTLES..end {
        let before = now.clone();
        now = flow(&mut holder, &pages[1], now, along(SLOW_M_S), tick..tick + 1);
        if tick.is_multiple_of(10) {
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
    }
    let sticks = stuck(&now).iter().filter(|stuck| **stuck != Stuck::default()).count();
    assert!((30..=36).contains(&sticks), "{sticks} of the 36 nodes that lie on the layer stick to it");
    let mut after = |state: Vec<u64>| flow(&mut holder, &pages[1], state, along(SLOW_M_S), end..end + 1);

    let knows = after(now.clone());
    let forgets = after(sticking(&now, |stuck| *stuck = Stuck::default()));
    assert!(positions(&knows) != positions(&forgets), "what it sticks to makes no difference");
    for bent_m in [f32::NAN, f32::INFINITY, 1e30, -0.03, 0.01] {
        let hurt = after(sticking(&now, |stuck| stuck.bent_m = [bent_m; 3]));
        assert!(positions(&hurt).as_flattened().iter().all(|part| part.is_finite()), "{bent_m}");
        assert!(stuck(&hurt).iter().flat_map(|stuck| stuck.bent_m).all(|part| part.abs() < 1e-4), "{bent_m}");
    }
    let unsure = after(sticking(&now, |stuck| stuck.out = [0.0; 3]));
    for out in [f32::NAN, f32::INFINITY, 1e30] {
        assert!(after(sticking(&now, |stuck| stuck.out = [out; 3])) == unsure, "{out}: a way that is none is nothing");
    }
    // What another engine does not know, and what is no section of a state.
    let sizes = sections(&successor.world, 0);
    let left_out = shortened(&now, &sizes[..STUCK]);
    assert!(successor.accepts(bytemuck::cast_slice(&left_out)));
    assert!(after(left_out) == forgets, "what is left out is nothing");
    let mut short = sizes;
    short[STUCK] -= size_of::<Stuck>();
    let short = shortened(&now, &short);
    assert!(!successor.accepts(bytemuck::cast_slice(&short)));
    assert_eq!(successor.why_refused(bytemuck::cast_slice(&short)), Refusal::Sections);
    // What is lifted sticks to nothing.
    let lifted = after(moved(&successor, &now, 1e-3 * Vec3::Y));
    assert!(stuck(&lifted).iter().all(|stuck| *stuck == Stuck::default()));
    drop((holder, successor));
}
