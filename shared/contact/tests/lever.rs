//! What touches an instrument that turns about a pivot is felt at its tip by the lever: with the force that does the same work, and where the tip is then.

mod common;

use common::TOOL;
use glam::{DQuat, DVec3, Vec3};
use hyst_contact::*;
use proptest::array::uniform3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const PIVOT_M: [f32; 3] = [0.001, -0.002, 0.003];
/// The tip, so far before the pivot along z, m.
const LENGTH_M: f32 = 0.04;
const TIP_M: [f32; 3] = [0.001, -0.002, 0.003 + LENGTH_M];
const PARAMS: PlaneParams = PlaneParams { range_m: 0.002, stiffness_n_m3: 2e7, most_stiffness_n_m: f32::INFINITY };
/// Area that a point stands for, m².
const AREA_M2: f32 = 2e-7;
/// Of the contacts here.
const NORMAL_N: f32 = 0.4;
const STIFFNESS_N_M: f32 = 200.0;
const DAMPING_N_S_M: f32 = 0.8;

fn contact(place_m: [f32; 3], direction: Vec3) -> ContactForce {
    ContactForce {
        point: 0,
        owner: TOOL,
        place_m,
        direction: direction.to_array(),
        normal_n: NORMAL_N,
        stiffness_n_m: STIFFNESS_N_M,
        damping_n_s_m: DAMPING_N_S_M,
    }
}

/// On the axis, so far from the pivot as a share of the way to the tip.
fn on_axis(share: f32) -> [f32; 3] {
    (Vec3::from_array(PIVOT_M) + Vec3::Z * (share * LENGTH_M)).to_array()
}

fn felt_at(tip_m: [f32; 3], pivot_m: Option<[f32; 3]>, contacts: &[ContactForce]) -> PlaneSet {
    let input = PlaneInput { contacts, gaps: &[], points_m: &[], owner: &[], point_area_m2: &[], tip_m, pivot_m, tool: TOOL };
    planes(&input, &PARAMS)
}

fn felt(contact: ContactForce) -> PlaneSet {
    felt_at(TIP_M, Some(PIVOT_M), &[contact])
}

fn force_n(set: &PlaneSet) -> Vec3 {
    Vec3::from_array(set.force_n(TIP_M))
}

/// Of all planes together: stiffness, N/m, and damping, N·s/m.
fn sums(set: &PlaneSet) -> [f32; 2] {
    let used = &set.planes[..set.count as usize];
    [used.iter().map(|plane| plane.stiffness_n_m).sum(), used.iter().map(|plane| plane.damping_n_s_m).sum()]
}

fn is_near(found: f32, wanted: f32) -> bool {
    (found - wanted).abs() < 1e-4 * wanted.abs()
}

#[test]
fn half_way_to_the_pivot_half_of_what_acts_across_is_felt_a_quarter_as_stiff_and_all_of_what_acts_along() {
    let across = felt(contact(on_axis(0.5), Vec3::X));
    assert!(force_n(&across).distance(Vec3::X * 0.2) < 1e-5, "{across:?}");
    let [stiffness_n_m, damping_n_s_m] = sums(&across);
    assert!(is_near(stiffness_n_m, 50.0) && is_near(damping_n_s_m, 0.2), "{across:?}");
    let along = felt(contact(on_axis(0.5), Vec3::NEG_Z));
    assert!(force_n(&along).distance(Vec3::NEG_Z * 0.4) < 1e-5, "{along:?}");
    let [stiffness_n_m, damping_n_s_m] = sums(&along);
    assert!(is_near(stiffness_n_m, STIFFNESS_N_M) && is_near(damping_n_s_m, DAMPING_N_S_M), "{along:?}");
}

#[test]
fn at_the_tip_a_contact_is_felt_as_without_a_lever() {
    for direction in [Vec3::X, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
        let contact = contact(TIP_M, direction);
        let [with, without] = [Some(PIVOT_M), None].map(|pivot_m| felt_at(TIP_M, pivot_m, &[contact]));
        assert!(force_n(&with).distance(force_n(&without)) < 1e-5, "{with:?} {without:?}");
        assert!(is_near(sums(&with)[0], sums(&without)[0]) && is_near(sums(&with)[1], sums(&without)[1]), "{with:?} {without:?}");
    }
}

