//! Promise: no bytes whatever make a reader panic or return a mesh with an index out of range, a coordinate that is not finite, or
//! more than the bytes can hold; and no mesh that a reader returns makes `check`, `repair`, `boundary` or `bind` panic.

use hyst_mesh::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// One good file for each form of each format.
const FILES: [(&str, &str); 11] = [
    ("1.msh", "$NOD\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$ENDNOD\n$ELM\n2\n1 4 1 1 4 1 2 3 4\n2 2 1 1 3 1 2 3\n$ENDELM\n"),
    (
        "2.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n2\n1 4 2 0 1 1 2 3 4\n2 2 2 0 1 1 2 3\n$EndElements\n",
    ),
    (
        "4.msh",
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 0 0 1\n1 0 0 0 0\n1 0 0 0 1 1 1 1 7 0\n$EndEntities\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n",
    ),
    (
        "40.msh",
        "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n1 4\n1 3 0 4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n1 1\n1 3 4 1\n1 1 2 3 4\n$EndElements\n",
    ),
    (
        "p.msh",
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PartitionedEntities\n1\n1\n5 1\n0 0 0 1\n1 3 1 1 1 0 0 0 1 1 1 1 7 0\n$EndPartitionedEntities\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n",
    ),
    (
        "a.vtk",
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 2 9\n4 0 1 2 3\n3 0 1 2\nCELL_TYPES 2\n10 5\n",
    ),
    (
        "b.vtk",
        "# vtk DataFile Version 5.1\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\nCELLS 2 4\nOFFSETS vtktypeint64\n0 4\nCONNECTIVITY vtktypeint64\n0 1 2 3\nCELL_TYPES 1\n10\n",
    ),
    (
        "c.vtk",
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 3 17\n5 0 1 2 3 4\n5 1 2 3 4 0\n4 0 1 2 4\nCELL_TYPES 3\n24 71 78\n",
    ),
    (
        "a.vtu",
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points><DataArray type=\"Int8\" format=\"binary\">DAAAAAAAAAEAAAABAAAAAQ==</DataArray></Points><Cells><DataArray Name=\"connectivity\">0 1 2 3</DataArray><DataArray Name=\"offsets\">4</DataArray><DataArray Name=\"types\">10</DataArray></Cells></Piece></VTKFile>",
    ),
    (
        "a.mesh",
        "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\nTetrahedra 1\n1 2 3 4 6\nEnd\n",
    ),
    (
        "b.mesh",
        "# comment\nMeshVersionFormatted 2\nDimension\n3\nVertices 4\n1e-3 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1\nTetrahedra 2\n1 2 3 4 6\n1 2 2 4 6\n",
    ),
];
const SURFACES: [(&str, &str); 2] = [
    ("a.obj", "# c\nv 0 0 0\nv 1 0 0 1 1 1\nv 0 1 0\nv 1 1 0\ng a\nf 1//1 2 3/4\nf -1 -2 -3 -4\nl 1 2\nf 1\nf\n"),
    (
        "s.vtk",
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 1 1 0\nPOLYGONS 2 9\n3 0 1 2\n4 0 1 3 2\n",
    ),
];
const NODE: &str = "4 3 0 1\n0 0 0 0 1\n1 1 0 0 1\n2 0 1 0 1\n3 0 0 1 1\n";
/// The corners of a tet alone, and with the nodes in the middle of its edges.
const ELES: [&str; 2] = ["1 4 1\n0 0 1 2 3 5\n", "1 10 1\n0 0 1 2 3 0 1 2 3 0 1 5\n"];

/// What a number or a word is replaced by.
const NASTY: [&str; 28] = [
    "-1",
    "0",
    "1",
    "2",
    "3",
    "5",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "9223372036854775807",
    "1e308",
    "1e39",
    "-1e-320",
    "nan",
    "inf",
    "1D5",
    "3.5",
    "2.0",
    "",
    "\n",
    "#",
    "$",
    "\"",
    "<",
    "x",
    "\u{0}",
    "é",
    "$EndNodes",
];

fn read_anything(name: &str, bytes: &[u8]) {
    if let Ok(mesh) = read_tets(name, bytes) {
        judge(mesh, bytes.len());
    }
    if let Ok(surface) = read_triangles(name, bytes) {
        assert!(surface.positions_m.as_flattened().iter().all(|coordinate| coordinate.is_finite()));
        assert!(surface.triangles.as_flattened().iter().all(|&vertex| (vertex as usize) < surface.positions_m.len()));
        assert!(surface.positions_m.len() + surface.triangles.len() <= bytes.len());
    }
}

