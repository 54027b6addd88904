//! Of how many faults of each kind, done to each role, something was seen to come: what rests on fewer than twenty is said. Bytes that flip elsewhere are another
//! fault: nobody may read them in one place, and everybody in another.

use super::figures::Figures;
use crate::campaign::file::Campaign;
use std::collections::BTreeMap;

/// Faults of a kind, done to a role (in a place of it), that are to show.
const LEAST_SHOWN: usize = 20;

/// A line for each kind and role, and place, of which fewer showed, arm by arm, those of all its cells together.
pub(super) fn few(campaign: &Campaign, cells: &[Figures]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str, &str, &str), [usize; 2]> = BTreeMap::new();
    for figures in cells.iter().filter(|figures| figures.judged && figures.planned > 0) {
        let Some(cell) = campaign.cell(&figures.name) else { continue };
        let place = cell.injection.place.map_or("", |place| place.name());
        let sums = groups.entry((&figures.arm, cell.injection.kind.name(), cell.role(), place)).or_default();
        *sums = [sums[0] + figures.manifested, sums[1] + figures.planned];
    }
    let few = groups.iter().filter(|(_, [shown, _])| *shown < LEAST_SHOWN);
    few.map(|((arm, kind, role, place), [shown, planned])| {
        let place = if place.is_empty() { String::new() } else { format!(", {place}") };
        format!("arm {arm}: {kind} of {role}{place}: {shown} of {planned} showed, fewer than {LEAST_SHOWN}")
    })
    .collect()
}
