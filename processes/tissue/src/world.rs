//! The model of everything that the Main Loop computes: made of a body, and what the scene says beside.

mod case;
mod derived;
mod held;
mod lookup;
mod model;
mod modeller;
mod outside;
mod roots;
mod surface;

use crate::body::{Body, Room};
use crate::closing::Closing;
use crate::drift::{Bath, Drifter};
use crate::knife::Filled;
use crate::materials::{Region, materials};
use crate::metal::Metal;
use crate::outlet::Outlet;
use crate::points::ContactPoints;
use crate::site::MAX_OBJECTS;
use crate::state::FARTHEST_M;
use crate::tool::Tool;
use crate::volumes::Volumes;
use derived::Derived;
pub use held::Held;
use hyst_contact::{Topology, TopologyMaker};
use hyst_engine::{Failure, Life, Settings};
use hyst_exchange::allocation;
use hyst_mesh::{Binding, TetMesh};
use hyst_messages::stream::{ObjectKind, ObjectRecord, ScopeRecord};
use hyst_scene::{LoadedLoop, LoadedScene, Look};
use hyst_tissue::{Attachment, Isa, Model, ModelMaker, Options, Skin, join};
use model::notes;
use modeller::{Job, ModelJob, Modeller, Sent};
use outside::Outside;
use parking_lot::Mutex;
use roots::Roots;
use std::path::Path;
use std::sync::{Arc, OnceLock};
pub use surface::{Coming, Trailing};

/// Stiffness that contacts and attachments may add up to at a node, N/m: a tip of 20 mm² in [`crate::contacts::STIFFNESS_N_M3`].
pub const CONTACT_STIFFNESS_N_M: f64 = 400.0;
/// Stiffness with which an attached node is held, N/m: an attachment takes up twice its stiffness.
const ATTACHMENT_N_M: f32 = 200.0;
/// The tool's number in the contact test: one that no tet has, also when pieces come free.
pub const TOOL_ID: u32 = MAX_OBJECTS as u32;
/// Share of the distance at which no state is taken any more that a node may come to.
const REACH_SHARE: f32 = 0.99;
/// Most mass that may be added, as a share of the tissue's own: a swing takes at most √2 times as long, what the hand feels at rest is the same.
const MAX_ADDED_MASS_RATIO: f64 = 1.0;

/// What a scene says and no cut changes.
pub struct Case {
    /// Name and kind of each object of the scene.
    objects: Vec<(String, ObjectKind)>,
    /// Whether an object of the scene has a cavity.
    hollow: Vec<bool>,
    /// What of the hollow organs lies outside.
    outside: Outside,
    /// Whether anything holds an object of the scene, or a part of one that hangs apart, from the beginning.
    rooted: Vec<bool>,
    /// Density of each object of the scene, and what they are in.
    density_kg_m3: Vec<f64>,
    bath: Bath,
    /// The regions of material of all objects.
    regions: Vec<Region>,
    /// Instruments by name.
    rigid: Vec<String>,
    /// What ties a pathology to its host.
    roots: Roots,
    /// Mean edge of the scene's tets, m.
    pub edge_m: f32,
    /// Cell of the spatial hash, m.
    pub cell_m: f32,
    /// What there is room for.
    pub room: Room,
    /// The instrument.
    pub tool: Tool,
    /// Its electrode at extension 0, in its own frame, and how far that goes out, m.
    pub electrode: Option<LoadedLoop>,
    /// Where medium flows out at it.
    pub outlet: Outlet,
    /// How each object looks, where the scene says so.
    pub looks: Vec<Option<Look>>,
    /// How the instrument sees, and what is drawn of it.
    pub scope: ScopeRecord,
    /// Its surfaces from files.
    pub metal: Metal,
    /// Where the hand rests at first.
    pub rest: hyst_scene::Pose,
    /// The pivot of the hand, m.
    pub pivot_m: [f32; 3],
    /// Pressure at which the organ has its rest shape, Pa.
    pub rest_pressure_pa: f32,
    /// How its cavity closes where the pressure is low.
    pub closing: Closing,
}

/// The model of everything that the Main Loop computes, made of a body: never changed by a step that cuts nothing.
pub struct World {
    /// What no cut changes.
    pub case: Arc<Case>,
    /// The body that it is made of.
    pub body: Body,
    /// The body as words, and their version.
    pub words: Vec<u32>,
    /// Names the body.
    pub version: u32,
    /// All objects as one model: objects that hold each other belong together.
    pub model: Model,
    /// Faces and neighbours.
    pub topology: Topology,
    /// What ties a pathology to its host, or to what has come off that.
    pub attachments: Vec<Attachment>,
    /// Points of the contact test.
    pub points: ContactPoints,
    /// Triangles of the cavity's wall: boundary triangles of what is hollow, wounds too, without held nodes; none of the outside of an organ that is held.
    pub wall: Vec<[u32; 3]>,
    /// All objects, instruments too.
    pub objects: Vec<ObjectRecord>,
    /// Those that nothing holds.
    pub drifters: Vec<Drifter>,
    /// Whether no stroke has cut the organ that has the cavity: one that is cut stays open, or opens.
    pub is_organ_whole: bool,
    /// The forces that hold the cavity shut, once somebody has asked for them: those of a mesh that is cut while it is shut or shutting are made with it.
    pub shut_n: OnceLock<Vec<[f32; 3]>>,
    /// What its tets fill.
    pub filled: Filled,
    /// What making the model took, one sentence each.
    pub notes: Vec<String>,
}

