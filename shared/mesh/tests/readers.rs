//! Promise: the same two tets come out of every format that can hold them, however liberally the file is written.

use hyst_mesh::*;

const POSITIONS_M: [[f32; 3]; 5] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]];
const TETS: [[u32; 4]; 2] = [[0, 1, 2, 3], [1, 2, 3, 4]];

fn expect(name: &str, file: &str, regions: [u32; 2]) {
    for text in [file.to_string(), file.replace('\n', "\r\n"), format!("\u{feff}{file}"), file.replace(' ', " \t ")] {
        let mesh = read_tets(name, text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(mesh.positions_m, POSITIONS_M);
        assert_eq!(mesh.tets, TETS);
        assert_eq!(mesh.regions, regions);
    }
}

#[test]
fn gmsh_1_with_a_triangle_in_between() {
    let file = "$NOD\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$ENDNOD\n$ELM\n3\n\
                1 4 7 1 4 1 2 3 4\n2 2 1 1 3 1 2 3\n3 4 8 1 4 2 3 4 5\n$ENDELM\n";
    expect("a.msh", file, [7, 8]);
}

#[test]
fn gmsh_2_with_sparse_unordered_tags_and_unknown_sections() {
    let file = "$Comments\nby hand\n$EndComments\n$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 4 \"wall\"\n\
                $EndPhysicalNames\n$Nodes\n5\n90 0.D0 0 0\n12 1.0d+00 0 0\n30 0 1e0 0\n4 0 0 +1\n7 1 1 1\n$EndNodes\n\
                $Elements\n4\n1 15 2 0 1 90\n2 4 4 3 1 1 -2 90 12 30 4\n5 3 0 1 2 3 4\n9 4 2 4 1 12 30 4 7\n$EndElements\n\
                $NodeData\n1\n\"T\"\n$EndNodeData\n";
    expect("a.msh", file, [3, 4]);
}

#[test]
fn a_tet_of_gmsh_1_or_2_in_no_physical_group_has_the_number_of_its_volume() {
    let nodes = "5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n";
    let two = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes}$EndNodes\n\
         $Elements\n2\n1 4 2 0 12 1 2 3 4\n2 4 4 0 13 1 -2 2 3 4 5\n$EndElements\n"
    );
    expect("a.msh", &two, [12, 13]);
    let one = format!("$NOD\n{nodes}$ENDNOD\n$ELM\n2\n1 4 0 12 4 1 2 3 4\n2 4 0 0 4 2 3 4 5\n$ENDELM\n");
    expect("a.msh", &one, [12, 0]);
}

const GMSH_41_HEAD: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 0 1 2\n1 0 0 0 0\n\
                            5 0 0 0 1 1 1 0 0\n1 0 0 0 1 1 1 1 11 1 5\n2 0 0 0 1 1 1 0 0\n$EndEntities\n";

#[test]
fn gmsh_4_1_with_several_blocks_parametric_nodes_and_physical_groups() {
    let file = format!(
        "{GMSH_41_HEAD}$Nodes\n3 5 1 50\n0 1 0 1\n50\n0 0 0\n2 5 1 2\n3\n1\n1 0 0 0.5 0.5\n0 1 0 0.1 0.2\n\
         3 1 0 2\n10\n20\n0 0 1\n1 1 1\n$EndNodes\n$Elements\n3 3 1 3\n2 5 2 1\n1 50 3 1\n3 1 4 1\n2 50 3 1 10\n\
         3 2 4 1\n3 3 1 10 20\n$EndElements\n"
    );
    expect("a.msh", &file, [11, 2]);
}

#[test]
fn gmsh_4_1_with_partitions() {
    let partitioned = "$PartitionedEntities\n2\n0\n0 0 0 2\n8 3 1 1 1 0 0 0 1 1 1 1 11 0\n9 3 1 1 2 0 0 0 1 1 1 1 12 0\n\
                       $EndPartitionedEntities\n";
    let file = format!(
        "{GMSH_41_HEAD}{partitioned}$Nodes\n1 5 1 5\n3 8 0 5\n1\n2\n3\n4\n5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n$EndNodes\n\
         $Elements\n2 2 1 2\n3 8 4 1\n1 1 2 3 4\n3 9 4 1\n2 2 3 4 5\n$EndElements\n$GhostElements\n0\n$EndGhostElements\n"
    );
    expect("a.msh", &file, [11, 12]);
}

#[test]
fn gmsh_4_0_whose_nodes_carry_their_tags() {
    let file = "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n1 5\n6 3 0 5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$EndNodes\n\
                $Elements\n1 2\n6 3 4 2\n1 1 2 3 4\n2 2 3 4 5\n$EndElements\n";
    expect("a.msh", file, [6, 6]);
}

