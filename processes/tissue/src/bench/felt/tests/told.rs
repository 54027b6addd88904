//! What a servo makes of the planes of a press for a hand that holds the tip where they were made: what they say.

use crate::bench::press::{Press, Record};
use glam::Vec3;
use hyst_coupling::{ContactModel, Plane, ServoInput, ServoParams, ServoState, servo_step};

/// Ticks after which a servo that has just begun feels planes in full.
const WARM_TICKS: u64 = 1_000;
/// How far what is felt may be from what is told, as a share: places of planes are rounded to some nanometres.
const MOST: f32 = 1e-3;

/// The force of a servo that has felt the planes for a while with the tip at a place, N.
fn served_n(press: &Press, tip_m: [f32; 3]) -> Vec3 {
    let planes = press.planes();
    let used = planes.planes[..planes.count as usize].iter().map(|plane| Plane {
        point_m: plane.point_m,
        normal: plane.normal,
        stiffness_n_m: plane.stiffness_n_m,
        damping_n_s_m: plane.damping_n_s_m,
    });
    let (params, model) = (ServoParams::default(), ContactModel::new(&used.collect::<Vec<_>>()));
    let mut state = ServoState::default();
    for tick in 1..=WARM_TICKS {
        let input = ServoInput {
            tick,
            position_m: tip_m,
            velocity_m_s: [0.0; 3],
            dt_s: 1e-3,
            model: &model,
            model_age_ticks: 1,
            applied_n: None,
            medium_n: [0.0; 3],
        };
        state = servo_step(&params, &state, &input).0;
    }
    Vec3::from(state.force_n)
}

/// Fails if the hand would feel another force than it is told in a tick.
pub fn assert_felt(what: &str, tick: usize, (press, record): &(Press, Record)) {
    let (told_n, served_n) = (Vec3::from(record.told_n), served_n(press, press.tip_m(tick)));
    let off_n = told_n.distance(served_n);
    assert!(off_n <= MOST * told_n.length() + 1e-4, "{what}, tick {tick}: {served_n} N are felt of {told_n} N");
}
