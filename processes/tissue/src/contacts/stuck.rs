//! What tissue remembers of other tissue that it is pressed on, or a fold of another fold: for each node the way to where friction holds it, and the way that
//! leads back out.
//!
//! Promise: it is in the state (its ninth section), so that whoever goes on from one is rubbed alike and pushed to the same side; what is not pressed any more
//! sticks to nothing, and what somebody has damaged there costs a little friction, or one contact its side.

use super::{Contacts, LAW, believed_m};
use crate::world::World;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use hyst_contact::Memory;
use hyst_tissue::{Scratch, StateRef};

/// What a node sticks to, as the state has it; all zero where it is nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Stuck {
    /// Object of the tissue that the node is pressed into.
    pub owner: u32,
    /// The way along that from the node to what it sticks to, m.
    pub bent_m: [f32; 3],
    /// The way back out of it, a unit vector; zero as long as nobody knows that for sure.
    pub out: [f32; 3],
}

/// What a contact of tissue with tissue is remembered by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pressed {
    /// Object of the tissue that the node is pressed into.
    pub(super) owner: u32,
    /// The way back out of it, or zero.
    pub(super) out: [f32; 3],
    /// Whether the node remembered that object before.
    pub(super) is_known: bool,
}

impl Stuck {
    /// What a node remembers of an object; nothing where it remembers another one.
    pub(super) fn of(all: &[Stuck], node: u32, owner: u32) -> Option<&Stuck> {
        all.get(node as usize).filter(|stuck| stuck.owner == owner && **stuck != Stuck::default())
    }

    /// The way to what the node sticks to, m.
    pub(super) fn way_m(&self) -> Vec3 {
        believed_m(self.bent_m)
    }

    /// The way back out of the object, a unit vector, if it is known.
    pub(super) fn way_back(&self) -> Option<Vec3> {
        Vec3::from(self.out).try_normalize()
    }
}

/// Tells the points of tissue, of which these are the memories, what their nodes remember.
pub(super) fn recall(world: &World, stuck: &[Stuck], of_tissue: &mut [Memory]) {
    for (memory, node) in of_tissue.iter_mut().zip(&world.points.node[world.points.tool..]) {
        let Stuck { owner, out, .. } = stuck.get(*node as usize).copied().unwrap_or_default();
        *memory = Memory { owner, direction: out, ..Memory::default() };
    }
}

impl Contacts {
    /// Writes what each node remembers after the step that `scratch` has made. Of two objects it is the one that it remembered before, else that of the lower
    /// tet; the other lets go of it in each step.
    pub(super) fn remember(&self, world: &World, after: &StateRef<'_>, scratch: &Scratch, stuck: &mut [Stuck]) {
        stuck.fill(Stuck::default());
        for (number, (pair, pressed)) in (self.springs.len()..).zip(self.pairs.iter().zip(&self.pressed)) {
            let Some(place) = stuck.get_mut(pair.node as usize) else { continue };
            if *place != Stuck::default() && !pressed.is_known {
                continue;
            }
            let push = scratch.press(&world.model, &LAW, (number, pair), after);
            if push.normal_n > 0.0 {
                *place = Stuck { owner: pressed.owner, bent_m: push.bent_m, out: pressed.out };
            }
        }
    }
}
