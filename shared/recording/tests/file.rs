//! Promises of the file: what is written is read, bit for bit; a cut at any byte and a flipped bit anywhere cost at most the block
//! that they hit; a successor goes on in the same file; a full disk loses nothing that was written.

use hyst_messages::{AppliedRecord, Controls, FluidStatus, ForceCommand, HardwareSample, Pose, TissueStatus};
use hyst_recording::{Block, Ending, Event, Level, ReadError, Reader, Recording, Session, TickRange, WriteError, Writer};
use std::io::Cursor;
use std::path::{Path, PathBuf};

struct Folder(PathBuf);
impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("hyst-recording-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
    fn file(&self) -> PathBuf {
        self.0.join("session.mcap")
    }
}
impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn session() -> Session {
    Session::from([("session".into(), "test-1".into()), ("scene_hash".into(), "00ff".into())])
}

fn record(tick: u64) -> AppliedRecord {
    let t = tick as f32 * 0.001;
    let pose = Pose {
        position_m: [0.01 * t.sin(), -0.0, 0.05 + 0.003 * t],
        orientation: [0.1 * t.cos(), 0.2, 0.3, 0.9],
        pitch_rad: t / 3.0,
        insertion_m: f32::MIN_POSITIVE,
        camera_roll_rad: 1e-9,
        ..Default::default()
    };
    let controls = Controls { buttons: (tick / 7) as u32, light: 0.7, ..Default::default() };
    AppliedRecord {
        tick,
        command: ForceCommand {
            tick,
            force_tick: tick.saturating_sub(1),
            force_n: [t, 1.0 / 3.0, -t * 1e-7],
            kind: 1,
            source_incarnation: 3,
            device_incarnation: 2,
        },
        sample: HardwareSample {
            hardware_tick: tick + 5,
            time_ns: 86_400_000_000_123 + tick,
            pose,
            velocity_m_s: [0.1, t, 0.3],
            force_n: [0.0, 0.33333334, t],
            controls,
        },
        model_tick: tick.saturating_sub(2),
        model_epoch: 1,
        model_incarnation: 9,
    }
}

fn block(ticks: std::ops::Range<u64>) -> Block {
    let tick = ticks.start;
    Block {
        applied: ticks.map(record).collect(),
        tissue: vec![TissueStatus { state_tick: tick, state_hash: u64::MAX - tick, contact_count: 4, ..Default::default() }],
        fluid: vec![FluidStatus { state_tick: tick, deficit_ml: 12.5, alarms: 2, ..Default::default() }],
        events: vec![Event {
            tick,
            level: Level::Warning,
            kind: "died".into(),
            process: "haptic:1".into(),
            incarnation: 7,
            text: "says \"nothing\" any more".into(),
        }],
        lost: Vec::new(),
    }
}

fn ticks(recording: &Recording) -> Vec<u64> {
    recording.applied().iter().map(|record| record.tick).collect()
}

fn write(path: &Path, blocks: &[Block]) -> Writer {
    let mut writer = Writer::open(path, &session()).unwrap();
    blocks.iter().for_each(|block| writer.append(block).unwrap());
    writer
}

fn read_bytes(bytes: &[u8]) -> Result<Recording, ReadError> {
    Reader::new(Cursor::new(bytes), Path::new("memory")).and_then(Recording::collect)
}

#[test]
fn what_was_written_is_read_bit_for_bit() {
    let folder = Folder::new("round");
    let mut second = block(20..40);
    second.lost.push(TickRange { first: 17, last: 19 });
    let writer = write(&folder.file(), &[block(5..17), second.clone()]);
    assert_eq!((writer.last_tick(), writer.ticks(), writer.lost()), (Some(39), 32, 3));
    writer.finish().unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    let expected: Vec<AppliedRecord> = (5..17).chain(20..40).map(record).collect();
    assert_eq!(recording.applied(), expected);
    let bits = |records: &[AppliedRecord]| records.iter().map(|r| r.sample.pose.position_m[1].to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(recording.applied()), bits(&expected), "a negative zero stays one");
    assert_eq!(recording.content.tissue, [block(5..6).tissue, second.tissue].concat());
    assert_eq!(recording.content.fluid, [block(5..6).fluid, second.fluid].concat());
    assert_eq!(recording.content.events, [block(5..6).events, second.events].concat());
    assert_eq!(recording.content.lost, [TickRange { first: 17, last: 19 }]);
    assert_eq!((recording.ending, recording.damage.len()), (Ending::Complete, 0));
    assert_eq!(recording.session["scene_hash"], "00ff");
}

#[test]
fn a_number_that_is_not_finite_costs_nothing_but_itself() {
    let folder = Folder::new("nan");
    let mut bad = block(5..8);
    bad.applied[1].command.force_n[0] = f32::NAN;
    bad.fluid[0].deficit_ml = f64::NAN;
    write(&folder.file(), &[bad]).finish().unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    assert!(recording.applied()[1].command.force_n[0].is_nan() && recording.content.fluid[0].deficit_ml.is_nan());
    assert_eq!(recording.applied()[2], record(7));
}

