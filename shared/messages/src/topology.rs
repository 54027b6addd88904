//! Whether a topology can be: what everyone asks before he takes one, for what is made of it stands until the next one comes.
//!
//! Promise: of a topology that is sound every tet has its nodes and its owner, every triangle its corners, every object its vertices and triangles, and every place
//! is one where an organ can be. A look at the message alone; it allocates nothing.

use crate::WireError;
use crate::stream::{Kind, Message, ObjectKind, ObjectRecord};

/// Farther from the pivot than any organ or instrument is, m.
const FARTHEST_M: f32 = 10.0;
/// Above any number of an object that is registered with a Site Manager.
const MOST_OBJECTS: u32 = 1 << 16;

/// Whether these bytes are a topology that can be.
pub fn topology_is_sound(bytes: &[u8]) -> bool {
    Message::parse(bytes, Kind::Topology).and_then(|message| is_sound(&message)).unwrap_or(false)
}

fn is_sound(message: &Message<'_>) -> Result<bool, WireError> {
    let objects: &[ObjectRecord] = message.section(0)?;
    let (tets, owners): (&[[u32; 4]], &[u32]) = (message.section(1)?, message.section(2)?);
    let (triangles, surface_m): (&[[u32; 3]], &[[f32; 3]]) = (message.section(3)?, message.section(4)?);
    let (raw, nodes_m): (&[u32], &[[f32; 3]]) = (message.section(6)?, message.section(7)?);
    // An instrument without surfaces from files has none.
    let metal_m: &[[f32; 3]] = message.section(8).unwrap_or(&[]);
    // A session that has used up the room of its surface has triangles that reach from a piece to what it was cut off: the corners are looked at by themselves.
    let has_its_own = |object: &ObjectRecord| {
        object.kind == ObjectKind::Tool as u32
            || range(object.vertices, surface_m.len()).is_some() && range(object.triangles, triangles.len()).is_some()
    };
    Ok(owners.len() == tets.len()
        && raw.len() == surface_m.len()
        && owners.iter().all(|owner| *owner < MOST_OBJECTS)
        && tets.iter().flatten().all(|node| (*node as usize) < nodes_m.len())
        && triangles.iter().flatten().all(|corner| (*corner as usize) < surface_m.len())
        && [surface_m, nodes_m, metal_m].iter().all(|places_m| are_near(places_m))
        && objects.iter().all(has_its_own))
}

/// What a first and a count mean, if there are so many.
fn range([first, count]: [u32; 2], have: usize) -> Option<std::ops::Range<usize>> {
    let end = (first as usize).checked_add(count as usize)?;
    (end <= have).then_some(first as usize..end)
}

/// Whether all are where something can be; what is no number is not.
fn are_near(places_m: &[[f32; 3]]) -> bool {
    places_m.iter().flatten().fold(true, |all, value_m| all & (value_m.abs() <= FARTHEST_M))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{MessageMut, StreamHeader, message_bytes};

    /// One tet with its four faces, of which a section was changed.
    fn topology(change: impl FnOnce(&mut MessageMut<'_>)) -> Vec<u64> {
        let sections = [2 * size_of::<ObjectRecord>(), 16, 4, 48, 48, 0, 16, 48, 0, 0, 0];
        let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let mut message = MessageMut::format(bytes, Kind::Topology, StreamHeader::default(), &sections).unwrap();
        let organ = ObjectRecord { id: 1, vertices: [0, 4], triangles: [0, 4], ..ObjectRecord::default() };
        let tool = ObjectRecord { kind: ObjectKind::Tool as u32, vertices: [90, 9], ..ObjectRecord::default() };
        message.section::<ObjectRecord>(0).unwrap().copy_from_slice(&[tool, organ]);
        message.section::<[u32; 4]>(1).unwrap()[0] = [0, 1, 2, 3];
        message.section::<u32>(2).unwrap()[0] = 1;
        message.section::<[u32; 3]>(3).unwrap().copy_from_slice(&[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]);
        change(&mut message);
        memory
    }

    fn is_taken(memory: &[u64]) -> bool {
        topology_is_sound(bytemuck::cast_slice(memory))
    }

    #[test]
    fn a_topology_with_a_number_or_an_index_that_cannot_be_is_none() {
        assert!(is_taken(&topology(|_| ())), "a good one");
        let reaches_over = |it: &mut MessageMut<'_>| it.section::<ObjectRecord>(0).unwrap()[1].vertices = [0, 3];
        assert!(is_taken(&topology(reaches_over)), "a triangle that was not cut reaches to another object");
        type Change = fn(&mut MessageMut<'_>);
        let changes: [(&str, Change); 8] = [
            ("a tet without its node", |it| it.section::<[u32; 4]>(1).unwrap()[0][2] = 4),
            ("a tet of nobody", |it| it.section::<u32>(2).unwrap()[0] = f32::NAN.to_bits()),
            ("a triangle without its vertex", |it| it.section::<[u32; 3]>(3).unwrap()[3][1] = 4),
            ("a vertex that is nowhere", |it| it.section::<f32>(4).unwrap()[5] = f32::NAN),
            ("a node that is nowhere", |it| it.section::<f32>(7).unwrap()[11] = f32::INFINITY),
            ("a node that is far away", |it| it.section::<f32>(7).unwrap()[0] = 1e9),
            ("an object with more vertices than there are", |it| {
                it.section::<ObjectRecord>(0).unwrap()[1].vertices = [u32::MAX, u32::MAX];
            }),
            ("an object with more triangles than there are", |it| {
                it.section::<ObjectRecord>(0).unwrap()[1].triangles = [1, 4];
            }),
        ];
        for (what, change) in changes {
            assert!(!is_taken(&topology(change)), "{what}");
        }
        let mut foreign = topology(|_| ());
        crate::stream::change_header(bytemuck::cast_slice_mut(&mut foreign), |header| header.layout = !header.layout);
        assert!(!is_taken(&foreign) && !topology_is_sound(&[]));
    }
}
