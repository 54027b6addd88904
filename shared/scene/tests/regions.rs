//! Regions of material in a scene: which tets each has, by the numbers of three formats and by place, what they are made of, and each fault of them.
#![allow(missing_docs)]

mod folder;

use folder::Folder;
use hyst_scene::{LoadedDeformable, LoadedScene, SceneError, SceneErrorKind as Kind, check, find_case, load};
use std::collections::BTreeMap;

impl Folder {
    fn load(&self, deformable: &str) -> Result<LoadedScene, SceneError> {
        load(&self.file("scene.toml", &text(deformable)))
    }
}

/// A scene of one deformable table and one instrument; the table begins in the fifth line.
fn text(deformable: &str) -> String {
    format!("version = 1\nname = \"t\"\n[[deformable]]\nname = \"organ\"\n{deformable}\n[[rigid]]\nname = \"scope\"\n")
}

/// Nodes and tets of a block of 4 × 4 × 4 cubes of 10 mm, six tets each.
fn block() -> (Vec<[f64; 3]>, Vec<[usize; 4]>) {
    let id = |[x, y, z]: [usize; 3]| x + 5 * (y + 5 * z);
    let all = |count: usize| {
        (0..count).flat_map(move |z| (0..count).flat_map(move |y| (0..count).map(move |x| [x, y, z]))).collect::<Vec<_>>()
    };
    let nodes = all(5).iter().map(|at| at.map(|i| 0.01 * i as f64)).collect();
    let mut tets = Vec::new();
    for cell in all(4) {
        for [i, j] in [[0, 1], [1, 0], [1, 2], [2, 1], [0, 2], [2, 0]] {
            let (mut corner, mut tet) = (cell, [id(cell); 4]);
            for (place, axis) in [(1, i), (2, j), (3, 3 - i - j)] {
                corner[axis] += 1;
                tet[place] = id(corner);
            }
            tets.push(tet);
        }
    }
    (nodes, tets)
}

/// Which number each tet of the block has: 7 above the middle, 3 below.
fn tags() -> Vec<u32> {
    let (nodes, tets) = block();
    tets.iter().map(|tet| if tet.iter().map(|node| nodes[*node][2]).sum::<f64>() > 0.08 { 7 } else { 3 }).collect()
}

/// The block as Gmsh, in a physical group or without one; as Medit; and as TetGen's two files.
fn files() -> [(&'static str, Vec<(&'static str, String)>); 4] {
    let ((nodes, tets), tags) = (block(), tags());
    let (count, many) = (nodes.len(), tets.len());
    let points = |form: &dyn Fn(usize, &str) -> String| -> String {
        let place = |[x, y, z]: &[f64; 3]| format!("{x} {y} {z}");
        nodes.iter().enumerate().map(|(index, at)| form(index + 1, &place(at))).collect()
    };
    let cells = |form: &dyn Fn(usize, &str, u32) -> String| -> String {
        let corners = |tet: &[usize; 4]| tet.map(|node| (node + 1).to_string()).join(" ");
        tets.iter().zip(&tags).enumerate().map(|(index, (tet, tag))| form(index + 1, &corners(tet), *tag)).collect()
    };
    let gmsh = |of: &dyn Fn(u32) -> String| {
        let (points, cells) = (
            points(&|index, at| format!("{index} {at}\n")),
            cells(&|index, tet, tag| format!("{index} 4 2 {} {tet}\n", of(tag))),
        );
        format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n{points}$EndNodes\n$Elements\n{many}\n{cells}$EndElements\n"
        )
    };
    let (points_m, tets_m) = (points(&|_, at| format!("{at} 0\n")), cells(&|_, tet, tag| format!("{tet} {tag}\n")));
    let medit = format!("MeshVersionFormatted 2\nDimension 3\nVertices {count}\n{points_m}Tetrahedra {many}\n{tets_m}End\n");
    let node = format!("{count} 3 0 0\n{}", points(&|index, at| format!("{index} {at}\n")));
    let ele = format!("{many} 4 1\n{}", cells(&|index, tet, tag| format!("{index} {tet} {tag}\n")));
    [
        ("group.msh", vec![("group.msh", gmsh(&|tag| format!("{tag} 1")))]),
        ("volume.msh", vec![("volume.msh", gmsh(&|tag| format!("0 {tag}")))]),
        ("block.mesh", vec![("block.mesh", medit)]),
        ("block.ele", vec![("block.node", node), ("block.ele", ele)]),
    ]
}

