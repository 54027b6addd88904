//! What a scene says and no cut changes: whose a tet is and what it is made of.

use super::outside::Outside;
use super::roots::Roots;
use super::{Case, mean_edge_m};
use crate::body::{Body, Room};
use crate::closing::Closing;
use crate::drift::Bath;
use crate::knife::register_parts;
use crate::materials::{FIRST_REGION, Region, regions};
use crate::metal::Metal;
use crate::outlet::Outlet;
use crate::site::MAX_OBJECTS;
use crate::tool::Tool;
use hyst_engine::Failure;
use hyst_mesh::{component_count, component_of_each_tet};
use hyst_messages::Pose;
use hyst_messages::stream::{ObjectKind, ScopeRecord};
use hyst_scene::{DeformableKind, LoadedRigid, LoadedScene};

/// Cell of the spatial hash, in mean edges: what took the shortest of 0.4 to 1.5 in the paper's scenes (`bench contact`, 2-core VM, 2026-11-29).
const CELL: f32 = 0.6;

impl Case {
    pub(super) fn of(scene: &LoadedScene, body: &Body, starts: &[usize]) -> Result<Case, Failure> {
        let rigid = scene.rigid.first().ok_or_else(|| Failure::Input("the scene has no rigid object".into()))?;
        let kind = |kind| match kind {
            DeformableKind::Organ => ObjectKind::Organ,
            DeformableKind::Pathology => ObjectKind::Pathology,
        };
        let roots = Roots::of(scene, body, starts);
        let edge_m = mean_edge_m(&body.rest.tets, &body.rest.positions_m);
        Ok(Case {
            // Known once the parts of the scene's meshes are.
            rooted: Vec::new(),
            objects: scene.objects.iter().map(|object| (object.name.clone(), kind(object.kind))).collect(),
            hollow: scene.objects.iter().map(|object| object.hollow).collect(),
            outside: Outside::of(scene, body, starts),
            density_kg_m3: scene.objects.iter().map(|object| object.material.density_kg_m3).collect(),
            bath: Bath { density_kg_m3: scene.fluid.density_kg_m3.into(), viscosity_pa_s: scene.fluid.viscosity_pa_s.into() },
            regions: regions(scene),
            rigid: scene.rigid.iter().map(|rigid| rigid.name.clone()).collect(),
            roots,
            edge_m,
            cell_m: CELL * edge_m,
            room: Room::for_body(body, MAX_OBJECTS - scene.rigid.len(), regions(scene).len()),
            tool: Tool::of(rigid),
            electrode: rigid.electrode.clone(),
            outlet: Outlet::of(rigid),
            looks: scene.objects.iter().map(|object| object.look).collect(),
            scope: scope(scene, rigid),
            metal: Metal::of(rigid),
            rest: scene.rest,
            pivot_m: scene.workspace.pivot_m,
            rest_pressure_pa: scene.fluid.rest_pressure_pa,
            closing: Closing::of(scene),
        })
    }

    /// Makes objects of the parts that hang apart in the scene's meshes, as after a cut: else the first cut anywhere would, and count those that nothing holds.
    /// An object that hangs together stays what it is.
    pub(super) fn register_parts(&mut self, body: &mut Body) -> Result<(), Failure> {
        let part_of_tet = component_of_each_tet(&body.rest);
        let (parts, most) = (component_count(&part_of_tet), self.room.objects);
        if parts > most {
            let cure = "give parts whose faces fit each other, or leave small ones out";
            let what = format!("the scene's meshes have {parts} parts that hang apart, at most {most} are told apart; {cure}");
            return Err(Failure::Input(what));
        }
        let (_, held) = register_parts(self, body, &part_of_tet);
        self.rooted = held.objects(body);
        self.room.named = body.origin.len();
        self.closing.know(body);
        Ok(())
    }

    /// Where the instrument is as a hand of the scene has it.
    pub fn pose_of(&self, pose: &hyst_scene::Pose) -> Pose {
        let position_m = pose.tip_m(self.pivot_m);
        Pose { position_m, orientation: pose.orientation(), insertion_m: pose.insertion_m, ..Pose::default() }
    }

    /// The object of the scene that an object is, or was a part of.
    pub fn origin(&self, body: &Body, object: u32) -> usize {
        body.origin.get(object as usize).map_or(0, |origin| *origin as usize)
    }

    /// The region of material that a tet is of; `None` where it is made of what its object is.
    fn region(&self, body: &Body, tet: usize) -> Option<(u32, &Region)> {
        let index = body.material.get(tet)?.checked_sub(1)?;
        self.regions.get(index as usize).map(|region| (index, region))
    }

    /// What a tet is made of, by the number that [`materials`] gives it.
    pub fn material(&self, body: &Body, tet: usize) -> u32 {
        let own = || self.origin(body, body.rest.regions[tet]) as u32;
        self.region(body, tet).map_or_else(own, |(index, _)| FIRST_REGION + index)
    }

    /// The mean density of an object, kg/m³.
    pub fn density_of_kg_m3(&self, body: &Body, object: u32) -> f64 {
        let own_kg_m3 = self.density_kg_m3.get(self.origin(body, object)).copied().unwrap_or(self.bath.density_kg_m3);
        let of_region = |tet: usize| self.region(body, tet).map_or(0.0, |(_, region)| region.density_kg_m3 - own_kg_m3);
        let more_kg = if body.material.is_empty() { 0.0 } else { body.weighed(object, of_region) };
        if more_kg == 0.0 { own_kg_m3 } else { own_kg_m3 + more_kg / body.volume_of_m3(object) }
    }

    /// Whether each node of a body is held: it is fixed, or in tissue that what is around it holds.
    pub fn held_nodes(&self, body: &Body) -> Vec<bool> {
        let mut is_held = body.fixed.clone();
        let is_on_bed = |tet: &usize| self.region(body, *tet).is_some_and(|(_, region)| region.is_on_bed);
        for tet in (0..body.material.len()).filter(is_on_bed) {
            body.rest.tets[tet].iter().for_each(|node| is_held[*node as usize] = true);
        }
        is_held
    }

    /// Whether an object is one of the scene, and not one that has come free of such.
    pub fn is_of_scene(&self, object: u32) -> bool {
        (object as usize) < self.objects.len()
    }

    /// Whether an object is one of the scene, or a part of one that hung apart at first, that nothing has ever held.
    pub fn is_loose_in_scene(&self, object: u32) -> bool {
        self.rooted.get(object as usize).is_some_and(|is_rooted| !is_rooted)
    }

    /// Whether an object is, or was a part of, what is to be removed.
    pub fn is_pathology(&self, body: &Body, object: u32) -> bool {
        self.objects.get(self.origin(body, object)).is_some_and(|(_, kind)| *kind == ObjectKind::Pathology)
    }
}

fn scope(scene: &LoadedScene, rigid: &LoadedRigid) -> ScopeRecord {
    let view = &scene.scene.view;
    ScopeRecord {
        oblique_rad: view.optic_angle_deg.to_radians() as f32,
        field_of_view_rad: view.field_of_view_deg.to_radians() as f32,
        periphery_ratio: view.periphery_ratio as f32,
        light: view.light as f32,
        shaft_radius_m: rigid.radius_m,
        shaft_length_m: rigid.length_m,
        loop_radius_m: rigid.electrode.as_ref().map_or(0.0, |electrode| electrode.radius_m),
        loop_wire_radius_m: rigid.electrode.as_ref().map_or(0.0, |electrode| electrode.wire_radius_m),
    }
}
