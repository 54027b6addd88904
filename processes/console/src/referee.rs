//! The session that runs, judged by its case: by the same function as its report, from the same ticks and statuses, a few at each look. Promise: a console
//! that follows a dead one goes on from its judgement, as long as it comes within the four seconds that the device's ring holds. One that first comes later
//! than that has the latest begin of the session all the same, which counts from the station's tick 0; from where the hand has moved it knows by what it sees.

use crate::sources::Sources;
use hyst_assessment::Judge;
use hyst_engine::{Life, Told};
use hyst_exchange::{Roster, Station, system, whole};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Between two writings of the judgement for a successor, and between two tellings of it, ns.
const KEEP_NS: u64 = 500_000_000;
const TELL_NS: u64 = 200_000_000;

/// The referee.
#[derive(Debug)]
pub struct Referee {
    judge: Judge,
    roster: Roster,
    station: Station,
    kept: PathBuf,
    told: Value,
    kept_ns: u64,
    told_ns: u64,
}

/// The tick with which the time of a session is over; `None` before it has begun, when it has ended, and where time does not end it.
fn until_tick(judge: &Judge) -> Option<u64> {
    let time_s = judge.brief.end.time_s.filter(|_| judge.ended.is_none())?;
    Some(judge.began_tick()?.saturating_add((time_s * 1e3) as u64))
}

/// The deficit from which on a case warns, ml: what its rules say, or what the pump allows of its medium.
fn deficit_limit_ml(judge: &Judge) -> Option<f64> {
    let limits =
        judge.brief.warnings.iter().filter_map(|warning| serde_json::to_value(warning.is).ok()?["deficit_above"].as_f64());
    limits.reduce(f64::min)
}

impl Referee {
    /// Of a station with a case; goes on from what a predecessor has kept, or a replay that begins later has laid down.
    pub fn of(life: &Life) -> Option<Referee> {
        let brief = std::fs::read_to_string(life.station.brief()).ok()?;
        let kept = life.station.judged();
        let judge = match Judge::resume(&brief, std::fs::read_to_string(&kept).ok().as_deref()) {
            Ok(judge) => judge,
            Err(reason) => {
                life.say(&format!("{}: {reason}", life.station.brief().display()));
                return None;
            }
        };
        let roster = Roster::open(&life.station).ok()?;
        let station = life.station.clone();
        Some(Referee { judge, roster, station, kept, told: Value::Null, kept_ns: 0, told_ns: 0 })
    }

    /// Takes what is new; gives case and judgement if they are to be told.
    pub fn look(&mut self, sources: &Sources) -> Option<Value> {
        // As in a report: a status comes before the ticks from its own on. One that is ahead of all ticks is read again, or its successor.
        let (mut tissue, mut fluid) = (sources.tissue(&self.roster), sources.fluid());
        let judge = &mut self.judge;
        // The first look takes the oldest that the ring holds: by that is judged from where the hand moves.
        sources.ticks(judge.first_tick.map_or(0, |_| judge.last_tick + 1), |record| {
            if let Some(status) = tissue.take_if(|status| status.state_tick <= record.tick) {
                judge.tissue(&status);
            }
            if let Some(status) = fluid.take_if(|status| status.state_tick <= record.tick) {
                judge.fluid(&status);
            }
            judge.tick(record);
        });
        let now_ns = system::now_ns();
        if now_ns >= self.kept_ns + KEEP_NS {
            self.kept_ns = now_ns;
            self.keep();
        }
        if now_ns < self.told_ns + TELL_NS {
            return None;
        }
        self.told_ns = now_ns;
        let mut told = self.judge.json();
        told["until_tick"] = json!(until_tick(&self.judge));
        told["deficit_limit_ml"] = json!(deficit_limit_ml(&self.judge));
        let is_new = told != self.told;
        self.told = told;
        is_new.then(|| self.told.clone())
    }

    /// Writes the judgement beside the one before, and puts it in its place; and what window and terminal show of it.
    fn keep(&self) {
        let judge = &self.judge;
        let fallen: u64 = judge.warnings.iter().map(|warning| warning.count).sum();
        let told = Told { tick: judge.last_tick, over: judge.over(), lines: judge.strip(), fallen };
        let _ = told.write(&self.station); // they show what was before, then nothing
        let Ok(text) = serde_json::to_string(&self.judge) else { return };
        // Refused, a successor goes on from an older one, or begins anew.
        let _ = whole::write(&self.kept, text.as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::AppliedRecord;

    #[test]
    fn the_deficit_that_a_case_warns_of_is_the_least_that_it_names() {
        let limit_ml = |warnings: Value| {
            let brief = json!({
                "name": "A case", "rung": "polyp", "task": "Do it.", "seed": 3, "drawn": [], "pathology_ml": 2.0, "goals": [],
                "end": { "goals": true, "time_s": null, "deficit_ml": null, "bled_ml": null, "perforation": false },
                "warnings": warnings, "score": {},
            });
            deficit_limit_ml(&Judge::read(&brief.to_string()).unwrap())
        };
        let above = |ml: f64| json!({ "words": "much is missing", "is": { "deficit_above": ml } });
        let others = [json!({ "words": "time", "is": { "time_above": 9 } }), json!({ "words": "current", "is": "current" })];
        assert_eq!(limit_ml(json!(others)), None);
        assert_eq!(limit_ml(json!([others[0], above(1_000.0), others[1], above(800.0)])), Some(800.0));
    }

    #[test]
    fn the_time_of_a_session_is_over_so_long_after_its_begin_and_never_where_time_does_not_end_it() {
        let judge = |time_s: Option<f64>, ticks: &[u64]| {
            let brief = json!({
                "name": "A case", "rung": "polyp", "task": "Do it.", "seed": 3, "drawn": [], "pathology_ml": 2.0, "goals": [],
                "end": { "goals": false, "time_s": time_s, "deficit_ml": null, "bled_ml": null, "perforation": false },
                "warnings": [], "score": {},
            });
            let mut judge = Judge::read(&brief.to_string()).unwrap();
            ticks.iter().for_each(|tick| judge.tick(&AppliedRecord { tick: *tick, ..AppliedRecord::default() }));
            judge
        };
        assert_eq!(until_tick(&judge(Some(600.0), &[1])), None, "nobody has moved anything yet");
        assert_eq!(until_tick(&judge(Some(600.0), &[1, 31_000])), Some(630_000), "it has begun with tick 30 000 at the latest");
        assert_eq!(until_tick(&judge(Some(600.0), &[1, 31_000, 700_000])), None, "it is over");
        assert_eq!(until_tick(&judge(None, &[1, 31_000])), None);
    }
}
