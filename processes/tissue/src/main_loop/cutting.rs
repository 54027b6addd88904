//! How the Main Loop comes to another mesh: by a cut of its own, or by a state in which somebody else has cut.

use super::MainLoop;
use crate::body::Body;
use crate::contacts::Contacts;
use crate::knife::{Stroke, removed_m3};
use crate::state::{BODY, STROKE};
use crate::world::World;
use hyst_engine::Failure;
use hyst_messages::Message;
use hyst_tissue::Scratch;
use std::sync::Arc;

impl MainLoop<'_> {
    /// Goes on with another world; what was made for the one before is made anew.
    pub(super) fn take_world(&mut self, world: World) {
        self.scratch = Scratch::new(&world.model);
        self.contacts = Contacts::new(&world);
        self.collision.take_world(&world);
        self.points_m.resize(world.points.len(), [0.0; 3]);
        self.pressure_pa.resize(world.wall.len(), 0.0);
        self.site.register_objects(&world.objects);
        self.status.objects = self.site.objects().len() as u32;
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
    pub(super) fn cut(
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
