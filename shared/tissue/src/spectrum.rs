//! The largest frequency of the object at rest, by power iteration: what the substeps must resolve so that no mode is fed.
//!
//! The bound of [`bound`](crate::bound) keeps a step stable whatever the rotations of the elements. Near the limit of stability,
//! though, each change of the frozen rotations can feed the stiffest modes, and weak damping does not take that energy out again.
//! With equal rotations the frozen stiffness is that at rest, however the object is stretched or turned; so its largest
//! frequency, which lies up to a third below the bound, is the one to be resolved well.

use crate::bulk::BulkSum;
use nalgebra::{Matrix3, Vector3};

/// Most iterations: some tenths of a second for 10 000 tets.
const ITERATIONS_MAX: usize = 300;
/// The iteration ends when the frequency grew by less than this share in [`WINDOW`] iterations.
const GROWTH_MIN: f64 = 1e-3;
/// Iterations between two looks at the growth.
const WINDOW: usize = 20;

/// What the iteration reads of a tet.
pub(crate) struct Element<'a> {
    pub nodes: &'a [u32; 4],
    pub gradients: [Vector3<f64>; 4],
    pub volume_m3: f64,
    pub mu_pa: f64,
    pub lambda_pa: f64,
    /// Whether its nodes hold its volume.
    pub is_held_by_nodes: bool,
}

/// Largest angular frequency, 1/s; 0 if every node is held. `bulk`: how nodes hold the volume of tets; empty if none does.
/// `outside_n_m`: stiffness of what acts on each node from outside, which is asked of free ones.
pub(crate) fn omega_per_s(
    (elements, bulk): (&[Element<'_>], &[BulkSum]),
    mass_kg: &[f64],
    held: &[bool],
    outside_n_m: &[f64],
) -> f64 {
    let mut shape = start(held);
    let (mut omega, mut before) = (0.0f64, 0.0f64);
    for iteration in 1..=ITERATIONS_MAX {
        let mut image: Vec<Vector3<f64>> = shape.iter().zip(outside_n_m).map(|(u, stiffness)| u * *stiffness).collect();
        let pressures_pa = pressures_pa(elements, bulk, &shape);
        elements.iter().for_each(|element| add_image(element, &shape, &pressures_pa, &mut image));
        let (mut energy, mut inertia, mut size) = (0.0, 0.0, 0.0);
        for (node, force) in image.iter_mut().enumerate() {
            if held[node] {
                *force = Vector3::zeros();
                continue;
            }
            energy += force.dot(&shape[node]);
            inertia += mass_kg[node] * shape[node].norm_squared();
            *force /= mass_kg[node];
            size += force.norm_squared();
        }
        if inertia <= 0.0 || size <= 0.0 {
            return 0.0;
        }
        omega = omega.max((energy / inertia).max(0.0).sqrt());
        let scale = 1.0 / size.sqrt();
        shape = image;
        shape.iter_mut().for_each(|u| *u *= scale);
        if iteration % WINDOW == 0 {
            if omega - before < GROWTH_MIN * omega {
                break;
            }
            before = omega;
        }
    }
    omega
}

/// A start without symmetry, the same for the same number of nodes (multiples of the golden ratio, modulo 1).
fn start(held: &[bool]) -> Vec<Vector3<f64>> {
    let value = |index: usize| (index as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
    let node = |(node, &held): (usize, &bool)| {
        if held { Vector3::zeros() } else { Vector3::from_fn(|axis, _| value(3 * node + axis + 1)) }
    };
    held.iter().enumerate().map(node).collect()
}

/// The pressure of each node that holds volume, as `shape` moves them; none if none does.
fn pressures_pa(elements: &[Element<'_>], bulk: &[BulkSum], shape: &[Vector3<f64>]) -> Vec<f64> {
    let mut grown_m3 = vec![0.0; bulk.len()];
    if bulk.is_empty() {
        return grown_m3;
    }
    for element in elements.iter().filter(|element| element.is_held_by_nodes) {
        let dilation: f64 =
            element.nodes.iter().zip(&element.gradients).map(|(&node, slope)| shape[node as usize].dot(slope)).sum();
        element.nodes.iter().for_each(|&node| grown_m3[node as usize] += dilation * element.volume_m3);
    }
    grown_m3.iter().zip(bulk).map(|(grown_m3, sum)| sum.pa_per_m3() * grown_m3).collect()
}

/// Adds the element's frozen stiffness times `shape`.
fn add_image(element: &Element<'_>, shape: &[Vector3<f64>], pressures_pa: &[f64], image: &mut [Vector3<f64>]) {
    let mut gradient = Matrix3::zeros();
    for (&node, slope) in element.nodes.iter().zip(&element.gradients) {
        gradient += shape[node as usize] * slope.transpose();
    }
    let pressure = match element.is_held_by_nodes {
        true => element.nodes.iter().map(|&node| pressures_pa[node as usize]).sum::<f64>() / 4.0,
        false => element.lambda_pa * gradient.trace(),
    };
    let stress = gradient * (2.0 * element.mu_pa) + Matrix3::from_diagonal_element(pressure);
    for (&node, slope) in element.nodes.iter().zip(&element.gradients) {
        image[node as usize] += stress * slope * element.volume_m3;
    }
}
