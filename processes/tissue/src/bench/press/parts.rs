//! What the force on the tool is made of, and what the hand is told of it: for tests that ask where the two part.

use super::Press;
use crate::contacts::LAW;
use glam::Vec3;
use hyst_contact::PlaneSet;
use hyst_tissue::StateRef;

/// Sums over the tool's contacts; forces are those on the tool.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parts {
    /// What the springs push with, N: all that the planes know of, there by the lever.
    pub pushed_n: Vec3,
    /// What damping along the normals adds, N.
    pub damped_n: Vec3,
    /// What friction adds, N.
    pub rubbed_n: Vec3,
    /// The amounts of what each spring pushes with, N, however they are directed: friction is at most its coefficient times as much.
    pub pressed_n: f32,
    /// The amounts of the friction of each contact, N.
    pub friction_n: f32,
    /// Stiffness of those that push, N/m.
    pub stiffness_n_m: f32,
    /// How many push.
    pub count: u32,
}

impl Parts {
    /// All of it, N.
    pub fn force_n(&self) -> Vec3 {
        self.pushed_n + self.damped_n + self.rubbed_n
    }
}

impl Press {
    /// What the force on the tool after the last step is made of: what the springs of that step do to the state that it wrote.
    pub fn parts(&self) -> Parts {
        let (model, input) = (&self.shared.world.model, self.shared.input.read());
        let after = StateRef { position_m: &input.positions_m, velocity_m_s: &self.velocities_m_s };
        let mut parts = Parts::default();
        for spring in self.contacts.springs() {
            let push = self.scratch.push(model, &LAW, spring, &after);
            if push.normal_n <= 0.0 {
                continue;
            }
            let (normal, force_n) = (Vec3::from(spring.normal), Vec3::from(push.force_n));
            let along_n = force_n.dot(normal);
            let rubbed_n = force_n - along_n * normal;
            parts.pushed_n -= push.normal_n * normal;
            parts.damped_n -= (along_n - push.normal_n) * normal;
            parts.rubbed_n -= rubbed_n;
            parts.pressed_n += push.normal_n;
            parts.friction_n += rubbed_n.length();
            parts.stiffness_n_m += push.stiffness_n_m;
            parts.count += 1;
        }
        parts
    }

    /// The planes of the last step, and where the tip is in a tick, m.
    pub fn planes(&self, tick: usize) -> (PlaneSet, [f32; 3]) {
        (self.planes, self.pose(tick).position_m)
    }
}
