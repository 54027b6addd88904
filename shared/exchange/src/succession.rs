//! The rules by which the states of a role follow each other, whoever computes them: each decision as a function of what was read, taken by
//! the engines (`engine::stateful`) and by the model in `tests/model` alike.
//!
//! Promise: two states of one epoch and tick follow from the same state, and are the same if their makers read the same inputs, which lock-step
//! sees to; of two, either may be gone on from. For within an epoch every state is computed from the one a step before
//! it, by holder or spare; only its first may come from anywhere, and that has one writer, the winner of the compare-and-swap that
//! raised the epoch. So a holder that has fallen behind and leaps over ticks promotes itself anew, and a spare that finds more missing
//! than one step does not leap. Who begins an epoch looks at the streams and at the clock again after it was won: it may have stood for long
//! before, and a first state behind one that is out already would turn its readers' time back.

/// Missing states in a row after which the spare takes the role from a holder that hangs: the supervisor's watch has asked the kernel, and the
/// thread is stopped, overslept, or runs without a step.
pub const MISSES_OF_A_SUSPECT: u32 = 3;
/// The same for a holder that lives and is only late: a busy machine makes it late, and its successor no faster, while each of the two throws away
/// what the other has begun (64 changes in 16 s were seen, load average 5 on a 2-core VM, 2026-11-21). The spare's substitutes bridge the time.
/// It is longer than a host's stall of 15 to 34 ms at 1 kHz, and ends lateness that has another reason, also if no supervisor watches.
pub const MISSES_OF_THE_LATE: u32 = 50;

/// Missing states in a row after which the spare takes the role from a holder that is not known to be dead.
pub fn most_misses(is_suspect: bool) -> u32 {
    if is_suspect { MISSES_OF_A_SUSPECT } else { MISSES_OF_THE_LATE }
}

/// Epoch and tick of a state: its place in the order.
pub type Key = (u32, u64);

/// Whether a state is taken in place of the newest one. Equal keys are equal states: whichever comes first counts.
pub fn supersedes(found: Key, newest: Option<Key>) -> bool {
    newest.is_none_or(|newest| found > newest)
}

/// How far a stamp may be ahead of the clock beyond two steps, ticks.
const AHEAD_TICKS: u64 = 16;

/// Whether a state is one that nobody can have made yet: of an epoch after the holder's, or of a tick that is far from being there. Who took it would
/// take none that comes after it. The holder's epoch is read after the state was found, for a winner is entered before it sends.
pub fn is_ahead(found: Key, holder_epoch: u32, present_tick: u64, step: u64) -> bool {
    found.0 > holder_epoch || found.1 > present_tick.saturating_add(2 * step + AHEAD_TICKS)
}

/// What a process of the role does at a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Nothing: the state is there.
    Rest,
    /// The state of this tick, a step after the newest one, or the first of the epoch.
    Step(u64),
    /// The holder has fallen behind: it takes the role again in the next epoch, and begins that.
    Leap,
    /// The spare computes the step that is missing, under the holder's epoch.
    Substitute(u64),
    /// The spare takes the role, and begins the next epoch.
    Promote,
}

/// The holder's turn at `tick`; `epoch` is its own, `step` in ticks.
pub fn holder_turn(tick: u64, newest: Key, epoch: u32, step: u64) -> Turn {
    let next = tick.max(newest.1) + step;
    if newest.0 > epoch || newest.1 >= tick + step {
        Turn::Rest
    } else if newest.0 == epoch && next != newest.1 + step {
        Turn::Leap
    } else {
        Turn::Step(next)
    }
}

