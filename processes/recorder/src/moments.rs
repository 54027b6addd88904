//! What of a session is worth a picture: its end, goals that are reached or missed and warnings that fall, as its case has them; the electrode that begins to
//! cut, a piece that comes out, an alarm or a notice of the pump. From the same ticks and statuses as are recorded.

use hyst_assessment::Judge;
use hyst_messages::{AppliedRecord, FluidStatus, PUMP_ALARMS, PUMP_NOTICES, TissueStatus};
use hyst_recording::{Block, Judged};

/// One cut after another is one as long as less than this lies between them, ticks.
const CALM_TICKS: u64 = 5_000;

/// How many of a block's records were there before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mark {
    applied: usize,
    tissue: usize,
    fluid: usize,
}

impl Mark {
    /// Of all that is in a block.
    pub fn of(block: &Block) -> Mark {
        Mark { applied: block.applied.len(), tissue: block.tissue.len(), fluid: block.fluid.len() }
    }
}

/// What has happened so far.
#[derive(Debug)]
pub struct Moments {
    judge: Option<Judge>,
    /// Goals that are decided, and warnings that were told, as far as they were noticed.
    decided: Vec<bool>,
    told: usize,
    has_ended: bool,
    /// The tick from which on what is taken follows what the referee was kept with, until one is taken.
    goes_on_at: Option<u64>,
    /// Something lies between: the referee knows less than who reads the recording.
    is_partial: bool,
    /// The newest of them, and the tick of the newest that the referee has seen.
    tissue: Option<TissueStatus>,
    tissue_tick: u64,
    fluid: Option<FluidStatus>,
    cut_tick: Option<u64>,
}

impl Moments {
    /// From now on: what `judge` knows already was noticed by whoever came before.
    pub fn after(judge: Option<Judge>) -> Moments {
        let decided = judge.as_ref().map_or_else(Vec::new, decided);
        let told = judge.as_ref().map_or(0, |judge| judge.told.len());
        let has_ended = judge.as_ref().is_some_and(|judge| judge.ended.is_some());
        Moments {
            judge,
            decided,
            told,
            has_ended,
            goes_on_at: None,
            is_partial: false,
            tissue: None,
            tissue_tick: 0,
            fluid: None,
            cut_tick: None,
        }
    }

    /// In a session that goes on: from what a recorder before has kept of its referee, if that is of this case.
    pub fn going_on(brief: &str, kept: Option<&Judged>) -> Moments {
        let judge = Judge::resume(brief, kept.map(|kept| kept.judge.as_str())).ok();
        let open = judge.as_ref().filter(|judge| judge.ended.is_none());
        let goes_on_at = open.map(|judge| judge.last_tick.saturating_add(1));
        Moments { goes_on_at, tissue_tick: kept.map_or(0, |kept| kept.tissue_tick), ..Moments::after(judge) }
    }

    /// What its referee has judged so far, for whoever goes on from here; `None` without a case, before the first tick, and of one that has not seen all.
    pub fn judged(&self) -> Option<Judged> {
        self.judge.as_ref().filter(|_| !self.is_partial)?.kept(self.tissue_tick)
    }

    /// Gives what happened in that part of a block that is behind the mark: when, and in words.
    pub fn take(&mut self, block: &Block, mark: Mark) -> Vec<(u64, String)> {
        let mut moments = Vec::new();
        let mut tissue = block.tissue.iter().skip(mark.tissue).peekable();
        let mut fluid = block.fluid.iter().skip(mark.fluid).peekable();
        for record in block.applied.iter().skip(mark.applied) {
            while let Some(status) = tissue.next_if(|status| status.state_tick <= record.tick) {
                self.tissue(status, &mut moments);
            }
            while let Some(status) = fluid.next_if(|status| status.state_tick <= record.tick) {
                self.fluid(status, &mut moments);
            }
            self.tick(record, &mut moments);
        }
        tissue.for_each(|status| self.tissue(status, &mut moments));
        fluid.for_each(|status| self.fluid(status, &mut moments));
        moments
    }

    fn tick(&mut self, record: &AppliedRecord, moments: &mut Vec<(u64, String)>) {
        self.is_partial |= self.goes_on_at.take().is_some_and(|next| record.tick > next);
        let Some(judge) = &mut self.judge else { return };
        judge.tick(record);
        let now = decided(judge);
        for (index, goal) in judge.brief.goals.iter().enumerate() {
            if now.get(index) != self.decided.get(index) {
                let is_reached = judge.goals.get(index).is_some_and(|state| state.reached_tick.is_some());
                moments.push((record.tick, format!("goal {}: {}", if is_reached { "reached" } else { "missed" }, goal.words)));
            }
        }
        self.decided = now;
        for (index, tick) in judge.told.iter().skip(self.told) {
            let warned = judge.brief.warnings.get(*index);
            moments.extend(warned.map(|warned| (*tick, format!("{}: {}", warned.kind(), warned.words))));
        }
        self.told = judge.told.len();
        if let Some((by, tick)) = judge.ended
            && !std::mem::replace(&mut self.has_ended, true)
        {
            moments.push((tick, format!("the session is over: {}", by.words())));
        }
    }

