//! Promises of the file: what is written is read, bit for bit; a cut at any byte and a flipped bit anywhere cost at most the block
//! that they hit; a successor goes on in the same file.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, record, session, ticks, write};
use hyst_messages::{AppliedRecord, FluidStatus};
use hyst_recording::{Block, Continuity, Ending, Event, ReadError, Reader, Recording, SceneFile, TickRange, Writer, scene_files};
use std::io::Cursor;
use std::path::Path;

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
    assert_eq!(recording.content.origins, [block(5..6).origins, second.origins].concat());
    assert_eq!(recording.content.tissue, [block(5..6).tissue, second.tissue].concat());
    assert_eq!(recording.content.fluid, [block(5..6).fluid, second.fluid].concat());
    assert_eq!(recording.content.events, [block(5..6).events, second.events].concat());
    assert_eq!(recording.content.pictures, [block(5..6).pictures, second.pictures].concat());
    assert_eq!(recording.content.lost, [TickRange { first: 17, last: 19 }]);
    assert_eq!((recording.ending, recording.damage.len()), (Ending::Complete, 0));
    assert_eq!(recording.session["scene_hash"], "00ff");
}

/// Nothing but an event says so: a gap of which none does counts as missing.
#[test]
fn ticks_that_were_never_made_are_read_as_the_event_that_says_so() {
    let folder = Folder::new("unmade");
    let range = |first, last| TickRange { first, last };
    let blocks = [block(5..17), Block { unmade: vec![range(17, 19), range(22, 22)], ..block(20..22) }, block(23..40)];
    write(&folder.file(), &blocks).finish().unwrap();
    let read = Recording::read(&folder.file()).unwrap().content;
    let said: Vec<&Event> = read.events.iter().filter(|event| event.kind == "skipped").collect();
    assert!(said.len() == 1 && said[0].text.contains("4 in 2 ranges from tick 17 to 22"), "{said:?}");
    let continuity = Continuity::of(&read);
    assert_eq!((continuity.unmade, continuity.missing(), read.unmade), (4, 0, Vec::new()));
}

#[test]
fn the_files_of_a_scene_are_found_wherever_they_are_and_none_of_one_that_is_not_whole() {
    let folder = Folder::new("scene");
    let file = |index, name: &str, bytes: &[u8]| SceneFile { index, count: 3, name: name.into(), bytes: bytes.to_vec() };
    let files = [file(0, "a.toml", b"version = 1"), file(1, "../meshes/b.msh", &[0, 255, 7]), file(2, "c.obj", &[])];
    let of = |file: &SceneFile| Block { scene: vec![file.clone()], ..Block::default() };
    let found = |blocks: &[Block]| {
        let _ = std::fs::remove_file(folder.file());
        write(&folder.file(), blocks).finish().unwrap();
        scene_files(&folder.file()).unwrap()
    };
    // A disk that is full for a while gets ticks between them; who takes over writes them again.
    assert_eq!(
        found(&[block(5..17), of(&files[0]), block(17..20), of(&files[2]), of(&files[0]), of(&files[1]), block(20..40)]),
        files
    );
    assert_eq!(Recording::read(&folder.file()).unwrap().content.scene.len(), 4);
    assert_eq!(found(&[of(&files[0]), of(&files[2]), block(5..17)]), [], "one is missing");
    assert_eq!(found(&[of(&files[1]), of(&files[2]), block(5..17)]), [], "the scene is");
    assert_eq!(found(&[block(5..17)]), []);
    assert_eq!(found(&[of(&SceneFile { index: 7, count: 1, ..files[0].clone() })]), [], "no such file");
    // Who goes on in a file knows without a look through it whether anything is there.
    let goes_on = |blocks: &[Block]| {
        let _ = std::fs::remove_file(folder.file());
        drop(write(&folder.file(), blocks));
        Writer::open(&folder.file(), &session()).unwrap().scene_files()
    };
    assert_eq!([&[block(5..17)][..], &[of(&files[0]), block(5..17), of(&files[2])]].map(goes_on), [0, 2]);
}

