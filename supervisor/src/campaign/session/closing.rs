//! How a fault of a campaign ends: its line, and those of others that were closed meanwhile, are read from the station's file.

use super::{QUIET_TICKS, Session, Trouble, keepers};
use crate::campaign::cell::Cell;
use crate::campaign::outcome::{Ending, Outcome};
use crate::control::NoAnswer;
use crate::fault::Fault;
use crate::faultfile::{FaultKind, Injection, Keepers};
use hyst_exchange::system;
use hyst_messages::Role;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// The supervisor closes a fault 40 s after it at the latest, and looks for a control window for as long as the fault took.
const CLOSE_NS: u64 = 120_000_000_000;
/// The same for one that makes a start hang, for which an ordinary process has 180 s.
const CLOSE_START_NS: u64 = 600_000_000_000;

/// How long after nobody has answered a fault may still be done, ns: a main loop that is busy has the request before it, and takes each within milliseconds.
const LATE_NS: u64 = 10_000_000_000;

/// When a fault was asked for, and was done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub sent_ns: u64,
    /// By when it was done at the latest.
    pub by_ns: u64,
    /// When a keeper was hurt, whom nobody else can be asked to hurt.
    pub struck_ns: Option<u64>,
}

/// What is known of a fault that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Done {
    pub by_ns: u64,
    pub struck_ns: Option<u64>,
}

impl Done {
    /// To a keeper, at this time.
    pub(super) fn at(struck_ns: u64) -> Done {
        Done { by_ns: system::now_ns(), struck_ns: Some(struck_ns) }
    }

    /// By what the supervisor answers now; why not, if it was not done, or not as it was to be.
    pub(super) fn of_answer(answer: Result<(), NoAnswer>, now_ns: u64) -> Result<Done, Omitted> {
        match answer {
            Ok(()) => Ok(Done { by_ns: now_ns, struck_ns: None }),
            Err(NoAnswer::Unanswered(_)) => Ok(Done { by_ns: now_ns + LATE_NS, struck_ns: None }),
            Err(NoAnswer::Half(reason)) => Err(Omitted::Half(reason)),
            Err(NoAnswer::Refused(reason)) => Err(Omitted::Refused(reason)),
        }
    }
}

/// Why a fault was not done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Omitted {
    /// It, or the one beside it, was refused, and why.
    Refused(String),
    /// It, or the one beside it, came to one alone of the two whom it was for: another fault than the one that is judged, whose words say to whom.
    Half(String),
    /// For the fault beside it a role was to be handed over, and none was.
    NoHandOver,
}

impl Omitted {
    /// How the wait for a fault of this cell ended, and why.
    pub(super) fn ending(self, cell: &str) -> (Ending, String) {
        match self {
            Omitted::Refused(reason) | Omitted::Half(reason) => (Ending::Refused, reason),
            Omitted::NoHandOver => (Ending::NoState, format!("no role was handed over for the first fault of {cell:?}")),
        }
    }
}

/// How many processes were hurt although the fault counts as refused: the station tells of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Begun {
    /// By the fault beside it.
    pub beside: usize,
    /// By the fault itself.
    pub own: usize,
}

impl Begun {
    /// Of a cell's fault that was not done, with or without the one beside it having been done before: what came by half came to one.
    pub(super) fn of(cell: &Cell, omitted: &Omitted, was_first_done: bool) -> Begun {
        let half = usize::from(matches!(omitted, Omitted::Half(_)));
        match cell.with.is_some() && !was_first_done {
            true => Begun { beside: half, own: 0 },
            false => Begun { beside: cell.faults_beside(), own: half },
        }
    }

    /// All of them.
    pub(super) fn processes(self) -> usize {
        self.beside + self.own
    }
}

