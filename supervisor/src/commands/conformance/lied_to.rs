//! Whether an engine withstands what is wrong in what it reads: those whose output it reads are asked to say NaN, an epoch that is over, or another layout, each
//! by that output alone, so that nobody else finds them first. The engine lives on, goes on, and says nothing that others refuse; where its role computes from that
//! output, it counts what it refuses, too.
//!
//! Not all roles can be asked for the last. Whose pictures, figures and recordings come from the pages alone is good without any stream, and so is a fluid whose
//! walls stand still; and where several read an output, its writer may be gone before this one has looked. Of these it is asked that they live. The servo is asked
//! nothing: it reads input records, and what a device says wrong is its command, which the hardware alone reads.

use super::{Check, Private, active, check};
use crate::control::{self, Request};
use crate::faultfile::{FaultKind, Injection, Output};
use crate::mischief::{self, Charge};
use crate::policy::DOOMED_NS;
use crate::view::{ProcessView, Viewer};
use hyst_exchange::{ReadPage, Station, StationPage, system};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

const WITHSTANDS: &str = "withstands what is wrong";
/// What is said, one after the other: each where that output can be wrong so.
const KINDS: [FaultKind; 3] = [FaultKind::Nan, FaultKind::Epoch, FaultKind::Layout];
/// For how long a writer is asked at most, s; it is undone before.
const LIES_FOR_S: f64 = 4.0;
/// How long it may take to begin, ns, and a reader to refuse it then: four of a fluid's longest steps.
const BEGINS_WITHIN_NS: u64 = 2_500_000_000;
const REFUSED_WITHIN_NS: u64 = 1_000_000_000;
/// How long it is said to those who need not refuse it, ns: more than any of their steps takes, on a machine that is not busy.
const BORNE_NS: u64 = 300_000_000;
/// How long until a reader beats again, ns: the pictures of a software driver take a second on a busy machine.
const BEATS_WITHIN_NS: u64 = 2_500_000_000;
const LOOK_NS: u64 = 1_000_000;
/// After it, ns: whoever is replaced for what it did is gone by then. And of a role with a state, whose next holder is lied to or lies next: it has held for so long
/// that its end says nothing of the state that it went on from.
const REST_NS: u64 = 300_000_000;
const REST_OF_STATE_NS: u64 = DOOMED_NS + 100_000_000;
/// The first epoch that has one before it: what is said under none is for the judge of a swap, and refused by nobody.
const SECOND_EPOCH: u32 = 2;
/// How often it is tried: a reader that somebody had to replace may have been kept from its core.
const TRIES: usize = 2;

/// An output that a role reads.
struct Source {
    writer: Role,
    /// Which of the writer's; of one that has a single output that.
    output: Option<Output>,
    what: &'static str,
    /// Whether the role computes from it, so that it must refuse it.
    is_computed_from: bool,
}

const fn computed_from(writer: Role, output: Option<Output>, what: &'static str) -> Source {
    Source { writer, output, what, is_computed_from: true }
}

const fn borne(writer: Role, output: Option<Output>, what: &'static str) -> Source {
    Source { writer, output, what, is_computed_from: false }
}

const STATE: Option<Output> = Some(Output::State);
const CELL: Option<Output> = Some(Output::Cell);
/// The NaN of its contact model has the tissue replaced, so that there is an epoch that is over.
const OF_DEVICE: &[Source] =
    &[computed_from(Role::Haptic, CELL, "its force"), computed_from(Role::Tissue, CELL, "its contact model")];
/// The spare follows the holder, which is an engine of the same kind; and the coordinator the workers.
const OF_TISSUE: &[Source] =
    &[computed_from(Role::Tissue, STATE, "its state"), computed_from(Role::CollisionWorker, None, "its share")];
const OF_FLUID: &[Source] = &[computed_from(Role::Fluid, STATE, "its state"), borne(Role::Tissue, STATE, "its state")];
const OF_WORKER: &[Source] = &[computed_from(Role::Tissue, Some(Output::Job), "its jobs")];
const OF_RENDERING: &[Source] = &[borne(Role::Tissue, STATE, "its state")];
const OF_RECORDER: &[Source] = &[borne(Role::Haptic, Some(Output::Force), "its stream of what was applied")];
const OF_CONSOLE: &[Source] = &[borne(Role::Fluid, CELL, "what it says of the medium")];

