//! How the working element stands in a step, and what the jaws hold in it.

use super::MainLoop;
use super::hand::Hand;
use crate::state::{Core, GRASP};
use crate::tool::Stand;
use hyst_engine::Failure;
use hyst_messages::Message;

impl MainLoop<'_> {
    /// How the working element stood in the step that made a state, and how it stands in the one from it; what the jaws hold is gone on with.
    pub(super) fn stands(
        &mut self,
        message: &Message<'_>,
        before: &Core,
        hand: &Hand,
        positions_m: &[[f32; 3]],
    ) -> Result<[Stand; 2], Failure> {
        if self.world.case.tool.jaws().is_none() {
            return Ok([before.loop_m, hand.loop_m].map(Stand::of_loop));
        }
        let stood = Stand { solid_m: Some(before.loop_m.max(before.hold_m)), looks: false };
        let (section, goes) = (message.section(GRASP)?, (&hand.pose, hand.loop_m));
        let stands = self.grasp.go_on(&self.world, (section, before), goes, positions_m);
        Ok([stood, stands])
    }
}
