//! Which promises a run's report shows to be broken beyond doubt, in words: then it ends with exit code 1.
//!
//! A single fault breaks its promise by what a campaign would call broken for it alone: a force that must not be applied, nobody who is back in time, a step
//! of the force, a gap ([`Fault::gap`]). Of the device, which may cost so many ticks, or one that was asked for as such, one more is too many. Of any other a
//! tick or two may be the machine's own noise, and they tell something only together with those of the other faults ([`Arms::broken`]). A run has few
//! controls: so all of them together say what the machine does by itself, whatever state they lie in, and what may be another fault's doing is no broken
//! promise.

use super::arms::Arms;
use crate::fault::compare::{excess, most_missed, tells};
use crate::fault::{Fault, bounds, most_step_n};
use crate::ledger::Window;
use hyst_messages::Role;
use serde_json::Value;
use std::collections::BTreeSet;

/// What was broken, a line for each.
pub(super) fn broken(report: &Value) -> Vec<String> {
    let count = |key: &str| report.get(key).and_then(Value::as_u64).filter(|count| *count > 0);
    let of_run = [("invalid_applied", "invalid"), ("stale_applied", "stale")];
    let of_run = of_run.into_iter().filter_map(|(key, what)| Some(format!("{} {what} forces were applied", count(key)?)));
    let faults: Vec<Fault> =
        report.get("faults").and_then(|faults| serde_json::from_value(faults.clone()).ok()).unwrap_or_default();
    let quiet = Quiet::of(&faults);
    // Who is lost for good is said by another exit code.
    let is_lost = |fault: &Fault| report["given_up"].as_array().is_some_and(|all| all.iter().any(|slot| *slot == fault.target));
    let of_one = |fault: &Fault| {
        let why = why(fault, &faults, &quiet, is_lost(fault))?;
        Some(format!("fault {} of {} at tick {}: {why}", fault.kind, fault.target, fault.tick))
    };
    let of_all = Arms::of(faults.iter().filter(|fault| !fault.may_be_felt())).broken();
    of_run.chain(faults.iter().filter_map(of_one)).chain(of_all).collect()
}

/// What the controls of a run say of ticks without a fault.
struct Quiet {
    /// Most ticks that one of them lost.
    missed: u64,
    /// Their largest step of the force, N.
    step_n: f64,
}

impl Quiet {
    fn of(faults: &[Fault]) -> Quiet {
        let controls = || faults.iter().filter_map(|fault| fault.control).filter(Window::is_whole);
        let step_n = controls().map(|control| control.force_step_max_n).fold(0.0, f64::max);
        Quiet { missed: most_missed(controls()), step_n }
    }
}

/// How a fault broke its promise by itself; `None` where that is not certain.
fn why(fault: &Fault, faults: &[Fault], quiet: &Quiet, is_lost: bool) -> Option<String> {
    let wrong = fault.window.map_or(0, |window| window.wrong);
    if wrong > 0 {
        let what = "forces that were not finite, too large, old, or made by a servo that lied";
        return Some(format!("the hand was given {wrong} {what}"));
    }
    if fault.target == Role::Hardware.name() {
        return None; // the thing on the desk, of which nothing is promised
    }
    if fault.is_not_back() && !is_lost {
        return Some("nobody was back in its place in time".into());
    }
    jerk(fault, faults, quiet).or_else(|| gap(fault, faults, quiet))
}

/// The step of the force, if neither the ticks before it nor its control made such a one (`fault::judge`), nor any other control.
fn jerk(fault: &Fault, faults: &[Fault], quiet: &Quiet) -> Option<String> {
    let made_n = fault.window.filter(|_| !fault.step.is_empty())?.force_step_max_n;
    // Of one that leaves nobody the own may be larger.
    let may_fade = |it: &Fault| it.may_let_the_force_fade() || took_the_last_servo(it, faults);
    let is_own = may_fade(fault);
    let may_be_anothers = || !is_own && faults.iter().any(|other| meet(fault, other) && may_fade(other));
    let is_broken = made_n > most_step_n(quiet.step_n, is_own) && !may_be_anothers();
    is_broken.then(|| format!("a force step of {made_n:.3} N, {:.3} N without a fault", quiet.step_n))
}

