//! The pressure of a medium on a wall, which turns with the wall in every substep.
//!
//! A force that is held for a step while the wall moves on lags half a step behind it. On a mode of frequency ω and amplitude a it does the work
//! k·(1 − cos ωτ)·a²/2 in each step, with τ the step and k what the force changes by per way. Where that is more than damping takes, the mode
//! grows until its nodes are at the velocity's cap, as those of a wall of 9 kPa under −2 kPa are within half a second (test `pressure`). No
//! number of substeps helps, for the lag is that of the step. As a law the pressure on a closed surface has a potential, and feeds nothing.
//!
//! Its stiffness at a node is at most a sixth of the pressure times the perimeters of the triangles around the node. The model's bound does not
//! have it: it is some N/m for 2 kPa and triangles of 3 mm. Who presses much harder gives the model that much more contact stiffness.

use crate::step::EXTERNAL_FORCE_MAX_N;

/// A pressure that is alike on a part of the boundary.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pressure<'a> {
    /// Triangles of nodes, counter-clockwise seen from the medium. Those that name a node that is not there are left out.
    pub triangles: &'a [[u32; 3]],
    /// Pressure, Pa: a positive one pushes into the tissue. One that is not finite, or beyond all reason, counts as none.
    pub pressure_pa: f32,
}

impl Pressure<'_> {
    /// Adds a third of each triangle's force to each of its nodes, at the places where they are.
    pub(crate) fn add_forces(&self, position: &[[f32; 4]], force: &mut [[f32; 4]]) {
        if self.pressure_pa == 0.0 || !(-EXTERNAL_FORCE_MAX_N..=EXTERNAL_FORCE_MAX_N).contains(&self.pressure_pa) {
            return;
        }
        let share_pa = -self.pressure_pa / 6.0;
        for triangle in self.triangles {
            let [a, b, c] = triangle.map(|node| node as usize);
            let (Some(origin), Some(one), Some(two)) = (position.get(a), position.get(b), position.get(c)) else { continue };
            let (u, v) = (minus(one, origin), minus(two, origin));
            let twice_area = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            let share_n = twice_area.map(|part| share_pa * part);
            if !share_n.iter().all(|part| part.is_finite()) {
                continue;
            }
            for node in [a, b, c] {
                force[node].iter_mut().zip(share_n).for_each(|(sum, part)| *sum += part);
            }
        }
    }
}

fn minus(a: &[f32; 4], b: &[f32; 4]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
