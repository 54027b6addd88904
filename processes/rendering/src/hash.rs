//! A hash of the nodes of a lattice, for noise and for places that only have to look like chance.

/// 32 mixed bits of a node and a seed.
pub(crate) fn hash(node: [u32; 3], seed: u32) -> u32 {
    let mut h = seed.wrapping_mul(0x9e37_79b1);
    for n in node {
        h = (h ^ n).wrapping_mul(0x85eb_ca6b);
        h ^= h >> 15;
        h = h.wrapping_mul(0xc2b2_ae35);
        h ^= h >> 13;
    }
    h
}
