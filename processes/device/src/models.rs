//! The newest valid contact model: the highest (epoch, state tick) over the pages of all tissues, and the newest valid word of the medium over
//! those of all fluids. What is not finite, out of range, of another input than it names, or without progress is refused and counted, and its writer is
//! distrusted; what has a lower epoch than one seen before is fenced.

use hyst_engine::Life;
use hyst_exchange::{Horizon, OwnedPage, ReadPage};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{device, fluid, header, tissue};
use hyst_messages::{ContactModel, FluidStatus, MAX_FLOW_M_S, MAX_PLANES, Medium};

/// Stiffest plane that is believed, N/m: far above what any tissue or device can show.
const MAX_STIFFNESS_N_M: f32 = 20_000.0;
/// Farthest point from the pivot that is believed, m.
const MAX_DISTANCE_M: f32 = 1.0;
/// Pressure beyond which the fluid's is not believed, Pa: the pump's range ends at 20 kPa.
const MAX_PRESSURE_PA: f32 = 40_000.0;
/// Most ticks by which a stamp may be ahead: two of the slowest steps (a fluid's), so that no stamp shuts out all that come after it.
const MOST_AHEAD_TICKS: u64 = 128;
/// Difference of the flows in and out, ml/min, that must change the deficit from one state to the next.
const TELLING_FLOW_ML_MIN: f32 = 0.01;
/// Fluids whose pages are read: holder, spare and a newcomer on trial.
const FLUIDS: usize = 3;
/// Tissues whose pages are read.
const TISSUES: usize = 3;

/// The page of one tissue: number of the cell's newest value, and its epoch and tick.
struct Tissue {
    page: ReadPage,
    number: u64,
    key: (u32, u64),
}

/// The page of one fluid: number of the cell's newest value, and the status that was in it.
struct Fluid {
    page: ReadPage,
    number: u64,
    status: FluidStatus,
}

/// Pages of the tissues and fluids, and what is in use of theirs.
pub struct Models {
    /// Of the tissue and of the fluid.
    horizons: [Option<Horizon>; 2],
    tissues: [Option<Tissue>; TISSUES],
    newest: ContactModel,
    fluids: [Option<Fluid>; FLUIDS],
    medium: Medium,
    medium_key: (u32, u64),
}

impl Models {
    /// No pages yet; the horizons are those of tissue and fluid. Without a roster, which may be damaged when the device starts, epochs are only
    /// compared with each other.
    pub fn new(horizons: [Option<Horizon>; 2]) -> Models {
        Models {
            horizons,
            tissues: Default::default(),
            newest: ContactModel::default(),
            fluids: Default::default(),
            medium: Medium::default(),
            medium_key: (0, 0),
        }
    }

    /// Takes the page of a new incarnation; gives back the one before.
    pub fn seat(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        match self.tissues.get_mut(index) {
            Some(place) => place.replace(Tissue { page, number: 0, key: (0, 0) }).map(|tissue| tissue.page),
            None => Some(page),
        }
    }

    /// Takes the page of a new incarnation of the fluid; gives back the one before.
    pub fn seat_fluid(&mut self, index: usize, page: ReadPage) -> Option<ReadPage> {
        match self.fluids.get_mut(index) {
            Some(place) => place.replace(Fluid { page, number: 0, status: FluidStatus::default() }).map(|fluid| fluid.page),
            None => Some(page),
        }
    }

    /// Whether the newest model and medium are of these ticks, or later ones.
    pub fn has_reached(&self, tissue_tick: u64, fluid_tick: u64) -> bool {
        self.newest.state_tick >= tissue_tick && self.medium_key.1 >= fluid_tick
    }

    /// What the newest valid status of a fluid says. It goes to the tissue in the input record, so that a substitute uses the same.
    pub fn medium(&mut self, life: &Life, tick: u64) -> Medium {
        for fluid in self.fluids.iter_mut().flatten() {
            let number = fluid.page.cell_number(fluid::STATUS);
            if number == fluid.number {
                continue;
            }
            let Some((number, status)) = fluid.page.cell(fluid::STATUS) else { continue };
            let before = std::mem::replace(&mut fluid.status, status);
            let first = std::mem::replace(&mut fluid.number, number) == 0;
            // This thread may have stood since its tick began: what others have made meanwhile is not ahead of its time.
            let key = (status.epoch, status.state_tick);
            let verdict = match () {
                () if is_ahead(&self.horizons[1], key, life) => Err(Distrust::Invalid),
                () => judge_status(&status, (!first).then_some(&before), tick.max(life.clock.present_tick())),
            };
            if let Err(why) = verdict {
                life.refuse(fluid.page.incarnation(), why);
            } else if status.epoch < self.medium_key.0 {
                life.page.add64(header::STALE, 1);
            } else if key > self.medium_key {
                let medium = Medium { pressure_pa: status.pressure_pa, pieces: status.pieces };
                (self.medium_key, self.medium) = (key, medium);
            }
        }
        self.medium
    }

