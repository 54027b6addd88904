//! Whether a device works so much that it cannot be in time, as a pure function of its processor time. One that beats is alive and yet no use if each of its
//! steps takes longer than a tick: nobody else does its work, so it is replaced by one that need not be slow. What another process takes from it is no processor
//! time of its own; what a host takes is booked as if it were, and is taken off as far as the hardware's canaries saw it; and what the kernel books late counts no
//! more than the time between two looks.

/// The part of its time, in tenths, that a device may run for without being noted. A healthy one sleeps until its tick and while the servos work.
const FREE_TENTHS: u64 = 3;
/// What it may have run beyond that, ns. One that runs all the time is found after 7 ms, one that needs three ticks for each after 12.
const BOUND_NS: u64 = 5_000_000;

/// What is remembered of a device between two looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Toil {
    ran_ns: Option<u64>,
    stood_ns: u64,
    /// What counted at the look before, of which the host's part may be told a look later.
    counted_ran_ns: u64,
    excess_ns: u64,
}

impl Toil {
    /// A look: the time since the look before as far as it counts, the processor time of its first thread so far, and for how long the host has stood still so
    /// far. True if it is too slow.
    pub fn look(&mut self, counted_ns: u64, ran_ns: Option<u64>, stood_ns: u64) -> bool {
        let stood_ns = stood_ns.saturating_sub(std::mem::replace(&mut self.stood_ns, stood_ns));
        let before_ns = std::mem::replace(&mut self.ran_ns, ran_ns);
        let Some((ran_ns, before_ns)) = ran_ns.zip(before_ns) else { return false };
        let ran_ns = ran_ns.saturating_sub(before_ns).min(counted_ns);
        let of_host_ns = stood_ns.min(ran_ns + std::mem::replace(&mut self.counted_ran_ns, ran_ns));
        self.excess_ns = (self.excess_ns + ran_ns).saturating_sub(counted_ns * FREE_TENTHS / 10 + of_host_ns);
        self.excess_ns >= BOUND_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// The look at which one is found that runs for so long in each of these ticks, again and again.
    fn found(ran_us: &[u64]) -> Option<usize> {
        let (mut toil, mut ran_ns) = (Toil::default(), 0);
        (0..5_000).find(|look| {
            ran_ns += ran_us[look % ran_us.len()] * 1_000;
            toil.look(MS, Some(ran_ns), 0)
        })
    }

    #[test]
    fn one_whose_steps_take_longer_than_a_tick_is_found_within_fifteen_and_a_healthy_one_never() {
        assert!(matches!(found(&[1_000]), Some(7..=9)), "{:?}", found(&[1_000]));
        assert!(matches!(found(&[1_000, 1_000, 100]), Some(10..=15)), "{:?}", found(&[1_000, 1_000, 100]));
        for healthy in [&[60][..], &[250], &[1_000, 50, 50, 50], &[200, 0, 0, 900]] {
            assert_eq!(found(healthy), None, "{healthy:?}");
        }
    }

    #[test]
    fn time_that_does_not_count_and_time_that_is_booked_late_make_nobody_slow() {
        let mut toil = Toil::default();
        assert!((0..100).all(|look| !toil.look(0, Some(look * MS), 0)), "the host stood still");
        assert!((0..100).all(|_| !toil.look(MS, None, 0)), "the kernel does not say");
        assert!(!toil.look(MS, Some(0), 0) && !toil.look(MS, Some(40 * MS), 0) && toil.excess_ns < MS, "40 ms at once");
    }

    #[test]
    fn what_the_host_took_is_none_of_its_time_and_excuses_no_more_than_that() {
        // Every other look a millisecond, told then or at the next look; beside that it runs for a tenth of each.
        for late in [0, 1] {
            let mut robbed = Toil::default();
            let stood_ns = |look: u64| (look + 1 - late.min(look)) / 2 * MS;
            assert!(
                (0u64..1_000).all(|look| !robbed.look(MS, Some(look.div_ceil(2) * MS + look * MS / 10), stood_ns(look))),
                "{late}"
            );
        }
        // One that is slow by itself is found in spite of a stall of 20 ms now and then.
        let mut slow = Toil::default();
        assert!((0..30).any(|look| slow.look(MS, Some(look * MS), look / 5 * 20 * MS)));
    }
}
