//! What one fault adds to the figures of its cell and its pool.

use super::blame::{Blame, end_of};
use super::figures::{Figures, Known, touches};
use super::notice::{Unfound, unfound};
use crate::campaign::cell::{Cell, May, State};
use crate::campaign::outcome::{Ending, Outcome};
use crate::fault::compare::{excess, tells};
use crate::fault::{Fault, most_step_n};
use crate::ledger::Window;
use hyst_messages::record::SHADOW_TICKS;
use hyst_messages::{Role, TICK_NS};

/// What one fault says of the misses.
pub(super) enum Taken {
    /// Nothing: it did not show, or could not be judged.
    NoVerdict,
    /// The host stalled for so long that only all ticks together, the void ones too, can be compared; its excess with them.
    Stalled(i64),
    /// It was done, and nobody noticed; what it cost the hand beyond its control and what it may cost, if that is known.
    Unnoticed(Option<i64>),
    /// Its misses, in two ways.
    Excess {
        /// Beyond its control's.
        lost: i64,
        /// Beyond that and what it may cost, without and with void ticks.
        beyond: [i64; 2],
        /// Whether the control began in the same state.
        is_alike: bool,
    },
}

impl Figures {
    /// Adds what a fault brought about beside what it was to do; where its cell does not allow that, it speaks against the cell.
    pub(super) fn take_sequel(&mut self, cell: &Cell, outcome: &Outcome, blame: &Blame) {
        let index = outcome.index;
        let sequel = blame.sequel(outcome);
        if !sequel.began_anew() {
            self.reasons.extend(sequel.broken().map(|broken| format!("fault {index}: {broken}")));
        }
        let mut saw = |what: &'static str, may: May, reason: String| {
            *self.seen.entry(what).or_default() += 1;
            if !cell.may.contains(&may) {
                self.reasons.push(format!("fault {index}: {reason}"));
            }
        };
        for other in sequel.others() {
            saw("others died", May::OthersDie, format!("{} too", end_of(other)));
        }
        if sequel.began_anew() {
            saw("began anew", May::BeginAnew, sequel.broken().unwrap_or_else(|| "a state began anew".into()));
        }
        if let Some(end) = blame.ended(index) {
            saw("station ended", May::StationEnds, end.into());
        }
        let lost = blame.lost_ticks(index);
        self.data_lost_ticks = self.data_lost_ticks.saturating_add(lost);
        if lost > 0 {
            self.reasons.push(format!("fault {index}: the recording lost {lost} ticks"));
        }
        self.leftovers += blame.leftovers(index);
        self.collateral.extend(sequel.others().map(|other| format!("fault {index}: {} at tick {}", end_of(other), other.tick)));
    }

    /// Adds a fault that was not done.
    pub(super) fn take_undone(&mut self, outcome: &Outcome) {
        self.not_shown.push(outcome.index);
        match outcome.ending {
            Ending::NoState => *self.seen.entry("no state").or_default() += 1,
            Ending::Skipped => *self.seen.entry("skipped").or_default() += 1,
            Ending::Closed | Ending::Open | Ending::Refused => {}
        }
    }

    /// Adds a fault that was injected and that nobody closed: the station came to its end over it, or it has no end.
    pub(super) fn take_open(&mut self, cell: &Cell, known: &Known, outcome: &Outcome) -> Taken {
        let has_ended = known.blame.ended(outcome.index).is_some();
        let sequel = known.blame.sequel(outcome);
        let fault = outcome.fault.clone().unwrap_or_default();
        let is_from_outside = cell.injection.kind.is_done_from_outside();
        let was_noticed = !is_from_outside || self.take_notice(cell, &fault, outcome.index, sequel, has_ended);
        self.injected += 1;
        self.manifested += usize::from(has_ended);
        self.take_wrong(outcome);
        if has_ended {
            self.take_last_step(known, outcome);
        } else {
            self.reasons.push(format!("fault {}: {}", outcome.index, outcome.reason)); // else said by its sequel
        }
        if was_noticed { Taken::NoVerdict } else { Taken::Unnoticed(None) }
    }

    /// Adds the last forces of a station that ended, by its recording: without a device the hardware takes the force away, as after the device's own death.
    fn take_last_step(&mut self, known: &Known, outcome: &Outcome) {
        let Some(step_n) = known.blame.last_step_n(outcome.index) else {
            *self.seen.entry("ended, last forces not recorded").or_default() += 1;
            return;
        };
        self.step_max_n[0] = self.step_max_n[0].max(step_n);
        let quiet_n = known.steps_n[usize::from(touches(None, outcome))];
        if step_n > (Fault { target: Role::Device.name().into(), ..Fault::default() }).most_step_n(quiet_n) {
            self.reasons.push(format!(
                "fault {}: a force step of {step_n:.3} N before the station's end, {quiet_n:.3} N without a fault",
                outcome.index
            ));
        }
    }

    /// Adds a fault.
    pub(super) fn take(&mut self, fault: &Fault, cell: &Cell, known: &Known, outcome: &Outcome) -> Taken {
        let ms = |us: Option<f64>| us.map(|us| us * 1e-3);
        let (index, has_ended) = (outcome.index, known.blame.ended(outcome.index).is_some());
        let is_astray = cell.injection.target.ends_with(":active") && !fault.active;
        let is_from_outside = cell.injection.kind.is_done_from_outside();
        let was_noticed = !is_from_outside || self.take_notice(cell, fault, index, known.blame.sequel(outcome), has_ended);
        let unfound = unfound(cell, fault, outcome).filter(|_| !is_astray);
        let met_no_cut = cell.state == State::Cutting && outcome.after.cuts <= outcome.before.cuts;
        let shows = fault.manifested && unfound != Some(Unfound::True) && !met_no_cut;
        self.injected += 1;
        self.manifested += usize::from(shows && was_noticed);
        if !shows {
            self.not_shown.push(index);
        }
        if met_no_cut {
            *self.seen.entry("no cut").or_default() += 1;
        }
        if unfound == Some(Unfound::Lie) {
            self.unfound.push(index);
            let given = fault.given.map_or(String::new(), |ticks| format!("; the hand was given its force in {ticks} ticks"));
            self.reasons.push(format!("fault {index}: nobody found that {} lied{given}", fault.target));
        }
        if !fault.detected_by.is_empty() {
            *self.detected_by.entry(fault.detected_by.clone()).or_default() += 1;
        }
        self.detected_ms.extend(ms(fault.detected_us));
        self.take_hang(fault);
        self.contained_ms.extend(ms(fault.contained_us));
        self.recovered_ms.extend(ms(fault.recovered_us));
        self.promise_held += usize::from(fault.promise_held == Some(true));
        if fault.manifested && fault.recovered_us.is_none() && !has_ended {
            self.reasons.push(format!("fault {index}: {} did not recover", fault.target));
        }
        self.take_swap(cell, fault, outcome);
        self.take_wrong(outcome);
        if !has_ended {
            self.take_gap(fault, outcome, cell, known);
        }
        let has_no_first = outcome.with.as_ref().is_some_and(|with| !with.manifested);
        if has_no_first {
            self.first_not_shown.push(index);
        }
        let is_beside = is_beside(cell, outcome, fault);
        if is_beside {
            self.beside.push(index);
        }
        let Some((window, control)) = fault.window.zip(fault.control) else { return Taken::NoVerdict };
        self.take_windows(fault, outcome, window, control, known);
        let is_other = !shows || is_astray || has_no_first || is_beside || fault.control_early;
        self.astray += usize::from(is_astray);
        match compared(&window, &control, cell.allowed_misses) {
            _ if is_other => Taken::NoVerdict,
            Taken::NoVerdict => Taken::NoVerdict,
            Taken::Excess { beyond, .. } if !was_noticed => Taken::Unnoticed(Some(beyond[0])),
            _ if !was_noticed => Taken::Unnoticed(None),
            Taken::Excess { lost, beyond, .. } => Taken::Excess { lost, beyond, is_alike: !fault.control_unlike },
            stalled => stalled,
        }
    }

    /// One fault counts once in the bound, however many ticks it costs. What costs more than the device's own death may, and more than the control windows lost,
    /// in its window and right after it, is a broken promise by itself.
    fn take_gap(&mut self, fault: &Fault, outcome: &Outcome, cell: &Cell, known: &Known) {
        if let Some(lost) = fault.gap(cell.allowed_misses, known.most_missed) {
            let text = format!("the hand lost {lost} ticks, {} at most without a fault", known.most_missed);
            self.take_harm(outcome.index, &text, known.blame.is_blind(outcome.index));
        }
    }

    /// Adds what a fault did to the hand, which speaks against its cell, unless it `may_be_the_hosts` doing.
    fn take_harm(&mut self, index: usize, text: &str, may_be_the_hosts: bool) {
        match may_be_the_hosts {
            true => self.unsure.push(format!("fault {index}: {text}; no canary ran, so that it may be the host's doing")),
            false => self.reasons.push(format!("fault {index}: {text}")),
        }
    }

    /// Adds how the swap beside it ended. Who was hurt before his probation was over must not get the role for good.
    fn take_swap(&mut self, cell: &Cell, fault: &Fault, outcome: &Outcome) {
        let Some((swap, was_done)) = outcome.swap.as_ref().and_then(|swap| Some((swap, swap.promoted?))) else { return };
        *self.seen.entry(if was_done { "swap done" } else { "swap undone" }).or_default() += 1;
        if was_done && cell.is_of_newcomer() && fault.manifested && swap.was_on_trial() && swap.is_at(fault.injected_ns) {
            self.reasons
                .push(format!("fault {}: {} was hurt on trial, and the swap was done all the same", outcome.index, fault.target));
        }
    }

    /// Adds the forces that the hand must not be given, whether there is a control or not.
    fn take_wrong(&mut self, outcome: &Outcome) {
        let wrong = [&outcome.fault, &outcome.with]
            .into_iter()
            .flatten()
            .filter_map(|fault| fault.window)
            .map(|window| window.wrong)
            .max()
            .unwrap_or(0);
        self.wrong += wrong;
        if wrong > 0 {
            let text = "forces that were not finite, too large, old, or made by a servo that lied";
            self.reasons.push(format!("fault {}: the hand was given {wrong} {text}", outcome.index));
        }
    }

    /// Adds the ticks of a window and its control.
    pub(super) fn take_ticks(&mut self, window: &Window, control: &Window) {
        for (sums, window) in [(&mut self.window_ticks, window), (&mut self.control_ticks, control)] {
            sums[0] += window.ticks;
            sums[1] += window.voided;
        }
        self.missed[0] += window.missed;
        self.missed[1] += control.missed;
    }

    /// Adds what its window and its control hold.
    fn take_windows(&mut self, fault: &Fault, outcome: &Outcome, window: Window, control: Window, known: &Known) {
        self.take_ticks(&window, &control);
        self.step_max_n = [self.step_max_n[0].max(window.force_step_max_n), self.step_max_n[1].max(control.force_step_max_n)];
        if fault.control_unlike {
            *self.seen.entry("control in another state").or_default() += 1;
        }
        if fault.control_early {
            *self.seen.entry("control in the first seconds").or_default() += 1;
        }
        let after = fault.aftermath.unwrap_or_default();
        self.aftermath = [self.aftermath[0] + after.ticks, self.aftermath[1] + after.missed];
        // Whatever the supervisor said of it: that knows the last ten seconds, and this all that was ever made in this state.
        let made_n = window.steps_n(touches(Some(&window), outcome)).into_iter().zip(known.steps_n);
        for ((made_n, quiet_n), state) in made_n.zip(["in the open", "in contact"]) {
            if let Some(made_n) = made_n.filter(|made_n| *made_n > fault.most_step_n(quiet_n)) {
                // A host that stands still leaves nobody who makes a force, as the device's death does.
                let may_be_the_hosts = known.blame.is_blind(outcome.index) && made_n <= most_step_n(quiet_n, true);
                let text = format!("a force step of {made_n:.3} N, {quiet_n:.3} N without a fault {state}");
                self.take_harm(outcome.index, &text, may_be_the_hosts);
            }
        }
    }
}

