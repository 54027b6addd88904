//! The instrument in the medium: the scope as a solid, its loop as wires, its ports and the pump.

use crate::lens::{Gaze, Lens};
use glam::{Quat, Vec3};
use hyst_flow::{Capsule, FlowInputs, MAX_WIRES, Port, PumpInput, StepReport, Way};
use hyst_messages::{BUTTON_EXTENDED, Controls, HardwareSample, MAX_ON_SCOPE_N};
use hyst_scene::{LoadedLoop, LoadedScene, OUTFLOW_RADII};

/// Length of the scope behind its tip that displaces fluid, m.
const SHAFT_M: f32 = 0.06;
/// Radius of the ports at the scope's tip, m.
const PORT_M: f32 = 0.003;
/// Below this the loop is in its sheath, m.
const LEAST_EXTENSION_M: f32 = 1e-3;
/// A tip this near to the pivot turns about nothing, m.
const LEAST_LEVER_M: f32 = 1e-3;
/// What turns the scope is felt at its tip as if that were at least so far from the pivot, m: a force on a shorter lever would be as large as one likes.
const LEAST_FELT_LEVER_M: f32 = 0.01;

/// What the scene says of the instrument.
pub struct Instrument {
    radius_m: f32,
    electrode: Option<LoadedLoop>,
    pivot_m: Vec3,
    max_flow_ml_min: f32,
    lens: Lens,
}

impl Instrument {
    /// That of a scene.
    pub fn of(scene: &LoadedScene) -> Instrument {
        let rigid = scene.rigid.first();
        Instrument {
            radius_m: rigid.map_or(0.0025, |rigid| rigid.radius_m),
            electrode: rigid.and_then(|rigid| rigid.electrode.clone()),
            pivot_m: Vec3::from(scene.workspace.pivot_m),
            max_flow_ml_min: scene.fluid.pump.max_flow_ml_min as f32,
            lens: Lens::of(scene),
        }
    }

    /// Its loop, if it has one.
    pub fn electrode(&self) -> Option<&LoadedLoop> {
        self.electrode.as_ref()
    }

    /// Where its lens looks; `None` if the hardware says nothing of it.
    pub fn gaze(&self, sample: &HardwareSample) -> Option<Gaze> {
        self.lens.gaze(sample)
    }

    /// What a step gets from the hardware: the scope and its loop as obstacles, the ports, valves and pump.
    pub fn inputs(&self, sample: &HardwareSample, dt_s: f32) -> FlowInputs {
        let mut inputs = FlowInputs { dt_s, ..FlowInputs::default() };
        let body = Body::new(sample, self.pivot_m);
        let (radius_m, axis) = (self.radius_m, body.axis.to_array());
        inputs.tools[0] = body.capsule([0.0, 0.0, -radius_m], [0.0, 0.0, -SHAFT_M], radius_m);
        self.place_wires(sample, &body, &mut inputs);
        // Inflow at the tip, along the axis; outflow through the outer sheath, one diameter behind it.
        let along = |from: f32| body.place_m([0.0, 0.0, from]).to_array();
        inputs.ports[0] = Port { centre_m: along(PORT_M), radius_m: PORT_M, direction: axis, share: 1.0, inflow: true, dye: 0.0 };
        let [behind_m, out_m] = OUTFLOW_RADII.map(|radii| radii * radius_m);
        inputs.ports[1] = Port { centre_m: along(-behind_m), radius_m: out_m, share: 1.0, ..Port::default() };
        // What leaks goes along the sheath through the cervix.
        inputs.leak = Way { centre_m: self.pivot_m.to_array(), radius_m };
        inputs.pump = PumpInput {
            inflow_valve: sample.controls.inflow_valve,
            outflow_valve: sample.controls.outflow_valve,
            set_pa: sample.controls.set_pressure_pa,
            flow_limit_ml_min: self.max_flow_ml_min,
            displaced_ml: room_ml(radius_m, body.lever_m),
            ..PumpInput::default()
        };
        inputs
    }

