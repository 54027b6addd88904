//! From a file to a scene that is ready to run: read, check, repair, place, bind, hold, and find the hands.

use crate::case::{Past, Seat, Seats};
use crate::error::SceneError;
use crate::file::Scene;
use crate::fixed::{default_shapes, depth_under_hull, fixed_nodes, hollow_nodes};
use crate::fluid::LoadedFluid;
use crate::hands::{self, Probe};
use crate::hash::Fnv;
use crate::loaded::{LoadedDeformable, LoadedScene, LoadedWorkspace};
use crate::locate::{Locator, bounds};
use crate::object::{self, RawObject};
use crate::parse::MAX_SCENE_BYTES;
use crate::place::{Transform, in_front, is_auto};
use crate::rigid::{LoadedRigid, load_rigid};
use crate::source::{Folder, unusable};
use crate::{bounded, case, embedded, mirror, parts, region, wrap};
use glam::Vec3;
use hyst_mesh::{TetMesh, TriangleMesh};
use std::path::Path;

/// An object in its place: its tets, and its own surface with the name to speak of it by.
pub(crate) type Placed = (TetMesh, Option<(TriangleMesh, String)>);

/// Reads a scene, or wraps a mesh in one, or draws the scene of a case, and makes it ready to run. Whether a case's goals are within reach is asked by who
/// settles it ([`crate::find_case`]), and by nobody who goes on with it.
///
/// # Errors
/// A [`SceneError`] whose text says which file, which line and key, what is wrong and what to do.
pub fn load(path: &Path) -> Result<LoadedScene, SceneError> {
    match read_file(path)? {
        Found::Scene(read) => read.load(&Seats::default()),
        Found::Case(text) => Ok(case::settle(&text, path, None, Past::Played)?.scene),
    }
}

/// The scene, mesh or case at a path, or the default scene where none is named.
///
/// # Errors
/// Those of [`load`].
pub fn load_or_embedded(path: Option<&Path>) -> Result<LoadedScene, SceneError> {
    path.map_or_else(load_embedded, load)
}

/// The default scene, from the binary itself.
///
/// # Errors
/// None with the assets as they are; a test loads them.
pub fn load_embedded() -> Result<LoadedScene, SceneError> {
    let origin = embedded::DEFAULT_ORIGIN;
    let (scene, text, origin) = (Scene::embedded_default()?, embedded::DEFAULT_SCENE.to_owned(), origin.to_owned());
    ReadScene { scene, text, origin, folder: Folder::Embedded }.load(&Seats::default())
}

impl Scene {
    /// The default scene's file, such that it can lie anywhere: its meshes are those in the binary.
    pub fn embedded_text() -> String {
        embedded::DEFAULT_SCENE.replace("\"../meshes/", &format!("\"{}", embedded::PREFIX))
    }

    /// The default scene as it stands in the binary.
    ///
    /// # Errors
    /// None with the assets as they are; a test reads them.
    pub fn embedded_default() -> Result<Scene, SceneError> {
        Scene::parse(embedded::DEFAULT_SCENE, embedded::DEFAULT_ORIGIN)
    }
}

/// A scene as it was read: nothing of its meshes is.
pub(crate) struct ReadScene {
    pub(crate) scene: Scene,
    pub(crate) text: String,
    pub(crate) origin: String,
    pub(crate) folder: Folder,
}

/// What a path names.
pub(crate) enum Found {
    Scene(Box<ReadScene>),
    /// The text of a case.
    Case(String),
}

impl ReadScene {
    /// Makes it ready to run, its objects seated as a case has drawn it.
    pub(crate) fn load(self, seats: &Seats) -> Result<LoadedScene, SceneError> {
        assemble(self.scene, &self.origin, &self.folder, seats).map_err(|error| error.located(&self.origin, &self.text))
    }
}

