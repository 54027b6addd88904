//! What the messages and the cells of the pages hold, as docs/messages.md says it, which is written from here: for whoever makes an engine of one's own.
//! Tests beside the code that writes and reads them compare it with what is there.

use crate::stream::{AppearanceRecord, ObjectRecord, ScopeRecord};
use crate::{AppliedRecord, Kind, Message, Role, SealRecord};

/// One section of a message: so many records, one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Section {
    /// The type of a record in Rust; where it is no number or row of numbers, a struct of `source`.
    pub record: &'static str,
    /// File of that struct, from the top of the sources; empty for numbers.
    pub source: &'static str,
    /// Bytes of a record.
    pub bytes: usize,
    /// How many there are; sections of a message with the same words have the same number.
    pub count: &'static str,
    /// What they are, with units.
    pub what: &'static str,
}

/// One kind of message.
#[derive(Clone, Copy, Debug)]
pub struct Content {
    /// The kind. Who offers it is said by [`crate::kinds_of`].
    pub kind: Kind,
    /// When one is sent.
    pub when: &'static str,
    /// Words of its header that mean something here, beside tick, epoch and incarnation.
    pub header: &'static str,
    /// Roles that ask their usher for it. A role with a state also follows its own, and the judge of a swap reads what it judges.
    pub readers: &'static [Role],
    /// What a reader does not take.
    pub refused: &'static str,
    /// Its sections, in order.
    pub sections: &'static [Section],
    /// So many of them at least.
    pub least: usize,
}

/// One cell or ring of a page.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// Whose page it is in; that role alone writes it.
    pub role: Role,
    /// Its name in [`crate::page`].
    pub name: &'static str,
    /// When it is written.
    pub when: &'static str,
    /// Who reads it.
    pub readers: &'static [Role],
    /// What a reader does not take; empty where it is shown and nothing depends on it.
    pub refused: &'static str,
}

const fn numbers(record: &'static str, bytes: usize, count: &'static str, what: &'static str) -> Section {
    Section { record, source: "", bytes, count, what }
}

const fn records(record: &'static str, source: &'static str, bytes: usize, count: &'static str, what: &'static str) -> Section {
    Section { record, source, bytes, count, what }
}

const POINT: &str = "[f32; 3]";
const INDEX: &str = "u32";
const STATE_OF_TISSUE: &str = "processes/tissue/src/state.rs";
const RECORDS: &str = "shared/messages/src/record.rs";

