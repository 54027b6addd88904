//! Promise of a pressure that is a law: it pushes as one that is held for a step does, a closed surface is not moved by it as a whole, what it cannot be is
//! no pressure, and a soft wall comes to rest under it, which one that is held shakes apart.

mod common;

use common::{Body, block, noise, options};
use hyst_mesh::boundary;
use hyst_tissue::{Material, Model, Pressure, StepInput, StepReport, pressure_forces};

/// Less than that of the shape at rest, as much as the Main Loop takes.
const LOW_PA: f32 = -2_000.0;

/// A soft block, standing on a face that is held or free, and the triangles of its boundary without held nodes.
fn wall(is_held: bool, damping_per_s: f64) -> (Body, Vec<[u32; 3]>) {
    let mesh = block([5, 5, 3], 0.002);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|place| is_held && place[2] == 0.0).collect();
    let material = Material::new(9_000.0, 0.45, 1050.0, damping_per_s).unwrap();
    let (model, _) = Model::new(&mesh, &fixed, &material, options()).unwrap();
    let mut triangles = boundary(&mesh).triangles;
    triangles.retain(|triangle| triangle.iter().all(|node| !fixed[*node as usize]));
    (Body::new(model), triangles)
}

/// A step under a pressure as a law.
fn step_under(body: &mut Body, triangles: &[[u32; 3]], pressure_pa: f32, dt_s: f32) -> StepReport {
    body.step_with(&StepInput { pressure: Pressure { triangles, pressure_pa }, dt_s, ..StepInput::default() })
}

/// A step under the forces that the pressure has at its begin.
fn step_held(body: &mut Body, triangles: &[[u32; 3]], pressure_pa: f32, dt_s: f32) -> StepReport {
    let mut force_n = vec![[0.0; 3]; body.position_m.len()];
    let pressures_pa = vec![pressure_pa; triangles.len()];
    assert_eq!(pressure_forces(triangles, &body.position_m, &pressures_pa, &mut force_n), 0);
    body.step_with(&StepInput { external_force_n: &force_n, dt_s, ..StepInput::default() })
}

fn fastest_m_s(body: &Body) -> f32 {
    body.velocity_m_s.iter().flatten().fold(0.0, |most: f32, speed| most.max(speed.abs()))
}

#[test]
fn a_soft_wall_comes_to_rest_and_one_whose_forces_are_held_for_a_step_shakes() {
    let speeds_m_s = [step_under, step_held].map(|step| {
        let (mut body, triangles) = wall(true, 20.0);
        let mut random = noise(9);
        body.velocity_m_s.iter_mut().flatten().for_each(|speed| *speed = 0.01 * random());
        let corrections: u32 = (0..500).map(|_| step(&mut body, &triangles, LOW_PA, 1e-3).corrections()).sum();
        (fastest_m_s(&body), corrections)
    });
    println!("{speeds_m_s:?}");
    let [(law_m_s, corrections), (held_m_s, _)] = speeds_m_s;
    assert!(law_m_s < 0.05 && corrections == 0, "{law_m_s} m/s after 0.5 s, {corrections} corrections");
    assert!(held_m_s > 0.5, "held forces shake nothing here: {held_m_s} m/s, and the test shows nothing");
}

#[test]
fn it_pushes_as_one_that_is_held_does_for_a_short_time() {
    let [law, held] = [step_under, step_held].map(|step| {
        let (mut body, triangles) = wall(true, 0.0);
        // Bent, so that the triangles are not those of the shape at rest.
        body.position_m.iter_mut().for_each(|[x, y, z]| *x += 0.3 * *z + 10.0 * *y * *z);
        let bent = body.position_m.clone();
        let mut without = Body::new(body.model.clone());
        without.position_m.copy_from_slice(&bent);
        step(&mut body, &triangles, 500.0, 1e-6);
        without.step_with(&StepInput { dt_s: 1e-6, ..StepInput::default() });
        let pairs = body.velocity_m_s.iter().flatten().zip(without.velocity_m_s.iter().flatten());
        pairs.map(|(with, without)| with - without).collect::<Vec<f32>>()
    });
    let most = held.iter().fold(0.0f32, |most, speed| most.max(speed.abs()));
    assert!(most > 1e-5, "{most} m/s");
    let apart = law.iter().zip(&held).fold(0.0f32, |most, (law, held)| most.max((law - held).abs()));
    assert!(apart < 5e-3 * most, "{apart} m/s apart of {most} m/s");
}

#[test]
fn a_free_body_is_pressed_and_not_moved() {
    let (mut body, triangles) = wall(false, 0.0);
    for _ in 0..100 {
        assert_eq!(step_under(&mut body, &triangles, LOW_PA, 1e-3).corrections(), 0);
    }
    let mass_kg = body.model.mass_kg();
    let along =
        |axis: usize| body.velocity_m_s.iter().zip(mass_kg).map(|(v, mass)| f64::from(v[axis]) * f64::from(*mass)).sum::<f64>();
    let sizes = body.velocity_m_s.iter().flatten().map(|speed| f64::from(speed.abs())).sum::<f64>() / mass_kg.len() as f64;
    let swing = sizes * mass_kg.iter().map(|mass| f64::from(*mass)).sum::<f64>();
    for axis in 0..3 {
        assert!(along(axis).abs() < 1e-3 * swing, "axis {axis}: {} of {swing} kg·m/s", along(axis));
    }
}

#[test]
fn what_is_no_pressure_presses_nothing_and_triangles_without_their_nodes_are_left_out() {
    let (body, triangles) = wall(true, 20.0);
    let nodes = body.position_m.len() as u32;
    let after = |triangles: &[[u32; 3]], pressure_pa: f32| {
        let mut body = Body::new(body.model.clone());
        step_under(&mut body, triangles, pressure_pa, 1e-3);
        [body.position_m, body.velocity_m_s].concat()
    };
    let (still, pressed) = (after(&[], 0.0), after(&triangles, LOW_PA));
    assert!(still != pressed);
    for pressure_pa in [f32::NAN, f32::INFINITY, f32::MIN, 1e30] {
        assert!(after(&triangles, pressure_pa) == still, "{pressure_pa} Pa");
    }
    // The node behind the last one is there for tets that are none, and those far behind it are in no memory at all.
    let strange = [[0, 1, nodes], [nodes + 1, 2, 3], [u32::MAX; 3]];
    assert!(after(&[&triangles[..], &strange[..]].concat(), LOW_PA) == pressed);
}
