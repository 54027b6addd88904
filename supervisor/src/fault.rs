//! One fault: what is known of it, and its verdict.
//!
//! The window of a fault runs from its injection to the recovery (a successor is warm or live) and 20 ms beyond, at least 200 ms. The
//! promise is judged as in the design: no more misses than in the control ([`compare`]), nothing wrong or stale applied, no force step larger than a fault-free
//! tick in the same state, contact or none, makes + 0.05 N, and somebody back in the place of whoever is gone. For the device itself: at most 20 misses, and no
//! step larger than the hardware's watchdog or the last hop's gate makes + 0.05 N; for one that was asked for with what it may cost, as many misses. A tick or
//! two that one fault lost more than its control may be noise of the machine: what one fault alone breaks beyond doubt, [`Fault::gap`] and the report of a run
//! say (`report::promises`).

pub mod compare;
pub mod finder;

use crate::corrupt::{Flip, Remains};
use crate::faultfile::{FaultKind, Helper, Output};
use crate::ledger::{Ledger, SETTLING_TICKS, Tick, Window};
use crate::shortage::Lowered;
use compare::{excess, tells};
use hyst_messages::{Role, TICK_NS};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Shortest window, ticks.
pub const WINDOW_TICKS: u64 = 200;
/// Ticks after the recovery that still belong to the window.
pub const AFTER_TICKS: u64 = 20;
/// Force step that is allowed beyond what fault-free ticks make, N.
pub const STEP_MARGIN_N: f64 = 0.05;
/// Misses that the death of the device itself may cost: 20 ms.
pub const DEVICE_TICKS: u64 = 20;
/// Ticks that any fault may cost once beyond what it is promised to: what the hardware holds and ramps a force for. More is no noise of the machine, unless its
/// controls show as much.
const MOST_LOST: u64 = 20;
/// Largest step that the device's own death makes by design, N: the hardware's watchdog takes 3.3 N away in 20 ticks, and of the force that
/// returns up to 0.2 N come at once, the rest by a rise (`HardwareParams`, `LastHopParams` of the coupling).
const DEVICE_STEP_N: f64 = 0.2;
/// What a servo publishes by these kinds is never applied. A stamp that stands still, or an old output, is as it should be the first time; every later time
/// the ledger itself finds it late or stale.
const NEVER_APPLIED: [FaultKind; 4] = [FaultKind::Nan, FaultKind::Inf, FaultKind::Range, FaultKind::Ahead];
/// A servo's output that stands still bears the stamps of its ticks, and is fresh to the ledger. Its force tells: in contact no two ticks make the same one.
const STANDS_STILL: FaultKind = FaultKind::Frozen;
/// Ticks before such a fault in which no force may have repeated: a hand that does not move makes one that stands still by itself.
const MOVING_TICKS: u64 = 100;
/// Ticks after its injection for which a servo may still make the force that it had begun.
const BEGUN_TICKS: u64 = 2;
/// Fault-free ticks that a force step is compared with.
const QUIET_TICKS: u64 = 10_000;

/// The kind of a fault that nobody asked for: its victim died or hung by itself.
pub const EXTERNAL: &str = "external";

/// When a death was seen.
#[derive(Clone, Copy, Debug)]
pub struct Death {
    /// The end of the process, ns.
    pub at_ns: u64,
    /// Its latch open, ns, if that was before.
    pub open_ns: Option<u64>,
    /// Its last heartbeat, ns.
    pub beat_ns: u64,
}