impl Session {
    /// Waits until the fault, and the one in whose recovery it came, are closed: a line of each is in the station's file.
    pub(super) fn close(&mut self, outcome: &mut Outcome, cell: &Cell, asked: Asked) -> Result<(), Trouble> {
        let injections: Vec<&Injection> = [cell.with.as_ref(), Some(&cell.injection)].into_iter().flatten().collect();
        let expected = cell.faults() + cell.faults_beside();
        let close_ns = if cell.injection.kind == FaultKind::HangStart { CLOSE_START_NS } else { CLOSE_NS };
        let ours = self.lines_of(outcome, &injections, expected, close_ns, asked)?;
        if ours.len() >= expected {
            let (own, beside) = joined(ours, cell.faults());
            (outcome.fault, outcome.with) = (own, beside.filter(|_| cell.with.is_some()));
        }
        if let (Some(fault), Some(viewer)) = (&mut outcome.fault, &self.viewer) {
            outcome.ending = Ending::Closed;
            if let Some(struck_ns) = asked.struck_ns {
                count_from(fault, struck_ns, viewer.page().tick_at(struck_ns));
            }
            outcome.tick = fault.tick;
            let in_tick_ns = fault.injected_ns.saturating_sub(viewer.page().start_of(outcome.tick));
            outcome.injected_phase_us = (in_tick_ns / 1_000).min(999) as u32;
        } else {
            outcome.reason = format!("no verdict within {} s", close_ns / 1_000_000_000);
        }
        self.be_quiet_after(outcome);
        Ok(())
    }

    /// Waits until what was done although the fault counts as refused is closed, so that neither it nor what it brings about is anybody else's: the fault beside
    /// it, whole or by half, and what was done of itself by half.
    pub(super) fn close_rest(&mut self, outcome: &mut Outcome, cell: &Cell, asked: Asked, begun: Begun) -> Result<(), Trouble> {
        let beside = cell.with.as_ref().filter(|_| begun.beside > 0);
        let own = Some(&cell.injection).filter(|_| begun.own > 0);
        let injections: Vec<&Injection> = beside.into_iter().chain(own).collect();
        let mut ours = self.lines_of(outcome, &injections, begun.processes(), CLOSE_NS, asked)?;
        if begun.own > 0 && ours.len() >= begun.processes() {
            outcome.fault = ours.pop();
        }
        outcome.with = ours.pop().filter(|_| begun.beside > 0);
        self.be_quiet_after(outcome);
        Ok(())
    }

    /// The lines of these injections, in the order of their injection, once there are so many or it takes too long; those of others go into the outcome.
    fn lines_of(
        &mut self,
        outcome: &mut Outcome,
        injections: &[&Injection],
        expected: usize,
        limit_ns: u64,
        asked: Asked,
    ) -> Result<Vec<Fault>, Trouble> {
        let is_ours = |fault: &Fault| injections.iter().any(|injection| is_of(fault, injection, asked));
        let lies_ns =
            injections.iter().filter(|injection| injection.kind == FaultKind::Frozen).filter_map(|injection| injection.for_s);
        let lies_until_ns = lies_ns.map(|for_s| asked.by_ns + (for_s * 1e9) as u64).max().unwrap_or(0);
        let (mut closed, mut touching) = (Vec::new(), 0);
        let waited = self.wait(limit_ns, |session| {
            closed.extend(session.unread());
            touching += u32::from(system::now_ns() < lies_until_ns && session.counters().contacts > 0);
            (closed.iter().filter(|fault| is_ours(fault)).count() >= expected).then_some(())
        });
        let (mut ours, others): (Vec<Fault>, Vec<Fault>) = closed.into_iter().partition(is_ours);
        outcome.collateral.extend(others);
        outcome.touching = touching;
        waited?;
        sort(&mut ours, |fault| injections.last().is_some_and(|second| is_of(fault, second, asked)));
        Ok(ours)
    }

    /// The next fault finds room for its control after the windows of this one and of what came of it.
    fn be_quiet_after(&mut self, outcome: &Outcome) {
        let ends = [&outcome.fault, &outcome.with].into_iter().flatten().chain(&outcome.collateral);
        let end_tick = ends.filter_map(|fault| fault.window).map(|window| window.to_tick).max().unwrap_or_else(|| self.tick());
        self.quiet_from_tick = end_tick + QUIET_TICKS;
    }

    /// Faults that were closed since the last call.
    pub(super) fn unread(&mut self) -> Vec<Fault> {
        let news = news(&self.station.root().join("faults.jsonl"), self.read_bytes).unwrap_or_default(); // none was closed yet
        self.read_bytes += news.len() as u64;
        news.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect()
    }
}

