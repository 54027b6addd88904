//! The step of a session: that of the role, or for who founds it the scene's, or what the machine affords of it.

use super::{FlowEngine, inputs_of};
use crate::afford::{affordable_step, at_rest, is_step, tissue_at_rest};
use crate::cavity::Cavity;
use hyst_engine::Failure;
use hyst_exchange::Roster;
use hyst_messages::Role;
use hyst_messages::page::fluid;
use hyst_scene::LoadedScene;

impl FlowEngine<'_> {
    /// Takes the step of the role, which whoever follows goes on with whatever it would afford itself: dry steps would only delay it, on a machine that is
    /// too slow for the scene by seconds. Who finds none takes the step that the machine affords.
    pub(super) fn choose_step(&mut self, scene: &LoadedScene) -> Result<(), Failure> {
        let has_begun = Roster::open(&self.life.station)?.holder(Role::Fluid).epoch > 0;
        match self.step_of_role().filter(|_| has_begun) {
            Some(step_ticks) => {
                self.step_ticks.set(step_ticks);
                Ok(())
            }
            None => self.find_step(scene, has_begun),
        }
    }

    /// The step that the processes of the role say they make, dead ones too: a state that is of another one corrects it.
    fn step_of_role(&self) -> Option<u64> {
        let others = self.life.clock.occupied(Role::Fluid).filter(|(_, incarnation)| *incarnation != self.life.incarnation);
        let said = others.filter_map(|(slot, incarnation)| {
            let page = self.life.station.read_slot(slot, incarnation).ok()?;
            page.cell(fluid::STATUS).map(|(_, status)| u64::from(status.step_ticks))
        });
        said.filter(|ticks| is_step(self.scene_ticks, *ticks)).max()
    }

    /// Takes the step that the machine affords; what the dry steps did to the flow is undone.
    fn find_step(&mut self, scene: &LoadedScene, has_begun: bool) -> Result<(), Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let (sample, (positions_m, tets)) = (at_rest(scene), tissue_at_rest(scene));
        let [_, bytes, ..] = self.sections();
        let (mut first, mut block) = (vec![0u64; bytes.div_ceil(8)], vec![0u64; bytes.div_ceil(8)]);
        self.crew.solver().store(bytemuck::cast_slice_mut(&mut first)).map_err(broken)?;
        let cells = self.crew.solver().model().grid.cell_count();
        let mut dry_step = |ticks: u64| -> Result<u64, Failure> {
            let begun_ns = self.crew.time_ns();
            if self.cavity.update(&positions_m, &tets, |_| true, self.seed_m) {
                self.crew.solver().set_mask(self.cavity.mask()).map_err(broken)?;
            }
            self.crew.step(&inputs_of(&sample, self.radius_m, ticks as f32 * 1e-3))?;
            self.crew.solver().store(bytemuck::cast_slice_mut(&mut block)).map_err(broken)?;
            Ok(self.crew.time_ns() - begun_ns)
        };
        let step_ticks = affordable_step(self.scene_ticks, cells, has_begun, &mut dry_step)?;
        self.step_ticks.set(step_ticks);
        self.crew.solver().load(bytemuck::cast_slice(&first)).map_err(broken)?;
        self.cavity = Cavity::new(self.crew.solver().model().grid);
        if step_ticks != self.scene_ticks {
            let asked = self.scene_ticks;
            self.life.say(&format!("steps of {step_ticks} ms: for the scene's {asked} ms this machine is too slow"));
        }
        Ok(())
    }
}
