//! Of how many faults of each kind, done to each role, something was seen to come: what rests on fewer than twenty is said. Bytes that flip elsewhere are another
//! fault: nobody may read them in one place, and everybody in another. So is a lie by one output alone, which has readers of its own, and a thread that helps.
//! A fault in whose recovery another one comes counts with those of its kind that come alone: who can open no file shows that when somebody else has died.

use super::figures::Figures;
use crate::campaign::cell::Cell;
use crate::campaign::file::Campaign;
use crate::faultfile::{FaultKind, Injection};
use hyst_messages::Role;
use std::collections::BTreeMap;

/// Faults of a kind, done to a role (to a part of it), that are to show.
const LEAST_SHOWN: usize = 20;

/// A line for each kind and role, and part of it, of which fewer showed, arm by arm, those of all its cells together.
pub(super) fn few(campaign: &Campaign, cells: &[Figures]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str, &str, String), [usize; 2]> = BTreeMap::new();
    let judged = cells.iter().filter(|figures| figures.judged && figures.planned > 0);
    let judged: Vec<(&Figures, &Cell)> = judged.filter_map(|figures| Some((figures, campaign.cell(&figures.name)?))).collect();
    for (figures, cell) in &judged {
        let sums = groups.entry(group(&figures.arm, &cell.injection)).or_default();
        *sums = [sums[0] + figures.manifested, sums[1] + figures.planned];
    }
    // What is there for the sake of a recovery alone is to show nothing of itself.
    for (figures, with) in judged.iter().filter_map(|(figures, cell)| Some((figures, cell.with.as_ref()?))) {
        if let Some(sums) = groups.get_mut(&group(&figures.arm, with)) {
            *sums = [sums[0] + figures.first_manifested, sums[1] + figures.planned];
        }
    }
    let few = groups.iter().filter(|(_, [shown, _])| *shown < LEAST_SHOWN);
    few.map(|((arm, kind, role, part), [shown, planned])| {
        format!("arm {arm}: {kind} of {role}{part}: {shown} of {planned} showed, fewer than {LEAST_SHOWN}")
    })
    .collect()
}

/// Arm, kind, role and part. A full /dev/shm is everybody's, whoever is named.
fn group<'a>(arm: &'a str, injection: &'a Injection) -> (&'a str, &'a str, &'a str, String) {
    let whom = if injection.kind == FaultKind::ShmFull { "all" } else { Role::name_in(&injection.target) };
    (arm, injection.kind.name(), whom, part(injection))
}

/// Where in a process alone it is done, in words to add; nothing of a fault of all of it.
fn part(injection: &Injection) -> String {
    let place = injection.place.map(|place| format!(", {}", place.name()));
    let output = injection.output.map(|output| format!(", output {}", output.name()));
    let thread = injection.thread.map(|helper| format!(", thread {}", helper.thread().name()));
    place.or(output).or(thread).unwrap_or_default()
}
