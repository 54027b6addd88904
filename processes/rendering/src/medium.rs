//! Blood and gas in the cavity, from the Flow Engine's state: its grid, the optical density of each cell, the parcels of gas, read in place.
//!
//! Promise: a clear medium costs no pass over the picture; a grid whose numbers contradict each other is refused.

use bytemuck::{Pod, Zeroable};
use hyst_messages::{FluidStatus, Kind, Message, WireError};
use rendering::{CLEAR, FluidField};

/// Section of the densities in a fluid state, x fastest; the head is section 0.
const DENSITIES: usize = 2;
/// Section of the parcels of gas.
const GAS: usize = 3;
/// Extinction of undiluted blood as drawn, 1/m: opaque over the width of a cavity, with what lies before it still to be seen.
const EXTINCTION_PER_M: f32 = 320.0;

/// First section of a fluid state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
struct Head {
    status: FluidStatus,
    /// Lowest corner of the grid, m.
    origin_m: [f32; 3],
    /// Edges of a cell, m.
    spacing_m: [f32; 3],
    /// Cells along x, y, z.
    cells: [u32; 3],
    reserved: u32,
}

/// The field of a fluid state; `None` if the medium is clear.
pub fn field(state: &[u8]) -> Result<Option<FluidField<'_>>, WireError> {
    let message = Message::parse(state, Kind::FluidState)?;
    let head: Head = message.record(0)?;
    let density: &[f32] = message.section(DENSITIES)?;
    let count = head.cells.iter().try_fold(1usize, |product, &cells| product.checked_mul(cells as usize));
    if count != Some(density.len()) {
        return Err(WireError::Section(DENSITIES));
    }
    if !density.iter().any(|value| *value > CLEAR) {
        return Ok(None);
    }
    Ok(Some(FluidField {
        dims: head.cells,
        min_m: head.origin_m,
        max_m: std::array::from_fn(|axis| head.origin_m[axis] + head.spacing_m[axis] * head.cells[axis] as f32),
        density,
        extinction_per_m: EXTINCTION_PER_M,
    }))
}

/// The parcels of gas in a fluid state: place, m, and volume, ml; of a fluid that knows of no gas none.
pub fn gas(state: &[u8]) -> Result<&[[f32; 4]], WireError> {
    let message = Message::parse(state, Kind::FluidState)?;
    if message.header().sections as usize <= GAS { Ok(&[]) } else { message.section(GAS) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{MessageMut, StreamHeader};

    fn state(cells: [u32; 3], density: &[f32]) -> Vec<u64> {
        let head = Head { origin_m: [-0.02, -0.01, 0.0], spacing_m: [0.01; 3], cells, ..Head::default() };
        let lengths = [size_of::<Head>(), 8, size_of_val(density)];
        let mut words = vec![0u64; message_bytes(&lengths).div_ceil(8)];
        let bytes = bytemuck::cast_slice_mut(&mut words);
        let parts = MessageMut::format(bytes, Kind::FluidState, StreamHeader::default(), &lengths).unwrap().split();
        let [first, _, last, ..] = parts;
        first.copy_from_slice(bytemuck::bytes_of(&head));
        last.copy_from_slice(bytemuck::cast_slice(density));
        words
    }

    #[test]
    fn a_clear_medium_is_no_field_and_blood_is_one_over_the_whole_grid() {
        let clear = state([2, 1, 3], &[0.0; 6]);
        assert!(field(bytemuck::cast_slice(&clear)).unwrap().is_none());
        assert!(gas(bytemuck::cast_slice(&clear)).unwrap().is_empty(), "a fluid that knows of no gas");
        let bloody = state([2, 1, 3], &[0.0, 0.0, 0.5, 0.0, f32::NAN, 0.0]);
        let seen = field(bytemuck::cast_slice(&bloody)).unwrap().unwrap();
        assert_eq!((seen.dims, seen.density.len()), ([2, 1, 3], 6));
        assert!((seen.max_m[0] - 0.0).abs() < 1e-7 && (seen.max_m[2] - 0.03).abs() < 1e-7, "{:?}", seen.max_m);
    }

    #[test]
    fn a_grid_of_another_size_than_its_densities_is_refused() {
        for cells in [[2, 1, 2], [0, 1, 6], [u32::MAX; 3]] {
            let words = state(cells, &[1.0; 6]);
            assert!(field(bytemuck::cast_slice(&words)).is_err(), "{cells:?}");
        }
    }
}