    fn tissue(&mut self, status: &TissueStatus, moments: &mut Vec<(u64, String)>) {
        if status.state_tick < self.tissue_tick {
            return; // of a holder that was followed by another one: no report counts it
        }
        self.tissue_tick = status.state_tick;
        if let Some(judge) = &mut self.judge {
            judge.tissue(status);
        }
        let Some(before) = self.tissue.replace(*status) else { return };
        let tick = status.state_tick;
        if status.is_cutting != 0 {
            let is_first = self.cut_tick.replace(tick).is_none_or(|last| tick.saturating_sub(last) > CALM_TICKS);
            moments.extend(is_first.then(|| (tick, "the electrode begins to cut".into())));
        }
        for (was, is, how) in [
            (before.taken_out, status.taken_out, "a piece is brought out"),
            (before.washed_out, status.washed_out, "a piece is rinsed out"),
        ] {
            moments.extend((is > was).then(|| (tick, how.into())));
        }
    }

    fn fluid(&mut self, status: &FluidStatus, moments: &mut Vec<(u64, String)>) {
        if let Some(judge) = &mut self.judge {
            judge.fluid(status);
        }
        let Some(before) = self.fluid.replace(*status) else { return };
        let new = status.alarms & !before.alarms;
        let named = PUMP_ALARMS.iter().filter(|(bit, _)| new & bit != 0);
        let what = |bit: u32| if bit & PUMP_NOTICES != 0 { "notice" } else { "alarm" };
        moments.extend(named.map(|(bit, name)| (status.state_tick, format!("{} of the pump: {name}", what(*bit)))));
    }
}

