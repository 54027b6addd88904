//! Promise: a bad file gives one error that says where, what was found, what was expected and what to do.

use hyst_mesh::{Place, ReadError, ReadErrorKind as Kind, read_tet_file, read_tetgen, read_tets, read_triangles};

const GOOD: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n\
                    $Elements\n1\n1 4 2 0 1 1 2 3 4\n$EndElements\n";

fn error(name: &str, bytes: &[u8]) -> ReadError {
    let error = read_tets(name, bytes).expect_err("the file is bad");
    for part in [&error.found, &error.expected, &error.cure] {
        assert!(!part.is_empty() && part.len() < 400, "{error}");
    }
    error
}

fn changed(from: &str, to: &str) -> ReadError {
    assert!(GOOD.contains(from));
    error("a.msh", GOOD.replacen(from, to, 1).as_bytes())
}

#[test]
fn each_fault_of_a_gmsh_file_is_named_with_its_line() {
    read_tets("a.msh", GOOD.as_bytes()).expect("the file is good before the change");
    let cases = [
        ("3 0 1 0", "3 0 nan 0", Kind::NotFinite, 8),
        ("3 0 1 0", "3 0 1e39 0", Kind::NotFinite, 8),
        ("3 0 1 0", "3 0 one 0", Kind::BadNumber, 8),
        ("3 0 1 0", "2 0 1 0", Kind::DuplicateNode, 8),
        ("1 2 3 4", "1 2 3 44", Kind::MissingNode, 13),
        ("1 2 3 4", "1 2 3", Kind::Truncated, 13),
        ("\n4\n", "\n3\n", Kind::Syntax, 9),
        ("\n4\n", "\n5\n", Kind::BadNumber, 10),
        ("\n4\n", "\n999999999999\n", Kind::AbsurdCount, 5),
        ("\n4\n", "\n-1\n", Kind::AbsurdCount, 5),
        ("2.2 0 8", "2.2 2 8", Kind::Unsupported, 2),
        ("2.2 0 8", "2.2 1 4", Kind::Unsupported, 2),
        ("2.2 0 8", "5.0 0 8", Kind::Unsupported, 2),
        ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "$A\n", Kind::Syntax, 2),
    ];
    for (from, to, kind, line) in cases {
        let error = changed(from, to);
        assert_eq!((error.kind, error.place), (kind, Place::Line(line)), "{from:?} → {to:?}: {error}");
    }
}

/// As programs write them in some languages.
#[test]
fn a_decimal_comma_is_told_as_one() {
    let comma = changed("3 0 1 0", "3 0 1,5 0");
    assert_eq!((comma.kind, comma.place), (Kind::BadNumber, Place::Line(8)), "{comma}");
    assert!(comma.cure.contains("LC_ALL=C") && !changed("3 0 1 0", "3 0 one 0").cure.contains("LC_ALL"), "{comma}");
}

/// Text that says it was binary, as where somebody changed the head.
#[test]
fn what_is_no_binary_file_is_told_by_its_first_number() {
    let error = changed("2.2 0 8", "2.2 1 8");
    assert_eq!((error.kind, error.place), (Kind::Syntax, Place::Byte(20)), "{error}");
    assert!(error.to_string().contains("order of bytes"), "{error}");
}

#[test]
fn a_message_reads_as_a_sentence() {
    let expected = "line 8: found “nan” as y of node 3 of 4, expected a finite coordinate below 3.4e38; \
                    correct the coordinate, or mesh again: the program that wrote the file has failed there";
    assert_eq!(changed("3 0 1 0", "3 0 nan 0").to_string(), expected);
}

#[test]
fn every_cut_of_a_good_file_is_an_error() {
    let end_of_content = GOOD.rfind("$EndElements").expect("it is there");
    for cut in 0..end_of_content {
        error("a.msh", &GOOD.as_bytes()[..cut]);
    }
}

