//! Which step the machine affords: the scene's, or where a step of the solver takes too much of that, twice, four times, … as long a one, found by dry
//! steps at the start. Where it affords none, the grid is made coarser ([`crate::coarse`]).
//!
//! Promise: a start on a machine that is busy for a moment leaves no session with longer steps than the machine manages. It is decided once, because
//! within an epoch every state follows from the one a step before it; the state says the step, and who follows takes it from there. A longer step
//! moves pump, blood and gas by as much more time, and so does one after periods that were skipped, as far as the solver goes ([`moved_s`]):
//! nothing of that is left out of the deficit.

use hyst_engine::{Failure, StepContext};
use hyst_flow::MAX_STEP_S;
use hyst_messages::{Controls, HardwareSample, MAX_FLUID_STEP_TICKS, Pose, StreamHeader, TICK_NS};
use hyst_scene::LoadedScene;

/// Dry steps in which the flow comes up, and those of which the least counts; the first that is short enough ends the search.
const WARM_UP: usize = 4;
const TRIALS: usize = 16;
/// A step may take this share of its period: the rest belongs to whatever is real time on the cores.
const SHARE_OF_PERIOD: f64 = 0.6;
/// A step whose least time is above this share of its period cannot be kept up with: sooner or later it is behind by more than a step makes up for.
const HOPELESS_SHARE: f64 = 0.9;
/// A step that takes so many of the longest periods ends the search: a grid of millions of cells would be tried for minutes.
const FAR_TOO_LONG: u64 = 4;
/// Trials of one length of which all take so many periods end that length, and other lengths that are as much too short are not tried: a longer step
/// takes about the same time.
const FEW_TRIALS: usize = 3;
const GIVEN_UP: f64 = 2.0;
/// The longest step that the solver takes, ticks. Of a longer gap the rest is left out: a step takes walls, scope and valves as they are at its end
/// for all of its time, which is right for a fraction of a second.
const LONGEST_STEP: u64 = (MAX_STEP_S * 1e3) as u64;
/// By it others know whether a state is ahead of its time.
const _: () = assert!(LONGEST_STEP == MAX_FLUID_STEP_TICKS);

/// The steps to be tried, in ticks, of which the first is the scene's.
fn steps(scene_ticks: u64) -> impl Iterator<Item = u64> {
    std::iter::successors(Some(scene_ticks.min(LONGEST_STEP)), |ticks| Some(2 * ticks)).take_while(|ticks| *ticks <= LONGEST_STEP)
}

/// The longest of those.
pub fn longest_step(scene_ticks: u64) -> u64 {
    steps(scene_ticks).last().unwrap_or(scene_ticks)
}

/// Whether a step is one of those, so that a state can be of it.
pub fn is_step(scene_ticks: u64, ticks: u64) -> bool {
    steps(scene_ticks).any(|step| step == ticks)
}

/// Whether a state with this header may be gone on from, as far as its step says, which is that of all that follow from it: none is longer than the longest.
/// One that founds a role was computed for no tick, and says none.
pub fn has_possible_step(header: &StreamHeader) -> bool {
    u64::from(header.step_ticks) <= LONGEST_STEP
}