#[test]
fn a_number_of_64_bits_is_read_as_the_one_that_was_written() {
    let folder = Folder::new("wide");
    let mut wide = block(5..8);
    // Of seventeen digits, of which a reader that is not exact gets one in three wrong.
    let numbers = || (1..=1_000u32).map(|n| f64::from(n).sqrt() * 1e3 / 7.0);
    wide.fluid = numbers().map(|deficit_ml| FluidStatus { state_tick: 5, deficit_ml, ..FluidStatus::default() }).collect();
    write(&folder.file(), &[wide]).finish().unwrap();
    let read = Recording::read(&folder.file()).unwrap().content.fluid;
    let bits: Vec<u64> = read.iter().map(|status| status.deficit_ml.to_bits()).collect();
    assert_eq!(bits, numbers().map(f64::to_bits).collect::<Vec<_>>());
}

#[test]
fn a_number_that_is_not_finite_costs_nothing_but_itself() {
    let folder = Folder::new("nan");
    let mut bad = block(5..8);
    bad.applied[1].command.force_n[0] = f32::NAN;
    (bad.tissue[0].hold_m, bad.tissue[0].removed_volume_ml) = (f32::INFINITY, f64::NAN);
    bad.fluid[0].deficit_ml = f64::NAN;
    write(&folder.file(), &[bad]).finish().unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    let (tissue, fluid) = (&recording.content.tissue[0], &recording.content.fluid[0]);
    assert!(recording.applied()[1].command.force_n[0].is_nan() && fluid.deficit_ml.is_nan());
    assert!(tissue.hold_m.is_nan() && tissue.removed_volume_ml.is_nan() && tissue.contact_count == 4, "{tissue:?}");
    assert_eq!(recording.applied()[2], record(7));
    let text = std::fs::read(folder.file()).unwrap();
    let mut messages = mcap::MessageStream::new(&text).unwrap().map(|message| message.unwrap().data.into_owned());
    assert!(messages.all(|json| !String::from_utf8(json).unwrap().contains("null")));
}

