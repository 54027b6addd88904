//! The swaps of a run, in the order in which they were asked for, for its report. Each is a line in a file in the station's root when it was asked for, and
//! again when it was over, so that it outlives the supervisor; how far the one under way is stands in `swap.json`.
//!
//! Promise: whoever asks without end for what is refused makes neither the list nor the file longer than a bound, and keeps no swap out of them.

use super::{Faults, lines};
use crate::policy::Cause;
use crate::swap::{Record, Step, kept};
use hyst_exchange::{Station, system};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Swaps that are kept: each takes seconds.
const MOST_BEGUN: usize = 500;
/// Those that were refused and are kept.
const MOST_REFUSED: usize = 100;
/// Characters of what somebody sent that are kept: a longer path there is not.
const MOST_CHARACTERS: usize = 4_096;
/// The file with their lines.
const FILE: &str = "swaps.jsonl";

/// What became of a swap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Became {
    /// It goes on, or did when the run ended.
    UnderWay,
    /// Every process of the role runs the newcomer's binary.
    Done,
    /// The old engine has the role.
    RolledBack,
    /// Nothing was begun.
    Refused,
}

/// A swap that was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// By which the station counts its swaps; `None` of one that was refused.
    pub number: Option<u64>,
    /// The role, as it was named.
    pub role: String,
    /// Where the newcomer starts; `None` of one that was refused.
    pub slot: Option<String>,
    /// The newcomer's binary, as it was named.
    pub binary: String,
    /// Station tick in which it was asked for.
    pub tick: u64,
    /// The same in the system's time (CLOCK_MONOTONIC), ns.
    pub asked_ns: u64,
    /// What became of it.
    pub became: Became,
    /// Why it was rolled back.
    pub cause: Option<Cause>,
    /// The same in words, or why it was refused.
    pub reason: String,
    /// What happened, with the time since it was asked for.
    pub steps: Vec<Step>,
}

impl Asked {
    fn of(record: &Record, tick: u64) -> Asked {
        let mut asked = Asked {
            number: Some(record.number),
            role: record.role.clone(),
            slot: Some(record.slot.clone()),
            binary: shortened(&kept::name_of(&record.binary).to_string_lossy()),
            tick,
            asked_ns: record.begun_ns,
            became: Became::UnderWay,
            cause: None,
            reason: String::new(),
            steps: Vec::new(),
        };
        asked.follow(record);
        asked
    }

    /// Takes what has happened since.
    fn follow(&mut self, record: &Record) {
        self.became = match record.promoted {
            None => Became::UnderWay,
            Some(true) => Became::Done,
            Some(false) => Became::RolledBack,
        };
        (self.cause, self.reason, self.steps) = (record.cause, record.reason.clone(), record.steps.clone());
    }

    fn is_refused(&self) -> bool {
        self.became == Became::Refused
    }
}

/// The beginning of a text of any length.
fn shortened(text: &str) -> String {
    text.chars().take(MOST_CHARACTERS).collect()
}

/// The swaps of a station.
#[derive(Debug, Default)]
pub(super) struct Swaps {
    list: Vec<Asked>,
    /// Those for which there was no room, since this supervisor has begun.
    left_out: u64,
}

impl Swaps {
    /// What a supervisor before this one left.
    pub(super) fn read(station: &Station) -> Swaps {
        let mut swaps = Swaps::default();
        for asked in lines(station, FILE) {
            swaps.put(asked);
        }
        if let Some(record) = Record::read(station) {
            swaps.follow(&record); // the last one may have ended after its line was written
        }
        swaps
    }

    /// Puts one in the place of what was known of it, or after all others; false if there is no room for it.
    fn put(&mut self, asked: Asked) -> bool {
        if let Some(known) = asked.number.and_then(|number| self.known(number, asked.asked_ns)) {
            *known = asked;
            return true;
        }
        let alike = self.list.iter().filter(|known| known.is_refused() == asked.is_refused()).count();
        let most = if asked.is_refused() { MOST_REFUSED } else { MOST_BEGUN };
        let has_room = alike < most;
        if has_room {
            self.list.push(asked);
        } else {
            self.left_out += 1;
        }
        has_room
    }

    /// What is known of a swap that was begun.
    fn known(&mut self, number: u64, asked_ns: u64) -> Option<&mut Asked> {
        self.list.iter_mut().rev().find(|known| (known.number, known.asked_ns) == (Some(number), asked_ns))
    }

    /// Takes what has happened in one that is known; gives it.
    fn follow(&mut self, record: &Record) -> Option<&Asked> {
        let known = self.known(record.number, record.begun_ns)?;
        known.follow(record);
        Some(&*known)
    }
}

impl Faults {
    /// A swap was begun, or a successor goes on with it.
    pub fn swap_asked(&mut self, record: &Record) {
        self.swap_begun(record.begun_ns);
        let tick = self.tick_at(record.begun_ns);
        self.keep_swap(Asked::of(record, tick));
    }

    /// A swap was refused: nothing was begun.
    pub fn swap_refused(&mut self, role: &str, binary: &Path, reason: &str) {
        let asked_ns = system::now_ns();
        let asked = Asked {
            number: None,
            role: shortened(role),
            slot: None,
            binary: shortened(&kept::name_of(binary).to_string_lossy()),
            tick: self.tick_at(asked_ns),
            asked_ns,
            became: Became::Refused,
            cause: None,
            reason: shortened(reason),
            steps: Vec::new(),
        };
        self.keep_swap(asked);
    }

