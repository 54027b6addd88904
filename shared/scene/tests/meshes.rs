//! Scenes on meshes that nobody made for them: units, faults, surfaces, attachments, and a mesh alone.
#![allow(missing_docs)]

mod folder;

use folder::Folder;
use hyst_scene::{LoadedScene, Pose, SceneError, SceneErrorKind as Kind, check, load};

impl Folder {
    /// Loads a scene of one deformable table and one instrument.
    fn load(&self, deformable: &str) -> Result<LoadedScene, SceneError> {
        self.load_with(deformable, "")
    }

    /// The same with more of the instrument.
    fn load_with(&self, deformable: &str, rigid: &str) -> Result<LoadedScene, SceneError> {
        let text = format!(
            "version = 1\nname = \"t\"\n[[deformable]]\nname = \"organ\"\n{deformable}\n[[rigid]]\nname = \"scope\"\n{rigid}\n"
        );
        load(&self.file("scene.toml", &text))
    }
}

/// A block of n³ cubes of six tets each as Gmsh 2.2, its side `side` units long, moved by `shift` on every axis.
fn block(n: u32, side: f64, shift: f64) -> String {
    let mut nodes = String::new();
    let id = |x: u32, y: u32, z: u32| 1 + x + (n + 1) * (y + (n + 1) * z);
    for z in 0..=n {
        for y in 0..=n {
            for x in 0..=n {
                let at = [x, y, z].map(|i| shift + side * f64::from(i) / f64::from(n));
                nodes += &format!("{} {} {} {}\n", id(x, y, z), at[0], at[1], at[2]);
            }
        }
    }
    let mut tets = String::new();
    let mut count = 0;
    for (x, y, z) in (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| (x, y, z)))) {
        for [i, j] in [[0, 1], [1, 0], [1, 2], [2, 1], [0, 2], [2, 0]] {
            let mut corner = [x, y, z];
            let mut tet = vec![id(x, y, z)];
            for axis in [i, j] {
                corner[axis] += 1;
                tet.push(id(corner[0], corner[1], corner[2]));
            }
            tet.push(id(x + 1, y + 1, z + 1));
            count += 1;
            tets += &format!("{count} 4 2 1 1 {} {} {} {}\n", tet[0], tet[1], tet[2], tet[3]);
        }
    }
    let nodes_count = (n + 1).pow(3);
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes_count}\n{nodes}$EndNodes\n$Elements\n{count}\n{tets}$EndElements\n"
    )
}

fn extent_m(scene: &LoadedScene) -> f32 {
    let z = scene.objects[0].mesh.positions_m.iter().map(|position| position[2]);
    z.clone().fold(f32::MIN, f32::max) - z.fold(f32::MAX, f32::min)
}

#[test]
fn an_organ_in_any_unit_comes_to_lie_before_the_scope_and_the_press_touches_it() {
    let folder = Folder::new("units");
    for (side, expected_m) in [(0.08, 0.08), (8.0, 0.08), (80.0, 0.08), (8e4, 0.1), (1e-5, 0.1)] {
        folder.file("organ.msh", &block(3, side, 17.0 * side));
        let scene = folder.load("mesh = \"organ.msh\"").unwrap_or_else(|error| panic!("{side}: {error}"));
        assert!((extent_m(&scene) / expected_m - 1.0).abs() < 1e-3, "{side}: {} m", extent_m(&scene));
        let press = scene.hand("press").unwrap();
        let tip = |pose: Pose| pose.tip_m(scene.workspace.pivot_m)[2];
        assert!(tip(press.way[0]) < 0.03 && tip(press.way[1]) > 0.03, "{side}: {press:?}");
        assert!(scene.objects[0].fixed.iter().any(|&fixed| fixed) && !scene.objects[0].fixed.iter().all(|&fixed| fixed));
        assert!(scene.notes.iter().any(|note| note.contains("placed in front of the scope")), "{:?}", scene.notes);
    }
}

#[test]
fn a_mesh_alone_is_a_scene() {
    let folder = Folder::new("alone");
    let scene = load(&folder.file("organ.msh", &block(2, 80.0, 0.0))).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.objects.len(), scene.rigid.len()), (1, 1));
    assert!(scene.hand("press").is_some() && scene.hand("explore").is_some());
}

