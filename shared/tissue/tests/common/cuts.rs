//! What must hold after each cut, and wires to make them.

use super::block;
use glam::{DVec3, Vec3};
use hyst_mesh::{
    Binding, TetMesh, TriangleMesh, bind, boundary, check, component_count, component_of_each_tet, quality, read_tets,
    read_triangles, repair, signed_volume,
};
use hyst_tissue::{CutOptions, CutReport, Cuttable, Skin, cut};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

fn bytes_of(name: &str) -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/meshes").join(name)).unwrap()
}

pub fn shipped(name: &str) -> TetMesh {
    let mut mesh = read_tets(name, &bytes_of(name)).unwrap();
    if check(&mesh).max_m.iter().any(|coordinate| *coordinate > 1.0) {
        mesh.scale_to_m(1e-3);
    }
    repair(mesh).unwrap().mesh
}

pub fn corners(mesh: &TetMesh, tet: &[u32; 4]) -> [DVec3; 4] {
    tet.map(|node| DVec3::from_array(mesh.positions_m[node as usize].map(f64::from)))
}

/// Volume of each tet in m³ and the least quality.
pub fn shape(mesh: &TetMesh) -> (Vec<f64>, f64) {
    let volumes = mesh.tets.iter().map(|tet| signed_volume(corners(mesh, tet))).collect();
    (volumes, mesh.tets.iter().map(|tet| quality(corners(mesh, tet))).fold(1.0, f64::min))
}

/// Volume of each tet where it is now, m³.
pub fn volumes_now(tissue: &Cuttable) -> Vec<f64> {
    let place = |node: u32| DVec3::from_array(tissue.position_m[node as usize].map(f64::from));
    tissue.rest.tets.iter().map(|tet| signed_volume(tet.map(place))).collect()
}

/// Binds a surface.
pub fn dressed(mut tissue: Cuttable, surface: &TriangleMesh) -> Cuttable {
    let (bindings, _) = bind(surface, &tissue.rest).unwrap();
    let raw = vec![false; bindings.len()];
    tissue.skin = Skin { rest_m: surface.positions_m.clone(), triangles: surface.triangles.clone(), bindings, raw };
    tissue
}

/// Under its own boundary.
pub fn in_its_boundary(tissue: Cuttable) -> Cuttable {
    let (surface, _) = boundary(&tissue.rest).to_mesh(&tissue.rest.positions_m);
    dressed(tissue, &surface)
}

/// The default scene's polyp with its finer surface.
pub fn polyp() -> Cuttable {
    let mut surface = read_triangles("polyp-surface.obj", &bytes_of("polyp-surface.obj")).unwrap();
    surface.scale_to_m(1e-3);
    dressed(Cuttable::at_rest(shipped("polyp.msh")), &surface)
}

/// Meshes in one, each with nodes of its own, and with its number for a region.
pub fn joined(meshes: &[TetMesh]) -> TetMesh {
    let mut all = TetMesh::default();
    for (mesh, region) in meshes.iter().zip(0..) {
        let first = all.positions_m.len() as u32;
        all.positions_m.extend(&mesh.positions_m);
        all.tets.extend(mesh.tets.iter().map(|tet| tet.map(|node| node + first)));
        all.regions.extend(vec![region; mesh.tets.len()]);
    }
    all
}

/// Two objects in one tissue, each a region, with nodes and a surface of its own.
pub fn beside(one: &Cuttable, other: &Cuttable) -> Cuttable {
    let [tets, vertices] = [one.rest.tets.len(), one.skin.rest_m.len()].map(|count| count as u32);
    let mut skin = one.skin.clone();
    skin.rest_m.extend(&other.skin.rest_m);
    skin.triangles.extend(other.skin.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + vertices)));
    skin.bindings.extend(other.skin.bindings.iter().map(|binding| Binding { tet: binding.tet + tets, ..*binding }));
    skin.raw.extend(&other.skin.raw);
    Cuttable { skin, ..Cuttable::at_rest(joined(&[one.rest.clone(), other.rest.clone()])) }
}

/// Momentum over the density, m⁴/s: a quarter of each tet belongs to each of its nodes.
pub fn momentum(tissue: &Cuttable) -> DVec3 {
    let (volumes, _) = shape(&tissue.rest);
    let velocity = |node: u32| DVec3::from_array(tissue.velocity_m_s[node as usize].map(f64::from));
    tissue.rest.tets.iter().zip(volumes).map(|(tet, volume)| tet.map(velocity).iter().sum::<DVec3>() * (volume / 4.0)).sum()
}

pub fn parts(mesh: &TetMesh) -> usize {
    component_count(&component_of_each_tet(mesh))
}

