//! What the campaigns that come with the station do while something else is under way, and that the page about faults names them all.

use super::tests::shipped;
use crate::campaign::cell::{Cell, State};
use crate::faultfile::{FaultKind, Keepers, Target, Which};
use hyst_messages::Role;
use std::collections::BTreeMap;
use std::path::Path;

/// Fewest faults of a family, done to somebody in a state, of which 20 show where a few do not.
const LEAST: usize = 24;
/// All states but those of a station in which nothing else is under way and nothing is touched.
const COURSES: [&str; 5] = ["contact", "cutting", "swap", "recovery", "handover"];

/// Which states a family of faults is done in, to whom, as the table of docs/faults.md says.
const DONE: [(&str, &str, &[&str]); 11] = [
    ("ends", "active", &COURSES),
    ("ends", "spare", &COURSES),
    ("ends", "newcomer", &["swap"]),
    ("hangs", "active", &COURSES),
    ("hangs", "spare", &["contact"]),
    ("hangs", "newcomer", &["swap"]),
    ("slows", "active", &["contact", "swap", "recovery", "handover"]),
    ("lies", "active", &COURSES),
    ("lies", "spare", &["contact", "recovery"]),
    ("lies", "newcomer", &["swap"]),
    ("leaks", "active", &["contact", "swap", "recovery"]),
];

/// Those of a family stand for each other where something else is under way; of the others the page says why they are done beside nothing.
fn family(kind: FaultKind) -> Option<&'static str> {
    use FaultKind::{Abort, Block, Exit0, Exit1, Kill, LeakFiles, LeakLoans, LeakMemory, Oom, Panic, Segfault, Slow, Spin, Stop};
    match kind {
        Kill | Segfault | Abort | Exit0 | Exit1 | Panic | Oom => Some("ends"),
        Stop | Block | Spin => Some("hangs"),
        Slow => Some("slows"),
        LeakMemory | LeakFiles | LeakLoans => Some("leaks"),
        kind if kind.is_lie() => Some("lies"),
        _ => None,
    }
}

fn whom(target: &str) -> &'static str {
    match Target::parse(target).map(|target| target.which) {
        Some(Which::Spare) => "spare",
        Some(Which::Both) => "both",
        Some(Which::Newcomer) => "newcomer",
        _ if Keepers::parse(target).is_some() => "keepers",
        _ => "active",
    }
}

/// Spares were hurt at any moment and next to never in a state, and nobody could say which family was done in which.
#[test]
fn each_family_of_faults_is_done_in_the_states_that_the_page_says_and_in_no_other() {
    let mut counts = BTreeMap::<(&str, &str, &str), usize>::new();
    for cell in shipped().iter().flat_map(|campaign| &campaign.cells) {
        let state = State::ALL.iter().find(|(state, _)| *state == cell.state).map(|(_, name)| *name);
        if let Some((family, state)) = family(cell.injection.kind).zip(state).filter(|(_, state)| COURSES.contains(state)) {
            *counts.entry((family, whom(&cell.injection.target), state)).or_default() += cell.count;
        }
    }
    for (family, whom, states) in DONE {
        let found = COURSES.map(|state| counts.remove(&(family, whom, state)).unwrap_or(0));
        let expected = COURSES.map(|state| states.contains(&state));
        assert_eq!(found.map(|count| count >= LEAST), expected, "{family} {whom}: {found:?}");
    }
    let others: Vec<_> = counts.keys().filter(|(_, whom, _)| !["both", "keepers"].contains(whom)).collect();
    assert!(others.is_empty(), "{others:?}");
}

#[test]
fn the_page_about_faults_names_each_campaign_with_its_number_of_faults() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/faults.md");
    let page = std::fs::read_to_string(page).unwrap();
    for campaign in shipped() {
        let faults = campaign.faults();
        let number = if faults < 1_000 { faults.to_string() } else { format!("{} {:03}", faults / 1_000, faults % 1_000) };
        let is_named = |line: &str| {
            line.contains(&format!("campaigns/{}.toml --report", campaign.name)) && line.contains(&format!("# {number}"))
        };
        assert!(page.lines().any(is_named), "{}: {number}", campaign.name);
    }
}

/// Whose successors each role has to open, in a page or by a stream (`interests` of the engines): where one of these dies, who can open no file shows it.
const OPENED_BY: [(&str, &[&str]); 8] = [
    ("device", &["haptic", "tissue", "fluid"]),
    ("haptic", &["haptic", "device"]),
    ("tissue", &["device", "haptic", "tissue", "fluid", "collision-worker", "rendering", "recorder"]),
    ("fluid", &["tissue", "fluid"]),
    ("collision-worker", &["tissue"]),
    ("rendering", &["device", "tissue", "fluid", "recorder", "console"]),
    ("recorder", &["device", "haptic", "tissue", "fluid", "rendering"]),
    ("console", &["tissue", "fluid", "rendering"]),
];

/// A servo could open no file while a tissue died, whose page it never opens: of 24 of each of most roles nobody noticed one, and of the rest few.
#[test]
fn who_can_open_no_file_has_somebody_to_open_often_enough_to_show_it() {
    let all = shipped();
    let cells = || all.iter().flat_map(|campaign| &campaign.cells);
    for (role, opened) in OPENED_BY {
        let beside = |cell: &&Cell| {
            let with = cell.with.as_ref().filter(|with| with.kind == FaultKind::NoFiles);
            with.is_some_and(|with| Role::name_in(&with.target) == role)
        };
        let deaths: Vec<(&str, usize)> = cells().filter(beside).map(|cell| (cell.role(), cell.count)).collect();
        assert!(deaths.iter().all(|(whom, _)| opened.contains(whom)), "{role}: {deaths:?}");
        assert!(deaths.iter().map(|(_, count)| count).sum::<usize>() >= LEAST, "{role}: {deaths:?}");
    }
    // A supervisor opens those whom it starts, and starts at once who has died once: the next one waits.
    let starts = |cell: &&Cell| {
        let is_hurt = cell.injection.kind == FaultKind::NoFiles && cell.injection.target == "supervisor";
        is_hurt && cell.with.as_ref().is_some_and(|with| with.kind == FaultKind::CrashLoop)
    };
    assert!(cells().filter(starts).map(|cell| cell.count).sum::<usize>() >= LEAST);
}
