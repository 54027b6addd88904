//! Is a force record worth applying? The consumer checks; it never trusts the producer.
//!
//! Three checks of rising depth:
//! - [`valid_force`]: the record alone (finite, in range, fresh).
//! - [`input_digest`]: the producer puts the digest of the input that it computed from beside its force; the device compares
//!   it with the input that it published. A force computed from an old input is found at once, even a force of zero.
//! - [`watch_step`]: a stamp that stands still and an output that stays the same while the tip moved against it, for
//!   producers that put a right stamp and digest on a wrong force.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::servo::ServoInput;
use crate::vector::is_finite;

/// Limits of a force record.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ForceLimits {
    /// Largest force, N.
    pub max_force_n: f32,
    /// Oldest record that is fresh, ticks: a force for this tick or the one before.
    pub max_age_ticks: u32,
}

impl Default for ForceLimits {
    fn default() -> Self {
        Self { max_force_n: 3.3, max_age_ticks: 1 }
    }
}

/// Why a force record must not be applied.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceFault {
    /// A component is NaN or infinite.
    NotFinite = 1,
    /// Longer than the force limit.
    TooLarge = 2,
    /// Computed for a tick that is too long ago.
    Stale = 3,
    /// Computed for a tick that has not come yet.
    FromFuture = 4,
}

/// Checks a force, N, computed for `record_tick`, at `tick_now`.
pub fn valid_force(tick_now: u64, record_tick: u64, force_n: [f32; 3], limits: &ForceLimits) -> Result<(), ForceFault> {
    if !is_finite(force_n) {
        return Err(ForceFault::NotFinite);
    }
    // One part in 10⁵ for the rounding of whoever clamped it. Written so that a limit of NaN refuses everything.
    let within = Vec3::from_array(force_n).as_dvec3().length() <= f64::from(limits.max_force_n) * (1.0 + 1e-5);
    if !within {
        return Err(ForceFault::TooLarge);
    }
    match tick_now.checked_sub(record_tick) {
        None => Err(ForceFault::FromFuture),
        Some(age) if age > u64::from(limits.max_age_ticks) => Err(ForceFault::Stale),
        Some(_) => Ok(()),
    }
}

/// A number that names the input of a servo step: tick, pose, speed, time step, medium, and which contact model (by age and count).
/// FNV-1a over the words; equal inputs give equal digests, and an input of another tick gives another one.
pub fn input_digest(input: &ServoInput) -> u64 {
    let [px, py, pz] = input.position_m.map(f32::to_bits);
    let [vx, vy, vz] = input.velocity_m_s.map(f32::to_bits);
    let (high, low) = ((input.tick >> 32) as u32, input.tick as u32);
    let [mx, my, mz] = input.medium_n.map(f32::to_bits);
    let words = [high, low, px, py, pz, vx, vy, vz, mx, my, mz, input.dt_s.to_bits(), input.model_age_ticks, input.model.count];
    words
        .into_iter()
        .flat_map(u32::to_le_bytes)
        .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Parameters of the watch over one producer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct WatchParams {
    /// Looks without a newer stamp after which the producer stands still.
    pub still_limit: u32,
    /// New records with the same force, each after motion against it, after which the output is frozen.
    pub frozen_limit: u32,
    /// Motion along the force, m, that must change it.
    pub min_motion_m: f32,
    /// Force limit, N: at the limit an equal force proves nothing.
    pub max_force_n: f32,
}

impl Default for WatchParams {
    fn default() -> Self {
        Self { still_limit: 3, frozen_limit: 3, min_motion_m: 20e-6, max_force_n: 3.3 }
    }
}

/// State of the watch over one producer. All zero is a producer not seen yet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WatchState {
    /// Newest stamp seen.
    pub record_tick: u64,
    /// Force of that record, N.
    pub force_n: [f32; 3],
    /// Tip position when the force last counted as explained, m.
    pub position_m: [f32; 3],
    /// Looks since a newer stamp.
    pub still: u32,
    /// Suspicious records in a row.
    pub frozen: u32,
    /// 1 once a record was seen.
    pub seen: u32,
    /// Explicit padding, zero.
    pub reserved: u32,
}

/// What the consumer saw at one look.
#[derive(Clone, Copy, Debug)]
pub struct WatchInput {
    /// Stamp of the newest record.
    pub record_tick: u64,
    /// Its force, N.
    pub force_n: [f32; 3],
    /// Tip position that it was computed from, m.
    pub position_m: [f32; 3],
    /// The digest that the record carries.
    pub digest: u64,
    /// The digest of the input published for `record_tick`.
    pub expected_digest: u64,
}

/// What the watch says about a producer.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchVerdict {
    /// Nothing to say against it.
    Alive = 0,
    /// Its stamp stands still: it hangs or is dead.
    StampStill = 1,
    /// It stamped this tick but computed from another input.
    WrongInput = 2,
    /// Its force stays the same although the tip moved against it.
    OutputFrozen = 3,
}

