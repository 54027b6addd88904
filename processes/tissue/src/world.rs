//! The model of everything that the Main Loop computes: made once from the scene, never changed by a step.

use crate::site::{Extent, ObjectKind, SiteManager};
use crate::tool::Tool;
use hyst_contact::Topology;
use hyst_engine::{Failure, Life, Settings};
use hyst_mesh::{Binding, TetMesh};
use hyst_messages::stream::ScopeRecord;
use hyst_scene::{DeformableKind, LoadedRigid, LoadedScene, Look};
use hyst_tissue::{Attachment, Isa, Material, Model, ModelError, ModelReport, Options, join};
use std::path::Path;

/// Stiffness that contacts and attachments may add up to at a node, N/m: a tip of 20 mm² in [`crate::contacts::STIFFNESS_N_M3`].
pub const CONTACT_STIFFNESS_N_M: f64 = 400.0;
/// Stiffness with which an attached node is held, N/m: an attachment takes up twice its stiffness.
const ATTACHMENT_N_M: f32 = 200.0;
/// Most substeps in a step of 1 ms, tried in this order: fine meshes of stiff tissue need more than what an organ of the size that the station
/// is made for does. The first is taken with which little enough mass has to be added.
const MAX_SUBSTEPS: [u32; 5] = [8, 12, 16, 24, 32];
/// Most mass that may be added, as a share of the tissue's own: a swing takes at most √2 times as long, what the hand feels at rest is the same.
const MAX_ADDED_MASS_RATIO: f64 = 1.0;

/// All objects as one model: objects that hold each other belong together.
pub struct World {
    /// The deformable objects.
    pub model: Model,
    /// Faces and neighbours.
    pub topology: Topology,
    /// Object of each tet.
    pub tet_owner: Vec<u32>,
    /// What holds a pathology in its host.
    pub attachments: Vec<Attachment>,
    /// Triangles of the cavity's wall: boundary triangles of hollow organs without fixed nodes.
    pub wall: Vec<[u32; 3]>,
    /// Surfaces for the eye, one behind the other: tet and weights of each vertex.
    pub bindings: Vec<Binding>,
    /// Their triangles, in the numbering of all vertices.
    pub triangles: Vec<[u32; 3]>,
    /// The instrument.
    pub tool: Tool,
    /// The register.
    pub site: SiteManager,
    /// How each deformable object looks, where the scene says so.
    pub looks: Vec<Option<Look>>,
    /// How the instrument sees, and what is drawn of it.
    pub scope: ScopeRecord,
    /// Mean edge of the tets: the cell of the spatial hash, m.
    pub cell_m: f32,
    /// Where the hand rests at first.
    pub rest: hyst_scene::Pose,
    /// The pivot of the hand, m.
    pub pivot_m: [f32; 3],
    /// What making the model took, one sentence each.
    pub notes: Vec<String>,
    /// Pressure at which the organ has its rest shape, Pa.
    pub rest_pressure_pa: f32,
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

impl World {
    /// Loads the settings' scene and makes the model.
    pub fn load(life: &Life) -> Result<World, Failure> {
        let scene = load_scene(life.settings.scene.as_deref())?;
        life.admit_scene(scene.hash)?;
        for note in &scene.notes {
            life.say(note);
        }
        let world = World::of(&scene, isa(&life.settings)?)?;
        for note in &world.notes {
            life.say(note);
        }
        Ok(world)
    }

