//! `fluid bench flow [--json]`: times a step of the Flow Engine on the embedded scene's cavity, outside of any station.
//!
//! A step is the walls from the tissue, the solver's phases, and the state written as a message. What the engine does beside is left out: the
//! look at each number of the state that it wrote, the copies of density and gas, vessels, holes and pieces. Two rows for the scene's cavity, on
//! its own grid and on a fine one, with the scope in it and both valves open, and one for each box of the comparison with other libraries: cubes
//! of 1 mm, no tissue, stirred by a capsule at 30 Hz. `bandwidth_ratio` is the least time in which the solver's fields could be moved at the
//! bandwidth of a triad measured in the same run, over the time of the solver; above 1 the fields stay in the caches. `divergence_left` is, of a
//! box, in which nothing comes or goes, the largest divergence after the last step, in parts of the largest speed over the edge of a cell.
//! `speedup` has the solver on two threads, and beside it what two independent copies reach on this machine; at 40×40×40 it has three threads
//! too, where there are cores enough, or says that there are not. Targets are rows too ([`targets`]), and a missed one is exit code 1.

mod targets;
mod traffic;

use crate::afford::{open_valves, tissue_at_rest};
use crate::cavity::{Cavity, Tissue};
use crate::crew::Crew;
use crate::engine::{load_scene, model_of};
use crate::tools::Instrument;
use hyst_engine::bench::{finish, quantile_ns, request, spread};
use hyst_exchange::system;
use hyst_flow::{Capsule, FlowInputs, FlowModel, Grid, Solver, StateView, StepReport};
use hyst_messages::{HardwareSample, Pose};
use hyst_scene::LoadedScene;
use serde_json::{Value, json};
use std::process::ExitCode;
use traffic::{step_bytes, triad_bytes_per_s};

/// The boxes of the comparison with other libraries, and the one by which threads are judged.
const BOXES: [[usize; 3]; 4] = [[32, 32, 18], targets::THREADED, [64, 64, 28], [128, 128, 128]];
/// Edge of a box's cells, m, and the speed at which the capsule circles in it, m/s: two thirds of a cell in a step, so that no rounding decides on a sweep more.
const CELL_M: f32 = 1e-3;
const STIR_M_S: f32 = 0.02;
/// Parts of a step.
const PHASES: [&str; 3] = ["walls", "solver", "state"];
/// Index of the solver in [`PHASES`].
const SOLVER: usize = 1;
/// Steps of a run that count, and those before them in which the flow comes up.
const STEPS: usize = 240;
const WARM_UP: usize = 30;
/// Longest time of a run and of its steps that do not count, ns: twenty-five runs, of which pairs run at once, end within 60 s.
const RUN_NS: u64 = 1_200_000_000;
const WARM_UP_NS: u64 = 500_000_000;
/// Threads of the comparison.
const THREADS: usize = 2;
/// Threads of the paper's comparison, and the cores that they want, so that one is left for everything else.
const MANY_THREADS: usize = 3;
const CORES_FOR_MANY: usize = 4;
const MS: f64 = 1e6;
/// Where another library is timed beside this one.
const PEERS: &str = "not timed here: tests/peers/beside.py does it, for the boxes 32x32x18 and 64x64x28";

