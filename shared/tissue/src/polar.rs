//! The rotation of an element: the R that maximises tr(RᵀF) over all rotations.
//!
//! Written with a unit quaternion q, tr(R(q)ᵀF) = qᵀKq with a symmetric, traceless 4×4 matrix K (Horn, "Closed-form solution of
//! absolute orientation using unit quaternions", 1987). Its largest eigenvalue is the largest root of a quartic, reached from
//! above by Newton's iteration, monotonically since all roots are real; its eigenvector is a column of the adjugate of K − λ.
//!
//! Promises: the result is a rotation for every finite F, also inverted, flat or zero; it is the polar factor where det F > 0;
//! it is a function of F alone, so that it needs no memory of the step before; the work is bounded, and what it saves changes no bit.

use crate::lanes::{F, Lanes, V3};
use pulp::Simd;

/// Most of Newton's steps on the quartic. Three reach single precision for strains of an ordinary tissue; near a double root (flat and
/// inverted elements) the error halves per step, and what is left is filtered by the second application of the adjugate. Once a step has moved no lane's root,
/// no later one would.
const NEWTON_STEPS: usize = 6;
/// Keeps 1/|F| finite for an element that collapsed into a point.
const SQUARED_NORM_MIN: f32 = 1e-30;
/// Keeps Newton's step finite on a double root.
const SLOPE_MIN: f32 = 1e-4;

/// A rotation matrix in lanes, and what the search found on its way.
pub(crate) struct Rotation<S: Simd> {
    /// R, row by row.
    pub matrix: [V3<S>; 3],
    /// det F / |F|³: negative in inverted elements.
    pub orientation: F<S>,
}

/// The rotation of `f` (row by row).
#[inline(always)]
pub(crate) fn rotation<S: Lanes>(simd: S, f: &[V3<S>; 3]) -> Rotation<S> {
    let mut squared = F::splat(simd, SQUARED_NORM_MIN);
    for row in f {
        for entry in row {
            squared = entry.fma(*entry, squared);
        }
    }
    let scale = squared.sqrt().recip();
    let mut unit = *f;
    for row in &mut unit {
        for entry in row {
            *entry = *entry * scale;
        }
    }
    let (lambda, orientation) = largest_root(simd, &unit);
    let adjugate = adjugate(&shifted(&unit, lambda));
    let column = largest_column(&adjugate);
    let q = apply(&adjugate, &column);
    Rotation { matrix: matrix_of(simd, &q), orientation }
}

/// The minor of rows a, b and columns c, d.
#[inline(always)]
fn minor<S: Simd>(f: &[V3<S>; 3], a: usize, b: usize, c: usize, d: usize) -> F<S> {
    f[a][c].fma(f[b][d], -(f[a][d] * f[b][c]))
}

/// The largest eigenvalue of K for |F| = 1, and det F.
#[inline(always)]
fn largest_root<S: Lanes>(simd: S, f: &[V3<S>; 3]) -> (F<S>, F<S>) {
    let quartic = quartic(simd, f);
    // That of a rotation: no other F has a larger one.
    let mut root = F::splat(simd, 3.0f32.sqrt());
    for _ in 0..NEWTON_STEPS {
        let last = root;
        root = newton(simd, root, &quartic);
        // A step is never negative.
        if !last.any_greater(root) {
            break;
        }
    }
    (root, quartic.determinant)
}

/// The quartic of which the eigenvalues of K are the roots for |F| = 1: x⁴ − 2x² − `linear`·x + `constant`.
struct Quartic<S: Simd> {
    linear: F<S>,
    constant: F<S>,
    /// det F.
    determinant: F<S>,
}

#[inline(always)]
fn quartic<S: Simd>(simd: S, f: &[V3<S>; 3]) -> Quartic<S> {
    let first = [minor(f, 1, 2, 1, 2), minor(f, 1, 2, 2, 0), minor(f, 1, 2, 0, 1)];
    let others = [
        minor(f, 2, 0, 1, 2),
        minor(f, 2, 0, 2, 0),
        minor(f, 2, 0, 0, 1),
        minor(f, 0, 1, 1, 2),
        minor(f, 0, 1, 2, 0),
        minor(f, 0, 1, 0, 1),
    ];
    let determinant = f[0][0].fma(first[0], f[0][1].fma(first[1], f[0][2] * first[2]));
    let mut cofactors_squared = first[0].fma(first[0], first[1].fma(first[1], first[2] * first[2]));
    for entry in others {
        cofactors_squared = entry.fma(entry, cofactors_squared);
    }
    let constant = F::splat(simd, 4.0).nfma(cofactors_squared, F::splat(simd, 1.0));
    Quartic { linear: F::splat(simd, 8.0) * determinant, constant, determinant }
}

