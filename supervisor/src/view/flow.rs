//! What a fluid's page says for the look at a station: the steps of its flow, what the medium does to the scope, and how clear the view is through it.

use hyst_exchange::ReadPage;
use hyst_messages::FluidStatus;
use hyst_messages::page::fluid;
use serde::Serialize;

/// Steps of a Flow Engine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepView {
    /// Length, ms.
    pub ms: u32,
    /// What the scene asks for, ms: less, where the machine does not afford it.
    pub scene_ms: u32,
    /// How many times the scene's grid is halved along each axis, where the machine affords no step of it.
    pub halvings: u32,
}

/// The status of one that has made a step.
fn status_of(page: &ReadPage) -> Option<FluidStatus> {
    page.cell(fluid::STATUS).map(|(_, status)| status).filter(|status| status.step_ticks > 0)
}

/// Its steps.
pub(super) fn steps_of(page: &ReadPage) -> Option<StepView> {
    let status = status_of(page)?;
    Some(StepView { ms: status.step_ticks, scene_ms: status.scene_step_ticks, halvings: status.halvings })
}

/// The share of the light that comes through the blood before the lens.
pub(super) fn transmittance_of(page: &ReadPage) -> Option<f32> {
    status_of(page)?.told_transmittance()
}

/// What the medium does to scope and loop, mN.
pub(super) fn on_scope_mn_of(page: &ReadPage) -> Option<[f32; 3]> {
    status_of(page).map(|status| status.on_scope_n.map(|force_n| force_n * 1e3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use hyst_messages::{Role, Slot};

    #[test]
    fn a_fluid_that_has_made_a_step_says_how_clear_the_view_is_unless_it_does_not_know() {
        let station = Station::named(&format!("t{}-view-flow", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Fluid);
        let (page, read) = (station.create_slot(slot, 1).unwrap(), station.read_slot(slot, 1).unwrap());
        assert_eq!(transmittance_of(&read), None);
        for (step_ticks, transmittance, told) in [(33, 0.25, Some(0.25)), (33, 0.0, None), (0, 0.25, None), (33, f32::NAN, None)]
        {
            page.write(fluid::STATUS, &FluidStatus { step_ticks, transmittance, ..FluidStatus::default() });
            assert_eq!(transmittance_of(&read), told, "{transmittance} after steps of {step_ticks}");
        }
        station.wipe();
    }
}
