//! A recording that is not read from its beginning: the checkpoints before a tick, and the ticks from one on.

mod fixture;

use fixture::{Folder, block, ticks, write};
use hyst_messages::Role;
use hyst_recording::{Checkpoint, Judged, Playback, Reader, Recording, checkpoints};
use std::path::Path;

/// Ticks of a block.
const TICKS: u64 = 200;

/// A recording of 8 s, in which the fluid has a checkpoint in each block, the tissue every second, and with it is kept what was judged.
fn recorded(folder: &Folder) -> std::path::PathBuf {
    let path = folder.file();
    let blocks: Vec<_> = (0..40u64)
        .map(|part| {
            let mut block = block(1 + part * TICKS..1 + (part + 1) * TICKS);
            if part % 5 == 0 {
                let tick = block.applied[10].tick;
                block.checkpoints.push(Checkpoint { role: Role::Tissue, tick, state: vec![part as u8; 64] });
                block.judged.push(Judged { tick: tick + 20, tissue_tick: tick, judge: format!("{{\"part\": {part}}}") });
            }
            block
        })
        .collect();
    write(&path, &blocks).finish().unwrap();
    path
}

fn found(path: &Path, up_to_tick: u64) -> Vec<(Role, u64)> {
    let mut found: Vec<_> = checkpoints(path, up_to_tick).unwrap().iter().map(|kept| (kept.role, kept.tick)).collect();
    found.sort_by_key(|(role, _)| *role as usize);
    found
}

#[test]
fn the_newest_checkpoints_up_to_a_tick_are_found_and_a_damaged_one_costs_its_interval() {
    let folder = Folder::new("seek");
    let path = recorded(&folder);
    assert_eq!(found(&path, 0), []);
    assert_eq!(found(&path, 11), [(Role::Tissue, 11), (Role::Fluid, 1)]);
    assert_eq!(found(&path, 6_050), [(Role::Tissue, 6_011), (Role::Fluid, 6_001)]);
    assert_eq!(found(&path, u64::MAX), [(Role::Tissue, 7_011), (Role::Fluid, 7_801)]);
    assert_eq!(checkpoints(&path, 6_050).unwrap().iter().find(|kept| kept.role == Role::Tissue).unwrap().state, vec![30; 64]);
    let mut bytes = std::fs::read(&path).unwrap();
    let at = chunk_with(&path, 6_001);
    bytes[at as usize + 200] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(found(&path, 6_050), [(Role::Tissue, 5_011), (Role::Fluid, 5_801)]);
    // Cut before its summary, and in the middle of a block.
    std::fs::write(&path, &bytes[..at as usize + 100]).unwrap();
    assert_eq!(found(&path, u64::MAX), [(Role::Tissue, 5_011), (Role::Fluid, 5_801)]);
}

#[test]
fn the_newest_judgement_up_to_a_tick_is_found_with_a_summary_and_without_and_the_next_block_stays_the_same() {
    let folder = Folder::new("judged");
    let path = recorded(&folder);
    let judged = |up_to_tick: u64| {
        let mut reader = Reader::open(&path).unwrap();
        let judged = reader.judged(up_to_tick).unwrap();
        let next = reader.next_block().unwrap().unwrap().applied[0].tick;
        assert_eq!(next, 1, "up to {up_to_tick}");
        judged.map(|judged| (judged.tick, judged.tissue_tick, judged.judge))
    };
    let of = |part: u64| Some((31 + part * TICKS, 11 + part * TICKS, format!("{{\"part\": {part}}}")));
    let mut bytes = std::fs::read(&path).unwrap();
    let (at, end) = (chunk_with(&path, 6_001) as usize, bytes.len());
    for length in [end, end - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert_eq!([0, 30, 31, 1_030, 6_031, u64::MAX].map(&judged), [None, None, of(0), of(0), of(30), of(35)], "{length}");
    }
    // One that is damaged costs its interval.
    bytes[at + 200] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(judged(6_031), of(25));
}

/// The byte of the chunk that begins with a tick.
fn chunk_with(path: &Path, tick: u64) -> u64 {
    let file = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let chunk = summary.chunk_indexes.iter().find(|chunk| chunk.message_start_time == tick * 1_000_000).unwrap();
    chunk.chunk_start_offset
}

#[test]
fn ticks_are_read_from_one_on_as_they_are_from_the_beginning() {
    let folder = Folder::new("skip");
    let path = recorded(&folder);
    let from = |tick: u64| {
        let mut playback = Playback::open(&path).unwrap();
        playback.skip_to(tick).unwrap();
        playback
    };
    assert!(ticks(&Recording::read(&path).unwrap()).into_iter().eq(1..=8_000));
    let mut whole = Playback::open(&path).unwrap();
    let mut part = from(5_123);
    assert_eq!(part.first_tick().unwrap(), Some(5_001), "the block is read as a whole");
    for tick in (5_123..5_500).chain([8_000]) {
        let (is, was) = (part.at(tick).unwrap().unwrap(), whole.at(tick).unwrap().unwrap());
        assert_eq!((is.applied, is.step, is.fluid), (was.applied, was.step, was.fluid), "tick {tick}");
    }
    assert_eq!(part.at(8_001).unwrap(), None);
    assert_eq!(from(8_001).first_tick().unwrap(), None, "behind the end");
    assert!(Reader::open(&path).unwrap().skip_to(u64::MAX).is_ok());
}

#[test]
fn what_is_found_by_the_summary_is_found_without_it_too() {
    let folder = Folder::new("index");
    let path = recorded(&folder);
    let sought = [0, 1, 11, 200, 201, 5_123, 6_050, 7_999, 8_000, 8_001, u64::MAX];
    let all = || {
        let of = |tick: u64| {
            let mut playback = Playback::open(&path).unwrap();
            playback.skip_to(tick).unwrap();
            (found(&path, tick), playback.first_tick().unwrap())
        };
        sought.map(of)
    };
    let by_summary = all();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.pop(); // no footer is where it has to be
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(all(), by_summary);
    assert_eq!(by_summary[5].1, Some(5_001));
}