/// A folder with all files of the block.
fn with_block(name: &str) -> Folder {
    let folder = Folder::new(name);
    files().into_iter().flat_map(|(_, files)| files).for_each(|(name, content)| drop(folder.file(name, &content)));
    folder
}

fn middle_m(object: &LoadedDeformable, tet: usize) -> [f32; 3] {
    let nodes = object.mesh.tets[tet].map(|node| object.mesh.positions_m[node as usize]);
    [0, 1, 2].map(|axis| nodes.iter().map(|node| node[axis]).sum::<f32>() / 4.0)
}

#[test]
fn the_numbers_of_three_formats_tell_regions_apart() {
    let folder = with_block("formats");
    for (mesh, _) in files() {
        let scene = folder.load(&format!(
            "mesh = \"{mesh}\"\nscale_to_m = 1.0\nfixed = [{{ below_z_m = 0.001 }}]\n\
             [[deformable.region]]\nname = \"upper\"\ntets = [{{ tag = 7 }}]\nyoungs_modulus_pa = 66e3\nsource = \"Omari 2015\""
        ));
        let scene = scene.unwrap_or_else(|error| panic!("{mesh}: {error}"));
        let object = &scene.objects[0];
        assert_eq!((object.regions.len(), object.mesh.tets.len()), (1, 384), "{mesh}");
        for (tet, region) in object.mesh.regions.iter().enumerate() {
            assert_eq!(*region, u32::from(middle_m(object, tet)[2] > 0.02), "{mesh}: tet {tet}");
        }
        let (own, upper) = (&object.material, &object.regions[0].material);
        assert_eq!((own.youngs_modulus_pa, upper.youngs_modulus_pa, upper.source.as_str()), (30e3, 66e3, "Omari 2015"), "{mesh}");
        // What it does not say is as its object has it.
        let others = [own, upper].map(|of| (of.poisson_ratio, of.density_kg_m3, of.damping_per_s));
        assert!(others[0] == others[1] && object.regions[0].bed_n_m4 == 0.0, "{mesh}: {others:?}");
        // A number that nothing has: the error names the file, the line, the region, the value, and what there is.
        let error = folder.load(&format!(
            "mesh = \"{mesh}\"\nscale_to_m = 1.0\n[[deformable.region]]\nname = \"core\"\ntets = [{{ tag = 5 }}]"
        ));
        let error = error.unwrap_err();
        assert_eq!((error.kind, error.key.as_str()), (Kind::Name, "deformable[0].region[0].tets[0]"), "{error}");
        let said = error.to_string();
        for part in ["scene.toml:9:", "“core”", "“organ”", "tag 5", "3 (192 tets), 7 (192 tets)", mesh] {
            assert!(said.contains(part), "no {part} in: {said}");
        }
    }
}

/// How many tets each region of the block has, where each is of the tets that it names.
fn counts(folder: &Folder, regions: &str) -> Result<(BTreeMap<u32, usize>, LoadedScene), SceneError> {
    let scene = folder.load(&format!("mesh = \"group.msh\"\nscale_to_m = 1.0\nfixed = [{{ below_z_m = 0.001 }}]\n{regions}"))?;
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    scene.objects[0].mesh.regions.iter().for_each(|region| *counts.entry(*region).or_default() += 1);
    Ok((counts, scene))
}

