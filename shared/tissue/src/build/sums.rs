//! What tets give their nodes, and what they come to together: found in one pass over them all, for they are more than what lies near a processor.
//!
//! Promise: each sum is made in the order of the tets.

use super::rest::Rest;
use crate::bed::Bed;
use crate::bulk::BulkSum;
use hyst_mesh::TetMesh;

/// What the tets of a node give it.
#[derive(Clone, Copy, Default)]
pub(super) struct NodeSum {
    /// Own mass, kg, and mass times damping, kg/s.
    pub mass: [f64; 2],
    /// Its bound by each way of spreading, N/m.
    pub stiffness_n_m: [f64; 2],
}

impl NodeSum {
    /// The mean of its tets by their mass.
    pub fn damping_per_s(&self) -> f64 {
        self.mass[1] / self.mass[0]
    }
}

/// The sums of a mesh.
#[derive(Default)]
pub(super) struct Sums {
    /// One for each node.
    pub nodes: Vec<NodeSum>,
    /// Stiffness of the bed at each node, N/m; empty where there is no bed.
    bed_n_m: Vec<f64>,
    /// What the tets about each node come to whose volume it holds; empty where there are none.
    pub bulk: Vec<BulkSum>,
    /// The flat tets.
    pub flat: Vec<usize>,
    pub volume_m3: f64,
    pub shortest_edge_m: f64,
}

impl Sums {
    /// Makes them anew.
    pub fn add_up(&mut self, mesh: &TetMesh, rest: &[Rest]) {
        let Sums { nodes, bed_n_m, bulk, flat, .. } = self;
        nodes.clear();
        nodes.resize(mesh.positions_m.len(), NodeSum::default());
        bed_n_m.clear();
        bulk.clear();
        flat.clear();
        let (mut volume_m3, mut shortest_edge_m) = (0.0f64, f64::INFINITY);
        let nodes = &mut nodes[..];
        for (index, (tet, rest)) in mesh.tets.iter().zip(rest).enumerate() {
            let mass = rest.corner_mass;
            for (&node, stiffness) in tet.iter().zip(&rest.corner_stiffness_n_m) {
                let sum = &mut nodes[node as usize];
                sum.mass = [sum.mass[0] + mass[0], sum.mass[1] + mass[1]];
                sum.stiffness_n_m = [sum.stiffness_n_m[0] + stiffness[0], sum.stiffness_n_m[1] + stiffness[1]];
            }
            if rest.corner_bed_n_m > 0.0 {
                bed_n_m.resize(nodes.len(), 0.0);
                tet.iter().for_each(|&node| bed_n_m[node as usize] += rest.corner_bed_n_m);
            }
            if rest.is_held_by_nodes {
                bulk.resize(nodes.len(), BulkSum::NONE);
                tet.iter().for_each(|&node| bulk[node as usize].add(rest.volume_m3, rest.lambda_pa, rest.mu_pa));
            }
            if rest.is_flat {
                flat.push(index);
            }
            volume_m3 += rest.volume_m3;
            shortest_edge_m = f64::min(shortest_edge_m, rest.shortest_edge_m);
        }
        (self.volume_m3, self.shortest_edge_m) = (volume_m3, shortest_edge_m);
    }

    /// What holds the free nodes of material on beds, by ascending node.
    pub fn beds(&self, held: &[bool]) -> Vec<Bed> {
        let bed = |(node, stiffness_n_m): (usize, &f64)| Bed { node: node as u32, stiffness_n_m: *stiffness_n_m as f32 };
        let all = self.bed_n_m.iter().enumerate();
        all.filter(|(node, stiffness_n_m)| !held[*node] && **stiffness_n_m > 0.0).map(bed).collect()
    }
}
