//! The crew: one Synchronized Thread for each band of layers, coordinated by the thread form of the Meeting Point. The result does not
//! depend on their number.

use hyst_engine::Failure;
use hyst_exchange::synchronized::{SharedWork, SynchronizedThreads};
use hyst_exchange::system;
use hyst_flow::{FlowInputs, Phase, Solver, StepReport};
use parking_lot::Mutex;
use std::sync::Arc;

/// What the threads share.
pub struct Bands {
    solver: Solver,
    phase: Mutex<Option<Phase>>,
    failure: Mutex<Option<String>>,
}

impl SharedWork for Bands {
    fn step(&self, _phase: u32, index: usize, _count: usize) {
        let phase = *self.phase.lock();
        if let Some(phase) = phase
            && let Err(error) = self.solver.run_phase(phase, index)
        {
            *self.failure.lock() = Some(error.to_string());
        }
    }
}

/// A solver and its threads.
pub struct Crew {
    bands: Arc<Bands>,
    threads: Option<SynchronizedThreads<Bands>>,
    count: u32,
}

/// A failure of the solver, which ends the process.
pub fn broken(error: hyst_flow::FlowError) -> Failure {
    Failure::Broken(error.to_string())
}

impl Crew {
    /// One thread for each of the solver's bands; with one band the caller computes alone.
    pub fn new(solver: Solver) -> Result<Crew, Failure> {
        let count = solver.bands();
        let bands = Arc::new(Bands { solver, phase: Mutex::new(None), failure: Mutex::new(None) });
        let threads = match count {
            1 => None,
            _ => Some(SynchronizedThreads::new(Arc::clone(&bands), count, "layer")?),
        };
        Ok(Crew { bands, threads, count: 0 })
    }

    /// The solver.
    pub fn solver(&self) -> &Solver {
        &self.bands.solver
    }

    /// The time that a step is measured by, ns: the calling thread's own where it computes alone, so that another that takes the core does not make it
    /// longer; else the clock's.
    pub fn time_ns(&self) -> u64 {
        if self.threads.is_none() { system::thread_ns() } else { system::now_ns() }
    }

    /// One step.
    pub fn step(&mut self, inputs: &FlowInputs) -> Result<StepReport, Failure> {
        let solver = &self.bands.solver;
        let Some(threads) = &mut self.threads else { return solver.step_serial(inputs).map_err(broken) };
        solver.begin(inputs).map_err(broken)?;
        // Bounded by the solver: its list of phases ends.
        while let Some(phase) = solver.next_phase().map_err(broken)? {
            if solver.is_serial(phase) {
                solver.run_phase(phase, 0).map_err(broken)?;
                continue;
            }
            *self.bands.phase.lock() = Some(phase);
            self.count = self.count.wrapping_add(1);
            threads.run(self.count);
            if let Some(error) = self.bands.failure.lock().take() {
                return Err(Failure::Broken(error));
            }
        }
        solver.report().map_err(broken)
    }
}