/// One fault.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// The name of a [`FaultKind`], or [`EXTERNAL`].
    pub kind: String,
    /// The slot that it hit.
    pub target: String,
    /// It hit the one that did the role's work.
    pub active: bool,
    /// Station tick of the injection; for one from outside, of the last heartbeat.
    pub tick: u64,
    /// CLOCK_MONOTONIC of the same, ns.
    pub injected_ns: u64,
    /// The process died, hung, was continued, or did wrong as it was asked to; of what is done to it from outside, bytes that were flipped and files that
    /// it cannot open any more: that it was done, whoever noticed. Of a file system that is filled: that it was full.
    pub manifested: bool,
    /// A word of [`finder`], the thread that stood still (`usher` …), or the process that refused its output, missed its answer or did its work, says that its
    /// disk is full or that it cannot open a newcomer, or died of a full /dev/shm; `guardian` of the supervisor's end; `supervisor` of the guardian's, where it
    /// mended what had flipped, and where it could start nobody for want of a file.
    pub detected_by: String,
    /// From the injection to the word in the station page, µs.
    pub detected_us: Option<f64>,
    /// From the injection to the end of the last tick that missed its force because of it, µs; 0 if the device never noticed.
    pub contained_us: Option<f64>,
    /// From the injection to a successor that is warm or live, or to the end of what it was asked to do, µs.
    pub recovered_us: Option<f64>,
    /// See the module's text; `None` if it could not be judged, as where the run ended before it was over.
    pub promise_held: Option<bool>,
    /// Ticks that it may cost the hand beyond its control by what was said when it was asked for; without that by what it is ([`Fault::allowed_misses`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub may_cost_ticks: Option<u64>,
    /// It was not over within the time that it had for that.
    #[serde(default)]
    pub overdue: bool,
    /// How the process ended.
    pub exit: String,
    /// It was a lie by this output alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<Output>,
    /// It was done to this thread alone, which helps the engine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thread: Option<Helper>,
    /// The fault's window.
    pub window: Option<Window>,
    /// Its control.
    pub control: Option<Window>,
    /// The ticks around its largest force step, where that broke the promise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step: Vec<Tick>,
    /// The ticks that missed their force, where they broke the promise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late: Vec<Tick>,
    /// Ticks from the injection to the recovery in which the hand was given a fresh force of this servo; of a servo alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub given: Option<u64>,
    /// It hit the incumbent and its spare at the same instant.
    pub together: bool,
    /// The control serves another fault too, because no other was free.
    pub control_shared: bool,
    /// The control began in contact and the fault's window did not, or the other way round, because none in the same state was free.
    #[serde(default)]
    pub control_unlike: bool,
    /// The control lies in the station's first seconds, because none later was free: it tells of the start, and of no fault.
    #[serde(default)]
    pub control_early: bool,
    /// The ticks right after its window, in which no control lies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aftermath: Option<Window>,
    /// `corrupt`: what became of the bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remains: Option<Remains>,
    /// Those bytes, until it is closed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) flips: Vec<Flip>,
    /// Its window, from its end to its verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) seen: Option<Seen>,
    pub(crate) slot: usize,
    pub(crate) incarnation: u32,
    pub(crate) dead: bool,
    pub(crate) continue_ns: Option<u64>,
    /// It was asked to do wrong: until when, ns (0: for ever), and how often it had done wrong before.
    pub(crate) asked: Option<(u64, u64)>,
    /// A limit of it that was lowered.
    pub(crate) lowered: Option<Lowered>,
    /// The file that fills a file system, and until when, ns.
    pub(crate) ballast: Option<(PathBuf, u64)>,
    /// It has been full.
    #[serde(default)]
    pub(crate) was_full: bool,
    /// So many of its successors are still to be hindered in their start.
    pub(crate) starts_left: Option<u32>,
}

impl Fault {
    /// Whether it is of this kind.
    pub fn is(&self, kind: FaultKind) -> bool {
        self.kind == kind.name()
    }

    /// Somebody has found it out at a time, ns.
    pub(crate) fn found_by(&mut self, by: &str, at_ns: u64) {
        (self.detected_by, self.detected_us) = (by.into(), Some(us(at_ns, self.injected_ns)));
    }

    /// It is over since a time, ns.
    pub(crate) fn over_at(&mut self, at_ns: u64) {
        self.recovered_us = Some(us(at_ns, self.injected_ns));
    }

    /// Whether it hit a servo.
    pub(crate) fn is_of_servo(&self) -> bool {
        Role::name_in(&self.target) == Role::Haptic.name()
    }

    /// Both servos at once: nobody is left who computes a force, and it fades.
    fn is_of_both_servos(&self) -> bool {
        self.together && self.is_of_servo()
    }

    /// Ticks that it may cost the hand beyond its control; `None` where nothing bounds them.
    pub fn allowed_misses(&self) -> Option<u64> {
        match () {
            () if self.is_of_both_servos() => None,
            () if self.may_cost_ticks.is_some() => self.may_cost_ticks,
            () if self.target == Role::Device.name() => Some(DEVICE_TICKS),
            () => Some(0),
        }
    }

    /// Ticks that the hand lost in its window and right after it, if they are a broken promise by themselves: more beyond its control's than the hardware
    /// bridges and it may cost, and than a window without a fault has lost at most.
    pub fn gap(&self, allowed_misses: u64, most_missed: u64) -> Option<u64> {
        let missed = |window: Option<Window>| window.map_or(0, |window| window.missed);
        let lost = missed(self.window).saturating_add(missed(self.aftermath));
        let most = most_missed.max(MOST_LOST.saturating_add(allowed_misses));
        (lost.saturating_sub(missed(self.control)) > most).then_some(lost)
    }

