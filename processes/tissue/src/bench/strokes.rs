//! Where the wires go whose cuts are timed: a straight one goes through what is cut in parallel strokes; the station's loop where the hand of the scene that
//! cuts draws it, or straight through where there is no such hand.

use crate::knife::wire_m;
use crate::world::Case;
use hyst_mesh::check;
use hyst_messages::{BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls, Pose};
use hyst_scene::{DeformableKind, LoadedHand, LoadedScene};

/// Way of the wire in a tick of 1 ms, m: 0.2 m/s, faster than a hand cuts.
const WAY_M: f32 = 2e-4;
/// Most ticks: a way of 0.2 m.
const MAX_TICKS: usize = 1_000;
/// Where the middle of an object is, as a share of its width.
pub const MIDDLE: f32 = 0.5;
/// Where the Main Loop's strokes go through it, each of them through the scene as it was loaded: one stroke has too few cuts for a percentile.
pub const PLACES: [f32; 5] = [0.3, 0.4, MIDDLE, 0.6, 0.7];
/// How far the instrument is turned about its axis in each of the loop's strokes, degrees, for the same reason: the half ring stays on its circle, its arms
/// outside of what it bites into, and its points come to other places of the tissue.
pub const TURNS_DEG: [f32; 5] = [-20.0, -10.0, 0.0, 10.0, 20.0];
/// Most ticks of such a stroke: ten seconds with the current on.
const MAX_LOOP_TICKS: usize = 10_000;

/// The box around the scene's first pathology, m; without one around its organ.
fn bounds_m(scene: &LoadedScene) -> Result<[[f32; 3]; 2], String> {
    let first = scene.objects.iter().position(|object| object.kind == DeformableKind::Pathology).unwrap_or(0);
    let object = scene.objects.get(first).ok_or("the scene has no deformable object")?;
    let found = check(&object.mesh);
    Ok([found.min_m, found.max_m])
}

/// How far along z a stroke through a box has come in each tick, m.
fn ways_m([low, high]: [[f32; 3]; 2]) -> impl Iterator<Item = f32> {
    (0..MAX_TICKS).map(move |tick| low[2] - WAY_M + tick as f32 * WAY_M).take_while(move |z| *z <= high[2] + WAY_M)
}

/// Where the wire is in each tick of a stroke through a place of the object, m.
pub fn wires(scene: &LoadedScene, place: f32) -> Result<impl Iterator<Item = [[f32; 3]; 3]>, String> {
    let [low, high] = bounds_m(scene)?;
    let x = low[0] + place * (high[0] - low[0]);
    let margin = 0.5 * (high[1] - low[1]);
    let at = move |z: f32| [[x, low[1] - margin, z], [x, 0.5 * (low[1] + high[1]), z], [x, high[1] + margin, z]];
    Ok(ways_m([low, high]).map(at))
}

/// Where a wire is in each tick, m; nowhere where there is no current in it.
pub type Wires = Vec<Option<Vec<[f32; 3]>>>;

/// The hand of the scene that cuts with the loop: `polyp`, or the first by name.
pub fn cutting_hand(scene: &LoadedScene) -> Option<&LoadedHand> {
    let is_cutting = |hand: &&LoadedHand| hand.legs.iter().any(|leg| leg.is_energized);
    scene.hand("polyp").filter(is_cutting).or_else(|| scene.hands.iter().find(is_cutting))
}

/// Where a hand has the instrument in each tick in which the current is on, with the mean speed of each leg, and turned about its axis; nowhere in between.
fn cutting_poses(hand: &LoadedHand, turn_rad: f32) -> impl Iterator<Item = Option<hyst_scene::Pose>> {
    let begins = hand.legs.last().into_iter().chain(&hand.legs);
    let along = begins.zip(&hand.legs).flat_map(move |(begin, leg)| {
        let ticks = if leg.is_energized { (1e3 * leg.time_s).ceil() as usize } else { 0 };
        let at = move |tick: usize| {
            let pose = begin.to.towards(&leg.to, tick as f32 / ticks as f32);
            Some(hyst_scene::Pose { roll_rad: pose.roll_rad + turn_rad, ..pose })
        };
        (1..=ticks).map(at).chain((ticks == 0).then_some(None))
    });
    along.take(MAX_LOOP_TICKS)
}

