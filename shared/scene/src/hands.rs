//! Scripted hands found from the geometry, for the scenes that name none: where the instrument is free, where it touches what.
//!
//! Everything is found by trying poses against the tets at rest, with the instrument's own collision points: what touches here,
//! touches in the simulation.

use crate::electrode::LoadedLoop;
use crate::file::{DeformableKind, Scene};
use crate::loaded::LoadedDeformable;
use crate::locate::{Locator, bounds};
use crate::pose::{LoadedHand, Pose};
use crate::resection::resection;

/// Steps in which the hand is moved to find a touch.
const STEP_M: f32 = 0.0005;
const STEP_RAD: f32 = 0.0025;
/// How far a press starts from the tissue, and how far it goes into it.
const PRESS_CLEARANCE_M: f32 = 0.003;
const PRESS_DEPTH_M: f32 = 0.004;
/// The press is made at this share of the way to the far wall: where the cavity is wide, and short of what hangs from the fundus.
const PRESS_SHARE: f32 = 0.7;
/// Periods of the found hands.
const PRESS_PERIOD_S: f64 = 2.0;
const EXPLORE_PERIOD_S: f64 = 12.0;
const POLYP_PERIOD_S: f64 = 6.0;
/// The approach to a pathology is straight up to this share of the way; tilting earlier would meet the narrow of the cervix.
pub(crate) const APPROACH_SHARE: f32 = 0.5;
/// Where the way to a pathology's middle meets the wall, aims nearer to the axis are tried: these shares of the middle's distance from it.
const AIM_SHARES: [f32; 6] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0];
/// A sweep never goes further than this, and stays this share of its way clear of the wall.
const SWEEP_RAD: f32 = 0.2;
const SWEEP_SHARE: f32 = 0.7;

/// What the search needs to know.
pub(crate) struct Probe<'a> {
    /// One per deformable, in the scene's order.
    pub(crate) objects: &'a [Locator],
    /// The held instrument's collision points.
    pub(crate) points_m: &'a [[f32; 3]],
    /// Its loop electrode.
    pub(crate) electrode: Option<&'a LoadedLoop>,
    /// Half its diameter.
    pub(crate) radius_m: f32,
    pub(crate) pivot_m: [f32; 3],
    /// Lowest and highest pitch, yaw, roll (radians) and insertion.
    pub(crate) pitch_rad: [f32; 2],
    pub(crate) yaw_rad: [f32; 2],
    pub(crate) roll_rad: [f32; 2],
    pub(crate) insertion_m: [f32; 2],
}

impl Probe<'_> {
    /// The first object that the instrument touches in this pose.
    pub(crate) fn touched(&self, pose: &Pose) -> Option<usize> {
        let placed: Vec<[f32; 3]> = self.points_m.iter().copied().map(pose.placer(self.pivot_m)).collect();
        self.objects.iter().position(|object| placed.iter().any(|&point| object.find(point).is_some()))
    }

    /// The first pose on the way `pose(0), pose(1) …` that touches, its step, and what it touches.
    fn first_touch(&self, steps: u32, pose: impl Fn(u32) -> Pose) -> Option<(u32, usize)> {
        (0..=steps).find_map(|step| self.touched(&pose(step)).map(|object| (step, object)))
    }

    /// The insertion at which the instrument touches when it goes in along this direction from this insertion, and what it touches.
    fn reach(&self, direction: &Pose, from_m: f32) -> Option<(f32, usize)> {
        let [low_m, high_m] = [self.insertion_m[0].max(from_m), self.insertion_m[1]];
        let at = |step: u32| Pose { insertion_m: low_m + step as f32 * STEP_M, ..*direction };
        let steps = ((high_m - low_m) / STEP_M).max(0.0) as u32;
        self.first_touch(steps, at).map(|(step, object)| (at(step).insertion_m, object))
    }

    /// How far the instrument can be tilted from a pose before it touches, as (pitch, yaw) per unit of the sweep; and what it touches.
    fn tilt(&self, from: &Pose, pitch: f32, yaw: f32) -> Option<(f32, usize)> {
        let at = |step: u32| tilted(from, pitch, yaw, step as f32 * STEP_RAD);
        let inside = |pose: &Pose| {
            (self.pitch_rad[0]..=self.pitch_rad[1]).contains(&pose.pitch_rad)
                && (self.yaw_rad[0]..=self.yaw_rad[1]).contains(&pose.yaw_rad)
        };
        let steps = (0..2_000).take_while(|&step| inside(&at(step))).last()?;
        self.first_touch(steps, at).map(|(step, object)| (step as f32 * STEP_RAD, object))
    }

    pub(crate) fn clamp(&self, pose: Pose) -> Pose {
        Pose {
            pitch_rad: pose.pitch_rad.clamp(self.pitch_rad[0], self.pitch_rad[1]),
            yaw_rad: pose.yaw_rad.clamp(self.yaw_rad[0], self.yaw_rad[1]),
            roll_rad: pose.roll_rad.clamp(self.roll_rad[0], self.roll_rad[1]),
            insertion_m: pose.insertion_m.clamp(self.insertion_m[0], self.insertion_m[1]),
        }
    }
}

