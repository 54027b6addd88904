//! What the fluid says of itself: pump, cavity, blood, vessels that are sealed, and the flow at what floats.

use crate::record::{MAX_FLOW_M_S, MAX_ON_SCOPE_N, MAX_PIECES, Medium, PieceFlow};
use bytemuck::{Pod, Zeroable};

/// Bits of [`FluidStatus::alarms`] and what they say: the pressure is above the set one, more medium is missing than may be, much of it goes where it
/// should not, more than vessels and sheath take, the container is to be changed.
pub const PUMP_ALARMS: [(u32, &str); 5] =
    [(1, "pressure"), (2, "deficit"), (4, "abnormal loss"), (8, "perforation"), (16, "container change")];
/// Bits of [`PUMP_ALARMS`] that ask for nothing: of a container that is to be changed another one hangs beside it, and nobody has done anything wrong.
pub const PUMP_NOTICES: u32 = 16;

/// Bits of [`FluidStatus::flaws`] and what was done about them. Mended: walls or inputs that are no numbers or beyond any organ were replaced, speeds beyond any
/// real one were set to 0, the walls of before were kept where the tissue left nothing of the cavity, a sample of before where the newest cannot be. As they
/// were: a flow too fast for the sweeps of a step was slowed in transport, the pressure was taken before it had converged, what flows through a port that lies
/// in a solid moved nothing, the box closed the cavity where the tissue does not.
pub const FLOW_FLAWS: [(u32, &str); 8] = [
    (1, "input replaced"),
    (2, "wild speed"),
    (WALLS_KEPT, "walls kept"),
    (SAMPLE_KEPT, "sample kept"),
    (4, "slowed"),
    (8, "not converged"),
    (16, "port without cells"),
    (WALLS_OPEN, "walls open"),
];
/// Bit of [`FLOW_FLAWS`]: walls that are no numbers or faster than any organ were replaced.
pub const WALLS_REPLACED: u32 = 1;
/// Bit of [`FLOW_FLAWS`]: the tissue does not close the cavity.
pub const WALLS_OPEN: u32 = 32;
/// Bit of [`FLOW_FLAWS`]: the tissue left nothing of the cavity.
pub const WALLS_KEPT: u32 = 64;
/// Bit of [`FLOW_FLAWS`]: the hardware's newest sample cannot be.
pub const SAMPLE_KEPT: u32 = 128;

/// Most vessels that a state says to be coagulated, in whole or in part: one in each cube of 4 mm of 10 cm² of wounds.
pub const MAX_SEALS: usize = 64;

/// Longest step of a Flow Engine, ticks.
pub const MAX_FLUID_STEP_TICKS: u64 = 250;

/// Pressure beyond which no fluid's is believed, Pa: the pump's range ends at 20 kPa.
const MAX_PRESSURE_PA: f32 = 40_000.0;
/// Beyond this no volume is believed, ml, and no flow, ml/min: a cavity of a litre, the largest that a scene may have, that empties within 10 ms makes
/// 6 000 000 ml/min (calculated).
const MAX_ML: f64 = 1e7;

/// A vessel that the loop coagulates, or has coagulated, in a section of the fluid's state. It is known by the cube of the tissue's shape at rest that it
/// lies in; a place that is free is zero.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SealRecord {
    /// The cube, in edges of a cube along x, y, z.
    pub cube: [i32; 3],
    /// How far it is shut: 0 not at all, 1 it neither bleeds nor takes medium in.
    pub share: f32,
    /// Middle of the wound that had opened it when the loop first touched it, in the tissue's shape at rest, m.
    pub rest_m: [f32; 3],
    /// Area of that wound within the cube, likewise, m².
    pub area_m2: f32,
}

/// What fluid says of itself each step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FluidStatus {
    /// Tick of the newest state.
    pub state_tick: u64,
    /// Volume in minus volume out since the start, ml.
    pub deficit_ml: f64,
    /// Volume of the cavity, ml.
    pub cavity_volume_ml: f64,
    /// Blood that has come into the cavity since the start, ml.
    pub bled_ml: f64,
    /// Hash of the solver's state, in lock-step; else 0, and where the status lies in a state.
    pub state_hash: u64,
    /// Pressure in the cavity, Pa.
    pub pressure_pa: f32,
    /// Flow into the cavity, ml/min.
    pub inflow_ml_min: f32,
    /// Flow out of the cavity, ml/min.
    pub outflow_ml_min: f32,
    /// Alarm bits of the pump, [`PUMP_ALARMS`].
    pub alarms: u32,
    /// Epoch and incarnation of the owner, as its page says it; 0 where the status lies in a state, which is the same whoever made it.
    pub epoch: u32,
    /// See `epoch`.
    pub incarnation: u32,
    /// Length of a step, ticks.
    pub step_ticks: u32,
    /// The one that the scene asks for, ticks: the shorter one, where the machine does not afford it.
    pub scene_step_ticks: u32,
    /// How many times the scene's grid is halved along each axis, where the machine affords no step of it.
    pub halvings: u32,
    /// What was mended in the step, [`FLOW_FLAWS`].
    pub flaws: u32,
    /// Vessels that wounds have opened and that are not sealed.
    pub open_vessels: u32,
    /// Vessels that are sealed.
    pub sealed_vessels: u32,
    /// The flow at the largest free pieces, in the order of the objects.
    pub pieces: [PieceFlow; MAX_PIECES],
    /// What the medium does to scope and loop beyond the cavity's mean pressure, as a force at the tip, N, within
    /// [`MAX_ON_SCOPE_N`](crate::record::MAX_ON_SCOPE_N) along each axis.
    pub on_scope_n: [f32; 3],
    /// Share of the light that comes through the blood before the lens, over 20 mm or to the wall, in the mean over the field of view: above 0, and 1 where
    /// there is none. 0 where nothing is said of it, as while the lens is in tissue; no number in a recording of before it was told. See
    /// [`told_transmittance`](FluidStatus::told_transmittance).
    pub transmittance: f32,
}

