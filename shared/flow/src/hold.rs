//! What velocity shows in solids at the begin and at the end of a step. While a step is computed, faces within solids beside the medium carry the mirrored
//! velocity ([`crate::obstacles`]); between two steps, and so in the state, the solid's own. A face that the solid leaves starts from there.

use crate::error::FlowError;
use crate::field::Field;
use crate::kernels::wide;
use crate::solver::Solver;
use crate::transport::hold_solid;

impl Solver {
    /// Phase Hold: faces that touch a solid take what phase Mirror made for them, before the first sweep of Diffuse.
    pub(crate) fn hold_band(&self, band: usize) -> Result<(), FlowError> {
        self.show_in_solids(band, &self.held, false)
    }

    /// Phase Rest: they take the solid's own velocity, after all that the step has moved. Far from the fluid they have shown that since Mirror: nothing is
    /// mirrored there, AdvectBack holds each face that touches a solid, and Project leaves those be.
    pub(crate) fn rest_band(&self, band: usize) -> Result<(), FlowError> {
        self.show_in_solids(band, &self.face, true)
    }

    fn show_in_solids(&self, band: usize, shown: &[Field; 3], only_near: bool) -> Result<(), FlowError> {
        let now = self.plan()?.roles.now;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let fluid = self.fluid.read()?;
        for (component, shown) in shown.iter().enumerate() {
            let shown = shown.read()?;
            let mut velocity = self.velocity[now][component].write(band)?;
            for kk in layout.own(band) {
                let plane = velocity.layer(kk);
                wide(
                    #[inline(always)]
                    || {
                        // As in phase Mirror: where all is fluid nothing is held.
                        for j in (0..layout.n[1]).filter(|j| !spans.is_free_row(component, kk, *j)) {
                            let cells = if only_near { spans.near_row(kk, j) } else { 0..layout.n[0] };
                            let (o, n) = (layout.row(j) + cells.start, cells.len());
                            hold_solid(&fluid, &shown, component, kk, o, layout.stride, &mut plane[o..o + n]);
                        }
                    },
                );
                self.mirrors.plane(layout, component, plane);
            }
            self.mirrors.layers(layout, component, band, &mut velocity);
        }
        Ok(())
    }
}
