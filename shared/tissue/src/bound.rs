//! A bound on the largest eigenvalue of M⁻¹K, which fixes how long a substep may be.
//!
//! For weights w on the four corners, the element stiffness obeys K_e ≤ κ·diag(w) with κ the largest eigenvalue of
//! diag(w)^−½ K_e diag(w)^−½. The sum over elements bounds K by a diagonal matrix, and so M⁻¹K, node by node. With the
//! rotation frozen, K_e = V·Gᵀ(2μ·1 + λ·vec(R)vec(R)ᵀ)G; its spectrum depends neither on R nor on the deformation, so that the
//! bound made at rest holds for stretched, flat and inverted elements (λ only drops out where the pressure is clamped). κ has a closed form in sums,
//! products, quotients and square roots, which have the same bits on every machine.

use nalgebra::Vector3;

/// How the stiffness of an element is spread over its corners: all four equal, or by the size of the shape gradient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Spread {
    Equal,
    ByGradient,
}

impl Spread {
    pub(crate) const BOTH: [Spread; 2] = [Spread::Equal, Spread::ByGradient];
}

/// Newton steps from a start that is off by half a percent at most: the error is squared by each.
const NEWTON_STEPS: usize = 3;

/// One element's share of the bound at its four corners, N/m. `gradients` are the shape gradients, 1/m.
pub(crate) fn corner_stiffness_n_m(
    gradients: &[Vector3<f64>; 4],
    volume_m3: f64,
    mu_pa: f64,
    lambda_pa: f64,
    spread: Spread,
) -> [f64; 4] {
    let weights = match spread {
        Spread::Equal => [1.0; 4],
        Spread::ByGradient => gradients.map(|gradient| gradient.norm()),
    };
    // Their Gram matrix: xx, yy, zz and yz, zx, xy.
    let (mut diagonal, mut sides) = (Vector3::zeros(), Vector3::zeros());
    for (gradient, weight) in gradients.iter().zip(weights) {
        let turned = Vector3::new(gradient.y, gradient.z, gradient.x);
        diagonal += gradient.component_mul(gradient) / weight;
        sides += turned.component_mul(&Vector3::new(gradient.z, gradient.x, gradient.y)) / weight;
    }
    let largest = largest_stiffness(&diagonal, &sides, mu_pa, lambda_pa);
    weights.map(|weight| weight * largest * volume_m3)
}

/// The largest eigenvalue of 2μ·diag(a) + λ·√a√aᵀ, with a the eigenvalues of a Gram matrix. (Shear directions give 2μ·aᵢ, which the largest
/// diagonal entry covers.)
///
/// In units of 2μ, with k = λ/2μ, its characteristic polynomial is y³ − (1+k)e₁y² + (1+2k)e₂y − (1+3k)e₃, with eᵢ the invariants of the Gram matrix.
/// With y = q + p·s, q a third of the trace, that is s³ − 3s = 2r, of which the largest root is between 1 and 2. From the mean and the deviator of
/// the Gram matrix p and r are found without a difference of large numbers. Relative error: some 1e-15, and up to 1e-7 where the largest two
/// eigenvalues are equal, which takes a λ of nearly 0; a substep leaves room for 1e-2.
fn largest_stiffness(diagonal: &Vector3<f64>, sides: &Vector3<f64>, mu_pa: f64, lambda_pa: f64) -> f64 {
    let k = lambda_pa / (2.0 * mu_pa);
    let mean = diagonal.sum() / 3.0;
    let deviator = diagonal.add_scalar(-mean);
    let squares = sides.component_mul(sides);
    let second = 0.5 * deviator.norm_squared() + squares.sum();
    let third = deviator.product() + 2.0 * sides.product() - deviator.dot(&squares);
    let pull = k * mean;
    let p = (pull * pull + (1.0 + 2.0 * k) * second / 3.0).sqrt();
    let r = (pull * (pull * pull + k * second) + 0.5 * (1.0 + 3.0 * k) * third) / (p * p * p);
    // s = 1 + u: u²(3 + u) = 2(1 + r). Where p is 0, for an even shape without coupling, all three roots are q.
    let squared = if p > 0.0 { 2.0 * (1.0 + r.clamp(-1.0, 1.0)) } else { 0.0 };
    let mut u = (squared / (3.0 + 0.5 * squared.sqrt())).sqrt();
    if u > 0.0 {
        for _ in 0..NEWTON_STEPS {
            u -= (u * u * (3.0 + u) - squared) / (3.0 * u * (2.0 + u));
        }
    }
    2.0 * mu_pa * (mean + pull + p * (1.0 + u))
}