impl Medium {
    /// Whether pressure, flow and force are in their ranges.
    pub fn is_sound(&self) -> bool {
        let mut speeds = self.pieces.iter().flat_map(|flow| flow.velocity_m_s);
        (0.0..=MAX_PRESSURE_PA).contains(&self.pressure_pa)
            && speeds.all(|speed| speed.abs() <= MAX_FLOW_M_S)
            && self.on_scope_n.iter().all(|newton| newton.abs() <= MAX_ON_SCOPE_N)
    }
}

impl FluidStatus {
    /// What it says of the medium.
    pub fn medium(&self) -> Medium {
        Medium { pressure_pa: self.pressure_pa, pieces: self.pieces, on_scope_n: self.on_scope_n }
    }

    /// Whether every figure of medium and pump is a number in its range. Who uses or shows one that is not follows a fluid that lies.
    pub fn is_sound(&self) -> bool {
        let flows = [self.inflow_ml_min, self.outflow_ml_min].map(f64::from);
        let figures = [self.deficit_ml, self.cavity_volume_ml, self.bled_ml].into_iter().chain(flows);
        self.medium().is_sound() && figures.map(f64::abs).all(|figure| figure <= MAX_ML)
    }

    /// The newest of what several fluids say, by epoch and tick; what is not [sound](FluidStatus::is_sound), or is ahead of its time, counts for nothing.
    pub fn newest_of(said: impl Iterator<Item = FluidStatus>, is_ahead: impl Fn((u32, u64)) -> bool) -> Option<FluidStatus> {
        let key = |status: &FluidStatus| (status.epoch, status.state_tick);
        let counting = said.filter(|status| status.state_tick > 0 && status.is_sound() && !is_ahead(key(status)));
        counting.max_by_key(key)
    }

    /// What it says of the light before the lens; `None` if it says nothing, or what cannot be.
    pub fn told_transmittance(&self) -> Option<f32> {
        Some(self.transmittance).filter(|share| *share > 0.0 && *share <= 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(epoch: u32, state_tick: u64) -> FluidStatus {
        FluidStatus { epoch, state_tick, pressure_pa: 9_000.0, deficit_ml: 3.0, inflow_ml_min: 90.0, ..FluidStatus::default() }
    }

    #[test]
    fn a_status_with_a_figure_that_is_no_number_or_out_of_range_is_not_sound() {
        let spoil: [fn(&mut FluidStatus, f64); 7] = [
            |status, number| status.pressure_pa = number as f32,
            |status, number| status.inflow_ml_min = number as f32,
            |status, number| status.outflow_ml_min = number as f32,
            |status, number| status.deficit_ml = number,
            |status, number| status.cavity_volume_ml = number,
            |status, number| status.bled_ml = number,
            |status, number| status.on_scope_n[1] = number as f32,
        ];
        for (figure, spoil) in spoil.into_iter().enumerate() {
            let with = |number: f64| {
                let mut told = status(1, 33);
                spoil(&mut told, number);
                told.is_sound()
            };
            assert!(with(0.25), "figure {figure}");
            for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e9] {
                assert!(!with(number), "figure {figure}: {number}");
            }
        }
        assert!(status(1, 33).is_sound() && FluidStatus { deficit_ml: -50.0, ..status(1, 33) }.is_sound());
        assert!(!FluidStatus { pressure_pa: -1.0, ..status(1, 33) }.is_sound());
    }

    #[test]
    fn of_several_statuses_the_newest_counts_that_can_be() {
        let said =
            [status(1, 99), status(2, 66), status(2, 33), status(9, 0), FluidStatus { deficit_ml: f64::NAN, ..status(2, 99) }];
        let newest = |said: &[FluidStatus]| FluidStatus::newest_of(said.iter().copied(), |key| key > (2, 200));
        assert_eq!(newest(&said), Some(status(2, 66)));
        assert_eq!(newest(&[status(2, 66), status(2, 201), status(1_002, 66)]), Some(status(2, 66)));
        assert_eq!((newest(&[status(3, 66)]), newest(&[])), (None, None));
    }

    #[test]
    fn a_status_that_says_nothing_of_the_view_or_what_cannot_be_tells_of_none() {
        let told = |transmittance| FluidStatus { transmittance, ..FluidStatus::default() }.told_transmittance();
        assert_eq!([1e-6, 0.25, 1.0].map(told), [Some(1e-6), Some(0.25), Some(1.0)]);
        assert_eq!([0.0, -0.0, -0.5, 1.5, f32::NAN, f32::INFINITY].map(told), [None; 6]);
        assert_eq!(FluidStatus::default().told_transmittance(), None);
    }
}
