//! What waits to be written, and the file. While the disk is full, fails or stands still, the recorder says so, keeps a minute in memory, tries again, and
//! counts what it has to drop.

use crate::scribe::{Scribe, Written};
use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, device, header, recorder as layout};
use hyst_messages::{RecorderStatus, Role};
use hyst_recording::sequence::RING_TICKS;
use hyst_recording::{Block, Session, TickRange, WriteError, Writer};
use std::path::Path;

/// Time between two blocks, ns: what a kill may leave to the successor, who finds it in the device's ring of 4 s.
const INTERVAL_NS: u64 = 200_000_000;
/// The same in a recording that is longer than so many ticks, an hour, whose summary names each block: a third of what one on probation may be silent for.
const LONG_INTERVAL_NS: u64 = 500_000_000;
const LONG_TICKS: u64 = 3_600_000;
/// Time between two tries on a full disk, ns.
const RETRY_NS: u64 = 1_000_000_000;
/// Between two looks whether the file is open, or was looked through, ns.
const LOOK_NS: u64 = 1_000_000;
/// Time after which the disk is asked to keep what it took, ns: what a power cut may cost. As often, a disk that fails behind the writes is found out.
const SYNC_NS: u64 = 5_000_000_000;
/// Pause while the file cannot be had, ns.
const WAIT_NS: u64 = 50_000_000;
/// How long a recorder waits for its predecessor to let go of the file, ns: longer than the supervisor takes to kill one that hangs.
const LOCK_PATIENCE_NS: u64 = 10_000_000_000;
/// How long the disk may take for what it was given until that is said, ns.
const STILL_NS: u64 = 2_000_000_000;
/// How long the disk may take at the end of a session, ns: a process that is told to stop has 2 s. And how often it may refuse.
const CLOSE_NS: u64 = 1_200_000_000;
const LAST_TRIES: usize = 2;
/// Ticks that wait in memory: a minute, 23 MB.
const MAX_TICKS: usize = 60_000;
/// Statuses and events that wait in memory, of each kind.
const MAX_OTHERS: usize = 10_000;
/// Checkpoints, and what was judged with them, and pictures, that wait in memory.
const MAX_CHECKPOINTS: usize = 4;
const MAX_PICTURES: usize = 50;

/// The file and its queue.
pub struct Keeper {
    scribe: Scribe,
    /// What waits.
    pub queue: Block,
    next_write_ns: u64,
    /// When the disk was given what it has not done with, ns.
    given_ns: u64,
    /// It was said that the recording does not go on.
    refused: bool,
    /// The first tick that was made while the disk let nobody open the file, if the device's ring no longer has it.
    missed_tick: Option<u64>,
    /// Ticks that the disk took and may not have kept.
    doubtful_ticks: u64,
    /// It kept nothing when it was last asked.
    is_doubtful: bool,
}

impl Keeper {
    /// Opens the file or goes on in it; waits while a predecessor holds it or the disk is full. `None` if the station stops meanwhile.
    pub fn open(life: &Life, path: &Path, session: &Session) -> Result<Option<Keeper>, Failure> {
        let patience_ns = system::now_ns() + LOCK_PATIENCE_NS;
        let (mut said, mut missed) = (false, Missed::default());
        while !life.clock.stop_requested() {
            let error = match open(life, path, session) {
                Ok(writer) => {
                    let scribe = Scribe::start(writer, SYNC_NS);
                    let scribe = scribe.map_err(|e| Failure::Broken(format!("a thread for the disk: {e}")))?;
                    if missed.is_told {
                        life.say("there is room again, and the recording begins");
                        life.page.last_words("");
                    }
                    return Ok(Some(Keeper::new(scribe, missed.first_gone(newest_tick(life)))));
                }
                Err(error) => error,
            };
            match &error {
                WriteError::Open { .. } | WriteError::Foreign { .. } => {
                    return Err(Failure::Input(error.to_string()));
                }
                WriteError::Encode(_) => return Err(Failure::Broken(error.to_string())),
                WriteError::Locked { .. } if system::now_ns() > patience_ns => {
                    return Err(Failure::Broken(error.to_string()));
                }
                WriteError::Locked { .. } => {}
                WriteError::Full { .. } | WriteError::Write { .. } | WriteError::Unsynced { .. } => {
                    missed.note(life, &error.to_string());
                }
            }
            if !std::mem::replace(&mut said, true) {
                life.say(&error.to_string());
            }
            life.page.set_state(ProcessState::Warm);
            life.heartbeat();
            system::sleep_ns(WAIT_NS);
        }
        missed.publish(life, 0); // nobody takes what the ring still has
        Ok(None)
    }

