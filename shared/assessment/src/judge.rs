//! A session judged by its case: which goals were reached and when, what ended it, which warnings fell. One function of what a recording holds (ticks,
//! statuses of fluid and tissue), computed incrementally, so that the operator's page says of a session that runs what the report says of its recording.
//!
//! Who is told to stop is asked for nothing else any more: a `stop` that was called for takes the place of the goals that are still open, whatever comes of
//! it, because a procedure is broken off there. So a session ends with its goals where all are reached that were called for, and there are some (`asked`).
//!
//! Its time counts from when the hand first moves (`begin`); what was reached, and what fell, before that has been all the same. The pressure of goals and
//! warnings is an average, as a pump shows and gives alarm by it: the roller's beat in the cavity is neither the trainee's doing nor his to mend.
//!
//! Promise: what is kept is bounded whatever comes; it is plain data, so a process that dies hands it to its successor, and what of it cannot be ends none; what
//! comes after the end counts for nothing; a status holds for a second, then nothing is known of what it said; nothing counts as held in ticks that are missing
//! for longer than that.

mod asked;

use crate::begin::Begin;
use crate::bleeding::Bleeding;
use crate::ended::EndedBy;
use crate::force::length;
use crate::medium::{HOLD_TICKS, PARTED_PA, SHUT};
use crate::motion::finite;
use crate::pieces::Pieces;
use crate::sight::{axis, is_in_sight};
use hyst_messages::{AppliedRecord, FluidStatus, PUMP_ALARMS, TissueStatus, mean_after};
use hyst_scene::{Aim, Alarm, Brief, Cause, Region};
use serde::{Deserialize, Serialize};

/// A warning stands until its cause is gone for so long, ticks: one that flickers is one.
const CALM_TICKS: u64 = 1_000;
/// A warning of the pressure stands until that is so far on the right side of its limit again, Pa (3 mmHg): farther than the roller's beat in it goes from its
/// lowest to its highest (twice 1.3 mmHg), however slowly the pump turns, so that a pressure that stays at its limit is warned of once.
const CLEAR_PA: f64 = 400.0;
/// A warning of the deficit stands until that is so far below its limit again, ml: what the cavity holds goes missing when it is filled and comes back when it
/// is emptied. 11.4 is the largest volume that was measured at 150 mmHg; of a small limit it is the half, as of the pump's alarm.
const CLEAR_ML: f64 = 11.4;
/// Most warnings that are told one by one.
const MOST_TOLD: usize = 200;
/// Most goals, and most warnings, of a case that can be judged: a case file has fewer.
const MOST_ENTRIES: usize = 64;

/// A goal so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GoalState {
    /// When it was reached.
    pub reached_tick: Option<u64>,
    /// When it was missed for good: something was to be done in time.
    pub missed_tick: Option<u64>,
    /// How far it is, 0 to 1.
    pub progress: f64,
    /// Since when what it asks for holds, or was called for.
    since_tick: Option<u64>,
    /// Places that were visited, or looked at.
    places: usize,
    /// Of each landmark since when it is looked at, and whether it was for long enough.
    #[serde(default)]
    looks: Vec<(Option<u64>, bool)>,
    /// When as much had bled as a bleeding to be staunched has to begin with.
    #[serde(default)]
    bled_tick: Option<u64>,
}

/// A warning so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WarningState {
    /// How often it fell.
    pub count: u64,
    /// When it fell first.
    pub first_tick: Option<u64>,
    /// Whether it stands.
    pub stands: bool,
    /// The newest tick with its cause.
    cause_tick: u64,
}

/// What is known of the cavity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Cavity {
    tick: u64,
    /// The average.
    pressure_pa: Option<f64>,
    deficit_ml: Option<f64>,
    bled_ml: Option<f64>,
    alarms: u32,
}

/// A session and its case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judge {
    /// The case.
    pub brief: Brief,
    /// Goals, in the case's order.
    pub goals: Vec<GoalState>,
    /// Warnings, in the case's order.
    pub warnings: Vec<WarningState>,
    /// Which warning fell at which tick, the first two hundred.
    pub told: Vec<(usize, u64)>,
    /// What ended the session, and when.
    pub ended: Option<(EndedBy, u64)>,
    /// First tick.
    pub first_tick: Option<u64>,
    /// Newest tick.
    pub last_tick: u64,
    /// Volume removed so far, ml.
    pub removed_ml: Option<f64>,
    #[serde(default)]
    pieces: Pieces,
    #[serde(default)]
    pub(crate) begin: Begin,
    cavity: Option<Cavity>,
    bled: Bleeding,
}

