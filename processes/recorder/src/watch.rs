//! What happened to the processes, as events: from the slots of the station's page and the roster, compared with what they were at the
//! look before. A process that lived and died between two looks is seen as the next one's start. Promise: what happened while no recorder lived is said by the
//! one that follows, and what the one before has written is not said again.

use crate::said::SLACK_TICKS;
use hyst_exchange::{Roster, Station, StationPage, Tenure, whole};
use hyst_messages::{Role, SLOTS, Slot};
use hyst_recording::{Event, Level, STATED};

/// Looks that are kept: more changes within the time that a disk may stand still are of a station that starts nobody any more.
const MOST_LOOKS: usize = 256;

/// A look as it is kept: its tick, incarnation and death of each slot, the holder of each role as a word, and whose statement was known.
type Kept = (u64, Vec<(u32, bool)>, Vec<u64>, u32);

/// What one look shows: incarnation and death of each slot, the holder of each role, and which life of the hardware has said what it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    slots: [(u32, bool); SLOTS],
    holders: [Tenure; Role::ALL.len()],
    /// 0 while the one that lives has not.
    stated: u32,
    /// The station was asked to stop: who ends now does as it was told.
    stops: bool,
}

impl Look {
    /// The slots and the roster as they are; `stated`: the life of the hardware whose statement is known.
    pub fn take(clock: &StationPage, roster: &Roster, stated: Option<u32>) -> Look {
        let mut look = Look { stated: stated.unwrap_or(0), stops: clock.stop_requested(), ..Look::default() };
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

    /// The events that lead from the look `before` to this one. Where nobody knows what was before, every process is `present`.
    fn events(&self, before: Option<&Look>, tick: u64) -> Vec<Event> {
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
                let kind = if before.is_some() { "started" } else { "present" };
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
        if self.stated != old.stated && self.stated != 0 {
            let (name, is) = (Slot::first(Role::Hardware).to_string(), self.stated);
            say(Level::Info, STATED, name.clone(), is, format!("{name} #{is} says what it is"));
        }
        events
    }

    fn kept(&self, tick: u64) -> Kept {
        (tick, self.slots.to_vec(), self.holders.iter().map(|holder| holder.word()).collect(), self.stated)
    }

    /// A look that was kept, and its tick; `None` of what is none.
    fn of((tick, slots, holders, stated): Kept) -> Option<(u64, Look)> {
        let holders: Vec<Tenure> = holders.into_iter().map(Tenure::from_word).collect();
        Some((tick, Look { slots: slots.try_into().ok()?, holders: holders.try_into().ok()?, stated, stops: false }))
    }
}

/// The looks from which on the file may not have what happened: what comes of a look is written with ticks that are [`SLACK_TICKS`] later.
#[derive(Debug)]
pub struct Looks {
    /// Each that differs from the one before, with its tick, oldest first; none where nobody knows what was before.
    seen: Vec<(u64, Look)>,
    is_kept: bool,
}

impl Looks {
    /// Of a recording that begins: there was nobody before.
    pub fn begun() -> Looks {
        Looks { seen: vec![(0, Look::default())], is_kept: false }
    }

    /// Of one that goes on behind `last_tick`: from the newest look whose events are in the file, by what the recorder before has kept.
    pub fn going_on(station: &Station, last_tick: Option<u64>) -> Looks {
        let text = std::fs::read_to_string(station.recorder_seen()).unwrap_or_default();
        let kept: Vec<Kept> = serde_json::from_str(&text).unwrap_or_default();
        let seen: Vec<(u64, Look)> = kept.into_iter().filter_map(Look::of).collect();
        let from = seen.get(written(&seen, last_tick)).cloned();
        Looks { seen: from.into_iter().collect(), is_kept: false }
    }

    /// What has happened since the look before this one.
    pub fn follow(&mut self, look: Look, tick: u64) -> Vec<Event> {
        let before = self.seen.last().map(|(_, before)| before);
        let events = look.events(before, tick);
        if before != Some(&look) {
            self.seen.push((tick, look));
            self.seen.drain(..self.seen.len().saturating_sub(MOST_LOOKS));
            self.is_kept = false;
        }
        events
    }

