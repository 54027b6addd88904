//! What the servo is given and gives: parameters, state, input, output, flags.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::friction::{MOST_BENT_M, SHARE};
use super::medium::{MAX_MEDIUM_N, RESERVE_J};
use crate::contact::ContactModel;
use crate::vector::{is_finite, sane};

/// Bound on the energy account of a state, J: 3.3 N over 0.1 m. More is a corrupt state.
pub(crate) const MAX_ENERGY_J: f32 = 0.33;

/// In [`ServoOutput::flags`]: at least one plane pushes.
pub const SERVO_CONTACT: u32 = 1;
/// In [`ServoOutput::flags`]: the force limit was reached.
pub const SERVO_SATURATED: u32 = 1 << 1;
/// In [`ServoOutput::flags`]: the model is too old for full force.
pub const SERVO_FADING: u32 = 1 << 2;
/// In [`ServoOutput::flags`]: the surface is on its way back to its place after a gap or a fade.
pub const SERVO_RETURNING: u32 = 1 << 3;
/// In [`ServoOutput::flags`]: the passivity controller damps.
pub const SERVO_PASSIVITY: u32 = 1 << 4;
/// In [`ServoOutput::flags`]: the force lags behind a contact model that jumped.
pub const SERVO_BLENDING: u32 = 1 << 5;
/// In [`ServoOutput::flags`]: a plane of the model could not be used.
pub const SERVO_BAD_PLANE: u32 = 1 << 6;
/// In [`ServoOutput::flags`]: pose, speed or time step could not be used; the tick counts as missing.
pub const SERVO_BAD_INPUT: u32 = 1 << 7;
/// In [`ServoOutput::flags`]: the given state was corrupt or from the future and was begun anew.
pub const SERVO_STATE_RESET: u32 = 1 << 8;
/// In [`ServoOutput::flags`]: ticks were missing before this one, more than are held.
pub const SERVO_GAP: u32 = 1 << 9;

/// Parameters of the servo. The defaults suit a desktop device of the Touch class behind a hand.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ServoParams {
    /// Largest force, N.
    pub max_force_n: f32,
    /// Wanted stiffness of the virtual coupling, N/m; limited by `coupling_limit_n_m`.
    pub coupling_stiffness_n_m: f32,
    /// Largest virtual damping B, all planes together, N·s/m.
    pub max_damping_n_s_m: f32,
    /// Physical damping b of device and grip that may be relied on, N·s/m.
    pub device_damping_n_s_m: f32,
    /// Ticks from reading the pose to applying its force.
    pub loop_delay_ticks: f32,
    /// Depth at which a plane's damping is fully there, m.
    pub damping_depth_m: f32,
    /// Ticks of age up to which a contact model is felt in full.
    pub full_age_ticks: u32,
    /// Ticks over which it then fades to nothing.
    pub fade_ticks: u32,
    /// Missing ticks that the last hop holds; equal to its `hold_ticks`.
    pub gap_hold_ticks: u32,
    /// Ticks over which the last hop then ramps to zero; equal to its `ramp_ticks`.
    pub gap_ramp_ticks: u32,
    /// Change of force per tick that a change of the contact model may cause beyond what motion explains, N: less than the 0.05 N that a fault may add
    /// to the step of a fault-free tick, because the first model after a gap is such a change.
    pub model_step_n: f32,
    /// The same while force comes back after a gap or a fade, N: the tissue that its model then comes from has mostly begun anew with the scope in its
    /// wall, and settles. So little that a hardware which reads every second of two forces still feels less than the 0.05 N.
    pub return_step_n: f32,
    /// Ticks for which that is so after a fade to nothing, and after a gap; after less of a fade as much fewer. More than the largest force takes to come
    /// back, and than such a tissue does to settle: of ten one was not done with it after 200.
    pub return_ticks: u32,
    /// Fastest motion of a hand that counts as an explanation, m/s.
    pub max_speed_m_s: f32,
    /// Speed at which the surface returns to its place after force was let go of while the tip was buried, m/s.
    pub return_speed_m_s: f32,
    /// Largest damping of the passivity controller, N·s/m.
    pub controller_damping_n_s_m: f32,
    /// Energy that contact may have in credit beyond what is stored, and at most in debt, J.
    pub energy_reserve_j: f32,
}

impl Default for ServoParams {
    fn default() -> Self {
        Self {
            max_force_n: 3.3,
            coupling_stiffness_n_m: 1200.0,
            max_damping_n_s_m: 1.0,
            device_damping_n_s_m: 3.0,
            loop_delay_ticks: 1.0,
            damping_depth_m: 0.5e-3,
            full_age_ticks: 100,
            fade_ticks: 200,
            gap_hold_ticks: 2,
            gap_ramp_ticks: 20,
            model_step_n: 0.04,
            return_step_n: 0.01,
            return_ticks: 400,
            max_speed_m_s: 1.0,
            return_speed_m_s: 0.03,
            controller_damping_n_s_m: 4.0,
            energy_reserve_j: 2e-3,
        }
    }
}