impl Judge {
    /// From what a recording, or a station, says of its case.
    ///
    /// # Errors
    /// Why nobody can be judged by it.
    pub fn read(brief: &str) -> Result<Judge, String> {
        let brief: Brief = serde_json::from_str(brief).map_err(|error| format!("the case cannot be read: {error}"))?;
        let most = brief.goals.len().max(brief.warnings.len());
        if most > MOST_ENTRIES {
            return Err(format!("the case cannot be read: {most} entries, at most {MOST_ENTRIES} are judged"));
        }
        Ok(Judge::new(brief))
    }

    /// The same, going on from what a predecessor has kept of it, if that is of the same case. One of an older build has kept no begin of the session: its
    /// time counts from when the hand next moves, and at the latest from the tick with which every session has begun.
    ///
    /// # Errors
    /// Those of [`Judge::read`].
    pub fn resume(brief: &str, kept: Option<&str>) -> Result<Judge, String> {
        let fresh = Judge::read(brief)?;
        let before = kept.and_then(|text| serde_json::from_str::<Judge>(text).ok());
        Ok(before.filter(|before| before.brief == fresh.brief).unwrap_or(fresh))
    }

    /// Before the first tick.
    pub fn new(brief: Brief) -> Judge {
        Judge {
            goals: vec![GoalState::default(); brief.goals.len()],
            warnings: vec![WarningState::default(); brief.warnings.len()],
            brief,
            told: Vec::new(),
            ended: None,
            first_tick: None,
            last_tick: 0,
            removed_ml: None,
            pieces: Pieces::default(),
            begin: Begin::default(),
            cavity: None,
            bled: Bleeding::default(),
        }
    }

    /// Takes a status of the fluid.
    pub fn fluid(&mut self, status: &FluidStatus) {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        if self.ended.is_some() || self.cavity.is_some_and(|before| status.state_tick <= before.tick) {
            return;
        }
        let bled_ml = finite(status.bled_ml);
        self.cavity = Some(Cavity {
            tick: status.state_tick,
            pressure_pa: finite(f64::from(status.pressure_pa)).map(|pa| self.averaged_pa(status.state_tick, pa)),
            deficit_ml: finite(status.deficit_ml),
            bled_ml,
            alarms: status.alarms,
        });
        if let Some(bled_ml) = bled_ml {
            self.bled.take(status.state_tick, bled_ml);
        }
    }

    /// The average after a status of this tick, with this pressure in it.
    fn averaged_pa(&self, tick: u64, pressure_pa: f64) -> f64 {
        let before = self.cavity.and_then(|cavity| Some((cavity.tick, cavity.pressure_pa?)));
        mean_after(before, tick, pressure_pa)
    }

    /// Takes a status of the tissue.
    pub fn tissue(&mut self, status: &TissueStatus) {
        if self.ended.is_some() || !status.removed_volume_ml.is_finite() {
            return;
        }
        self.pieces.take(status, self.removed_ml);
        self.removed_ml = Some(status.removed_volume_ml);
    }

    /// Takes a tick, after the statuses of before it.
    pub fn tick(&mut self, record: &AppliedRecord) {
        if self.ended.is_some() || self.first_tick.is_some() && record.tick <= self.last_tick {
            return;
        }
        if self.first_tick.is_some() && record.tick - self.last_tick > HOLD_TICKS {
            self.let_go();
        }
        self.first_tick.get_or_insert(record.tick);
        self.last_tick = record.tick;
        self.begin.take(record);
        for index in 0..self.brief.warnings.len().min(self.warnings.len()) {
            let is_cause = self.holds(&self.brief.warnings[index].is, self.warnings[index].stands, record);
            self.warn(index, is_cause, record.tick);
        }
        let is_to_stop = self.is_to_stop();
        for index in 0..self.brief.goals.len().min(self.goals.len()) {
            if is_to_stop && !matches!(self.brief.goals[index].is, Aim::Stop { .. }) {
                continue;
            }
            if self.goals[index].reached_tick.is_none() && self.goals[index].missed_tick.is_none() {
                let before = std::mem::take(&mut self.goals[index]);
                self.goals[index] = self.goal(&self.brief.goals[index].is, before, record);
            }
        }
        self.ended = self.end().map(|by| (by, record.tick));
    }

