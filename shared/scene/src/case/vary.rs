//! The anatomy of a seed: what a case varies is drawn for each object and figure by itself, so that a further one changes none of the others.
//!
//! Promise: the same seed gives the same anatomy to the bit, on every machine: splitmix64 (Steele, Lea and Flood, OOPSLA 2014) over a hash of seed and names,
//! and nothing but + − × ÷ √.

use super::file::{Case, Vary};
use super::seat::Seat;
use crate::file::Scene;
use crate::hash::Fnv;

/// Tries to find a point within a circle: each fails one in five times.
const MOST_TRIES: u64 = 64;

/// Puts into the scene what the case sets and draws of materials, medium and vessels; answers how each object is to sit, and what was drawn beside that.
pub(crate) fn draw(case: &Case, seed: u32, scene: &mut Scene) -> (Vec<Option<Seat>>, Vec<String>) {
    let mut seats = vec![None; scene.deformable.len()];
    let mut drawn = Vec::new();
    if let Some(medium) = case.rules.medium {
        scene.fluid.medium = medium;
    }
    if let Some(set_pressure_pa) = case.rules.set_pressure_pa {
        // The meshes keep their shape at the pressure that they were made for.
        scene.fluid.rest_pressure_pa.get_or_insert(scene.fluid.set_pressure_pa);
        scene.fluid.set_pressure_pa = set_pressure_pa;
    }
    for vary in &case.vary {
        let Some(name) = &vary.object else {
            vessels(vary, seed, scene, &mut drawn);
            continue;
        };
        let Some(index) = scene.deformable.iter().position(|object| object.name == *name) else { continue };
        let of = |what: &str, limits: Option<[f64; 2]>| limits.map(|limits| between(seed, name, what, limits));
        if let Some(factor) = of("stiffness", vary.stiffness) {
            scene.deformable[index].material.youngs_modulus_pa *= factor;
            drawn.push(format!("{name}: {factor:.2} times as stiff as the scene has it"));
        }
        if vary.size.is_some() || vary.shift_m.is_some() {
            let size = of("size", vary.size).unwrap_or(1.0) as f32;
            let shift_m = of("shift", vary.shift_m).unwrap_or(0.0) as f32;
            seats[index] = Some(Seat { size, shift_m, direction: direction(seed, name) });
        }
    }
    (seats, drawn)
}

/// The vessels' figures; their calibres are drawn anew for each seed.
fn vessels(vary: &Vary, seed: u32, scene: &mut Scene, drawn: &mut Vec<String>) {
    let of = |what: &str, limits: Option<[f64; 2]>| limits.map(|limits| between(seed, "", what, limits));
    let vessels = &mut scene.vessels;
    vessels.seed = u64::from(seed);
    vessels.pressure_pa = of("pressure", vary.vessel_pressure_pa).unwrap_or(vessels.pressure_pa);
    vessels.spacing_m = of("spacing", vary.vessel_spacing_m).unwrap_or(vessels.spacing_m);
    vessels.conductance_ml_s_pa = of("conductance", vary.vessel_conductance_ml_s_pa).unwrap_or(vessels.conductance_ml_s_pa);
    drawn.push(format!(
        "vessels: {:.1} kPa, one in each {:.1} mm, up to {:.2e} ml/(s·Pa)",
        1e-3 * vessels.pressure_pa,
        1e3 * vessels.spacing_m,
        vessels.conductance_ml_s_pa
    ));
}

/// A number between two, each as likely.
fn between(seed: u32, who: &str, what: &str, [low, high]: [f64; 2]) -> f64 {
    (low + (high - low) * unit(seed, who, what, 0)).clamp(low, high)
}

/// A direction in the plane, each as likely: a point of the unit circle's inside, on its rim.
fn direction(seed: u32, who: &str) -> [f32; 2] {
    let point = |number: u64| [0, 1].map(|axis| 2.0 * unit(seed, who, "direction", 2 * number + axis) - 1.0);
    let length = |[x, y]: [f64; 2]| (x * x + y * y).sqrt();
    let inside = (0..MOST_TRIES).map(point).find(|point| (0.1..=1.0).contains(&length(*point)));
    inside.map_or([1.0, 0.0], |point| point.map(|coordinate| (coordinate / length(point)) as f32))
}

/// A number from 0 to below 1.
fn unit(seed: u32, who: &str, what: &str, number: u64) -> f64 {
    let mut hash = Fnv::new();
    hash.bytes(&seed.to_le_bytes());
    hash.bytes(&(who.len() as u64).to_le_bytes());
    hash.bytes(who.as_bytes());
    hash.bytes(what.as_bytes());
    hash.bytes(&number.to_le_bytes());
    let mut word = hash.finish().wrapping_add(0x9e37_79b9_7f4a_7c15);
    word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((word ^ (word >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fill_their_range_evenly_and_depend_on_seed_name_and_figure_alone() {
        let drawn: Vec<f64> = (0..4_000).map(|seed| between(seed, "polyp", "size", [2.0, 6.0])).collect();
        assert!(drawn.iter().all(|value| (2.0..=6.0).contains(value)));
        for quarter in 0..4 {
            let from = 2.0 + f64::from(quarter);
            let count = drawn.iter().filter(|value| (from..from + 1.0).contains(*value)).count();
            assert!((900..1_100).contains(&count), "{count} of 4000 in quarter {quarter}"); // 1000 ± 27
        }
        assert_eq!(between(7, "polyp", "size", [0.0, 1.0]), between(7, "polyp", "size", [0.0, 1.0]));
        let others = [between(8, "polyp", "size", [0.0, 1.0]), between(7, "myoma", "size", [0.0, 1.0])];
        assert!(others.iter().all(|other| *other != between(7, "polyp", "size", [0.0, 1.0])));
        assert_ne!(between(7, "polyp", "size", [0.0, 1.0]), between(7, "polyp", "shift", [0.0, 1.0]));
    }

    #[test]
    fn directions_have_length_one_and_go_everywhere() {
        let all: Vec<[f32; 2]> = (0..400).map(|seed| direction(seed, "polyp")).collect();
        assert!(all.iter().all(|[x, y]| (x.hypot(*y) - 1.0).abs() < 1e-6));
        for quadrant in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            let count = all.iter().filter(|[x, y]| x * quadrant[0] > 0.0 && y * quadrant[1] > 0.0).count();
            assert!((60..140).contains(&count), "{count} of 400 in {quadrant:?}"); // 100 ± 9
        }
    }
}