/// What a role reads most directly.
fn sources(role: Role) -> &'static [Source] {
    match role {
        Role::Device => OF_DEVICE,
        Role::Tissue => OF_TISSUE,
        Role::Fluid => OF_FLUID,
        Role::CollisionWorker => OF_WORKER,
        Role::Rendering => OF_RENDERING,
        Role::Recorder => OF_RECORDER,
        Role::Console => OF_CONSOLE,
        Role::Hardware | Role::Haptic | Role::Supervisor | Role::Guardian => &[],
    }
}

impl Source {
    fn lie(&self, kind: FaultKind, of: &str) -> Injection {
        Injection { output: self.output, for_s: Some(LIES_FOR_S), ..Injection::now(kind, of) }
    }

    /// What can be wrong in it.
    fn kinds(&self) -> impl Iterator<Item = FaultKind> + '_ {
        KINDS.into_iter().filter(move |kind| self.lie(*kind, self.writer.name()).check().is_ok())
    }

    fn rest_ns(&self) -> u64 {
        if self.writer.is_stateful() { REST_OF_STATE_NS } else { REST_NS }
    }

    /// Who does the writer's work. One that is to say an epoch that is over has one before its own.
    fn writer(&self, kind: FaultKind, private: &mut Private) -> Result<ProcessView, String> {
        let found = active(self.writer, private)?;
        if kind != FaultKind::Epoch || !self.writer.is_stateful() || found.epoch >= SECOND_EPOCH {
            return Ok(found);
        }
        crate::proc::signal(found.pid, Signal::KILL);
        system::sleep_ns(self.rest_ns());
        active(self.writer, private)
    }
}

/// What is wrong with an engine.
#[derive(Debug, PartialEq)]
struct Flaw {
    why: String,
    /// It cannot have been the machine.
    is_certain: bool,
}

impl Flaw {
    fn after(self, said: &str) -> Flaw {
        Flaw { why: format!("{said}: {}", self.why), ..self }
    }
}

impl From<String> for Flaw {
    fn from(why: String) -> Flaw {
        Flaw { why, is_certain: false }
    }
}

/// One that reads it.
struct Reader {
    slot: Slot,
    incarnation: u32,
    pid: u32,
    page: ReadPage,
    /// What it had refused before.
    refused: u64,
}

fn refused(page: &ReadPage) -> u64 {
    [header::INVALID, header::STALE, header::FROZEN].iter().fold(0, |sum: u64, word| sum.saturating_add(page.load64(*word)))
}

impl Reader {
    /// Those of a role that live, but for the one that lies.
    fn all(station: &Station, role: Role, liar: u32) -> Result<Vec<Reader>, String> {
        let clock = station.open().map_err(|error| error.to_string())?;
        let living = clock.occupied(role).filter(|(slot, incarnation)| *incarnation != liar && !clock.is_dead(*slot));
        let readers = living.filter_map(|(slot, incarnation)| {
            let page = station.read_slot(slot, incarnation).ok()?;
            Some(Reader { slot, incarnation, pid: clock.pid(slot), refused: refused(&page), page })
        });
        let readers: Vec<Reader> = readers.collect();
        if readers.is_empty() { Err(format!("no {} lives that could read it", role.name())) } else { Ok(readers) }
    }

    fn has_refused(&self) -> bool {
        refused(&self.page) > self.refused
    }

    /// What became of it, if it does not live and beat again after a time.
    fn flaw(&self, clock: &StationPage, after_ns: u64) -> Option<Flaw> {
        if clock.incarnation(self.slot) == self.incarnation && !clock.is_dead(self.slot) {
            let beats = until(BEATS_WITHIN_NS, || self.page.load64(header::HEARTBEAT_NS) > after_ns);
            return (!beats).then(|| format!("{} hangs", self.slot).into());
        }
        let word = clock.page().load64(layout::SLOT_EXIT + self.slot.number());
        let status = layout::exit_of(word, self.pid).map(ExitStatus::from_raw);
        let is_killed = |status: &ExitStatus| status.signal().and_then(Signal::from_named_raw) == Some(Signal::KILL);
        Some(match status.filter(|status| !is_killed(status)) {
            Some(status) => Flaw { why: format!("{} died of it ({status})", self.slot), is_certain: true },
            None => format!("{} was ended: it hung, or others refuse what it says", self.slot).into(),
        })
    }
}

/// Waits until something is so; whether it is.
fn until(within_ns: u64, is_so: impl Fn() -> bool) -> bool {
    let end_ns = system::now_ns() + within_ns;
    while !is_so() {
        if system::now_ns() >= end_ns {
            return false;
        }
        system::sleep_ns(LOOK_NS);
    }
    true
}

