//! Promises of the end of a file that is looked at while it is written: each tick that comes is given once, as it was written, and nothing of what is no block.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, record, write};
use hyst_messages::AppliedRecord;
use hyst_recording::{Block, Picture, Tail};

fn ticks(tail: &mut Tail) -> Vec<u64> {
    tail.look().unwrap().applied.iter().map(|record| record.tick).collect()
}

#[test]
fn what_comes_to_a_file_is_given_once_and_as_it_was_written() {
    let folder = Folder::new("tail");
    let mut writer = write(&folder.file(), &[block(1..4)]);
    let mut tail = Tail::of(&folder.file());
    assert!(ticks(&mut tail).is_empty(), "what was there before is not read");
    writer.append(&block(4..7)).unwrap();
    writer.append(&block(7..10)).unwrap();
    let expected: Vec<AppliedRecord> = (4..10).map(record).collect();
    let come = tail.look().unwrap();
    assert_eq!(come.applied, expected);
    assert_eq!(come.steps, [block(4..7).steps, block(7..10).steps].concat());
    assert_eq!((come.tissue.len(), come.fluid.len(), come.events.len(), come.checkpoints.len()), (2, 2, 2, 0), "but no states");
    assert!(ticks(&mut tail).is_empty());
    let later = folder.0.join("later.mcap");
    let mut absent = Tail::of(&later);
    assert!(absent.look().is_err());
    std::fs::copy(folder.file(), &later).unwrap();
    assert_eq!(ticks(&mut absent), (1..10).collect::<Vec<_>>(), "it was not there yet");
}

#[test]
fn a_block_is_given_when_it_is_there_as_a_whole_wherever_it_was_cut() {
    let folder = Folder::new("tail-cut");
    let file = folder.file();
    let mut writer = write(&file, &[block(1..3), block(3..4)]);
    let before = std::fs::read(&file).unwrap();
    writer.append(&block(4..7)).unwrap();
    let middle = writer.bytes() as usize;
    writer.append(&block(7..10)).unwrap();
    let whole = std::fs::read(&file).unwrap();
    for length in (before.len()..middle).step_by(37) {
        std::fs::write(&file, &before).unwrap();
        let mut tail = Tail::of(&file);
        std::fs::write(&file, &whole[..length]).unwrap();
        let mut given = ticks(&mut tail);
        assert!(given.is_empty() || given == [4, 5, 6], "{length}: {given:?}");
        let mut late = Tail::of(&file);
        std::fs::write(&file, &whole).unwrap();
        given.extend(ticks(&mut tail));
        assert_eq!(given, [4, 5, 6, 7, 8, 9], "{length}");
        assert!(ticks(&mut late).ends_with(&[7, 8, 9]), "{length}: who begins in the midst of a block has the next one");
    }
}

#[test]
fn nothing_is_given_of_what_is_no_block_nor_behind_one_that_is_damaged() {
    let folder = Folder::new("tail-rubbish");
    let file = folder.file();
    let mut writer = write(&file, &[block(1..3), block(3..4)]);
    let before = std::fs::read(&file).unwrap();
    let mut tail = Tail::of(&file);
    for filler in [0x00u8, 0x06, 0xa5] {
        std::fs::write(&file, [&before[..], &[filler; 5_000][..]].concat()).unwrap();
        assert!(ticks(&mut tail).is_empty() && ticks(&mut tail).is_empty(), "{filler}");
    }
    std::fs::write(&file, &before).unwrap();
    writer.append(&block(4..7)).unwrap();
    writer.append(&block(7..10)).unwrap();
    let whole = std::fs::read(&file).unwrap();
    let mut bad = whole.clone();
    bad[before.len() + 200] ^= 1; // within what is compressed of the first of the two
    std::fs::write(&file, &bad).unwrap();
    assert!(ticks(&mut tail).is_empty() && ticks(&mut tail).is_empty());
    std::fs::write(&file, &whole).unwrap();
    assert_eq!(ticks(&mut tail), (4..10).collect::<Vec<_>>(), "it was not all there yet");
}

/// Who goes on in a file cuts its summary away, which may be longer than what comes next.
#[test]
fn what_comes_where_a_summary_was_cut_away_is_given() {
    let folder = Folder::new("tail-summary");
    write(&folder.file(), &[block(1..4)]).finish().unwrap();
    let mut tail = Tail::of(&folder.file());
    let mut writer = write(&folder.file(), &[]);
    assert!(ticks(&mut tail).is_empty());
    writer.append(&block(4..7)).unwrap();
    assert_eq!(ticks(&mut tail), [4, 5, 6]);
}

#[test]
fn a_look_has_an_end_and_the_next_one_goes_on_from_there() {
    let folder = Folder::new("tail-large");
    let mut writer = write(&folder.file(), &[block(1..4)]);
    let mut tail = Tail::of(&folder.file());
    let mut seed = 1u64;
    let noise = std::iter::repeat_with(|| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 56) as u8
    });
    let jpeg = [0xff, 0xd8].into_iter().chain(noise.take(10 << 20)).chain([0xff, 0xd9]).collect();
    let picture = Picture { tick: 4, event_tick: 4, words: String::new(), jpeg };
    writer.append(&Block { pictures: vec![picture], ..Block::default() }).unwrap();
    writer.append(&block(4..7)).unwrap();
    assert!(ticks(&mut tail).is_empty());
    assert_eq!(ticks(&mut tail), [4, 5, 6]);
}