#[test]
fn the_summary_is_one_that_the_library_reads_and_names_every_message() {
    let folder = Folder::new("summary");
    drop(write(&folder.file(), &[block(5..17)]));
    write(&folder.file(), &[block(17..40)]).finish().unwrap();
    let bytes = std::fs::read(folder.file()).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.clone().unwrap();
    let counted = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap()).count() as u64;
    assert_eq!((stats.message_count, summary.chunk_indexes.len(), summary.channels.len()), (counted, 2, 6));
    assert_eq!((stats.message_start_time, stats.message_end_time), (5_000_000, 39_000_000));
    let mut indexed = 0;
    for chunk in &summary.chunk_indexes {
        indexed += summary.stream_chunk(&bytes, chunk).unwrap().map(|message| message.unwrap()).count() as u64;
        let indexes = summary.read_message_indexes(&bytes, chunk).unwrap();
        for (channel, entries) in &indexes {
            let message = summary.seek_message(&bytes, chunk, &entries[0]).unwrap();
            assert_eq!(&message.channel.topic, &channel.topic);
        }
    }
    assert_eq!(indexed, counted);
    let facts = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!(facts.metadata["session"], "test-1");
}

#[test]
fn a_file_that_is_cut_at_any_byte_reads_to_its_last_whole_block_and_is_continued_from_there() {
    let folder = Folder::new("cut");
    let writer = Writer::open(&folder.file(), &session()).unwrap();
    let head = writer.bytes() as usize;
    drop(writer);
    let mut ends = vec![head];
    for first in [1u64, 4, 7] {
        ends.push(write(&folder.file(), &[block(first..first + 3)]).bytes() as usize);
    }
    write(&folder.file(), &[]).finish().unwrap();
    let whole = std::fs::read(folder.file()).unwrap();
    for length in 0..whole.len() {
        let cut = &whole[..length];
        let blocks = ends.iter().filter(|end| **end <= length).count();
        match read_bytes(cut) {
            Err(ReadError::Foreign { .. }) => assert!(length < head, "{length}"),
            Err(error) => panic!("{length}: {error}"),
            Ok(recording) => {
                // A chunk counts as soon as it is whole, even if its indexes are not.
                let read = ticks(&recording);
                assert!(read.len() >= 3 * (blocks - 1) && read == (1..=read.len() as u64).collect::<Vec<_>>(), "{length}: {read:?}");
                assert!(matches!(recording.ending, Ending::Cut { .. }) && recording.damage.is_empty(), "{length}");
            }
        }
        std::fs::write(folder.file(), cut).unwrap();
        let mut writer = Writer::open(&folder.file(), &session()).unwrap();
        let kept = 3 * blocks.saturating_sub(1) as u64;
        assert_eq!((writer.ticks(), writer.last_tick()), (kept, (kept > 0).then_some(kept)), "{length}");
        if length % 97 == 0 {
            writer.append(&block(kept + 1..kept + 4)).unwrap();
            writer.finish().unwrap();
            let recording = Recording::read(&folder.file()).unwrap();
            assert_eq!(ticks(&recording), (1..kept + 4).collect::<Vec<_>>(), "{length}");
            assert_eq!((recording.ending, recording.damage.len()), (Ending::Complete, 0));
        }
    }
}

#[test]
fn a_flipped_bit_anywhere_is_found_or_changes_no_record() {
    let folder = Folder::new("flip");
    write(&folder.file(), &[block(1..4), block(4..7), block(7..10)]).finish().unwrap();
    let whole = std::fs::read(folder.file()).unwrap();
    let good = read_bytes(&whole).unwrap();
    let (mut refused, mut damaged) = (0, 0);
    for at in 0..whole.len() {
        let mut bad = whole.clone();
        bad[at] ^= 1 << (at % 8);
        match read_bytes(&bad) {
            Err(_) => refused += 1,
            Ok(recording) => {
                for record in recording.applied() {
                    assert!(good.applied().contains(record), "byte {at} changed tick {}", record.tick);
                }
                let known = !recording.damage.is_empty() || recording.ending != Ending::Complete;
                assert!(known || recording.applied() == good.applied(), "byte {at} lost ticks in silence");
                damaged += usize::from(known);
            }
        }
        // A successor never panics and never takes a damaged file for a longer one.
        if at % 5 == 0 {
            std::fs::write(folder.file(), &bad).unwrap();
            if let Ok(writer) = Writer::open(&folder.file(), &session()) {
                assert!(writer.bytes() <= whole.len() as u64);
            }
        }
    }
    assert!(refused > 10 && damaged > 1000, "{refused} {damaged}");
}

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