    fn new(scribe: Scribe, missed_tick: Option<u64>) -> Keeper {
        Keeper {
            scribe,
            queue: Block::default(),
            next_write_ns: 0,
            given_ns: 0,
            refused: false,
            missed_tick,
            doubtful_ticks: 0,
            is_doubtful: false,
        }
    }

    /// Newest tick on disk.
    pub fn last_tick(&self) -> Option<u64> {
        self.scribe.file.last_tick
    }

    /// The tick after which the recording goes on; `None` where it begins with the oldest that can be had. What was made while the file could not be opened is
    /// asked for, so that it is named as lost.
    pub fn goes_on_after(&self) -> Option<u64> {
        self.last_tick().or(self.missed_tick.map(|tick| tick.saturating_sub(1)))
    }

    /// Whether a predecessor began the file.
    pub fn is_continued(&self) -> bool {
        self.scribe.file.is_continued
    }

    /// Whether files of the scene are in the file, all of them or some.
    pub fn has_scene(&self) -> bool {
        self.scribe.file.has_scene
    }

    /// Gives what waits to the disk if it is time, and the disk has done with what it was given before; publishes how far the recording has come. Before it is
    /// given, `before` is done.
    pub fn keep(&mut self, life: &Life, before: impl FnOnce()) -> Result<(), Failure> {
        self.heed_syncs(life);
        while let Some(written) = self.scribe.written(0) {
            self.take(life, written)?;
        }
        let time_ns = system::now_ns();
        if self.scribe.is_busy() && time_ns > self.given_ns + STILL_NS {
            self.complain(life, "the disk takes nothing; what is to be recorded waits in memory, for a minute at most");
        } else if time_ns >= self.next_write_ns && !self.scribe.is_busy() {
            before();
            (self.given_ns, self.next_write_ns) = (time_ns, time_ns + interval_ns(self.scribe.file.ticks));
            self.scribe.write(std::mem::take(&mut self.queue));
        }
        drop_oldest(&mut self.queue);
        self.publish(life, 0);
        Ok(())
    }

    /// What the disk says of what it was given; what it refused waits again.
    fn take(&mut self, life: &Life, written: Written) -> Result<(), Failure> {
        let Some((error, rest)) = written else {
            life.page.store64(header::VALUE_NS, system::now_ns());
            if self.is_doubtful {
                return Ok(()); // what it did not keep it had taken, too
            }
            life.page.last_words(""); // whoever wrote there: it is read as a complaint
            if std::mem::replace(&mut self.refused, false) {
                life.say("the recording goes on");
            }
            return Ok(());
        };
        if matches!(error, WriteError::Encode(_)) {
            return Err(Failure::Broken(error.to_string()));
        }
        self.queue.precede(rest);
        self.next_write_ns = system::now_ns() + RETRY_NS;
        self.complain(life, &error.to_string());
        Ok(())
    }

    /// What the disk says when it is asked to keep what it took: of what it did not keep nobody knows what is there. The recording goes on once it keeps again.
    fn heed_syncs(&mut self, life: &Life) {
        while let Some(synced) = self.scribe.synced() {
            let was_doubtful = std::mem::replace(&mut self.is_doubtful, synced.is_err());
            let Err(error) = synced else { continue };
            self.doubtful_ticks += error.doubtful_ticks();
            self.refused &= was_doubtful; // whatever was said before, this is worse
            self.complain(life, &error.to_string());
        }
    }

    /// Says why the recording does not go on, once: in the log, and in the page for whoever keeps the station.
    fn complain(&mut self, life: &Life, why: &str) {
        if !std::mem::replace(&mut self.refused, true) {
            life.say(why);
            life.page.last_words(why);
        }
    }