    /// Whether its victim is gone, or was found hanging, and nobody was back in time. One that goes on doing what it was asked to is there.
    pub fn is_not_back(&self) -> bool {
        self.overdue && (self.dead || self.detected_us.is_some() && self.asked.is_none())
    }

    /// Whether it may leave nobody who makes a force: without a servo the device fades it, as the hardware does without a device.
    pub fn may_let_the_force_fade(&self) -> bool {
        self.target == Role::Device.name() || self.is_of_servo() && self.may_be_felt()
    }

    /// Largest step of the force that is allowed, N, where fault-free ticks make `quiet_n`.
    pub fn most_step_n(&self, quiet_n: f64) -> f64 {
        most_step_n(quiet_n, self.may_let_the_force_fade())
    }

    /// The station tick at which a servo that was hit had recovered; `None` of any other process.
    fn servo_until(&self) -> Option<u64> {
        self.recovered_us.filter(|_| self.is_of_servo()).map(|us| self.tick + whole_ticks(us))
    }

    /// Ticks at which the hand was given what this servo made while it did wrong. The last hop lets nothing through that is not finite or too large, so the
    /// force itself would not show that nobody had checked it; the hardware's ledger says whose it was.
    fn wrong_ticks(&self, ledger: &Ledger) -> u64 {
        // One that lies in its stream alone, which nobody applies, gives the hand what it should.
        let Some(to_tick) = self.servo_until().filter(|_| self.output != Some(Output::Force)) else { return 0 };
        if self.is(STANDS_STILL) {
            let stood = ledger.repeated(self.incarnation, self.tick.saturating_sub(MOVING_TICKS), self.tick);
            return if stood == 0 { ledger.repeated(self.incarnation, self.tick, to_tick) } else { 0 };
        }
        if !NEVER_APPLIED.iter().any(|kind| self.is(*kind)) {
            return 0;
        }
        // By the stamp of the force: a stall of the machine may let the servo read its orders later, and what it makes until then is as it should be.
        let is_wrong = |tick: &&Tick| tick.force_tick >= self.tick + BEGUN_TICKS;
        ledger.fresh_of(self.incarnation, self.tick, to_tick).filter(is_wrong).count() as u64
    }

    /// Whether the process was found by its death, and not ended because it hung.
    pub fn is_found_dead(&self) -> bool {
        self.dead && [finder::LATCH, finder::PIDFD].contains(&self.detected_by.as_str())
    }

    /// Whether the hand may feel it, so that it has an account of its own: that of the device, of both servos at once, and one that was asked for as such.
    pub fn may_be_felt(&self) -> bool {
        let may_cost_some = self.may_cost_ticks.is_some_and(|ticks| ticks > 0);
        may_cost_some || self.target == Role::Device.name() || self.is_of_both_servos()
    }
}

/// Largest step of the force that is allowed, N, where fault-free ticks make `quiet_n`, and by one that `may_fade` the force what that makes by design.
pub(crate) fn most_step_n(quiet_n: f64, may_fade: bool) -> f64 {
    let by_design_n = if may_fade { DEVICE_STEP_N } else { 0.0 };
    quiet_n.max(by_design_n) + STEP_MARGIN_N
}

fn us(at_ns: u64, since_ns: u64) -> f64 {
    at_ns.saturating_sub(since_ns) as f64 * 1e-3
}

/// Ticks that have passed within so many microseconds.
fn whole_ticks(us: f64) -> u64 {
    (us * 1e3) as u64 / TICK_NS
}

/// The window of a fault, as station ticks.
pub(crate) fn bounds(fault: &Fault) -> (u64, u64) {
    let recovery_ticks = fault.recovered_us.map_or(0, |us| whole_ticks(us) + 1);
    (fault.tick, fault.tick + (recovery_ticks + AFTER_TICKS).max(WINDOW_TICKS))
}

/// The station ticks in which a fault may do something to the hand, so that they are no control of another: its window; of one that is not over yet all up to the
/// newest.
pub(crate) fn reach(fault: &Fault, newest_tick: u64) -> (u64, u64) {
    let (from_tick, to_tick) = bounds(fault);
    let so_far = if fault.recovered_us.is_none() { newest_tick.saturating_add(1) } else { 0 };
    (from_tick, to_tick.max(so_far))
}

