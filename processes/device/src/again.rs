//! In a replay: what the recording says of a tick, so that the device makes of it what the recorded one made: the same input record but for
//! the contact model's numbers, which the tissue computes again, the same part of the servos in it, and the same births of device and hardware.

use crate::plugged::Plug;
use hyst_coupling::LastHopState;
use hyst_exchange::ReadPage;
use hyst_messages::page::hardware;
use hyst_messages::{Applied, AppliedRecord, ContactModel, DeviceLimits, FROM_OWN, Medium, ReplayRecord, Replayed};
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
    /// In a replay: what each servo is to go on from, if not by its own rule.
    pub replayed: [Replayed; 2],
    /// In a replay: whose force it was, as the record of the tick says it.
    pub followed: u16,
    /// In a replay: no servo had answered in time, so none counts.
    pub is_mute: bool,
    /// In a replay: the recorded device was born in this tick, and went on from this.
    pub newborn: Option<LastHopState>,
    /// Whether the hardware is there.
    pub plug: Plug,
}

/// The contact models that tissues have made, and whose tick was recorded last.
#[derive(Default)]
pub struct Again {
    models: VecDeque<ContactModel>,
    /// What the device did in the tick before.
    before: Option<AppliedRecord>,
    /// Whether it has told the motors of a force in this life of the hardware.
    has_pushed: bool,
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
        let before = self.before.replace(recorded);
        let incarnation = |record: AppliedRecord| record.command.device_incarnation;
        let is_newborn = before.map(incarnation) != Some(incarnation(recorded));
        let plug = before.map_or(Plug::Stays, |before| plug(&before, &recorded));
        self.has_pushed &= !matches!(plug, Plug::In(_));
        let newborn = is_newborn.then(|| LastHopState::born(recorded.before_n, self.has_pushed));
        self.has_pushed |= recorded.command.force_n != [0.0; 3];
        Some(Given {
            model,
            medium: recorded.medium(),
            limits: recorded.limits,
            replayed: replayed(&replay),
            followed: recorded.followed,
            is_mute: recorded.command.kind != Applied::Fresh as u32,
            newborn,
            plug,
            ..Given::default()
        })
    }
}

/// What the servos are told. An older recording says only how old the state was that the force went on from: both go on from theirs of that age.
fn replayed(replay: &ReplayRecord) -> [Replayed; 2] {
    let (told, lag) = (replay.replayed, replay.recorded.lag);
    if told == [Replayed::default(); 2] && lag > 1 { [Replayed { from: FROM_OWN, lag }; 2] } else { told }
}

/// Whether the hardware was there in a tick after the one `before`. Each life of it counts its samples anew; and from one tick to the next the force is another
/// by nothing else. (Of a device that was not let run for longer than a ramp the force is gone, too, and it goes on as from hardware that is not there.)
fn plug(before: &AppliedRecord, recorded: &AppliedRecord) -> Plug {
    let is_gone = recorded.before_n == [0.0; 3];
    let is_other = recorded.before_n != before.command.force_n && (is_gone || recorded.tick == before.tick + 1);
    let is_anew = recorded.sample.hardware_tick < before.sample.hardware_tick;
    match (is_anew, is_other) {
        (false, true) if is_gone => Plug::Out,
        (false, false) => Plug::Stays,
        _ => Plug::In(recorded.before_n),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use hyst_messages::{FROM_OTHER, ForceCommand, HardwareSample, Role, Slot};

    /// Both servos were told how old the state was that the force went on from, and the other one's had been another.
    #[test]
    fn each_servo_is_told_its_own_origin_and_of_an_older_recording_both_are_told_the_age() {
        let told = |lag: u16, replayed: [Replayed; 2]| {
            let recorded = AppliedRecord { tick: 9, lag, ..AppliedRecord::default() };
            super::replayed(&ReplayRecord { tick: 9, recorded, replayed })
        };
        let (none, own, other) =
            (Replayed::default(), Replayed { from: FROM_OWN, lag: 5 }, Replayed { from: FROM_OTHER, lag: 1 });
        assert_eq!([told(5, [own, none]), told(5, [own, other])], [[own, none], [own, other]]);
        assert_eq!([told(1, [none, other]), told(1, [none; 2]), told(0, [none; 2])], [[none, other], [none; 2], [none; 2]]);
        assert_eq!(told(5, [none; 2]), [own; 2], "an older recording");
    }

    /// Forces differed from where a driver had died under the hand.
    #[test]
    fn another_life_of_device_or_hardware_is_known_by_what_was_recorded_of_the_ticks() {
        let station = Station::named(&format!("t{}-again", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Hardware);
        let (own, page) = (station.create_slot(slot, 3).unwrap(), station.read_slot(slot, 3).unwrap());
        let mut again = Again::default();
        let mut given = |tick: u64, device_incarnation: u32, hardware_tick: u64, before_n: f32, force_n: f32| {
            let command = ForceCommand { tick, device_incarnation, force_n: [0.0, 0.0, force_n], ..ForceCommand::default() };
            let sample = HardwareSample { hardware_tick, ..HardwareSample::default() };
            let recorded = AppliedRecord { tick, command, sample, before_n: [0.0, 0.0, before_n], ..AppliedRecord::default() };
            own.write(hardware::REPLAY, &ReplayRecord { tick, recorded, ..ReplayRecord::default() });
            let given = again.given(&page, tick, ContactModel::default()).unwrap();
            (given.newborn, given.plug)
        };
        let (nothing, shut) = ((None, Plug::Stays), LastHopState::default());
        let resumed = |force_n: f32| LastHopState::resumed([0.0, 0.0, force_n]);
        assert_eq!(given(10, 4, 100, 0.0, 0.0), (Some(shut), Plug::Stays), "the session begins");
        assert_eq!(given(11, 4, 101, 0.0, 0.0), nothing);
        assert_eq!(given(12, 5, 102, 0.0, 0.0), (Some(shut), Plug::Stays), "before any force");
        assert_eq!(given(13, 5, 103, 0.0, 0.5), nothing);
        assert_eq!(given(14, 5, 103, 0.5, 0.4), nothing, "a sample that is late");
        assert_eq!(given(15, 5, 103, 0.0, 0.0), (None, Plug::Out));
        assert_eq!(given(16, 5, 103, 0.0, 0.0), nothing, "it has said nothing yet");
        assert_eq!(given(17, 5, 1, 0.125, 0.1), (None, Plug::In([0.0, 0.0, 0.125])));
        assert_eq!(given(18, 5, 2, 0.1, 0.2), nothing);
        assert_eq!(given(19, 5, 2, 0.0, 0.0), (None, Plug::Out));
        assert_eq!(given(20, 5, 5, 0.2, 0.2), (None, Plug::In([0.0, 0.0, 0.2])), "it was not dead");
        assert_eq!(given(35, 5, 20, 0.15, 0.2), nothing, "a device that was not let run");
        assert_eq!(given(45, 6, 30, 0.2, 0.2), (Some(resumed(0.2)), Plug::Stays));
        // The next is born after the motors have let go; the one after it with motors that have made nothing yet.
        assert_eq!(given(80, 7, 64, 0.0, 0.1), (Some(resumed(0.0)), Plug::Out));
        assert_eq!(given(90, 8, 3, 0.0, 0.0), (Some(shut), Plug::In([0.0; 3])));
        assert_eq!(again.given(&page, 91, ContactModel::default()).map(|given| given.plug), None, "it made no such tick");
        station.wipe();
    }
}
