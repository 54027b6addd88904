//! Whether a recorder on probation writes, beside the ticks, what the one before it wrote and what is made all the time: steps and states of the tissue, states of
//! the fluid. Of what happens its own start alone is looked for, which each of them sees.
//!
//! Promise: nobody is found who reads what there is whenever he fetches ticks. What he reads with a tick comes to the file with it; and a tick that was made after
//! somebody here has seen a new state was fetched after that, however late he was let run.

use hyst_exchange::{ReadPage, Roster, Station, StationPage};
use hyst_messages::page::{fluid, tissue};
use hyst_messages::{Role, Slot};
use hyst_recording::Block;

/// Kinds of messages that are looked for.
pub(super) const OTHERS: usize = 3;
const NAMES: [&str; OTHERS] = ["steps of the tissue", "states of the tissue", "states of the fluid"];
/// Ticks within which a kind is made that is looked for: so long may a state of a coarse flow take, twice.
const MADE_TICKS: u64 = 500;
/// Ticks behind that with which it must have come to the file, or an event with what happened in a tick.
const BEHIND_TICKS: u64 = 500;

/// What is there of each kind: who has made the newest, and the tick of that.
pub(super) type Made = [Option<(u32, u64)>; OTHERS];

/// How many of each kind are in a block.
pub(super) fn counts(block: &Block) -> [usize; OTHERS] {
    [block.steps.len(), block.tissue.len(), block.fluid.len()]
}

/// What those who hold the roles have made.
pub(super) fn made(station: &Station, clock: &StationPage) -> Made {
    let roster = Roster::open(station).ok();
    let page = |role: Role| {
        let holder = roster.as_ref()?.holder(role).incarnation;
        let (slot, _) = clock.occupied(role).find(|(_, incarnation)| *incarnation == holder)?;
        Some((holder, station.read_slot(slot, holder).ok()?))
    };
    let of = |page: &Option<(u32, ReadPage)>, tick: fn(&ReadPage) -> Option<u64>| {
        let (by, page) = page.as_ref()?;
        Some((*by, tick(page)?))
    };
    let (of_tissue, of_fluid) = (page(Role::Tissue), page(Role::Fluid));
    [
        of(&of_tissue, |page| Some(page.ring_end(tissue::STEPS))),
        of(&of_tissue, |page| page.cell(tissue::STATUS).map(|(_, status)| status.state_tick)),
        of(&of_fluid, |page| page.cell(fluid::STATUS).map(|(_, status)| status.state_tick)),
    ]
}

/// A time in which nothing of a kind came to the file.
#[derive(Clone, Copy, Debug)]
struct Spell {
    /// Who could make it, the tick of his newest when it began, and when that was.
    by: u32,
    tick: u64,
    since: u64,
    /// The tick in which he was seen to have made another.
    due: Option<u64>,
}

/// What is looked for, and how that goes.
#[derive(Debug, Default)]
pub(super) struct Beside {
    /// What the one before wrote.
    asked: [bool; OTHERS],
    spells: [Option<Spell>; OTHERS],
    /// The newcomer, as long as the file does not say that it has started; and the tick in which some of it was seen to be written first.
    guest: Option<u32>,
    since: Option<u64>,
    flaw: Option<String>,
}

impl Beside {
    /// Of a newcomer that follows one who wrote these.
    pub(super) fn behind(asked: [bool; OTHERS], guest: u32) -> Beside {
        Beside { asked, guest: Some(guest), ..Beside::default() }
    }

    /// Takes what came to the file, which has ticks up to `in_file`, and then what there was to be written, in the present tick. `has_begun`: the newcomer has
    /// written some of it.
    pub(super) fn take(&mut self, came: &Block, in_file: u64, made: Made, present: u64, has_begun: bool) {
        self.flaw = None;
        let name = Slot::first(Role::Recorder).to_string();
        if came.events.iter().any(|event| event.process == name && Some(event.incarnation) == self.guest) {
            self.guest = None;
        }
        if !has_begun {
            return;
        }
        let has_come = |tick: u64| in_file >= tick.saturating_add(BEHIND_TICKS);
        let since = *self.since.get_or_insert(present);
        if self.guest.is_some() && has_come(since) {
            self.flaw = Some("its file does not say that it has started".into());
        }
        let counts = counts(came);
        for kind in (0..OTHERS).filter(|kind| self.asked[*kind]) {
            let spell = match (self.spells[kind], made[kind]) {
                (Some(spell), Some((by, tick))) if by == spell.by && counts[kind] == 0 => {
                    let is_due = tick > spell.tick && present >= spell.since.saturating_add(MADE_TICKS);
                    Some(Spell { due: spell.due.or(is_due.then_some(present)), ..spell })
                }
                (_, made) => made.map(|(by, tick)| Spell { by, tick, since: present, due: None }),
            };
            if spell.and_then(|spell| spell.due).is_some_and(has_come) {
                self.flaw = Some(format!("its file has no {} any more", NAMES[kind]));
            }
            self.spells[kind] = spell;
        }
    }

