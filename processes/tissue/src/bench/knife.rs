//! What a cut costs: a wire is drawn through the middle of the scene's first pathology (without one, of its organ), and the model of what it leaves is
//! made anew after each tick in which the mesh changed. The same wire is drawn as the Main Loop does it, with the scene's surface and all that is made anew,
//! with an allocator that keeps what is freed, as the Main Loop's ([`Workshop::open`] asks it to), and in real time, where that is granted. And so is the
//! station's own loop, whose half ring sweeps eight times as many triangles as that wire, as the scene's hand cuts with it.

use super::press::{Press, Record, text};
use super::strokes::{MIDDLE, Wires, loop_wires, wires};
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
use hyst_scene::LoadedScene;
use hyst_tissue::{BoundSurface, CutOptions, Cuttable, Isa, LooseSkin, ModelMaker, Options, Scratch, cut};
use std::hint::black_box;

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
    /// The most that a sweep has changed of the volume beside what it burnt, as a share of it.
    #[cfg(test)]
    pub astray: f64,
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

/// What the Main Loop does for a cut, one after the other: the sweep, the names of the parts that it leaves, their faces and points of contact, waiting for their
/// surface for the eye, which is bound on another core meanwhile, packing them into words and looking whether others would take them, waiting for their model,
/// which is made there behind the surface, and all else that is made anew for them.
pub const STAGES: [&str; 7] = ["sweep", "parts", "faces", "surface", "packing", "model", "taking"];

/// The cuts of some strokes.
#[derive(Default)]
pub struct Cuts {
    /// What each took, ns.
    pub whole_ns: Vec<u64>,
    /// What each of [`STAGES`] took of that, ns.
    pub stages_ns: [Vec<u64>; STAGES.len()],
    /// How many were refused.
    pub refused: usize,
    /// Most triangles that the wire has swept in one: two for each of its pieces.
    pub swept_triangles: usize,
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
    fn add(&mut self, laps: &Laps, wire_points: usize) {
        self.swept_triangles = self.swept_triangles.max(2 * wire_points.saturating_sub(1));
        for (stage_ns, lap) in self.stages_ns.iter_mut().zip(laps.0.windows(2)) {
            stage_ns.push(lap[1] - lap[0]);
        }
        self.whole_ns.extend(laps.0.first().zip(laps.0.last()).map(|(begun, ended)| ended - begun));
    }
}

/// What is cut: where its worlds are made, the world, and where its nodes are, m, and how fast, m/s.
struct Tissue {
    workshop: Workshop,
    world: World,
    positions_m: Vec<[f32; 3]>,
    velocities_m_s: Vec<[f32; 3]>,
}

impl Tissue {
    /// That of a scene as it was loaded, at rest.
    fn at_rest(scene: &LoadedScene, isa: Isa) -> Result<Tissue, String> {
        let (workshop, world) = Workshop::open(scene, isa).map_err(text)?;
        let positions_m = world.model.rest_m().to_vec();
        let velocities_m_s = vec![[0.0; 3]; positions_m.len()];
        Ok(Tissue { workshop, world, positions_m, velocities_m_s })
    }
}

/// The cuts that the Main Loop makes in a stroke through each place, with all that is made anew for what they leave. Left out is what is kept and
/// hardly grows: the tables of the points, and the register of the objects. With what holds the cavity shut, if it is; where the walls are makes no difference to
/// the time of a cut, and they stay at rest.
pub fn whole(scene: &LoadedScene, isa: Isa, places: &[f32], is_shut: bool) -> Result<Cuts, String> {
    let mut cuts = Cuts::default();
    for place in places {
        let straight: Wires = wires(scene, *place)?.map(|wire_m| Some(wire_m.to_vec())).collect();
        sweep_along(Tissue::at_rest(scene, isa)?, straight, is_shut, &mut cuts)?;
    }
    Ok(cuts)
}