#[test]
fn the_summary_is_one_that_the_library_reads_and_names_every_message() {
    let folder = Folder::new("summary");
    drop(write(&folder.file(), &[block(5..17)]));
    write(&folder.file(), &[block(17..40)]).finish().unwrap();
    let bytes = std::fs::read(folder.file()).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.clone().unwrap();
    let counted = mcap::MessageStream::new(&bytes).unwrap().filter(|message| message.is_ok()).count() as u64;
    assert_eq!((stats.message_count, summary.chunk_indexes.len(), summary.channels.len()), (counted, 2, 13));
    assert_eq!((stats.message_start_time, stats.message_end_time), (5_000_000, 39_000_000));
    let mut indexed = 0;
    for chunk in &summary.chunk_indexes {
        indexed += summary.stream_chunk(&bytes, chunk).unwrap().filter(|message| message.is_ok()).count() as u64;
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

/// What happened before the first tick has the time 0, and its block was left out of the times that the summary says.
#[test]
fn the_summary_begins_with_the_first_message_also_where_that_has_the_time_0_and_not_with_a_block_without_messages() {
    let folder = Folder::new("span");
    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    let lost = Block { lost: vec![TickRange { first: 2, last: 4 }], ..Block::default() };
    let started = Block { events: vec![Event { tick: 0, ..block(5..6).events.remove(0) }], ..Block::default() };
    let span = |path: &Path| {
        let stats = mcap::Summary::read(&std::fs::read(path).unwrap()).unwrap().unwrap().stats.unwrap();
        (stats.message_start_time, stats.message_end_time)
    };
    [&lost, &block(5..17)].into_iter().for_each(|block| writer.append(block).unwrap());
    writer.finish().unwrap();
    assert_eq!(span(&folder.file()), (5_000_000, 16_000_000));
    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    writer.append(&started).unwrap();
    writer.finish().unwrap();
    assert_eq!(span(&folder.file()), (0, 16_000_000));
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
                assert!(
                    read.len() >= 3 * (blocks - 1) && read == (1..=read.len() as u64).collect::<Vec<_>>(),
                    "{length}: {read:?}"
                );
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
fn blocks_come_in_the_files_order_with_the_same_damage_however_many_threads_decode_them() {
    let folder = Folder::new("threads");
    let blocks: Vec<Block> = (0..40).map(|n| block(1 + 3 * n..4 + 3 * n)).collect();
    write(&folder.file(), &blocks).finish().unwrap();
    let mut bytes = std::fs::read(folder.file()).unwrap();
    let third = bytes.len() / 3;
    bytes[third..third + 6_000].iter_mut().step_by(500).for_each(|byte| *byte ^= 0x10);
    let one_by_one = read_bytes(&bytes).unwrap();
    assert!(!one_by_one.damage.is_empty() && !one_by_one.applied().is_empty());
    for threads in [0, 1, 2, 5, 100] {
        let mut reader = Reader::new(Cursor::new(&bytes), Path::new("memory")).unwrap();
        let mut applied = Vec::new();
        reader.each_block(threads, |block| applied.extend(block.applied)).unwrap();
        assert_eq!(applied, one_by_one.applied(), "{threads} threads");
        assert_eq!((reader.damage(), reader.ending()), (&one_by_one.damage[..], Some(one_by_one.ending)), "{threads} threads");
    }
}

#[test]
fn a_hole_of_zeros_is_the_end_and_is_not_walked_through() {
    let folder = Folder::new("hole");
    let end = write(&folder.file(), &[block(1..4)]).bytes();
    let hole_bytes = 64 << 30;
    std::fs::OpenOptions::new().write(true).open(folder.file()).unwrap().set_len(end + hole_bytes).unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    assert_eq!((ticks(&recording), recording.ending, recording.damage.len()), (vec![1, 2, 3], Ending::Cut { at: end }, 0));
    let writer = Writer::open(&folder.file(), &session()).unwrap();
    assert_eq!((writer.last_tick(), writer.bytes()), (Some(3), end));
}

#[test]
fn a_block_whose_length_was_hit_is_left_out_and_what_follows_it_is_read_and_continued() {
    let folder = Folder::new("length");
    let blocks = [1u64, 4, 7, 10].map(|first| block(first..first + 3));
    let ends = blocks.map(|block| write(&folder.file(), &[block]).bytes() as usize);
    // The third block: before the second stand the session's facts.
    let hit = ends[1]..ends[1] + 100;
    let left = |to: u64| (1..7).chain(10..to).collect::<Vec<u64>>();
    let unfinished = std::fs::read(folder.file()).unwrap();
    write(&folder.file(), &[]).finish().unwrap();
    let finished = std::fs::read(folder.file()).unwrap();
    for fill in [0x00, 0x06, 0x55, 0xff] {
        let mut bad = finished.clone();
        bad[hit.clone()].fill(fill);
        let recording = read_bytes(&bad).unwrap();
        assert_eq!((ticks(&recording), recording.ending), (left(13), Ending::Complete), "{fill}");
        assert_eq!(recording.damage[0].at, hit.start as u64, "{fill}: {:?}", recording.damage);

        let mut bad = unfinished.clone();
        bad[hit.clone()].fill(fill);
        std::fs::write(folder.file(), &bad).unwrap();
        let mut writer = Writer::open(&folder.file(), &session()).unwrap();
        assert_eq!((writer.last_tick(), writer.bytes()), (Some(12), bad.len() as u64), "{fill}");
        writer.append(&block(13..16)).unwrap();
        writer.finish().unwrap();
        let recording = Recording::read(&folder.file()).unwrap();
        assert_eq!((ticks(&recording), recording.ending), (left(16), Ending::Complete), "{fill}");
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
                assert_eq!(recording.session, good.session, "byte {at} changed the session's facts");
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
    assert!(refused == mcap::MAGIC.len() && damaged > 1000, "{refused} {damaged}");
}
