//! Meshes of the kinds that others make, made here of blocks: graded and jittered; with slivers; one tet thick; in no order. The tests of the cuts
//! draw strokes through small ones, and the bench of the process presses and cuts larger ones (`processes/tissue/src/bench/foreign/made.rs`).
//!
//! A block is one of cells along each axis, six tets each, its nodes along x first, then y, then z.

use hyst_mesh::TetMesh;
use std::f32::consts::TAU;

/// By how much of the lesser space beside it an inner node is moved along each axis at most: no tet turns inside out by that.
const JITTER: f32 = 0.15;
/// Height of a sliver as a share of what it was.
const SLIVER: f32 = 1e-4;

/// A number from −1 to 1 for each of some things, in no order that is to be seen: multiples of an irrational number without their whole part.
fn scattered(index: usize, which: usize) -> f32 {
    const STEPS: [f64; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
    (2.0 * (index as f64 * STEPS[which]).fract() - 1.0) as f32
}

/// Lines with these spaces between them, from the first to the last, m.
pub fn spaced_m(spaces: &[f32], [low_m, high_m]: [f32; 2]) -> Vec<f32> {
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

/// A block with its nodes where these lines cross.
pub fn on_lines(mut block: TetMesh, lines_m: &[Vec<f32>; 3]) -> TetMesh {
    for (node, place_m) in block.positions_m.iter_mut().enumerate() {
        let at = lines_of(node, lines_m);
        *place_m = [0, 1, 2].map(|axis| lines_m[axis][at[axis]]);
    }
    block
}

/// A block on these lines, its inner nodes jittered.
pub fn jittered(mut block: TetMesh, lines_m: &[Vec<f32>; 3]) -> TetMesh {
    for (node, place_m) in block.positions_m.iter_mut().enumerate() {
        let at = lines_of(node, lines_m);
        if is_inner(at, lines_m) {
            for axis in 0..3 {
                let [before_m, here_m, after_m] = [at[axis] - 1, at[axis], at[axis] + 1].map(|line| lines_m[axis][line]);
                place_m[axis] += JITTER * (here_m - before_m).min(after_m - here_m) * scattered(node, axis);
            }
        }
    }
    block
}

/// A block on these lines in which every second inner node on each axis lies nearly in a face that is opposite to it. No two of them have a tet in common, and
/// what the tets around each fill is convex, so that none turns inside out.
pub fn with_slivers(mut block: TetMesh, lines_m: &[Vec<f32>; 3]) -> TetMesh {
    for node in 0..block.positions_m.len() {
        let at = lines_of(node, lines_m);
        let around = block.tets.iter().find(|tet| tet.contains(&(node as u32)));
        let Some(tet) = around.filter(|_| is_inner(at, lines_m) && at.iter().all(|line| line % 2 == 0)) else { continue };
        let face = tet.iter().map(|corner| *corner as usize).filter(|corner| *corner != node);
        let middle_m =
            face.fold([0.0; 3], |sum: [f32; 3], corner| [0, 1, 2].map(|axis| sum[axis] + block.positions_m[corner][axis] / 3.0));
        block.positions_m[node] = [0, 1, 2].map(|axis| {
            let before_m = block.positions_m[node][axis];
            middle_m[axis] + SLIVER * (before_m - middle_m[axis])
        });
    }
    block
}

/// A block of one cell along y rolled to a tube, of an outer radius, a thickness and a length along x, m, around the origin; the nodes where it closes are there
/// twice, those of the last cells unused.
pub fn tube(mut block: TetMesh, [around, along]: [usize; 2], [outer_m, thick_m, long_m]: [f32; 3]) -> TetMesh {
    let in_turn = around + 1;
    for (node, place_m) in block.positions_m.iter_mut().enumerate() {
        let [turn, out, far] = [node % in_turn, node / in_turn % 2, node / in_turn / 2];
        let (sin, cos) = (TAU * turn as f32 / around as f32).sin_cos();
        let radius_m = outer_m - thick_m * (1 - out) as f32;
        *place_m = [long_m * (far as f32 / along as f32 - 0.5), radius_m * sin, -radius_m * cos];
    }
    for corner in block.tets.as_flattened_mut() {
        *corner -= if *corner as usize % in_turn == around { around as u32 } else { 0 };
    }
    block
}

/// The same mesh with its nodes and its tets in no order.
pub fn in_no_order(mesh: &TetMesh) -> TetMesh {
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