    /// What the medium did in a step to scope and loop, as a force at the tip, N: all that goes along the axis, and across it what turns the scope about the
    /// pivot as much, for beside it the cervix holds. What turns it about its own axis is not felt. Within [`MAX_ON_SCOPE_N`] along each axis.
    pub fn felt_n(&self, inputs: &FlowInputs, report: &StepReport) -> [f32; 3] {
        let (shaft, scope, wires) = (&inputs.tools[0], &report.tools[0], &report.wires);
        let along_m = Vec3::from(shaft.a_m) - Vec3::from(shaft.b_m);
        let axis = along_m.normalize_or_zero();
        let tip_m = Vec3::from(shaft.a_m) + shaft.radius_m * axis - self.pivot_m;
        let force_n = Vec3::from(scope.force_n) + Vec3::from(wires.force_n);
        let torque_nm = Vec3::from(scope.torque_nm) + Vec3::from(wires.torque_nm) - self.pivot_m.cross(force_n);
        let across_n = torque_nm.cross(axis) / tip_m.dot(axis).max(LEAST_FELT_LEVER_M);
        let felt_n = force_n.dot(axis) * axis + across_n;
        let most_n = Vec3::splat(MAX_ON_SCOPE_N);
        if felt_n.is_finite() { felt_n.clamp(-most_n, most_n).to_array() } else { [0.0; 3] }
    }

    /// The loop's half ring and the two arms on which it stands, as far as they are out.
    fn place_wires(&self, sample: &HardwareSample, body: &Body, inputs: &mut FlowInputs) {
        let Some(electrode) = &self.electrode else { return };
        let Some(out_m) = out_m(electrode, &sample.controls) else { return };
        let ring = ring_of(electrode, out_m);
        let ends = ring.windows(2).map(|ends| (ends[0], ends[1]));
        let arms = [ring[0], ring[RING]].map(|end| ([end[0], end[1], 0.0], end));
        for (wire, (a, b)) in inputs.wires.iter_mut().zip(ends.chain(arms)) {
            *wire = body.capsule(a, b, electrode.wire_radius_m);
        }
    }
}

/// What a scope with a round tip takes of the cavity's room, which begins at the pivot, when its tip is so far beyond that, ml.
fn room_ml(radius_m: f32, beyond_m: f32) -> f32 {
    let depth_m = beyond_m.clamp(0.0, SHAFT_M);
    // Of the tip's half ball as much as has come through, and then the shaft.
    let cap_m = depth_m.min(radius_m);
    let tip_m3 = cap_m * cap_m * (radius_m - cap_m / 3.0);
    1e6 * std::f32::consts::PI * (tip_m3 + radius_m * radius_m * (depth_m - cap_m))
}

/// How far a loop is out, if it is, m.
pub fn out_m(electrode: &LoadedLoop, controls: &Controls) -> Option<f32> {
    let out_m = controls.loop_extension_m;
    let is_out = controls.buttons & BUTTON_EXTENDED != 0 && out_m.is_finite() && out_m >= LEAST_EXTENSION_M;
    is_out.then(|| out_m.min(electrode.reach_m))
}

/// Straight pieces of the half ring, the first of the wires; with the two arms, which are insulated, no more than a step takes.
pub const RING: usize = 8;
const _: () = assert!(RING + 2 <= MAX_WIRES);

/// Evenly spread points of the half ring.
fn ring_of(electrode: &LoadedLoop, out_m: f32) -> [[f32; 3]; RING + 1] {
    let last = electrode.wire_m.len().saturating_sub(1);
    std::array::from_fn(|point| {
        let [x, y, z] = electrode.wire_m.get(point * last / RING).copied().unwrap_or_default();
        [x, y, z + out_m]
    })
}

/// The scope as a rigid body that slides through the pivot and turns about it.
struct Body {
    tip_m: Vec3,
    turn: Quat,
    axis: Vec3,
    /// Velocity of the tip along and across the axis, m/s.
    along_m_s: Vec3,
    across_m_s: Vec3,
    /// From the pivot to the tip along the axis, m.
    lever_m: f32,
}

