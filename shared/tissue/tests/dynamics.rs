//! Motion: what is conserved, what is bounded, what is repeated bit for bit.

mod common;

use common::{Body, block, noise, options};
use hyst_tissue::{ContactLaw, Isa, Material, Model, ModelError, Options, PlaneSpring, Push, StateRef, StepInput, gather};

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

/// Poisson's ratios of the lower third of a block and of the rest: of tets that hold their own volume, of such whose nodes do, and of both.
const PAIRS_OF_RATIOS: [[f64; 2]; 3] = [[0.45; 2], [0.48; 2], [0.45, 0.49]];

fn shaken(isa: Isa, poisson_ratios: [f64; 2]) -> (Vec<[f32; 3]>, Vec<[f32; 3]>, f64) {
    let mut mesh = block([5, 4, 3], 0.003);
    let is_above = |tet: &[u32; 4]| tet.iter().all(|node| mesh.positions_m[*node as usize][2] > 0.002);
    mesh.regions = mesh.tets.iter().map(|tet| u32::from(is_above(tet))).collect();
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let [below, above] = poisson_ratios.map(|ratio| Material::new(10_000.0, ratio, 1000.0, 10.0).unwrap());
    let options = Options { isa, ..options() };
    let (model, _) = Model::with_materials(&mesh, &fixed, &[(0, below), (1, above)], options).unwrap();
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
        for ratios in PAIRS_OF_RATIOS {
            assert_eq!(shaken(isa, ratios), shaken(isa, ratios), "{isa:?}, ν = {ratios:?}");
        }
    }
}

#[test]
fn wide_and_narrow_lanes_give_the_same_bits() {
    for ratios in PAIRS_OF_RATIOS {
        if Isa::Avx512.available() {
            assert_eq!(shaken(Isa::Avx2, ratios), shaken(Isa::Avx512, ratios), "ν = {ratios:?}");
        }
        // Without fused multiply-add the rounding differs, and nothing else.
        let (wide, baseline) = (shaken(Isa::detect(), ratios), shaken(Isa::Baseline, ratios));
        for (a, b) in wide.0.iter().flatten().zip(baseline.0.iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "ν = {ratios:?}: {a} and {b} m");
        }
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
    let made = |max_substeps| {
        let options = Options { max_added_mass_ratio: 1e-6, max_substeps, ..narrow };
        Model::new(&mesh, &fixed, &material, options).map(|(_, report)| report)
    };
    let refused = made(narrow.max_substeps);
    let Err(ModelError::TooStiff { unscaled_substeps, enough_substeps, .. }) = refused else { panic!("{refused:?}") };
    assert!(enough_substeps > narrow.max_substeps && enough_substeps <= unscaled_substeps, "{refused:?}");
    assert!(made(enough_substeps).is_ok() && made(enough_substeps - 1).is_err(), "{refused:?}");
}

/// A block that stands on its lower side, and two contacts at a node of the upper side, together five times as stiff as was stated.
fn pressed() -> (Body, u32, [PlaneSpring; 2]) {
    let mesh = block([3, 3, 3], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, 60.0).unwrap();
    let stiff = Options { contact_stiffness_n_m: 2000.0, max_substeps: 64, ..options() };
    let body = Body::new(Model::new(&mesh, &fixed, &material, stiff).unwrap().0);
    let top = mesh.positions_m.iter().position(|p| *p == [0.003, 0.003, 0.009]).unwrap() as u32;
    let spring = PlaneSpring {
        nodes: [top; 4],
        weights: [1.0, 0.0, 0.0, 0.0],
        normal: [0.0, 0.0, -1.0],
        offset_m: -0.008,
        velocity_m_s: [0.0; 3],
        sticks_at_m: [0.0035, 0.003, 0.009],
        stiffness_n_m: 5000.0,
    };
    (body, top, [spring; 2])
}

fn in_contact(springs: &[PlaneSpring], damping_s: f32) -> StepInput<'_> {
    let law = ContactLaw { damping_s, ..ContactLaw::default() };
    StepInput { springs, law, ..StepInput::default() }
}

#[test]
fn contacts_up_to_the_stated_stiffness_are_stable_however_much_damping_is_asked_for() {
    for (damping_s, friction) in
        [(0.0, 0.0), (6e-4, 0.0), (1e9, 0.0), (f32::NAN, 0.0), (0.0, 0.05), (6e-4, 0.05), (6e-4, 0.3), (1e9, 0.3)]
    {
        let (mut body, top, springs) = pressed();
        for _ in 0..1000 {
            // They are softened to what was stated. With friction what sticks is half a millimetre aside.
            let law = ContactLaw { friction, ..in_contact(&springs, damping_s).law };
            let report = body.step_with(&StepInput { law, ..in_contact(&springs, damping_s) });
            assert_eq!((report.softened_springs, report.ignored_springs, report.recovered_nodes), (2, 0, 0));
        }
        let depth = body.position_m[top as usize][2] - 0.008;
        // Drawn aside it goes down, too.
        let lowest_m = if friction > 0.0 { -0.0002 } else { 0.0 };
        assert!((lowest_m..0.0002).contains(&depth), "the node stands {depth} m above the plane that pushes it down to 8 mm");
        let speed = body.velocity_m_s[top as usize][2].abs();
        println!("damping {damping_s} s, friction {friction}: {depth} m, {speed} m/s");
        assert!(speed < 1e-3, "the contact rattles at {speed} m/s with a damping of {damping_s} s");
    }
}

