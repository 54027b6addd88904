//! Scenes on meshes that nobody made for them: units, faults, surfaces, attachments, and a mesh alone.
#![allow(missing_docs)]

mod folder;
mod organ;

use folder::Folder;
use hyst_scene::{LoadedScene, Pose, SceneErrorKind as Kind, check, load};
use organ::{a_box, block};

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

/// It was kept: points left the organ within it, and a hollow one was blown up from there. `run` said of it that the boundary touches itself.
#[test]
fn a_tet_that_lies_in_others_is_dropped_by_whoever_loads_the_mesh_and_many_are_refused() {
    let folder = Folder::new("overlap");
    // More tets at a face of the first two, which lie on either side of it, behind all others.
    let mesh = |apexes: &[u32]| {
        let more = (49..).zip(apexes).map(|(tet, apex)| format!("{tet} 4 2 1 1 1 5 14 {apex}\n")).collect::<String>();
        let whole = block(2, 80.0, 0.0).replace("$Elements\n48\n", &format!("$Elements\n{}\n", 48 + apexes.len()));
        whole.replace("$EndElements\n", &format!("{more}$EndElements\n"))
    };
    let path = folder.file("organ.msh", &mesh(&[3]));
    let scene = load(&path).unwrap_or_else(|error| panic!("{error}"));
    assert!(hyst_mesh::check(&scene.objects[0].mesh).is_sound() && scene.objects[0].mesh.tets.len() == 48);
    let said = |part: &str| scene.notes.iter().any(|note| note.contains(part));
    assert!(said("dropped 1 tet on that side of a face") && said("(first: tet 48)"), "{:?}", scene.notes);
    assert!(!said("touches itself"), "{:?}", scene.notes);
    let report = check(Some(&path));
    assert!(report.runnable && report.objects[0].crowded_faces == 1, "{report:?}");
    assert!(report.to_string().contains("1 face of more than two tets: of those on one side one is kept"), "{report}");

    // Before all others it is dropped, too: the good ones stay.
    let kept = scene.objects[0].mesh.clone();
    let ahead = block(2, 80.0, 0.0).replace("$Elements\n48\n", "$Elements\n49\n49 4 2 1 1 1 5 14 3\n");
    let scene = load(&folder.file("organ.msh", &ahead)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.objects[0].mesh, kept);
    assert!(scene.notes.iter().any(|note| note.contains("(first: tet 0)")), "{:?}", scene.notes);

    let path = folder.file("organ.msh", &mesh(&[3, 6, 7, 8, 12, 16, 20, 21, 22, 24, 25, 26]));
    let error = load(&path).unwrap_err();
    assert!(error.kind == Kind::BadMesh && error.to_string().contains("of 60 tets 12 lie in others"), "{error}");
    let report = check(Some(&path));
    assert!(!report.runnable && report.error.is_some_and(|error| error.contains("12 lie in others")));
}

/// As `Mesh.SaveAll` may leave it.
#[test]
fn a_number_that_a_group_and_a_volume_in_none_share_is_noted_and_refused_where_a_region_names_it() {
    let folder = Folder::new("shared");
    folder.file("organ.msh", &block(2, 80.0, 0.0).replace("\n2 4 2 1 1 ", "\n2 4 2 0 1 "));
    let with = |region: &str| folder.load(&format!("mesh = \"organ.msh\"\nscale_to_m = 0.001\n{region}"));
    let by = |tets: &str| with(&format!("[[deformable.region]]\nname = \"one\"\ntets = [{{ {tets} }}]"));
    for scene in [with(""), by("below_z_m = 0.02")].map(|scene| scene.unwrap_or_else(|error| panic!("{error}"))) {
        assert!(scene.notes.iter().any(|note| note.contains("have the number 1 both (line ")), "{:?}", scene.notes);
    }
    let error = by("tag = 1").unwrap_err();
    assert_eq!((error.kind, error.key.as_str()), (Kind::Name, "deformable[0].region[0].tets[0]"), "{error}");
    assert!(error.line_column.is_some() && error.to_string().contains("a physical group 1 and a volume 1 in none"), "{error}");
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
