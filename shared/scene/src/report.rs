//! What `hystation check` says of a scene or a mesh: what was found, and what will be done about it. Nothing is started.

use crate::case::{self, Brief, Past};
use crate::embedded;
use crate::error::SceneError;
use crate::file::Scene;
use crate::load::{Found, ReadScene, load_or_embedded, read_file};
use crate::loaded::{LoadedDeformable, LoadedScene};
use crate::object::{self, RawObject};
use crate::place::is_auto;
use crate::source::Folder;
use hyst_mesh::Report;
use serde::Serialize;
use std::fmt::{self, Write as _};
use std::path::Path;

/// Seeds of a case that are tried beside its own, from 1 on: a class is given one of them.
const SEEDS: u32 = 12;
/// Most tets of a case whose seeds are tried: each draws and loads all of them.
const MOST_TETS: usize = 10_000;

/// What was found in a scene or a mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckReport {
    /// The file.
    pub origin: String,
    /// Name of the scene.
    pub name: String,
    /// One per deformable object.
    pub objects: Vec<ObjectReport>,
    /// True if the station can run it.
    pub runnable: bool,
    /// Why it cannot, if it cannot: where, what, what to do.
    pub error: Option<String>,
    /// What is assumed, repaired or worth knowing, one sentence each.
    pub notes: Vec<String>,
    /// The hands that can be scripted.
    pub hands: Vec<String>,
    /// Hash of all content, 16 hexadecimal digits; empty if it is not runnable.
    pub hash: String,
    /// The case, if it is one: what its seed has drawn, goals, ends, warnings, scores.
    pub case: Option<Brief>,
}

/// What was found in one object's files, before any repair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectReport {
    /// Its name in the scene.
    pub name: String,
    /// Its mesh file.
    pub mesh: String,
    /// Nodes of the file.
    pub nodes: usize,
    /// Tets of the file.
    pub tets: usize,
    /// Extent of its box, in the file's unit.
    pub extent: [f32; 3],
    /// Unit of the file as guessed from its size: m, cm or mm.
    pub unit_guess: String,
    /// Metres per unit as the scene gives it; none if it is placed by itself.
    pub scale_to_m: Option<f64>,
    /// Tets with a negative volume.
    pub inverted: usize,
    /// Tets of hardly any volume for their size.
    pub flat: usize,
    /// Lowest quality as `hyst_mesh::quality` gives it, 0 to 1.
    pub worst_quality: f64,
    /// Tets that are there twice.
    pub duplicate: usize,
    /// Nodes that no tet uses.
    pub unused_nodes: usize,
    /// Parts that hang apart.
    pub components: usize,
    /// Triangles of the boundary.
    pub boundary_triangles: usize,
    /// Boundary edges with one triangle.
    pub open_edges: usize,
    /// Boundary edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Nodes at which the boundary touches itself.
    pub non_manifold_nodes: usize,
    /// Faces that more than two tets share.
    pub crowded_faces: usize,
    /// Cells that are not tets.
    pub other_volume_cells: usize,
    /// Triangles of the surface file; none if the boundary is drawn.
    pub surface_triangles: Option<usize>,
}

/// Checks a scene or a mesh, the default scene where none is named, without starting anything. What cannot be read or not be run is a report
/// with `runnable == false` and the reason.
pub fn check(path: Option<&Path>) -> CheckReport {
    check_drawn(path, None)
}

/// The same, of a case with the anatomy of another seed than its own; of a scene, which has none, that changes nothing.
pub fn check_drawn(path: Option<&Path>, seed: Option<u32>) -> CheckReport {
    let origin = path.map_or(embedded::DEFAULT_ORIGIN.to_owned(), |path| path.display().to_string());
    let mut report = CheckReport {
        origin,
        name: String::new(),
        objects: Vec::new(),
        runnable: false,
        error: None,
        notes: Vec::new(),
        hands: Vec::new(),
        hash: String::new(),
        case: None,
    };
    if let Err(error) = find(path, seed, &mut report) {
        report.refuse(error.to_string());
    }
    report
}

