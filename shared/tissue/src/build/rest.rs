//! What is known of a tet from its own shape and material: made once, and kept for as long as its corners stay where they are.
//!
//! Promise: what is kept has the bits that making it anew would give.

use super::Materials;
use crate::bound::{self, Spread};
use crate::material::Material;
use crate::model::ModelError;
use hyst_mesh::{FLAT_QUALITY, TetMesh, quality};
use nalgebra::{Matrix3, Vector3};

/// A tet flatter than this (volume over the cube of its longest edge) has no usable inverse in single precision.
const FLATNESS_MIN: f64 = 1e-7;
/// Largest number that a product in a step may reach: far below the end of single precision.
const FORCE_MAX_N: f64 = 1e30;

/// The shape of one tet at rest.
pub(super) struct Shape {
    inv_edges: Matrix3<f64>,
    volume_m3: f64,
    pub gradients: [Vector3<f64>; 4],
    shortest_edge_m: f64,
    is_flat: bool,
}

impl Shape {
    /// Error: [`ModelError::BadTet`].
    pub fn of(mesh: &TetMesh, tet: usize) -> Result<Shape, ModelError> {
        let places_m = mesh.tets[tet].map(|node| mesh.positions_m[node as usize].map(f64::from));
        let [a, b, c, d] = places_m.map(Vector3::from);
        let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
        let volume_m3 = edges.determinant() / 6.0;
        let squared = [b - a, c - a, d - a, c - b, d - b, d - c].map(|edge| edge.norm_squared());
        let longest_m = squared.into_iter().fold(0.0, f64::max).sqrt();
        let bad = || ModelError::BadTet { tet, volume_m3 };
        if volume_m3 <= FLATNESS_MIN * longest_m.powi(3) || !(1e-30..=1e30).contains(&volume_m3) {
            return Err(bad());
        }
        let inv_edges = edges.try_inverse().ok_or_else(bad)?;
        let row = |i: usize| inv_edges.row(i).transpose();
        Ok(Shape {
            inv_edges,
            volume_m3,
            gradients: [-(row(0) + row(1) + row(2)), row(0), row(1), row(2)],
            shortest_edge_m: squared.into_iter().fold(f64::INFINITY, f64::min).sqrt(),
            is_flat: quality(places_m.map(Into::into)) < FLAT_QUALITY,
        })
    }
}

/// One tet at rest, of its material.
#[derive(Clone, Copy)]
pub(super) struct Rest {
    pub volume_m3: f64,
    /// What each corner gets: mass, kg, and mass times damping, kg/s.
    pub corner_mass: [f64; 2],
    /// Its share of the bound at each corner by each way of spreading, N/m.
    pub corner_stiffness_n_m: [[f64; 2]; 4],
    /// What each corner gets of the bed that the material is on, N/m.
    pub corner_bed_n_m: f64,
    /// Above the largest of its forces for each metre that a node strays, N/m.
    force_n_m: f64,
    pub shortest_edge_m: f64,
    pub mu_pa: f64,
    pub lambda_pa: f64,
    /// Below [`FLAT_QUALITY`].
    pub is_flat: bool,
    pub lane: Lane,
}

/// A tet's lane of its blocks, in their units.
#[derive(Clone, Copy)]
pub(super) struct Lane {
    pub metric: [f32; 6],
    pub inv_volume: f32,
    pub lambda: f32,
    pub two_mu: f32,
    pub inv_edges: [f32; 9],
    pub volume: f32,
}

impl Rest {
    pub fn of(shape: &Shape, material: &Material) -> Rest {
        let (mu_pa, lambda_pa, volume_m3) = (material.shear_modulus_pa(), material.lame_lambda_pa(), shape.volume_m3);
        let share_kg = material.density_kg_m3() * volume_m3 / 4.0;
        let [equal, by_gradient] =
            Spread::BOTH.map(|spread| bound::corner_stiffness_n_m(&shape.gradients, volume_m3, mu_pa, lambda_pa, spread));
        Rest {
            volume_m3,
            corner_mass: [share_kg, share_kg * material.damping_per_s()],
            corner_stiffness_n_m: [0, 1, 2, 3].map(|corner| [equal[corner], by_gradient[corner]]),
            corner_bed_n_m: material.bed_n_m4() * volume_m3 / 4.0,
            force_n_m: mu_pa.max(lambda_pa) * volume_m3 * shape.inv_edges.norm_squared(),
            shortest_edge_m: shape.shortest_edge_m,
            mu_pa,
            lambda_pa,
            is_flat: shape.is_flat,
            lane: Lane::of(shape, mu_pa, lambda_pa),
        }
    }
}

