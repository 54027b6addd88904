//! Promise of tissue, servo and hand in their loop: a hand that presses and holds still is pushed with what the tissue does to the tool, and comes to rest.

use super::blind::{input_of, pressing};
use super::*;
use crate::contacts::LAW;
use crate::served::{DT_S, Servo, Tip, model_of};
use glam::Vec3;
use hyst_coupling::{
    ContactModel, EnergyParams, EnergyState, HandModel, HandState, Pose4, ServoParams, energy_step, hand_dynamics,
};
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
    /// The least share of a force that the device's account of energy leaves.
    least_share: f32,
}

/// The hand goes where the scene's hand `press` does, as far as it is let.
fn pressed(main: &mut MainLoop<'_>, device: &OwnedPage, hand: &HandModel, mut servo: Servo) -> Held {
    let pivot_m = main.world.case.pivot_m;
    let at = pressing(pivot_m);
    let target = |tick: u64| {
        let Way { pitch_rad, yaw_rad, roll_rad, insertion_m } = at(tick.min(IN));
        Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m }
    };
    let mut state = HandState::at_rest(hand, &target(0));
    let (mut now, mut model, mut made_at) = (first_state(main), ContactModel::default(), 0);
    let (mut account, mut least_share) = (EnergyState::default(), 1.0f32);
    let [mut low, mut high] = [f32::MAX, f32::MIN].map(|end| [Vec3::splat(end); 2]);
    for tick in 1..=IN + HOLDS {
        let tip = Tip { place_m: state.tip_m.into(), velocity_m_s: state.velocity_m_s.into() };
        // The force of the tick before acts while this one is computed.
        let acts_n = servo.force_n;
        servo.tick(tick, tip, &model, tick - made_at);
        let (next, share) = energy_step(&EnergyParams::default(), &account, state.tip_m, acts_n.to_array(), DT_S);
        (account, least_share) = (next, least_share.min(share));
        let Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m } = state.pose;
        let record = input_of(main, tick, &Way { pitch_rad, yaw_rad, roll_rad, insertion_m }, tip);
        if is_read(main, tick) {
            now = fed(main, device, &now, &record);
            (model, made_at) = (model_of(&main.planes), tick);
        } else {
            device.push(device::INPUTS, tick, &record);
        }
        state = hand_dynamics(hand, &state, &target(tick), acts_n.to_array(), DT_S);
        if tick + LOOKED_AT > IN + HOLDS {
            let seen = [servo.force_n, tip.place_m];
            low = [0, 1].map(|what| low[what].min(seen[what]));
            high = [0, 1].map(|what| high[what].max(seen[what]));
        }
    }
    let told_n = Vec3::from(main.planes.force_n(state.tip_m));
    let [buzz_n, buzz_m] = [0, 1].map(|what| high[what].distance(low[what]));
    Held { buzz_n, buzz_m, felt_n: servo.force_n, told_n, least_share }
}

/// A wall, steps of the tissue, and a hand.
#[derive(Clone, Copy, Debug)]
struct Try {
    /// How many times as stiff as the scene's the walls are.
    stiffer: f64,
    step_ticks: u64,
    /// What is relied on of device and grip, and what they have, N·s/m.
    relied_on_n_s_m: f32,
    damping_n_s_m: f32,
    stiffness_n_m: f32,
    mass_kg: f32,
}

/// As in the station; and a hand that damps no more than is relied on.
const USUAL: Try =
    Try { stiffer: 1.0, step_ticks: 1, relied_on_n_s_m: 3.0, damping_n_s_m: 13.4, stiffness_n_m: 300.0, mass_kg: 0.15 };
const LOOSE: Try = Try { damping_n_s_m: 3.0, ..USUAL };
const LIGHT: Try = Try { stiffness_n_m: 100.0, mass_kg: 0.1, ..LOOSE };

fn held(number: usize, tried: &Try) -> Held {
    let (station, pages, life, mut inbox) = begun_with(tried.step_ticks, &format!("grip{number}"), "workers = 0");
    let mut scene = hyst_scene::load_embedded().unwrap();
    scene.objects.iter_mut().for_each(|object| object.material.youngs_modulus_pa *= tried.stiffer);
    let (workshop, world) = Workshop::open(&scene, Isa::detect()).unwrap();
    let mut main = MainLoop::new(&life, workshop, world).unwrap();
    main.arrival(page_of(&station, Role::Device), &mut inbox);
    let Try { stiffness_n_m, mass_kg, damping_n_s_m, relied_on_n_s_m, .. } = *tried;
    let pivot_m = main.world.case.pivot_m;
    let hand = HandModel { stiffness_n_m, mass_kg, damping_n_s_m, pivot_m, ..HandModel::default() };
    let servo = Servo { params: ServoParams::default().relying_on(relied_on_n_s_m), ..Servo::default() };
    let held = pressed(&mut main, &pages[1], &hand, servo);
    drop(main);
    held
}

/// Walls of the scene, and such as are three and ten times as stiff, of which more comes by new models than by planes that stand; steps of 4 ms; and a device of
/// 0.6 N·s/m, which feels a share.
#[test]
fn a_hand_that_presses_and_holds_still_is_pushed_by_what_the_tissue_does_and_comes_to_rest() {
    let weak = Try { relied_on_n_s_m: 0.6, damping_n_s_m: 0.6, ..LIGHT };
    let tries = [
        USUAL,
        LOOSE,
        LIGHT,
        Try { stiffer: 3.0, ..LOOSE },
        Try { stiffer: 10.0, ..LIGHT },
        Try { step_ticks: 4, ..USUAL },
        Try { step_ticks: 4, ..LOOSE },
        Try { stiffer: 10.0, step_ticks: 4, ..LIGHT },
        weak,
        Try { stiffer: 10.0, ..weak },
    ];
    for (number, tried) in tries.iter().enumerate() {
        let held = held(number, tried);
        let what = format!("{tried:?}: {held:?}");
        println!("{what}");
        let (felt_n, told_n) = (held.felt_n.length(), held.told_n.length());
        let share = if tried.relied_on_n_s_m < 3.0 { felt_n / told_n } else { 1.0 };
        assert!(
            felt_n > 0.3 && felt_n < 0.99 * ServoParams::default().max_force_n,
            "it hardly touches, or is at its limit: {what}"
        );
        assert!(share <= 1.0 && (held.felt_n - share * held.told_n).length() < (LAW.friction + 0.01) * felt_n, "{what}");
        assert!(held.buzz_n < 0.15 && held.buzz_m < 1e-4, "it does not come to rest: {what}");
        assert!(held.least_share == 1.0, "the device's account of energy takes force away: {what}");
    }
}