fn find(path: Option<&Path>, seed: Option<u32>, report: &mut CheckReport) -> Result<(), SceneError> {
    let embedded = || -> Result<ReadScene, SceneError> {
        let (text, origin) = (embedded::DEFAULT_SCENE.to_owned(), report.origin.clone());
        Ok(ReadScene { scene: Scene::embedded_default()?, text, origin, folder: Folder::Embedded })
    };
    let mut case = None;
    let read = match path.map(read_file).transpose()? {
        None => embedded()?,
        Some(Found::Scene(read)) => *read,
        Some(Found::Case(text)) => {
            let (found, read) = case::read_case(&text, path.unwrap_or(Path::new("")), Past::New)?;
            case = Some(found);
            read
        }
    };
    report.name.clone_from(case.as_ref().map_or(&read.scene.name, |case| &case.name));
    for (index, deformable) in read.scene.deformable.iter().enumerate() {
        let raw = object::read(deformable, index, &read.folder).map_err(|error| error.located(&read.origin, &read.text))?;
        let scale_to_m = if is_auto(deformable) { None } else { Some(deformable.scale_to_m.unwrap_or(1.0)) };
        report.objects.push(object_report(&deformable.name, scale_to_m, &raw));
    }
    let settled = match (case, path) {
        (Some(_), Some(path)) => case::find_case(path, seed)?,
        _ => None,
    };
    match settled {
        Some(settled) => {
            report.notes.extend(settled.brief.doubts());
            let is_small = report.objects.iter().map(|object| object.tets).sum::<usize>() <= MOST_TETS;
            report.notes.extend(path.filter(|_| is_small).and_then(refused_seeds));
            report.case = Some(settled.brief);
            fill(report, settled.scene);
        }
        None => fill(report, load_or_embedded(path)?),
    }
    Ok(())
}

/// With which seeds a case would be refused, and why with the first of them: what is drawn with another seed than its own may be out of reach, or too small.
fn refused_seeds(path: &Path) -> Option<String> {
    let refused = |seed: u32| Some((seed, case::find_case(path, Some(seed)).err()?));
    let refused: Vec<(u32, SceneError)> = (1..=SEEDS).filter_map(refused).collect();
    let (first, error) = refused.first()?;
    let seeds: Vec<String> = refused.iter().map(|(seed, _)| seed.to_string()).collect();
    Some(format!("of the seeds 1 to {SEEDS} it is refused with {}; with {first}: {error}", seeds.join(", ")))
}

fn fill(report: &mut CheckReport, loaded: LoadedScene) {
    report.runnable = true;
    report.hash = format!("{:016x}", loaded.hash);
    for object in &loaded.objects {
        let held = object.fixed.iter().filter(|&&fixed| fixed).count();
        let rooted = object.attach.as_ref().map_or(0, |attach| attach.nodes.len());
        let form = if object.hollow { "hollow" } else { "solid" };
        let line = format!(
            "{}: {form}, {} nodes, {held} held, {rooted} rooted in another object, {} tet{}, drawn as {} triangles",
            object.name,
            object.mesh.positions_m.len(),
            object.mesh.tets.len(),
            if object.mesh.tets.len() == 1 { "" } else { "s" },
            object.surface.triangles.len()
        );
        report.notes.push(line);
        report.notes.extend(region_lines(object));
    }
    report.notes.extend(loaded.notes);
    report.hands = loaded.hands.into_iter().map(|hand| hand.name).collect();
}

/// What the regions of an object are, one sentence each.
fn region_lines(object: &LoadedDeformable) -> impl Iterator<Item = String> + '_ {
    (1u32..).zip(&object.regions).map(move |(number, region)| {
        let tets = object.mesh.regions.iter().filter(|of| **of == number).count();
        let modulus_kpa = 1e-3 * region.material.youngs_modulus_pa;
        let bed = if region.bed_n_m4 > 0.0 { format!(", on a bed of {:.2e} N/m⁴", region.bed_n_m4) } else { String::new() };
        format!("{}: “{}” is {tets} of its tets, of {modulus_kpa:.1} kPa{bed}", object.name, region.name)
    })
}

fn object_report(name: &str, scale_to_m: Option<f64>, raw: &RawObject) -> ObjectReport {
    let found: &Report = &raw.report;
    ObjectReport {
        name: name.to_owned(),
        mesh: raw.mesh_name.clone(),
        nodes: found.nodes,
        tets: found.tets,
        extent: std::array::from_fn(|axis| found.max_m[axis] - found.min_m[axis]),
        unit_guess: raw.unit().symbol().to_owned(),
        scale_to_m,
        inverted: found.inverted.len(),
        flat: found.flat.len(),
        worst_quality: found.worst.map_or(0.0, |(_, quality)| quality),
        duplicate: found.duplicate.len(),
        unused_nodes: found.unused_nodes.len(),
        components: found.components,
        boundary_triangles: found.boundary_triangles,
        open_edges: found.open_edges,
        non_manifold_edges: found.non_manifold_edges,
        non_manifold_nodes: found.non_manifold_vertices,
        crowded_faces: found.crowded_faces,
        other_volume_cells: raw.other_volume_cells,
        surface_triangles: raw.surface.as_ref().map(|(surface, _)| surface.triangles.len()),
    }
}

