//! Promise of tissue and servo about a tip that slides along a wall: both are rubbed by the same coefficient, the tissue by what presses on it wherever it is,
//! the hand by what of that is felt at the tip.

use super::blind::{MEETS, SPEED_M_S, input_of, pressing};
use super::*;
use crate::contacts::LAW;
use crate::served::{DT_S, Servo, Tip, model_of};
use glam::Vec3;
use hyst_contact::Memory;
use hyst_coupling::ContactModel;
use hyst_scene::Pose as Way;

/// Ticks from the first contact into the wall; ticks to one side, and back by twice as many.
const DEEP: u64 = 75;
const ASIDE: u64 = 250;
/// Ticks of a way over which a force is the mean; and in which the tip stays where it is in the end.
const MEAN_OF: u64 = 40;
const STAYS: u64 = 300;

/// The model of the last step with the friction that the page says; its planes are those of the page.
fn told(main: &MainLoop<'_>, page: &hyst_exchange::ReadPage) -> ContactModel {
    let (_, model) = page.cell(tissue::MODEL).unwrap();
    assert_eq!(model.plane_count, main.planes.count);
    let told = model.planes.iter().map(|plane| (plane.point_m, plane.normal, plane.stiffness_n_m));
    let own = main.planes.planes.iter().map(|plane| (plane.point_m, plane.normal, plane.stiffness_n_m));
    assert!(told.zip(own).take(model.plane_count as usize).all(|(told, own)| told == own));
    ContactModel { friction: model.friction, ..model_of(&main.planes) }
}

/// What was felt on a way over one place in one direction: forces on the hand, N, the mean of some ticks.
#[derive(Clone, Copy, Debug, Default)]
struct Felt {
    /// Of the tissue on the tool.
    tool_n: Vec3,
    /// Of the servo, without friction.
    push_n: Vec3,
    /// Its friction.
    friction_n: Vec3,
}

/// What came of drawing the tip along the wall.
struct Drawn {
    /// What was felt on the way over the middle, back and on.
    felt: [Felt; 2],
    /// Which way it went on, a unit vector.
    aside: Vec3,
    /// The tissue's force on the tool as it stops, and once it has stood for a while, N.
    stands_n: [Vec3; 2],
    /// The last state, and what was said of the hand then.
    end: (Vec<u64>, InputRecord),
}

/// The tip is pressed into the wall, drawn to one side and back, and left there.
fn drawn(main: &mut MainLoop<'_>, device: &OwnedPage, own: &hyst_exchange::ReadPage) -> Drawn {
    let pivot_m = main.world.case.pivot_m;
    let at = pressing(pivot_m);
    let (mut servo, mut now, mut tip) = (Servo::default(), first_state(main), Tip::default());
    let bristle_n_m = 0.1 * servo.params.coupling_limit_n_m(DT_S);
    let (mut felt, mut met_at, mut aside) = ([Felt::default(); 2], u64::MAX, Vec3::ZERO);
    let mut stops_n = Vec3::ZERO;
    tip.place_m = at(0).tip_m(pivot_m).into();
    for tick in 1..=MEETS + DEEP + 4 * ASIDE + STAYS {
        let deep = tick.min(met_at.saturating_add(DEEP));
        let since = tick - deep;
        // To one side, back beyond the middle, and to it again.
        let aside_ticks = match since {
            0..=ASIDE => since as f32,
            _ if since <= 3 * ASIDE => 2.0 * ASIDE as f32 - since as f32,
            _ => since.min(4 * ASIDE) as f32 - 4.0 * ASIDE as f32,
        };
        let straight = at(deep);
        let yaw_rad = straight.yaw_rad + aside_ticks * SPEED_M_S * DT_S / straight.insertion_m;
        let pose = Way { yaw_rad, ..straight };
        let place_m = Vec3::from(pose.tip_m(pivot_m));
        tip = Tip { place_m, velocity_m_s: (place_m - tip.place_m) / DT_S };
        let record = input_of(main, tick, &pose, tip);
        now = fed(main, device, &now, &record);
        main.finished(&context(tick + 1), bytemuck::cast_slice(&now));
        servo.tick(tick, tip, &told(main, own), 1);
        let core = core_of(&now);
        if met_at == u64::MAX && core.contact_count > 0 {
            met_at = tick;
        }
        // The middle of the way back, and of the way on again.
        for (felt, middle) in felt.iter_mut().zip([2 * ASIDE, 4 * ASIDE - MEAN_OF / 2]) {
            if (middle - MEAN_OF / 2..middle + MEAN_OF / 2).contains(&since) {
                let friction_n = -bristle_n_m * Vec3::from(servo.state.bristle_m);
                felt.tool_n += Vec3::from(core.force_n) / MEAN_OF as f32;
                felt.push_n += (servo.force_n - friction_n) / MEAN_OF as f32;
                felt.friction_n += friction_n / MEAN_OF as f32;
                aside = tip.velocity_m_s.normalize();
            }
        }
        if since == 4 * ASIDE {
            stops_n = core.force_n.into();
        }
        if since == 4 * ASIDE + STAYS {
            return Drawn { felt, aside, stands_n: [stops_n, core.force_n.into()], end: (now, record) };
        }
    }
    panic!("the hand does not meet the wall within {MEETS} ticks");
}

