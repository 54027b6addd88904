//! Making the tissue's model of a body, with as few substeps as little enough mass has to be added for.

use super::Workshop;
use crate::body::Body;
use hyst_engine::Failure;
use hyst_mesh::TetMesh;
use hyst_tissue::{Model, ModelError, ModelReport};

/// Most substeps in a step of 1 ms, tried in this order: fine meshes of stiff tissue need more than what an organ of the size that the station
/// is made for does. The first is taken with which little enough mass has to be added.
const MAX_SUBSTEPS: [u32; 5] = [8, 12, 16, 24, 32];

impl Workshop {
    /// The model of a body: it is made of what the scene's objects are made of, whatever its parts are now.
    pub(super) fn model(&mut self, body: &Body) -> Result<(Model, ModelReport), Failure> {
        let regions = body.rest.regions.iter().map(|region| self.case.origin(body, *region) as u32).collect();
        let mesh = TetMesh { regions, ..body.rest.clone() };
        let mut with = |max_substeps| {
            self.maker.options.max_substeps = max_substeps;
            self.maker.make(&mesh, &body.fixed)
        };
        let mut last = with(MAX_SUBSTEPS[0]);
        for max_substeps in &MAX_SUBSTEPS[1..] {
            if !matches!(last, Err(ModelError::TooStiff { .. })) {
                break;
            }
            last = with(*max_substeps);
        }
        last.map_err(|error| Failure::Input(error.to_string()))
    }
}

/// What making a model took, one sentence each.
pub(super) fn notes(report: &ModelReport) -> Vec<String> {
    let mut notes =
        vec![format!("a step of 1 ms takes {} substep{}", report.substeps, if report.substeps == 1 { "" } else { "s" })];
    if report.scaled_nodes > 0 {
        let share = 100.0 * report.added_mass_kg / report.mass_kg;
        notes.push(format!("{share:.2} % of the mass is added, at {} nodes, so that the substeps suffice", report.scaled_nodes));
    }
    if report.softened_tets > 0 {
        let share = 1e6 * report.softened_volume_m3 / report.volume_m3;
        notes.push(format!(
            "{} flat tets are made softer so that the substeps suffice; they fill {share:.1} millionths of the volume",
            report.softened_tets
        ));
    }
    notes
}

#[cfg(test)]
impl Workshop {
    /// A world with room for so many tets beyond its own, and for no more in those that are made of it.
    pub fn cramp(&mut self, world: super::World, tets: usize) -> super::World {
        let body = world.body.clone();
        drop(world);
        let case = std::sync::Arc::get_mut(&mut self.case).expect("nobody else has the case");
        case.room.tets = body.rest.tets.len() + tets;
        self.make(body).unwrap()
    }
}
