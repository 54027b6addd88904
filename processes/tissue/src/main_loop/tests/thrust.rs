//! Promise of the Main Loop about a tool that is thrust in far faster than any hand does: it is met, nothing is passed through, nothing tears or swings up, and the
//! tissue comes back to where it was, in steps of each length.

use super::*;
use glam::Vec3;

/// Mean speed of the tip, m/s; half-way it is half as fast again.
const SPEED_M_S: f64 = 0.5;
/// Ticks in which the tip stays in, and those after it has come out.
const STAY: u64 = 200;
const AFTER: u64 = 1_500;
/// No node goes farther than this, m: a few times the way of the tip into the wall.
const FAR_M: f32 = 0.02;
/// How far from its place a node may be at the end, m.
const BACK_M: f32 = 0.3e-3;
/// Largest force beside the one that the tip at rest is pushed back with: it is slowest where it is deepest, so that what tissue is pushed aside with on the
/// way, and what contacts damp, comes upon a spring that is bent little yet.
const PEAK: f32 = 1.5;

/// Thrusts the tool in and draws it back as fast, in steps of so many ticks.
fn thrust_in(step_ticks: u64) {
    let (station, pages, life, mut inbox) = begun_with(step_ticks, &format!("thrust{step_ticks}"), "workers = 0");
    let mut main = engine(&station, &life, &mut inbox);
    let scene = hyst_scene::load_embedded().unwrap();
    let hand = scene.hand("press").unwrap();
    let tip_at = |share: f64| {
        let pose = hand.pose_at(0.5 * hand.period_s * share);
        main.world.case.pose_of(&pose)
    };
    let steps = 200;
    let places: Vec<Vec3> = (0..=steps).map(|step| tip_at(f64::from(step) / f64::from(steps)).position_m.into()).collect();
    let way_m: f64 = places.windows(2).map(|pair| f64::from(pair[0].distance(pair[1]))).sum();
    let thrust = (way_m / (SPEED_M_S * 1e-3)).ceil() as u64;
    let poses: Vec<Pose> = (1..=2 * thrust + STAY + AFTER)
        .map(|tick| match tick {
            tick if tick <= thrust => tip_at(tick as f64 / thrust as f64),
            tick if tick <= thrust + STAY => tip_at(1.0),
            tick => tip_at(1.0 - (tick - thrust - STAY).min(thrust) as f64 / thrust as f64),
        })
        .collect();
    let mut now = first_state(&mut main);
    let (mut most_m, mut most_n, mut held_n) = (0.0f32, 0.0f32, 0.0f32);
    for (tick, pose) in (1..).zip(poses) {
        if !is_read(&main, tick) {
            continue;
        }
        now = stepped(&mut main, &pages[1], &now, tick, pose, PieceFlow::default());
        assert!(main.accepts(bytemuck::cast_slice(&now)), "the state of tick {tick} is none");
        let force_n = Vec3::from(core_of(&now).force_n);
        assert!(force_n.is_finite(), "{force_n} at tick {tick}");
        (most_m, most_n) = (most_m.max(displaced_m(&main, &now)), most_n.max(force_n.length()));
        if tick <= thrust + STAY {
            // At the end of it: whoever has passed through the wall feels nothing, or is drawn on.
            held_n = force_n.dot((places[0] - places[steps as usize]).normalize());
        }
    }
    let left_m = displaced_m(&main, &now);
    println!(
        "thrust over {:.1} mm in {thrust} ticks, steps of {step_ticks}: {most_n:.2} N and {:.2} mm at most, {held_n:.2} N held \
         (at most {:.2} times as much), {:.3} mm left",
        1e3 * way_m,
        1e3 * most_m,
        most_n / held_n,
        1e3 * left_m
    );
    assert!(held_n > 0.1, "the tip that stays in is pushed back with {held_n} N");
    assert!(most_n < PEAK * held_n, "{most_n} N where {held_n} N hold it");
    assert!(most_m > 0.5e-3 && most_m < FAR_M, "a node went {most_m} m");
    assert!(left_m < BACK_M, "{left_m} m from its place at the end");
}

#[test]
fn a_tool_that_is_thrust_in_is_met_and_the_tissue_comes_back() {
    thrust_in(1);
}

/// A step of 4 ms sees the tip first when it is up to 3 mm deep.
#[test]
fn so_is_one_in_steps_of_two_and_of_four_ticks() {
    [2, 4].into_iter().for_each(thrust_in);
}

/// Ticks in which the tip goes in, in which it is nowhere, and in which it is back.
const IN: u64 = 80;
const NOWHERE: u64 = 12;
const BACK: u64 = 120;

/// The device lets no such sample through; whoever did would harm nothing but himself.
#[test]
fn a_tool_whose_place_is_no_number_moves_no_node_anywhere_cuts_nothing_and_is_felt_again() {
    const CUTS: u32 = hyst_messages::BUTTON_ENERGIZED | hyst_messages::BUTTON_EXTENDED;
    let (station, pages, life, mut inbox) = begun("no-place");
    let mut main = engine(&station, &life, &mut inbox);
    let scene = hyst_scene::load_embedded().unwrap();
    let (hand, pivot_m) = (scene.hand("press").unwrap(), main.world.case.pivot_m);
    let mut now = first_state(&mut main);
    for tick in 1..=IN + NOWHERE + BACK {
        let at = hand.pose_at(0.5 * hand.period_s * tick.min(IN) as f64 / IN as f64);
        let (position_m, orientation) = (at.tip_m(pivot_m), at.orientation());
        let pose = Pose { position_m, orientation, insertion_m: at.insertion_m, ..Pose::default() };
        let mut record = InputRecord { tick, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
        record.sample.pose = pose;
        if (IN + 1..=IN + NOWHERE).contains(&tick) {
            record.sample.pose = match tick % 4 {
                0 => Pose { position_m: [f32::NAN; 3], ..pose },
                1 => Pose { orientation: [f32::NAN; 4], ..pose },
                2 => Pose { position_m: [f32::INFINITY, 0.0, f32::NEG_INFINITY], ..pose },
                _ => Pose { position_m: [f32::MAX; 3], orientation: [f32::MAX; 4], ..pose },
            };
            record.sample.velocity_m_s = [f32::NAN; 3];
            record.sample.controls.buttons = if tick.is_multiple_of(2) { CUTS } else { 0 };
            record.sample.controls.loop_extension_m = 0.005;
        }
        now = fed(&mut main, &pages[1], &now, &record);
        let core = core_of(&now);
        assert!(Vec3::from(core.force_n).is_finite() && core.is_sane(), "{:?} N at tick {tick}", core.force_n);
        assert!(displaced_m(&main, &now) < FAR_M, "tick {tick}");
        assert!(positions(&now).as_flattened().iter().all(|coordinate| coordinate.is_finite()), "tick {tick}");
    }
    let core = core_of(&now);
    assert!(main.accepts(bytemuck::cast_slice(&now)) && core.cuts == 0, "{} cuts", core.cuts);
    assert!(Vec3::from(core.force_n).length() > 0.05, "the tool is back, and {:?} N are felt", core.force_n);
}
