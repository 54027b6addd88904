//! The servo: one tick of the force on the hand, from the pose and the tissue's local contact model (haptic process, 1 kHz).
//!
//! In order, in [`servo_step`]:
//! 1. Gap: ticks that are missing are treated as the last hop treats them (held, then ramped to zero), so that a servo that
//!    was suspended knows what the hand feels now.
//! 2. Fade: full force up to `full_age_ticks` of the contact model, then smoothly to zero over `fade_ticks`.
//! 3. Return: when force comes back while the tip is buried (after a gap or a fade), the surface is first felt where the
//!    hand is, so far shifted that the force stays what it is, and moves to its place at `return_speed_m_s`. It resists
//!    from the first tick, but it does not throw the hand out. If the hand withdraws, the surface follows it.
//! 4. Push of the planes and the proxy ([`crate::proxy`]): what the planes say, all of it as long as they together are no stiffer than nine tenths of
//!    the coupling, which the passivity bound limits; damping that grows with depth (no step on entry) and never pulls.
//! 5. Friction of the planes, a spring that slides (`servo/friction.rs`); passivity observer and controller (Hannaford and Ryu
//!    2002), which meets what the bound cannot know: planes that move.
//! 6. What the medium does to the scope (`servo/medium.rs`), with an account of its own; then the force limit.
//! 7. Blend: the force changes by no more than the motion of the tip explains plus `model_step_n`; so a contact model that
//!    jumps is felt as a ramp, while the motion of the hand is passed on undelayed. For `return_ticks` after a gap or a fade it is
//!    `return_step_n`, and motion explains what these planes make of it and no more: a tissue that has begun anew about the scope settles, its model jumps
//!    from tick to tick, and the tip is on its way out.
//!
//! Stability of the sampled wall needs `b > K·T/2 + |B|` (Colgate and Schenkel 1997) with b the physical damping of
//! device and hand, K and B the virtual stiffness and damping; a loop delay of d ticks adds K·d·T. `coupling_limit_n_m`
//! solves this for K with the bristle of friction beside it, and no planes are felt stiffer than nine tenths of that from one model to the next. What a wall
//! is stiffer than they are comes with the next models, as planes that have moved: the observer sees it, and the tissue's tests try it with a hand
//! (`processes/tissue/src/main_loop/tests/grip.rs`).

mod friction;
mod medium;
pub use medium::felt_of_medium_n;
mod types;

use glam::{DVec3, Vec3};

use crate::contact::{Constraints, MAX_PLANES};
use crate::proxy::{self, Proxy};
use crate::vector::{clamp_length, is_finite, step_towards};

pub use types::*;

/// Speeds below this are encoder noise; the passivity controller does not divide by them, m/s.
const MIN_SPEED_M_S: f64 = 1e-3;
/// Ticks over which the passivity controller goes from nothing to its largest damping.
const DAMPER_TICKS: f64 = 10.0;

