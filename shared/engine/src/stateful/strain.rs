//! How strained a role is: a machine that has become too slow for its steps makes the holder leap over ticks, each time into a new epoch, and leaves pictures
//! and flow next to nothing. Where that lasts the steps become longer, at the beginning of an epoch, whose first state may follow from any.
//!
//! Promise: faults and stalls, which bring single epochs, and a busy moment do not count, nor do the epochs of a newcomer on trial, which may be too slow by
//! itself: it is to be found out, and not to be given more time. A step that was lengthened is not shortened again in a session. How long it takes bounds what
//! one of half the length would take by a factor of two, and a step of 1 ms takes 0.63 of that where all is well (docs/speed.md): what cannot be kept up with is
//! nearer than that factor. Each try that fails costs a trainee seconds without pictures, and a session lasts minutes.

/// New epochs in a second from which on it counts as strained: a fortieth of its steps at 1 kHz is lost.
const MANY: u32 = 25;
/// So many seconds in a row must be strained.
const LASTING_S: u32 = 5;
/// Ticks in a second.
const SECOND_TICKS: u64 = 1_000;

/// The account of one process of the role; epochs are everybody's.
#[derive(Debug, Default)]
pub struct Strain {
    /// The second that is counted, and the epoch at its begin.
    second: u64,
    first_epoch: u32,
    strained_s: u32,
    /// A newcomer was on trial since an epoch began last.
    is_paused: bool,
}

impl Strain {
    /// A newcomer is on trial, or on its way out: it begins epochs, which count for nothing. What was before goes on after that, for one that has the role again
    /// and again in pauses would keep a role that is strained without it from longer steps.
    pub fn pause(&mut self) {
        self.is_paused = true;
    }

    /// Takes that an epoch begins at a tick; gives whether the strain has lasted, and then begins to count anew.
    pub fn is_lasting(&mut self, tick: u64, epoch: u32) -> bool {
        let second = tick / SECOND_TICKS;
        if std::mem::take(&mut self.is_paused) {
            // What is left of that second is judged as a whole one.
            (self.second, self.first_epoch) = (second, epoch);
            return false;
        }
        if second == self.second {
            return false;
        }
        let is_next = second == self.second + 1;
        let many = epoch.saturating_sub(self.first_epoch) >= MANY;
        self.strained_s = if is_next && many { self.strained_s + 1 } else { 0 };
        (self.second, self.first_epoch) = (second, epoch);
        let lasts = self.strained_s >= LASTING_S;
        if lasts {
            self.strained_s = 0;
        }
        lasts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds at which the strain was found to last, of epochs that begin every so many ticks between two seconds.
    fn found(every_ticks: usize, seconds: [u64; 2]) -> Vec<u64> {
        let (mut strain, mut epoch, mut found) = (Strain::default(), 0, Vec::new());
        for tick in (seconds[0] * SECOND_TICKS..seconds[1] * SECOND_TICKS).step_by(every_ticks) {
            epoch += 1;
            if strain.is_lasting(tick, epoch) {
                found.push(tick / SECOND_TICKS);
            }
        }
        found
    }

    #[test]
    fn epochs_without_end_are_found_after_five_seconds_and_again() {
        // The first second is known to be one when the second has begun.
        assert_eq!(found(7, [10, 18]), [15]);
        assert_eq!(found(30, [10, 22]), [15, 20]);
    }

    #[test]
    fn faults_and_busy_moments_lengthen_nothing() {
        assert!(found(100, [10, 60]).is_empty(), "ten in a second");
        assert!(found(3, [10, 15]).is_empty(), "five seconds of it");
        assert!(found(5_000, [0, 600]).is_empty(), "a fault every five seconds");
        // Two busy spells with a quiet second between.
        let mut strain = Strain::default();
        let mut epoch = 0;
        let busy = (0..4_000u64).chain(6_000..10_000);
        let lasts = busy
            .step_by(10)
            .filter(|tick| {
                epoch += 1;
                strain.is_lasting(*tick, epoch)
            })
            .count();
        assert_eq!(lasts, 0);
    }

    /// Seconds at which the strain was found to last of an old engine beside whom a newcomer has the role in one second of three, and begins epochs as often as it.
    fn found_beside(seconds: [u64; 2], every_ticks: usize) -> Vec<u64> {
        let (mut strain, mut epoch, mut found) = (Strain::default(), 0, Vec::new());
        for tick in seconds[0] * SECOND_TICKS..seconds[1] * SECOND_TICKS {
            let begins = tick % every_ticks as u64 == 0;
            epoch += u32::from(begins);
            match tick / SECOND_TICKS % 3 {
                0 => strain.pause(),
                _ if begins && strain.is_lasting(tick, epoch) => found.push(tick / SECOND_TICKS),
                _ => {}
            }
        }
        found
    }

    /// Between the times for which a newcomer has the role, beside a hand that cuts, the old engine has it.
    #[test]
    fn what_a_role_is_strained_without_the_newcomer_adds_up_over_its_times() {
        assert!(!found_beside([10, 40], 10).is_empty(), "it was never given longer steps");
        assert!(found_beside([10, 40], 50).is_empty(), "twenty in a second are no strain");
    }

    /// A newcomer that was too slow for steps of 1 ms had the role's made longer after 6 s on trial, was in time then, and was promoted.
    #[test]
    fn epochs_of_a_newcomer_on_trial_lengthen_nothing() {
        let (mut strain, mut epoch) = (Strain::default(), 0);
        let mut found_at = |is_on_trial: bool, from_s: u64, to_s: u64| -> Vec<u64> {
            let ticks = (from_s * SECOND_TICKS..to_s * SECOND_TICKS).step_by(7);
            let lasting = ticks.filter(|tick| {
                epoch += 1;
                if is_on_trial {
                    strain.pause();
                }
                strain.is_lasting(*tick, epoch)
            });
            lasting.map(|tick| tick / SECOND_TICKS).collect()
        };
        assert!(found_at(true, 10, 70).is_empty());
        assert!(found_at(false, 70, 75).is_empty(), "none of them counts");
        assert_eq!(found_at(false, 75, 78), [75], "of one that has passed they do");
    }
}
