//! Of how many faults of each kind, done to each role, something was seen to come: what rests on fewer than twenty is said.

use super::figures::Figures;
use crate::campaign::file::Campaign;
use std::collections::BTreeMap;

/// Faults of a kind, done to a role, that are to show.
const LEAST_SHOWN: usize = 20;

/// A line for each kind and role of which fewer showed, arm by arm, those of all its cells together.
pub(super) fn few(campaign: &Campaign, cells: &[Figures]) -> Vec<String> {
    let mut pairs: BTreeMap<(&str, &str, &str), [usize; 2]> = BTreeMap::new();
    for figures in cells.iter().filter(|figures| figures.judged && figures.planned > 0) {
        let Some(cell) = campaign.cell(&figures.name) else { continue };
        let (kind, role) = (cell.injection.kind.name(), cell.role());
        let sums = pairs.entry((&figures.arm, kind, role)).or_default();
        *sums = [sums[0] + figures.manifested, sums[1] + figures.planned];
    }
    let few = pairs.iter().filter(|(_, [shown, _])| *shown < LEAST_SHOWN);
    few.map(|((arm, kind, role), [shown, planned])| {
        format!("arm {arm}: {kind} of {role}: {shown} of {planned} showed, fewer than {LEAST_SHOWN}")
    })
    .collect()
}
