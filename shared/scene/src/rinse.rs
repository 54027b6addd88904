//! The way on which the outflow of the instrument comes to a chip. It is two diameters behind the tip, where the lens does not look, and medium comes to it from
//! all around. Wet mucosa holds a chip of 10 mm³ against some 5 mm/s; a hand that goes back to where it rested, with the valve at 0.3, leaves it in 3 mm/s, and with
//! the outflow near it and wide open it is in 15 to 20 mm/s (default scene, 2026-11-25).
//!
//! Promise: along the way neither the shaft touches anything nor the loop, which is in.

use crate::hands::Probe;
use crate::pose::Pose;
use crate::rigid::OUTFLOW_RADII;
use glam::Vec3;
use std::f32::consts::TAU;

/// Steps in which the wall below is looked for, and how far.
const DOWN_M: f32 = 0.000_25;
const DEEPEST_M: f32 = 0.05;
/// Steps in which places for the outflow are tried, from that over the chip back to the pivot, and up.
const TRY_M: f32 = 0.001;
const TRIES_BACK: u32 = 16;
const TRIES_UP: u32 = 8;
/// Most that the optic is turned to the chip.
const MOST_TURN_RAD: f32 = 1.2;
/// Steps in which a way is tried.
const ALONG_M: f32 = 0.000_5;

/// Where the hand goes to draw in a chip that comes free at a place, from one pose and then on to another: its outflow is as near there to where the chip sinks
/// to as it can be. `None` where it comes no nearer than it was.
pub(crate) fn rinse(probe: &Probe<'_>, from: &Pose, to: &Pose, chip_m: Vec3) -> Option<Pose> {
    let behind_m = OUTFLOW_RADII[0] * probe.radius_m;
    let lies_m = sunk(probe, chip_m)?;
    let away_m = |pose: &Pose| Vec3::from(pose.place(probe.pivot_m, [0.0, 0.0, -behind_m])).distance(lies_m);
    // Down at the chip, by the shorter turn.
    let look = from.facing((-Vec3::Y).to_array()).roll_rad - from.roll_rad;
    let look = (look - (look / TAU).round() * TAU).clamp(-MOST_TURN_RAD, MOST_TURN_RAD);
    let pose = |back: u32, up: u32| {
        let over_m = lies_m + (probe.radius_m + up as f32 * TRY_M) * Vec3::Y;
        let aimed = Pose::aim(probe.pivot_m, over_m.to_array())?;
        let insertion_m = aimed.insertion_m - back as f32 * TRY_M + behind_m;
        let turned = probe.clamp(Pose { insertion_m, roll_rad: from.roll_rad + look, ..aimed });
        Some(turned)
            .filter(|pose| pose.insertion_m == insertion_m && [pose.pitch_rad, pose.yaw_rad] == [aimed.pitch_rad, aimed.yaw_rad])
    };
    let all = (0..TRIES_BACK).flat_map(|back| (0..TRIES_UP).map(move |up| (back, up)));
    let mut poses: Vec<Pose> = all.filter_map(|(back, up)| pose(back, up)).filter(|pose| away_m(pose) < away_m(from)).collect();
    poses.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
    let is_reached = |pose: &&Pose| is_clear(probe, pose) && is_free(probe, from, pose) && is_free(probe, pose, to);
    poses.iter().find(is_reached).copied()
}

/// Where what comes free at a place comes to lie: straight below it, on the first tissue that is not what it was cut from.
fn sunk(probe: &Probe<'_>, chip_m: Vec3) -> Option<Vec3> {
    let mut below = (0..(DEEPEST_M / DOWN_M) as u32).map(|step| chip_m - step as f32 * DOWN_M * Vec3::Y);
    let is_in_nothing = |point: &Vec3| probe.objects.iter().all(|object| object.find(point.to_array()).is_none());
    let first = below.find(is_in_nothing)?;
    Some(below.take_while(is_in_nothing).last().unwrap_or(first))
}

/// Whether neither the shaft touches anything in a pose, nor the ring of the loop, which is in.
fn is_clear(probe: &Probe<'_>, pose: &Pose) -> bool {
    let place = pose.placer(probe.pivot_m);
    let mut ring = probe.electrode.into_iter().flat_map(|electrode| electrode.wire_at(0.0)).map(place);
    probe.touched(pose).is_none() && !ring.any(|point| probe.objects.iter().any(|object| object.find(point).is_some()))
}

/// Whether that is so between two poses.
fn is_free(probe: &Probe<'_>, from: &Pose, to: &Pose) -> bool {
    let way_m = Vec3::from(from.tip_m(probe.pivot_m)).distance(to.tip_m(probe.pivot_m).into());
    let steps = (way_m / ALONG_M).ceil().max(1.0) as u32;
    (0..=steps).all(|step| is_clear(probe, &from.towards(to, step as f32 / steps as f32)))
}
