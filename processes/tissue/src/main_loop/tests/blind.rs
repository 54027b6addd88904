//! Promise of tissue and servo about a hand that goes on for a tenth of a second while nobody steps the tissue: it feels the planes of the last state, no step
//! of the force comes of that, and the way back to fresh planes is as gentle as the servo's blend makes it.
//!
//! What of it is bounded by construction: planes that stand still make a force that changes by no more than their stiffness times the way of the tip, and that
//! of the tissue's is bounded (`most_stiffness_n_m`). So no step is left for the time without tissue. They are about as stiff as the wall of the default scene
//! is under the tip, and lead as far from the tissue meanwhile as the two differ; what of that the hand feels when fresh planes come is what the servo lets a
//! model change the force by in a tick.

use super::*;
use crate::contacts::LAW;
use crate::served::{DT_S, Servo, Tip, model_of};
use glam::Vec3;
use hyst_coupling::{ContactModel, ServoParams};
use hyst_scene::Pose as Way;

/// Speed of the hand, m/s.
pub(super) const SPEED_M_S: f32 = 0.02;
/// Ticks from the first contact until the tissue is heard no more, half a millimetre, and of a hand that does not go deeper then, or comes back; ticks without
/// it; those in which the hand goes on when it is back, and in which it rests then.
const DEEP: u64 = 25;
const DEEP_ASIDE: u64 = 75;
const DEEP_BACK: u64 = 175;
const BLIND: u64 = 100;
const ON: u64 = 20;
const RESTS: u64 = 150;
/// Ticks within which the tip meets the wall: four times the way that the hand `press` leaves before it.
pub(super) const MEETS: u64 = 600;
/// What a fault may add to the largest step of ticks without one, N.
const MARGIN_N: f32 = 0.05;

/// Where the scene's hand `press` is after so many ticks at the speed of these tests, on its way into the wall and on.
pub(super) fn pressing(pivot_m: [f32; 3]) -> impl Fn(u64) -> Way {
    let way = hyst_scene::load_embedded().unwrap().hand("press").unwrap().way.clone();
    let long_m = Vec3::from(way[0].tip_m(pivot_m)).distance(way[1].tip_m(pivot_m).into());
    move |ticks| way[0].towards(&way[1], ticks as f32 * SPEED_M_S * DT_S / long_m)
}

/// What the device says of a tick in which the hand is so.
pub(super) fn input_of(main: &MainLoop<'_>, tick: u64, pose: &Way, tip: Tip) -> InputRecord {
    let mut record = InputRecord { tick, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
    let (position_m, orientation) = (tip.place_m.to_array(), pose.orientation());
    record.sample.pose = Pose { position_m, orientation, insertion_m: pose.insertion_m, ..Pose::default() };
    record.sample.velocity_m_s = tip.velocity_m_s.to_array();
    record
}

/// A way of the tip changes the push by as much as the coupling makes of it, friction by its share of that, and the bristle by a tenth.
const FELT: f32 = 1.0 + LAW.friction + 0.1;

/// What the servo lets the force change by from one tick to the next, N: what the tip's motion makes of planes that stand still, and what a model that jumps may.
fn most_n(params: &ServoParams, before: Tip, now: Tip) -> f32 {
    let (way_m, speed_m_s) = (now.place_m.distance(before.place_m), now.velocity_m_s.length());
    let entered = speed_m_s * (way_m / params.damping_depth_m).min(1.0);
    let turned = now.velocity_m_s.distance(before.velocity_m_s);
    FELT * params.coupling_limit_n_m(DT_S) * way_m + params.max_damping_n_s_m * (turned + entered) + params.model_step_n
}

/// What was felt, N: the largest steps without tissue and with it in the same ticks, the step as it came back and the largest later, how far the two forces were
/// apart before that, and each and the distance at the end.
#[derive(Debug, Default)]
struct Felt {
    blind_n: f32,
    own_n: f32,
    back_n: f32,
    later_n: f32,
    apart_n: f32,
    end_n: f32,
    end_apart_n: f32,
}

impl Felt {
    /// Adds the tick so long after the last one whose planes the blind servo had in time.
    fn add(&mut self, since: u64, [blind, own]: [&Servo; 2]) {
        let apart_n = blind.force_n.distance(own.force_n);
        match since {
            0 => {}
            1..=BLIND => {
                (self.blind_n, self.own_n) = (self.blind_n.max(blind.step_n), self.own_n.max(own.step_n));
                self.apart_n = apart_n;
            }
            _ if since == BLIND + 1 => self.back_n = blind.step_n,
            _ => self.later_n = self.later_n.max(blind.step_n),
        }
        (self.end_n, self.end_apart_n) = (own.force_n.length(), apart_n);
    }
}

/// Where the hand goes on to while one servo hears nothing of the tissue: deeper into the wall, back out of it, or along it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Goes {
    Deeper,
    Back,
    Aside,
}