impl ServoParams {
    /// The same for a device that can do no more than this: N, N/m, N·s/m. What is not above 0 is not stated, and changes nothing.
    pub fn for_device(&self, max_force_n: f32, max_stiffness_n_m: f32, max_damping_n_s_m: f32) -> Self {
        Self {
            max_force_n: least(self.max_force_n, max_force_n),
            coupling_stiffness_n_m: least(self.coupling_stiffness_n_m, max_stiffness_n_m),
            max_damping_n_s_m: least(self.max_damping_n_s_m, max_damping_n_s_m),
            ..*self
        }
    }

    /// The same for a device that has no more physical damping than this, N·s/m; not above 0: it is not stated, and changes nothing. At most half of it is
    /// spent on virtual damping, so that [`coupling_limit_n_m`](Self::coupling_limit_n_m) leaves a coupling that is soft, and not none.
    pub fn relying_on(&self, device_damping_n_s_m: f32) -> Self {
        Self {
            device_damping_n_s_m: least(self.device_damping_n_s_m, device_damping_n_s_m),
            max_damping_n_s_m: least(self.max_damping_n_s_m, 0.5 * device_damping_n_s_m),
            ..*self
        }
    }

    /// The largest coupling stiffness that is passive with these parameters at a time step of `dt_s`, N/m, if friction adds a tenth of it:
    /// `min(wanted, (b − B) / (1.1 T (½ + delay)))`, at least 1.
    pub fn coupling_limit_n_m(&self, dt_s: f32) -> f32 {
        let delay = 0.5 + sane(self.loop_delay_ticks, 0.0, 100.0, 1.0);
        let spare = self.device_damping_n_s_m - self.max_damping_n_s_m;
        sane(self.coupling_stiffness_n_m.min(spare / ((1.0 + SHARE) * dt_s * delay)), 1.0, 1e5, 1.0)
    }

    /// The same parameters with each number inside its meaningful range; what is not a number becomes the safe end.
    pub(crate) fn checked(&self) -> Self {
        Self {
            max_force_n: sane(self.max_force_n, 0.0, 100.0, 0.0),
            coupling_stiffness_n_m: sane(self.coupling_stiffness_n_m, 1.0, 1e5, 1.0),
            max_damping_n_s_m: sane(self.max_damping_n_s_m, 0.0, 1e3, 0.0),
            device_damping_n_s_m: sane(self.device_damping_n_s_m, 0.0, 1e3, 0.0),
            loop_delay_ticks: sane(self.loop_delay_ticks, 0.0, 100.0, 1.0),
            damping_depth_m: sane(self.damping_depth_m, 1e-6, 1.0, 0.5e-3),
            gap_ramp_ticks: self.gap_ramp_ticks.max(1),
            fade_ticks: self.fade_ticks.max(1),
            model_step_n: sane(self.model_step_n, 0.0, 100.0, 0.04),
            return_step_n: sane(self.return_step_n, 0.0, 100.0, 0.01),
            max_speed_m_s: sane(self.max_speed_m_s, 1e-3, 100.0, 1.0),
            return_speed_m_s: sane(self.return_speed_m_s, 1e-3, 1.0, 0.03),
            controller_damping_n_s_m: sane(self.controller_damping_n_s_m, 0.0, 1e3, 0.0),
            energy_reserve_j: sane(self.energy_reserve_j, 0.0, 0.1, 0.0),
            ..*self
        }
    }
}

/// The smaller of what is wanted and what a device states; what is not above 0 is not stated.
fn least(own: f32, stated: f32) -> f32 {
    if stated > 0.0 { own.min(stated) } else { own }
}

