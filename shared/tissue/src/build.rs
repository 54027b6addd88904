//! Making a model: checks, rest data in double precision, masses, bound, blocks.
//!
//! Promise: the result depends on the arguments alone; every fault of the input is a typed error.

mod soften;

use hyst_mesh::TetMesh;
use nalgebra::{Matrix3, Vector3};

use crate::bound::{self, Spread};
use crate::check;
use crate::layout::{self, Block, LANES, RestBlock, Row};
use crate::material::Material;
use crate::model::{Model, ModelError, ModelReport, Options, omega_allowed_per_s, substeps_stable};
use crate::spectrum::{self, Element};

/// A tet flatter than this (volume over the cube of its longest edge) has no usable inverse in single precision.
const FLATNESS_MIN: f64 = 1e-7;
/// How far a node may stray, in diameters of the object at rest: room for a piece that floats away, and finite forces.
const REACH_DIAMETERS: f64 = 100.0;
/// Largest number that a product in a step may reach: far below the end of single precision.
const FORCE_MAX_N: f64 = 1e30;

/// One tet at rest.
struct Rest {
    inv_edges: Matrix3<f64>,
    volume_m3: f64,
    gradients: [Vector3<f64>; 4],
    material: Material,
}

impl Rest {
    /// Its share of the bound at its four corners.
    fn corner_stiffness_n_m(&self, spread: Spread) -> [f64; 4] {
        let (mu, lambda) = (self.material.shear_modulus_pa(), self.material.lame_lambda_pa());
        bound::corner_stiffness_n_m(&self.gradients, self.volume_m3, mu, lambda, spread)
    }
}

/// What tets add up to at their nodes.
struct NodeSums {
    mass: Vec<f64>,
    /// Mass times damping, kg/s.
    drag: Vec<f64>,
    /// The bound by each way of spreading, N/m.
    stiffness: [Vec<f64>; 2],
}

impl NodeSums {
    fn new(nodes: usize) -> Self {
        let zeros = || vec![0.0; nodes];
        NodeSums { mass: zeros(), drag: zeros(), stiffness: [zeros(), zeros()] }
    }

    fn add_stiffness(&mut self, tet: &[u32; 4], data: &Rest) {
        for (spread, sum) in Spread::BOTH.into_iter().zip(&mut self.stiffness) {
            let corners = data.corner_stiffness_n_m(spread);
            tet.iter().zip(corners).for_each(|(&node, share)| sum[node as usize] += share);
        }
    }

    fn add_mass(&mut self, tet: &[u32; 4], data: &Rest) {
        let material = &data.material;
        let share_kg = material.density_kg_m3() * data.volume_m3 / 4.0;
        for &node in tet {
            self.mass[node as usize] += share_kg;
            self.drag[node as usize] += share_kg * material.damping_per_s();
        }
    }
}

