//! Grid and step of a session: those of the role, or for who founds it the scene's, or what the machine affords of them.

use super::{FlowEngine, load_scene};
use crate::afford::{affordable_step, at_rest, is_step, longest_step, refused, tissue_at_rest};
use crate::cavity::{Cavity, Tissue};
use crate::coarse::{agree, agreed, halved};
use hyst_engine::{Failure, Life};
use hyst_exchange::Roster;
use hyst_messages::Role;
use hyst_messages::page::fluid;
use hyst_scene::LoadedScene;

impl<'a> FlowEngine<'a> {
    /// An engine for the settings' scene. In lock-step, a replay's too, neither grid nor step may depend on the machine.
    pub fn new(life: &'a Life) -> Result<FlowEngine<'a>, Failure> {
        let scene = load_scene(life.scene().as_deref())?;
        life.admit_scene(scene.hash)?;
        if life.is_lockstep() {
            return FlowEngine::on_grid(life, &scene, 0);
        }
        match agreed(&life.station) {
            Some(halvings) => FlowEngine::of_session(life, &scene, halvings),
            None => FlowEngine::that_founds(life, &scene),
        }
    }

    /// On the grid that another has found.
    fn of_session(life: &'a Life, scene: &LoadedScene, halvings: u32) -> Result<FlowEngine<'a>, Failure> {
        let mut engine = FlowEngine::on_grid(life, scene, halvings)?;
        if engine.choose_step(scene)?.is_err() {
            // It was afforded when the session began.
            engine.step_ticks.set(longest_step(engine.scene_ticks));
        }
        engine.say_what_is_less(scene);
        Ok(engine)
    }

    /// On the finest grid of which the machine affords a step, unless another has found one meanwhile.
    fn that_founds(life: &'a Life, scene: &LoadedScene) -> Result<FlowEngine<'a>, Failure> {
        let mut engine = FlowEngine::on_grid(life, scene, 0)?;
        while let Err(took_ns) = engine.choose_step(scene)? {
            let (cells, halvings) = (engine.crew.solver().model().grid.cell_count(), engine.halvings + 1);
            if halved(scene.fluid.grid, halvings).is_none() {
                return Err(refused(cells, took_ns));
            }
            life.say(&format!(
                "a step of {cells} cells takes {:.0} ms: they are too many for this machine",
                took_ns as f64 * 1e-6
            ));
            engine = FlowEngine::on_grid(life, scene, halvings)?;
        }
        let halvings = agree(&life.station, life.incarnation, engine.halvings)?;
        if halvings != engine.halvings {
            return FlowEngine::of_session(life, scene, halvings);
        }
        engine.say_what_is_less(scene);
        Ok(engine)
    }

    fn say_what_is_less(&self, scene: &LoadedScene) {
        let (ticks, asked) = (self.step_ticks.get(), self.scene_ticks);
        if ticks != asked {
            self.life.say(&format!("steps of {ticks} ms: for the scene's {asked} ms this machine is too slow"));
        }
        if self.halvings > 0 {
            let ([x, y, z], [of_x, of_y, of_z]) = (self.crew.solver().model().grid.cells(), scene.fluid.grid);
            let asked = format!("{of_x} × {of_y} × {of_z}");
            self.life.say(&format!("{x} × {y} × {z} cells: for the scene's {asked} this machine is too slow"));
        }
    }

    /// Takes the step of the role, which whoever follows goes on with whatever it would afford itself: dry steps would only delay it, on a machine that is
    /// too slow for the scene by seconds. Who finds none takes the step that the machine affords; if there is none, the time that one takes is given, ns.
    pub(super) fn choose_step(&mut self, scene: &LoadedScene) -> Result<Result<(), u64>, Failure> {
        let has_begun = Roster::open(&self.life.station)?.holder(Role::Fluid).epoch > 0;
        let of_role = self.step_of_role().filter(|_| has_begun);
        let found = of_role.map_or_else(|| self.find_step(scene), |step_ticks| Ok(Ok(step_ticks)))?;
        Ok(found.map(|step_ticks| self.step_ticks.set(step_ticks)))
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

    /// The step that the machine affords; what the dry steps did to the flow is undone.
    fn find_step(&mut self, scene: &LoadedScene) -> Result<Result<u64, u64>, Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let (sample, (positions_m, tets)) = (at_rest(scene), tissue_at_rest(scene));
        let velocities_m_s = vec![[0.0; 3]; positions_m.len()];
        let tissue = Tissue { positions_m: &positions_m, velocities_m_s: &velocities_m_s, tets: &tets };
        let [_, bytes, ..] = self.sections();
        let (mut first, mut block) = (vec![0u64; bytes.div_ceil(8)], vec![0u64; bytes.div_ceil(8)]);
        self.crew.solver().store(bytemuck::cast_slice_mut(&mut first)).map_err(broken)?;
        let mut dry_step = |ticks: u64| -> Result<u64, Failure> {
            let begun_ns = self.crew.time_ns();
            if self.cavity.update(&tissue, |_| true, self.seed_m) {
                self.crew.solver().set_walls(self.cavity.mask(), self.cavity.velocities_m_s()).map_err(broken)?;
            }
            self.crew.step(&self.instrument.inputs(&sample, ticks as f32 * 1e-3))?;
            self.crew.solver().store(bytemuck::cast_slice_mut(&mut block)).map_err(broken)?;
            Ok(self.crew.time_ns() - begun_ns)
        };
        let found = affordable_step(self.scene_ticks, &mut dry_step)?;
        self.crew.solver().load(bytemuck::cast_slice(&first)).map_err(broken)?;
        self.cavity = Cavity::new(self.crew.solver().model().grid);
        Ok(found)
    }
}
