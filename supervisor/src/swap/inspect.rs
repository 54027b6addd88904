//! The judge of a recorder or a rendering on probation: a helper process that looks a few times a second at what the newcomer has brought forth: at what can be
//! read of its file, or at its pictures; what its page says of them has to be so. Who brings forth nothing new agrees with nothing, and is out of
//! tolerance when that lasts. A helper, because the file may lie on a disk that does not answer.

use super::beside::{self, Beside};
use super::judge::{Seen, tell};
use super::lives::Lives;
use super::pictures::{Gallery, Stream};
use super::stated::{MOST_BEHIND_TICKS, STILL_NS, STILL_RECORDER_NS};
use super::witness::Noted;
use super::written::Written;
use hyst_engine::Settings;
use hyst_exchange::{ReadPage, Station, StationPage, system};
use hyst_messages::page::{ProcessState, hardware, recorder, rendering, tissue};
use hyst_messages::{RecorderStatus, RenderingStatus, Role, Slot};
use hyst_recording::{Before, Block, Tail};
use std::path::{Path, PathBuf};

/// Between two looks, ns; and after one that speaks against the newcomer: what a stall makes of three of them at once is no verdict.
const LOOK_NS: u64 = 250_000_000;
const AMISS_NS: u64 = 1_000_000_000;
/// How far ahead of the present a tick on disk may be said to be: none, but for what passes between two words of a page.
const MOST_AHEAD_TICKS: u64 = 100;

/// What one look shows.
#[derive(Clone, Debug, PartialEq)]
enum Look {
    /// Something new, so far from what it should be, in parts of what is allowed.
    New(f64, String),
    /// Nothing new; what to say if that lasts.
    Still(String),
    /// Nothing right; the same.
    Wrong(String),
    /// There was nothing to be done.
    Idle,
}

/// What was seen of a newcomer so far, and when there was something new last.
#[derive(Debug, Default)]
struct Inspection {
    seen: Seen,
    new_ns: u64,
    still_ns: u64,
}

impl Inspection {
    fn of(role: Role, now_ns: u64) -> Inspection {
        let still_ns = if role == Role::Recorder { STILL_RECORDER_NS } else { STILL_NS };
        Inspection { new_ns: now_ns, still_ns, ..Inspection::default() }
    }

    /// Takes a look; true if it speaks against the newcomer.
    fn take(&mut self, look: Look, now_ns: u64) -> bool {
        let lasts = now_ns.saturating_sub(self.new_ns) > self.still_ns;
        match look {
            Look::New(ratio, text) => {
                self.new_ns = now_ns;
                self.seen.note((ratio, text));
                ratio > 1.0
            }
            Look::Still(text) if lasts => {
                self.seen.note_silence(text);
                true
            }
            Look::Wrong(text) if lasts => {
                self.seen.note((f64::INFINITY, text));
                true
            }
            Look::Still(_) | Look::Wrong(_) => false,
            Look::Idle => {
                self.new_ns = now_ns;
                false
            }
        }
    }
}

/// The helper itself: writes a line of JSON after each look until nobody reads it or the station stops. `draws`: the old rendering drew pictures, so the
/// new one can; where there is no driver both say that they have drawn none.
pub fn inspect(station: &Station, role: Role, guest: u32, draws: bool) -> Result<(), String> {
    let clock = station.open().map_err(|error| error.to_string())?;
    let text = std::fs::read_to_string(station.settings()).map_err(|error| error.to_string())?;
    let settings: Settings = toml::from_str(&text).map_err(|error| error.to_string())?;
    let own = station.read_slot(Slot::first(role), guest).map_err(|error| error.to_string())?;
    let file = settings.record.as_deref().filter(|_| role == Role::Recorder);
    let noted = if role == Role::Recorder { Noted::told(guest) } else { None };
    let (mut recording, mut pictures) = (Recording::of(file, noted, guest), Pictures { draws, ..Pictures::default() });
    let mut inspection = Inspection::of(role, system::now_ns());
    let mut stream = if role == Role::Rendering { Some(Stream::of(station, guest)?) } else { None };
    while !clock.stop_requested() {
        let look = if role == Role::Recorder {
            recording.inspect(station, &clock, &own)
        } else {
            let picture = stream.as_mut().and_then(Stream::newest);
            let shown = pictures.gallery.look(picture.as_ref().map(|held| held.bytes()), place_m(station, &clock));
            pictures.look(own.cell(rendering::STATUS).map(|(_, status)| status), newest_state(station, &clock), shown)
        };
        let is_amiss = inspection.take(look, system::now_ns());
        if !tell(&inspection.seen)? {
            return Ok(());
        }
        system::sleep_ns(if is_amiss && role != Role::Recorder { AMISS_NS } else { LOOK_NS });
    }
    Ok(())
}

