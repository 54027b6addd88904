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

/// Nodes that 16 bits can name, the spare one included.
pub(crate) const SHORT_NODES: usize = 1 << 15;
/// The pairs in [`ShortNodes`]: two from each number of 16 bits on.
const SHORT_PAIRS: usize = (1 << 16) + 1;
/// The rows of the nodes where 16 bits name them, as pairs of floats. A node's number is that of its first pair ([`short_number`]): a processor takes eight
/// times a number for an address as it is, and sixteen times a number only once it was shifted. There are pairs for every number of 16 bits, so that none
/// has to be compared with their count. What lies behind the model's own is never touched.
pub(crate) type ShortNodes = [[f32; 2]; SHORT_PAIRS];

/// The number in [`ShortNodes`] of one of [`SHORT_NODES`] nodes.
pub(crate) fn short_number(node: u32) -> u16 {
    (2 * node) as u16
}

/// The node that a number in [`ShortNodes`] names.
pub(crate) fn short_node(number: u16) -> u32 {
    u32::from(number / 2)
}

/// Rows of nodes as (x, y, z, 0), and the numbers that name them.
pub(crate) trait Nodes {
    /// Number of a node.
    type Number: Copy;

    /// The nodes in these rows.
    fn of(rows: &[Row]) -> &Self;
    /// The same, to be written.
    fn of_mut(rows: &mut [Row]) -> &mut Self;
    fn node(&self, number: Self::Number) -> &[f32; 4];
    fn node_mut(&mut self, number: Self::Number) -> &mut [f32; 4];
}

impl Nodes for ShortNodes {
    type Number = u16;

    #[inline(always)]
    fn of(rows: &[Row]) -> &Self {
        let pairs: &[[f32; 2]] = bytemuck::cast_slice(rows);
        pairs.first_chunk().expect("rows for every number of 16 bits")
    }

    #[inline(always)]
    fn of_mut(rows: &mut [Row]) -> &mut Self {
        let pairs: &mut [[f32; 2]] = bytemuck::cast_slice_mut(rows);
        pairs.first_chunk_mut().expect("rows for every number of 16 bits")
    }

    #[inline(always)]
    fn node(&self, number: u16) -> &[f32; 4] {
        let pairs: &[[f32; 2]; 2] = self[usize::from(number)..].first_chunk().expect("two pairs from every number on");
        bytemuck::cast_ref(pairs)
    }

    #[inline(always)]
    fn node_mut(&mut self, number: u16) -> &mut [f32; 4] {
        let pairs: &mut [[f32; 2]; 2] = self[usize::from(number)..].first_chunk_mut().expect("two pairs from every number on");
        bytemuck::cast_mut(pairs)
    }
}

impl Nodes for [[f32; 4]] {
    type Number = u32;

    #[inline(always)]
    fn of(rows: &[Row]) -> &Self {
        bytemuck::cast_slice(rows)
    }

    #[inline(always)]
    fn of_mut(rows: &mut [Row]) -> &mut Self {
        bytemuck::cast_slice_mut(rows)
    }

    #[inline(always)]
    fn node(&self, number: u32) -> &[f32; 4] {
        &self[number as usize]
    }

    #[inline(always)]
    fn node_mut(&mut self, number: u32) -> &mut [f32; 4] {
        &mut self[number as usize]
    }
}

/// The nodes of the tets, for each block that of corner c in lane l. Padding lanes name the spare node behind the last one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Corners {
    /// Of a model with nodes that 16 bits can name, by their numbers in [`ShortNodes`].
    Short(Vec<[[u16; LANES]; 4]>),
    /// Of any.
    Long(Vec<[[u32; LANES]; 4]>),
}

/// What a substep reads of 16 tets beside their nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Block {
    /// 2μV·B·Bᵀ (xx, yy, zz, xy, xz, yz), B the inverse of the rest edges; N/m.
    pub metric: [Row; 6],
    /// 1/V, 1/m³; 0 in padding lanes.
    pub inv_volume: Row,
    /// λ and 2μ, Pa.
    pub lambda: Row,
    pub two_mu: Row,
}

impl Block {
    pub const ZERO: Block = Block { metric: [Row::ZERO; 6], inv_volume: Row::ZERO, lambda: Row::ZERO, two_mu: Row::ZERO };
}

/// What only the search for rotations reads of 16 tets.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct RestBlock {
    /// B, the inverse of the rest edge matrix, row by row; 1/m.
    pub inv_edges: [Row; 9],
    /// V, m³; 0 in padding lanes.
    pub volume: Row,
    /// 1/2λ, 1/Pa; finite also where λ is 0. 0 where the nodes of a tet hold its volume ([`bulk`](crate::bulk)), whose λ is 0 here.
    pub half_inv_lambda: Row,
}

