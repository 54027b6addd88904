//! The framing of a stream message: one header, a table of sections, and the sections themselves, all in one block of shared
//! memory that is written in place and read in place. Sections start on 64-byte borders.
//!
//! Promise: [`Message::parse`] checks kind, layout, length and every section before anything is read through it.

use crate::Role;
use bytemuck::{AnyBitPattern, NoUninit, Pod, Zeroable};

pub use crate::looks::{AppearanceRecord, ScopeRecord};
pub use crate::object::{ObjectKind, ObjectRecord};

/// Most sections in one message.
pub const MAX_SECTIONS: usize = 12;
/// Most of a [`Kind::Picture`], px: it is made and read on the cores of the engines.
pub const MOST_PICTURE_PX: [u32; 2] = [400, 300];
const ALIGNMENT: usize = 64;

/// What a message carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Nodes, velocities and surface vertices of all deformable objects.
    TissueState = 1,
    /// Objects, tets, triangles and bindings; sent on change and by every new owner.
    Topology = 2,
    /// Points, positions and the spatial hash of one tick, for the collision workers.
    CollisionJob = 3,
    /// One share of the hits of one tick.
    Contacts = 4,
    /// State of the Flow Engine.
    FluidState = 5,
    /// Force and tool records of some ticks.
    Force = 6,
    /// Request for the appearance of the objects.
    AppearanceRequest = 7,
    /// The appearance of the objects.
    Appearance = 8,
    /// A small picture of what rendering shows, while somebody looks: rows from the top, 3 bytes for a pixel (RGB, gamma 2.2).
    Picture = 9,
}

impl Kind {
    /// The last part of the stream's name.
    pub const fn name(self) -> &'static str {
        match self {
            Kind::TissueState | Kind::FluidState => "state",
            Kind::Topology => "topology",
            Kind::CollisionJob => "job",
            Kind::Contacts => "contacts",
            Kind::Force => "force",
            Kind::AppearanceRequest | Kind::Appearance => "appearance",
            Kind::Picture => "picture",
        }
    }
}

/// What an incarnation of a role offers, all of it made before its process starts: streams, and [`Kind::Appearance`], a rendezvous.
pub const fn kinds_of(role: Role) -> &'static [Kind] {
    match role {
        Role::Tissue => &[Kind::TissueState, Kind::Topology, Kind::CollisionJob, Kind::Appearance],
        Role::CollisionWorker => &[Kind::Contacts],
        Role::Fluid => &[Kind::FluidState],
        Role::Haptic => &[Kind::Force],
        Role::Rendering => &[Kind::Picture],
        _ => &[],
    }
}

/// First bytes of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct StreamHeader {
    /// A [`Kind`].
    pub kind: u32,
    /// Sections in use.
    pub sections: u32,
    /// [`crate::layout_hash`] of the writer.
    pub layout: u64,
    /// Epoch of the writer.
    pub epoch: u32,
    /// Incarnation of the writer.
    pub incarnation: u32,
    /// Tick that the content describes.
    pub tick: u64,
    /// Tick of the newest input that it was computed from.
    pub input_tick: u64,
    /// Names the topology that it belongs to: equal versions, equal meshes.
    pub topology_version: u32,
    /// Step of the writer in ticks.
    pub step_ticks: u32,
    /// Two words that the kind defines. Contacts: index and count of the share. Collision job: count of shares, and the incarnation that
    /// wrote the state it is about (whose epoch is in `input_tick`). Picture: width and height, px.
    pub words: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Section {
    offset: u32,
    length: u32,
}

const TABLE: usize = size_of::<StreamHeader>();
const BODY: usize = round_up(TABLE + MAX_SECTIONS * size_of::<Section>());

const fn round_up(bytes: usize) -> usize {
    bytes.div_ceil(ALIGNMENT) * ALIGNMENT
}

/// Why a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Fewer bytes than a header.
    #[error("message of {0} bytes is shorter than a header; the writer is broken and must be restarted")]
    Short(usize),
    /// Another kind of message.
    #[error("message of kind {found} where kind {expected} was expected")]
    Kind {
        /// What was found.
        found: u32,
        /// What was expected.
        expected: u32,
    },
    /// Written by a binary with other layouts.
    #[error("message has layout {0:#x}, this binary has {1:#x}; rebuild both from one source")]
    Layout(u64, u64),
    /// A section is missing, out of range or not a whole number of elements.
    #[error("section {0} of the message is missing, out of range or misaligned")]
    Section(usize),
    /// The block cannot hold the sections.
    #[error("the sections need {need} bytes, the block has {have}")]
    Space {
        /// Bytes needed.
        need: usize,
        /// Bytes there.
        have: usize,
    },
}

/// Bytes of a message with sections of these lengths (bytes).
pub fn message_bytes(sections: &[usize]) -> usize {
    sections.iter().fold(BODY, |at, length| round_up(at + length))
}

