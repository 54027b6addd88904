//! Promise of the Main Loop about what moves while it is cut: by the masses of its model it has the momentum after the cut that it had before.

use super::*;
use glam::{DVec3, Vec3};
use std::collections::BTreeSet;

/// How fast the tissue moves, m/s: a tenth of a millimetre in the whole stroke; and by which share of that some of it is faster, in waves, radians for each m.
const MOVES_M_S: Vec3 = Vec3::new(1e-3, 0.5e-3, -0.5e-3);
const FASTER: f32 = 0.25;
const WAVES_PER_M: f32 = 300.0;

/// A state in which all that is not held moves.
fn moving(world: &World, now: &[u64]) -> Vec<u64> {
    let velocity = |(node, rest_m): (usize, &[f32; 3])| {
        let wave = FASTER * (WAVES_PER_M * (rest_m[0] + rest_m[2])).sin();
        if world.model.is_held(node) { [0.0; 3] } else { ((1.0 + wave) * MOVES_M_S).to_array() }
    };
    let velocities_m_s: Vec<[f32; 3]> = world.model.rest_m().iter().enumerate().map(velocity).collect();
    let (range, mut state) = (place_of(now, 2), now.to_vec());
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut state);
    bytes[range].copy_from_slice(bytemuck::cast_slice(&velocities_m_s));
    state
}

/// The tets of the pathology, and its objects.
fn of_pathology(world: &World) -> (Vec<[u32; 4]>, BTreeSet<u32>) {
    let rest = &world.body.rest;
    let own = rest.tets.iter().zip(&rest.regions).filter(|(_, object)| world.case.is_pathology(&world.body, **object));
    own.map(|(tet, object)| (*tet, *object)).unzip()
}

/// Whether the pathology was one object and has other tets now, and nothing of it is burnt.
fn is_cut(before: &World, after: &World) -> bool {
    let ((tets, objects), (tets_now, _)) = (of_pathology(before), of_pathology(after));
    let volume_m3 = |world: &World| world.body.volume_where_m3(|object| world.case.is_pathology(&world.body, object));
    objects.len() == 1 && tets != tets_now && (volume_m3(after) / volume_m3(before) - 1.0).abs() < 1e-5
}

/// Mass of the pathology by the model, kg, and its momentum, kg·m/s.
fn momentum(world: &World, velocities_m_s: &[[f32; 3]]) -> (f64, DVec3) {
    let nodes: BTreeSet<u32> = of_pathology(world).0.into_iter().flatten().collect();
    nodes.into_iter().map(|node| node as usize).fold((0.0, DVec3::ZERO), |(mass_kg, momentum_kg_m_s), node| {
        let own_kg = f64::from(world.model.mass_kg()[node]);
        (mass_kg + own_kg, momentum_kg_m_s + own_kg * Vec3::from(velocities_m_s[node]).as_dvec3())
    })
}

#[test]
fn a_polyp_that_moves_has_the_momentum_after_each_cut_that_it_had_before() {
    let (station, pages, life, mut inbox) = begun("momentum");
    let mut main = engine(&station, &life, &mut inbox);
    let whole = Arc::clone(&main.world);
    let mut now = first_state(&mut main);
    let (mut cuts, mut most_share) = (0, 0.0f64);
    for tick in 1..=SWEEP {
        let before = Arc::clone(&main.world);
        let state = moving(&before, &now);
        now = fed(&mut main, &pages[1], &state, &sweeping(&whole, tick));
        if is_cut(&before, &main.world) {
            let from_m_s: &[[f32; 3]] =
                Message::parse(bytemuck::cast_slice(&state), Kind::TissueState).unwrap().section(2).unwrap();
            let (had_kg, had) = momentum(&before, from_m_s);
            let (has_kg, has) = momentum(&main.world, main.knife.moved().1);
            assert!(has.distance(had) <= 5e-5 * had.length(), "tick {tick}: {had} of {had_kg} kg became {has} of {has_kg} kg");
            most_share = most_share.max((has_kg / had_kg - 1.0).abs());
            cuts += 1;
        }
    }
    println!("in one of {cuts} cuts the polyp's mass became another one by {:.2} %", 100.0 * most_share);
    assert!(cuts > 1 && most_share > 1e-3, "{cuts} cuts, the mass became another one by {most_share}: nothing was tried");
    drop(main);
}
