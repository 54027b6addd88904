//! What is left out changes no bit.

use super::*;
use crate::blood::BloodSource;
use crate::coordinator::StepReport;
use crate::grid::Grid;
use crate::inputs::{Capsule, FlowInputs, Port};
use crate::kernels::{Dot, dot};
use crate::model::FlowModel;
use crate::pump::PumpInput;

/// Numbers from 0 to 1 (a linear congruence).
struct Random(u64);

impl Random {
    fn number(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Layout, spans and padded planes of the fluid of a grid with these solid cells, x fastest.
fn of_mask(n: [usize; 3], solid: &[u8]) -> (Arc<Layout>, Spans, Vec<Vec<f32>>) {
    let layout = Arc::new(Layout::new(n, 1));
    let mut planes = vec![vec![0.0f32; layout.plane]; n[2] + 2];
    for (cell, solid) in solid.iter().enumerate() {
        let (i, j, k) = (cell % n[0], cell / n[0] % n[1], cell / (n[0] * n[1]));
        planes[k + 1][layout.row(j) + i] = f32::from(u8::from(*solid == 0));
    }
    let mut components = Components::new(&layout);
    components.label(&layout, |kk| planes[kk].as_slice(), &mut vec![0; layout.cell_count()]);
    let mut spans = Spans::new(&layout);
    spans.set_fine(&components, |kk| planes[kk].as_slice(), true);
    (layout, spans, planes)
}

/// Grids with solid cells here and there, few to nearly all.
fn scattered() -> Vec<([usize; 3], Vec<u8>)> {
    let mut random = Random(7);
    let mut all = Vec::new();
    for n in [[40, 17, 5], [64, 9, 4], [7, 6, 5], [130, 8, 3], [1, 5, 2]] {
        for share in [0.0, 0.02, 0.6, 0.97, 0.999, 1.0] {
            let solid = (0..n[0] * n[1] * n[2]).map(|_| u8::from(random.number() < share)).collect();
            all.push((n, solid));
        }
    }
    all
}

#[test]
fn a_grid_without_solids_is_computed_in_the_runs_of_its_planes() {
    for n in [[32, 32, 3], [64, 20, 2], [3, 2, 1], [33, 1, 2], [512, 2, 1]] {
        let (layout, spans, _) = of_mask(n, &vec![0; n[0] * n[1] * n[2]]);
        let runs: Vec<_> = layout.runs().collect();
        for kk in 1..=n[2] {
            for parts in [&spans.open, &spans.near, &spans.lanes] {
                assert_eq!(parts.of(kk).collect::<Vec<_>>(), runs, "{n:?}");
            }
            assert_eq!(spans.gaps.of(kk).count(), 0);
            assert!((0..3).all(|component| spans.is_free_layer(component, kk)));
        }
    }
}

#[test]
fn every_fluid_cell_is_in_one_part_and_what_is_in_none_is_solid() {
    for (n, solid) in scattered() {
        let (layout, spans, planes) = of_mask(n, &solid);
        let s = layout.stride;
        for kk in 1..=n[2] {
            let marks = |parts: &Parts| {
                let mut marks = vec![0u32; layout.plane];
                for (o, len) in parts.of(kk) {
                    marks[o..o + len].iter_mut().for_each(|mark| *mark += 1);
                }
                marks
            };
            let (open, gaps, near, lanes) = (marks(&spans.open), marks(&spans.gaps), marks(&spans.near), marks(&spans.lanes));
            for at in inside(&layout) {
                assert_eq!(open[at] + gaps[at], 1, "{n:?} {kk} {at}");
                assert!(near[at] <= 1 && lanes[at] <= 1);
            }
            for at in (0..n[1]).flat_map(|j| layout.row(j)..layout.row(j) + n[0]) {
                let is_beside = planes[kk - 1..=kk + 1]
                    .iter()
                    .any(|plane| [at - s, at, at + s].into_iter().any(|at| plane[at - 1..=at + 1].contains(&1.0)));
                assert!(planes[kk][at] == 0.0 || (open[at], lanes[at]) == (1, 1), "{n:?} {kk} {at}");
                assert!(!is_beside || near[at] == 1, "{n:?} {kk} {at}");
            }
        }
    }
}

#[test]
fn a_sum_without_its_zeros_has_the_bits_of_the_whole() {
    let mut random = Random(3);
    for (n, solid) in scattered() {
        let (layout, spans, planes) = of_mask(n, &solid);
        for (kk, plane) in planes.iter().enumerate().take(n[2] + 1).skip(1) {
            let mut field = || -> Vec<f32> { plane.iter().map(|m| m * (random.number() - 0.5)).collect() };
            let (a, b) = (field(), field());
            let (mut parts, mut whole) = (Dot::default(), 0.0f64);
            for (o, len) in spans.lanes.of(kk) {
                parts.add(layout.run_of(o), &a[o..o + len], &b[o..o + len]);
            }
            for (o, len) in layout.runs() {
                whole += dot(&a[o..o + len], &b[o..o + len]);
            }
            assert_eq!(parts.total().to_bits(), whole.to_bits(), "{n:?} {kk}");
        }
    }
}

const CELLS: [usize; 3] = [40, 24, 14];

fn solver(bands: usize, skips: bool) -> Solver {
    let mut model = FlowModel::new(Grid::new(CELLS, [1e-3, 0.9e-3, 1.1e-3], [0.0; 3]).unwrap());
    model.blood.capacity = 64;
    model.blood.conductance_ml_s_pa = 1e-4;
    let solver = Solver::new(model, bands).unwrap();
    solver.coordinator.lock().skips = skips;
    solver
}

/// A scope is thrust in and drawn back; medium jets out of it, blood wells up.
fn inputs(step: u32) -> FlowInputs {
    let along = 0.012 + 0.002 * (step as f32).sin();
    let mut inputs = FlowInputs { dt_s: 1.0 / 40.0, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 9_000.0, flow_limit_ml_min: 300.0, inflow_valve: 1.0, outflow_valve: 0.5, ..Default::default() };
    inputs.tools[0] = Capsule {
        a_m: [0.0, 0.011, 0.007],
        b_m: [along, 0.011, 0.007],
        radius_m: 0.002,
        velocity_a_m_s: [0.03, 0.01, 0.0],
        velocity_b_m_s: [0.03, -0.01, 0.0],
    };
    let front_m = [along + 0.003, 0.011, 0.007];
    inputs.ports[0] = Port { centre_m: front_m, radius_m: 0.002, direction: [1.0, 0.0, 0.0], share: 1.0, inflow: true, dye: 0.1 };
    inputs.ports[1] = Port { centre_m: [0.02, 0.015, 0.007], radius_m: 0.003, share: 1.0, ..Default::default() };
    inputs.blood[0] = BloodSource { position_m: [0.022, 0.01, 0.008], opening: 1.0 };
    inputs
}

/// Solid where a function of the cell's place from −1 to 1 along each axis says so.
fn walls(mut is_solid: impl FnMut([f32; 3]) -> bool) -> Vec<u8> {
    let [nx, ny, _] = CELLS;
    let place = |cell: usize| -> [f32; 3] {
        let cell = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        std::array::from_fn(|axis| (2 * cell[axis] + 1) as f32 / CELLS[axis] as f32 - 1.0)
    };
    let count: usize = CELLS.iter().product();
    (0..count).map(|cell| u8::from(is_solid(place(cell)))).collect()
}

fn state(solver: &Solver) -> Vec<u64> {
    let mut block = vec![0u64; solver.state_bytes() / 8];
    solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
    block
}

#[test]
fn a_solver_that_leaves_out_solids_has_the_bits_of_one_that_computes_them() {
    let mut random = Random(11);
    let size = |p: [f32; 3]| p.iter().map(|x| x * x).sum::<f32>();
    let cavity = walls(|[x, y, z]| size([1.4 * (x + 0.1), 1.5 * (y - 0.1), 1.3 * z]) > 1.0);
    let narrow = walls(|[x, y, z]| size([1.2 * (x - 0.1), 2.0 * y, 1.6 * z]) > 1.0);
    let chambers = walls(|[x, y, z]| x.abs() < 0.1 || size([x, 1.2 * y, z]) > 1.0);
    let sponge = walls(|_| random.number() < 0.7);
    let cases = [walls(|_| false), cavity.clone(), narrow, cavity, chambers, sponge, walls(|_| true), walls(|[x, ..]| x < 0.0)];
    let solvers = [(1, false), (1, true), (3, true)].map(|(bands, skips)| solver(bands, skips));
    let fast: Vec<[f32; 3]> = (0..cases[0].len()).map(|cell| [0.01, -0.02, 0.001 * (cell % 30) as f32]).collect();
    for (step, case) in (0..32u32).map(|step| (step, &cases[step as usize / 4])) {
        let done: Vec<(StepReport, Vec<u64>)> = solvers
            .iter()
            .map(|solver| {
                if step % 4 == 0 {
                    solver.set_walls(case, &fast).unwrap();
                } else if step % 4 == 2 {
                    solver.set_mask(case).unwrap();
                }
                (solver.step_serial(&inputs(step)).unwrap(), state(solver))
            })
            .collect();
        for other in &done[1..] {
            assert_eq!(done[0].0, other.0, "the reports of step {step}");
            assert!(done[0].1 == other.1, "the states of step {step} differ");
        }
    }
}
