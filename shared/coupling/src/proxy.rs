//! The proxy (god-object) under compliant plane constraints.
//!
//! The proxy p is where a massless point would rest that is tied to the device x by a spring of stiffness k_c and pushed out of
//! the tissue by the planes: it minimises
//! `φ(p) = ½ k_c |p − x|² + ½ Σ K_i max(0, depth_i(p))²`.
//! φ is strongly convex, so the proxy exists and is unique for *any* set of planes: nearly parallel ones share the load,
//! conflicting ones (a crevice narrower than nothing) balance, and no case needs a tolerance. The minimum as a function
//! of x is the Moreau envelope of the planes' energy (Moreau 1965): the force `k_c (p − x)` is its gradient, therefore
//! conservative (a closed path yields no energy) and Lipschitz in x with constant k_c (the stiffness that the hand can
//! feel never exceeds k_c, however many planes there are). That is the god-object of Zilles and Salisbury (1995) with a finite
//! wall stiffness; with rigid planes at most three would be active, compliant ones need no such limit.
//!
//! K_i is chosen so that plane and coupling in series resist with the plane's own stiffness: one plane, or planes at right
//! angles, give exactly `F = Σ k_i max(0, depth_i) n_i`.
//!
//! The minimum is found by Newton's method with an exact line search. φ is piecewise quadratic, so it ends after a few
//! iterations; [`MAX_ITERATIONS`] bounds them. Arithmetic is f64.

use glam::{DMat3, DVec3};

use crate::contact::{Constraint, MAX_PLANES};

/// Bound on Newton iterations. Random sets of 8 planes need at most 10 (test below); at the bound the result is still a
/// point of lower energy than the start, with bounded force.
pub const MAX_ITERATIONS: usize = 16;

/// A plane is felt with at most this share of the coupling's stiffness, because the series compensation diverges at 1.
pub const MAX_STIFFNESS_SHARE: f64 = 0.9;

/// Stiffness of a plane that counts as rigid, in multiples of the coupling.
const RIGID: f64 = 1000.0;

/// A step of the proxy shorter than this ends the iteration: a million times finer than any encoder.
const STEP_END_M: f64 = 1e-13;

/// Where the proxy rests and what each plane pushes with.
#[derive(Clone, Copy, Debug, Default)]
pub struct Proxy {
    /// Proxy minus device position, metres, station frame.
    pub offset_m: DVec3,
    /// Push of each constraint along its normal, N, ≥ 0.
    pub push_n: [f64; MAX_PLANES],
    /// Energy stored in coupling and planes, J.
    pub energy_j: f64,
    /// Newton iterations used.
    pub iterations: usize,
}

/// A constraint inside the solver: the stiffness compensated for the coupling in series.
#[derive(Clone, Copy, Default)]
struct Stiff {
    normal: DVec3,
    depth_m: f64,
    stiffness_n_m: f64,
}

/// Finds the proxy for `constraints` (depths at the device) and a coupling of `coupling_n_m` > 0.
///
/// Each stiffness must lie within `(0, MAX_STIFFNESS_SHARE · coupling_n_m]`; larger ones are limited to that.
pub fn rest(constraints: &[Constraint], coupling_n_m: f64) -> Proxy {
    solve(constraints, coupling_n_m, |felt_n_m| {
        let felt = felt_n_m.min(MAX_STIFFNESS_SHARE * coupling_n_m);
        felt * coupling_n_m / (coupling_n_m - felt)
    })
}

/// The shortest way from the device to where it is free of all planes, m (to one part in a thousand); where they leave no free
/// place, to the best compromise. It is the offset of a proxy on planes that are all rigid.
pub fn way_out(constraints: &[Constraint]) -> DVec3 {
    solve(constraints, 1.0, |_| RIGID).offset_m
}

/// The proxy for planes whose stiffness in the solver, N/m, is `inside(stiffness of the constraint)`.
fn solve(constraints: &[Constraint], coupling_n_m: f64, inside: impl Fn(f64) -> f64) -> Proxy {
    let mut stiff = [Stiff::default(); MAX_PLANES];
    let count = constraints.len().min(MAX_PLANES);
    for (to, from) in stiff.iter_mut().zip(constraints) {
        *to = Stiff { normal: from.normal, depth_m: from.depth_m, stiffness_n_m: inside(from.stiffness_n_m) };
    }
    let stiff = &stiff[..count];
    let mut proxy = Proxy::default();
    if stiff.iter().all(|c| c.depth_m <= 0.0) {
        return proxy;
    }
    let mut offset = DVec3::ZERO;
    while proxy.iterations < MAX_ITERATIONS {
        proxy.iterations += 1;
        let gradient = gradient(stiff, coupling_n_m, offset);
        let step = -(hessian(stiff, coupling_n_m, offset).inverse() * gradient);
        let share = line_search(stiff, coupling_n_m, offset, step);
        offset += step * share;
        if step.length() * share < STEP_END_M {
            break;
        }
    }
    proxy.offset_m = offset;
    proxy.energy_j = 0.5 * coupling_n_m * offset.length_squared();
    for (push, c) in proxy.push_n.iter_mut().zip(stiff) {
        let depth = depth_at(c, offset);
        *push = c.stiffness_n_m * depth;
        proxy.energy_j += 0.5 * c.stiffness_n_m * depth * depth;
    }
    proxy
}

/// Depth of the proxy below a plane, metres; 0 outside.
fn depth_at(c: &Stiff, offset: DVec3) -> f64 {
    (c.depth_m - c.normal.dot(offset)).max(0.0)
}

/// ∇φ, N: the coupling's pull less the planes' pushes.
fn gradient(stiff: &[Stiff], coupling_n_m: f64, offset: DVec3) -> DVec3 {
    stiff.iter().fold(offset * coupling_n_m, |sum, c| sum - c.normal * (c.stiffness_n_m * depth_at(c, offset)))
}

