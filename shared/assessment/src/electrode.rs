//! The loop electrode: how long it was under each current, and how long of the one that cuts it worked on nothing.

use hyst_messages::{BUTTON_ENERGIZED, Controls, TissueStatus};

/// So long after a cut that changed the mesh the loop counts as cutting, ticks: it cuts again when it has swept 0.5 mm, which takes a hand less.
const WORKING_TICKS: u64 = 500;

/// The electrode so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Electrode {
    /// Ticks with the current that cuts.
    pub energised_ticks: u64,
    /// Of them those in which the tool touched nothing and nothing was cut.
    pub free_ticks: u64,
    /// How often that current was switched on.
    pub strokes: u64,
    /// Ticks with the current that coagulates.
    pub coagulating_ticks: u64,
    was_energised: bool,
    cuts: Option<u32>,
    works_until: u64,
}

impl Electrode {
    /// Takes one tick; the tool may be touching.
    pub fn tick(&mut self, tick: u64, controls: &Controls, is_touching: bool) {
        let is_energised = controls.buttons & BUTTON_ENERGIZED != 0;
        self.energised_ticks += u64::from(is_energised);
        self.free_ticks += u64::from(is_energised && !is_touching && tick >= self.works_until);
        self.strokes += u64::from(is_energised && !self.was_energised);
        self.coagulating_ticks += u64::from(controls.coagulates());
        self.was_energised = is_energised;
    }

    /// Takes a status of the tissue, which counts the cuts.
    pub fn status(&mut self, status: &TissueStatus) {
        if self.cuts.is_some_and(|cuts| status.cuts > cuts) {
            self.works_until = status.state_tick.saturating_add(WORKING_TICKS);
        }
        self.cuts = Some(status.cuts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{BUTTON_COAGULATING, BUTTONS_CURRENT};

    #[test]
    fn the_current_that_coagulates_counts_for_itself() {
        let mut electrode = Electrode::default();
        let pressed = |buttons: u32| Controls { buttons, ..Controls::default() };
        (0..100).for_each(|tick| electrode.tick(tick, &pressed(BUTTON_COAGULATING), false));
        (100..150).for_each(|tick| electrode.tick(tick, &pressed(BUTTONS_CURRENT), true)); // it cuts
        (150..200).for_each(|tick| electrode.tick(tick, &pressed(0), true));
        assert_eq!((electrode.coagulating_ticks, electrode.energised_ticks, electrode.free_ticks), (100, 50, 0));
    }

    #[test]
    fn current_without_contact_is_counted_until_the_loop_cuts() {
        let mut electrode = Electrode::default();
        let on = Controls { buttons: BUTTON_ENERGIZED, ..Controls::default() };
        let status = |state_tick, cuts| TissueStatus { state_tick, cuts, ..TissueStatus::default() };
        electrode.status(&status(0, 3));
        (0..100).for_each(|tick| electrode.tick(tick, &on, false)); // 100 free
        electrode.status(&status(100, 4));
        (100..700).for_each(|tick| electrode.tick(tick, &on, false)); // 500 cutting, then 100 free
        (700..800).for_each(|tick| electrode.tick(tick, &on, true)); // touching
        electrode.tick(800, &Controls::default(), false);
        electrode.tick(801, &on, true);
        assert_eq!((electrode.energised_ticks, electrode.free_ticks, electrode.strokes), (801, 200, 2));
    }
}