/// Without a word each volume was a region of its own, and a `tag` of a scene chose by the volume's number.
#[test]
fn gmsh_4_0_with_a_point_and_two_volumes_of_which_one_is_in_a_physical_group() {
    let file = "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Entities\n1 0 0 2\n1 0 0 0 0 0 0 1 7\n5 0 0 0 1 1 1 2 11 12 1 3\n\
                6 0 0 0 1 1 1 0 0\n$EndEntities\n$Nodes\n1 5\n5 3 0 5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$EndNodes\n\
                $Elements\n2 2\n5 3 4 1\n1 1 2 3 4\n6 3 4 1\n2 2 3 4 5\n$EndElements\n";
    expect("a.msh", file, [11, 6]);
}

const VTK_HEAD: &str = "# vtk DataFile Version 3.0\nPOINTS in the title\nASCII\nDATASET UNSTRUCTURED_GRID\n\
                        FIELD FieldData 1\nt 1 1 double\n0.5\nPOINTS 5 float\n0 0 0 1 0 0\n0 1 0\n0 0 1 1 1 1\n";

#[test]
fn vtk_legacy_with_mixed_cells() {
    let file = format!(
        "{VTK_HEAD}CELLS 3 14\n4 0 1 2 3\n3 0 1 2\n4 1 2 3 4\nCELL_TYPES 3\n10 5 10\nCELL_DATA 3\nSCALARS a int\n\
         LOOKUP_TABLE default\n1 2 3\n"
    );
    expect("a.vtk", &file, [0, 0]);
}

#[test]
fn vtk_legacy_5_1_with_offsets() {
    let file = format!(
        "{VTK_HEAD}METADATA\nINFORMATION 0\n\nCELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n\
         0 1 2 3 1 2 3 4\nCELL_TYPES 2\n10\n10\n"
    );
    expect("a.vtk", &file, [0, 0]);
}

/// Quadratic, Lagrange's and Bézier's: of each the corners come first.
#[test]
fn vtk_tets_of_higher_order_give_their_corners() {
    for kind in [24, 71, 78] {
        let file = format!("{VTK_HEAD}CELLS 3 20\n10 0 1 2 3 4 4 4 4 4 4\n3 0 1 2\n4 1 2 3 4\nCELL_TYPES 3\n{kind} 5 10\n");
        expect("a.vtk", &file, [0, 0]);
    }
}

#[test]
fn vtk_legacy_surface_with_a_quad() {
    let file = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n0 0 0 1 0 0 1 1 0 0 1 0\nPOLYGONS 1 5\n4 0 1 2 3\n";
    let surface = read_triangles("a.vtk", file.as_bytes()).unwrap();
    assert_eq!(surface.triangles, [[0, 1, 2], [0, 2, 3]]);
}

fn vtu(points: &str, more: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\">\n\
         <UnstructuredGrid><Piece NumberOfPoints=\"5\" NumberOfCells=\"3\">\n<PointData/>\n<Points>{points}</Points>\n<Cells>\n\
         <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">\n0 1 2 3\n0 1 2 1 2 3 4\n</DataArray>\n\
         <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\"> 4 7 11 </DataArray>\n\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"> 10 5 10 </DataArray>\n</Cells></Piece></UnstructuredGrid>{more}\n</VTKFile>\n"
    )
}

#[test]
fn vtk_xml_as_text() {
    let points =
        "<DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0\n0 0 1 1 1 1</DataArray>";
    expect("a.vtu", &vtu(points, ""), [0, 0]);
}

/// Base64, written out here so that the reader's own crate does not vouch for itself.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits = three.iter().chain([&0; 2]).take(3).fold(0_usize, |bits, &byte| (bits << 8) | usize::from(byte));
        for place in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * place)) & 63] as char;
            text.push(if place <= three.len() { digit } else { '=' });
        }
    }
    text
}

#[test]
fn vtk_xml_as_base64_with_head_and_data_together_or_apart() {
    let data: Vec<u8> = POSITIONS_M.as_flattened().iter().flat_map(|c| c.to_le_bytes()).collect();
    let head = 60_u32.to_le_bytes();
    for packed in [base64(&[&head, data.as_slice()].concat()), base64(&head) + &base64(&data)] {
        let points = format!("<DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"binary\">\n {packed}\n</DataArray>");
        let file = vtu(&points, "").replace(" compressor=\"vtkZLibDataCompressor\"", "");
        let mesh = read_tets("a.vtu", file.as_bytes()).unwrap();
        assert_eq!((mesh.positions_m.as_slice(), mesh.tets.as_slice()), (&POSITIONS_M[..], &TETS[..]));
        let error = read_tets("a.vtu", vtu(&points, "").as_bytes()).unwrap_err();
        assert_eq!(error.kind, ReadErrorKind::Unsupported, "a compressed array: {error}");
    }
}