/// Has those lie to an engine that it reads; nothing of a role to which nobody can.
pub(super) fn withstands(role: Role, private: &mut Private) -> Option<Check> {
    let mut told = Vec::new();
    for source in sources(role) {
        for kind in source.kinds() {
            match tried(role, source, kind, private) {
                Ok(Some(text)) => told.push(text),
                // Who does not lie when it is asked to has a check of its own, and is not waited for again.
                Ok(None) => {
                    told.push(format!("{} of {} in {}: not said", kind.name(), source.writer.name(), source.what));
                    break;
                }
                Err(why) => return Some(check(WITHSTANDS, Err(why))),
            }
        }
    }
    (!told.is_empty()).then(|| check(WITHSTANDS, Ok(told.join(", "))))
}

fn tried(role: Role, source: &Source, kind: FaultKind, private: &mut Private) -> Result<Option<String>, String> {
    let mut found = Err(String::new());
    for _ in 0..TRIES {
        let Flaw { why, is_certain } = match tell(role, source, kind, private) {
            Ok(told) => return Ok(told),
            Err(flaw) => flaw,
        };
        found = Err(why);
        if is_certain {
            break;
        }
    }
    found
}

/// Has the writer say it once, and says what came of it; `None` if it was not said: a tissue that asks no workers reads no answer of theirs.
fn tell(role: Role, source: &Source, kind: FaultKind, private: &mut Private) -> Result<Option<String>, Flaw> {
    let writer = source.writer(kind, private)?;
    let station = private.station.clone();
    let slot = Slot::parse(&writer.name).ok_or_else(|| format!("{} is no process", writer.name))?;
    let page = station.read_slot(slot, writer.incarnation).map_err(|error| error.to_string())?;
    let readers = Reader::all(&station, role, writer.incarnation)?;
    let said = format!("{} of {} in {}", kind.name(), writer.name, source.what);
    let (begun_ns, done) = (system::now_ns(), page.load64(header::MISCHIEF));
    control::ask(&station, &Request::Fault(source.lie(kind, &writer.name)))?;
    let is_told = until(BEGINS_WITHIN_NS, || page.load64(header::MISCHIEF) != done);
    let told_ns = system::now_ns();
    let has_refused = || source.is_computed_from && readers.iter().any(Reader::has_refused);
    let within_ns = if source.is_computed_from { REFUSED_WITHIN_NS } else { BORNE_NS };
    let has_refused = is_told && until(within_ns, has_refused);
    let over_ns = system::now_ns();
    // It may have been replaced for it by now, and then nothing is left to end.
    let _ = control::ask(&station, &Request::Fault(Injection::now(FaultKind::Undo, &writer.name)));
    system::sleep_ns(source.rest_ns());
    if !is_told {
        return Ok(None);
    }
    let whole = active(role, private);
    let clock = station.open().map_err(|error| error.to_string())?;
    if let Some(flaw) = readers.iter().find_map(|reader| reader.flaw(&clock, over_ns)) {
        return Err(flaw.after(&said));
    }
    whole.map_err(|why| Flaw::from(why).after(&said))?;
    if let Some(why) = accused(&station, &readers, writer.incarnation, begun_ns) {
        return Err(Flaw::from(why).after(&said));
    }
    let after_ms = (over_ns - told_ns) as f64 * 1e-6;
    match (source.is_computed_from, has_refused) {
        (true, true) => Ok(Some(format!("{said}: refused after {after_ms:.0} ms"))),
        (true, false) => {
            let names: Vec<String> = readers.iter().map(|reader| reader.slot.to_string()).collect();
            Err(Flaw::from(format!("{} refused nothing of it in {after_ms:.0} ms", names.join(", "))).after(&said))
        }
        (false, _) => Ok(Some(format!("{said}: borne"))),
    }
}

