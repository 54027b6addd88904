//! What tissue sticks to where it is pressed on other tissue, or a fold of it on another: for each node the way to where friction holds it.
//!
//! Promise: it is in the state (its ninth section), so that whoever goes on from one is rubbed alike; what is not pressed any more sticks to nothing, and what
//! somebody has damaged there costs a little friction.

use super::{Contacts, LAW, believed_m};
use crate::world::World;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use hyst_tissue::{Scratch, StateRef};

/// What a node sticks to, as the state has it; all zero where it is nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Stuck {
    /// Object of the tissue that the node is pressed into.
    pub owner: u32,
    /// The way along that from the node to what it sticks to, m.
    pub bent_m: [f32; 3],
}

impl Stuck {
    /// The way from a node to what it sticks to of an object, m; none where it remembers another one, or nothing.
    pub(super) fn way_m(of_node: Option<&Stuck>, owner: u32) -> Vec3 {
        of_node.filter(|stuck| stuck.owner == owner).map_or(Vec3::ZERO, |stuck| believed_m(stuck.bent_m))
    }
}

impl Contacts {
    /// Writes what each node sticks to after the step that `scratch` has made. Of two objects it remembers the one of the lower tet; the other lets go of it in
    /// each step.
    pub(super) fn remember(&self, world: &World, after: &StateRef<'_>, scratch: &Scratch, stuck: &mut [Stuck]) {
        stuck.fill(Stuck::default());
        for (number, (pair, owner)) in (self.springs.len()..).zip(self.pairs.iter().zip(&self.pair_owners)) {
            let Some(place) = stuck.get_mut(pair.node as usize).filter(|place| **place == Stuck::default()) else { continue };
            let bent_m = scratch.press(&world.model, &LAW, (number, pair), after).bent_m;
            if bent_m != [0.0; 3] {
                *place = Stuck { owner: *owner, bent_m };
            }
        }
    }
}