/// Newton's next place after one that is no less than the largest root.
#[inline(always)]
fn newton<S: Simd>(simd: S, root: F<S>, quartic: &Quartic<S>) -> F<S> {
    let (zero, two, four) = (F::splat(simd, 0.0), F::splat(simd, 2.0), F::splat(simd, 4.0));
    let square = root * root;
    let value = ((square - two).fma(root, -quartic.linear)).fma(root, quartic.constant);
    let slope = (four * (square - F::splat(simd, 1.0))).fma(root, -quartic.linear);
    let step = value.max(zero) * slope.max(F::splat(simd, SLOPE_MIN)).recip();
    root - step
}

/// K − λ as its ten entries: 00, 11, 22, 33, 01, 02, 03, 12, 13, 23.
#[inline(always)]
fn shifted<S: Simd>(f: &[V3<S>; 3], lambda: F<S>) -> [F<S>; 10] {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *f;
    [
        xx + yy + zz - lambda,
        xx - yy - zz - lambda,
        yy - xx - zz - lambda,
        zz - xx - yy - lambda,
        zy - yz,
        xz - zx,
        yx - xy,
        xy + yx,
        xz + zx,
        yz + zy,
    ]
}

/// Adjugate of a symmetric 4×4 matrix, entries in the order of [`shifted`].
#[inline(always)]
fn adjugate<S: Simd>(a: &[F<S>; 10]) -> [F<S>; 10] {
    let [a00, a11, a22, a33, a01, a02, a03, a12, a13, a23] = *a;
    let s0 = a00.fma(a11, -(a01 * a01));
    let s1 = a00.fma(a12, -(a01 * a02));
    let s2 = a00.fma(a13, -(a01 * a03));
    let s3 = a01.fma(a12, -(a11 * a02));
    let s4 = a01.fma(a13, -(a11 * a03));
    let s5 = a02.fma(a13, -(a12 * a03));
    let c5 = a22.fma(a33, -(a23 * a23));
    let c4 = a12.fma(a33, -(a13 * a23));
    let c3 = a12.fma(a23, -(a13 * a22));
    let c2 = a02.fma(a33, -(a03 * a23));
    let c1 = a02.fma(a23, -(a03 * a22));
    [
        a11.fma(c5, a13.fma(c3, -(a12 * c4))),
        a00.fma(c5, a03.fma(c1, -(a02 * c2))),
        a03.fma(s4, a33.fma(s0, -(a13 * s2))),
        a02.fma(s3, a22.fma(s0, -(a12 * s1))),
        a02.fma(c4, -(a01.fma(c5, a03 * c3))),
        a13.fma(s5, a33.fma(s3, -(a23 * s4))),
        a22.fma(s4, -(a12.fma(s5, a23 * s3))),
        a23.fma(s2, -(a03.fma(s5, a33 * s1))),
        a02.fma(s5, a23.fma(s1, -(a22 * s2))),
        a12.fma(s2, -(a02.fma(s4, a23 * s0))),
    ]
}

/// The column of a symmetric 4×4 matrix whose diagonal entry is largest in size.
#[inline(always)]
fn largest_column<S: Simd>(b: &[F<S>; 10]) -> [F<S>; 4] {
    let [b00, b11, b22, b33, b01, b02, b03, b12, b13, b23] = *b;
    let mut best = b00.abs();
    let mut column = [b00, b01, b02, b03];
    for (diagonal, candidate) in [(b11, [b01, b11, b12, b13]), (b22, [b02, b12, b22, b23]), (b33, [b03, b13, b23, b33])] {
        let size = diagonal.abs();
        for (entry, other) in column.iter_mut().zip(candidate) {
            *entry = size.if_greater(best, other, *entry);
        }
        best = best.max(size);
    }
    column
}

/// The symmetric matrix `b` times `q`.
#[inline(always)]
fn apply<S: Simd>(b: &[F<S>; 10], q: &[F<S>; 4]) -> [F<S>; 4] {
    let [b00, b11, b22, b33, b01, b02, b03, b12, b13, b23] = *b;
    let [w, x, y, z] = *q;
    [
        b00.fma(w, b01.fma(x, b02.fma(y, b03 * z))),
        b01.fma(w, b11.fma(x, b12.fma(y, b13 * z))),
        b02.fma(w, b12.fma(x, b22.fma(y, b23 * z))),
        b03.fma(w, b13.fma(x, b23.fma(y, b33 * z))),
    ]
}