/// All kinds of messages, in the order of [`Kind`]; the request for an appearance may be any bytes.
pub static CONTENTS: [Content; 8] = [
    Content {
        kind: Kind::TissueState,
        when: "each step, of 1, 2 or 4 ticks; by holder, spare (a step that is missing) and a newcomer on trial",
        header: "input_tick: the input record it was made from; topology_version: hash of section 5; step_ticks",
        readers: &[Role::Fluid, Role::Rendering, Role::CollisionWorker],
        refused: "another layout, an epoch that nobody has won, a tick that is not there yet; by the next tissue also: sections whose lengths do not fit \
                  section 5, a node beyond 10 m or faster than 1000 m/s, a pose that is not that of the input it names. Section 8 may be left out",
        sections: &[
            records("Core", STATE_OF_TISSUE, 288, "1", "the tool in the step, what was removed, cut and held so far"),
            numbers(POINT, 12, "nodes", "positions, m"),
            numbers(POINT, 12, "nodes", "velocities, m/s"),
            numbers(POINT, 12, "surface vertices", "the surface for the eye, m"),
            records(
                "Memory",
                "shared/contact/src/penetrate_data.rs",
                32,
                "points of the tool",
                "where each came out of the tissue before, and how far it has gone from what it sticks to",
            ),
            numbers(INDEX, 4, "words of the body", "the mesh: what processes/tissue/src/body.rs packs"),
            numbers(
                INDEX,
                4,
                "words of the stroke",
                "the wire's way while it cuts: nothing, or what processes/tissue/src/knife.rs writes",
            ),
            records(
                "Grip",
                "processes/tissue/src/grasp.rs",
                36,
                "points between the jaws",
                "what they hold, or held and have not let out yet",
            ),
            records(
                "Stuck",
                "processes/tissue/src/contacts/stuck.rs",
                28,
                "nodes",
                "the tissue that each is pressed on, the way along it to what it sticks to, m, and the way back out of it",
            ),
        ],
        least: 8,
    },
    Content {
        kind: Kind::Topology,
        when: "on change, within some ms, and to each newcomer",
        header: "topology_version: that of the states it belongs to; tick and epoch are 0",
        readers: &[Role::Fluid, Role::Rendering, Role::CollisionWorker],
        refused: "a version that is not the state's; by rendering also: indices out of range, numbers that are none, lengths that differ",
        sections: &[
            records(
                "ObjectRecord",
                "shared/messages/src/object.rs",
                size_of::<ObjectRecord>(),
                "objects",
                "organs, what is to be removed, pieces, tools",
            ),
            numbers("[u32; 4]", 16, "tets", "nodes of each"),
            numbers(INDEX, 4, "tets", "the object that each belongs to"),
            numbers("[u32; 3]", 12, "triangles", "surface vertices of each"),
            numbers(POINT, 12, "surface vertices", "the surface at rest, m"),
            numbers("[u32; 3]", 12, "triangles of the wall", "nodes of each, of the cavity's wall"),
            numbers(INDEX, 4, "surface vertices", "1 on a wound, else 0"),
            numbers(POINT, 12, "nodes", "positions at rest, m"),
            numbers(
                POINT,
                12,
                "vertices of the instrument",
                "shaft, then jaw, m, in the scope's frame; none without surfaces from files",
            ),
            numbers("[u32; 3]", 12, "triangles of the instrument", "vertices of each"),
            numbers(INDEX, 4, "2", "vertices and triangles of the shaft"),
        ],
        least: 11,
    },
    Content {
        kind: Kind::CollisionJob,
        when: "each step of the holder in which the workers are asked",
        header: "words: count of shares, incarnation that wrote the state it is about; input_tick: the epoch of that state",
        readers: &[Role::CollisionWorker],
        refused: "one without the state and the topology that it is about: the share is answered with nothing, and computed by the tissue",
        sections: &[
            numbers(POINT, 12, "points", "of tool and tissue that may meet tissue, m"),
            numbers(INDEX, 4, "words of the hash", "the spatial hash of the points: shared/contact/src/hash_read.rs"),
            numbers(INDEX, 4, "points", "the object that each belongs to"),
            numbers(INDEX, 4, "points", "the node that each is; all bits set for none"),
            numbers(
                INDEX,
                4,
                "2",
                "first point that meets its own object alone, and from which distance at rest on, the bits of an f32, m",
            ),
        ],
        least: 5,
    },
    Content {
        kind: Kind::Contacts,
        when: "at each release by the tissue's Meeting Point",
        header: "tick and epoch of the job; words: index and count of the share; as count 0 where what the job is about has not come, u32::MAX for too many hits",
        readers: &[Role::Tissue],
        refused: "another tick, epoch, share or job; a hit that is not true to the last bit, a share that leaves one out",
        sections: &[
            records(
                "Hit",
                "shared/contact/src/types.rs",
                24,
                "hits",
                "point, tet and weights of each, in the order of shared/contact's intersect",
            ),
            numbers("u64", 8, "1", "the job: messages::job_hash of its section 0"),
        ],
        least: 2,
    },
    Content {
        kind: Kind::FluidState,
        when: "each step, by default of 33 ticks, more where the machine affords no more; by whom, as of the tissue's",
        header: "step_ticks; input_tick: the tissue's state that its walls are of",
        readers: &[Role::Rendering],
        refused: "as of the tissue's; by the next fluid also: another grid, a number that is none, a status of another tick. Sections 3 and 4 may be left out",
        sections: &[
            records("Head", "processes/fluid/src/status.rs", 272, "1", "FluidStatus, which the judge reads, then the grid"),
            numbers("u8", 1, "bytes of the solver", "the engine's own; of hyst-flow, a StateView"),
            numbers("f32", 4, "cells", "share of blood in the medium, 0 to 1, x fastest"),
            records("Particle", "shared/flow/src/blood.rs", 16, "256", "parcels of gas: place, m, and volume, ml"),
            records(
                "SealRecord",
                "shared/messages/src/fluid.rs",
                size_of::<SealRecord>(),
                "64",
                "vessels that are coagulated; share 0 is a free place",
            ),
        ],
        least: 3,
    },
    Content {
        kind: Kind::Force,
        when: "every 20 ms, by both servos, on an ordinary thread",
        header: "tick: that of the first record",
        readers: &[Role::Recorder],
        refused: "nothing but the frame; a record with tick 0 is passed over, and each tick is taken once",
        sections: &[records(
            "AppliedRecord",
            RECORDS,
            size_of::<AppliedRecord>(),
            "ticks",
            "what the device's ring holds of each",
        )],
        least: 1,
    },
    Content {
        kind: Kind::Appearance,
        when: "on request, by rendezvous: the bytes alone, without a header and a table",
        header: "none",
        readers: &[Role::Rendering],
        refused: "a length that is none, more than 272 objects, a scope out of bounds: the usual looks are drawn. Objects of another \
                  topology_version than is shown, where one is said: asked again",
        sections: &[
            records("ScopeRecord", "shared/messages/src/looks.rs", size_of::<ScopeRecord>(), "1", "what the scope sees"),
            records(
                "AppearanceRecord",
                "shared/messages/src/looks.rs",
                size_of::<AppearanceRecord>(),
                "objects",
                "the look of each",
            ),
        ],
        least: 2,
    },
    Content {
        kind: Kind::Picture,
        when: "every 200 ms while console or recorder ask for it in their pages, or it is on trial",
        header: "words: width and height, px",
        readers: &[Role::Recorder, Role::Console],
        refused: "a length that is not that of its width and height",
        sections: &[numbers("[u8; 3]", 3, "pixels", "RGB, gamma 2.2, rows from the top; at most 400 x 300")],
        least: 1,
    },
];