fn pages(station: &Station, clock: &StationPage, role: Role) -> impl Iterator<Item = ReadPage> {
    clock.occupied(role).filter_map(|(slot, incarnation)| station.read_slot(slot, incarnation).ok())
}

/// Tick of the newest state that there is to be drawn; 0 if there is none.
fn newest_state(station: &Station, clock: &StationPage) -> u64 {
    let ticks = pages(station, clock, Role::Tissue).filter_map(|page| page.cell(tissue::STATUS));
    ticks.map(|(_, status)| status.state_tick).max().unwrap_or(0)
}

/// Where the scope is, m; the origin if there is no hardware.
fn place_m(station: &Station, clock: &StationPage) -> [f32; 3] {
    let samples = pages(station, clock, Role::Hardware).filter_map(|page| page.cell(hardware::SAMPLE));
    samples.map(|(_, sample)| sample.pose.position_m).next().unwrap_or_default()
}

/// What a recorder has brought forth so far.
#[derive(Default)]
struct Recording {
    /// Its file, and the end of that, if the station records.
    file: Option<PathBuf>,
    tail: Option<Tail>,
    /// What the file held before, if that is known; and that it does no longer.
    before: Option<Before>,
    is_spoilt: bool,
    /// It was live.
    has_lived: bool,
    lives: Lives,
    written: Written,
    beside: Beside,
    /// The newest tick that is known to be in its file: at first the one that its page says, since nobody reads what was there before.
    last_tick: Option<u64>,
}

impl Recording {
    fn of(file: Option<&Path>, noted: Option<Noted>, guest: u32) -> Recording {
        let (path, tail) = (file.map(Path::to_path_buf), file.map(Tail::of));
        let mut recording = Recording { file: path, tail, ..Recording::default() };
        if let (Some(file), Some(Noted { before, last_tick, wrote, .. })) = (file, noted) {
            recording.tail = Some(Tail::behind(file, &before));
            (recording.written, recording.beside) = (Written::behind(last_tick), Beside::behind(wrote, guest));
            recording.before = Some(before);
        }
        recording
    }

    /// A look at its page, at its file, and at what there is to be written. Before it is live it may not have the file yet, whose end may be torn.
    fn inspect(&mut self, station: &Station, clock: &StationPage, own: &ReadPage) -> Look {
        self.has_lived |= own.state() == ProcessState::Live;
        if !self.has_lived {
            return Look::Still("it is not live".into());
        }
        let status = own.cell(recorder::STATUS).map(|(_, status)| status);
        let size = self.file.as_ref().map(|path| std::fs::metadata(path).map_or(0, |file| file.len()));
        let came = self.read(station, clock.occupied(Role::Device)); // after its page: what that says is on disk by now
        let (made, present) = (beside::made(station, clock), clock.present_tick());
        let in_file = self.written.last_tick().unwrap_or(0);
        self.beside.take(&came, in_file, made, present, self.written.has_begun());
        let newest = self.lives.newest_tick();
        self.look(status, size, newest, clock.present_tick())
    }

    /// Reads what has come to its file. Of one that cannot be read nothing has come. Which lives of the device are present is asked after that: one that begins
    /// meanwhile may have made what was read. One that was over before the newcomer has written anything may have been so before it could read of it.
    fn read(&mut self, station: &Station, present: impl IntoIterator<Item = (Slot, u32)>) -> Block {
        let came = self.tail.as_mut().and_then(|tail| tail.look().ok()).unwrap_or_default();
        let has_begun = self.written.has_begun();
        let Recording { lives, written, .. } = self;
        lives.meet(station, present);
        let made = |tick: u64| if has_begun { lives.made(tick) } else { lives.made_last(tick) };
        written.take(&came.applied, lives.newest_tick(), made);
        if let (Some(file), Some(before)) = (&self.file, &self.before) {
            self.is_spoilt |= before.is_in(file).is_ok_and(|is_in| !is_in);
        }
        came
    }

