//! Whether the pathology was in view while it was worked on: in the ticks with current, in all ticks of a session with less than a second of it. In view is
//! what the lens points at, as of a landmark (`sight`): the middle of the pathology that is nearest to the tip, where the seed has drawn it, in the picture,
//! near enough and with light. Whether the loop itself is in the picture is not asked: loop and optic are fixed to the scope, so that lies in its make and not
//! in how it is held.

use crate::force::length;
use crate::motion::{difference, finite};
use crate::sight::is_in_sight;
use hyst_messages::HardwareSample;
use hyst_scene::Brief;

/// Most pathologies that are looked for in each tick: a scene has no more objects.
const MOST: usize = 64;

/// With less current than this nothing was worked on, ticks: a tap on the pedal (assumption; a chip takes two to three seconds).
const WORK_TICKS: u64 = 1_000;

/// Ticks so far, of those whose pose is known, in a case with a pathology.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InView {
    /// All of them.
    pub ticks: u64,
    /// Of them with the pathology in view.
    pub seen_ticks: u64,
    /// With current.
    pub energised_ticks: u64,
    /// With current, and the pathology in view.
    pub energised_seen_ticks: u64,
}

impl InView {
    /// Takes one tick of a session with a case.
    pub fn tick(&mut self, brief: &Brief, sample: &HardwareSample) {
        let is_turned = sample.pose.orientation.iter().all(|part| part.is_finite());
        let Some(tip_m) = finite(sample.pose.position_m).filter(|_| is_turned) else { return };
        let far_m = |middle_m: [f64; 3]| length(difference(middle_m, tip_m));
        let middles_m = brief.pathologies_m.iter().copied().take(MOST);
        let Some(nearest_m) = middles_m.min_by(|a, b| far_m(*a).total_cmp(&far_m(*b))) else { return };
        let is_seen = is_in_sight(&brief.pathology_sight, nearest_m, sample);
        let is_energised = sample.controls.has_current();
        self.ticks += 1;
        self.seen_ticks += u64::from(is_seen);
        self.energised_ticks += u64::from(is_energised);
        self.energised_seen_ticks += u64::from(is_energised && is_seen);
    }

    /// Ticks in view, and the ticks of which they are a part: those with current, if there are enough.
    pub fn counted(&self) -> (u64, u64) {
        if self.energised_ticks < WORK_TICKS {
            return (self.seen_ticks, self.ticks);
        }
        (self.energised_seen_ticks, self.energised_ticks)
    }
}