/// Where the nodes are, m, after so many ticks of the hand `press`, which has bent the tissue by then; at rest in a scene without it.
pub fn pressed_m(scene: &LoadedScene, isa: Isa, ticks: usize) -> Result<Vec<[f32; 3]>, String> {
    let (mut press, mut record) = (Press::new(scene, isa, 1)?, Record::default());
    (0..ticks).try_for_each(|tick| press.tick(tick, &mut record))?;
    Ok(press.positions_m())
}

/// The cuts that the Main Loop makes, in an open cavity, where the hand of the scene that cuts draws the station's loop, turned so far in one stroke after the
/// other; through the middle of what is cut where there is no such hand, and `None` without a loop. The tissue stands still: at rest, for along the way of
/// `polyp` nothing of the instrument touches it but the wire that cuts, or where it was bent to.
pub fn by_loop(scene: &LoadedScene, isa: Isa, turns_deg: &[f32], bent_m: Option<&[[f32; 3]]>) -> Result<Option<Cuts>, String> {
    let mut cuts = Cuts::default();
    for turn_deg in turns_deg {
        let mut tissue = Tissue::at_rest(scene, isa)?;
        let Some(wires) = loop_wires(scene, &tissue.world.case, *turn_deg)? else { return Ok(None) };
        if let Some(bent_m) = bent_m {
            tissue.positions_m = bent_m.to_vec();
        }
        sweep_along(tissue, wires, false, &mut cuts)?;
    }
    Ok(Some(cuts))
}