#[test]
fn a_file_without_tets_says_what_it_holds_instead() {
    let surface = GOOD.replace("1 4 2 0 1 1 2 3 4", "1 2 2 0 1 1 2 3");
    assert_eq!(error("a.msh", surface.as_bytes()).kind, Kind::Empty);
    let hexahedra = GOOD.replace("1 4 2 0 1 1 2 3 4", "1 5 2 0 1 1 2 3 4 1 2 3 4");
    assert!(error("a.msh", hexahedra.as_bytes()).found.contains("1 volume cell"));
}

#[test]
fn what_is_not_read_here_names_the_cure() {
    let vtu = |attributes: &str, array: &str| {
        format!(
            "<VTKFile type=\"UnstructuredGrid\" {attributes}><UnstructuredGrid><Piece NumberOfPoints=\"1\" NumberOfCells=\"0\">\
             <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" {array}</DataArray></Points></Piece></UnstructuredGrid>"
        )
    };
    let mut appended = vtu("", "format=\"appended\" offset=\"0\">").into_bytes();
    appended.extend_from_slice(b"<AppendedData encoding=\"raw\">_\x00\xff\xfe<</AppendedData></VTKFile>");
    let compressed = vtu("compressor=\"vtkZLibDataCompressor\"", "format=\"binary\">AAAA") + "</VTKFile>";
    let cases: [(&str, &[u8], &str); 9] = [
        ("a.vtu", &appended, "Ascii"),
        ("a.vtu", compressed.as_bytes(), "Ascii"),
        ("a.vtk", b"# vtk DataFile Version 3.0\nt\nBASE64\nDATASET UNSTRUCTURED_GRID\n", "Ascii"),
        ("a.msh", b"$MeshFormat\n4 1 8\n\x01\x00\x00\x00\n$EndMeshFormat\n", "gmsh FILE -save"),
        ("a.msh.gz", b"\x1f\x8b\x08\x00", "unpack"),
        ("a.mesh", b"\x01\x00\x00\x00\x02\x00\x00\x00\x03\x00\x00\x00\x14\x00\x00\x00", "ASCII .mesh"),
        ("a.meshb", b"\x00\x00\x00\x01\x00\x00\x00\x04\x00\x00\x00\x03", "ASCII .mesh"),
        ("a.ele", b"1 4 0\n1 1 2 3 4\n", "a.node"),
        ("a.obj", b"v 0 0 0\nf 1 1 1\n", "volume mesh"),
    ];
    for (name, bytes, cure) in cases {
        let error = error(name, bytes);
        assert!(error.cure.contains(cure), "{name}: {error}");
        assert!(matches!(error.kind, Kind::Unsupported | Kind::Empty), "{name}: {error}");
    }
    // Of a version that there is none of it is no file of Medit's.
    let version_5 = error("a.meshb", b"\x01\x00\x00\x00\x05\x00\x00\x00");
    assert_eq!(version_5.kind, Kind::UnknownFormat, "{version_5}");
    let unknown = error("a.stl", b"solid a\nfacet normal 0 0 1\n");
    assert!(unknown.kind == Kind::UnknownFormat && unknown.cure.contains("meshio"), "{unknown}");
    assert_eq!(error("a.msh", b" \n").kind, Kind::Truncated);
}

