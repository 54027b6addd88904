//! What is known of a tet from its own shape and material: made once, and kept for as long as its corners stay where they are.
//!
//! Promise: what is kept has the bits that making it anew would give.

use super::Materials;
use crate::bound::{self, Spread};
use crate::material::Material;
use crate::model::ModelError;
use hyst_mesh::{FLAT_QUALITY, TetMesh, is_too_flat, quality};
use nalgebra::{Matrix3, Vector3};

/// Largest number that a product in a step may reach: far below the end of single precision.
const FORCE_MAX_N: f64 = 1e30;
/// Smallest λ that is divided by, Pa.
const LAMBDA_MIN_PA: f32 = 1e-20;
/// How many places a tet is looked for behind where it is expected: what burns at once are pieces of a few tets.
const LOOK_AHEAD: usize = 16;

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
        let bad = || ModelError::BadTet { tet, volume_m3 };
        if is_too_flat(places_m.map(Into::into)) || !(1e-30..=1e30).contains(&volume_m3) {
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

/// One tet at rest, of its material: what every model reads.
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
    /// Whether its nodes hold its volume.
    pub is_held_by_nodes: bool,
    /// Below [`FLAT_QUALITY`].
    pub is_flat: bool,
}

/// A tet's lane of its blocks, in their units: copied there, and read by nothing else.
#[derive(Clone, Copy)]
pub(super) struct Lane {
    pub metric: [f32; 6],
    pub inv_volume: f32,
    pub lambda: f32,
    pub two_mu: f32,
    pub inv_edges: [f32; 9],
    pub volume: f32,
    pub half_inv_lambda: f32,
}

/// Both of one tet.
pub(super) fn both_of(shape: &Shape, material: &Material) -> (Rest, Lane) {
    let rest = Rest::of(shape, material);
    (rest, Lane::of(shape, &rest))
}

impl Rest {
    fn of(shape: &Shape, material: &Material) -> Rest {
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
            is_held_by_nodes: material.is_nearly_incompressible(),
            is_flat: shape.is_flat,
        }
    }
}

impl Lane {
    fn of(shape: &Shape, rest: &Rest) -> Lane {
        let (two_mu_pa, lambda_pa) = (2.0 * rest.mu_pa, if rest.is_held_by_nodes { 0.0 } else { rest.lambda_pa });
        let half_inv_lambda = 0.5 * (lambda_pa as f32).max(LAMBDA_MIN_PA).recip();
        let metric = shape.inv_edges * shape.inv_edges.transpose() * (two_mu_pa * shape.volume_m3);
        Lane {
            metric: [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|place| metric[place] as f32),
            inv_volume: (1.0 / shape.volume_m3) as f32,
            lambda: lambda_pa as f32,
            two_mu: two_mu_pa as f32,
            inv_edges: [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|index| shape.inv_edges[(index / 3, index % 3)] as f32),
            volume: shape.volume_m3 as f32,
            half_inv_lambda: if rest.is_held_by_nodes { 0.0 } else { half_inv_lambda },
        }
    }
}

/// The tets of the mesh that was last made a model of, or was tried.
#[derive(Default)]
pub(super) struct Kept {
    /// With the regions that were told.
    pub mesh: TetMesh,
    /// One for each tet of `mesh`.
    pub rest: Vec<Rest>,
    /// The same.
    pub lanes: Vec<Lane>,
    /// Of a mesh that it is brought up to: whether the node of each number is where that of `mesh` is.
    is_still: Vec<bool>,
    /// How far nodes may stray, m, so that no force of the tets that are kept is too large: as far as they might in the last mesh.
    is_borne_m: f64,
}

impl Kept {
    /// Brings it up to `mesh`, whose tets are of these regions and in which nodes may stray by `reach_m`.
    pub fn renew(&mut self, mesh: &TetMesh, regions: &[u32], materials: &Materials, reach_m: f64) -> Result<(), ModelError> {
        let renewed = self.renew_tets(mesh, regions, materials, reach_m);
        if renewed.is_err() {
            // Some tets are those of the one mesh, some those of the other.
            *self = Kept::default();
            return renewed;
        }
        self.mesh.positions_m.clone_from(&mesh.positions_m);
        self.mesh.tets.clone_from(&mesh.tets);
        regions.clone_into(&mut self.mesh.regions);
        self.is_borne_m = reach_m;
        renewed
    }

