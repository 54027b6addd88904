//! Who did each role's work when: the selected servo and the holders in the roster, sampled by the supervisor. A death is seen up to a
//! fifth of a second after it happened (the system tears the memory down first), and by then a spare has taken over; so who *was*
//! active must be known.

use hyst_exchange::{ReadPage, Roster, Station};
use hyst_messages::page::device as layout;
use hyst_messages::{Role, Slot};

/// Changes that are remembered: some minutes of a campaign.
const MOST_CHANGES: usize = 4_096;

/// The log.
#[derive(Debug, Default)]
pub struct ActiveLog {
    changes: Vec<(u64, Role, u32)>,
}

impl ActiveLog {
    /// Notes who is active at a time; what did not change costs nothing.
    pub fn note(&mut self, now_ns: u64, role: Role, incarnation: u32) {
        if incarnation == 0
            || self.changes.iter().rev().find(|(_, known, _)| *known == role).is_some_and(|(_, _, active)| *active == incarnation)
        {
            return;
        }
        if self.changes.len() >= MOST_CHANGES {
            self.changes.drain(..MOST_CHANGES / 2);
        }
        self.changes.push((now_ns, role, incarnation));
    }
    /// Who did the role's work at a time; 0 if unknown.
    pub fn active_at(&self, at_ns: u64, role: Role) -> u32 {
        let at = |(since_ns, known, _): &&(u64, Role, u32)| *known == role && *since_ns <= at_ns;
        self.changes.iter().rev().find(at).map_or(0, |(_, _, active)| *active)
    }
}

/// The incarnation that does the role's work at this moment; 0 if none is known.
pub fn active_now(station: &Station, roster: &Roster, device: Option<&ReadPage>, role: Role) -> u32 {
    match role {
        Role::Haptic => device.map_or(0, |page| page.load64(layout::SELECTED + 1) as u32),
        _ if role.is_stateful() => roster.holder(role).incarnation,
        _ => station.open().map_or(0, |page| page.incarnation(Slot::first(role))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_was_active_is_known_after_the_takeover() {
        let mut log = ActiveLog::default();
        log.note(100, Role::Haptic, 3);
        log.note(150, Role::Haptic, 3);
        log.note(200, Role::Haptic, 4);
        log.note(210, Role::Tissue, 9);
        assert_eq!([50, 100, 199, 200, 500].map(|at_ns| log.active_at(at_ns, Role::Haptic)), [0, 3, 3, 4, 4]);
        assert_eq!(log.active_at(500, Role::Tissue), 9);
    }
}
