//! The session that runs, judged by its case: by the same function as its report, from the same ticks and statuses, a few at each look. Promise: a console
//! that follows a dead one goes on from its judgement, as long as it comes within the four seconds that the device's ring holds. One that first comes later
//! than that has the latest begin of the session all the same, which counts from the station's tick 0; from where the hand has moved it knows by what it sees.
//! One that follows after those four seconds says how much of the session no console has judged.

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
    /// Ticks of the session that no console has judged.
    unseen_ticks: u64,
    told: Value,
    kept_ns: u64,
    told_ns: u64,
}

/// The tick with which the time of a session is over; `None` before it has begun, when it has ended, and where time does not end it.
fn until_tick(judge: &Judge) -> Option<u64> {
    let time_s = judge.brief.end.time_s.filter(|_| judge.ended.is_none())?;
    Some(judge.began_tick()?.saturating_add((time_s * 1e3) as u64))
}

/// What a successor goes on from: the judgement, and how many ticks nobody has judged. `None` if it cannot be written down.
fn kept_text(judge: &Judge, unseen_ticks: u64) -> Option<String> {
    let mut kept = serde_json::to_value(judge).ok()?;
    kept["unseen_ticks"] = json!(unseen_ticks);
    Some(kept.to_string())
}

/// How many ticks nobody has judged, by what was kept; 0 where it does not say.
fn unseen_ticks_of(kept: &str) -> u64 {
    let kept = serde_json::from_str::<Value>(kept).unwrap_or_default();
    kept["unseen_ticks"].as_u64().unwrap_or(0)
}

impl Referee {
    /// Of a station with a case; goes on from what a predecessor has kept, or a replay that begins later has laid down.
    pub fn of(life: &Life) -> Option<Referee> {
        let brief = std::fs::read_to_string(life.station.brief()).ok()?;
        let kept = life.station.judged();
        let before = std::fs::read_to_string(&kept).ok();
        let judge = match Judge::resume(&brief, before.as_deref()) {
            Ok(judge) => judge,
            Err(reason) => {
                life.say(&format!("{}: {reason}", life.station.brief().display()));
                return None;
            }
        };
        let roster = Roster::open(&life.station).ok()?;
        let station = life.station.clone();
        // What was kept of another case counts for nothing.
        let unseen_ticks = before.filter(|_| judge.first_tick.is_some()).map_or(0, |text| unseen_ticks_of(&text));
        Some(Referee { judge, roster, station, kept, unseen_ticks, told: Value::Null, kept_ns: 0, told_ns: 0 })
    }

    /// Takes what is new; gives case and judgement if they are to be told.
    pub fn look(&mut self, sources: &Sources) -> Option<Value> {
        // As in a report: a status comes before the ticks from its own on. One that is ahead of all ticks is read again, or its successor.
        let (mut tissue, mut fluid) = (sources.tissue(&self.roster), sources.fluid());
        let judge = &mut self.judge;
        // The first look takes the oldest that the ring holds: by that is judged from where the hand moves.
        let next = judge.first_tick.filter(|_| judge.ended.is_none()).map(|_| judge.last_tick + 1);
        let gone_ticks = next.map_or(0, |next| sources.gone_ticks(next));
        sources.ticks(judge.first_tick.map_or(0, |_| judge.last_tick + 1), |record| {
            if let Some(status) = tissue.take_if(|status| status.state_tick <= record.tick) {
                judge.tissue(&status);
            }
            if let Some(status) = fluid.take_if(|status| status.state_tick <= record.tick) {
                judge.fluid(&status);
            }
            judge.tick(record);
        });
        // No more than it went on by: what a damaged ring says of its end is no time that has been.
        if let Some(next) = next.filter(|next| judge.last_tick >= *next) {
            self.unseen_ticks = self.unseen_ticks.saturating_add(gone_ticks.min(judge.last_tick - next));
        }
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
        told["deficit_limit_ml"] = json!(self.judge.brief.deficit_allowed_ml());
        told["unseen_s"] = json!(self.unseen_ticks as f64 * 1e-3);
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
        let Some(text) = kept_text(&self.judge, self.unseen_ticks) else { return };
        // Refused, a successor goes on from an older one, or begins anew.
        let _ = whole::write(&self.kept, text.as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::AppliedRecord;

    /// Goals and warnings of a time in which there was no console were missing on the page, which did not say so.
    #[test]
    fn what_nobody_has_judged_is_kept_beside_the_judgement() {
        let brief = json!({
            "name": "A case", "rung": "polyp", "task": "Do it.", "seed": 3, "drawn": [], "pathology_ml": 2.0, "goals": [],
            "end": { "goals": true, "time_s": 0.3, "deficit_ml": null, "bled_ml": null, "perforation": false },
            "warnings": [], "score": {},
        });
        let mut judge = Judge::read(&brief.to_string()).unwrap();
        judge.tick(&AppliedRecord { tick: 7, ..AppliedRecord::default() });
        let text = kept_text(&judge, 1_234).unwrap();
        assert_eq!(unseen_ticks_of(&text), 1_234);
        assert_eq!(Judge::resume(&brief.to_string(), Some(&text)), Ok(judge.clone()));
        // A replay that begins later lays down the judgement alone.
        let plain = serde_json::to_string(&judge).unwrap();
        assert_eq!([&plain[..], "", "[]", "{\"unseen_ticks\":-1}"].map(unseen_ticks_of), [0; 4]);
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
