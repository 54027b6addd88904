//! Making a model: checks, rest data in double precision, masses, bound, blocks.
//!
//! Promise: the result depends on the mesh, its fixed nodes, the materials and the options alone, not on what was made before; every fault of the input
//! is a typed error.

mod blocks;
mod rest;
mod soften;

use hyst_mesh::TetMesh;
use nalgebra::Vector3;

use crate::bed::Bed;
use crate::bound;
use crate::check;
use crate::material::Material;
use crate::model::{Model, ModelError, ModelReport, Options, omega_allowed_per_s, substeps_stable};
use crate::spectrum::{self, Element};
use blocks::node_rows;
use rest::{Kept, Rest, Shape};

/// How far a node may stray, in diameters of the object at rest: room for a piece that floats away, and finite forces.
const REACH_DIAMETERS: f64 = 100.0;

/// The material of each region.
pub(crate) enum Materials {
    /// The same for all.
    Same(Material),
    /// Pairs of region and material.
    Each(Vec<(u32, Material)>),
}

impl Materials {
    fn of(&self, region: u32) -> Option<Material> {
        match self {
            Materials::Same(material) => Some(*material),
            Materials::Each(pairs) => pairs.iter().find(|(of, _)| *of == region).map(|(_, material)| *material),
        }
    }
}

/// Makes one model after the other of a mesh that is cut: what it knows of a tet it keeps for as long as the tet has the same index and region, and
/// its corners the same places at rest, to the bit. Each model has the bits of the one that [`Model::with_materials`] makes of the same mesh.
pub struct ModelMaker {
    /// How the next model is made. After the first, [`Options::omega_rest_per_s`] is set to what its report says: looking for it takes far longer than
    /// all else.
    pub options: Options,
    materials: Materials,
    kept: Kept,
}

impl ModelMaker {
    /// With a material per region of the mesh: pairs of region and material, one for every region in use.
    pub fn new(materials: &[(u32, Material)], options: Options) -> ModelMaker {
        ModelMaker::of(Materials::Each(materials.to_vec()), options)
    }

    pub(crate) fn of(materials: Materials, options: Options) -> ModelMaker {
        ModelMaker { options, materials, kept: Kept::default() }
    }

    /// Makes the model of `mesh`. `fixed`: one per node; fixed nodes follow their targets.
    ///
    /// Errors: those of [`Model::with_materials`]; the next model is made as if there had been none.
    pub fn make(&mut self, mesh: &TetMesh, fixed: &[bool]) -> Result<(Model, ModelReport), ModelError> {
        check::options(&self.options)?;
        check::mesh(mesh, fixed)?;
        let reach_m = reach_m(mesh).min(self.options.most_reach_m.unwrap_or(f64::INFINITY));
        self.kept.renew(mesh, &self.materials, reach_m)?;
        let sums = add_to_nodes(mesh, &self.kept.rest, |rest| [rest.corner_mass; 4]);
        let mass: Vec<f64> = sums.iter().map(|[mass, _]| *mass).collect();
        let mut softened = soften::flat_tets(mesh, &self.kept.rest, &mass, fixed, &self.materials, &self.options)?;
        // What is kept is not softened: how much a tet gives way depends on its neighbours.
        let mut swap = |rest: &mut [Rest]| softened.iter_mut().for_each(|(tet, other)| std::mem::swap(&mut rest[*tet], other));
        swap(&mut self.kept.rest);
        let made = assemble(mesh, fixed, &self.kept.rest, sums, &self.options, reach_m);
        swap(&mut self.kept.rest);
        let (model, mut report) = made?;
        report.softened_tets = softened.len();
        report.softened_volume_m3 = softened.iter().map(|(_, rest)| rest.volume_m3).fold(0.0, |sum, volume| sum + volume);
        Ok((model, report))
    }
}

/// What the tets give their corners, two numbers each, added up at the nodes in the order of the tets.
fn add_to_nodes(mesh: &TetMesh, rest: &[Rest], shares: impl Fn(&Rest) -> [[f64; 2]; 4]) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; mesh.positions_m.len()];
    for (tet, data) in mesh.tets.iter().zip(rest) {
        for (&node, share) in tet.iter().zip(shares(data)) {
            let sum = &mut sums[node as usize];
            *sum = [sum[0] + share[0], sum[1] + share[1]];
        }
    }
    sums
}

