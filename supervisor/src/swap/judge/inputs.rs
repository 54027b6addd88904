//! Which input either side made a tick of a tissue from. A step takes the device's record of the tick before, or the newest one that there is: where the
//! device is late, who begins a step before that record is there uses an older one than who begins it after. A fluid's states say something else in that
//! place: the tissue's state that its walls are of, which need not be the same one.

use super::Pairs;
use hyst_engine::stateful::MOST_BEHIND_TICKS;
use hyst_messages::tolerance::SHADOW_EPOCH;
use hyst_messages::{ContactModel, StreamHeader};
use std::collections::BTreeMap;

/// Ticks that are remembered: twice as many as an elder is behind before it leaps.
const MOST: usize = 2 * MOST_BEHIND_TICKS as usize;

/// What a state, or its contact model, says of how it was made.
#[derive(Clone, Copy)]
pub(super) struct Made {
    incarnation: u32,
    is_shadow: bool,
    tick: u64,
    input_tick: u64,
}

impl From<&StreamHeader> for Made {
    fn from(header: &StreamHeader) -> Made {
        let StreamHeader { incarnation, tick, input_tick, .. } = *header;
        Made { incarnation, is_shadow: header.is_shadow(), tick, input_tick }
    }
}

impl From<&ContactModel> for Made {
    fn from(model: &ContactModel) -> Made {
        let ContactModel { incarnation, state_tick, input_tick, .. } = *model;
        Made { incarnation, is_shadow: model.epoch == SHADOW_EPOCH, tick: state_tick, input_tick }
    }
}

/// What both sides made the newest ticks of: the old engine, and the newcomer.
#[derive(Default)]
pub(super) struct Inputs(BTreeMap<u64, [Option<Made>; 2]>);

impl Inputs {
    /// Takes what one side says of a tick; whether the other side made it of another input, and only one of them has the role.
    fn differ_with(&mut self, made: Made, guest: u32) -> bool {
        let pair = self.0.entry(made.tick).or_default();
        pair[usize::from(made.incarnation == guest)] = Some(made);
        let differ = match *pair {
            [Some(old), Some(new)] => old.is_shadow != new.is_shadow && old.input_tick != new.input_tick,
            _ => false,
        };
        while self.0.len() > MOST {
            self.0.pop_first();
        }
        differ
    }
}

impl Pairs {
    /// Whether a tick was made of another input than the other side made it of: there is nothing to compare. In the shadow both make the next one of one
    /// state again. Where the newcomer has the role each goes on from its own, and they have parted as by a leap.
    pub(super) fn has_other_input(&mut self, made: Made, guest: u32) -> bool {
        let differs = self.inputs.differ_with(made, guest);
        let in_shadow = made.is_shadow == (made.incarnation == guest);
        if differs && !in_shadow {
            self.part_at(made.tick);
        }
        differs
    }
}
