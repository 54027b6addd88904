//! `hystation swap`: another engine in the place of a role's, while the station runs. The file is verified here, by an ordinary process, before the
//! station hears of it; then the supervisor does it, and this command says what happened.
//!
//! Exit codes: 0 the newcomer has the role, 1 it was rolled back, or how it ended is not known, 2 it was refused and nothing was disturbed, 3 this command was
//! interrupted, and a swap that it has begun goes on.

use super::{INTERRUPTED, no_station};
use crate::control::{NoAnswer, Request, ask_once};
use crate::interrupt;
use crate::policy::Cause;
use crate::remains;
use crate::settings::Refusal;
use crate::swap::{Record, kept, role_of};
use hyst_exchange::{Station, system};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two looks at the record.
const LOOK_NS: u64 = 20_000_000;
/// A swap takes seconds; pictures in software may take minutes to start, twice.
const PATIENCE_NS: u64 = 600_000_000_000;
/// How long a swap is looked for that nobody has said was begun: a supervisor that was restarted finishes or undoes it by then.
const BEGUN_WITHIN_NS: u64 = 10_000_000_000;

/// Swaps, and prints what happened.
pub fn swap(station: &Station, role: &str, binary: &Path, json: bool) -> Result<u8, Refusal> {
    let interrupted = interrupt::noticed().map_err(Refusal::failed)?;
    let number = begin_unless(station, role, binary, &interrupted)?;
    let record = wait(station, number, &interrupted)?;
    if json {
        let text = serde_json::to_string_pretty(&record).map_err(|e| Refusal::failed(e.to_string()))?;
        println!("{text}");
    } else {
        print!("{}", table(&record));
        has_printed(station, &record).iter().for_each(|hint| eprintln!("hystation: {hint}"));
    }
    Ok(u8::from(record.promoted != Some(true)))
}

/// Why no swap was begun.
#[derive(Debug)]
pub(super) enum NotBegun {
    /// Nobody was asked for it: the file is no such engine, there is no station, or this command was interrupted.
    Unasked(Refusal),
    /// The station refused it, or nobody has said that it was begun. That speaks of the station, and not of the file.
    Refused(Refusal),
}

impl From<Refusal> for NotBegun {
    fn from(refusal: Refusal) -> NotBegun {
        NotBegun::Unasked(refusal)
    }
}

impl From<NotBegun> for Refusal {
    fn from(not_begun: NotBegun) -> Refusal {
        match not_begun {
            NotBegun::Unasked(refusal) | NotBegun::Refused(refusal) => refusal,
        }
    }
}

/// Asks for a swap to the station's own copy of an engine; gives its number.
pub fn begin(station: &Station, role: &str, binary: &Path) -> Result<u64, Refusal> {
    begin_unless(station, role, binary, &AtomicBool::new(false)).map_err(Refusal::from)
}

/// The same, unless it is interrupted before it is asked for: then nobody is left who was asked what he is.
pub(super) fn begin_unless(station: &Station, role: &str, binary: &Path, interrupted: &AtomicBool) -> Result<u64, NotBegun> {
    let known = role_of(role).map_err(Refusal::input)?;
    // Not resolved: a program may go by the name that it is called by.
    let binary = std::path::absolute(binary).map_err(|e| Refusal::input(format!("{}: {e}", binary.display())))?;
    if !station.root().is_dir() {
        return Err(no_station(station).into());
    }
    // To the end of this, when the supervisor has written down what it is for.
    let kept = kept::keep(station, &binary, known, &|| interrupted.load(Ordering::Relaxed));
    if interrupted.load(Ordering::Relaxed) {
        let message = format!("interrupted: no swap of {role} was begun, and nothing was disturbed");
        return Err(Refusal { code: INTERRUPTED, message }.into());
    }
    let kept = kept.map_err(Refusal::input)?;
    let request = Request::Swap { role: role.to_string(), binary: kept.binary().to_path_buf() };
    let before = Record::read(station).map_or(0, |record| record.number);
    match ask_once(station, &request) {
        Ok(answer) => Ok(answer["number"].as_u64().unwrap_or(0)),
        Err(NoAnswer::Refused(reason)) => Err(NotBegun::Refused(Refusal::input(format!("swap of {role}: {reason}")))),
        Err(NoAnswer::Unanswered(reason) | NoAnswer::Half(reason)) => {
            let cure = "no swap was begun within 10 s; `hystation status` says what runs, then swap again";
            let unknown = || NotBegun::Refused(Refusal::failed(format!("swap of {role}: {reason}; {cure}")));
            begun_meanwhile(station, before, kept.binary()).ok_or_else(unknown)
        }
    }
}

