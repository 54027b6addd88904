//! How the recording of a station is, by the page of its recorder: what is on disk, what is lost, and whether it stands still. It is shown where the processes
//! are, and at the end of a station it decides over the exit code.

pub mod folder;

use hyst_engine::Settings;
use hyst_exchange::{ReadPage, Station};
use hyst_messages::page::{device, recorder as layout};
use hyst_messages::{Role, Slot};
use hyst_recording::Reader;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What a recording takes of a disk at most, bytes a second: some 0.25 MB of ticks, steps and statuses, and as much again of the states of tissue and of fluid each,
/// which come more seldom where they are large.
pub const MOST_BYTES_PER_S: f64 = 1e6;
/// A disk that lasts for less than this, s, is one that a class can be lost to.
pub const SHORT_S: f64 = 3_600.0;
/// So many ticks tell at what rate a recording grows: a minute, for it begins with its scene.
const RATE_TICKS: u64 = 60_000;

/// The recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecordingView {
    /// The file.
    pub file: String,
    /// Ticks on disk.
    pub ticks: u64,
    /// Ticks that nobody has any more, or that the disk may not have kept.
    pub lost: u64,
    /// Bytes on disk.
    pub bytes: u64,
    /// Ticks that the device has made since the newest on disk.
    pub behind_ticks: u64,
    /// Why nothing is written or kept; `None` while it goes on. At the end, why the file has not the end that it should have.
    pub stands_still: Option<String>,
    /// Bytes that its disk has left, as its recorder was told some seconds ago; `None` while nobody knows.
    pub free_bytes: Option<u64>,
    /// How long they last, s of the session: at the mean rate of the recording, in its first minute at 1 MB/s, the most that one takes. `None` while nobody knows.
    pub lasts_s: Option<f64>,
}

/// The file of a station's recording, if one was asked for.
pub fn file_of(station: &Station) -> Option<PathBuf> {
    let settings = std::fs::read_to_string(station.settings()).ok()?;
    toml::from_str::<Settings>(&settings).ok()?.record
}

/// Bytes that the disk of a station's recording has left, as its recorder was told last; nobody waits for the disk.
pub fn free_bytes(station: &Station) -> Option<u64> {
    std::fs::read_to_string(station.room()).ok()?.parse().ok()
}

/// The tick that a device has made last, by its page; 0 if it has made none.
pub fn newest_tick(device: Option<&ReadPage>) -> u64 {
    device.map_or(0, |page| page.ring_end(device::APPLIED).saturating_sub(1))
}

/// The recording of a station that has ended and is not removed yet; `None` if it never had a recorder, or had nothing to record.
pub fn at_end(station: &Station) -> Option<RecordingView> {
    let (file, clock) = (file_of(station)?, station.open().ok()?);
    let page_of = |role: Role| {
        let incarnation = clock.incarnation(Slot::first(role));
        (incarnation != 0).then(|| station.read_slot(Slot::first(role), incarnation).ok())
    };
    let recorder = page_of(Role::Recorder)?;
    let view = RecordingView::of(&file, recorder.as_ref(), newest_tick(page_of(Role::Device).flatten().as_ref()));
    Some(view.with_room(free_bytes(station)))
}

impl RecordingView {
    /// By the page of the recorder, if that can be read.
    pub fn of(file: &Path, recorder: Option<&ReadPage>, newest_tick: u64) -> RecordingView {
        let (_, status) = recorder.and_then(|page| page.cell(layout::STATUS)).unwrap_or_default();
        let words = recorder.map(ReadPage::last_words).unwrap_or_default();
        RecordingView {
            file: file.display().to_string(),
            ticks: status.ticks,
            lost: status.lost,
            bytes: status.bytes,
            behind_ticks: newest_tick.saturating_sub(status.last_tick),
            stands_still: (!words.is_empty()).then_some(words),
            ..RecordingView::default()
        }
    }