/// One tick: the next state and the force. Pure; bounded by the proxy's iterations; allocates nothing.
pub fn servo_step(params: &ServoParams, state: &ServoState, input: &ServoInput) -> (ServoState, ServoOutput) {
    let params = &params.checked();
    let (state, reset) = state.repaired(params, input.tick);
    let (mut next, bridged) = bridge_gap(params, &state, input);
    if !input.usable() {
        // A missing tick: the state stays behind, so that the next good tick sees the gap.
        return (state, ServoOutput { force_n: next.force_n, flags: reset | SERVO_BAD_INPUT });
    }
    let velocity = clamp_length(Vec3::from_array(input.velocity_m_s), params.max_speed_m_s);
    let old_ramp = next.ramp;
    let restored = fade(params, &mut next, input.model_age_ticks);
    next.return_ticks = return_ticks(params, &state, old_ramp, restored, bridged);
    let known = state.running == 1 && !bridged;
    let moved = if known { Vec3::from_array(input.position_m) - Vec3::from_array(next.position_m) } else { Vec3::ZERO };
    let touch = touch(params, &mut next, input, velocity, known, restored);
    let medium_n = medium::medium_step(&mut next, input.medium_n, moved);
    // Nothing is added where there is none: a zero has a sign.
    let wanted = if medium_n == Vec3::ZERO { touch.wanted_n } else { touch.wanted_n + medium_n };

    let limited = clamp_length(wanted, params.max_force_n);
    // Only a fade explains a step: what comes back is shifted so that the force stays what it is.
    let faded = (smoothstep(old_ramp) - smoothstep(next.ramp)).max(0.0) * params.max_force_n;
    let by_model_n = if next.return_ticks > 0 { params.return_step_n.min(params.model_step_n) } else { params.model_step_n };
    let allowed = touch.explained_n + faded + by_model_n;
    let force = step_towards(Vec3::from_array(next.force_n), limited, allowed);

    let contact = touch.flags & SERVO_CONTACT != 0;
    next.tick = input.tick;
    next.position_m = input.position_m;
    next.velocity_m_s = velocity.to_array();
    next.force_n = force.to_array();
    next.running = 1;
    next.contact_ticks = if contact { next.contact_ticks.saturating_add(1) } else { 0 };
    let flags = bit(SERVO_SATURATED, limited != wanted)
        | bit(SERVO_FADING, next.ramp < 1.0)
        | bit(SERVO_BLENDING, force != limited)
        | bit(SERVO_GAP, bridged);
    (next, ServoOutput { force_n: next.force_n, flags: flags | touch.flags | reset })
}

/// What the planes do at one tick, before limit and blend.
struct Touch {
    /// Force that planes and controller want, N.
    wanted_n: Vec3,
    /// Change of force since the last tick that the motion of the tip explains, N.
    explained_n: f32,
    /// `SERVO_…` bits of contact.
    flags: u32,
}

/// Finds the proxy and the forces on it; books energy, surface shift and proxy into `next`. `known` says that the last tick
/// is in `next`, `restored` that the fade is being taken back.
fn touch(params: &ServoParams, next: &mut ServoState, input: &ServoInput, velocity: Vec3, known: bool, restored: bool) -> Touch {
    let position = Vec3::from_array(input.position_m);
    let coupling_n_m = f64::from(params.coupling_limit_n_m(input.dt_s));
    let damping_limit = f64::from(params.max_damping_n_s_m);
    let mut walls = Constraints::at(input.model, position.as_dvec3(), damping_limit);
    let shift = surface_shift(params, next, &walls, coupling_n_m, restored || !known, input.dt_s);
    walls.shift(shift);
    let rest = proxy::rest(walls.used(), coupling_n_m);

    let gain = f64::from(smoothstep(next.ramp));
    let pushed = push_of(params, &walls, &rest, velocity.as_dvec3()) * gain;
    // The last force acted on the hand from the last position to this one.
    let moved = if known { position - Vec3::from_array(next.position_m) } else { Vec3::ZERO };
    if !known {
        next.bristle_m = [0.0; 3];
    }
    let friction = friction::friction_step(next, (&walls, &rest, coupling_n_m), gain, moved.as_dvec3());
    let stored_j = rest.energy_j * gain + friction.stored_j;
    let damper = observe(params, next, moved, velocity, (&rest, stored_j), input.dt_s);
    let path = if known { moved } else { velocity * input.dt_s };
    let turn = velocity - Vec3::from_array(next.velocity_m_s);
    // What the tip's way changes of the push, and of friction by that, and what it bends.
    let bends = if walls.friction > 0.0 { f64::from(friction::SHARE) * coupling_n_m } else { 0.0 };
    // While force comes back planes jump with a tip that is pushed out: what the way explains is what these planes make of it.
    let planes_n_m = if next.return_ticks > 0 { rest.stiffness_n_m } else { coupling_n_m };
    let felt_n_m = (planes_n_m * (1.0 + walls.friction) + bends) as f32;
    next.proxy_m = (position.as_dvec3() + rest.offset_m).as_vec3().to_array();
    next.shift_m = shift.as_vec3().to_array();
    Touch {
        wanted_n: (pushed - velocity.as_dvec3() * damper + friction.force_n).as_vec3(),
        explained_n: explained_n(params, felt_n_m, path, velocity, turn, input.dt_s),
        flags: bit(SERVO_CONTACT, rest.energy_j > 0.0)
            | bit(SERVO_RETURNING, shift != DVec3::ZERO)
            | bit(SERVO_PASSIVITY, damper > 0.0)
            | bit(SERVO_BAD_PLANE, walls.faulty),
    }
}

