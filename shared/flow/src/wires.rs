//! Wires: obstacles thinner than a cell. They fill none; the medium that goes across them is dragged along, and they by it.
//!
//! Force across a wire of diameter d per length: ½·ρ·C·d·|v|·v with the relative velocity v across it, and C = 1 + 10·Re^(−⅔), a fit to measured cylinders for
//! Re = |v|·d/ν from 1 to 2·10⁵ (White, Viscous Fluid Flow, 1991). Along a wire nothing drags. Each piece acts on the eight faces of a component around
//! it. Promise: the change is implicit, so that no face overshoots the wire's velocity, however long the step.

use crate::blood::{faces_around, velocity_at};
use crate::error::FlowError;
use crate::inputs::{Capsule, MAX_WIRES};
use crate::plan::Plan;
use crate::solver::Solver;

/// Pieces of all wires of a step at most; a wire of 40 mm in cells of 0.4 mm has 200.
const MAX_PIECES: usize = 1_024;
/// A piece acts on eight faces of each component.
pub(crate) const MAX_DRAGS: usize = 24 * MAX_PIECES;
/// Slower is at rest.
const REST_M_S: f32 = 1e-6;

/// What a piece of wire does to a face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drag {
    pub component: usize,
    /// Padded layer.
    pub kk: usize,
    /// Offset in the plane.
    pub at: usize,
    /// Rate of the drag times the step.
    rate: f32,
    /// What the face would come to in the end, m/s.
    toward_m_s: f32,
}

impl Drag {
    /// The face's velocity after the step.
    pub fn pull(&self, velocity_m_s: &mut f32) {
        *velocity_m_s = (*velocity_m_s + self.rate * self.toward_m_s) / (1.0 + self.rate);
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Solver {
    /// Finds what the wires do to the medium in this step; what it does to them is known once it is done ([`crate::traction`]).
    pub(crate) fn place_wires(&self, plan: &mut Plan) -> Result<(), FlowError> {
        plan.drags.clear();
        let (grid, mut pieces) = (&self.model.grid, 0);
        let least_m = grid.spacing_m().into_iter().fold(f32::INFINITY, f32::min);
        let wires: [Capsule; MAX_WIRES] = plan.inputs.wires;
        for wire in wires.iter().filter(|wire| wire.radius_m > 0.0) {
            let along: [f32; 3] = std::array::from_fn(|axis| wire.b_m[axis] - wire.a_m[axis]);
            let length_m = dot(along, along).sqrt();
            let count = ((2.0 * length_m / least_m).ceil() as usize).min(MAX_PIECES - pieces);
            if length_m <= 0.0 || count == 0 {
                continue;
            }
            pieces += count;
            let direction = along.map(|x| x / length_m);
            for piece in 0..count {
                let t = (piece as f32 + 0.5) / count as f32;
                let own = Piece {
                    place_m: std::array::from_fn(|axis| wire.a_m[axis] + t * along[axis]),
                    direction,
                    length_m: length_m / count as f32,
                    diameter_m: 2.0 * wire.radius_m,
                    velocity_m_s: std::array::from_fn(|axis| {
                        wire.velocity_a_m_s[axis] + t * (wire.velocity_b_m_s[axis] - wire.velocity_a_m_s[axis])
                    }),
                };
                self.place_piece(&own, plan)?;
            }
        }
        Ok(())
    }

    /// What a piece does; nothing outside of the grid.
    fn place_piece(&self, piece: &Piece, plan: &mut Plan) -> Result<(), FlowError> {
        let (grid, layout) = (&self.model.grid, &*self.layout);
        let place = grid.to_cells(piece.place_m);
        if !(0..3).all(|axis| place[axis] >= 0.0 && place[axis] < layout.n[axis] as f32) {
            return Ok(());
        }
        let flow = velocity_at(&self.read_velocity(plan.roles.now)?, layout, place);
        let across = piece.across(flow);
        let speed = dot(across, across).sqrt();
        if !(speed.is_finite() && speed > REST_M_S) {
            return Ok(());
        }
        let reynolds = speed * piece.diameter_m / self.model.medium.viscosity_m2_s.max(f32::MIN_POSITIVE);
        let drag = 0.5 * (1.0 + 10.0 * reynolds.powf(-2.0 / 3.0)) * piece.diameter_m * piece.length_m * speed; // m³/s
        let rate = drag / grid.cell_volume_m3() as f32 * plan.inputs.dt_s;
        for component in 0..3 {
            let toward_m_s = flow[component] - across[component];
            let (base, t) = faces_around(layout, component, place);
            for corner in 0..8usize {
                let high: [usize; 3] = std::array::from_fn(|axis| corner >> axis & 1);
                let weight: f32 = (0..3).map(|axis| if high[axis] == 1 { t[axis] } else { 1.0 - t[axis] }).product();
                let cell: [usize; 3] = std::array::from_fn(|axis| base[axis] + high[axis]);
                let is_inside = (0..3).all(|axis| (1..=layout.n[axis]).contains(&cell[axis]));
                if weight > 0.0 && is_inside {
                    let at = cell[1] * layout.stride + cell[0];
                    plan.drags.push(Drag { component, kk: cell[2], at, rate: rate * weight, toward_m_s });
                }
            }
        }
        Ok(())
    }
}

/// A straight piece of a wire, shorter than a cell.
struct Piece {
    place_m: [f32; 3],
    direction: [f32; 3],
    length_m: f32,
    diameter_m: f32,
    velocity_m_s: [f32; 3],
}

impl Piece {
    /// How fast a flow goes across it, m/s.
    fn across(&self, flow: [f32; 3]) -> [f32; 3] {
        let relative: [f32; 3] = std::array::from_fn(|axis| flow[axis] - self.velocity_m_s[axis]);
        let along = dot(relative, self.direction);
        std::array::from_fn(|axis| relative[axis] - along * self.direction[axis])
    }
}
