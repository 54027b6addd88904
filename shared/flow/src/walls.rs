//! Ghost cells: what a velocity component shows beyond the six sides of the grid.
//!
//! The face on a wall is zero (nothing flows through); tangential components mirror with the wall's own velocity (no-slip) or copy (slip).

use crate::field::Write;
use crate::grid::Layout;
use crate::model::Wall;

/// ghost = sign · inside + add
#[derive(Debug, Clone, Copy, Default)]
struct Mirror {
    sign: f32,
    add: f32,
}

/// The rule of each component (first index) on each side (second index: low x, high x, low y, …).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Mirrors([[Mirror; 6]; 3]);

impl Mirrors {
    pub fn new(walls: &[Wall; 6]) -> Self {
        Self(std::array::from_fn(|component| {
            std::array::from_fn(|side| match walls[side] {
                Wall::NoSlip(v) => Mirror { sign: -1.0, add: 2.0 * v[component] },
                Wall::Slip => Mirror { sign: 1.0, add: 0.0 },
            })
        }))
    }

    /// Fills the ghosts of one plane of a component in x and y, and sets its faces on those walls to zero.
    pub fn plane(&self, layout: &Layout, component: usize, plane: &mut [f32]) {
        let [nx, ny, _] = layout.n;
        let s = layout.stride;
        let rules = &self.0[component];
        for row in plane[s..s * (ny + 1)].chunks_exact_mut(s) {
            if component == 0 {
                (row[1], row[nx + 1]) = (0.0, 0.0);
                row[0] = -row[2];
            } else {
                row[0] = rules[0].sign * row[1] + rules[0].add;
                row[nx + 1] = rules[1].sign * row[nx] + rules[1].add;
            }
        }
        if component == 1 {
            plane[s..2 * s].fill(0.0);
            plane[s * (ny + 1)..].fill(0.0);
            plane[..s].fill(0.0);
        } else {
            mirror_rows(plane, s, 1, 0, rules[2]);
            mirror_rows(plane, s, ny, ny + 1, rules[3]);
        }
    }

    /// Fills the ghost layers that belong to a band, after its inside is final.
    pub fn layers(&self, layout: &Layout, component: usize, band: usize, field: &mut Write<'_>) {
        let nz = layout.n[2];
        if band == 0 {
            if component == 2 {
                field.layer(1).fill(0.0);
                field.layer(0).fill(0.0);
            } else {
                mirror_layer(field, 1, 0, self.0[component][4]);
            }
        }
        if band + 1 == layout.bands {
            if component == 2 {
                field.layer(nz + 1).fill(0.0);
            } else {
                mirror_layer(field, nz, nz + 1, self.0[component][5]);
            }
        }
    }
}

fn mirror_rows(plane: &mut [f32], s: usize, from: usize, to: usize, rule: Mirror) {
    for i in 0..s {
        plane[to * s + i] = rule.sign * plane[from * s + i] + rule.add;
    }
}

fn mirror_layer(field: &mut Write<'_>, from: usize, to: usize, rule: Mirror) {
    let (inside, ghost) = field.pair(from, to);
    for (g, x) in ghost.iter_mut().zip(inside) {
        *g = rule.sign * x + rule.add;
    }
}