/// What must hold after each sweep, whatever it was.
pub fn assert_sound(before: &Cuttable, after: &Cuttable, report: &CutReport, options: &CutOptions) {
    let ((old_volumes, old_quality), (volumes, least_quality)) = (shape(&before.rest), shape(&after.rest));
    let (old, new): (f64, f64) = (old_volumes.iter().sum(), volumes.iter().sum());
    assert!((new + report.burnt_m3 - old).abs() <= 2e-6 * old, "volume {old} became {new}, burnt {}", report.burnt_m3);
    assert!(volumes.iter().all(|volume| *volume > 0.0), "an inverted tet");
    assert!(least_quality >= options.min_quality.min(old_quality) * 0.999, "quality {old_quality} became {least_quality}");
    let nodes = after.rest.positions_m.len();
    for (what, length) in [
        ("position", after.position_m.len()),
        ("velocity", after.velocity_m_s.len()),
        ("fixed", after.fixed.len()),
        ("marks", after.marks.len()),
    ] {
        assert_eq!(length, nodes, "{what}");
    }
    assert!(
        nodes <= options.max_nodes.max(before.rest.positions_m.len())
            && after.rest.tets.len() <= options.max_tets.max(before.rest.tets.len())
    );
    let all = [&after.rest.positions_m, &after.position_m, &after.velocity_m_s, &after.marks];
    assert!(all.into_iter().flatten().flatten().all(|coordinate| coordinate.is_finite()));
    if report.burnt_tets == 0 {
        let (old, new) = (momentum(before), momentum(after));
        assert!(old.distance(new) <= 2e-5 * old.length().max(1e-12), "momentum {old} became {new}");
    }
    let found = check(&after.rest);
    assert_eq!((found.open_edges, found.crowded_faces), (0, 0), "{found}");
    assert_eq!((found.non_manifold_edges, found.non_manifold_vertices), (0, 0), "{report:?}\n{found}");
    assert!(!report.has_changed_mesh() || report.parts == parts(&after.rest), "{report:?}");
    let part_of_tet = if report.has_changed_mesh() { component_of_each_tet(&after.rest) } else { Vec::new() };
    assert_eq!(after.part_of_tet, part_of_tet, "{report:?}");
    assert!(report.has_changed() || before.skin == after.skin, "the surface changed, and nothing says so: {report:?}");
    if !report.has_changed_mesh() {
        assert!(before.rest.tets == after.rest.tets && before.rest.regions == after.rest.regions, "{report:?}");
        // A node that no tet uses may have been tried as a copy of another one.
        for node in before.rest.tets.iter().flatten().map(|node| *node as usize) {
            let of = |tissue: &Cuttable| (tissue.rest.positions_m[node], tissue.position_m[node]);
            assert_eq!(of(before), of(after), "node {node}");
        }
    }
    assert_kinds(before, after, report);
    assert_held(before, after);
    assert_sound_now(before, after, report);
    assert_bound(before, after, options);
}

/// Volume of what is of one region and of one material, m³.
fn kinds_m3(tissue: &Cuttable) -> BTreeMap<(u32, Option<u32>), f64> {
    let mut kinds = BTreeMap::new();
    for (tet, volume) in shape(&tissue.rest).0.into_iter().enumerate() {
        *kinds.entry((tissue.rest.regions[tet], tissue.material.get(tet).copied())).or_insert(0.0) += volume;
    }
    kinds
}

/// What a tet is of and what it is made of goes with its parts: each kind keeps its volume, but for what is burnt.
fn assert_kinds(before: &Cuttable, after: &Cuttable, report: &CutReport) {
    assert_eq!(after.material.len(), if before.material.is_empty() { 0 } else { after.rest.tets.len() });
    let (old, new) = (kinds_m3(before), kinds_m3(after));
    assert!(new.keys().all(|kind| old.contains_key(kind)), "{:?} became {:?}", old.keys(), new.keys());
    let rounding_m3 = 2e-6 * old.values().sum::<f64>();
    for (kind, old_m3) in old {
        let lost_m3 = old_m3 - new.get(&kind).copied().unwrap_or(0.0);
        assert!(
            (-rounding_m3..=report.burnt_m3 + rounding_m3).contains(&lost_m3),
            "{lost_m3} of {old_m3} m³ of {kind:?} are lost: {report:?}"
        );
    }
}

/// A held node stays where it is and as it moves, and so does none that was not; of nodes at one place at rest all are held or none.
fn assert_held(before: &Cuttable, after: &Cuttable) {
    let used = |tissue: &Cuttable| tissue.rest.tets.iter().flatten().map(|node| *node as usize).collect::<BTreeSet<usize>>();
    for node in used(before) {
        assert_eq!(before.fixed[node], after.fixed[node], "node {node}");
        let of = |tissue: &Cuttable| (tissue.rest.positions_m[node], tissue.position_m[node], tissue.velocity_m_s[node]);
        assert!(!before.fixed[node] || of(before) == of(after), "held node {node}: {:?} became {:?}", of(before), of(after));
    }
    let place = |node: usize| (after.rest.positions_m[node].map(f32::to_bits), after.fixed[node]);
    let places: BTreeMap<[u32; 3], bool> = used(after).into_iter().map(place).collect();
    for node in used(after) {
        let (at, is_held) = place(node);
        assert_eq!(places[&at], is_held, "node {node} is held, or not, and another one at its place is not, or is");
    }
}

