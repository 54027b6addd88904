//! Pressure, deficit and flow: from the statuses of the fluid, some twenty a second, each of which holds until the next, but for no longer than a
//! second; and the valves and the light, from the records of the ticks. The pressure is the mean over a second, as a pump shows it and as goals and warnings
//! have it.

use crate::bleeding::Bleeding;
use crate::clarity::Clarity;
use crate::conduct::Peak;
use hyst_messages::{Controls, FLOW_FLAWS, FluidStatus, PA_PER_MMHG, PUMP_ALARMS, PUMP_NOTICES, mean_after};
use hyst_scene::Alarm;
use std::collections::VecDeque;

/// Lower end of the working range, Pa: 35 mmHg, where the usual pressure begins (35 to 70 mmHg, WOM's manual).
pub const LOW_PA: f64 = 35.0 * PA_PER_MMHG;
/// Upper end of the working range, Pa: 100 mmHg, a mean arterial pressure, below which to stay (ACOG Committee Opinion 800).
pub const HIGH_PA: f64 = 100.0 * PA_PER_MMHG;
/// Where the walls part, Pa: a median of 40 mmHg (25 to 50). A case in which nobody may come to that pressure and that has a landmark looked at is refused.
pub const PARTED_PA: f64 = hyst_scene::LOOKS_FROM_PA;
/// A status holds for so long at most, ticks; then nothing is known.
pub(crate) const HOLD_TICKS: u64 = 1_000;
/// Time over which the rate of the deficit is taken, and between two points of it, ticks: shorter ones show the filling of a cavity of 5 ml alone.
const RATE_TICKS: u64 = 10_000;
const RATE_POINT_TICKS: u64 = 1_000;
/// It bleeds enough to see it from this rate on, ml/min: what the case of a bleeding asks to stay below.
pub(crate) const BLEEDS_ML_MIN: f64 = 1.0;
/// Most alarms and notices whose times are kept.
const MOST_TOLD: usize = 200;
/// Valves below this are shut, and light below it is none; 0 to 1.
pub(crate) const SHUT: f32 = 0.05;

/// Medium, valves and light so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Medium {
    newest: Option<FluidStatus>,
    /// The pressure's mean at the newest status, Pa, if that says a pressure; with its tick.
    mean_pa: Option<(u64, f64)>,
    /// Ticks in which the pressure is known.
    pub known_ticks: u64,
    /// Of them below [`LOW_PA`].
    pub low_ticks: u64,
    /// Of them above [`HIGH_PA`].
    pub high_ticks: u64,
    /// Of them at or above [`PARTED_PA`].
    pub parted_ticks: u64,
    /// Of them with any alarm that is no notice.
    pub alarm_ticks: u64,
    /// The highest pressure, in the mean over a second, Pa.
    pub highest: Option<Peak>,
    /// Deficit in the newest status, ml.
    pub deficit_ml: Option<f64>,
    /// Blood that has come into the cavity, in the newest status that says it, ml.
    pub bled_ml: Option<f64>,
    /// Ticks in which it is known how fast it bleeds.
    pub bled_known_ticks: u64,
    /// Of them those in which it does so faster than 1 ml/min.
    pub bleeding_ticks: u64,
    /// How clear the view was through it.
    pub clarity: Clarity,
    /// Steepest rise of the deficit over 10 s or more, ml/min; the tick is its end.
    pub steepest: Option<Peak>,
    /// Medium that flowed in, ml.
    pub inflow_ml: Option<f64>,
    /// How often each of [`PUMP_ALARMS`] came up, notices too.
    pub alarms: [u64; PUMP_ALARMS.len()],
    /// Which of [`PUMP_ALARMS`] came up at which tick, the first two hundred.
    pub told: Vec<(usize, u64)>,
    /// How often each of [`FLOW_FLAWS`] did.
    pub flaws: [u64; FLOW_FLAWS.len()],
    /// Ticks whose valves are known.
    pub valve_ticks: u64,
    /// Of them with the outflow shut.
    pub shut_ticks: u64,
    /// Of them without light.
    pub dark_ticks: u64,
    points: VecDeque<(u64, f64)>,
    bled: Bleeding,
    /// Ticks before this one are not counted.
    began_tick: u64,
}

impl Medium {
    /// Takes the controls of one tick.
    pub fn tick(&mut self, controls: &Controls) {
        if controls.outflow_valve.is_finite() && controls.light.is_finite() {
            self.valve_ticks += 1;
            self.shut_ticks += u64::from(controls.outflow_valve < SHUT);
            self.dark_ticks += u64::from(controls.light < SHUT);
        }
    }

