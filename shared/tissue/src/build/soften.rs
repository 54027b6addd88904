//! Tets of nearly no height. The stiffness of such a tet across its height grows with the inverse square of the height while its mass
//! vanishes, so that a dozen of them among thousands would ask for a hundred times as many substeps, or for several times the organ's mass. They fill hardly
//! any of the organ, so it is they that give way: they get the share of their material's stiffness that the step allows.
//!
//! Promise: only tets below [`hyst_mesh::FLAT_QUALITY`] are changed, and only those whose stiffness the step does not allow.

use super::Materials;
use super::rest::{Rest, Shape};
use crate::model::{ModelError, Options, omega_allowed_per_s};
use hyst_mesh::TetMesh;

/// What flat tets may take of the stiffness that a node may bear; the rest is for its sound tets and for contact.
const FLAT_SHARE: f64 = 0.5;

/// Tets, and what they are to be instead.
pub(super) type Softened = Vec<(usize, Rest)>;

/// The flat tets that have to be softer. `mass_kg` is that of each node.
pub(super) fn flat_tets(
    mesh: &TetMesh,
    rest: &[Rest],
    mass_kg: &[f64],
    fixed: &[bool],
    materials: &Materials,
    options: &Options,
) -> Result<Softened, ModelError> {
    let flat: Vec<usize> = (0..rest.len()).filter(|&tet| rest[tet].is_flat).collect();
    let mut flat_at = vec![0u32; mass_kg.len()];
    for &tet in &flat {
        mesh.tets[tet].iter().for_each(|&node| flat_at[node as usize] += 1);
    }
    let allowed_per_s = omega_allowed_per_s(options.step_s, options.max_substeps);
    let mut softened = Softened::new();
    for tet in flat {
        let of_corner = |(&node, stiffness): (&u32, &[f64; 2])| {
            let node = node as usize;
            let allowed_n_m = FLAT_SHARE * allowed_per_s.powi(2) * mass_kg[node] / f64::from(flat_at[node]);
            if fixed[node] { f64::INFINITY } else { (allowed_n_m / stiffness[0]).min(allowed_n_m / stiffness[1]) }
        };
        let share = mesh.tets[tet].iter().zip(&rest[tet].corner_stiffness_n_m).map(of_corner).fold(f64::INFINITY, f64::min);
        let material = mesh.regions.get(tet).and_then(|region| materials.of(*region)).filter(|_| share < 1.0);
        if let Some(material) = material {
            softened.push((tet, Rest::of(&Shape::of(mesh, tet)?, &material.softened(share))));
        }
    }
    Ok(softened)
}
