//! The last hop: the only code between a computed force and the hardware (device process, 1 kHz).
//!
//! It promises, whatever the candidates are: what it applies is finite, never longer than `max_force_n`, and changes per tick by
//! no more than [`LastHopParams::slew_n`]. Without a valid candidate it holds the applied force for `hold_ticks`, then ramps
//! to exactly zero in `ramp_ticks`, straight. Force returns through a rise of `rise_ticks`, from where the ramp had come to.
//! With nothing missing and steps within the slew limit it passes the candidate on bit for bit.
//!
//! All that it remembers is in [`LastHopState`], which belongs into a shared page, so that both sides of a takeover filter with it.
//!
//! Small-force gate: a station that starts with the tip buried would push at once. Until the first candidate of at most
//! `gate_n` nothing is applied; a state made by [`LastHopState::resumed`] has passed the gate and is ramped instead.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::hardware::HardwareParams;
use crate::vector::{clamp_length, is_finite, sane, step_towards};

/// Parameters of the last hop.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LastHopParams {
    /// Largest force, N. A candidate above it (by more than rounding) is invalid: it is dropped, not shortened.
    pub max_force_n: f32,
    /// Largest change of the applied force per tick, N; see [`LastHopParams::slew_n`].
    pub max_slew_n_per_tick: f32,
    /// Ticks for which the force is held when none is valid.
    pub hold_ticks: u32,
    /// Ticks of the ramp to zero after that (20 ms).
    pub ramp_ticks: u32,
    /// Ticks for the full return of the force after a ramp.
    pub rise_ticks: u32,
    /// Small force, N, that may be applied at once before the first contact; 0 or less switches the gate off.
    pub gate_n: f32,
    /// Difference of force, N, that may be applied at once after a ramp: what returns by more than that rises.
    pub return_n: f32,
}

impl Default for LastHopParams {
    fn default() -> Self {
        Self {
            max_force_n: 3.3,
            max_slew_n_per_tick: 0.5,
            hold_ticks: 2,
            ramp_ticks: 20,
            rise_ticks: 50,
            gate_n: 0.2,
            return_n: 0.05,
        }
    }
}

impl LastHopParams {
    /// The slew limit in force, N per tick: never less than the ramp to zero needs, because the fade is the stronger promise.
    pub fn slew_n(&self) -> f32 {
        let ramp = self.max_force_n() / self.ramp_ticks.max(1) as f32;
        // A little more, so that rounding does not shorten the last steps of the ramp.
        sane(self.max_slew_n_per_tick, 0.0, 1e3, 0.0).max(ramp * (1.0 + 1e-4))
    }

    /// The force limit, 0 if the parameter is not a number.
    fn max_force_n(&self) -> f32 {
        sane(self.max_force_n, 0.0, 1e3, 0.0)
    }
}

/// State of the last hop: 40 bytes. All zero is a device that never applied a force and whose gate is shut.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LastHopState {
    /// Force applied at the last tick, N, on the hand.
    pub applied_n: [f32; 3],
    /// Force that the ramp to zero began with, N.
    pub ramp_from_n: [f32; 3],
    /// Ticks since the last valid candidate.
    pub missing_ticks: u32,
    /// Share of the candidate that is applied, 0 to 1.
    pub gain: f32,
    /// 1 once the small-force gate was passed.
    pub engaged: u32,
    /// 1 after a ramp or a restart: the next candidate sets `gain` to the share of it that is applied already.
    pub returning: u32,
}

impl LastHopState {
    /// The state of a device process that starts anew while the hardware still applies `applied_n` (0 after its watchdog):
    /// past the gate, force returns by the rise, no kick. One that this station never asks for counts as zero: it is what the servos are told of and what is
    /// booked as work on the hand.
    pub fn resumed(applied_n: [f32; 3]) -> Self {
        let applied_n = if is_valid(&LastHopParams::default(), applied_n) { applied_n } else { [0.0; 3] };
        Self { applied_n, engaged: 1, returning: 1, ..Self::default() }
    }

    /// The state of a device process that is born: [`LastHopState::resumed`] where the motors make a force or have made one before, for
    /// then the gate was passed; else all zero.
    pub fn born(applied_n: [f32; 3], has_pushed: bool) -> Self {
        if has_pushed || applied_n != [0.0; 3] { Self::resumed(applied_n) } else { Self::default() }
    }

    /// The state while another life of the hardware has said nothing yet: it is to find no force commanded. The gate stays as it was.
    pub fn unplugged(self) -> Self {
        let returning = self.engaged;
        Self { applied_n: [0.0; 3], ramp_from_n: [0.0; 3], returning, ..self }
    }

    /// The state when it says first what its motors make: the force returns from there by the rise, once the gate is passed.
    pub fn replugged(self, felt_n: [f32; 3]) -> Self {
        if self.engaged == 0 { self } else { Self::resumed(felt_n) }
    }