    /// Ticks are missing: what was held before them begins anew. What was called for stays so.
    fn let_go(&mut self) {
        let held = self.goals.iter_mut().zip(&self.brief.goals).filter(|(_, asked)| !matches!(asked.is, Aim::Stop { .. }));
        for (goal, _) in held {
            goal.since_tick = None;
            goal.looks.iter_mut().for_each(|(since_tick, _)| *since_tick = None);
        }
    }

    /// What is known of the cavity at a tick.
    fn known(&self, tick: u64) -> Cavity {
        self.cavity.filter(|cavity| tick.saturating_sub(cavity.tick) <= HOLD_TICKS).unwrap_or_default()
    }

    /// Whether a cause is there; of one that is warned of already, whether it is there still.
    fn holds(&self, cause: &Cause, is_warned_of: bool, record: &AppliedRecord) -> bool {
        let (known, controls) = (self.known(record.tick), &record.sample.controls);
        let clear = |by: f64| if is_warned_of { by } else { 0.0 };
        match *cause {
            Cause::PressureAbove(limit_pa) => known.pressure_pa.is_some_and(|pa| pa > limit_pa - clear(CLEAR_PA)),
            Cause::PressureBelow(limit_pa) => known.pressure_pa.is_some_and(|pa| pa < limit_pa + clear(CLEAR_PA)),
            Cause::DeficitAbove(limit_ml) => {
                known.deficit_ml.is_some_and(|ml| ml > limit_ml - clear(CLEAR_ML.min(0.5 * limit_ml)))
            }
            Cause::BledAbove(limit_ml) => known.bled_ml.is_some_and(|ml| ml > limit_ml),
            Cause::ForceAbove(limit_n) => finite(record.command.force_n).map(length).is_some_and(|n| n > limit_n),
            Cause::TimeAbove(ticks) => self.elapsed_ticks(record.tick) > ticks,
            Cause::Alarm(alarm) => known.alarms & bit(alarm) != 0,
            Cause::Current => controls.has_current(),
            Cause::CurrentIn(region) => controls.has_current() && is_at(&region, record, f64::from(controls.loop_extension_m)),
        }
    }

    /// How often warnings fell that count: those that are no notices.
    pub fn warning_count(&self) -> u64 {
        let fell = self.brief.warnings.iter().zip(&self.warnings).filter(|(warned, _)| !warned.is_notice());
        fell.fold(0, |sum, (_, state)| state.count.saturating_add(sum))
    }

    fn warn(&mut self, index: usize, is_cause: bool, tick: u64) {
        let warning = &mut self.warnings[index];
        if is_cause {
            if !warning.stands {
                warning.count = warning.count.saturating_add(1);
                warning.first_tick.get_or_insert(tick);
                if self.told.len() < MOST_TOLD {
                    self.told.push((index, tick));
                }
            }
            (warning.stands, warning.cause_tick) = (true, tick);
        } else if tick.saturating_sub(warning.cause_tick) >= CALM_TICKS {
            warning.stands = false;
        }
    }