/// Reads what a path names. A file that is not named `.toml` is taken for a mesh.
pub(crate) fn read_file(path: &Path) -> Result<Found, SceneError> {
    let origin = path.display().to_string();
    let folder = Folder::Disk(path.parent().unwrap_or(Path::new("")).to_owned());
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("toml")) {
        let scene = wrap::around_mesh(path)?;
        return Ok(Found::Scene(Box::new(ReadScene { scene, text: String::new(), origin, folder })));
    }
    let cure = "give the path of a scene or a case (.toml), or of a mesh";
    let text = bounded::text(path, MAX_SCENE_BYTES as u64).map_err(|why| unusable(path, why, "", cure).at(&origin))?;
    if case::is_case(&text) {
        return Ok(Found::Case(text));
    }
    Ok(Found::Scene(Box::new(ReadScene { scene: Scene::parse(&text, &origin)?, text, origin, folder })))
}

fn assemble(scene: Scene, origin: &str, folder: &Folder, seats: &Seats) -> Result<LoadedScene, SceneError> {
    let mut notes = Vec::new();
    let workspace = workspace(&scene);
    let (placed, drawn) = placed(&scene, folder, seats, &mut notes)?;
    let locators: Vec<Locator> = placed.iter().map(|(mesh, _)| Locator::new(mesh)).collect();
    let meshes: Vec<TetMesh> = placed.iter().map(|(mesh, _)| mesh.clone()).collect();
    let mut objects: Vec<LoadedDeformable> = Vec::new();
    let mut hollow = Vec::new();
    for (index, (mesh, surface)) in placed.into_iter().enumerate() {
        let (mut object, deep) = finish(&scene, index, mesh, surface, &locators[index], &mut notes)?;
        if let Some(host) = host_of(&scene, index) {
            object.attach =
                Some(object::attach(&scene.deformable[index], index, &object.mesh, host, &meshes[host], &locators[host])?);
        }
        notes.extend(parts::notes(&object));
        objects.push(object);
        hollow.push(deep);
    }
    let instruments = scene.rigid.iter().enumerate();
    let rigid: Vec<LoadedRigid> =
        instruments.map(|(index, rigid)| load_rigid(rigid, index, folder, &mut notes)).collect::<Result<_, _>>()?;
    let fluid = fluid(&scene, &objects[0], &hollow[0], workspace.pivot_m);
    let probe = Probe {
        objects: &locators,
        points_m: &rigid[0].points_m,
        electrode: rigid[0].electrode.as_ref(),
        radius_m: rigid[0].radius_m,
        pivot_m: workspace.pivot_m,
        pitch_rad: workspace.pitch_rad,
        yaw_rad: workspace.yaw_rad,
        roll_rad: workspace.roll_rad,
        insertion_m: workspace.insertion_m,
    };
    let (hands, rest) = hands::find(&scene, &objects, &probe, &mut notes);
    let (origin, is_head_free) = (origin.to_owned(), false);
    let mut loaded =
        LoadedScene { scene, origin, objects, rigid, workspace, fluid, hands, rest, hash: 0, notes, drawn, is_head_free };
    loaded.hash = content_hash(&loaded);
    Ok(loaded)
}

/// The objects of a scene in their places, those moved for which a seat was drawn, mirrored where that was drawn, and how they were moved, in words.
pub(crate) fn placed(
    scene: &Scene,
    folder: &Folder,
    seats: &Seats,
    notes: &mut Vec<String>,
) -> Result<(Vec<Placed>, Vec<String>), SceneError> {
    let raw = scene.deformable.iter().enumerate().map(|(index, one)| object::read(one, index, folder));
    let raw: Vec<RawObject> = raw.collect::<Result<_, _>>()?;
    let transforms = transforms(scene, &raw, workspace(scene).pivot_m, notes)?;
    let mut placed = Vec::new();
    for (index, (raw, transform)) in raw.into_iter().zip(&transforms).enumerate() {
        let object = &scene.deformable[index];
        let (mut mesh, surface) = raw.place(object, index, transform, notes)?;
        region::assign(object, index, &mut mesh, notes)?;
        placed.push((mesh, surface));
    }
    let drawn = seated(scene, &seats.of, &mut placed);
    let pivot_m = workspace(scene).pivot_m;
    for (mesh, surface) in &mut placed {
        mirror::tets(mesh, pivot_m, seats.mirrored);
        if let Some((surface, _)) = surface {
            mirror::surface(surface, pivot_m, seats.mirrored);
        }
    }
    for (index, (mesh, _)) in placed.iter().enumerate() {
        object::check_place(&scene.deformable[index], index, mesh)?;
    }
    Ok((placed, drawn))
}

