//! The newest valid contact model: the highest (epoch, state tick) over the pages of all tissues. What is not finite or out of range is
//! refused and counted; what has a lower epoch than one seen before is fenced.

use hyst_exchange::{OwnedPage, ReadPage};
use hyst_messages::page::{fluid, header, tissue};
use hyst_messages::{ContactModel, MAX_PLANES};

/// Stiffest plane that is believed, N/m: far above what any tissue or device can show.
const MAX_STIFFNESS_N_M: f32 = 20_000.0;
/// Farthest point from the pivot that is believed, m.
const MAX_DISTANCE_M: f32 = 1.0;
/// Pressure beyond which the fluid's is not believed, Pa: the pump's range ends at 20 kPa.
const MAX_PRESSURE_PA: f32 = 40_000.0;
/// Fluids whose pages are read.
const FLUIDS: usize = 2;
/// Tissues whose pages are read.
const TISSUES: usize = 2;

/// Pages of the tissues and the model in use.
#[derive(Default)]
pub struct Models {
    pages: [Option<(ReadPage, u64)>; TISSUES],
    newest: ContactModel,
    fluids: [Option<ReadPage>; FLUIDS],
    pressure_pa: f32,
    pressure_tick: u64,
}

impl Models {
    /// Takes the page of a new incarnation; gives back the one before.
    pub fn seat(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        match self.pages.get_mut(index) {
            Some(place) => place.replace((page, 0)).map(|(page, _)| page),
            None => Some(page),
        }
    }

    /// Takes the page of a new incarnation of the fluid; gives back the one before.
    pub fn seat_fluid(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        match self.fluids.get_mut(index) {
            Some(place) => place.replace(page),
            None => Some(page),
        }
    }

    /// The newest valid pressure in the cavity, Pa. It goes to the tissue in the input record, so that a substitute uses the same.
    pub fn pressure_pa(&mut self, own: &OwnedPage) -> f32 {
        for (_, status) in self.fluids.iter().flatten().filter_map(|page| page.cell(fluid::STATUS)) {
            if status.state_tick <= self.pressure_tick {
                continue;
            }
            self.pressure_tick = status.state_tick;
            if (0.0..=MAX_PRESSURE_PA).contains(&status.pressure_pa) {
                self.pressure_pa = status.pressure_pa;
            } else {
                own.add64(header::INVALID, 1);
            }
        }
        self.pressure_pa
    }

    /// The model to use in this tick.
    pub fn newest(&mut self, own: &OwnedPage) -> ContactModel {
        for (page, seen) in self.pages.iter_mut().flatten() {
            let number = page.cell_number(tissue::MODEL);
            if number == *seen {
                continue;
            }
            let Some((number, model)) = page.cell(tissue::MODEL) else { continue };
            *seen = number;
            if model.epoch < self.newest.epoch {
                own.add64(header::STALE, 1);
            } else if !is_valid(&model) {
                own.add64(header::INVALID, 1);
            } else if (model.epoch, model.state_tick) > (self.newest.epoch, self.newest.state_tick) {
                self.newest = model;
            }
        }
        self.newest
    }
}

/// Whether every number of the model is in its range.
fn is_valid(model: &ContactModel) -> bool {
    let count = model.plane_count as usize;
    count <= MAX_PLANES
        && model.planes[..count].iter().all(|plane| {
            let length = plane.normal.iter().map(|c| c * c).sum::<f32>();
            plane.point_m.iter().all(|c| c.abs() <= MAX_DISTANCE_M)
                && (0.99..=1.01).contains(&length)
                && (0.0..=MAX_STIFFNESS_N_M).contains(&plane.stiffness_n_m)
                && (0.0..=1_000.0).contains(&plane.damping_n_s_m)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::ContactPlane;

    #[test]
    fn a_model_with_any_number_out_of_range_is_refused() {
        let plane =
            ContactPlane { point_m: [0.0, 0.01, 0.05], stiffness_n_m: 300.0, normal: [0.0, 1.0, 0.0], damping_n_s_m: 0.5 };
        let good = ContactModel { plane_count: 1, planes: [plane; MAX_PLANES], ..Default::default() };
        assert!(is_valid(&good));
        assert!(!is_valid(&ContactModel { plane_count: 9, ..good }));
        let changes: [fn(&mut ContactPlane); 6] = [
            |plane| plane.point_m[2] = f32::NAN,
            |plane| plane.point_m[0] = 2.0,
            |plane| plane.normal = [0.0, 0.5, 0.0],
            |plane| plane.normal = [f32::INFINITY, 0.0, 0.0],
            |plane| plane.stiffness_n_m = -1.0,
            |plane| plane.damping_n_s_m = f32::NAN,
        ];
        for change in changes {
            let mut bad = good;
            change(&mut bad.planes[0]);
            assert!(!is_valid(&bad), "{:?}", bad.planes[0]);
        }
    }
}
