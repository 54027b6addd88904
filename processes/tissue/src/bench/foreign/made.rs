//! Meshes of the kinds that others make, made here, small, and always tried: graded and jittered; with slivers; in pieces that have nodes of their own where
//! they touch; in millimetres; one tet thick, its nodes and tets in no order. Each is read from a file, repaired, pressed and cut as those of a folder are.

use super::super::linear::block;
use super::{Copied, EXTENT_M, cut_in_two, pressed, scene_of};
use hyst_mesh::{TetMesh, check};
use std::f32::consts::TAU;

/// Where each begins before the pivot, m: the scope comes along +z to its middle.
const NEAR_M: f32 = 0.03;
/// How far from its far face, or from its middle, nodes are held, m: more than rounding.
const MARGIN_M: f32 = 1e-4;
/// Spaces between the lines of the graded block, in the least of them, across the scope's way and along it. In the middle no line is: there it is cut.
const ACROSS: [f32; 7] = [10.0, 4.6, 2.2, 1.0, 2.2, 4.6, 10.0];
const ALONG: [f32; 5] = [1.0, 1.8, 3.2, 5.6, 10.0];
/// Cells of the cubes, likewise.
const CELLS: [usize; 2] = [7, 6];
/// By how much of the lesser space beside it an inner node is moved along each axis at most: no tet turns inside out by that.
const JITTER: f32 = 0.15;
/// Height of a sliver as a share of what it was.
const SLIVER: f32 = 1e-4;
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

/// A number from −1 to 1 for each of some things, in no order that is to be seen: multiples of an irrational number without their whole part.
fn scattered(index: usize, which: usize) -> f32 {
    const STEPS: [f64; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
    (2.0 * (index as f64 * STEPS[which]).fract() - 1.0) as f32
}

/// Lines with these spaces between them, from the first to the last, m.
fn spaced_m(spaces: &[f32], [low_m, high_m]: [f32; 2]) -> Vec<f32> {
    let whole: f32 = spaces.iter().sum();
    let mut gone = 0.0;
    let line_m = |space: &f32| {
        gone += space;
        low_m + (high_m - low_m) * gone / whole
    };
    std::iter::once(low_m).chain(spaces.iter().map(line_m)).collect()
}

/// The lines on which a node of a block lies.
fn lines_of(node: usize, lines_m: &[Vec<f32>; 3]) -> [usize; 3] {
    let [x, y] = [0, 1].map(|axis| lines_m[axis].len());
    [node % x, node / x % y, node / x / y]
}

/// Whether a node of a block lies inside.
fn is_inner(at: [usize; 3], lines_m: &[Vec<f32>; 3]) -> bool {
    (0..3).all(|axis| at[axis] > 0 && at[axis] + 1 < lines_m[axis].len())
}

/// A block with nodes where these lines cross.
fn grid(lines_m: &[Vec<f32>; 3]) -> TetMesh {
    let mut mesh = block([0, 1, 2].map(|axis| lines_m[axis].len() - 1), [0.0; 3]);
    for (node, place_m) in mesh.positions_m.iter_mut().enumerate() {
        let at = lines_of(node, lines_m);
        *place_m = [0, 1, 2].map(|axis| lines_m[axis][at[axis]]);
    }
    mesh
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
    let mut mesh = grid(&lines_m);
    for (node, place_m) in mesh.positions_m.iter_mut().enumerate() {
        let at = lines_of(node, &lines_m);
        if is_inner(at, &lines_m) {
            for axis in 0..3 {
                let [before_m, here_m, after_m] = [at[axis] - 1, at[axis], at[axis] + 1].map(|line| lines_m[axis][line]);
                place_m[axis] += JITTER * (here_m - before_m).min(after_m - here_m) * scattered(node, axis);
            }
        }
    }
    mesh
}

/// A cube in which every second inner node on each axis lies nearly in a face that is opposite to it. No two of them have a tet in common, and what the tets
/// around each fill is convex, so that none turns inside out.
fn with_slivers() -> TetMesh {
    let lines_m = even_m();
    let mut mesh = grid(&lines_m);
    for node in 0..mesh.positions_m.len() {
        let at = lines_of(node, &lines_m);
        let around = mesh.tets.iter().find(|tet| tet.contains(&(node as u32)));
        let Some(tet) = around.filter(|_| is_inner(at, &lines_m) && at.iter().all(|line| line % 2 == 0)) else { continue };
        let face = tet.iter().map(|corner| *corner as usize).filter(|corner| *corner != node);
        let middle_m =
            face.fold([0.0; 3], |sum: [f32; 3], corner| [0, 1, 2].map(|axis| sum[axis] + mesh.positions_m[corner][axis] / 3.0));
        mesh.positions_m[node] = [0, 1, 2].map(|axis| {
            let before_m = mesh.positions_m[node][axis];
            middle_m[axis] + SLIVER * (before_m - middle_m[axis])
        });
    }
    mesh
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
    let mut mesh = block([around, 1, along], [0.0; 3]);
    let in_turn = around + 1;
    for (node, place_m) in mesh.positions_m.iter_mut().enumerate() {
        let [turn, out, far] = [node % in_turn, node / in_turn % 2, node / in_turn / 2];
        let (sin, cos) = (TAU * turn as f32 / around as f32).sin_cos();
        let radius_m = OUTER_M - THICK_M * (1 - out) as f32;
        let x_m = EXTENT_M * (far as f32 / along as f32 - 0.5);
        *place_m = [x_m, radius_m * sin, NEAR_M + OUTER_M - radius_m * cos];
    }
    for corner in mesh.tets.as_flattened_mut() {
        *corner -= if *corner as usize % in_turn == around { around as u32 } else { 0 };
    }
    mesh
}

/// The same mesh with its nodes and its tets in no order.
fn in_no_order(mesh: &TetMesh) -> TetMesh {
    let order = |count: usize, which: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|one, other| scattered(*one, which).total_cmp(&scattered(*other, which)));
        order
    };
    let nodes = order(mesh.positions_m.len(), 0);
    let mut now = vec![0; nodes.len()];
    nodes.iter().zip(0..).for_each(|(node, number)| now[*node] = number);
    let tets = order(mesh.tets.len(), 1);
    TetMesh {
        positions_m: nodes.iter().map(|node| mesh.positions_m[*node]).collect(),
        tets: tets.iter().map(|tet| mesh.tets[*tet].map(|node| now[node as usize])).collect(),
        regions: mesh.regions.clone(),
    }
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
