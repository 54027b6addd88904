//! One deformable object: read, checked, repaired, placed, bound.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Deformable;
use crate::loaded::{Attach, AttachedNode};
use crate::locate::{Locator, bounds};
use crate::parts::{self, LEAST_PART_M3, MAX_PARTS};
use crate::place::Transform;
use crate::region;
use crate::source::Folder;
use hyst_mesh::{BindError, Binding, Format, ORGAN_SIZE_M, Place, Report, TetFile, TetMesh, TriangleMesh, Unit, guess_unit};

/// Most tets of one object: some fifty times what a step of 1 ms takes.
pub const MAX_TETS: usize = 200_000;
/// Most triangles of one surface.
pub const MAX_TRIANGLES: usize = 2_000_000;
/// Largest and smallest extent of an organ.
const MAX_EXTENT_M: f32 = 1.0;
const MIN_EXTENT_M: f32 = 0.001;
/// Farthest that a node is from the scene's origin along an axis, m: twice the largest organ. The tissue's states end at 10 m, and what lies near that is left
/// no room to move.
const FARTHEST_M: f32 = 2.0;
/// An organ placed by itself keeps its guessed unit if its extent is then within these; else it is scaled to the middle one.
const AUTO_EXTENT_M: [f32; 3] = [0.03, 0.1, 0.35];
/// A surface vertex may lie this share of the object's extent outside its tets; further out it belongs to another mesh.
const MAX_OUTSIDE_SHARE: f32 = 0.15;
/// From this share on the distance is worth a note.
const NOTED_OUTSIDE_SHARE: f32 = 0.05;

/// An object as its files give it, in the files' unit and frame.
pub(crate) struct RawObject {
    pub(crate) mesh: TetMesh,
    pub(crate) mesh_name: String,
    pub(crate) surface: Option<(TriangleMesh, String)>,
    pub(crate) report: Report,
    pub(crate) other_volume_cells: usize,
    pub(crate) shared_numbers: Vec<(u32, Place)>,
}

/// Why a mesh cannot be read, at a key.
pub(crate) fn unreadable(error: &hyst_mesh::ReadError, key: &str, name: &str) -> SceneError {
    let what = format!("{}: found {}, expected {}", error.place, error.found, error.expected);
    SceneError::new(Kind::Mesh, key, what, error.cure.clone()).at(name)
}

/// Reads the object's files. Nothing is changed yet.
pub(crate) fn read(object: &Deformable, index: usize, folder: &Folder) -> Result<RawObject, SceneError> {
    let key = format!("deformable[{index}].mesh");
    let (file, mesh_name) = read_volume(&key, &object.mesh, folder)?;
    let TetFile { mesh, other_volume_cells, shared_numbers, .. } = file;
    region::refuse_shared(object, index, &shared_numbers)?;
    if mesh.tets.len() > MAX_TETS {
        let what = format!("has {} tets, at most {MAX_TETS} are simulated", mesh.tets.len());
        return Err(
            SceneError::new(Kind::TooLarge, key, what, "make it coarser, for example with gmsh or fTetWild").at(&mesh_name)
        );
    }
    let surface = match &object.surface {
        None => None,
        Some(name) => {
            let key = format!("deformable[{index}].surface");
            let (bytes, shown) = folder.mesh(&key, name)?;
            let surface = hyst_mesh::read_triangles(&shown, &bytes).map_err(|error| unreadable(&error, &key, &shown))?;
            if surface.triangles.len() > MAX_TRIANGLES {
                let what = format!("has {} triangles, at most {MAX_TRIANGLES} are drawn", surface.triangles.len());
                return Err(SceneError::new(Kind::TooLarge, key, what, "make it coarser").at(&shown));
            }
            Some((surface, shown))
        }
    };
    let report = hyst_mesh::check(&mesh);
    Ok(RawObject { mesh, mesh_name, surface, report, other_volume_cells, shared_numbers })
}

/// Reads tets, from two files where the format has two. Returns also the name to speak of them by.
fn read_volume(key: &str, name: &str, folder: &Folder) -> Result<(TetFile, String), SceneError> {
    let (bytes, shown) = folder.mesh(key, name)?;
    if let Some(companion) = hyst_mesh::companion_name(name) {
        let (other, _) = folder.mesh(key, &companion)?;
        let (node, ele) = if name.to_ascii_lowercase().ends_with(".node") { (bytes, other) } else { (other, bytes) };
        let mesh = hyst_mesh::read_tetgen(&node, &ele).map_err(|error| unreadable(&error, key, &shown))?;
        return Ok((TetFile { mesh, format: Format::Tetgen, other_volume_cells: 0, shared_numbers: Vec::new() }, shown));
    }
    let file = hyst_mesh::read_tet_file(&shown, &bytes).map_err(|error| unreadable(&error, key, &shown))?;
    Ok((file, shown))
}

