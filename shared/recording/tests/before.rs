//! Promises of what is noted of a file while it is written: who goes on in it leaves that, and whoever spoils it is found.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, session, write};
use hyst_recording::{Before, Block, Picture, Tail, Writer};
use std::path::Path;

/// What a file holds.
fn noted(file: &Path) -> Before {
    Before::of(file).unwrap().expect("a recording").0
}

/// Goes on in a file with a block.
fn go_on(file: &Path) {
    Writer::open(file, &session()).unwrap().append(&block(100..103)).unwrap();
}

/// A picture of so many bytes that nobody packs.
fn noise(bytes: usize) -> Block {
    let mut seed = 1u64;
    let noise = std::iter::repeat_with(|| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 56) as u8
    });
    let jpeg = [0xff, 0xd8].into_iter().chain(noise.take(bytes)).chain([0xff, 0xd9]).collect();
    Block { pictures: vec![Picture { tick: 4, event_tick: 4, words: String::new(), jpeg }], ..Block::default() }
}

#[test]
fn who_goes_on_leaves_what_was_there_wherever_the_one_before_was_when_it_was_noted_and_when_it_died() {
    let folder = Folder::new("before-torn");
    let file = folder.file();
    let mut writer = write(&file, &[block(1..4), block(4..7)]);
    let first = writer.bytes() as usize;
    writer.append(&block(7..10)).unwrap();
    let last = writer.bytes() as usize;
    writer.append(&block(10..13)).unwrap();
    let whole = std::fs::read(&file).unwrap();
    drop(writer);
    for noted_at in (first..=whole.len()).step_by(211) {
        std::fs::write(&file, &whole[..noted_at]).unwrap();
        let before = noted(&file);
        for died_at in [noted_at, last + 40, last + 1_000, whole.len() - 1].into_iter().filter(|died_at| *died_at >= noted_at) {
            std::fs::write(&file, &whole[..died_at]).unwrap();
            go_on(&file);
            assert!(before.is_in(&file).unwrap(), "noted at {noted_at}, died at {died_at}");
        }
    }
    // With a summary, which is cut away.
    write(&file, &[]).finish().unwrap();
    let before = noted(&file);
    go_on(&file);
    assert!(before.is_in(&file).unwrap());
}

#[test]
fn whoever_spoils_it_is_found_and_what_came_later_is_nobodys() {
    let folder = Folder::new("before-spoilt");
    let file = folder.file();
    let mut writer = write(&file, &[block(1..4), block(4..7)]);
    let end = writer.bytes() as usize;
    [block(7..10), block(10..13)].iter().for_each(|block| writer.append(block).unwrap());
    drop(writer);
    let before = noted(&file);
    let whole = std::fs::read(&file).unwrap();
    for at in (0..whole.len()).step_by(101) {
        let mut bad = whole.clone();
        bad[at] ^= 0x20;
        std::fs::write(&file, &bad).unwrap();
        assert_eq!(before.is_in(&file).unwrap(), at >= end, "byte {at} of {end}");
        std::fs::write(&file, &whole[..at]).unwrap();
        assert_eq!(before.is_in(&file).unwrap(), at >= end, "cut at {at} of {end}");
    }
    std::fs::remove_file(&file).unwrap();
    assert!(before.is_in(&file).is_err(), "nobody knows");
    go_on(&file);
    assert!(!before.is_in(&file).unwrap(), "it was begun anew");
}

#[test]
fn of_a_long_file_its_ends_are_known_and_what_its_newest_blocks_have() {
    let folder = Folder::new("before-long");
    let file = folder.file();
    let mut writer = write(&file, &[block(1..4), noise(5 << 20)]);
    writer.append(&block(4..7)).unwrap();
    let end = writer.bytes() as usize;
    [block(7..10), block(10..13)].iter().for_each(|block| writer.append(block).unwrap());
    let (before, newest) = Before::of(&file).unwrap().unwrap();
    let ticks = |block: &Block| block.applied.iter().map(|record| record.tick).collect::<Vec<_>>();
    assert_eq!((ticks(&newest), newest.steps.len()), (vec![4, 5, 6], 1), "the large one lies farther back");
    let mut tail = Tail::behind(&file, &before);
    assert_eq!(ticks(&tail.look().unwrap()), (7..13).collect::<Vec<_>>(), "the last two are read again");
    writer.append(&block(13..16)).unwrap();
    assert_eq!(ticks(&tail.look().unwrap()), [13, 14, 15]);
    let whole = std::fs::read(&file).unwrap();
    for (at, is_in) in [(0, false), (60_000, false), (end - 60_000, false), (end - 1, false), (end, true)] {
        let mut bad = whole.clone();
        bad[at] ^= 1;
        std::fs::write(&file, &bad).unwrap();
        assert_eq!(before.is_in(&file).unwrap(), is_in, "byte {at}");
    }
}

#[test]
fn nothing_is_noted_of_what_is_no_recording_or_was_damaged_by_then_or_ends_with_too_large_a_block() {
    let folder = Folder::new("before-none");
    let file = folder.file();
    assert!(Before::of(&file).is_err(), "it is not there");
    std::fs::write(&file, [0x55; 5_000]).unwrap();
    assert_eq!(Before::of(&file).unwrap(), None);
    std::fs::remove_file(&file).unwrap();
    let mut writer = write(&file, &[block(1..4), block(4..7)]);
    let at = writer.bytes() as usize;
    [block(7..10), block(10..13)].iter().for_each(|block| writer.append(block).unwrap());
    let mut whole = std::fs::read(&file).unwrap();
    whole[at + 300] ^= 1;
    std::fs::write(&file, &whole).unwrap();
    assert_eq!(Before::of(&file).unwrap(), None, "the last block but one");
    std::fs::write(&file, &whole[..at]).unwrap();
    assert!(Before::of(&file).unwrap().is_some(), "without it");
    drop(writer);
    write(&file, &[noise(5 << 20)]);
    assert_eq!(Before::of(&file).unwrap(), None, "where the one before it begins nobody has looked");
}
