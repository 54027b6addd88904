//! How far one sees through the medium: the green light that blood takes on its way along straight rays (Beer–Lambert), on the solver's grid.
//!
//! Promise: a pure function of its arguments, with the same bits on the same machine; whatever numbers come in, what comes out is a share from 0 to 1 or
//! nothing, and no ray takes more than eighty looks at the grid.

use crate::grid::Grid;
use crate::state::StateView;

/// Extinction of green light by undiluted blood as it is drawn and as the view is judged by it, 1/m: an eighth of what whole blood has
/// (`processes/rendering/src/blood.rs`). In saline blood draws opaque threads: some 0.5 mm wide (assumed), of which a metre of a medium that holds the share f
/// in them meets 4 f / (π 0.0005) = 2 500 f. A cell of the flow, a millimetre or two wide, knows that share alone: with the whole extinction a
/// drop of a microlitre, the least that a vessel gives and less than a cell, would hide all behind the eight cells that it is spread over.
pub const EXTINCTION_PER_M: f32 = 2_687.5;
/// So far is looked, m: across a uterine cavity, and where a lens is focused that is not set (20 mm).
pub const SIGHT_M: f32 = 0.02;
/// Looks along a ray, a quarter of a millimetre apart: a quarter of the shortest edge of a cell of the scenes' grids.
const STEPS: usize = 80;

/// The mean share of the light that comes through the blood along some rays, each a unit vector from the eye, over [`SIGHT_M`] or until it meets a solid cell
/// (nonzero in `solid`) or the grid's end: exp(−[`EXTINCTION_PER_M`] · density · length). 0 to 1; one ray that meets the wall at once counts as 1. `density`
/// and `solid` have an entry for each cell, x fastest, the first as a volume fraction; what is no number or below 0 there counts as clear. `None` where no ray
/// goes through the medium: the eye is in a solid or outside of the grid.
pub fn transmittance(grid: &Grid, (density, solid): (&[f32], &[u8]), eye_m: [f32; 3], rays: &[[f32; 3]]) -> Option<f32> {
    let (mut sum, mut is_in_medium) = (0.0_f32, false);
    for ray in rays {
        let depth = optical_depth(grid, density, solid, eye_m, *ray);
        is_in_medium |= depth.is_some();
        sum += depth.map_or(1.0, |depth| (-depth).exp());
    }
    is_in_medium.then(|| (sum / rays.len() as f32).clamp(0.0, 1.0))
}

impl StateView<'_> {
    /// The same through the blood of this state, as far as the tissue's walls.
    pub fn transmittance(&self, eye_m: [f32; 3], rays: &[[f32; 3]]) -> Option<f32> {
        transmittance(self.grid(), (self.density(), self.mask()), eye_m, rays)
    }
}

/// What blood does to the light along a ray, as a power of e, 0 or more; `None` if it begins in no medium.
fn optical_depth(grid: &Grid, density: &[f32], solid: &[u8], eye_m: [f32; 3], ray: [f32; 3]) -> Option<f32> {
    let step_m = SIGHT_M / STEPS as f32;
    let mut found: Option<f32> = None;
    for step in 0..STEPS {
        let far_m = (step as f32 + 0.5) * step_m;
        let cell = cell_at(grid, std::array::from_fn(|axis| eye_m[axis] + far_m * ray[axis]));
        let Some(here) = cell.filter(|cell| solid.get(*cell) == Some(&0)).and_then(|cell| density.get(cell)) else { break };
        let before = found.unwrap_or(0.0);
        found = Some(if *here > 0.0 { before + EXTINCTION_PER_M * step_m * here } else { before });
    }
    found
}

