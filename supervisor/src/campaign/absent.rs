//! Cells whose state does not come. A fault waits a minute for it: a hand that never touches, or has cut all that there is to cut, would cost a campaign as many
//! minutes as such a cell has faults. Promise: once three of them in a row have waited in vain, the others are skipped, in their station; and in every station,
//! once the three lie in two. They are through, and without a verdict.

use super::draw::Entry;
use super::outcome::{Ending, Outcome};
use std::collections::{BTreeMap, BTreeSet};

/// Faults of a cell in a row that wait in vain before the others are skipped: one or two do so by chance (2 of 312 hand-overs, in other cells each).
const MOST_IN_VAIN: usize = 3;

/// What is known of the cells of each arm whose last faults waited in vain.
#[derive(Debug, Default)]
pub(super) struct Absent {
    /// By arm and cell the runs of the stations in which they did, a number for each fault.
    waited: BTreeMap<(String, String), Vec<Option<usize>>>,
}

impl Absent {
    /// By the faults that are through, in their order.
    pub(super) fn of(outcomes: &[Outcome]) -> Absent {
        let mut absent = Absent::default();
        outcomes.iter().for_each(|outcome| absent.note(outcome, outcome.run));
        absent
    }

    /// Adds what came of a fault in the station of a run.
    pub(super) fn note(&mut self, outcome: &Outcome, run: Option<usize>) {
        let cell = (outcome.arm.clone(), outcome.cell.clone());
        match outcome.ending {
            Ending::NoState => self.waited.entry(cell).or_default().push(run),
            Ending::Skipped => {}
            Ending::Closed | Ending::Open | Ending::Refused => drop(self.waited.remove(&cell)),
        }
    }

    /// Why a fault is skipped in the station of a run; `None` if it is to be tried.
    pub(super) fn why_skipped(&self, entry: &Entry, run: usize) -> Option<String> {
        let waited = self.waited.get(&(entry.arm.clone(), entry.cell.clone()))?;
        let runs: BTreeSet<Option<usize>> = waited.iter().copied().collect();
        let is_everywhere = runs.len() > 1;
        let is_over = waited.len() >= MOST_IN_VAIN && (is_everywhere || runs.contains(&Some(run)));
        let place = if is_everywhere { "any station" } else { "this station" };
        is_over.then(|| {
            format!(
                "skipped: {} faults of {:?} in a row waited in vain for its state, which is waited for in {place} no more",
                waited.len(),
                entry.cell
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{draw, file};

    /// A hand that soon has nothing left to cut cost a minute for each fault that was to fall into a cut.
    #[test]
    fn a_cell_is_given_up_after_three_in_a_row_in_their_station_and_everywhere_once_they_lie_in_two() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\", \"console\"]\nstates = [\"contact\"]\ncount = 9\n";
        let plan = draw::plan(&file::parse("t", text).unwrap(), 1);
        let [fluid, console] = ["kill fluid in contact", "kill console in contact"]
            .map(|cell| plan.faults.iter().find(|entry| entry.cell == cell).unwrap());
        let is_skipped = |came: &[(usize, Ending)], entry: &Entry, run: usize| {
            let outcomes: Vec<Outcome> =
                came.iter().map(|(run, ending)| Outcome { run: Some(*run), ending: *ending, ..Outcome::of(fluid) }).collect();
            Absent::of(&outcomes).why_skipped(entry, run).is_some()
        };
        let [in_vain, done, skipped] = [Ending::NoState, Ending::Closed, Ending::Skipped];
        let three = [(4, in_vain), (4, in_vain), (4, in_vain)];
        assert_eq!([&three[..2], &three[..]].map(|came| is_skipped(came, fluid, 4)), [false, true]);
        assert!(!is_skipped(&three, fluid, 5), "another station may bring the state about");
        assert!(!is_skipped(&three, console, 4), "each cell has a state of its own");
        let in_two = [&three[..], &[(4, skipped), (5, in_vain)]].concat();
        assert_eq!([4, 5, 6].map(|run| is_skipped(&in_two, fluid, run)), [true; 3]);
        let came_again = [&three[..], &[(5, done), (5, in_vain), (6, in_vain)]].concat();
        assert!(!is_skipped(&came_again, fluid, 6), "two in a row");
        let other_arm = Entry { arm: "other".into(), ..fluid.clone() };
        assert!(!is_skipped(&in_two, &other_arm, 6), "where another hand may bring it about");
    }
}
