//! Promise of the Main Loop about tissue that is pressed into other tissue: it comes back on the side that it came from, also from beyond the middle of a thin
//! part, whoever goes on with it.

use super::pieces::{flow, sunk};
use super::slides::{CUBE, EDGE_M, engine_of, scene, stuck};
use super::*;
use glam::Vec3;

/// How far the cube is put to the side of where it is above the layer, m along x and z: there all of its lowest nodes are, below the layer's middle, in tets
/// that have a face on the far side.
const ASIDE_M: [f32; 2] = [0.7 * EDGE_M, 0.6 * EDGE_M];
/// How deep they are pressed into the layer, of which the thickness is an edge, m, and in how many ticks.
const DEEP_M: f32 = 0.6 * EDGE_M;
const PRESSES: u64 = 12;
/// Ticks after it was let go.
const GOES: u64 = 20;

/// A state in which the cube lies so deep in the layer, and all is at rest.
fn pressed(main: &MainLoop<'_>, state: &[u64], deep_m: f32) -> Vec<u64> {
    let (owners, rest_m) = (main.world.body.owners(), main.world.model.rest_m());
    let by_m = Vec3::new(ASIDE_M[0], -EDGE_M - deep_m, ASIDE_M[1]);
    let (places, velocities, mut state) = (place_of(state, 1), place_of(state, 2), state.to_vec());
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut state);
    bytes[velocities].fill(0);
    let positions_m: &mut [[f32; 3]] = bytemuck::cast_slice_mut(&mut bytes[places]);
    for (node, place_m) in positions_m.iter_mut().enumerate().filter(|(node, _)| owners[*node] == Some(CUBE)) {
        *place_m = (Vec3::from(rest_m[node]) + by_m).to_array();
    }
    state
}

#[test]
fn what_is_pressed_into_a_leaf_beyond_its_middle_comes_back_on_its_own_side_whoever_goes_on_with_it() {
    let (station, pages, life, mut inbox) = begun("leaves");
    let scene = scene("leaves");
    let [mut holder, mut successor] = [(); 2].map(|()| engine_of(&scene, &station, &life, &mut inbox));
    let mut now = first_state(&mut holder);
    for tick in 1..=PRESSES {
        let before = pressed(&holder, &now, tick as f32 / PRESSES as f32 * DEEP_M);
        now = flow(&mut holder, &pages[1], before.clone(), PieceFlow::default(), tick..tick + 1);
        if tick.is_multiple_of(4) {
            succeeds(&mut successor, tick, bytemuck::cast_slice(&before), &now);
        }
    }
    let up = stuck(&now).iter().filter(|stuck| stuck.owner == 0 && stuck.out[1] > 0.9).count();
    assert!((30..=36).contains(&up), "{up} of the 36 nodes in the layer remember that they came from above");
    let (share, from_m) = sunk(&holder, &now, CUBE);
    assert!(share > 0.1, "{share} of the cube's nodes are in the layer");
    let now = flow(&mut holder, &pages[1], now, PieceFlow::default(), PRESSES + 1..PRESSES + 1 + GOES);
    let (share, to_m) = sunk(&holder, &now, CUBE);
    let higher_m = (to_m - from_m).y;
    println!("{:.2} mm beyond the middle, {:.2} mm higher after {GOES} ms", 1e3 * (DEEP_M - 0.5 * EDGE_M), 1e3 * higher_m);
    assert!(share == 0.0 && higher_m > 0.0, "{share} of the cube's nodes are in the layer, the cube is {higher_m} m higher");
    drop((holder, successor));
}