    /// The session begins with this tick: what was counted of the ticks before it counts no more. Amounts, peaks and alarms stay.
    pub(crate) fn begin(&mut self, tick: u64) {
        (self.known_ticks, self.low_ticks, self.high_ticks, self.parted_ticks, self.alarm_ticks) = (0, 0, 0, 0, 0);
        (self.bled_known_ticks, self.bleeding_ticks) = (0, 0);
        self.clarity = Clarity::default();
        (self.valve_ticks, self.shut_ticks, self.dark_ticks) = (0, 0, 0);
        self.began_tick = tick;
    }

    /// How often an alarm came up that is no notice.
    pub fn alarm_count(&self) -> u64 {
        let counts = PUMP_ALARMS.iter().zip(&self.alarms);
        counts.filter(|((bit, _), _)| bit & PUMP_NOTICES == 0).map(|(_, count)| count).sum()
    }

    /// How often the pump said that the wall is pierced.
    pub fn perforation_count(&self) -> u64 {
        let counts = PUMP_ALARMS.iter().zip(&self.alarms);
        counts.filter(|((_, name), _)| *name == Alarm::Perforation.name()).map(|(_, count)| count).sum()
    }

    /// The newest status.
    pub fn newest(&self) -> Option<&FluidStatus> {
        self.newest.as_ref()
    }

    /// Takes a status; one that is not newer than the one before is left out.
    pub fn status(&mut self, status: &FluidStatus) {
        let before = self.newest;
        let held_ticks = match before {
            Some(before) if status.state_tick <= before.state_tick => return,
            Some(before) => (status.state_tick - before.state_tick).min(HOLD_TICKS),
            None => 0,
        };
        if let Some(before) = before {
            self.hold(&before, held_ticks);
        }
        let (alarms, flaws) = before.map_or((0, 0), |before| (before.alarms, before.flaws));
        count(&PUMP_ALARMS, &mut self.alarms, status.alarms & !alarms);
        let came_up = (0..PUMP_ALARMS.len()).filter(|index| status.alarms & !alarms & PUMP_ALARMS[*index].0 != 0);
        let room = MOST_TOLD.saturating_sub(self.told.len());
        self.told.extend(came_up.map(|index| (index, status.state_tick)).take(room));
        count(&FLOW_FLAWS, &mut self.flaws, status.flaws & !flaws);
        let pressure_pa = Some(f64::from(status.pressure_pa)).filter(|pressure_pa| pressure_pa.is_finite());
        self.mean_pa = pressure_pa.map(|is_pa| (status.state_tick, mean_after(self.mean_pa, status.state_tick, is_pa)));
        if let Some((_, mean_pa)) = self.mean_pa {
            Peak::raise(&mut self.highest, mean_pa, status.state_tick);
        }
        if status.deficit_ml.is_finite() {
            self.deficit_ml = Some(status.deficit_ml);
            self.rise(status.state_tick, status.deficit_ml);
        }
        if status.bled_ml.is_finite() {
            self.bled_ml = Some(status.bled_ml);
            self.bled.take(status.state_tick, status.bled_ml);
        }
        self.newest = Some(*status);
    }

    /// The newest status was true for so many ticks.
    fn hold(&mut self, status: &FluidStatus, held_ticks: u64) {
        if status.inflow_ml_min.is_finite() {
            *self.inflow_ml.get_or_insert(0.0) += f64::from(status.inflow_ml_min) * held_ticks as f64 / 60_000.0;
        }
        let ticks = held_ticks.min((status.state_tick + held_ticks).saturating_sub(self.began_tick));
        if let Some((_, mean_pa)) = self.mean_pa {
            self.known_ticks += ticks;
            self.low_ticks += if mean_pa < LOW_PA { ticks } else { 0 };
            self.high_ticks += if mean_pa > HIGH_PA { ticks } else { 0 };
            self.parted_ticks += if mean_pa >= PARTED_PA { ticks } else { 0 };
            self.alarm_ticks += if status.alarms & !PUMP_NOTICES != 0 { ticks } else { 0 };
        }
        if let Some(rate_ml_min) = self.bled.rate_ml_min().filter(|_| status.bled_ml.is_finite()) {
            self.bled_known_ticks += ticks;
            self.bleeding_ticks += if rate_ml_min > BLEEDS_ML_MIN { ticks } else { 0 };
        }
        if let Some(share) = status.told_transmittance() {
            self.clarity.hold(f64::from(share), ticks);
        }
    }

