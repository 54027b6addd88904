//! Somebody else's organs: files that end in the middle are refused with one error, and the same organ in other formats and units, with a
//! surface or without, is run and felt.

use station_tests::{Folder, Station, hystation, run, wait_for};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The scripted hand touches the tissue once in each round of 2 s.
const TOUCH_LIMIT: Duration = Duration::from_secs(60);

/// The uterus of the default scene, read from its file: nodes in mm, tets.
struct Organ {
    nodes_mm: Vec<[f64; 3]>,
    tets: Vec<[usize; 4]>,
}

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/meshes")
}

fn organ() -> Organ {
    let text = std::fs::read_to_string(assets().join("uterus.msh")).unwrap();
    let section = |name: &'static str| {
        let begun = text.lines().skip_while(move |line| line.strip_prefix('$') != Some(name)).skip(2);
        begun.take_while(|line| !line.starts_with("$End")).map(|line| line.split(' ').collect::<Vec<_>>())
    };
    let nodes_mm = section("Nodes").map(|words| std::array::from_fn(|axis| words[axis + 1].parse().unwrap())).collect();
    let tets = section("Elements").filter(|words| words[1] == "4");
    let corner = |words: &[&str], at: usize| words[words.len() - 4 + at].parse::<usize>().unwrap() - 1;
    Organ { nodes_mm, tets: tets.map(|words| std::array::from_fn(|at| corner(&words, at))).collect() }
}

/// Gmsh 4.1, in mm.
fn gmsh_41(organ: &Organ) -> String {
    let (nodes, tets) = (organ.nodes_mm.len(), organ.tets.len());
    let mut text = String::from("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n");
    write!(text, "$Nodes\n1 {nodes} 1 {nodes}\n3 1 0 {nodes}\n").unwrap();
    (1..=nodes).for_each(|tag| writeln!(text, "{tag}").unwrap());
    organ.nodes_mm.iter().for_each(|[x, y, z]| writeln!(text, "{x} {y} {z}").unwrap());
    write!(text, "$EndNodes\n$Elements\n1 {tets} 1 {tets}\n3 1 4 {tets}\n").unwrap();
    for (at, [a, b, c, d]) in organ.tets.iter().enumerate() {
        writeln!(text, "{} {} {} {} {}", at + 1, a + 1, b + 1, c + 1, d + 1).unwrap();
    }
    text + "$EndElements\n"
}

/// VTK XML, in mm.
fn vtu(organ: &Organ) -> String {
    let (nodes, tets) = (organ.nodes_mm.len(), organ.tets.len());
    let array = |kind: &str, name: &str, more: &str, values: String| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" {more} format=\"ascii\">\n{values}\n</DataArray>\n")
    };
    let points = organ.nodes_mm.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let corners = organ.tets.iter().map(|[a, b, c, d]| format!("{a} {b} {c} {d}\n")).collect();
    let offsets = (1..=tets).map(|at| format!("{} ", 4 * at)).collect();
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n<UnstructuredGrid>\n\
         <Piece NumberOfPoints=\"{nodes}\" NumberOfCells=\"{tets}\">\n<Points>\n{}</Points>\n<Cells>\n{}{}{}</Cells>\n</Piece>\n\
         </UnstructuredGrid>\n</VTKFile>\n",
        array("Float32", "Points", "NumberOfComponents=\"3\"", points),
        array("Int64", "connectivity", "", corners),
        array("Int64", "offsets", "", offsets),
        array("UInt8", "types", "", "10 ".repeat(tets)),
    )
}

/// The same organ with every 300th tet split at a node that nearly lies in one of its faces, as some mesh generators leave it.
fn with_flat_tets(organ: &Organ) -> Organ {
    let (mut nodes_mm, mut tets) = (organ.nodes_mm.clone(), organ.tets.clone());
    for tet in (0..organ.tets.len()).step_by(300) {
        let corners = tets[tet];
        let [a, b, c, d] = corners.map(|node| nodes_mm[node]);
        let node = nodes_mm.len();
        nodes_mm.push(std::array::from_fn(|axis| 0.9999 * (a[axis] + b[axis] + c[axis]) / 3.0 + 0.0001 * d[axis]));
        let part = |corner: usize| std::array::from_fn(|at| if at == corner { node } else { corners[at] });
        tets[tet] = part(0);
        tets.extend([part(1), part(2), part(3)]);
    }
    Organ { nodes_mm, tets }
}