/// The model of tets that may have been softened. `sums`: own mass of each node, kg, and mass times damping, kg/s.
fn assemble(
    mesh: &TetMesh,
    fixed: &[bool],
    rest: &[Rest],
    sums: Vec<[f64; 2]>,
    options: &Options,
    reach_m: f64,
) -> Result<(Model, ModelReport), ModelError> {
    let nodes = sums.len();
    let mut mass: Vec<f64> = sums.iter().map(|[mass, _]| *mass).collect();
    let held: Vec<bool> = fixed.iter().zip(&mass).map(|(&fixed, &mass)| fixed || mass == 0.0).collect();
    let own_mass_kg: f64 = mass.iter().sum();
    let unused_nodes = mass.iter().filter(|&&mass| mass == 0.0).count();
    let mut stiffness = add_to_nodes(mesh, rest, |rest| rest.corner_stiffness_n_m);
    let beds = beds(mesh, rest, &held);
    for Bed { node, stiffness_n_m } in &beds {
        stiffness[*node as usize].iter_mut().for_each(|share| *share += f64::from(*stiffness_n_m));
    }
    let stiffness = better_bound(stiffness, &mass, &held, options.contact_stiffness_n_m);
    let (added_mass_kg, scaled_nodes) = fit_step(&mut mass, &stiffness, own_mass_kg, options)?;
    let omega_max_per_s = bound::omega_per_s(&mass, &stiffness);
    let omega_rest_per_s = match options.omega_rest_per_s {
        Some(told_per_s) => told_per_s,
        None => omega_rest_per_s(mesh, rest, &mass, &held, &beds, options)?,
    };
    let omega_rest_per_s = omega_rest_per_s.min(omega_max_per_s);
    let mut report = ModelReport {
        nodes,
        tets: mesh.tets.len(),
        unused_nodes,
        volume_m3: rest.iter().map(|tet| tet.volume_m3).sum(),
        mass_kg: own_mass_kg,
        added_mass_kg,
        scaled_nodes,
        softened_tets: 0,
        softened_volume_m3: 0.0,
        shortest_edge_m: rest.iter().map(|tet| tet.shortest_edge_m).fold(f64::INFINITY, f64::min),
        omega_rest_per_s,
        omega_max_per_s,
        substeps: 0,
    };
    let (corners, blocks, rest_blocks) = blocks::of_tets(mesh, rest);
    let model = Model {
        rest_m: mesh.positions_m.clone(),
        tets: mesh.tets.clone(),
        inv_mass: node_rows(nodes, |node| if held[node] { 0.0 } else { 1.0 / mass[node] }),
        damping_per_s: node_rows(nodes, |node| if held[node] { 0.0 } else { sums[node][1] / sums[node][0] }),
        corners,
        blocks,
        rest_blocks,
        mass_kg: mass.iter().map(|&mass| mass as f32).collect(),
        bound_n_m: stiffness.iter().map(|&bound| bound as f32).collect(),
        held,
        beds,
        options: *options,
        omega_rest_per_s,
        omega_max_per_s,
        reach_m: reach_m as f32,
    };
    report.substeps = model.substeps(options.step_s);
    Ok((model, report))
}

/// What holds the free nodes of material on beds, by ascending node.
fn beds(mesh: &TetMesh, rest: &[Rest], held: &[bool]) -> Vec<Bed> {
    if rest.iter().all(|rest| rest.corner_bed_n_m == 0.0) {
        return Vec::new();
    }
    let sums = add_to_nodes(mesh, rest, |rest| [[rest.corner_bed_n_m, 0.0]; 4]);
    let bed = |node: usize| Bed { node: node as u32, stiffness_n_m: sums[node][0] as f32 };
    (0..sums.len()).filter(|node| !held[*node] && sums[*node][0] > 0.0).map(bed).collect()
}

/// The box is that of the nodes in use.
fn reach_m(mesh: &TetMesh) -> f64 {
    let mut is_used = vec![false; mesh.positions_m.len()];
    mesh.tets.iter().flatten().for_each(|&node| is_used[node as usize] = true);
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for (place, _) in mesh.positions_m.iter().zip(is_used).filter(|(_, is_used)| *is_used) {
        low = [0, 1, 2].map(|axis| low[axis].min(place[axis]));
        high = [0, 1, 2].map(|axis| high[axis].max(place[axis]));
    }
    let [low, high] = [low, high].map(|corner| Vector3::from(corner.map(f64::from)));
    REACH_DIAMETERS * (high - low).norm()
}

/// The one of the two bounds that asks for the smaller frequency, with contact added; 0 at held nodes, which do not move freely.
fn better_bound(bounds: Vec<[f64; 2]>, mass: &[f64], held: &[bool], contact_n_m: f64) -> Vec<f64> {
    let [equal, by_gradient] = [0, 1].map(|spread| {
        let free = |(shares, &held): (&[f64; 2], &bool)| if held { 0.0 } else { shares[spread] + contact_n_m };
        bounds.iter().zip(held).map(free).collect::<Vec<f64>>()
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
        let enough = |substeps: u32| {
            let allowed = omega_allowed_per_s(options.step_s, substeps);
            bound::scale_mass(&mut before.clone(), stiffness, allowed) / own_mass_kg <= options.max_added_mass_ratio
        };
        let enough_substeps = least(options.max_substeps, unscaled_substeps, enough);
        return Err(ModelError::TooStiff { substeps: options.max_substeps, ratio, unscaled_substeps, enough_substeps });
    }
    Ok((added_kg, before.iter().zip(mass.iter()).filter(|(before, after)| before != after).count()))
}

/// The least number above one that is too low, up to one that is high enough, that is: by halving what is between them, 32 times at most.
fn least(mut low: u32, high: u32, is_enough: impl Fn(u32) -> bool) -> u32 {
    let mut high = high.max(low.saturating_add(1));
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if is_enough(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

fn omega_rest_per_s(
    mesh: &TetMesh,
    rest: &[Rest],
    mass: &[f64],
    held: &[bool],
    beds: &[Bed],
    options: &Options,
) -> Result<f64, ModelError> {
    let element = |(tet, data): (usize, &Rest)| {
        let (nodes, Rest { volume_m3, mu_pa, lambda_pa, .. }) = (&mesh.tets[tet], *data);
        Shape::of(mesh, tet).map(|Shape { gradients, .. }| Element { nodes, gradients, volume_m3, mu_pa, lambda_pa })
    };
    let elements: Vec<Element<'_>> = rest.iter().enumerate().map(element).collect::<Result<_, _>>()?;
    let mut outside_n_m = vec![options.contact_stiffness_n_m; mass.len()];
    beds.iter().for_each(|bed| outside_n_m[bed.node as usize] += f64::from(bed.stiffness_n_m));
    Ok(spectrum::omega_per_s(&elements, mass, held, &outside_n_m))
}
