//! Meshes and helpers that the tests and the bench share.
#![allow(dead_code, missing_docs, unused_imports)]

pub mod cuts;
pub mod kinds;
mod noise;

pub use noise::noise;

use hyst_mesh::TetMesh;
use hyst_tissue::{Model, Options, Scratch, StateMut, StateRef, StepInput, StepReport, step};
use nalgebra::{Matrix3, Vector3};

/// A block of `cells` cubes with edge `edge_m`, each cut into 6 tets along its diagonal; lowest corner in the origin.
pub fn block(cells: [u32; 3], edge_m: f32) -> TetMesh {
    let [nx, ny, nz] = cells;
    let index = |x: u32, y: u32, z: u32| x + (nx + 1) * (y + (ny + 1) * z);
    let mut mesh = TetMesh::default();
    for z in 0..=nz {
        for y in 0..=ny {
            for x in 0..=nx {
                mesh.positions_m.push([x as f32 * edge_m, y as f32 * edge_m, z as f32 * edge_m]);
            }
        }
    }
    // Each order of the three axes is a path from the lowest to the highest corner, and so a tet.
    let paths =
        [([0, 1, 2], false), ([1, 2, 0], false), ([2, 0, 1], false), ([0, 2, 1], true), ([2, 1, 0], true), ([1, 0, 2], true)];
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                for (path, odd) in paths {
                    let mut at = [x, y, z];
                    let mut tet = [index(x, y, z); 4];
                    for (corner, axis) in path.into_iter().enumerate() {
                        at[axis] += 1;
                        tet[corner + 1] = index(at[0], at[1], at[2]);
                    }
                    if odd {
                        tet.swap(2, 3);
                    }
                    mesh.tets.push(tet);
                    mesh.regions.push(0);
                }
            }
        }
    }
    mesh
}

/// Splits every `nth` tet at a node that lies `height` of the way from its first face to the opposite corner: the tet on that face is flat.
pub fn with_flat_tets(mut mesh: TetMesh, nth: usize, height: f32) -> TetMesh {
    for tet in (0..mesh.tets.len()).step_by(nth) {
        let corners = mesh.tets[tet];
        let [a, b, c, d] = corners.map(|node| mesh.positions_m[node as usize]);
        let node = mesh.positions_m.len() as u32;
        let within = |axis: usize| (1.0 - height) * (a[axis] + b[axis] + c[axis]) / 3.0 + height * d[axis];
        mesh.positions_m.push([within(0), within(1), within(2)]);
        let part = |corner: usize| std::array::from_fn(|at| if at == corner { node } else { corners[at] });
        mesh.tets[tet] = part(0);
        mesh.tets.extend([part(1), part(2), part(3)]);
        mesh.regions.extend([mesh.regions[tet]; 3]);
    }
    mesh
}

/// The shape gradients of a tet, 1/m, and its volume, m³, in double precision.
pub fn gradients(mesh: &TetMesh, tet: &[u32; 4]) -> ([Vector3<f64>; 4], f64) {
    let [a, b, c, d] = tet.map(|node| Vector3::from(mesh.positions_m[node as usize].map(f64::from)));
    let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
    let inverse = edges.try_inverse().unwrap();
    let row = |index: usize| inverse.row(index).transpose();
    ([-(row(0) + row(1) + row(2)), row(0), row(1), row(2)], edges.determinant() / 6.0)
}

/// A model with its state, stepped in place.
pub struct Body {
    pub model: Model,
    pub scratch: Scratch,
    pub position_m: Vec<[f32; 3]>,
    pub velocity_m_s: Vec<[f32; 3]>,
    pub force_n: Vec<[f32; 3]>,
    next_position_m: Vec<[f32; 3]>,
    next_velocity_m_s: Vec<[f32; 3]>,
}

impl Body {
    pub fn new(model: Model) -> Self {
        let (rest, still) = (model.rest_m().to_vec(), vec![[0.0; 3]; model.node_count()]);
        Body {
            scratch: Scratch::new(&model),
            position_m: rest.clone(),
            velocity_m_s: still.clone(),
            force_n: still.clone(),
            next_position_m: rest,
            next_velocity_m_s: still,
            model,
        }
    }

    pub fn step_with(&mut self, input: &StepInput) -> StepReport {
        let now = StateRef { position_m: &self.position_m, velocity_m_s: &self.velocity_m_s };
        let next = StateMut { position_m: &mut self.next_position_m, velocity_m_s: &mut self.next_velocity_m_s };
        let report = step(&self.model, &mut self.scratch, now, input, next).expect("a valid step");
        std::mem::swap(&mut self.position_m, &mut self.next_position_m);
        std::mem::swap(&mut self.velocity_m_s, &mut self.next_velocity_m_s);
        report
    }

    /// One step of 1 ms under `force_n`.
    pub fn step(&mut self) -> StepReport {
        let force = std::mem::take(&mut self.force_n);
        let report = self.step_with(&StepInput { external_force_n: &force, ..StepInput::default() });
        self.force_n = force;
        report
    }

    /// Kinetic energy and the elastic one of the resting material at this state, J, by a step that is thrown away.
    pub fn energy_j(&self) -> f64 {
        let mut still = Body::new(self.model.clone());
        still.position_m.copy_from_slice(&self.position_m);
        let elastic = still.step().elastic_energy_j;
        let speeds = self.velocity_m_s.iter().map(|v| v.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>());
        elastic + speeds.zip(self.model.mass_kg()).map(|(squared, &mass)| 0.5 * f64::from(mass) * squared).sum::<f64>()
    }
}

/// Default options with another number of substeps allowed.
pub fn options() -> Options {
    Options { max_substeps: 32, ..Options::default() }
}
