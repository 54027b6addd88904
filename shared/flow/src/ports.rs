//! Which cells a port feeds or drains, and how fast its jet is.

use crate::grid::{Grid, Layout};
use crate::inputs::Port;

/// Times that a port's reach is made less at most: even from a metre down to a cell of a micrometre, one of them makes it a hundredth less at least.
const MOST_ROUNDS: usize = 64;
/// What is left of the reach each time, at most.
const MOST_LEFT: f32 = 0.99;

/// Calls `visit(padded layer, offset in plane)` for the cells whose centre is within a distance of a place.
pub(crate) fn within(grid: &Grid, layout: &Layout, centre_m: [f32; 3], reach_m: f32, mut visit: impl FnMut(usize, usize)) {
    let h = grid.spacing_m();
    let middle = grid.to_cells(centre_m);
    let low: [usize; 3] = std::array::from_fn(|a| (middle[a] - reach_m / h[a] - 1.0).max(0.0) as usize);
    let high: [usize; 3] = std::array::from_fn(|a| ((middle[a] + reach_m / h[a] + 1.0).max(0.0) as usize).min(layout.n[a]));
    for k in low[2]..high[2] {
        for j in low[1]..high[1] {
            for i in low[0]..high[0] {
                let c = grid.centre_m([i, j, k]);
                let distance2: f32 = (0..3).map(|a| (c[a] - centre_m[a]).powi(2)).sum();
                if distance2 <= reach_m * reach_m {
                    visit(k + 1, layout.row(j) + i);
                }
            }
        }
    }
}

/// How far from its middle the cells of a port lie, m: its radius; if none of them is open, the nearest shell of one or two cells that has one; and where more
/// than `most` are open, so much less that no more are, on all sides alike. `None` where no cell is open.
pub(crate) fn reach_m(
    grid: &Grid,
    layout: &Layout,
    centre_m: [f32; 3],
    radius_m: f32,
    most: usize,
    is_open: impl Fn(usize, usize) -> bool,
) -> Option<f32> {
    let h = grid.spacing_m();
    let largest = h[0].max(h[1]).max(h[2]);
    let count = |reach_m: f32| {
        let mut cells = 0;
        within(grid, layout, centre_m, reach_m, |kk, at| cells += usize::from(is_open(kk, at)));
        cells
    };
    let reaches = [radius_m, largest, 2.0 * largest].map(|reach_m| reach_m.max(0.5 * largest));
    let (mut reach_m, mut cells) = reaches.into_iter().map(|reach_m| (reach_m, count(reach_m))).find(|(_, cells)| *cells > 0)?;
    for _ in 0..MOST_ROUNDS {
        if cells <= most {
            break;
        }
        let less_m = reach_m * (most as f32 / cells as f32).cbrt().min(MOST_LEFT);
        let left = count(less_m);
        if left == 0 {
            break; // the nearest open ones are many: the first of them serve
        }
        (reach_m, cells) = (less_m, left);
    }
    Some(reach_m)
}

/// The middle of the open cell that is nearest to a place.
pub(crate) fn nearest_m(
    grid: &Grid,
    layout: &Layout,
    place_m: [f32; 3],
    is_open: impl Fn(usize, usize) -> bool,
) -> Option<[f32; 3]> {
    let [nx, ny, nz] = layout.n;
    let mut nearest: Option<(f32, [f32; 3])> = None;
    for k in 0..nz {
        for j in 0..ny {
            for i in (0..nx).filter(|i| is_open(k + 1, layout.row(j) + i)) {
                let c = grid.centre_m([i, j, k]);
                let distance2: f32 = (0..3).map(|a| (c[a] - place_m[a]).powi(2)).sum();
                if nearest.is_none_or(|(least, _)| distance2 < least) {
                    nearest = Some((distance2, c));
                }
            }
        }
    }
    nearest.map(|(_, c)| c)
}

/// Velocity of the jet of an inflow with a direction: its flow through the port's cross-section, m/s.
pub(crate) fn jet_m_s(grid: &Grid, port: &Port, flow_m3_s: f64) -> Option<[f32; 3]> {
    let length = port.direction.iter().map(|d| d * d).sum::<f32>().sqrt();
    if !port.inflow || length < 0.1 {
        return None;
    }
    let h = grid.spacing_m();
    let radius_m = port.radius_m.max(0.5 * h[0].max(h[1]).max(h[2]));
    let speed = (flow_m3_s / (std::f64::consts::PI * f64::from(radius_m * radius_m))) as f32;
    Some(port.direction.map(|d| d / length * speed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_of_more_cells_than_it_may_have_becomes_smaller_on_all_sides_alike() {
        let grid = Grid::new([31, 31, 31], [0.25e-3; 3], [0.0; 3]).unwrap();
        let layout = Layout::new(grid.cells(), 1);
        let middle_m = [15.5 * 0.25e-3; 3];
        let found = |most: usize, is_open: &dyn Fn(usize, usize) -> bool| {
            let reach_m = reach_m(&grid, &layout, middle_m, 3.1e-3, most, is_open)?;
            let (mut cells, mut moment) = (0, [0.0f32; 3]);
            within(&grid, &layout, middle_m, reach_m, |kk, at| {
                let place = [at % layout.stride - 1, at / layout.stride - 1, kk - 1];
                (cells, moment) = (cells + 1, std::array::from_fn(|a| moment[a] + place[a] as f32 - 15.0));
            });
            Some((reach_m, cells, moment))
        };
        let (reach_m, whole, moment) = found(1 << 20, &|_, _| true).unwrap();
        assert!(reach_m == 3.1e-3 && whole > 7_000 && moment.iter().all(|sum| sum.abs() < 1e-2), "{whole} {moment:?}");
        for most in [4_096, 1_000, 100, 7] {
            let (reach_m, cells, moment) = found(most, &|_, _| true).unwrap();
            assert!(cells <= most && 3 * cells > most, "{cells} of {most} within {reach_m} m");
            assert!(moment.iter().all(|sum| sum.abs() < 1e-2), "{moment:?}: it lies about its middle");
        }
        assert!(found(100, &|_, _| false).is_none());
    }
}