/// `flag` if `set`.
fn bit(flag: u32, set: bool) -> u32 {
    if set { flag } else { 0 }
}

/// What became of force and energy while ticks were missing: the force that the device reports, else what its last hop
/// does by itself. True if more ticks were missing than are held. A servo without a state begins with the reported force.
fn bridge_gap(params: &ServoParams, state: &ServoState, input: &ServoInput) -> (ServoState, bool) {
    let mut next = *state;
    let reported = input.applied_n.filter(|force| is_finite(*force));
    let reported = reported.map(|force| clamp_length(Vec3::from_array(force), params.max_force_n).to_array());
    if state.running == 0 {
        next.force_n = reported.unwrap_or_default();
        return (next, false);
    }
    let missing = input.tick - state.tick - 1;
    if missing <= u64::from(params.gap_hold_ticks) {
        return (next, false);
    }
    let ramped = missing - u64::from(params.gap_hold_ticks);
    let left = 1.0 - (ramped as f32 / params.gap_ramp_ticks as f32).min(1.0);
    next.force_n = reported.unwrap_or(state.force_n.map(|force| force * left));
    next.energy_j = state.energy_j.min(0.0);
    (next.medium_n, next.medium_j) = ([0.0; 3], state.medium_j.min(0.0));
    next.gaps = next.gaps.saturating_add(1);
    (next, true)
}

/// Sets the ramp to what the model's age allows, falling no faster than the last hop ramps. True if it rose.
fn fade(params: &ServoParams, next: &mut ServoState, age_ticks: u32) -> bool {
    let late = age_ticks.saturating_sub(params.full_age_ticks);
    let target = 1.0 - (late as f32 / params.fade_ticks as f32).min(1.0);
    let rose = target > next.ramp;
    next.ramp = target.max(next.ramp - 1.0 / params.gap_ramp_ticks as f32);
    rose
}

/// Ticks for which force is still on its way back: as many as were lost of the fade that is taken back at this tick, all after a gap.
fn return_ticks(params: &ServoParams, state: &ServoState, old_ramp: f32, restored: bool, bridged: bool) -> u32 {
    let all = params.return_ticks;
    let begun = match (bridged, restored) {
        (true, _) => all,
        (false, true) => ((1.0 - old_ramp) * all as f32) as u32,
        (false, false) => 0,
    };
    begun.max(state.return_ticks.min(all).saturating_sub(1))
}

/// The force of the tick before without what the medium did, N.
fn touch_n(next: &ServoState) -> Vec3 {
    Vec3::from_array(next.force_n) - Vec3::from_array(next.medium_n)
}

/// Where the planes are felt less where they are, m.
///
/// If force comes back at this tick (`returning`), the shift is chosen such that the force stays what it is. Otherwise the
/// shift of the last tick shrinks, and is never longer than what just frees the tip.
fn surface_shift(
    params: &ServoParams,
    next: &ServoState,
    walls: &Constraints,
    coupling_n_m: f64,
    returning: bool,
    dt_s: f32,
) -> DVec3 {
    let last = DVec3::from_array(next.shift_m.map(f64::from));
    if !returning && last == DVec3::ZERO {
        return DVec3::ZERO;
    }
    let freeing = -proxy::way_out(walls.used());
    if returning {
        let felt = touch_n(next).as_dvec3().length();
        let gain = f64::from(smoothstep(next.ramp));
        let full = proxy::rest(walls.used(), coupling_n_m).offset_m.length() * coupling_n_m * gain;
        let share = if full > felt { felt / full } else { 1.0 };
        return freeing * (1.0 - share);
    }
    let step = f64::from(params.return_speed_m_s * dt_s);
    let length = (last.length() - step).min(freeing.length());
    if length > 0.0 { last * (length / last.length()) } else { DVec3::ZERO }
}

