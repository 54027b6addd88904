//! The fixed-size records that live in cells and rings of the station pages. SI units; world frame: metres, origin at the pivot
//! in the cervix, +z into the uterus, +y anterior, +x to the patient's right. Padding is explicit, so that every bit is defined.

use crate::replay::Replayed;
use crate::statement::DeviceLimits;
use bytemuck::{Pod, Zeroable};

/// Most planes in a contact model.
pub const MAX_PLANES: usize = 8;
/// Most free pieces that the flow carries; more rest in the medium.
pub const MAX_PIECES: usize = 8;
/// Words reserved for the servo's filter state inside a force record.
pub const SERVO_STATE_WORDS: usize = 24;

/// Where the scope is: the tip, its orientation, and the same as the four degrees of freedom about the pivot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Pose {
    /// Tip in the world frame, m.
    pub position_m: [f32; 3],
    /// Rotation about x, rad.
    pub pitch_rad: f32,
    /// Unit quaternion x, y, z, w; its +z is the scope's axis, pointing inwards.
    pub orientation: [f32; 4],
    /// Rotation about y, rad.
    pub yaw_rad: f32,
    /// Rotation about the scope's axis, rad.
    pub roll_rad: f32,
    /// Pivot to tip, m.
    pub insertion_m: f32,
    /// Camera head against the scope, rad.
    pub camera_roll_rad: f32,
}

impl Pose {
    /// Whether all its numbers are.
    pub fn is_finite(&self) -> bool {
        bytemuck::cast_slice::<Pose, f32>(std::slice::from_ref(self)).iter().all(|number| number.is_finite())
    }

    /// A number that names the pose.
    pub fn hash(&self) -> u64 {
        let words: &[u32] = bytemuck::cast_slice(std::slice::from_ref(self));
        crate::fnv_words(0, words.iter().map(|word| *word as u64))
    }
}

/// Bit of [`Controls::buttons`]: the hand wants the current that cuts in the loop electrode.
pub const BUTTON_ENERGIZED: u32 = 1;
/// Bit of [`Controls::buttons`]: the hand wants the loop electrode out, or the jaws open; [`Controls::loop_extension_m`] says how far it is, or they are.
pub const BUTTON_EXTENDED: u32 = 2;
/// Bit of [`Controls::buttons`]: the hand wants the current that coagulates in the loop electrode, by the other pedal; see [`Controls::coagulates`].
pub const BUTTON_COAGULATING: u32 = 4;
/// Bits of [`Controls::buttons`] by which the hand wants current, of whichever kind.
pub const BUTTONS_CURRENT: u32 = BUTTON_ENERGIZED | BUTTON_COAGULATING;
/// Bits of [`Controls::buttons`] and what the hand wants by them.
pub const BUTTONS: [(u32, &str); 3] = [
    (BUTTON_ENERGIZED, "current that cuts"),
    (BUTTON_EXTENDED, "loop out or jaws open"),
    (BUTTON_COAGULATING, "current that coagulates"),
];

/// What the hand sets beside the pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Controls {
    /// Bits of [`BUTTONS`].
    pub buttons: u32,
    /// Inflow valve, 0 shut … 1 open.
    pub inflow_valve: f32,
    /// Outflow valve, 0 shut … 1 open.
    pub outflow_valve: f32,
    /// Set pressure of the pump, Pa.
    pub set_pressure_pa: f32,
    /// Light, 0…1.
    pub light: f32,
    /// Extension of the loop electrode beyond the sheath, or what the tips of jaws are apart, m.
    pub loop_extension_m: f32,
    /// Focus of the camera head: distance from the lens that is sharp, m, within [`FOCUS_RANGE_M`](crate::controls::FOCUS_RANGE_M); 0: none is stated.
    pub focus_m: f32,
}