    fn renew_tets(&mut self, mesh: &TetMesh, regions: &[u32], materials: &Materials, reach_m: f64) -> Result<(), ModelError> {
        let places = mesh.positions_m.iter().zip(&self.mesh.positions_m);
        self.is_still.clear();
        self.is_still.extend(places.map(|(now, before)| now.map(f32::to_bits) == before.map(f32::to_bits)));
        // Where tets were burnt those behind them have moved up: by how many places the last one that was found has.
        let mut moved = 0;
        for tet in 0..mesh.tets.len() {
            let kept = self.moved(mesh, regions, tet, moved);
            let is_borne = kept.is_some() && reach_m <= self.is_borne_m;
            if let Some(now) = kept {
                moved = now;
                if moved > 0 {
                    self.rest[tet] = self.rest[tet + moved];
                    self.lanes[tet] = self.lanes[tet + moved];
                }
            } else {
                let region = regions.get(tet).copied();
                let material = region.and_then(|region| materials.of(region)).ok_or(ModelError::Region { tet, region })?;
                let (rest, lane) = both_of(&Shape::of(mesh, tet)?, &material);
                if tet < self.rest.len() {
                    (self.rest[tet], self.lanes[tet]) = (rest, lane);
                } else {
                    self.rest.push(rest);
                    self.lanes.push(lane);
                }
            }
            // Of most tets it is known.
            if !is_borne && self.rest[tet].force_n_m * reach_m > FORCE_MAX_N {
                return Err(ModelError::BadTet { tet, volume_m3: self.rest[tet].volume_m3 });
            }
        }
        self.rest.truncate(mesh.tets.len());
        self.lanes.truncate(mesh.tets.len());
        Ok(())
    }

    /// By how many places the tet of this index has moved up; `expected` is tried first, and what is not near that is found where as much was taken out as is
    /// missing now. `None`: it is a new one, or stood before its place, where what is kept has been written over.
    fn moved(&self, mesh: &TetMesh, regions: &[u32], tet: usize, expected: usize) -> Option<usize> {
        if self.is_same(mesh, regions, tet, tet + expected) {
            return Some(expected);
        }
        let missing = self.mesh.tets.len().saturating_sub(mesh.tets.len());
        let mut others = (expected + 1..=expected + LOOK_AHEAD).chain([missing]);
        others.find(|moved| self.is_same(mesh, regions, tet, tet + moved))
    }

    /// Whether the tet of this index has the corners and the region that the one of the index `before` had. The corners may have other names: a node that was
    /// parted has copies.
    fn is_same(&self, mesh: &TetMesh, regions: &[u32], tet: usize, before: usize) -> bool {
        let Some(corners) = self.mesh.tets.get(before) else { return false };
        let bits = |mesh: &TetMesh, node: u32| mesh.positions_m[node as usize].map(f32::to_bits);
        let is_still = |node: &u32| self.is_still.get(*node as usize).is_some_and(|is_still| *is_still);
        let is_there = |(now, before): (&u32, &u32)| bits(mesh, *now) == bits(&self.mesh, *before);
        let now = &mesh.tets[tet];
        // Nearly all of them by the first look, which goes on without a branch for each corner.
        let is_where_it_was = now == corners && now.iter().fold(true, |all, node| all & is_still(node));
        self.mesh.regions.get(before) == regions.get(tet) && (is_where_it_was || now.iter().zip(corners).all(is_there))
    }

