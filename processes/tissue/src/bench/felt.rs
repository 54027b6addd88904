//! What the real-time settings cost in truth: the force that the hand feels and the displacement of the tissue, beside the solution that is converged in
//! time on the same mesh, with the same tool in the same places. There steps are shorter, and with them the contacts are looked for more often, and
//! nowhere is mass added. And what the contact gives way by itself, which both have alike: beside the same short steps with a contact many times as stiff.

use super::press::{Press, Record};
use crate::world::Otherwise;
use hyst_scene::LoadedScene;
use hyst_tissue::Isa;

/// Ticks between two looks at the displacement.
const LOOK: usize = 20;

/// How far two solutions are apart, as shares of the largest figure of the converged one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Apart {
    /// Of the force on the tool.
    pub force: f64,
    /// Of the displacement of a node.
    pub displacement: f64,
    /// Largest force, N.
    pub most_n: f64,
    /// Largest displacement, m.
    pub most_m: f64,
}

/// How far two places, or forces, are apart.
pub fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// The same of the two of some places that are farthest apart.
pub fn farthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| distance(*a, *b)).fold(0.0, f64::max)
}

/// So many ticks of the scene's hand with the settings of the station, and `finer` times as fine.
pub fn apart(scene: &LoadedScene, finer: [u32; 2], ticks: usize) -> Result<Apart, String> {
    between(scene, finer.map(|finer| Otherwise { finer, ..Otherwise::default() }), ticks)
}

/// The same, both `finer` times as fine, with the contacts of the station, and with such as are `stiffer` times as stiff.
pub fn softness(scene: &LoadedScene, finer: u32, stiffer: f32, ticks: usize) -> Result<Apart, String> {
    between(scene, [1.0, stiffer].map(|stiffer| Otherwise { finer, stiffer, ..Otherwise::default() }), ticks)
}

/// How far the first of two runs is from the second.
fn between(scene: &LoadedScene, otherwise: [Otherwise; 2], ticks: usize) -> Result<Apart, String> {
    let mut press = Vec::new();
    for otherwise in otherwise {
        press.push((Press::with(scene, Isa::detect(), 1, otherwise)?, Record::default()));
    }
    let mut apart = Apart::default();
    for tick in 0..ticks {
        for (press, record) in &mut press {
            press.tick(tick, record)?;
        }
        let [(coarse, felt), (fine, right)] = &press[..] else { return Err("two runs".into()) };
        apart.force = apart.force.max(distance(felt.force_n, right.force_n));
        apart.most_n = apart.most_n.max(distance(right.force_n, [0.0; 3]));
        if tick % LOOK == 0 {
            let (coarse_m, fine_m) = (coarse.positions_m(), fine.positions_m());
            apart.displacement = apart.displacement.max(farthest(&coarse_m, &fine_m));
            apart.most_m = apart.most_m.max(farthest(&fine_m, fine.rest_m()));
        }
    }
    apart.force /= apart.most_n.max(f64::MIN_POSITIVE);
    apart.displacement /= apart.most_m.max(f64::MIN_POSITIVE);
    Ok(apart)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// What is allowed, as a share of the largest figure of the converged solution.
    const MOST: f64 = 0.05;
    /// Ticks of the hand, and what it has pressed with by then, N, at the least.
    const TICKS: usize = 1_000;
    const LEAST_N: f64 = 1.0;

    fn assert_near(name: &str, finer: u32) {
        assert_pressed(name, finer, LEAST_N);
    }

    fn assert_pressed(name: &str, finer: u32, least_n: f64) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes").join(format!("{name}.toml"));
        let apart = apart(&hyst_scene::load(&path).unwrap(), [1, finer], TICKS).unwrap();
        println!("{name}, beside {finer} times as fine: {apart:?}");
        assert!(apart.most_n > least_n && apart.most_m > 1e-3, "{name}: the hand hardly touches: {apart:?}");
        assert!(apart.force < MOST && apart.displacement < MOST, "{name}: {apart:?}");
        assert!(apart.force > 0.0, "{name}: the two are one");
    }

    #[test]
    fn force_and_displacement_of_the_default_scene_are_near_the_converged_ones() {
        assert_near("default", 8);
    }

    #[test]
    fn those_of_the_myoma_are() {
        assert_near("myoma", 8);
    }

    #[test]
    fn those_of_the_medium_polyp_are() {
        assert_near("polyp-medium", 8);
    }

    #[test]
    fn those_of_three_polyps_are() {
        assert_near("three-polyps", 4);
    }

    #[test]
    fn those_of_a_uterus_of_several_tissues_on_beds_are() {
        assert_pressed("regions", 8, 0.8); // its beds are soft
    }

    #[test]
    fn those_of_the_septum_are() {
        assert_near("septum", 8);
    }

    /// The scene with a loose piece, and jaws for a loop; `rinsing` has the tissue and the instrument of the default scene.
    #[test]
    fn those_of_the_grasper_are() {
        assert_near("grasper", 8);
    }

    /// A contact that is many times as stiff is met with more force, and does not swing in steps as short as these. Expected of ten times: a fifth to a third
    /// of the force, for a contact of 7.5e7 N/m³ under the tip's circle of 1 to 2 mm is about as soft as tissue of 30 kPa is there.
    #[test]
    fn what_the_contact_itself_gives_way_is_seen_and_is_not_all() {
        let scene = hyst_scene::load_embedded().unwrap();
        let [some, more] = [3.0, 10.0].map(|stiffer| softness(&scene, 4, stiffer, 600).unwrap());
        println!("beside contacts 3 and 10 times as stiff: {some:?} {more:?}");
        for apart in [some, more] {
            assert!((0.01..0.6).contains(&apart.force) && apart.displacement < 0.6, "{apart:?}");
        }
    }

    /// What is compared can fail: steps that are longer than the station's are farther from the truth than it allows.
    #[test]
    fn a_coarse_step_is_seen() {
        let scene = hyst_scene::load_embedded().unwrap();
        let [finer, coarser] = [[2, 8], [1, 8]].map(|finer| apart(&scene, finer, 600).unwrap());
        assert!(finer.displacement < coarser.displacement, "{finer:?} {coarser:?}");
    }
}
