//! The floor of a step: the bytes that its phases must move at least, over the bandwidth that a triad shows in the same run.

use hyst_exchange::system;
use hyst_flow::{FlowError, FlowInputs, Phase, Solver};

/// Numbers in each of the triad's three arrays: 64 MiB each, well beyond the caches.
const TRIAD_LEN: usize = 1 << 24;
/// Passes of the triad, of which the fastest counts, as STREAM does.
const TRIAD_PASSES: usize = 8;

/// Bytes per second of `a = b + s·c` (McCalpin's STREAM: two arrays read, one written; a line fetched for writing is not counted).
pub fn triad_bytes_per_s() -> f64 {
    let (b, c) = (vec![1.0f32; TRIAD_LEN], vec![2.0f32; TRIAD_LEN]);
    let mut a = vec![0.0f32; TRIAD_LEN];
    let mut least_ns = u64::MAX;
    for pass in 0..TRIAD_PASSES {
        let scale = std::hint::black_box(pass as f32);
        let begun_ns = system::now_ns();
        for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
            *a = b + scale * c;
        }
        std::hint::black_box(&a);
        least_ns = least_ns.min(system::now_ns() - begun_ns);
    }
    (3 * TRIAD_LEN * size_of::<f32>()) as f64 / (least_ns.max(1) as f64 * 1e-9)
}

/// Bytes that a step's phases must move: each field that a phase needs read once, each that it makes written once. What only cells beside solids need, and
/// the levels that one band computes alone, are left out.
pub fn step_bytes(solver: &Solver, inputs: &FlowInputs) -> Result<f64, FlowError> {
    solver.begin(inputs)?;
    let (mut numbers, mut is_first) = (0.0, true);
    // Bounded by the solver: its list of phases ends.
    while let Some(phase) = solver.next_phase()? {
        for band in 0..solver.bands() {
            solver.run_phase(phase, band)?;
        }
        for (fields, level) in fields_of(phase) {
            numbers += fields * solver.level_cells(level) as f64;
        }
        // The first direction comes of no other one.
        if phase == Phase::Direction && std::mem::take(&mut is_first) {
            numbers -= 2.0 * solver.level_cells(0) as f64;
        }
    }
    Ok(numbers * size_of::<f32>() as f64)
}

/// Fields, read and written together, that a phase cannot do without, with the level that they are of. The operator of level 0 is the diagonal, for cells
/// alone say which faces are open; that of another is the diagonal and three faces.
fn fields_of(phase: Phase) -> [(f64, u8); 2] {
    let operator = |level: u8| if level == 0 { 1.0 } else { 4.0 };
    let finest = |fields: f64| [(fields, 0), (0.0, 0)];
    match phase {
        // Three velocities, the cells and the walls' bytes read, three faces written.
        Phase::Mask => finest(7.25),
        // The cells read, to find those beside solids.
        Phase::Mirror | Phase::Hold | Phase::Rest => finest(1.0),
        // The cells read, diagonal and its inverse written.
        Phase::Operator => finest(3.0),
        // Three faces written; of the finer level's each second is read.
        Phase::Coarsen(level) => [(3.0, level), (0.0, 0)],
        // Three faces read, diagonal and its inverse written.
        Phase::CoarsenDiagonal(level) => [(5.0, level), (0.0, 0)],
        // Velocity and the cells read, velocity written.
        Phase::Diffuse => finest(7.0),
        // Velocity read and written.
        Phase::AdvectForward => finest(6.0),
        // Velocity before and ahead and the cells read, velocity written.
        Phase::AdvectBack => finest(10.0),
        // Velocity, the cells and the pressure read, divergence and potential written.
        Phase::RightSide => finest(7.0),
        // Potential, operator, the cells and divergence read, residual written.
        Phase::Residual => finest(operator(0) + 4.0),
        // Residual and inverse read; of the coarser level the residual written.
        Phase::Restrict(level) => [(operator(level) + 2.0, level), (1.0, level + 1)],
        // Residual and inverse read, correction written; that of the coarser level read.
        Phase::Smooth(level) => [(operator(level) + 3.0, level), (1.0, level + 1)],
        // Correction read, direction and image read and written.
        Phase::Direction => finest(operator(0) + 5.0),
        // Direction and image read, potential and residual read and written.
        Phase::Update => finest(6.0),
        // Velocity, potential and the cells read, velocity written.
        Phase::Project => finest(8.0),
        // Potential, velocity and the cells read, pressure written.
        Phase::Centre => finest(6.0),
        // Velocity, dye and the cells read, dye written.
        Phase::Dye => finest(6.0),
        // What is left has no field of the grid's size.
        _ => finest(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_flow::{FlowModel, Grid};

    #[test]
    fn an_operator_is_one_field_on_the_finest_level_and_four_on_the_others() {
        let of_level = |phase: Phase, level: u8| -> f64 {
            fields_of(phase).into_iter().filter(|(_, of)| *of == level).map(|(fields, _)| fields).sum()
        };
        assert_eq!([of_level(Phase::Restrict(0), 0), of_level(Phase::Smooth(0), 0)], [3.0, 4.0]);
        assert_eq!([of_level(Phase::Restrict(1), 1), of_level(Phase::Smooth(1), 1)], [6.0, 7.0]);
        assert_eq!([of_level(Phase::Restrict(1), 2), of_level(Phase::Smooth(1), 2)], [1.0, 1.0]);
    }

    /// A box at rest has nothing to solve: its step is the sum of its phases by hand.
    #[test]
    fn a_step_without_a_flow_moves_what_its_phases_move_once() {
        let solver = Solver::new(FlowModel::new(Grid::new([16, 16, 16], [1e-3; 3], [0.0; 3]).unwrap()), 1).unwrap();
        let inputs = FlowInputs { dt_s: 0.01, ..FlowInputs::default() };
        solver.step_serial(&inputs).unwrap(); // the operator is made in the first step
        let (bytes, cells) = (step_bytes(&solver, &inputs).unwrap(), 4_096.0 * 4.0);
        // Mask, Mirror, Hold, Diffuse, both sweeps of advection, RightSide, Residual, Project, Centre, Dye, Rest.
        let fields = 7.25 + 1.0 + 1.0 + 7.0 + 6.0 + 10.0 + 7.0 + 5.0 + 8.0 + 6.0 + 6.0 + 1.0;
        assert_eq!(bytes, fields * cells);
    }
}