impl Body {
    fn new(sample: &HardwareSample, pivot_m: Vec3) -> Body {
        let (tip_m, turn) = (Vec3::from(sample.pose.position_m), Quat::from_array(sample.pose.orientation));
        let (axis, velocity) = (turn * Vec3::Z, Vec3::from(sample.velocity_m_s));
        let along_m_s = velocity.dot(axis) * axis;
        let lever_m = (tip_m - pivot_m).dot(axis);
        Body { tip_m, turn, axis, along_m_s, across_m_s: velocity - along_m_s, lever_m }
    }

    /// Where a point of the scope is; the tip is the origin, the axis z.
    fn place_m(&self, own: [f32; 3]) -> Vec3 {
        self.tip_m + self.turn * Vec3::from(own)
    }

    /// How fast it goes: across the axis as its distance from the pivot; what turns about the axis itself is not known, and is as if it did not.
    fn velocity_m_s(&self, own: [f32; 3]) -> Vec3 {
        let share = if self.lever_m.abs() > LEAST_LEVER_M { (self.lever_m + own[2]) / self.lever_m } else { 1.0 };
        self.along_m_s + share * self.across_m_s
    }

    fn capsule(&self, a: [f32; 3], b: [f32; 3], radius_m: f32) -> Capsule {
        Capsule {
            a_m: self.place_m(a).to_array(),
            b_m: self.place_m(b).to_array(),
            radius_m,
            velocity_a_m_s: self.velocity_m_s(a).to_array(),
            velocity_b_m_s: self.velocity_m_s(b).to_array(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instrument() -> Instrument {
        Instrument { pivot_m: Vec3::ZERO, ..Instrument::of(&hyst_scene::load_embedded().unwrap()) }
    }

    /// The tip 40 mm before the pivot, going 20 mm/s along the axis and 8 mm/s across it.
    fn sample() -> HardwareSample {
        let mut sample = HardwareSample::default();
        sample.pose.orientation = Quat::IDENTITY.to_array();
        sample.pose.position_m = [0.0, 0.0, 0.04];
        sample.velocity_m_s = [0.008, 0.0, 0.02];
        sample
    }

    #[test]
    fn the_shafts_far_end_turns_about_the_pivot() {
        let instrument = instrument();
        let shaft = instrument.inputs(&sample(), 0.01).tools[0];
        let near = |found: [f32; 3], wanted: [f32; 3]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6);
        // 20 mm behind the pivot it goes the other way, half as fast; along the axis all of it goes alike.
        assert!(near(shaft.b_m, [0.0, 0.0, -0.02]) && near(shaft.velocity_b_m_s, [-0.004, 0.0, 0.02]), "{shaft:?}");
        let share = (0.04 - instrument.radius_m) / 0.04;
        assert!(near(shaft.velocity_a_m_s, [share * 0.008, 0.0, 0.02]), "{shaft:?}");
        let mut at_the_pivot = sample();
        at_the_pivot.pose.position_m = [0.0; 3];
        assert!(near(instrument.inputs(&at_the_pivot, 0.01).tools[0].velocity_b_m_s, sample().velocity_m_s));
    }

    /// A force at the tip is felt as it is, one half way to the pivot half as much across the axis, and one on the loop before the tip more.
    #[test]
    fn what_the_medium_does_is_felt_at_the_tip_by_the_levers() {
        let pivot_m = Vec3::new(0.001, -0.002, 0.003);
        let instrument = Instrument { pivot_m, ..instrument() };
        let mut sample = sample();
        sample.pose.position_m = (pivot_m + Vec3::new(0.0, 0.0, 0.04)).to_array();
        let inputs = instrument.inputs(&sample, 0.01);
        let at = |from_pivot_m: f32, force_n: [f32; 3]| {
            let place_m = pivot_m + Vec3::new(0.0, 0.0, from_pivot_m);
            let torque_nm = place_m.cross(Vec3::from(force_n)).to_array();
            hyst_flow::Load { force_n, torque_nm, ..Default::default() }
        };
        let felt_n = |scope: hyst_flow::Load, wires: hyst_flow::Load| {
            let mut report = StepReport { wires, ..StepReport::default() };
            report.tools[0] = scope;
            instrument.felt_n(&inputs, &report)
        };
        let near = |found: [f32; 3], wanted: [f32; 3]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6);
        let (none, force_n) = (hyst_flow::Load::default(), [0.02, -0.01, 0.04]);
        for (from_pivot_m, wanted_n) in
            [(0.04, force_n), (0.02, [0.01, -0.005, 0.04]), (0.0, [0.0, 0.0, 0.04]), (-0.02, [-0.01, 0.005, 0.04])]
        {
            let found_n = felt_n(at(from_pivot_m, force_n), none);
            assert!(near(found_n, wanted_n), "{from_pivot_m} m: {found_n:?} N");
        }
        let found_n = felt_n(at(0.02, force_n), at(0.05, [0.008, 0.0, 0.0]));
        assert!(near(found_n, [0.02, -0.005, 0.04]), "{found_n:?} N");
        assert_eq!(felt_n(at(0.04, [9.0, 0.0, -9.0]), none), [MAX_ON_SCOPE_N, 0.0, -MAX_ON_SCOPE_N]);
        assert_eq!(felt_n(at(0.04, [f32::NAN, 0.0, 0.0]), none), [0.0; 3]);
        let still = instrument.felt_n(&FlowInputs::default(), &StepReport::default());
        assert_eq!(still, [0.0; 3], "before there is a scope");
    }

    #[test]
    fn what_of_the_scope_is_beyond_the_pivot_takes_of_the_cavitys_room() {
        // By hand, for a radius of 2.5 mm: the half ball 2/3·π·2.5³ = 32.725 mm³, and 37.5 mm of shaft of π·2.5² = 19.635 mm² each: 0.76904 ml.
        let instrument = instrument();
        assert_eq!(instrument.radius_m, 0.0025);
        let displaced_ml = |z_m: f32| {
            let mut sample = sample();
            sample.pose.position_m[2] = z_m;
            instrument.inputs(&sample, 0.01).pump.displaced_ml
        };
        // A cap of 1 mm: π·1²·(2.5 − 1/3) = 6.8068 mm³.
        for (z_m, expected_ml) in [(-0.01, 0.0), (0.0, 0.0), (0.001, 0.006_806_8), (0.0025, 0.032_725), (0.04, 0.769_04)] {
            assert!((displaced_ml(z_m) - expected_ml).abs() < 2e-5, "{} ml at {z_m} m", displaced_ml(z_m));
        }
    }

    #[test]
    fn the_loop_is_wires_where_it_is_while_it_is_out() {
        let instrument = instrument();
        let electrode = instrument.electrode().unwrap();
        let mut sample = sample();
        sample.controls.loop_extension_m = 0.01;
        assert_eq!(instrument.inputs(&sample, 0.01).wires, [Capsule::default(); MAX_WIRES], "in its sheath");
        sample.controls.buttons = BUTTON_EXTENDED;
        let wires = instrument.inputs(&sample, 0.01).wires;
        let placed: Vec<&Capsule> = wires.iter().filter(|wire| wire.radius_m > 0.0).collect();
        assert_eq!(placed.len(), RING + 2);
        let length = |wire: &Capsule| Vec3::from(wire.a_m).distance(Vec3::from(wire.b_m));
        let ring_m: f32 = placed[..RING].iter().map(|wire| length(wire)).sum();
        let arc_m = std::f32::consts::PI * electrode.radius_m;
        assert!((ring_m / arc_m - 1.0).abs() < 0.01, "{ring_m} of {arc_m} m");
        for wire in &placed {
            assert!(wire.radius_m == electrode.wire_radius_m && wire.velocity_a_m_s[2] == 0.02, "{wire:?}");
        }
        for wire in &placed[..RING] {
            assert!(
                (wire.a_m[2] - 0.05).abs() < 1e-6 && (wire.velocity_a_m_s[0] - 0.01).abs() < 1e-6,
                "5/4 of the tip's: {wire:?}"
            );
        }
        for arm in &placed[RING..] {
            assert!((length(arm) - 0.01).abs() < 1e-6 && (arm.a_m[2] - 0.04).abs() < 1e-6, "{arm:?}");
        }
        for extension_m in [0.0005, f32::NAN, f32::INFINITY] {
            sample.controls.loop_extension_m = extension_m;
            assert_eq!(instrument.inputs(&sample, 0.01).wires, [Capsule::default(); MAX_WIRES], "{extension_m}");
        }
    }
}
