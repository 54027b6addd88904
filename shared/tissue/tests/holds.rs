//! Promise of what is held from outside: it is drawn to its place from every side, what is told of it is what the tissue got, no stiffness makes it
//! unstable, and nonsense is left out.

mod common;

use common::{Body, block, options};
use hyst_tissue::{ContactLaw, Hold, Material, Model, Options, Push, StateRef, StepInput};

/// Stiffness that the models' bound has room for, N/m.
const ROOM_N_M: f64 = 2_000.0;
const LAW: ContactLaw = ContactLaw { damping_s: 6e-4, friction: 0.05, most_n: 5.0 };

/// A block of 9 mm, whose lower side is fixed or not, and the middle of its upper side held at a place.
fn held(is_fixed: bool, place_m: [f32; 3], stiffness_n_m: f32) -> (Body, Hold) {
    let mesh = block([3, 3, 3], 0.003);
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|place| is_fixed && place[2] == 0.0).collect();
    let material = Material::new(10_000.0, 0.45, 1000.0, if is_fixed { 60.0 } else { 0.0 }).unwrap();
    let options = Options { contact_stiffness_n_m: ROOM_N_M, max_substeps: 64, ..options() };
    let body = Body::new(Model::new(&mesh, &fixed, &material, options).unwrap().0);
    let at = |place: [f32; 3]| mesh.positions_m.iter().position(|other| *other == place).unwrap() as u32;
    let nodes = [[0.003, 0.003], [0.006, 0.003], [0.003, 0.006], [0.006, 0.006]].map(|[x, y]| at([x, y, 0.009]));
    (body, Hold { nodes, weights: [0.25; 4], place_m, velocity_m_s: [0.0; 3], stiffness_n_m })
}

/// Where the held point is, m, and what the hold does.
fn seen(body: &Body, law: &ContactLaw, hold: &Hold) -> ([f32; 3], Push) {
    let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
    let point = hyst_tissue::gather(hold.nodes, hold.weights, &body.position_m).unwrap();
    (point, body.scratch.pull(&body.model, law, hold, &at))
}

#[test]
fn a_point_is_drawn_to_its_place_from_whichever_side_it_is_on() {
    for away in [[0.0, 0.0, 1e-3], [0.0, 0.0, -1e-3], [1e-3, 0.0, 0.0], [0.0, -1e-3, 5e-4]] {
        let place_m = [0.0045 + away[0], 0.0045 + away[1], 0.009 + away[2]];
        let (mut body, hold) = held(true, place_m, 300.0);
        for _ in 0..2_000 {
            let report = body.step_with(&StepInput { holds: &[hold], law: LAW, ..StepInput::default() });
            assert_eq!((report.ignored_springs, report.softened_springs, report.recovered_nodes), (0, 0, 0));
        }
        let (point, pull) = seen(&body, &LAW, &hold);
        for axis in 0..3 {
            let came_m = point[axis] - [0.0045, 0.0045, 0.009][axis];
            let expected_n = 300.0 * (place_m[axis] - point[axis]);
            assert!((pull.force_n[axis] - expected_n).abs() < 1e-3, "{away:?}: {pull:?}");
            if away[axis] != 0.0 {
                assert!((0.1..1.0).contains(&(came_m / away[axis])), "{away:?}: it came by {came_m} m along axis {axis}");
            }
        }
        assert!(pull.normal_n > 0.01 && pull.stiffness_n_m == 300.0, "{pull:?}");
    }
}

#[test]
fn what_is_told_of_a_hold_is_what_the_tissue_got() {
    const DT_S: f32 = 2e-7;
    let (mut body, mut hold) = held(false, [0.0051, 0.0039, 0.0098], 10_000.0);
    hold.velocity_m_s = [0.01, 0.0, -0.02];
    body.velocity_m_s.fill([0.03, -0.02, 0.01]);
    let momentum = |body: &Body| -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let parts = body.velocity_m_s.iter().zip(body.model.mass_kg());
            parts.map(|(velocity, mass)| f64::from(velocity[axis]) * f64::from(*mass)).sum()
        })
    };
    let before = momentum(&body);
    let report = body.step_with(&StepInput { holds: &[hold], law: LAW, dt_s: DT_S, ..StepInput::default() });
    assert_eq!(
        (report.softened_springs, report.ignored_springs),
        (1, 0),
        "a quarter of 10 kN/m is more than there is room for at a node"
    );
    let (after, (_, told)) = (momentum(&body), seen(&body, &LAW, &hold));
    for axis in 0..3 {
        let got_n = (after[axis] - before[axis]) / f64::from(DT_S);
        assert!((got_n - f64::from(told.force_n[axis])).abs() < 0.02 * f64::from(told.normal_n), "{axis}: {got_n} N, {told:?}");
    }
}

#[test]
fn no_stiffness_makes_it_unstable_and_it_draws_with_no_more_than_it_is_allowed_to() {
    let (mut body, hold) = held(true, [0.0045, 0.0045, 0.1], 1e7);
    let law = ContactLaw { most_n: 0.05, ..LAW };
    for _ in 0..1_000 {
        let report = body.step_with(&StepInput { holds: &[hold], law, ..StepInput::default() });
        assert_eq!((report.softened_springs, report.recovered_nodes, report.capped_nodes), (1, 0, 0));
    }
    let (_, pull) = seen(&body, &law, &hold);
    assert_eq!(pull.normal_n, law.most_n);
    let fastest = body.velocity_m_s.as_flattened().iter().fold(0.0f32, |most, speed| most.max(speed.abs()));
    assert!(fastest < 1e-2, "it rattles at {fastest} m/s");
}

#[test]
fn nonsense_is_left_out() {
    let (mut body, good) = held(true, [0.0045, 0.0045, 0.009], 300.0);
    let bad = [
        Hold { nodes: [0, 1, 2, 9_999], ..good },
        Hold { weights: [f32::NAN, 0.0, 0.0, 0.0], ..good },
        Hold { place_m: [f32::INFINITY, 0.0, 0.0], ..good },
        Hold { velocity_m_s: [0.0, f32::NAN, 0.0], ..good },
        Hold { stiffness_n_m: -1.0, ..good },
    ];
    let rest = body.position_m.clone();
    let report = body.step_with(&StepInput { holds: &bad, law: LAW, ..StepInput::default() });
    assert_eq!(report.ignored_springs as usize, bad.len());
    let moved = body.position_m.as_flattened().iter().zip(rest.as_flattened());
    assert!(moved.map(|(now, before)| (now - before).abs()).fold(0.0, f32::max) < 1e-8, "nothing draws: {:?}", body.position_m);
    let at = StateRef { position_m: &body.position_m, velocity_m_s: &body.velocity_m_s };
    assert!(bad.iter().all(|hold| body.scratch.pull(&body.model, &LAW, hold, &at) == Push::default()));
}