    /// Keeps them for a recorder that follows, but for those of which the file, which has ticks up to `last_tick`, has everything.
    pub fn keep(&mut self, station: &Station, last_tick: Option<u64>) {
        let written = written(&self.seen, last_tick);
        self.is_kept &= written == 0;
        self.seen.drain(..written);
        if !self.is_kept {
            let kept: Vec<Kept> = self.seen.iter().map(|(tick, look)| look.kept(*tick)).collect();
            // Refused, it is tried again with the next block.
            let text = serde_json::to_string(&kept).unwrap_or_default();
            self.is_kept = whole::write(&station.recorder_seen(), text.as_bytes()).is_ok();
        }
    }
}

/// Which of these is the newest whose events are in a file up to `last_tick`; the oldest, if none is.
fn written(seen: &[(u64, Look)], last_tick: Option<u64>) -> usize {
    let is_written = |(tick, _): &(u64, Look)| last_tick.is_some_and(|last_tick| tick.saturating_add(SLACK_TICKS) <= last_tick);
    seen.iter().rposition(is_written).unwrap_or(0)
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
        assert_eq!(kinds(&look.events(None, 9)), [("present", "haptic:1", 5), ("promoted", "tissue", 4)]);
        let mut dead = look.clone();
        dead.slots[haptic] = (5, true);
        assert_eq!(kinds(&dead.events(Some(&look), 9)), [("died", "haptic:1", 5)]);
        assert!(dead.events(Some(&dead), 9).is_empty());
        let stopped = Look { stops: true, ..dead.clone() };
        let told = stopped.events(Some(&look), 9);
        assert_eq!((kinds(&told), told[0].level), (vec![("ended", "haptic:1", 5)], Level::Info), "nobody died");
        let mut leapt = dead.clone();
        leapt.holders[tissue].epoch = 2;
        assert!(leapt.events(Some(&dead), 9).is_empty());
        let mut again = look.clone();
        again.slots[haptic] = (8, false);
        again.holders[tissue] = Tenure { epoch: 2, incarnation: 6 };
        assert_eq!(kinds(&again.events(Some(&dead), 9)), [("started", "haptic:1", 8), ("promoted", "tissue", 6)]);
        assert_eq!(kinds(&again.events(Some(&look), 9))[0], ("ended", "haptic:1", 5));
    }

    /// What had died and come back while no recorder lived was in no event: who went on with the recording found everybody present.
    #[test]
    fn what_happened_since_the_last_look_that_is_in_the_file_is_said_by_who_goes_on() {
        let station = Station::named(&format!("t{}-looks", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let console = Slot::first(Role::Console).number();
        let with = |incarnation: u32, dead: bool, stated: u32| {
            let mut look = Look { stated, ..Look::default() };
            look.slots[console] = (incarnation, dead);
            look
        };
        let mut first = Looks::begun();
        assert_eq!(kinds(&first.follow(with(5, false, 0), 100)), [("started", "console", 5)]);
        first.keep(&station, None);
        assert_eq!(kinds(&first.follow(with(5, false, 3), 200)), [(STATED, "hardware", 3)]);
        assert_eq!(first.follow(with(5, false, 3), 300), []);
        assert_eq!(kinds(&first.follow(with(5, true, 3), 400)), [("died", "console", 5)]);
        first.keep(&station, Some(180));
        // By the ticks that its predecessor has written, who goes on knows what of that is in the file.
        let goes_on = |last_tick: Option<u64>| {
            let mut next = Looks::going_on(&station, last_tick);
            let events = next.follow(with(8, false, 3), 500);
            kinds(&events).into_iter().map(|(kind, _, incarnation)| (kind.to_string(), incarnation)).collect::<Vec<_>>()
        };
        let told = |told: &[(&str, u32)]| told.iter().map(|(kind, number)| (kind.to_string(), *number)).collect::<Vec<_>>();
        assert_eq!(goes_on(Some(450)), told(&[("started", 8)]));
        assert_eq!(goes_on(Some(449)), told(&[("ended", 5), ("started", 8)]));
        assert_eq!(goes_on(Some(249)), told(&[("ended", 5), ("started", 8), (STATED, 3)]));
        assert_eq!(goes_on(None), goes_on(Some(249)), "the one before is known to be written, and kept no more");
        std::fs::write(station.recorder_seen(), "[[1, [], [], 0]]").unwrap();
        assert_eq!(goes_on(Some(450)), told(&[("present", 8), (STATED, 3)]), "nobody knows what was before");
        station.wipe();
    }
}
