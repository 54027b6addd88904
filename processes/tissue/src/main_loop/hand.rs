//! What a step takes from its input: the hand, and what the medium does.

use super::MainLoop;
use super::cutting::Change;
use crate::contacts::{MAX_LOOP_DEPTH_M, ToolMotion};
use crate::grasp;
use crate::knife::{soft_m, solid_m, wire_m};
use crate::outlet::Draw;
use crate::state::Core;
use crate::tool::Stand;
use crate::world::World;
use hyst_engine::{Stateful, StepContext};
use hyst_messages::page::{device, station};
use hyst_messages::{InputRecord, Kind, Medium, Message, Pose};
use hyst_tissue::StepReport;

/// How far back an input record is looked for when the one for the tick is missing, ticks: as long as the device's own hold and ramp.
const INPUT_REACH: u64 = 22;

/// The square of the length of what may be a unit quaternion of a driver that is not careful.
const UNIT: std::ops::RangeInclusive<f32> = 0.5..=2.0;

/// What a step takes from its input.
pub(super) struct Hand {
    pub(super) input_tick: u64,
    pub(super) pose: Pose,
    pub(super) velocity_m_s: [f32; 3],
    /// Where the wire is, m, if it cuts.
    pub(super) wire_m: Option<Vec<[f32; 3]>>,
    /// How far the loop is out, m, if it is solid; else 0. Of jaws how far they are apart.
    pub(super) loop_m: f32,
    /// How much less deep than a cold one a loop is pushed out from, m.
    pub(super) soft_m: f32,
    /// The outflow, if it draws.
    pub(super) draw: Option<Draw>,
    /// What the medium does, to be used by the next step.
    pub(super) next_medium: Medium,
    /// How far the cavity is closed then.
    pub(super) next_closed: f32,
}

impl Hand {
    /// The tool's points as they move from where they were in the state that is read, which has used the input of a tick; its jaws do not meet what is spared, and
    /// the way back is that to the pivot.
    pub(super) fn motion<'a>(
        &self,
        world: &World,
        (points_m, spared): (&'a [[f32; 3]], &'a [u32]),
        (pose, stood, told_tick): (&'a Pose, Stand, u64),
        dt_s: f32,
    ) -> ToolMotion<'a> {
        let Pose { position_m: tip_m, orientation, .. } = self.pose;
        let (before, since_s) = ((pose, stood), since_s(told_tick, self.input_tick, dt_s));
        let back = std::array::from_fn(|axis| world.case.pivot_m[axis] - tip_m[axis]);
        ToolMotion { points_m, before, since_s, way_share: 1.0, tip_m, back, orientation, spared, soft_m: self.soft_m }
    }

    /// Whether the forces that hold the cavity shut are in this step, or in one that may come soon: they begin a fifth of the way later than it does.
    pub(super) fn is_shut(&self) -> bool {
        self.next_closed > 0.0
    }

    /// What a state says beside its nodes: after a step from a core, with a force on the tool, so many contacts and points that are held, what became of
    /// the mesh, and what the deformation says of itself.
    pub(super) fn core(
        &self,
        before: &Core,
        force_n: [f32; 3],
        (contacts, (held, hold_m)): (usize, (usize, f32)),
        (change, report): (&Change, &StepReport),
    ) -> Core {
        Core {
            pose: self.pose,
            velocity_m_s: self.velocity_m_s,
            force_n,
            removed_volume_ml: before.removed_volume_ml + change.removed_ml,
            largest_piece_ml: before.largest_piece_ml.max(change.freed_ml),
            healthy_removed_ml: before.healthy_removed_ml + change.healthy_ml,
            washed_out_ml: before.washed_out_ml + change.washed_out_ml.unwrap_or(0.0),
            pressure_pa: self.next_medium.pressure_pa,
            contact_count: contacts as u32,
            cuts: before.cuts + u32::from(change.is_cut),
            is_cutting: u32::from(self.wire_m.is_some()),
            loop_m: self.loop_m,
            washed_out: before.washed_out + u32::from(change.washed_out_ml.is_some()),
            held: held as u32,
            hold_m: hold_m.max(self.soft_m),
            cut_limits: before.cut_limits.saturating_add(u32::from(change.is_limited)),
            corrections: before.corrections.saturating_add(report.corrections()),
            closed: self.next_closed,
            taken_out: before.taken_out + u32::from(change.taken_out_ml.is_some()),
            taken_out_ml: before.taken_out_ml + change.taken_out_ml.unwrap_or(0.0),
            pieces: self.next_medium.pieces,
        }
    }
}