#[test]
fn places_tell_regions_apart_and_the_later_one_counts() {
    let folder = with_block("places");
    let region = |name: &str, tets: &str| format!("[[deformable.region]]\nname = \"{name}\"\ntets = [{tets}]\n");
    let found = |regions: &str| counts(&folder, regions).unwrap_or_else(|error| panic!("{error}")).0;
    let all = |pairs: &[(u32, usize)]| pairs.iter().copied().collect::<BTreeMap<u32, usize>>();
    // Layers of cubes have 96 tets each.
    assert_eq!(found(&region("a", "{ below_z_m = 0.01 }")), all(&[(0, 288), (1, 96)]));
    assert_eq!(found(&region("a", "{ above_z_m = 0.01 }")), all(&[(0, 96), (1, 288)]));
    assert_eq!(found(&region("a", "{ below_z_m = 0.01 }, { above_z_m = 0.03 }")), all(&[(0, 192), (1, 192)]));
    let cube = "{ box = { min_m = [0.01, 0.01, 0.01], max_m = [0.02, 0.02, 0.02] } }";
    assert_eq!(found(&region("a", cube)), all(&[(0, 378), (1, 6)]));
    let ball = "{ sphere = { centre_m = [0.015, 0.015, 0.015], radius_m = 0.005 } }";
    assert_eq!(found(&region("a", ball)), all(&[(0, 378), (1, 6)]), "their middles are 3.5 mm from the cube's");
    let both = region("a", "{ below_z_m = 0.02 }") + &region("b", "{ above_z_m = 0.01 }");
    assert_eq!(found(&both), all(&[(1, 96), (2, 288)]));
    // The eight cubes within are no nearer than 10 mm to any side; of those outside the middles are.
    assert_eq!(found(&region("a", "{ outer_layer_m = 0.01 }")), all(&[(0, 48), (1, 336)]));
    let (_, scene) = counts(&folder, &(region("a", "{ tag = 3 }") + &region("b", "{ below_z_m = 0.03 }"))).unwrap();
    assert!(scene.notes.iter().any(|note| note.contains("leave nothing of “a”")), "{:?}", scene.notes);
}

#[test]
fn the_lining_of_a_cavity_is_at_its_wall_and_the_serosa_is_not() {
    let folder = Folder::new("lining");
    let layers = "[[deformable.region]]\nname = \"serosa\"\ntets = [{ outer_layer_m = 0.003 }]\n\
                  [[deformable.region]]\nname = \"endometrium\"\ntets = [{ inner_layer_m = 0.003 }]\nyoungs_modulus_pa = 10e3\n";
    let scene = folder.load(&format!("mesh = \"builtin:uterus.msh\"\nscale_to_m = 0.001\n{layers}")).unwrap();
    let object = &scene.objects[0];
    assert!(object.hollow);
    // Beside the axis of the cavity, which is a wedge about it, and outside of the organ's box less a wall.
    let away_m = |number: u32| -> Vec<f32> {
        let of = (0..object.mesh.tets.len()).filter(|tet| object.mesh.regions[*tet] == number);
        let upper = of.map(|tet| middle_m(object, tet)).filter(|middle| (0.02..0.05).contains(&middle[2]));
        upper.map(|middle| middle[1].abs()).collect()
    };
    let mean = |number: u32| away_m(number).iter().sum::<f32>() / away_m(number).len() as f32;
    assert!(away_m(1).len() > 50 && away_m(2).len() > 50, "{} and {}", away_m(1).len(), away_m(2).len());
    assert!(mean(2) < mean(0) && mean(0) < mean(1), "lining {}, between {}, serosa {}", mean(2), mean(0), mean(1));
    folder.file("block.msh", &files()[0].1[0].1);
    let error = folder.load(&format!("mesh = \"block.msh\"\nscale_to_m = 1.0\n{layers}")).unwrap_err();
    assert_eq!((error.kind, error.key.as_str()), (Kind::Apart, "deformable[0].region[1].tets[0]"), "{error}");
    assert!(error.to_string().contains("“endometrium”") && error.to_string().contains("only a hollow organ"), "{error}");
}