pub(crate) fn build(
    mesh: &TetMesh,
    fixed: &[bool],
    material_of: &dyn Fn(u32) -> Option<Material>,
    options: Options,
) -> Result<(Model, ModelReport), ModelError> {
    check::options(&options)?;
    check::mesh(mesh, fixed)?;
    let nodes = mesh.positions_m.len();
    let reach_m = reach_m(mesh);
    let mut sums = NodeSums::new(nodes);
    let mut rest = Vec::with_capacity(mesh.tets.len());
    for (index, tet) in mesh.tets.iter().enumerate() {
        let region = mesh.regions.get(index).copied();
        let material = region.and_then(material_of).ok_or(ModelError::Region { tet: index, region })?;
        let data = rest_of(mesh, index, reach_m, material)?;
        sums.add_mass(tet, &data);
        rest.push(data);
    }
    let softened = soften::flat_tets(mesh, &mut rest, &sums.mass, fixed, &options);
    mesh.tets.iter().zip(&rest).for_each(|(tet, data)| sums.add_stiffness(tet, data));
    let NodeSums { mass: own_mass, drag, stiffness } = sums;
    let mut mass = own_mass.clone();
    let held: Vec<bool> = fixed.iter().zip(&mass).map(|(&fixed, &mass)| fixed || mass == 0.0).collect();
    let own_mass_kg: f64 = mass.iter().sum();
    let unused_nodes = mass.iter().filter(|&&mass| mass == 0.0).count();
    let stiffness = better_bound(stiffness, &mass, &held, options.contact_stiffness_n_m);
    let (added_mass_kg, scaled_nodes) = fit_step(&mut mass, &stiffness, own_mass_kg, &options)?;
    let omega_max_per_s = bound::omega_per_s(&mass, &stiffness);
    let found_per_s = || omega_rest_per_s(mesh, &rest, &mass, &held, &options);
    let omega_rest_per_s = options.omega_rest_per_s.unwrap_or_else(found_per_s).min(omega_max_per_s);
    let mut report = ModelReport {
        nodes,
        tets: mesh.tets.len(),
        unused_nodes,
        volume_m3: rest.iter().map(|tet| tet.volume_m3).sum(),
        mass_kg: own_mass_kg,
        added_mass_kg,
        scaled_nodes,
        softened_tets: softened.tets,
        softened_volume_m3: softened.volume_m3,
        shortest_edge_m: shortest_edge_m(mesh),
        omega_rest_per_s,
        omega_max_per_s,
        substeps: 0,
    };
    let order = layout::pack(&mesh.tets, nodes);
    let model = Model {
        rest_m: mesh.positions_m.clone(),
        tets: mesh.tets.clone(),
        inv_mass: node_rows(nodes, |node| if held[node] { 0.0 } else { 1.0 / mass[node] }),
        damping_per_s: node_rows(nodes, |node| if held[node] { 0.0 } else { drag[node] / own_mass[node] }),
        blocks: order.chunks_exact(LANES).map(|lanes| block_of(lanes, mesh, &rest)).collect(),
        rest_blocks: order.chunks_exact(LANES).map(|lanes| rest_block_of(lanes, &rest)).collect(),
        mass_kg: mass.iter().map(|&mass| mass as f32).collect(),
        held,
        options,
        omega_rest_per_s,
        omega_max_per_s,
        reach_m: reach_m as f32,
    };
    report.substeps = model.substeps(options.step_s);
    Ok((model, report))
}

fn position(mesh: &TetMesh, node: u32) -> Vector3<f64> {
    Vector3::from(mesh.positions_m[node as usize].map(f64::from))
}

fn reach_m(mesh: &TetMesh) -> f64 {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for &node in mesh.tets.iter().flatten() {
        low = low.inf(&position(mesh, node));
        high = high.sup(&position(mesh, node));
    }
    REACH_DIAMETERS * (high - low).norm()
}

fn rest_of(mesh: &TetMesh, tet: usize, reach_m: f64, material: Material) -> Result<Rest, ModelError> {
    let [a, b, c, d] = mesh.tets[tet].map(|node| position(mesh, node));
    let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
    let volume_m3 = edges.determinant() / 6.0;
    let longest = [b - a, c - a, d - a, c - b, d - b, d - c].iter().map(|edge| edge.norm()).fold(0.0, f64::max);
    let bad = ModelError::BadTet { tet, volume_m3 };
    if volume_m3 <= FLATNESS_MIN * longest.powi(3) || !(1e-30..=1e30).contains(&volume_m3) {
        return Err(bad);
    }
    let inv_edges = edges.try_inverse().ok_or(bad.clone())?;
    let row = |i: usize| inv_edges.row(i).transpose();
    let stiffest_pa = material.shear_modulus_pa().max(material.lame_lambda_pa());
    if stiffest_pa * volume_m3 * inv_edges.norm_squared() * reach_m > FORCE_MAX_N {
        return Err(bad);
    }
    let gradients = [-(row(0) + row(1) + row(2)), row(0), row(1), row(2)];
    Ok(Rest { inv_edges, volume_m3, gradients, material })
}

/// The one of the two bounds that asks for the smaller frequency, with contact added; 0 at held nodes, which do not move freely.
fn better_bound(bounds: [Vec<f64>; 2], mass: &[f64], held: &[bool], contact_n_m: f64) -> Vec<f64> {
    let [equal, by_gradient] = bounds.map(|bound| {
        let free = |(share, &held): (f64, &bool)| if held { 0.0 } else { share + contact_n_m };
        bound.into_iter().zip(held).map(free).collect::<Vec<f64>>()
    });
    let worst = |bound: &[f64]| {
        let ratio = bound.iter().zip(mass).filter(|(_, mass)| **mass > 0.0).map(|(share, mass)| share / mass);
        ratio.fold(0.0, f64::max)
    };
    if worst(&by_gradient) < worst(&equal) { by_gradient } else { equal }
}

