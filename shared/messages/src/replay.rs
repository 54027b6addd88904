//! What a replay needs beside what a session is judged by: which state each step of the tissue and each answer of a servo went on from, and what the
//! recording says of a tick.

use crate::record::AppliedRecord;
use bytemuck::{Pod, Zeroable};

/// One step of the tissue: with its input record and the state that it names, the state that it made can be made again, to the bit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct StepRecord {
    /// Tick of the state that was made.
    pub tick: u64,
    /// Hash of that state.
    pub state_hash: u64,
    /// Tick of the input record that it was made from; 0 if there was none.
    pub input_tick: u64,
    /// Tick of the state that it was made from.
    pub from_tick: u64,
    /// Incarnation that made that one.
    pub from_incarnation: u32,
    /// Epoch of the state that was made.
    pub epoch: u32,
    /// Incarnation that made it.
    pub incarnation: u32,
    /// Length of the step, ticks.
    pub step_ticks: u32,
}

/// What an answer of a servo went on from, where that was not its own state of the tick before: it is newborn, has lost ticks, or took the other's state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct OriginRecord {
    /// Tick of the answer.
    pub tick: u64,
    /// Tick of the state that it went on from; 0: it began anew.
    pub from_tick: u64,
    /// Which servo has answered, 0 or 1.
    pub servo: u32,
    /// Whose state that was.
    pub from_servo: u32,
}

impl OriginRecord {
    /// Whether it is of servos that there are, and a state that was there before the answer.
    pub fn can_be(&self) -> bool {
        self.from_tick < self.tick && self.servo < 2 && self.from_servo < 2
    }

    /// What a replay tells that servo of it; nothing where the state is too old to be told.
    pub fn replayed(&self) -> Replayed {
        if self.from_tick == 0 {
            return Replayed { from: FROM_NOTHING, lag: 0 };
        }
        let from = if self.from_servo == self.servo { FROM_OWN } else { FROM_OTHER };
        u16::try_from(self.tick.saturating_sub(self.from_tick)).map_or_else(|_| Replayed::default(), |lag| Replayed { from, lag })
    }
}

/// In a replay: what a servo is to go on from in a tick, as the recorded one did. All zero: it knows by itself.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Replayed {
    /// [`FROM_OWN`], [`FROM_OTHER`], [`FROM_NOTHING`], or 0.
    pub from: u16,
    /// How many ticks before this one that state is from.
    pub lag: u16,
}

/// [`Replayed::from`]: its own state.
pub const FROM_OWN: u16 = 1;
/// [`Replayed::from`]: the other's.
pub const FROM_OTHER: u16 = 2;
/// [`Replayed::from`]: none, it begins anew.
pub const FROM_NOTHING: u16 = 3;

/// In a replay: what the recorded tick says that the device makes again, beside the sample. In the hardware's page.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ReplayRecord {
    /// The tick. What it says counts for this tick alone.
    pub tick: u64,
    /// The tick as it was recorded; its own tick is 0 if the device made none.
    pub recorded: AppliedRecord,
    /// What each servo is to go on from.
    pub replayed: [Replayed; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replay_tells_whose_state_it_was_and_how_old_and_nothing_where_that_cannot_be_told() {
        let told = |tick, from_tick, servo, from_servo| OriginRecord { tick, from_tick, servo, from_servo }.replayed();
        assert_eq!(told(100, 93, 1, 1), Replayed { from: FROM_OWN, lag: 7 });
        assert_eq!(told(100, 99, 1, 0), Replayed { from: FROM_OTHER, lag: 1 });
        assert_eq!(told(100_000, 0, 0, 0), Replayed { from: FROM_NOTHING, lag: 0 });
        assert_eq!(told(70_000, 1, 0, 0), Replayed::default(), "a minute ago");
        assert_eq!(told(7, u64::MAX, 0, 1), Replayed { from: FROM_OTHER, lag: 0 }, "damage is no overflow");
    }

    #[test]
    fn what_cannot_be_is_of_no_servo_or_of_a_state_that_was_not_there_yet() {
        let can_be = |tick, from_tick, servo, from_servo| OriginRecord { tick, from_tick, servo, from_servo }.can_be();
        assert!(can_be(100, 99, 1, 0) && can_be(100, 0, 0, 0));
        assert!(
            !can_be(100, 100, 1, 0) && !can_be(100, u64::MAX, 1, 0) && !can_be(100, 99, 2, 0) && !can_be(100, 99, 0, u32::MAX)
        );
    }
}