/// Whether it was to fall into a recovery, a hand-over or a swap, and came after it. The hand-over of a servo is not over once its successor is warm: the
/// device takes nothing of one in its shadow, and the other servo is alone meanwhile.
fn is_beside(cell: &Cell, outcome: &Outcome, fault: &Fault) -> bool {
    let over_ns = outcome.with.as_ref().and_then(|with| {
        let has_shadow = cell.state == State::Handover && with.dead && Role::name_in(&with.target) == Role::Haptic.name();
        let shadow_ns = if has_shadow { u64::from(SHADOW_TICKS) * TICK_NS } else { 0 };
        Some(with.injected_ns + (with.recovered_us? * 1e3) as u64 + shadow_ns)
    });
    over_ns.is_some_and(|over_ns| fault.injected_ns > over_ns)
        || outcome.swap.as_ref().is_some_and(|swap| !swap.is_at(fault.injected_ns))
}

/// What a window says beside a control in the same state, of something that may cost so many ticks.
pub(super) fn compared(window: &Window, control: &Window, allowed_misses: u64) -> Taken {
    // With the void ticks both are of the same length.
    let excess = [excess(window, control), window.late as i64 - control.late as i64];
    let (lost, beyond) = (excess[0], excess.map(|excess| beyond(excess, allowed_misses as i64)));
    match () {
        () if !(window.is_whole() && control.is_whole()) => Taken::NoVerdict,
        () if !(tells(window) && tells(control)) => Taken::Stalled(beyond[1]),
        () => Taken::Excess { lost, beyond, is_alike: true },
    }
}

/// Misses beyond what a fault may cost; one that may cost some is not credited with those that it spared.
fn beyond(excess: i64, allowed: i64) -> i64 {
    match excess {
        1.. => (excess - allowed).max(0),
        _ if allowed > 0 => 0,
        _ => excess,
    }
}