/// Adds the cuts of a wire that goes from place to place in tissue that stands still. Where it is nowhere a stroke ends.
fn sweep_along(tissue: Tissue, wires: Wires, is_shut: bool, cuts: &mut Cuts) -> Result<(), String> {
    let Tissue { mut workshop, mut world, mut positions_m, mut velocities_m_s } = tissue;
    let (mut scratch, mut contacts) = (Scratch::new(&world.model), Contacts::new(&world));
    let mut surface = BoundSurface::new(&world.body.skin.bindings, world.model.tets());
    let (mut electrode, mut stroke) = (Electrode::default(), Vec::<u32>::new());
    for wire_m in wires {
        let _in_real_time = InRealTime::begin();
        let mut laps = Laps::begun();
        let nodes = (&positions_m[..], &velocities_m_s[..]);
        let before: &[u8] = bytemuck::cast_slice(&stroke);
        let bind = |loose: LooseSkin, rest: &TetMesh| workshop.bind(loose, rest);
        let swept = electrode.sweep_by(&world, wire_m.as_deref(), before, nodes, bind, || laps.pass()).map_err(text)?;
        if let Stroke::Cut { body, held, parted, trailing, .. } = swept {
            laps.pass();
            let made = workshop.make_sound(*body, (Some(held), trailing), is_shut, &mut || laps.pass());
            match made {
                Ok((next, _)) => {
                    laps.pass();
                    black_box((removed_m3(&world, &next), freed_m3(&world, &next, &parted), healthy_removed_m3(&world, &next)));
                    electrode.keep_momentum(&world, &next, &parted, nodes.1);
                    fit(&next, (&mut scratch, &mut surface, &mut contacts));
                    laps.pass();
                    cuts.add(&laps, wire_m.as_ref().map_or(0, Vec::len));
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
        #[cfg(test)]
        let before_m3 = tissue.volume_m3();
        let report = timed(&mut knife.cut_ns, || cut(&mut tissue, &wire, &options)).map_err(text)?;
        if report.has_changed_mesh() {
            timed(&mut knife.model_ns, || maker.make(&tissue.rest, &tissue.fixed)).map_err(text)?;
            timed(&mut knife.topology_ns, || topology_of(&mut faces, &tissue.rest)).map_err(text)?;
        }
        #[cfg(test)]
        {
            let changed_m3 = tissue.volume_m3() + report.burnt_m3 - before_m3;
            knife.astray = knife.astray.max((changed_m3 / before_m3).abs());
        }
    }
    knife.tets[1] = tissue.rest.tets.len();
    knife.parts[1] = check(&tissue.rest).components;
    Ok(knife)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::felt::farthest;
    use crate::bench::strokes::{PLACES, TURNS_DEG};

    #[test]
    fn the_wire_parts_the_pathology_of_the_embedded_scene() {
        let scene = crate::world::load_scene(None).unwrap();
        let knife = draw(&scene, Isa::detect()).unwrap();
        assert_eq!(knife.parts[1], knife.parts[0] + 1);
        assert!(knife.tets[1] > knife.tets[0] && knife.model_ns.len() > 5 && knife.cut_ns.len() > knife.model_ns.len());
    }

    /// Each stage of each cut is told once, and together they are the cut; gives how many there are.
    fn told_stage_by_stage(cuts: &Cuts) -> usize {
        let (count, refused) = (cuts.whole_ns.len(), cuts.refused);
        println!("{count} cuts, {refused} refused");
        assert!(refused < count, "{count} cuts, {refused} refused");
        assert!(cuts.stages_ns.iter().all(|stage_ns| stage_ns.len() == count), "a stage is left out, or is told twice");
        for (cut, whole_ns) in cuts.whole_ns.iter().enumerate() {
            assert_eq!(cuts.stages_ns.iter().map(|stage_ns| stage_ns[cut]).sum::<u64>(), *whole_ns, "cut {cut}");
        }
        count
    }

    #[test]
    fn the_main_loops_cuts_are_timed_one_by_one_and_stage_by_stage() {
        let scene = crate::world::load_scene(None).unwrap();
        for (places, is_shut) in [(&PLACES[..], false), (&[MIDDLE][..], true)] {
            let cuts = whole(&scene, Isa::detect(), places, is_shut).unwrap();
            let count = told_stage_by_stage(&cuts);
            assert!(count > 2 * places.len(), "{count} cuts");
            assert_eq!(cuts.swept_triangles, 4, "two for each piece of the straight wire");
        }
    }

    /// Two for each of the 16 pieces of the half ring.
    const OF_THE_LOOP: usize = 32;

    #[test]
    fn the_stations_loop_cuts_along_the_hands_way_and_sweeps_the_triangles_of_its_half_ring() {
        let scene = crate::world::load_scene(None).unwrap();
        let turns_deg = &TURNS_DEG[1..3];
        let cuts = by_loop(&scene, Isa::detect(), turns_deg, None).unwrap().expect("the scene has a loop");
        let count = told_stage_by_stage(&cuts);
        assert!(count > 5 * turns_deg.len(), "{count} cuts in {} strokes", turns_deg.len());
        assert_eq!(cuts.swept_triangles, OF_THE_LOOP);
    }

    #[test]
    fn the_loop_cuts_tissue_that_a_press_has_bent_and_what_no_hand_goes_to_and_without_a_loop_nothing_is_cut() {
        let (mut scene, isa) = (crate::world::load_scene(None).unwrap(), Isa::detect());
        let bent_m = pressed_m(&scene, isa, 1_000).unwrap();
        let rest_m = Tissue::at_rest(&scene, isa).unwrap().positions_m;
        assert!(farthest(&bent_m, &rest_m) > 1e-3, "the press has hardly bent it");
        let bent = by_loop(&scene, isa, &[0.0], Some(&bent_m[..])).unwrap().unwrap();
        scene.hands.clear();
        let through = by_loop(&scene, isa, &[0.0], None).unwrap().unwrap();
        for (what, cuts) in [("bent", &bent), ("through the middle", &through)] {
            let count = told_stage_by_stage(cuts);
            assert!(count > 2 && cuts.swept_triangles == OF_THE_LOOP, "{what}: {count} cuts");
        }
        scene.rigid[0].electrode = None;
        assert!(by_loop(&scene, isa, &[0.0], None).unwrap().is_none(), "there is no loop");
    }
}
