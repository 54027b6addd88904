//! A body that is cut while it moves: deformation pauses within the step, and goes on with what the cut has made.

mod common;

use common::{Body, block, options};
use hyst_mesh::component_of_each_tet;
use hyst_tissue::{CutOptions, Cuttable, Material, Model, ModelReport, Options, cut};

/// A bar of 36 × 12 × 12 mm, soft as tissue.
fn body_of(tissue: &Cuttable, poisson_ratio: f64, omega_rest_per_s: Option<f64>) -> (Body, ModelReport) {
    let material = Material::new(10_000.0, poisson_ratio, 1000.0, 20.0).unwrap();
    let options = Options { omega_rest_per_s, ..options() };
    let (model, report) = Model::new(&tissue.rest, &tissue.fixed, &material, options).unwrap();
    let mut body = Body::new(model);
    body.position_m.clone_from(&tissue.position_m);
    body.velocity_m_s.clone_from(&tissue.velocity_m_s);
    (body, report)
}

/// The width of the gap in the middle of the bar at rest, m: how far the nearest nodes of the two parts are apart along x.
fn gap_m(tissue: &Cuttable) -> f32 {
    let part = component_of_each_tet(&tissue.rest);
    let first =
        tissue.rest.tets.iter().position(|tet| tet.iter().any(|node| tissue.rest.positions_m[*node as usize][0] == 0.0)).unwrap();
    let (mut left, mut right) = (f32::MIN, f32::MAX);
    for (tet, number) in tissue.rest.tets.iter().zip(&part) {
        for node in tet {
            let x = tissue.position_m[*node as usize][0];
            if *number == part[first] { left = left.max(x) } else { right = right.min(x) }
        }
    }
    right - left
}

#[test]
fn a_stretched_bar_is_cut_tick_by_tick_and_its_halves_go_apart() {
    const STRETCH: f32 = 1.2;
    let mut tissue = Cuttable::at_rest(block([12, 4, 4], 0.003));
    tissue.fixed = tissue.rest.positions_m.iter().map(|p| p[0] == 0.0 || p[0] > 0.0359).collect();
    tissue.position_m.iter_mut().for_each(|p| p[0] *= STRETCH);
    let (mut body, whole) = body_of(&tissue, 0.45, None);
    for _ in 0..200 {
        body.step();
    }
    let stretched_j = body.energy_j();
    let place = |tick: u32| {
        let z = -0.002 + 0.016 * tick as f32 / 40.0;
        [[0.0216, -0.002, z], [0.0216, 0.006, z], [0.0216, 0.014, z]]
    };
    let mut changes = 0;
    for tick in 0..=40 {
        tissue.position_m.clone_from(&body.position_m);
        tissue.velocity_m_s.clone_from(&body.velocity_m_s);
        let before_j = body.energy_j();
        let report = cut(&mut tissue, &place(tick), &CutOptions::default()).unwrap();
        if report.has_changed_mesh() {
            changes += 1;
            // The frequency is that of the whole bar: the cut ones are made without looking for theirs.
            body = body_of(&tissue, 0.45, Some(whole.omega_rest_per_s)).0;
            let after_j = body.energy_j();
            // A node that moves along an edge takes the shape at rest along: the strain is sampled anew.
            assert!(after_j <= before_j + 0.03 * stretched_j, "tick {tick}: {before_j} J became {after_j}: {report:?}");
        }
        let report = body.step();
        assert_eq!((report.recovered_nodes, report.capped_nodes), (0, 0), "tick {tick}");
        assert!(body.energy_j() <= 1.05 * stretched_j, "tick {tick}: {} J, stretched {stretched_j} J", body.energy_j());
    }
    assert!(changes > 3, "{changes} changes: it was not cut tick by tick");
    assert_eq!(component_of_each_tet(&tissue.rest).iter().max(), Some(&1));
    for _ in 0..1500 {
        body.step();
    }
    tissue.position_m.clone_from(&body.position_m);
    assert!(body.energy_j() < 0.01 * stretched_j, "{} J of {stretched_j} J are left", body.energy_j());
    let expected = 0.036 * (STRETCH - 1.0);
    let gap = gap_m(&tissue);
    // Each face of the cut is uneven by up to a fifth of an edge at the border.
    assert!((gap - expected).abs() < 0.0015, "the halves are {gap} m apart, relaxed they would be {expected}");
}

#[test]
fn many_cuts_leave_a_mesh_that_a_model_can_be_made_of() {
    // Of tets that hold their own volume, and of such whose nodes do.
    [0.45, 0.49].into_iter().for_each(many_cuts);
}

fn many_cuts(poisson_ratio: f64) {
    let mut tissue = Cuttable::at_rest(block([10, 8, 4], 0.003));
    tissue.fixed = tissue.rest.positions_m.iter().map(|p| p[2] == 0.0).collect();
    let whole = body_of(&tissue, poisson_ratio, None).1;
    for stroke in 0..6 {
        let x = 0.004 + 0.0043 * stroke as f32;
        let place = |tick: u32| {
            let z = 0.013 - 0.008 * (tick as f32 / 10.0);
            [[x, -0.002, z], [x + 0.001, 0.012, z], [x, 0.026, z]]
        };
        for tick in 0..=10 {
            cut(&mut tissue, &place(tick), &CutOptions::default()).unwrap();
        }
        tissue.end_stroke();
    }
    // As in the station the frequency is that of the mesh before it was cut.
    let mut body = body_of(&tissue, poisson_ratio, Some(whole.omega_rest_per_s)).0;
    body.velocity_m_s.iter_mut().zip(&tissue.fixed).filter(|(_, fixed)| !**fixed).for_each(|(v, _)| *v = [0.3, 0.0, 0.1]);
    let started_j = body.energy_j();
    for tick in 0..2000 {
        let report = body.step();
        assert_eq!(report.recovered_nodes, 0, "ν = {poisson_ratio}, tick {tick}");
    }
    assert!(body.energy_j() < 0.02 * started_j, "ν = {poisson_ratio}: {} J of {started_j} J are left", body.energy_j());
    // What is told is what is used; what would be looked for is never above the bound that keeps the step stable.
    let report = body_of(&tissue, poisson_ratio, None).1;
    let told = body_of(&tissue, poisson_ratio, Some(report.omega_rest_per_s));
    assert_eq!(told.1, report);
    let far_above = body_of(&tissue, poisson_ratio, Some(1e9)).1;
    assert_eq!(far_above.omega_rest_per_s, report.omega_max_per_s);
}
