//! What a step of the Flow Engine is told by the hand, by the wounds, and by what is gone.

use super::FlowEngine;
use crate::gas;
use crate::tools::RING;
use hyst_exchange::system;
use hyst_flow::FlowInputs;
use hyst_messages::SAMPLE_KEPT;
use hyst_messages::page::header;

impl FlowEngine<'_> {
    /// What the step is told, and where the lens looks in it; what the loop touches under the current that coagulates is shut by so much more.
    pub(super) fn inputs(&mut self, dt_s: f32) -> FlowInputs {
        let sample = self.heard.look(system::now_ns());
        let refused = self.heard.take_refused();
        if refused > 0 {
            self.life.page.add64(header::INVALID, refused);
        }
        if self.heard.is_kept() {
            self.flaws |= SAMPLE_KEPT;
        }
        self.gaze = sample.and_then(|sample| self.instrument.gaze(&sample));
        let mut inputs =
            sample.map_or(FlowInputs { dt_s, ..FlowInputs::default() }, |sample| self.instrument.inputs(&sample, dt_s));
        inputs.gas = sample.map_or_else(Default::default, |sample| gas::source(self.instrument.electrode(), &sample));
        if sample.is_some_and(|sample| sample.controls.coagulates()) {
            self.seals.touch(self.wounds.vessels(), &inputs.wires[..RING], dt_s);
        }
        self.wounds.shut(|cube| self.seals.share(cube));
        inputs.blood = self.wounds.sources();
        inputs.pump.open_veins = self.wounds.open_veins();
        inputs.pump.perforation = self.holes.size();
        inputs.pump.displaced_ml -= self.removed.gone_ml();
        inputs.hole = self.holes.way();
        inputs
    }
}