/// A message that is read in place.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    header: StreamHeader,
    bytes: &'a [u8],
}

impl<'a> Message<'a> {
    /// Checks the frame and every section's range.
    pub fn parse(bytes: &'a [u8], kind: Kind) -> Result<Message<'a>, WireError> {
        if bytes.len() < BODY {
            return Err(WireError::Short(bytes.len()));
        }
        let header: StreamHeader = bytemuck::pod_read_unaligned(&bytes[..TABLE]);
        if header.kind != kind as u32 {
            return Err(WireError::Kind { found: header.kind, expected: kind as u32 });
        }
        if header.layout != crate::layout_hash() {
            return Err(WireError::Layout(header.layout, crate::layout_hash()));
        }
        if header.sections as usize > MAX_SECTIONS {
            return Err(WireError::Section(header.sections as usize));
        }
        let message = Message { header, bytes };
        for index in 0..header.sections as usize {
            message.section_bytes(index)?;
        }
        Ok(message)
    }

    /// The topology of a version, if that is what these bytes are.
    pub fn topology(bytes: &'a [u8], version: u32) -> Option<Message<'a>> {
        Message::parse(bytes, Kind::Topology).ok().filter(|message| message.header.topology_version == version)
    }

    /// The header.
    pub fn header(&self) -> &StreamHeader {
        &self.header
    }

    fn section_bytes(&self, index: usize) -> Result<&'a [u8], WireError> {
        if index >= self.header.sections as usize {
            return Err(WireError::Section(index));
        }
        let at = TABLE + index * size_of::<Section>();
        let section: Section = bytemuck::pod_read_unaligned(&self.bytes[at..at + size_of::<Section>()]);
        let (start, length) = (section.offset as usize, section.length as usize);
        if start < BODY {
            return Err(WireError::Section(index));
        }
        self.bytes.get(start..start.saturating_add(length)).ok_or(WireError::Section(index))
    }

    /// Section `index` as a slice of `T`, in place.
    pub fn section<T: AnyBitPattern>(&self, index: usize) -> Result<&'a [T], WireError> {
        bytemuck::try_cast_slice(self.section_bytes(index)?).map_err(|_| WireError::Section(index))
    }

    /// The first element of section `index`, copied.
    pub fn record<T: AnyBitPattern>(&self, index: usize) -> Result<T, WireError> {
        self.section::<T>(index)?.first().copied().ok_or(WireError::Section(index))
    }
}

/// A message that is written in place.
#[derive(Debug)]
pub struct MessageMut<'a> {
    bytes: &'a mut [u8],
    ranges: [(usize, usize); MAX_SECTIONS],
    sections: usize,
}

impl<'a> MessageMut<'a> {
    /// Writes header and section table into `bytes`, and zeros into everything that belongs to no section, so that messages of equal content
    /// have equal bytes, whatever lay there. The sections keep what is there: whoever formats a message writes each of them in full.
    pub fn format(
        bytes: &'a mut [u8],
        kind: Kind,
        mut header: StreamHeader,
        sections: &[usize],
    ) -> Result<MessageMut<'a>, WireError> {
        let need = message_bytes(sections);
        if sections.len() > MAX_SECTIONS || bytes.len() < need || need > u32::MAX as usize {
            return Err(WireError::Space { need, have: bytes.len() });
        }
        header.kind = kind as u32;
        header.sections = sections.len() as u32;
        header.layout = crate::layout_hash();
        bytes[..TABLE].copy_from_slice(bytemuck::bytes_of(&header));
        let mut ranges = [(0, 0); MAX_SECTIONS];
        bytes[TABLE + sections.len() * size_of::<Section>()..BODY].fill(0);
        let mut at = BODY;
        for (index, &length) in sections.iter().enumerate() {
            let entry = Section { offset: at as u32, length: length as u32 };
            let place = TABLE + index * size_of::<Section>();
            bytes[place..place + size_of::<Section>()].copy_from_slice(bytemuck::bytes_of(&entry));
            ranges[index] = (at, at + length);
            let next = round_up(at + length);
            bytes[at + length..next].fill(0);
            at = next;
        }
        bytes[at..].fill(0);
        Ok(MessageMut { bytes, ranges, sections: sections.len() })
    }

    /// Section `index` as a slice of `T`.
    pub fn section<T: NoUninit + AnyBitPattern>(&mut self, index: usize) -> Result<&mut [T], WireError> {
        let (start, end) = self.ranges[index.min(MAX_SECTIONS - 1)];
        if index >= self.sections {
            return Err(WireError::Section(index));
        }
        bytemuck::try_cast_slice_mut(&mut self.bytes[start..end]).map_err(|_| WireError::Section(index))
    }

    /// Splits into the byte slices of all sections, so that several can be written at once.
    pub fn split(self) -> [&'a mut [u8]; MAX_SECTIONS] {
        let mut parts: [&'a mut [u8]; MAX_SECTIONS] = Default::default();
        let mut rest = self.bytes;
        let mut consumed = 0;
        for (part, &(start, end)) in parts.iter_mut().zip(&self.ranges[..self.sections]) {
            let (_, tail) = rest.split_at_mut(start - consumed);
            let (section, tail) = tail.split_at_mut(end - start);
            *part = section;
            rest = tail;
            consumed = end;
        }
        parts
    }
}