/// All cells and rings, in the order of [`crate::page`].
pub static TOLD: [Told; 19] = [
    told(
        Role::Hardware,
        "SAMPLE",
        "1 kHz, by its own clock",
        &[Role::Device, Role::Fluid, Role::Rendering, Role::Console],
        "a pose or controls that cannot be",
    ),
    told(Role::Hardware, "LEDGER", "each of its ticks", &[Role::Supervisor], ""),
    told(Role::Hardware, "REPLAY", "in a replay, each tick", &[Role::Device], ""),
    told(
        Role::Hardware,
        "STATEMENT",
        "once, before the first sample",
        &[Role::Device, Role::Fluid, Role::Recorder],
        "limits that make no sense",
    ),
    told(Role::Device, "INPUT", "1 kHz", &[Role::Haptic, Role::Rendering], ""),
    told(Role::Device, "INPUTS", "1 kHz", &[Role::Hardware, Role::Tissue], "a pose that is no pose"),
    told(Role::Device, "COMMAND", "1 kHz", &[Role::Hardware], "not finite, out of range, of the future, of an older device"),
    told(Role::Device, "APPLIED", "1 kHz", &[Role::Hardware, Role::Haptic, Role::Recorder, Role::Console], ""),
    told(
        Role::Haptic,
        "FORCE",
        "1 kHz, within 0.4 ms of the input",
        &[Role::Device, Role::Supervisor],
        "another tick or input, not finite, out of range; a shadow's",
    ),
    told(Role::Haptic, "FORCES", "1 kHz", &[Role::Device, Role::Haptic], "a state of the servo that is not sane"),
    told(Role::Haptic, "INPUT", "1 kHz", &[Role::Device], "one that is older than its own"),
    told(
        Role::Haptic,
        "ORIGINS",
        "each answer that does not go on from its own of the tick before",
        &[Role::Recorder],
        "a servo that there is not, a state that is not older",
    ),
    told(
        Role::Tissue,
        "MODEL",
        "each step",
        &[Role::Device, Role::Supervisor],
        "an epoch that is over or not won, a tick ahead, another pose than that input's, planes that are none",
    ),
    told(Role::Tissue, "STATUS", "each step", &[Role::Rendering, Role::Recorder, Role::Console, Role::Supervisor], ""),
    told(Role::Tissue, "STEPS", "each step that counts", &[Role::Recorder], ""),
    told(
        Role::Fluid,
        "STATUS",
        "each step",
        &[Role::Hardware, Role::Device, Role::Fluid, Role::Rendering, Role::Recorder, Role::Console, Role::Supervisor],
        "by the device: as the tissue's model; pressure, flow or force out of range",
    ),
    told(Role::Rendering, "POINTER", "100 Hz, of a window alone", &[Role::Hardware], ""),
    told(
        Role::Rendering,
        "STATUS",
        "each picture",
        &[Role::Console, Role::Supervisor],
        "on trial: no picture, none that shows what is new",
    ),
    told(
        Role::Recorder,
        "STATUS",
        "each block on disk",
        &[Role::Hardware, Role::Supervisor],
        "on trial: a tick that is not there yet or that cannot be read of the file, more bytes than the file has",
    ),
];