/// Adds mass where the bound at a node exceeds `omega_max_per_s`²; returns the mass added, kg.
pub(crate) fn scale_mass(mass_kg: &mut [f64], stiffness_n_m: &[f64], omega_max_per_s: f64) -> f64 {
    let mut added_kg = 0.0;
    for (mass, stiffness) in mass_kg.iter_mut().zip(stiffness_n_m) {
        let needed = stiffness / (omega_max_per_s * omega_max_per_s);
        if needed > *mass {
            added_kg += needed - *mass;
            *mass = needed;
        }
    }
    added_kg
}

/// The largest angular frequency that the bound allows, 1/s. Nodes without mass (used by no tet) do not count.
pub(crate) fn omega_per_s(mass_kg: &[f64], stiffness_n_m: &[f64]) -> f64 {
    let squared = mass_kg.iter().zip(stiffness_n_m).filter(|(mass, _)| **mass > 0.0).map(|(mass, stiffness)| stiffness / mass);
    squared.fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SMatrix};

    /// The element stiffness as a full 12×12 matrix, from its definition.
    fn full(gradients: &[Vector3<f64>; 4], volume: f64, mu: f64, lambda: f64) -> SMatrix<f64, 12, 12> {
        SMatrix::from_fn(|row, column| {
            let (i, a, j, b) = (row / 3, row % 3, column / 3, column % 3);
            let shear = if a == b { 2.0 * mu * gradients[i].dot(&gradients[j]) } else { 0.0 };
            volume * (shear + lambda * gradients[i][a] * gradients[j][b])
        })
    }

    fn gradients(edges: Matrix3<f64>) -> ([Vector3<f64>; 4], f64) {
        let inverse = edges.try_inverse().expect("a tet with a volume");
        let row = |i: usize| inverse.row(i).transpose();
        ([-(row(0) + row(1) + row(2)), row(0), row(1), row(2)], edges.determinant() / 6.0)
    }

    #[test]
    fn the_bound_is_above_the_element_and_touches_it() {
        let edges = Matrix3::new(3.0, 0.4, 0.1, 0.2, 2.0, 0.7, -0.3, 0.1, 0.5) * 1e-3;
        let (gradients, volume) = gradients(edges);
        for spread in Spread::BOTH {
            let corners = corner_stiffness_n_m(&gradients, volume, 3448.0, 31034.0, spread);
            let scale = SMatrix::<f64, 12, 12>::from_fn(|i, j| if i == j { 1.0 / corners[i / 3].sqrt() } else { 0.0 });
            let scaled = scale * full(&gradients, volume, 3448.0, 31034.0) * scale;
            let largest = scaled.symmetric_eigenvalues().max();
            assert!((largest - 1.0).abs() < 1e-9, "{spread:?}: largest scaled eigenvalue {largest}, expected 1");
        }
    }

    #[test]
    fn the_closed_form_is_the_largest_eigenvalue() {
        let axes = [Matrix3::identity(), Matrix3::new(2.0, -1.0, 2.0, 2.0, 2.0, -1.0, -1.0, 2.0, 2.0) / 3.0];
        let sizes = [0.0, 1e-9, 1e-3, 0.3, 1.0 - 1e-12, 1.0 - 1e-5, 0.9, 1.0];
        let mu_pa = 3448.0;
        for (axes, a, b, k) in axes.iter().flat_map(|axes| {
            let pairs = sizes.iter().flat_map(|a| sizes.iter().map(move |b| (*a, *b)));
            pairs.flat_map(move |(a, b)| [0.0, 1e-9, 1e-4, 0.1, 0.5, 4.5].map(|k| (axes, a, b, k)))
        }) {
            let stretch = Vector3::new(1e6, 1e6 * a, 1e6 * b);
            let root = stretch.map(f64::sqrt);
            let coupled = (Matrix3::from_diagonal(&stretch) + root * root.transpose() * k) * (2.0 * mu_pa);
            let expected = coupled.symmetric_eigenvalues().max();
            let gram = axes * Matrix3::from_diagonal(&stretch) * axes.transpose();
            let sides = Vector3::new(gram[(1, 2)], gram[(0, 2)], gram[(0, 1)]);
            let found = largest_stiffness(&gram.diagonal(), &sides, mu_pa, 2.0 * mu_pa * k);
            let allowed = if k < 0.1 { 1e-7 } else { 1e-12 };
            assert!((found / expected - 1.0).abs() < allowed, "{found} is not {expected}: 1, {a}, {b}, {k}");
        }
    }
}