    /// The same on a disk that has so much left.
    pub fn with_room(self, free_bytes: Option<u64>) -> RecordingView {
        let is_known = self.ticks >= RATE_TICKS;
        let bytes_per_s = if is_known { self.bytes as f64 / (self.ticks as f64 * 1e-3) } else { MOST_BYTES_PER_S };
        let lasts_s = free_bytes.map(|bytes| bytes as f64 / bytes_per_s.max(1.0));
        RecordingView { free_bytes, lasts_s, ..self }
    }

    /// A line for the table; a second one where the disk is soon full.
    pub fn line(&self) -> String {
        let RecordingView { file, ticks, lost, bytes, behind_ticks, .. } = self;
        let short = self.lasts_s.filter(|lasts_s| *lasts_s < SHORT_S).map_or(String::new(), |lasts_s| {
            format!("THE DISK OF THE RECORDING HAS ROOM FOR {} MORE: make room, or record elsewhere\n", long(lasts_s))
        });
        let room = self.lasts_s.map_or(String::new(), |lasts_s| format!(", room for {} more", long(lasts_s)));
        let gone = if *lost > 0 { format!(", {lost} ticks are lost") } else { String::new() };
        match &self.stands_still {
            Some(why) => format!("THE RECORDING STANDS STILL, {behind_ticks} ticks behind{gone}: {why}\n"),
            None => format!("recording {file}: {ticks} ticks, {:.1} MB{room}{gone}\n{short}", *bytes as f64 * 1e-6),
        }
    }

    /// What of a session that is over is not in its recording, in words; `None` if nothing is missing.
    pub fn loss(&self) -> Option<String> {
        self.loss_if(|| holds_ticks(Path::new(&self.file)))
    }

    /// The last recorder may not have come to open what its predecessors wrote: then `holds_ticks` tells.
    fn loss_if(&self, holds_ticks: impl FnOnce() -> bool) -> Option<String> {
        let RecordingView { file, ticks, lost, behind_ticks, .. } = self;
        // What helps while it runs helps no more.
        let why = self.stands_still.as_deref().map(|why| why.strip_prefix(&format!("recording {file}: ")).unwrap_or(why));
        let why = why.and_then(|why| why.split(';').next()).map_or(String::new(), |why| format!(" ({why})"));
        // Who still complains when all is over could not close the file.
        let is_closed = *ticks == 0 || self.stands_still.is_none();
        if *lost == 0 && is_closed && (*ticks > 0 || *behind_ticks == 0) {
            return None;
        }
        match (*ticks > 0 || holds_ticks(), *lost) {
            (true, 0) if is_closed => None,
            (true, 0) => Some(format!("the recording {file} was not closed{why}; `hystation report` reads what is there")),
            (true, lost) => Some(format!(
                "the recording {file} is not whole{why}: {lost} ticks are lost; `hystation report` reads what is there"
            )),
            (false, _) => Some(format!("the recording {file} holds no tick{why}: the session is lost; look at `df`")),
        }
    }
}

/// A time in words, not longer than it is.
fn long(time_s: f64) -> String {
    match time_s {
        time_s if time_s < 60.0 => format!("{:.0} s", time_s.floor()),
        time_s if time_s < SHORT_S => format!("{:.0} min", (time_s / 60.0).floor()),
        time_s => format!("{:.1} h", (time_s / 360.0).floor() / 10.0),
    }
}