/// The shipped polyp, each other tet of it with another number than it came with, as Gmsh, Medit and TetGen write a mesh.
fn polyp_in_three_formats() -> [(&'static str, String); 4] {
    let shipped = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/meshes/polyp.msh")).unwrap();
    let numbered = |line: &str| match line.split_once(" 4 2 1 1 ") {
        Some((tet, corners)) if tet.parse::<u32>().unwrap().is_multiple_of(2) => format!("{tet} 4 2 2 1 {corners}\n"),
        _ => format!("{line}\n"),
    };
    let gmsh: String = shipped.lines().map(numbered).collect();
    let mesh = hyst_mesh::read_tets("polyp.msh", gmsh.as_bytes()).unwrap();
    let (nodes, tets) = (mesh.positions_m.len(), mesh.tets.len());
    let places = || mesh.positions_m.iter().map(|[x, y, z]| format!("{x} {y} {z}"));
    let cells = |first: u32| {
        let corners = move |tet: &[u32; 4]| tet.map(|node| (node + first).to_string()).join(" ");
        mesh.tets.iter().zip(&mesh.regions).map(move |(tet, number)| format!("{} {number}", corners(tet)))
    };
    let in_lines = |lines: &mut dyn Iterator<Item = String>| lines.map(|line| line + "\n").collect::<String>();
    let counted = |(index, line): (usize, String)| format!("{index:5}    {line}");
    // A triangle beside the tets, as programs write a boundary; counted from 0, as TetGen does unasked.
    let medit = format!(
        "MeshVersionFormatted 2\n\nDimension\n3\n\nVertices\n{nodes}\n{}\n\
         Triangles\n1\n1 2 3 0\n\nTetrahedra\n{tets}\n{}\nEnd\n",
        in_lines(&mut places().map(|place| place + " 0")),
        in_lines(&mut cells(1))
    );
    let node = format!("{nodes}  3  0  0\n{}# the end\n", in_lines(&mut places().enumerate().map(counted)));
    let ele = format!("{tets}  4  1\n{}# the end\n", in_lines(&mut cells(0).enumerate().map(counted)));
    [("polyp.msh", gmsh), ("polyp.mesh", medit), ("polyp.node", node), ("polyp.ele", ele)]
}

#[test]
fn a_shipped_organ_has_the_same_nodes_tets_and_regions_from_other_formats() {
    let folder = Folder::new("same");
    let files = polyp_in_three_formats();
    files.iter().for_each(|(name, content)| drop(folder.file(name, content)));
    let [gmsh, others @ ..] = files.map(|(name, _)| {
        let region = "[[deformable.region]]\nname = \"other\"\ntets = [{ tag = 2 }]\nyoungs_modulus_pa = 66e3";
        let scene = folder.load(&format!("mesh = \"{name}\"\nscale_to_m = 0.001\n{region}"));
        (name, scene.unwrap_or_else(|error| panic!("{name}: {error}")).objects.swap_remove(0).mesh)
    });
    let of_other = gmsh.1.regions.iter().filter(|region| **region == 1).count();
    assert_eq!((gmsh.1.positions_m.len(), gmsh.1.tets.len(), of_other), (84, 206, 103));
    for (name, mesh) in others {
        assert_eq!(mesh, gmsh.1, "{name}");
    }
}

#[test]
fn a_given_place_is_kept_to_the_millimetre() {
    let folder = Folder::new("given");
    folder.file("organ.msh", &block(2, 50.0, 0.0));
    let scene = folder
        .load("mesh = \"organ.msh\"\nscale_to_m = 0.001\nrotate_deg = [0.0, 0.0, 90.0]\ntranslate_m = [0.1, 0.2, 0.3]")
        .unwrap();
    let (low, high) = scene.objects[0].mesh.positions_m.iter().fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
        (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
    });
    for (found, expected) in low.iter().chain(&high).zip([0.05, 0.2, 0.3, 0.1, 0.25, 0.35]) {
        assert!((found - expected).abs() < 1e-6, "{low:?} {high:?}");
    }
}