impl RawObject {
    /// The largest extent of the nodes that tets use, in the file's unit: a stray node must not decide about the scale.
    pub(crate) fn extent(&self) -> f32 {
        let used: Vec<[f32; 3]> =
            self.mesh.tets.as_flattened().iter().map(|&node| self.mesh.positions_m[node as usize]).collect();
        let (low, high) = bounds(&used);
        (high - low).max_element()
    }

    /// The unit of the file as guessed from that extent.
    pub(crate) fn unit(&self) -> Unit {
        guess_unit(self.extent(), ORGAN_SIZE_M)
    }

    /// The scale of an object placed by itself, and why.
    pub(crate) fn auto_scale(&self) -> (f64, String) {
        let (extent, unit) = (self.extent(), self.unit());
        let metres = extent * unit.metres();
        if (AUTO_EXTENT_M[0]..=AUTO_EXTENT_M[2]).contains(&metres) {
            (f64::from(unit.metres()), format!("by its size the file is in {}", unit.symbol()))
        } else {
            let scale = f64::from(AUTO_EXTENT_M[1]) / f64::from(extent.max(f32::MIN_POSITIVE));
            (scale, format!("in no unit it has the size of an organ, so it is scaled to {} m", AUTO_EXTENT_M[1]))
        }
    }

    /// Refuses what is no organ in size.
    pub(crate) fn check_size(&self, index: usize, scale: f32) -> Result<(), SceneError> {
        let extent_m = self.extent() * scale;
        if (MIN_EXTENT_M..=MAX_EXTENT_M).contains(&extent_m) {
            return Ok(());
        }
        let what = format!("is {extent_m:.3e} m long, allowed is {MIN_EXTENT_M} to {MAX_EXTENT_M} m");
        let cure = format!("by its size the file is in {}: set scale_to_m = {}", self.unit().symbol(), self.unit().metres());
        let key = format!("deformable[{index}].scale_to_m");
        Err(SceneError::new(Kind::Size, key, what, cure).at(&self.mesh_name))
    }

    /// Places and repairs the object. Returns its tets and its own surface in the scene's frame; what was done goes to the notes.
    pub(crate) fn place(
        mut self,
        object: &Deformable,
        index: usize,
        transform: &Transform,
        notes: &mut Vec<String>,
    ) -> Result<(TetMesh, Option<(TriangleMesh, String)>), SceneError> {
        transform.apply(&mut self.mesh.positions_m);
        if self.other_volume_cells > 0 {
            notes.push(format!("{}: {} cells that are not tets were passed over", object.name, self.other_volume_cells));
        }
        if let Some((number, place)) = self.shared_numbers.first() {
            let (name, more) = (&object.name, if self.shared_numbers.len() > 1 { ", and so do others" } else { "" });
            notes.push(format!(
                "{name}: a physical group and a volume in none have the number {number} both ({place}){more}; no region can be chosen by it"
            ));
        }
        let repaired = hyst_mesh::repair(self.mesh).map_err(|error| {
            SceneError::new(Kind::BadMesh, format!("deformable[{index}].mesh"), "cannot be repaired", error.to_string())
                .at(&self.mesh_name)
        })?;
        notes.extend(repaired.repairs.iter().map(|repair| format!("{}: {repair}", object.name)));
        let (mesh, crumbs) = parts::without_crumbs(repaired.mesh).map_err(|parts| {
            let what = format!("has {parts} parts that hang apart, at most {MAX_PARTS} are told apart");
            let cure = "give parts whose faces fit each other, or leave small ones out";
            SceneError::new(Kind::BadMesh, format!("deformable[{index}].mesh"), what, cure).at(&self.mesh_name)
        })?;
        if crumbs > 0 {
            let (s, mm3) = (if crumbs == 1 { "" } else { "s" }, 1e9 * LEAST_PART_M3);
            notes.push(format!("{}: dropped {crumbs} part{s} of less than {mm3:.1} mm³ that hung apart", object.name));
        }
        let touches = touches(&self.report, &mesh);
        if touches > 0 {
            notes.push(format!("{}: the boundary touches itself at {touches} places; it is simulated as it is", object.name));
        }
        if let Some((surface, _)) = &mut self.surface {
            transform.apply(&mut surface.positions_m);
        }
        Ok((mesh, self.surface))
    }
}