/// Whether there is a tick in a file; of a file that has some, its beginning is read.
fn holds_ticks(file: &Path) -> bool {
    let Ok(mut reader) = Reader::open(file) else { return false };
    while let Ok(Some(block)) = reader.next_block() {
        if !block.applied.is_empty() {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full(ticks: u64, lost: u64) -> RecordingView {
        let why = "recording /x/a.mcap: no room for 70 bytes more; make room, the recorder tries again";
        let stands_still = Some(why.to_string());
        let other = RecordingView::default();
        RecordingView { file: "/x/a.mcap".into(), ticks, lost, bytes: 1_500_000, behind_ticks: 900, stands_still, ..other }
    }

    #[test]
    fn a_disk_lasts_as_long_as_the_recordings_rate_says_and_in_its_first_minute_as_the_highest_says() {
        let on = |ticks, bytes, free_bytes| RecordingView { ticks, bytes, ..RecordingView::default() }.with_room(free_bytes);
        assert_eq!(on(59_999, 24_000_000, Some(3_000_000)).lasts_s, Some(3.0), "the scene is no rate");
        assert_eq!(on(120_000, 24_000_000, Some(3_000_000)).lasts_s, Some(15.0), "0.2 MB a second");
        assert_eq!((on(120_000, 0, Some(7)).lasts_s, on(120_000, 24_000_000, None).lasts_s), (Some(7.0), None));
        let times = [0.0, 59.9, 60.0, 3_599.0, 3_600.0, 39_600.0].map(long);
        assert_eq!(times, ["0 s", "59 s", "1 min", "59 min", "1.0 h", "11.0 h"]);
    }

    #[test]
    fn a_disk_that_is_full_within_the_hour_is_said_in_a_line_of_its_own() {
        let going = |free_bytes| RecordingView { stands_still: None, ..full(5_000, 0) }.with_room(Some(free_bytes)).line();
        assert_eq!(going(7_200_000_000), "recording /x/a.mcap: 5000 ticks, 1.5 MB, room for 2.0 h more\n");
        let short = going(90_000_000);
        let last = short.lines().last().unwrap();
        assert!(last.starts_with("THE DISK OF THE RECORDING HAS ROOM FOR 1 min MORE: make room"), "{short}");
        assert_eq!(short.lines().count(), 2, "{short}");
        assert_eq!(full(5_000, 0).with_room(Some(0)).line().lines().count(), 1, "one that stands still says why");
    }

    #[test]
    fn what_is_missing_at_the_end_is_said_with_its_cause_and_an_outage_that_cost_nothing_is_not() {
        let some = full(5_000, 800).loss_if(|| unreachable!("it is known")).unwrap();
        assert!(some.contains("not whole (no room for 70 bytes more): 800 ticks are lost") && !some.contains("tries"), "{some}");
        let none = full(0, 900).loss_if(|| false).unwrap();
        assert!(none.contains("/x/a.mcap holds no tick (no room for 70 bytes more)"), "{none}");
        assert!(full(0, 900).loss_if(|| true).unwrap().contains("900 ticks are lost"), "its predecessor's ticks are there");
        assert_eq!(RecordingView { stands_still: None, ..full(5_000, 0) }.loss_if(|| false), None);
        // Ended with 0: nobody knew that the end had found no room.
        let open = full(5_000, 0).loss_if(|| unreachable!("it is known")).unwrap();
        assert!(open.contains("was not closed (no room for 70 bytes more)"), "{open}");
        // Of a recorder that was not let come to open its file nothing is known.
        let silent = RecordingView { file: "/x/a.mcap".into(), behind_ticks: 900, ..RecordingView::default() };
        assert!(silent.loss_if(|| false).unwrap().contains("holds no tick: the session is lost"));
        assert_eq!(silent.loss_if(|| true), None);
        let unborn = RecordingView { behind_ticks: 0, ..silent };
        assert_eq!(unborn.loss_if(|| false), None, "there was nothing to record");
    }

    #[test]
    fn a_recording_that_stands_still_is_said_in_the_table_instead_of_how_far_it_has_come() {
        let line = full(5_000, 800).line();
        assert!(line.starts_with("THE RECORDING STANDS STILL, 900 ticks behind, 800 ticks are lost: "), "{line}");
        assert!(line.contains("make room"), "{line}");
        let line = RecordingView { stands_still: None, ..full(5_000, 0) }.line();
        assert_eq!(line, "recording /x/a.mcap: 5000 ticks, 1.5 MB\n");
    }
}
