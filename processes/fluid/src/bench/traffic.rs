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

/// Bytes that a step's phases must move: each field that a phase needs read once, each that it makes written once.
pub fn step_bytes(solver: &Solver, inputs: &FlowInputs) -> Result<f64, FlowError> {
    solver.begin(inputs)?;
    let mut numbers = 0.0;
    // Bounded by the solver: its list of phases ends.
    while let Some(phase) = solver.next_phase()? {
        for band in 0..solver.bands() {
            solver.run_phase(phase, band)?;
        }
        let (fields, level) = fields_of(phase);
        numbers += fields * solver.level_cells(level) as f64;
    }
    Ok(numbers * size_of::<f32>() as f64)
}

/// Fields, read and written together, that a phase cannot do without, and its level.
/// An operator is four fields: three faces and the diagonal.
fn fields_of(phase: Phase) -> (f64, u8) {
    match phase {
        Phase::Mask => (4.0, 0),               // three velocities read, the cells written
        Phase::Mirror => (10.0, 0),            // three velocities, faces and the cells read, what faces show written
        Phase::Operator => (5.0, 0),           // cells read, the operator written
        Phase::Coarsen(level) => (5.0, level), // at the level's own size: faces of the finer one read, its own written
        Phase::CoarsenDiagonal(level) => (4.0, level),
        Phase::Diffuse | Phase::AdvectForward => (6.0, 0), // velocity read and written
        Phase::AdvectBack => (9.0, 0),                     // velocity before and ahead read, velocity written
        Phase::RightSide => (4.0, 0),                      // velocity read, divergence written
        Phase::Residual | Phase::Direction => (7.0, 0),    // operator and two fields read, one written
        Phase::Smooth(level) | Phase::Restrict(level) => (7.0, level),
        Phase::Update => (6.0, 0),  // pressure and residual along direction and image
        Phase::Project => (7.0, 0), // velocity and pressure read, velocity written
        Phase::Centre => (5.0, 0),  // pressure and velocity read, pressure written
        Phase::Dye => (5.0, 0),     // velocity and dye read, dye written
        _ => (0.0, 0),              // what is left has no field of the grid's size
    }
}