    /// What is wrong with the file.
    fn flaw(&self) -> Option<String> {
        let spoilt = self.is_spoilt.then(|| "its file has not what was in it before it came".to_string());
        spoilt.or_else(|| self.written.flaw()).or_else(|| self.beside.flaw())
    }

    /// `size`: bytes of the file, if the station records; `newest`: the tick that the device has made last.
    fn look(&mut self, status: Option<RecorderStatus>, size: Option<u64>, newest: u64, present: u64) -> Look {
        let Some(status) = status else { return Look::Still("its page says nothing of a recording".into()) };
        let RecorderStatus { last_tick: said, bytes, .. } = status;
        let Some(size) = size else {
            return match status == RecorderStatus::default() {
                true => Look::New(0.0, "it records nothing, as it should".into()),
                false => Look::Wrong(format!("it says that it records, up to tick {said}, where nothing is to be recorded")),
            };
        };
        if let Some(flaw) = self.flaw() {
            return Look::New(f64::INFINITY, flaw);
        }
        let before = *self.last_tick.get_or_insert(said.min(newest));
        let in_file = self.written.last_tick().unwrap_or(0).max(before);
        match () {
            () if said > present + MOST_AHEAD_TICKS => {
                Look::Wrong(format!("it says that tick {said} is on disk, and tick {present} is the present"))
            }
            () if size < bytes => Look::Wrong(format!("its file has {size} bytes, and it says {bytes}")),
            () if in_file > before => {
                self.last_tick = Some(in_file);
                let behind = newest.saturating_sub(in_file);
                Look::New(behind as f64 / MOST_BEHIND_TICKS as f64, format!("{behind} ticks are not in its recording"))
            }
            () if newest <= in_file => Look::Idle, // the device makes none
            () if said > in_file => {
                Look::Wrong(format!("it says that tick {said} is on disk, and its file can be read up to tick {in_file}"))
            }
            () => Look::Still(format!("its recording stays at tick {in_file}")),
        }
    }
}

/// What a rendering has brought forth so far.
#[derive(Debug, Default)]
struct Pictures {
    draws: bool,
    gallery: Gallery,
    frames: u64,
    /// Tick of the newest state when pictures last showed a new one.
    state: u64,
    /// Tick of the state that they showed then.
    shown_tick: u64,
}

impl Pictures {
    /// `state`: the tick of the newest state that it can draw; `shown`: what speaks against its newest picture.
    fn look(&mut self, status: Option<RenderingStatus>, state: u64, shown: Result<(), &str>) -> Look {
        let Some(status) = status else { return Look::Still("its page says nothing of pictures".into()) };
        let RenderingStatus { frames, shown_tick, size_px: [width, height], frame_ms, .. } = status;
        match () {
            () if frames == 0 && !self.draws => Look::New(0.0, "it has drawn nothing, as the one before".into()),
            () if frames == 0 => Look::Still("it has drawn nothing".into()),
            () if frames <= self.frames => Look::Still(format!("it has drawn no picture after its {frames}.")),
            () if width == 0 || height == 0 || !frame_ms.is_finite() => {
                Look::Wrong(format!("its pictures are {width}x{height} and take {frame_ms} ms"))
            }
            // It may be some pictures behind, and a picture between two states shows the one before.
            () if shown_tick <= self.shown_tick && state > self.state => Look::Wrong("its pictures show no new state".into()),
            () => match shown {
                Err(why) => Look::Wrong(why.into()),
                Ok(()) => {
                    (self.frames, self.state, self.shown_tick) = (frames, state, shown_tick);
                    Look::New(0.0, format!("it has drawn {frames} pictures"))
                }
            },
        }
    }
}