/// Adds mass until `max_substeps` suffice; returns the mass added and the number of nodes that took some.
fn fit_step(mass: &mut [f64], stiffness: &[f64], own_mass_kg: f64, options: &Options) -> Result<(f64, usize), ModelError> {
    let before = mass.to_vec();
    let unscaled_substeps = substeps_stable(options.step_s, bound::omega_per_s(mass, stiffness));
    let allowed = omega_allowed_per_s(options.step_s, options.max_substeps);
    let added_kg = bound::scale_mass(mass, stiffness, allowed);
    let ratio = added_kg / own_mass_kg;
    if ratio > options.max_added_mass_ratio {
        return Err(ModelError::TooStiff { substeps: options.max_substeps, ratio, unscaled_substeps });
    }
    Ok((added_kg, before.iter().zip(mass.iter()).filter(|(before, after)| before != after).count()))
}

fn omega_rest_per_s(mesh: &TetMesh, rest: &[Rest], mass: &[f64], held: &[bool], options: &Options) -> f64 {
    let elements: Vec<Element<'_>> = mesh
        .tets
        .iter()
        .zip(rest)
        .map(|(nodes, data)| Element {
            nodes,
            gradients: &data.gradients,
            volume_m3: data.volume_m3,
            mu_pa: data.material.shear_modulus_pa(),
            lambda_pa: data.material.lame_lambda_pa(),
        })
        .collect();
    spectrum::omega_per_s(&elements, mass, held, options.contact_stiffness_n_m)
}

fn shortest_edge_m(mesh: &TetMesh) -> f64 {
    let mut shortest = f64::INFINITY;
    for tet in &mesh.tets {
        for (first, second) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            shortest = shortest.min((position(mesh, tet[first]) - position(mesh, tet[second])).norm());
        }
    }
    shortest
}

/// Rows of (v, v, v, 0) for each node, 0 for the spare ones.
fn node_rows(nodes: usize, value: impl Fn(usize) -> f64) -> Vec<Row> {
    let mut rows = vec![Row::ZERO; layout::node_rows(nodes)];
    for node in 0..nodes {
        rows[node / 4].0[4 * (node % 4)..][..3].fill(value(node) as f32);
    }
    rows
}

fn block_of(lanes: &[u32], mesh: &TetMesh, rest: &[Rest]) -> Block {
    let spare = mesh.positions_m.len() as u32;
    let mut block =
        Block { nodes: [[spare; LANES]; 4], metric: [Row::ZERO; 6], inv_volume: Row::ZERO, lambda: Row::ZERO, two_mu: Row::ZERO };
    for (lane, &tet) in lanes.iter().enumerate().filter(|(_, tet)| **tet != u32::MAX) {
        let data = &rest[tet as usize];
        for (corner, &node) in mesh.tets[tet as usize].iter().enumerate() {
            block.nodes[corner][lane] = node;
        }
        let two_mu_pa = 2.0 * data.material.shear_modulus_pa();
        let metric = data.inv_edges * data.inv_edges.transpose() * (two_mu_pa * data.volume_m3);
        for (row, (i, j)) in block.metric.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
            row.0[lane] = metric[(i, j)] as f32;
        }
        block.lambda.0[lane] = data.material.lame_lambda_pa() as f32;
        block.two_mu.0[lane] = two_mu_pa as f32;
        block.inv_volume.0[lane] = (1.0 / data.volume_m3) as f32;
    }
    block
}

fn rest_block_of(lanes: &[u32], rest: &[Rest]) -> RestBlock {
    let mut block = RestBlock { inv_edges: [Row::ZERO; 9], volume: Row::ZERO };
    for (lane, &tet) in lanes.iter().enumerate().filter(|(_, tet)| **tet != u32::MAX) {
        let data = &rest[tet as usize];
        for (index, row) in block.inv_edges.iter_mut().enumerate() {
            row.0[lane] = data.inv_edges[(index / 3, index % 3)] as f32;
        }
        block.volume.0[lane] = data.volume_m3 as f32;
    }
    block
}
