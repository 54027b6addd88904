//! What a tissue state holds, and what a sound one is.

use crate::body::{Body, COUNTS, version_of};
use crate::contacts::Stuck;
use crate::grasp;
use crate::knife::most_stroke_bytes;
use crate::world::World;
use bytemuck::{Pod, Zeroable};
use hyst_contact::Memory;
use hyst_messages::stream::message_bytes;
use hyst_messages::{MAX_FLOW_M_S, MAX_PIECES, Message, PieceFlow, Pose, Refusal, fnv_words};
use hyst_tissue::Seat;

/// No node of a patient's organ is farther from the pivot, m.
pub const FARTHEST_M: f32 = 10.0;
/// And none is faster, m/s.
const MOST_M_S: f32 = 1_000.0;

/// First section of a tissue state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Core {
    /// The tool in the step that made the state.
    pub pose: Pose,
    /// Velocity of its tip, m/s.
    pub velocity_m_s: [f32; 3],
    /// Force of the tissue on it, N.
    pub force_n: [f32; 3],
    /// Removed so far, ml.
    pub removed_volume_ml: f64,
    /// The largest piece of it that came free by one cut so far, ml.
    pub largest_piece_ml: f64,
    /// Taken off other tissue so far, ml.
    pub healthy_removed_ml: f64,
    /// What has left through the outflow so far, ml.
    pub washed_out_ml: f64,
    /// What was taken out in the jaws so far, ml.
    pub taken_out_ml: f64,
    /// Pressure in the cavity to be used by the next step, Pa.
    pub pressure_pa: f32,
    /// Contacts in the step.
    pub contact_count: u32,
    /// Sweeps of the electrode that changed the mesh, so far.
    pub cuts: u32,
    /// 1 while a stroke is under way.
    pub is_cutting: u32,
    /// How far the loop is out where it is solid, m; 0 in its sheath, and while it cuts. Of jaws how far they are apart.
    pub loop_m: f32,
    /// Pieces that have left through the outflow, so far.
    pub washed_out: u32,
    /// Points that the jaws hold.
    pub held: u32,
    /// Pieces that were taken out in the jaws, so far.
    pub taken_out: u32,
    /// How far the jaws were apart when they took hold, m, which they are at least until they have opened so far again; 0 of such that have. Of a loop how much
    /// less deep than a cold one it is pushed out from, because it cuts or has just cut.
    pub hold_m: f32,
    /// Sweeps of the electrode that met a limit of the mesh or were refused, so far.
    pub cut_limits: u32,
    /// What the steps had to mend so far.
    pub corrections: u32,
    /// How far the cavity is closed, 0 to 1, to be used by the next step.
    pub closed: f32,
    /// The flow at free pieces to be used by the next step.
    pub pieces: [PieceFlow; MAX_PIECES],
}

impl Core {
    /// Whether what counts and what the next step uses of it are numbers that can be.
    pub fn is_sane(&self) -> bool {
        let mut speeds = self.pieces.iter().flat_map(|flow| flow.velocity_m_s);
        let [removed_ml, healthy_ml] = [self.removed_volume_ml, self.healthy_removed_ml];
        let volumes_ml = [removed_ml, self.largest_piece_ml, healthy_ml, self.washed_out_ml, self.taken_out_ml];
        let volumes_ml = volumes_ml.map(|volume_ml| volume_ml as f32);
        let numbers = [self.pressure_pa, self.loop_m, self.hold_m];
        let mut all = self.velocity_m_s.iter().chain(&self.force_n).chain(&numbers).chain(&volumes_ml);
        let is_closed_by = (0.0..=1.0).contains(&self.closed);
        is_closed_by
            && self.pose.is_finite()
            && all.all(|number| number.is_finite())
            && speeds.all(|speed| speed.abs() <= MAX_FLOW_M_S)
    }
}

/// Sections of a tissue state, in order: core, positions, velocities, surface vertices, memory of the tool's points, body, stroke, what the jaws hold, what the
/// nodes stick to.
pub const SECTIONS: usize = 9;
/// The body's.
pub const BODY: usize = 5;
/// The stroke's.
pub const STROKE: usize = 6;
/// That of what the jaws hold.
pub const GRASP: usize = 7;
/// That of what the nodes stick to.
pub const STUCK: usize = 8;