    /// Something happened in a swap, which may be over by that.
    pub fn swap_went_on(&mut self, record: &Record) {
        let over = self.asked.follow(record).filter(|asked| asked.became != Became::UnderWay).cloned();
        if let Some(over) = over {
            let _ = self.append(FILE, &over); // it is in the report all the same
        }
    }

    fn keep_swap(&mut self, asked: Asked) {
        if self.asked.put(asked.clone()) {
            let _ = self.append(FILE, &asked); // likewise
        }
    }

    /// The swaps that were asked for, in that order, and how many there was no room for.
    pub fn swaps_asked(&self) -> (&[Asked], u64) {
        (&self.asked.list, self.asked.left_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::path;
    use crate::faults::tests::book;
    use crate::swap::tests::record;

    fn told(faults: &Faults) -> Vec<(Option<u64>, Became)> {
        faults.swaps_asked().0.iter().map(|asked| (asked.number, asked.became)).collect()
    }

    /// The report had a list of the faults, and of the swaps one read in the events.
    #[test]
    fn swaps_stand_in_the_order_in_which_they_were_asked_for_and_outlive_the_supervisor() {
        let (station, mut faults) = book("asked");
        let page = station.open().unwrap();
        let mut first = Record { begun_ns: page.start_of(6_000), ..record() };
        first.note("fluid:2 is to run fluid");
        faults.swap_asked(&first);
        faults.swap_refused("tissue", Path::new("/x/tissue"), "another swap is under way");
        first.note("ready, and in the shadow of the old engine");
        faults.swap_went_on(&first);
        assert_eq!(told(&faults), [(Some(1), Became::UnderWay), (None, Became::Refused)]);
        assert_eq!(faults.swaps_asked().0[0].steps.len(), 2);
        (first.promoted, first.cause, first.reason) = (Some(false), Some(Cause::Died), "it died".into());
        faults.swap_went_on(&first);
        let second = Record { number: 2, begun_ns: page.start_of(9_000), ..record() };
        faults.swap_asked(&second);
        let as_told = [(Some(1), Became::RolledBack), (None, Became::Refused), (Some(2), Became::UnderWay)];
        assert_eq!(told(&faults), as_told);
        let first = &faults.swaps_asked().0[0];
        assert_eq!((first.role.as_str(), first.slot.as_deref(), first.binary.as_str()), ("fluid", Some("fluid:2"), "/x/fluid"));
        assert_eq!((first.tick, first.asked_ns), (6_000, page.start_of(6_000)));
        assert_eq!((first.cause, first.reason.as_str()), (Some(Cause::Died), "it died"));
        assert_eq!(faults.swaps_asked().0[1].reason, "another swap is under way");
        let successor = Faults::new(&station, &[]).unwrap();
        assert_eq!(successor.swaps_asked(), faults.swaps_asked());
        // One that goes on with a swap tells of it once, and of what ended right before a death the record says how.
        let mut goes_on = Faults::new(&station, &[]).unwrap();
        goes_on.swap_asked(&second);
        assert_eq!(told(&goes_on), as_told);
        assert!(Record { promoted: Some(true), ..second }.write(&station));
        assert_eq!(told(&Faults::new(&station, &[]).unwrap())[2], (Some(2), Became::Done));
    }

    #[test]
    fn whoever_asks_for_what_is_refused_without_end_fills_nothing_and_keeps_no_swap_out() {
        let (station, mut faults) = book("asks");
        let long = "x".repeat(3 * MOST_CHARACTERS);
        for _ in 0..MOST_REFUSED + 5 {
            faults.swap_refused(&long, Path::new(&long), &long);
        }
        faults.swap_asked(&record());
        let (list, left_out) = faults.swaps_asked();
        assert_eq!((list.len(), left_out, list[MOST_REFUSED].number), (MOST_REFUSED + 1, 5, Some(1)));
        assert!([&list[0].role, &list[0].binary, &list[0].reason].iter().all(|text| text.len() == MOST_CHARACTERS));
        let lines = std::fs::read_to_string(path(&station, FILE)).unwrap().lines().count();
        assert_eq!(lines, MOST_REFUSED + 1);
        for number in 2..=MOST_BEGUN as u64 + 3 {
            faults.asked.put(Asked::of(&Record { number, ..record() }, 0));
        }
        assert_eq!((faults.swaps_asked().0.len(), faults.swaps_asked().1), (MOST_REFUSED + MOST_BEGUN, 8));
    }

    #[test]
    fn the_handbook_says_what_is_told_of_a_swap() {
        let handbook = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/handbook.md")).unwrap();
        let (_, section) = handbook.split_once("| key of `swaps` |").unwrap();
        let (section, _) = section.split_once("\n\n").unwrap();
        let asked = serde_json::to_value(Asked::of(&record(), 7)).unwrap();
        for key in asked.as_object().unwrap().keys() {
            assert!(section.contains(&format!("`{key}`")), "{key} is not in the handbook");
        }
        for became in [Became::UnderWay, Became::Done, Became::RolledBack, Became::Refused] {
            let word = serde_json::to_value(became).unwrap();
            assert!(section.contains(&format!("`{}`", word.as_str().unwrap())), "{word} is not in the handbook");
        }
    }
}