    /// Gives the rest to the disk and closes the file; what the disk does not take in time, or does not keep, is lost, and said. Why a file has not the end
    /// that it should have stays in the page: at the end of a station it is read as a loss.
    pub fn close(mut self, life: &Life) -> Result<(), Failure> {
        let (end_ns, mut tries) = (system::now_ns() + CLOSE_NS, 0);
        loop {
            while self.scribe.is_busy()
                && let Some(written) = self.scribe.written(end_ns)
            {
                self.take(life, written)?;
            }
            if self.scribe.is_busy() || self.queue.is_empty() || tries == LAST_TRIES {
                break;
            }
            tries += 1;
            self.scribe.write(std::mem::take(&mut self.queue));
        }
        let left = self.scribe.away_ticks + self.queue.applied.len() as u64;
        if left > 0 {
            self.queue.applied.drain(..).for_each(|record| TickRange::extend(&mut self.queue.lost, record.tick));
            life.say(&format!("{left} ticks could not be written and are lost"));
        }
        self.heed_syncs(life);
        let given_up = self.scribe.away_ticks;
        self.publish(life, given_up);
        if let Err(unfinished) = self.scribe.finish(end_ns) {
            life.say(&format!("{}; the recording may have no end, but is readable", unfinished.why));
            life.page.last_words(&unfinished.why);
            self.doubtful_ticks += unfinished.doubtful_ticks;
            self.publish(life, given_up);
        }
        Ok(())
    }

    /// Publishes how far the recording has come; `given_up`: ticks of which the disk never said that it has them, and which nobody has any more.
    fn publish(&self, life: &Life, given_up: u64) {
        let noted = self.scribe.away_lost + self.queue.lost.iter().map(TickRange::count).sum::<u64>();
        // The file may name as many as there are numbers, if it was damaged.
        let lost = [noted, given_up, self.doubtful_ticks].into_iter().fold(self.scribe.file.lost, u64::saturating_add);
        life.page.write(layout::STATUS, &RecorderStatus { lost, ..self.scribe.file.status() });
    }
}

/// What the device makes while the disk lets nobody open the file.
#[derive(Debug, Default)]
struct Missed {
    is_told: bool,
    /// The first tick that was seen meanwhile.
    first_tick: Option<u64>,
}

impl Missed {
    /// Says once why nothing is recorded, in the log and in the page, and publishes what is lost so far.
    fn note(&mut self, life: &Life, why: &str) {
        if !std::mem::replace(&mut self.is_told, true) {
            life.page.last_words(why);
        }
        if self.first_tick.is_none() {
            self.first_tick = Some(newest_tick(life)).filter(|tick| *tick > 0);
        }
        self.publish(life, RING_TICKS);
    }

    /// Publishes what is lost, if the newest `kept` ticks are not.
    fn publish(&self, life: &Life, kept: u64) {
        let lost = self.gone(newest_tick(life), kept);
        if lost > 0 {
            life.page.write(layout::STATUS, &RecorderStatus { lost, ..RecorderStatus::default() });
        }
    }

    /// Ticks up to the newest one that nobody has any more.
    fn gone(&self, newest_tick: u64, kept: u64) -> u64 {
        self.first_tick.map_or(0, |first| (newest_tick + 1).saturating_sub(first + kept))
    }

    /// The first of them, if there are any.
    fn first_gone(&self, newest_tick: u64) -> Option<u64> {
        self.first_tick.filter(|_| self.gone(newest_tick, RING_TICKS) > 0)
    }
}

/// Time between two blocks of a recording of so many ticks, ns.
fn interval_ns(ticks: u64) -> u64 {
    if ticks > LONG_TICKS { LONG_INTERVAL_NS } else { INTERVAL_NS }
}

/// The newest tick that the device has for a recorder; 0 if there is none.
fn newest_tick(life: &Life) -> u64 {
    let devices = life.clock.occupied(Role::Device);
    let pages = devices.filter_map(|(slot, incarnation)| life.station.read_slot(slot, incarnation).ok());
    pages.map(|page| page.ring_end(device::APPLIED).saturating_sub(1)).max().unwrap_or(0)
}

/// Opens the file, or goes on in it: of a long one that takes a second.
fn open(life: &Life, path: &Path, session: &Session) -> Result<Writer, WriteError> {
    while_alive(life, || Writer::open(path, session))
}