/// Changes the header of a message in place, after its sections were written. A block too short for a header stays as it is.
pub fn change_header(bytes: &mut [u8], change: impl FnOnce(&mut StreamHeader)) {
    let Some(place) = bytes.get_mut(..TABLE) else { return };
    let mut header: StreamHeader = bytemuck::pod_read_unaligned(place);
    change(&mut header);
    place.copy_from_slice(bytemuck::bytes_of(&header));
}

/// The kind that a message says it is.
pub fn kind_of(bytes: &[u8]) -> Option<Kind> {
    const KINDS: [Kind; 9] = [
        Kind::TissueState,
        Kind::Topology,
        Kind::CollisionJob,
        Kind::Contacts,
        Kind::FluidState,
        Kind::Force,
        Kind::AppearanceRequest,
        Kind::Appearance,
        Kind::Picture,
    ];
    let header: StreamHeader = bytemuck::pod_read_unaligned(bytes.get(..TABLE)?);
    KINDS.into_iter().find(|kind| *kind as u32 == header.kind)
}

/// The bytes of a message that was kept as words.
pub fn bytes_of_words(words: &[u64]) -> &[u8] {
    bytemuck::cast_slice(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(bytes: usize) -> Vec<u64> {
        vec![0u64; bytes.div_ceil(8)]
    }

    #[test]
    fn what_is_written_in_place_is_read_in_place() {
        let sections = [24, 0, 16];
        let mut memory = block(message_bytes(&sections));
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let header = StreamHeader { tick: 7, epoch: 3, ..Default::default() };
        let mut message = MessageMut::format(bytes, Kind::TissueState, header, &sections).unwrap();
        message.section::<f32>(0).unwrap().copy_from_slice(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let parts = message.split();
        parts[2].fill(9);
        change_header(bytemuck::cast_slice_mut(&mut memory), |header| header.input_tick = 6);
        assert_eq!(kind_of(bytemuck::cast_slice(&memory)), Some(Kind::TissueState));
        let bytes: &[u8] = bytemuck::cast_slice(&memory);
        let read = Message::parse(bytes, Kind::TissueState).unwrap();
        assert_eq!(read.section::<[f32; 3]>(0).unwrap(), &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(read.section::<u8>(2).unwrap(), &[9; 16]);
        assert_eq!((read.header().tick, read.header().input_tick), (7, 6));
        assert_eq!(read.section::<u8>(3), Err(WireError::Section(3)));
    }

    /// A loan holds what an older message left there.
    #[test]
    fn messages_of_equal_content_have_equal_bytes_whatever_lay_in_the_block() {
        for sections in [&[24, 0, 16][..], &[1, 63, 64, 65], &[]] {
            let written = [0u64, u64::MAX, 0xAAAA_AAAA_AAAA_AAAA].map(|left| {
                let mut memory = vec![left; message_bytes(sections) / 8 + 5];
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
                let header = StreamHeader { tick: 7, ..Default::default() };
                let parts = MessageMut::format(bytes, Kind::TissueState, header, sections).unwrap().split();
                parts.into_iter().for_each(|part| part.fill(9));
                memory
            });
            assert!(written[0] == written[1] && written[0] == written[2], "sections of {sections:?} bytes");
        }
    }

    #[test]
    fn a_damaged_message_is_refused_wherever_it_is_damaged() {
        let sections = [24, 16];
        let mut memory = block(message_bytes(&sections));
        MessageMut::format(bytemuck::cast_slice_mut(&mut memory), Kind::Force, StreamHeader::default(), &sections).unwrap();
        let good: Vec<u8> = bytemuck::cast_slice(&memory).to_vec();
        for length in 0..BODY + 1 {
            assert!(Message::parse(&good[..length], Kind::Force).is_err());
        }
        let mut refused = 0;
        for at in 0..BODY {
            for bit in 0..8 {
                let mut bad = memory.clone();
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut bad);
                bytes[at] ^= 1 << bit;
                if let Ok(message) = Message::parse(bytes, Kind::Force) {
                    let _ = message.section::<u64>(0); // never a panic
                } else {
                    refused += 1;
                }
            }
        }
        assert!(refused > 100);
        assert!(matches!(Message::parse(&good, Kind::Contacts), Err(WireError::Kind { .. })));
    }
}