#[test]
fn a_wrong_scale_is_refused_with_the_right_one() {
    let folder = Folder::new("scale");
    folder.file("organ.msh", &block(2, 80.0, 0.0));
    for scale in ["1.0", "0.000001"] {
        let error = folder.load(&format!("mesh = \"organ.msh\"\nscale_to_m = {scale}")).unwrap_err();
        assert_eq!(error.kind, Kind::Size, "{error}");
        assert!(error.cure.contains("scale_to_m = 0.001"), "{error}");
    }
}

#[test]
fn a_missing_truncated_or_broken_mesh_names_its_file_and_its_cure() {
    let folder = Folder::new("broken");
    let good = block(2, 80.0, 0.0);
    folder.file("short.msh", &good[..good.len() / 2]);
    folder.file("nan.msh", &good.replacen(" 40 ", " nan ", 1));
    folder.file("index.msh", &good.replace("1 4 2 1 1 1 ", "1 4 2 1 1 999 "));
    folder.file("surface.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let cases = [
        ("none.msh", Kind::Missing),
        ("short.msh", Kind::Mesh),
        ("nan.msh", Kind::Mesh),
        ("index.msh", Kind::Mesh),
        ("surface.obj", Kind::Mesh),
    ];
    for (name, kind) in cases {
        let error = folder.load(&format!("mesh = \"{name}\"")).expect_err(name);
        assert_eq!(error.kind, kind, "{error}");
        assert!(error.to_string().contains(name) && !error.cure.is_empty(), "{error}");
    }
    let error = folder.load("mesh = \"builtin:liver.msh\"").unwrap_err();
    assert!(error.to_string().contains("builtin:uterus.msh"), "{error}");
    let error = load(&folder.0).unwrap_err();
    assert_eq!(error.kind, Kind::Missing, "{error}");
}

#[test]
fn an_inverted_tet_and_an_unused_node_are_repaired_and_said_so() {
    let folder = Folder::new("repair");
    let mesh = block(2, 80.0, 0.0)
        .replace("$Nodes\n27\n", "$Nodes\n28\n28 500 500 500\n")
        .replace("1 4 2 1 1 1 2 5 14", "1 4 2 1 1 1 5 2 14");
    let path = folder.file("organ.msh", &mesh);
    let scene = folder.load("mesh = \"organ.msh\"\nscale_to_m = 0.001").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.objects[0].mesh.positions_m.len(), 27);
    assert!(hyst_mesh::check(&scene.objects[0].mesh).is_sound());
    assert!(scene.notes.len() >= 2, "{:?}", scene.notes);
    let report = check(Some(&path));
    let inverted = report.objects[0].inverted;
    assert!(inverted >= 1 && report.objects[0].unused_nodes == 1 && report.runnable, "{report:?}");
    assert!((extent_m(&load(&path).unwrap()) - 0.08).abs() < 1e-6, "the stray node decided about the scale");
    let text = report.to_string();
    for part in ["nodes 28", "tets 48", "the unit is mm", "inverted", "no tet uses", "turned round", "can be run"] {
        assert!(text.contains(part), "no “{part}” in:\n{text}");
    }
    assert!(serde_json::to_value(&report).unwrap()["objects"][0]["tets"] == 48);
}

#[test]
fn a_surface_of_another_mesh_is_refused_and_its_own_is_bound() {
    let folder = Folder::new("surface");
    folder.file("organ.msh", &block(2, 80.0, 0.0));
    let square = |z: f64| format!("v 0 0 {z}\nv 80 0 {z}\nv 80 80 {z}\nv 0 80 {z}\nf 1 2 3\nf 1 3 4\n");
    folder.file("own.obj", &square(80.0));
    folder.file("other.obj", &square(800.0));
    let scene = folder.load("mesh = \"organ.msh\"\nsurface = \"own.obj\"").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.objects[0].surface.triangles.len(), scene.objects[0].bindings.len()), (2, 4));
    let error = folder.load("mesh = \"organ.msh\"\nsurface = \"other.obj\"").unwrap_err();
    assert_eq!(error.kind, Kind::Apart, "{error}");
    assert!(error.to_string().contains("other.obj"), "{error}");
}

