//! The cavity's volume against its pressure, and what takes room in it beside the medium.
//!
//! The curve is of the cavity as the scene has it: a measured volume at 150 mmHg and a measured pressure at which the walls part (Zátonyi et al. 2005), and
//! between them this model's shape. An instrument that comes in takes of the room, and tissue that is gone leaves some. Walls that lie on an instrument without
//! medium between them bear on it and press on no medium: it counts as far as medium has come between, which the parting volume says (assumed). Promise: an
//! empty cavity is at no pressure, and more medium never lowers it.

use crate::pump::{BISECTIONS, PA_PER_MMHG, PumpModel};

impl PumpModel {
    /// Pressure at a volume, Pa: up to the parting pressure the walls lie on each other and a little medium raises the pressure
    /// much; from there it grows with the volume, to 150 mmHg at the model's volume. Strictly increasing.
    pub fn pressure_pa(&self, volume_ml: f64) -> f64 {
        self.parted_pa(volume_ml) + self.slope_pa_ml() * volume_ml
    }

    /// The same where so much takes room beside the medium, more than when the curve was taken, ml; negative where so much is gone.
    pub fn distended_pa(&self, volume_ml: f64, displaced_ml: f32) -> f64 {
        self.pressure_pa(self.filling_ml(volume_ml, displaced_ml))
    }

    /// By how much that pressure grows with the medium, Pa/ml; 0 while it does not grow yet.
    pub(crate) fn stiffness_pa_ml(&self, volume_ml: f64, displaced_ml: f32) -> f64 {
        let filling_ml = self.filling_ml(volume_ml, displaced_ml);
        if filling_ml <= 0.0 {
            return 0.0;
        }
        let parting = self.parting_pa / self.parting_ml * (-filling_ml / self.parting_ml).exp();
        let by_medium = 1.0 + f64::from(displaced_ml) / self.parting_ml * (-volume_ml / self.parting_ml).exp();
        (parting + self.slope_pa_ml()) * by_medium.max(0.0)
    }

    /// The volume of the curve that medium and what displaces it stand for, ml. Convex where it falls at first, so that it grows once it is positive.
    fn filling_ml(&self, volume_ml: f64, displaced_ml: f32) -> f64 {
        let between = -(-volume_ml / self.parting_ml).exp_m1();
        (volume_ml + f64::from(displaced_ml) * between).max(0.0)
    }

    fn parted_pa(&self, volume_ml: f64) -> f64 {
        self.parting_pa * (1.0 - (-volume_ml / self.parting_ml).exp())
    }

    /// By how much the pressure grows with the volume at least.
    fn slope_pa_ml(&self) -> f64 {
        (150.0 * PA_PER_MMHG - self.parted_pa(self.volume_150_mmhg_ml)) / self.volume_150_mmhg_ml
    }

    /// What a cavity with so much medium in it, and so much that displaces it, takes until its pressure is so high, ml: 0 above that.
    pub(crate) fn room_ml(&self, volume_ml: f64, displaced_ml: f32, pressure_pa: f64) -> f64 {
        let lacking_pa = (pressure_pa - self.distended_pa(volume_ml, displaced_ml)).max(0.0);
        // No less than what is gone fills before the pressure grows by the least slope.
        let gone_ml = f64::from(-displaced_ml).max(0.0);
        let (mut low, mut high) = (0.0, lacking_pa / self.slope_pa_ml() + gone_ml);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if self.distended_pa(volume_ml + middle, displaced_ml) < pressure_pa {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}