/// Where worlds are made: what was computed for one serves for the next.
pub struct Workshop {
    case: Arc<Case>,
    maker: Arc<Mutex<ModelMaker>>,
    faces: TopologyMaker,
    volumes: Volumes,
    first_substeps: u32,
    /// Who binds surfaces and makes models on another core where something is cut.
    modeller: Option<Modeller>,
}

/// What is not as in the station, for whoever asks what that costs or is worth.
#[derive(Clone, Copy, Debug)]
pub struct Otherwise {
    /// Steps in each tick of the hand; of more than one none has mass added.
    pub finer: u32,
    /// Or ticks of the hand in each step, as where a machine affords no shorter ones.
    pub step_ticks: u32,
    /// How many times as stiff the contacts of the tool are.
    pub stiffer: f32,
    /// Most substeps of a step that are tried first: with fewer more mass is added.
    pub first_substeps: u32,
    /// Whether the test of the points looks for the tets near them among all in each step.
    pub searches: bool,
}

impl Default for Otherwise {
    /// As in the station.
    fn default() -> Otherwise {
        Otherwise { finer: 1, step_ticks: 1, stiffer: 1.0, first_substeps: model::MAX_SUBSTEPS[0], searches: false }
    }
}

/// The scene of the settings.
pub fn load_scene(path: Option<&Path>) -> Result<LoadedScene, Failure> {
    hyst_scene::load_or_embedded(path).map_err(|error| Failure::Input(error.to_string()))
}

/// The instruction set of the settings, or the widest of this machine.
pub fn isa(settings: &Settings) -> Result<Isa, Failure> {
    let Some(name) = settings.set.get("isa") else { return Ok(Isa::detect()) };
    let found = Isa::from_name(name).filter(|isa| isa.available());
    found.ok_or_else(|| Failure::Input(format!("--set isa={name}: this machine has up to {}", Isa::detect().name())))
}

impl Workshop {
    /// Loads the settings' scene and makes its world.
    pub fn load(life: &Life) -> Result<(Workshop, World), Failure> {
        let scene = load_scene(life.scene().as_deref())?;
        life.admit_scene(scene.hash)?;
        for note in &scene.notes {
            life.say(note);
        }
        let (workshop, world) = Workshop::open(&scene, isa(&life.settings)?)?;
        for note in &world.notes {
            life.say(note);
        }
        Ok((workshop, world))
    }

    /// The world of a scene, and where others are made of it.
    pub fn open(scene: &LoadedScene, isa: Isa) -> Result<(Workshop, World), Failure> {
        Workshop::open_other(scene, isa, Otherwise::default())
    }

    /// The same with what is not as in the station.
    pub fn open_other(scene: &LoadedScene, isa: Isa, otherwise: Otherwise) -> Result<(Workshop, World), Failure> {
        let Otherwise { finer, stiffer, first_substeps, .. } = otherwise;
        // The lists of a world, some megabytes, are made anew in each cut, and those of the one before are freed.
        allocation::keep_what_is_freed();
        let meshes: Vec<_> = scene.objects.iter().map(|object| &object.mesh).collect();
        let (rest, starts) = join(&meshes).ok_or_else(|| Failure::Input("the scene has too many nodes".into()))?;
        let mut body = Body::of(scene, rest)?;
        let options = Options {
            step_s: 1e-3 / f64::from(finer.max(1)),
            max_added_mass_ratio: if finer > 1 { 0.0 } else { MAX_ADDED_MASS_RATIO },
            contact_stiffness_n_m: f64::from(stiffer) * CONTACT_STIFFNESS_N_M,
            most_reach_m: Some(most_reach_m(&body)),
            isa,
            ..Options::default()
        };
        let mut case = Case::of(scene, &body, &starts)?;
        case.register_parts(&mut body)?;
        let case = Arc::new(case);
        let maker = Arc::new(Mutex::new(ModelMaker::new(&materials(scene)?, options)));
        let (faces, volumes, modeller) = (TopologyMaker::default(), Volumes::default(), Modeller::start());
        let mut workshop = Workshop { case, maker, faces, volumes, first_substeps, modeller };
        let (model, report) = workshop.model(&body)?;
        // Looking for the frequency takes longer than all else. Cuts raise it, to 1.9 in a substep at most, for there mass is added: what they leave is stable,
        // and its stiffest modes ring for longer than those of the whole mesh.
        workshop.maker.lock().options.omega_rest_per_s = Some(report.omega_rest_per_s);
        let known = (&mut workshop.faces, &mut workshop.volumes);
        let derived = Derived::of(&workshop.case, known, &body, None, || None, &mut || ())?;
        let mut world = derived.with(&workshop.case, body, model, None);
        world.notes = [&notes(&report)[..], world.case.closing.notes()].concat();
        // Now, so that no step of a mesh that is not cut has to.
        world.shut_n();
        Ok((workshop, world))
    }

