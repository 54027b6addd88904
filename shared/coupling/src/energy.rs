//! Passivity at the last hop (Hannaford and Ryu 2002): the energy account of the grip, kept by who hands forces to the motors. Servos have an observer of
//! their own and damp; this one knows nothing of how a force was made, so it holds whatever servo was swapped in, and whatever one says.
//!
//! It promises: in any stretch of time the motors give the hand no more than it put in before (at most [`EnergyParams::credit_j`] of that), and twice
//! [`EnergyParams::debt_j`], and what leaks, `2 · debt_j / forgotten_s` for each second; and what a force gives while it goes down to nothing by the slew
//! limit. As long as the debt is below `debt_j` every force passes bit for bit.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::vector::{is_finite, sane};

/// Longest motion of the tip in one tick that is booked, m: a hand moves by 1 m/s at most. What is longer is a sample of somewhere else.
const MOST_MOVED_M: f32 = 0.01;

/// Parameters of the account.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct EnergyParams {
    /// Most of what the hand put in that is given back unasked, J: a spring of the largest force, 3.3 N, over 30 mm.
    pub credit_j: f32,
    /// Debt from which on less force is applied, J; at twice as much none is. Fifty times what the default scene's walls owed when they were pressed
    /// with 0.5 N and their engines died (0.2 mJ, a recorded campaign of 49 s).
    pub debt_j: f32,
    /// Time in which a debt falls to 1/e, s: walls that move by themselves, as the medium's pressure has them, give a little all the time.
    pub forgotten_s: f32,
}

impl Default for EnergyParams {
    fn default() -> Self {
        Self { credit_j: 0.05, debt_j: 0.01, forgotten_s: 0.5 }
    }
}

impl EnergyParams {
    /// The nearest usable ones.
    fn checked(&self) -> Self {
        Self {
            credit_j: sane(self.credit_j, 0.0, 10.0, 0.0),
            debt_j: sane(self.debt_j, 1e-6, 10.0, 1e-6),
            forgotten_s: sane(self.forgotten_s, 1e-3, 1e3, 1.0),
        }
    }
}

/// The account: 24 bytes. All zero is one that has seen nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct EnergyState {
    /// What the hand has put in, less what the motors gave, J; below zero the motors owe.
    pub energy_j: f32,
    /// Place of the tip when it was last looked at, m.
    pub tip_m: [f32; 3],
    /// 1 if there is such a place.
    pub running: u32,
    /// Zero.
    pub reserved: u32,
}

/// One tick: books what `applied_n`, N on the hand, has done since the tip was last looked at, `dt_s` ago, and gives the next state and the share of any force
/// that may be applied now, 0 to 1. Of a tip that is no number, and of one that has jumped, nothing is booked.
pub fn energy_step(
    params: &EnergyParams,
    state: &EnergyState,
    tip_m: [f32; 3],
    applied_n: [f32; 3],
    dt_s: f32,
) -> (EnergyState, f32) {
    let params = params.checked();
    let mut next = if state.energy_j.is_finite() && is_finite(state.tip_m) { *state } else { EnergyState::default() };
    if !is_finite(tip_m) {
        return (EnergyState { running: 0, ..next }, share(&params, next.energy_j));
    }
    let moved_m = Vec3::from_array(tip_m) - Vec3::from_array(next.tip_m);
    let is_known = next.running == 1 && is_finite(applied_n) && moved_m.length() <= MOST_MOVED_M;
    let given_j = if is_known { Vec3::from_array(applied_n).dot(moved_m) } else { 0.0 };
    // A debt is forgotten in time, and credit is not: who presses for a minute gets back what the wall has stored.
    let left = if next.energy_j < 0.0 { 1.0 - (sane(dt_s, 0.0, 1.0, 0.0) / params.forgotten_s).min(1.0) } else { 1.0 };
    next.energy_j = (next.energy_j * left - given_j).clamp(-1e3, params.credit_j);
    (next.tip_m, next.running) = (tip_m, 1);
    (next, share(&params, next.energy_j))
}

/// The share of a force that may be applied.
fn share(params: &EnergyParams, energy_j: f32) -> f32 {
    (1.0 - (-energy_j - params.debt_j) / params.debt_j).clamp(0.0, 1.0)
}

