//! The anatomy of a seed: what a case varies is drawn for each object and figure by itself, so that a further one changes none of the others.
//!
//! Promise: the same seed gives the same anatomy to the bit, on every machine: splitmix64 (Steele, Lea and Flood, OOPSLA 2014) over a hash of seed and names,
//! and nothing but + − × ÷ √.

use super::file::{Case, Mirror, Vary};
use super::seat::{Seat, Seats};
use crate::file::Scene;
use crate::hash::Fnv;
use crate::mirror::{self, Planes};

/// Tries to find a point within a circle: each fails one in five times.
const MOST_TRIES: u64 = 64;

/// Puts into the scene what the case sets and draws of materials, medium and vessels, and its mirror image where that is drawn; answers how each object is to
/// sit, and what was drawn beside that.
pub(crate) fn draw(case: &Case, seed: u32, scene: &mut Scene) -> (Seats, Vec<String>) {
    let mut seats = Seats { of: vec![None; scene.deformable.len()], mirrored: planes(case, seed) };
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
            let object = &mut scene.deformable[index];
            object.material.youngs_modulus_pa *= factor;
            // Its regions are as much stiffer or softer than the rest as they were.
            let of_regions = object.region.iter_mut().filter_map(|region| region.youngs_modulus_pa.as_mut());
            of_regions.for_each(|youngs_modulus_pa| *youngs_modulus_pa *= factor);
            drawn.push(format!("{name}: {factor:.2} times as stiff as the scene has it"));
        }
        if vary.size.is_some() || vary.shift_m.is_some() {
            let size = of("size", vary.size).unwrap_or(1.0) as f32;
            let shift_m = of("shift", vary.shift_m).unwrap_or(0.0) as f32;
            seats.of[index] = Some(Seat { size, shift_m, direction: direction(seed, name) });
        }
    }
    mirror::scene(scene, seats.mirrored);
    let words = ["what the scene has on the patient's right is on the left", "what the scene has anterior is posterior"];
    let mirrored = words.into_iter().zip(seats.mirrored).filter(|(_, is)| *is);
    drawn.extend(mirrored.map(|(words, _)| format!("mirrored: {words}")));
    (seats, drawn)
}

/// About which planes a seed mirrors what may be mirrored.
fn planes(case: &Case, seed: u32) -> Planes {
    let is_drawn = |side: Mirror, what: &str| {
        let mut allowed = case.vary.iter().flat_map(|vary| &vary.mirror);
        allowed.any(|one| *one == side) && unit(seed, "", what, 0) < 0.5
    };
    [is_drawn(Mirror::Side, "mirrored"), is_drawn(Mirror::Wall, "posterior")]
}

/// The vessels' figures; their calibres are drawn anew for each seed of a case that varies them.
fn vessels(vary: &Vary, seed: u32, scene: &mut Scene, drawn: &mut Vec<String>) {
    let of = |what: &str, limits: Option<[f64; 2]>| limits.map(|limits| between(seed, "", what, limits));
    if [vary.vessel_pressure_pa, vary.vessel_spacing_m, vary.vessel_conductance_ml_s_pa].iter().all(Option::is_none) {
        return; // it mirrors
    }
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
    fn half_of_the_seeds_are_mirrored_each_way_a_quarter_both_ways_and_the_first_none() {
        let may = |mirror: &str| -> Case {
            let text = "version = 1\nname = \"x\"\nrung = \"polyp\"\ntask = \"x\"\nscene = \"x\"\n[[vary]]\nmirror = ";
            toml::from_str(&format!("{text}{mirror}\n")).unwrap()
        };
        let both = may("[\"wall\", \"side\"]");
        let count = |is: fn(&Planes) -> bool| (1..=200).map(|seed| planes(&both, seed)).filter(is).count();
        for (count, from, to) in [
            (count(|[side, _]| *side), 79, 121), // 100 ± 7
            (count(|[_, wall]| *wall), 79, 121),
            (count(|[side, wall]| *side && *wall), 32, 68), // 50 ± 6
            (count(|[side, wall]| !*side && !*wall), 32, 68),
        ] {
            assert!((from..=to).contains(&count), "{count} of 200");
        }
        assert_eq!(planes(&both, 1), [false, false], "hands and words are written for the first");
        for seed in 1..=200 {
            let [side, wall] = planes(&both, seed);
            assert_eq!([planes(&may("[\"side\"]"), seed), planes(&may("[\"wall\"]"), seed)], [[side, false], [false, wall]]);
            assert_eq!(planes(&may("[]"), seed), [false, false]);
        }
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