/// ∇²φ, N/m: symmetric, its smallest eigenvalue is at least the coupling's stiffness.
fn hessian(stiff: &[Stiff], coupling_n_m: f64, offset: DVec3) -> DMat3 {
    let mut sum = DMat3::from_diagonal(DVec3::splat(coupling_n_m));
    for c in stiff.iter().filter(|c| depth_at(c, offset) > 0.0) {
        let n = c.normal * c.stiffness_n_m;
        sum += DMat3::from_cols(n * c.normal.x, n * c.normal.y, n * c.normal.z);
    }
    sum
}

/// The share in (0, 1] of `step` that minimises φ along it. The slope along the step is piecewise linear and rises; its
/// kinks are where the path crosses a plane.
fn line_search(stiff: &[Stiff], coupling_n_m: f64, offset: DVec3, step: DVec3) -> f64 {
    let slope = |t: f64| gradient(stiff, coupling_n_m, offset + step * t).dot(step);
    let (mut low, mut high) = (0.0, 1.0);
    let (mut low_slope, mut high_slope) = (slope(0.0), slope(1.0));
    if high_slope <= 0.0 || low_slope >= 0.0 {
        return 1.0;
    }
    for c in stiff {
        let kink = (c.depth_m - c.normal.dot(offset)) / c.normal.dot(step);
        if !(kink > low && kink < high) {
            continue;
        }
        let at = slope(kink);
        if at <= 0.0 {
            (low, low_slope) = (kink, at);
        } else {
            (high, high_slope) = (kink, at);
        }
    }
    low + (high - low) * (-low_slope / (high_slope - low_slope))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn constraint(normal: DVec3, depth_m: f64, stiffness_n_m: f64) -> Constraint {
        Constraint { normal: normal.normalize(), depth_m, stiffness_n_m, damping_n_s_m: 0.0 }
    }

    fn force(constraints: &[Constraint]) -> DVec3 {
        let proxy = rest(constraints, 1000.0);
        constraints.iter().zip(proxy.push_n).fold(DVec3::ZERO, |sum, (c, push)| sum + c.normal * push)
    }

    #[test]
    fn one_plane_and_planes_at_right_angles_resist_with_their_own_stiffness() {
        let floor = constraint(DVec3::Z, 0.002, 400.0);
        let side = constraint(DVec3::X, 0.001, 800.0);
        assert!((force(&[floor]) - DVec3::new(0.0, 0.0, 0.8)).length() < 1e-9);
        assert!((force(&[floor, side]) - DVec3::new(0.8, 0.0, 0.8)).length() < 1e-9);
    }

    #[test]
    fn a_plane_given_twice_is_stiffer_but_never_beyond_the_coupling() {
        let twice = [constraint(DVec3::Z, 0.001, 900.0); 2];
        let felt = force(&twice).z;
        assert!(felt > 0.9 && felt < 1.0, "{felt}");
    }

    #[test]
    fn the_way_out_of_a_corner_leads_to_its_edge() {
        let corner = [constraint(DVec3::Z, 0.003, 400.0), constraint(DVec3::X, 0.004, 900.0)];
        assert!((way_out(&corner) - DVec3::new(0.004, 0.0, 0.003)).length() < 1e-5);
        assert_eq!(way_out(&[constraint(DVec3::Z, -0.003, 400.0)]), DVec3::ZERO);
    }

    #[test]
    fn planes_that_contradict_each_other_balance() {
        let crevice = [constraint(DVec3::Z, 0.01, 500.0), constraint(DVec3::NEG_Z, 0.01, 500.0)];
        assert!(force(&crevice).length() < 1e-9);
        let skew = [constraint(DVec3::new(1e-7, 0.0, 1.0), 0.01, 900.0), constraint(DVec3::NEG_Z, 0.01, 900.0)];
        assert!(force(&skew).length() < 1e-4, "nearly opposite planes must not eject the tip sideways");
    }

    fn any_constraint() -> impl Strategy<Value = Constraint> {
        (prop::array::uniform3(-1.0..1.0f64), -0.02..0.05f64, 1.0..900.0f64)
            .prop_filter("a direction", |(n, _, _)| DVec3::from_array(*n).length() > 1e-3)
            .prop_map(|(n, depth, k)| constraint(DVec3::from_array(n), depth, k))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, rng_seed: RngSeed::Fixed(2), ..ProptestConfig::default() })]

        #[test]
        fn the_gradient_vanishes_at_the_proxy(planes in prop::collection::vec(any_constraint(), 1..=8)) {
            let proxy = rest(&planes, 1000.0);
            let push = planes.iter().zip(proxy.push_n).fold(DVec3::ZERO, |s, (c, f)| s + c.normal * f);
            prop_assert!((push - proxy.offset_m * 1000.0).length() < 1e-6);
            prop_assert!(proxy.iterations <= 10, "{} iterations", proxy.iterations);
            prop_assert!(solve(&planes, 1.0, |_| RIGID).iterations < MAX_ITERATIONS);
        }

        #[test]
        fn the_force_is_lipschitz_with_the_coupling_stiffness(
            planes in prop::collection::vec(any_constraint(), 1..=8),
            shift in prop::array::uniform3(-1e-3..1e-3f64),
        ) {
            let shift = DVec3::from_array(shift);
            let mut moved = planes.clone();
            for c in &mut moved {
                c.depth_m -= c.normal.dot(shift);
            }
            let change = (force(&planes) - force(&moved)).length();
            prop_assert!(change <= 1000.0 * shift.length() + 1e-6, "{change} N over {} m", shift.length());
        }
    }
}
