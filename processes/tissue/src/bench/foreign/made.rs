//! Meshes of the kinds that others make, made here, small, and always tried: graded and jittered; with slivers; in pieces that have nodes of their own where
//! they touch; in millimetres; one tet thick, its nodes and tets in no order. Each is read from a file, repaired, pressed and cut as those of a folder are.

#[path = "../../../../../shared/tissue/tests/common/kinds.rs"]
mod kinds;

use super::super::linear::block;
use super::{Copied, EXTENT_M, cut_in_two, pressed, scene_of};
use hyst_mesh::{TetMesh, check};
use kinds::{in_no_order, jittered, on_lines, spaced_m};

/// Where each begins before the pivot, m: the scope comes along +z to its middle.
const NEAR_M: f32 = 0.03;
/// How far from its far face, or from its middle, nodes are held, m: more than rounding.
const MARGIN_M: f32 = 1e-4;
/// Spaces between the lines of the graded block, in the least of them, across the scope's way and along it. In the middle no line is: there it is cut.
const ACROSS: [f32; 7] = [10.0, 4.6, 2.2, 1.0, 2.2, 4.6, 10.0];
const ALONG: [f32; 5] = [1.0, 1.8, 3.2, 5.6, 10.0];
/// Cells of the cubes, likewise.
const CELLS: [usize; 2] = [7, 6];
/// The tube: its outer radius and its thickness, m, and its cells around and along its axis, which lies across the scope's way.
const OUTER_M: f32 = 0.02;
const THICK_M: f32 = 0.002;
const TUBE: [usize; 2] = [24, 13];
/// How deep each is pressed at least, m: the scene's hand goes 4 mm into it.
const DEEP_M: f32 = 3.5e-3;

/// A mesh to be tried.
struct Made {
    name: &'static str,
    /// As the file has it, m; each with nodes of its own.
    pieces: Vec<TetMesh>,
    /// Unit of the file.
    metres_per_unit: f32,
    /// What lies from here on along z is held, m.
    held_from_m: f32,
    /// What is said of it, among others.
    said: &'static str,
}

/// A block with nodes where these lines cross.
fn grid(lines_m: &[Vec<f32>; 3]) -> TetMesh {
    on_lines(block([0, 1, 2].map(|axis| lines_m[axis].len() - 1), [0.0; 3]), lines_m)
}

/// The lines of a cube.
fn even_m() -> [Vec<f32>; 3] {
    let half_m = 0.5 * EXTENT_M;
    let across_m = spaced_m(&[1.0; CELLS[0]], [-half_m, half_m]);
    [across_m.clone(), across_m, spaced_m(&[1.0; CELLS[1]], [NEAR_M, NEAR_M + EXTENT_M])]
}

/// A block whose edges are ten times as long at its far corners as where the scope meets it, its inner nodes jittered.
fn graded() -> TetMesh {
    let (half_m, least_m) = (0.5 * EXTENT_M, EXTENT_M / ACROSS.iter().sum::<f32>());
    let across_m = spaced_m(&ACROSS, [-half_m, half_m]);
    let along_m = spaced_m(&ALONG, [NEAR_M, NEAR_M + least_m * ALONG.iter().sum::<f32>()]);
    let lines_m = [across_m.clone(), across_m, along_m];
    jittered(grid(&lines_m), &lines_m)
}

/// A cube in which every second inner node on each axis lies nearly in a face that is opposite to it.
fn with_slivers() -> TetMesh {
    let lines_m = even_m();
    kinds::with_slivers(grid(&lines_m), &lines_m)
}

/// The near and the far half of a cube, each with nodes of its own between them.
fn halves() -> Vec<TetMesh> {
    let [x, y, z] = even_m();
    let middle = z.len() / 2;
    [&z[..=middle], &z[middle..]].map(|z| grid(&[x.clone(), y.clone(), z.to_vec()])).into()
}

/// A tube, one tet thick; the nodes where it closes are there twice, those of the last cells unused.
fn tube() -> TetMesh {
    let [around, along] = TUBE;
    let mut mesh = kinds::tube(block([around, 1, along], [0.0; 3]), TUBE, [OUTER_M, THICK_M, EXTENT_M]);
    mesh.positions_m.iter_mut().for_each(|place_m| place_m[2] += NEAR_M + OUTER_M);
    mesh
}