    /// The state of a device process that was not let run and has sent nothing for `silent_ticks` ticks: the hardware's watchdog has
    /// taken a part of the force away, and the force returns from what is left: `felt_n`, which the motors made at their newest sample, or
    /// less, if that is from before. A shorter silence than the watchdog's changes nothing.
    pub fn after_silence(self, hardware: &HardwareParams, silent_ticks: u32, felt_n: [f32; 3]) -> Self {
        // The hardware may have counted one more by now.
        if self.engaged == 0 || hardware.left(silent_ticks.saturating_add(1)) >= 1.0 {
            return self;
        }
        let least_n = self.applied_n.map(|force| force * hardware.left(silent_ticks));
        let is_less = is_finite(felt_n) && Vec3::from_array(felt_n).length() < Vec3::from_array(least_n).length();
        Self::resumed(if is_less { felt_n } else { least_n })
    }
}

/// What was applied at a tick.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppliedKind {
    /// A candidate computed for this tick (through rise and slew limit).
    Fresh = 0,
    /// The last force once more.
    Held = 1,
    /// A share of the last force, on the way to zero.
    Ramped = 2,
    /// Nothing: the ramp has ended, or the gate is shut.
    Zero = 3,
}

/// One tick. `candidate` is the chosen force, N, or `None` if there was none by the deadline; NaN, infinity and more than
/// `max_force_n` count as `None`. Returns the next state, the force to apply, and what it is.
pub fn last_hop_step(
    params: &LastHopParams,
    state: &LastHopState,
    candidate: Option<[f32; 3]>,
) -> (LastHopState, [f32; 3], AppliedKind) {
    let mut next = repaired(params, state);
    let kind = match candidate.filter(|force| is_valid(params, *force)) {
        Some(force) => follow(params, &mut next, Vec3::from_array(force)),
        None => let_go(params, &mut next),
    };
    (next, next.applied_n, kind)
}

/// True if a candidate may be applied at all.
fn is_valid(params: &LastHopParams, force: [f32; 3]) -> bool {
    // One part in 10⁵ for the rounding of whoever clamped it.
    let limit = f64::from(params.max_force_n()) * (1.0 + 1e-5);
    is_finite(force) && Vec3::from_array(force).as_dvec3().length() <= limit
}

/// Follows a valid candidate.
fn follow(params: &LastHopParams, next: &mut LastHopState, force: Vec3) -> AppliedKind {
    if next.returning == 1 {
        (next.gain, next.returning) = (share_of(params, Vec3::from_array(next.applied_n), force), 0);
    }
    next.missing_ticks = 0;
    if next.engaged == 0 && (params.gate_n <= 0.0 || force.length() <= params.gate_n) {
        (next.engaged, next.gain) = (1, 1.0);
    }
    let open = next.engaged == 1;
    if open {
        next.gain = (next.gain + 1.0 / params.rise_ticks.max(1) as f32).min(1.0);
    }
    let share = if open { next.gain } else { 0.0 };
    let target = clamp_length(force * share, params.max_force_n());
    next.applied_n = step_towards(Vec3::from_array(next.applied_n), target, params.slew_n()).to_array();
    if open { AppliedKind::Fresh } else { AppliedKind::Zero }
}

/// Holds, then ramps to zero.
fn let_go(params: &LastHopParams, next: &mut LastHopState) -> AppliedKind {
    if next.missing_ticks == 0 {
        next.ramp_from_n = next.applied_n;
    }
    next.missing_ticks = next.missing_ticks.saturating_add(1);
    if next.engaged == 0 {
        next.applied_n = [0.0; 3];
        return AppliedKind::Zero;
    }
    if next.missing_ticks <= params.hold_ticks {
        return AppliedKind::Held;
    }
    next.returning = 1;
    let left = 1.0 - ramp_progress(params, next.missing_ticks);
    let target = Vec3::from_array(next.ramp_from_n) * left;
    next.applied_n = step_towards(Vec3::from_array(next.applied_n), target, params.slew_n()).to_array();
    if next.applied_n == [0.0; 3] { AppliedKind::Zero } else { AppliedKind::Ramped }
}

/// The share of `force` that is applied already, 0 to 1: the rise begins where the hand is. A candidate that differs from the
/// applied force by `return_n` only needs no rise; so a servo that comes back gently itself is not ramped twice.
fn share_of(params: &LastHopParams, applied: Vec3, force: Vec3) -> f32 {
    if (force - applied).length() <= params.return_n.max(0.0) {
        return 1.0;
    }
    let squared = force.length_squared();
    if squared > 0.0 { (applied.dot(force) / squared).clamp(0.0, 1.0) } else { 1.0 }
}