#[test]
fn what_is_attached_to_nothing_near_is_refused() {
    let folder = Folder::new("attach");
    folder.file("organ.msh", &block(2, 80.0, 0.0));
    folder.file("knob.msh", &block(1, 10.0, 0.0));
    let knob = |shift_m: f64| {
        let place = format!("scale_to_m = 0.001\ntranslate_m = [0.03, 0.03, {shift_m}]");
        folder.load(&format!("mesh = \"organ.msh\"\nscale_to_m = 0.001\n[[deformable]]\nname = \"knob\"\nmesh = \"knob.msh\"\nattach_to = \"organ\"\n{place}"))
    };
    let scene = knob(-0.005).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.objects[1].attach.as_ref().unwrap().nodes.len(), 4);
    let error = knob(-0.5).unwrap_err();
    assert_eq!((error.kind, error.key.as_str()), (Kind::Apart, "deformable[1].attach_to"), "{error}");
    assert!(error.line_column.is_some(), "{error}");
}

/// Beyond 9.9 m the tissue left no node any room to move, and beyond 10 m nobody took a state of it.
#[test]
fn an_object_far_from_the_origin_is_refused_with_its_place_and_the_bound() {
    let folder = Folder::new("far");
    folder.file("organ.msh", &block(2, 80.0, 0.0));
    folder.file("away.msh", &block(2, 80.0, 9_950.0));
    let given = |mesh: &str, rest: &str| format!("mesh = \"{mesh}\"\nscale_to_m = 0.001\n{rest}");
    let moved_back = given("away.msh", "translate_m = [-9.95, -9.95, -9.95]");
    for near in [given("organ.msh", "translate_m = [0.0, -1.9, 0.0]"), moved_back] {
        folder.load(&near).unwrap_or_else(|error| panic!("{near}: {error}"));
    }
    let in_front_of_the_pivot = "[workspace]\npivot_m = [0.0, 0.0, 9.93]";
    let far = [
        ("organ.msh", given("organ.msh", "translate_m = [0.0, 0.0, 9.95]"), ""),
        ("organ.msh", given("organ.msh", "translate_m = [0.0, -9.95, 0.0]"), ""),
        ("away.msh", given("away.msh", ""), ""),
        ("organ.msh", "mesh = \"organ.msh\"".to_owned(), in_front_of_the_pivot),
    ];
    for (mesh, deformable, rest) in far {
        let error = folder.load_with(&deformable, rest).expect_err(&deformable);
        assert_eq!((error.kind, error.key.as_str()), (Kind::Range, "deformable[0].translate_m"), "{error}");
        let said = error.to_string();
        assert!(error.line_column.is_some() && said.contains(&format!("“organ” ({mesh}) has a node at ")), "{said}");
        assert!(said.contains("9.9") && said.contains("-2 to 2 m"), "{said}");
        let report = check(Some(&folder.0.join("scene.toml")));
        assert!(!report.runnable && report.error.is_some_and(|error| error.contains("-2 to 2 m")), "{said}");
    }
}

#[test]
fn more_tets_than_can_be_simulated_are_refused() {
    let folder = Folder::new("large");
    folder.file("organ.msh", &block(33, 80.0, 0.0));
    let error = folder.load("mesh = \"organ.msh\"").unwrap_err();
    assert_eq!(error.kind, Kind::TooLarge, "{error}");
}

#[test]
fn the_hash_follows_the_content() {
    let folder = Folder::new("hash");
    folder.file("organ.msh", &block(2, 80.0, 0.0));
    let first = folder.load("mesh = \"organ.msh\"").unwrap();
    assert_eq!(first, folder.load("mesh = \"organ.msh\"").unwrap());
    folder.file("organ.msh", &block(2, 80.0, 0.0).replacen(" 40 ", " 40.1 ", 1));
    assert_ne!(first.hash, folder.load("mesh = \"organ.msh\"").unwrap().hash);
}

