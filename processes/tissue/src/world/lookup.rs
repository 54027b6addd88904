//! Which of some lists of four words one is: made once for a scene, and asked for hundreds of them in each cut.
//!
//! Promise: the answer is that of comparing with each of them; the hash decides about nothing but time.

/// No list.
const NONE: u32 = u32::MAX;

/// Lists of four words, by their numbers.
pub(super) struct Lookup {
    known: Vec<[u32; 4]>,
    /// Numbers, or [`NONE`]; half of them are free at least, and how many there are is a power of two.
    slots: Vec<u32>,
}

impl Lookup {
    /// Each has its place among these as its number; of some that are the same the first place counts.
    pub fn of(known: Vec<[u32; 4]>) -> Lookup {
        let slots = vec![NONE; (2 * known.len()).next_power_of_two().max(2)];
        let mut made = Lookup { known, slots };
        for number in 0..made.known.len() {
            let slot = made.slot(made.known[number]);
            if made.slots[slot] == NONE {
                made.slots[slot] = number as u32;
            }
        }
        made
    }

    /// All of them, in their order.
    pub fn known(&self) -> &[[u32; 4]] {
        &self.known
    }

    /// The number of one of them.
    pub fn number(&self, list: [u32; 4]) -> Option<usize> {
        let number = self.slots[self.slot(list)];
        (number != NONE).then_some(number as usize)
    }

    /// The slot that a list is in, or would get.
    fn slot(&self, list: [u32; 4]) -> usize {
        let [a, b, c, d] = list.map(u64::from);
        let mixed = ((a << 32 | b).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (c << 32 | d)).wrapping_mul(0xD1B5_4A32_D192_ED03);
        let mixed = (mixed ^ (mixed >> 32)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut slot = (mixed >> (64 - self.slots.len().trailing_zeros())) as usize;
        // There are fewer lists than slots.
        while self.slots[slot] != NONE && self.known[self.slots[slot] as usize] != list {
            slot = (slot + 1) & (self.slots.len() - 1);
        }
        slot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_is_found_where_comparing_with_each_finds_it() {
        // So many that each slot is taken by chance, some of them twice, of words that differ in their highest or their lowest bits.
        let list = |seed: u32| [seed % 3, (seed % 7) << 29, f32::to_bits(seed as f32), seed.wrapping_mul(2_654_435_761)];
        for count in [0, 1, 2, 3, 500] {
            let known: Vec<[u32; 4]> = (0..count).map(|seed| list(seed % 400)).collect();
            let lookup = Lookup::of(known.clone());
            assert_eq!(lookup.known(), known);
            for seed in 0..1_000 {
                let expected = known.iter().position(|known| *known == list(seed));
                assert_eq!(lookup.number(list(seed)), expected, "list {seed} of {count}");
            }
        }
    }
}
