//! A stable hash of all content: FNV-1a, 64 bit (Fowler, Noll, Vo). The same scene and meshes have the same hash on every machine.

/// FNV-1a over bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Fnv(u64);

impl Fnv {
    pub(crate) fn new() -> Fnv {
        Fnv(0xcbf2_9ce4_8422_2325)
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// Numbers by their bits, after their count, so that two arrays never run into one another.
    pub(crate) fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) {
        self.bytes(&(rows.len() as u64).to_le_bytes());
        for number in rows.iter().flatten() {
            self.bytes(&number.to_bits().to_le_bytes());
        }
    }

    /// As [`floats`](Fnv::floats).
    pub(crate) fn indices<const N: usize>(&mut self, rows: &[[u32; N]]) {
        self.bytes(&(rows.len() as u64).to_le_bytes());
        for index in rows.iter().flatten() {
            self.bytes(&index.to_le_bytes());
        }
    }

    pub(crate) fn finish(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::Fnv;

    #[test]
    fn the_hash_is_that_of_the_published_test_vectors() {
        for (text, expected) in [("", 0xcbf2_9ce4_8422_2325), ("a", 0xaf63_dc4c_8601_ec8c), ("foobar", 0x8594_4171_f739_67e8)] {
            let mut hash = Fnv::new();
            hash.bytes(text.as_bytes());
            assert_eq!(hash.finish(), expected, "{text}");
        }
    }
}
