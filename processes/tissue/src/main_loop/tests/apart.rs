//! Promise of the Main Loop about a mesh that hangs apart: its parts are objects from the beginning, those that nothing holds are free pieces, and a cut through
//! another part makes none of them and counts none of them.

use super::lattice::{self, Lattice};
use super::pieces::sunk;
use super::*;
use crate::knife::removed_m3;
use hyst_mesh::{component_count, component_of_each_tet};

/// Edge of a cell, sides of the block that is held and of the one that is not, and how far along x that begins, m.
const EDGE_M: f32 = HELD_M / 6.0;
const HELD_M: f32 = 0.02;
const FREE_M: f32 = 0.01;
const APART_M: f32 = 0.04;
/// For how many ticks the tip presses, how deep, and how far the ring goes through the middle of the block then, m.
const PRESSES: u64 = 40;
const DEEP_M: f32 = 1e-3;
const THROUGH_M: f32 = 6e-3;
/// What the ring may cut off the block that is held, ml: the other one has 1 ml.
const CHIP_ML: f64 = 0.5;

/// A scene of two blocks in one file: a pathology that is held at the far end of one of them.
fn blocks() -> lattice::Folder {
    let [held, free, apart] = [HELD_M, FREE_M, APART_M].map(|side_m| (side_m / EDGE_M).round() as usize);
    let cells = Lattice { cells: [apart + free, held, held], edge_m: [EDGE_M; 3], low_m: [0.0; 3] };
    let is_there = |[x, y, z]: [usize; 3]| x < held || (x >= apart && y < free && z < free);
    lattice::scene_of("apart", "pathology", &cells, is_there, "{ above_z_m = 0.0195 }")
}

/// The parts that hang together, and the objects of tissue that are registered.
fn parts_and_objects(main: &MainLoop<'_>) -> [u32; 2] {
    let parts = component_count(&component_of_each_tet(&main.world.body.rest));
    // One is the instrument.
    [parts as u32, main.site.present() - 1]
}

#[test]
fn of_two_blocks_in_one_file_the_one_that_nothing_holds_is_a_piece_before_the_other_is_cut_and_never_counts() {
    let files = blocks();
    let (station, pages, life, mut inbox) = begun_with(1, "apart", &format!("workers = 0\nscene = {:?}", files.scene()));
    let [mut main, mut successor] = [(); 2].map(|()| engine(&station, &life, &mut inbox));
    let first = Arc::clone(&main.world);
    let free: Vec<u32> = first.objects.iter().filter(|object| object.is_free_piece()).map(|object| object.id).collect();
    assert_eq!((&free[..], first.drifters.len(), first.version), (&[1][..], 1, successor.world.version));
    assert!(first.case.is_loose_in_scene(1) && !first.case.is_loose_in_scene(0), "it is removed when it leaves");
    assert_eq!(parts_and_objects(&main), [2; 2]);
    let mut now = first_state(&mut main);
    let from_m = sunk(&main, &now, 1).1;

    let electrode = first.case.electrode.as_ref().expect("the default instrument has a loop");
    let (middle_m, mut contacts) = (0.5 * HELD_M, 0);
    for tick in 1..=PRESSES + SWEEP {
        let mut record = InputRecord { tick, ..InputRecord::default() };
        record.sample.pose.orientation = [0.0, 0.0, 0.0, 1.0];
        if tick <= PRESSES {
            record.sample.pose.position_m = [middle_m, middle_m, DEEP_M];
        } else {
            let gone_m = ((tick - PRESSES) as f32 / SWEEP as f32 - 0.5) * THROUGH_M;
            record.sample.pose.position_m = [middle_m, middle_m - electrode.radius_m + gone_m, middle_m - electrode.reach_m];
            record.sample.controls.buttons = BUTTON_ENERGIZED | hyst_messages::BUTTON_EXTENDED;
            record.sample.controls.loop_extension_m = electrode.reach_m;
        }
        let before = now.clone();
        now = fed(&mut main, &pages[1], &now, &record);
        contacts += main.status.contact_count;
        if tick % 20 == 0 {
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
    }
    let core = core_of(&now);
    assert!(contacts > 0 && core.cuts > 0, "{contacts} contacts, {} cuts: nothing was tried", core.cuts);
    let [parts, objects] = parts_and_objects(&main);
    assert!(parts == objects && parts >= 2, "{parts} parts, {objects} objects");
    let missing_ml = 1e6 * removed_m3(&first, &main.world);
    println!("{} cuts, {parts} parts, {missing_ml} ml came off the block that is held", core.cuts);
    assert!(missing_ml < CHIP_ML && (core.removed_volume_ml - missing_ml).abs() < 1e-4, "{} ml", core.removed_volume_ml);
    assert!(main.world.objects[1].is_free_piece() && main.world.body.volume_of_m3(1) == first.body.volume_of_m3(1));
    let sunk_m = from_m.y - sunk(&main, &now, 1).1.y;
    assert!(sunk_m > 1e-5, "what nothing holds sinks from the beginning, {sunk_m} m");
    drop((main, successor));
}
