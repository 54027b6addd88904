//! Promise of the Main Loop about a mesh that hangs apart: its parts are objects from the beginning, those that nothing holds are free pieces, and a cut through
//! another part makes none of them and counts none of them.

use super::pieces::sunk;
use super::*;
use crate::knife::removed_m3;
use hyst_mesh::{TetMesh, component_of_each_tet};
use std::path::PathBuf;

/// Sides of the block that is held and of the one that is not, and how far along x that begins, m.
const HELD_M: f32 = 0.02;
const FREE_M: f32 = 0.01;
const APART_M: f32 = 0.04;
/// For how many ticks the tip presses, how deep, and how far the ring goes through the middle of the block then, m.
const PRESSES: u64 = 40;
const DEEP_M: f32 = 1e-3;
const THROUGH_M: f32 = 6e-3;
/// What the ring may cut off the block that is held, ml: the other one has 1 ml.
const CHIP_ML: f64 = 0.5;

/// Adds to a mesh a block of so many cubes along each side, of six tets each.
fn add_block(mesh: &mut TetMesh, x_m: f32, side_m: f32, cells: u32) {
    let first = mesh.positions_m.len() as u32;
    let id = |[x, y, z]: [u32; 3]| first + x + (cells + 1) * (y + (cells + 1) * z);
    let all = |count: u32| (0..count.pow(3)).map(move |at| [at % count, at / count % count, at / count / count]);
    let place_m = |at: [u32; 3]| at.map(|step| side_m * step as f32 / cells as f32);
    mesh.positions_m.extend(all(cells + 1).map(place_m).map(|[x, y, z]| [x_m + x, y, z]));
    for low in all(cells) {
        for way in [[0, 1], [1, 0], [1, 2], [2, 1], [0, 2], [2, 0]] {
            let mut corner = low;
            let between = way.map(|axis: usize| {
                corner[axis] += 1;
                id(corner)
            });
            mesh.tets.push([id(low), between[0], between[1], id(low.map(|step| step + 1))]);
        }
    }
}

/// A scene's folder, removed when its test ends.
struct Files(PathBuf);

impl Drop for Files {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0); // it lies where the system cleans up
    }
}

/// A scene of two blocks in one file: a pathology that is held at the far end of one of them.
fn blocks() -> Files {
    let mut mesh = TetMesh::default();
    add_block(&mut mesh, 0.0, HELD_M, 6);
    add_block(&mut mesh, APART_M, FREE_M, 3);
    let nodes = mesh.positions_m.iter().zip(1..).map(|([x, y, z], id)| format!("{id} {x} {y} {z}\n"));
    let tets = mesh.tets.iter().zip(1..).map(|(tet, id)| {
        let [a, b, c, d] = tet.map(|node| node + 1);
        format!("{id} 4 2 1 1 {a} {b} {c} {d}\n")
    });
    let text = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n{}$EndNodes\n$Elements\n{}\n{}$EndElements\n",
        mesh.positions_m.len(),
        nodes.collect::<String>(),
        mesh.tets.len(),
        tets.collect::<String>()
    );
    let files = Files(std::env::temp_dir().join(format!("hyst-tissue-{}-apart", std::process::id())));
    std::fs::create_dir_all(&files.0).unwrap();
    std::fs::write(files.0.join("blocks.msh"), text).unwrap();
    let scene = "version = 1\nname = \"t\"\n[[deformable]]\nname = \"blocks\"\nkind = \"pathology\"\nmesh = \"blocks.msh\"\n\
                 scale_to_m = 1.0\nfixed = [{ above_z_m = 0.0195 }]\n[[rigid]]\nname = \"scope\"\n";
    std::fs::write(files.0.join("scene.toml"), scene).unwrap();
    files
}

/// The parts that hang together, and the objects of tissue that are registered.
fn parts_and_objects(main: &MainLoop<'_>) -> [u32; 2] {
    let parts = component_of_each_tet(&main.world.body.rest).into_iter().max().map_or(0, |last| last + 1);
    // One is the instrument.
    [parts, main.site.present() - 1]
}

#[test]
fn of_two_blocks_in_one_file_the_one_that_nothing_holds_is_a_piece_before_the_other_is_cut_and_never_counts() {
    let files = blocks();
    let (station, pages) = founded("apart", &format!("workers = 0\nscene = {:?}", files.0.join("scene.toml")));
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
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
