//! What a newcomer may differ by: the tolerance of each role whose state is a message, section by section, and the comparison of two states of the
//! same tick. Engines of one source that read the same inputs do not differ at all; the tolerance is for one that is made anew.
//!
//! Promise: a number that is none is beyond every tolerance; a state that lacks a section gives an error, never a panic.

use crate::fluid::FluidStatus;
use crate::record::{ContactModel, ContactPlane};
use crate::stream::{Kind, Message, StreamHeader, WireError};

/// The epoch of what is computed beside the role, by a newcomer on trial or by whom it has replaced: below any epoch in which a role is held.
pub const SHADOW_EPOCH: u32 = 0;

impl StreamHeader {
    /// Whether the message was computed beside the role, and is read by the judge alone.
    pub fn is_shadow(&self) -> bool {
        self.epoch == SHADOW_EPOCH
    }
}

/// How far apart two states are where they are farthest apart, in parts of what is allowed there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// What differs.
    pub what: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// By how much.
    pub by: f64,
    /// By how much it may.
    pub most: f64,
}

impl Deviation {
    /// 1 is just allowed.
    pub fn ratio(&self) -> f64 {
        if self.by.is_finite() { self.by / self.most } else { f64::INFINITY }
    }
}

/// A section of numbers.
struct Field {
    section: usize,
    what: &'static str,
    unit: &'static str,
    most: f64,
    /// The root of the mean square counts and not the largest: at the rim of a cloud two good solvers differ by all of it, and two tissues
    /// where something swings.
    is_mean: bool,
}

/// Nodes and surface, m: half of what the eye resolves on the picture at 3 cm. Velocities, m/s: that of a quick hand, and their mean square, for of two
/// states that lost different ticks to a stall one swings as the other did some ms ago: a node by 1 m/s and all by 0.11 m/s were seen half a second
/// later (2-core VM, stalls of up to 20 ms each second, 2026-11-22), and both are right.
const TISSUE: [Field; 3] = [
    Field { section: 1, what: "positions", unit: "m", most: 5e-4, is_mean: false },
    Field { section: 2, what: "velocities", unit: "m/s", most: 0.2, is_mean: true },
    Field { section: 3, what: "surface", unit: "m", most: 5e-4, is_mean: false },
];
/// Blood in the medium of the cells.
const FLUID: [Field; 1] = [Field { section: 2, what: "share of blood", unit: "", most: 0.05, is_mean: true }];
/// Of the pump's figures: Pa, a tenth of what distends the cavity; ml; ml/min, a tenth of the pump's range.
const MOST_PRESSURE_PA: f64 = 1_000.0;
const MOST_VOLUME_ML: f64 = 2.0;
const MOST_FLOW_ML_MIN: f64 = 80.0;
/// Of vessels that are open, and of those that are coagulated: each is there or not, so that one more or less is beyond it. Who counts one a step later than the other is
/// beyond it for that step alone.
const MOST_VESSELS: f64 = 0.5;

/// Of contact models: how deep below a plane the hand is tried, m, and how fast it goes in, m/s; and by how much the forces may differ there, N and as a
/// share of the larger one. A surface that is as far out of place as [`TISSUE`] allows changes the force of a contact of 1.5 kN/m by 0.75 N, and so the place of a
/// plane of 450 N/m by 1.7 mm, which is a quarter of what it does here; a plane that is missing is all of it.
const MODEL_DEPTH_M: f32 = 6e-3;
const MODEL_SPEED_M_S: f32 = 0.05;
const MOST_FORCE_N: f64 = 0.05;
const MOST_FORCE_SHARE: f64 = 0.4;

/// The tolerance of a role's states, as a person reads it.
pub fn stated(kind: Kind) -> Vec<String> {
    let numbers = fields(kind).iter().map(|field| {
        let how = if field.is_mean { "root mean square" } else { "largest" };
        format!("{} within {} {} ({how} difference)", field.what, field.most, field.unit)
    });
    let pump = [
        format!("pressure within {MOST_PRESSURE_PA} Pa"),
        format!("deficit, blood and volume within {MOST_VOLUME_ML} ml"),
        format!("flows within {MOST_FLOW_ML_MIN} ml/min"),
        format!("force on the scope within {MOST_FORCE_N} N (largest difference)"),
        "as many vessels open, and as many coagulated".into(),
    ];
    let model = format!(
        "force of the contact model {} mm deep within {MOST_FORCE_N} N and {} %",
        1e3 * MODEL_DEPTH_M,
        100.0 * MOST_FORCE_SHARE
    );
    let model = (kind == Kind::TissueState).then_some(model);
    numbers.chain(pump.into_iter().filter(|_| kind == Kind::FluidState)).chain(model).collect()
}