#[test]
fn medit() {
    let file = "MeshVersionFormatted 2\n# by hand\nDimension\n3\nVertices\n5\n0 0 0 0\n1 0 0 0 # second\n0 1 0 0\n0 0 1 0\n1 1 1 0\n\
                Triangles\n1\n1 2 3 5\nTetrahedra 2\n1 2 3 4 6\n2 3 4 5 9\nEnd\n";
    expect("a.mesh", file, [6, 9]);
}

#[test]
fn tetgen_counted_from_0_and_from_1() {
    for base in [0, 1] {
        let node: String = POSITIONS_M.iter().zip(base..).map(|([x, y, z], tag)| format!("  {tag}  {x} {y} {z} 1\r\n")).collect();
        let ele: String = TETS
            .iter()
            .zip(base..)
            .map(|(t, tag)| format!("{tag} {} {} {} {} 3\n", t[0] + base, t[1] + base, t[2] + base, t[3] + base))
            .collect();
        let mesh =
            read_tetgen(format!("# points\n5 3 0 1\n{node}").as_bytes(), format!("2 4 1\n{ele}# end\n").as_bytes()).unwrap();
        assert_eq!(mesh.positions_m, POSITIONS_M);
        assert_eq!(mesh.tets, TETS);
        assert_eq!(mesh.regions, [3, 3]);
    }
    assert_eq!(companion_name("a/b.ele").as_deref(), Some("a/b.node"));
    assert_eq!(companion_name("a/b.vtk"), None);
}

/// The region is behind the nodes in the middle of the edges.
#[test]
fn tetgen_with_ten_nodes_per_tet_gives_the_corners_and_the_region() {
    let node: String = POSITIONS_M.iter().zip(1..).map(|([x, y, z], tag)| format!("{tag} {x} {y} {z}\n")).collect();
    let ele = "2 10 1\n1 1 2 3 4 5 5 5 5 5 5 7\n2 2 3 4 5 1 1 1 1 1 1 8\n";
    let mesh = read_tetgen(format!("5 3 0 0\n{node}").as_bytes(), ele.as_bytes()).unwrap();
    assert_eq!((mesh.tets.as_slice(), mesh.regions.as_slice()), (&TETS[..], &[7, 8][..]));
}

#[test]
fn obj_with_groups_is_one_surface_and_polygons_become_fans() {
    let file = "# cm\nmtllib a.mtl\no first\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\ng one\nusemtl red\nf 1/1/1 2/1/1 3//1 4\n\
                g two\nv 0 0 1\nusemtl blue\nf -1 -5 -4\nl 1 2\np 3\n";
    let surface = read_triangles("a.obj", file.replace('\n', "\r\n").as_bytes()).unwrap();
    assert_eq!(surface.positions_m, [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0., 0., 1.]]);
    assert_eq!(surface.triangles, [[0, 1, 2], [0, 2, 3], [4, 0, 1]]);
}

#[test]
fn quadratic_tets_give_their_corners_and_the_midpoints_stay_unused() {
    let file = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n10\n1 0 0 0\n2 2 0 0\n3 0 2 0\n4 0 0 2\n5 1 0 0\n6 1 1 0\n7 0 1 0\n8 0 0 1\n\
                9 0 1 1\n10 1 0 1\n$EndNodes\n$Elements\n2\n1 11 2 0 1 1 2 3 4 5 6 7 8 9 10\n2 5 0 1 2 3 4 5 6 7 8\n$EndElements\n";
    let read = read_tet_file("a.msh", file.as_bytes()).unwrap();
    assert_eq!(read.mesh.tets, [[0, 1, 2, 3]]);
    assert_eq!(read.other_volume_cells, 1);
    assert_eq!(check(&read.mesh).unused_nodes, [4, 5, 6, 7, 8, 9]);
}

#[test]
fn content_goes_before_the_name() {
    let gmsh = "$NOD\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$ENDNOD\n$ELM\n1\n1 4 1 1 4 1 2 3 4\n$ENDELM";
    assert_eq!(detect("a.vtu", gmsh.as_bytes()), Ok(Format::Gmsh));
    assert_eq!(read_tets("without-extension", gmsh.as_bytes()).unwrap().tets, [[0, 1, 2, 3]]);
}

#[test]
fn scaling_turns_millimetres_into_metres() {
    let mut mesh = TetMesh { positions_m: vec![[1000.0, -500.0, 0.0]], ..TetMesh::default() };
    mesh.scale_to_m(Unit::Millimetre.metres());
    assert_eq!(mesh.positions_m, [[1.0, -0.5, 0.0]]);
}
