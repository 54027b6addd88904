//! A bound on the largest eigenvalue of M⁻¹K, which fixes how long a substep may be.
//!
//! For weights w on the four corners, the element stiffness obeys K_e ≤ κ·diag(w) with κ the largest eigenvalue of
//! diag(w)^−½ K_e diag(w)^−½. The sum over elements bounds K by a diagonal matrix, and so M⁻¹K, node by node. With the
//! rotation frozen, K_e = V·Gᵀ(2μ·1 + λ·vec(R)vec(R)ᵀ)G; its spectrum depends neither on R nor on the deformation, so that the
//! bound made at rest holds for stretched, flat and inverted elements (λ only drops out where the pressure is clamped).

use nalgebra::{Matrix3, Vector3};

/// How the stiffness of an element is spread over its corners: all four equal, or by the size of the shape gradient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Spread {
    Equal,
    ByGradient,
}

impl Spread {
    pub(crate) const BOTH: [Spread; 2] = [Spread::Equal, Spread::ByGradient];
}

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
    let mut gram = Matrix3::zeros();
    for (gradient, weight) in gradients.iter().zip(weights) {
        gram += gradient * gradient.transpose() / weight;
    }
    let stretch = gram.symmetric_eigenvalues().map(|value| value.max(0.0));
    let root = stretch.map(f64::sqrt);
    // Shear directions give 2μ·a_i, which the largest diagonal entry covers.
    let coupled = Matrix3::from_diagonal(&(stretch * (2.0 * mu_pa))) + root * root.transpose() * lambda_pa;
    let largest = coupled.symmetric_eigenvalues().max();
    weights.map(|weight| weight * largest * volume_m3)
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
    use nalgebra::SMatrix;

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
}
