//! The thread that meets the disk: it has one thing to write at a time, and whoever gives it that never waits. A disk that stands still for longer than the
//! device's ring lasts costs the recording nothing, because the ring is read on. Now and then it has the disk asked, on another thread, to keep what it took,
//! and says so if not; neither a block nor the end waits for that.

use crate::parts::parts;
use crate::syncer::{Answer, Syncer};
use hyst_exchange::system;
use hyst_messages::RecorderStatus;
use hyst_recording::{Block, Closed, TickRange, WriteError, Writer};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Between two looks whether the disk has answered, if nothing is given meanwhile, ns.
const LOOK_NS: u64 = 50_000_000;

/// What became of a block: nothing if it is on disk, else why not, and what is left of it.
pub type Written = Option<(WriteError, Block)>;

/// The file, as it was when the thread last said so.
#[derive(Clone, Copy, Debug, Default)]
pub struct FileState {
    /// Newest tick on disk.
    pub last_tick: Option<u64>,
    /// Ticks on disk.
    pub ticks: u64,
    /// Ticks that the file says are lost.
    pub lost: u64,
    /// Bytes on disk.
    pub bytes: u64,
    /// A predecessor began the file.
    pub is_continued: bool,
    /// It holds files of the scene, all of them or some.
    pub has_scene: bool,
}

impl FileState {
    fn of(writer: &Writer) -> FileState {
        FileState {
            last_tick: writer.last_tick(),
            ticks: writer.ticks(),
            lost: writer.lost(),
            bytes: writer.bytes(),
            is_continued: writer.is_continued(),
            has_scene: writer.scene_files() > 0,
        }
    }

    /// As it is published.
    pub fn status(&self) -> RecorderStatus {
        RecorderStatus { last_tick: self.last_tick.unwrap_or(0), ticks: self.ticks, lost: self.lost, bytes: self.bytes }
    }
}

/// Why a file has not the end that it should have.
#[derive(Debug, PartialEq)]
pub struct Unfinished {
    /// What the disk says.
    pub why: String,
    /// Ticks that it took and may not have.
    pub doubtful_ticks: u64,
}

impl Unfinished {
    fn of(error: &WriteError) -> Unfinished {
        Unfinished { why: error.to_string(), doubtful_ticks: error.doubtful_ticks() }
    }
}

/// The thread and the way to it.
pub struct Scribe {
    blocks: Option<Sender<Block>>,
    done: Receiver<(Written, FileState)>,
    synced: Receiver<Answer>,
    /// Of the summary first, then that the disk has answered for all that is there.
    finished: Receiver<Result<(), WriteError>>,
    /// The file.
    pub file: FileState,
    /// Ticks of what the thread has and has not said anything of.
    pub away_ticks: u64,
    /// Ticks of which it says that they are lost, which the file does not say yet.
    pub away_lost: u64,
    busy: bool,
}

impl Scribe {
    /// Starts the thread of a file. As often as `sync_ns` says it asks the disk to keep what was written since.
    pub fn start(writer: Writer, sync_ns: u64) -> std::io::Result<Scribe> {
        let (blocks, given) = channel::<Block>();
        let (tell, done) = channel();
        let (tell_sync, synced) = channel();
        let (tell_end, finished) = channel();
        let file = FileState::of(&writer);
        let mut syncer = Syncer::start(&writer)?;
        std::thread::Builder::new().name("scribe".into()).spawn(move || {
            if let Some(writer) = write_all(writer, &mut syncer, sync_ns, &given, &tell, &tell_sync) {
                end(writer, syncer, &tell_sync, &tell_end);
            }
        })?;
        Ok(Scribe { blocks: Some(blocks), done, synced, finished, file, away_ticks: 0, away_lost: 0, busy: false })
    }

    /// Whether it has something to write.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Gives it something to write; only if it is not busy.
    pub fn write(&mut self, block: Block) {
        let (ticks, lost) = (block.applied.len() as u64, block.lost.iter().map(TickRange::count).sum::<u64>());
        if !block.is_empty() && self.blocks.as_ref().is_some_and(|blocks| blocks.send(block).is_ok()) {
            (self.busy, self.away_ticks, self.away_lost) = (true, ticks, lost);
        }
    }