/// The same where no hand cuts: straight through the middle of a box, so that the ring, which stands so far before the tip, is there.
fn poses_through(bounds_m: [[f32; 3]; 2], reach_m: f32, turn_rad: f32) -> Vec<Option<Pose>> {
    let [low, high] = bounds_m;
    let [x, y, _]: [f32; 3] = std::array::from_fn(|axis| low[axis] + MIDDLE * (high[axis] - low[axis]));
    let orientation = hyst_scene::Pose { roll_rad: turn_rad, ..hyst_scene::Pose::default() }.orientation();
    ways_m(bounds_m).map(|z| Some(Pose { position_m: [x, y, z - reach_m], orientation, ..Pose::default() })).collect()
}

/// Where the station's loop is in a stroke, turned so far; `None` of a scene without one.
pub fn loop_wires(scene: &LoadedScene, case: &Case, turn_deg: f32) -> Result<Option<Wires>, String> {
    let Some(electrode) = &case.electrode else { return Ok(None) };
    let turn_rad = turn_deg.to_radians();
    let poses: Vec<Option<Pose>> = match cutting_hand(scene) {
        Some(hand) => cutting_poses(hand, turn_rad).map(|pose| pose.map(|pose| case.pose_of(&pose))).collect(),
        None => poses_through(bounds_m(scene)?, electrode.reach_m, turn_rad),
    };
    let buttons = BUTTON_EXTENDED | BUTTON_ENERGIZED;
    let controls = Controls { buttons, loop_extension_m: electrode.reach_m, ..Controls::default() };
    Ok(Some(poses.iter().map(|pose| wire_m(Some(electrode), pose.as_ref()?, &controls)).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Workshop;
    use hyst_scene::HandLeg;
    use hyst_tissue::Isa;

    #[test]
    fn without_a_hand_that_cuts_the_ring_goes_all_the_way_through_the_middle_and_without_a_loop_nowhere() {
        let mut scene = crate::world::load_scene(None).unwrap();
        scene.hands.clear();
        let wires_of = |scene: &LoadedScene| {
            let (_, world) = Workshop::open(scene, Isa::detect()).unwrap();
            loop_wires(scene, &world.case, 90.0).unwrap()
        };
        let wires = wires_of(&scene).expect("the scene has a loop");
        let [low, high] = bounds_m(&scene).unwrap();
        // The middle of the half ring, which stands to +y, is turned to -x.
        let radius_m = scene.rigid[0].electrode.as_ref().unwrap().radius_m;
        let [[x, y, first], [_, _, last]] = [&wires[0], &wires[wires.len() - 1]].map(|wire_m| wire_m.as_ref().unwrap()[8]);
        assert!((x + radius_m - 0.5 * (low[0] + high[0])).abs() < 1e-5 && (y - 0.5 * (low[1] + high[1])).abs() < 1e-5, "{x} {y}");
        assert!(first < low[2] && last > high[2] - WAY_M, "from {first} to {last}, through {low:?} to {high:?}");
        scene.rigid[0].electrode = None;
        assert!(wires_of(&scene).is_none(), "there is no loop");
    }

    #[test]
    fn a_stroke_of_the_loop_has_the_ticks_of_the_legs_with_current_and_ends_where_that_is_off() {
        let leg = |to: f32, time_s: f64, is_energized: bool| HandLeg {
            to: hyst_scene::Pose::straight(to),
            time_s,
            is_extended: true,
            is_energized,
            is_coagulating: false,
            is_rinsing: false,
        };
        let told = [(1.0, 0.002, true), (3.0, 0.001, true), (5.0, 600.0, false), (6.0, 0.001, true), (0.0, 1.0, false)];
        let legs = told.map(|(to, time_s, is_energized)| leg(to, time_s, is_energized)).to_vec();
        let hand = LoadedHand { legs, ..LoadedHand::default() };
        let poses: Vec<_> = cutting_poses(&hand, 0.5).collect();
        let reached: Vec<_> = poses.iter().map(|pose| pose.map(|pose| (pose.insertion_m, pose.roll_rad))).collect();
        let at = |insertion_m: f32| Some((insertion_m, 0.5));
        assert_eq!(reached, [at(0.5), at(1.0), at(3.0), None, at(6.0), None], "it begins where the last leg ends");
        let long = LoadedHand { legs: vec![leg(1.0, 600.0, true)], ..LoadedHand::default() };
        assert_eq!(cutting_poses(&long, 0.0).count(), MAX_LOOP_TICKS);
    }
}