/// The whole lines of a file from a byte on. It is looked at every 5 ms, mostly in a control window: what was read is not read again.
fn news(path: &Path, from_byte: u64) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    if file.metadata()?.len() <= from_byte {
        return Ok(Vec::new());
    }
    file.seek(SeekFrom::Start(from_byte))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    bytes.truncate(bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1));
    Ok(bytes)
}

/// Of a keeper it is known when it was struck; who tells of it knows when it was last well, which is where its window begins.
fn count_from(fault: &mut Fault, struck_ns: u64, tick: u64) {
    let earlier_us = (struck_ns as f64 - fault.injected_ns as f64) * 1e-3;
    let since = |us: f64| (us - earlier_us).max(0.0);
    (fault.detected_us, fault.recovered_us) = (fault.detected_us.map(since), fault.recovered_us.map(since));
    (fault.injected_ns, fault.tick) = (struck_ns, tick);
}

/// In the order of their injection, those of the second last: a keeper's is dated by its last heartbeat, which may lie before the first. Of two that were hit
/// at once the one that took longer comes later.
fn sort(ours: &mut [Fault], is_of_second: impl Fn(&Fault) -> bool) {
    ours.sort_by_key(|fault| (is_of_second(fault), fault.injected_ns, fault.recovered_us.map_or(u64::MAX, |us| us as u64)));
}

/// What is known of a fault, by its lines, which are the last, and of the one beside it: of two that were hit at once the one that took longer tells, with the
/// harm of both.
fn joined(mut ours: Vec<Fault>, own: usize) -> (Option<Fault>, Option<Fault>) {
    let own = ours.split_off(ours.len().saturating_sub(own));
    (own.into_iter().rev().reduce(with_harm_of), ours.into_iter().reduce(with_harm_of))
}

/// One of two that were hit at once, for both: it came about if both did, the hand was given what was wrong of either, and the force stepped as far as beside
/// either. What its window lost beyond its control's is its own.
fn with_harm_of(mut fault: Fault, other: Fault) -> Fault {
    fault.manifested &= other.manifested;
    if other.promise_held == Some(false) {
        fault.promise_held = Some(false);
    }
    if let Some((window, of_other)) = fault.window.as_mut().zip(other.window) {
        if of_other.force_step_max_n > window.force_step_max_n {
            fault.step = other.step;
        }
        window.wrong = window.wrong.saturating_add(of_other.wrong);
        window.force_step_max_n = window.force_step_max_n.max(of_other.force_step_max_n);
        let larger = |one: Option<f64>, two: Option<f64>| if two > one { two } else { one }; // none is less than any
        window.open_step_max_n = larger(window.open_step_max_n, of_other.open_step_max_n);
        window.contact_step_max_n = larger(window.contact_step_max_n, of_other.contact_step_max_n);
    }
    fault
}

