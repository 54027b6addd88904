//! What velocity shows in solids at the begin and at the end of a step. While a step is computed, faces within solids beside the medium carry the mirrored
//! velocity ([`crate::obstacles`]); between two steps, and so in the state, the solid's own. A face that the solid leaves starts from there.

use crate::error::FlowError;
use crate::field::Field;
use crate::rows;
use crate::solver::Solver;
use crate::transport::{hold_solid, step};

impl Solver {
    /// Phase Hold: faces that touch a solid take what phase Mirror made for them, before the first sweep of Diffuse.
    pub(crate) fn hold_band(&self, band: usize) -> Result<(), FlowError> {
        self.show_in_solids(band, &self.held)
    }

    /// Phase Rest: they take the solid's own velocity, after all that the step has moved.
    pub(crate) fn rest_band(&self, band: usize) -> Result<(), FlowError> {
        self.show_in_solids(band, &self.face)
    }

    fn show_in_solids(&self, band: usize, shown: &[Field; 3]) -> Result<(), FlowError> {
        let now = self.plan()?.roles.now;
        let layout = &*self.layout;
        let fluid = self.fluid.read()?;
        for (component, shown) in shown.iter().enumerate() {
            let shown = shown.read()?;
            let mut velocity = self.velocity[now][component].write(band)?;
            for kk in layout.own(band) {
                let plane = velocity.layer(kk);
                for o in (0..layout.n[1]).map(|j| layout.row(j)) {
                    let range = o..o + layout.n[0];
                    let (k_back, back) = step(component, kk, o, layout.stride, false);
                    let before = &fluid.layer(k_back)[back..back + range.len()];
                    // As in phase Mirror: where all is fluid nothing is held, and the grid's own side is at rest.
                    if rows::are_fluid(&fluid.layer(kk)[range.clone()]) && (component == 0 || rows::are_fluid(before)) {
                        continue;
                    }
                    hold_solid(&fluid, &shown, component, kk, o, layout.stride, &mut plane[range]);
                }
                self.mirrors.plane(layout, component, plane);
            }
            self.mirrors.layers(layout, component, band, &mut velocity);
        }
        Ok(())
    }
}