/// A mesh that is held at its far end, its file in metres.
fn made(name: &'static str, pieces: Vec<TetMesh>, said: &'static str) -> Made {
    let far_m = pieces.iter().flat_map(|piece| &piece.positions_m).map(|place_m| place_m[2]).fold(f32::MIN, f32::max);
    Made { name, pieces, metres_per_unit: 1.0, held_from_m: far_m - MARGIN_M, said }
}

fn all() -> [Made; 5] {
    [
        made("graded", vec![graded()], ""),
        made("slivers", vec![with_slivers()], "of nearly no height"),
        made("halves", halves(), "merged 64 nodes with others at the same places: at 98 faces"),
        Made { metres_per_unit: 0.001, ..made("millimetres", vec![grid(&even_m())], "") },
        Made {
            held_from_m: NEAR_M + OUTER_M - MARGIN_M,
            ..made("tube", vec![in_no_order(&tube())], "dropped 28 nodes that no tet uses")
        },
    ]
}

/// A file of these pieces.
fn vtu(pieces: &[TetMesh], metres_per_unit: f32) -> String {
    let array = |kind: &str, name: &str, more: &str, values: String| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" {more}format=\"ascii\">{values}</DataArray>\n")
    };
    let piece = |mesh: &TetMesh| {
        let (nodes, tets) = (mesh.positions_m.len(), mesh.tets.len());
        let points = mesh.positions_m.iter().flatten().map(|place_m| format!("{} ", place_m / metres_per_unit)).collect();
        let corners = mesh.tets.iter().flatten().map(|node| format!("{node} ")).collect();
        let ends = (1..=tets).map(|tet| format!("{} ", 4 * tet)).collect();
        format!(
            "<Piece NumberOfPoints=\"{nodes}\" NumberOfCells=\"{tets}\">\n<Points>\n{}</Points>\n<Cells>\n{}{}{}</Cells>\n</Piece>\n",
            array("Float32", "Points", "NumberOfComponents=\"3\" ", points),
            array("Int64", "connectivity", "", corners),
            array("Int64", "offsets", "", ends),
            array("UInt8", "types", "", "10 ".repeat(tets)),
        )
    };
    let pieces: String = pieces.iter().map(piece).collect();
    format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n<UnstructuredGrid>\n{pieces}\
         </UnstructuredGrid>\n</VTKFile>\n"
    )
}

#[test]
fn meshes_of_the_kinds_that_others_make_are_one_organ_that_is_pressed_no_farther_than_the_tool_comes_and_cut_in_two() {
    let folder = Copied::empty("meshes of the kinds that others make");
    for made in all() {
        let (name, file) = (made.name, format!("{}.vtu", made.name));
        std::fs::write(folder.0.join(&file), vtu(&made.pieces, made.metres_per_unit)).unwrap();
        let (unit, held_from_m) = (made.metres_per_unit, made.held_from_m);
        let more = format!("scale_to_m = {unit:?}\nfixed = [{{ above_z_m = {held_from_m:?} }}]\n");
        let scene = scene_of(&folder, &file, &more).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {}", scene.notes.join("; "));
        let is_said = made.said.is_empty() || scene.notes.iter().any(|note| note.contains(made.said));
        assert!(is_said, "{name}: nothing is said of “{}”", made.said);
        let (found, tets) = (check(&scene.objects[0].mesh), made.pieces.iter().map(|piece| piece.tets.len()).sum::<usize>());
        assert!(
            (500..=2_000).contains(&tets) && found.tets == tets && found.components == 1,
            "{name}: {tets} tets became\n{found}"
        );
        assert!((found.extent_m() / EXTENT_M - 1.0).abs() < 1e-5, "{name}: {} m", found.extent_m());

        let pressed = pressed(scene.clone()).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("    {}", pressed.said);
        // Tissue goes with the tip, or to its side, by half of the tool's diameter at most.
        let (deep_m, far_m) = (pressed.deep_m, pressed.deep_m + scene.rigid[0].radius_m);
        assert!(deep_m > DEEP_M, "{name}: pressed by {deep_m} m");
        assert!(pressed.most_m < far_m, "{name}: a node went {} m, the tip {deep_m} m", pressed.most_m);
        println!("    {}", cut_in_two(name, &scene));
    }
}
