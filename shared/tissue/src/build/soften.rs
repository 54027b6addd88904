//! Tets of nearly no height. The stiffness of such a tet across its height grows with the inverse square of the height while its mass
//! vanishes, so that a dozen of them among thousands would ask for a hundred times as many substeps, or for several times the organ's mass. They fill hardly
//! any of the organ, so it is they that give way: they get the share of their material's stiffness that the step allows.
//!
//! Promise: only tets below [`hyst_mesh::FLAT_QUALITY`] are changed, and only those whose stiffness the step does not allow.

use super::Rest;
use crate::bound::Spread;
use crate::model::{Options, omega_allowed_per_s};
use hyst_mesh::{FLAT_QUALITY, TetMesh, quality};

/// What flat tets may take of the stiffness that a node may bear; the rest is for its sound tets and for contact.
const FLAT_SHARE: f64 = 0.5;

/// What was softened.
#[derive(Debug, Default)]
pub(super) struct Softened {
    pub tets: usize,
    pub volume_m3: f64,
}

/// Softens the flat tets. `mass_kg` is that of each node.
pub(super) fn flat_tets(mesh: &TetMesh, rest: &mut [Rest], mass_kg: &[f64], fixed: &[bool], options: &Options) -> Softened {
    let flat: Vec<usize> = (0..rest.len()).filter(|&tet| is_flat(mesh, tet)).collect();
    let mut flat_at = vec![0u32; mass_kg.len()];
    for &tet in &flat {
        mesh.tets[tet].iter().for_each(|&node| flat_at[node as usize] += 1);
    }
    let allowed_per_s = omega_allowed_per_s(options.step_s, options.max_substeps);
    let mut softened = Softened::default();
    for tet in flat {
        let data = &mut rest[tet];
        let of_corner = |(&node, stiffness): (&u32, f64)| {
            let node = node as usize;
            let allowed_n_m = FLAT_SHARE * allowed_per_s.powi(2) * mass_kg[node] / f64::from(flat_at[node]);
            if fixed[node] { f64::INFINITY } else { allowed_n_m / stiffness }
        };
        let share = Spread::BOTH
            .into_iter()
            .flat_map(|spread| mesh.tets[tet].iter().zip(data.corner_stiffness_n_m(spread)).map(of_corner).collect::<Vec<_>>())
            .fold(f64::INFINITY, f64::min);
        if share < 1.0 {
            data.material = data.material.softened(share);
            softened.tets += 1;
            softened.volume_m3 += data.volume_m3;
        }
    }
    softened
}

fn is_flat(mesh: &TetMesh, tet: usize) -> bool {
    quality(mesh.tets[tet].map(|node| mesh.positions_m[node as usize].map(f64::from).into())) < FLAT_QUALITY
}
