//! Nodes and tets as the kernels read them: rows of 4 nodes, blocks of 16 tets.

use super::rest::Lane;
use crate::layout::{self, Block, Corners, LANES, RestBlock, Row, SHORT_NODES};
use hyst_mesh::TetMesh;

/// Rows of (v, v, v, 0) for each node, 0 for the spare ones.
pub(super) fn node_rows(nodes: usize, value: impl Fn(usize) -> f64) -> Vec<Row> {
    let mut rows = vec![Row::ZERO; layout::node_rows(nodes)];
    for node in 0..nodes {
        rows[node / 4].0[4 * (node % 4)..][..3].fill(value(node) as f32);
    }
    rows
}

/// The blocks of the tets in an order that is good for the kernels.
pub(super) fn of_tets(mesh: &TetMesh, data: &[Lane]) -> (Corners, Vec<Block>, Vec<RestBlock>) {
    let order = layout::pack(&mesh.tets, mesh.positions_m.len());
    let (orders, _) = order.as_chunks::<LANES>();
    let corners = match mesh.positions_m.len() < SHORT_NODES {
        true => Corners::Short(corners_of(orders, mesh, layout::short_number)),
        false => Corners::Long(corners_of(orders, mesh, |node| node)),
    };
    // Each is filled before it is written to where it stays, once: they are some hundred KiB.
    let (mut blocks, mut rest_blocks) = (Vec::with_capacity(orders.len()), Vec::with_capacity(orders.len()));
    for lanes in orders {
        let (mut block, mut rest_block) = (Block::ZERO, RestBlock::ZERO);
        for (lane, &tet) in lanes.iter().enumerate().filter(|(_, tet)| **tet != u32::MAX) {
            put(lane, &data[tet as usize], &mut block, &mut rest_block);
        }
        blocks.push(block);
        rest_blocks.push(rest_block);
    }
    (corners, blocks, rest_blocks)
}

fn corners_of<N: Copy>(orders: &[[u32; LANES]], mesh: &TetMesh, number: impl Fn(u32) -> N) -> Vec<[[N; LANES]; 4]> {
    let spare = number(mesh.positions_m.len() as u32);
    let of_block = |lanes: &[u32; LANES]| {
        let mut corners = [[spare; LANES]; 4];
        for (lane, &tet) in lanes.iter().enumerate().filter(|(_, tet)| **tet != u32::MAX) {
            for (corner, &node) in mesh.tets[tet as usize].iter().enumerate() {
                corners[corner][lane] = number(node);
            }
        }
        corners
    };
    orders.iter().map(of_block).collect()
}

fn put(lane: usize, data: &Lane, block: &mut Block, rest_block: &mut RestBlock) {
    block.metric.iter_mut().zip(data.metric).for_each(|(row, value)| row.0[lane] = value);
    block.inv_volume.0[lane] = data.inv_volume;
    block.lambda.0[lane] = data.lambda;
    block.two_mu.0[lane] = data.two_mu;
    rest_block.inv_edges.iter_mut().zip(data.inv_edges).for_each(|(row, value)| row.0[lane] = value);
    rest_block.volume.0[lane] = data.volume;
    rest_block.half_inv_lambda.0[lane] = data.half_inv_lambda;
}