/// What the hardware says at one of its own ticks.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct HardwareSample {
    /// Tick of the hardware's own clock.
    pub hardware_tick: u64,
    /// CLOCK_MONOTONIC of the sample, ns.
    pub time_ns: u64,
    /// Encoders, as a pose.
    pub pose: Pose,
    /// Velocity of the tip, m/s.
    pub velocity_m_s: [f32; 3],
    /// Force that the motors make at this moment, N.
    pub force_n: [f32; 3],
    /// Buttons, valves, light and focus.
    pub controls: Controls,
    /// What of pose and controls comes from the window's keys and mouse because the device has nothing for it: bits of
    /// [`WINDOW_ALL`](crate::controls::WINDOW_ALL), and [`WINDOW_HEAD_FREE`](crate::controls::WINDOW_HEAD_FREE); 0 if all of it is the device's own.
    pub from_window: u32,
}

/// One plane of the local contact model: F = stiffness · max(0, (point − x)·normal) · normal, x the tip. What touches the instrument elsewhere is in it
/// as it is felt at the tip.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ContactPlane {
    /// A point of the plane, m.
    pub point_m: [f32; 3],
    /// Stiffness along the normal, N/m.
    pub stiffness_n_m: f32,
    /// Unit normal, pointing to the free side.
    pub normal: [f32; 3],
    /// Damping along the normal, N·s/m.
    pub damping_n_s_m: f32,
}

/// The contact model that tissue hands to the servo.
///
/// Planes that together are stiffer than a servo can make a hand feel (1 080 N/m with the station's device, less with one that states less) are felt by a
/// share, force and all. How stiff they are together is the largest, over their normals, of the sum of all stiffness by the cosine to it, of those that do
/// not push as well.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ContactModel {
    /// Epoch of the tissue that made it; a higher one fences a lower one.
    pub epoch: u32,
    /// Incarnation of the tissue that made it.
    pub incarnation: u32,
    /// Tick of the tissue state that it describes.
    pub state_tick: u64,
    /// Tick of the input that the state was computed from.
    pub input_tick: u64,
    /// Planes in use.
    pub plane_count: u32,
    /// Coulomb's coefficient of friction between planes and tip, 0 to 1.
    pub friction: f32,
    /// Hash of the pose that the state was computed from: that of the input record for `input_tick`.
    pub pose_hash: u64,
    /// The planes; beyond `plane_count` they are zero.
    pub planes: [ContactPlane; MAX_PLANES],
}

/// No medium is said to flow faster, m/s: far above any jet, which the pump's 800 ml/min make 2 m/s fast.
pub const MAX_FLOW_M_S: f32 = 40.0;

/// No medium is said to push the scope along an axis with more, N: the flow of a scope that is thrust in, and the jet of 800 ml/min, make some 0.03 N.
pub const MAX_ON_SCOPE_N: f32 = 0.5;

/// How the medium moves where a piece floats that nothing holds.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PieceFlow {
    /// Registration number of the piece; where there is none it is 0, and so is the velocity. Those come last.
    pub object: u32,
    /// Mean velocity of the medium where it is, m/s.
    pub velocity_m_s: [f32; 3],
}

/// What tissue and servo are to know of the medium; all zero before a fluid has said anything.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Medium {
    /// Pressure in the cavity, Pa.
    pub pressure_pa: f32,
    /// The flow at free pieces.
    pub pieces: [PieceFlow; MAX_PIECES],
    /// What it does to scope and loop, as a force at the tip, N.
    pub on_scope_n: [f32; 3],
}

/// What both replicas of the servo compute from, once a tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct InputRecord {
    /// Station tick.
    pub tick: u64,
    /// Incarnation of the device that wrote it.
    pub device_incarnation: u64,
    /// The newest sample of the hardware.
    pub sample: HardwareSample,
    /// The newest valid contact model.
    pub model: ContactModel,
    /// Force that the last hop applied in the tick before, N.
    pub applied_n: [f32; 3],
    /// Pressure in the cavity, Pa, from the newest valid status of the fluid; 0 if there has been none.
    pub pressure_pa: f32,
    /// The flow that carries the largest free pieces, likewise.
    pub pieces: [PieceFlow; MAX_PIECES],
    /// Incarnation of the servo that the device follows, 0 if none: where both servos lost ticks, the other one adopts its state.
    pub selected_incarnation: u64,
    /// In a replay: what each servo is to go on from.
    pub replayed: [Replayed; 2],
    /// Tick of the fluid's state that pressure and flow are from; 0 in a replay, whose recording does not say it.
    pub medium_tick: u64,
    /// Its epoch; 0 if there has been none.
    pub medium_epoch: u32,
    /// What the device on the desk can do at most, as it states it, and as its damping carries it.
    pub limits: DeviceLimits,
    /// What the medium does to scope and loop, as a force at the tip, N, from the status that the pressure is from; it fades with the age of that.
    pub on_scope_n: [f32; 3],
    /// Zero.
    pub reserved: u32,
}

