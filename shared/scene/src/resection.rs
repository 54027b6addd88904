//! The hand that cuts a chip from a pathology with the loop, found from the geometry: the loop goes out before the pathology and is brought beside it, cold;
//! at the far end it bites into it sideways with the current on, is drawn back along the shaft until it has left it, and goes away cold. So what it has
//! swept parts a chip. Cutting always towards oneself is what surgeons call slicing (Di Spiezio Sardo et al., Hum Reprod Update 2008; 14: 101–119).
//!
//! Then it opens the outflow and brings it to where the chip has sunk to ([`crate::rinse`]).
//!
//! Promise: along the whole way the shaft touches nothing, the loop nothing but the pathology, and that with its ring, while there is current in it.

use crate::electrode::LoadedLoop;
use crate::hands::{APPROACH_SHARE, Probe};
use crate::pose::{HandLeg, LoadedHand, Pose};
use crate::rinse::rinse;
use glam::{Quat, Vec3};

/// How deep the ring bites, as a share of its radius: its arms stay outside.
const BITE_SHARE: f32 = 0.6;
/// Sides from which the ring comes, as turns from the one that faces the axis of the cavity, in the order in which they are tried.
const SIDES_DEG: [f32; 8] = [0.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 180.0];
/// Distance in which the ring passes beside the pathology before it bites, and that it leaves it behind at the end.
const PASS_M: f32 = 0.001;
const LEAVE_M: f32 = 0.002;
/// Room that the loop leaves to all but the pathology: the hand follows its script within some tenths of a millimetre.
const ROOM_M: f32 = 0.000_5;
/// Steps along the shaft and across it in which the search looks, and in which a way is tried.
const ALONG_M: f32 = 0.000_5;
const ACROSS_M: f32 = 0.000_25;
/// Most steps along and across, and slices of a chip: what is larger than an organ's pathology is looked at more coarsely.
const MOST_STEPS: f32 = 128.0;
/// Halvings of the last step across: the bite is exact to a hundredth of a millimetre.
const HALVINGS: u32 = 5;
/// A chip of this size is taken at once, smaller ones only where no side gives more, and none below the least: cutting burns crumbs.
const GOOD_CHIP_M3: f32 = 8e-9;
const LEAST_CHIP_M3: f32 = 2e-9;
/// Cells per radius of the ring in which a chip is measured.
const CHIP_CELLS: f32 = 8.0;
/// Mean speeds of the ring: with the current off, and on, as loops are drawn through tissue.
const MOVE_M_S: f32 = 0.012;
const CUT_M_S: f32 = 0.006;
/// Mean speed of the roll.
const ROLL_RAD_S: f32 = 1.2;
/// Shortest leg, and shortest rest.
const LEAST_S: f64 = 0.5;
const REST_S: f64 = 0.6;
/// How long the outflow waits over a chip, wide open: what is carried with a few millimetres a second comes over a centimetre.
const RINSE_S: f64 = 2.0;
/// Speed at which a rest lets the loop go out and in: two thirds of the device's.
const LOOP_M_S: f32 = 0.02;

/// What the search needs to know of one pathology.
struct Search<'a> {
    probe: &'a Probe<'a>,
    electrode: &'a LoadedLoop,
    target: usize,
    /// Unit vector from the pivot to the middle of what of the pathology is free.
    middle: Vec3,
    /// Distances of the ring from the pivot at which it can be beside the pathology, ascending in equal steps.
    places_m: Vec<f32>,
    /// Step across, and a tilt at which the ring is beside the pathology wherever it is.
    step_rad: f32,
    widest_rad: f32,
}

/// How the instrument lies: its axis goes through the pivot.
struct Stand {
    axis: Vec3,
    /// To where the middle of the ring points, across the axis.
    arc: Vec3,
}

/// The poses of a resection, and about how much it cuts off.
struct Way {
    rest: Pose,
    /// Before the pathology, and with the ring at its far end, passing it.
    front: Pose,
    beside: Pose,
    /// The same two, but deep enough.
    bitten: Pose,
    drawn: Pose,
    chip_m3: f32,
}