    /// Puts other tets in the places of these, and these in theirs.
    pub fn swap(&mut self, others: &mut [(usize, Rest, Lane)]) {
        for (tet, rest, lane) in others {
            std::mem::swap(&mut self.rest[*tet], rest);
            std::mem::swap(&mut self.lanes[*tet], lane);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;

    /// Two tets on one face.
    fn pair() -> TetMesh {
        TetMesh {
            positions_m: vec![[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, -0.01]],
            tets: vec![[0, 1, 2, 3], [0, 2, 1, 4]],
            regions: vec![0, 0],
        }
    }

    /// So many tets in a row, each by itself.
    fn row(tets: u32) -> TetMesh {
        let corners = |tet: u32| {
            [[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]].map(|[x, y, z]| [x + 0.02 * tet as f32, y, z])
        };
        TetMesh {
            positions_m: (0..tets).flat_map(corners).collect(),
            tets: (0..tets).map(|tet| [0, 1, 2, 3].map(|corner| 4 * tet + corner)).collect(),
            regions: vec![0; tets as usize],
        }
    }

    /// Which tet of the mesh before each tet of the one that `change` makes is kept from; `None` for one that is made anew.
    fn kept_after(mut mesh: TetMesh, change: impl Fn(&mut TetMesh)) -> Vec<Option<usize>> {
        let materials = Materials::Same(Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap());
        let mut kept = Kept::default();
        kept.renew(&mesh, &mesh.regions, &materials, 1.0).unwrap();
        for (tet, (rest, lane)) in kept.rest.iter_mut().zip(&mut kept.lanes).enumerate() {
            (rest.volume_m3, lane.volume) = (1.0 + tet as f64, 1.0 + tet as f32);
        }
        change(&mut mesh);
        kept.renew(&mesh, &mesh.regions, &materials, 1.0).unwrap();
        assert_eq!((kept.rest.len(), kept.lanes.len()), (mesh.tets.len(), mesh.tets.len()));
        let mark = |(rest, lane): (&Rest, &Lane)| {
            let is_new = rest.volume_m3 < 1.0;
            assert!(if is_new { lane.volume < 1.0 } else { f64::from(lane.volume) == rest.volume_m3 }, "another tet's lane");
            (!is_new).then(|| rest.volume_m3 as usize - 1)
        };
        kept.rest.iter().zip(&kept.lanes).map(mark).collect()
    }

    fn take_out(mesh: &mut TetMesh, tets: Range<usize>) {
        mesh.tets.drain(tets.clone());
        mesh.regions.drain(tets);
    }

    #[test]
    fn a_tet_is_kept_until_a_corner_moves_or_its_region_changes() {
        assert_eq!(kept_after(pair(), |_| {}), [Some(0), Some(1)]);
        assert_eq!(kept_after(pair(), |mesh| mesh.positions_m[4][2] = -0.011), [Some(0), None]);
        assert_eq!(kept_after(pair(), |mesh| mesh.positions_m[0][0] = -0.0), [None, None]);
        assert_eq!(kept_after(pair(), |mesh| mesh.regions[1] = 7), [Some(0), None]);
        assert_eq!(kept_after(pair(), |mesh| mesh.tets[0] = [1, 2, 0, 3]), [None, Some(1)]);
        // a node that was parted: another name for the same place
        let parted = |mesh: &mut TetMesh| {
            mesh.positions_m.push([0.0; 3]);
            mesh.tets[1][0] = 5;
        };
        assert_eq!(kept_after(pair(), parted), [Some(0), Some(1)]);
        let grown = |mesh: &mut TetMesh| {
            mesh.tets.push([0, 1, 2, 3]);
            mesh.regions.push(0);
        };
        assert_eq!(kept_after(pair(), grown), [Some(0), Some(1), None]);
    }

    #[test]
    fn a_tet_that_is_kept_is_refused_once_nodes_may_stray_too_far_and_taken_again_when_they_may_not() {
        let materials = Materials::Same(Material::new(10_000.0, 0.45, 1000.0, 20.0).unwrap());
        let (mut kept, mut mesh) = (Kept::default(), row(5));
        let mut renew = |mesh: &TetMesh, reach_m: f64| kept.renew(mesh, &mesh.regions, &materials, reach_m);
        for reach_m in [1.0, 2.0, 0.5, 2.0] {
            assert_eq!(renew(&mesh, reach_m), Ok(()));
        }
        assert!(matches!(renew(&mesh, FORCE_MAX_N), Err(ModelError::BadTet { tet: 0, .. })));
        assert_eq!(renew(&mesh, 0.5), Ok(()));
        // Not too far for any of these (155 N/m each), and too far for one of them that is stretched (1 040 N/m).
        let far_m = FORCE_MAX_N / 200.0;
        assert_eq!(renew(&mesh, far_m), Ok(()));
        mesh.positions_m[13][0] += 0.09;
        assert!(matches!(renew(&mesh, far_m), Err(ModelError::BadTet { tet: 3, .. })));
        assert_eq!(renew(&mesh, 1.0), Ok(()));
    }

    #[test]
    fn a_tet_is_kept_where_others_before_it_were_burnt() {
        // Here and there; one that is left has changed, and one is new.
        let some = |mesh: &mut TetMesh| {
            mesh.regions[20] = 7;
            take_out(mesh, 30..33);
            take_out(mesh, 5..6);
            mesh.tets.push([1, 2, 0, 3]);
            mesh.regions.push(0);
        };
        let left = (0..60_usize).filter(|tet| *tet != 5 && !(30..33).contains(tet));
        let expected: Vec<Option<usize>> = left.map(|tet| (tet != 20).then_some(tet)).chain([None]).collect();
        assert_eq!(kept_after(row(60), some), expected);
        // More at once than are looked through.
        let many = 10..10 + LOOK_AHEAD + 5;
        let expected: Vec<Option<usize>> = (0..60).filter(|tet| !many.contains(tet)).map(Some).collect();
        assert_eq!(kept_after(row(60), |mesh| take_out(mesh, many.clone())), expected);
    }
}