/// One look at a producer, once per tick.
///
/// An output counts as frozen only if motion must have changed it: the force is neither zero nor at its limit, and the tip
/// moved by `min_motion_m` along it. Sliding along a wall, resting, and free motion are no suspicion.
pub fn watch_step(params: &WatchParams, state: &WatchState, input: &WatchInput) -> (WatchState, WatchVerdict) {
    let mut next = *state;
    if state.seen == 1 && input.record_tick <= state.record_tick {
        next.still = next.still.saturating_add(1);
        let verdict = if next.still >= params.still_limit { WatchVerdict::StampStill } else { WatchVerdict::Alive };
        return (next, verdict);
    }
    let same = state.seen == 1 && state.force_n.map(f32::to_bits) == input.force_n.map(f32::to_bits);
    let force = Vec3::from_array(input.force_n);
    let telling = force.length() > 0.0 && force.length() < 0.999 * params.max_force_n;
    let moved = Vec3::from_array(input.position_m) - Vec3::from_array(state.position_m);
    let against = moved.dot(force.normalize_or_zero()).abs();
    (next.record_tick, next.force_n, next.still, next.seen) = (input.record_tick, input.force_n, 0, 1);
    if !(same && telling) {
        (next.frozen, next.position_m) = (0, input.position_m);
    } else if against >= params.min_motion_m {
        (next.frozen, next.position_m) = (next.frozen.saturating_add(1), input.position_m);
    }
    let verdict = if input.digest != input.expected_digest {
        WatchVerdict::WrongInput
    } else if next.frozen >= params.frozen_limit {
        WatchVerdict::OutputFrozen
    } else {
        WatchVerdict::Alive
    };
    (next, verdict)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::ContactModel;

    fn look(tick: u64, force_n: [f32; 3], z_m: f32) -> WatchInput {
        WatchInput { record_tick: tick, force_n, position_m: [0.0, 0.0, z_m], digest: 7, expected_digest: 7 }
    }

    fn verdicts(looks: &[WatchInput]) -> Vec<WatchVerdict> {
        let mut state = WatchState::default();
        let step = |look: &WatchInput| {
            let (next, verdict) = watch_step(&WatchParams::default(), &state, look);
            state = next;
            verdict
        };
        looks.iter().map(step).collect()
    }

    #[test]
    fn a_record_is_valid_for_its_tick_and_the_next() {
        let limits = ForceLimits::default();
        let force = [0.0, 1.0, 0.0];
        assert_eq!(valid_force(10, 10, force, &limits), Ok(()));
        assert_eq!(valid_force(10, 9, force, &limits), Ok(()));
        assert_eq!(valid_force(10, 8, force, &limits), Err(ForceFault::Stale));
        assert_eq!(valid_force(10, 11, force, &limits), Err(ForceFault::FromFuture));
        assert_eq!(valid_force(10, 10, [f32::NAN; 3], &limits), Err(ForceFault::NotFinite));
        assert_eq!(valid_force(10, 10, [0.0, 3.31, 0.0], &limits), Err(ForceFault::TooLarge));
        assert_eq!(valid_force(10, 10, [f32::MAX; 3], &limits), Err(ForceFault::TooLarge));
    }

    #[test]
    fn a_stamp_that_stands_still_is_found_within_three_looks() {
        let mut looks = vec![look(1, [0.0; 3], 0.0); 4];
        assert_eq!(verdicts(&looks)[2..], [WatchVerdict::Alive, WatchVerdict::StampStill]);
        looks[3].record_tick = 0;
        assert_eq!(verdicts(&looks)[3], WatchVerdict::StampStill, "a stamp that goes back is no life sign");
    }

    #[test]
    fn the_same_force_while_the_tip_moves_against_it_is_frozen() {
        let looks: Vec<_> = (1..=5).map(|t| look(t, [0.0, 0.0, -1.0], t as f32 * 1e-4)).collect();
        assert_eq!(verdicts(&looks)[2..4], [WatchVerdict::Alive, WatchVerdict::OutputFrozen]);
    }

    #[test]
    fn free_motion_rest_sliding_and_saturation_are_no_suspicion() {
        let free: Vec<_> = (1..=9).map(|t| look(t, [0.0; 3], t as f32 * 1e-3)).collect();
        let rest: Vec<_> = (1..=9).map(|t| look(t, [0.0, 0.0, -1.0], 0.05)).collect();
        let slide: Vec<_> = (1..=9).map(|t| look(t, [0.0, -1.0, 0.0], t as f32 * 1e-3)).collect();
        let limit: Vec<_> = (1..=9).map(|t| look(t, [0.0, 0.0, -3.3], t as f32 * 1e-3)).collect();
        for looks in [free, rest, slide, limit] {
            assert!(verdicts(&looks).iter().all(|v| *v == WatchVerdict::Alive));
        }
    }

    #[test]
    fn a_force_from_another_input_is_found_at_once_even_if_it_is_zero() {
        let model = ContactModel::default();
        let input = ServoInput {
            tick: 5,
            position_m: [0.0; 3],
            velocity_m_s: [0.0; 3],
            dt_s: 1e-3,
            model: &model,
            model_age_ticks: 0,
            applied_n: None,
            medium_n: [0.0; 3],
        };
        let old = input_digest(&input);
        let new = input_digest(&ServoInput { tick: 6, ..input });
        assert_ne!(old, new);
        let stale = WatchInput { digest: old, expected_digest: new, ..look(6, [0.0; 3], 0.0) };
        assert_eq!(verdicts(&[stale]), [WatchVerdict::WrongInput]);
    }
}
