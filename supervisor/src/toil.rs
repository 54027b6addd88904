//! Whether a device works so much that it cannot be in time, as a pure function of its processor time. One that beats is alive and yet no use if each of its
//! steps takes longer than a tick: nobody else does its work, so it is replaced by one that need not be slow. What a host or another process takes from it is
//! no processor time of its own, and what the kernel books late counts no more than the time between two looks.

/// The part of its time, in tenths, that a device may run for without being noted. A healthy one sleeps until its tick and while the servos work.
const FREE_TENTHS: u64 = 3;
/// What it may have run beyond that, ns. One that runs all the time is found after 7 ms, one that needs three ticks for each after 12.
const BOUND_NS: u64 = 5_000_000;

/// What is remembered of a device between two looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Toil {
    ran_ns: Option<u64>,
    excess_ns: u64,
}

impl Toil {
    /// A look: the time since the look before as far as it counts, and the processor time of its first thread so far. True if it is too slow.
    pub fn look(&mut self, counted_ns: u64, ran_ns: Option<u64>) -> bool {
        let before_ns = std::mem::replace(&mut self.ran_ns, ran_ns);
        let Some((ran_ns, before_ns)) = ran_ns.zip(before_ns) else { return false };
        let ran_ns = ran_ns.saturating_sub(before_ns).min(counted_ns);
        self.excess_ns = (self.excess_ns + ran_ns).saturating_sub(counted_ns * FREE_TENTHS / 10);
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
            toil.look(MS, Some(ran_ns))
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
        assert!((0..100).all(|look| !toil.look(0, Some(look * MS))), "the host stood still");
        assert!((0..100).all(|_| !toil.look(MS, None)), "the kernel does not say");
        assert!(!toil.look(MS, Some(0)) && !toil.look(MS, Some(40 * MS)) && toil.excess_ns < MS, "40 ms at once");
    }
}