#[cfg(test)]
mod file_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::AppliedRecord;
    use std::ops::RangeInclusive;

    const MS: u64 = 1_000_000;

    fn nothing(look: Look) -> String {
        match look {
            Look::Still(text) | Look::Wrong(text) => text,
            other => panic!("{other:?}"),
        }
    }

    fn is_still(look: Look) -> bool {
        matches!(look, Look::Still(_))
    }

    fn made(tick: u64) -> AppliedRecord {
        AppliedRecord { tick, ..AppliedRecord::default() }
    }

    #[test]
    fn a_recorder_is_good_while_the_ticks_in_its_file_go_on_as_its_page_says() {
        let mut recording = Recording::default();
        let status = |last_tick: u64, bytes: u64| Some(RecorderStatus { last_tick, ticks: last_tick, lost: 0, bytes });
        let append = |recording: &mut Recording, ticks: RangeInclusive<u64>| {
            recording.written.take(&ticks.map(made).collect::<Vec<_>>(), u64::MAX, |tick| Some(made(tick)));
        };
        assert_eq!(nothing(recording.look(None, Some(9), 100, 100)), "its page says nothing of a recording");
        assert_eq!(nothing(recording.look(status(4_900, 60), Some(60), 4_950, 4_951)), "its recording stays at tick 4900");
        append(&mut recording, 4_901..=5_000);
        let new = recording.look(status(5_000, 70), Some(70), 5_200, 5_201);
        assert!(matches!(&new, Look::New(ratio, _) if *ratio < 0.05), "{new:?}");
        assert_eq!(nothing(recording.look(status(5_000, 70), Some(70), 5_400, 5_401)), "its recording stays at tick 5000");
        assert_eq!(recording.look(status(5_000, 70), Some(70), 5_000, 9_000), Look::Idle, "the device makes no ticks");
        assert_eq!(recording.look(status(5_100, 70), Some(70), 5_000, 9_000), Look::Idle, "whatever it says");
        assert!(nothing(recording.look(status(5_400, 90), Some(70), 5_500, 5_501)).contains("70 bytes, and it says 90"));
        assert!(nothing(recording.look(status(u64::MAX, 70), Some(70), 5_500, 5_501)).contains("is the present"));
        append(&mut recording, 5_001..=5_600);
        let late = recording.look(status(5_600, 90), Some(90), 15_600, 15_601);
        assert!(matches!(&late, Look::New(ratio, text) if *ratio > 2.0 && text.starts_with("10000 ticks")), "{late:?}");
    }

    #[test]
    fn a_recorder_that_has_nothing_to_record_says_so() {
        let mut recording = Recording::default();
        assert_eq!(nothing(recording.look(None, None, 100, 100)), "its page says nothing of a recording");
        assert!(matches!(recording.look(Some(RecorderStatus::default()), None, 100, 100), Look::New(0.0, _)));
        let busy = RecorderStatus { last_tick: 90, ..RecorderStatus::default() };
        assert!(nothing(recording.look(Some(busy), None, 100, 100)).contains("nothing is to be recorded"));
    }

    #[test]
    fn a_rendering_is_good_while_its_pictures_go_on_and_show_what_is_new() {
        let mut pictures = Pictures { draws: true, ..Pictures::default() };
        let status = |frames: u64, shown_tick: u64| {
            Some(RenderingStatus { frames, shown_tick, size_px: [640, 480], ..RenderingStatus::default() })
        };
        assert_eq!(nothing(pictures.look(None, 10, Ok(()))), "its page says nothing of pictures");
        assert_eq!(nothing(pictures.look(Some(RenderingStatus::default()), 10, Ok(()))), "it has drawn nothing");
        assert_eq!(nothing(pictures.look(status(2, 0), 10, Ok(()))), "its pictures show no new state", "of an empty stage");
        assert!(matches!(pictures.look(status(3, 9), 10, Ok(())), Look::New(0.0, _)));
        assert!(nothing(pictures.look(status(3, 9), 260, Ok(()))).contains("no picture after its 3"));
        assert_eq!(nothing(pictures.look(status(9, 9), 260, Ok(()))), "its pictures show no new state");
        assert!(matches!(pictures.look(status(9, 9), 10, Ok(())), Look::New(0.0, _)), "there is no new state");
        let empty = Some(RenderingStatus { frames: 20, shown_tick: 290, ..RenderingStatus::default() });
        assert!(nothing(pictures.look(empty, 300, Ok(()))).contains("0x0"));
        assert!(matches!(pictures.look(status(20, 290), 300, Ok(())), Look::New(0.0, _)));
        assert_eq!(nothing(pictures.look(status(21, 300), 300, Err("it is black"))), "it is black");
        assert!(matches!(pictures.look(status(21, 300), 300, Ok(())), Look::New(0.0, _)), "it was not counted");
    }

    #[test]
    fn a_rendering_without_a_driver_may_follow_one_that_drew_nothing() {
        let mut pictures = Pictures::default();
        assert!(matches!(pictures.look(Some(RenderingStatus::default()), 10, Err("it sends none")), Look::New(0.0, _)));
        assert_eq!(nothing(pictures.look(None, 10, Ok(()))), "its page says nothing of pictures");
    }

    #[test]
    fn nothing_new_counts_for_nothing_at_first_and_against_it_when_that_lasts() {
        let mut inspection = Inspection::of(Role::Rendering, 0);
        let still = || Look::Still("still".into());
        assert!(!inspection.take(still(), STILL_NS));
        assert_eq!(inspection.seen, Seen::default(), "no agreement, and no doubt");
        assert!(!inspection.take(Look::New(0.5, "new".into()), STILL_NS + MS));
        assert_eq!((inspection.seen.compared, inspection.seen.outside), (1, 0));
        assert!(!inspection.take(still(), 2 * STILL_NS));
        assert!(!inspection.take(Look::Idle, 2 * STILL_NS + MS), "it had nothing to do");
        assert!(!inspection.take(still(), 3 * STILL_NS));
        assert_eq!(inspection.seen.compared, 1);
        for outside in 1..=3 {
            assert!(inspection.take(still(), 3 * STILL_NS + (1 + outside) * MS));
            assert_eq!((inspection.seen.compared, inspection.seen.outside), (1 + outside, outside));
        }
        assert_eq!(inspection.seen.text, "still");
        assert!(!inspection.take(Look::New(0.5, "new".into()), 4 * STILL_NS));
        assert_eq!(inspection.seen.outside, 0);
        assert!(inspection.take(Look::New(2.0, "far behind".into()), 4 * STILL_NS), "new, and out of tolerance");
    }

    /// A good recorder whose disk or core was away for two seconds was out of tolerance as a bad one is.
    #[test]
    fn one_that_stands_still_is_told_from_one_that_shows_what_is_wrong() {
        let status = |last_tick: u64, bytes: u64| Some(RecorderStatus { last_tick, ticks: last_tick, lost: 0, bytes });
        let mut recording = Recording { last_tick: Some(5_000), ..Recording::default() };
        let mut of_recording = |status, size| is_still(recording.look(status, Some(size), 5_400, 5_401));
        assert_eq!([of_recording(None, 70), of_recording(status(5_000, 70), 70)], [true; 2]);
        assert_eq!([of_recording(status(5_400, 90), 70), of_recording(status(u64::MAX, 70), 70)], [false; 2], "it says too much");
        let mut pictures = Pictures { draws: true, frames: 3, state: 10, shown_tick: 9, ..Pictures::default() };
        let drawn =
            |frames: u64| Some(RenderingStatus { frames, shown_tick: 9, size_px: [640, 480], ..RenderingStatus::default() });
        let mut of_pictures = |status, shown| is_still(pictures.look(status, 10, shown));
        assert_eq!([of_pictures(None, Ok(())), of_pictures(drawn(3), Ok(()))], [true; 2]);
        assert!(!of_pictures(drawn(4), Err("it is black")));

        let mut inspection = Inspection::of(Role::Recorder, 0);
        let mut after = |look: Look| {
            inspection.take(look, inspection.new_ns + STILL_RECORDER_NS + MS);
            (inspection.seen.outside, inspection.seen.silent)
        };
        let (still, wrong) = (|| Look::Still("still".into()), || Look::Wrong("wrong".into()));
        assert_eq!([after(still()), after(still())], [(1, true), (2, true)]);
        assert_eq!([after(wrong()), after(still())], [(3, false), (4, false)], "one that is wrong in between is enough");
        assert_eq!(after(Look::New(0.0, "new".into())), (0, false));
        assert_eq!(after(still()), (1, true));
    }
}