    /// What became of it, waiting until `end_ns` at most; `None` if it is still at it, or has nothing to do.
    pub fn written(&mut self, end_ns: u64) -> Option<Written> {
        let (written, file) = self.done.recv_timeout(patience(end_ns)).ok()?;
        (self.file, self.busy, self.away_ticks, self.away_lost) = (file, false, 0, 0);
        Some(written)
    }

    /// Whether the disk has kept what it took, if it was asked since the last time.
    pub fn synced(&self) -> Option<Answer> {
        self.synced.try_recv().ok()
    }

    /// Closes the file with its summary. A disk that took that by `end_ns` and keeps it later is not to blame: it has all of it, if the power holds.
    pub fn finish(&mut self, end_ns: u64) -> Result<(), Unfinished> {
        drop(self.blocks.take());
        let still = Unfinished { why: "the disk stands still".into(), doubtful_ticks: 0 };
        let summary = self.ended(end_ns).unwrap_or(Err(still));
        let last = self.ended(end_ns).unwrap_or(Ok(()));
        // What is not kept is worse. The system tells of a failure once: it may have been before the last time, and nobody has listened yet.
        let unkept = std::iter::from_fn(|| self.synced()).filter_map(Result::err).map(|error| Unfinished::of(&error));
        let both = |a: Unfinished, b: Unfinished| Unfinished { doubtful_ticks: a.doubtful_ticks + b.doubtful_ticks, ..b };
        summary.err().into_iter().chain(last.err()).chain(unkept).reduce(both).map_or(Ok(()), Err)
    }

    /// What became of the next step of the end, waiting until `end_ns` at most; `None` if the disk is still at it.
    fn ended(&self, end_ns: u64) -> Option<Result<(), Unfinished>> {
        match self.finished.recv_timeout(patience(end_ns)) {
            Ok(ended) => Some(ended.map_err(|error| Unfinished::of(&error))),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                Some(Err(Unfinished { why: "the thread that writes has died".into(), doubtful_ticks: 0 }))
            }
        }
    }
}

/// The time until then.
fn patience(end_ns: u64) -> Duration {
    Duration::from_nanos(end_ns.saturating_sub(system::now_ns()))
}

