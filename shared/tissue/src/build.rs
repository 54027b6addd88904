//! Making a model: checks, rest data in double precision, masses, bound, blocks.
//!
//! Promise: the result depends on the mesh, its fixed nodes, the materials and the options alone, not on what was made before; every fault of the input
//! is a typed error.

mod blocks;
mod rest;
mod soften;
mod sums;

use hyst_mesh::TetMesh;
use nalgebra::Vector3;

use crate::bed::Bed;
use crate::bound;
use crate::bulk::Bulk;
use crate::check;
use crate::material::Material;
use crate::model::{Model, ModelError, ModelReport, Options, omega_allowed_per_s, substeps_stable};
use crate::spectrum::{self, Element};
use blocks::node_rows;
use rest::{Kept, Rest, Shape};
use sums::{NodeSum, Sums};

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

/// Makes one model after the other of a mesh that is cut: what it knows of a tet it keeps for as long as the tet has the same region, its corners the same
/// places at rest, to the bit, and its index is the same, or less where tets before it were taken out. Each model has the bits of the one that
/// [`Model::with_materials`] makes of the same mesh.
pub struct ModelMaker {
    /// How the next model is made. After the first, [`Options::omega_rest_per_s`] is set to what its report says: looking for it takes far longer than
    /// all else.
    pub options: Options,
    materials: Materials,
    kept: Kept,
    /// Room for those of a mesh.
    sums: Sums,
}

impl ModelMaker {
    /// With a material per region of the mesh: pairs of region and material, one for every region in use.
    pub fn new(materials: &[(u32, Material)], options: Options) -> ModelMaker {
        ModelMaker::of(Materials::Each(materials.to_vec()), options)
    }

    pub(crate) fn of(materials: Materials, options: Options) -> ModelMaker {
        ModelMaker { options, materials, kept: Kept::default(), sums: Sums::default() }
    }

    /// Makes the model of `mesh`. `fixed`: one per node; fixed nodes follow their targets.
    ///
    /// Errors: those of [`Model::with_materials`]; the next model is made as if there had been none.
    pub fn make(&mut self, mesh: &TetMesh, fixed: &[bool]) -> Result<(Model, ModelReport), ModelError> {
        self.make_of(mesh, &mesh.regions, fixed)
    }

    /// As [`ModelMaker::make`], of tets that are of these regions, one each, whatever the mesh itself says.
    pub fn make_of(&mut self, mesh: &TetMesh, regions: &[u32], fixed: &[bool]) -> Result<(Model, ModelReport), ModelError> {
        let ModelMaker { options, materials, kept, sums } = self;
        check::options(options)?;
        check::mesh(mesh, fixed)?;
        let reach_m = reach_m(mesh).min(options.most_reach_m.unwrap_or(f64::INFINITY));
        kept.renew(mesh, regions, materials, reach_m)?;
        sums.add_up(mesh, &kept.rest);
        let mut softened = soften::flat_tets(kept, sums, fixed, materials, options)?;
        if !softened.is_empty() {
            // What is kept is not softened: how much a tet gives way depends on its neighbours.
            kept.swap(&mut softened);
            sums.add_up(mesh, &kept.rest);
        }
        let made = assemble(mesh, fixed, kept, sums, options, reach_m);
        kept.swap(&mut softened);
        let (model, mut report) = made?;
        report.softened_tets = softened.len();
        report.softened_volume_m3 = softened.iter().map(|(_, rest, _)| rest.volume_m3).fold(0.0, |sum, volume| sum + volume);
        Ok((model, report))
    }
}

