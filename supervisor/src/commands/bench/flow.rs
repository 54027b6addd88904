//! `bench flow`: the Flow Engine's own benchmark, and what a fine grid costs the Main Loop: the default station without a fluid, and with one of
//! 64 × 28 × 64 cells, in turns, so that what the host does falls on both. The row is the median step of the Main Loop (its loop latency) with the
//! fluid over that without, the median of the pairs. It counts only if the fluid had that grid, and 25 Hz.

use super::arm::{Arm, Kind};
use super::probe::Spell;
use super::program::{self, Said};
use super::targets::{Target, figures, median, ratios};
use super::{Folder, beside, not_started};
use crate::settings::Refusal;
use hyst_messages::Role;
use hyst_scene::Scene;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The grid of the comparison: 28 cells along the thin axis of the default scene.
const CELLS: [usize; 3] = [64, 28, 64];
/// Pairs of windows. The ten pairs of two runs lay between 0.73 and 1.11, and the medians of five came to 0.98 and 1.08, on both sides of the limit
/// (2-core VM that is shared, 2026-11-28). A median of eleven forgets five that the host disturbed.
const ROUNDS: usize = 11;
/// The Main Loop's step with the fluid over that without.
const MOST_RATIO: f64 = 1.05;
/// The fluid's rate meanwhile, Hz: one that hardly runs costs the Main Loop nothing. That of Tuchschmid et al. (ISBMS 2006); the scene asks for 30. A
/// period counts whoever of the role made its state.
const LEAST_HZ: f64 = 25.0;