impl Lane {
    fn of(shape: &Shape, mu_pa: f64, lambda_pa: f64) -> Lane {
        let two_mu_pa = 2.0 * mu_pa;
        let metric = shape.inv_edges * shape.inv_edges.transpose() * (two_mu_pa * shape.volume_m3);
        Lane {
            metric: [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|place| metric[place] as f32),
            inv_volume: (1.0 / shape.volume_m3) as f32,
            lambda: lambda_pa as f32,
            two_mu: two_mu_pa as f32,
            inv_edges: [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|index| shape.inv_edges[(index / 3, index % 3)] as f32),
            volume: shape.volume_m3 as f32,
        }
    }
}

/// The tets of the mesh that was last made a model of, or was tried.
#[derive(Default)]
pub(super) struct Kept {
    mesh: TetMesh,
    /// One for each tet of `mesh`.
    pub rest: Vec<Rest>,
}

impl Kept {
    /// Brings it up to `mesh`, in which nodes may stray by `reach_m`.
    pub fn renew(&mut self, mesh: &TetMesh, materials: &Materials, reach_m: f64) -> Result<(), ModelError> {
        let renewed = self.renew_tets(mesh, materials, reach_m);
        if renewed.is_err() {
            // Some tets are those of the one mesh, some those of the other.
            *self = Kept::default();
            return renewed;
        }
        self.mesh.positions_m.clone_from(&mesh.positions_m);
        self.mesh.tets.clone_from(&mesh.tets);
        self.mesh.regions.clone_from(&mesh.regions);
        renewed
    }

    fn renew_tets(&mut self, mesh: &TetMesh, materials: &Materials, reach_m: f64) -> Result<(), ModelError> {
        for tet in 0..mesh.tets.len() {
            if !self.is_same(mesh, tet) {
                let region = mesh.regions.get(tet).copied();
                let material = region.and_then(|region| materials.of(region)).ok_or(ModelError::Region { tet, region })?;
                let rest = Rest::of(&Shape::of(mesh, tet)?, &material);
                match self.rest.get_mut(tet) {
                    Some(before) => *before = rest,
                    None => self.rest.push(rest),
                }
            }
            let Rest { force_n_m, volume_m3, .. } = self.rest[tet];
            if force_n_m * reach_m > FORCE_MAX_N {
                return Err(ModelError::BadTet { tet, volume_m3 });
            }
        }
        self.rest.truncate(mesh.tets.len());
        Ok(())
    }

    /// Whether the tet of this index has the corners and the region that it had. The corners may have other names: a node that was parted has copies.
    fn is_same(&self, mesh: &TetMesh, tet: usize) -> bool {
        let Some(before) = self.mesh.tets.get(tet) else { return false };
        let bits = |mesh: &TetMesh, node: u32| mesh.positions_m[node as usize].map(f32::to_bits);
        self.mesh.regions.get(tet) == mesh.regions.get(tet)
            && mesh.tets[tet].iter().zip(before).all(|(&now, &before)| bits(mesh, now) == bits(&self.mesh, before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MARK: f64 = 42.0;

    /// Two tets on one face.
    fn pair() -> TetMesh {
        TetMesh {
            positions_m: vec![[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, -0.01]],
            tets: vec![[0, 1, 2, 3], [0, 2, 1, 4]],
            regions: vec![0, 0],
        }
    }

    /// Whether each tet of the mesh that `change` makes is kept from the mesh before.
    fn kept_after(change: impl Fn(&mut TetMesh)) -> Vec<bool> {
        let materials = Materials::Same(Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap());
        let (mut mesh, mut kept) = (pair(), Kept::default());
        kept.renew(&mesh, &materials, 1.0).unwrap();
        kept.rest.iter_mut().for_each(|rest| rest.volume_m3 = MARK);
        change(&mut mesh);
        kept.renew(&mesh, &materials, 1.0).unwrap();
        kept.rest.iter().map(|rest| rest.volume_m3 == MARK).collect()
    }

    #[test]
    fn a_tet_is_kept_until_a_corner_moves_or_its_region_changes() {
        assert_eq!(kept_after(|_| {}), [true, true]);
        assert_eq!(kept_after(|mesh| mesh.positions_m[4][2] = -0.011), [true, false]);
        assert_eq!(kept_after(|mesh| mesh.positions_m[0][0] = -0.0), [false, false]);
        assert_eq!(kept_after(|mesh| mesh.regions[1] = 7), [true, false]);
        assert_eq!(kept_after(|mesh| mesh.tets[0] = [1, 2, 0, 3]), [false, true]);
        // a node that was parted: another name for the same place
        let parted = |mesh: &mut TetMesh| {
            mesh.positions_m.push([0.0; 3]);
            mesh.tets[1][0] = 5;
        };
        assert_eq!(kept_after(parted), [true, true]);
        let grown = |mesh: &mut TetMesh| {
            mesh.tets.push([0, 1, 2, 3]);
            mesh.regions.push(0);
        };
        assert_eq!(kept_after(grown), [true, true, false]);
        let burnt = |mesh: &mut TetMesh| {
            mesh.tets.remove(0);
            mesh.regions.remove(0);
        };
        assert_eq!(kept_after(burnt), [false]);
    }
}