/// The hand goes into the wall on the way of the scene's hand `press`, and on; of two servos one hears nothing of the tissue for a while.
fn pressed(main: &mut MainLoop<'_>, device: &OwnedPage, goes: Goes) -> Felt {
    let deep = match goes {
        Goes::Deeper => DEEP,
        Goes::Back => DEEP_BACK,
        Goes::Aside => DEEP_ASIDE,
    };
    let pivot_m = main.world.case.pivot_m;
    let at = pressing(pivot_m);
    let mut tip = Tip { place_m: at(0).tip_m(pivot_m).into(), ..Tip::default() };
    let [mut blind, mut own] = [Servo::default(); 2];
    // A servo that has just begun lets the force come slowly.
    let warm = u64::from(own.params.return_ticks) + 10;
    for tick in 1..=warm {
        for servo in [&mut blind, &mut own] {
            servo.tick(tick, tip, &ContactModel::default(), 1);
        }
    }
    let (mut now, mut felt) = (first_state(main), Felt::default());
    let (mut fresh, mut frozen, mut deaf_at) = (ContactModel::default(), ContactModel::default(), u64::MAX);
    for tick in 1..=MEETS + deep + BLIND + ON + RESTS {
        let since = tick.saturating_sub(deaf_at);
        let on = since.min(BLIND + ON);
        let (deeper, aside) = match goes {
            Goes::Deeper => (on as i64, 0),
            Goes::Back => (-(on as i64), 0),
            Goes::Aside => (0, on),
        };
        let mut pose = at((tick - since).saturating_add_signed(deeper));
        pose.yaw_rad += aside as f32 * SPEED_M_S * DT_S / pose.insertion_m;
        let place_m = Vec3::from(pose.tip_m(pivot_m));
        let velocity_m_s = (place_m - tip.place_m) / DT_S;
        let before = std::mem::replace(&mut tip, Tip { place_m, velocity_m_s });
        let (model, age) = if (1..=BLIND).contains(&since) { (&frozen, since) } else { (&fresh, 1) };
        blind.tick(warm + tick, tip, model, age);
        own.tick(warm + tick, tip, &fresh, 1);
        for servo in [&blind, &own] {
            let (step_n, let_n) = (servo.step_n, most_n(&servo.params, before, tip));
            assert!(step_n < let_n + 1e-4, "tick {tick}, {since}: a step of {step_n} N, and {let_n} are let through");
        }
        felt.add(since, [&blind, &own]);
        if since == BLIND + ON + RESTS {
            return felt;
        }
        let record = input_of(main, tick, &pose, tip);
        now = fed(main, device, &now, &record);
        fresh = model_of(&main.planes);
        if deaf_at == u64::MAX && core_of(&now).contact_count > 0 {
            deaf_at = tick + deep;
        }
        if tick == deaf_at {
            frozen = fresh;
        }
    }
    panic!("the hand does not meet the wall within {MEETS} ticks");
}

fn feels_no_step(name: &str, goes: Goes) {
    let (station, pages, life, mut inbox) = begun(name);
    let mut main = engine(&station, &life, &mut inbox);
    let felt = pressed(&mut main, &pages[1], goes);
    let params = ServoParams::default();
    let of_motion_n = FELT * params.coupling_limit_n_m(DT_S) * SPEED_M_S * DT_S;
    println!("{goes:?}: {felt:?}");
    let least_n = if goes == Goes::Deeper { 1.0 } else { 0.3 };
    assert!(felt.end_n > least_n, "the hand hardly touches: {felt:?}");
    assert!(felt.apart_n > 1e-3, "the tissue does nothing that the frozen planes do not: {felt:?}");
    // A fifth of what the way of the tip makes of the wall, which goes on with 500 N/m.
    let of_way_n = 0.2 * 500.0 * SPEED_M_S * DT_S * BLIND as f32;
    assert!(felt.apart_n < of_way_n, "the frozen planes lead away by more than {of_way_n} N: {felt:?}");
    assert!(felt.blind_n <= felt.own_n + MARGIN_N, "{felt:?}");
    assert!(felt.back_n < of_motion_n + MARGIN_N && felt.later_n < of_motion_n + MARGIN_N, "{felt:?}");
    // A tip that stuck to other planes may be held back in another direction until it has slid on.
    let bristles_n = if goes == Goes::Deeper { 0.0 } else { LAW.friction * felt.end_n };
    assert!(felt.end_apart_n < 0.01 + bristles_n, "a hand that rests feels the tissue that there is: {felt:?}");
    drop(main);
}

#[test]
fn a_hand_that_goes_on_without_tissue_for_a_tenth_of_a_second_feels_no_step_nor_when_it_is_back() {
    feels_no_step("blind", Goes::Deeper);
}

#[test]
fn nor_does_one_that_slides_along_the_wall_meanwhile() {
    feels_no_step("blinda", Goes::Aside);
}

#[test]
fn nor_does_one_that_comes_back_out_of_it() {
    feels_no_step("blindb", Goes::Back);
}