fn judge(mesh: TetMesh, bytes: usize) {
    assert!(mesh.positions_m.as_flattened().iter().all(|coordinate| coordinate.is_finite()));
    assert!(mesh.tets.as_flattened().iter().all(|&node| (node as usize) < mesh.positions_m.len()));
    assert_eq!(mesh.regions.len(), mesh.tets.len());
    assert!(mesh.positions_m.len() + mesh.tets.len() <= bytes && !mesh.tets.is_empty());
    let report = check(&mesh);
    assert!(report.to_string().contains("node"));
    let surface = boundary(&mesh).to_mesh(&mesh.positions_m).0;
    if let Ok((bindings, _)) = bind(&surface, &mesh) {
        let mut out_m = vec![[0.0; 3]; bindings.len()];
        evaluate(&bindings, &mesh.tets, &mesh.positions_m, &mut out_m);
    }
    if let Ok(repaired) = repair(mesh) {
        let after = check(&repaired.mesh);
        assert!(after.inverted.is_empty() && after.duplicate.is_empty() && after.unused_nodes.is_empty());
        assert_eq!((after.crowded_faces, after.open_edges), (0, 0));
    }
}

#[test]
fn the_files_to_be_spoiled_are_good() {
    for (name, file) in FILES {
        read_tets(name, file.as_bytes()).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    for (name, file) in SURFACES {
        read_triangles(name, file.as_bytes()).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    for ele in ELES {
        assert_eq!(read_tetgen(NODE.as_bytes(), ele.as_bytes()).unwrap().regions, [5]);
    }
}

#[test]
fn a_cut_at_any_byte_is_survived() {
    for (name, file) in FILES.iter().chain(&SURFACES) {
        (0..file.len()).for_each(|cut| read_anything(name, &file.as_bytes()[..cut]));
    }
    for ele in ELES {
        for cut in 0..NODE.len() {
            assert!(read_tetgen(&NODE.as_bytes()[..cut], ele.as_bytes()).is_err() || cut + 3 >= NODE.len());
        }
        for cut in 0..ele.len() {
            assert!(read_tetgen(NODE.as_bytes(), &ele.as_bytes()[..cut]).is_err() || cut + 1 >= ele.len());
        }
    }
}

#[test]
fn deep_and_explosive_xml_is_survived() {
    read_anything("a.vtu", "<a>".repeat(200_000).as_bytes());
    let bomb =
        "<!DOCTYPE a [<!ENTITY x \"xxxxxxxxxx\"><!ENTITY y \"&x;&x;&x;&x;\">]><VTKFile type=\"UnstructuredGrid\">&y;</VTKFile>";
    read_anything("a.vtu", bomb.as_bytes());
}

/// Replaces one piece between white space or quotes.
fn replaced(file: &str, nth: usize, by: &str) -> String {
    let is_border = |c: char| c.is_whitespace() || "\"<>".contains(c);
    let words: Vec<(usize, &str)> = file
        .split(is_border)
        .filter(|word| !word.is_empty())
        .map(|word| (word.as_ptr() as usize - file.as_ptr() as usize, word))
        .collect();
    let (at, word) = words[nth % words.len()];
    format!("{}{by}{}", &file[..at], &file[at + word.len()..])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3_000, rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_are_survived(which in 0..FILES.len() + SURFACES.len(), head in 0..80_usize, tail in proptest::collection::vec(any::<u8>(), 0..200)) {
        let (name, file) = FILES.iter().chain(&SURFACES).nth(which).unwrap();
        let bytes = [&file.as_bytes()[..head.min(file.len())], tail.as_slice()].concat();
        read_anything(name, &bytes);
        let _ = read_tetgen(&bytes, ELES[which % ELES.len()].as_bytes());
    }

    #[test]
    fn spoiled_words_are_survived(which in 0..FILES.len() + SURFACES.len(), spots in proptest::collection::vec((any::<usize>(), 0..NASTY.len()), 1..4)) {
        let (name, file) = FILES.iter().chain(&SURFACES).nth(which).unwrap();
        let spoiled = spots.iter().fold(file.to_string(), |file, &(nth, by)| replaced(&file, nth, NASTY[by]));
        read_anything(name, spoiled.as_bytes());
    }

    #[test]
    fn spoiled_bytes_are_survived(which in 0..FILES.len() + SURFACES.len(), spots in proptest::collection::vec((any::<usize>(), any::<u8>()), 1..6)) {
        let (name, file) = FILES.iter().chain(&SURFACES).nth(which).unwrap();
        let mut bytes = file.as_bytes().to_vec();
        for (at, byte) in spots {
            let at = at % bytes.len();
            bytes[at] = byte;
        }
        read_anything(name, &bytes);
    }

    #[test]
    fn a_spoiled_tetgen_pair_is_survived(
        node_spot in any::<usize>(), ele_spot in any::<usize>(), by in 0..NASTY.len(), which in 0..3, of in 0..ELES.len(),
    ) {
        let node = if which != 1 { replaced(NODE, node_spot, NASTY[by]) } else { NODE.into() };
        let ele = if which != 0 { replaced(ELES[of], ele_spot, NASTY[by]) } else { ELES[of].into() };
        if let Ok(mesh) = read_tetgen(node.as_bytes(), ele.as_bytes()) {
            judge(mesh, node.len() + ele.len());
        }
    }
}