/// Writes what is given until nothing more comes, and then hands the file back; `None` if nobody listens any more.
fn write_all(
    mut writer: Writer,
    syncer: &mut Syncer,
    sync_ns: u64,
    given: &Receiver<Block>,
    tell: &Sender<(Written, FileState)>,
    tell_sync: &Sender<Answer>,
) -> Option<Writer> {
    let mut due_ns = system::now_ns() + sync_ns;
    loop {
        let until_ns = if syncer.is_busy() { system::now_ns() + LOOK_NS } else { due_ns };
        match given.recv_timeout(patience(until_ns)) {
            Ok(block) => {
                let written = append(&mut writer, block);
                tell.send((written, FileState::of(&writer))).ok()?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Some(writer),
        }
        if let Some(answer) = syncer.answered() {
            tell_sync.send(writer.heed(answer)).ok()?;
            let _ = writer.note(); // what is refused is tried again with the next block
            due_ns = system::now_ns() + sync_ns;
        }
        if !syncer.is_busy() && system::now_ns() >= due_ns {
            if writer.is_unsynced() {
                syncer.ask(writer.ask());
            }
            due_ns = system::now_ns() + sync_ns;
        }
    }
}

/// Writes the summary, says so, and has the disk keep all of it. What the disk answers is said before it is noted; when all is said, the file is unlocked.
fn end(writer: Writer, mut syncer: Syncer, tell_sync: &Sender<Answer>, tell_end: &Sender<Result<(), WriteError>>) {
    let heed = |closed: &mut Closed, answer: Option<Answer>| {
        if let Some(answer) = answer {
            let _ = tell_sync.send(closed.heed(answer));
        }
    };
    let (mut closed, summary) = writer.close();
    let _ = tell_end.send(summary); // here and below: nobody may wait for it any more
    heed(&mut closed, syncer.wait());
    syncer.ask(closed.ask());
    heed(&mut closed, syncer.wait());
    let _ = closed.note();
    drop(closed);
    syncer.end();
    let _ = tell_end.send(Ok(()));
}

/// Appends a block in parts; of what is refused everything is given back that is not on disk.
fn append(writer: &mut Writer, block: Block) -> Written {
    let mut parts = parts(block);
    while let Some(mut part) = parts.pop_front() {
        if let Err(error) = writer.append(&part) {
            for mut later in parts {
                later.precede(part);
                part = later;
            }
            return Some((error, part));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::AppliedRecord;
    use hyst_recording::{Recording, Session};
    use std::sync::atomic::{AtomicBool, Ordering};

    /// The disk is asked at the end alone.
    const NEVER_NS: u64 = 3_600_000_000_000;

    fn block(ticks: std::ops::Range<u64>) -> Block {
        Block { applied: ticks.map(|tick| AppliedRecord { tick, ..Default::default() }).collect(), ..Block::default() }
    }

    #[test]
    fn what_is_given_is_on_disk_when_the_thread_says_so_and_what_it_refuses_comes_back() {
        let path = std::env::temp_dir().join(format!("hyst-scribe-{}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        let later_ns = || system::now_ns() + 60_000_000_000;
        writer.set_limit(writer.bytes() + 300_000);
        let mut scribe = Scribe::start(writer, NEVER_NS).unwrap();
        scribe.write(Block::default());
        assert!(!scribe.is_busy(), "nothing is written of nothing");
        scribe.write(block(1..2_500));
        assert!(scribe.is_busy() && scribe.away_ticks == 2_499 && scribe.file.last_tick.is_none());
        assert_eq!(scribe.written(later_ns()).unwrap().map(|(error, _)| error.to_string()), None);
        assert_eq!((scribe.file.last_tick, scribe.file.ticks, scribe.away_ticks), (Some(2_499), 2_499, 0));
        scribe.write(block(2_500..100_000));
        let (error, rest) = scribe.written(later_ns()).unwrap().unwrap();
        assert!(matches!(error, WriteError::Full { .. }), "{error}");
        assert_eq!(scribe.file.last_tick.map(|last| last + 1), rest.applied.first().map(|record| record.tick));
        let last_tick = scribe.file.last_tick;
        let lost = vec![TickRange { first: 100_000, last: 100_006 }];
        scribe.write(Block { lost, ..Block::default() });
        assert_eq!((scribe.away_ticks, scribe.away_lost), (0, 7), "what is lost is known while nobody has written it");
        assert!(scribe.written(later_ns()).is_some() && scribe.away_lost == 0);
        drop(scribe); // as in a death: no summary
        // The thread lets go of the file once it has written its summary, or was refused that too.
        let read = (0..10_000).find_map(|_| Recording::read(&path).ok()).unwrap();
        assert_eq!(read.applied().last().map(|record| record.tick), last_tick);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_file_is_closed_with_its_summary() {
        let path = std::env::temp_dir().join(format!("hyst-scribe-end-{}.mcap", std::process::id()));
        let writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        let mut scribe = Scribe::start(writer, NEVER_NS).unwrap();
        scribe.write(block(1..10));
        assert_eq!(scribe.finish(system::now_ns() + 60_000_000_000), Ok(()), "what it was given is written first");
        let read = Recording::read(&path).unwrap();
        assert_eq!((read.applied().len(), read.ending), (9, hyst_recording::Ending::Complete));
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_disk_that_does_not_keep_what_it_took_is_told_while_it_is_written_and_at_the_end() {
        const EIO: i32 = 5;
        let path = std::env::temp_dir().join(format!("hyst-scribe-sync-{}.mcap", std::process::id()));
        let open = || Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        let started = |sync_ns| {
            let mut writer = open();
            writer.set_sync(|_| Err(std::io::Error::from_raw_os_error(EIO)));
            Scribe::start(writer, sync_ns).unwrap()
        };
        let later_ns = || system::now_ns() + 60_000_000_000;
        let mut scribe = started(1_000_000);
        scribe.write(block(1..10));
        assert!(scribe.written(later_ns()).is_some_and(|written| written.is_none()), "it took all of it");
        let mut told = std::iter::from_fn(|| scribe.synced.recv_timeout(Duration::from_secs(60)).ok());
        let doubtful = told.find_map(|synced| Some(synced.unwrap_err().doubtful_ticks()).filter(|ticks| *ticks > 0));
        assert_eq!(doubtful, Some(9), "the head of the file may have been asked for before");
        let unfinished = scribe.finish(later_ns()).unwrap_err();
        assert!(unfinished.why.contains("did not keep") && unfinished.doubtful_ticks == 0, "{unfinished:?}");
        assert_eq!(open().lost(), 9, "whoever goes on in it knows");
        std::fs::remove_file(&path).unwrap();
        let mut scribe = started(NEVER_NS);
        scribe.write(block(1..10));
        assert_eq!(scribe.finish(later_ns()).unwrap_err().doubtful_ticks, 9);
        assert_eq!(open().lost(), 9, "of what was not kept at the end, too");
        std::fs::remove_file(&path).unwrap();
    }

    /// The last block was not written at the stop, and its ticks were lost: the disk was still at what it had been asked to keep before.
    #[test]
    fn a_disk_that_keeps_slowly_what_it_took_holds_up_neither_a_block_nor_the_end() {
        static ASKED: AtomicBool = AtomicBool::new(false);
        static LET: AtomicBool = AtomicBool::new(false);
        fn slow(_: &std::fs::File) -> std::io::Result<()> {
            ASKED.store(true, Ordering::Release);
            while !LET.load(Ordering::Acquire) {
                system::sleep_ns(1_000_000);
            }
            Ok(())
        }
        let path = std::env::temp_dir().join(format!("hyst-scribe-slow-{}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        writer.set_sync(slow);
        let later_ns = system::now_ns() + 60_000_000_000;
        let mut scribe = Scribe::start(writer, 1_000_000).unwrap();
        scribe.write(block(1..10));
        assert!(scribe.written(later_ns).is_some_and(|written| written.is_none()));
        while !ASKED.load(Ordering::Acquire) && system::now_ns() < later_ns {
            system::sleep_ns(1_000_000);
        }
        scribe.write(block(10..20));
        assert!(scribe.written(later_ns).is_some_and(|written| written.is_none()), "it takes what comes meanwhile");
        // The disk takes the end, too, however long a busy machine needs for that; only then is it waited for to keep it.
        drop(scribe.blocks.take());
        let is_ended = || Recording::read(&path).is_ok_and(|read| read.ending == hyst_recording::Ending::Complete);
        while !is_ended() && system::now_ns() < later_ns {
            system::sleep_ns(1_000_000);
        }
        assert_eq!(scribe.finish(system::now_ns() + 2_000_000_000), Ok(()), "what it keeps later is not lost");
        assert!(ASKED.load(Ordering::Acquire) && scribe.synced().is_none(), "it is still at it");
        let read = Recording::read(&path).unwrap();
        assert_eq!((read.applied().len(), read.ending), (19, hyst_recording::Ending::Complete));
        LET.store(true, Ordering::Release);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_file_without_room_for_its_summary_is_told() {
        let path = std::env::temp_dir().join(format!("hyst-scribe-room-{}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        writer.set_limit(writer.bytes() + 10);
        let mut scribe = Scribe::start(writer, NEVER_NS).unwrap();
        let unfinished = scribe.finish(system::now_ns() + 60_000_000_000).unwrap_err();
        assert!(unfinished.why.contains("no room for"), "{unfinished:?}");
        std::fs::remove_file(&path).unwrap();
    }
}
