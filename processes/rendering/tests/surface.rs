//! How surfaces are drawn: what sticks to them.
mod stand;

use rendering::{Material, Without};
use stand::*;

/// Colour and vessels alone, under a light that nothing bends.
const FLAT: Without = Without { vessels: false, bump: true, wet: true, softness: false };

/// How alike two rows of numbers are, -1 to 1.
fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let mean = |row: &[f32]| row.iter().sum::<f32>() / row.len() as f32;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sum = |of: &dyn Fn(f32, f32) -> f32| a.iter().zip(b).map(|(x, y)| of(x - mean_a, y - mean_b)).sum::<f32>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

#[test]
fn what_is_drawn_on_a_wall_that_is_stretched_goes_with_its_vertices() {
    let Some(mut r) = lacking(FLAT) else { return };
    let lining = wall(0.006, 0.007);
    put(&mut r, CAVITY, &lining, Material::MucosaTissue);
    let before = picture(&mut r, &close_up(0.006));
    let wide: Vec<[f32; 3]> = lining.positions_m.iter().map(|[x, y, z]| [2.0 * x, *y, *z]).collect();
    r.stage().update_positions(CAVITY, &wide).unwrap();
    let after = picture(&mut r, &close_up(0.006));
    // What a pixel differs by from those about it, then where it has gone to, which lies between two pixels, and where it was.
    let places: Vec<[u32; 2]> = middle([30, 45]).collect();
    let of = |at: &dyn Fn([u32; 2]) -> f32| places.iter().map(|place| at(*place)).collect::<Vec<f32>>();
    let drawn = of(&|at| detail(&before, 1, at, [5, 5]));
    let [left, right] = [80, 79].map(|less| of(&|[x, y]| detail(&after, 1, [2 * x - less, y], [10, 5])));
    let gone: Vec<f32> = left.iter().zip(&right).map(|(left, right)| 0.5 * (left + right)).collect();
    let stayed = of(&|at| detail(&after, 1, at, [5, 5]));
    let (sticks, slides) = (correlation(&drawn, &gone), correlation(&drawn, &stayed));
    println!("as before {sticks} at the vertices, {slides} at the pixels");
    assert!(sticks > 0.8 && slides < 0.75 && sticks > slides + 0.15, "{sticks} {slides}");
    let (darkest, depth) = drawn.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).expect("there are places");
    assert!(*depth < -8.0 && gone[darkest] < 0.4 * depth, "the darkest spot, of {depth}, is {} there", gone[darkest]);
}