/// Runs the benchmark that the arguments name.
pub fn run(arguments: impl Iterator<Item = String>) -> ExitCode {
    match request(arguments, &["flow"], false) {
        Ok(request) => finish("fluid", request.json, rows()),
        Err(error) => finish("fluid", false, Err(error)),
    }
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn rows() -> Result<Vec<Value>, String> {
    let scene = load_scene(None).map_err(text)?;
    let triad = triad_bytes_per_s();
    let own = scene.fluid.grid.map(|count| count as usize);
    let places = [own, targets::FINE].map(Place::Cavity).into_iter().chain(BOXES.map(Place::Box));
    let mut rows: Vec<Value> = places.map(|place| row(&scene, place, triad)).collect::<Result<_, _>>()?;
    rows.extend(targets::of(&rows));
    Ok(rows)
}

/// Where the flow is computed, and with how many cells.
#[derive(Clone, Copy)]
enum Place {
    Cavity([usize; 3]),
    Box([usize; 3]),
}

fn row(scene: &LoadedScene, place: Place, triad_bytes_per_s: f64) -> Result<Value, String> {
    let mut flow = Flow::new(scene, place, 1)?;
    let mut record = flow.run()?;
    let solver = flow.crew.solver();
    let bytes = step_bytes(solver, &flow.inputs(WARM_UP + record.phases_ns[0].len())).map_err(text)?;
    let mut steps_ns: Vec<u64> =
        (0..record.phases_ns[0].len()).map(|at| record.phases_ns.iter().map(|phase| phase[at]).sum()).collect();
    let all_ns = steps_ns.iter().sum::<u64>().max(1) as f64;
    let share = |phase: usize| record.phases_ns[phase].iter().sum::<u64>() as f64 / all_ns;
    let shares = [share(0), share(1), share(2)];
    let solver_ns = quantile_ns(&mut record.phases_ns[SOLVER], 0.5).max(1.0);
    let step_ns = quantile_ns(&mut steps_ns, 0.5).max(1.0);
    let fluid = flow.cavity.mask().iter().filter(|cell| **cell == 0).count();
    let cells = solver.model().grid.cells();
    let count = cells.iter().product::<usize>();
    let is_box = matches!(place, Place::Box(_));
    let name = if is_box { "box of 1 mm cubes" } else { scene.scene.name.as_str() };
    let divergence_left = if is_box { Some(divergence_left(&flow.block)?) } else { None };
    Ok(json!({
        "scene": name,
        "is_box": is_box,
        "grid": cells.map(|count| count.to_string()).join("x"),
        "cells": count,
        "fluid_cells": fluid,
        "steps": steps_ns.len(),
        "step_ms": spread(&mut steps_ns, MS),
        "steps_per_s": 1e9 / step_ns,
        "share": { PHASES[0]: shares[0], PHASES[1]: shares[1], PHASES[2]: shares[2] },
        "cells_per_s": count as f64 * 1e9 / solver_ns,
        "fluid_cells_per_s": fluid as f64 * 1e9 / solver_ns,
        "iterations_mean": record.iterations as f64 / steps_ns.len() as f64,
        "iterations_max": record.iterations_max,
        "residual_max": record.residual,
        "divergence_left": divergence_left,
        "state_mib": solver.state_bytes() as f64 / f64::from(1 << 20),
        "triad_gb_per_s": triad_bytes_per_s * 1e-9,
        "bandwidth_ratio": bytes / triad_bytes_per_s / (solver_ns * 1e-9),
        "peers": {},
        "peers_note": PEERS,
        "speedup": speedup(scene, place)?,
    }))
}

/// The largest divergence in a state of a box, in parts of the largest speed over the edge of a cell. Solid cells go as one, and have none.
fn divergence_left(block: &[u64]) -> Result<f64, String> {
    let view = StateView::framed(bytemuck::cast_slice(block)).map_err(text)?;
    let speed_m_s = (0..3).flat_map(|axis| view.velocity_m_s(axis)).fold(0.0f32, |most, speed_m_s| most.max(speed_m_s.abs()));
    let cells = 0..view.grid().cell_count();
    let most_per_s = cells.map(|cell| view.divergence_per_s(cell).abs()).fold(0.0, f64::max);
    Ok(most_per_s * f64::from(CELL_M) / f64::from(speed_m_s))
}

/// How many times as much the solver gets done: with its bands on several threads, and by as many independent copies. One thread alone is
/// measured in the same breath, so that all three see the same machine.
fn speedup(scene: &LoadedScene, place: Place) -> Result<Value, String> {
    let median_ns = |bands: usize| -> Result<f64, String> {
        let mut record = Flow::new(scene, place, bands)?.run()?;
        Ok(quantile_ns(&mut record.phases_ns[SOLVER], 0.5).max(1.0))
    };
    let alone_ns = median_ns(1)?;
    let shared_ns = median_ns(THREADS)?;
    let copies: Vec<Result<f64, String>> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..THREADS).map(|_| scope.spawn(|| median_ns(1))).collect();
        running.into_iter().map(|copy| copy.join().unwrap_or_else(|_| Err("a copy panicked".into()))).collect()
    });
    let mut together = 0.0;
    for copy_ns in copies {
        together += alone_ns / copy_ns?;
    }
    let mut speedup = json!({ "1": 1.0, "2": alone_ns / shared_ns, "2_independent_copies": together });
    if matches!(place, Place::Box(targets::THREADED)) {
        match system::cores() {
            CORES_FOR_MANY.. => speedup["3"] = json!(alone_ns / median_ns(MANY_THREADS)?),
            cores => speedup["3_note"] = json!(format!("not measured: {cores} cores, {CORES_FOR_MANY} are wanted")),
        }
    }
    Ok(speedup)
}

