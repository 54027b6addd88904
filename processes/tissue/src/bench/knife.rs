//! What a cut costs: a wire is drawn through the middle of the scene's first pathology (without one, of its organ), and the model of what it leaves is
//! made anew after each tick in which the mesh changed. The same wire is drawn as the Main Loop does it, with the scene's surface and all that is made anew,
//! with an allocator that keeps what is freed, as the Main Loop's ([`Workshop::open`] asks it to), and in real time, where that is granted.

use super::press::text;
use crate::contacts::Contacts;
use crate::knife::{Knife as Electrode, Stroke, freed_m3, healthy_removed_m3, removed_m3};
use crate::main_loop::fit;
use crate::materials::materials;
use crate::world::{Workshop, World};
use hyst_contact::{ContactError, Topology, TopologyMaker};
use hyst_engine::realtime;
use hyst_exchange::system;
use hyst_mesh::{TetMesh, check};
use hyst_messages::Role;
use hyst_scene::{DeformableKind, LoadedScene};
use hyst_tissue::{BoundSurface, CutOptions, Cuttable, Isa, ModelMaker, Options, Scratch, cut};
use std::hint::black_box;

/// Way of the wire in a tick of 1 ms, m: 0.2 m/s, faster than a hand cuts.
const WAY_M: f32 = 2e-4;
/// Most ticks: a way of 0.2 m.
const MAX_TICKS: usize = 1_000;
/// Where the middle of an object is, as a share of its width.
const MIDDLE: f32 = 0.5;
/// Where the Main Loop's strokes go through it, each of them through the scene as it was loaded: one stroke has too few cuts for a percentile.
pub const PLACES: [f32; 5] = [0.3, 0.4, MIDDLE, 0.6, 0.7];

/// What was measured, ns and counts.
#[derive(Default)]
pub struct Knife {
    /// Each tick in which the wire was near.
    pub cut_ns: Vec<u64>,
    /// Making the model of the new mesh from what is known of the old one, each time that it changed.
    pub model_ns: Vec<u64>,
    /// The same of its faces and neighbours.
    pub topology_ns: Vec<u64>,
    /// Tets before and after.
    pub tets: [usize; 2],
    /// Parts before and after.
    pub parts: [usize; 2],
}

fn timed<T>(times_ns: &mut Vec<u64>, work: impl FnOnce() -> T) -> T {
    let begun_ns = system::now_ns();
    let made = work();
    times_ns.push(system::now_ns() - begun_ns);
    made
}

/// All objects of the scene as they can be cut.
fn cuttable(world: &World) -> Cuttable {
    let rest = TetMesh {
        positions_m: world.model.rest_m().to_vec(),
        tets: world.model.tets().to_vec(),
        regions: world.body.rest.regions.clone(),
    };
    let fixed = (0..rest.positions_m.len()).map(|node| world.model.is_held(node)).collect();
    Cuttable { fixed, ..Cuttable::at_rest(rest) }
}

/// Where the wire is in each tick of a stroke through a place of the object, m.
fn wires(scene: &LoadedScene, place: f32) -> Result<impl Iterator<Item = [[f32; 3]; 3]>, String> {
    let first = scene.objects.iter().position(|object| object.kind == DeformableKind::Pathology).unwrap_or(0);
    let object = scene.objects.get(first).ok_or("the scene has no deformable object")?;
    let found = check(&object.mesh);
    let (low, high) = (found.min_m, found.max_m);
    let x = low[0] + place * (high[0] - low[0]);
    let margin = 0.5 * (high[1] - low[1]);
    let ways = (0..MAX_TICKS).map(move |tick| low[2] - WAY_M + tick as f32 * WAY_M).take_while(move |z| *z <= high[2] + WAY_M);
    Ok(ways.map(move |z| [[x, low[1] - margin, z], [x, 0.5 * (low[1] + high[1]), z], [x, high[1] + margin, z]]))
}