/// How far the ramp to zero has come after `missing` ticks, 0 to 1.
fn ramp_progress(params: &LastHopParams, missing: u32) -> f32 {
    let ramped = missing.saturating_sub(params.hold_ticks);
    (ramped as f32 / params.ramp_ticks.max(1) as f32).min(1.0)
}

/// The state, or where its bytes make no sense the nearest safe one: zero force.
fn repaired(params: &LastHopParams, state: &LastHopState) -> LastHopState {
    let whole = is_valid(params, state.applied_n)
        && is_valid(params, state.ramp_from_n)
        && (0.0..=1.0).contains(&state.gain)
        && state.engaged <= 1
        && state.returning <= 1;
    if whole { *state } else { LastHopState::resumed([0.0; 3]) }
}

/// What other processes map must not change size unnoticed.
const _: () = assert!(size_of::<LastHopState>() == 40);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::{HardwareState, hardware_step};

    const PRESS: [f32; 3] = [0.3, -0.2, -1.1];

    fn running(params: &LastHopParams) -> LastHopState {
        let mut state = LastHopState { engaged: 1, gain: 1.0, ..LastHopState::default() };
        for _ in 0..20 {
            state = last_hop_step(params, &state, Some(PRESS)).0;
        }
        state
    }

    #[test]
    fn a_valid_candidate_within_the_slew_limit_is_applied_bit_for_bit() {
        let params = LastHopParams::default();
        let (_, applied, kind) = last_hop_step(&params, &running(&params), Some([0.31, -0.21, -1.2]));
        assert_eq!((applied, kind), ([0.31, -0.21, -1.2], AppliedKind::Fresh));
    }

    #[test]
    fn two_ticks_are_held_then_twenty_ramp_to_exactly_zero() {
        let params = LastHopParams::default();
        let mut state = running(&params);
        for missing in 1..=30u32 {
            let (next, applied, kind) = last_hop_step(&params, &state, None);
            let expected = match missing {
                1..=2 => AppliedKind::Held,
                3..=21 => AppliedKind::Ramped,
                _ => AppliedKind::Zero,
            };
            assert_eq!(kind, expected, "tick {missing}");
            let left = 1.0 - missing.saturating_sub(2).min(20) as f32 / 20.0;
            assert_eq!(applied, PRESS.map(|f| f * left), "tick {missing}");
            state = next;
        }
    }

    #[test]
    fn invalid_candidates_count_as_missing_and_are_never_applied() {
        let params = LastHopParams::default();
        let state = running(&params);
        for bad in [[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0, 0.0, 3.31], [2.5; 3], [f32::MAX; 3]] {
            let (next, applied, kind) = last_hop_step(&params, &state, Some(bad));
            assert_eq!((applied, kind, next.missing_ticks), (PRESS, AppliedKind::Held, 1), "{bad:?}");
        }
    }

    #[test]
    fn after_a_ramp_force_returns_without_a_kick() {
        let params = LastHopParams::default();
        let mut state = running(&params);
        for _ in 0..12 {
            state = last_hop_step(&params, &state, None).0;
        }
        let before = Vec3::from_array(state.applied_n);
        let (next, applied, _) = last_hop_step(&params, &state, Some(PRESS));
        assert!((Vec3::from_array(applied) - before).length() < 0.05, "{before} to {applied:?}");
        state = next;
        for _ in 0..50 {
            state = last_hop_step(&params, &state, Some(PRESS)).0;
        }
        assert_eq!(state.applied_n, PRESS);
    }

    #[test]
    fn the_gate_lets_nothing_through_until_the_tip_is_free() {
        let params = LastHopParams::default();
        let mut state = LastHopState::default();
        for _ in 0..5 {
            let (next, applied, kind) = last_hop_step(&params, &state, Some(PRESS));
            assert_eq!((applied, kind), ([0.0; 3], AppliedKind::Zero));
            state = next;
        }
        let (next, applied, kind) = last_hop_step(&params, &state, Some([0.0, 0.0, 0.1]));
        assert_eq!((applied, kind, next.engaged), ([0.0, 0.0, 0.1], AppliedKind::Fresh, 1));
    }

    #[test]
    fn a_corrupt_state_becomes_zero_force_not_a_panic() {
        let corrupt = LastHopState { applied_n: [f32::NAN; 3], gain: 7.0, engaged: 9, ..LastHopState::default() };
        let (_, applied, _) = last_hop_step(&LastHopParams::default(), &corrupt, None);
        assert_eq!(applied, [0.0; 3]);
    }

    #[test]
    fn a_slew_limit_below_the_ramp_gives_way_to_the_ramp() {
        let params = LastHopParams { max_slew_n_per_tick: 0.01, ..LastHopParams::default() };
        let mut state = LastHopState { applied_n: [0.0, 0.0, 3.3], gain: 1.0, engaged: 1, ..LastHopState::default() };
        for _ in 0..22 {
            state = last_hop_step(&params, &state, None).0;
        }
        assert_eq!(state.applied_n, [0.0; 3]);
    }

    #[test]
    fn a_device_that_was_not_let_run_goes_on_from_what_the_watchdog_has_left() {
        let (params, hardware) = (LastHopParams::default(), HardwareParams::default());
        let before = running(&params);
        assert_eq!(before.after_silence(&hardware, hardware.watchdog_ticks - 1, PRESS), before, "the force was held");
        let shut = LastHopState::default();
        assert_eq!(shut.after_silence(&hardware, 100, PRESS), shut, "what never applied a force has its gate to pass");
        let of_nonsense = before.after_silence(&hardware, 18, [f32::NAN; 3]);
        assert_eq!(of_nonsense, before.after_silence(&hardware, 18, PRESS), "a sample from before, and one that says nothing");
        // The hardware may have counted one more by the time the device is let run.
        for (silent_ticks, ahead) in (1..100u32).flat_map(|ticks| [(ticks, 0), (ticks, 1)]) {
            let mut motors = HardwareState { command_n: PRESS, force_n: PRESS, ..HardwareState::default() };
            for _ in 0..silent_ticks + ahead {
                motors = hardware_step(&hardware, &motors, None).0;
            }
            let (mut state, mut felt) =
                (before.after_silence(&hardware, silent_ticks, motors.force_n), Vec3::from_array(motors.force_n));
            for _ in 0..=50 {
                let (next, applied, _) = last_hop_step(&params, &state, Some(PRESS));
                let step_n = (Vec3::from_array(applied) - felt).length();
                assert!(step_n <= params.return_n, "{step_n} N after {silent_ticks} ticks");
                (state, felt) = (next, Vec3::from_array(applied));
            }
            assert_eq!(state.applied_n, PRESS);
        }
    }

    /// Who pressed on while the driver was started again felt nothing until he drew back: the gate was shut anew.
    #[test]
    fn another_life_of_the_hardware_finds_no_force_and_then_feels_it_rise() {
        let params = LastHopParams::default();
        for silent_ticks in [0, 1, 2, 3, 40] {
            let mut state = running(&params).unplugged();
            for _ in 0..silent_ticks {
                state = last_hop_step(&params, &state.unplugged(), None).0;
                assert_eq!(state.applied_n, [0.0; 3], "{silent_ticks}");
            }
            state = state.replugged([0.0; 3]);
            for _ in 0..=params.rise_ticks {
                let (next, applied, _) = last_hop_step(&params, &state, Some(PRESS));
                let step_n = (Vec3::from_array(applied) - Vec3::from_array(state.applied_n)).length();
                assert!(step_n <= params.return_n, "{step_n} N after {silent_ticks} ticks");
                state = next;
            }
            assert_eq!(state.applied_n, PRESS);
        }
        let shut = LastHopState::default();
        assert_eq!([shut.unplugged(), shut.replugged(PRESS), LastHopState::born([0.0; 3], false)], [shut; 3], "not passed yet");
        assert_eq!(LastHopState::born([0.0; 3], true), LastHopState::resumed([0.0; 3]), "passed before");
    }

    /// A driver that said 1 MN once was told of to the servos, and with it so much work was booked that no force was applied for seconds.
    #[test]
    fn a_force_that_no_station_asks_for_is_none_to_go_on_from() {
        for felt_n in [[0.0, 0.0, 3.4], [1e6, 0.0, 0.0], [f32::MAX; 3], [f32::INFINITY; 3], [f32::NAN; 3]] {
            assert_eq!(LastHopState::resumed(felt_n), LastHopState::resumed([0.0; 3]), "{felt_n:?}");
        }
        assert_eq!(LastHopState::resumed([0.0, 0.0, 3.3]).applied_n, [0.0, 0.0, 3.3]);
    }

    #[test]
    fn a_resumed_device_goes_on_at_the_force_of_the_hardware() {
        let params = LastHopParams::default();
        let (_, applied, kind) = last_hop_step(&params, &LastHopState::resumed(PRESS), Some(PRESS));
        assert_eq!((applied, kind), (PRESS, AppliedKind::Fresh));
        let from_nothing = last_hop_step(&params, &LastHopState::resumed([0.0; 3]), Some(PRESS)).1;
        assert!(Vec3::from_array(from_nothing).length() < 0.05, "{from_nothing:?}");
        let ungated = LastHopParams { return_n: 0.0, ..params };
        let (state, _, _) = last_hop_step(&ungated, &LastHopState::resumed(PRESS), Some([0.0; 3]));
        assert_eq!(state.gain, 1.0);
    }
}