/// What the ledger says of a fault's own window. It is taken as soon as the window is over: a control of equal length may lie after it, and by the end of
/// that one the ledger has forgotten the beginning of a long window.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Seen {
    window: Window,
    contained_us: f64,
    /// Largest force step of the fault-free ticks before it in the open, and in contact, N.
    #[serde(default)]
    quiet_steps_n: [f64; 2],
    #[serde(default)]
    given: Option<u64>,
    /// The ticks around its own largest force step in the open, and in contact.
    #[serde(default)]
    steps: [Vec<Tick>; 2],
    late: Vec<Tick>,
}

impl Seen {
    /// Whether the hand was in contact at its beginning.
    pub(crate) fn contact(&self) -> bool {
        self.window.contact == Some(true)
    }
}

/// Looks at the window of a fault; `None` without a ledger.
pub(crate) fn look(fault: &Fault, ledger: &Ledger, taken: &[(u64, u64)]) -> Option<Seen> {
    let (from_tick, to_tick) = bounds(fault);
    let mut window = ledger.window(from_tick, to_tick);
    window.wrong += fault.wrong_ticks(ledger);
    let contained_ticks = ledger.last_miss(from_tick, to_tick).map_or(0, |tick| tick + 1 - from_tick);
    (window.ticks + window.voided > 0).then(|| Seen {
        window,
        contained_us: (contained_ticks * TICK_NS) as f64 * 1e-3,
        quiet_steps_n: quiet_steps_n(ledger, from_tick, taken),
        given: fault.servo_until().map(|until| ledger.fresh_of(fault.incarnation, fault.tick, until).count() as u64),
        steps: [false, true].map(|in_contact| ledger.around_step(&window, in_contact)),
        late: ledger.late(&window),
    })
}

/// Judges a fault by its window and its control. Where one of them has gaps nothing is said; where the host stalled for long, nothing good.
pub(crate) fn judge(fault: &mut Fault, seen: Seen, control: Option<Window>) {
    let window = seen.window;
    (fault.contained_us, fault.given) = (Some(seen.contained_us), seen.given);
    fault.control_unlike = control.and_then(|control| control.contact).is_some_and(|contact| contact != seen.contact());
    if let Some(control) = control.filter(|control| window.is_whole() && control.is_whole()) {
        let (steps_n, control_steps_n) = (window.steps_n(seen.contact()), control.steps_n(control.contact == Some(true)));
        let over_n = |at: usize| {
            let quiet_n = seen.quiet_steps_n[at].max(control_steps_n[at].unwrap_or(0.0));
            Some(steps_n[at]? - fault.most_step_n(quiet_n)).filter(|over_n| *over_n > 0.0)
        };
        // Of both the one that is farther beyond what it may be.
        let jerk = (0..2usize).filter_map(|at| Some((at, over_n(at)?))).max_by(|one, other| one.1.total_cmp(&other.1));
        let jerk = jerk.map(|(at, _)| at);
        fault.step = jerk.and_then(|at| seen.steps.into_iter().nth(at)).unwrap_or_default();
        let most = fault.allowed_misses().and_then(|misses| i64::try_from(misses).ok()).unwrap_or(i64::MAX);
        let (compares, is_spared) = (tells(&window) && tells(&control), excess(&window, &control) <= most);
        fault.late = if is_spared || !compares { Vec::new() } else { seen.late };
        let has_harm = jerk.is_some() || window.wrong > 0;
        // Of one that was not over when the run ended nobody knows what it would have cost.
        let is_open = fault.recovered_us.is_none() && is_spared;
        fault.promise_held = if has_harm { Some(false) } else { compares.then_some(is_spared).filter(|_| !is_open) };
    }
    (fault.window, fault.control) = (Some(window), control);
}

/// Largest force step of the fault-free windows before a fault in the open, and in contact, N: what is made at the wall excuses no kick in the open.
fn quiet_steps_n(ledger: &Ledger, before_tick: u64, taken: &[(u64, u64)]) -> [f64; 2] {
    let mut quiet_n = [0.0f64; 2];
    let Some(settled) = ledger.since_start(SETTLING_TICKS) else {
        return quiet_n;
    };
    let mut tick = before_tick.saturating_sub(QUIET_TICKS).max(settled);
    while tick < before_tick {
        let next = (tick + WINDOW_TICKS).min(before_tick);
        if taken.iter().all(|(from, to)| next <= *from || tick >= *to) {
            let window = ledger.window(tick, next);
            let steps_n = window.steps_n(window.contact == Some(true)).map(|step_n| step_n.unwrap_or(0.0));
            quiet_n = [quiet_n[0].max(steps_n[0]), quiet_n[1].max(steps_n[1])];
        }
        tick = next;
    }
    quiet_n
}

#[cfg(test)]
mod tests;
