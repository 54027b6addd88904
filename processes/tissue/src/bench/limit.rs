//! How far the deformation is from what the core can do: its operations, as the kernels are counted, over the most that were measured in the same run.

use hyst_exchange::system;
use hyst_tissue::{FORCE_OPERATIONS, Isa, ROTATION_OPERATIONS, busy, operations};
use serde_json::{Value, json};
use std::hint::black_box;

/// Rounds of a measurement, some ms, and how many there are: the fastest counts.
const ROUNDS: u32 = 1_000_000;
const RUNS: usize = 7;

/// Operations for each tet and substep of a step of so many: the forces are evaluated once more than there are substeps.
fn per_tet_and_substep(substeps: f64) -> f64 {
    (FORCE_OPERATIONS * (substeps + 1.0) + ROTATION_OPERATIONS) / substeps
}

/// Most operations in a ns.
fn peak_per_ns(isa: Isa) -> f64 {
    let run = || {
        let begun_ns = system::now_ns();
        black_box(busy(isa, black_box(ROUNDS)));
        system::now_ns() - begun_ns
    };
    let least_ns = (0..RUNS).map(|_| run()).min().unwrap_or(1).max(1);
    operations(isa, ROUNDS) / least_ns as f64
}

/// How many times as long something takes, ns, as so many operations do at the most that a core does in a ns.
fn limit_ratio(took_ns: f64, done: f64, peak_per_ns: f64) -> f64 {
    took_ns * peak_per_ns / done
}

/// The operations of a deformation that takes so long for each tet and substep, ns, the most that this core does, and how many times as long as that takes.
pub fn arithmetic(isa: Isa, substeps: f64, ns_per_tet_and_substep: f64) -> Value {
    let (done, peak_per_ns) = (per_tet_and_substep(substeps), peak_per_ns(isa));
    json!({
        "operations_per_tet_and_substep": done,
        "most_operations_per_ns": peak_per_ns,
        "limit_ratio": limit_ratio(ns_per_tet_and_substep, done, peak_per_ns),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_counted_is_spread_over_the_substeps_and_the_limit_is_how_long_the_core_takes_for_it() {
        assert_eq!(per_tet_and_substep(1.0), 2.0 * FORCE_OPERATIONS + ROTATION_OPERATIONS);
        assert!(per_tet_and_substep(1e6) - FORCE_OPERATIONS < 1.0);
        // 300 operations are 3 ns of a core that does 100 in a ns.
        assert_eq!([3.0, 12.0].map(|took_ns| limit_ratio(took_ns, 300.0, 100.0)), [1.0, 4.0]);
        let row = arithmetic(Isa::detect(), 8.0, 10.0);
        assert_eq!(row["operations_per_tet_and_substep"], per_tet_and_substep(8.0));
        let [peak_per_ns, ratio] = ["most_operations_per_ns", "limit_ratio"].map(|key| row[key].as_f64().unwrap());
        assert!(peak_per_ns > 0.0 && ratio == limit_ratio(10.0, per_tet_and_substep(8.0), peak_per_ns), "{row}");
    }
}