/// Whether a record says where the tool is, and how it moves. Of a device that has measured nothing yet the orientation is 0.
pub(super) fn is_fit(record: &InputRecord) -> bool {
    let sample = &record.sample;
    let turned = sample.pose.orientation.iter().map(|part| part * part).sum::<f32>();
    sample.pose.is_finite()
        && (turned == 0.0 || UNIT.contains(&turned))
        && sample.velocity_m_s.iter().chain([&sample.controls.loop_extension_m]).all(|number| number.is_finite())
}

/// A record as a step uses it: where it says of the medium what cannot be, as a number that is none, it says nothing of it. `None` of one that is not fit.
fn usable(record: InputRecord) -> Option<InputRecord> {
    if !is_fit(&record) {
        return None;
    }
    if record.medium().is_sound() {
        return Some(record);
    }
    let Medium { pressure_pa, pieces, on_scope_n } = Medium::default();
    Some(InputRecord { pressure_pa, pieces, on_scope_n, ..record })
}

/// How long the instrument took from the input of one tick to that of another, s: at least a step of `dt_s`, and more where ticks were lost in between. From where
/// nobody knows it came from it has not moved.
fn since_s(told_tick: u64, input_tick: u64, dt_s: f32) -> f32 {
    if told_tick == 0 { f32::INFINITY } else { dt_s.max(input_tick.saturating_sub(told_tick) as f32 * 1e-3) }
}

impl MainLoop<'_> {
    /// The input for the step from `tick`: the record of the tick before, or the newest one within reach; in a replay the one that was recorded.
    pub(super) fn input(&self, tick: u64) -> Option<InputRecord> {
        let page = self.device.as_ref()?;
        if self.life.is_replay() {
            let named = self.life.clock.page().load64(station::REPLAY_INPUT_TICK);
            return (named > 0).then(|| page.ring(device::INPUTS, named)).flatten().and_then(usable);
        }
        (1..=INPUT_REACH).find_map(|back| page.ring(device::INPUTS, tick.checked_sub(back)?).and_then(usable))
    }

    /// What the hand does in a step; without an input it stays where it was, the loop too, and the wire cuts nothing. Nor does it where fewer bytes were lent than
    /// a cut may take, because the current came on after that: it does in the next step. What the next step uses of the medium is part of this state, so that a
    /// substitute for it uses the same.
    pub(super) fn hand(&self, context: &StepContext, before: &Core, lent: usize) -> Hand {
        let dt_s = context.step_ticks as f32 * 1e-3;
        let parts_pa = if self.world.is_organ_whole { before.pressure_pa } else { f32::INFINITY };
        let next_closed = self.world.case.closing.after(before.closed, parts_pa, dt_s);
        let medium = Medium { pressure_pa: before.pressure_pa, pieces: before.pieces, ..Medium::default() };
        let tool = &self.world.case.tool;
        // With jaws the state has something else there.
        let soft_before_m = if tool.jaws().is_some() { 0.0 } else { before.hold_m.clamp(0.0, MAX_LOOP_DEPTH_M) };
        let Some(input) = self.input(context.tick) else {
            let (pose, loop_m, soft_m, next_medium) = (before.pose, before.loop_m, soft_before_m, medium);
            let (velocity_m_s, wire_m, draw) = ([0.0; 3], None, None);
            return Hand { input_tick: 0, pose, velocity_m_s, wire_m, loop_m, soft_m, draw, next_medium, next_closed };
        };
        let sample = &input.sample;
        let wire_m = wire_m(self.world.case.electrode.as_ref(), &sample.pose, &sample.controls);
        Hand {
            input_tick: input.tick,
            pose: sample.pose,
            velocity_m_s: sample.velocity_m_s,
            wire_m: wire_m.filter(|_| lent >= self.message_bytes()),
            loop_m: match tool.jaws() {
                Some(_) => grasp::apart_m(tool, &sample.controls, before.loop_m),
                None => solid_m(self.world.case.electrode.as_ref(), &sample.controls),
            },
            soft_m: soft_m(self.world.case.electrode.as_ref(), &sample.controls, soft_before_m, dt_s),
            draw: self.world.case.outlet.draw(&input),
            next_medium: if input.pressure_pa > 0.0 { input.medium() } else { medium },
            next_closed,
        }
    }

    /// The input for the step from a state.
    pub(super) fn input_of(&self, now: &[u8]) -> Option<InputRecord> {
        self.input(Message::parse(now, Kind::TissueState).ok()?.header().tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten lost ticks made a hand ten times as fast for a step.
    #[test]
    fn what_was_lost_between_two_inputs_is_no_speed_of_the_hand() {
        let all = [(7, 8), (7, 17), (7, 7), (9, 7), (0, 8)].map(|(told, input)| since_s(told, input, 2e-3));
        assert_eq!(all, [2e-3, 10.0 * 1e-3, 2e-3, 2e-3, f32::INFINITY]);
    }
}