#[test]
fn faults_of_a_vtu_file_are_named_with_their_line() {
    let good = "<VTKFile type=\"UnstructuredGrid\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">\n\
                <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n</DataArray></Points>\n<Cells>\n\
                <DataArray Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray>\n<DataArray Name=\"offsets\">4</DataArray>\n\
                <DataArray Name=\"types\">10</DataArray></Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>";
    read_tets("a.vtu", good.as_bytes()).expect("good before the change");
    let cases = [
        ("0 1 0\n", "0 inf 0\n", Kind::NotFinite, 7),
        ("0 1 0\n", "0 1 0 7\n", Kind::Truncated, 3),
        ("0 1 2 3", "0 1 2 4", Kind::MissingNode, 11),
        ("0 1 2 3", "0 1 2 -1", Kind::MissingNode, 11),
        (">4<", ">5<", Kind::Syntax, 11),
        (">10<", ">ten<", Kind::BadNumber, 13),
        ("</Cells>", "", Kind::Syntax, 14),
        ("\"4\"", "\"99999999999999999999\"", Kind::Truncated, 3),
    ];
    for (from, to, kind, line) in cases {
        let error = error("a.vtu", good.replacen(from, to, 1).as_bytes());
        assert_eq!((error.kind, error.place), (kind, Place::Line(line)), "{from:?} → {to:?}: {error}");
    }
}

#[test]
fn faults_of_a_surface_are_named_with_their_line() {
    let cases = [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", Kind::MissingNode, Place::Line(4)),
        ("v 0 0 0\nf 1 1 0\n", Kind::MissingNode, Place::Line(2)),
        ("v 0 0 0\nf -1 -1 -2\n", Kind::MissingNode, Place::Line(2)),
        ("v 0 0 0\nf 1 x 1\n", Kind::BadNumber, Place::Line(2)),
        ("v 0 0\n", Kind::Truncated, Place::Line(1)),
        ("v 0 0 inf\n", Kind::NotFinite, Place::Line(1)),
        ("v 0 0 0\n", Kind::Empty, Place::File),
    ];
    for (file, kind, place) in cases {
        let error = read_triangles("a.obj", file.as_bytes()).expect_err("the file is bad");
        assert_eq!((error.kind, error.place), (kind, place), "{file:?}: {error}");
    }
}

const FIVE_NODES: &str = "5 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n";

/// Two tets of these regions, as TetGen and as Medit write them.
fn with_regions(first: &str, second: &str) -> [Result<Vec<u32>, ReadError>; 2] {
    let ele = format!("2 4 1\n1 1 2 3 4 {first}\n2 2 3 4 5 {second}\n");
    let medit = format!(
        "MeshVersionFormatted 2\nDimension 3\nVertices 5\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 1 1 0\n\
         Tetrahedra 2\n1 2 3 4 {first}\n2 3 4 5 {second}\nEnd\n"
    );
    [read_tetgen(FIVE_NODES.as_bytes(), ele.as_bytes()), read_tets("a.mesh", medit.as_bytes())]
        .map(|read| read.map(|mesh| mesh.regions))
}

/// Without a word 1.2 and 1.9 were 1, and 0.5 was none.
#[test]
fn a_region_that_is_no_whole_number_is_told() {
    for (first, second, line) in [("1.2", "1.9", 2), ("1", "0.5", 3), ("nan", "1", 2)] {
        let [tetgen, medit] = with_regions(first, second).map(|read| read.expect_err("it is none"));
        assert_eq!((tetgen.kind, tetgen.place), (Kind::BadNumber, Place::Line(line)), "{tetgen}");
        assert!(tetgen.to_string().contains(".ele file") && tetgen.expected.contains("a whole number"), "{tetgen}");
        assert!(tetgen.cure.contains("number the regions"), "{tetgen}");
        assert_eq!(medit.kind, Kind::BadNumber, "{medit}");
    }
    for read in with_regions("3.0", "2") {
        assert_eq!(read, Ok(vec![3, 2]));
    }
}

