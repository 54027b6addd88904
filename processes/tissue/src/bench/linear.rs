//! How the cost of a step grows with the mesh: blocks of cells of one size, from 1 080 to 50 400 tets, with the tip of the scene's instrument pressed into them.

use super::complete;
use super::press::Press;
use hyst_engine::bench::{quantile_ns, target};
use hyst_mesh::{Binding, TetMesh, boundary};
use hyst_scene::{DeformableKind, LoadedDeformable, LoadedScene};
use hyst_tissue::Isa;
use serde_json::{Value, json};

/// Cells of the blocks, six tets each.
const CELLS: [[usize; 3]; 5] = [[6, 6, 5], [12, 12, 4], [12, 12, 12], [16, 16, 16], [20, 20, 21]];
/// Edge of a cell, m.
const EDGE_M: f32 = 3e-3;
/// How deep the tip is pressed in, m.
const DEEP_M: f32 = 1e-3;
/// Longest time of a run, ns.
const RUN_NS: u64 = 1_200_000_000;
/// How many times as much one more tet may cost up to one of the blocks as up to another. What does not grow, the tool's points and planes, is in the least
/// block as in all others; the largest does not fit into a core's own cache.
const MOST_RATIO: f64 = 1.5;

/// A block whose near face is before the tip, less how deep that is pressed in. Its nodes go along x first, then y, then z.
pub fn block(cells: [usize; 3], tip_m: [f32; 3]) -> TetMesh {
    let [nx, ny, _] = cells.map(|count| count + 1);
    let number = |[x, y, z]: [usize; 3]| ((z * ny + y) * nx + x) as u32;
    let in_order = |[x, y, z]: [usize; 3]| (0..z).flat_map(move |k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])));
    let middle = |axis: usize| if axis == 2 { DEEP_M } else { 0.5 * cells[axis] as f32 * EDGE_M };
    let place = |at: [usize; 3]| std::array::from_fn(|axis| tip_m[axis] + at[axis] as f32 * EDGE_M - middle(axis));
    // About the diagonal of each cell; half of the orders are of the other handedness.
    let orders =
        [([0, 1, 2], false), ([1, 2, 0], false), ([2, 0, 1], false), ([1, 0, 2], true), ([0, 2, 1], true), ([2, 1, 0], true)];
    let tet = |cell: [usize; 3], (order, is_odd): ([usize; 3], bool)| {
        let mut at = cell;
        let mut tet = [number(at); 4];
        for (corner, axis) in (1usize..).zip(order) {
            at[axis] += 1;
            tet[corner] = number(at);
        }
        if is_odd {
            tet.swap(2, 3);
        }
        tet
    };
    let tets: Vec<[u32; 4]> = in_order(cells).flat_map(|cell| orders.map(|order| tet(cell, order))).collect();
    let positions_m = in_order(cells.map(|count| count + 1)).map(place).collect();
    TetMesh { positions_m, regions: vec![0; tets.len()], tets }
}

/// The scene with a block as its only object, held at its far face, and no hand: the tool rests.
pub fn with_block(scene: &LoadedScene, cells: [usize; 3]) -> Option<LoadedScene> {
    let mesh = block(cells, scene.rest.tip_m(scene.workspace.pivot_m));
    let far_m = mesh.positions_m.iter().map(|place| place[2]).fold(f32::MIN, f32::max) - 0.5 * EDGE_M;
    with_mesh(scene, mesh, |place| place[2] > far_m)
}

/// The scene with a mesh as its only object, of the material of its first one, held where it is said, and no hand.
pub fn with_mesh(scene: &LoadedScene, mesh: TetMesh, is_held: impl Fn(&[f32; 3]) -> bool) -> Option<LoadedScene> {
    let (surface, nodes) = boundary(&mesh).to_mesh(&mesh.positions_m);
    let mut bound = vec![None; mesh.positions_m.len()];
    for (index, tet) in mesh.tets.iter().enumerate() {
        for (corner, node) in tet.iter().enumerate() {
            let weights = std::array::from_fn(|other| if other == corner { 1.0 } else { 0.0 });
            bound[*node as usize] = Some(Binding { tet: index as u32, weights });
        }
    }
    let object = LoadedDeformable {
        name: "block".to_owned(),
        kind: DeformableKind::Organ,
        surface,
        bindings: nodes.iter().map(|node| bound[*node as usize]).collect::<Option<Vec<Binding>>>()?,
        fixed: mesh.positions_m.iter().map(is_held).collect(),
        material: scene.objects.first()?.material.clone(),
        regions: Vec::new(),
        attach: None,
        look: None,
        hollow: false,
        mesh,
    };
    Some(LoadedScene { objects: vec![object], hands: Vec::new(), ..scene.clone() })
}

/// A row for each block, and whether the cost grows as its tets do.
pub fn rows(scene: &LoadedScene) -> Result<Vec<Value>, String> {
    let (mut rows, mut costs) = (Vec::new(), Vec::new());
    for cells in CELLS {
        let scene = with_block(scene, cells).ok_or("the scene has no deformable object")?;
        let mut press = Press::new(&scene, Isa::detect(), 1)?;
        let record = press.run(RUN_NS)?;
        let (tets, step_ns) = (press.tets() as f64, quantile_ns(&mut record.steps_ns(|_| true), 0.5));
        let mut row = json!({ "method": "a block", "substeps": record.substeps, "ns_per_tet": step_ns / tets });
        complete(&mut row, &scene, &press, &record, |_| true);
        rows.push(row);
        // Blocks of one size of cells and one material need as many substeps.
        costs.push((tets, step_ns));
    }
    let name = "cost of one more tet from 1 080 to 50 400 tets, most over least";
    rows.push(target(name, most_over_least(&costs), MOST_RATIO, false));
    Ok(rows)
}

/// Of what one more tet costs from the first of some meshes to each of the others; each is its tets and the time of a step, ns. Not a number where one costs
/// nothing.
fn most_over_least(costs: &[(f64, f64)]) -> f64 {
    let Some(((tets, step_ns), others)) = costs.split_first() else { return f64::NAN };
    let one_more_ns = others.iter().map(|(of, of_ns)| (of_ns - step_ns) / (of - tets));
    let [least, most] = [f64::min, f64::max].map(|pick| one_more_ns.clone().reduce(pick).unwrap_or(f64::NAN));
    if least > 0.0 { most / least } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_grows_with_its_tets_is_linear_whatever_it_costs_beside_and_what_grows_faster_is_not() {
        let tets = [1.0, 3.0, 10.0, 50.0];
        let ratio = |cost: fn(f64) -> f64| most_over_least(&tets.map(|tets| (tets, cost(tets))));
        assert_eq!(ratio(|tets| 100.0 + 2.0 * tets), 1.0);
        assert_eq!(ratio(|tets| tets * tets), 51.0 / 4.0);
        assert!(ratio(|_| 1.0).is_nan() && most_over_least(&[]).is_nan());
    }

    #[test]
    fn a_block_is_sound_and_the_tip_is_in_it() {
        let scene = hyst_scene::load_embedded().unwrap();
        let block = with_block(&scene, CELLS[0]).unwrap();
        let found = hyst_mesh::check(&block.objects[0].mesh);
        assert!(found.is_sound(), "{found:?}");
        assert_eq!(block.objects[0].mesh.tets.len(), 1_080);
        assert!(block.objects[0].fixed.iter().any(|fixed| *fixed));
        let mut press = Press::new(&block, Isa::detect(), 1).unwrap();
        let record = press.run(50_000_000).unwrap();
        assert!(record.contacts > 5, "{} contacts", record.contacts);
    }
}
