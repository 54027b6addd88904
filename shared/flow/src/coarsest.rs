//! The coarsest level of the multigrid cycle, solved by dense Cholesky factors.
//!
//! Promise: positive definite whatever the mask (solid cells get a unit diagonal, the pressure's free level a weak anchor), so
//! that the factors exist and are finite.

use parking_lot::RwLock;

use crate::error::FlowError;
use crate::grid::Layout;
use crate::multigrid::Level;

/// Anchor of the constant, which the operator does not see, relative to the diagonal.
const ANCHOR: f64 = 1e-3;

/// Factors and right side.
pub(crate) struct Coarsest(RwLock<Factors>);

struct Factors {
    /// Lower triangle, row-major, `n`×`n`.
    lower: Vec<f64>,
    x: Vec<f64>,
}

/// Offset in the plane and padded layer of cell `c`.
fn place(layout: &Layout, c: usize) -> (usize, usize) {
    let [nx, ny, _] = layout.n;
    (layout.row(c / nx % ny) + c % nx, c / (nx * ny) + 1)
}

impl Coarsest {
    pub fn new(cells: usize) -> Self {
        Self(RwLock::new(Factors { lower: vec![0.0; cells * cells], x: vec![0.0; cells] }))
    }

    /// Factors the level's operator.
    pub fn factor(&self, level: &Level) -> Result<(), FlowError> {
        let mut factors = self.0.try_write().ok_or(FlowError::PhaseConflict)?;
        let Some([fx, fy, fz]) = &level.faces else {
            return Ok(());
        };
        let (fx, fy, fz, diagonal) = (fx.read()?, fy.read()?, fz.read()?, level.diagonal.read()?);
        let layout = &*level.layout;
        let (n, a) = (layout.cell_count(), &mut factors.lower);
        let [nx, ny, _] = layout.n;
        a.fill(0.0);
        for c in 0..n {
            let (at, kk) = place(layout, c);
            let d = f64::from(diagonal.layer(kk)[at]);
            a[c * n + c] = if d > 0.0 { d * (1.0 + ANCHOR) } else { 1.0 };
            for (face, back) in [(&fx, 1), (&fy, nx), (&fz, nx * ny)] {
                let weight = f64::from(face.layer(kk)[at]);
                if weight != 0.0 && back <= c {
                    a[c * n + c - back] -= weight;
                }
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let (ri, rj) = (&a[i * n..i * n + j], &a[j * n..j * n + j]);
                let sum = a[i * n + j] - ri.iter().zip(rj).map(|(x, y)| x * y).sum::<f64>();
                a[i * n + j] = if i == j { sum.max(1e-30).sqrt() } else { sum / a[j * n + j] };
            }
        }
        Ok(())
    }

    /// z = A⁻¹ r on the level.
    pub fn solve(&self, level: &Level) -> Result<(), FlowError> {
        let mut factors = self.0.try_write().ok_or(FlowError::PhaseConflict)?;
        let Factors { lower, x } = &mut *factors;
        let layout = &*level.layout;
        let n = x.len();
        let r = level.r.read()?;
        for i in 0..n {
            let (at, kk) = place(layout, i);
            let row = &lower[i * n..i * n + i];
            let known: f64 = row.iter().zip(&x[..i]).map(|(l, x)| l * x).sum();
            x[i] = (f64::from(r.layer(kk)[at]) - known) / lower[i * n + i];
        }
        for i in (0..n).rev() {
            x[i] /= lower[i * n + i];
            let value = x[i];
            for (x, l) in x[..i].iter_mut().zip(&lower[i * n..i * n + i]) {
                *x -= l * value;
            }
        }
        let (mut z, diagonal) = (level.z.write(0)?, level.diagonal.read()?);
        for (c, &value) in x.iter().enumerate() {
            let (at, kk) = place(layout, c);
            z.layer(kk)[at] = if diagonal.layer(kk)[at] > 0.0 { value as f32 } else { 0.0 };
        }
        Ok(())
    }
}