/// Which goals are reached or missed.
fn decided(judge: &Judge) -> Vec<bool> {
    judge.goals.iter().map(|goal| goal.reached_tick.is_some() || goal.missed_tick.is_some()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn judge() -> Judge {
        Judge::read(&brief()).unwrap()
    }

    /// A case with two goals and a warning, which is over after half a second.
    fn brief() -> String {
        let brief = json!({
            "name": "a case", "rung": "polyp", "task": "Do it.", "seed": 1, "drawn": [], "pathology_ml": 2.0, "score": {},
            "goals": [{ "words": "a part", "is": { "removed": 0.5 } }, { "words": "all", "is": { "removed": 2.0 } }],
            "end": { "goals": true, "time_s": 0.5, "deficit_ml": null, "bled_ml": null, "perforation": false },
            "warnings": [{ "words": "too hard", "is": { "force_above": 1.0 } }],
        });
        brief.to_string()
    }

    fn ticks(range: std::ops::Range<u64>) -> Vec<AppliedRecord> {
        let tick = |tick| {
            let mut record = AppliedRecord { tick, ..AppliedRecord::default() };
            // The session begins with the light.
            record.sample.pose.orientation = [0.0, 0.0, 0.0, 1.0];
            record.sample.controls.light = if tick > 1 { 1.0 } else { 0.0 };
            record.command.force_n[0] = if (300..310).contains(&tick) { 1.5 } else { 0.0 };
            record
        };
        range.map(tick).collect()
    }

    fn tissue(state_tick: u64, removed_volume_ml: f64, is_cutting: u32, taken_out: u32) -> TissueStatus {
        TissueStatus { state_tick, removed_volume_ml, is_cutting, taken_out, ..TissueStatus::default() }
    }

    fn fluid(state_tick: u64, alarms: u32) -> FluidStatus {
        FluidStatus { state_tick, alarms, ..FluidStatus::default() }
    }

    /// What happens in a session of 700 ticks, in two blocks.
    fn blocks() -> [Block; 2] {
        let first = Block {
            applied: ticks(1..250),
            tissue: vec![tissue(10, 0.0, 0, 0), tissue(100, 0.6, 1, 0), tissue(120, 0.6, 0, 0), tissue(150, 0.6, 1, 1)],
            fluid: vec![fluid(20, 16), fluid(200, 16 | 1 | 8), fluid(240, 16 | 1)],
            ..Block::default()
        };
        [first, Block { applied: ticks(250..700), ..Block::default() }]
    }

    const FIRST: [(u64, &str); 5] = [
        (100, "the electrode begins to cut"),
        (100, "goal reached: a part"),
        (150, "a piece is brought out"),
        (200, "alarm of the pump: pressure"),
        (200, "alarm of the pump: perforation"),
    ];

    fn told(moments: Vec<(u64, String)>, wanted: &[(u64, &str)]) {
        let moments: Vec<(u64, &str)> = moments.iter().map(|(tick, words)| (*tick, words.as_str())).collect();
        assert_eq!(moments, wanted);
    }

    #[test]
    fn what_happens_is_told_once_with_its_tick_and_an_alarm_that_stands_or_a_cut_that_goes_on_is_no_other() {
        let [mut first, second] = blocks();
        let mut moments = Moments::after(Some(judge()));
        told(moments.take(&first, Mark::default()), &FIRST);
        // What waits on a disk that is full is in the block still.
        let mark = Mark::of(&first);
        first.applied.extend(second.applied);
        let judged = moments.take(&first, mark);
        told(judged, &[(300, "warning: too hard"), (502, "the session is over: the time was over")]);
        told(moments.take(&Block { applied: ticks(700..900), ..Block::default() }, Mark::default()), &[]);
    }

    #[test]
    fn a_container_that_is_to_be_changed_is_told_as_a_notice_and_no_alarm() {
        let fluid = vec![fluid(20, 0), fluid(60, 16), fluid(90, 16 | 2)];
        let block = Block { applied: ticks(1..100), fluid, ..Block::default() };
        told(
            Moments::after(None).take(&block, Mark::default()),
            &[(60, "notice of the pump: container change"), (90, "alarm of the pump: deficit")],
        );
    }

    #[test]
    fn what_is_kept_of_the_referee_is_as_much_as_it_has_seen_and_another_goes_on_from_it() {
        let [first, second] = blocks();
        let mut moments = Moments::after(Some(judge()));
        assert_eq!(moments.judged(), None, "before its first tick");
        moments.take(&first, Mark::default());
        let kept = moments.judged().unwrap();
        assert_eq!((kept.tick, kept.tissue_tick), (249, 150));
        let mut next = Moments::going_on(&brief(), Some(&kept));
        assert_eq!(next.judged(), Some(kept), "before its first tick, too");
        assert_eq!(next.take(&second, Mark::default()), moments.take(&second, Mark::default()));
        assert_eq!(next.judged(), moments.judged());
        // One of before that comes late, of a holder that was followed by another.
        let late = Block { tissue: vec![tissue(140, 2.0, 0, 5)], ..Block::default() };
        let known = moments.judged();
        for moments in [&mut moments, &mut next] {
            told(moments.take(&late, Mark::default()), &[]);
            assert_eq!(moments.judged(), known);
        }
        assert_eq!(Moments::after(None).judged(), None);
    }

    /// Where no console had judged, the second part of a session was judged as if it had begun there, and a replay went on from that.
    #[test]
    fn a_referee_that_has_not_seen_what_was_before_is_not_kept_and_the_one_before_it_serves() {
        let [first, second] = blocks();
        let mut before = Moments::after(Some(judge()));
        before.take(&first, Mark::default());
        let kept = before.judged();
        let judged = |kept: Option<&Judged>, from: u64| {
            let mut moments = Moments::going_on(&brief(), kept);
            let applied = ticks(from..700);
            moments.take(&Block { applied, ..Block::default() }, Mark::default());
            moments.judged()
        };
        assert_eq!([judged(None, 250), judged(kept.as_ref(), 251)], [None, None]);
        before.take(&second, Mark::default());
        assert_eq!([judged(kept.as_ref(), 250), judged(kept.as_ref(), 200)].map(|found| found == before.judged()), [true; 2]);
        // One that has seen the end has seen all.
        let over = before.judged();
        assert_eq!(judged(over.as_ref(), 690), over);
    }

    #[test]
    fn who_goes_on_does_not_tell_again_what_the_referee_knows_and_without_a_case_the_rest_is_told() {
        let [first, second] = blocks();
        let mut before = judge();
        before.tissue(&tissue(100, 0.6, 1, 0));
        first.applied.iter().for_each(|record| before.tick(record));
        let mut moments = Moments::after(Some(before));
        told(
            moments.take(&second, Mark::default()),
            &[(300, "warning: too hard"), (502, "the session is over: the time was over")],
        );
        let mut moments = Moments::after(None);
        told(moments.take(&first, Mark::default()), &[FIRST[0], FIRST[2], FIRST[3], FIRST[4]]);
        told(moments.take(&second, Mark::default()), &[]);
    }
}
