//! A fault whose cell was given up is not waited for, and any other is.

use super::tests::session;
use crate::campaign::absent::Absent;
use crate::campaign::draw::{self, Entry};
use crate::campaign::file;
use crate::campaign::outcome::{Ending, Outcome};
use crate::campaign::runner::Runner;
use crate::campaign::station::StationOutcome;
use crate::settings::Refusal;
use hyst_exchange::Station;
use std::sync::Arc;
use std::sync::atomic::Ordering;

#[test]
fn the_faults_of_a_cell_that_was_given_up_are_handed_on_without_a_try() {
    let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\nstates = [\"contact\"]\ncount = 5\n";
    let campaign = file::parse("t", text).unwrap();
    let plan = draw::plan(&campaign, 1);
    let station = Station::named(&format!("t{}-given-up", std::process::id())).unwrap();
    let mut waiting = session(&station);
    waiting.interrupted.store(true, Ordering::Relaxed); // so that whoever is tried does not come to its end
    let runner = Runner { campaign: &campaign, plan: &plan, station, interrupted: Arc::default(), json: true };
    // Those of a run that goes on are asked for in other ticks than the drawn ones.
    let entries: Vec<Entry> = plan.faults[3..].iter().map(|entry| Entry { tick: entry.tick + 7, ..entry.clone() }).collect();
    let mut after = |runs: [usize; 3]| {
        let in_vain = |run| Outcome { run: Some(run), ending: Ending::NoState, ..Outcome::of(&plan.faults[0]) };
        let mut absent = Absent::of(&runs.map(in_vain));
        let (mut found, mut taken) = (StationOutcome { run: 2, ..StationOutcome::default() }, Vec::new());
        let mut take = |outcome: Outcome| -> Result<(), Refusal> {
            taken.push((outcome.index, outcome.ending, outcome.planned_tick));
            Ok(())
        };
        let entries: Vec<&Entry> = entries.iter().collect();
        let (trouble, _) = runner.hurt_all(&mut waiting, &entries, &mut found, &mut take, &mut absent).unwrap();
        assert!(found.faults.is_empty(), "{found:?}");
        (trouble.is_some(), found.skipped, taken)
    };
    let skipped = |index: usize| (index, Ending::Skipped, plan.faults[index].tick);
    assert_eq!(after([0, 0, 1]), (false, vec![3, 4], vec![skipped(3), skipped(4)]));
    assert_eq!(after([1, 1, 1]), (true, vec![], vec![]), "it is tried in another station");
    assert_eq!(after([2, 2, 2]), (false, vec![3, 4], vec![skipped(3), skipped(4)]), "they waited in this one");
    waiting.child.kill().unwrap();
    waiting.child.wait().unwrap();
}