impl ObjectReport {
    /// Every fault with its count and what is done about it; faults that are not there are left out.
    fn faults(&self) -> Vec<(usize, &'static str, &'static str, &'static str)> {
        let all = [
            (self.inverted, "inverted tet", "inverted tets", "turned round when loaded"),
            (
                self.flat,
                "flat tet",
                "flat tets",
                "dropped if they have no volume that a model could use, else kept, and softened as far as the step asks for it",
            ),
            (self.duplicate, "tet that is there twice", "tets that are there twice", "dropped"),
            (self.unused_nodes, "node that no tet uses", "nodes that no tet uses", "dropped"),
            (
                self.components.saturating_sub(1),
                "part beside the first, hanging apart",
                "parts beside the first, hanging apart",
                "one with it where whole faces touch, else each an object of its own, if the repair leaves it; what holds them is said below",
            ),
            (self.open_edges, "open boundary edge", "open boundary edges", "closed: tets that lie in others there are dropped"),
            (
                self.non_manifold_edges,
                "boundary edge of more than two triangles",
                "boundary edges of more than two triangles",
                "kept; cutting there may be refused",
            ),
            (
                self.non_manifold_nodes,
                "node at which the boundary touches itself",
                "nodes at which the boundary touches itself",
                "kept; cutting there may be refused",
            ),
            (
                self.crowded_faces,
                "face of more than two tets",
                "faces of more than two tets",
                "of those on one side one is kept, where they are few; with many the mesh is refused",
            ),
            (
                self.other_volume_cells,
                "cell that is not a tet",
                "cells that are not tets",
                "passed over; convert them to tets if the mesh has holes now",
            ),
        ];
        all.into_iter().filter(|(count, ..)| *count > 0).collect()
    }
}

impl fmt::Display for ObjectReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{} ({})", self.name, self.mesh)?;
        writeln!(out, "  nodes {}, tets {}, boundary triangles {}", self.nodes, self.tets, self.boundary_triangles)?;
        let [x, y, z] = self.extent;
        let by_size = || format!("by its size the unit is {}; placed by itself", self.unit_guess);
        let unit = self.scale_to_m.map_or_else(by_size, |scale| format!("of {scale} m, as the scene says"));
        writeln!(out, "  size {x:.4} × {y:.4} × {z:.4} units {unit}")?;
        writeln!(out, "  worst quality {:.2e} (1 is a regular tet)", self.worst_quality)?;
        match self.surface_triangles {
            Some(triangles) => writeln!(out, "  surface of {triangles} triangles")?,
            None => writeln!(out, "  no surface file: the boundary is drawn")?,
        }
        let faults = self.faults();
        if faults.is_empty() {
            writeln!(out, "  sound: no inverted or flat tet, no unused node, the boundary is closed and manifold")?;
        }
        for (count, one, many, cure) in faults {
            writeln!(out, "  {count} {}: {cure}", if count == 1 { one } else { many })?;
        }
        Ok(())
    }
}

impl CheckReport {
    /// The scene was read, and somebody who would have to run it cannot.
    pub fn refuse(&mut self, error: String) {
        self.runnable = false;
        self.error = Some(error);
        self.hash.clear();
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = if self.name.is_empty() { String::new() } else { format!(": “{}”", self.name) };
        writeln!(out, "{}{name}", self.origin)?;
        for object in &self.objects {
            write!(out, "{object}")?;
        }
        if let Some(case) = &self.case {
            write!(out, "{case}")?;
        }
        for note in &self.notes {
            writeln!(out, "- {note}")?;
        }
        match &self.error {
            Some(error) => writeln!(out, "cannot be run: {error}"),
            None => {
                let mut hands = String::new();
                self.hands.iter().try_for_each(|hand| write!(hands, " {hand}"))?;
                writeln!(out, "can be run; scripted hands:{hands} idle; content {}", self.hash)
            }
        }
    }
}
