//! Bad engines: each is rolled back for a cause that is its own, and the hand does not notice. As many swaps to them are made as `HYSTATION_BAD_SWAPS` says, one
//! kind after the other, of each role in turn, and then from the beginning.

use super::costs::Costs;
use super::{ROLES, TRIES, number_of};
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::swapped::{assert_left_nobody, got_no_time, swap};
use station_tests::{DEVICE_TICKS, Station, bad_engine};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Role, kind, causes, words.
type Case = (&'static str, &'static str, &'static [&'static str], &'static str);

const STANDS: &[&str] = &["hung", "missed", "late"];
/// One that is tried in the old one's place may be missed by who reads it, or by who compares it, before it is known that it stands.
const STANDS_IN_PLACE: &[&str] = &["hung", "missed", "late", "out-of-tolerance", "refused"];
/// On full cores one does not beat for long before it is gone.
const DIES: &[&str] = &["died", "hung"];
/// Bad engines: each with the causes that are its own, and words of the reason, unless its readers were first. One that stands still is found by its heartbeat, or by what is missed of it.
const BAD: [Case; 46] = [
    ("tissue", "start", &["died"], ""),
    ("tissue", "shadow-off", &["out-of-tolerance"], ""),
    ("tissue", "shadow-segfault", DIES, ""),
    ("tissue", "panic", DIES, ""),
    ("tissue", "exit", DIES, ""),
    ("tissue", "spin", STANDS, ""),
    ("tissue", "slow", &["missed", "slow"], "its steps"),
    ("tissue", "sluggish", &["slow", "missed", "not-compared"], ""),
    ("tissue", "nan", &["refused", "out-of-tolerance"], ""),
    ("tissue", "off", &["out-of-tolerance", "refused"], ""),
    ("tissue", "numb", &["out-of-tolerance", "refused"], "contact force"),
    ("tissue", "frozen", &["refused", "out-of-tolerance"], ""),
    ("tissue", "epoch", &["refused", "out-of-tolerance"], ""),
    ("tissue", "leak", &["unfit"], "it grows"),
    ("fluid", "stop", STANDS, ""),
    ("fluid", "slow", &["missed", "slow"], "its steps"),
    ("fluid", "garbage", &["refused", "out-of-tolerance"], ""),
    ("fluid", "off", &["out-of-tolerance"], ""),
    ("fluid", "frozen", &["refused", "out-of-tolerance"], ""),
    ("fluid", "stuck", &["not-ready"], "become ready"),
    ("fluid", "babble", &["unfit"], "floods its log"),
    ("haptic", "abort", DIES, ""),
    ("haptic", "stop", STANDS, ""),
    ("haptic", "off", &["out-of-tolerance", "refused"], "from the other servo's"),
    ("haptic", "slow", &["late", "slow", "not-compared"], ""),
    ("collision-worker", "segfault", DIES, ""),
    ("collision-worker", "blind", &["refused"], ""),
    // What it has started, as it was asked what it is and as it began, ends with it.
    ("collision-worker", "forks", DIES, ""),
    ("collision-worker", "stop", STANDS_IN_PLACE, ""),
    ("collision-worker", "slow", &["late", "slow", "hung", "refused"], ""),
    ("recorder", "exit", DIES, ""),
    ("recorder", "stop", STANDS_IN_PLACE, ""),
    ("recorder", "mute", &["out-of-tolerance"], "its page"),
    ("recorder", "liar", &["out-of-tolerance"], "its file"),
    ("recorder", "forgets", &["out-of-tolerance"], "its file"),
    ("rendering", "mute", &["out-of-tolerance"], "its page"),
    ("rendering", "black", &["out-of-tolerance"], "all of one colour"),
    ("rendering", "still", &["out-of-tolerance"], "stand still"),
    ("rendering", "slow", &["slow"], "steps a second"),
    ("rendering", "stop", STANDS_IN_PLACE, ""),
    ("console", "mute", &["out-of-tolerance"], "its page"),
    ("console", "stop", STANDS_IN_PLACE, ""),
    ("device", "abort", DIES, ""),
    ("device", "stop", STANDS_IN_PLACE, ""),
    ("device", "slow", &["hung", "slow", "late", "missed", "out-of-tolerance"], ""),
    ("device", "half", &["out-of-tolerance"], "the motors' force"),
];

/// The same that leave a recording as nobody wants it: in a station of their own.
const SPOILING: [Case; 2] =
    [("recorder", "skips", &["out-of-tolerance"], "leaves out"), ("recorder", "anew", &["out-of-tolerance"], "before it came")];