/// State of the servo: 128 bytes, a message like any other state. All zero is a servo that never ran.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ServoState {
    /// Tick of the last step.
    pub tick: u64,
    /// Device position then, m.
    pub position_m: [f32; 3],
    /// Device velocity then, m/s.
    pub velocity_m_s: [f32; 3],
    /// Proxy position then, m.
    pub proxy_m: [f32; 3],
    /// Force then, N, on the hand.
    pub force_n: [f32; 3],
    /// Where the planes are felt less where they are, m: not zero while the surface returns to its place.
    pub shift_m: [f32; 3],
    /// Energy taken up from the hand since contact began, less what was given back, J; negative is a debt.
    pub energy_j: f32,
    /// Progress of the fade, 1 (full force) to 0 (no force); the gain is its smoothstep.
    pub ramp: f32,
    /// 1 once a step was made.
    pub running: u32,
    /// Ticks since contact began; 0 out of contact.
    pub contact_ticks: u32,
    /// Steps that followed a gap longer than is held, for the report.
    pub gaps: u32,
    /// The passivity controller's damping, N·s/m.
    pub damper_n_s_m: f32,
    /// Ticks for which force is still on its way back after a gap or a fade.
    pub return_ticks: u32,
    /// What of the force is the medium's, N.
    pub medium_n: [f32; 3],
    /// Energy that the medium has taken from the hand, less what it gave, J; negative is a debt.
    pub medium_j: f32,
    /// How far the bristle is bent by which the planes hold the tip back where it slides along them, m.
    pub bristle_m: [f32; 3],
    /// Zero.
    pub reserved: u32,
}

impl ServoState {
    /// From the words in which a force record carries it; of too few of them a state that is none.
    pub fn of_words(words: &[u64]) -> ServoState {
        let bytes = bytemuck::cast_slice::<u64, u8>(words).get(..size_of::<ServoState>());
        bytes.map(bytemuck::pod_read_unaligned).unwrap_or_default()
    }

    /// Whether a step for a tick after the state's can go on from it: every number is finite and in its range.
    pub fn is_sound(&self, params: &ServoParams) -> bool {
        self.running == 1 && self.repaired(&params.checked(), u64::MAX).1 == 0
    }

    /// The state if it is whole and from before `tick`, else a fresh one with the flag that says so.
    pub(crate) fn repaired(&self, params: &ServoParams, tick: u64) -> (Self, u32) {
        if self.running == 0 {
            return (Self::default(), 0);
        }
        let vectors =
            [self.position_m, self.velocity_m_s, self.proxy_m, self.force_n, self.shift_m, self.medium_n, self.bristle_m];
        let finite = vectors.into_iter().all(is_finite) && self.shift_m.iter().all(|c| c.abs() <= 2.0);
        let bristle = self.bristle_m.iter().all(|c| c.abs() <= MOST_BENT_M);
        let ramp = (0.0..=1.0).contains(&self.ramp);
        let damper = (0.0..=params.controller_damping_n_s_m).contains(&self.damper_n_s_m);
        let energy = self.energy_j.abs() <= MAX_ENERGY_J;
        let force = Vec3::from_array(self.force_n).as_dvec3().length() <= f64::from(params.max_force_n);
        let medium = self.medium_n.iter().all(|newton| newton.abs() <= 2.0 * MAX_MEDIUM_N) && self.medium_j.abs() <= RESERVE_J;
        if finite && bristle && ramp && damper && energy && force && medium && self.running == 1 && self.tick < tick {
            return (*self, 0);
        }
        (Self::default(), SERVO_STATE_RESET)
    }
}

/// What one step reads. Both replicas must be given the same.
#[derive(Clone, Copy, Debug)]
pub struct ServoInput<'a> {
    /// The tick that the force is for.
    pub tick: u64,
    /// Tip position, m, station frame.
    pub position_m: [f32; 3],
    /// Tip velocity, m/s.
    pub velocity_m_s: [f32; 3],
    /// Length of a tick, s; outside 0.1–10 ms the tick counts as missing.
    pub dt_s: f32,
    /// The newest contact model.
    pub model: &'a ContactModel,
    /// Its age, now minus its tick; `u32::MAX` if there never was one.
    pub model_age_ticks: u32,
    /// The force that the device applied at the tick before, N, if its input record says so. It is used only where the servo's
    /// own last force is not what the hand feels: without a state and after missing ticks.
    pub applied_n: Option<[f32; 3]>,
    /// What the medium does to the scope, as a force at the tip, N; what is no number counts as 0, and what is more than 0.5 along an axis as that.
    pub medium_n: [f32; 3],
}

impl ServoInput<'_> {
    /// True if every number of the input can be used. (The planes are checked one by one.)
    pub(crate) fn usable(&self) -> bool {
        is_finite(self.position_m)
            && self.position_m.iter().all(|c| c.abs() <= 2.0)
            && is_finite(self.velocity_m_s)
            && (1e-4..=1e-2).contains(&self.dt_s)
    }
}

/// What one step gives.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ServoOutput {
    /// Force on the hand, N; finite, no longer than `max_force_n`.
    pub force_n: [f32; 3],
    /// `SERVO_…` bits.
    pub flags: u32,
}

