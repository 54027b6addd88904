//! How tets and nodes lie in memory: rows of 16 lanes, blocks of 16 tets, in an order made for the scatter of forces.
//!
//! Promise: the order depends on the mesh alone. Within a block no two tets share a node where the mesh allows it, so that the
//! additions to node forces do not wait for each other; the remaining ones are added in lane order, so that the sum has one order.

/// Tets per block: one AVX-512 register, two of AVX2.
pub(crate) const LANES: usize = 16;
/// How far ahead the packing looks for a tet without a node in common: enough for conflict-free blocks in practice, and near
/// enough that a block's nodes lie close together.
const LOOK_AHEAD: usize = 256;

/// 16 numbers on one cache line: a quantity of 16 tets, or 4 nodes as (x, y, z, 0).
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Row(pub [f32; LANES]);

impl Row {
    pub const ZERO: Row = Row([0.0; LANES]);
}

/// What a substep reads of 16 tets.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Block {
    /// Node of corner c in lane l. Padding lanes name the spare node behind the last one.
    pub nodes: [[u32; LANES]; 4],
    /// 2μV·B·Bᵀ (xx, yy, zz, xy, xz, yz), B the inverse of the rest edges; N/m.
    pub metric: [Row; 6],
    /// 1/V, 1/m³; 0 in padding lanes.
    pub inv_volume: Row,
    /// λ and 2μ, Pa.
    pub lambda: Row,
    pub two_mu: Row,
}

/// What only the search for rotations reads of 16 tets.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct RestBlock {
    /// B, the inverse of the rest edge matrix, row by row; 1/m.
    pub inv_edges: [Row; 9],
    /// V, m³; 0 in padding lanes.
    pub volume: Row,
}

/// Number of rows for `nodes` nodes and one spare.
pub(crate) fn node_rows(nodes: usize) -> usize {
    (nodes + 1).div_ceil(4)
}

/// Order of the tets, `u32::MAX` for a padding lane; the length is a multiple of [`LANES`].
pub(crate) fn pack(tets: &[[u32; 4]], nodes: usize) -> Vec<u32> {
    let mut waiting: Vec<u32> = (0..tets.len() as u32).collect();
    waiting.sort_by_key(|&tet| {
        let corners = tets[tet as usize];
        (corners.iter().map(|&node| u64::from(node)).sum::<u64>(), tet)
    });
    let mut order = Vec::with_capacity(tets.len().next_multiple_of(LANES));
    let mut last_block_of_node = vec![usize::MAX; nodes];
    let mut taken = vec![false; waiting.len()];
    let mut first = 0;
    let mut block = 0;
    while order.len() < tets.len() {
        let in_block = (tets.len() - order.len()).min(LANES);
        let window = first..(first + LOOK_AHEAD).min(waiting.len());
        let mut filled = 0;
        for conflicts_allowed in [false, true] {
            for slot in window.clone() {
                if filled == in_block {
                    break;
                }
                let corners = tets[waiting[slot] as usize];
                let conflict = corners.iter().any(|&node| last_block_of_node[node as usize] == block);
                if taken[slot] || (conflict && !conflicts_allowed) {
                    continue;
                }
                taken[slot] = true;
                corners.iter().for_each(|&node| last_block_of_node[node as usize] = block);
                order.push(waiting[slot]);
                filled += 1;
            }
        }
        while first < waiting.len() && taken[first] {
            first += 1;
        }
        block += 1;
    }
    order.resize(order.len().next_multiple_of(LANES), u32::MAX);
    order
}