/// Does what takes a second, with files that are long or a disk that is slow, while this process is seen to live.
pub fn while_alive<T: Send>(life: &Life, work: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| {
        let works = scope.spawn(work);
        while !works.is_finished() {
            life.heartbeat();
            system::sleep_ns(LOOK_NS);
        }
        works.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Drops the oldest of what does not fit into memory; the ticks are noted as lost.
fn drop_oldest(queue: &mut Block) {
    let over = queue.applied.len().saturating_sub(MAX_TICKS);
    for record in queue.applied.drain(..over) {
        TickRange::extend(&mut queue.lost, record.tick);
    }
    queue.origins.drain(..queue.origins.len().saturating_sub(2 * MAX_TICKS));
    queue.steps.drain(..queue.steps.len().saturating_sub(2 * MAX_TICKS));
    queue.tissue.drain(..queue.tissue.len().saturating_sub(MAX_OTHERS));
    queue.fluid.drain(..queue.fluid.len().saturating_sub(MAX_OTHERS));
    queue.events.drain(..queue.events.len().saturating_sub(MAX_OTHERS));
    queue.processes.drain(..queue.processes.len().saturating_sub(MAX_OTHERS));
    queue.checkpoints.drain(..queue.checkpoints.len().saturating_sub(MAX_CHECKPOINTS));
    queue.judged.drain(..queue.judged.len().saturating_sub(MAX_CHECKPOINTS));
    queue.pictures.drain(..queue.pictures.len().saturating_sub(MAX_PICTURES));
    queue.lost.drain(..queue.lost.len().saturating_sub(MAX_OTHERS));
    queue.unmade.drain(..queue.unmade.len().saturating_sub(MAX_OTHERS));
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use hyst_messages::{AppliedRecord, Slot};

    #[test]
    fn what_does_not_fit_into_memory_is_dropped_from_its_old_end_and_noted() {
        let ticks = 1..MAX_TICKS as u64 + 8;
        let mut queue =
            Block { applied: ticks.map(|tick| AppliedRecord { tick, ..Default::default() }).collect(), ..Block::default() };
        drop_oldest(&mut queue);
        assert_eq!((queue.applied.len(), queue.applied[0].tick), (MAX_TICKS, 8));
        assert_eq!(queue.lost, [TickRange { first: 1, last: 7 }]);
    }

    /// Each block is named in the summary, which is there as long as the recording goes on: a day of it grew as fast as its first hour.
    #[test]
    fn a_long_recording_has_fewer_blocks_each_of_which_fits_in_one_and_in_the_ring() {
        assert_eq!([0, LONG_TICKS, LONG_TICKS + 1, u64::MAX].map(interval_ns), [200, 200, 500, 500].map(|ms| ms * 1_000_000));
        let longest_ticks = (LONG_INTERVAL_NS + crate::session::LOOK_NS) / hyst_messages::TICK_NS;
        assert!(longest_ticks <= crate::parts::BLOCK_TICKS as u64 && 4 * longest_ticks <= RING_TICKS, "{longest_ticks}");
    }

    /// A long recording without its scene was walked through to its end without a sign of life, and its recorder was ended for it.
    #[test]
    fn a_recorder_that_looks_through_a_long_file_is_seen_to_live() {
        let station = Station::named(&format!("t{}-alive", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let _page = station.open_for_keeping().unwrap();
        std::fs::write(station.settings(), "").unwrap();
        let slot = Slot::first(Role::Recorder);
        station.create_slot(slot, 1).unwrap();
        let life = Life::begin(station.name(), slot, 1).unwrap();
        let beat = || station.read_slot(slot, 1).unwrap().load64(header::HEARTBEAT_NS);
        let begun_ns = beat();
        // Without a heartbeat it takes for ever, and is ended from outside.
        let last_ns = while_alive(&life, || (0..).map(|_: u64| beat()).find(|ns| *ns > begun_ns));
        assert!(last_ns > Some(begun_ns));
        station.wipe();
    }

    /// The session of a disk that was full from its start was recorded from where there was room, and nobody said that what came before was lost.
    #[test]
    fn what_the_ring_no_longer_has_when_the_file_can_be_opened_is_lost() {
        let missed = |first_tick| Missed { is_told: true, first_tick };
        assert_eq!((missed(None).gone(9_000, 0), missed(None).first_gone(9_000)), (0, None), "nothing was made");
        let some = missed(Some(51));
        assert_eq!((some.gone(50 + RING_TICKS, RING_TICKS), some.first_gone(50 + RING_TICKS)), (0, None));
        assert_eq!((some.gone(60 + RING_TICKS, RING_TICKS), some.first_gone(60 + RING_TICKS)), (10, Some(51)));
        assert_eq!(some.gone(1_050, 0), 1_000, "at the end the ring goes, too");
    }
}