#[test]
fn a_bed_holds_an_organ_of_which_no_node_is_fixed() {
    let folder = with_block("bed");
    let bed = |stiffness: &str| {
        folder.load(&format!(
            "mesh = \"group.msh\"\nscale_to_m = 1.0\n[[deformable.region]]\nname = \"ligaments\"\ntets = [{{ below_z_m = 0.01 }}]\n{stiffness}"
        ))
    };
    let on_bed = bed("bed_n_m4 = 1e8").unwrap();
    let object = &on_bed.objects[0];
    assert!(object.is_held() && !object.fixed.contains(&true) && object.regions[0].bed_n_m4 == 1e8);
    assert!(!on_bed.notes.iter().any(|note| note.contains("drift")), "{:?}", on_bed.notes);
    let without = bed("").unwrap();
    assert!(without.objects[0].fixed.contains(&true), "as an organ without regions");
    let said = check(Some(&folder.file("scene.toml", &text("mesh = \"group.msh\"\nscale_to_m = 1.0\n[[deformable.region]]\nname = \"ligaments\"\ntets = [{ below_z_m = 0.01 }]\nbed_n_m4 = 1e8")))).to_string();
    assert!(said.contains("“ligaments” is 96 of its tets, of 30.0 kPa, on a bed of 1.00e8 N/m⁴"), "{said}");
}

/// What a region says, and the kind, the key and a part of the error that it must give.
const BAD: [(&str, Kind, &str, &str); 17] = [
    ("tets = [{ tag = 3 }]\nyoungs_modulus_pa = 0.0", Kind::Range, "youngs_modulus_pa", "is 0 Pa"),
    ("tets = [{ tag = 3 }]\nyoungs_modulus_pa = 0.9", Kind::Range, "youngs_modulus_pa", "allowed is 1 to 1000000000 Pa"),
    ("tets = [{ tag = 3 }]\nyoungs_modulus_pa = -5e3", Kind::Range, "youngs_modulus_pa", "is -5000 Pa"),
    ("tets = [{ tag = 3 }]\nyoungs_modulus_pa = nan", Kind::Range, "youngs_modulus_pa", "not a finite number"),
    ("tets = [{ tag = 3 }]\nyoungs_modulus_pa = 1e12", Kind::Range, "youngs_modulus_pa", "is 1000000000000 Pa"),
    ("tets = [{ tag = 3 }]\npoisson_ratio = 0.5", Kind::Range, "poisson_ratio", "is 0.5"),
    ("tets = [{ tag = 3 }]\ndensity_kg_m3 = 0.0", Kind::Range, "density_kg_m3", "is 0 kg/m³"),
    ("tets = [{ tag = 3 }]\ndamping_per_s = 1e5", Kind::Range, "damping_per_s", "is 100000 1/s"),
    ("tets = [{ tag = 3 }]\nbed_n_m4 = -1.0", Kind::Range, "bed_n_m4", "is -1 N/m⁴"),
    ("tets = [{ tag = 3 }]\nbed_n_m4 = 1e13", Kind::Range, "bed_n_m4", "is 10000000000000 N/m⁴"),
    ("tets = []", Kind::Incomplete, "tets", "“core” names no tets"),
    ("tets = [{ tag = 3 }]\nmodulus_pa = 6e4", Kind::UnknownKey, "modulus_pa", "`modulus_pa`"),
    ("tets = [{ globe = 3 }]", Kind::UnknownKey, "tets[0].globe", "`globe`"),
    ("tets = [{ inner_layer_m = 0.2 }]", Kind::Range, "tets[0].inner_layer_m", "is 0.2 m"),
    ("tets = [{ outer_layer_m = 0.0 }]", Kind::Apart, "tets[0]", "no tet of “organ” is within 0 m"),
    ("tets = [{ above_z_m = 0.05 }]", Kind::Apart, "tets[0]", "no tet of “organ” is above z = 0.05 m"),
    (
        "tets = [{ sphere = { centre_m = [1, 1, 1], radius_m = 0.01 } }]",
        Kind::Apart,
        "tets[0]",
        "within 0.01 m of [1.0, 1.0, 1.0] m",
    ),
];

