//! What happened to the processes, as events: from the slots of the station's page and the roster, compared with what they were at the
//! look before. A process that lived and died between two looks is seen as the next one's start.

use hyst_exchange::{Roster, StationPage, Tenure};
use hyst_messages::{Role, SLOTS, Slot};
use hyst_recording::{Event, Level};

/// What one look shows: incarnation and death of each slot, and the holder of each role.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    slots: [(u32, bool); SLOTS],
    holders: [Tenure; Role::ALL.len()],
    /// The station was asked to stop: who ends now does as it was told.
    stops: bool,
}

impl Look {
    /// The slots and the roster as they are.
    pub fn take(clock: &StationPage, roster: &Roster) -> Look {
        let mut look = Look { stops: clock.stop_requested(), ..Look::default() };
        for (number, place) in look.slots.iter_mut().enumerate() {
            if let Some(slot) = Slot::from_number(number) {
                *place = (clock.incarnation(slot), clock.is_dead(slot));
            }
        }
        for role in Role::ALL {
            look.holders[role as usize] = roster.holder(role);
        }
        look
    }

    /// The events that lead from the look `before` to this one. Without one before, every process is `first`: `started` or `present`.
    pub fn events(&self, before: Option<&Look>, first: &str, tick: u64) -> Vec<Event> {
        let none = Look::default();
        let old = before.unwrap_or(&none);
        let mut events = Vec::new();
        let mut say = |level, kind: &str, process: String, incarnation, text| {
            events.push(Event { tick, level, kind: kind.into(), process, incarnation, text });
        };
        for number in 0..SLOTS {
            let Some(slot) = Slot::from_number(number) else {
                continue;
            };
            let ((was, was_dead), (is, is_dead)) = (old.slots[number], self.slots[number]);
            let name = slot.to_string();
            if is != was && was != 0 && !was_dead {
                say(Level::Warning, "ended", name.clone(), was, format!("{name} #{was} is gone"));
            }
            if is != was && is != 0 {
                let kind = if before.is_some() { "started" } else { first };
                let text = format!("{name} #{is} {}", if was != 0 { "started again" } else { kind });
                say(Level::Info, kind, name.clone(), is, text);
            }
            let is_new = is != 0 && is_dead && (is != was || !was_dead);
            if is_new && self.stops {
                say(Level::Info, "ended", name.clone(), is, format!("{name} #{is} has ended with the station"));
            } else if is_new {
                say(Level::Warning, "died", name.clone(), is, format!("{name} #{is} died"));
            }
        }
        for role in Role::ALL {
            let (was, is) = (old.holders[role as usize], self.holders[role as usize]);
            // A holder that leaps over ticks begins an epoch of its own: nobody was promoted.
            if is.incarnation != was.incarnation && is.epoch != 0 {
                let text = format!("#{} holds the role {} in epoch {}", is.incarnation, role.name(), is.epoch);
                say(Level::Info, "promoted", role.name().into(), is.incarnation, text);
            }
        }
        events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(events: &[Event]) -> Vec<(&str, &str, u32)> {
        events.iter().map(|event| (event.kind.as_str(), event.process.as_str(), event.incarnation)).collect()
    }

    #[test]
    fn a_start_a_death_a_restart_and_a_promotion_are_each_said_once() {
        let (haptic, tissue) = (Slot::parse("haptic:1").unwrap().number(), Role::Tissue as usize);
        let mut look = Look::default();
        look.slots[haptic] = (5, false);
        look.holders[tissue] = Tenure { epoch: 1, incarnation: 4 };
        assert_eq!(kinds(&look.events(None, "present", 9)), [("present", "haptic:1", 5), ("promoted", "tissue", 4)]);
        let mut dead = look.clone();
        dead.slots[haptic] = (5, true);
        assert_eq!(kinds(&dead.events(Some(&look), "", 9)), [("died", "haptic:1", 5)]);
        assert!(dead.events(Some(&dead), "", 9).is_empty());
        let stopped = Look { stops: true, ..dead.clone() };
        let told = stopped.events(Some(&look), "", 9);
        assert_eq!((kinds(&told), told[0].level), (vec![("ended", "haptic:1", 5)], Level::Info), "nobody died");
        let mut leapt = dead.clone();
        leapt.holders[tissue].epoch = 2;
        assert!(leapt.events(Some(&dead), "", 9).is_empty());
        let mut again = look.clone();
        again.slots[haptic] = (8, false);
        again.holders[tissue] = Tenure { epoch: 2, incarnation: 6 };
        assert_eq!(kinds(&again.events(Some(&dead), "", 9)), [("started", "haptic:1", 8), ("promoted", "tissue", 6)]);
        assert_eq!(kinds(&again.events(Some(&look), "", 9))[0], ("ended", "haptic:1", 5));
    }
}