/// Spring and damping of all planes, N, on the hand; each plane pushes or does nothing.
fn push_of(params: &ServoParams, walls: &Constraints, rest: &Proxy, velocity: DVec3) -> DVec3 {
    let depth_full = f64::from(params.damping_depth_m);
    let mut damping = [0.0; MAX_PLANES];
    for ((damping, c), push) in damping.iter_mut().zip(walls.used()).zip(rest.push_n) {
        *damping = if push > 0.0 { c.damping_n_s_m * (c.depth_m / depth_full).min(1.0) } else { 0.0 };
    }
    let total: f64 = damping.iter().sum();
    let damping_limit = f64::from(params.max_damping_n_s_m);
    let share = if total > damping_limit { damping_limit / total } else { 1.0 };
    let each = walls.used().iter().zip(rest.push_n).zip(damping);
    each.fold(DVec3::ZERO, |sum, ((c, push), damping)| {
        sum + c.normal * (push - damping * share * velocity.dot(c.normal)).max(0.0)
    })
}

/// Passivity observer: books the energy that crossed the grip, and returns the controller's damping, N·s/m. `stored_j`: what planes and bristle have of it.
///
/// The account is limited to what is stored plus a reserve, because old credit would let energy out later without notice; planes that are softer than their
/// wall, and as much deeper, have more of it stored than the wall has.
/// out of contact a debt is forgiven, because there is nothing left that could give energy.
fn observe(
    params: &ServoParams,
    next: &mut ServoState,
    moved: Vec3,
    velocity: Vec3,
    (rest, stored_j): (&Proxy, f64),
    dt_s: f32,
) -> f64 {
    let offset_m = rest.offset_m.length();
    let contact = offset_m > 0.0;
    let reserve = f64::from(params.energy_reserve_j);
    let taken = -touch_n(next).as_dvec3().dot(moved.as_dvec3());
    let ceiling = (stored_j + reserve).min(f64::from(MAX_ENERGY_J));
    let floor = if contact { -reserve } else { 0.0 };
    let energy = (f64::from(next.energy_j) + taken).clamp(floor, ceiling);
    next.energy_j = energy as f32;
    let most = f64::from(params.controller_damping_n_s_m);
    let speed = velocity.as_dvec3().length().max(MIN_SPEED_M_S);
    let wanted = (-energy / (speed * speed * f64::from(dt_s))).clamp(0.0, most);
    // Eased in and out, for a damper that snaps shut is a kick.
    let last = f64::from(next.damper_n_s_m);
    let most_change = most / DAMPER_TICKS;
    let damper = if contact { wanted.clamp(last - most_change, last + most_change).max(0.0) } else { 0.0 };
    next.damper_n_s_m = damper as f32;
    damper * (offset_m / f64::from(params.damping_depth_m)).min(1.0)
}

/// Change of force, N, that the motion of the tip since the last tick can cause with planes that stand still.
fn explained_n(params: &ServoParams, stiffness_n_m: f32, path: Vec3, velocity: Vec3, turn: Vec3, dt_s: f32) -> f32 {
    let path = path.length().min(params.max_speed_m_s * dt_s);
    let turn = turn.length().min(2.0 * params.max_speed_m_s);
    let entered = velocity.length() * (path / params.damping_depth_m).min(1.0);
    stiffness_n_m * path + params.max_damping_n_s_m * (turn + entered)
}

/// 3r² − 2r³: from 0 to 1 with no slope at either end, so that a ramp begins and ends unfelt.
fn smoothstep(r: f32) -> f32 {
    r * r * (3.0 - 2.0 * r)
}