/// A box as OBJ, from a corner to the other.
fn a_box([x, y, z]: [f64; 3], [u, v, w]: [f64; 3]) -> String {
    let corners = [[x, y, z], [u, y, z], [x, v, z], [u, v, z], [x, y, w], [u, y, w], [x, v, w], [u, v, w]];
    let vertices: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let quads = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    vertices + &quads.map(|[a, b, c, d]| format!("f {a} {b} {c}\nf {a} {c} {d}\n")).concat()
}

#[test]
fn an_instrument_from_a_mesh_has_its_points_on_it_and_one_that_does_not_end_at_its_tip_is_refused() {
    let folder = Folder::new("instrument");
    folder.file("block.msh", &block(2, 0.05, 0.0));
    folder.file("rod.obj", &a_box([-2.0, -3.0, -80.0], [2.0, 3.0, 0.0]));
    let organ = "mesh = \"block.msh\"";
    let scene = folder.load_with(organ, "mesh = \"rod.obj\"\nscale_to_m = 0.001").unwrap();
    let rigid = &scene.rigid[0];
    assert_eq!((rigid.points_m.len(), rigid.outward.len(), rigid.points_m[0][2]), (400, 400, 0.0));
    let is_on = |[x, y, z]: &[f32; 3]| {
        let sides = [(x.abs() - 0.002).abs(), (y.abs() - 0.003).abs(), z.abs()];
        sides.iter().any(|away_m| *away_m < 1e-7) && x.abs() < 0.00201 && y.abs() < 0.00301 && (-0.081..=0.0).contains(z)
    };
    assert!(rigid.points_m.iter().all(is_on), "{:?}", rigid.points_m);
    assert!(rigid.points_m.iter().any(|point| point[2] < -0.02) && scene.hand("press").is_some());
    let other = folder.load_with(organ, "mesh = \"rod.obj\"\nscale_to_m = 0.00099").unwrap();
    assert_ne!(other.hash, scene.hash, "the hash follows the instrument");
    folder.file("ahead.obj", &a_box([-2.0, -3.0, -80.0], [2.0, 3.0, 9.0]));
    for (file, what) in [("ahead.obj", "foremost point is at z = 9.000e-3 m"), ("none.obj", "there is no such file")] {
        let error = folder.load_with(organ, &format!("mesh = \"{file}\"\nscale_to_m = 0.001")).unwrap_err();
        assert!(error.key == "rigid[0].mesh" && error.to_string().contains(what), "{error}");
    }
    let error = folder.load_with(organ, "mesh = \"rod.obj\"").unwrap_err();
    assert!(error.kind == Kind::Size && error.to_string().contains("set scale_to_m"), "{error}");
}

#[test]
fn jaws_lie_along_their_shaft_on_one_side_of_it_and_open_no_farther_than_they_can() {
    let folder = Folder::new("jaws");
    folder.file("block.msh", &block(2, 0.05, 0.0));
    folder.file("jaw.obj", &a_box([0.0, -1.5, 0.0], [1.0, 1.5, 9.0]));
    folder.file("turned.obj", &a_box([0.0, -1.5, -9.0], [1.0, 1.5, 1.5]));
    folder.file("both.obj", &a_box([-1.0, -1.5, 0.0], [1.0, 1.5, 9.0]));
    let load = |rest: &str| folder.load_with("mesh = \"block.msh\"", &format!("jaws = {{ {rest} }}"));
    let scene = load("mesh = \"jaw.obj\", scale_to_m = 0.001, points = 64").unwrap();
    let jaws = scene.rigid[0].jaws.as_ref().unwrap();
    assert!(scene.rigid[0].electrode.is_none() && jaws.points_m.len() == 64);
    assert!((jaws.length_m - 0.009).abs() < 1e-6, "{} m", jaws.length_m);
    // Two sides, two faces, two ends.
    let area_m2 = 64.0 * jaws.point_area_m2;
    assert!((area_m2 - 2.0 * (9.0 + 27.0 + 3.0) * 1e-6).abs() < 1e-9, "{area_m2}");
    for (rest, kind, what) in [
        ("mesh = \"jaw.obj\"", Kind::Size, "long along +z"),
        ("mesh = \"turned.obj\", scale_to_m = 0.001", Kind::Size, "does not lie along +z"),
        ("mesh = \"both.obj\", scale_to_m = 0.001", Kind::Size, "does not lie along +z"),
        ("mesh = \"jaw.obj\", scale_to_m = 0.001, opening_m = 0.02", Kind::Range, "give at most 0.0144 m"),
    ] {
        let error = load(rest).unwrap_err();
        assert!(error.kind == kind && error.to_string().contains(what) && error.key.starts_with("rigid[0].jaws"), "{error}");
    }
}