    /// The world of a body of the same scene: the same whoever makes it, and whatever was made before.
    pub fn make(&mut self, body: Body) -> Result<World, Failure> {
        let (model, _) = self.model(&body)?;
        let derived = Derived::of(&self.case, (&mut self.faces, &mut self.volumes), &body, None, || None, &mut || ())?;
        Ok(derived.with(&self.case, body, model, None))
    }

    /// The world of a body that this process has changed. It is asked what everybody asks who is sent it: with a mesh that they refuse its maker would go on
    /// alone, without a spare or a successor. Who knows already what holds the body says it, and who has its surface bound meanwhile gives that; how much of it
    /// found no room is told with the world. The tissue stands still meanwhile, so the model is made on another core, and there, too, the forces that hold the
    /// cavity shut, where it is or comes to be (`is_shut`). Calls `passed` once the faces and the points of contact are made, once the surface is there, and
    /// once the body is packed.
    pub fn make_sound(
        &mut self,
        body: Body,
        (held, trailing): (Option<Held>, Option<Box<Trailing>>),
        is_shut: bool,
        passed: &mut impl FnMut(),
    ) -> Result<(World, usize), Failure> {
        let (body, case) = (Arc::new(body), Arc::clone(&self.case));
        let job = ModelJob::of(self, &body, is_shut);
        let given = match &mut self.modeller {
            Some(modeller) => modeller.make(job),
            None => Err(job),
        };
        let mut out_of_room = 0;
        let come = || {
            let (skin, left_out) = trailing?.come(&body);
            out_of_room = left_out;
            Some(skin)
        };
        let derived = Derived::of(&case, (&mut self.faces, &mut self.volumes), &body, held, come, passed);
        passed();
        let (model, shut_n) = given.map_or_else(Job::done, Sent::ended)?;
        let body = Arc::try_unwrap(body).unwrap_or_else(|shared| Body::clone(&shared));
        let world = derived?.with(&case, body, model, shut_n);
        let is_sound = world.body.fits(&case.room) && world.filled.is_everywhere;
        if !is_sound {
            return Err(Failure::Broken("the mesh that it leaves is none, or one that there is no room for".into()));
        }
        Ok((world, out_of_room))
    }
}

impl Body {
    /// The objects of a scene, in their places.
    fn of(scene: &LoadedScene, mut rest: TetMesh) -> Result<Body, Failure> {
        if scene.objects.len() + scene.rigid.len() > MAX_OBJECTS {
            return Err(Failure::Input(format!("a scene has at most {MAX_OBJECTS} objects")));
        }
        let (mut skin, mut regions) = (Skin::default(), Vec::with_capacity(rest.tets.len()));
        let (mut material, mut first_region) = (Vec::<u32>::new(), 0u32);
        for (index, object) in scene.objects.iter().enumerate() {
            let (first_vertex, first_tet) = (skin.rest_m.len() as u32, regions.len() as u32);
            skin.rest_m.extend_from_slice(&object.surface.positions_m);
            skin.bindings.extend(object.bindings.iter().map(|binding| Binding { tet: binding.tet + first_tet, ..*binding }));
            skin.raw.extend(object.bindings.iter().map(|_| false));
            skin.triangles.extend(object.surface.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first_vertex)));
            regions.extend(std::iter::repeat_n(index as u32, object.mesh.tets.len()));
            material.extend(object.mesh.regions.iter().map(|own| if *own == 0 { 0 } else { first_region + own }));
            first_region += object.regions.len() as u32;
        }
        rest.regions = regions;
        if first_region == 0 {
            material.clear();
        }
        let fixed = scene.objects.iter().flat_map(|object| object.fixed.iter().copied()).collect();
        Ok(Body { rest, material, fixed, skin, origin: (0..scene.objects.len() as u32).collect() })
    }
}

/// How far nodes may stray, m: not to where nobody takes a state of them, its maker neither.
fn most_reach_m(body: &Body) -> f64 {
    let places_m = body.rest.positions_m.as_flattened();
    let farthest_m = places_m.iter().fold(0.0f32, |farthest, place_m| farthest.max(place_m.abs()));
    f64::from(REACH_SHARE * FARTHEST_M - farthest_m).max(0.0)
}

/// Mean edge of some tets, m.
pub(crate) fn mean_edge_m(tets: &[[u32; 4]], positions_m: &[[f32; 3]]) -> f32 {
    const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    let at = |node: u32| glam::Vec3::from(positions_m[node as usize]);
    let length = |tet: &[u32; 4]| EDGES.iter().map(|[a, b]| at(tet[*a]).distance(at(tet[*b]))).sum::<f32>();
    let sum: f32 = tets.iter().map(length).sum();
    (sum / (6 * tets.len().max(1)) as f32).max(1e-5)
}
