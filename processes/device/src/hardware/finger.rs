//! Whether somebody's finger is still on the current: who shows no sign of life has none there.
//!
//! Promise: what a window said last holds beyond it, but for the current: of one whose records have not gone on for a fifth of a second none is wanted. A
//! pause of the whole machine takes it from nobody.

use hyst_engine::Silence;
use hyst_messages::{BUTTONS_CURRENT, PointerRecord};

/// A window whose records have not gone on for so long has no finger on the current, ns.
const SILENT_NS: u64 = 200_000_000;
/// Of the time between two ticks at most this counts, ns: that of five of them.
const MOST_NS: u64 = 5_000_000;

/// The finger in the window.
pub struct Finger {
    silence: Silence,
}

impl Finger {
    /// Before anybody has said anything.
    pub fn new(now_ns: u64) -> Finger {
        Finger { silence: Silence::new(now_ns, MOST_NS) }
    }

    /// What the window said last, as it counts now; to be asked once in a tick.
    pub fn heed(&mut self, now_ns: u64, mut said: PointerRecord) -> PointerRecord {
        if self.silence.look(now_ns, said.sequence) >= SILENT_NS {
            said.controls.buttons &= !BUTTONS_CURRENT;
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls};

    #[test]
    fn a_pause_of_the_machine_takes_nobodys_finger_off_and_who_speaks_again_is_heard_at_once() {
        let buttons = BUTTON_ENERGIZED | BUTTON_EXTENDED;
        let controls = Controls { buttons, ..Controls::default() };
        let said = |sequence: u64| PointerRecord { sequence, controls, ..PointerRecord::default() };
        let (mut finger, mut now_ns) = (Finger::new(0), 0);
        let mut after_an_hour = |sequence: u64| {
            now_ns += 3_600_000_000_000;
            finger.heed(now_ns, said(sequence)).controls.buttons
        };
        // 39 looks after the first one are 195 ms, however long they took.
        assert!((0..40).all(|_| after_an_hour(7) == buttons));
        assert_eq!([7, 7, 8, 8].map(&mut after_an_hour), [BUTTON_EXTENDED, BUTTON_EXTENDED, buttons, buttons]);
        assert_eq!(after_an_hour(1), buttons, "a successor counts from the beginning");
    }
}
