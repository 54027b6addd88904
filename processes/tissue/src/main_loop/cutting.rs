//! How the Main Loop comes to another mesh: by a cut of its own, by a piece that leaves, or by a state in which somebody else has changed it.

use super::MainLoop;
use super::hand::Hand;
use crate::body::Body;
use crate::contacts::Contacts;
use crate::knife::{Stroke, freed_m3, healthy_removed_m3, removed_m3};
use crate::state::{BODY, STROKE};
use crate::world::World;
use hyst_engine::Failure;
use hyst_messages::{CUT_LIMIT, Message};
use hyst_tissue::{BoundSurface, Scratch};
use std::sync::Arc;

/// Up to so far from the pivot the tip is in the cervix, and what the jaws hold is drawn out with it, m.
const OUT_M: f32 = 0.006;

/// A piece that has left.
#[derive(Clone, Copy, Debug)]
struct Left {
    volume_ml: f64,
    /// What of it is removed by that, ml.
    removed_ml: f64,
}

/// What a step did to the mesh before it deformed it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Change {
    /// Something was cut.
    pub(super) is_cut: bool,
    /// What that removed, ml.
    pub(super) removed_ml: f64,
    /// What of that came free by the cut, ml, and is not burnt.
    pub(super) freed_ml: f64,
    /// What the cut took off other tissue, ml.
    pub(super) healthy_ml: f64,
    /// Volume of a piece that has left through the outflow, ml.
    pub(super) washed_out_ml: Option<f64>,
    /// Volume of a piece that was taken out in the jaws, ml.
    pub(super) taken_out_ml: Option<f64>,
    /// A sweep of the wire cut coarser than was asked for, or nothing, because the mesh has reached its limit.
    pub(super) is_limited: bool,
}

impl Change {
    /// Whether the mesh is another one now.
    pub(super) fn is_any(&self) -> bool {
        self.is_cut || self.washed_out_ml.or(self.taken_out_ml).is_some()
    }
}

