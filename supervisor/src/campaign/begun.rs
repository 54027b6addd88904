//! Which faults are through. A line of `begun.jsonl` says what runs a station before its first fault, a line of `results.jsonl` is one of its faults, and one of
//! `stations.jsonl` what came of it as a whole. A station that was cut off (its campaign was killed, the disk took no more, the machine lost power) has none of
//! these last: what it applied, lost and left is not known. Promise: whoever judges a folder, faults of such a station are not through, and they come again.

use super::draw::Plan;
use super::origin::Origin;
use super::outcome::Outcome;
use super::station::StationOutcome;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A station that begins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Begun {
    /// Number of its run, from 0, which no other of the folder has.
    pub run: usize,
    /// Number of the station in the plan.
    pub station: usize,
    /// By what it is run.
    pub origin: Origin,
}

/// What is known of the faults of a folder.
#[derive(Debug)]
pub struct Parted {
    /// Those that are through, each once.
    pub through: Vec<Outcome>,
    /// Those of stations that were cut off, each once, but for the ones that are through since.
    pub cut: Vec<Outcome>,
}

/// Parts those of a plan; others are left out.
pub fn of_plan(plan: &Plan, mut outcomes: Vec<Outcome>, stations: &[StationOutcome]) -> Parted {
    outcomes.retain(|outcome| plan.faults.get(outcome.index).is_some_and(|entry| entry.cell == outcome.cell));
    part(outcomes, stations)
}

/// What is to be said of faults whose station was cut off; `None` if there are none.
pub fn told_of_cut(cut: &[Outcome]) -> Option<String> {
    let faults = match cut.len() {
        0 => return None,
        1 => "1 fault is".to_string(),
        count => format!("{count} faults are"),
    };
    Some(format!(
        "{faults} not through, although done: the station was cut off (its campaign was killed, the disk took no more, or the machine lost power), \
         so that nobody knows what else it did to the hand, lost or left; none is judged, and a run that goes on does them again"
    ))
}

