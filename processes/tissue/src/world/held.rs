//! Which parts of a body something holds: what is around them, or a host that is held itself.
//!
//! Promise: what hangs on a chip that has come off its wall is as free as the chip, however many hang on each other, and nothing is held in a circle. The springs
//! to the hosts are there all the same, so that what hangs together floats together.

use super::Case;
use crate::body::Body;
use hyst_mesh::component_count;
use hyst_messages::stream::ObjectKind;
use hyst_tissue::Attachment;

/// What holds the nodes of a body.
#[derive(Debug, PartialEq)]
pub struct Held {
    /// Whether each is fixed, or in tissue that what is around it holds.
    pub is_held: Vec<bool>,
    /// Whether it is that, or tied to a host that is held.
    pub is_rooted: Vec<bool>,
    /// What ties pathologies to their hosts, whether those are held or not.
    pub attachments: Vec<Attachment>,
}

impl Held {
    /// Whether each object of the body is held: a node of it is rooted.
    pub fn objects(&self, body: &Body) -> Vec<bool> {
        let mut is_object_held = vec![false; body.origin.len()];
        for (tet, object) in body.rest.tets.iter().zip(&body.rest.regions) {
            let is_held = &mut is_object_held[*object as usize];
            *is_held = *is_held || tet.iter().any(|node| self.is_rooted[*node as usize]);
        }
        is_object_held
    }
}

impl Case {
    /// What holds the nodes of a body whose objects are named as they hang together.
    pub fn held(&self, body: &Body) -> Held {
        self.held_in_parts(body, &body.rest.regions)
    }

    /// The same of one that may have come apart since its objects were named: each tet has the number of what it hangs together with.
    pub fn held_in_parts(&self, body: &Body, part_of_tet: &[u32]) -> Held {
        let (is_held, attachments) = (self.held_nodes(body), self.attachments(body));
        let is_rooted = self.rooted_nodes(body, part_of_tet, &is_held, &attachments);
        Held { is_held, is_rooted, attachments }
    }

    /// Whether each node is held, or tied to a host that is.
    pub fn rooted_nodes(&self, body: &Body, part_of_tet: &[u32], is_held: &[bool], attachments: &[Attachment]) -> Vec<bool> {
        let mut is_rooted = is_held.to_vec();
        if attachments.is_empty() {
            return is_rooted;
        }
        let parts = Parts::of(body, part_of_tet);
        let is_part_held = self.held_parts(body, &parts, is_held, attachments);
        let is_host_held = |tie: &&Attachment| parts.part_of(tie.tet[0]).is_some_and(|host| is_part_held[host as usize]);
        attachments.iter().filter(is_host_held).for_each(|tie| is_rooted[tie.node as usize] = true);
        is_rooted
    }

    /// Whether each part is held, by itself or by way of others. An organ of the scene that nothing holds is no free piece: what is tied to it is held, too, and
    /// while it comes apart what is tied to any part of it.
    fn held_parts(&self, body: &Body, parts: &Parts, is_held: &[bool], attachments: &[Attachment]) -> Vec<bool> {
        let mut is_part_held = vec![false; parts.object_of.len()];
        let held_nodes = parts.of_node.iter().zip(is_held).filter(|(_, is_held)| **is_held);
        held_nodes.filter_map(|(part, _)| *part).for_each(|part| is_part_held[part as usize] = true);
        let tie = |held: &Attachment| Some([parts.part_of(held.node)?, parts.part_of(held.tet[0])?]);
        let ties: Vec<[u32; 2]> = attachments.iter().filter_map(tie).collect();
        spread(&mut is_part_held, &ties);
        let mut is_object_held = vec![false; body.origin.len()];
        for (object, is_held) in parts.object_of.iter().zip(&is_part_held) {
            is_object_held[*object as usize] |= *is_held;
        }
        let is_organ = |object: u32| self.objects.get(object as usize).is_some_and(|(_, kind)| *kind == ObjectKind::Organ);
        for (object, is_held) in parts.object_of.iter().zip(&mut is_part_held) {
            *is_held = *is_held || is_organ(*object) && !is_object_held[*object as usize];
        }
        spread(&mut is_part_held, &ties);
        is_part_held
    }
}

/// What hangs together in a body.
struct Parts {
    /// The part of each node; `None` for those that no tet uses.
    of_node: Vec<Option<u32>>,
    /// The object of each part; of a number that no part has it says 0.
    object_of: Vec<u32>,
}

impl Parts {
    /// Those of a body that has tets.
    fn of(body: &Body, part_of_tet: &[u32]) -> Parts {
        let mut of_node = vec![None; body.rest.positions_m.len()];
        let mut object_of = vec![0; component_count(part_of_tet)];
        for ((tet, object), part) in body.rest.tets.iter().zip(&body.rest.regions).zip(part_of_tet) {
            tet.iter().for_each(|node| of_node[*node as usize] = Some(*part));
            object_of[*part as usize] = *object;
        }
        Parts { of_node, object_of }
    }

    /// The part of a node.
    fn part_of(&self, node: u32) -> Option<u32> {
        self.of_node.get(node as usize).copied().flatten()
    }
}

/// Holds each part that is tied to one that is held, until there is no other. A tie is a part and that of its host.
fn spread(is_held: &mut [bool], ties: &[[u32; 2]]) {
    let next = |is_held: &[bool]| {
        let is_next = |[part, host]: &&[u32; 2]| is_held[*host as usize] && !is_held[*part as usize];
        ties.iter().find(is_next).map(|[part, _]| *part)
    };
    while let Some(part) = next(is_held) {
        is_held[part as usize] = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_tied_to_what_is_held_is_held_by_way_of_others_and_nothing_is_in_a_circle() {
        // 1 is tied to 0, 2 to 1, 3 and 4 to each other, 5 to 4 and to 1.
        let ties = [[2, 1], [1, 0], [3, 4], [4, 3], [5, 4], [5, 1]];
        let spread_from = |first: usize| {
            let mut is_held = [false; 6];
            is_held[first] = true;
            spread(&mut is_held, &ties);
            is_held
        };
        assert_eq!(spread_from(0), [true, true, true, false, false, true]);
        assert_eq!(spread_from(4), [false, false, false, true, true, true]);
        assert_eq!(spread_from(5), [false, false, false, false, false, true], "a host is not held by what hangs on it");
        let mut nothing = [false; 6];
        spread(&mut nothing, &ties);
        assert_eq!(nothing, [false; 6]);
    }
}
