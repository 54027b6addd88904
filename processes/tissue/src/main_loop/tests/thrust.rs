//! Promise of the Main Loop about a tool that is thrust in far faster than any hand does: it is met, nothing is passed through, nothing tears or swings up, and the
//! tissue comes back to where it was.

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

#[test]
fn a_tool_that_is_thrust_in_is_met_and_the_tissue_comes_back() {
    let (station, pages) = founded("thrust", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let scene = hyst_scene::load_embedded().unwrap();
    let hand = scene.hand("press").unwrap();
    let tip_at = |share: f64| {
        let pose = hand.pose_at(0.5 * hand.period_s * share);
        let position_m = pose.tip_m(main.world.case.pivot_m);
        Pose { position_m, orientation: pose.orientation(), insertion_m: pose.insertion_m, ..Pose::default() }
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
        now = stepped(&mut main, &pages[1], &now, tick, pose, PieceFlow::default());
        assert!(main.accepts(bytemuck::cast_slice(&now)), "the state of tick {tick} is none");
        let force_n = Vec3::from(core_of(&now).force_n);
        assert!(force_n.is_finite(), "{force_n} at tick {tick}");
        (most_m, most_n) = (most_m.max(displaced_m(&main, &now)), most_n.max(force_n.length()));
        if tick == thrust + STAY {
            // Whoever has passed through the wall feels nothing, or is drawn on.
            held_n = force_n.dot((places[0] - places[steps as usize]).normalize());
        }
    }
    let left_m = displaced_m(&main, &now);
    println!(
        "thrust over {:.1} mm in {thrust} ticks: {most_n:.2} N and {:.2} mm at most, {held_n:.2} N held",
        1e3 * way_m,
        1e3 * most_m
    );
    assert!(held_n > 0.1, "the tip that stays in is pushed back with {held_n} N");
    assert!(most_m > 0.5e-3 && most_m < FAR_M, "a node went {most_m} m");
    assert!(left_m < BACK_M, "{left_m} m from its place at the end");
}
