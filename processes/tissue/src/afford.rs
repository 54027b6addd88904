//! Which step the machine affords: the shortest whose deformation takes no more than its share of the period, found by dry steps at the start.
//!
//! Promise: a start on a machine that is busy for a moment leaves no session with longer steps than the machine manages. Within
//! an epoch every state follows from the one a step before it; the state says the step, and followers take it from there. It becomes longer at the begin
//! of an epoch alone, on a machine that has become too slow for it (`hyst_engine::stateful`), and shorter in no session.

use crate::contacts::LAW;
use crate::world::World;
use hyst_engine::Failure;
use hyst_exchange::system;
use hyst_messages::TICK_NS;
use hyst_tissue::{Scratch, StateMut, StateRef, StepInput, step};

/// Dry steps of each length that find out what the machine manages, one each [`PAUSE_NS`]. The least counts, and the first that is short enough ends
/// it: a machine that affords the step says so at once, others spend 0.5 s on each length.
const TRIALS: usize = 100;
/// Between two trials, ns: a compiler, or another station that starts, does not hold all of them up.
const PAUSE_NS: u64 = 5_000_000;
/// A step may take this share of its period: the rest belongs to the others on the core.
const SHARE_OF_PERIOD: f64 = 0.6;
/// A step whose least time is above this share of its period cannot be kept up with: its process would take a whole core from everybody else.
const HOPELESS_SHARE: f64 = 0.9;
/// Trials of one length that are all this many times too long end the search.
const FAR_TOO_LONG: f64 = 4.0;
/// How many such trials.
const FEW_TRIALS: usize = 20;
/// Steps in ticks.
const STEPS: [u64; 3] = [1, 2, LONGEST_STEP];
/// The longest of them.
pub const LONGEST_STEP: u64 = 4;

/// The shortest step, in ticks, that is afforded; the longest if that can at least be kept up with.
///
/// # Errors
/// A scene that this machine cannot run: how long its step takes, and how many tets there is time for.
pub fn affordable_step(world: &World) -> Result<u64, Failure> {
    let rest = world.model.rest_m().to_vec();
    let still = vec![[0.0; 3]; rest.len()];
    let (mut position_m, mut velocity_m_s) = (rest.clone(), still.clone());
    let mut scratch = Scratch::new(&world.model);
    let mut trial = |ticks: u64| -> Result<u64, Failure> {
        // The thread's own time: another that takes the core meanwhile does not make the step longer.
        let begun_ns = system::thread_ns();
        let now = StateRef { position_m: &rest, velocity_m_s: &still };
        let next = StateMut { position_m: &mut position_m, velocity_m_s: &mut velocity_m_s };
        let input = StepInput { attachments: &world.attachments, law: LAW, dt_s: ticks as f32 * 1e-3, ..StepInput::default() };
        step(&world.model, &mut scratch, now, &input, next).map_err(|error| Failure::Input(error.to_string()))?;
        Ok(system::thread_ns() - begun_ns)
    };
    let tets = world.body.rest.tets.len();
    first_affordable(&mut trial, || system::sleep_ns(PAUSE_NS))?.map_err(|least_ns| {
        let (longest, least_ms) = (LONGEST_STEP, least_ns as f64 * 1e-6);
        let room = tets as f64 * SHARE_OF_PERIOD * longest as f64 / least_ms;
        Failure::Input(format!(
            "{tets} tets are too many for this machine: a step of {longest} ms takes {least_ms:.1} ms of computing, and there is time for about \
             {room:.0} tets like these; coarsen the mesh, take a softer material, or a faster machine"
        ))
    })
}

/// The length in ticks, or the least time that the longest took, ns.
fn first_affordable(trial: &mut dyn FnMut(u64) -> Result<u64, Failure>, pause: impl Fn()) -> Result<Result<u64, u64>, Failure> {
    let mut least_ns = u64::MAX;
    for ticks in STEPS {
        let period_ns = (ticks * TICK_NS) as f64;
        least_ns = u64::MAX;
        for tried in 1..=TRIALS {
            least_ns = least_ns.min(trial(ticks)?);
            if (least_ns as f64) < SHARE_OF_PERIOD * period_ns {
                return Ok(Ok(ticks));
            }
            if tried == FEW_TRIALS && least_ns as f64 > FAR_TOO_LONG * period_ns {
                break;
            }
            pause();
        }
    }
    let keeps_up = least_ns as f64 <= HOPELESS_SHARE * (LONGEST_STEP * TICK_NS) as f64;
    Ok(if keeps_up { Ok(LONGEST_STEP) } else { Err(least_ns) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(mut step_us: impl FnMut(usize, u64) -> u64) -> (Result<u64, u64>, usize) {
        let mut trials = 0;
        let mut trial = |ticks: u64| {
            trials += 1;
            Ok(step_us(trials, ticks) * 1_000)
        };
        let ticks = first_affordable(&mut trial, || {}).unwrap();
        (ticks, trials)
    }

    #[test]
    fn a_start_that_is_busy_for_a_while_leaves_the_step_that_the_machine_affords() {
        assert_eq!(found(|_, ticks| 400 * ticks), (Ok(1), 1), "at once");
        assert_eq!(found(|trial, ticks| if trial < 90 { 3_000 } else { 400 * ticks }), (Ok(1), 90));
        assert_eq!(found(|_, ticks| 400 + 300 * ticks), (Ok(2), TRIALS + 1));
        assert_eq!(found(|_, ticks| 700 * ticks), (Ok(4), 3 * TRIALS));
    }
    #[test]
    fn a_step_that_no_length_can_keep_up_with_is_refused_with_its_time_and_soon() {
        assert_eq!(found(|_, ticks| 1_000 * ticks), (Err(4_000_000), 3 * TRIALS));
        assert_eq!(found(|_, ticks| 20_000 * ticks), (Err(80_000_000), 3 * FEW_TRIALS));
    }
}