    /// The model to use in this tick.
    pub fn newest(&mut self, life: &Life, tick: u64) -> ContactModel {
        for tissue in self.tissues.iter_mut().flatten() {
            let number = tissue.page.cell_number(tissue::MODEL);
            if number == tissue.number {
                continue;
            }
            let Some((number, model)) = tissue.page.cell(tissue::MODEL) else { continue };
            tissue.number = number;
            let key = (model.epoch, model.state_tick);
            let verdict = match () {
                () if is_ahead(&self.horizons[0], key, life) => Err(Distrust::Invalid),
                () if key <= std::mem::replace(&mut tissue.key, key) => Err(Distrust::Still),
                () => judge_model(&model, &life.page, tick.max(life.clock.present_tick())),
            };
            if let Err(why) = verdict {
                life.refuse(tissue.page.incarnation(), why);
            } else if model.epoch < self.newest.epoch {
                life.page.add64(header::STALE, 1);
            } else if key > (self.newest.epoch, self.newest.state_tick) {
                self.newest = model;
            }
        }
        self.newest
    }
}

/// Whether an epoch is one that nobody has won, or a tick far from being there: it would shut out all that come after it.
fn is_ahead(horizon: &Option<Horizon>, key: (u32, u64), life: &Life) -> bool {
    horizon.as_ref().is_some_and(|horizon| horizon.is_passed_by(key, MOST_AHEAD_TICKS, &life.clock))
}

/// Whether every number of the model is in its range, and the pose that it was computed from the one that was sent.
fn judge_model(model: &ContactModel, own: &OwnedPage, tick: u64) -> Result<(), Distrust> {
    if !is_valid(model) || model.state_tick > tick + MOST_AHEAD_TICKS {
        return Err(Distrust::Invalid);
    }
    // What is older than the ring, or was sent by a device before this one, cannot be known.
    let sent = own.ring(device::INPUTS, model.input_tick).map(|input| input.sample.pose.hash());
    if sent.is_some_and(|hash| hash != model.pose_hash) { Err(Distrust::Frozen) } else { Ok(()) }
}

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

/// Whether a status is in range and goes on from the one before it: a deficit that stands still while something flows is an old one.
fn judge_status(status: &FluidStatus, before: Option<&FluidStatus>, tick: u64) -> Result<(), Distrust> {
    let mut speeds = status.pieces.iter().flat_map(|flow| flow.velocity_m_s);
    let in_range = (0.0..=MAX_PRESSURE_PA).contains(&status.pressure_pa)
        && status.deficit_ml.is_finite()
        && speeds.all(|speed| speed.abs() <= MAX_FLOW_M_S);
    if !in_range || status.state_tick > tick + MOST_AHEAD_TICKS {
        return Err(Distrust::Invalid);
    }
    let Some(before) = before else { return Ok(()) };
    let flowing = (status.inflow_ml_min - status.outflow_ml_min).abs() > TELLING_FLOW_ML_MIN;
    match () {
        () if status.state_tick <= before.state_tick => Err(Distrust::Still),
        () if flowing && status.deficit_ml.to_bits() == before.deficit_ml.to_bits() => Err(Distrust::Frozen),
        () => Ok(()),
    }
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

    #[test]
    fn a_status_that_is_no_number_stands_still_or_comes_again_is_refused() {
        let before =
            FluidStatus { state_tick: 66, deficit_ml: 3.0, pressure_pa: 9_000.0, inflow_ml_min: 90.0, ..FluidStatus::default() };
        let good = FluidStatus { state_tick: 99, deficit_ml: 3.1, ..before };
        let judge = |status: FluidStatus| judge_status(&status, Some(&before), 90);
        assert_eq!(judge(good), Ok(()));
        assert_eq!(judge(FluidStatus { pressure_pa: f32::NAN, ..good }), Err(Distrust::Invalid));
        assert_eq!(judge(FluidStatus { pressure_pa: 1e9, ..good }), Err(Distrust::Invalid));
        assert_eq!(judge(FluidStatus { deficit_ml: f64::INFINITY, ..good }), Err(Distrust::Invalid));
        assert_eq!(judge(FluidStatus { state_tick: u64::MAX, ..good }), Err(Distrust::Invalid));
        for speed in [f32::NAN, 1e6, f32::NEG_INFINITY] {
            let mut bad = good;
            bad.pieces[hyst_messages::MAX_PIECES - 1].velocity_m_s[1] = speed;
            assert_eq!(judge(bad), Err(Distrust::Invalid), "{speed} m/s");
        }
        assert_eq!(judge(FluidStatus { state_tick: 66, ..good }), Err(Distrust::Still));
        assert_eq!(judge(FluidStatus { deficit_ml: 3.0, ..good }), Err(Distrust::Frozen));
        let shut = FluidStatus { deficit_ml: 3.0, inflow_ml_min: 0.0, ..good };
        assert_eq!(judge(shut), Ok(()), "nothing flows: nothing need change");
    }
}