/// Bytes of each section of a state of a world.
pub fn sections(world: &World, stroke: usize) -> [usize; SECTIONS] {
    let (nodes, vertices) = (world.model.node_count(), world.body.skin.rest_m.len());
    of_counts(world, nodes, vertices, world.words.len(), stroke)
}

fn of_counts(world: &World, nodes: usize, vertices: usize, words: usize, stroke: usize) -> [usize; SECTIONS] {
    let memory = world.case.tool.points_m.len() * size_of::<Memory>();
    let grasp = grasp::most_bytes(&world.case.tool);
    [size_of::<Core>(), nodes * 12, nodes * 12, vertices * 12, memory, words * 4, stroke, grasp, nodes * size_of::<Stuck>()]
}

/// Bytes of the greatest state that can come of a world.
pub fn most_bytes(world: &World) -> usize {
    let room = &world.case.room;
    message_bytes(&of_counts(world, room.nodes, room.vertices, room.words(), most_stroke_bytes(room)))
}

/// What the nodes of a state stick to: nothing, where an engine in this one's place does not know.
pub fn stuck_of<'a>(message: &Message<'a>) -> &'a [Stuck] {
    message.section(STUCK).unwrap_or(&[])
}

/// Bytes that are compared at once before they are written.
const PIECE: usize = 4096;

/// Writes the words of a body into its section. The few blocks that are lent by turns hold it from some steps before, at the same place unless something was
/// cut: what is there already is compared, which writes no memory. Whatever lay there, it is the body then.
///
/// # Panics
/// If the section has another length.
pub fn write_body(words: &[u32], section: &mut [u8]) {
    let bytes: &[u8] = bytemuck::cast_slice(words);
    assert_eq!(bytes.len(), section.len(), "the section of a body");
    for (to, from) in section.chunks_mut(PIECE).zip(bytes.chunks(PIECE)) {
        if to != from {
            to.copy_from_slice(from);
        }
    }
}

/// Whether all sections are there and fit each other, the body is that of the world or else one that a world can be made of, and the numbers are
/// those of an organ.
pub fn is_sound(message: &Message<'_>, world: &World) -> bool {
    flaw_of(message, world).is_none()
}

/// What is wrong with a state that is not sound.
pub fn flaw_of(message: &Message<'_>, world: &World) -> Option<Refusal> {
    let (Ok(words), Ok(stroke)) = (message.section::<u32>(BODY), message.section::<u8>(STROKE)) else {
        return Some(Refusal::Sections);
    };
    let version = message.header().topology_version;
    let is_known = version == world.version;
    let is_named = if is_known { words == &world.words[..] } else { version_of(words) == version };
    if !is_named {
        return Some(Refusal::Version);
    }
    if !is_known && Body::unpack(words, &world.case.room).is_none() {
        return Some(Refusal::Mesh);
    }
    flaw_of_parts(message, world, words, stroke)
}

/// The same for a state of the world that this thread has just written itself. Of the body only the counts are looked at: the rest, most of the state, was
/// copied from the world, and by that alone this thread goes on. One that the role was founded with may be of another mesh: of that nothing is known.
pub fn is_sound_own(message: &Message<'_>, world: &World) -> bool {
    if message.header().topology_version != world.version {
        return is_sound(message, world);
    }
    let (Ok(words), Ok(stroke)) = (message.section::<u32>(BODY), message.section::<u8>(STROKE)) else { return false };
    let is_of_world = words.len() == world.words.len() && words.get(..COUNTS) == world.words.get(..COUNTS);
    is_of_world && flaw_of_parts(message, world, words, stroke).is_none()
}

/// Whether all sections fit a body of these words, and the numbers are those of an organ; what does not, and are not.
fn flaw_of_parts(message: &Message<'_>, world: &World, words: &[u32], stroke: &[u8]) -> Option<Refusal> {
    let (nodes, vertices) = (words[0] as usize, words[2] as usize);
    let sizes = of_counts(world, nodes, vertices, words.len(), stroke.len());
    // An engine in this one's place may not know what the nodes stick to.
    let is_left_out = |index: usize| index == STUCK && message.header().sections as usize == STUCK;
    let fits = |index: usize| message.section::<u8>(index).map_or(is_left_out(index), |bytes| bytes.len() == sizes[index]);
    let is_stroke = stroke.is_empty() || stroke.len().checked_sub(nodes * 12).is_some_and(|seats| seats % size_of::<Seat>() == 0);
    // Without an early end, so that it is a few instructions for each line of memory.
    let within = |index: usize, most: f32| {
        let numbers: &[f32] = message.section(index).unwrap_or(&[]);
        numbers.iter().fold(true, |all, value| all & (value.abs() <= most))
    };
    match () {
        () if !((0..SECTIONS).all(fits) && is_stroke) => Some(Refusal::Sections),
        () if !(within(1, FARTHEST_M) && within(2, MOST_M_S)) => Some(Refusal::Numbers),
        () => None,
    }
}

