//! What a tissue says of itself in its page, as a look at the station shows it.

use super::ProcessView;
use hyst_exchange::ReadPage;
use hyst_messages::page::tissue;
use hyst_messages::{CUT_LIMIT, SLOTS, Slot};
use serde::Serialize;

/// The register of a Site Manager.
#[derive(Clone, Debug, Serialize)]
pub struct RegisterView {
    /// Objects.
    pub objects: u32,
    /// Engines, by the names of their slots.
    pub engines: Vec<String>,
}

/// How far a tissue could cut as it was asked to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CuttingView {
    /// Sweeps of the electrode that changed the mesh.
    pub cuts: u32,
    /// Sweeps that met a limit of the mesh, or were refused.
    pub limits: u32,
    /// What that means; nothing without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub says: Option<&'static str>,
    /// Substeps of the last step.
    pub substeps: u32,
}

impl CuttingView {
    /// The line under the table; none while there is nothing to be said.
    pub fn line(&self) -> Option<String> {
        let says = self.says?;
        Some(format!("{says} ({} of its sweeps)\n", self.limits))
    }
}

/// Puts what a tissue's page says into its view.
pub(super) fn of_tissue(page: &ReadPage, view: &mut ProcessView) {
    let Some((_, status)) = page.cell(tissue::STATUS) else { return };
    let slots = (0..SLOTS).filter(|number| status.engines >> number & 1 == 1).filter_map(Slot::from_number);
    view.registered = Some(RegisterView { objects: status.objects, engines: slots.map(|slot| slot.to_string()).collect() });
    view.step_ms = (status.step_ticks > 0).then_some(status.step_ticks);
    view.corrections = Some(status.corrections);
    view.cutting = Some(CuttingView {
        cuts: status.cuts,
        limits: status.cut_limits,
        says: (status.cut_limits > 0).then_some(CUT_LIMIT),
        substeps: status.substeps,
    });
}

#[cfg(test)]
mod tests {
    use super::super::{StationView, table};
    use super::*;

    #[test]
    fn a_loop_that_cuts_no_finer_is_said_under_the_table_and_in_json_and_one_that_does_is_not() {
        let view = |limits: u32| {
            let says = (limits > 0).then_some(CUT_LIMIT);
            let cutting = Some(CuttingView { limits, says, ..CuttingView::default() });
            let tissue = ProcessView { name: "tissue:0".into(), active: true, cutting, ..ProcessView::default() };
            StationView { processes: vec![tissue], ..StationView::default() }
        };
        assert!(table(&view(3)).contains("the loop cuts no finer here: the mesh has reached its limit (3 of its sweeps)"));
        assert!(!table(&view(0)).contains("the loop"));
        let said = |limits: u32| serde_json::to_value(view(limits)).unwrap()["processes"][0]["cutting"].clone();
        assert_eq!((said(3)["limits"].as_u64(), said(3)["says"].as_str()), (Some(3), Some(CUT_LIMIT)));
        assert_eq!((said(0)["limits"].as_u64(), said(0)["says"].as_str()), (Some(0), None));
    }
}