impl InputRecord {
    /// What it says of the medium.
    pub fn medium(&self) -> Medium {
        Medium { pressure_pa: self.pressure_pa, pieces: self.pieces, on_scope_n: self.on_scope_n }
    }
}

/// How far ahead of the present a record may be: not at all, but for what passes between two looks at the clock.
const MOST_AHEAD_TICKS: u64 = 100;
/// More than any device makes, N.
const MOST_N: f32 = 1_000.0;

/// What one replica of the servo answers.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ForceRecord {
    /// Tick of the input record that it answers.
    pub tick: u64,
    /// Hash of that input record; two replicas with equal hashes must have equal forces.
    pub input_hash: u64,
    /// Force on the hand, N.
    pub force_n: [f32; 3],
    /// Flags of the servo: bit 0 in contact, bit 1 saturated, [`FORCE_SHADOW`], [`FORCE_ASTRAY`], and its [`ForceRecord::lag`].
    pub flags: u32,
    /// Filter state after this tick; a newborn replica goes on from it.
    pub servo_state: [u64; SERVO_STATE_WORDS],
}

/// Bits of [`ForceRecord::flags`] from here on: its lag.
const LAG_SHIFT: u32 = 8;
/// Longest lag that is told, ticks.
const MOST_LAG: u64 = 255;

impl ForceRecord {
    /// How many ticks before `tick` the servo's state is from that this force went on from: 1, unless it lost ticks; 255 also stands for more.
    pub fn lag(&self) -> u32 {
        self.flags >> LAG_SHIFT & MOST_LAG as u32
    }
    /// The bits that say so.
    pub fn lag_bits(tick: u64, from_tick: u64) -> u32 {
        (tick.saturating_sub(from_tick).min(MOST_LAG) as u32) << LAG_SHIFT
    }
}

/// Bit of [`ForceRecord::flags`]: the replica is in its shadow phase and must not be chosen.
pub const FORCE_SHADOW: u32 = 4;
/// Ticks that a newborn servo must agree with the other one before it may be chosen: its shadow lasts so long, or longer.
pub const SHADOW_TICKS: u32 = 20;
/// Bit of [`ForceRecord::flags`]: the replica lost ticks or is newborn, and has not yet gone on from the other's state.
pub const FORCE_ASTRAY: u32 = 8;

/// What kind of force the last hop applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Applied {
    /// Computed for this tick or the one before.
    Fresh = 0,
    /// The last force, held.
    Held = 1,
    /// Ramping to zero.
    Ramped = 2,
    /// Zero: nothing has been computed yet, or the ramp has ended.
    Zero = 3,
}

/// What the device hands to the hardware.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ForceCommand {
    /// Station tick at which it was written.
    pub tick: u64,
    /// Tick of the input that the force was computed from.
    pub force_tick: u64,
    /// Force, N.
    pub force_n: [f32; 3],
    /// An [`Applied`].
    pub kind: u32,
    /// Incarnation of the replica that computed it.
    pub source_incarnation: u32,
    /// Incarnation of the device.
    pub device_incarnation: u32,
}