/// Hash of what the next step depends on: positions and velocities, and of what they are the nodes. What the tool's points remember, and what the nodes stick to,
/// shows in them a step later.
pub fn hash(message: &Message<'_>) -> u64 {
    let words = |index: usize| message.section::<u32>(index).unwrap_or(&[]).iter().map(|word| *word as u64);
    let version = u64::from(message.header().topology_version);
    fnv_words(message.header().tick, words(1).chain(words(2)).chain([version]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{Kind, contents};

    #[test]
    fn the_records_of_a_state_are_those_that_the_documents_say() {
        let (point, word) = (size_of::<[f32; 3]>(), size_of::<u32>());
        let (memory, grip, stuck) = (size_of::<Memory>(), size_of::<grasp::Grip>(), size_of::<Stuck>());
        let records: [usize; SECTIONS] = [size_of::<Core>(), point, point, point, memory, word, word, grip, stuck];
        assert_eq!(contents::record_bytes(Kind::TissueState), records);
        assert_eq!(contents::record_bytes(Kind::Topology).len(), crate::clerk::SECTIONS);
    }

    #[test]
    fn a_core_with_a_number_that_is_none_is_not_sane_wherever_it_is() {
        assert!(Core::default().is_sane());
        type Spoil = fn(&mut Core);
        let spoilt: [(&str, Spoil); 18] = [
            ("position", |core| core.pose.position_m[2] = f32::NAN),
            ("orientation", |core| core.pose.orientation[3] = f32::INFINITY),
            ("insertion", |core| core.pose.insertion_m = f32::NAN),
            ("camera", |core| core.pose.camera_roll_rad = f32::NAN),
            ("velocity", |core| core.velocity_m_s[0] = f32::NAN),
            ("force", |core| core.force_n[1] = f32::NEG_INFINITY),
            ("removed", |core| core.removed_volume_ml = f64::NAN),
            ("largest", |core| core.largest_piece_ml = f64::NAN),
            ("healthy", |core| core.healthy_removed_ml = f64::INFINITY),
            ("washed out", |core| core.washed_out_ml = f64::NAN),
            ("taken out", |core| core.taken_out_ml = f64::INFINITY),
            ("pressure", |core| core.pressure_pa = f32::NAN),
            ("loop", |core| core.loop_m = f32::NAN),
            ("hold", |core| core.hold_m = f32::NAN),
            ("closed", |core| core.closed = f32::NAN),
            ("closed beyond", |core| core.closed = 1.5),
            ("flow", |core| core.pieces[7].velocity_m_s[2] = f32::NAN),
            ("wild flow", |core| core.pieces[0].velocity_m_s[0] = 2.0 * MAX_FLOW_M_S),
        ];
        for (what, spoil) in spoilt {
            let mut core = Core::default();
            spoil(&mut core);
            assert!(!core.is_sane(), "{what}");
        }
    }

    #[test]
    fn a_body_is_written_as_it_is_whatever_lay_in_its_place() {
        let words: Vec<u32> = (0..2_500).map(|word: u32| word.wrapping_mul(2_654_435_761)).collect();
        let body: Vec<u8> = bytemuck::cast_slice(&words).to_vec();
        let mut last_piece = body.clone();
        last_piece[9_999] ^= 1;
        let shifted = [&body[64..], &body[..64]].concat();
        let corrupt: Vec<u8> = body.iter().enumerate().map(|(at, byte)| byte ^ u8::from(at % 3_000 == 17)).collect();
        for mut lies in [vec![0; body.len()], vec![0xAA; body.len()], body.clone(), last_piece, shifted, corrupt] {
            write_body(&words, &mut lies);
            assert!(lies == body);
        }
        write_body(&[], &mut []);
    }
}