/// Waits for the end of a swap, or until nobody wants to know it any more: the swap goes on.
pub(super) fn wait(station: &Station, number: u64, interrupted: &AtomicBool) -> Result<Record, Refusal> {
    let deadline_ns = system::now_ns() + PATIENCE_NS;
    loop {
        match Record::read(station) {
            // There is one record: somebody was quicker than the next look.
            Some(next) if next.number != number => {
                let since = format!("swap {} of {} was begun since", next.number, next.role);
                return Err(Refusal::failed(format!("{since}; `hystation logs` says how swap {number} ended")));
            }
            Some(record) if record.promoted.is_some() => return Ok(record),
            None => {
                return Err(Refusal::failed("the station has ended, how the swap ended is not known; start it and swap again"));
            }
            Some(record) if interrupted.load(Ordering::Relaxed) => {
                let role = record.role;
                let message = format!(
                    "interrupted: swap {number} of {role} goes on without this command; `hystation logs` says how it ends, `hystation \
                     status` who runs what"
                );
                return Err(Refusal { code: INTERRUPTED, message });
            }
            Some(_) if system::now_ns() >= deadline_ns => {
                return Err(Refusal::failed("the swap does not end; `hystation logs` says how far it is"));
            }
            Some(_) if remains::living(station).is_empty() => {
                return Err(Refusal::failed("the station died during the swap; start it and swap again"));
            }
            Some(_) => system::sleep_ns(LOOK_NS),
        }
    }
}

/// The number of a swap to this binary that was begun after another one, if there is one soon.
fn begun_meanwhile(station: &Station, before: u64, binary: &Path) -> Option<u64> {
    let deadline_ns = system::now_ns() + BEGUN_WITHIN_NS;
    while system::now_ns() < deadline_ns && !remains::living(station).is_empty() {
        if let Some(record) = Record::read(station).filter(|record| record.number > before && record.binary == binary) {
            return Some(record.number);
        }
        system::sleep_ns(LOOK_NS);
    }
    None
}

/// Where the words of a newcomer are that was rolled back for its own sake: its author asks for them next.
fn has_printed(station: &Station, record: &Record) -> Option<String> {
    let is_its_own = record.cause.is_some_and(Cause::speaks_of_newcomer);
    let hint = || format!("what it printed is in `hystation --name {} logs {}`", station.name(), record.slot);
    (record.promoted == Some(false) && is_its_own).then(hint)
}

/// What happened, as lines of plain text.
pub fn table(record: &Record) -> String {
    let [binary, before] = [&record.binary, &record.before].map(|path| kept::name_of(path));
    let mut text = format!("swap {} of {}: {} for {}\n", record.number, record.role, binary.display(), before.display());
    for step in &record.steps {
        text.push_str(&format!("{:>9.1} ms  {}\n", step.at_ms, step.what));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::book;
    use crate::swap::tests::record;

    /// Ctrl-C while a file was asked what it is left its process.
    #[test]
    fn a_command_that_is_interrupted_before_its_swap_has_begun_begins_none() {
        let (station, _faults) = book("none-begun");
        let refused = |interrupted| {
            let begun = begin_unless(&station, "fluid", Path::new("/bin/cat"), &AtomicBool::new(interrupted));
            begun.map_err(|not_begun| match not_begun {
                NotBegun::Unasked(refusal) => refusal.code,
                NotBegun::Refused(refusal) => panic!("{refusal:?}"),
            })
        };
        assert_eq!([refused(true), refused(false)], [Err(INTERRUPTED), Err(2)]);
        assert!(!station.swap().exists());
    }

    /// Ctrl-C said nothing, and looked as if the swap had ended with the command.
    #[test]
    fn whoever_interrupts_the_command_is_told_that_the_swap_goes_on() {
        let station = Station::named(&format!("t{}-goes-on", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let going = Record { number: 3, ..record() };
        assert!(going.write(&station));
        let interrupted = AtomicBool::new(true);
        let refusal = wait(&station, 3, &interrupted).unwrap_err();
        assert!(refusal.code == 3 && refusal.message.contains("swap 3 of fluid goes on"), "{refusal:?}");
        let over = Record { promoted: Some(true), ..going };
        assert!(over.write(&station));
        assert_eq!(wait(&station, 3, &interrupted), Ok(over), "it has ended, and one is told how");
        station.wipe();
    }

    /// It was said that the station had ended.
    #[test]
    fn whoever_waits_for_a_swap_that_another_one_has_followed_is_told_so() {
        let station = Station::named(&format!("t{}-next-swap", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let waits = || wait(&station, 3, &AtomicBool::new(false)).unwrap_err();
        assert!(waits().message.contains("the station has ended"), "nobody has written anything");
        assert!(Record { number: 4, ..record() }.write(&station));
        let refusal = waits();
        assert!(refusal.code == 1 && refusal.message.contains("swap 4 of fluid was begun since"), "{refusal:?}");
        station.wipe();
    }

    #[test]
    fn whoever_wrote_an_engine_that_is_rolled_back_is_told_where_its_words_are() {
        let station = Station::named("words").unwrap();
        let ended = |promoted: bool, cause: Option<Cause>| Record { promoted: Some(promoted), cause, ..record() };
        let hint = has_printed(&station, &ended(false, Some(Cause::Died))).unwrap();
        assert!(hint.contains("`hystation --name words logs fluid:2`"), "{hint}");
        for record in [ended(true, None), ended(false, Some(Cause::NoTime)), ended(false, Some(Cause::Interrupted)), record()] {
            assert_eq!(has_printed(&station, &record), None, "{record:?}");
        }
    }
}