/// The spare's turn at `tick`, when it has found `misses` states missing in a row, this one included; `epoch` and `holder_lives` are the
/// holder's.
pub fn spare_turn(tick: u64, newest: Key, epoch: u32, step: u64, holder_lives: bool, misses: u32, most_misses: u32) -> Turn {
    if newest.1 >= tick {
        Turn::Rest
    } else if !holder_lives || misses >= most_misses {
        Turn::Promote
    } else if newest.0 == epoch {
        Turn::Substitute(newest.1 + step)
    } else {
        Turn::Rest // the first state of an epoch is its winner's
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_by_hand() {
        assert_eq!(holder_turn(7, (2, 7), 2, 1), Turn::Step(8));
        assert_eq!(holder_turn(8, (2, 8), 2, 4), Turn::Step(12));
        assert_eq!(holder_turn(7, (2, 8), 2, 1), Turn::Rest, "a substitute is there already");
        assert_eq!(holder_turn(9, (2, 7), 2, 1), Turn::Leap);
        assert_eq!(holder_turn(9, (1, 7), 2, 1), Turn::Step(10), "the first state of its epoch");
        assert_eq!(holder_turn(9, (3, 9), 2, 1), Turn::Rest, "fenced");
        assert_eq!(spare_turn(7, (2, 7), 2, 1, true, 0, 3), Turn::Rest);
        assert_eq!(spare_turn(8, (2, 7), 2, 1, true, 1, 3), Turn::Substitute(8));
        assert_eq!(spare_turn(9, (2, 7), 2, 1, true, 2, 3), Turn::Substitute(8), "the step that is missing, never a leap");
        assert_eq!(spare_turn(9, (1, 7), 2, 1, true, 2, 3), Turn::Rest);
        assert_eq!(spare_turn(9, (2, 7), 2, 1, true, 3, 3), Turn::Promote);
        assert_eq!(spare_turn(8, (2, 7), 2, 1, false, 1, 3), Turn::Promote);
        assert_eq!(spare_turn(9, (1, 7), 2, 1, false, 1, 3), Turn::Promote, "a winner that died before its first state");
        assert!(supersedes((1, 5), None) && supersedes((2, 4), Some((1, 5))));
        assert!(!supersedes((1, 5), Some((1, 5))) && !supersedes((1, 9), Some((2, 4))));
    }

    #[test]
    fn what_nobody_can_have_made_is_ahead() {
        assert!(!is_ahead((3, 101), 3, 100, 1) && !is_ahead((2, 101), 3, 100, 1) && !is_ahead((3, 182), 3, 100, 33));
        assert!(is_ahead((4, 101), 3, 100, 1), "an epoch that nobody has won");
        assert!(is_ahead((3, 119), 3, 100, 1) && is_ahead((3, 183), 3, 100, 33) && is_ahead((3, u64::MAX), 3, u64::MAX - 40, 1));
    }

    /// A holder and its spare on a clock of hundredths of a period. The holder's steps take as long as `step` says; it skips what it slept through.
    /// Gives the tick of the first change of hands, and the number of states that came from the spare until then.
    fn run(periods: u64, is_suspect: impl Fn(u64) -> bool, mut step: impl FnMut(u64) -> u64) -> (Option<u64>, usize) {
        let (mut newest, mut epoch, mut misses) = ((1, 0), 1, 0);
        let (mut free_at, mut pending): (u64, Option<Key>) = (0, None);
        let mut substitutes = 0;
        for now in 100..periods * 100 {
            if let Some(done) = pending.filter(|_| now >= free_at) {
                newest = if supersedes(done, Some(newest)) { done } else { newest };
                pending = None;
            }
            let tick = now / 100;
            if pending.is_none() && now >= free_at {
                match holder_turn(tick, newest, epoch, 1) {
                    Turn::Step(next) => (free_at, pending) = (now + step(tick), Some((epoch, next))),
                    Turn::Leap => {
                        epoch += 1;
                        (free_at, pending) = (now + step(tick), Some((epoch, tick + 1)));
                    }
                    _ => {}
                }
            }
            if now % 100 != 60 {
                continue;
            }
            misses = if newest.1 >= tick { 0 } else { misses + 1 };
            match spare_turn(tick, newest, epoch, 1, true, misses, most_misses(is_suspect(tick))) {
                Turn::Promote => return (Some(tick), substitutes),
                Turn::Substitute(next) => {
                    substitutes += 1;
                    newest = (epoch, next);
                }
                _ => {}
            }
        }
        (None, substitutes)
    }

    /// Steps of a busy machine: most take half a period, some several, in bursts; the numbers are a fixed linear congruence's.
    fn busy(seed: u64) -> impl FnMut(u64) -> u64 {
        let mut word = seed;
        move |tick| {
            word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let in_burst = tick % 97 < 30;
            let drawn = (word >> 33) % 100;
            if in_burst || drawn < 5 { 100 + 4 * drawn } else { 50 }
        }
    }

    #[test]
    fn a_holder_that_is_late_because_the_machine_is_busy_keeps_the_role_and_one_that_hangs_loses_it_at_the_third_miss() {
        for seed in 0..50 {
            let (change, substitutes) = run(3_000, |_| false, busy(seed));
            assert_eq!(change, None, "seed {seed}");
            assert!(substitutes > 100, "seed {seed}: the spare stands in for what is late ({substitutes})");
        }
        // It hangs in the step of tick 500, whose state is missed at tick 501.
        let hangs = |tick: u64| if tick < 500 { 50 } else { 1_000_000 };
        assert_eq!(run(1_000, |tick| tick >= 503, hangs), (Some(503), 2), "the third miss of a suspect");
        let (change, _) = run(1_000, |_| false, hangs);
        assert_eq!(change, Some(500 + u64::from(MISSES_OF_THE_LATE)), "nobody watches: late for too long");
    }
}
