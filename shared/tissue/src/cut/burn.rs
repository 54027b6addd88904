//! The parts that a cut leaves, and those of them that are too small to be objects, which the wire burns.

use super::places::corners;
use super::{CutOptions, CutReport, Cuttable};
use hyst_mesh::{component_count, component_of_each_tet, renumber, signed_volume};

/// Counts the parts, and takes those away that are too small to be objects, if any has come free, and unless they are all that there is. Gives the new number
/// of each tet that is left, where something was burnt: the surface for the eye, which may be elsewhere, is yet to be rid of what lay there.
pub fn burn(tissue: &mut Cuttable, options: &CutOptions, report: &mut CutReport) -> Option<Vec<Option<u32>>> {
    let mut part = component_of_each_tet(&tissue.rest);
    let parts = component_count(&part);
    // What is large enough is not summed up further: no tet takes anything from it.
    let enough_m3 = if report.copied_nodes > 0 { options.min_piece_m3 } else { 0.0 };
    let mut volume_m3: Vec<f64> = vec![0.0; parts];
    for (tet, part) in tissue.rest.tets.iter().zip(&part) {
        let sum = &mut volume_m3[*part as usize];
        if *sum < enough_m3 {
            // Far from the wire some may be inverted.
            *sum += signed_volume(corners(&tissue.rest.positions_m, *tet)).abs();
        }
    }
    let least = volume_m3.iter().copied().fold(0.0, f64::max).min(enough_m3);
    report.parts = volume_m3.iter().filter(|volume| **volume >= least).count();
    report.burnt_m3 = volume_m3.iter().filter(|volume| **volume < least).sum();
    let mut number_of_tet = None;
    if report.parts < parts {
        let is_kept: Vec<bool> = part.iter().map(|part| volume_m3[*part as usize] >= least).collect();
        report.burnt_tets = is_kept.iter().filter(|kept| !**kept).count();
        tissue.note_burnt(&is_kept);
        number_of_tet = Some(renumber(&is_kept));
        retain(&mut tissue.rest.tets, &is_kept);
        retain(&mut tissue.material, &is_kept);
        retain(&mut tissue.rest.regions, &is_kept);
        retain(&mut part, &is_kept);
        // The parts that are left stay in their order, which is that of their first tets.
        let is_left: Vec<bool> = volume_m3.iter().map(|volume| *volume >= least).collect();
        let number = renumber(&is_left);
        part.iter_mut().for_each(|part| *part = number[*part as usize].unwrap_or_default());
    }
    tissue.part_of_tet = part;
    number_of_tet
}

fn retain<T>(list: &mut Vec<T>, is_kept: &[bool]) {
    let mut kept = is_kept.iter().copied();
    list.retain(|_| kept.next().unwrap_or(true));
}
