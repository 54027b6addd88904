//! Which cells a port feeds or drains, and how fast its jet is.

use crate::grid::{Grid, Layout};
use crate::inputs::Port;

/// Calls `visit(padded layer, offset in plane)` for the cells of a port: those within its radius, and if `visit` has taken none
/// of them, those within two cells of its centre, nearest shell first. `visit` returns whether it has taken any so far.
pub(crate) fn cells(grid: &Grid, layout: &Layout, port: &Port, mut visit: impl FnMut(usize, usize) -> bool) {
    let h = grid.spacing_m();
    let largest = h[0].max(h[1]).max(h[2]);
    for reach_m in [port.radius_m, largest, 2.0 * largest] {
        let reach_m = reach_m.max(0.5 * largest);
        let middle = grid.to_cells(port.centre_m);
        let low: [usize; 3] = std::array::from_fn(|a| (middle[a] - reach_m / h[a] - 1.0).max(0.0) as usize);
        let high: [usize; 3] = std::array::from_fn(|a| ((middle[a] + reach_m / h[a] + 1.0).max(0.0) as usize).min(layout.n[a]));
        let mut taken = false;
        for k in low[2]..high[2] {
            for j in low[1]..high[1] {
                for i in low[0]..high[0] {
                    let c = grid.centre_m([i, j, k]);
                    let distance2: f32 = (0..3).map(|a| (c[a] - port.centre_m[a]).powi(2)).sum();
                    if distance2 <= reach_m * reach_m {
                        taken = visit(k + 1, layout.row(j) + i);
                    }
                }
            }
        }
        if taken {
            return;
        }
    }
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
