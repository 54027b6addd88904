//! Which step the machine affords: the scene's, or where a step of the solver takes too much of that, twice, four times, … as long a one, found by dry
//! steps at the start. The grid stays the scene's: everybody who reads the field knows it, and the state of one grid is none of another.
//!
//! Promise: a start on a machine that is busy for a moment leaves no session with longer steps than the machine manages. It is decided once, because
//! within an epoch every state follows from the one a step before it; the state says the step, and who follows takes it from there. A longer step
//! moves pump, blood and gas by as much more time: nothing is left out of the deficit.

use hyst_engine::Failure;
use hyst_flow::MAX_STEP_S;
use hyst_messages::{Controls, HardwareSample, Pose, TICK_NS};
use hyst_scene::LoadedScene;

/// Dry steps in which the flow comes up, and those of which the least counts; the first that is short enough ends the search.
const WARM_UP: usize = 4;
const TRIALS: usize = 16;
/// A step may take this share of its period: the rest belongs to whatever is real time on the cores.
const SHARE_OF_PERIOD: f64 = 0.6;
/// A step whose least time is above this share of its period cannot be kept up with, and the pump would lose time.
const HOPELESS_SHARE: f64 = 0.9;
/// A first step that takes so many of the longest periods ends the search: a grid of millions of cells would be tried for minutes.
const FAR_TOO_LONG: u64 = 4;
/// The longest step that the solver takes, ticks.
const LONGEST_STEP: u64 = (MAX_STEP_S * 1e3) as u64;

/// The steps to be tried, in ticks, of which the first is the scene's.
fn steps(scene_ticks: u64) -> impl Iterator<Item = u64> {
    std::iter::successors(Some(scene_ticks.min(LONGEST_STEP)), |ticks| Some(2 * ticks)).take_while(|ticks| *ticks <= LONGEST_STEP)
}

/// Whether a step is one of those, so that a state can be of it.
pub fn is_step(scene_ticks: u64, ticks: u64) -> bool {
    steps(scene_ticks).any(|step| step == ticks)
}

/// The scope where it rests at first, with the valves as a hand would have them.
pub fn at_rest(scene: &LoadedScene) -> HardwareSample {
    let rest = &scene.rest;
    let position_m = rest.tip_m(scene.workspace.pivot_m);
    HardwareSample {
        pose: Pose { position_m, orientation: rest.orientation(), insertion_m: rest.insertion_m, ..Pose::default() },
        controls: open_valves(scene),
        ..HardwareSample::default()
    }
}

/// Both valves open, and the scene's set pressure.
pub fn open_valves(scene: &LoadedScene) -> Controls {
    Controls { inflow_valve: 1.0, outflow_valve: 0.4, set_pressure_pa: scene.fluid.set_pressure_pa, ..Controls::default() }
}

/// Nodes and tets of all objects of a scene at rest, m.
pub fn tissue_at_rest(scene: &LoadedScene) -> (Vec<[f32; 3]>, Vec<[u32; 4]>) {
    let (mut positions_m, mut tets) = (Vec::new(), Vec::new());
    for object in &scene.objects {
        let first = positions_m.len() as u32;
        positions_m.extend_from_slice(&object.mesh.positions_m);
        tets.extend(object.mesh.tets.iter().map(|tet| tet.map(|node| node + first)));
    }
    (positions_m, tets)
}

/// The shortest step in ticks that is afforded, from the scene's on; `trial` takes a dry step of so many and says how long that took, ns. The longest if it
/// can at least be kept up with, or if a session `has_begun`.
///
/// # Errors
/// A grid that this machine cannot compute, with how long its step takes and how many cells there is time for.
pub fn affordable_step(
    scene_ticks: u64,
    cells: usize,
    has_begun: bool,
    trial: &mut dyn FnMut(u64) -> Result<u64, Failure>,
) -> Result<u64, Failure> {
    let (mut longest, mut least_ns) = (scene_ticks, u64::MAX);
    for ticks in steps(scene_ticks) {
        (longest, least_ns) = (ticks, u64::MAX);
        for tried in 0..WARM_UP + TRIALS {
            let took_ns = trial(ticks)?;
            if took_ns > FAR_TOO_LONG * LONGEST_STEP * TICK_NS {
                return refused(cells, has_begun, took_ns);
            }
            if tried >= WARM_UP {
                least_ns = least_ns.min(took_ns);
                if least_ns as f64 <= SHARE_OF_PERIOD * (ticks * TICK_NS) as f64 {
                    return Ok(ticks);
                }
            }
        }
    }
    let keeps_up = least_ns as f64 <= HOPELESS_SHARE * (longest * TICK_NS) as f64;
    if keeps_up { Ok(longest) } else { refused(cells, has_begun, least_ns) }
}

fn refused(cells: usize, has_begun: bool, took_ns: u64) -> Result<u64, Failure> {
    if has_begun {
        return Ok(LONGEST_STEP);
    }
    let took_ms = took_ns as f64 * 1e-6;
    let room = cells as f64 * SHARE_OF_PERIOD * LONGEST_STEP as f64 / took_ms;
    Err(Failure::Input(format!(
        "a fluid of {cells} cells is too much for this machine: a step takes {took_ms:.0} ms of computing, and the longest may be {LONGEST_STEP} ms; \
         there is time for about {room:.0} cells; take a coarser `fluid.grid`, or a faster machine"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn found(scene_ticks: u64, has_begun: bool, mut took_us: impl FnMut(usize, u64) -> u64) -> (Result<u64, Failure>, usize) {
        let mut trials = 0;
        let mut trial = |ticks: u64| {
            trials += 1;
            Ok(took_us(trials, ticks) * 1_000)
        };
        let ticks = affordable_step(scene_ticks, 1_000, has_begun, &mut trial);
        (ticks, trials)
    }

    #[test]
    fn a_machine_that_keeps_the_scenes_rate_gets_it_also_if_it_is_busy_at_first() {
        assert!(matches!(found(33, false, |_, _| 5_000), (Ok(33), 5)));
        assert!(matches!(found(33, false, |trial, _| if trial < 20 { 60_000 } else { 5_000 }), (Ok(33), 20)));
        assert!(matches!(found(250, false, |_, _| 100_000), (Ok(250), 5)));
    }

    #[test]
    fn a_machine_that_does_not_takes_twice_as_long_steps_until_it_does() {
        let each = WARM_UP + TRIALS;
        assert!(matches!(found(33, false, |_, _| 30_000), (Ok(66), trials) if trials == each + WARM_UP + 1));
        assert!(matches!(found(33, false, |_, _| 70_000), (Ok(132), trials) if trials == 2 * each + WARM_UP + 1));
        // Longer steps cost a little more.
        assert!(matches!(found(20, false, |_, ticks| 11_000 + 100 * ticks), (Ok(40), _)));
        assert!(matches!(found(33, false, |_, _| 110_000), (Ok(132), _)), "the longest that the solver takes is kept up with");
    }

    #[test]
    fn what_no_step_can_keep_up_with_is_refused_with_its_cells_unless_a_session_has_begun() {
        let (refused, _) = found(33, false, |_, _| 130_000);
        let said = refused.unwrap_err().to_string();
        assert!(said.contains("1000 cells") && said.contains("130 ms") && said.contains("fluid.grid"), "{said}");
        assert!(matches!(found(33, true, |_, _| 130_000), (Ok(LONGEST_STEP), _)));
        let (refused, trials) = found(33, false, |_, _| 5 * LONGEST_STEP * MS / 1_000);
        assert!(refused.is_err() && trials == 1, "a grid of millions of cells is tried once");
    }
}
