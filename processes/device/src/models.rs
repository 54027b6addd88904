//! The newest valid contact model: the highest (epoch, state tick) over the pages of all tissues, and the newest valid word of the medium over
//! those of all fluids. What is not finite, out of range, of another input than it names, or without progress is refused and counted, and its writer is
//! distrusted; what has a lower epoch than one seen before is fenced. A newborn device goes
//! on from what its predecessor used last, as a servo remembers it, so that nothing older is used after a restart either.

use hyst_coupling::MAX_FRICTION;
use hyst_engine::Life;
use hyst_exchange::{Horizon, OwnedPage, ReadPage, StationPage};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{device, fluid, header, tissue};
use hyst_messages::tolerance::SHADOW_EPOCH;
use hyst_messages::{ContactModel, FluidStatus, InputRecord, MAX_PLANES, Medium, Role};

#[cfg(test)]
mod tests;

/// Stiffest plane that is believed, N/m: far above what any tissue or device can show.
const MAX_STIFFNESS_N_M: f32 = 20_000.0;
/// Farthest point from the pivot that is believed, m.
const MAX_DISTANCE_M: f32 = 1.0;
/// Most ticks by which a stamp may be ahead: two of the slowest steps (a fluid's), so that no stamp shuts out all that come after it.
const MOST_AHEAD_TICKS: u64 = 512;
/// Age up to which what the medium does to the scope is felt in full, ticks: two of a fluid's longest steps; and then it fades to nothing in as many. Of the
/// cavity's pressure the last word holds, for a cavity that nobody computes stays as it was; a flow does not.
const FULL_AGE_TICKS: u64 = 500;
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

/// What a contact model of an epoch and a tick is ordered by.
pub type Order = fn(u32, u64) -> (u32, u64);

/// Pages of the tissues and fluids, and what is in use of theirs.
pub struct Models {
    order: Order,
    /// Of the tissue and of the fluid.
    horizons: [Option<Horizon>; 2],
    tissues: [Option<Tissue>; TISSUES],
    newest: ContactModel,
    fluids: [Option<Fluid>; FLUIDS],
    medium: Medium,
    medium_key: (u32, u64),
    /// Latest ticks of which a model and a status were refused.
    refused_ticks: [u64; 2],
}