    fn rise(&mut self, tick: u64, deficit_ml: f64) {
        if self.points.back().is_some_and(|(newest, _)| tick - newest < RATE_POINT_TICKS) {
            return;
        }
        self.points.push_back((tick, deficit_ml));
        let is_old_enough = |point: Option<&(u64, f64)>| point.is_some_and(|(point, _)| tick - point >= RATE_TICKS);
        while is_old_enough(self.points.get(1)) {
            self.points.pop_front();
        }
        if let Some((since, from_ml)) = self.points.front().copied().filter(|point| is_old_enough(Some(point))) {
            let minutes = (tick - since) as f64 / 60_000.0;
            Peak::raise(&mut self.steepest, (deficit_ml - from_ml) / minutes, tick);
        }
    }
}

/// Counts the bits that came up.
fn count(names: &[(u32, &str)], counts: &mut [u64], came_up: u32) {
    for ((bit, _), count) in names.iter().zip(counts) {
        *count += u64::from(came_up & bit != 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(state_tick: u64, pressure_mmhg: f64, deficit_ml: f64, alarms: u32) -> FluidStatus {
        let pressure_pa = (pressure_mmhg * PA_PER_MMHG) as f32;
        FluidStatus { state_tick, pressure_pa, deficit_ml, alarms, inflow_ml_min: 120.0, ..FluidStatus::default() }
    }

    #[test]
    fn each_status_holds_until_the_next_and_for_a_second_at_most() {
        let mut medium = Medium::default();
        for (tick, pressure_mmhg, alarms) in
            [(0, 20.0, 0), (500, 38.0, 1), (1_000, 260.0, 29), (1_500, 70.0, 1), (9_000, 70.0, 0)]
        {
            medium.status(&FluidStatus { flaws: alarms & 5, ..status(tick, pressure_mmhg, 0.0, alarms) });
        }
        assert_eq!(medium.flaws, [1, 0, 0, 0, 1, 0, 0, 0]);
        // In the mean 20, 20 + 18/3 = 26 and 26 + 234/3 = 104 mmHg for 500 ticks each, 104 − 34/3 = 92.7 for 1 000 of 7 500.
        let known = (medium.known_ticks, medium.low_ticks, medium.high_ticks, medium.parted_ticks, medium.alarm_ticks);
        assert_eq!(known, (2_500, 1_000, 500, 1_500, 2_000));
        assert_eq!((medium.alarms, medium.highest.unwrap().tick), ([1, 0, 1, 1, 1], 1_000));
        assert!((medium.highest.unwrap().value - 104.0 * PA_PER_MMHG).abs() < 0.01, "{:?}", medium.highest);
        assert!((medium.inflow_ml.unwrap() - 5.0).abs() < 1e-9, "2.5 s of 120 ml/min");
        medium.status(&status(9_000, 500.0, 99.0, 7));
        assert_eq!(medium.deficit_ml, Some(0.0), "it is not newer");
    }

    /// A beat of 1.3 mmHg every 2.2 s at 99.3 mmHg was time above 100.
    #[test]
    fn the_rollers_beat_is_neither_time_beyond_a_limit_nor_a_peak() {
        let mut medium = Medium::default();
        for tick in (0..30_000_u64).step_by(25) {
            let mmhg = 99.3 + 1.3 * (std::f64::consts::TAU * tick as f64 / 2_200.0).sin();
            medium.status(&status(tick, mmhg, 0.0, 0));
        }
        assert_eq!((medium.known_ticks, medium.high_ticks), (29_975, 0));
        assert!(medium.highest.unwrap().value < HIGH_PA, "{:?}", medium.highest);
    }

    #[test]
    fn a_container_that_is_to_be_changed_is_no_alarm_by_itself() {
        assert_eq!(PUMP_ALARMS.iter().find(|(_, name)| *name == "container change").map(|(bit, _)| *bit), Some(PUMP_NOTICES));
        let mut medium = Medium::default();
        for (tick, alarms) in [(0, 16), (500, 16 | 4), (1_000, 16), (1_500, 0)] {
            medium.status(&status(tick, 70.0, 0.0, alarms));
        }
        assert_eq!((medium.alarm_ticks, medium.alarm_count(), medium.known_ticks), (500, 1, 1_500));
        assert_eq!(medium.alarms, [0, 0, 1, 0, 1], "the notice is told all the same");
    }

    #[test]
    fn it_bleeds_while_more_than_a_millilitre_a_minute_comes_into_the_cavity() {
        let mut medium = Medium::default();
        // 6 ml/min for 2 s, then 0.6 ml/min for 3 s.
        for tick in (0..=5_000_u64).step_by(100) {
            let bled_ml = 1e-4 * tick.min(2_000) as f64 + 1e-5 * tick.saturating_sub(2_000) as f64;
            medium.status(&FluidStatus { bled_ml, ..status(tick, 70.0, 0.0, 0) });
        }
        // Known from half a second on; over a second before 2 900 it bled at 1.14 ml/min in the mean, before 3 000 at 0.6.
        assert_eq!((medium.bled_known_ticks, medium.bleeding_ticks), (4_500, 2_500));
    }

    #[test]
    fn the_view_is_what_each_status_says_of_it_since_the_session_began_and_unknown_where_none_does() {
        let mut medium = Medium::default();
        // Clear for a second, then a quarter of the light for one, then nothing is said for one, then a quarter again for half of one.
        let story = [(0, 1.0), (1_000, 0.25), (2_000, 0.0), (2_500, f32::NAN), (3_000, 0.25), (3_500, 1.0)];
        for (tick, transmittance) in story {
            medium.status(&FluidStatus { transmittance, ..status(tick, 70.0, 0.0, 0) });
        }
        let clarity = medium.clarity;
        assert_eq!((clarity.known_ticks, clarity.clear_ticks, clarity.longest_known_ticks()), (2_500, 1_000, Some(1_500)));
        assert_eq!(clarity.mean_share(), Some(0.55));
        medium.begin(4_000);
        assert_eq!(medium.clarity, Clarity::default(), "what was before counts no more");
        medium.status(&FluidStatus { transmittance: 0.25, ..status(4_250, 70.0, 0.0, 0) });
        assert_eq!((medium.clarity.known_ticks, medium.clarity.clear_ticks), (250, 250));
    }

    #[test]
    fn when_each_alarm_came_up_is_told_and_one_that_stands_is_told_once() {
        let mut medium = Medium::default();
        for (tick, alarms) in [(0, 0), (500, 1), (600, 1 | 8), (700, 0), (800, 16 | 1)] {
            medium.status(&status(tick, 70.0, 0.0, alarms));
        }
        assert_eq!(medium.told, [(0, 500), (3, 600), (0, 800), (4, 800)]);
        for tick in 1_000..3_000 {
            medium.status(&status(tick, 70.0, 0.0, (tick % 2) as u32));
        }
        assert_eq!(medium.told.len(), MOST_TOLD, "and not one more");
    }

    #[test]
    fn the_steepest_rise_is_taken_over_ten_seconds() {
        let mut medium = Medium::default();
        // 1 ml/s for 20 s, then 3 ml/s for 5 s, then nothing: 5 s of 3 and 5 s of 1 ml/s make 120 ml/min.
        let deficit_ml = |second: u64| second.min(20) as f64 + 3.0 * second.saturating_sub(20).min(5) as f64;
        for tenth in 0..400 {
            medium.status(&status(tenth * 100, 70.0, deficit_ml(tenth / 10), 0));
        }
        let steepest = medium.steepest.unwrap();
        assert!((steepest.value - 120.0).abs() < 1e-9 && steepest.tick == 25_000, "{steepest:?}");
        let mut short = Medium::default();
        [0, 9_999].iter().for_each(|tick| short.status(&status(*tick, 70.0, 1.0, 0)));
        assert_eq!(short.steepest, None);
    }

    #[test]
    fn what_is_no_number_is_unknown() {
        let mut medium = Medium::default();
        for tick in [0, 100] {
            medium.status(&FluidStatus {
                state_tick: tick,
                pressure_pa: f32::NAN,
                deficit_ml: f64::NAN,
                bled_ml: f64::NAN,
                ..FluidStatus::default()
            });
        }
        assert_eq!((medium.known_ticks, medium.highest, medium.deficit_ml, medium.bled_ml), (0, None, None, None));
        medium.tick(&Controls { outflow_valve: f32::NAN, light: 1.0, ..Controls::default() });
        medium.tick(&Controls { outflow_valve: 0.0, light: 1.0, ..Controls::default() });
        assert_eq!((medium.valve_ticks, medium.shut_ticks, medium.dark_ticks), (1, 1, 0));
    }
}
