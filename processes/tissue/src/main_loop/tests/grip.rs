//! Promise of tissue, servo and hand in their loop: a hand that presses and holds still is pushed with what the tissue does to the tool, and comes to rest.

use super::blind::{DT_S, Servo, Tip, input_of, model_of, pressing};
use super::*;
use crate::contacts::LAW;
use glam::Vec3;
use hyst_coupling::{ContactModel, HandModel, HandState, Pose4, ServoParams, hand_dynamics};
use hyst_scene::Pose as Way;
use hyst_tissue::Isa;

/// Ticks in which the hand goes in, in which it comes to rest, and of those the last ones, which are looked at.
const IN: u64 = 900;
const HOLDS: u64 = 1_500;
const LOOKED_AT: u64 = 500;

/// What came of pressing.
#[derive(Debug, Default)]
struct Held {
    /// Peak to peak of the force in the end, N, and of the tip's place, m.
    buzz_n: f32,
    buzz_m: f32,
    /// What the hand feels in the end, friction included, and what the planes say, N.
    felt_n: Vec3,
    told_n: Vec3,
}

/// The hand goes where the scene's hand `press` does, as far as it is let.
fn pressed(main: &mut MainLoop<'_>, device: &OwnedPage, hand: &HandModel) -> Held {
    let pivot_m = main.world.case.pivot_m;
    let at = pressing(pivot_m);
    let target = |tick: u64| {
        let Way { pitch_rad, yaw_rad, roll_rad, insertion_m } = at(tick.min(IN));
        Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m }
    };
    let mut state = HandState::at_rest(hand, &target(0));
    let (mut servo, mut now, mut model) = (Servo::default(), first_state(main), ContactModel::default());
    let [mut low, mut high] = [f32::MAX, f32::MIN].map(|end| [Vec3::splat(end); 2]);
    for tick in 1..=IN + HOLDS {
        let tip = Tip { place_m: state.tip_m.into(), velocity_m_s: state.velocity_m_s.into() };
        // The force of the tick before acts while this one is computed.
        let acts_n = servo.force_n;
        servo.tick(tick, tip, &model, 1);
        let Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m } = state.pose;
        let record = input_of(main, tick, &Way { pitch_rad, yaw_rad, roll_rad, insertion_m }, tip);
        now = fed(main, device, &now, &record);
        model = model_of(main);
        state = hand_dynamics(hand, &state, &target(tick), acts_n.to_array(), DT_S);
        if tick + LOOKED_AT > IN + HOLDS {
            let seen = [servo.force_n, tip.place_m];
            low = [0, 1].map(|what| low[what].min(seen[what]));
            high = [0, 1].map(|what| high[what].max(seen[what]));
        }
    }
    let told_n = Vec3::from(main.planes.force_n(state.tip_m));
    let [buzz_n, buzz_m] = [0, 1].map(|what| high[what].distance(low[what]));
    Held { buzz_n, buzz_m, felt_n: servo.force_n, told_n }
}

/// Walls of the scene, and such as are three and ten times as stiff, in which a servo that is a tick late has most to do; a hand as in the station, and one that
/// damps no more than is relied on of device and grip, light and heavy.
#[test]
fn a_hand_that_presses_and_holds_still_is_pushed_by_what_the_tissue_does_and_comes_to_rest() {
    let hands = [(300.0, 0.15, 13.4), (300.0, 0.15, 3.0), (100.0, 0.1, 3.0)];
    for (stiffer, hands) in [(1.0, &hands[..]), (3.0, &hands[1..2]), (10.0, &hands[2..])] {
        for (stiffness_n_m, mass_kg, damping_n_s_m) in hands.iter().copied() {
            let (station, pages) = founded("grip", "workers = 0");
            let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
            let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
            let mut scene = hyst_scene::load_embedded().unwrap();
            scene.objects.iter_mut().for_each(|object| object.material.youngs_modulus_pa *= stiffer);
            let (workshop, world) = Workshop::open(&scene, Isa::detect()).unwrap();
            let mut main = MainLoop::new(&life, workshop, world).unwrap();
            main.arrival(page_of(&station, Role::Device), &mut inbox);
            let pivot_m = main.world.case.pivot_m;
            let hand = HandModel { stiffness_n_m, mass_kg, damping_n_s_m, pivot_m, ..HandModel::default() };
            let held = pressed(&mut main, &pages[1], &hand);
            let what =
                format!("{stiffer} times as stiff, a hand of {stiffness_n_m} N/m, {mass_kg} kg, {damping_n_s_m} N·s/m: {held:?}");
            println!("{what}");
            assert!(
                held.felt_n.length() > 1.0 && held.felt_n.length() < servo_limit_n(),
                "the hand hardly touches, or is at its limit: {what}"
            );
            assert!(
                (held.felt_n - held.told_n).length() < (LAW.friction + 0.01) * held.told_n.length(),
                "it feels another force: {what}"
            );
            assert!(held.buzz_n < 0.15 && held.buzz_m < 1e-4, "it does not come to rest: {what}");
            drop(main);
        }
    }
}

/// What no servo goes beyond, less a little, N.
fn servo_limit_n() -> f32 {
    0.99 * ServoParams::default().max_force_n
}
