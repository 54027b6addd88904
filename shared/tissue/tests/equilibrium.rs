//! Promise of the forces that hold a model at a shape: there nothing moves, from the shape at rest they lead to it and without them it comes back, without
//! gaining energy; what the shape presses together is left out, and counted; no instruction set makes a difference.

mod common;

use common::{Body, block, options};
use hyst_tissue::{Isa, Material, Model, Options, holding_forces};

/// Edge of the block's cubes, m, of which it has four along each axis.
const EDGE_M: f32 = 0.003;

/// A block that stands on a face that is held.
fn standing(isa: Isa, poisson_ratio: f64) -> Body {
    let mesh = block([4, 4, 4], EDGE_M);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|place| place[2] == 0.0).collect();
    let material = Material::new(30_000.0, poisson_ratio, 1050.0, 60.0).unwrap();
    Body::new(Model::new(&mesh, &fixed, &material, Options { isa, ..options() }).unwrap().0)
}

/// The block sheared along y and stretched along z, each the more the farther it is from x = 0.
fn shape_m(body: &Body, shear: f32, stretch: f32) -> Vec<[f32; 3]> {
    let moved = |[x, y, z]: [f32; 3]| {
        let more = 1.0 + 20.0 * x;
        [x, y + shear * more * z, z + stretch * more * z]
    };
    body.model.rest_m().iter().map(|place| moved(*place)).collect()
}

fn loads_n(body: &Body, shape_m: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut loads_n = vec![[0.0; 3]; shape_m.len()];
    assert_eq!(holding_forces(&body.model, shape_m, &mut loads_n), 0);
    loads_n
}

/// Largest distance between two places of the same node, m.
fn apart_m(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let distance_m = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f32>().sqrt();
    a.iter().zip(b).map(distance_m).fold(0.0, f32::max)
}

#[test]
fn at_the_shape_nothing_moves() {
    for (shear, stretch, poisson_ratio) in [(0.1, 0.03, 0.45), (0.4, 0.3, 0.45), (0.1, 0.03, 0.48), (0.4, 0.3, 0.48)] {
        let mut body = standing(Isa::detect(), poisson_ratio);
        let shape_m = shape_m(&body, shear, stretch);
        body.force_n = loads_n(&body, &shape_m);
        body.position_m.copy_from_slice(&shape_m);
        for _ in 0..200 {
            let report = body.step();
            assert_eq!((report.inverted_tets, report.corrections()), (0, 0));
        }
        let moved_m = apart_m(&body.position_m, &shape_m);
        assert!(moved_m < 2e-6, "ν = {poisson_ratio}, shear {shear}, stretch {stretch}: {moved_m} m");
    }
}

#[test]
fn loads_that_grow_lead_there_and_back_and_the_energy_is_that_of_the_shape_at_most() {
    let mut body = standing(Isa::detect(), 0.45);
    let (shape_m, rest_m) = (shape_m(&body, 0.3, 0.2), body.position_m.clone());
    let loads_n = loads_n(&body, &shape_m);
    let of_shape_j = {
        let mut there = Body::new(body.model.clone());
        there.position_m.copy_from_slice(&shape_m);
        there.step().elastic_energy_j
    };
    assert!(of_shape_j > 1e-4, "{of_shape_j} J: a shape that costs nothing shows nothing");
    // Up in 0.3 s, there for 0.5 s, down in 0.3 s and at rest for 0.5 s.
    let share = |tick: usize| (tick as f32 / 300.0).min(1.0).min(((1_100.0 - tick as f32) / 300.0).clamp(0.0, 1.0));
    let mut most_j = 0.0f64;
    for tick in 0..1_600 {
        body.force_n.iter_mut().zip(&loads_n).for_each(|(force, load)| *force = load.map(|part| share(tick) * part));
        let report = body.step();
        assert_eq!((report.inverted_tets, report.corrections()), (0, 0), "tick {tick}");
        most_j = most_j.max(report.elastic_energy_j);
        if tick == 799 {
            let away_m = apart_m(&body.position_m, &shape_m);
            assert!(away_m < 2e-5, "{away_m} m from the shape");
        }
    }
    // 1.03: by the ramp it swings a little beyond.
    assert!(most_j < 1.05 * of_shape_j, "{most_j} J, the shape has {of_shape_j}");
    let left_m = apart_m(&body.position_m, &rest_m);
    assert!(left_m < 2e-5 && body.energy_j() < 1e-9, "{left_m} m from rest, {} J", body.energy_j());
}

#[test]
fn what_a_shape_presses_together_or_does_not_name_is_left_out_and_counted() {
    let body = standing(Isa::detect(), 0.45);
    // The lowest corner goes outwards along the diagonal of its cube, by which all six tets there are stretched.
    let mut moved_m = body.position_m.clone();
    moved_m[0] = [-0.3 * EDGE_M; 3];
    let mut loads_n = vec![[0.0f32; 3]; moved_m.len()];
    assert_eq!(holding_forces(&body.model, &moved_m, &mut loads_n), 0);
    let sum_n = |axis: usize| loads_n.iter().map(|load| f64::from(load[axis])).sum::<f64>();
    assert!(loads_n[0].iter().all(|part| *part < -1e-2) && (0..3).all(|axis| sum_n(axis).abs() < 1e-5), "{:?}", loads_n[0]);
    // Inwards, and through the opposite corner, by which they are pressed together and turned inside out.
    for inwards in [0.3, 0.9, 1.1] {
        moved_m[0] = [inwards * EDGE_M; 3];
        let mut loads_n = vec![[0.0f32; 3]; moved_m.len()];
        assert_eq!(holding_forces(&body.model, &moved_m, &mut loads_n), 6, "{inwards}");
        assert!(loads_n.iter().all(|load| *load == [0.0; 3]), "{inwards}: the others are at rest");
    }
    let mut few_n = vec![[0.0f32; 3]; 10];
    assert!(holding_forces(&body.model, &body.position_m, &mut few_n) > 6, "most have a corner beyond ten");
    assert!(few_n.iter().all(|load| *load == [0.0; 3]));
}

#[test]
fn the_forces_are_those_of_any_instruction_set_to_the_bit() {
    for poisson_ratio in [0.45, 0.48] {
        let [own, plain] = [Isa::detect(), Isa::Baseline].map(|isa| {
            let body = standing(isa, poisson_ratio);
            loads_n(&body, &shape_m(&body, 0.3, 0.2))
        });
        assert!(own == plain && own.iter().any(|load| load[1].abs() > 1e-3), "ν = {poisson_ratio}");
    }
}
