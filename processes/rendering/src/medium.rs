//! Blood and gas in the cavity, and how the medium flows, from the Flow Engine's state: its grid, the share of blood in each cell, the parcels of gas,
//! the solver's velocities, read in place; and the vessels that are coagulated.
//!
//! Promise: a clear medium costs no pass over the picture; a grid whose numbers contradict each other is refused.

use bytemuck::{Pod, Zeroable};
use hyst_flow::{EXTINCTION_PER_M, StateView};
use hyst_messages::{FluidStatus, Kind, Message, SealRecord, WireError};
use rendering::{CLEAR, FlowField, FluidField};

/// Section of the solver's block in a fluid state.
const BLOCK: usize = 1;
/// Section of the densities in a fluid state, x fastest; the head is section 0.
const DENSITIES: usize = 2;
/// Section of the parcels of gas.
const GAS: usize = 3;
/// Section of the vessels that are coagulated.
const SEALS: usize = 4;

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

/// The vessels that are coagulated in a fluid state; of a fluid that knows of none none.
pub fn seals(state: &[u8]) -> Result<&[SealRecord], WireError> {
    let message = Message::parse(state, Kind::FluidState)?;
    if message.header().sections as usize <= SEALS { Ok(&[]) } else { message.section(SEALS) }
}

/// How the medium flows in a fluid state; `None` if its block is none of the station's own solver, as that of a swapped engine may be.
pub fn flow(state: &[u8]) -> Option<FlowField<'_>> {
    let message = Message::parse(state, Kind::FluidState).ok()?;
    let view = StateView::framed(message.section(BLOCK).ok()?).ok()?;
    let grid = view.grid();
    Some(FlowField {
        dims: grid.cells().map(|count| count as u32),
        min_m: grid.origin_m(),
        spacing_m: grid.spacing_m(),
        velocity_m_s: [0, 1, 2].map(|axis| view.velocity_m_s(axis)),
        solid: view.mask(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_flow::{FlowModel, Grid, Solver};
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{MessageMut, StreamHeader};

    fn state(cells: [u32; 3], density: &[f32]) -> Vec<u64> {
        state_with(&[0], cells, density)
    }

    fn state_with(block: &[u64], cells: [u32; 3], density: &[f32]) -> Vec<u64> {
        let head = Head { origin_m: [-0.02, -0.01, 0.0], spacing_m: [0.01; 3], cells, ..Head::default() };
        let lengths = [size_of::<Head>(), size_of_val(block), size_of_val(density)];
        let mut words = vec![0u64; message_bytes(&lengths).div_ceil(8)];
        let bytes = bytemuck::cast_slice_mut(&mut words);
        let parts = MessageMut::format(bytes, Kind::FluidState, StreamHeader::default(), &lengths).unwrap().split();
        let [first, middle, last, ..] = parts;
        first.copy_from_slice(bytemuck::bytes_of(&head));
        middle.copy_from_slice(bytemuck::cast_slice(block));
        last.copy_from_slice(bytemuck::cast_slice(density));
        words
    }

    #[test]
    fn a_clear_medium_is_no_field_and_blood_is_one_over_the_whole_grid() {
        let clear = state([2, 1, 3], &[0.0; 6]);
        assert!(field(bytemuck::cast_slice(&clear)).unwrap().is_none());
        assert!(gas(bytemuck::cast_slice(&clear)).unwrap().is_empty(), "a fluid that knows of no gas");
        assert!(seals(bytemuck::cast_slice(&clear)).unwrap().is_empty(), "nor of vessels");
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

    #[test]
    fn the_flow_is_that_of_the_solvers_block_and_of_another_engines_block_there_is_none() {
        let (cells, spacing_m, origin_m) = ([4, 3, 5], [0.001, 0.002, 0.001], [-0.002, 0.0, 0.01]);
        let solver = Solver::new(FlowModel::new(Grid::new(cells, spacing_m, origin_m).unwrap()), 1).unwrap();
        let velocities: Vec<f32> = (0..60).map(|cell| 1e-3 * cell as f32).collect();
        solver.set_velocity_m_s(0, &velocities).unwrap();
        let mut mask = [0_u8; 60];
        mask[7] = 1;
        solver.set_mask(&mask).unwrap();
        let mut block = vec![0u64; solver.state_bytes() / 8];
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        let words = state_with(&block, [4, 3, 5], &[0.0; 60]);
        let seen = flow(bytemuck::cast_slice(&words)).unwrap();
        assert_eq!((seen.dims, seen.spacing_m, seen.min_m), ([4, 3, 5], spacing_m, origin_m));
        // Cells 2 and 3 of the row 1, 2.
        let [u, v, w] = seen.velocity_m_s.map(|faces| &faces[30..32]);
        assert_eq!((u, v, w, seen.solid), (&velocities[30..32], &[0.0; 2][..], &[0.0; 2][..], &mask[..]));
        assert!(flow(bytemuck::cast_slice(&state([4, 3, 5], &[0.0; 60]))).is_none());
        assert!(flow(&[]).is_none());
    }
}