#[derive(Default)]
struct Record {
    phases_ns: [Vec<u64>; PHASES.len()],
    iterations: u64,
    iterations_max: u32,
    residual: f64,
}

/// The engine's computation without its station.
struct Flow<'a> {
    scene: &'a LoadedScene,
    place: Place,
    hand: &'a str,
    crew: Crew,
    cavity: Cavity,
    positions_m: Vec<[f32; 3]>,
    /// All 0, and looked at like any.
    velocities_m_s: Vec<[f32; 3]>,
    tets: Vec<[u32; 4]>,
    block: Vec<u64>,
    dt_s: f32,
}

impl<'a> Flow<'a> {
    fn new(scene: &'a LoadedScene, place: Place, bands: usize) -> Result<Flow<'a>, String> {
        let model = match place {
            Place::Cavity(cells) => model_of(scene, cells).map_err(text)?,
            Place::Box(cells) => FlowModel::new(Grid::new(cells, [CELL_M; 3], [0.0; 3]).map_err(text)?),
        };
        let cavity = Cavity::new(model.grid);
        let crew = Crew::new(Solver::new(model, bands).map_err(text)?).map_err(text)?;
        let (positions_m, tets) = tissue_at_rest(scene);
        let block = vec![0; crew.solver().state_bytes().div_ceil(size_of::<u64>())];
        let velocities_m_s = vec![[0.0; 3]; positions_m.len()];
        Ok(Flow {
            scene,
            place,
            hand: "press",
            crew,
            cavity,
            positions_m,
            velocities_m_s,
            tets,
            block,
            dt_s: 1.0 / scene.fluid.rate_hz,
        })
    }

    /// The capsule that stirs a box: across all layers, halfway between middle and wall.
    fn stirred(&self, step: usize, cells: [usize; 3]) -> FlowInputs {
        let [x, y, z] = cells.map(|count| count as f32 * CELL_M);
        let circle_m = 0.25 * x.min(y);
        let (sin, cos) = (step as f32 * self.dt_s * STIR_M_S / circle_m).sin_cos();
        let place_m = |z: f32| [0.5 * x + circle_m * cos, 0.5 * y + circle_m * sin, z];
        let velocity_m_s = [-STIR_M_S * sin, STIR_M_S * cos, 0.0];
        let mut inputs = FlowInputs { dt_s: self.dt_s, ..FlowInputs::default() };
        inputs.tools[0] = Capsule {
            a_m: place_m(0.0),
            b_m: place_m(0.7 * z),
            radius_m: 0.1 * x.min(y),
            velocity_a_m_s: velocity_m_s,
            velocity_b_m_s: velocity_m_s,
        };
        inputs
    }

    /// In the cavity: the scope as the hand moves it, the valves open as a hand would have them.
    fn inputs(&self, step: usize) -> FlowInputs {
        if let Place::Box(cells) = self.place {
            return self.stirred(step, cells);
        }
        let hand = self.scene.hand(self.hand);
        let pivot_m = self.scene.workspace.pivot_m;
        let at = |step: usize| hand.map_or(self.scene.rest, |hand| hand.pose_at(step as f64 * f64::from(self.dt_s)));
        let (pose, before_m) = (at(step), at(step.saturating_sub(1)).tip_m(pivot_m));
        let position_m = pose.tip_m(pivot_m);
        let sample = HardwareSample {
            pose: Pose { position_m, orientation: pose.orientation(), insertion_m: pose.insertion_m, ..Pose::default() },
            velocity_m_s: std::array::from_fn(|axis| (position_m[axis] - before_m[axis]) / self.dt_s),
            controls: open_valves(self.scene),
            ..HardwareSample::default()
        };
        Instrument::of(self.scene).inputs(&sample, self.dt_s)
    }

    fn run(&mut self) -> Result<Record, String> {
        let mut record = Record::default();
        let begun_ns = system::now_ns();
        let mut warm_up = WARM_UP;
        for step in 0..WARM_UP + STEPS {
            let (laps_ns, report) = self.step(step)?;
            if step < warm_up && system::now_ns() - begun_ns > WARM_UP_NS {
                warm_up = step + 1;
                continue;
            }
            if step >= warm_up {
                for (phase, lap_ns) in record.phases_ns.iter_mut().zip(laps_ns) {
                    phase.push(lap_ns);
                }
                record.iterations += u64::from(report.iterations);
                record.iterations_max = record.iterations_max.max(report.iterations);
                record.residual = record.residual.max(report.residual_relative);
            }
            if step > warm_up && system::now_ns() - begun_ns > RUN_NS {
                break;
            }
        }
        Ok(record)
    }

    fn step(&mut self, step: usize) -> Result<([u64; PHASES.len()], StepReport), String> {
        let seed_m = self.scene.rest.tip_m(self.scene.workspace.pivot_m);
        let inputs = self.inputs(step);
        let begun_ns = system::now_ns();
        let tissue = Tissue { positions_m: &self.positions_m, velocities_m_s: &self.velocities_m_s, tets: &self.tets };
        if matches!(self.place, Place::Cavity(_)) && self.cavity.update(&tissue, |_| true, seed_m) {
            self.crew.solver().set_walls(self.cavity.mask(), self.cavity.velocities_m_s()).map_err(text)?;
        }
        let walled_ns = system::now_ns();
        let report = self.crew.step(&inputs).map_err(text)?;
        let solved_ns = system::now_ns();
        self.crew.solver().store(bytemuck::cast_slice_mut(&mut self.block)).map_err(text)?;
        let stored_ns = system::now_ns();
        Ok(([walled_ns - begun_ns, solved_ns - walled_ns, stored_ns - solved_ns], report))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every hand of the default scene, half a second from pose to pose so that the last pressure helps little, on the scene's grid and
    /// on one with cells eight times as long as thin. There the order in which sums are rounded alone makes 15.2 to 20 iterations in the mean of a hand (four
    /// orders, 2026-11-25).
    #[test]
    fn the_pressure_converges_in_the_real_cavity_wherever_the_scope_is() {
        let scene = load_scene(None).unwrap();
        for (cells, bound) in [(scene.fluid.grid.map(|count| count as usize), 12.0), ([64, 64, 28], 21.0)] {
            for hand in &scene.hands {
                let mut flow = Flow::new(&scene, Place::Cavity(cells), 1).unwrap();
                flow.hand = &hand.name;
                let (mut iterations, poses) = (0, 10);
                for pose in 0..poses {
                    let (_, report) = flow.step(pose * 15).unwrap();
                    assert!(report.residual_relative <= 1e-4, "{cells:?}, hand {}, pose {pose}: {report:?}", hand.name);
                    assert!(
                        f64::from(report.iterations) <= 2.0 * bound,
                        "{cells:?}, hand {}, pose {pose}: {report:?}",
                        hand.name
                    );
                    iterations += report.iterations;
                }
                let mean = f64::from(iterations) / poses as f64;
                assert!(mean <= bound, "{cells:?}, hand {}: {mean} iterations", hand.name);
            }
        }
    }
}