/// Moves the objects for which a seat was drawn; says how.
fn seated(scene: &Scene, seats: &[Option<Seat>], placed: &mut [Placed]) -> Vec<String> {
    let mut drawn = Vec::new();
    for (index, seat) in seats.iter().enumerate() {
        if let (Some(seat), Some(host)) = (seat, host_of(scene, index)) {
            let host = Locator::new(&placed[host].0);
            let (mesh, surface) = &mut placed[index];
            let surface = surface.as_mut().map(|(surface, _)| surface);
            drawn.extend(seat.take(&scene.deformable[index].name, mesh, surface, &host));
        }
    }
    drawn
}

fn host_of(scene: &Scene, index: usize) -> Option<usize> {
    let name = scene.deformable[index].attach_to.as_ref()?;
    scene.deformable.iter().position(|object| object.name == *name)
}

/// One transform per object. Those placed by themselves share one: they come from one frame. An attached one goes with its host.
fn transforms(
    scene: &Scene,
    raw: &[RawObject],
    pivot_m: [f32; 3],
    notes: &mut Vec<String>,
) -> Result<Vec<Transform>, SceneError> {
    let mut shared: Option<Transform> = None;
    let mut transforms = Vec::new();
    for index in 0..scene.deformable.len() {
        // Up the chain of hosts as long as they, too, are placed by themselves; `validate` has shown that the chain ends.
        let mut leader = index;
        while is_auto(&scene.deformable[leader]) {
            let Some(host) = host_of(scene, leader) else {
                break;
            };
            leader = host;
        }
        let transform = if !is_auto(&scene.deformable[leader]) {
            Transform::given(&scene.deformable[leader], 1.0)
        } else if let Some(transform) = shared {
            transform
        } else {
            let (scale, why) = raw[leader].auto_scale();
            let mut transform = Transform::given(&scene.deformable[leader], scale);
            raw[leader].check_size(leader, transform.scale)?;
            let mut mesh = raw[leader].mesh.clone();
            transform.apply(&mut mesh.positions_m);
            transform.translation_m += in_front(&mesh, pivot_m);
            notes.push(format!("{}: {why}; placed in front of the scope", scene.deformable[leader].name));
            shared = Some(transform);
            transform
        };
        raw[index].check_size(index, transform.scale)?;
        transforms.push(transform);
    }
    Ok(transforms)
}

/// Binds the surface and holds the fixed nodes. Returns also the nodes that lie in the object's hollow.
fn finish(
    scene: &Scene,
    index: usize,
    mesh: TetMesh,
    surface: Option<(TriangleMesh, String)>,
    locator: &Locator,
    notes: &mut Vec<String>,
) -> Result<(LoadedDeformable, Vec<usize>), SceneError> {
    let object = &scene.deformable[index];
    let (surface, bindings) = object::bind(&object.name, index, &mesh, surface, notes)?;
    let boundary = hyst_mesh::boundary(&mesh).triangles;
    let mut on_boundary = vec![false; mesh.positions_m.len()];
    for &node in boundary.as_flattened() {
        on_boundary[node as usize] = true;
    }
    let depth = depth_under_hull(&mesh.positions_m);
    let deep = hollow_nodes(&mesh.positions_m, &boundary, locator);
    let is_on_bed = object.region.iter().any(|region| region.bed_n_m4.is_some_and(|bed_n_m4| bed_n_m4 > 0.0));
    let shapes = match (&object.fixed, object.attach_to.is_some() || is_on_bed) {
        (Some(shapes), _) => shapes.clone(),
        (None, true) => Vec::new(),
        (None, false) => default_shapes(!deep.is_empty(), &mesh.positions_m),
    };
    let fixed = fixed_nodes(&shapes, &mesh.positions_m, &depth, &on_boundary);
    let held = fixed.iter().filter(|&&fixed| fixed).count();
    if held == fixed.len() {
        notes.push(format!("{}: every node is fixed, nothing will give way; make `fixed` smaller", object.name));
    } else if held == 0
        && !is_on_bed
        && object.attach_to.is_none()
        && object.fixed.as_ref().is_none_or(|shapes| !shapes.is_empty())
    {
        notes.push(format!("{}: no node is fixed and it is attached to nothing: it will drift; add `fixed`", object.name));
    }
    let loaded = LoadedDeformable {
        name: object.name.clone(),
        kind: object.kind,
        mesh,
        surface,
        bindings,
        fixed,
        material: object.material.clone(),
        regions: region::loaded(object),
        attach: None,
        look: object.look,
        hollow: !deep.is_empty(),
    };
    Ok((loaded, deep))
}

