//! The checks before a model is made: options in range, a mesh whose indices and numbers can be used.

use hyst_mesh::{TetMesh, are_below, are_finite};

use crate::model::{ModelError, Options, SUBSTEPS_MAX};

pub(crate) fn options(options: &Options) -> Result<(), ModelError> {
    let check = |name, value: f64, low: f64, high: f64, range| {
        if (low..=high).contains(&value) { Ok(()) } else { Err(ModelError::Option { name, value, range }) }
    };
    check("step_s", options.step_s, 1e-6, 0.02, "from 1e-6 to 0.02")?;
    check("max_substeps", f64::from(options.max_substeps), 1.0, f64::from(SUBSTEPS_MAX), "from 1 to 256")?;
    check("max_added_mass_ratio", options.max_added_mass_ratio, 0.0, 1e6, "from 0 to 1e6")?;
    check("contact_stiffness_n_m", options.contact_stiffness_n_m, 0.0, 1e9, "from 0 to 1e9")?;
    check("omega_rest_per_s", options.omega_rest_per_s.unwrap_or(0.0), 0.0, 1e9, "from 0 to 1e9")?;
    check("velocity_cap_m_s", options.velocity_cap_m_s, 1e-3, 1e3, "from 0.001 to 1000")?;
    check("most_reach_m", options.most_reach_m.unwrap_or(0.0), 0.0, 1e9, "from 0 to 1e9")?;
    if options.isa.available() { Ok(()) } else { Err(ModelError::Isa(options.isa)) }
}

pub(crate) fn mesh(mesh: &TetMesh, fixed: &[bool]) -> Result<(), ModelError> {
    let (nodes, tets) = (mesh.positions_m.len(), mesh.tets.len());
    if tets == 0 {
        return Err(ModelError::Empty);
    }
    if nodes >= 1 << 31 || tets >= 1 << 31 {
        return Err(ModelError::TooLarge { nodes, tets });
    }
    if fixed.len() != nodes {
        return Err(ModelError::FixedLength { expected: nodes, found: fixed.len() });
    }
    if !are_finite(mesh.positions_m.as_flattened())
        && let Some(node) = mesh.positions_m.iter().position(|position| position.iter().any(|x| !x.is_finite()))
    {
        return Err(ModelError::NotFinite { node });
    }
    let beyond = |(tet, corners): (usize, &[u32; 4])| Some((tet, *corners.iter().find(|node| **node as usize >= nodes)?));
    if !are_below(nodes, mesh.tets.as_flattened())
        && let Some((tet, node)) = mesh.tets.iter().enumerate().find_map(beyond)
    {
        return Err(ModelError::NodeIndex { tet, node, nodes });
    }
    Ok(())
}
