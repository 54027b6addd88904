//! Pieces of tissue that nothing holds. They are no wall: the flow goes through where they are, and its mean velocity there is what carries them.

use crate::cavity::{Cavity, Tissue};
use glam::Vec3;
use hyst_flow::{Grid, StateView};
use hyst_messages::stream::ObjectRecord;
use hyst_messages::{MAX_PIECES, PieceFlow};

/// The pieces in the tissue's newest state, and the cells that they are in.
pub struct Pieces {
    free: Vec<bool>,
    /// Object and cell, ascending, each pair once.
    cells: Vec<(u32, u32)>,
}

impl Pieces {
    /// None yet; with room for many pieces on a grid of so many cells.
    pub fn new(cells: usize) -> Pieces {
        Pieces { free: Vec::with_capacity(256), cells: Vec::with_capacity(2 * cells) }
    }

    /// Takes the objects of a topology.
    pub fn set_objects(&mut self, objects: &[ObjectRecord]) {
        self.free.clear();
        for object in objects.iter().filter(|object| object.is_free_piece()) {
            let id = object.id as usize;
            if id < objects.len() {
                self.free.resize(self.free.len().max(id + 1), false);
                self.free[id] = true;
            }
        }
    }

    /// Whether an object is one.
    pub fn is_free(&self, object: u32) -> bool {
        self.free.get(object as usize).is_some_and(|free| *free)
    }

    /// Finds the cells that each piece is in: those whose centre lies in one of its tets, and those that hold a tet's centre, for pieces
    /// smaller than a cell.
    pub fn locate(&mut self, cavity: &Cavity, tissue: &Tissue<'_>, owner: &[u32]) {
        let mut cells = std::mem::take(&mut self.cells);
        cells.clear();
        for (tet, object) in tissue.tets.iter().zip(owner).filter(|(_, object)| self.is_free(**object)) {
            let Some(corners) = tissue.corners_m(*tet) else { continue };
            let middle = corners.iter().sum::<Vec3>() * 0.25;
            cells.extend(cavity.cell_at(middle).map(|cell| (*object, cell as u32)));
            cavity.for_each_cell_in(corners, |cell, _| cells.push((*object, cell as u32)));
        }
        cells.sort_unstable();
        cells.dedup();
        self.cells = cells;
    }

    /// How the medium moves at the largest pieces, in the order of the objects; the rest is zero.
    pub fn flows(&self, view: &StateView<'_>) -> [PieceFlow; MAX_PIECES] {
        let mut largest = [(0, PieceFlow::default()); MAX_PIECES];
        // The objects come in ascending order, so that of two that are equally large the first one stays.
        for cells in self.cells.chunk_by(|a, b| a.0 == b.0) {
            let Some(least) = largest.iter_mut().min_by_key(|(size, flow)| (*size, std::cmp::Reverse(flow.object))) else {
                continue;
            };
            if cells.len() > least.0 {
                let sum: Vec3 = cells.iter().map(|(_, cell)| velocity_m_s(view, *cell as usize)).sum();
                let velocity_m_s = (sum / cells.len() as f32).to_array();
                *least = (cells.len(), PieceFlow { object: cells[0].0, velocity_m_s });
            }
        }
        largest.sort_unstable_by_key(|(size, flow)| (*size == 0, flow.object));
        largest.map(|(_, flow)| flow)
    }
}

