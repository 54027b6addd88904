//! The facts of a session, by which it is judged and done again: whatever bit of them was hit, they are what was written, or it is said that they are not; and a
//! recording of before they had a checksum is read as ever.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, ticks};
use hyst_recording::{Block, Ending, ReadError, Reader, Recording, Session, Writer, outline};
use std::io::Cursor;
use std::path::Path;

/// The fact that is hit in a test; its digit with another bit is one that counts three times as much.
const WEIGHT: &[u8] = b"\"weight\":2.0";
const DIGIT: usize = 9;
const OTHER: &[u8] = b"\"weight\":6.0";

fn judged() -> Session {
    let case = "{\"goals\":[{\"is\":{\"removed\":0.5}}],\"score\":{\"time\":{\"weight\":2.0}}}";
    Session::from([("session".into(), "test-1".into()), ("case".into(), case.into())])
}

/// The bytes of a recording of these blocks, of its head, and of all before its summary.
fn written(name: &str, blocks: &[Block]) -> (Vec<u8>, usize, usize) {
    let folder = Folder::new(name);
    let mut writer = Writer::open(&folder.file(), &judged()).unwrap();
    let head = writer.bytes() as usize;
    blocks.iter().for_each(|block| writer.append(block).unwrap());
    let end = writer.bytes() as usize;
    writer.finish().unwrap();
    (std::fs::read(folder.file()).unwrap(), head, end)
}

fn open(bytes: &[u8]) -> Result<Reader<Cursor<&[u8]>>, ReadError> {
    Reader::new(Cursor::new(bytes), Path::new("memory"))
}

/// Where these bytes stand.
fn places(bytes: &[u8], sought: &[u8]) -> Vec<usize> {
    bytes.windows(sought.len()).enumerate().filter(|(_, window)| *window == sought).map(|(at, _)| at).collect()
}

#[test]
fn whatever_bit_of_the_head_is_hit_the_facts_are_those_that_were_written_and_everything_is_read() {
    let (whole, head, end) = written("facts-head", &[block(1..4), block(4..7)]);
    let facts = open(&whole).unwrap().session().clone();
    assert_eq!((&facts["case"], facts.get("crc")), (&judged()["case"], None));
    assert_eq!([&whole[..], &whole[..end], &whole[..head]].map(|bytes| places(bytes, WEIGHT).len()), [3, 2, 1]);
    // Also of one that was never closed.
    for bytes in [&whole[..], &whole[..end]] {
        for bit in 8 * mcap::MAGIC.len()..8 * head {
            let mut bad = bytes.to_vec();
            bad[bit / 8] ^= 1 << (bit % 8);
            let reader = open(&bad).unwrap_or_else(|error| panic!("bit {bit}: {error}"));
            assert_eq!(*reader.session(), facts, "bit {bit}");
            if bit % 13 == 0 {
                let recording = Recording::collect(reader).unwrap();
                assert_eq!((ticks(&recording), recording.damage), ((1..7).collect::<Vec<_>>(), Vec::new()), "bit {bit}");
            }
        }
    }
    // One that stands behind the head: nothing is missing.
    let mut bad = whole.clone();
    bad[places(&whole, WEIGHT)[2] + DIGIT] ^= 4;
    let mut reader = open(&bad).unwrap();
    assert_eq!(*reader.session(), facts);
    reader.each_block(1, |_| {}).unwrap();
    assert_eq!((reader.damage(), reader.ending()), (&[][..], Some(Ending::Complete)));
}

#[test]
fn facts_that_stand_nowhere_else_are_taken_as_they_are_and_it_is_said_that_they_are_damaged() {
    // Nobody has closed it, and it has one block.
    let (whole, _, end) = written("facts-once", &[block(1..4)]);
    let mut bad = whole[..end].to_vec();
    bad[places(&whole, WEIGHT)[0] + DIGIT] ^= 4;
    let reader = open(&bad).unwrap();
    assert_eq!(places(reader.session()["case"].as_bytes(), OTHER).len(), 1);
    let recording = Recording::collect(reader).unwrap();
    assert_eq!(ticks(&recording), [1, 2, 3]);
    assert!(recording.damage.len() == 1 && recording.damage[0].reason.contains("facts of the session"), "{:?}", recording.damage);
    // Where there are none that can be read it is no recording of ours.
    let mut bad = whole[..end].to_vec();
    let name = places(&bad, b"\x07\0\0\0station")[0];
    bad[name + 4] ^= 1;
    assert!(matches!(open(&bad), Err(ReadError::Foreign { .. })));
}

#[test]
fn who_goes_on_in_a_file_whose_head_is_damaged_goes_on_in_its_session_and_writes_its_facts_again() {
    let folder = Folder::new("facts-on");
    for (blocks, copies) in [(1, 2), (2, 3)] {
        let _ = std::fs::remove_file(folder.file());
        let mut writer = Writer::open(&folder.file(), &judged()).unwrap();
        (0..blocks).for_each(|part| writer.append(&block(1 + 3 * part..4 + 3 * part)).unwrap());
        drop(writer);
        let mut bytes = std::fs::read(folder.file()).unwrap();
        let place = places(&bytes, WEIGHT)[0];
        bytes[place + DIGIT] ^= 4;
        std::fs::write(folder.file(), &bytes).unwrap();
        let mut writer = Writer::open(&folder.file(), &judged()).unwrap();
        assert_eq!((writer.last_tick(), writer.bytes()), (Some(3 * blocks), bytes.len() as u64));
        writer.append(&block(1 + 3 * blocks..4 + 3 * blocks)).unwrap();
        writer.finish().unwrap();
        let recording = Recording::read(&folder.file()).unwrap();
        assert_eq!(ticks(&recording), (1..4 + 3 * blocks).collect::<Vec<_>>());
        assert_eq!(recording.session["case"], judged()["case"]);
        let bytes = std::fs::read(folder.file()).unwrap();
        assert_eq!(
            (places(&bytes, WEIGHT).len(), places(&bytes, OTHER).len()),
            (copies, 1),
            "what is damaged is not written again"
        );
        assert_eq!(outline(&folder.file()).unwrap().map(|outline| outline.last_tick), Some(3 + 3 * blocks));
    }
}

#[test]
fn a_recording_of_the_version_before_whose_facts_had_no_checksum_is_read_as_ever() {
    let (mut bytes, ..) = written("facts-before", &[block(1..4)]);
    for at in places(&bytes, b"format\x01\0\0\x005") {
        bytes[at + 10] = b'4';
    }
    for at in places(&bytes, b"\x03\0\0\0crc\x08") {
        bytes[at + 4] = b'C';
    }
    let recording = Recording::collect(open(&bytes).unwrap()).unwrap();
    assert_eq!((ticks(&recording), &recording.session["format"][..]), (vec![1, 2, 3], "4"));
    assert_eq!((recording.damage.len(), &recording.session["case"]), (0, &judged()["case"]));
}