impl RestBlock {
    pub const ZERO: RestBlock = RestBlock { inv_edges: [Row::ZERO; 9], volume: Row::ZERO, half_inv_lambda: Row::ZERO };

    /// Whether the volume of the tet in a lane is held by its nodes.
    pub fn is_held_by_nodes(&self, lane: usize) -> bool {
        self.volume.0[lane] > 0.0 && self.half_inv_lambda.0[lane] == 0.0
    }
}

/// Number of rows for `nodes` nodes and one spare.
pub(crate) fn node_rows(nodes: usize) -> usize {
    (nodes + 1).div_ceil(4)
}

/// Number of rows in which the tets look their nodes up, of which those of [`node_rows`] are in use.
pub(crate) fn looked_up_rows(nodes: usize, corners: &Corners) -> usize {
    match corners {
        Corners::Short(_) => SHORT_PAIRS.div_ceil(LANES / 2),
        Corners::Long(_) => node_rows(nodes),
    }
}

/// Order of the tets, `u32::MAX` for a padding lane; the length is a multiple of [`LANES`].
///
/// Tets wait in the order of the sum of their nodes. A block takes from the window the first tet that has no node in common with what it holds, as long
/// as there is one, then those at the front of the window.
pub(crate) fn pack(tets: &[[u32; 4]], nodes: usize) -> Vec<u32> {
    let waiting = by_sum(tets, nodes);
    let mut window = Window::new(nodes);
    let mut order = Vec::with_capacity(tets.len().next_multiple_of(LANES));
    while order.len() < tets.len() {
        window.fill(&waiting, tets);
        let in_block = (tets.len() - order.len()).min(LANES);
        // Those without a node in common with what the block holds. None that was passed over becomes one of them.
        let (mut apart, mut from) = (window.free, window.first);
        for _ in 0..in_block {
            let Some(slot) = apart.first_from(from).or_else(|| window.free.first_from(window.first)) else { break };
            let tet = waiting[slot];
            window.take(slot, &tets[tet as usize], &mut apart);
            order.push(tet);
            from = slot;
        }
        window.move_on();
    }
    order.resize(order.len().next_multiple_of(LANES), u32::MAX);
    order
}

/// The tets by the sum of their nodes, those with the same sum by index.
fn by_sum(tets: &[[u32; 4]], nodes: usize) -> Vec<u32> {
    let sum = |tet: &[u32; 4]| tet.iter().map(|&node| node as usize).sum::<usize>();
    let mut next = vec![0u32; 4 * nodes];
    tets.iter().for_each(|tet| next[sum(tet)] += 1);
    let mut before = 0;
    next.iter_mut().for_each(|entry| before += std::mem::replace(entry, before));
    let mut sorted = vec![0; tets.len()];
    for (tet, nodes) in tets.iter().enumerate() {
        let place = &mut next[sum(nodes)];
        sorted[*place as usize] = tet as u32;
        *place += 1;
    }
    sorted
}

/// A set of slots of the window, one bit each; the slot's number modulo [`LOOK_AHEAD`] says which.
#[derive(Debug, Clone, Copy)]
struct Slots([u64; LOOK_AHEAD / 64]);

impl Slots {
    const NONE: Slots = Slots([0; LOOK_AHEAD / 64]);

    fn insert(&mut self, slot: usize) {
        self.0[slot % LOOK_AHEAD / 64] |= 1 << (slot % 64);
    }

    fn remove(&mut self, slot: usize) {
        self.0[slot % LOOK_AHEAD / 64] &= !(1 << (slot % 64));
    }

    fn add(&mut self, others: &Slots) {
        self.0.iter_mut().zip(others.0).for_each(|(word, other)| *word |= other);
    }

    fn remove_all(&mut self, others: &Slots) {
        self.0.iter_mut().zip(others.0).for_each(|(word, other)| *word &= !other);
    }

    /// The first slot from this one on, of a set of slots of a window in which none lies before it.
    fn first_from(&self, from: usize) -> Option<usize> {
        let begin = from - from % 64;
        let mut part = self.0[from % LOOK_AHEAD / 64] & (u64::MAX << (from % 64));
        // The word that it begins in is also the one that the window may end in, and has nothing else by then.
        for step in 1..=LOOK_AHEAD / 64 {
            if part != 0 {
                return Some(begin + 64 * (step - 1) + part.trailing_zeros() as usize);
            }
            part = self.0[(from / 64 + step) % (LOOK_AHEAD / 64)];
        }
        (part != 0).then(|| begin + LOOK_AHEAD + part.trailing_zeros() as usize)
    }
}

