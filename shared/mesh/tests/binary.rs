//! Promise: the same two tets come out of binary files as out of text, Gmsh's in either byte order and VTK's of before and since version 5; and no damage to
//! one panics or is read as something else than a mesh.

use hyst_mesh::*;

const POSITIONS_M: [[f32; 3]; 5] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]];
const TETS: [[u32; 4]; 2] = [[0, 1, 2, 3], [1, 2, 3, 4]];

/// What stands in a file: text, whole numbers, sizes, coordinates.
enum Part {
    Text(&'static str),
    Ints(&'static [i32]),
    Sizes(&'static [u64]),
    Reals(&'static [f64]),
}
use Part::{Ints, Reals, Sizes, Text};

fn file(parts: &[Part], is_big: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    for part in parts {
        match part {
            Text(text) => bytes.extend(text.as_bytes()),
            Ints(ints) if is_big => ints.iter().for_each(|int| bytes.extend(int.to_be_bytes())),
            Ints(ints) => ints.iter().for_each(|int| bytes.extend(int.to_le_bytes())),
            Sizes(sizes) if is_big => sizes.iter().for_each(|size| bytes.extend(size.to_be_bytes())),
            Sizes(sizes) => sizes.iter().for_each(|size| bytes.extend(size.to_le_bytes())),
            Reals(reals) if is_big => reals.iter().for_each(|real| bytes.extend(real.to_be_bytes())),
            Reals(reals) => reals.iter().for_each(|real| bytes.extend(real.to_le_bytes())),
        }
    }
    bytes
}

/// Parametric nodes, a triangle, a tet of second order, a volume in a physical group and one in none, and a section that is not read.
fn version_4_1() -> Vec<Part> {
    vec![
        Text("$MeshFormat\n4.1 1 8\n"),
        Ints(&[1]),
        Text("\n$EndMeshFormat\n$PhysicalNames\n1\n3 11 \"wall\"\n$EndPhysicalNames\n$Entities\n"),
        Sizes(&[1, 0, 1, 1]),
        Ints(&[1]),
        Reals(&[0.0, 0.0, 0.0]),
        Sizes(&[0]),
        Ints(&[5]),
        Reals(&[0.0, 0.0, 0.0, 1.0, 1.0, 0.0]),
        Sizes(&[0, 1]),
        Ints(&[-3]),
        Ints(&[1]),
        Reals(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        Sizes(&[2]),
        Ints(&[11, 12]),
        Sizes(&[1]),
        Ints(&[5]),
        Text("\n$EndEntities\n$Nodes\n"),
        Sizes(&[2, 5, 1, 50]),
        Ints(&[2, 5, 1]),
        Sizes(&[1, 50]),
        Reals(&[0.0, 0.0, 0.0, 0.5, 0.25]),
        Ints(&[3, 1, 0]),
        Sizes(&[4, 3, 1, 10, 20]),
        Reals(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]),
        Text("\n$EndNodes\n$Elements\n"),
        Sizes(&[3, 3, 1, 3]),
        Ints(&[2, 5, 2]),
        Sizes(&[1, 1, 50, 3, 1]),
        Ints(&[3, 1, 4]),
        Sizes(&[1, 2, 50, 3, 1, 10]),
        Ints(&[3, 2, 11]),
        Sizes(&[1, 3, 3, 1, 10, 20, 50, 50, 50, 50, 50, 50]),
        Text("\n$EndElements\n$NodeData\n1\n\"T\"\n"),
        Reals(&[0.1]),
        Text("\n$EndNodeData\n"),
    ]
}

fn version_2_2() -> Vec<Part> {
    let node = |tag: &'static [i32], point: &'static [f64]| [Ints(tag), Reals(point)];
    let mut parts = vec![Text("$MeshFormat\n2.2 1 8\n"), Ints(&[1]), Text("\n$EndMeshFormat\n$Nodes\n5\n")];
    parts.extend(node(&[90], &[0.0, 0.0, 0.0]));
    parts.extend(node(&[12], &[1.0, 0.0, 0.0]));
    parts.extend(node(&[30], &[0.0, 1.0, 0.0]));
    parts.extend(node(&[4], &[0.0, 0.0, 1.0]));
    parts.extend(node(&[7], &[1.0, 1.0, 1.0]));
    parts.push(Text("\n$EndNodes\n$Elements\n3\n"));
    parts.push(Ints(&[2, 1, 2, 1, 1, 1, 90, 12, 30]));
    parts.push(Ints(&[4, 2, 2, 2, 11, 1, 90, 12, 30, 4, 3, 0, 2, 12, 30, 4, 7]));
    parts.push(Text("\n$EndElements\n"));
    parts
}

const COORDINATES: &[f64] = &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];

/// A field before the points, and a triangle between the tets.
fn vtk_3() -> Vec<Part> {
    vec![
        Text(
            "# vtk DataFile Version 3.0\nPOINTS in the title\nBINARY\nDATASET UNSTRUCTURED_GRID\nFIELD FieldData 1\nTIME 1 1 double\n",
        ),
        Reals(&[0.5]),
        Text("\nPOINTS 5 double\n"),
        Reals(COORDINATES),
        Text("\nCELLS 3 14\n"),
        Ints(&[4, 0, 1, 2, 3, 3, 0, 1, 2, 4, 1, 2, 3, 4]),
        Text("\nCELL_TYPES 3\n"),
        Ints(&[10, 5, 10]),
        Text("\nCELL_DATA 3\nSCALARS a int\nLOOKUP_TABLE default\n"),
        Ints(&[1, 2, 3]),
    ]
}

fn vtk_5() -> Vec<Part> {
    vec![
        Text("# vtk DataFile Version 5.1\nt\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n"),
        Reals(COORDINATES),
        Text("\nMETADATA\nINFORMATION 0\n\nCELLS 3 8\nOFFSETS vtktypeint64\n"),
        Sizes(&[0, 4, 8]),
        Text("\nCONNECTIVITY vtktypeint64\n"),
        Sizes(&[0, 1, 2, 3, 1, 2, 3, 4]),
        Text("\nCELL_TYPES 2\n"),
        Ints(&[10, 10]),
        Text("\nCELL_DATA 2\n"),
    ]
}

/// A file: its name, its bytes, the regions that it names, and what comes after the last byte that it cannot do without.
type File = (&'static str, Vec<u8>, [u32; 2], &'static [u8]);

fn files() -> Vec<File> {
    let gmsh = [version_4_1(), version_2_2()].into_iter().flat_map(|parts| [false, true].map(|is_big| file(&parts, is_big)));
    let vtk = [vtk_3(), vtk_5()].map(|parts| file(&parts, true));
    let gmsh = gmsh.map(|bytes| ("a.msh", bytes, [11, 2], b"\n$EndElements".as_slice()));
    gmsh.chain(vtk.map(|bytes| ("a.vtk", bytes, [0, 0], b"\nCELL_DATA".as_slice()))).collect()
}

#[test]
fn a_binary_file_is_the_same_mesh_as_one_of_text() {
    for (name, bytes, regions, _) in files() {
        let mesh = read_tets(name, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((mesh.positions_m.as_slice(), mesh.tets.as_slice()), (&POSITIONS_M[..], &TETS[..]), "{name}");
        assert_eq!(mesh.regions, regions, "{name}");
    }
}

#[test]
fn a_number_that_a_group_and_a_volume_in_none_of_a_binary_file_share_is_told() {
    for mut parts in [version_4_1(), version_2_2()] {
        for part in &mut parts {
            match part {
                Ints(ints) if ints[..] == [11, 12] => *ints = &[2, 12],
                Ints(ints) if ints.len() == 17 => *ints = &[4, 2, 2, 2, 2, 1, 90, 12, 30, 4, 3, 0, 2, 12, 30, 4, 7],
                _ => {}
            }
        }
        let read = read_tet_file("a.msh", &file(&parts, false)).unwrap_or_else(|error| panic!("{error}"));
        assert!(matches!(read.shared_numbers[..], [(2, Place::Byte(_))]), "{:?}", read.shared_numbers);
    }
}

#[test]
fn a_binary_surface_is_read_too() {
    let parts = [
        Text("# vtk DataFile Version 3.0\nt\nBINARY\nDATASET POLYDATA\nPOINTS 5 double\n"),
        Reals(COORDINATES),
        Text("\nPOLYGONS 1 5\n"),
        Ints(&[4, 0, 1, 4, 2]),
    ];
    let surface = read_triangles("a.vtk", &file(&parts, true)).unwrap();
    assert_eq!((surface.positions_m.as_slice(), surface.triangles), (&POSITIONS_M[..], vec![[0, 1, 4], [0, 4, 2]]));
}

#[test]
fn a_binary_file_that_is_cut_short_is_an_error_and_no_byte_in_it_does_harm() {
    for (name, whole, _, after) in files() {
        let content = whole.windows(after.len()).rposition(|piece| piece == after).unwrap();
        for cut in 0..content {
            let error = read_tets(name, &whole[..cut]).expect_err("it is cut short");
            assert!(!error.cure.is_empty(), "{cut}: {error}");
        }
        for at in 0..whole.len() {
            for by in [0, 1, 0x7f, 0xff, b'$', b'\n'] {
                let mut spoiled = whole.clone();
                spoiled[at] = by;
                let Ok(mesh) = read_tets(name, &spoiled) else { continue };
                assert!(mesh.positions_m.as_flattened().iter().all(|coordinate| coordinate.is_finite()), "{at}: {by}");
                assert!(mesh.tets.as_flattened().iter().all(|node| (*node as usize) < mesh.positions_m.len()), "{at}: {by}");
                assert!(mesh.positions_m.len() + mesh.tets.len() <= whole.len(), "{at}: {by}");
            }
        }
    }
}

#[test]
fn an_element_whose_length_is_not_known_is_refused_with_the_cure() {
    let parts =
        [Text("$MeshFormat\n2.2 1 8\n"), Ints(&[1]), Text("\n$EndMeshFormat\n$Elements\n1\n"), Ints(&[71, 1, 0]), Ints(&[1; 20])];
    let error = read_tets("a.msh", &file(&parts, false)).unwrap_err();
    assert_eq!(error.kind, ReadErrorKind::Unsupported, "{error}");
    assert!(error.to_string().contains("type 71") && error.cure.contains("gmsh FILE -save"), "{error}");
}