#[test]
fn near_the_pivot_and_behind_it_a_twentieth_is_felt_far_before_the_tip_twice_as_much_and_of_a_tip_in_the_pivot_all() {
    for (share, wanted) in [(0.03, 0.05), (0.0, 0.05), (-0.5, 0.05), (1.5, 1.5), (3.0, 2.0)] {
        let set = felt(contact(on_axis(share), Vec3::Y));
        assert!(force_n(&set).distance(Vec3::Y * (wanted * NORMAL_N)) < 1e-5, "{share}: {set:?}");
        assert!(is_near(sums(&set)[0], wanted * wanted * STIFFNESS_N_M), "{share}: {set:?}");
    }
    let contact = contact(on_axis(0.5), Vec3::Y);
    let [in_it, without] = [Some(TIP_M), None].map(|pivot_m| felt_at(TIP_M, pivot_m, &[contact]));
    assert!(in_it == without && in_it.count > 0);
}

#[test]
fn a_wall_beside_the_middle_of_the_shaft_is_met_when_the_tip_has_gone_twice_as_far_and_one_before_it_when_it_has_gone_as_far() {
    let gap_m = 0.001;
    for (direction, share) in [(Vec3::X, 0.5), (Vec3::NEG_Z, 1.0)] {
        let input = PlaneInput {
            contacts: &[],
            gaps: &[Gap { distance_m: gap_m, direction: direction.to_array(), triangle: 0 }],
            points_m: &[on_axis(0.5)],
            owner: &[TOOL],
            point_area_m2: &[AREA_M2],
            tip_m: TIP_M,
            pivot_m: Some(PIVOT_M),
            tool: TOOL,
        };
        let set = planes(&input, &PARAMS);
        assert!(set.count > 0, "{direction}");
        for plane in &set.planes[..set.count as usize] {
            let normal = Vec3::from_array(plane.normal);
            let free_m = (Vec3::from_array(TIP_M) - Vec3::from_array(plane.point_m)).dot(normal);
            assert!(normal.distance(direction) < 1e-4 && (free_m - gap_m / share).abs() < 1e-6, "{plane:?}");
        }
        // At half of the range a quarter of the contact's stiffness.
        let wanted_n_m = share * share * 0.25 * PARAMS.stiffness_n_m3 * AREA_M2;
        assert!(is_near(sums(&set)[0], wanted_n_m), "{set:?}, not {wanted_n_m} N/m");
    }
}

fn unit() -> impl Strategy<Value = Vec3> {
    (-1.0f32..1.0, 0.0..std::f32::consts::TAU).prop_map(|(z, turn)| {
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * turn.cos(), across * turn.sin(), z)
    })
}

/// Where a point of the instrument is when its tip has gone a way: it slides through the pivot and turns about it, and not about its own axis.
fn moved_m([pivot, tip, place]: [DVec3; 3], way: DVec3) -> DVec3 {
    let turn = DQuat::from_rotation_arc((tip - pivot).normalize(), (tip + way - pivot).normalize());
    tip + way + turn * (place - tip)
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(43), failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn what_is_felt_does_the_same_work_at_the_tip_as_the_contact_at_its_place(
        axis in unit(),
        length_m in 0.03f32..0.07,
        share in 0.4f32..1.6,
        beside in uniform3(-0.004f32..0.004),
        direction in unit(),
        way in unit(),
    ) {
        let pivot = Vec3::from_array(PIVOT_M);
        let tip_m = (pivot + axis * length_m).to_array();
        let place_m = (pivot + axis * (share * length_m) + Vec3::from_array(beside)).to_array();
        let set = felt_at(tip_m, Some(PIVOT_M), &[contact(place_m, direction)]);
        let felt_n = Vec3::from_array(set.force_n(tip_m)).as_dvec3();
        let places = [PIVOT_M, tip_m, place_m].map(|place_m| Vec3::from_array(place_m).as_dvec3());
        let step = way.as_dvec3() * 1e-5;
        let went = moved_m(places, step) - moved_m(places, -step);
        let (at_tip_j, at_place_j) = (felt_n.dot(2.0 * step), f64::from(NORMAL_N) * direction.as_dvec3().dot(went));
        prop_assert!((at_tip_j - at_place_j).abs() < 1e-4 * 2e-5 * f64::from(NORMAL_N), "{at_tip_j} J for {at_place_j} J");
        // The same wall: where the tip goes by δ along what is felt, the point goes into it by s·δ.
        let share = felt_n.length() / f64::from(NORMAL_N);
        let wanted_n_m = share * share * f64::from(STIFFNESS_N_M);
        prop_assert!((f64::from(sums(&set)[0]) - wanted_n_m).abs() < 1e-3 * wanted_n_m, "{set:?}, not {wanted_n_m} N/m");
    }
}