/// The time by which a step from a state with this header moves pump and flow, s: all that lies between the ticks of the two states, so that periods
/// which nobody had time for are in the deficit too; no less than the period, and no more than the solver takes ([`MAX_STEP_S`]). From a state for
/// whose tick nothing was computed, which founds the role or was held still, it is the period.
///
/// Pump and flow go on by the same time: what the pump delivers comes in through the flow's ports, and what bleeds is blood in its cells, so that the
/// balance of both would not close if one went on for longer. It follows from the states alone and from no clock, so that holder and spare make the
/// same step.
pub fn moved_s(from: &StreamHeader, context: &StepContext) -> f32 {
    let gone_ticks = if from.step_ticks > 0 { context.next_tick.saturating_sub(from.tick) } else { 0 };
    gone_ticks.min(LONGEST_STEP).max(context.step_ticks) as f32 * 1e-3
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
/// can at least be kept up with; or the least time that a step took, ns, if none is.
pub fn affordable_step(
    scene_ticks: u64,
    trial: &mut dyn FnMut(u64) -> Result<u64, Failure>,
) -> Result<Result<u64, u64>, Failure> {
    let (mut longest, mut least_ns) = (scene_ticks, 0);
    for ticks in steps(scene_ticks) {
        longest = ticks;
        let period_ns = (ticks * TICK_NS) as f64;
        if least_ns as f64 > GIVEN_UP * period_ns {
            continue;
        }
        least_ns = u64::MAX;
        for tried in 0..WARM_UP + TRIALS {
            let took_ns = trial(ticks)?;
            if took_ns > FAR_TOO_LONG * LONGEST_STEP * TICK_NS {
                return Ok(Err(took_ns));
            }
            if tried >= WARM_UP {
                least_ns = least_ns.min(took_ns);
                if least_ns as f64 <= SHARE_OF_PERIOD * period_ns {
                    return Ok(Ok(ticks));
                }
                if tried + 1 >= WARM_UP + FEW_TRIALS && least_ns as f64 > GIVEN_UP * period_ns {
                    break;
                }
            }
        }
    }
    let keeps_up = least_ns as f64 <= HOPELESS_SHARE * (longest * TICK_NS) as f64;
    Ok(if keeps_up { Ok(longest) } else { Err(least_ns) })
}

/// Why a grid of so many cells, whose step takes so long, is none for this machine.
pub fn refused(cells: usize, took_ns: u64) -> Failure {
    let took_ms = took_ns as f64 * 1e-6;
    let room = cells as f64 * SHARE_OF_PERIOD * LONGEST_STEP as f64 / took_ms;
    Failure::Input(format!(
        "a fluid of {cells} cells is too much for this machine: a step takes {took_ms:.0} ms of computing, and the longest may be {LONGEST_STEP} ms; \
         there is time for about {room:.0} cells; take a coarser `fluid.grid`, or a faster machine"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn found(scene_ticks: u64, mut took_us: impl FnMut(usize, u64) -> u64) -> (Result<u64, u64>, usize) {
        let mut trials = 0;
        let mut trial = |ticks: u64| {
            trials += 1;
            Ok(took_us(trials, ticks) * 1_000)
        };
        let ticks = affordable_step(scene_ticks, &mut trial).unwrap();
        (ticks, trials)
    }

    #[test]
    fn a_machine_that_keeps_the_scenes_rate_gets_it_also_if_it_is_busy_at_first() {
        assert_eq!(found(33, |_, _| 5_000), (Ok(33), 5));
        assert_eq!(found(33, |trial, _| if trial < 20 { 60_000 } else { 5_000 }), (Ok(33), 20));
        assert_eq!(found(250, |_, _| 100_000), (Ok(250), 5));
    }

    #[test]
    fn a_machine_that_does_not_takes_twice_as_long_steps_until_it_does() {
        let each = WARM_UP + TRIALS;
        assert_eq!(found(33, |_, _| 30_000), (Ok(66), each + WARM_UP + 1));
        assert_eq!(found(33, |_, _| 70_000), (Ok(132), WARM_UP + FEW_TRIALS + each + WARM_UP + 1));
        assert_eq!(found(20, |_, ticks| 11_000 + 100 * ticks).0, Ok(40), "longer steps cost a little more");
        assert_eq!(found(33, |_, _| 110_000).0, Ok(132), "the longest that the solver takes is kept up with");
    }

    #[test]
    fn a_step_that_is_longer_than_any_is_none_to_go_on_with() {
        let is_possible = |ticks: u32| has_possible_step(&StreamHeader { step_ticks: ticks, ..StreamHeader::default() });
        let longest = LONGEST_STEP as u32;
        assert_eq!([66, 0, longest, longest + 1, u32::MAX].map(is_possible), [true, true, true, false, false]);
    }

    #[test]
    fn what_no_step_can_keep_up_with_is_found_soon_and_refused_with_its_cells() {
        assert_eq!(found(33, |_, _| 130_000), (Err(130 * MS), WARM_UP + FEW_TRIALS + 2 * (WARM_UP + TRIALS)));
        assert_eq!(found(33, |_, _| 600_000), (Err(600 * MS), WARM_UP + FEW_TRIALS), "the other lengths are too short as well");
        assert_eq!(
            found(33, |_, _| 5 * LONGEST_STEP * MS / 1_000),
            (Err(5 * LONGEST_STEP * MS), 1),
            "millions of cells are tried once"
        );
        let said = refused(1_000, 130 * MS).to_string();
        assert!(said.contains("1000 cells") && said.contains("130 ms") && said.contains("fluid.grid"), "{said}");
    }
}