fn workspace(scene: &Scene) -> LoadedWorkspace {
    let limits = &scene.workspace;
    let radians = |degrees: [f64; 2]| degrees.map(|angle| angle.to_radians() as f32);
    LoadedWorkspace {
        pivot_m: limits.pivot_m.map(|coordinate| coordinate as f32),
        pitch_rad: radians(limits.pitch_deg),
        yaw_rad: radians(limits.yaw_deg),
        roll_rad: radians(limits.roll_deg),
        insertion_m: limits.insertion_m.map(|length| length as f32),
    }
}

/// The fluid's figures, with a box around the hollow of the first object, or around the object and the pivot if it has none.
fn fluid(scene: &Scene, organ: &LoadedDeformable, hollow: &[usize], pivot_m: [f32; 3]) -> LoadedFluid {
    let fluid = &scene.fluid;
    let (box_min_m, box_max_m) = match (fluid.box_min_m, fluid.box_max_m) {
        (Some(low), Some(high)) => (low.map(|c| c as f32), high.map(|c| c as f32)),
        _ => {
            let inner: Vec<[f32; 3]> = hollow.iter().map(|&node| organ.mesh.positions_m[node]).collect();
            let (low, high) = if inner.is_empty() {
                let (low, high) = bounds(&organ.mesh.positions_m);
                (low.min(pivot_m.into()), high.max(pivot_m.into()))
            } else {
                bounds(&inner)
            };
            let margin = Vec3::splat((fluid.margin_m as f32).max(1e-4));
            ((low - margin).to_array(), (high + margin).to_array())
        }
    };
    LoadedFluid::new(fluid, &scene.vessels, [box_min_m, box_max_m])
}

fn content_hash(loaded: &LoadedScene) -> u64 {
    let mut hash = Fnv::new();
    // The text's content in a fixed order; a scene's types always serialize.
    hash.bytes(serde_json::to_string(&loaded.scene).unwrap_or_default().as_bytes());
    for object in &loaded.objects {
        hash.floats(&object.mesh.positions_m);
        hash.indices(&object.mesh.tets);
        hash.floats(&object.surface.positions_m);
        hash.indices(&object.surface.triangles);
        for binding in &object.bindings {
            hash.bytes(&binding.tet.to_le_bytes());
            hash.floats(&[binding.weights]);
        }
        if !object.regions.is_empty() {
            object.mesh.regions.iter().for_each(|region| hash.bytes(&region.to_le_bytes()));
        }
        hash.bytes(&object.fixed.iter().map(|&fixed| u8::from(fixed)).collect::<Vec<_>>());
        for node in object.attach.iter().flat_map(|attach| &attach.nodes) {
            hash.indices(&[[node.node, node.tet]]);
            hash.floats(&[node.weights]);
        }
    }
    for rigid in &loaded.rigid {
        hash.floats(&rigid.points_m);
        if let Some(electrode) = &rigid.electrode {
            hash.floats(&electrode.wire_m);
            hash.floats(&[[electrode.wire_radius_m, electrode.reach_m]]);
        }
        for surface in rigid.surface.iter().chain(rigid.jaws.iter().map(|jaws| &jaws.surface)) {
            hash.floats(&surface.positions_m);
            hash.indices(&surface.triangles);
        }
    }
    hash.finish()
}