    /// The goal after a tick.
    fn goal(&self, aim: &Aim, mut goal: GoalState, record: &AppliedRecord) -> GoalState {
        let (tick, known) = (record.tick, self.known(record.tick));
        let share = |is: f64, of: f64| if of > 0.0 { (is / of).clamp(0.0, 1.0) } else { 1.0 };
        let is_reached = match aim {
            Aim::Removed(ml) => {
                goal.progress = share(self.removed_ml.unwrap_or(0.0), *ml);
                self.removed_ml.is_some_and(|removed_ml| removed_ml >= *ml)
            }
            Aim::Piece(ml) => {
                goal.progress = share(self.pieces.largest_ml, *ml);
                self.pieces.largest_ml >= *ml
            }
            Aim::Pressure { band_pa: [from_pa, to_pa], ticks } => {
                goal.hold(known.pressure_pa.is_some_and(|pa| (*from_pa..=*to_pa).contains(&pa)), tick, *ticks)
            }
            Aim::Visit { places, stay_ticks } => {
                let is_there = places.get(goal.places).is_some_and(|place| is_at(&place.is, record, 0.0));
                if goal.hold(is_there, tick, *stay_ticks) {
                    (goal.places, goal.since_tick) = (goal.places + 1, None);
                }
                goal.progress = share(goal.places as f64, places.len() as f64);
                goal.places >= places.len()
            }
            Aim::Look { landmarks, sight, ticks } => {
                let is_visible = known.pressure_pa.is_some_and(|pa| pa >= PARTED_PA);
                goal.looks.resize(landmarks.len(), (None, false));
                for (landmark, (since_tick, is_seen)) in landmarks.iter().zip(&mut goal.looks) {
                    let is_looked_at = is_visible && is_in_sight(sight, landmark.is, &record.sample);
                    *since_tick = since_tick.or(Some(tick)).filter(|_| is_looked_at);
                    *is_seen |= since_tick.is_some_and(|since| tick.saturating_sub(since) >= *ticks);
                }
                goal.places = goal.looks.iter().filter(|(_, is_seen)| *is_seen).count();
                goal.progress = share(goal.places as f64, landmarks.len() as f64);
                goal.places >= landmarks.len()
            }
            Aim::Stop { after, ticks } => {
                if self.holds(after, false, record) {
                    goal.since_tick.get_or_insert(tick);
                }
                let controls = &record.sample.controls;
                let is_stopped = controls.inflow_valve < SHUT && !controls.has_current();
                goal.missed_tick = goal.since_tick.filter(|since| tick.saturating_sub(*since) > *ticks).map(|_| tick);
                goal.since_tick.is_some() && goal.missed_tick.is_none() && is_stopped
            }
            Aim::Staunch { after_ml, below_ml_min, ticks } => {
                let is_bleeding = known.bled_ml.is_some_and(|ml| ml >= *after_ml);
                goal.bled_tick = goal.bled_tick.or(Some(tick).filter(|_| is_bleeding));
                let is_slow = self.bled.rate_ml_min().is_some_and(|rate_ml_min| rate_ml_min <= *below_ml_min);
                goal.hold(is_bleeding && is_slow, tick, *ticks)
            }
        };
        if is_reached {
            (goal.reached_tick, goal.progress) = (Some(tick), 1.0);
        }
        goal
    }

    fn end(&self) -> Option<EndedBy> {
        let (end, known) = (&self.brief.end, self.known(self.last_tick));
        let reaches = |value: Option<f64>, limit: Option<f64>| value.zip(limit).is_some_and(|(value, limit)| value >= limit);
        let (reached, called_for) = self.tally();
        let all_reached = called_for > 0 && reached == called_for;
        let ends = [
            (EndedBy::Goals, end.goals && all_reached),
            (EndedBy::Perforation, end.perforation && known.alarms & bit(Alarm::Perforation) != 0),
            (EndedBy::Deficit, reaches(known.deficit_ml, end.deficit_ml)),
            (EndedBy::Bleeding, reaches(known.bled_ml, end.bled_ml)),
            (EndedBy::Time, reaches(Some(self.elapsed_s(self.last_tick)), end.time_s)),
        ];
        ends.into_iter().find(|(_, is_over)| *is_over).map(|(by, _)| by)
    }
}

impl GoalState {
    /// Something holds at this tick, or not; whether it has held for so many ticks.
    fn hold(&mut self, is_so: bool, tick: u64, ticks: u64) -> bool {
        self.since_tick = if is_so { self.since_tick.or(Some(tick)) } else { None };
        let held = self.since_tick.map(|since| tick.saturating_sub(since));
        self.progress = held.map_or(0.0, |held| if ticks == 0 { 1.0 } else { (held as f64 / ticks as f64).min(1.0) });
        held.is_some_and(|held| held >= ticks)
    }
}

/// Whether the point so far before the tip, on the scope's axis, is there.
fn is_at(region: &Region, record: &AppliedRecord, ahead_m: f64) -> bool {
    let pose = &record.sample.pose;
    match *region {
        Region::Ball(centre_m, radius_m) => {
            let axis = axis(pose);
            let away_m =
                |tip_m: [f64; 3]| (0..3).map(|i| (tip_m[i] + ahead_m * axis[i] - centre_m[i]).powi(2)).sum::<f64>().sqrt();
            finite(pose.position_m).map(away_m).is_some_and(|away_m| away_m <= radius_m)
        }
        Region::Insertion([least_m, most_m]) => (least_m..=most_m).contains(&(f64::from(pose.insertion_m) + ahead_m)),
    }
}

/// The pump's bit of an alarm.
fn bit(alarm: Alarm) -> u32 {
    PUMP_ALARMS.iter().find(|(_, name)| *name == alarm.name()).map_or(0, |(bit, _)| *bit)
}