/// Largest speed of a node in contact, m/s, in 10 ms that begin 20 ms after it was met.
fn ringing_m_s(damping_s: f32) -> f32 {
    let (mut body, top, springs) = pressed();
    let mut most = 0.0f32;
    for tick in 0..30 {
        body.step_with(&in_contact(&springs, damping_s));
        most = if tick < 20 { 0.0 } else { most.max(body.velocity_m_s[top as usize][2].abs()) };
    }
    most
}

#[test]
fn a_node_in_contact_does_not_ring_on() {
    let (undamped, damped) = (ringing_m_s(0.0), ringing_m_s(6e-4));
    assert!(undamped > 0.02, "nothing rings here: {undamped} m/s");
    assert!(damped < 0.2 * undamped, "{damped} m/s with damping, {undamped} m/s without");
}

#[test]
fn a_contact_brakes_the_speed_against_its_plane_and_not_the_speed() {
    let (mut with, mut without) = (pressed(), pressed());
    let falling = [0.0, 0.0, -0.1];
    let speeds = [(0.0, -0.1), (6e-4, -0.1), (6e-4, 0.0)].map(|(damping_s, speed_m_s)| {
        let (body, top, springs) = if damping_s > 0.0 { &mut with } else { &mut without };
        body.position_m.copy_from_slice(body.model.rest_m());
        body.velocity_m_s.fill(falling);
        let velocity_m_s = [0.0, 0.0, speed_m_s];
        let springs = springs.map(|spring| PlaneSpring { velocity_m_s, offset_m: -0.0089, ..spring });
        body.step_with(&StepInput { dt_s: 1e-6, ..in_contact(&springs, damping_s) });
        body.velocity_m_s[*top as usize][2]
    });
    let [undamped, along, across] = speeds;
    assert!((along - undamped).abs() < 0.3 * (across - undamped).abs(), "{speeds:?}");
    assert!(across > along, "a plane that stands still holds back what falls ahead of it: {speeds:?}");
}

/// An obstacle presses on the block's upper side and slides along it until the tissue is at rest: how far it takes the node along, m, and the push that the
/// last step leaves.
fn dragged(friction: f32, slide_m_s: f32) -> (f32, Push) {
    let (mut body, top, [spring, _]) = pressed();
    let mut spring = PlaneSpring { velocity_m_s: [slide_m_s, 0.0, 0.0], stiffness_n_m: 1500.0, ..spring };
    let law = ContactLaw { friction, damping_s: 6e-4, ..ContactLaw::default() };
    let mut push = Push::default();
    for _ in 0..3_000 {
        // What was bent before, and the way of the obstacle since.
        let at_m = body.position_m[top as usize];
        spring.sticks_at_m = [0, 1, 2].map(|axis| at_m[axis] + push.bent_m[axis] + 1e-3 * spring.velocity_m_s[axis]);
        body.step_with(&StepInput { law, dt_s: 1e-3, ..in_contact(&[spring], 0.0) });
        let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
        push = body.scratch.push(&body.model, &law, &spring, &at);
    }
    let rest = body.model.rest_m()[top as usize][0];
    (body.position_m[top as usize][0] - rest, push)
}

#[test]
fn friction_drags_the_tissue_along_with_its_share_of_the_normal_force() {
    // Where the mesh alone lets it go.
    let (still_m, push) = dragged(0.0, 0.02);
    assert_eq!(push.force_n[0], 0.0, "nothing drags without friction");
    for (friction, slide_m_s) in [(0.05, 0.02), (0.3, 0.2), (0.3, -0.2)] {
        let (moved_m, push) = dragged(friction, slide_m_s);
        let expected_n = friction * push.normal_n * slide_m_s.signum();
        assert!((push.force_n[0] - expected_n).abs() < 0.01 * expected_n.abs(), "{push:?}");
        assert!((moved_m - still_m) * slide_m_s > 0.0 && push.normal_n > 0.02, "{moved_m} m, {push:?}");
    }
}