/// The force and tool record of one tick, in the device's ring.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AppliedRecord {
    /// Station tick.
    pub tick: u64,
    /// What was handed to the hardware.
    pub command: ForceCommand,
    /// The sample that the tick's input was made from.
    pub sample: HardwareSample,
    /// Tick of the contact model in use.
    pub model_tick: u64,
    /// Epoch of the contact model in use.
    pub model_epoch: u32,
    /// Incarnation of the tissue that made the contact model in use.
    pub model_incarnation: u32,
    /// When the command was there for the hardware, CLOCK_MONOTONIC, ns; 0 in lock-step, and not recorded.
    pub sent_ns: u64,
    /// Force applied in the tick before, N, as the tick's input says it: that of the record before, unless the device is newborn.
    pub before_n: [f32; 3],
    /// The servo's [`ForceRecord::lag`]; 0 if none was followed.
    pub lag: u16,
    /// One more than the index of that servo; 0 if none was followed, or an older recording does not say it.
    pub followed: u16,
    /// The medium, as the tick's input says it.
    pub pieces: [PieceFlow; MAX_PIECES],
    /// Pressure in the cavity, Pa, likewise.
    pub pressure_pa: f32,
    /// Epoch of the fluid's state that the medium is from.
    pub medium_epoch: u32,
    /// Its tick.
    pub medium_tick: u64,
    /// What the device on the desk could do at most, likewise.
    pub limits: DeviceLimits,
    /// What the medium does to scope and loop, N, likewise.
    pub on_scope_n: [f32; 3],
}

impl AppliedRecord {
    /// What the tick's input says of the medium.
    pub fn medium(&self) -> Medium {
        Medium { pressure_pa: self.pressure_pa, pieces: self.pieces, on_scope_n: self.on_scope_n }
    }

    /// Whether somebody who has it from a stream can believe it at a tick: a force that a motor makes, a place that a tip has, and no tick to come.
    pub fn can_be(&self, present: u64) -> bool {
        let (pose, on_scope_n) = (&self.sample.pose, &self.on_scope_n);
        self.tick <= present + MOST_AHEAD_TICKS
            && self.command.force_n.iter().chain(on_scope_n).all(|newton| newton.abs() <= MOST_N)
            && pose.position_m.iter().chain(&pose.orientation).all(|value| value.is_finite())
    }
}

/// One tick of the hardware's ledger.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LedgerEntry {
    /// Tick of the hardware's own clock.
    pub hardware_tick: u64,
    /// CLOCK_MONOTONIC, ns.
    pub time_ns: u64,
    /// Station tick at that time.
    pub station_tick: u64,
    /// Tick of the input that the command's force was computed from.
    pub force_tick: u64,
    /// Force commanded, N.
    pub force_n: [f32; 3],
    /// An [`Applied`], as the hardware judges it.
    pub kind: u32,
    /// Incarnation of the replica that computed it.
    pub source_incarnation: u32,
    /// Nonzero when the canaries saw the host itself stall.
    pub void: u32,
}

/// The hand that comes from a window: targets for the hardware, of which it takes what [`HardwareSample::from_window`] says.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PointerRecord {
    /// Counts records; a window that lives writes a hundred in a second, however slowly it draws.
    pub sequence: u64,
    /// Target of pitch, yaw, roll (rad), insertion (m), and of the horizon: how far the camera head is turned on the scope and the scope itself, rad; with
    /// [`WINDOW_HEAD_FREE`](crate::controls::WINDOW_HEAD_FREE) how far the head is on the scope.
    pub target: [f32; 5],
    /// Valves, buttons, pressure, light, focus.
    pub controls: Controls,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_applied_has_a_force_a_place_and_a_tick_that_can_be() {
        let good = AppliedRecord { tick: 5_000, ..AppliedRecord::default() };
        assert!(good.can_be(5_000) && AppliedRecord::default().can_be(5_000), "the second is of a tick that was skipped");
        let changes: [fn(&mut AppliedRecord); 5] = [
            |it| it.tick = u64::from(f32::NAN.to_bits()),
            |it| it.command.force_n[2] = f32::NAN,
            |it| it.command.force_n[0] = 1e9,
            |it| it.on_scope_n[1] = f32::INFINITY,
            |it| it.sample.pose.position_m[0] = f32::NAN,
        ];
        for (at, change) in changes.into_iter().enumerate() {
            let mut wrong = good;
            change(&mut wrong);
            assert!(!wrong.can_be(5_000), "{at}");
        }
    }
}
