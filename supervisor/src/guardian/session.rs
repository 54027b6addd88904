//! What whoever trained is told at the end: where the report of their session is, or how they come by it. A session of which the folder of its recording was
//! named has its page made beside that, however it ended, before a service begins the next one.

use super::order::Order;
use crate::notify::Notifier;
use crate::proc::own_program;
use hyst_engine::Settings;
use hyst_exchange::{Station, system};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};

/// How long a page may take, ns: ten times and more of what an hour's takes on two cores (docs/speed.md).
pub const PAGE_NS: u64 = 120_000_000_000;
/// Between two looks whether it is there, ns.
const LOOK_NS: u64 = 20_000_000;

/// A case's session that was recorded.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Session {
    recording: PathBuf,
    /// Its page is to be made.
    has_page: bool,
}

impl Session {
    /// That of a station whose processes have ended and which is not removed yet. A replay's is the recorded one's.
    pub(super) fn of(station: &Station, order: &Order) -> Option<Session> {
        let settings: Settings = toml::from_str(&std::fs::read_to_string(station.settings()).ok()?).ok()?;
        let is_played = settings.replay.is_none() && station.brief().exists();
        let recording = settings.record.filter(|_| is_played)?;
        let is_begun = std::fs::metadata(&recording).is_ok_and(|file| file.len() > 0);
        is_begun.then_some(Session { recording, has_page: order.in_folder })
    }

    /// Makes the page, if it is to be made, and gives what is said of it.
    pub(super) fn tell(&self, notifier: &mut Notifier) -> String {
        let (file, page) = (self.recording.display(), self.recording.with_extension("html"));
        if !self.has_page {
            return format!("for the report of the session: hystation report {file} --html {}", page.display());
        }
        match make(&self.recording, &page, notifier) {
            Ok(()) => format!("the report of the session is {}", page.display()),
            Err(why) => {
                format!("the report of the session was not made: {why}; try hystation report {file} --html {}", page.display())
            }
        }
    }
}

/// Which file lies there now: another one does once a page was put in its place.
fn version(page: &Path) -> Option<(u64, i64, i64)> {
    let file = std::fs::metadata(page).ok()?;
    Some((file.ino(), file.mtime(), file.mtime_nsec()))
}

/// Whether there is a page that was not there before. A report of a recording that is not whole is one, too, and its exit code is that of a page that the
/// disk did not take.
fn made(status: ExitStatus, page: &Path, before: Option<(u64, i64, i64)>) -> Result<(), String> {
    let now = version(page);
    match status.code() {
        Some(0 | 3) if now.is_some() && now != before => Ok(()),
        Some(0 | 3) => Err("the disk did not take it".to_owned()),
        _ => Err(status.to_string()),
    }
}

/// By a process of its own, which may fail without anything else.
fn make(recording: &Path, page: &Path, notifier: &mut Notifier) -> Result<(), String> {
    let before = version(page);
    let mut command = own_program();
    command.arg("report").arg(recording).arg("--html").arg(page);
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let mut child = child.map_err(|error| error.to_string())?;
    notifier.say(&format!("EXTEND_TIMEOUT_USEC={}\n", PAGE_NS / 1_000));
    let deadline_ns = system::now_ns() + PAGE_NS;
    while system::now_ns() < deadline_ns {
        if let Ok(Some(status)) = child.try_wait() {
            return made(status, page, before);
        }
        notifier.watchdog(|| true);
        system::sleep_ns(LOOK_NS);
    }
    let _ = child.kill(); // gone is as good
    let _ = child.wait();
    Err(format!("it took more than {} s", PAGE_NS / 1_000_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_engine::settings::Replay;
    use std::os::unix::process::ExitStatusExt;

    /// The end of a session told where its report is, and the disk, full by the recording, had taken none.
    #[test]
    fn a_page_that_the_disk_did_not_take_is_not_called_the_report() {
        let page = std::env::temp_dir().join(format!("hystation-made-{}.html", std::process::id()));
        let status = |code: i32| ExitStatus::from_raw(code << 8); // as wait(2) has it
        let _ = std::fs::remove_file(&page);
        assert!(made(status(3), &page, None).unwrap_err().contains("the disk did not take it"));
        std::fs::write(&page, "of this session, as far as its recording goes").unwrap();
        assert_eq!([0, 3].map(|code| made(status(code), &page, None)), [Ok(()), Ok(())]);
        assert!(made(status(2), &page, None).unwrap_err().contains("exit status: 2"));
        let before = version(&page);
        assert!(made(status(3), &page, before).is_err(), "that is the one before");
        let next = page.with_extension("next");
        std::fs::write(&next, "of this session").unwrap();
        std::fs::rename(&next, &page).unwrap();
        assert_eq!(made(status(3), &page, before), Ok(()));
        std::fs::remove_file(&page).unwrap();
    }

    #[test]
    fn of_a_recorded_case_it_is_said_how_it_went_and_of_nothing_else() {
        let station = Station::named(&format!("t{}-session", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let file = std::env::temp_dir().join(format!("hystation-session-{}.mcap", std::process::id()));
        let settings = Settings { record: Some(file.clone()), ..Settings::default() };
        let lay = |settings: &Settings| std::fs::write(station.settings(), toml::to_string(settings).unwrap()).unwrap();
        let [named, in_folder] = [false, true].map(|in_folder| Order { in_folder, ..Order::default() });
        lay(&settings);
        std::fs::write(&file, "ticks").unwrap();
        assert_eq!(Session::of(&station, &in_folder), None, "it had no case");
        std::fs::write(station.brief(), "{}").unwrap();
        let session = |has_page| Some(Session { recording: file.clone(), has_page });
        assert_eq!([&named, &in_folder].map(|order| Session::of(&station, order)), [session(false), session(true)]);
        let told = session(false).unwrap().tell(&mut Notifier::of_environment());
        assert!(
            told.contains("hystation report ") && told.contains(&file.with_extension("html").display().to_string()),
            "{told}"
        );
        lay(&Settings { replay: Some(Replay { begin_tick: 0, from_tick: 0, speed: 1.0 }), ..settings.clone() });
        assert_eq!(Session::of(&station, &in_folder), None, "a replay's is the recorded one's");
        lay(&settings);
        std::fs::write(&file, "").unwrap();
        assert_eq!(Session::of(&station, &in_folder), None, "nothing was recorded");
        std::fs::remove_file(&file).unwrap();
        station.wipe();
    }
}