/// The numbers of a section of a Gmsh file, line by line.
fn numbers(text: &str, section: &str) -> Vec<Vec<f64>> {
    let (_, rest) = text.split_once(&format!("${section}\n")).unwrap();
    let (inner, _) = rest.split_once(&format!("$End{section}")).unwrap();
    inner.lines().skip(1).map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect()
}

/// Two blocks of 20 units in one file, the second 20 units beyond the first on each axis, and a tet without a volume that has nodes of both.
fn two_blocks() -> String {
    let [(mut nodes, mut tets), (other_nodes, other_tets)] =
        [0.0, 40.0].map(|shift| block(2, 20.0, shift)).map(|text| (numbers(&text, "Nodes"), numbers(&text, "Elements")));
    let [first_node, first_tet] = [nodes.len(), tets.len()].map(|count| count as f64);
    nodes.extend(other_nodes.iter().map(|node| [&[node[0] + first_node][..], &node[1..]].concat()));
    let moved = |tet: &Vec<f64>| -> Vec<f64> { tet[5..].iter().map(|node| node + first_node).collect() };
    tets.extend(other_tets.iter().map(|tet| [&[tet[0] + first_tet][..], &tet[1..5], &moved(tet)[..]].concat()));
    tets.push(vec![tets.len() as f64 + 1.0, 4.0, 2.0, 1.0, 1.0, 1.0, 2.0, 3.0, first_node + 1.0]);
    let section = |name: &str, rows: &[Vec<f64>]| {
        let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<String>>().join(" ");
        let lines: Vec<String> = rows.iter().map(line).collect();
        format!("${name}\n{}\n{}\n$End{name}\n", rows.len(), lines.join("\n"))
    };
    format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{}{}", section("Nodes", &nodes), section("Elements", &tets))
}

#[test]
fn what_hangs_apart_is_counted_after_the_repair_and_said_with_what_nothing_holds() {
    let folder = Folder::new("apart");
    folder.file("organ.msh", &two_blocks());
    folder.file("jaw.obj", &a_box([0.0, -1.5, 0.0], [1.0, 1.5, 9.0]));
    let load = |fixed: &str| {
        let organ = format!("kind = \"pathology\"\nmesh = \"organ.msh\"\nscale_to_m = 0.001\nfixed = [{fixed}]");
        folder.load_with(&organ, "jaws = { mesh = \"jaw.obj\", scale_to_m = 0.001 }").unwrap()
    };
    let said = |scene: &LoadedScene| scene.notes.iter().find(|note| note.contains("hang apart")).cloned().unwrap_or_default();
    let one = load("{ below_z_m = 0.005 }");
    let parts = ["2 parts that hang apart", "holds 1 of them (8000.0 mm³)"];
    assert!(parts.iter().all(|part| said(&one).contains(part)), "{:?}", one.notes);
    assert!((one.pathology_ml() - 8.0).abs() < 1e-4, "{} ml are loose", one.pathology_ml());
    let report = check(Some(&folder.0.join("scene.toml")));
    assert_eq!(report.objects[0].components, 1, "in the file a flat tet joins them");
    assert!(report.to_string().contains(&said(&one)), "{report}");
    let both = load("{ below_z_m = 0.005 }, { above_z_m = 0.055 }");
    assert!(said(&both).ends_with("each is held"), "{:?}", both.notes);
    assert_eq!(both.pathology_ml(), 0.0);
    assert_eq!(said(&load("{ sphere = { centre_m = [1.0, 1.0, 1.0], radius_m = 0.01 } }")).matches("holds 2 of them").count(), 1);
}
