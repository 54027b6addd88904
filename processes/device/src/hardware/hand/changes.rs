//! What a scripted hand still has to set at the pump and the valves: each at its time, or so long after the pump has said what it waits for. Its hand knows
//! no more than who stands before a pump: alarms, deficit, blood, and the pressure that is shown, which is the mean over a second.

use hyst_messages::{FluidStatus, PUMP_ALARMS, Shown};
use hyst_scene::{Alarm, PumpChange, Signal};
use std::collections::VecDeque;

/// What is still to be set.
pub(super) struct Changes {
    /// What waits for nothing, in the order of its time.
    timed: VecDeque<PumpChange>,
    /// What waits, in the script's order.
    awaited: Vec<Awaited>,
    /// The pressure as it is shown: of what the script waits for, the roller's beat is none.
    shown: Shown,
}

struct Awaited {
    change: PumpChange,
    signal: Signal,
    /// Since when what it waits for has come, s.
    since_s: Option<f64>,
}

impl Changes {
    /// All of a script.
    pub(super) fn of(script: &[PumpChange]) -> Changes {
        let awaited = |change: &PumpChange| Some(Awaited { change: *change, signal: change.after?, since_s: None });
        Changes {
            timed: script.iter().filter(|change| change.after.is_none()).copied().collect(),
            awaited: script.iter().filter_map(awaited).collect(),
            shown: Shown::default(),
        }
    }

    /// Whether something of it waits.
    pub(super) fn is_waiting(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// Takes what the pump says at a time.
    pub(super) fn see(&mut self, time_s: f64, status: &FluidStatus) {
        let status = self.shown.show(status);
        for awaited in &mut self.awaited {
            if awaited.since_s.is_none() && has_come(&awaited.signal, &status) {
                awaited.since_s = Some(time_s);
            }
        }
    }

    /// The next that is to be set by now; each is given once.
    pub(super) fn due(&mut self, time_s: f64) -> Option<PumpChange> {
        if let Some(change) = self.timed.pop_front_if(|change| change.at_s <= time_s) {
            return Some(change);
        }
        let is_due = |awaited: &Awaited| awaited.since_s.is_some_and(|since_s| since_s + awaited.change.at_s <= time_s);
        let index = self.awaited.iter().position(is_due)?;
        Some(self.awaited.remove(index).change)
    }
}

/// Whether a status says what is waited for; what is no number says nothing.
fn has_come(signal: &Signal, status: &FluidStatus) -> bool {
    let is_above = |limit: Option<f64>, value: f64| limit.is_some_and(|limit| value > limit);
    let pressure_pa = f64::from(status.pressure_pa);
    signal.alarm.is_some_and(|alarm| status.alarms & bit(alarm) != 0)
        || is_above(signal.deficit_above_ml, status.deficit_ml)
        || is_above(signal.bled_above_ml, status.bled_ml)
        || is_above(signal.pressure_above_pa, pressure_pa)
        || signal.pressure_below_pa.is_some_and(|limit_pa| pressure_pa < limit_pa)
}

/// The pump's bit of an alarm.
fn bit(alarm: Alarm) -> u32 {
    PUMP_ALARMS.iter().find(|(_, name)| *name == alarm.name()).map_or(0, |(bit, _)| *bit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(at_s: f64, after: Option<Signal>) -> PumpChange {
        PumpChange { at_s, after, ..PumpChange::default() }
    }

    /// Times of the script's changes that are due by then.
    fn due(changes: &mut Changes, time_s: f64) -> Vec<f64> {
        std::iter::from_fn(|| changes.due(time_s)).map(|change| change.at_s).collect()
    }

    #[test]
    fn what_waits_is_due_so_long_after_its_signal_came_first_and_only_once() {
        let alarm = Signal { alarm: Some(Alarm::AbnormalLoss), ..Signal::default() };
        let mut changes = Changes::of(&[change(0.25, Some(alarm)), change(1.0, None), change(2.0, None)]);
        let status = |alarms: u32| FluidStatus { alarms, ..FluidStatus::default() };
        changes.see(0.5, &status(1 | 2 | 8 | 16));
        assert_eq!((due(&mut changes, 1.5), changes.is_waiting()), (vec![1.0], true), "none of these alarms is meant");
        changes.see(1.5, &status(4));
        assert_eq!(due(&mut changes, 1.5), Vec::<f64>::new());
        changes.see(1.75, &status(0)); // it has come and gone
        assert_eq!((due(&mut changes, 1.75), changes.is_waiting()), (vec![0.25], false));
        changes.see(2.0, &status(4));
        assert_eq!(due(&mut changes, 9.0), vec![2.0]);
    }

    /// A beat of 1.3 mmHg every 2.2 s, seen each 25 ms: a third of it, 0.43 mmHg, is in the mean.
    #[test]
    fn the_rollers_beat_is_nothing_that_is_waited_for() {
        let above = Signal { pressure_above_pa: Some(100.0 * 133.322), ..Signal::default() };
        let mut changes = Changes::of(&[change(0.0, Some(above))]);
        let beats = |changes: &mut Changes, from: u64, mean_mmhg: f64| {
            for state_tick in (from..from + 10_000).step_by(25) {
                let beat_mmhg = 1.3 * (std::f64::consts::TAU * state_tick as f64 / 2_200.0).sin();
                let pressure_pa = (133.322 * (mean_mmhg + beat_mmhg)) as f32;
                changes.see(state_tick as f64 * 1e-3, &FluidStatus { state_tick, pressure_pa, ..FluidStatus::default() });
            }
            due(changes, 1e3)
        };
        assert_eq!(beats(&mut changes, 1_000, 99.3), Vec::<f64>::new(), "the peaks are at 100.6");
        assert_eq!(beats(&mut changes, 11_000, 100.3), vec![0.0]);
    }

    #[test]
    fn each_figure_of_the_pump_is_waited_for_and_none_that_is_no_number() {
        let none = Signal::default();
        let signals = [
            Signal { deficit_above_ml: Some(100.0), ..none },
            Signal { bled_above_ml: Some(10.0), ..none },
            Signal { pressure_above_pa: Some(13_000.0), ..none },
            Signal { pressure_below_pa: Some(4_000.0), ..none },
        ];
        let told = |deficit_ml: f64, bled_ml: f64, pressure_pa: f32| {
            let status = FluidStatus { deficit_ml, bled_ml, pressure_pa, ..FluidStatus::default() };
            signals.each_ref().map(|signal| has_come(signal, &status))
        };
        assert_eq!(told(100.0, 10.0, 13_000.0), [false; 4]);
        assert_eq!(told(100.1, 10.1, 13_001.0), [true, true, true, false]);
        assert_eq!(told(0.0, 0.0, 3_999.0), [false, false, false, true]);
        assert_eq!(told(f64::NAN, f64::NAN, f32::NAN), [false; 4]);
        assert!(!has_come(&none, &FluidStatus { alarms: 31, ..FluidStatus::default() }));
    }
}