    /// What is missing now.
    pub(super) fn flaw(&self) -> Option<String> {
        self.flaw.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{FluidStatus, StepRecord, TissueStatus};
    use hyst_recording::{Event, Level};

    const GUEST: u32 = 17;

    /// Has a recorder looked at four times a second, for two seconds from tick 10 000 on, while a tissue (5) and a fluid (6) go on. `writes`: what comes with the
    /// ticks before a look, 300 of which are not there yet. Gives what is missing at each look.
    fn missing(asked: [bool; OTHERS], made: impl Fn(u64) -> Made, writes: impl Fn(u64) -> Block) -> Vec<Option<String>> {
        let mut beside = Beside::behind(asked, GUEST);
        let look = |present: u64| {
            beside.take(&writes(present), present - 300, made(present), present, present > 10_000);
            beside.flaw()
        };
        (10_000..12_000).step_by(250).map(look).collect()
    }

    fn all_made(present: u64) -> Made {
        [Some((5, present)), Some((5, present - 1)), Some((6, present / 500 * 500))]
    }

    fn started(present: u64, process: &str, incarnation: u32) -> Vec<Event> {
        let (kind, process, text) = ("started".into(), process.into(), String::new());
        let event = Event { tick: present, level: Level::Info, kind, process, incarnation, text };
        if present == 10_250 { vec![event] } else { Vec::new() }
    }

    fn whole(present: u64) -> Block {
        Block {
            steps: vec![StepRecord::default()],
            tissue: vec![TissueStatus::default()],
            fluid: if present.is_multiple_of(500) { vec![FluidStatus::default()] } else { Vec::new() },
            events: started(present, "recorder", GUEST),
            ..Block::default()
        }
    }

    fn first(missing: Vec<Option<String>>) -> Option<(usize, String)> {
        missing.into_iter().enumerate().find_map(|(at, missing)| Some((at, missing?)))
    }

    #[test]
    fn who_writes_all_that_is_made_or_all_that_was_asked_for_is_right() {
        assert_eq!(first(missing([true; 3], all_made, whole)), None);
        let of_tissue = |present: u64| Block { fluid: Vec::new(), ..whole(present) };
        assert_eq!(first(missing([true, true, false], all_made, of_tissue)), None, "the one before wrote no more");
        let nothing = |present: u64| Block { steps: Vec::new(), tissue: Vec::new(), ..whole(present) };
        assert_eq!(first(missing([true; 3], |present| [None, None, all_made(present)[2]], nothing)), None, "nobody makes any");
        let stands = |present: u64| [Some((5, 9_000)), Some((5, 9_000)), all_made(present)[2]];
        assert_eq!(first(missing([true; 3], stands, nothing)), None, "who makes them stands still");
        let changes = |present: u64| [Some((present as u32, present)), None, all_made(present)[2]];
        assert_eq!(first(missing([true; 3], changes, nothing)), None, "each lives for a moment");
    }

    #[test]
    fn who_leaves_out_a_kind_that_is_made_is_found_and_who_comes_late_with_it_is_not() {
        let without = |change: fn(&mut Block)| {
            let writes = |present: u64| {
                let mut block = whole(present);
                change(&mut block);
                block
            };
            first(missing([true; 3], all_made, writes))
        };
        let found = |what: &str| Some((7, format!("its file has no {what} any more")));
        assert_eq!(without(|block| block.steps.clear()), found("steps of the tissue"));
        assert_eq!(without(|block| block.tissue.clear()), found("states of the tissue"));
        assert_eq!(without(|block| block.fluid.clear()), found("states of the fluid"));
        let late = |present: u64| if present < 11_750 { Block { steps: Vec::new(), ..whole(present) } } else { whole(present) };
        assert_eq!(first(missing([true; 3], all_made, late)), None);
    }

    #[test]
    fn who_does_not_say_that_it_has_started_is_found() {
        let says = |process: &str, incarnation: u32| {
            let writes = |present: u64| Block { events: started(present, process, incarnation), ..whole(present) };
            first(missing([true; 3], all_made, writes))
        };
        assert_eq!(says("recorder", GUEST), None);
        let silent = Some((5, "its file does not say that it has started".to_string()));
        assert_eq!([says("recorder", GUEST - 1), says("tissue", GUEST), says("", 0)], [silent.clone(), silent.clone(), silent]);
        let mut unknown = Beside::default();
        unknown.take(&Block::default(), 90_000, all_made(90_000), 10_000, true);
        assert_eq!(unknown.flaw(), None, "where nobody knows what was before nothing is looked for");
    }
}
