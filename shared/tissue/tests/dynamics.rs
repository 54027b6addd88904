//! Motion: what is conserved, what is bounded, what is repeated bit for bit.

mod common;

use common::{Body, block, noise, options};
use hyst_tissue::{Isa, Material, Model, Options, PlaneSpring, StepInput};

fn free_body(damping_per_s: f64) -> Body {
    let mesh = block([4, 3, 3], 0.003);
    let material = Material::new(10_000.0, 0.45, 1000.0, damping_per_s).unwrap();
    Body::new(Model::new(&mesh, &vec![false; mesh.positions_m.len()], &material, options()).unwrap().0)
}

fn momentum(body: &Body) -> [f64; 3] {
    [0, 1, 2].map(|axis| {
        let parts = body.velocity_m_s.iter().zip(body.model.mass_kg());
        parts.map(|(v, &mass)| f64::from(v[axis]) * f64::from(mass)).sum()
    })
}

/// Angular momentum about the origin along z.
fn spin(body: &Body) -> f64 {
    let parts = body.position_m.iter().zip(&body.velocity_m_s).zip(body.model.mass_kg());
    parts.map(|((x, v), &mass)| f64::from(mass) * (f64::from(x[0]) * f64::from(v[1]) - f64::from(x[1]) * f64::from(v[0]))).sum()
}

fn rotate_z(angle: f32, p: [f32; 3]) -> [f32; 3] {
    let (sin, cos) = angle.sin_cos();
    [cos * p[0] - sin * p[1], sin * p[0] + cos * p[1], p[2]]
}

#[test]
fn momentum_of_a_free_body_is_conserved() {
    let mut body = free_body(0.0);
    let mut random = noise(7);
    body.velocity_m_s.iter_mut().flatten().for_each(|v| *v = 0.1 + 0.3 * random());
    let before = momentum(&body);
    for _ in 0..300 {
        assert_eq!(body.step().capped_nodes, 0);
    }
    let mass: f64 = body.model.mass_kg().iter().map(|&m| f64::from(m)).sum();
    for (before, after) in before.iter().zip(momentum(&body)) {
        assert!((before - after).abs() < 1e-5 * mass, "momentum {before} became {after} kg·m/s");
    }
}

#[test]
fn a_turning_body_keeps_turning() {
    let mut body = free_body(0.0);
    let centre = [0.006, 0.0045, 0.0045];
    for (position, velocity) in body.position_m.iter().zip(&mut body.velocity_m_s) {
        *velocity = [-5.0 * (position[1] - centre[1]), 5.0 * (position[0] - centre[0]), 0.0];
    }
    let before = spin(&body);
    for _ in 0..300 {
        body.step();
    }
    let kept = spin(&body) / before;
    assert!((0.97..1.01).contains(&kept), "{kept} of the spin is left after 1.5 rad");
}

#[test]
fn energy_of_an_undamped_body_stays_bounded() {
    let mut body = free_body(0.0);
    let mut random = noise(3);
    body.position_m.iter_mut().flatten().for_each(|x| *x += 0.0003 * random());
    let start = body.energy_j();
    let mut end = start;
    for tick in 0..2000 {
        body.step();
        if tick % 20 == 0 {
            end = body.energy_j();
            assert!(end < 1.001 * start, "tick {tick}: {end} J, started with {start} J");
        }
    }
    assert!(end < 0.8 * start && end > 0.1 * start, "{end} J after 2 s, started with {start} J");
}

#[test]
fn a_rigid_rotation_makes_no_force() {
    for angle in [0.3, 1.6, 3.1] {
        let mut body = free_body(0.0);
        body.position_m.iter_mut().for_each(|p| *p = rotate_z(angle, *p));
        let report = body.step();
        let fastest = body.velocity_m_s.iter().flatten().fold(0.0f32, |a, v| a.max(v.abs()));
        // 1 µm of stretch over an edge of 3 mm gives about 3e-3 m/s here; single precision leaves a few nm.
        assert!(fastest < 5e-5, "angle {angle}: {fastest} m/s after a step");
        assert!(report.elastic_energy_j < 1e-12, "angle {angle}: {} J", report.elastic_energy_j);
    }
}

fn shaken(isa: Isa) -> (Vec<[f32; 3]>, Vec<[f32; 3]>, f64) {
    let mesh = block([5, 4, 3], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, 10.0).unwrap();
    let (model, _) = Model::new(&mesh, &fixed, &material, Options { isa, ..options() }).unwrap();
    let mut body = Body::new(model);
    let mut random = noise(11);
    let mut energy = 0.0;
    for _ in 0..100 {
        body.force_n.iter_mut().flatten().for_each(|f| *f = 0.001 * random());
        energy = body.step().elastic_energy_j;
    }
    (body.position_m, body.velocity_m_s, energy)
}

#[test]
fn the_same_input_gives_the_same_bits() {
    for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
        assert_eq!(shaken(isa), shaken(isa), "{isa:?}");
    }
}

