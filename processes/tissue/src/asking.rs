//! Whether a step shares the intersection test with the workers or makes it alone: on few cores a share may take longer to come back than to compute. Which
//! way is the cheaper one is found by trying the other now and then.
//!
//! Promise: nothing but time depends on it, the hits are the same. In lock-step, in test mode and with `--set workers=always` the workers are asked in each
//! step, as they are for a while after one has come: whoever put it there wants to see it work.

use hyst_engine::{Failure, Life};

/// Steps from the end of a trial to the end of the next.
const EVERY: u32 = 2_000;
/// Steps of a trial, and those before it that it is compared with.
const TRIED: u32 = 20;
/// Fewer steps of a kind say nothing of it.
const LEAST: usize = TRIED as usize / 2;
/// Steps in which all are asked after one has come: more than any probation takes.
const NEWCOMER: u32 = 10_000;
/// The way that is in use stays unless the other takes less by more than this part of it: what makes no difference is not changed for ever.
const MARGIN: u64 = 20;

/// What is known of the two ways.
pub struct Asking {
    is_fixed: bool,
    /// The test is made alone, but in a trial.
    is_alone: bool,
    /// Steps of this round.
    step: u32,
    /// Steps in which all are still asked.
    newcomer: u32,
    shared_ns: Vec<u64>,
    alone_ns: Vec<u64>,
}

impl Asking {
    /// As the station's settings have it.
    pub fn new(life: &Life) -> Result<Asking, Failure> {
        let word = life.settings.word("workers", ["auto", "always"], "auto or always")?;
        Ok(Asking::with(word == "always" || life.is_lockstep() || life.clock.test_mode()))
    }

    fn with(is_fixed: bool) -> Asking {
        let room = || Vec::with_capacity(TRIED as usize);
        Asking { is_fixed, is_alone: false, step: 0, newcomer: NEWCOMER, shared_ns: room(), alone_ns: room() }
    }

    /// A worker has come.
    pub fn welcome(&mut self) {
        self.newcomer = NEWCOMER;
        self.begin();
    }

    /// Whether the workers are asked in this step.
    pub fn asks(&self) -> bool {
        let is_trial = self.step >= EVERY - TRIED;
        self.is_fixed || self.newcomer > 0 || self.is_alone == is_trial
    }

    /// What the test of a step took, and whether it was shared: with nobody there it was not, whoever was asked.
    pub fn note(&mut self, was_shared: bool, took_ns: u64) {
        if self.is_fixed || self.newcomer > 0 {
            self.newcomer = self.newcomer.saturating_sub(1);
            return;
        }
        if self.step >= EVERY - 2 * TRIED {
            let samples = if was_shared { &mut self.shared_ns } else { &mut self.alone_ns };
            if samples.len() < samples.capacity() {
                samples.push(took_ns);
            }
        }
        self.step += 1;
        if self.step == EVERY {
            self.judge();
            self.begin();
        }
    }

    fn begin(&mut self) {
        self.step = 0;
        self.shared_ns.clear();
        self.alone_ns.clear();
    }

    fn judge(&mut self) {
        let (Some(shared_ns), Some(alone_ns)) = (median(&mut self.shared_ns), median(&mut self.alone_ns)) else { return };
        let (own_ns, other_ns) = if self.is_alone { (alone_ns, shared_ns) } else { (shared_ns, alone_ns) };
        self.is_alone ^= other_ns + own_ns / MARGIN < own_ns;
    }
}

fn median(samples: &mut [u64]) -> Option<u64> {
    samples.sort_unstable();
    samples.get(samples.len() / 2).copied().filter(|_| samples.len() >= LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that ask, of so many whose tests take so long; workers are there or not.
    fn asked(asking: &mut Asking, steps: u32, [shared_ns, alone_ns]: [u64; 2], are_there: bool) -> u32 {
        (0..steps).fold(0, |asked, step| {
            let asks = asking.asks();
            let stall_ns = if step % 7 == 0 { 1_000_000 } else { 0 };
            let shared = asks && are_there;
            asking.note(shared, stall_ns + if shared { shared_ns } else { alone_ns });
            asked + u32::from(asks)
        })
    }

    #[test]
    fn the_cheaper_way_is_taken_after_a_trial_and_the_other_one_tried_again() {
        let mut asking = Asking::with(false);
        assert_eq!(asked(&mut asking, NEWCOMER, [200, 100], true), NEWCOMER, "who has come is asked");
        assert_eq!(asked(&mut asking, EVERY, [200, 100], true), EVERY - TRIED, "all but those of the trial");
        assert_eq!(asked(&mut asking, 3 * EVERY, [200, 100], true), 3 * TRIED, "those of the trials");
        assert_eq!(asked(&mut asking, EVERY, [100, 200], true), TRIED);
        assert_eq!(asked(&mut asking, EVERY, [100, 97], true), EVERY - TRIED, "it pays again");
        assert_eq!(asked(&mut asking, EVERY, [100, 97], true), EVERY - TRIED, "what makes no difference stays");
    }

    #[test]
    fn a_newcomer_is_asked_and_without_anybody_nothing_is_changed() {
        let mut asking = Asking::with(false);
        asked(&mut asking, NEWCOMER + EVERY, [200, 100], true);
        assert!(!asking.asks());
        asking.welcome();
        assert_eq!(asked(&mut asking, NEWCOMER, [100, 200], true), NEWCOMER);
        assert!(!asking.asks(), "what was found stays until it is tried again");
        asked(&mut asking, EVERY, [100, 200], false);
        assert!(!asking.asks(), "a trial in which nobody was there says nothing");
    }

    #[test]
    fn where_it_is_said_all_are_asked_always() {
        let mut asking = Asking::with(true);
        assert_eq!(asked(&mut asking, NEWCOMER + 3 * EVERY, [200, 100], true), NEWCOMER + 3 * EVERY);
    }
}