    /// Makes the model of a scene.
    pub fn of(scene: &LoadedScene, isa: Isa) -> Result<World, Failure> {
        let input = |text: String| Failure::Input(text);
        let meshes: Vec<_> = scene.objects.iter().map(|object| &object.mesh).collect();
        let (mut mesh, starts) = join(&meshes).ok_or_else(|| input("the scene has too many nodes".into()))?;
        let mut tet_owner = Vec::with_capacity(mesh.tets.len());
        for (index, object) in scene.objects.iter().enumerate() {
            tet_owner.extend(std::iter::repeat_n(index as u32, object.mesh.tets.len()));
        }
        mesh.regions.clone_from(&tet_owner);
        let fixed: Vec<bool> = scene.objects.iter().flat_map(|object| object.fixed.iter().copied()).collect();
        let materials = materials(scene)?;
        let (model, report) = model(&mesh, &fixed, &materials, isa).map_err(|error| input(error.to_string()))?;
        let topology = Topology::new(&mesh.tets, &tet_owner, &mesh.positions_m).map_err(|error| input(error.to_string()))?;
        let hollow = |owner: u32| scene.objects.get(owner as usize).is_some_and(|object| object.hollow);
        let is_wall = |(triangle, owner): (&[u32; 3], &u32)| hollow(*owner) && triangle.iter().all(|node| !fixed[*node as usize]);
        let wall = topology
            .boundary
            .iter()
            .zip(&topology.boundary_owner)
            .filter(|pair| is_wall((pair.0, pair.1)))
            .map(|pair| *pair.0)
            .collect();
        let (bindings, triangles, site) = surfaces(scene)?;
        let rigid = scene.rigid.first().ok_or_else(|| input("the scene has no rigid object".into()))?;
        Ok(World {
            attachments: attachments(scene, &starts, &mesh.tets),
            cell_m: mean_edge_m(&mesh.tets, &mesh.positions_m),
            notes: notes(&report),
            model,
            topology,
            tet_owner,
            wall,
            bindings,
            triangles,
            tool: Tool::new(rigid.points_m.clone()),
            site,
            looks: scene.objects.iter().map(|object| object.look).collect(),
            scope: scope(scene, rigid),
            rest: scene.rest,
            pivot_m: scene.workspace.pivot_m,
            rest_pressure_pa: scene.fluid.set_pressure_pa,
        })
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

fn model(mesh: &TetMesh, fixed: &[bool], materials: &[(u32, Material)], isa: Isa) -> Result<(Model, ModelReport), ModelError> {
    let with = |max_substeps| {
        let options = Options {
            max_substeps,
            max_added_mass_ratio: MAX_ADDED_MASS_RATIO,
            contact_stiffness_n_m: CONTACT_STIFFNESS_N_M,
            isa,
            ..Options::default()
        };
        Model::with_materials(mesh, fixed, materials, options)
    };
    let mut last = with(MAX_SUBSTEPS[0]);
    for max_substeps in &MAX_SUBSTEPS[1..] {
        if !matches!(last, Err(ModelError::TooStiff { .. })) {
            break;
        }
        last = with(*max_substeps);
    }
    last
}

fn notes(report: &ModelReport) -> Vec<String> {
    let mut notes =
        vec![format!("a step of 1 ms takes {} substep{}", report.substeps, if report.substeps == 1 { "" } else { "s" })];
    if report.scaled_nodes > 0 {
        let share = 100.0 * report.added_mass_kg / report.mass_kg;
        notes.push(format!("{share:.2} % of the mass is added, at {} nodes, so that the substeps suffice", report.scaled_nodes));
    }
    if report.softened_tets > 0 {
        let share = 1e6 * report.softened_volume_m3 / report.volume_m3;
        notes.push(format!(
            "{} flat tets are made softer so that the substeps suffice; they fill {share:.1} millionths of the volume",
            report.softened_tets
        ));
    }
    notes
}

/// The material of each object; its region is the object's index.
pub fn materials(scene: &LoadedScene) -> Result<Vec<(u32, Material)>, Failure> {
    let made = scene.objects.iter().enumerate().map(|(index, object)| {
        let stuff = &object.material;
        // Plain tets lock above: 6 % too stiff at 0.45, 30 % at 0.49.
        let poisson = stuff.poisson_ratio.min(0.45);
        let material = Material::new(stuff.youngs_modulus_pa, poisson, stuff.density_kg_m3, stuff.damping_per_s);
        material.map(|material| (index as u32, material)).map_err(|error| Failure::Input(format!("{}: {error}", object.name)))
    });
    made.collect()
}

fn attachments(scene: &LoadedScene, starts: &[usize], tets: &[[u32; 4]]) -> Vec<Attachment> {
    let mut first_tet = vec![0usize];
    for object in &scene.objects {
        first_tet.push(first_tet.last().copied().unwrap_or(0) + object.mesh.tets.len());
    }
    let mut all = Vec::new();
    for (index, object) in scene.objects.iter().enumerate() {
        let Some(attach) = &object.attach else { continue };
        for held in &attach.nodes {
            all.push(Attachment {
                node: starts[index] as u32 + held.node,
                tet: tets[first_tet[attach.host] + held.tet as usize],
                weights: held.weights,
                stiffness_n_m: ATTACHMENT_N_M,
            });
        }
    }
    all
}

/// Bindings and triangles of all surfaces, and the register of all objects.
type Surfaces = (Vec<Binding>, Vec<[u32; 3]>, SiteManager);

fn surfaces(scene: &LoadedScene) -> Result<Surfaces, Failure> {
    let (mut bindings, mut triangles, mut site) = (Vec::new(), Vec::new(), SiteManager::default());
    let mut first_tet = 0u32;
    for object in &scene.objects {
        let first_vertex = bindings.len() as u32;
        bindings.extend(object.bindings.iter().map(|binding| Binding { tet: binding.tet + first_tet, ..*binding }));
        triangles.extend(object.surface.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first_vertex)));
        first_tet += object.mesh.tets.len() as u32;
        let kind = match object.kind {
            DeformableKind::Organ => ObjectKind::Organ,
            DeformableKind::Pathology => ObjectKind::Pathology,
        };
        let extent = Extent {
            nodes: object.mesh.positions_m.len(),
            tets: object.mesh.tets.len(),
            vertices: object.bindings.len(),
            triangles: object.surface.triangles.len(),
        };
        let full = || Failure::Input(format!("{}: a scene has at most {} objects", object.name, crate::site::MAX_OBJECTS));
        site.register_object(&object.name, kind, extent).ok_or_else(full)?;
    }
    for rigid in &scene.rigid {
        let extent = Extent::default();
        let full = || Failure::Input(format!("{}: a scene has at most {} objects", rigid.name, crate::site::MAX_OBJECTS));
        site.register_object(&rigid.name, ObjectKind::Tool, extent).ok_or_else(full)?;
    }
    Ok((bindings, triangles, site))
}

fn mean_edge_m(tets: &[[u32; 4]], positions_m: &[[f32; 3]]) -> f32 {
    const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
    let at = |node: u32| glam::Vec3::from(positions_m[node as usize]);
    let length = |tet: &[u32; 4]| EDGES.iter().map(|[a, b]| at(tet[*a]).distance(at(tet[*b]))).sum::<f32>();
    let sum: f32 = tets.iter().map(length).sum();
    (sum / (6 * tets.len().max(1)) as f32).max(1e-5)
}
