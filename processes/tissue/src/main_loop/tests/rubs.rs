//! Promise of tissue and servo about a tip that slides along a wall: both are rubbed by the same coefficient, the tissue by what presses on it wherever it is,
//! the hand by what of that is felt at the tip.

use super::blind::{Servo, Tip};
use super::*;
use crate::contacts::LAW;
use glam::Vec3;
use hyst_coupling::{ContactModel, Plane};
use hyst_scene::Pose as Way;

/// Speed of the hand, m/s, and a tick, s.
const SPEED_M_S: f32 = 0.02;
const DT_S: f32 = 1e-3;
/// Ticks from the first contact into the wall; ticks to one side, and back by twice as many.
const DEEP: u64 = 75;
const ASIDE: u64 = 250;
/// Ticks within which the tip meets the wall.
const MEETS: u64 = 600;
/// Ticks of a way over which a force is the mean.
const MEAN_OF: u64 = 40;

/// The model of the last step, as the servo reads it in the page.
fn told(main: &MainLoop<'_>, page: &hyst_exchange::ReadPage) -> ContactModel {
    let (_, model) = page.cell(tissue::MODEL).unwrap();
    assert_eq!(model.plane_count, main.planes.count);
    let planes: Vec<Plane> = model.planes[..model.plane_count as usize]
        .iter()
        .map(|plane| Plane {
            point_m: plane.point_m,
            normal: plane.normal,
            stiffness_n_m: plane.stiffness_n_m,
            damping_n_s_m: plane.damping_n_s_m,
        })
        .collect();
    ContactModel { friction: model.friction, ..ContactModel::new(&planes) }
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

/// The tip is pressed into the wall and drawn to one side and back. Gives what was felt on the way over the middle in each direction, and which way that went.
fn drawn(main: &mut MainLoop<'_>, device: &OwnedPage, own: &hyst_exchange::ReadPage) -> ([Felt; 2], Vec3) {
    let scene = hyst_scene::load_embedded().unwrap();
    let (way, pivot_m) = (scene.hand("press").unwrap().way.clone(), main.world.case.pivot_m);
    let long_m = Vec3::from(way[0].tip_m(pivot_m)).distance(way[1].tip_m(pivot_m).into());
    let (mut servo, mut now, mut tip) = (Servo::default(), first_state(main), Tip::default());
    let bristle_n_m = 0.1 * servo.params.coupling_limit_n_m(DT_S);
    let (mut felt, mut met_at, mut aside) = ([Felt::default(); 2], u64::MAX, Vec3::ZERO);
    tip.place_m = way[0].tip_m(pivot_m).into();
    for tick in 1..=MEETS + DEEP + 4 * ASIDE {
        let deep = tick.min(met_at.saturating_add(DEEP));
        let since = tick - deep;
        // To one side, back beyond the middle, and to it again.
        let aside_ticks = match since {
            0..=ASIDE => since as f32,
            _ if since <= 3 * ASIDE => 2.0 * ASIDE as f32 - since as f32,
            _ => since as f32 - 4.0 * ASIDE as f32,
        };
        let straight = way[0].towards(&way[1], deep as f32 * SPEED_M_S * DT_S / long_m);
        let yaw_rad = straight.yaw_rad + aside_ticks * SPEED_M_S * DT_S / straight.insertion_m;
        let pose = Way { yaw_rad, ..straight };
        let place_m = Vec3::from(pose.tip_m(pivot_m));
        tip = Tip { place_m, velocity_m_s: (place_m - tip.place_m) / DT_S };
        let (position_m, orientation) = (place_m.to_array(), pose.orientation());
        let mut record = InputRecord { tick, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
        record.sample.pose = Pose { position_m, orientation, insertion_m: pose.insertion_m, ..Pose::default() };
        record.sample.velocity_m_s = tip.velocity_m_s.to_array();
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
        if since >= 4 * ASIDE {
            return (felt, aside);
        }
    }
    panic!("the hand does not meet the wall within {MEETS} ticks");
}

#[test]
fn a_tip_that_slides_along_the_wall_is_held_back_by_the_friction_that_the_tissue_tells() {
    let (station, pages) = founded("rubs", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let own = station.read_slot(Slot::first(Role::Tissue), 1).unwrap();
    let ([back, on], aside) = drawn(&mut main, &pages[1], &own);
    println!("back {back:?}, on {on:?}, along {aside:?}");
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
    drop(main);
}