/// Velocity in the middle of a cell, m/s: the mean of those on its faces; the high face of the last cell is on the box's wall.
fn velocity_m_s(view: &StateView<'_>, cell: usize) -> Vec3 {
    let grid: &Grid = view.grid();
    let [nx, ny, nz] = grid.cells();
    let place = [cell % nx, cell / nx % ny, cell / (nx * ny)];
    let stride = [1, nx, nx * ny];
    let along = |axis: usize| {
        let faces = view.velocity_m_s(axis);
        let is_last = place[axis] + 1 == [nx, ny, nz][axis];
        0.5 * (faces[cell] + if is_last { 0.0 } else { faces[cell + stride[axis]] })
    };
    Vec3::new(along(0), along(1), along(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_flow::{FlowInputs, FlowModel, Port, PumpInput, Solver};
    use hyst_messages::stream::ObjectKind;

    fn object(id: u32, kind: ObjectKind) -> ObjectRecord {
        ObjectRecord { id, kind: kind as u32, ..ObjectRecord::default() }
    }

    /// Water flows through a box along x, in at one end and out at the other; a small piece floats in its middle, a larger one beside.
    #[test]
    fn a_piece_is_carried_the_way_the_medium_flows_and_is_no_wall() {
        let grid = Grid::new([16, 8, 8], [2e-3; 3], [0.0; 3]).unwrap();
        let solver = Solver::new(FlowModel::new(grid), 1).unwrap();
        let mut cavity = Cavity::new(grid);
        let corner = |at: [f32; 3], edge: f32| {
            let [x, y, z] = at;
            [[x, y, z], [x + edge, y, z], [x, y + edge, z], [x, y, z + edge]]
        };
        let small = corner([0.0155, 0.0085, 0.0085], 2e-4);
        let large = corner([0.012, 0.003, 0.003], 6e-3);
        let positions: Vec<[f32; 3]> = small.into_iter().chain(large).collect();
        let (tets, owner) = ([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 2, 99]], [1, 2, 2]);
        let objects = [object(0, ObjectKind::Organ), object(1, ObjectKind::FreePiece), object(2, ObjectKind::FreePiece)];
        let mut pieces = Pieces::new(grid.cell_count());
        pieces.set_objects(&objects);
        assert!(!pieces.is_free(0) && pieces.is_free(1) && pieces.is_free(2) && !pieces.is_free(3));
        let tissue = Tissue { positions_m: &positions, velocities_m_s: &[], tets: &tets };
        assert!(cavity.update(&tissue, |tet| !pieces.is_free(owner[tet]), [1e-3; 3]));
        assert!(cavity.mask().iter().all(|cell| *cell == 0), "neither is a wall");
        assert!(cavity.update(&tissue, |_| true, [1e-3; 3]) && cavity.mask().contains(&1), "held, it would be one");
        pieces.locate(&cavity, &tissue, &owner);
        let port = |x: f32, inflow| Port { centre_m: [x, 8e-3, 8e-3], radius_m: 4e-3, share: 1.0, inflow, ..Port::default() };
        let mut inputs = FlowInputs { dt_s: 0.033, ..FlowInputs::default() };
        (inputs.ports[0], inputs.ports[1]) = (port(1e-3, true), port(0.031, false));
        inputs.pump = PumpInput {
            inflow_valve: 1.0,
            outflow_valve: 1.0,
            set_pa: 9_000.0,
            flow_limit_ml_min: 300.0,
            ..PumpInput::default()
        };
        (0..60).for_each(|_| {
            solver.step_serial(&inputs).unwrap();
        });
        let mut block = vec![0u64; solver.state_bytes().div_ceil(8)];
        let bytes: &mut [u8] = &mut bytemuck::cast_slice_mut(&mut block)[..solver.state_bytes()];
        solver.store(bytes).unwrap();
        let flows = pieces.flows(&StateView::new(bytes).unwrap());
        assert_eq!(flows.map(|flow| flow.object), [1, 2, 0, 0, 0, 0, 0, 0]);
        // A few ml/s through 2.56 cm²: about a centimetre a second, along x.
        for flow in &flows[..2] {
            let [x, y, z] = flow.velocity_m_s;
            assert!(x > 2e-3 && x < 0.2 && y.abs() < x && z.abs() < x, "{flow:?}");
        }
        assert_eq!(flows[2..], [PieceFlow::default(); MAX_PIECES - 2]);
    }

    #[test]
    fn of_many_pieces_the_largest_are_carried() {
        let grid = Grid::new([16, 4, 4], [1.0; 3], [0.0; 3]).unwrap();
        let solver = Solver::new(FlowModel::new(Grid::new([16, 4, 4], [1e-3; 3], [0.0; 3]).unwrap()), 1).unwrap();
        let mut block = vec![0u64; solver.state_bytes().div_ceil(8)];
        let bytes: &mut [u8] = &mut bytemuck::cast_slice_mut(&mut block)[..solver.state_bytes()];
        solver.store(bytes).unwrap();
        let cavity = Cavity::new(grid);
        // Twelve pieces of one tet each; those with odd numbers reach over two cells.
        let objects: Vec<ObjectRecord> = (0..13).map(|id| object(id, ObjectKind::FreePiece)).collect();
        let mut pieces = Pieces::new(grid.cell_count());
        pieces.set_objects(&objects);
        let (mut positions, mut tets, mut owner) = (Vec::new(), Vec::new(), Vec::new());
        for id in 1..13u32 {
            let (first, edge) = (positions.len() as u32, if id % 2 == 1 { 4.0 } else { 0.2 });
            let at = [id as f32 + 0.4, 1.4, 1.4];
            positions.extend([at, [at[0], at[1] + edge, at[2]], [at[0], at[1], at[2] + edge], [at[0] + 0.2, at[1], at[2]]]);
            tets.push([first, first + 1, first + 2, first + 3]);
            owner.push(id);
        }
        let tissue = Tissue { positions_m: &positions, velocities_m_s: &[], tets: &tets };
        pieces.locate(&cavity, &tissue, &owner);
        let carried = pieces.flows(&StateView::new(bytes).unwrap()).map(|flow| flow.object);
        assert_eq!(carried, [1, 2, 3, 4, 5, 7, 9, 11], "the six large ones, and the first two of the small");
        pieces.set_objects(&[]);
        pieces.locate(&cavity, &tissue, &owner);
        assert_eq!(pieces.flows(&StateView::new(bytes).unwrap()), [PieceFlow::default(); MAX_PIECES]);
    }
}
