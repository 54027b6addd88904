//! Messages are written into loans that hold whatever an older message left: their bytes must not depend on it.

/// What an older message left: nothing, everything, a pattern.
pub const LEFT: [u64; 3] = [0, u64::MAX, 0xAAAA_AAAA_AAAA_AAAA];

/// The same message written into blocks with each of [`LEFT`] in them; gives it if all are equal.
pub fn written(bytes: usize, what: &str, mut write: impl FnMut(&mut [u8])) -> Vec<u64> {
    let [first, rest @ ..] = LEFT.map(|left| {
        let mut block = vec![left; bytes.div_ceil(8)];
        write(&mut bytemuck::cast_slice_mut(&mut block)[..bytes]);
        block
    });
    for other in rest {
        let differs = first.iter().zip(&other).position(|(a, b)| a != b);
        assert_eq!(differs, None, "{what}: first word that depends on what lay in the loan, of {}", first.len());
    }
    first
}
