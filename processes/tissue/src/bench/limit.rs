//! How far the deformation is from what the core can do: its operations, counted in the kernels' source, over the most that were measured in the same run.

use hyst_exchange::system;
use hyst_tissue::{Isa, busy, operations};
use serde_json::{Value, json};
use std::hint::black_box;

/// Operations for each tet in each evaluation of the forces (`kernel::element_forces`): edges 9, edges times Q 45, trace and pressure 7, the turned part 12,
/// the straight part 9, forces 99 and 6 for the first corner, sums at the nodes 12. A fused multiply-add counts as two, a change of sign as none.
const FORCES: f64 = 199.0;
/// The same once in each step (`kernel::find_frame`): edges and deformation 54, rotation 334 (`polar.rs`, all six of Newton's steps among them, of 15
/// operations each; 16 tets that are hardly strained take two or three), energy and what a rotation is free to do 93, Q and its factor 57; a quotient, a
/// root, a least and a greatest count as one.
const ROTATIONS: f64 = 538.0;
/// Rounds of a measurement, some ms, and how many there are: the fastest counts.
const ROUNDS: u32 = 1_000_000;
const RUNS: usize = 7;

/// Operations for each tet and substep of a step of so many: the forces are evaluated once more than there are substeps.
fn per_tet_and_substep(substeps: f64) -> f64 {
    (FORCES * (substeps + 1.0) + ROTATIONS) / substeps
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

/// The operations of a deformation that takes so long for each tet and substep, ns, the most that this core does, and how many times as long as that takes.
pub fn arithmetic(isa: Isa, substeps: f64, ns_per_tet_and_substep: f64) -> Value {
    let (done, peak_per_ns) = (per_tet_and_substep(substeps), peak_per_ns(isa));
    json!({
        "operations_per_tet_and_substep": done,
        "most_operations_per_ns": peak_per_ns,
        "limit_ratio": ns_per_tet_and_substep * peak_per_ns / done,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_counted_is_spread_over_the_substeps_and_no_deformation_is_faster_than_the_core() {
        assert_eq!(per_tet_and_substep(1.0), 2.0 * FORCES + ROTATIONS);
        assert!(per_tet_and_substep(1e6) - FORCES < 1.0);
        let row = arithmetic(Isa::detect(), 8.0, 10.0);
        let of = |key: &str| row[key].as_f64().unwrap();
        let ratio = 10.0 * of("most_operations_per_ns") / of("operations_per_tet_and_substep");
        assert!((of("limit_ratio") - ratio).abs() < 1e-9 * ratio && of("most_operations_per_ns") > 0.0, "{row}");
    }
}
