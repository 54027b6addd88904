//! Parts of one mesh: those that touch with whole faces are one object, and of those that hang apart it is said what nothing holds.
#![allow(missing_docs)]

mod folder;
mod organ;

use folder::Folder;
use hyst_mesh::{component_count, component_of_each_tet};
use hyst_scene::{LoadedScene, check};
use organ::{a_box, block};

/// The numbers of a section of a Gmsh file, line by line.
fn numbers(text: &str, section: &str) -> Vec<Vec<f64>> {
    let (_, rest) = text.split_once(&format!("${section}\n")).unwrap();
    let (inner, _) = rest.split_once(&format!("$End{section}")).unwrap();
    inner.lines().skip(1).map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect()
}

/// Two blocks of 20 units in one file, each with nodes and a group of its own, the second moved by so many units, and a tet without a volume that has nodes of
/// both.
fn two_blocks(moved: [f64; 3]) -> String {
    let text = block(2, 20.0, 0.0);
    let [mut nodes, mut tets] = ["Nodes", "Elements"].map(|section| numbers(&text, section));
    let [first_node, first_tet] = [nodes.len(), tets.len()].map(|count| count as f64);
    let node = |of: &Vec<f64>| vec![of[0] + first_node, of[1] + moved[0], of[2] + moved[1], of[3] + moved[2]];
    let tet = |of: &Vec<f64>| -> Vec<f64> {
        [of[0] + first_tet, 4.0, 2.0, 2.0, 1.0].into_iter().chain(of[5..].iter().map(|node| node + first_node)).collect()
    };
    let (other_nodes, other_tets): (Vec<_>, Vec<_>) = (nodes.iter().map(node).collect(), tets.iter().map(tet).collect());
    nodes.extend(other_nodes);
    tets.extend(other_tets);
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
    folder.file("organ.msh", &two_blocks([40.0; 3]));
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

#[test]
fn two_halves_of_an_organ_without_common_nodes_are_one_object_that_keeps_its_regions_and_two_blocks_at_an_edge_are_two() {
    let folder = Folder::new("halves");
    let load = |moved: [f64; 3]| {
        folder.file("organ.msh", &two_blocks(moved));
        let region = "[[deformable.region]]\nname = \"other\"\ntets = [{ tag = 2 }]\nyoungs_modulus_pa = 66e3";
        let organ = format!("mesh = \"organ.msh\"\nscale_to_m = 0.001\nfixed = [{{ below_z_m = 0.001 }}]\n{region}");
        folder.load(&organ).unwrap_or_else(|error| panic!("{error}"))
    };
    let parts = |scene: &LoadedScene| component_count(&component_of_each_tet(&scene.objects[0].mesh));
    let has_note = |scene: &LoadedScene, what: &str| scene.notes.iter().any(|note| note.contains(what));

    let one = load([0.0, 0.0, 20.0]);
    let merged = "organ: merged 9 nodes with others at the same places: at 8 faces parts touched without common nodes";
    assert!(has_note(&one, merged) && !has_note(&one, "hang apart"), "{:?}", one.notes);
    let organ = &one.objects[0];
    // Squares of 10 mm are what is drawn, four of each end and of each side of each half, and nothing between the halves.
    assert_eq!((parts(&one), organ.mesh.positions_m.len(), organ.surface.triangles.len()), (1, 45, 2 * (4 + 4 + 8 * 4)));
    let middle_m = |tet: &[u32; 4]| tet.iter().map(|node| organ.mesh.positions_m[*node as usize][2]).sum::<f32>() / 4.0;
    for (tet, region) in organ.mesh.tets.iter().zip(&organ.mesh.regions) {
        assert_eq!(*region, u32::from(middle_m(tet) > 0.02), "{tet:?}");
    }
    let said = check(Some(&folder.0.join("scene.toml"))).to_string();
    assert!(said.contains(merged) && said.contains("“other” is 48 of its tets"), "{said}");

    let two = load([20.0, 20.0, 0.0]);
    assert!(parts(&two) == 2 && has_note(&two, "2 parts that hang apart") && !has_note(&two, "merged"), "{:?}", two.notes);
}
