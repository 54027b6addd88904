//! Promises of the writer towards the disk and others: a full disk loses nothing that was written; one writer at a time; nobody else's
//! file is touched; what a disk took and did not keep is said; a second of recording is small.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, session, ticks, write};
use hyst_recording::{Ending, ReadError, Recording, Session, WriteError, Writer, outline};
use std::fs::File;
use std::io;

#[test]
fn a_full_disk_is_said_keeps_what_was_written_and_the_same_block_goes_in_later() {
    let folder = Folder::new("full");
    let mut writer = write(&folder.file(), &[block(1..50)]);
    writer.set_limit(writer.bytes() + 100);
    for _ in 0..2 {
        assert!(matches!(writer.append(&block(50..90)), Err(WriteError::Full { .. })));
    }
    assert_eq!(writer.last_tick(), Some(49));
    assert_eq!(ticks(&Recording::read(&folder.file()).unwrap()), (1..50).collect::<Vec<_>>());
    writer.set_limit(u64::MAX);
    writer.append(&block(50..90)).unwrap();
    writer.finish().unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    assert_eq!((ticks(&recording), recording.ending), ((1..90).collect::<Vec<_>>(), Ending::Complete));
}

/// Error numbers of Linux.
const EIO: i32 = 5;
const EINVAL: i32 = 22;
const ENOSYS: i32 = 38;
const EOPNOTSUPP: i32 = 95;

/// A disk that refuses to keep anything, for this reason.
fn refuses<const ERRNO: i32>(_: &File) -> io::Result<()> {
    Err(io::Error::from_raw_os_error(ERRNO))
}

/// Nobody asked the disk: a stick that was gone since, and a server that was full, ended a session with "nothing is lost".
#[test]
fn what_the_disk_took_and_did_not_keep_is_counted_once_and_a_file_system_that_cannot_be_asked_is_not_to_blame() {
    let folder = Folder::new("sync");
    let mut writer = write(&folder.file(), &[block(1..50)]);
    assert!(writer.is_unsynced());
    writer.set_sync(refuses::<EIO>);
    let error = writer.sync().unwrap_err();
    assert!(matches!(error, WriteError::Unsynced { .. }) && error.doubtful_ticks() == 49, "{error}");
    assert!(error.to_string().contains("did not keep what it had taken: ") && !writer.is_unsynced(), "{error}");
    writer.append(&block(50..60)).unwrap();
    assert!(writer.is_unsynced(), "the next time it is of what is new");
    assert_eq!(writer.sync().unwrap_err().doubtful_ticks(), 10);
    let unable: [fn(&File) -> io::Result<()>; 3] = [refuses::<EINVAL>, refuses::<ENOSYS>, refuses::<EOPNOTSUPP>];
    for sync in unable {
        writer.set_sync(sync);
        assert!(writer.sync().is_ok());
    }
    writer.append(&block(60..70)).unwrap();
    writer.set_sync(refuses::<EIO>);
    assert_eq!(writer.finish().unwrap_err().doubtful_ticks(), 10, "at the end, too");
    assert_eq!(Recording::read(&folder.file()).unwrap().ending, Ending::Complete, "as far as the system knows");
}

/// Whoever went on in the file of a recorder that had told of it ended with 0 and nothing lost.
#[test]
fn what_the_disk_did_not_keep_is_known_to_a_successor_and_whoever_reads_finds_what_is_there() {
    let folder = Folder::new("doubt");
    let mut writer = write(&folder.file(), &[block(1..50)]);
    writer.set_sync(refuses::<EIO>);
    assert_eq!(writer.sync().unwrap_err().doubtful_ticks(), 49);
    writer.append(&block(50..60)).unwrap();
    assert_eq!(writer.lost(), 0, "it was told with the answer");
    drop(writer); // as in a death
    let mut next = write(&folder.file(), &[]);
    assert_eq!((next.lost(), next.ticks(), next.is_unsynced()), (49, 59, true));
    next.set_sync(refuses::<EIO>);
    assert_eq!(next.sync().unwrap_err().doubtful_ticks(), 10, "the predecessor had not asked for them");
    next.append(&block(60..70)).unwrap();
    assert_eq!(next.finish().unwrap_err().doubtful_ticks(), 10);
    let read = Recording::read(&folder.file()).unwrap();
    assert_eq!((ticks(&read), read.ending), ((1..70).collect::<Vec<_>>(), Ending::Complete));
    assert!(read.damage.is_empty() && read.content.lost.is_empty(), "{:?}", read.damage);
    assert_eq!(outline(&folder.file()).unwrap().map(|outline| outline.last_tick), Some(69));
    assert_eq!(write(&folder.file(), &[]).lost(), 69, "what was not kept at the end, too");
}

#[test]
fn of_a_long_file_a_successor_answers_for_the_newest_five_seconds() {
    let folder = Folder::new("newest");
    drop(write(&folder.file(), &[block(1..3_001), block(3_001..6_001)]));
    let mut next = write(&folder.file(), &[]);
    next.set_sync(refuses::<EIO>);
    let error = next.sync().unwrap_err();
    assert!(matches!(&error, WriteError::Unsynced { ranges, .. } if ranges[0].first == 1_001), "{error:?}");
    assert_eq!(error.doubtful_ticks(), 5_000);
}

#[test]
fn a_summary_without_room_is_refused_and_the_rest_is_there() {
    let folder = Folder::new("end");
    let mut writer = write(&folder.file(), &[block(1..50)]);
    writer.set_limit(writer.bytes() + 10);
    assert!(matches!(writer.close(), (_, Err(WriteError::Full { .. }))));
    assert_eq!(ticks(&Recording::read(&folder.file()).unwrap()), (1..50).collect::<Vec<_>>());
}

#[test]
fn one_writer_at_a_time_and_never_over_somebody_elses_file() {
    let folder = Folder::new("foreign");
    let first = write(&folder.file(), &[block(1..4)]);
    assert!(matches!(Writer::open(&folder.file(), &session()), Err(WriteError::Locked { .. })));
    drop(first);
    let other = Session::from([("session".into(), "test-2".into())]);
    assert!(matches!(Writer::open(&folder.file(), &other), Err(WriteError::Foreign { .. })));
    assert_eq!(Writer::open(&folder.file(), &session()).unwrap().last_tick(), Some(3));
    let notes = folder.0.join("notes.txt");
    std::fs::write(&notes, "what the surgeon said").unwrap();
    assert!(matches!(Writer::open(&notes, &session()), Err(WriteError::Foreign { .. })));
    assert_eq!(std::fs::read(&notes).unwrap(), b"what the surgeon said");
    assert!(matches!(Writer::open(&folder.0, &session()), Err(WriteError::Open { .. })));
    assert!(matches!(Writer::open(&folder.0.join("no/such.mcap"), &session()), Err(WriteError::Open { .. })));
    assert!(matches!(Recording::read(&notes), Err(ReadError::Foreign { .. })));
    assert!(matches!(Recording::read(&folder.0.join("absent")), Err(ReadError::File { .. })));
}

#[test]
fn a_second_of_recording_takes_less_than_a_megabyte() {
    let folder = Folder::new("size");
    let writer = write(&folder.file(), &[block(1..201), block(201..401), block(401..601), block(601..801), block(801..1001)]);
    assert!(writer.bytes() < 1_000_000, "{}", writer.bytes());
}