fn scene(mesh: &str, more: &str) -> String {
    format!(
        "version = 1\nname = \"x\"\n[[deformable]]\nname = \"organ\"\nmesh = \"{mesh}\"\n{more}\n[[rigid]]\nname = \"scope\"\n"
    )
}

fn assert_refused(file: &str, must_say: &str) {
    let name = format!("organs-{}", std::process::id());
    let (code, _, said) = run(hystation().args(["--name", &name, "run", file, "--headless", "--for", "1s"]));
    assert_eq!(code, Some(2), "{file}: {said}");
    assert!(said.contains(must_say) && said.lines().count() == 1, "{file} is not one error about {must_say:?}: {said}");
    let left = hyst_exchange::Station::named(&name).unwrap().leftovers();
    assert!(left.is_empty(), "{file} left {left:?}");
}

#[test]
fn a_mesh_or_surface_that_ends_in_the_middle_is_refused() {
    let folder = Folder::new("organs-cut");
    let organ = organ();
    let (vtu, gmsh) = (vtu(&organ), gmsh_41(&organ));
    folder.write("whole.msh", &gmsh);
    for (part, of) in [(1, 4), (2, 4), (3, 4)] {
        assert_refused(&folder.write("cut.vtu", &vtu[..vtu.len() * part / of]), "cut.vtu");
        assert_refused(&folder.write("cut.msh", &gmsh[..gmsh.len() * part / of]), "cut.msh");
    }
    // Cut in the middle of a triangle, or before the last of the vertices that triangles name.
    let surface = std::fs::read_to_string(assets().join("uterus-surface.obj")).unwrap();
    let faces = surface.find("\nf ").unwrap();
    let last = surface.trim_end().rfind(' ').unwrap();
    let few_vertices = format!("{}{}", &surface[..faces / 2], &surface[faces..]);
    for (name, text) in [("cut.obj", &surface[..last]), ("few.obj", &few_vertices), ("none.obj", &surface[..faces])] {
        folder.write(name, text);
        assert_refused(&folder.write("cut.toml", &scene("whole.msh", &format!("surface = \"{name}\""))), name);
    }
}

#[test]
fn tissue_that_no_step_can_bear_is_refused_before_anything_starts() {
    let folder = Folder::new("organs-stiff");
    folder.write("organ.msh", &gmsh_41(&organ()));
    let steel = scene("organ.msh", "material = { youngs_modulus_pa = 5e8 }");
    let file = folder.write("steel.toml", &steel);
    assert_refused(&file, "substeps");
    let (code, text, _) = run(hystation().args(["check", &file]));
    assert!(code == Some(2) && text.contains("cannot be run"), "{text}");
}

fn assert_felt(name: &str, file: &str) {
    let (code, text, said) = run(hystation().args(["check", file]));
    assert_eq!(code, Some(0), "{file}: {said}");
    assert!(!text.is_empty());
    let station = Station::start(name, &[file, "--hand", "script:press"]);
    let felt = wait_for(TOUCH_LIMIT, || Some(station.force_n()).filter(|force_n| *force_n > 0.05));
    assert!(felt.is_some(), "{file}: the hand has felt nothing\n{}", station.said());
    station.kill("tissue", true);
    let felt = wait_for(TOUCH_LIMIT, || Some(station.force_n()).filter(|force_n| *force_n > 0.05));
    assert!(felt.is_some(), "{file}: the hand has felt nothing of the successor\n{}", station.said());
    station.stop().assert_clean();
}

#[test]
fn the_same_organ_is_felt_in_other_formats_units_and_with_a_surface_of_its_own() {
    let folder = Folder::new("organs-felt");
    let organ = organ();
    assert_felt("gmsh", &folder.write("organ.msh", &gmsh_41(&organ)));
    assert_felt("vtu", &folder.write("organ.vtu", &vtu(&organ)));
    let flat = folder.write("flat.vtu", &vtu(&with_flat_tets(&organ)));
    let (_, text, _) = run(hystation().args(["check", &flat]));
    assert!(text.contains("flat tets are made softer"), "{text}");
    assert_felt("flat", &flat);
    let surface = std::fs::read_to_string(assets().join("uterus-surface.obj")).unwrap();
    folder.write("surface.obj", &surface);
    assert_felt("surface", &folder.write("organ.toml", &scene("organ.msh", "surface = \"surface.obj\"")));
}
