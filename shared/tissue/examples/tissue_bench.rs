//! Prints nanoseconds per tet and substep, and steps of 1 ms per second, for two blocks and every instruction set of this machine.
//!
//! `cargo run --release -p hyst-tissue --example tissue_bench`. The figure is that of the fastest of several short runs: others
//! may use the machine at the same time.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Body, block, options};
use hyst_tissue::{Isa, Material, Model, Options};
use std::time::Instant;

/// Runs per row; the fastest counts.
const RUNS: usize = 15;
/// Steps per run: some 10 ms, shorter than the usual slice between two interruptions.
const STEPS: usize = 60;

fn main() {
    let material = Material::new(10_000.0, 0.45, 1000.0, 10.0).expect("valid constants");
    println!("{:>6} {:>9} {:>8} {:>12} {:>14}", "tets", "isa", "substeps", "steps_per_s", "ns_per_tet_sub");
    for cells in [[12, 12, 4], [12, 12, 12]] {
        for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
            let mesh = block(cells, 0.003);
            let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
            let (model, report) = Model::new(&mesh, &fixed, &material, Options { isa, ..options() }).expect("a model");
            let mut body = Body::new(model);
            let nodes = body.force_n.len();
            body.force_n[nodes - 1] = [0.0, 0.01, -0.02];
            let mut fastest_s = f64::INFINITY;
            for _ in 0..RUNS {
                let start = Instant::now();
                for _ in 0..STEPS {
                    body.step();
                }
                fastest_s = fastest_s.min(start.elapsed().as_secs_f64() / STEPS as f64);
            }
            let work = (report.tets as f64) * f64::from(report.substeps);
            let (rate, cost_ns) = (1.0 / fastest_s, fastest_s * 1e9 / work);
            println!("{:>6} {:>9} {:>8} {rate:>12.0} {cost_ns:>14.2}", report.tets, isa.name(), report.substeps);
        }
    }
}