/// Parts outcomes by whether their stations have ended.
pub fn part(outcomes: Vec<Outcome>, stations: &[StationOutcome]) -> Parted {
    let of_station = |station: &StationOutcome| station.through().map(|index| (station.run, index)).collect::<Vec<_>>();
    let ended: BTreeSet<(usize, usize)> = stations.iter().flat_map(of_station).collect();
    let ended_in_any: BTreeSet<usize> = ended.iter().map(|(_, index)| *index).collect();
    let is_of_ended = |outcome: &Outcome| outcome.run.is_some_and(|run| ended.contains(&(run, outcome.index)));
    let known: BTreeSet<usize> = outcomes.iter().filter(|outcome| is_of_ended(outcome)).map(|outcome| outcome.index).collect();
    // One that names no run is of a build that noted none: the line of a station is its own, unless another of the same fault names the station.
    let is_through = |outcome: &Outcome| match outcome.run {
        Some(_) => is_of_ended(outcome),
        None => ended_in_any.contains(&outcome.index) && !known.contains(&outcome.index),
    };
    let (mut through, mut cut): (Vec<Outcome>, Vec<Outcome>) = outcomes.into_iter().partition(is_through);
    let mut seen = BTreeSet::new();
    through.retain(|outcome| seen.insert(outcome.index));
    cut.retain(|outcome| seen.insert(outcome.index));
    Parted { through, cut }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::draw;
    use crate::campaign::file;
    use crate::campaign::store::Store;
    use crate::campaign::store::tests::reopened;
    use std::path::PathBuf;

    fn plan() -> Plan {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 4\n";
        draw::plan(&file::parse("t", text).unwrap(), 1)
    }

    fn outcome(plan: &Plan, index: usize, run: Option<usize>) -> Outcome {
        Outcome { run, ..Outcome::of(&plan.faults[index]) }
    }

    fn ended(run: usize, faults: &[usize], origin: Option<&Origin>) -> StationOutcome {
        StationOutcome { run, faults: faults.to_vec(), origin: origin.cloned(), ..StationOutcome::default() }
    }

    fn numbers(outcomes: &[Outcome]) -> Vec<(usize, Option<usize>)> {
        outcomes.iter().map(|outcome| (outcome.index, outcome.run)).collect()
    }

    #[test]
    fn a_fault_is_through_once_the_station_that_suffered_it_has_ended() {
        let plan = plan();
        let of = |runs: &[(usize, Option<usize>)], stations: &[StationOutcome]| {
            let parted = part(runs.iter().map(|(index, run)| outcome(&plan, *index, *run)).collect(), stations);
            (numbers(&parted.through), numbers(&parted.cut))
        };
        let cut: [(usize, Option<usize>); 2] = [(0, Some(0)), (1, Some(0))];
        assert_eq!(of(&cut, &[]), (vec![], cut.to_vec()));
        assert_eq!(of(&cut, &[ended(0, &[0, 1], None)]), (cut.to_vec(), vec![]));
        // Of those of a station that was cut off, one has come again in another.
        let again = [(0, Some(0)), (1, Some(0)), (0, Some(1))];
        assert_eq!(of(&again, &[ended(1, &[0], None)]), (vec![(0, Some(1))], vec![(1, Some(0))]));
        // And was cut off once more.
        assert_eq!(of(&again, &[]), (vec![], cut.to_vec()));
    }

    /// Results of builds that did not say which run a fault was of are as good as they were, unless it came again.
    #[test]
    fn faults_of_older_builds_are_through_if_any_station_had_them_and_none_has_had_them_since() {
        let plan = plan();
        let old = |index| outcome(&plan, index, None);
        let parted = part(vec![old(1), old(0), old(0), old(2)], &[ended(0, &[0, 1], None)]);
        assert_eq!(numbers(&parted.through), [(1, None), (0, None)]);
        assert_eq!(numbers(&parted.cut), [(2, None)], "its station was cut off");
        let parted = part(vec![old(2), outcome(&plan, 2, Some(1))], &[ended(1, &[2], None)]);
        assert_eq!((numbers(&parted.through), parted.cut.len()), (vec![(2, Some(1))], 0));
        let text = serde_json::to_string(&old(0)).unwrap();
        assert!(!text.contains("\"run\"") && serde_json::from_str::<Outcome>(&text).is_ok_and(|read| read == old(0)));
    }

    #[test]
    fn a_fault_that_was_skipped_is_through_with_its_station_which_did_not_suffer_it() {
        let plan = plan();
        let station = StationOutcome { skipped: vec![1], ..ended(0, &[0], None) };
        let parted = part([0, 1, 2].map(|index| outcome(&plan, index, Some(0))).into(), &[station]);
        assert_eq!((numbers(&parted.through), numbers(&parted.cut)), (vec![(0, Some(0)), (1, Some(0))], vec![(2, Some(0))]));
    }

    fn folder(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("hystation-{name}-{}", std::process::id()))
    }

    /// A campaign was killed in the middle of a station: its faults counted as through, and nobody knew what the station had done to the hand.
    #[test]
    fn a_station_that_was_cut_off_has_no_results_and_its_faults_come_again() {
        let (plan, folder) = (plan(), folder("cut-off"));
        let [own, another] = ["f00", "bad"].map(|build| Origin { build: build.into(), ..Origin::default() });
        let mut store = Store::open(Some(&folder), &plan).unwrap();
        assert_eq!((store.begin(0, &own).unwrap(), store.told_of_cut()), (0, None));
        store.add(outcome(&plan, 0, Some(0))).unwrap();
        store.add_station(ended(0, &[0], Some(&own))).unwrap();
        assert_eq!(store.begin(0, &own).unwrap(), 1);
        store.add(outcome(&plan, 1, Some(1))).unwrap();
        store.add(outcome(&plan, 2, Some(1))).unwrap();
        let recordings = [0, 1].map(|run| store.files(run).with_extension("mcap"));
        recordings.iter().for_each(|file| std::fs::write(file, "ticks").unwrap());
        drop(store); // killed
        let mut store = reopened(&folder, &plan).unwrap();
        assert_eq!((store.outcomes.len(), [0, 1, 2].map(|index| store.has(index))), (1, [true, false, false]));
        let told = store.told_of_cut().unwrap();
        assert!(told.starts_with("2 faults are not through") && told.contains("its campaign was killed"), "{told}");
        assert!(recordings.iter().all(|file| file.is_file()), "one who only judges removes nothing");
        assert_eq!(store.begin(0, &own).unwrap(), 2, "no run has the number of another");
        assert_eq!(recordings.map(|file| file.is_file()), [true, false], "half a recording is of no use");
        store.add(outcome(&plan, 1, Some(2))).unwrap();
        store.add_station(ended(2, &[1], Some(&own))).unwrap();
        drop(store);
        let store = reopened(&folder, &plan).unwrap();
        assert_eq!(numbers(&store.outcomes), [(0, Some(0)), (1, Some(2))]);
        assert!(store.told_of_cut().unwrap().starts_with("1 fault is not through"));
        assert!(store.check_build(&own).is_ok() && store.check_build(&another).is_err());
        drop(store);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// No line of a station said which build they were of, so that any other went on.
    #[test]
    fn faults_of_the_first_station_that_was_cut_off_are_of_the_build_that_began_it() {
        let (plan, folder) = (plan(), folder("cut-first"));
        let [own, another] = ["f00", "bad"].map(|build| Origin { build: build.into(), ..Origin::default() });
        let mut store = Store::open(Some(&folder), &plan).unwrap();
        store.begin(0, &own).unwrap();
        drop(store);
        let mut store = reopened(&folder, &plan).unwrap();
        assert!(store.check_build(&another).is_ok(), "nothing has come of it");
        let run = store.begin(0, &own).unwrap();
        store.add(outcome(&plan, 0, Some(run))).unwrap();
        drop(store);
        let store = reopened(&folder, &plan).unwrap();
        assert!(store.check_build(&own).is_ok());
        let refused = store.check_build(&another).unwrap_err();
        assert!(refused.code == 2 && refused.message.contains("its results are of build f00"), "{}", refused.message);
        drop(store);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// The line of a station that a machine without power wrote by half is none.
    #[test]
    fn half_a_line_of_a_station_leaves_its_faults_to_come_again_and_the_lines_before_it_as_they_are() {
        let (plan, folder) = (plan(), folder("cut-line"));
        let mut store = Store::open(Some(&folder), &plan).unwrap();
        for run in [0, 1] {
            assert_eq!(store.begin(0, &Origin::default()).unwrap(), run);
            store.add(outcome(&plan, run, Some(run))).unwrap();
            store.add_station(ended(run, &[run], Some(&Origin::default()))).unwrap();
        }
        drop(store);
        for name in ["begun.jsonl", "stations.jsonl"] {
            let path = folder.join(name);
            let text = std::fs::read_to_string(&path).unwrap();
            let first = text.split_inclusive('\n').next().unwrap();
            std::fs::write(&path, &text[..text.len() - 9]).unwrap();
            let mut store = reopened(&folder, &plan).unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), first);
            let is_cut = name == "stations.jsonl";
            assert_eq!([0, 1].map(|index| store.has(index)), [true, !is_cut], "{name}");
            assert_eq!(store.begin(0, &Origin::default()).unwrap(), if is_cut { 3 } else { 2 }, "no number twice");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
