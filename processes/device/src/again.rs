//! In a replay: what the recording says of a tick, so that the device makes of it what the recorded one made: the same input record but for
//! the contact model's numbers, which the tissue computes again, and the same part of the servos in it.

use hyst_coupling::LastHopState;
use hyst_exchange::ReadPage;
use hyst_messages::page::hardware;
use hyst_messages::{Applied, ContactModel, DeviceLimits, Medium};
use std::collections::VecDeque;

/// Contact models that are kept: far more than the ticks for which a model that is late is used.
const MODELS: usize = 256;

/// What is known of a tick before the servos are asked.
#[derive(Clone, Copy, Debug, Default)]
pub struct Given {
    /// The contact model.
    pub model: ContactModel,
    /// What the tissue is told of the medium.
    pub medium: Medium,
    /// What the device on the desk can do at most.
    pub limits: DeviceLimits,
    /// Epoch and tick of the fluid's state that it is from.
    pub medium_key: (u32, u64),
    /// How far back the servo's state is that the force goes on from, ticks, if not by its own rule; else 0.
    pub lag: u64,
    /// In a replay: no servo had answered in time, so none counts.
    pub is_mute: bool,
    /// In a replay: the recorded device was born in this tick, and went on from this.
    pub newborn: Option<LastHopState>,
}

/// The contact models that tissues have made, and whose tick was recorded last.
#[derive(Default)]
pub struct Again {
    models: VecDeque<ContactModel>,
    device_incarnation: u32,
}

impl Again {
    /// What the recording says of a tick, in the hardware's page; `None` if the device made none. `newest` is the tissue's newest model.
    pub fn given(&mut self, hardware: &ReadPage, tick: u64, newest: ContactModel) -> Option<Given> {
        // One that takes over sends its predecessor's last state again; the model of a tick is the same whoever made it.
        if newest.epoch > 0 && self.models.back().is_none_or(|known| known.state_tick < newest.state_tick) {
            self.models.push_back(newest);
            self.models.drain(..self.models.len().saturating_sub(MODELS));
        }
        let (_, replay) = hardware.cell(hardware::REPLAY)?;
        let recorded = Some(replay.recorded).filter(|recorded| replay.tick == tick && recorded.tick == tick)?;
        let model = match recorded.model_epoch {
            0 => ContactModel::default(),
            // Of a state that nobody went on from none is made again; that of the state before is next to it.
            _ => {
                let mut known = self.models.iter().rev();
                let found = known.find(|model| model.state_tick <= recorded.model_tick).copied().unwrap_or(newest);
                ContactModel { state_tick: recorded.model_tick, ..found }
            }
        };
        let incarnation = recorded.command.device_incarnation;
        let is_newborn = std::mem::replace(&mut self.device_incarnation, incarnation) != incarnation;
        let before_n = recorded.before_n;
        let born = || if before_n == [0.0; 3] { LastHopState::default() } else { LastHopState::resumed(before_n) };
        Some(Given {
            model,
            medium: recorded.medium(),
            limits: recorded.limits,
            lag: u64::from(recorded.lag),
            is_mute: recorded.command.kind != Applied::Fresh as u32,
            newborn: is_newborn.then(born),
            ..Given::default()
        })
    }
}
