//! The forces that hold a model at a shape that stretches it: with them as external ones the shape is an equilibrium, and a share of them leads some of the
//! way there. A dead load does not depend on where the nodes are, so that it needs no room in the bound on the stiffness and feeds no mode.
//!
//! What the shape presses together is not held. The volume of an element is known by the trace of its stretch, so that one under much pressure gives way by
//! shearing, and under dead loads it would turn inside out. So it resists, and the tissue about it comes to rest some way before the shape.
//!
//! Promise: the stress is that of the step's own elements (`kernel`, whose β does nothing at the element's rotation); in double precision, with
//! + − × ÷ alone and in the order of the model's blocks, so that the bits depend on model and shape alone, whatever the instruction set.

use crate::layout::{self, Corners, LANES, RestBlock};
use crate::material::POISSON_RATIO_MAX;
use crate::model::Model;
use nalgebra::{Matrix3, Vector3};

/// Most rounds of the search for a rotation: it doubles the digits that are right in each, and from a stretch of 2⁻²⁰ it takes 20 until it does.
const MOST_ROUNDS: usize = 40;
/// What rounding makes of a stretch that is none: corners in single precision.
const ROUNDING: f64 = 1e-6;
/// λ over 2μ of the material with the highest Poisson's ratio: what rounding makes of a pressure.
const MOST_BULK: f64 = POISSON_RATIO_MAX / (1.0 - 2.0 * POISSON_RATIO_MAX);
/// Square of what a round changes at last: the next one would change nothing in double precision.
const NO_CHANGE: f64 = 1e-18;

/// Adds the forces that hold each node against the elastic forces at `position_m`, N. Tets that the shape presses together or turns inside out add nothing,
/// and resist it; nor do those whose corners are all at rest, if their nodes are under no pressure either.
///
/// Returns how many tets were left out because they resist, or because a corner is beyond one of the slices.
pub fn holding_forces(model: &Model, position_m: &[[f32; 3]], out_n: &mut [[f32; 3]]) -> usize {
    let count = model.rest_m.len().min(position_m.len()).min(out_n.len());
    let pressures_pa = pressures_pa(model, &position_m[..count]);
    let is_moved = |node: &usize| *node >= count || position_m[*node] != model.rest_m[*node];
    let mut left_out = 0;
    for (block, (constants, rest)) in model.blocks.iter().zip(&model.rest_blocks).enumerate() {
        for lane in (0..LANES).filter(|lane| rest.volume.0[*lane] > 0.0) {
            let nodes = corners_of(&model.corners, block, lane);
            let of_node = |node: &usize| pressures_pa.get(*node).copied().unwrap_or(0.0);
            let shared_pa = if rest.is_held_by_nodes(lane) { nodes.iter().map(of_node).sum::<f64>() / 4.0 } else { 0.0 };
            if shared_pa == 0.0 && !nodes.iter().any(is_moved) {
                continue;
            }
            let inv_edges = inv_edges(rest, lane);
            let lame_pa = [constants.lambda.0[lane], constants.two_mu.0[lane]].map(f64::from);
            let stress_pa = match nodes.iter().all(|node| *node < count) {
                true => stress_pa(&(edges_m(nodes, position_m) * inv_edges), lame_pa, shared_pa),
                false => None,
            };
            let Some(stress_pa) = stress_pa else {
                left_out += 1;
                continue;
            };
            // One column for each corner but the first: what holds them all adds up to nothing.
            let held_n = stress_pa * inv_edges.transpose() * f64::from(rest.volume.0[lane]);
            let [one, two, three] = [0, 1, 2].map(|column| held_n.column(column).into_owned());
            for (node, force_n) in nodes.into_iter().zip([-(one + two + three), one, two, three]) {
                out_n[node].iter_mut().zip(force_n.iter()).for_each(|(sum, part)| *sum += *part as f32);
            }
        }
    }
    left_out
}