/// What a block may choose from: [`LOOK_AHEAD`] slots of the waiting tets, from the first that is not taken.
struct Window {
    first: usize,
    end: usize,
    /// Those that are not taken.
    free: Slots,
    /// For each node those that are not taken and have it.
    with_node: Vec<Slots>,
}

impl Window {
    fn new(nodes: usize) -> Window {
        Window { first: 0, end: 0, free: Slots::NONE, with_node: vec![Slots::NONE; nodes] }
    }

    fn fill(&mut self, waiting: &[u32], tets: &[[u32; 4]]) {
        let end = (self.first + LOOK_AHEAD).min(waiting.len());
        for slot in self.end..end {
            self.free.insert(slot);
            tets[waiting[slot] as usize].iter().for_each(|&node| self.with_node[node as usize].insert(slot));
        }
        self.end = end;
    }

    /// Takes a free slot out; takes those that have a node in common with it out of `apart`.
    fn take(&mut self, slot: usize, corners: &[u32; 4], apart: &mut Slots) {
        self.free.remove(slot);
        let mut touching = Slots::NONE;
        for &node in corners {
            let same = &mut self.with_node[node as usize];
            touching.add(same);
            same.remove(slot);
        }
        apart.remove_all(&touching);
    }

    fn move_on(&mut self) {
        self.first = self.free.first_from(self.first).unwrap_or(self.end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    /// The definition, tried slot by slot.
    fn plain(tets: &[[u32; 4]], nodes: usize) -> Vec<u32> {
        let mut waiting: Vec<u32> = (0..tets.len() as u32).collect();
        waiting.sort_by_key(|&tet| (tets[tet as usize].iter().map(|&node| u64::from(node)).sum::<u64>(), tet));
        let mut order = Vec::new();
        let mut last_block_of_node = vec![usize::MAX; nodes];
        let mut taken = vec![false; waiting.len()];
        let (mut first, mut block) = (0, 0);
        while order.len() < tets.len() {
            let in_block = (tets.len() - order.len()).min(LANES);
            let window = first..(first + LOOK_AHEAD).min(waiting.len());
            let mut filled = 0;
            for conflicts_allowed in [false, true] {
                for slot in window.clone() {
                    let corners = tets[waiting[slot] as usize];
                    let conflict = corners.iter().any(|&node| last_block_of_node[node as usize] == block);
                    if filled == in_block || taken[slot] || (conflict && !conflicts_allowed) {
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

    #[test]
    fn the_number_of_a_node_leads_to_its_own_row_and_no_number_leads_nowhere() {
        let mut rows = vec![Row::ZERO; looked_up_rows(7, &Corners::Short(Vec::new()))];
        let nodes = [0, 1, 2, 4_097, SHORT_NODES as u32 - 1];
        for node in nodes {
            assert_eq!(short_node(short_number(node)), node);
            *ShortNodes::of_mut(&mut rows).node_mut(short_number(node)) = [node as f32, 1.0, 2.0, 3.0];
        }
        let written: &[[f32; 4]] = bytemuck::cast_slice(&rows);
        for node in nodes {
            assert_eq!(written[node as usize], [node as f32, 1.0, 2.0, 3.0]);
            assert_eq!(ShortNodes::of(&rows).node(short_number(node)), &written[node as usize]);
        }
        assert_eq!(written.iter().filter(|node| **node != [0.0; 4]).count(), nodes.len());
        // One that no node has.
        assert_eq!(ShortNodes::of(&rows).node(u16::MAX), &[2.0, 3.0, 0.0, 0.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 200,
            rng_seed: RngSeed::Fixed(8),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// From tets that nearly all touch to some that hardly do, with nodes near each other as in a mesh; many windows long.
        #[test]
        fn the_order_is_the_one_that_trying_slot_by_slot_gives(
            nodes in 1..1500u32,
            reach in 1..80u32,
            seeds in vec((0..1500u32, [0..80u32, 0..80u32, 0..80u32, 0..80u32]), 0..1500),
        ) {
            let tets: Vec<[u32; 4]> = seeds.iter().map(|(at, off)| off.map(|off| (at + off % reach) % nodes)).collect();
            prop_assert_eq!(pack(&tets, nodes as usize), plain(&tets, nodes as usize));
        }
    }
}