fn tilted(from: &Pose, pitch: f32, yaw: f32, angle_rad: f32) -> Pose {
    Pose { pitch_rad: from.pitch_rad + pitch * angle_rad, yaw_rad: from.yaw_rad + yaw * angle_rad, ..*from }
}

/// The hands of the scene, those found from the geometry where it names none, and where the hand rests.
pub(crate) fn find(
    scene: &Scene,
    objects: &[LoadedDeformable],
    probe: &Probe<'_>,
    notes: &mut Vec<String>,
) -> (Vec<LoadedHand>, Pose) {
    let index_of = |name: &String| objects.iter().position(|object| object.name == *name);
    let mut hands: Vec<LoadedHand> = scene
        .hand
        .iter()
        .filter(|(_, hand)| hand.like.is_none())
        .map(|(name, hand)| LoadedHand::from_file(name, hand, hand.target.as_ref().and_then(index_of)))
        .collect();
    let explore = explore(probe);
    let rest = explore.way[0];
    let mut found = vec![Some(explore), press(probe, objects[0].hollow)];
    let is_pathology = |target: &usize| objects[*target].kind == DeformableKind::Pathology;
    let targets: Vec<usize> = (0..objects.len()).filter(is_pathology).collect();
    found.push(polyp(probe, objects, &targets, notes));
    if found[1].is_none() {
        notes.push("the instrument touches nothing within its limits; there is no hand `press`".to_owned());
    }
    if let Some(object) = probe.touched(&rest) {
        notes.push(format!("{}: the instrument touches it where the hand rests", objects[object].name));
    }
    for hand in found.into_iter().flatten() {
        if !scene.hand.contains_key(&hand.name) {
            hands.push(hand);
        }
    }
    for (name, hand) in &scene.hand {
        let Some(other) = &hand.like else { continue };
        let moves_itself = scene.hand.get(other).is_none_or(|one| one.like.is_none());
        let found = hands.iter().find(|found| found.name == *other && moves_itself);
        match found.map(|found| found.like(name, hand)) {
            Some(hand) => hands.push(hand),
            None => notes.push(format!("hand `{name}`: there is no hand `{other}` that it could move like; it is left out")),
        }
    }
    hands.sort_by(|a, b| a.name.cmp(&b.name));
    (hands, rest)
}

/// The hand into the wall and out. In a hollow organ it lowers the tip onto the posterior wall; else it goes straight into what lies
/// in front. `None` if nothing can be touched.
fn press(probe: &Probe<'_>, hollow: bool) -> Option<LoadedHand> {
    let front = probe.reach(&Pose::straight(0.0), 0.0);
    let end_m = front.map_or(probe.insertion_m[1], |(insertion_m, _)| insertion_m);
    let start = Pose::straight(probe.insertion_m[0] + (end_m - probe.insertion_m[0]) * PRESS_SHARE);
    let side = if hollow { probe.tilt(&start, 1.0, 0.0) } else { None };
    let (from, into, target) = match (side, front) {
        (Some((angle_rad, object)), _) if angle_rad > 0.0 => {
            let lower =
                |by_m: f32| probe.clamp(tilted(&start, 1.0, 0.0, angle_rad + (by_m / start.insertion_m.max(STEP_M)).atan()));
            (lower(-PRESS_CLEARANCE_M), lower(PRESS_DEPTH_M), object)
        }
        (_, Some((insertion_m, object))) => {
            let at = |by_m: f32| probe.clamp(Pose::straight(insertion_m + by_m));
            (at(-PRESS_CLEARANCE_M), at(PRESS_DEPTH_M), object)
        }
        _ => return None,
    };
    let way = vec![from, into];
    Some(LoadedHand { name: "press".to_owned(), way, period_s: PRESS_PERIOD_S, target: Some(target), ..LoadedHand::default() })
}