/// What the Main Loop does for a cut, one after the other: the sweep, the names of the parts that it leaves, their faces and points of contact, packing them into words
/// and looking whether others would take them, waiting for their model, which is made on another core meanwhile, and all else that is made anew for them.
pub const STAGES: [&str; 6] = ["sweep", "parts", "faces", "packing", "model", "taking"];

/// The cuts of some strokes.
#[derive(Default)]
pub struct Cuts {
    /// What each took, ns.
    pub whole_ns: Vec<u64>,
    /// What each of [`STAGES`] took of that, ns.
    pub stages_ns: [Vec<u64>; STAGES.len()],
    /// How many were refused.
    pub refused: usize,
}

/// While this is there the calling thread is real time as a tissue is, if it may.
struct InRealTime;

impl InRealTime {
    fn begin() -> InRealTime {
        let _ = realtime::priority(Role::Tissue).is_some_and(system::become_fifo); // refused: as an ordinary tissue
        InRealTime
    }
}

impl Drop for InRealTime {
    fn drop(&mut self) {
        system::demote(0);
    }
}

/// When the stages of a cut were over, ns.
struct Laps(Vec<u64>);

impl Laps {
    fn begun() -> Laps {
        Laps(vec![system::now_ns()])
    }

    fn pass(&mut self) {
        self.0.push(system::now_ns());
    }
}

impl Cuts {
    fn add(&mut self, laps: &Laps) {
        for (stage_ns, lap) in self.stages_ns.iter_mut().zip(laps.0.windows(2)) {
            stage_ns.push(lap[1] - lap[0]);
        }
        self.whole_ns.extend(laps.0.first().zip(laps.0.last()).map(|(begun, ended)| ended - begun));
    }
}

/// The cuts that the Main Loop makes in a stroke through each place, with all that is made anew for what they leave. Left out is what is kept and
/// hardly grows: the tables of the points, and the register of the objects. With what holds the cavity shut, if it is; where the walls are makes no difference to
/// the time of a cut, and they stay at rest.
pub fn whole(scene: &LoadedScene, isa: Isa, places: &[f32], is_shut: bool) -> Result<Cuts, String> {
    let mut cuts = Cuts::default();
    places.iter().try_for_each(|place| stroke_through(scene, isa, (*place, is_shut), &mut cuts))?;
    Ok(cuts)
}

/// Adds the cuts of one stroke.
fn stroke_through(scene: &LoadedScene, isa: Isa, (place, is_shut): (f32, bool), cuts: &mut Cuts) -> Result<(), String> {
    let (mut workshop, mut world) = Workshop::open(scene, isa).map_err(text)?;
    let (mut scratch, mut contacts) = (Scratch::new(&world.model), Contacts::new(&world));
    let mut surface = BoundSurface::new(&world.body.skin.bindings, world.model.tets());
    let (mut electrode, mut stroke) = (Electrode::default(), Vec::<u32>::new());
    let mut positions_m = world.model.rest_m().to_vec();
    let mut velocities_m_s = vec![[0.0; 3]; positions_m.len()];
    for wire_m in wires(scene, place)? {
        let _in_real_time = InRealTime::begin();
        let mut laps = Laps::begun();
        let nodes = (&positions_m[..], &velocities_m_s[..]);
        let before: &[u8] = bytemuck::cast_slice(&stroke);
        let swept = electrode.sweep_by(&world, Some(&wire_m[..]), before, nodes, || laps.pass()).map_err(text)?;
        if let Stroke::Cut { body, held, parted, .. } = swept {
            laps.pass();
            let made = workshop.make_sound(*body, Some(held), is_shut, &mut || laps.pass());
            match made {
                Ok(next) => {
                    laps.pass();
                    black_box((removed_m3(&world, &next), freed_m3(&world, &next, &parted), healthy_removed_m3(&world, &next)));
                    electrode.keep_momentum(&world, &next, &parted, nodes.1);
                    fit(&next, (&mut scratch, &mut surface, &mut contacts));
                    laps.pass();
                    cuts.add(&laps);
                    // The one before is freed by the clerk, and not in this time.
                    world = next;
                    let (moved_m, moved_m_s) = electrode.moved();
                    (positions_m, velocities_m_s) = (moved_m.to_vec(), moved_m_s.to_vec());
                }
                Err(_) => {
                    cuts.refused += 1;
                    electrode.end();
                }
            }
        }
        stroke.resize(electrode.stroke_bytes() / size_of::<u32>(), 0);
        electrode.write_stroke(bytemuck::cast_slice_mut(&mut stroke));
    }
    Ok(())
}

