//! What the medium exerts on the tissue in a step.

use crate::closing;
use crate::drift::drift_forces;
use crate::outlet::Draw;
use crate::state::Core;
use crate::world::World;
use hyst_tissue::{Pressure, pressure_forces};

/// Distension about the rest shape that the wall follows, Pa. The scene's rest shape is the cavity at its set pressure; farther from it the
/// wall would need the stress-free shape, which no mesh of a distended cavity holds. A cavity that is closed is held at its own shape.
const MAX_DISTENSION_PA: f32 = 2_000.0;
/// Distension up to which its force stays as it is for a step, Pa: the roller's beat. What the lag of such a force feeds to the wall grows with the
/// pressure, and is here a third of what damping takes where a wall of 12 kPa was cut.
const MAX_HELD_PA: f32 = 200.0;

/// Adds what the medium exerts: its pressure on the cavity's wall, which `pressure_pa` has room for, what leads the walls together where that is too
/// little, and its flow on what floats. A pressure whose force may not be held for a step is not added but given back, as a law.
pub(super) fn medium_forces<'a>(
    world: &'a World,
    (before, draw): (&Core, Option<&Draw>),
    nodes: (&[[f32; 3]], &[[f32; 3]]),
    dt_s: f32,
    pressure_pa: &mut [f32],
    node_force_n: &mut [[f32; 3]],
) -> Pressure<'a> {
    let distension_pa = before.pressure_pa - world.case.rest_pressure_pa;
    let shut = closing::share(before.closed);
    let on_wall_pa = (1.0 - shut) * distension_pa.clamp(-MAX_DISTENSION_PA, MAX_DISTENSION_PA);
    let is_held = on_wall_pa.abs() <= MAX_HELD_PA;
    if is_held {
        pressure_pa.fill(on_wall_pa);
        pressure_forces(&world.wall, nodes.0, pressure_pa, node_force_n);
    }
    world.shut(shut, node_force_n);
    drift_forces(&world.drifters, (&before.pieces, draw), nodes, (&world.model, dt_s), node_force_n);
    Pressure { triangles: &world.wall, pressure_pa: if is_held { 0.0 } else { on_wall_pa } }
}