impl MainLoop<'_> {
    /// What the hand does to the mesh in a step from a state with these positions and velocities.
    pub(super) fn change(
        &mut self,
        message: &Message<'_>,
        hand: &Hand,
        nodes: (&[[f32; 3]], &[[f32; 3]]),
    ) -> Result<Change, Failure> {
        let cut = self.cut(message, hand, nodes)?;
        // While the wire cuts nothing leaves: the stroke names the tets that it is in.
        let draw = hand.draw.filter(|_| hand.wire_m.is_none());
        let washed = draw.and_then(|draw| Some(draw.leaving(&self.world.drifters, nodes.0)?.object()));
        let taken = self.is_out(hand).then(|| self.in_the_jaws()).flatten();
        // One at most: the next leaves in the next step.
        let left = washed.or(taken).and_then(|object| self.let_go(object, hand).map(|left| (object, left)));
        let removed_ml = cut.removed_ml + left.map_or(0.0, |(_, left)| left.removed_ml);
        let volume_ml = |of: Option<u32>| left.filter(|(object, _)| of == Some(*object)).map(|(_, left)| left.volume_ml);
        let taken = taken.filter(|_| washed.is_none());
        Ok(Change { removed_ml, washed_out_ml: volume_ml(washed), taken_out_ml: volume_ml(taken), ..cut })
    }

    /// Whether the tip has been drawn back so far that what is in the jaws is out of the cavity.
    fn is_out(&self, hand: &Hand) -> bool {
        self.world.case.tool.jaws().is_some() && hand.pose.insertion_m <= OUT_M
    }

    /// A free piece that the jaws hold.
    fn in_the_jaws(&self) -> Option<u32> {
        let is_free = |object: &u32| self.world.drifters.iter().any(|piece| piece.object() == *object);
        self.grasp.objects(&self.world).find(is_free)
    }

    /// Goes on without a piece. What is left has a model as it had one with the piece; if it had none, the piece stays.
    fn let_go(&mut self, object: u32, hand: &Hand) -> Option<Left> {
        let volume_ml = 1e6 * self.world.body.volume_of_m3(object);
        // One that came free has been counted then; one that the scene has free is removed now.
        let is_removed = self.world.case.is_loose_in_scene(object) && self.world.case.is_pathology(&self.world.body, object);
        let world = self.made(self.world.body.without(object), hand.is_shut()).ok()?;
        self.take_world(world);
        Some(Left { volume_ml, removed_ml: if is_removed { volume_ml } else { 0.0 } })
    }

    /// The world of a mesh that this process has changed, if everybody would take it; where its cavity is shut, with the forces that hold it so.
    pub(super) fn made(&mut self, body: Body, is_shut: bool) -> Result<World, Failure> {
        self.workshop.make_sound(body, (None, None), is_shut, &mut || ()).map(|(world, _)| world)
    }

    /// Goes on with another world; what was made for the one before is made anew.
    pub(super) fn take_world(&mut self, world: World) {
        let substeps = world.model.substeps(1e-3);
        if let Some(longer) = longer_steps(self.most_substeps, substeps, self.status.phase_us[0]) {
            self.life.say(&longer);
            self.most_substeps = substeps;
        }
        fit(&world, (&mut self.scratch, &mut self.surface, &mut self.contacts));
        self.collision.take_world(&world);
        self.points_m.resize(world.points.len(), [0.0; 3]);
        self.pressure_pa.resize(world.wall.len(), 0.0);
        self.site.register_objects(&world.objects);
        self.status.objects = self.site.present();
        self.world = Arc::new(world);
        if let Some(clerk) = &self.clerk {
            clerk.tell(&self.world);
        }
    }

    /// Makes the world that a state is of, if it is another one.
    pub(super) fn adopt(&mut self, message: &Message<'_>) -> Result<(), Failure> {
        if let Some(clerk) = &self.clerk {
            clerk.free();
        }
        if message.header().topology_version == self.world.version {
            return Ok(());
        }
        let body = Body::unpack(message.section(BODY)?, &self.world.case.room);
        let body = body.ok_or_else(|| Failure::Broken("the state has a body that is none".into()))?;
        let world = self.workshop.make(body)?;
        self.take_world(world);
        Ok(())
    }

    /// Cuts with what the wire has swept; tells whether the mesh is another one now, what that removed, and what of it came free.
    fn cut(&mut self, message: &Message<'_>, hand: &Hand, nodes: (&[[f32; 3]], &[[f32; 3]])) -> Result<Change, Failure> {
        let (world, wire_m, stroke) = (&*self.world, hand.wire_m.as_deref(), message.section(STROKE)?);
        let swept = self.knife.sweep_by(world, wire_m, stroke, nodes, |loose, rest| self.workshop.bind(loose, rest), || ());
        let refused = match swept {
            Ok(Stroke::None) => return Ok(Change::default()),
            Ok(Stroke::GoesOn { is_limited }) => return Ok(self.limited(Change::default(), is_limited)),
            Ok(Stroke::Cut { body, held, parted, trailing, is_limited }) => {
                match self.workshop.make_sound(*body, (Some(held), trailing), hand.is_shut(), &mut || ()) {
                    Ok((world, out_of_room)) => {
                        let removed_ml = 1e6 * removed_m3(&self.world, &world);
                        let freed_ml = 1e6 * freed_m3(&self.world, &world, &parted);
                        let healthy_ml = 1e6 * healthy_removed_m3(&self.world, &world);
                        self.knife.keep_momentum(&self.world, &world, &parted, nodes.1);
                        self.take_world(world);
                        let change = Change { is_cut: true, removed_ml, freed_ml, healthy_ml, ..Change::default() };
                        return Ok(self.limited(change, is_limited || out_of_room > 0));
                    }
                    Err(error) => error.to_string(),
                }
            }
            Err(error) => error.to_string(),
        };
        // The tissue stays as it was.
        self.knife.end();
        if !std::mem::replace(&mut self.has_refused, true) {
            self.life.say(&format!("a cut is left out: {refused}"));
        }
        Ok(Change { is_limited: true, ..Change::default() })
    }

    /// A change by a sweep that may have met a limit, which is said once.
    fn limited(&mut self, change: Change, is_limited: bool) -> Change {
        if is_limited && !std::mem::replace(&mut self.has_met_limit, true) {
            let (room, rest) = (&self.world.case.room, &self.world.body.rest);
            let [tets, nodes] = [rest.tets.len(), rest.positions_m.len()];
            self.life.say(&format!("{CUT_LIMIT} ({tets} of {} tets, {nodes} of {} nodes)", room.tets, room.nodes));
        }
        Change { is_limited, ..change }
    }
}

/// Makes anew, for another world, what is kept of the deformation, of the surface for the eye and of the contacts.
pub fn fit(world: &World, (scratch, surface, contacts): (&mut Scratch, &mut BoundSurface, &mut Contacts)) {
    scratch.fit(&world.model);
    surface.fit(&world.body.skin.bindings, world.model.tets());
    contacts.fit(world);
}

/// What is said of a mesh that asks for more substeps than all before it, of which the deformation took so long at last, µs.
fn longer_steps(most: u32, substeps: u32, deformation_us: f32) -> Option<String> {
    let longer_us = deformation_us * substeps as f32 / most.max(1) as f32;
    (substeps > most).then(|| {
        format!(
            "the mesh is finer where it was cut: 1 ms takes {substeps} substeps from here on and not {most}, \
             and the deformation some {longer_us:.0} µs and not {deformation_us:.0}"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_that_makes_every_later_step_longer_is_said_with_figures_and_another_one_is_not() {
        let said = longer_steps(8, 32, 200.0).expect("four times as long");
        assert!(said.contains("32 substeps from here on and not 8") && said.contains("800 µs and not 200"), "{said}");
        assert_eq!((longer_steps(8, 8, 200.0), longer_steps(32, 8, 200.0)), (None, None));
    }
}
