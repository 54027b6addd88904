//! How the Main Loop comes to another mesh: by a cut of its own, by a piece that leaves, or by a state in which somebody else has changed it.

use super::MainLoop;
use super::hand::Hand;
use crate::body::Body;
use crate::contacts::Contacts;
use crate::knife::{Stroke, removed_m3};
use crate::outlet::Draw;
use crate::state::{BODY, STROKE};
use crate::world::World;
use hyst_engine::Failure;
use hyst_messages::Message;
use hyst_tissue::Scratch;
use std::sync::Arc;

/// What a step did to the mesh before it deformed it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Change {
    /// Something was cut.
    pub(super) is_cut: bool,
    /// What that removed, ml.
    pub(super) removed_ml: f64,
    /// Volume of a piece that has left, ml.
    pub(super) washed_out_ml: Option<f64>,
}

impl Change {
    /// Whether the mesh is another one now.
    pub(super) fn is_any(&self) -> bool {
        self.is_cut || self.washed_out_ml.is_some()
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
        let (is_cut, removed_ml) = self.cut(message, hand.wire_m.as_deref(), nodes)?;
        // While the wire cuts nothing leaves: the stroke names the tets that it is in.
        let draw = hand.draw.filter(|_| hand.wire_m.is_none());
        let washed_out_ml = draw.and_then(|draw| self.wash_out(&draw, nodes.0));
        Ok(Change { is_cut, removed_ml, washed_out_ml })
    }

    /// Lets a piece go that has come to the outflow and is small enough; gives its volume, ml. One at most: the next leaves in the next step.
    fn wash_out(&mut self, draw: &Draw, positions_m: &[[f32; 3]]) -> Option<f64> {
        let piece = draw.leaving(&self.world.drifters, positions_m)?;
        let (object, volume_ml) = (piece.object(), 1e6 * piece.volume_m3());
        // What is left has a model as it had one with the piece; if it had none, the piece stays, as one that is caught.
        let world = self.workshop.make(self.world.body.without(object)).ok()?;
        self.take_world(world);
        Some(volume_ml)
    }

    /// Goes on with another world; what was made for the one before is made anew.
    pub(super) fn take_world(&mut self, world: World) {
        self.scratch = Scratch::new(&world.model);
        self.contacts = Contacts::new(&world);
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
        if message.header().topology_version == self.world.version {
            return Ok(());
        }
        let body = Body::unpack(message.section(BODY)?, &self.world.case.room);
        let body = body.ok_or_else(|| Failure::Broken("the state has a body that is none".into()))?;
        let world = self.workshop.make(body)?;
        self.take_world(world);
        Ok(())
    }

    /// Cuts with what the wire has swept; tells whether the mesh is another one now, and what that removed, ml.
    fn cut(
        &mut self,
        message: &Message<'_>,
        wire_m: Option<&[[f32; 3]]>,
        nodes: (&[[f32; 3]], &[[f32; 3]]),
    ) -> Result<(bool, f64), Failure> {
        let swept = self.knife.sweep(&self.world, wire_m, message.section(STROKE)?, nodes);
        let refused = match swept {
            Ok(Stroke::None | Stroke::GoesOn) => return Ok((false, 0.0)),
            Ok(Stroke::Cut(body, pieces, report)) => {
                let removed_ml = 1e6 * removed_m3(&self.world.case, &body, &pieces, &report);
                match self.workshop.make(*body) {
                    Ok(world) => {
                        self.take_world(world);
                        return Ok((true, removed_ml));
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
        Ok((false, 0.0))
    }
}