/// What other processes map must not change size unnoticed.
const _: () = assert!(size_of::<ServoState>() == 128 && size_of::<ContactModel>() == 272);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo_step;

    #[test]
    fn a_device_of_less_damping_gets_a_softer_coupling_by_hand_arithmetic_and_one_that_states_none_the_usual_one() {
        let own = ServoParams::default();
        for not_stated in [0.0, -1.0, f32::NAN] {
            assert_eq!(own.relying_on(not_stated), own, "{not_stated}");
        }
        assert_eq!(own.relying_on(13.4), own, "more is not relied on");
        // (b − B) / 1.65 ms, with B = 1 N·s/m, or half of b.
        for (damping_n_s_m, virtual_n_s_m, limit_n_m) in
            [(3.0, 1.0, 1_200.0), (2.5, 1.0, 909.09), (2.0, 1.0, 606.06), (0.6, 0.3, 181.82)]
        {
            let params = own.relying_on(damping_n_s_m);
            assert_eq!(params.max_damping_n_s_m, virtual_n_s_m, "{damping_n_s_m}");
            let found_n_m = params.coupling_limit_n_m(1e-3);
            assert!((found_n_m - limit_n_m).abs() < 0.1, "{damping_n_s_m} N·s/m: {found_n_m} N/m");
        }
    }

    #[test]
    fn a_state_whose_bristle_cannot_be_is_begun_anew_and_says_so_and_one_that_is_sound_goes_on() {
        let (params, model) = (ServoParams::default(), ContactModel::default());
        let flags_of = |state: &ServoState| {
            let input = ServoInput {
                tick: 8,
                position_m: [0.0; 3],
                velocity_m_s: [0.0; 3],
                dt_s: 1e-3,
                model: &model,
                model_age_ticks: 1,
                applied_n: None,
                medium_n: [0.0; 3],
            };
            servo_step(&params, state, &input).1.flags
        };
        let bristle_m = [0.3e-3, -MOST_BENT_M, MOST_BENT_M];
        let sound = ServoState { tick: 7, ramp: 1.0, running: 1, bristle_m, ..ServoState::default() };
        assert_eq!(sound.repaired(&params, 8), (sound, 0));
        assert!(sound.is_sound(&params) && flags_of(&sound) & SERVO_STATE_RESET == 0);
        let too_far_m = 1.001 * MOST_BENT_M;
        for part_m in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, too_far_m, -too_far_m] {
            for axis in 0..3 {
                let mut bent = sound;
                bent.bristle_m[axis] = part_m;
                assert_eq!(bent.repaired(&params, 8), (ServoState::default(), SERVO_STATE_RESET), "{part_m} m, axis {axis}");
                assert!(!bent.is_sound(&params) && flags_of(&bent) & SERVO_STATE_RESET != 0, "{part_m} m, axis {axis}");
            }
        }
    }

    #[test]
    fn a_device_that_can_do_less_is_asked_for_less_and_one_that_can_do_more_changes_nothing() {
        let own = ServoParams::default();
        assert_eq!(own.for_device(3.3, 1_200.0, 1.0), own, "the simulated device");
        assert_eq!(own.for_device(10.0, 5_000.0, 4.0), own);
        assert_eq!(own.for_device(0.0, f32::NAN, 0.0), own, "nothing is stated");
        let weak = own.for_device(0.9, 300.0, 0.2);
        assert_eq!((weak.max_force_n, weak.max_damping_n_s_m), (0.9, 0.2));
        assert!(own.coupling_limit_n_m(1e-3) > 300.0 && weak.coupling_limit_n_m(1e-3) <= 300.0);
        // A tip that is pushed two centimetres into a wall.
        let wall = crate::Plane { point_m: [0.0; 3], normal: [0.0, 0.0, -1.0], stiffness_n_m: 2_000.0, damping_n_s_m: 0.0 };
        let model = ContactModel::new(&[wall]);
        let force_n = |params: &ServoParams| {
            let (mut state, mut force_n) = (ServoState::default(), 0.0f32);
            for tick in 1..400u32 {
                let input = ServoInput {
                    tick: u64::from(tick),
                    position_m: [0.0, 0.0, (tick as f32 * 1e-4).min(0.02)],
                    velocity_m_s: [0.0, 0.0, if tick < 200 { 0.1 } else { 0.0 }],
                    dt_s: 1e-3,
                    model: &model,
                    model_age_ticks: 1,
                    applied_n: None,
                    medium_n: [0.0; 3],
                };
                let (next, output) = servo_step(params, &state, &input);
                (state, force_n) = (next, Vec3::from_array(output.force_n).length());
            }
            force_n
        };
        let (strong_n, weak_n) = (force_n(&own), force_n(&weak));
        assert!(strong_n > 3.0 && (0.8..=0.9001).contains(&weak_n), "{strong_n} N, {weak_n} N");
    }
}