/// The rotation matrix of the quaternion (w, x, y, z) of any length but zero.
#[inline(always)]
fn matrix_of<S: Simd>(simd: S, q: &[F<S>; 4]) -> [V3<S>; 3] {
    let [w, x, y, z] = *q;
    let one = F::splat(simd, 1.0);
    let squared = w.fma(w, x.fma(x, y.fma(y, z.fma(z, F::splat(simd, SQUARED_NORM_MIN)))));
    let twice = F::splat(simd, 2.0) * squared.recip();
    let (sx, sy, sz) = (twice * x, twice * y, twice * z);
    let (wx, wy, wz) = (sx * w, sy * w, sz * w);
    let (xx, yy, zz) = (sx * x, sy * y, sz * z);
    let (xy, xz, yz) = (sx * y, sx * z, sy * z);
    [[one - (yy + zz), xy - wz, xz + wy], [xy + wz, one - (xx + zz), yz - wx], [xz - wy, yz + wx, one - (xx + yy)]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{LANES, Row};
    use nalgebra::Matrix3;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn solve(f: &Matrix3<f64>) -> Matrix3<f64> {
        let simd = pulp::Scalar::new();
        let lane = |i: usize, j: usize| F { simd, value: f[(i, j)] as f32 };
        let rows = [0, 1, 2].map(|i| [lane(i, 0), lane(i, 1), lane(i, 2)]);
        let rotation = rotation(simd, &rows).matrix;
        Matrix3::from_fn(|i, j| f64::from(rotation[i][j].value))
    }

    /// The largest tr(RᵀF): the sum of the singular values, the smallest one negative where det F < 0.
    fn largest_trace(f: &Matrix3<f64>) -> f64 {
        let mut singular: Vec<f64> = f.singular_values().iter().copied().collect();
        singular.sort_by(f64::total_cmp);
        singular[0] *= if f.determinant() < 0.0 { -1.0 } else { 1.0 };
        singular.iter().sum()
    }

    fn check(f: &Matrix3<f64>, tolerance: f64) {
        let rotation = solve(f);
        let off = (rotation.transpose() * rotation - Matrix3::identity()).norm();
        assert!(off < 1e-5 && rotation.determinant() > 0.0, "not a rotation: {rotation} for {f}");
        let (reached, best) = ((rotation.transpose() * f).trace(), largest_trace(f));
        assert!(best - reached <= tolerance * f.norm(), "tr(RᵀF) is {reached}, the largest is {best}, for {f}");
    }

    #[test]
    fn flat_linear_collapsed_and_mirrored_elements_have_a_rotation() {
        for diagonal in [
            [1.0, 1.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [1.0, 1.0, -1.0],
            [-1.0, -1.0, -1.0],
            [1e6, 1e6, -1e6],
            [1.0, 0.3, -0.3],
            [1e-9, 2e-9, 1e-9],
        ] {
            check(&Matrix3::from_diagonal(&diagonal.into()), 0.03);
        }
    }

    #[test]
    fn a_pure_rotation_is_returned() {
        for angle in [0.0, 0.1, 1.0, 2.0, 3.0, std::f64::consts::PI] {
            let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.3, -0.8, 0.5));
            let exact = *nalgebra::Rotation3::from_axis_angle(&axis, angle).matrix();
            assert!((solve(&exact) - exact).norm() < 2e-6, "angle {angle}");
        }
    }

    /// Each lane's root: the one that is found, and that after all of Newton's steps.
    fn roots<S: Lanes>(simd: S, entries: &[Row; 9]) -> [Row; 2] {
        let mut roots = [Row::ZERO; 2];
        for half in 0..LANES / S::F32_LANES {
            let f = [0, 1, 2].map(|i| [0, 1, 2].map(|j| F::load(simd, &entries[3 * i + j], half)));
            let (found, quartic) = (largest_root(simd, &f).0, quartic(simd, &f));
            let after_all = (0..NEWTON_STEPS).fold(F::splat(simd, 3.0f32.sqrt()), |root, _| newton(simd, root, &quartic));
            found.store(&mut roots[0], half);
            after_all.store(&mut roots[1], half);
        }
        roots
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 2000,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]
        #[test]
        fn the_trace_is_the_largest_possible(entries in prop::array::uniform9(-1.0f64..1.0)) {
            let f = Matrix3::from_row_slice(&entries);
            // How much the best rotation is better than the next turn by half a circle: twice the sum of the smaller two
            // singular values, the smallest one negative in inverted elements. Near 0 the rotation is not unique.
            let gap = 2.0 * (largest_trace(&f) - f.singular_values().max()) / f.norm();
            check(&f, if gap > 0.5 { 1e-5 } else { 1e-2 });
        }

        /// From lanes that are not strained at all to such as have next to nothing of a rotation, side by side.
        #[test]
        fn steps_that_are_left_out_would_have_changed_no_bit(
            lanes in prop::collection::vec((prop::array::uniform9(-1.0f64..1.0), 0..6i32), LANES),
            most in prop_oneof![Just(1.0f64), Just(100.0f64)],
        ) {
            let mut entries = [Row::ZERO; 9];
            for (lane, (parts, size)) in lanes.iter().enumerate() {
                let strain = most * 10f64.powi(-size);
                let f = (Matrix3::<f64>::identity() + Matrix3::from_row_slice(parts) * strain).normalize();
                (0..9).for_each(|entry| entries[entry].0[lane] = f[(entry / 3, entry % 3)] as f32);
            }
            let mut all = vec![roots(pulp::Scalar::new(), &entries)];
            #[cfg(target_arch = "x86_64")]
            {
                all.extend(pulp::x86::V3::try_new().map(|simd| roots(simd, &entries)));
                all.extend(pulp::x86::V4::try_new().map(|simd| roots(simd, &entries)));
            }
            for [found, after_all] in all {
                prop_assert_eq!(found.0.map(f32::to_bits), after_all.0.map(f32::to_bits));
            }
        }
    }
}