/// Bad engines that end as another one of the list does, or take a minute to: shown where many swaps are asked for alone.
const AS_THE_OTHERS: [(&str, &str); 21] = [
    ("tissue", "start"),
    ("tissue", "panic"),
    ("tissue", "exit"),
    ("tissue", "spin"),
    ("tissue", "off"),
    ("fluid", "stop"),
    ("fluid", "slow"),
    ("fluid", "frozen"),
    ("fluid", "stuck"),
    ("haptic", "stop"),
    ("haptic", "slow"),
    ("rendering", "mute"),
    ("collision-worker", "segfault"),
    ("collision-worker", "stop"),
    ("collision-worker", "slow"),
    ("recorder", "exit"),
    ("rendering", "slow"),
    ("rendering", "stop"),
    ("console", "stop"),
    ("device", "stop"),
    ("device", "slow"),
];

/// The same, one of each role in turn: a run that is cut off has been at every role.
fn by_turns<'a>(cases: &[&'a Case]) -> Vec<&'a Case> {
    let turn = |at: &usize| cases[..*at].iter().filter(|before| before.0 == cases[*at].0).count();
    let mut order: Vec<usize> = (0..cases.len()).collect();
    order.sort_by_key(turn);
    order.into_iter().map(|at| cases[at]).collect()
}

#[test]
fn of_the_kinds_each_comes_once_in_a_round_and_every_role_at_its_beginning() {
    let order = by_turns(&BAD.iter().collect::<Vec<_>>());
    let roles: BTreeSet<&str> = order.iter().take(ROLES.len()).map(|case| case.0).collect();
    assert_eq!(roles, BTreeSet::from(ROLES), "{order:?}");
    let kinds = |of: &[&Case]| of.iter().map(|case| (case.0, case.1)).collect::<BTreeSet<_>>();
    assert_eq!((order.len(), kinds(&order).len()), (BAD.len(), BAD.len()), "each once");
    let mut of_role = BTreeMap::<&str, Vec<&str>>::new();
    order.iter().for_each(|case| of_role.entry(case.0).or_default().push(case.1));
    assert_eq!(of_role["fluid"], ["stop", "slow", "garbage", "off", "frozen", "stuck", "babble"], "as they are listed");
}

/// Swaps a role to a bad engine, again where the machine left that no time.
fn tried(station: &Station, role: &str, path: &Path) -> (Option<i32>, Value, String) {
    let mut tried = swap(station, role, path);
    for _ in 1..TRIES {
        if got_no_time(&tried.1) {
            station.recover();
            tried = swap(station, role, path);
        }
    }
    tried
}

/// What came of a swap to a bad engine: it is rolled back for a cause of its own.
fn assert_rolled_back(station: &Station, case: Case, (code, record, said): (Option<i32>, Value, String)) {
    let (role, kind, causes, words) = case;
    assert_eq!(code, Some(1), "{role} {kind}: {record:#}\n{said}\n{}", station.said());
    let why = record["reason"].as_str().unwrap_or_default();
    println!("{role} {kind}: {} ({why})", record["cause"]);
    let is_own =
        record["cause"].as_str().is_some_and(|cause| causes.contains(&cause) && (cause == "refused" || why.contains(words)));
    assert!(is_own || got_no_time(&record), "{role} {kind}: {record:#}\n{}", station.said());
    if !is_own {
        not_shown(&format!("why {role} {kind} is rolled back: {TRIES} times it got no time"));
    }
}

#[test]
fn bad_engines_of_many_kinds_are_rolled_back_and_nothing_of_theirs_is_applied() {
    let station = Station::start("bad", &["--hand", "script:press", "--test-mode"]);
    // Of those that nobody has counted one of each kind: every role refuses in its own way, and dies as the others do.
    let asked = number_of("HYSTATION_BAD_SWAPS");
    let is_another = |case: &&Case| asked.is_some() || !AS_THE_OTHERS.contains(&(case.0, case.1));
    let listed: Vec<&Case> = BAD.iter().filter(is_another).collect();
    let cases = if asked.is_some() { by_turns(&listed) } else { listed };
    let count = asked.unwrap_or(cases.len());
    // A device is swapped to the bad one and back to the good one.
    let mut costs = Costs::new("bad engines", 2.0 * DEVICE_TICKS, asked.is_some(), &station);
    for case in cases.into_iter().cycle().take(count).copied() {
        let (role, kind, ..) = case;
        let path = bad_engine(station.folder(), role, kind);
        let before = station.processes(role)[0]["binary"].clone();
        let result = costs.around(role, &station, || tried(&station, role, &path));
        assert_rolled_back(&station, case, result);
        station.recover();
        assert!(station.processes(role).iter().all(|process| process["binary"] == before), "{}", station.status());
        assert_left_nobody(&path);
    }
    costs.judge(&station);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
}

/// All that they wrote was right, and so they passed: nobody had looked at what they left out, nor at what they left of the file.
#[test]
fn a_recorder_that_spoils_what_was_recorded_or_leaves_out_what_lies_between_is_rolled_back() {
    let station = Station::start("spoilt", &["--hand", "script:press", "--test-mode"]);
    for case in SPOILING {
        let path = bad_engine(station.folder(), case.0, case.1);
        assert_rolled_back(&station, case, tried(&station, case.0, &path));
        station.recover();
    }
}
