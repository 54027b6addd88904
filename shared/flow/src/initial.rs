//! Setting fields from outside, and moving them between bands and flat arrays.

use crate::error::FlowError;
use crate::field::Field;
use crate::inputs::MAX_SPEED_M_S;
use crate::solver::Solver;

impl Solver {
    /// Sets a velocity component (0, 1, 2), m/s, one value per low face as in the state. Values that are not finite become 0;
    /// returns how many. Between steps only.
    ///
    /// # Errors
    /// [`FlowError::Length`], or [`FlowError::PhaseConflict`] during a phase.
    pub fn set_velocity_m_s(&self, axis: usize, values: &[f32]) -> Result<u32, FlowError> {
        let now = self.plan()?.roles.now;
        let replaced = self.set_field("the velocity", &self.velocity[now][axis.min(2)], values, MAX_SPEED_M_S)?;
        self.fill_ghosts()?;
        Ok(replaced)
    }

    /// Sets the dye, volume fraction per cell; values outside 0..1 become 0, returns how many. Between steps only.
    ///
    /// # Errors
    /// As [`Self::set_velocity_m_s`].
    pub fn set_dye(&self, values: &[f32]) -> Result<u32, FlowError> {
        let dye = self.plan()?.dye;
        self.set_field("the dye", &self.dye[dye], values, 1.0)
    }

    fn set_field(&self, what: &'static str, field: &Field, values: &[f32], limit: f32) -> Result<u32, FlowError> {
        if values.len() != self.layout.cell_count() {
            return Err(FlowError::Length { what, got: values.len(), want: self.layout.cell_count() });
        }
        self.copy_in(field, values)?;
        let mut replaced = 0;
        for band in 0..self.bands {
            let mut field = field.write(band)?;
            for kk in self.layout.own(band) {
                for x in field.layer(kk).iter_mut().filter(|x| !(-limit..=limit).contains(&**x)) {
                    *x = 0.0;
                    replaced += 1;
                }
            }
        }
        Ok(replaced)
    }

    pub(crate) fn copy_out(&self, field: &Field, out: &mut [f32]) -> Result<(), FlowError> {
        let [nx, ny, _] = self.layout.n;
        let field = field.read()?;
        for (row, out) in out.chunks_exact_mut(nx).enumerate() {
            let o = self.layout.row(row % ny);
            out.copy_from_slice(&field.layer(row / ny + 1)[o..o + nx]);
        }
        Ok(())
    }

    pub(crate) fn copy_in(&self, field: &Field, from: &[f32]) -> Result<(), FlowError> {
        let [nx, ny, _] = self.layout.n;
        for band in 0..self.bands {
            let mut field = field.write(band)?;
            for kk in self.layout.own(band) {
                for j in 0..ny {
                    let o = self.layout.row(j);
                    field.layer(kk)[o..o + nx].copy_from_slice(&from[((kk - 1) * ny + j) * nx..][..nx]);
                }
            }
        }
        Ok(())
    }
}