/// The hand that cuts a chip from a pathology with these nodes. `None` without a loop, or where there is no room to draw it.
pub(crate) fn resection(probe: &Probe<'_>, target: usize, nodes_m: &[[f32; 3]]) -> Option<LoadedHand> {
    let search = Search::new(probe, probe.electrode?, target, nodes_m)?;
    let mut best: Option<Way> = None;
    for degrees in SIDES_DEG {
        let found = search.way_from(search.inwards(degrees.to_radians()));
        if let Some(way) = found.filter(|way| best.as_ref().is_none_or(|best| way.chip_m3 > best.chip_m3)) {
            best = Some(way);
        }
        if best.as_ref().is_some_and(|best| best.chip_m3 >= GOOD_CHIP_M3) {
            break;
        }
    }
    best.map(|way| search.hand(&way))
}

impl<'a> Search<'a> {
    fn new(probe: &'a Probe<'a>, electrode: &'a LoadedLoop, target: usize, nodes_m: &[[f32; 3]]) -> Option<Search<'a>> {
        let pivot_m = Vec3::from(probe.pivot_m);
        let is_free = |point: &[f32; 3]| (0..probe.objects.len()).all(|o| o == target || probe.objects[o].find(*point).is_none());
        let free_m: Vec<Vec3> = nodes_m.iter().filter(|point| is_free(point)).map(|&point| Vec3::from(point) - pivot_m).collect();
        let middle_m = free_m.iter().sum::<Vec3>() / free_m.len().max(1) as f32;
        let middle = middle_m.try_normalize()?;
        let ahead_m = |point: &Vec3| point.dot(middle);
        let near_m = free_m.iter().map(ahead_m).fold(f32::MAX, f32::min);
        let far_m = free_m.iter().map(ahead_m).fold(f32::MIN, f32::max);
        let size_m = free_m.iter().map(|point| point.distance(middle_m)).fold(0.0, f32::max);
        let along_m = ALONG_M.max((far_m - near_m) / MOST_STEPS);
        let places = ((far_m - near_m) / along_m) as usize + 2;
        let away_m = size_m + electrode.radius_m + PASS_M;
        let widest_rad = (away_m / middle_m.length()).min(1.0).asin();
        Some(Search {
            probe,
            electrode,
            target,
            middle,
            places_m: (0..places).map(|place| near_m + (place as f32 - 0.5) * along_m).collect(),
            step_rad: (ACROSS_M / middle_m.length()).max(widest_rad / MOST_STEPS),
            widest_rad,
        })
    }

    /// The direction into the pathology from a side, across the line to its middle; 0 is the side that faces the axis of the cavity.
    fn inwards(&self, turn_rad: f32) -> Vec3 {
        let outwards = Vec3::new(self.middle.x, self.middle.y, 0.0).normalize_or(Vec3::X);
        let into = outwards.reject_from_normalized(self.middle).normalize_or(Vec3::X);
        Quat::from_axis_angle(self.middle, turn_rad) * into
    }

    fn stand(&self, into: Vec3, away_rad: f32) -> Stand {
        let (sin, cos) = away_rad.sin_cos();
        Stand { axis: self.middle * cos - into * sin, arc: into * cos + self.middle * sin }
    }

    /// The pose in which the ring, out, stands so far from the pivot.
    fn pose(&self, stand: &Stand, ring_m: f32, facing: Vec3) -> Option<Pose> {
        let ring = Vec3::from(self.probe.pivot_m) + stand.axis * ring_m;
        let aimed = Pose::aim(self.probe.pivot_m, ring.to_array())?;
        let pose = Pose { insertion_m: aimed.insertion_m - self.electrode.reach_m, ..aimed }.facing(facing.to_array());
        (self.probe.clamp(pose) == pose).then_some(pose)
    }

    fn cuts(&self, stand: &Stand, ring_m: f32) -> bool {
        let centre = Vec3::from(self.probe.pivot_m) + stand.axis * ring_m;
        let right = stand.arc.cross(stand.axis);
        let mut wire = self.electrode.wire_m.iter().map(|[x, y, _]| centre + right * *x + stand.arc * *y);
        wire.any(|point| self.is_target(point))
    }

    fn is_target(&self, point: Vec3) -> bool {
        self.probe.objects[self.target].find(point.to_array()).is_some()
    }

    /// The tilt away from the pathology at which a ring at this place first touches it, coming from afar.
    fn first_touch_rad(&self, into: Vec3, ring_m: f32) -> Option<f32> {
        let steps = (self.widest_rad / self.step_rad) as u32;
        let touches = |away_rad: f32| self.cuts(&self.stand(into, away_rad), ring_m);
        let first = (0..=steps).map(|step| self.widest_rad - step as f32 * self.step_rad).find(|away_rad| touches(*away_rad))?;
        let (mut touching_rad, mut step_rad) = (first, self.step_rad);
        for _ in 0..HALVINGS {
            step_rad /= 2.0;
            if touches(touching_rad + step_rad) {
                touching_rad += step_rad;
            }
        }
        Some(touching_rad)
    }

    /// The way from one side: as far behind as there is room.
    fn way_from(&self, into: Vec3) -> Option<Way> {
        let touch_rad: Vec<Option<f32>> = self.places_m.iter().map(|&ring_m| self.first_touch_rad(into, ring_m)).collect();
        let last = touch_rad.iter().rposition(Option::is_some)?;
        // A step beyond the last touch the ring bites from behind.
        (0..=(last + 1).min(self.places_m.len() - 1)).rev().step_by(2).find_map(|far| {
            let touches = touch_rad[..=far].iter().zip(&self.places_m).filter_map(|(touch, place)| Some(((*touch)?, *place)));
            let (touch_rad, place_m) = touches.reduce(|most, other| if other.0 > most.0 { other } else { most })?;
            let bite = self.stand(into, touch_rad - BITE_SHARE * self.electrode.radius_m / place_m);
            let pass = self.stand(into, touch_rad + PASS_M / place_m);
            let far_m = self.places_m[far];
            let near_m = *self.places_m[..=far].iter().find(|&&place_m| self.cuts(&bite, place_m))?;
            let front_m = near_m - LEAVE_M;
            let front = self.pose(&pass, front_m, bite.arc)?;
            let way = Way {
                rest: self.probe.clamp(Pose::straight(front.insertion_m * APPROACH_SHARE)),
                front,
                beside: self.pose(&pass, far_m, bite.arc)?,
                bitten: self.pose(&bite, far_m, bite.arc)?,
                drawn: self.pose(&bite, front_m, bite.arc)?,
                chip_m3: self.chip_m3(&bite, near_m, far_m),
            };
            (way.chip_m3 >= LEAST_CHIP_M3 && self.is_free(&way)).then_some(way)
        })
    }

    /// About how much of the pathology lies within the ring's half circle on its way.
    fn chip_m3(&self, bite: &Stand, near_m: f32, far_m: f32) -> f32 {
        let radius_m = self.electrode.radius_m;
        let cell_m = radius_m / CHIP_CELLS;
        let slice_m = cell_m.max((far_m - near_m) / MOST_STEPS);
        let right = bite.arc.cross(bite.axis);
        let middle_m = |cell: u32| (cell as f32 + 0.5) * cell_m;
        let mut cells = 0u32;
        for slice in 0..((far_m - near_m) / slice_m) as u32 {
            let centre = Vec3::from(self.probe.pivot_m) + bite.axis * (near_m + (slice as f32 + 0.5) * slice_m);
            for (x, y) in (0..2 * CHIP_CELLS as u32).flat_map(|x| (0..CHIP_CELLS as u32).map(move |y| (x, y))) {
                let (x_m, y_m) = (middle_m(x) - radius_m, middle_m(y));
                cells += u32::from(x_m.hypot(y_m) < radius_m && self.is_target(centre + right * x_m + bite.arc * y_m));
            }
        }
        cells as f32 * cell_m * cell_m * slice_m
    }

    /// Whether the promise holds on the way. Its ends come first: there most fail.
    fn is_free(&self, way: &Way) -> bool {
        let Way { rest, front, beside, bitten, drawn, .. } = way;
        let reach_m = self.electrode.reach_m;
        let steps = (reach_m / ALONG_M) as u32;
        self.loop_is_free(bitten, reach_m, true)
            && self.loop_is_free(beside, reach_m, false)
            && self.loop_is_free(drawn, reach_m, false)
            && self.is_free_between(front, beside, false)
            && self.is_free_between(beside, bitten, true)
            && self.is_free_between(bitten, drawn, true)
            && self.is_free_between(drawn, front, false)
            && (0..=steps).all(|step| self.loop_is_free(front, step as f32 * ALONG_M, false))
            && self.steps_between(rest, front).all(|pose| self.probe.touched(&pose).is_none())
    }

    fn is_free_between(&self, from: &Pose, to: &Pose, may_cut: bool) -> bool {
        let reach_m = self.electrode.reach_m;
        self.steps_between(from, to).all(|pose| self.loop_is_free(&pose, reach_m, may_cut) && self.probe.touched(&pose).is_none())
    }

    fn steps_between<'p>(&self, from: &'p Pose, to: &'p Pose) -> impl Iterator<Item = Pose> + use<'p> {
        let steps = (self.ring_m(from).distance(self.ring_m(to)) / ALONG_M).ceil().max(1.0) as u32;
        (0..=steps).map(move |step| from.towards(to, step as f32 / steps as f32))
    }

    /// Where the ring is when it is out.
    fn ring_m(&self, pose: &Pose) -> Vec3 {
        pose.place(self.probe.pivot_m, [0.0, 0.0, self.electrode.reach_m]).into()
    }

    /// Whether the loop, so far out, has room on all sides. Only a ring that may cut touches the pathology.
    fn loop_is_free(&self, pose: &Pose, extension_m: f32, may_cut: bool) -> bool {
        let place = pose.placer(self.probe.pivot_m);
        let wider = 1.0 + ROOM_M / self.electrode.radius_m;
        let ring = || self.electrode.wire_at(extension_m);
        let arm = |step: u32| [-1.0, 1.0].map(|side| [side * self.electrode.radius_m, 0.0, extension_m - step as f32 * ALONG_M]);
        let arms = || (1..=(extension_m / ALONG_M) as u32).flat_map(arm);
        let is_in = |object: usize, point: [f32; 3]| self.probe.objects[object].find(place(point)).is_some();
        (0..self.probe.objects.len()).all(|object| {
            if object == self.target {
                return !arms().any(|point| is_in(object, point)) && (may_cut || !ring().any(|point| is_in(object, point)));
            }
            // Itself as well: what it is around may be within the wider one.
            let with_room = |[x, y, z]: [f32; 3]| [[x, y, z], [x * wider, y * wider, z], [x * wider, y * wider, z + ROOM_M]];
            !ring().chain(arms()).flat_map(with_room).any(|point| is_in(object, point))
        })
    }

    fn hand(&self, way: &Way) -> LoadedHand {
        let Way { rest, front, beside, bitten, drawn, .. } = way;
        let rest_s = REST_S.max(f64::from(self.electrode.reach_m / LOOP_M_S));
        let mut legs: Vec<HandLeg> = Vec::new();
        let mut from = rest;
        let cuts = [
            (rest, false, false),
            (front, false, false),
            (front, true, false),
            (beside, true, false),
            (bitten, true, true),
            (drawn, true, true),
            (drawn, true, false),
            (front, true, false),
            (front, false, false),
        ];
        // The outflow comes to the chip, waits there, and goes.
        let rinsed = rinse(self.probe, front, rest, self.ring_m(drawn));
        let rinses = rinsed.iter().flat_map(|over| [over, over]).map(|over| (over, true)).chain([(rest, rinsed.is_some())]);
        let cuts = cuts.into_iter().map(|(to, is_extended, is_energized)| (to, is_extended, is_energized, false));
        let rinses = rinses.map(|(to, is_rinsing)| (to, false, false, is_rinsing));
        for (to, is_extended, is_energized, is_rinsing) in cuts.chain(rinses) {
            let speed_m_s = if is_energized { CUT_M_S } else { MOVE_M_S };
            let moved_s = f64::from(self.ring_m(from).distance(self.ring_m(to)) / speed_m_s);
            let rolled_s = f64::from((to.roll_rad - from.roll_rad).abs() / ROLL_RAD_S);
            let time_s = match is_rinsing {
                _ if from != to => moved_s.max(rolled_s).max(LEAST_S),
                true => RINSE_S,
                false => rest_s,
            };
            legs.push(HandLeg { to: *to, time_s, is_extended, is_energized, is_coagulating: false, is_rinsing });
            from = to;
        }
        LoadedHand {
            name: "polyp".to_owned(),
            way: vec![*rest, *front, *beside, *bitten],
            period_s: legs.iter().map(|leg| leg.time_s).sum(),
            legs,
            target: Some(self.target),
            ..LoadedHand::default()
        }
    }
}
