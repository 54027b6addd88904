//! How often and how soon each role is restarted, after Erlang/OTP's restart intensity.

use hyst_messages::Role;

/// Bounds of a role's restarts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// An incarnation that was ready for this long has settled, ns.
    pub settled_ns: u64,
    /// First wait after a short life, doubled by each further one, ns. The first restart of a settled incarnation does not wait at all: the
    /// trainee's hand waits for it.
    pub first_wait_ns: u64,
    /// Longest wait, ns: a person at the table still sees that the station tries.
    pub most_wait_ns: u64,
    /// Short lives in a row before the slot is given up.
    pub most_short_lives: u32,
    /// Window of the second bound, which holds for settled incarnations too, ns.
    pub window_ns: u64,
    /// Deaths of one slot within the window before it is given up.
    pub most_deaths: usize,
}

/// Bounds of a role.
pub const fn limits(role: Role) -> Limits {
    // A fault that its input causes shows within a few steps (1 ms each for the real-time roles, 33 ms for the slowest), and a campaign of kills
    // leaves each slot at least twice as long and kills it at most five times a second. With these waits a slot is tried for about 9 s.
    let limits = Limits {
        settled_ns: 100_000_000,
        first_wait_ns: 50_000_000,
        most_wait_ns: 3_200_000_000,
        most_short_lives: 8,
        window_ns: 10_000_000_000,
        most_deaths: 60,
    };
    match role {
        // Their start takes a driver or a disk, and nothing waits for them.
        Role::Rendering | Role::Console => Limits { first_wait_ns: 200_000_000, most_wait_ns: 6_400_000_000, ..limits },
        // The device's ring keeps 4.1 s for it: no single wait is longer. So often it is tried for some 20 s.
        Role::Recorder => Limits { first_wait_ns: 200_000_000, most_wait_ns: 1_600_000_000, most_short_lives: 15, ..limits },
        _ => limits,
    }
}

/// Whether a helper compares what a newcomer on probation makes with what it should be: its states, its force, its page, its recording or its pictures.
pub const fn is_judged(role: Role) -> bool {
    role.is_stateful() || matches!(role, Role::Device | Role::Console | Role::Recorder | Role::Rendering)
}

/// Roles whose streams a role reads. Its own is left out: of two that follow each other the ladder and the last one's right to live decide.
pub const fn sources(role: Role) -> &'static [Role] {
    match role {
        Role::Tissue => &[Role::CollisionWorker],
        Role::CollisionWorker | Role::Fluid => &[Role::Tissue],
        Role::Rendering => &[Role::Tissue, Role::Fluid],
        Role::Recorder => &[Role::Haptic],
        _ => &[],
    }
}

impl Limits {
    /// Short lives in a row after which those are replaced whose streams it reads: half of what most roles are given. A recorder has waited for 1.4 s by then, and
    /// what it has not written is in the device's ring still; after half of its own fifteen, in 7 s, 4 917 ticks were not.
    pub const fn mistrust_after(&self) -> u32 {
        4
    }

    /// The wait after so many short lives in a row.
    pub const fn wait_ns(&self, short_lives: u32) -> u64 {
        if short_lives == 0 {
            return 0;
        }
        let doublings = if short_lives > 17 { 16 } else { short_lives - 1 };
        let wait_ns = self.first_wait_ns << doublings;
        if wait_ns < self.most_wait_ns { wait_ns } else { self.most_wait_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_recorder_reads_is_mistrusted_while_the_ring_holds_what_it_has_not_written() {
        const RING_NS: u64 = 4_000_000_000;
        let limits = limits(Role::Recorder);
        let waits_ns: u64 = (0..limits.mistrust_after()).map(|short_lives| limits.wait_ns(short_lives)).sum();
        // Beside it five starts, each of which may take a quarter of a second, and that of who replaces what it reads.
        assert!(waits_ns + 6 * 250_000_000 < RING_NS, "{waits_ns}");
        assert!(limits.mistrust_after() < limits.most_short_lives);
    }
}