/// The model of tets that may have been softened. Beds are added to `sums`.
fn assemble(
    mesh: &TetMesh,
    fixed: &[bool],
    kept: &Kept,
    sums: &mut Sums,
    options: &Options,
    reach_m: f64,
) -> Result<(Model, ModelReport), ModelError> {
    let nodes = sums.nodes.len();
    let mut mass: Vec<f64> = sums.nodes.iter().map(|sum| sum.mass[0]).collect();
    let held: Vec<bool> = fixed.iter().zip(&mass).map(|(&fixed, &mass)| fixed || mass == 0.0).collect();
    let own_mass_kg: f64 = mass.iter().sum();
    let unused_nodes = mass.iter().filter(|&&mass| mass == 0.0).count();
    let beds = sums.beds(&held);
    for Bed { node, stiffness_n_m } in &beds {
        sums.nodes[*node as usize].stiffness_n_m.iter_mut().for_each(|share| *share += f64::from(*stiffness_n_m));
    }
    let stiffness = better_bound(&sums.nodes, &held, options.contact_stiffness_n_m);
    let (added_mass_kg, scaled_nodes) = fit_step(&mut mass, &stiffness, own_mass_kg, options)?;
    let omega_max_per_s = bound::omega_per_s(&mass, &stiffness);
    let omega_rest_per_s = match options.omega_rest_per_s {
        Some(told_per_s) => told_per_s,
        None => omega_rest_per_s(mesh, (&kept.rest, sums), &mass, &held, &beds, options)?,
    };
    let omega_rest_per_s = omega_rest_per_s.min(omega_max_per_s);
    let mut report = ModelReport {
        nodes,
        tets: mesh.tets.len(),
        unused_nodes,
        volume_m3: sums.volume_m3,
        mass_kg: own_mass_kg,
        added_mass_kg,
        scaled_nodes,
        softened_tets: 0,
        softened_volume_m3: 0.0,
        shortest_edge_m: sums.shortest_edge_m,
        omega_rest_per_s,
        omega_max_per_s,
        substeps: 0,
    };
    let (corners, blocks, rest_blocks) = blocks::of_tets(mesh, &kept.lanes);
    let model = Model {
        rest_m: mesh.positions_m.clone(),
        tets: mesh.tets.clone(),
        inv_mass: node_rows(nodes, |node| if held[node] { 0.0 } else { 1.0 / mass[node] }),
        damping_per_s: node_rows(nodes, |node| if held[node] { 0.0 } else { sums.nodes[node].damping_per_s() }),
        bulk: Bulk::new(&rest_blocks, &sums.bulk),
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
fn better_bound(nodes: &[NodeSum], held: &[bool], contact_n_m: f64) -> Vec<f64> {
    let mut worst = [0.0f64; 2];
    for (sum, _) in nodes.iter().zip(held).filter(|(_, held)| !**held) {
        worst = [0, 1].map(|spread| worst[spread].max((sum.stiffness_n_m[spread] + contact_n_m) / sum.mass[0]));
    }
    let spread = usize::from(worst[1] < worst[0]);
    let free = |(sum, &held): (&NodeSum, &bool)| if held { 0.0 } else { sum.stiffness_n_m[spread] + contact_n_m };
    nodes.iter().zip(held).map(free).collect()
}

/// Adds mass until `max_substeps` suffice; returns the mass added and the number of nodes that took some.
fn fit_step(mass: &mut [f64], stiffness: &[f64], own_mass_kg: f64, options: &Options) -> Result<(f64, usize), ModelError> {
    let before = mass.to_vec();
    let allowed = omega_allowed_per_s(options.step_s, options.max_substeps);
    let added_kg = bound::scale_mass(mass, stiffness, allowed);
    let ratio = added_kg / own_mass_kg;
    if ratio > options.max_added_mass_ratio {
        let unscaled_substeps = substeps_stable(options.step_s, bound::omega_per_s(&before, stiffness));
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
    (rest, sums): (&[Rest], &Sums),
    mass: &[f64],
    held: &[bool],
    beds: &[Bed],
    options: &Options,
) -> Result<f64, ModelError> {
    let element = |(tet, data): (usize, &Rest)| {
        let (nodes, Rest { volume_m3, mu_pa, lambda_pa, is_held_by_nodes, .. }) = (&mesh.tets[tet], *data);
        Shape::of(mesh, tet).map(|Shape { gradients, .. }| Element {
            nodes,
            gradients,
            volume_m3,
            mu_pa,
            lambda_pa,
            is_held_by_nodes,
        })
    };
    let elements: Vec<Element<'_>> = rest.iter().enumerate().map(element).collect::<Result<_, _>>()?;
    let mut outside_n_m = vec![options.contact_stiffness_n_m; mass.len()];
    beds.iter().for_each(|bed| outside_n_m[bed.node as usize] += f64::from(bed.stiffness_n_m));
    Ok(spectrum::omega_per_s((&elements, &sums.bulk), mass, held, &outside_n_m))
}