/// The ticks that the hand lost.
fn gap(fault: &Fault, faults: &[Fault], quiet: &Quiet) -> Option<String> {
    let allowed = fault.allowed_misses()?;
    let (window, control) = fault.window.zip(fault.control).filter(|(window, control)| tells(window) && tells(control))?;
    let is_beyond = |beyond: u64| allowed > 0 && beyond > allowed.max(quiet.missed);
    let lost = match u64::try_from(excess(&window, &control)) {
        Ok(beyond) if is_beyond(beyond) => Some(window.missed),
        _ => fault.gap(allowed, quiet.missed),
    };
    let lost = lost.filter(|_| !is_beside_one_that_is_felt(fault, faults))?;
    Some(format!("the hand lost {lost} ticks, {} at most without a fault", quiet.missed))
}

/// Whether the windows of two faults have ticks in common.
fn meet(one: &Fault, other: &Fault) -> bool {
    let ((from, to), (other_from, other_to)) = (bounds(one), bounds(other));
    from < other_to && other_from < to
}

/// Whether it is one of two faults of the two servos whose windows meet: who kills them one after the other by hand makes a fault of each, and nobody is left.
fn took_the_last_servo(fault: &Fault, faults: &[Fault]) -> bool {
    let is_of_the_other = |other: &Fault| other.is_of_servo() && other.target != fault.target && meet(fault, other);
    fault.is_of_servo() && faults.iter().any(is_of_the_other)
}

