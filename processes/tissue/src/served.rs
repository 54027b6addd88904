//! A servo beside the tissue, for tests that ask what a hand feels of it.

use crate::contacts::LAW;
use glam::Vec3;
use hyst_contact::PlaneSet;
use hyst_coupling::{ContactModel, Plane, ServoInput, ServoParams, ServoState, servo_step};

/// A tick, s.
pub const DT_S: f32 = 1e-3;

/// Planes as the servo is told them.
pub fn model_of(set: &PlaneSet) -> ContactModel {
    let planes = set.planes[..set.count as usize].iter().map(|plane| Plane {
        point_m: plane.point_m,
        normal: plane.normal,
        stiffness_n_m: plane.stiffness_n_m,
        damping_n_s_m: plane.damping_n_s_m,
    });
    ContactModel { friction: LAW.friction, ..ContactModel::new(&planes.collect::<Vec<_>>()) }
}

/// Where the tip is in a tick, m, and how fast, m/s.
#[derive(Clone, Copy, Default)]
pub struct Tip {
    pub place_m: Vec3,
    pub velocity_m_s: Vec3,
}

/// A servo, the force of its last tick, and by how much that was another one than the force before, N.
#[derive(Clone, Copy, Default)]
pub struct Servo {
    pub params: ServoParams,
    pub state: ServoState,
    pub force_n: Vec3,
    pub step_n: f32,
}

impl Servo {
    /// The tick with a model that is so old, ticks.
    pub fn tick(&mut self, tick: u64, tip: Tip, model: &ContactModel, age: u64) {
        let input = ServoInput {
            tick,
            position_m: tip.place_m.to_array(),
            velocity_m_s: tip.velocity_m_s.to_array(),
            dt_s: DT_S,
            model,
            model_age_ticks: age as u32,
            applied_n: None,
            medium_n: [0.0; 3],
        };
        let (state, output) = servo_step(&self.params, &self.state, &input);
        let force_n = Vec3::from(output.force_n);
        *self = Servo { state, force_n, step_n: force_n.distance(self.force_n), ..*self };
    }
}