/// Without a word -1 was 1.
#[test]
fn two_regions_that_would_become_one_are_told_but_for_the_two_ways_round_of_one_of_gmsh() {
    for (first, second) in [("1", "-1"), ("-7", "7"), ("5000000000", "6000000000")] {
        let [tetgen, medit] = with_regions(first, second).map(|read| read.expect_err("they are two"));
        assert_eq!((tetgen.kind, tetgen.place), (Kind::BadNumber, Place::Line(3)), "{tetgen}");
        assert_eq!((medit.kind, medit.place), (Kind::BadNumber, Place::Line(11)), "{medit}");
        assert!(tetgen.to_string().contains(".ele file"), "{tetgen}");
        for error in [tetgen, medit] {
            assert!([first, second].iter().all(|region| error.found.contains(region)), "{error}");
        }
    }
    for read in with_regions("-1", "2") {
        assert_eq!(read, Ok(vec![1, 2]));
    }
    let gmsh = GOOD.replace("\n1\n1 4 2 0 1 1 2 3 4", "\n2\n1 4 2 3 1 1 2 3 4\n2 4 2 -3 1 1 2 3 4");
    assert_eq!(read_tets("a.msh", gmsh.as_bytes()).map(|mesh| mesh.regions), Ok(vec![3, 3]));
}

/// Two volumes of Gmsh 4, of which the first is in the physical group 2 and the second in none.
const GROUP_2_AND_VOLUME_2: &str = "$Entities\n0 0 0 2\n1 0 0 0 1 1 1 1 2 0\n2 0 0 0 1 1 1 0 0\n$EndEntities\n";

/// As where all was saved and not all was in a group: a good file for whoever does not read the numbers.
#[test]
fn a_number_that_a_group_and_a_volume_in_none_share_is_told() {
    let two = GOOD.replace("\n1\n1 4 2 0 1 1 2 3 4", "\n2\n1 4 2 2 1 1 2 3 4\n2 4 2 0 2 1 2 3 4");
    let of_40 = format!(
        "$MeshFormat\n4 0 8\n$EndMeshFormat\n{GROUP_2_AND_VOLUME_2}$Nodes\n1 4\n1 3 0 4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n\
         $EndNodes\n$Elements\n2 2\n1 3 4 1\n1 1 2 3 4\n2 3 4 1\n2 1 2 3 4\n$EndElements\n"
    );
    let of_41 = format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{GROUP_2_AND_VOLUME_2}$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n\
         0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n2 2 1 2\n3 1 4 1\n1 1 2 3 4\n3 2 4 1\n2 1 2 3 4\n$EndElements\n"
    );
    for (file, line) in [(two.as_str(), 14), (of_40.as_str(), 22), (of_41.as_str(), 26)] {
        let read = read_tet_file("a.msh", file.as_bytes()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((read.mesh.regions, read.shared_numbers), (vec![2, 2], vec![(2, Place::Line(line))]));
    }
    // With another number it is another region.
    let [of_40, of_41] = [of_40, of_41].map(|file| file.replace("\n1 0 0 0 1 1 1 1 2 0\n", "\n1 0 0 0 1 1 1 1 3 0\n"));
    for file in [two.replace(" 2 2 1 1 2 3 4", " 2 3 1 1 2 3 4"), of_40, of_41] {
        let read = read_tet_file("a.msh", file.as_bytes()).map(|read| (read.mesh.regions, read.shared_numbers));
        assert_eq!(read, Ok((vec![3, 2], Vec::new())));
    }
}

#[test]
fn a_fault_of_a_tetgen_pair_names_the_file() {
    let error = read_tetgen(b"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n", b"1 4 0\n1 1 2 3 4\n").expect_err("a point is missing");
    assert_eq!(error.kind, Kind::Truncated);
    assert!(error.to_string().contains(".node file"), "{error}");
    let missing = read_tetgen(FIVE_NODES.as_bytes(), b"1 4 0\n1 1 2 3 6\n").expect_err("there is no node 6");
    assert!(missing.kind == Kind::MissingNode && missing.to_string().contains(".ele file"), "{missing}");
    let twice = read_tetgen(FIVE_NODES.replace("\n5 1", "\n4 1").as_bytes(), b"1 4 0\n1 1 2 3 4\n").expect_err("two nodes 4");
    assert!(twice.kind == Kind::DuplicateNode && twice.to_string().contains(".node file"), "{twice}");
}