/// Measures, prints, and says whether every target is held.
pub fn flow(mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    if mesh.is_some() {
        return Err(Refusal::input("bench flow: it has grids of its own, and takes no mesh"));
    }
    let path = beside("fluid")?;
    let mut command = Command::new(&path);
    command
        .args(["bench", "flow"])
        .args(json.then_some("--json"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit());
    let mut own = command.spawn().map_err(|e| not_started(&path, &e))?;
    let said = Said::of(own.stdout.take());
    let status = program::ends_within(&mut own, program::MOST_NS);
    let status = status.ok_or_else(|| program::endless("bench flow: the Flow Engine's own benchmark", program::MOST_NS))?;
    let (code, rows) = (status.code().unwrap_or(1), said.text());
    if code > 1 {
        let message = "bench flow: the Flow Engine's own benchmark failed; what it said is above".into();
        return Err(Refusal { code: code.clamp(1, 255) as u8, message });
    }
    if !json {
        print!("{rows}");
    }
    let (row, target) = beside_the_main_loop()?;
    if json {
        let mut all: Value = serde_json::from_str(&rows).map_err(|e| Refusal::failed(format!("fluid bench flow: {e}")))?;
        if let Some(rows) = all["rows"].as_array_mut() {
            rows.extend([row, target.json()]);
        }
        println!("{all:#}");
    } else {
        println!("{row}");
        println!("{target}");
    }
    Ok(u8::from(code != 0 || target.held != Some(true)))
}

/// The fine scene as a file, in a folder that is removed when dropped.
struct FineScene(Folder);

impl FineScene {
    fn new() -> Result<FineScene, Refusal> {
        let scene = FineScene(Folder::new("flow")?);
        let path = scene.path();
        std::fs::write(&path, fine_text()).map_err(|e| Refusal::failed(format!("{}: {e}", path.display())))?;
        Ok(scene)
    }
    fn path(&self) -> PathBuf {
        self.0.file("fine.toml")
    }
}

fn fine_text() -> String {
    let text = Scene::embedded_text();
    let mut table: toml::Table = text.parse().unwrap_or_default();
    if let Some(fluid) = table.get_mut("fluid").and_then(toml::Value::as_table_mut) {
        fluid.insert("grid".into(), CELLS.map(|cells| toml::Value::Integer(cells as i64)).to_vec().into());
    }
    table.to_string()
}

fn beside_the_main_loop() -> Result<(Value, Target), Refusal> {
    let scene = FineScene::new()?;
    let mut arms = [Arm::new(Kind::Processes, 0), Arm::new(Kind::Processes, 0).without(Role::Fluid)];
    for round in 0..ROUNDS {
        for turn in 0..arms.len() {
            arms[(round + turn) % 2].run(Some(&scene.path()))?;
        }
    }
    Ok(judged(&arms))
}

fn judged(arms: &[Arm; 2]) -> (Value, Target) {
    let [with, without] = arms;
    let of_flow = |figure: fn(&Spell) -> Option<f64>| median(figures(with, "fluid:active", figure));
    let halvings = with.windows.iter().filter_map(|window| window.spells.get("fluid:active")?.halvings).max();
    let fluid_hz = of_flow(Spell::rate_hz);
    let steps = |arm: &Arm| arm.windows.iter().map(super::targets::step_us).collect::<Vec<_>>();
    let pairs = ratios(with, without);
    let row = json!({
        "arm": "station",
        "name": "Main Loop beside the fluid",
        "grid": CELLS.map(|cells| cells.to_string()).join("x"),
        "halvings": halvings,
        "fluid_hz": fluid_hz,
        "main_loop_us": { "with": steps(with), "without": steps(without) },
        "ratios": pairs,
        "failures": [&with.failures, &without.failures],
    });
    // A grid or a rate that the machine does not afford is not what was asked for.
    let is_fine = halvings == Some(0) && fluid_hz.is_some_and(|hz| hz >= LEAST_HZ);
    let ratio = median(pairs).filter(|_| is_fine && arms.iter().all(|arm| arm.failures.is_empty()));
    let name = format!(
        "Main Loop's median step, with a fluid of {} at {:.1} Hz (at least {LEAST_HZ}) over without",
        row["grid"].as_str().unwrap_or_default(),
        fluid_hz.unwrap_or(0.0)
    );
    (row, Target::new(name, ratio, MOST_RATIO, false).required())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::bench::probe::Window;

    fn window(step_ns: u64, halvings: u32, fluid_steps: u64) -> Window {
        let mut looping = vec![0; hyst_messages::LATENCY_BUCKETS];
        looping[hyst_messages::bucket_of_ns(step_ns)] = 1_000;
        let tissue = Spell { seconds: 2.0, steps: Some(2_000), looping, ..Spell::default() };
        let fluid = Spell { seconds: 2.0, steps: Some(fluid_steps), halvings: Some(halvings), ..Spell::default() };
        let spells = [("tissue:active".into(), tissue), ("fluid:active".into(), fluid)].into();
        Window { spells, quiet: true, ..Window::default() }
    }

    #[test]
    fn a_fluid_that_slows_the_main_loop_or_whose_grid_was_halved_or_that_is_slow_itself_is_not_held() {
        let cases = [
            (500_000, 0, 60, true),
            (700_000, 0, 60, false),
            (500_000, 1, 60, false),
            (500_000, 0, 50, true),
            (500_000, 0, 49, false),
            (500_000, 0, 12, false),
        ];
        for (with_ns, halvings, fluid_steps, held) in cases {
            let mut arms = [Arm::new(Kind::Processes, 0), Arm::new(Kind::Processes, 0).without(Role::Fluid)];
            arms[0].windows = vec![window(with_ns, halvings, fluid_steps); 3];
            arms[1].windows = vec![window(500_000, 0, fluid_steps); 3];
            let (row, target) = judged(&arms);
            assert_eq!(target.held, Some(held), "{row}");
        }
    }

    #[test]
    fn the_fine_scene_is_the_default_one_with_another_grid() {
        let fine = FineScene::new().unwrap();
        let loaded = hyst_scene::load(&fine.path()).unwrap();
        assert_eq!(loaded.fluid.grid.map(|cells| cells as usize), CELLS);
        let path = fine.path();
        drop(fine);
        assert!(!path.exists());
    }
}