/// Whether a closed fault is the injected one.
fn is_of(fault: &Fault, injection: &Injection, asked: Asked) -> bool {
    if let Some(keepers) = Keepers::parse(&injection.target) {
        return keepers::is_of(fault, keepers, asked.sent_ns);
    }
    fault.is(injection.kind)
        && Role::name_in(&fault.target) == Role::name_in(&injection.target)
        && (asked.sent_ns..=asked.by_ns).contains(&fault.injected_ns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Window;

    #[test]
    fn lines_are_read_once_and_whole_and_what_was_read_is_not_read_again() {
        let path = std::env::temp_dir().join(format!("hystation-news-{}.jsonl", std::process::id()));
        let read = |from_byte: u64| String::from_utf8_lossy(&news(&path, from_byte).unwrap()).into_owned();
        std::fs::write(&path, "one\ntwo\nthr").unwrap();
        assert_eq!([read(0), read(4), read(8), read(11), read(99)], ["one\ntwo\n", "two\n", "", "", ""]);
        // Whatever the head has become: it is not looked at.
        std::fs::write(&path, b"\xff\xff\xff\xfftwo\nthree\n").unwrap();
        assert_eq!(read(8), "three\n");
        std::fs::remove_file(&path).unwrap();
        assert!(news(&path, 0).is_err());
    }

    /// It counted as refused: what had been done had no window, and its line was nobody's.
    #[test]
    fn a_fault_whose_answer_is_lost_is_looked_for_among_those_that_were_done() {
        let now_ns = 50_000_000_000;
        let answers = [Ok(()), Err(NoAnswer::Unanswered("busy".into())), Err(NoAnswer::Refused("no such spare".into()))];
        let [answered, lost, refused] = answers.map(|answer| Done::of_answer(answer, now_ns));
        assert_eq!(refused, Err(Omitted::Refused("no such spare".into())));
        let injection = Injection::now(FaultKind::Kill, "tissue:active");
        let is_found = |done: &Result<Done, Omitted>, injected_ns: u64| {
            let Done { by_ns, struck_ns } = done.clone().unwrap();
            let fault = Fault { kind: "kill".into(), target: "tissue:1".into(), injected_ns, ..Fault::default() };
            is_of(&fault, &injection, Asked { sent_ns: now_ns - 10_000_000, by_ns, struck_ns })
        };
        assert_eq!([0, 4_000_000_000].map(|late_ns| is_found(&lost, now_ns + late_ns)), [true, true], "it is done after all");
        assert_eq!([0, 4_000_000_000].map(|late_ns| is_found(&answered, now_ns + late_ns)), [true, false], "another one");
        assert!(!is_found(&lost, now_ns - 20_000_000), "one of before");
    }

    /// Whether it was a hand-over that was missing was found out again from the cell and what else was known, beside its text.
    #[test]
    fn a_fault_whose_hand_over_did_not_come_met_no_state_and_any_other_that_was_not_done_was_refused() {
        let reason = "no role was handed over for the first fault of \"kill guardian in a hand-over\"";
        assert_eq!(Omitted::NoHandOver.ending("kill guardian in a hand-over"), (Ending::NoState, reason.into()));
        let refused = Omitted::Refused("no such spare".into());
        assert_eq!(refused.ending("kill guardian in a hand-over"), (Ending::Refused, "no such spare".into()));
    }

    /// It was waited for as if it had come to both, for two minutes, and was a broken promise then.
    #[test]
    fn a_fault_that_came_to_one_alone_of_two_counts_as_refused_with_its_words() {
        let words = "tissue:both: tissue:1 is not alive now; wait until it is back; tissue:0 was hit alone";
        let omitted = Done::of_answer(Err(NoAnswer::Half(words.into())), 50_000_000_000).unwrap_err();
        assert_eq!(omitted, Omitted::Half(words.into()));
        assert_eq!(omitted.ending("kill tissue:both"), (Ending::Refused, words.into()));
    }

    /// Of a first fault that came by half nothing counted as begun.
    #[test]
    fn what_was_begun_of_a_fault_that_was_not_done_is_what_was_done_before_it_and_one_of_what_came_by_half() {
        let half = || Omitted::Half("tissue:0 was hit alone".into());
        let refused = || Omitted::Refused("no such spare".into());
        let begun = |target: &str, more: &str, omitted: Omitted, was_first_done: bool| {
            let text = format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"{target}\"]\ncount = 1\n{more}");
            let cell = crate::campaign::file::parse("t", &text).unwrap().cells.remove(0);
            let begun = Begun::of(&cell, &omitted, was_first_done);
            [begun.beside, begun.own]
        };
        assert_eq!([half(), refused()].map(|omitted| begun("tissue:both", "", omitted, false)), [[0, 1], [0, 0]]);
        let handed = "states = [\"handover\"]\nwith = \"leak-memory haptic:both rate=64.0\"\n";
        let in_handover = |omitted: Omitted, was_first_done: bool| begun("fluid:active", handed, omitted, was_first_done);
        assert_eq!([half(), refused()].map(|omitted| in_handover(omitted, false)), [[1, 0], [0, 0]], "the first was not done");
        assert_eq!([refused(), Omitted::NoHandOver].map(|omitted| in_handover(omitted, true)), [[2, 0]; 2]);
        let damaged = "states = [\"recovery\"]\nwith = 'corrupt tissue:active where=\"checkpoint\" seed=2'\n";
        assert_eq!(begun("tissue:both", damaged, half(), true), [1, 1]);
    }

    /// What the one that recovered sooner had done to the hand stood nowhere.
    #[test]
    fn of_two_that_were_hit_at_once_the_harm_of_both_counts_and_the_loss_of_the_one_that_took_longer() {
        let fault = |target: &str, missed: u64, wrong: u64, open_n: f64, contact_n: Option<f64>| {
            let (open_step_max_n, contact_step_max_n) = (Some(open_n), contact_n);
            let force_step_max_n = open_n.max(contact_n.unwrap_or(0.0));
            let window =
                Window { ticks: 200, missed, wrong, force_step_max_n, open_step_max_n, contact_step_max_n, ..Window::default() };
            let (target, promise_held) = (target.into(), Some(wrong == 0));
            Fault { target, manifested: true, promise_held, window: Some(window), ..Fault::default() }
        };
        let [first, sooner, later] = [
            fault("tissue:0", 1, 0, 0.9, None),
            fault("haptic:1", 30, 4, 0.3, None),
            Fault { promise_held: None, ..fault("haptic:0", 90, 1, 0.1, Some(0.2)) },
        ];
        let (own, beside) = joined(vec![first.clone(), sooner.clone(), later.clone()], 2);
        assert_eq!(beside, Some(first), "the one beside them is another");
        let own = own.unwrap();
        let window = own.window.unwrap();
        assert_eq!((own.target.as_str(), window.missed, window.wrong), ("haptic:0", 90, 5));
        assert_eq!((window.open_step_max_n, window.contact_step_max_n), (Some(0.3), Some(0.2)));
        assert_eq!((window.force_step_max_n, own.manifested, own.promise_held), (0.3, true, Some(false)));
        let silent = Fault { manifested: false, ..sooner };
        assert!(!joined(vec![silent, later.clone()], 2).0.unwrap().manifested, "it came to one alone");
        assert_eq!(joined(vec![later.clone()], 1), (Some(later), None));
    }

    /// Of both of a role, killed beside a damaged checkpoint, one counted as the damage; and a keeper as what came before it, by its last heartbeat.
    #[test]
    fn the_second_fault_comes_last_whenever_it_is_dated() {
        let fault = |target: &str, injected_ns: u64, recovered_us: f64| {
            let recovered_us = Some(recovered_us);
            Fault { kind: "kill".into(), target: target.into(), injected_ns, recovered_us, ..Fault::default() }
        };
        let order = |mut ours: Vec<Fault>, second: &str| {
            sort(&mut ours, |fault| fault.target.starts_with(second));
            ours.iter().map(|fault| (fault.target.clone(), fault.injected_ns)).collect::<Vec<_>>()
        };
        let keeper = order(vec![fault("supervisor", 90, 1.0), fault("tissue:0", 100, 5.0)], "supervisor");
        assert_eq!(keeper, [("tissue:0".to_string(), 100), ("supervisor".to_string(), 90)]);
        let both = order(vec![fault("fluid:1", 120, 9.0), fault("fluid:0", 120, 3.0), fault("tissue:0", 100, 5.0)], "fluid");
        assert_eq!(both.iter().map(|(target, _)| &target[..]).collect::<Vec<_>>(), ["tissue:0", "fluid:0", "fluid:1"]);
    }

    #[test]
    fn what_a_keeper_took_is_counted_from_when_it_was_struck() {
        let times = |us: f64| (Some(us), Some(us + 500_000.0));
        let (detected_us, recovered_us) = times(3_060_000.0);
        let fault = Fault { injected_ns: 5_000_000_000, tick: 5_000, detected_us, recovered_us, ..Fault::default() };
        let counted = |struck_ns| {
            let mut fault = fault.clone();
            count_from(&mut fault, struck_ns, 7);
            (fault.detected_us, fault.recovered_us, fault.injected_ns, fault.tick)
        };
        let ((detected_us, recovered_us), struck_ns) = (times(3_020_000.0), 5_040_000_000);
        assert_eq!(counted(struck_ns), (detected_us, recovered_us, struck_ns, 7));
    }
}