/// The hand that looks around: in, right, up, left, down, in again, and back, without touching.
fn explore(probe: &Probe<'_>) -> LoadedHand {
    let low_m = probe.insertion_m[0];
    let end_m = probe.reach(&Pose::straight(0.0), 0.0).map_or(probe.insertion_m[1], |(insertion_m, _)| insertion_m);
    let at = |share: f32| Pose::straight(low_m + (end_m - low_m) * share);
    let middle = at(0.75);
    let sweep = |pitch: f32, yaw: f32| {
        let free_rad = probe.tilt(&middle, pitch, yaw).map_or(SWEEP_RAD, |(angle_rad, _)| angle_rad * SWEEP_SHARE);
        probe.clamp(tilted(&middle, pitch, yaw, free_rad.min(SWEEP_RAD)))
    };
    let way = vec![at(0.2), middle, sweep(0.0, -1.0), sweep(-1.0, 0.0), sweep(0.0, 1.0), sweep(1.0, 0.0), middle, at(0.92)];
    LoadedHand { name: "explore".to_owned(), way, period_s: EXPLORE_PERIOD_S, ..LoadedHand::default() }
}

/// The hand that goes to the first pathology of which it can cut a chip with the loop; where there is none, to the first that it can press on.
fn polyp(probe: &Probe<'_>, objects: &[LoadedDeformable], targets: &[usize], notes: &mut Vec<String>) -> Option<LoadedHand> {
    let points_m = |target: usize| &objects[target].mesh.positions_m;
    let name_all = || targets.iter().map(|&target| objects[target].name.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(found) = targets.iter().find_map(|&target| resection(probe, target, points_m(target))) {
        return Some(found);
    }
    let found = targets.iter().find_map(|&target| {
        let (low, high) = bounds(points_m(target));
        touch(probe, target, ((low + high) / 2.0).to_array())
    });
    match &found {
        Some(hand) if probe.electrode.is_some() => notes.push(format!(
            "{}: there is no room to draw the loop along it; the hand `polyp` only touches {}",
            name_all(),
            objects[hand.target.unwrap_or(0)].name
        )),
        None if !targets.is_empty() => {
            notes.push(format!("{}: out of the instrument's reach; there is no hand `polyp`", name_all()));
        }
        _ => {}
    }
    found
}

/// The hand that goes to a pathology and presses on it: straight in, aim at its middle or nearer to the axis, touch. `None` if it is out of reach.
fn touch(probe: &Probe<'_>, target: usize, middle_m: [f32; 3]) -> Option<LoadedHand> {
    let [pivot_x, pivot_y, _] = probe.pivot_m;
    let (aim, insertion_m) = AIM_SHARES.iter().find_map(|share| {
        let aside = |middle: f32, pivot: f32| pivot + (middle - pivot) * share;
        let aim = Pose::aim(probe.pivot_m, [aside(middle_m[0], pivot_x), aside(middle_m[1], pivot_y), middle_m[2]])?;
        let reached = probe.reach(&aim, aim.insertion_m * APPROACH_SHARE);
        reached.filter(|&(_, object)| object == target).map(|(insertion_m, _)| (aim, insertion_m))
    })?;
    let at = |by_m: f32| probe.clamp(Pose { insertion_m: insertion_m + by_m, ..aim });
    let way =
        vec![probe.clamp(Pose::straight(insertion_m * APPROACH_SHARE)), at(-2.0 * PRESS_CLEARANCE_M), at(PRESS_DEPTH_M * 0.5)];
    Some(LoadedHand { name: "polyp".to_owned(), way, period_s: POLYP_PERIOD_S, target: Some(target), ..LoadedHand::default() })
}