fn fields(kind: Kind) -> &'static [Field] {
    match kind {
        Kind::TissueState => &TISSUE,
        Kind::FluidState => &FLUID,
        _ => &[],
    }
}

/// Where two states of one tick are farthest apart.
pub fn compare(kind: Kind, a: &[u8], b: &[u8]) -> Result<Deviation, WireError> {
    let (a, b) = (Message::parse(a, kind)?, Message::parse(b, kind)?);
    let mut worst = Deviation { what: "nothing", unit: "", by: 0.0, most: 1.0 };
    let mut note = |what, unit, by: f64, most| {
        let found = Deviation { what, unit, by: if by.is_nan() { f64::INFINITY } else { by }, most };
        if found.ratio() > worst.ratio() {
            worst = found;
        }
    };
    for field in fields(kind) {
        let (x, y): (&[f32], &[f32]) = (a.section(field.section)?, b.section(field.section)?);
        if x.len() != y.len() {
            return Err(WireError::Section(field.section));
        }
        note(field.what, field.unit, distance(x, y, field.is_mean), field.most);
    }
    if kind == Kind::FluidState {
        let (x, y) = (status_of(&a)?, status_of(&b)?);
        note("pressure", "Pa", f64::from(x.pressure_pa - y.pressure_pa).abs(), MOST_PRESSURE_PA);
        note("deficit", "ml", (x.deficit_ml - y.deficit_ml).abs(), MOST_VOLUME_ML);
        note("blood", "ml", (x.bled_ml - y.bled_ml).abs(), MOST_VOLUME_ML);
        note("volume", "ml", (x.cavity_volume_ml - y.cavity_volume_ml).abs(), MOST_VOLUME_ML);
        note("inflow", "ml/min", f64::from(x.inflow_ml_min - y.inflow_ml_min).abs(), MOST_FLOW_ML_MIN);
        note("outflow", "ml/min", f64::from(x.outflow_ml_min - y.outflow_ml_min).abs(), MOST_FLOW_ML_MIN);
        let differ = |a: u32, b: u32| f64::from(a.abs_diff(b));
        note("open vessels", "", differ(x.open_vessels, y.open_vessels), MOST_VESSELS);
        note("coagulated vessels", "", differ(x.sealed_vessels, y.sealed_vessels), MOST_VESSELS);
        note("force on the scope", "N", distance(&x.on_scope_n, &y.on_scope_n, false), MOST_FORCE_N);
    }
    Ok(worst)
}

/// How far apart two contact models of one tick are: the force of either below each plane of both, where it differs most, with what friction would make of that.
pub fn compare_models(a: &ContactModel, b: &ContactModel) -> Deviation {
    let mut worst = Deviation { what: "contact force", unit: "N", by: 0.0, most: MOST_FORCE_N };
    let planes = |model: &ContactModel| model.planes[..(model.plane_count as usize).min(model.planes.len())].to_vec();
    for plane in planes(a).iter().chain(&planes(b)) {
        let at_m: [f32; 3] = std::array::from_fn(|axis| plane.point_m[axis] - MODEL_DEPTH_M * plane.normal[axis]);
        let velocity_m_s = plane.normal.map(|component| -MODEL_SPEED_M_S * component);
        let forces_n = [a, b].map(|model| force_n(&planes(model), at_m, velocity_m_s));
        let length_n = |force_n: [f64; 3]| force_n.iter().map(|component| component * component).sum::<f64>().sqrt();
        let by = length_n(std::array::from_fn(|axis| forces_n[0][axis] - forces_n[1][axis]));
        let larger_n = length_n(forces_n[0]).max(length_n(forces_n[1]));
        let by = by + f64::from(a.friction - b.friction).abs() * larger_n;
        let most = MOST_FORCE_N + MOST_FORCE_SHARE * larger_n;
        let found = Deviation { by: if by.is_finite() { by } else { f64::INFINITY }, most, ..worst };
        if found.ratio() > worst.ratio() {
            worst = found;
        }
    }
    worst
}