#[test]
fn each_fault_of_a_region_is_one_error_that_names_file_key_and_value() {
    let folder = with_block("faults");
    let load = |region: &str| {
        folder.load(&format!("mesh = \"group.msh\"\nscale_to_m = 1.0\n[[deformable.region]]\nname = \"core\"\n{region}"))
    };
    load("tets = [{ tag = 3 }]").unwrap_or_else(|error| panic!("{error}"));
    for (region, kind, key, part) in BAD {
        let error = load(region).expect_err(region);
        let key = format!("deformable[0].region[0].{key}");
        assert_eq!((error.kind, &error.key), (kind, &key), "{error}");
        let said = error.to_string();
        assert!(said.contains("scene.toml:") && said.contains(part) && !said.contains('\n') && !error.cure.is_empty(), "{said}");
    }
    for (region, kind) in [("youngs_modulus_pa = 6e4", Kind::Incomplete), ("tets = [{ tag = -3 }]", Kind::Syntax)] {
        let error = load(region).expect_err(region);
        assert!(error.kind == kind && error.to_string().contains("scene.toml:"), "{error}");
    }
    for name in ["core", "", "\\n"] {
        let error = load(&format!("tets = [{{ tag = 3 }}]\n[[deformable.region]]\nname = \"{name}\"\ntets = [{{ tag = 7 }}]"))
            .unwrap_err();
        assert_eq!((error.kind, error.key.as_str()), (Kind::Name, "deformable[0].region[1].name"), "{error}");
    }
}

#[test]
fn the_hash_follows_the_regions_and_a_scene_without_any_has_the_one_that_it_had() {
    let folder = with_block("hash");
    let scene = |mesh: &str, region: &str| folder.load(&format!("mesh = \"{mesh}\"\nscale_to_m = 1.0\n{region}")).unwrap();
    let region = "[[deformable.region]]\nname = \"upper\"\ntets = [{ tag = 7 }]\n";
    let (plain, parted) = (scene("group.msh", ""), scene("group.msh", region));
    assert_ne!(plain.hash, parted.hash);
    assert!(plain.objects[0].mesh.regions.iter().all(|region| *region == 0));
    assert!(!serde_json::to_string(&plain.scene).unwrap().contains("region"), "what the hash is made of");
    // The same text and shape, with another tet in the region.
    let other = files()[0].1[0].1.replacen(" 4 2 3 1 ", " 4 2 7 1 ", 1);
    folder.file("group.msh", &other);
    assert_ne!(scene("group.msh", region).hash, parted.hash);
    assert_eq!(scene("group.msh", "").hash, plain.hash);
}

#[test]
fn a_seed_makes_the_regions_stiffer_with_their_object_and_they_go_where_it_goes() {
    let folder = Folder::new("case");
    let core = "[[deformable.region]]\nname = \"core\"\ntets = [{ sphere = { centre_m = [CENTRE], radius_m = 0.004 } }]\nyoungs_modulus_pa = 60e3\n";
    let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets");
    let scene =
        std::fs::read_to_string(format!("{assets}/scenes/myoma.toml")).unwrap().replace("../meshes", &format!("{assets}/meshes"));
    let case =
        std::fs::read_to_string(format!("{assets}/cases/myoma.toml")).unwrap().replace("../scenes/myoma.toml", "scene.toml");
    let home = load(&folder.file("scene.toml", &scene)).unwrap();
    let myoma = &home.objects[1];
    let all: Vec<[f32; 3]> = (0..myoma.mesh.tets.len()).map(|tet| middle_m(myoma, tet)).collect();
    let centre = [0, 1, 2].map(|axis| all.iter().map(|middle| middle[axis]).sum::<f32>() / all.len() as f32);
    let core = core.replace("CENTRE", &centre.map(|at| format!("{at}")).join(", "));
    folder.file("scene.toml", &scene.replace("[[rigid]]", &format!("{core}\n[[rigid]]")));
    let path = folder.file("case.toml", &case);
    let settled = |seed: u32| find_case(&path, Some(seed)).unwrap().unwrap().scene;
    let drawn: Vec<LoadedScene> = [1, 7].map(settled).into_iter().collect();
    for scene in &drawn {
        let object = &scene.objects[1];
        let ratio = object.regions[0].material.youngs_modulus_pa / object.material.youngs_modulus_pa;
        assert!((ratio - 60.0 / 66.0).abs() < 1e-9, "{ratio}");
        assert_eq!(object.mesh.regions, drawn[0].objects[1].mesh.regions, "the same tets, wherever it is");
    }
    assert!(drawn[0].objects[1].mesh.regions.contains(&1) && drawn[0].objects[1].mesh.regions.contains(&0));
    assert_ne!(drawn[0].objects[1].mesh.positions_m, drawn[1].objects[1].mesh.positions_m);
}