/// Who refuses what a reader has said since, if anybody but the one that lies does.
fn accused(station: &Station, readers: &[Reader], liar: u32, since_ns: u64) -> Option<String> {
    let mut viewer = Viewer::open(station).ok()?;
    let (charges, _) = mischief::charges(&mut viewer);
    let is_grave = |charge: &Charge| [Distrust::Invalid, Distrust::Still, Distrust::Frozen].iter().any(|why| charge.is(*why));
    let counts = |charge: &Charge| charge.last_ns >= since_ns && is_grave(charge) && viewer.page().incarnation(charge.by) != liar;
    charges.iter().filter(|charge| counts(charge)).find_map(|charge| {
        let reader = readers.iter().find(|reader| reader.incarnation == charge.incarnation)?;
        Some(format!("{} refuses what {} says since", charge.by, reader.slot))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::{begin, book};

    #[test]
    fn each_role_is_told_by_those_whom_it_reads_what_can_be_wrong_there_and_a_servo_nothing() {
        let told = |role: Role| {
            let of = |source: &Source| {
                let kinds: Vec<&str> = source.kinds().map(FaultKind::name).collect();
                format!("{}: {}", source.writer.name(), kinds.join(" "))
            };
            sources(role).iter().map(of).collect::<Vec<_>>()
        };
        assert_eq!(told(Role::Device), ["haptic: nan", "tissue: nan epoch"]);
        assert_eq!(told(Role::Tissue), ["tissue: nan epoch layout", "collision-worker: nan epoch layout"]);
        assert_eq!(told(Role::Fluid), ["fluid: nan epoch layout", "tissue: nan epoch layout"]);
        assert_eq!(told(Role::CollisionWorker), ["tissue: nan layout"]);
        assert_eq!(told(Role::Rendering), ["tissue: nan epoch layout"]);
        assert_eq!(told(Role::Recorder), ["haptic: nan"]);
        assert_eq!(told(Role::Console), ["fluid: nan epoch"]);
        assert_eq!(told(Role::Haptic), Vec::<String>::new());
    }

    #[test]
    fn a_reader_that_dies_of_it_is_told_from_one_that_was_ended_and_from_one_that_lives() {
        let (station, _faults) = book("lied-to");
        let page = station.open_for_keeping().unwrap();
        let [liar, slot] = [0, 1].map(|index| Slot::new(Role::Fluid, index).unwrap());
        let _liars = begin(&station, &page, liar, 4);
        assert!(Reader::all(&station, Role::Fluid, 4).is_err(), "nobody reads it");
        let own = begin(&station, &page, slot, 5);
        let readers = Reader::all(&station, Role::Fluid, 4).unwrap();
        let [reader] = readers.as_slice() else { panic!("{} readers", readers.len()) };
        assert!(reader.slot == slot && !reader.has_refused());
        own.store64(header::STALE, 1);
        assert!(reader.has_refused());
        let clock = station.open().unwrap();
        own.store64(header::HEARTBEAT_NS, 100);
        assert_eq!(reader.flaw(&clock, 99), None);
        let ended = |status: i32| {
            page.store64(layout::SLOT_EXIT + slot.number(), layout::exit_word(std::process::id(), status));
            page.store32(layout::SLOT_DEAD + slot.number(), 1);
            reader.flaw(&clock, 99).map(|flaw| (flaw.is_certain, flaw.why))
        };
        let said = |found: Option<(bool, String)>, is_certain: bool, words: &str| {
            found.is_some_and(|(certain, why)| certain == is_certain && why.starts_with(words))
        };
        assert!(said(ended(1 << 8), true, "fluid:1 died of it"), "by itself");
        assert!(said(ended(6), true, "fluid:1 died of it"), "of a signal of its own");
        assert!(said(ended(9), false, "fluid:1 was ended"), "by the supervisor, and the machine may be to blame");
    }

    #[test]
    fn who_refuses_what_a_reader_says_counts_unless_it_is_the_liar_or_was_before() {
        let (station, _faults) = book("accused");
        let page = station.open_for_keeping().unwrap();
        let (device, reader) = (Slot::first(Role::Device), Slot::first(Role::Tissue));
        let own = begin(&station, &page, device, 7);
        let _readers = begin(&station, &page, reader, 8);
        let readers = Reader::all(&station, Role::Tissue, 0).unwrap();
        let now_ns = system::now_ns();
        let charge = |why: Distrust| {
            let words = [(why as u64) << 32 | 8, now_ns, now_ns];
            words.into_iter().enumerate().for_each(|(word, value)| own.store64(header::distrusted(0) + word, value));
        };
        charge(Distrust::Invalid);
        let told = "device refuses what tissue:0 says since";
        assert_eq!(accused(&station, &readers, 9, now_ns).as_deref(), Some(told));
        assert_eq!(accused(&station, &readers, 7, now_ns), None, "that one lies");
        assert_eq!(accused(&station, &readers, 9, now_ns + 1), None, "of before");
        charge(Distrust::Missing);
        assert_eq!(accused(&station, &readers, 9, now_ns), None, "it was late");
    }
}