/// The force of planes on a point that moves, N.
fn force_n(planes: &[ContactPlane], at_m: [f32; 3], velocity_m_s: [f32; 3]) -> [f64; 3] {
    let mut sum_n = [0.0; 3];
    for plane in planes {
        let along = |vector: &dyn Fn(usize) -> f32| (0..3).map(|axis| f64::from(vector(axis) * plane.normal[axis])).sum::<f64>();
        let depth_m = along(&|axis| plane.point_m[axis] - at_m[axis]);
        if depth_m > 0.0 || depth_m.is_nan() {
            let inwards_m_s = -along(&|axis| velocity_m_s[axis]);
            let push_n = f64::from(plane.stiffness_n_m) * depth_m + f64::from(plane.damping_n_s_m) * inwards_m_s;
            sum_n.iter_mut().zip(plane.normal).for_each(|(sum, component)| *sum += push_n * f64::from(component));
        }
    }
    sum_n
}

/// Every fluid's state begins with its status.
fn status_of(message: &Message<'_>) -> Result<FluidStatus, WireError> {
    let head = message.section::<u8>(0)?.get(..size_of::<FluidStatus>()).ok_or(WireError::Section(0))?;
    Ok(bytemuck::pod_read_unaligned(head))
}

fn distance(a: &[f32], b: &[f32], is_mean: bool) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b));
    if is_mean {
        let sum = differences.map(|difference| difference * difference).sum::<f64>();
        return (sum / a.len().max(1) as f64).sqrt();
    }
    // Not `max`, which passes over what is no number; one that is none stays the worst.
    differences.map(f64::abs).fold(0.0, |most: f64, off| if most.is_nan() || off <= most { most } else { off })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{MessageMut, message_bytes};

    fn tissue(position_m: f32) -> Vec<u64> {
        moving_tissue(position_m, 0.0)
    }

    fn moving_tissue(position_m: f32, velocity_m_s: f32) -> Vec<u64> {
        let sections = [8, 24, 24, 12];
        let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let mut message = MessageMut::format(bytes, Kind::TissueState, StreamHeader::default(), &sections).unwrap();
        message.section::<f32>(1).unwrap()[4] = position_m;
        message.section::<f32>(2).unwrap().fill(velocity_m_s);
        memory
    }

    fn fluid(status: FluidStatus, density: f32) -> Vec<u64> {
        let sections = [size_of::<FluidStatus>(), 8, 16];
        let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let mut message = MessageMut::format(bytes, Kind::FluidState, StreamHeader::default(), &sections).unwrap();
        message.section::<u8>(0).unwrap().copy_from_slice(bytemuck::bytes_of(&status));
        message.section::<f32>(2).unwrap()[0] = density;
        memory
    }

    fn of(kind: Kind, a: &[u64], b: &[u64]) -> Deviation {
        compare(kind, bytemuck::cast_slice(a), bytemuck::cast_slice(b)).unwrap()
    }

    #[test]
    fn a_node_that_is_out_of_place_counts_by_how_far() {
        assert_eq!(of(Kind::TissueState, &tissue(0.01), &tissue(0.01)).ratio(), 0.0);
        let found = of(Kind::TissueState, &tissue(0.01), &tissue(0.011));
        assert!((found.ratio() - 2.0).abs() < 1e-4 && found.what == "positions", "{found:?}");
        for bad in [f32::NAN, f32::INFINITY] {
            assert_eq!(of(Kind::TissueState, &tissue(0.01), &tissue(bad)).ratio(), f64::INFINITY, "{bad}");
        }
    }

    fn model(planes: &[([f32; 3], f32, [f32; 3])]) -> ContactModel {
        let mut model = ContactModel { plane_count: planes.len() as u32, ..ContactModel::default() };
        for (to, (point_m, stiffness_n_m, normal)) in model.planes.iter_mut().zip(planes) {
            *to = ContactPlane { point_m: *point_m, stiffness_n_m: *stiffness_n_m, normal: *normal, damping_n_s_m: 1.0 };
        }
        model
    }

    #[test]
    fn contact_models_count_by_the_force_that_the_hand_would_feel() {
        let wall = ([0.0, 0.0, 0.05], 400.0, [0.0, 0.0, -1.0]);
        let at = model(&[wall]);
        assert_eq!(compare_models(&at, &at).ratio(), 0.0);
        assert_eq!(compare_models(&model(&[]), &model(&[])).ratio(), 0.0);
        // None at all: 400 N/m · 6 mm + 1 N·s/m · 0.05 m/s = 2.45 N, 0.05 + 0.4 · 2.45 are allowed.
        let found = compare_models(&at, &model(&[]));
        assert!((found.by - 2.45).abs() < 1e-5 && (found.ratio() - 2.45 / 1.03).abs() < 1e-4, "{found:?}");
        assert_eq!(compare_models(&model(&[]), &at).ratio(), found.ratio());
        // 1.7 mm further in: 0.68 N of 2.45 or 3.13.
        let moved = compare_models(&at, &model(&[([0.0, 0.0, 0.0517], 400.0, [0.0, 0.0, -1.0])]));
        assert!(moved.ratio() < 0.7 && (moved.by - 0.68).abs() < 1e-4, "{moved:?}");
        assert!(compare_models(&at, &model(&[([0.0, 0.0, 0.05], 900.0, [0.0, 0.0, -1.0])])).ratio() > 1.0, "twice as stiff");
        assert!(compare_models(&at, &model(&[([0.0, 0.0, 0.05], 400.0, [0.0, 0.0, 1.0])])).ratio() > 1.0, "it pulls");
        assert_eq!(compare_models(&at, &model(&[([f32::NAN; 3], 400.0, [0.0, 0.0, -1.0])])).ratio(), f64::INFINITY);
        // Half of 2.45 N more along the wall.
        let rough = compare_models(&at, &ContactModel { friction: 0.5, ..at });
        assert!((rough.by - 1.225).abs() < 1e-5 && rough.ratio() > 1.0, "{rough:?}");
        assert_eq!(compare_models(&at, &ContactModel { friction: f32::NAN, ..at }).ratio(), f64::INFINITY);
    }

    #[test]
    fn velocities_count_by_their_mean_square() {
        let moving = |velocity_m_s: f32| moving_tissue(0.01, velocity_m_s);
        let found = of(Kind::TissueState, &moving(0.1), &moving(0.4));
        assert!((found.ratio() - 1.5).abs() < 1e-5 && found.what == "velocities", "{found:?}");
        assert_eq!(of(Kind::TissueState, &moving(0.1), &moving(f32::NAN)).ratio(), f64::INFINITY);
    }

    #[test]
    fn the_pump_counts_by_its_worst_figure_and_density_by_its_mean_square() {
        let good = FluidStatus { pressure_pa: 9_000.0, deficit_ml: 3.0, ..Default::default() };
        assert_eq!(of(Kind::FluidState, &fluid(good, 0.0), &fluid(good, 0.0)).ratio(), 0.0);
        let off = FluidStatus { pressure_pa: 9_500.0, deficit_ml: 6.0, ..good };
        let found = of(Kind::FluidState, &fluid(good, 0.0), &fluid(off, 0.0));
        assert_eq!((found.what, found.ratio()), ("deficit", 1.5));
        let bled = FluidStatus { bled_ml: 3.0, ..good };
        assert_eq!(of(Kind::FluidState, &fluid(good, 0.0), &fluid(bled, 0.0)).what, "blood");
        // One of four cells differs by 0.2: the root of the mean square is 0.1.
        let found = of(Kind::FluidState, &fluid(good, 0.0), &fluid(good, 0.2));
        assert!((found.ratio() - 2.0).abs() < 1e-6, "{found:?}");
        let pushed = FluidStatus { on_scope_n: [0.0, -0.075, 0.0], ..good };
        let found = of(Kind::FluidState, &fluid(good, 0.0), &fluid(pushed, 0.0));
        assert!((found.ratio() - 1.5).abs() < 1e-6 && found.what == "force on the scope", "{found:?}");
        // One that knows of no vessels agrees where there is none, and nowhere else.
        let (open, shut) = (FluidStatus { open_vessels: 1, ..good }, FluidStatus { sealed_vessels: 1, ..good });
        for (vessels, what) in [(open, "open vessels"), (shut, "coagulated vessels")] {
            let found = of(Kind::FluidState, &fluid(vessels, 0.0), &fluid(good, 0.0));
            assert_eq!((found.what, found.ratio()), (what, 2.0));
            assert_eq!(of(Kind::FluidState, &fluid(vessels, 0.0), &fluid(vessels, 0.0)).ratio(), 0.0);
        }
        let none = FluidStatus { outflow_ml_min: f32::NAN, ..good };
        assert_eq!(of(Kind::FluidState, &fluid(good, 0.0), &fluid(none, 0.0)).ratio(), f64::INFINITY);
    }

    #[test]
    fn states_that_lack_a_section_are_an_error() {
        let (short, good) = (tissue(0.0), fluid(FluidStatus::default(), 0.0));
        assert!(compare(Kind::FluidState, bytemuck::cast_slice(&short), bytemuck::cast_slice(&good)).is_err());
        assert!(compare(Kind::TissueState, &[0; 5], bytemuck::cast_slice(&short)).is_err());
        assert_eq!(stated(Kind::TissueState).len(), 4);
        assert_eq!(stated(Kind::FluidState).len(), 6);
    }
}