/// At how many places the boundary of a mesh touches itself once it is repaired: where tets lay in each other it does so no more.
fn touches(before: &Report, repaired: &TetMesh) -> usize {
    let at = |found: &Report| found.non_manifold_edges + found.non_manifold_vertices;
    // A second look takes as long as the first one: only where that has found something.
    let is_changed = before.crowded_faces + before.duplicate.len() + before.flat.len() > 0;
    if is_changed || at(before) > 0 { at(&hyst_mesh::check(repaired)) } else { 0 }
}

/// Refuses what lies so far from the scene's origin that its nodes would have no room to move.
pub(crate) fn check_place(object: &Deformable, index: usize, mesh: &TetMesh) -> Result<(), SceneError> {
    let is_far = |place_m: &&[f32; 3]| place_m.iter().any(|coordinate_m| coordinate_m.abs() > FARTHEST_M);
    let Some([x, y, z]) = mesh.positions_m.iter().find(is_far) else { return Ok(()) };
    let what = format!(
        "“{}” ({}) has a node at [{x:.3}, {y:.3}, {z:.3}] m, allowed is -{FARTHEST_M} to {FARTHEST_M} m along each axis",
        object.name, object.mesh
    );
    let cure = "move it with translate_m to the scene's origin, and workspace.pivot_m, too";
    Err(SceneError::new(Kind::Range, format!("deformable[{index}].translate_m"), what, cure))
}

/// Binds the surface, or the boundary of each part where there is none.
pub(crate) fn bind(
    name: &str,
    index: usize,
    mesh: &TetMesh,
    surface: Option<(TriangleMesh, String)>,
    notes: &mut Vec<String>,
) -> Result<(TriangleMesh, Vec<Binding>), SceneError> {
    let key = format!("deformable[{index}].surface");
    let failed = |what: String, cure: &str, origin: &str| SceneError::new(Kind::Apart, key.clone(), what, cure).at(origin);
    let unbound = |error: BindError, origin: &str| failed("cannot be bound".to_owned(), &error.to_string(), origin);
    let Some((surface, origin)) = surface else {
        return parts::bind_boundary(mesh).map_err(|error| unbound(error, ""));
    };
    let (bindings, report) = hyst_mesh::bind(&surface, mesh).map_err(|error| unbound(error, &origin))?;
    let open = hyst_mesh::open_edges(&surface.triangles);
    if open > 0 {
        notes.push(format!(
            "{name}: the surface is not closed, {open} of its edges have one triangle only; if it was cut short, export it again"
        ));
    }
    let (low, high) = bounds(&mesh.positions_m);
    let share = report.max_outside_m / (high - low).max_element().max(f32::MIN_POSITIVE);
    let far = format!("vertex {} is {:.2} mm away from its tets", report.farthest_vertex, 1e3 * report.max_outside_m);
    if share > MAX_OUTSIDE_SHARE {
        let cure = "give the surface that belongs to this mesh, in the same unit and frame, or none to draw the boundary";
        return Err(failed(format!("{far}, {:.0} % of the organ's size", 100.0 * share), cure, &origin));
    }
    if share > NOTED_OUTSIDE_SHARE {
        notes.push(format!("{name}: {} surface vertices lie outside the tets; {far}", report.outside));
    }
    Ok((surface, bindings))
}

/// Which nodes of an attached object lie in its host.
pub(crate) fn attach(
    object: &Deformable,
    index: usize,
    mesh: &TetMesh,
    host: usize,
    host_mesh: &TetMesh,
    locator: &Locator,
) -> Result<Attach, SceneError> {
    let root = |(node, &point): (usize, &[f32; 3])| {
        locator.find(point).map(|(tet, weights)| AttachedNode { node: node as u32, tet, weights })
    };
    let nodes: Vec<AttachedNode> = mesh.positions_m.iter().enumerate().filter_map(root).collect();
    if nodes.is_empty() {
        let ((low, high), (host_low, host_high)) = (bounds(&mesh.positions_m), bounds(&host_mesh.positions_m));
        let what = format!(
            "no node of “{}” (from {low:.3} to {high:.3} m) lies in a tet of its host (from {host_low:.3} to {host_high:.3} m)",
            object.name
        );
        let cure = "move it with translate_m so that its root is inside the host's wall, or remove attach_to";
        return Err(SceneError::new(Kind::Apart, format!("deformable[{index}].attach_to"), what, cure));
    }
    Ok(Attach { host, nodes })
}