const fn told(role: Role, name: &'static str, when: &'static str, readers: &'static [Role], refused: &'static str) -> Told {
    Told { role, name, when, readers, refused }
}

/// What a kind holds; `None` for the request for an appearance.
pub fn content(kind: Kind) -> Option<&'static Content> {
    CONTENTS.iter().find(|content| content.kind == kind)
}

/// Bytes of a record of each section of a kind, in order.
pub fn record_bytes(kind: Kind) -> Vec<usize> {
    content(kind).into_iter().flat_map(|content| content.sections).map(|section| section.bytes).collect()
}

/// Whether a message has the sections that are stated here: as many, each a whole number of records, and as many of them as it says, or as another section
/// that says the same.
///
/// # Errors
/// What is otherwise.
pub fn check(bytes: &[u8], kind: Kind) -> Result<(), String> {
    let content = content(kind).ok_or("a kind that has no sections")?;
    let message = Message::parse(bytes, kind).map_err(|error| error.to_string())?;
    let found = message.header().sections as usize;
    if !(content.least..=content.sections.len()).contains(&found) {
        return Err(format!("{found} sections, where there are {} to {}", content.least, content.sections.len()));
    }
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for (index, section) in content.sections.iter().enumerate().take(found) {
        let length = message.section::<u8>(index).map_err(|error| error.to_string())?.len();
        let count = length / section.bytes;
        let known = counts.iter().find(|(what, _)| *what == section.count).map(|(_, count)| *count);
        let stated = section.count.parse().ok().or(known).unwrap_or(count);
        if !length.is_multiple_of(section.bytes) || count != stated {
            let (bytes, words) = (section.bytes, section.count);
            return Err(format!(
                "section {index} has {length} bytes, where there are {bytes} for each of the {words} ({stated})"
            ));
        }
        counts.push((section.count, count));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{MessageMut, StreamHeader, message_bytes};

    fn said(kind: Kind, sections: &[usize]) -> Result<(), String> {
        let mut memory = vec![0u64; message_bytes(sections).div_ceil(8)];
        MessageMut::format(bytemuck::cast_slice_mut(&mut memory), kind, StreamHeader::default(), sections).unwrap();
        check(bytemuck::cast_slice(&memory), kind)
    }

    #[test]
    fn a_message_is_checked_by_the_number_and_the_lengths_of_its_sections() {
        assert_eq!(said(Kind::Contacts, &[48, 8]), Ok(()));
        assert_eq!(said(Kind::CollisionJob, &[120, 4, 40, 40, 8]), Ok(()));
        let bad: [(Kind, &[usize], &str); 5] = [
            (Kind::Contacts, &[48], "1 sections"),
            (Kind::Contacts, &[48, 8, 8], "3 sections"),
            (Kind::Contacts, &[47, 8], "section 0 has 47 bytes"),
            (Kind::Contacts, &[48, 16], "section 1 has 16 bytes"),
            (Kind::CollisionJob, &[120, 4, 40, 36, 8], "section 3 has 36 bytes"),
        ];
        for (kind, sections, words) in bad {
            assert!(said(kind, sections).is_err_and(|why| why.starts_with(words)), "{sections:?}: {:?}", said(kind, sections));
        }
        assert!(said(Kind::AppearanceRequest, &[]).is_err());
    }
}
