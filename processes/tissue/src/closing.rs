//! How the cavity of a hollow organ closes: where the medium's pressure is below that at which the walls part, they come together to a slit, and where it is
//! not nothing of this is in a step, to the last bit.
//!
//! The meshes hold the shape of a distended cavity. Closed it is held by the forces that lead there ([`holding_forces`]), a share of them by how far it is
//! closed. They depend on no position, so that they feed no mode, and about the closed shape the wall is about as stiff as about the open one: an instrument
//! between the walls, or what grows there, is pressed with what it takes to part them so far, and no more.

mod lattice;
mod slit;

use crate::body::Body;
use crate::world::World;
use hyst_messages::PA_PER_MMHG;
use hyst_scene::{DeformableKind, LoadedScene};
use hyst_tissue::{Model, holding_forces};
use slit::Slit;

/// The share of the parting pressure below which the cavity is closed wholly: walls part at 25 to 50 mmHg with a median of 40, and the lowest is taken for
/// where they begin to.
const CLOSED_SHARE: f32 = 25.0 / 40.0;
/// Time in which a cavity closes or opens, s (assumed).
const CLOSING_S: f32 = 0.5;
/// Share of it in which the walls stay as they are at first: that the pressure is low for a tenth of a second, as when the pump starts, moves nothing (assumed).
const LAG_SHARE: f32 = 0.2;
/// Pascal in a millimetre of mercury.
const MMHG_PA: f32 = PA_PER_MMHG as f32;

/// How the cavity of a scene closes.
pub struct Closing {
    /// The closed shape, of a cavity that has one.
    slit: Option<Slit>,
    /// The organ that has it, by its number, and of how many tets and nodes it is.
    organ: (u32, [usize; 2]),
    /// Pressure from which on the walls are apart, Pa.
    parting_pa: f32,
    /// What is said of it.
    notes: Vec<String>,
}

impl Closing {
    /// That of a scene's first hollow organ. One that has its rest shape below the parting pressure parts at that of the rest shape.
    pub fn of(scene: &LoadedScene) -> Closing {
        let parting_pa = (scene.fluid.cavity.parting_pa as f32).min(scene.fluid.rest_pressure_pa);
        let is_hollow_organ = |object: &hyst_scene::LoadedDeformable| object.hollow && object.kind == DeformableKind::Organ;
        let Some(organ) = scene.objects.iter().position(is_hollow_organ) else {
            return Closing { slit: None, organ: (0, [0; 2]), parting_pa, notes: Vec::new() };
        };
        let mesh = &scene.objects[organ].mesh;
        let number = (organ as u32, [mesh.tets.len(), mesh.positions_m.len()]);
        let below = format!("{}: below {:.0} mmHg its cavity", scene.objects[organ].name, parting_pa / MMHG_PA);
        match Slit::of(scene, organ) {
            Ok(slit) => {
                let notes = vec![format!("{below} closes to a slit, in {CLOSING_S} s")];
                Closing { slit: Some(slit), organ: number, parting_pa, notes }
            }
            Err(why) => Closing { slit: None, organ: number, parting_pa, notes: vec![format!("{below} stays open: {why}")] },
        }
    }

    /// Whether a body's organ has as many tets and nodes as in the scene: a stroke that cuts it makes more tets, or takes some, and where there is no room for
    /// tets it parts what is there, which makes nodes alone. The forces that lead a cut wall to its closed shape meet tets of every form, and a wall that is cut
    /// through has no such shape.
    pub fn is_whole(&self, body: &Body) -> bool {
        self.size_of_organ(body) == self.organ.1
    }

    /// Goes by what has the organ's number in the scene's body: of a mesh that hangs apart that is a part of it.
    pub fn know(&mut self, body: &Body) {
        self.organ.1 = self.organ.1.min(self.size_of_organ(body));
    }

    /// Tets and nodes of the organ.
    fn size_of_organ(&self, body: &Body) -> [usize; 2] {
        let (mut tets, mut is_used) = (0, vec![false; body.rest.positions_m.len()]);
        for (tet, _) in body.rest.tets.iter().zip(&body.rest.regions).filter(|(_, object)| **object == self.organ.0) {
            tets += 1;
            tet.iter().for_each(|node| is_used[*node as usize] = true);
        }
        [tets, is_used.into_iter().filter(|is_used| *is_used).count()]
    }

    /// What is said of it, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// How far the cavity is closed after a step of `dt_s` at a pressure, 0 to 1, of how far it was before.
    pub fn after(&self, closed: f32, pressure_pa: f32, dt_s: f32) -> f32 {
        let most = dt_s / CLOSING_S;
        (closed + (self.wanted(pressure_pa) - closed).clamp(-most, most)).clamp(0.0, 1.0)
    }

    /// How far it closes at a pressure.
    fn wanted(&self, pressure_pa: f32) -> f32 {
        if self.slit.is_none() || pressure_pa >= self.parting_pa {
            return 0.0;
        }
        let share = (self.parting_pa - pressure_pa) / ((1.0 - CLOSED_SHARE) * self.parting_pa);
        LAG_SHARE + (1.0 - LAG_SHARE) * share.clamp(0.0, 1.0)
    }

    /// The forces that hold the cavity of a body shut, N, one for each node; none at all where it does not close.
    pub fn shut_n(&self, model: &Model, body: &Body) -> Vec<[f32; 3]> {
        let Some(slit) = &self.slit else { return Vec::new() };
        let shape_m = slit.shape_m(body);
        let mut held_n = vec![[0.0; 3]; shape_m.len()];
        holding_forces(model, &shape_m, &mut held_n);
        held_n
    }
}

/// The share of the forces that hold a cavity shut, of how far it is closed: none at first, then ever more, and all in the end without a jerk.
pub fn share(closed: f32) -> f32 {
    let way = ((closed - LAG_SHARE) / (1.0 - LAG_SHARE)).clamp(0.0, 1.0);
    way * way * (3.0 - 2.0 * way)
}

impl World {
    /// Adds a share of the forces that hold the cavity shut, N; at share 0 nothing. Where nobody has made the forces of this world they are made here.
    pub fn shut(&self, share: f32, node_force_n: &mut [[f32; 3]]) {
        if share == 0.0 {
            return;
        }
        for (force_n, held_n) in node_force_n.iter_mut().zip(self.shut_n()) {
            force_n.iter_mut().zip(held_n).for_each(|(sum, part)| *sum += share * part);
        }
    }

    /// The forces that hold the cavity shut, N, one for each node; none at all where it does not close.
    pub fn shut_n(&self) -> &[[f32; 3]] {
        self.shut_n.get_or_init(|| self.case.closing.shut_n(&self.model, &self.body))
    }
}

#[cfg(test)]
mod tests;