/// What other processes may map must not change size unnoticed.
const _: () = assert!(size_of::<EnergyState>() == 24);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lasthop::{LastHopParams, LastHopState, last_hop_step};

    const DT_S: f32 = 1e-3;

    /// A bare mass at the grip, 0.1 kg, that a hand damps with so many N·s/m: what a servo gives it in so many ticks, J, and the least share.
    fn driven(servo: impl Fn(u32, Vec3, Vec3) -> Vec3, damping_n_s_m: f32, ticks: u32, is_watched: bool) -> (f64, f32) {
        let (mut tip_m, mut velocity_m_s) = (Vec3::ZERO, Vec3::ZERO);
        let hop_params = LastHopParams::default();
        let mut hop = LastHopState { engaged: 1, gain: 1.0, ..LastHopState::default() };
        let (mut energy, mut given_j, mut least) = (EnergyState::default(), 0.0, 1.0f32);
        for tick in 0..ticks {
            let (next, share) = energy_step(&EnergyParams::default(), &energy, tip_m.to_array(), hop.applied_n, DT_S);
            energy = next;
            least = least.min(share);
            let wanted_n = servo(tick, tip_m, velocity_m_s) * if is_watched { share } else { 1.0 };
            hop = last_hop_step(&hop_params, &hop, Some(wanted_n.to_array())).0;
            let force_n = Vec3::from_array(hop.applied_n);
            velocity_m_s += (force_n - velocity_m_s * damping_n_s_m) / 0.1 * DT_S;
            tip_m += velocity_m_s * DT_S;
            given_j += f64::from(force_n.dot(velocity_m_s * DT_S));
        }
        (given_j, least)
    }

    #[test]
    fn a_servo_that_pushes_along_with_the_hand_is_let_give_as_much_as_is_promised_and_no_more() {
        // 3 N along with whatever motion there is, and a push to begin with.
        let lying = |_: u32, _: Vec3, velocity_m_s: Vec3| {
            let along = if velocity_m_s == Vec3::ZERO { Vec3::Z } else { velocity_m_s.normalize() };
            along * 3.0
        };
        let (free_j, _) = driven(lying, 5.0, 2_000, false);
        let (held_j, least) = driven(lying, 5.0, 2_000, true);
        // Two seconds; 0.02 J is what twice the debt is, and 0.04 W what leaks of it; the way down of the force gives the rest.
        assert!(free_j > 1.0 && held_j < 0.02 + 0.04 * 2.0 + 0.02, "{free_j} J without, {held_j} J with");
        assert!(least < 0.2, "{least}");
    }

    #[test]
    fn a_servo_that_shakes_the_hand_is_stilled() {
        let shaking = |tick: u32, _: Vec3, _: Vec3| Vec3::X * if (tick / 20).is_multiple_of(2) { 3.0 } else { -3.0 };
        let (free_j, _) = driven(shaking, 8.0, 4_000, false);
        let (held_j, _) = driven(shaking, 8.0, 4_000, true);
        assert!(free_j > 0.4 && held_j < 0.02 + 0.04 * 4.0 + 0.02, "{free_j} J without, {held_j} J with");
    }

    #[test]
    fn a_spring_gives_back_what_was_put_in_however_long_it_was_held_and_nothing_is_taken_of_its_force() {
        let params = EnergyParams::default();
        let mut state = EnergyState::default();
        // 300 N/m: in to 11 mm, 18 mJ, held for ten seconds, and out again.
        let depth_m =
            |tick: u32| 0.011 * (tick.min(100) as f32 / 100.0) * (1.0 - tick.saturating_sub(10_100).min(50) as f32 / 50.0);
        let mut applied_n = [0.0; 3];
        for tick in 0..10_200 {
            let (next, share) = energy_step(&params, &state, [0.0, 0.0, depth_m(tick)], applied_n, DT_S);
            assert_eq!(share, 1.0, "tick {tick}: {next:?}");
            (state, applied_n) = (next, [0.0, 0.0, -300.0 * depth_m(tick)]);
        }
        assert!(state.energy_j.abs() < 1e-3, "{state:?}");
    }

    #[test]
    fn a_debt_is_forgotten_and_the_force_comes_back() {
        let params = EnergyParams::default();
        let mut state = EnergyState { energy_j: -0.03, tip_m: [0.0; 3], running: 1, reserved: 0 };
        let mut shares = Vec::new();
        for _ in 0..1_000 {
            let (next, share) = energy_step(&params, &state, [0.0; 3], [0.0; 3], DT_S);
            state = next;
            shares.push(share);
        }
        assert!(shares[0] == 0.0 && shares[999] == 1.0 && shares.is_sorted(), "{:?}", &shares[..5]);
    }

    #[test]
    fn nonsense_is_not_booked() {
        let params = EnergyParams::default();
        let state = EnergyState { energy_j: -0.001, tip_m: [0.0; 3], running: 1, reserved: 0 };
        for (tip_m, applied_n) in [
            ([f32::NAN; 3], [1.0; 3]),
            ([0.001; 3], [f32::INFINITY; 3]),
            ([1.0, 0.0, 0.0], [3.0, 0.0, 0.0]),
            ([f32::MAX; 3], [1.0; 3]),
        ] {
            let (next, share) = energy_step(&params, &state, tip_m, applied_n, DT_S);
            assert!(share == 1.0 && next.energy_j <= 0.0 && next.energy_j >= state.energy_j, "{tip_m:?}: {next:?}");
        }
        let corrupt = EnergyState { energy_j: f32::NAN, tip_m: [f32::INFINITY; 3], running: 7, reserved: 0 };
        let (next, share) = energy_step(&params, &corrupt, [0.0; 3], [1.0; 3], DT_S);
        assert!(share == 1.0 && next.energy_j == 0.0, "{next:?}");
    }
}
