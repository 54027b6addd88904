//! Making the tissue's model of a body, with as few substeps as little enough mass has to be added for.

use super::{Case, Workshop};
use crate::body::Body;
use hyst_engine::Failure;
use hyst_tissue::{Model, ModelError, ModelMaker, ModelReport};

/// Most substeps in a step of 1 ms: fine meshes of stiff tissue need more than what an organ of the size that the station is made for does. The first is
/// taken with which little enough mass has to be added. One that is too few says how many would be enough, so that those between are not tried: a cut
/// that is refused costs no more than one that is made.
pub(super) const MAX_SUBSTEPS: [u32; 5] = [8, 12, 16, 24, 32];

impl Workshop {
    /// The model of a body.
    pub(super) fn model(&mut self, body: &Body) -> Result<(Model, ModelReport), Failure> {
        model_of(&mut self.maker.lock(), &self.case, self.first_substeps, body)
    }
}

/// The model of a body: it is made of what the scene's objects and their regions are made of, whatever its parts are now.
pub(super) fn model_of(
    maker: &mut ModelMaker,
    case: &Case,
    first_substeps: u32,
    body: &Body,
) -> Result<(Model, ModelReport), Failure> {
    let regions: Vec<u32> = (0..body.rest.tets.len()).map(|tet| case.material(body, tet)).collect();
    let mut with = |max_substeps| {
        maker.options.max_substeps = max_substeps;
        maker.make_of(&body.rest, &regions, &body.fixed)
    };
    let mut last = with(first_substeps);
    while let Err(ModelError::TooStiff { substeps, enough_substeps, .. }) = last {
        let Some(next) = next_after(substeps, enough_substeps) else { break };
        last = with(next);
    }
    last.map_err(|error| Failure::Input(error.to_string()))
}

/// The least of [`MAX_SUBSTEPS`] beyond one that was too few that may be enough.
fn next_after(too_few: u32, enough: u32) -> Option<u32> {
    MAX_SUBSTEPS.into_iter().find(|substeps| *substeps > too_few && *substeps >= enough)
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
    /// A world of another case, and so are those that are made of it: with less room, or another loop.
    pub fn cramp(&mut self, world: super::World, change: impl FnOnce(&mut super::Case, &Body)) -> super::World {
        let body = world.body.clone();
        drop(world);
        let case = std::sync::Arc::get_mut(&mut self.case).expect("nobody else has the case");
        change(case, &body);
        self.make(body).unwrap()
    }

    /// Has the models that are made from here on bear contacts of a stiffness, N/m.
    pub fn stiffen(&mut self, contact_n_m: f64) {
        self.maker.lock().options.contact_stiffness_n_m = contact_n_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substeps_that_are_too_few_are_not_tried_and_what_none_is_enough_for_is_refused_at_once() {
        assert_eq!([9, 12, 13, 20, 32].map(|enough| next_after(8, enough)), [12, 12, 16, 24, 32].map(Some));
        assert_eq!((next_after(8, 33), next_after(32, 9)), (None, None));
        assert_eq!(next_after(16, 9), Some(24), "each is tried once");
    }
}