/// The pressure of each node that holds the volume of tets, Pa: as in [`bulk`](crate::bulk), at the elements' own rotations. Tets with a corner beyond the slice
/// and those that are inside out count as at rest. None for a model without such nodes.
fn pressures_pa(model: &Model, position_m: &[[f32; 3]]) -> Vec<f64> {
    let Some(bulk) = &model.bulk else { return Vec::new() };
    let mut grown_m3 = vec![0.0; bulk.nodes.len()];
    for (block, rest) in model.rest_blocks.iter().enumerate() {
        for lane in (0..LANES).filter(|lane| rest.is_held_by_nodes(*lane)) {
            let nodes = corners_of(&model.corners, block, lane);
            if nodes.iter().any(|node| *node >= position_m.len()) {
                continue;
            }
            let deformation = edges_m(nodes, position_m) * inv_edges(rest, lane);
            let turned = if deformation.determinant() > 0.0 { rotation(&deformation) } else { None };
            let stretch = turned.map_or(0.0, |rotation| (rotation.transpose() * deformation).trace() - 3.0);
            if stretch.is_finite() {
                nodes.iter().for_each(|node| grown_m3[*node] += stretch * f64::from(rest.volume.0[lane]));
            }
        }
    }
    let nodes = grown_m3.iter().zip(&bulk.nodes);
    nodes.map(|(grown_m3, node)| (grown_m3 * f64::from(node.pa_per_m3)).min(f64::from(node.most_pa))).collect()
}

/// The inverse of a tet's edges at rest, 1/m.
fn inv_edges(rest: &RestBlock, lane: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|row, axis| f64::from(rest.inv_edges[3 * row + axis].0[lane]))
}

/// The nodes of the tet in a lane of a block.
fn corners_of(corners: &Corners, block: usize, lane: usize) -> [usize; 4] {
    match corners {
        Corners::Short(all) => [0, 1, 2, 3].map(|corner| layout::short_node(all[block][corner][lane]) as usize),
        Corners::Long(all) => [0, 1, 2, 3].map(|corner| all[block][corner][lane] as usize),
    }
}

/// The edges of a tet from its first corner, as columns, m.
fn edges_m(nodes: [usize; 4], position_m: &[[f32; 3]]) -> Matrix3<f64> {
    let [origin, one, two, three] = nodes.map(|node| Vector3::from(position_m[node].map(f64::from)));
    Matrix3::from_columns(&[one - origin, two - origin, three - origin])
}

/// First Piola-Kirchhoff stress of an element at a deformation, Pa: 2μ(F − R) + p·R with p = min(λ(tr RᵀF − 3), 2μ) and the pressure of its nodes; `None` where one of the
/// two is less than 0.
fn stress_pa(deformation: &Matrix3<f64>, [lambda_pa, two_mu_pa]: [f64; 2], shared_pa: f64) -> Option<Matrix3<f64>> {
    let rotation = if deformation.determinant() > 0.0 { rotation(deformation)? } else { return None };
    let stretch = (rotation.transpose() * deformation).trace() - 3.0;
    if stretch < -ROUNDING || shared_pa < -ROUNDING * MOST_BULK * two_mu_pa {
        return None;
    }
    let pressure_pa = (lambda_pa * stretch).min(two_mu_pa) + shared_pa;
    let stress_pa = (deformation - rotation) * two_mu_pa + rotation * pressure_pa;
    stress_pa.iter().all(|part| part.is_finite()).then_some(stress_pa)
}

/// The rotation of a deformation that turns nothing inside out: Newton's iteration for the polar decomposition (Higham 1986).
fn rotation(deformation: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let mut found = *deformation;
    for _ in 0..MOST_ROUNDS {
        let next = (found + found.try_inverse()?.transpose()) * 0.5;
        let change = (next - found).norm_squared();
        found = next;
        if change <= NO_CHANGE {
            break;
        }
    }
    Some(found)
}
