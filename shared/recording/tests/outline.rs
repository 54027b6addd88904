//! What the summary tells of a recording that nobody reads: the same as reading it does, or nothing.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, session, ticks, write};
use hyst_recording::{Block, Outline, Recording, TickRange, Writer, outline};

#[test]
fn the_outline_of_a_closed_file_is_what_reading_it_to_its_end_finds() {
    let folder = Folder::new("outline");
    let gap = |first, last| vec![TickRange { first, last }];
    let second = Block { lost: gap(201, 230), ..block(231..400) };
    drop(write(&folder.file(), &[block(1..201), second]));
    // A successor goes on, and says something after the last tick.
    let last = Block { applied: Vec::new(), lost: gap(450, 451), ..block(500..501) };
    write(&folder.file(), &[block(400..450), last]).finish().unwrap();
    let read = Recording::read(&folder.file()).unwrap();
    let found = outline(&folder.file()).unwrap().unwrap();
    assert_eq!(Some(found.last_tick), ticks(&read).last().copied());
    assert_eq!((found.last_tick, &found.lost), (449, &read.content.lost));
    assert_eq!(found.lost.len(), 2);
}

#[test]
fn a_summary_that_is_not_whole_or_does_not_name_all_that_is_there_tells_nothing() {
    let folder = Folder::new("no-outline");
    let ends: Vec<usize> = [1u64, 4, 7].map(|first| write(&folder.file(), &[block(first..first + 3)]).bytes() as usize).into();
    let open = std::fs::read(folder.file()).unwrap();
    assert_eq!(outline(&folder.file()).unwrap(), None, "it was not closed");
    write(&folder.file(), &[]).finish().unwrap();
    let whole = std::fs::read(folder.file()).unwrap();
    let of = |bytes: &[u8]| {
        std::fs::write(folder.file(), bytes).unwrap();
        outline(&folder.file()).unwrap()
    };
    assert_eq!(of(&whole), Some(Outline { last_tick: 9, lost: Vec::new() }));
    // The footer's body begins with the byte at which the summary does; behind it are the checksum and the magic.
    let words = whole.len() - 8 - 20;
    let summary = u64::from_le_bytes(whole[words..words + 8].try_into().unwrap()) as usize;
    for at in summary..whole.len() {
        let mut bad = whole.clone();
        bad[at] ^= 1 << (at % 8);
        assert_eq!(of(&bad), None, "byte {at} of {}", whole.len());
        if at % 50 == 0 {
            assert_eq!(of(&whole[..at]), None, "cut at byte {at}");
        }
    }
    // The block that has the last tick.
    let mut bad = whole.clone();
    bad[ends[1] + 200] ^= 1;
    assert_eq!(of(&bad), None);
    // One in the middle is not seen from here; but a part that is no block, after which a successor went on, is.
    let mut bad = open;
    bad[ends[0]..ends[0] + 100].fill(0x55);
    std::fs::write(folder.file(), &bad).unwrap();
    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    writer.append(&block(10..13)).unwrap();
    writer.finish().unwrap();
    assert_eq!(outline(&folder.file()).unwrap(), None);
}

#[test]
fn a_recording_without_a_tick_has_no_outline() {
    let folder = Folder::new("empty-outline");
    write(&folder.file(), &[]).finish().unwrap();
    assert_eq!(outline(&folder.file()).unwrap(), None);
}