/// What must hold where the tissue is now, bent as it may be: nodes lie on edges and are moved along edges in both shapes alike. So nothing turns inside out that
/// was not, and what is filled stays as much. (Mass and momentum know the shape at rest alone.)
fn assert_sound_now(before: &Cuttable, after: &Cuttable, report: &CutReport) {
    let (old, new) = (volumes_now(before), volumes_now(after));
    if old.iter().any(|volume| *volume <= 0.0) {
        return;
    }
    assert!(new.iter().all(|volume| *volume > 0.0), "a tet has turned inside out where it is now");
    let (old, new): (f64, f64) = (old.iter().sum(), new.iter().sum());
    let is_kept = if report.burnt_tets == 0 { (new - old).abs() <= 2e-6 * old } else { new <= old * (1.0 + 2e-6) };
    assert!(is_kept, "{old} m³ where it is now became {new}, {} tets burnt", report.burnt_tets);
}

/// The surface for the eye follows tets that are there, from where it was bound to them; none of its triangles joins two parts; it has no more than there is
/// room for.
fn assert_bound(before: &Cuttable, after: &Cuttable, options: &CutOptions) {
    let (skin, tets) = (&after.skin, after.rest.tets.len());
    assert_eq!((skin.bindings.len(), skin.raw.len()), (skin.rest_m.len(), skin.rest_m.len()));
    for binding in &skin.bindings {
        let sum: f32 = binding.weights.iter().sum();
        assert!((binding.tet as usize) < tets && (sum - 1.0).abs() < 1e-3, "{binding:?}, {tets} tets");
    }
    for triangle in &skin.triangles {
        let [a, b, c] = *triangle;
        assert!(a != b && b != c && c != a, "a triangle has a vertex twice");
        assert!(triangle.iter().all(|vertex| (*vertex as usize) < skin.rest_m.len()));
    }
    assert!(
        skin.rest_m.len() <= options.max_vertices.max(before.skin.rest_m.len())
            && skin.triangles.len() <= options.max_triangles.max(before.skin.triangles.len())
    );
    assert_placed(after);
    // A vertex for which there is no room stays one, between two sides, also in later sweeps that find room.
    if options.max_vertices >= CutOptions::default().max_vertices {
        assert_eq!(joining(after), 0, "triangles join two parts");
    }
}

/// Where the tissue is at rest the surface for the eye is where it was bound, also what lies outside of all tets: its weights are those in the tet that is there
/// now.
fn assert_placed(tissue: &Cuttable) {
    let skin = &tissue.skin;
    let placed = skin.place(&tissue.rest.tets, &tissue.rest.positions_m);
    for (vertex, rest) in placed.iter().zip(&skin.rest_m) {
        assert!(Vec3::from(*vertex).distance(Vec3::from(*rest)) < 2e-5, "{vertex:?} is not at {rest:?}");
    }
}

/// How many triangles of the surface for the eye have corners that follow different parts of the tissue.
pub fn joining(tissue: &Cuttable) -> usize {
    let (part, skin) = (component_of_each_tet(&tissue.rest), &tissue.skin);
    let of_vertex = |vertex: u32| part[skin.bindings[vertex as usize].tet as usize];
    let joins = |triangle: &&[u32; 3]| triangle.iter().any(|vertex| of_vertex(*vertex) != of_vertex(triangle[0]));
    skin.triangles.iter().filter(joins).count()
}

/// Sweeps a wire along its places and asserts after each.
pub fn sweep(tissue: &mut Cuttable, places: &[Vec<[f32; 3]>], options: &CutOptions) -> Vec<CutReport> {
    let mut reports = Vec::new();
    for wire in places {
        let before = tissue.clone();
        let report = cut(tissue, wire, options).unwrap();
        assert_sound(&before, tissue, &report, options);
        reports.push(report);
    }
    reports
}

/// A straight wire from `from` to `to` at each of `steps + 1` places along `way`.
pub fn straight(from: Vec3, to: Vec3, way: Vec3, steps: u32) -> Vec<Vec<[f32; 3]>> {
    let at = |step: u32| way * (step as f32 / steps as f32);
    (0..=steps).map(|step| [from, from.lerp(to, 0.5), to].map(|point| (point + at(step)).to_array()).to_vec()).collect()
}

/// A bar of 36 × 12 × 12 mm in tets of 3 mm.
pub fn bar() -> Cuttable {
    Cuttable::at_rest(block([12, 4, 4], 0.003))
}