/// Whether it may have been another fault, that of a device or of both servos, or one that may cost more, for which the hand had nobody. A campaign tells both
/// faults of a cell what they may cost together, so that neither excuses the other. Who kills two by hand makes a fault of each.
fn is_beside_one_that_is_felt(fault: &Fault, faults: &[Fault]) -> bool {
    let here = || faults.iter().filter(|other| meet(fault, other));
    let is_servo = |target: &&str| Role::name_in(target) == Role::Haptic.name();
    let servos: BTreeSet<&str> = here().map(|other| other.target.as_str()).filter(is_servo).collect();
    let own = fault.allowed_misses().unwrap_or(0);
    let may_cost_more = |other: &Fault| other.allowed_misses().is_none_or(|ticks| ticks > own);
    let is_told = |it: &Fault| it.may_cost_ticks.is_some();
    let is_one_more = |other: &Fault| !std::ptr::eq(other, fault) && !is_told(other) && !is_told(fault);
    servos.len() > 1 || here().any(|other| other.may_be_felt() && (may_cost_more(other) || is_one_more(other)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Tick;
    use serde_json::json;

    /// A fault at tick 9 000 that cost so many ticks, over after a tenth of a second, with a control that lost none.
    fn fault(target: &str, missed: u64) -> Fault {
        let window = |from_tick: u64, missed: u64| {
            let to_tick = from_tick + 200;
            Some(Window { from_tick, to_tick, ticks: 200, missed, ..Window::default() })
        };
        let (kind, target, recovered_us) = ("kill".into(), target.into(), Some(100_000.0));
        let (window, control) = (window(9_000, missed), window(8_000, 0));
        Fault { kind, target, tick: 9_000, recovered_us, window, control, ..Fault::default() }
    }

    /// One whose window has a step of the force, and its control another; `is_new`: one that the ticks before it had not made.
    fn stepping(target: &str, [step_n, control_n]: [f64; 2], is_new: bool) -> Fault {
        let of = |window: Window, force_step_max_n: f64| Some(Window { force_step_max_n, ..window });
        let made = fault(target, 0);
        let (window, control) = (made.window.and_then(|it| of(it, step_n)), made.control.and_then(|it| of(it, control_n)));
        let step = if is_new { vec![Tick::default()] } else { Vec::new() };
        Fault { window, control, step, ..made }
    }

    fn with_window(fault: Fault, change: impl Fn(Window) -> Window) -> Fault {
        Fault { window: fault.window.map(change), ..fault }
    }

    /// What is said to be broken of these faults, each alone and all together.
    fn said_of(faults: &[Fault]) -> Vec<String> {
        broken(&json!({ "faults": faults }))
    }

    fn broken_of(faults: &[Fault]) -> usize {
        said_of(faults).len()
    }

    #[test]
    fn a_tick_or_two_are_noise_and_what_the_hardware_does_not_bridge_is_a_broken_promise_of_one_fault() {
        assert_eq!(broken(&json!({})), Vec::<String>::new());
        let of = |target: &str, missed: u64| broken_of(&[fault(target, missed)]);
        assert_eq!([0, 2, 20, 21].map(|missed| of("tissue:0", missed)), [0, 0, 0, 1]);
        assert_eq!([20, 21].map(|missed| of("device", missed)), [0, 1], "to the tick that it may cost");
        let both = Fault { together: true, ..fault("haptic:0", 900) };
        assert_eq!(broken_of(&[both]), 0, "the force fades until one is back");
        let late = Fault { aftermath: Some(Window { missed: 19, ..Window::default() }), ..fault("fluid:0", 2) };
        assert_eq!(broken_of(&[late]), 1, "right after it, too");
        let said = "fault kill of tissue:1 at tick 9000: the hand lost 30 ticks, 0 at most without a fault";
        assert_eq!(said_of(&[fault("tissue:1", 30)]), [said]);
    }

    /// Stations of a campaign of hand-overs ended with 1 for the deaths of servos that were alone, although its cells allowed what these cost.
    #[test]
    fn what_a_fault_may_cost_by_what_was_said_with_it_breaks_no_promise_and_one_tick_more_does() {
        let of = |missed: u64| Fault { may_cost_ticks: Some(300), ..fault("haptic:0", missed) };
        assert_eq!([30, 300, 301].map(|missed| broken_of(&[of(missed)])), [0, 0, 1]);
        assert_eq!(broken_of(&[30, 31, 32, 33, 34].map(of)), 0, "nor do many");
        assert_eq!(broken_of(&[of(30), fault("tissue:0", 30)]), 0, "nor does one that is beside it");
    }

    /// The first fault of a cell, told what the device beside it may cost, excused whatever that one cost.
    #[test]
    fn only_what_may_cost_more_excuses_what_the_hand_lost() {
        let told = |target: &str, ticks: u64, missed: u64| Fault { may_cost_ticks: Some(ticks), ..fault(target, missed) };
        let beside = |tissue_ticks: u64, missed: u64| broken_of(&[told("tissue:0", tissue_ticks, 0), told("device", 20, missed)]);
        assert_eq!([beside(20, 20), beside(20, 500), beside(300, 500)], [0, 1, 0]);
        assert_eq!(broken_of(&[told("tissue:0", 20, 0), fault("device", 500)]), 1, "a device may cost as many by what it is");
        assert_eq!(broken_of(&[fault("device", 30), fault("device", 30)]), 0, "two by hand, one after the other");
    }

    #[test]
    fn what_the_machine_does_by_itself_or_another_fault_did_is_no_broken_promise() {
        let later = |other: Fault| Fault { tick: 99_000, ..other };
        let stalled = Fault { control: fault("fluid:0", 40).window, ..later(fault("fluid:0", 0)) };
        assert_eq!(broken_of(&[fault("tissue:0", 30), stalled.clone()]), 0, "a control lost more");
        assert_eq!(broken_of(&[fault("device", 30), stalled]), 0, "of the device as well");
        let void = with_window(fault("tissue:0", 30), |window| Window { ticks: 150, voided: 50, ..window });
        let cut = with_window(fault("tissue:0", 30), |window| Window { ticks: 150, ..window });
        assert_eq!(broken_of(&[void, cut, Fault { control: None, ..fault("tissue:0", 30) }]), 0, "nothing is known of them");
        let device = || fault("device", 12);
        assert_eq!(broken_of(&[fault("tissue:0", 30), device()]), 0, "there was no device");
        assert_eq!(broken_of(&[fault("tissue:0", 30), later(device())]), 1);
        assert_eq!(broken_of(&[fault("haptic:0", 99), fault("haptic:1", 99)]), 0, "both, by hand");
        assert_eq!(broken_of(&[fault("haptic:0", 99), later(fault("haptic:1", 0))]), 1);
        assert_eq!(broken_of(&[fault("hardware", 99)]), 0, "the plug was pulled");
    }

    #[test]
    fn a_force_that_must_not_be_and_one_who_does_not_come_back_are_broken_promises_of_one_fault() {
        let wrong = with_window(fault("haptic:0", 0), |window| Window { wrong: 1, ..window });
        assert!(said_of(&[Fault { control: None, ..wrong }])[0].contains("the hand was given 1 forces"));
        let gone = Fault { recovered_us: None, dead: true, ..fault("recorder", 0) };
        let overdue = Fault { overdue: true, ..gone.clone() };
        assert_eq!([gone, overdue.clone()].map(|fault| broken_of(&[fault])), [0, 1], "the run ended before its time was over");
        let goes_on = Fault { dead: false, detected_us: Some(5.0), asked: Some((0, 0)), ..overdue.clone() };
        assert_eq!(broken_of(std::slice::from_ref(&goes_on)), 0, "it is there, and does what it was asked to");
        assert_eq!(broken_of(&[Fault { asked: None, ..goes_on }]), 1, "it was found hanging");
        let lost = broken(&json!({ "faults": [overdue], "given_up": ["recorder"] }));
        assert_eq!(lost.len(), 0, "it is lost, which is said by itself: {lost:?}");
    }

    #[test]
    fn only_a_step_that_no_tick_without_a_fault_made_breaks_the_promise() {
        let of = |target: &str, steps_n, is_new| broken_of(&[stepping(target, steps_n, is_new)]);
        assert_eq!(of("tissue:0", [0.4, 0.1], true), 1);
        assert_eq!(of("tissue:0", [0.14, 0.1], true), 0, "within what is allowed");
        assert_eq!(of("tissue:0", [0.4, 0.1], false), 0, "the ticks before it stepped as much");
        let by_design = [[0.24, 0.1], [0.26, 0.1]].map(|steps_n| of("device", steps_n, true));
        assert_eq!(by_design, [0, 1], "its death makes some by design");
        let beside = [stepping("tissue:0", [0.4, 0.1], true), stepping("device", [0.2, 0.1], false)];
        assert_eq!(broken_of(&beside), 0, "it may be the device's");
        let of_both = ["haptic:0", "haptic:1"].map(|target| Fault { together: true, ..stepping(target, [0.4, 0.1], true) });
        assert_eq!(broken_of(&of_both), 2, "of both servos as of the device");
        // Beside a servo that is doomed the other dies as well, by nobody's hand.
        let doomed = |ticks: u64| Fault { may_cost_ticks: Some(ticks), ..stepping("haptic:0", [0.2, 0.1], false) };
        let of_others = |ticks: u64| broken_of(&[doomed(ticks), stepping("tissue:0", [0.2, 0.1], true)]);
        assert_eq!([of_others(0), of_others(1_500)], [1, 0], "the force fades by design where nobody is left");
    }

    /// Whoever killed one by hand and then the other was told of a step of the force that its fading makes by design.
    #[test]
    fn two_servos_that_were_killed_one_after_the_other_may_let_the_force_step_as_both_at_once() {
        let at = |tick: u64, target: &str, step_n: f64| Fault { tick, ..stepping(target, [step_n, 0.1], true) };
        let of = |tick: u64, target: &str, step_n: f64| broken_of(&[at(9_000, "haptic:0", step_n), at(tick, target, step_n)]);
        assert_eq!(broken_of(&[at(9_000, "haptic:0", 0.24)]), 1, "alone");
        assert_eq!([of(9_050, "haptic:1", 0.24), of(9_050, "haptic:1", 0.26)], [0, 2], "as of the device");
        assert_eq!(of(9_300, "haptic:1", 0.24), 2, "the other one was back");
        assert_eq!(of(9_050, "haptic:0", 0.24), 2, "the other one was there all the time");
        let both = [at(9_000, "haptic:0", 0.24), at(9_050, "haptic:1", 0.24)];
        let beside = |servos: &[Fault]| broken_of(&[servos, &[at(9_000, "tissue:0", 0.24)]].concat());
        assert_eq!([beside(&both), beside(&both[..1])], [0, 2], "what is felt of both is no third one's");
    }

    /// By hand in `arms`: of five that all lost more at least 0.094 do.
    #[test]
    fn what_one_fault_does_not_show_many_do() {
        let of = |count: usize| broken_of(&vec![fault("tissue:0", 2); count]);
        assert_eq!([4, 5].map(of), [0, 1]);
        assert_eq!(broken(&json!({ "invalid_applied": 1, "stale_applied": 0 })), ["1 invalid forces were applied"]);
    }
}
