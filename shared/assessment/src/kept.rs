//! What a recorder keeps of the referee beside each state of the tissue: a replay that begins there has its case judged from there on.

use crate::judge::Judge;
use hyst_recording::Judged;
use hyst_scene::Brief;

impl Judge {
    /// What is kept of it, with the tick of the newest status of the tissue that it has seen; `None` before its first tick.
    pub fn kept(&self, tissue_tick: u64) -> Option<Judged> {
        self.first_tick?;
        let judge = serde_json::to_string(self).ok()?;
        Some(Judged { tick: self.last_tick, tissue_tick, judge })
    }

    /// The referee that was kept; `None` where it is another build's, or judges by another case.
    pub(crate) fn of_kept(kept: &Judged, brief: &Brief) -> Option<Judge> {
        let judge: Judge = serde_json::from_str(&kept.judge).ok()?;
        (judge.brief == *brief && judge.last_tick == kept.tick).then_some(judge)
    }
}