/// The cell that a place lies in; `None` outside of the grid, and of what is no number.
fn cell_at(grid: &Grid, place_m: [f32; 3]) -> Option<usize> {
    let (along, cells) = (grid.to_cells(place_m), grid.cells());
    let is_inside = (0..3).all(|axis| along[axis] >= 0.0 && along[axis] < cells[axis] as f32);
    let [i, j, k] = along.map(|cells| cells as usize);
    is_inside.then(|| (k * cells[1] + j) * cells[0] + i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    const AHEAD: [f32; 3] = [0.0, 0.0, 1.0];

    /// A box of 30 mm with its low corner in the origin, in cells of 1, 1.5 and 2 mm, all of one density and without walls.
    fn murk(density: f32) -> (Grid, Vec<f32>, Vec<u8>) {
        let grid = Grid::new([30, 20, 15], [1e-3, 1.5e-3, 2e-3], [0.0; 3]).unwrap();
        (grid, vec![density; grid.cell_count()], vec![0; grid.cell_count()])
    }

    fn is_near(found: Option<f32>, exact: f32) -> bool {
        found.is_some_and(|found| (found / exact - 1.0).abs() < 0.01)
    }

    #[test]
    fn a_clear_medium_takes_no_light_and_blood_takes_as_much_as_it_is_dense_and_deep() {
        let eye_m = [0.015, 0.015, 0.001];
        let (grid, clear, solid) = murk(0.0);
        assert_eq!(transmittance(&grid, (&clear, &solid), eye_m, &[AHEAD, [0.6, 0.0, 0.8]]), Some(1.0));
        for density in [0.001, 0.02, 0.1, 0.3] {
            let (grid, blood, solid) = murk(density);
            let exact = (-EXTINCTION_PER_M * density * SIGHT_M).exp();
            for ray in [AHEAD, [0.0, 0.6, 0.8], [-0.6, 0.0, 0.8]] {
                let found = transmittance(&grid, (&blood, &solid), eye_m, &[ray]);
                assert!(is_near(found, exact), "{density}, {ray:?}: {found:?} of {exact}");
            }
        }
        // A sheet of blood, 4 mm thick, across the way: what is behind the reach counts for nothing.
        let mut sheet = clear;
        let of_layer = grid.cells()[0] * grid.cells()[1];
        sheet[3 * of_layer..5 * of_layer].fill(0.1);
        sheet[12 * of_layer..].fill(1.0);
        let found = transmittance(&grid, (&sheet, &solid), eye_m, &[AHEAD]);
        assert!(is_near(found, (-EXTINCTION_PER_M * 0.1 * 0.004_f32).exp()), "{found:?}");
    }

    #[test]
    fn a_wall_and_the_end_of_the_grid_stop_the_ray_and_the_mean_is_that_of_all_rays() {
        let (grid, blood, mut solid) = murk(0.1);
        let of_layer = grid.cells()[0] * grid.cells()[1];
        solid[5 * of_layer..6 * of_layer].fill(1); // from 10 mm on, 2 mm thick
        let eye_m = [0.015, 0.015, 0.001];
        let seen = |rays: &[[f32; 3]]| transmittance(&grid, (&blood, &solid), eye_m, rays);
        let [to_wall, to_end] = [0.009_f32, 0.015].map(|far_m| (-EXTINCTION_PER_M * 0.1 * far_m).exp());
        assert!(is_near(seen(&[AHEAD]), to_wall), "{:?}", seen(&[AHEAD]));
        assert!(is_near(seen(&[[1.0, 0.0, 0.0]]), to_end), "{:?}", seen(&[[1.0, 0.0, 0.0]]));
        assert!(is_near(seen(&[AHEAD, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), (to_wall + 2.0 * to_end) / 3.0));
    }

    #[test]
    fn from_within_a_wall_or_from_outside_of_the_grid_nothing_is_seen_and_nothing_is_said() {
        let (grid, blood, mut solid) = murk(0.1);
        assert_eq!(transmittance(&grid, (&blood, &solid), [0.015, 0.015, -0.001], &[AHEAD]), None);
        assert_eq!(transmittance(&grid, (&blood, &solid), [f32::NAN, 0.015, 0.001], &[AHEAD]), None);
        assert_eq!(transmittance(&grid, (&blood, &solid), [0.015, 0.015, 0.001], &[]), None);
        assert_eq!(transmittance(&grid, (&[], &[]), [0.015, 0.015, 0.001], &[AHEAD]), None, "no cell is there");
        solid.fill(1);
        assert_eq!(transmittance(&grid, (&blood, &solid), [0.015, 0.015, 0.001], &[AHEAD]), None);
    }

    #[test]
    fn a_density_that_is_no_number_is_clear_and_one_beyond_all_lets_nothing_through() {
        let eye_m = [0.015, 0.015, 0.001];
        for (density, share) in [(f32::NAN, 1.0), (-3.0, 1.0), (f32::NEG_INFINITY, 1.0), (f32::INFINITY, 0.0), (f32::MAX, 0.0)] {
            let (grid, blood, solid) = murk(density);
            assert_eq!(transmittance(&grid, (&blood, &solid), eye_m, &[AHEAD]), Some(share), "{density}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(9), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_eye_ray_and_density_give_a_share_or_nothing(
            eye in prop::array::uniform3(any::<u32>()),
            near_m in prop::array::uniform3(0.0f32..0.03),
            ray in prop::array::uniform3(any::<u32>()),
            density in any::<u32>(),
        ) {
            let (grid, blood, solid) = murk(f32::from_bits(density));
            for eye_m in [eye.map(f32::from_bits), near_m] {
                for ray in [ray.map(f32::from_bits), AHEAD] {
                    let found = transmittance(&grid, (&blood, &solid), eye_m, &[ray, AHEAD]);
                    prop_assert!(found.is_none_or(|share| (0.0..=1.0).contains(&share)), "{:?}", found);
                }
            }
        }
    }
}
