//! Tets of nearly no height. The stiffness of such a tet across its height grows with the inverse square of the height while its mass
//! vanishes, so that a dozen of them among thousands would ask for a hundred times as many substeps, or for several times the organ's mass. They fill hardly
//! any of the organ, so it is they that give way: they get the share of their material's stiffness that the step allows.
//!
//! Promise: only tets below [`hyst_mesh::FLAT_QUALITY`] are changed, and only those whose stiffness the step does not allow.

use super::Materials;
use super::rest::{self, Kept, Lane, Rest, Shape};
use super::sums::Sums;
use crate::model::{ModelError, Options, omega_allowed_per_s};

/// What flat tets may take of the stiffness that a node may bear; the rest is for its sound tets and for contact.
const FLAT_SHARE: f64 = 0.5;

/// Tets, and what they are to be instead.
pub(super) type Softened = Vec<(usize, Rest, Lane)>;

/// The flat tets that have to be softer. `sums` are those of all tets as they are.
pub(super) fn flat_tets(
    kept: &Kept,
    sums: &Sums,
    fixed: &[bool],
    materials: &Materials,
    options: &Options,
) -> Result<Softened, ModelError> {
    let (mesh, mut softened) = (&kept.mesh, Softened::new());
    if sums.flat.is_empty() {
        return Ok(softened);
    }
    let mut flat_at = vec![0u32; sums.nodes.len()];
    for &tet in &sums.flat {
        mesh.tets[tet].iter().for_each(|&node| flat_at[node as usize] += 1);
    }
    let allowed_per_s = omega_allowed_per_s(options.step_s, options.max_substeps);
    for &tet in &sums.flat {
        let of_corner = |(&node, stiffness): (&u32, &[f64; 2])| {
            let node = node as usize;
            let allowed_n_m = FLAT_SHARE * allowed_per_s.powi(2) * sums.nodes[node].mass[0] / f64::from(flat_at[node]);
            if fixed[node] { f64::INFINITY } else { (allowed_n_m / stiffness[0]).min(allowed_n_m / stiffness[1]) }
        };
        let share_of =
            |stiffness_n_m: &[[f64; 2]; 4]| mesh.tets[tet].iter().zip(stiffness_n_m).map(of_corner).fold(f64::INFINITY, f64::min);
        let share = share_of(&kept.rest[tet].corner_stiffness_n_m);
        let material = mesh.regions.get(tet).and_then(|region| materials.of(*region)).filter(|_| share < 1.0);
        if let Some(material) = material {
            let shape = Shape::of(mesh, tet)?;
            // One that holds its own volume bears more of its stiffness than one whose nodes hold it.
            let (own, _) = rest::both_of(&shape, &material.softened(1.0));
            let (rest, lane) = rest::both_of(&shape, &material.softened(share_of(&own.corner_stiffness_n_m).min(1.0)));
            softened.push((tet, rest, lane));
        }
    }
    Ok(softened)
}