#[test]
fn wide_and_narrow_lanes_give_the_same_bits() {
    if Isa::Avx512.available() {
        assert_eq!(shaken(Isa::Avx2), shaken(Isa::Avx512));
    }
    // Without fused multiply-add the rounding differs, and nothing else.
    let (wide, baseline) = (shaken(Isa::detect()), shaken(Isa::Baseline));
    for (a, b) in wide.0.iter().flatten().zip(baseline.0.iter().flatten()) {
        assert!((a - b).abs() < 1e-6, "{a} and {b} m");
    }
}

#[test]
fn a_scratch_carries_nothing_from_step_to_step() {
    let (mut old, mut fresh) = (free_body(10.0), free_body(10.0));
    for _ in 0..5 {
        old.velocity_m_s[3] = [0.2, 0.1, -0.3];
        old.step();
    }
    fresh.position_m = old.position_m.clone();
    fresh.velocity_m_s = old.velocity_m_s.clone();
    old.step();
    fresh.step();
    assert_eq!((old.position_m, old.velocity_m_s), (fresh.position_m, fresh.velocity_m_s));
}

#[test]
fn mass_is_added_only_where_the_step_needs_it_and_is_reported() {
    let mut mesh = block([4, 4, 4], 0.003);
    let fixed = vec![false; mesh.positions_m.len()];
    let material = Material::new(10_000.0, 0.45, 1000.0, 0.0).unwrap();
    let (_, even) = Model::new(&mesh, &fixed, &material, options()).unwrap();
    assert_eq!((even.added_mass_kg, even.scaled_nodes), (0.0, 0));
    assert!((even.mass_kg - 1.728e-3).abs() < 1e-8 && even.substeps <= 8, "{even:?}");
    mesh.positions_m[62][0] += 0.0025; // squeezes the cells beside one inner node
    let narrow = Options { max_substeps: even.substeps, ..options() };
    let (_, squeezed) = Model::new(&mesh, &fixed, &material, narrow).unwrap();
    assert!(squeezed.scaled_nodes > 0 && squeezed.scaled_nodes < 20, "{squeezed:?}");
    assert!(squeezed.added_mass_kg < 0.2 * squeezed.mass_kg && squeezed.substeps == even.substeps, "{squeezed:?}");
    let refused = Model::new(&mesh, &fixed, &material, Options { max_added_mass_ratio: 1e-6, ..narrow });
    assert!(refused.is_err());
}

#[test]
fn contacts_up_to_the_stated_stiffness_are_stable() {
    let mesh = block([3, 3, 3], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, 60.0).unwrap();
    let stiff = Options { contact_stiffness_n_m: 2000.0, max_substeps: 64, ..options() };
    let mut body = Body::new(Model::new(&mesh, &fixed, &material, stiff).unwrap().0);
    let top = mesh.positions_m.iter().position(|p| *p == [0.003, 0.003, 0.009]).unwrap() as u32;
    // Five times too stiff together: softened to what was stated.
    let spring = PlaneSpring {
        nodes: [top; 4],
        weights: [1.0, 0.0, 0.0, 0.0],
        normal: [0.0, 0.0, -1.0],
        offset_m: -0.008,
        stiffness_n_m: 5000.0,
    };
    let springs = [spring, spring];
    for _ in 0..1000 {
        let report = body.step_with(&StepInput {
            external_force_n: &[],
            targets_m: &[],
            springs: &springs,
            pairs: &[],
            attachments: &[],
            dt_s: 1e-3,
        });
        assert_eq!((report.softened_springs, report.ignored_springs, report.recovered_nodes), (2, 0, 0));
    }
    let depth = body.position_m[top as usize][2] - 0.008;
    assert!((0.0..0.0002).contains(&depth), "the node stands {depth} m above the plane that pushes it down to 8 mm");
    let speed = body.velocity_m_s[top as usize][2].abs();
    assert!(speed < 1e-3, "the contact rattles at {speed} m/s");
}

#[test]
fn held_nodes_are_at_their_targets_and_carry_the_tissue_along() {
    let mesh = block([3, 3, 3], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, 60.0).unwrap();
    let mut body = Body::new(Model::new(&mesh, &fixed, &material, options()).unwrap().0);
    for tick in 1..=400 {
        let shift = 1e-5 * tick.min(200) as f32;
        let targets: Vec<[f32; 3]> = mesh.positions_m.iter().map(|p| [p[0] + shift, p[1], p[2]]).collect();
        body.step_with(&StepInput {
            external_force_n: &[],
            targets_m: &targets,
            springs: &[],
            pairs: &[],
            attachments: &[],
            dt_s: 1e-3,
        });
        for node in (0..targets.len()).filter(|&node| fixed[node]) {
            assert_eq!(body.position_m[node], targets[node], "tick {tick}, node {node}");
        }
    }
    let moved = body.position_m[63][0] - mesh.positions_m[63][0];
    assert!((moved - 0.002).abs() < 2e-5, "the free end moved by {moved} m");
}