impl Models {
    /// No pages yet; the horizons are those of tissue and fluid. Without a roster, which may be damaged when the device starts, epochs are only
    /// compared with each other.
    pub fn new(horizons: [Option<Horizon>; 2], order: Order) -> Models {
        Models {
            order,
            horizons,
            tissues: Default::default(),
            newest: ContactModel::default(),
            fluids: Default::default(),
            medium: Medium::default(),
            medium_key: (0, 0),
            refused_ticks: [0; 2],
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

    /// Takes model and medium of an input record that a device before this one sent, if they are newer than what is known here.
    pub fn go_on_from(&mut self, before: &InputRecord, life: &Life) {
        let model = &before.model;
        let key = (model.epoch, model.state_tick);
        if self.key_of(model) > self.key_of(&self.newest) && is_valid(model) && !is_ahead(&self.horizons[0], key, life) {
            self.newest = *model;
        }
        let (key, medium) = ((before.medium_epoch, before.medium_tick), before.medium());
        if key > self.medium_key && medium.is_sound() && !is_ahead(&self.horizons[1], key, life) {
            (self.medium_key, self.medium) = (key, medium);
        }
    }

    fn key_of(&self, model: &ContactModel) -> (u32, u64) {
        (self.order)(model.epoch, model.state_tick)
    }

    /// Whether every tissue and fluid that lives in the station has its seat. Until then the newest model known here may be an old one, that of a spare.
    pub fn are_all_seated(&self, clock: &StationPage) -> bool {
        let tissue = |index: usize| self.tissues.get(index).map(|place| place.as_ref().map(|tissue| tissue.page.incarnation()));
        let fluid = |index: usize| self.fluids.get(index).map(|place| place.as_ref().map(|fluid| fluid.page.incarnation()));
        let is_seated = |role: Role, seat: &dyn Fn(usize) -> Option<Option<u32>>| {
            let mut living = clock.occupied(role).filter(|(slot, _)| !clock.is_dead(*slot));
            living.all(|(slot, incarnation)| seat(slot.index()).is_none_or(|seated| seated == Some(incarnation)))
        };
        is_seated(Role::Tissue, &tissue) && is_seated(Role::Fluid, &fluid)
    }

    /// Whether model and medium of these ticks, or later ones, have come. Where one was refused none other comes for it, and the one before is used.
    pub fn has_reached(&self, tissue_tick: u64, fluid_tick: u64) -> bool {
        let [model, status] = self.refused_ticks;
        self.newest.state_tick.max(model) >= tissue_tick && self.medium_key.1.max(status) >= fluid_tick
    }

    /// What the newest valid status of a fluid says, and its epoch and tick. It goes to tissue and servos in the input record, so that a substitute uses
    /// the same.
    pub fn medium(&mut self, life: &Life, tick: u64) -> (Medium, (u32, u64)) {
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
                self.refused_ticks[1] = self.refused_ticks[1].max(told_tick(status.state_tick, life));
            } else if status.epoch < self.medium_key.0 {
                life.page.add64(header::STALE, 1);
            } else if key > self.medium_key {
                (self.medium_key, self.medium) = (key, status.medium());
            }
        }
        (aged(&self.medium, tick.saturating_sub(self.medium_key.1)), self.medium_key)
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
            // One that was computed beside the role is for the judge of a swap.
            if model.epoch == SHADOW_EPOCH {
                continue;
            }
            let order = |model: &ContactModel| (self.order)(model.epoch, model.state_tick);
            let (key, newest) = (order(&model), order(&self.newest));
            let verdict = match () {
                () if is_ahead(&self.horizons[0], (model.epoch, model.state_tick), life) => Err(Distrust::Invalid),
                () if key <= std::mem::replace(&mut tissue.key, key) => Err(Distrust::Still),
                () => judge_model(&model, &life.page, tick.max(life.clock.latest_tick())),
            };
            if let Err(why) = verdict {
                life.refuse(tissue.page.incarnation(), why);
                self.refused_ticks[0] = self.refused_ticks[0].max(told_tick(model.state_tick, life));
            } else if key.0 < newest.0 {
                life.page.add64(header::STALE, 1);
            } else if key > newest {
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

/// The tick of what was refused; 0 for one that has not come yet, which would be said of all until then.
fn told_tick(tick: u64, life: &Life) -> u64 {
    if tick <= life.clock.latest_tick() { tick } else { 0 }
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
        && (0.0..=MAX_FRICTION).contains(&model.friction)
        && model.planes[..count].iter().all(|plane| {
            let length = plane.normal.iter().map(|c| c * c).sum::<f32>();
            plane.point_m.iter().all(|c| c.abs() <= MAX_DISTANCE_M)
                && (0.99..=1.01).contains(&length)
                && (0.0..=MAX_STIFFNESS_N_M).contains(&plane.stiffness_n_m)
                && (0.0..=1_000.0).contains(&plane.damping_n_s_m)
        })
}

/// The same after so many ticks.
fn aged(medium: &Medium, age_ticks: u64) -> Medium {
    let faded = age_ticks.saturating_sub(FULL_AGE_TICKS).min(FULL_AGE_TICKS) as f32 / FULL_AGE_TICKS as f32;
    Medium { on_scope_n: medium.on_scope_n.map(|newton| newton * (1.0 - faded)), ..*medium }
}

/// Whether a status is in range and goes on from the one before it: a deficit that stands still while something flows is an old one.
fn judge_status(status: &FluidStatus, before: Option<&FluidStatus>, tick: u64) -> Result<(), Distrust> {
    if !status.is_sound() || status.state_tick > tick + MOST_AHEAD_TICKS {
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