#[test]
fn a_tip_that_slides_along_the_wall_is_held_back_by_the_friction_that_the_tissue_tells() {
    let (station, pages, life, mut inbox) = begun("rubs");
    let mut main = engine(&station, &life, &mut inbox);
    let own = station.read_slot(Slot::first(Role::Tissue), 1).unwrap();
    let Drawn { felt: [back, on], aside, stands_n, end } = drawn(&mut main, &pages[1], &own);
    println!("back {back:?}, on {on:?}, along {aside:?}, at the end {stands_n:?}");
    for (felt, way) in [(back, -aside), (on, aside)] {
        let (push_n, friction_n) = (felt.push_n.length(), felt.friction_n.length());
        assert!(push_n > 0.2, "the hand hardly touches: {felt:?}");
        assert!(
            (friction_n - LAW.friction * push_n).abs() < 0.1 * LAW.friction * push_n,
            "{friction_n} N of {push_n} N: {felt:?}"
        );
        assert!(felt.friction_n.dot(way) < -0.9 * friction_n, "it is held back: {felt:?}");
    }
    // What differs by the way that it goes is friction; what does not is the wall's slope.
    let [tissues_n, hands_n] = [back.tool_n - on.tool_n, back.friction_n - on.friction_n].map(|apart_n| 0.5 * apart_n.dot(aside));
    let pressed_n = 0.5 * (back.tool_n + on.tool_n).length();
    println!("friction: {hands_n} N of the hand, {tissues_n} N of the tissue, which is pressed with {pressed_n} N");
    // More than its share, for the wall is not flat: what slides along it climbs, too.
    let share = tissues_n / (LAW.friction * pressed_n);
    assert!((0.8..2.0).contains(&share), "{tissues_n} N where {pressed_n} N press");
    assert!((hands_n - LAW.friction * 0.5 * (back.push_n + on.push_n).length()).abs() < 0.1 * hands_n, "{hands_n} N");
    // What sticks holds a tip that stands.
    let [stops_n, stays_n] = stands_n.map(|force_n| force_n.dot(aside));
    assert!((stops_n - stays_n).abs() < 0.4 * LAW.friction * pressed_n, "{stops_n} N, then {stays_n} N");
    goes_on_from_any_memory(&mut main, &pages[1], end);
    drop(main);
}

/// Bits that flip in what the points remember cost a little friction, and nothing else.
fn goes_on_from_any_memory(main: &mut MainLoop<'_>, device: &OwnedPage, (state, record): (Vec<u64>, InputRecord)) {
    let next = InputRecord { tick: record.tick + 1, ..record };
    let usual_n = Vec3::from(core_of(&fed(main, device, &state, &next)).force_n);
    for bent_m in [f32::NAN, f32::INFINITY, 1e30, -0.03, 0.01] {
        let mut damaged = state.clone();
        let range = place_of(&damaged, 4);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut damaged);
        let memory: &mut [Memory] = bytemuck::cast_slice_mut(&mut bytes[range]);
        memory.iter_mut().for_each(|memory| memory.bent_m = [bent_m; 3]);
        let after = fed(main, device, &damaged, &next);
        assert!(positions(&after).as_flattened().iter().all(|part| part.is_finite()), "{bent_m}");
        let remembered: &[Memory] = bytemuck::cast_slice(&bytemuck::cast_slice::<u64, u8>(&after)[place_of(&after, 4)]);
        assert!(remembered.iter().flat_map(|memory| memory.bent_m).all(|part| part.abs() <= 0.01), "{bent_m}");
        let force_n = Vec3::from(core_of(&after).force_n);
        assert!(force_n.distance(usual_n) < 2.5 * LAW.friction * usual_n.length(), "{bent_m}: {force_n}, not {usual_n}");
    }
}