fn topology_of(faces: &mut TopologyMaker, rest: &TetMesh) -> Result<Topology, ContactError> {
    faces.make(&rest.tets, &rest.regions, &rest.positions_m)
}

/// Draws the wire.
pub fn draw(scene: &LoadedScene, isa: Isa) -> Result<Knife, String> {
    let (_, world) = Workshop::open(scene, isa).map_err(text)?;
    let mut tissue = cuttable(&world);
    let materials = materials(scene).map_err(text)?;
    // What it takes to make a model is measured, not whether it is fast enough.
    let options = Options { max_substeps: 256, max_added_mass_ratio: 1e6, isa, ..Options::default() };
    let mut maker = ModelMaker::new(&materials, options);
    let (_, whole) = maker.make(&tissue.rest, &tissue.fixed).map_err(text)?;
    maker.options.omega_rest_per_s = Some(whole.omega_rest_per_s);
    let mut faces = TopologyMaker::default();
    topology_of(&mut faces, &tissue.rest).map_err(text)?;
    // Room for a mesh of any size: without it the wire would part nothing.
    let (room, nodes, tets) = (CutOptions::default(), tissue.rest.positions_m.len(), tissue.rest.tets.len());
    let options = CutOptions { max_nodes: room.max_nodes.max(2 * nodes), max_tets: room.max_tets.max(2 * tets), ..room };
    let mut knife = Knife { tets: [tets; 2], parts: [check(&tissue.rest).components; 2], ..Knife::default() };
    for wire in wires(scene, MIDDLE)? {
        let report = timed(&mut knife.cut_ns, || cut(&mut tissue, &wire, &options)).map_err(text)?;
        if report.has_changed_mesh() {
            timed(&mut knife.model_ns, || maker.make(&tissue.rest, &tissue.fixed)).map_err(text)?;
            timed(&mut knife.topology_ns, || topology_of(&mut faces, &tissue.rest)).map_err(text)?;
        }
    }
    knife.tets[1] = tissue.rest.tets.len();
    knife.parts[1] = check(&tissue.rest).components;
    Ok(knife)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wire_parts_the_pathology_of_the_embedded_scene() {
        let scene = crate::world::load_scene(None).unwrap();
        let knife = draw(&scene, Isa::detect()).unwrap();
        assert_eq!(knife.parts[1], knife.parts[0] + 1);
        assert!(knife.tets[1] > knife.tets[0] && knife.model_ns.len() > 5 && knife.cut_ns.len() > knife.model_ns.len());
    }

    #[test]
    fn the_main_loops_cuts_are_timed_one_by_one_and_stage_by_stage() {
        let scene = crate::world::load_scene(None).unwrap();
        for (places, is_shut) in [(&PLACES[..], false), (&[MIDDLE][..], true)] {
            let cuts = whole(&scene, Isa::detect(), places, is_shut).unwrap();
            let (count, refused) = (cuts.whole_ns.len(), cuts.refused);
            println!("{count} cuts, {refused} refused");
            assert!(count > 2 * places.len() && refused < count, "{count} cuts, {refused} refused");
            assert!(cuts.stages_ns.iter().all(|stage_ns| stage_ns.len() == count), "a stage is left out, or is told twice");
            for (cut, whole_ns) in cuts.whole_ns.iter().enumerate() {
                assert_eq!(cuts.stages_ns.iter().map(|stage_ns| stage_ns[cut]).sum::<u64>(), *whole_ns, "cut {cut}");
            }
        }
    }
}