/// What the hand is told of a contact is what the tissue got: the change of its momentum, softened springs, damping and friction included.
#[test]
fn what_is_told_of_contacts_is_what_the_tissue_got() {
    const DT_S: f32 = 2e-7;
    let mesh = block([3, 3, 3], 0.003);
    let material = Material::new(10_000.0, 0.45, 1000.0, 0.0).unwrap();
    let stiff = Options { contact_stiffness_n_m: 2000.0, max_substeps: 64, ..options() };
    let mut body = Body::new(Model::new(&mesh, &vec![false; mesh.positions_m.len()], &material, stiff).unwrap().0);
    let (_, top, [spring, _]) = pressed();
    let aside = PlaneSpring { normal: [0.6, 0.0, -0.8], offset_m: 0.6 * 0.003 - 0.8 * 0.0089, ..spring };
    let springs = [PlaneSpring { offset_m: -0.0089, ..spring }, aside];
    let law = ContactLaw { damping_s: 1e-4, friction: 0.3, ..ContactLaw::default() };
    body.velocity_m_s.fill([0.03, -0.02, 0.01]);
    let momentum = |body: &Body| {
        let of_axis = |axis: usize| {
            let parts = body.velocity_m_s.iter().zip(body.model.mass_kg());
            parts.map(|(v, mass)| f64::from(v[axis]) * f64::from(*mass)).sum::<f64>()
        };
        [of_axis(0), of_axis(1), of_axis(2)]
    };
    let before = momentum(&body);
    let report = body.step_with(&StepInput { law, dt_s: DT_S, ..in_contact(&springs, 0.0) });
    assert_eq!(report.softened_springs, 2);
    let after = momentum(&body);
    let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
    let told = springs.map(|spring| body.scratch.push(&body.model, &law, &spring, &at));
    assert!(told.iter().all(|push| push.normal_n > 0.01 && push.stiffness_n_m < 1001.0), "{told:?}, node {top}");
    for axis in 0..3 {
        let (got_n, told_n) =
            ((after[axis] - before[axis]) / f64::from(DT_S), f64::from(told[0].force_n[axis] + told[1].force_n[axis]));
        assert!((got_n - told_n).abs() < 0.02 * f64::from(told[0].normal_n), "axis {axis}: got {got_n} N, told {told_n} N");
    }
}

/// A contact with a point in a tet, which slides and is damped.
#[test]
fn the_nodes_of_a_contact_get_the_force_and_the_moment_that_the_tool_loses() {
    const DT_S: f32 = 2e-7;
    let mesh = block([4, 3, 3], 0.003);
    let material = Material::new(10_000.0, 0.45, 1000.0, 0.0).unwrap();
    let stiff = Options { contact_stiffness_n_m: 2000.0, max_substeps: 64, ..options() };
    let mut body = Body::new(Model::new(&mesh, &vec![false; mesh.positions_m.len()], &material, stiff).unwrap().0);
    let (nodes, weights, normal) = (*body.model.tets().last().unwrap(), [0.4, 0.3, 0.2, 0.1], [0.6, 0.0, -0.8]);
    let place_m = gather(nodes, weights, body.model.rest_m()).unwrap();
    let offset_m = normal[0] * place_m[0] + normal[2] * place_m[2] + 3e-4;
    let (velocity_m_s, sticks_at_m) = ([0.05, 0.04, 0.02], [place_m[0], place_m[1] + 0.002, place_m[2]]);
    let spring = PlaneSpring { nodes, weights, normal, offset_m, velocity_m_s, sticks_at_m, stiffness_n_m: 300.0 };
    let law = ContactLaw { damping_s: 1e-4, friction: 0.3, ..ContactLaw::default() };
    let report = body.step_with(&StepInput { law, dt_s: DT_S, ..in_contact(&[spring], 0.0) });
    assert_eq!(report.ignored_springs, 0);
    let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
    let told = body.scratch.push(&body.model, &law, &spring, &at);
    let across_n = told.force_n[1];
    assert!(told.normal_n > 0.05 && across_n > 0.005, "it pushes and drags: {told:?}");
    // It was at rest.
    for (got, told_n) in momentum(&body).iter().zip(told.force_n) {
        let got_n = got / f64::from(DT_S);
        assert!((got_n - f64::from(told_n)).abs() < 0.02 * f64::from(told.normal_n), "got {got_n} N, told {told_n} N");
    }
    let told_n_m = f64::from(place_m[0] * told.force_n[1] - place_m[1] * told.force_n[0]);
    let got_n_m = spin(&body) / f64::from(DT_S);
    assert!((got_n_m - told_n_m).abs() < 0.02 * told_n_m.abs(), "got {got_n_m} N·m, told {told_n_m} N·m");
}

#[test]
fn a_contact_pushes_with_no_more_than_it_is_allowed_to() {
    let (mut body, _, springs) = pressed();
    let law = ContactLaw { most_n: 0.01, ..ContactLaw::default() };
    for _ in 0..100 {
        body.step_with(&StepInput { law, ..in_contact(&springs[..1], 0.0) });
    }
    let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
    assert_eq!(body.scratch.push(&body.model, &law, &springs[0], &at).normal_n, 0.01);
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
        body.step_with(&StepInput { targets_m: &targets, ..StepInput::default() });
        for node in (0..targets.len()).filter(|&node| fixed[node]) {
            assert_eq!(body.position_m[node], targets[node], "tick {tick}, node {node}");
        }
    }
    let moved = body.position_m[63][0] - mesh.positions_m[63][0];
    assert!((moved - 0.002).abs() < 2e-5, "the free end moved by {moved} m");
}
