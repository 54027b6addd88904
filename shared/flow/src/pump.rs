//! Pump and hydrometra: how much medium is in the cavity, at which pressure, and where the rest went.
//!
//! One compartment: dV/dt = inflow − outflow − intravasation − leak − perforation + bleeding, with the pressure given by the volume ([`crate::curve`]). All of
//! it is the mean over a beat of the roller, which comes on top ([`crate::roller`]): by the mean the pump regulates, counts and gives alarm.
//! Promise: implicit Euler, unconditionally stable; the balance of the counters holds to rounding whatever the inputs; counters are f64.
//! Figures: Zátonyi et al. 2005 (hydrometra), WOM's manual, ACOG Committee Opinion 800. The conductances, the leak
//! and the shape of the curve between its two published points are this model's assumptions, to be set per case.

use crate::alarms::Alarms;
use crate::error::FlowError;
use crate::inputs::tame;
use crate::model::range;
use crate::roller::Beat;

/// Pascal per millimetre of mercury.
pub const PA_PER_MMHG: f64 = 133.322;
/// The longest inner step, s: a tenth of the time in which the outflow empties a cavity of 5 ml.
const INNER_STEP_S: f64 = 0.005;
/// No instrument takes more room in a cavity, and no more tissue comes out of it, ml.
const MOST_DISPLACED_ML: f32 = 100.0;
/// No pressure above this goes to the tissue, Pa (300 mmHg): an instrument that comes into a shut cavity meets a way past it, or through the tubes, before.
pub(crate) const MOST_PA: f64 = 40_000.0;
/// A set pressure so little above the range is its upper end, rounded, Pa: 150 mmHg are 19 998.3 Pa, and a scene says 20 kPa for them.
const ROUNDING_PA: f64 = 2.0;
/// Bisections per inner step: 2⁻⁵⁰ of the bracket is beyond what f64 volumes show.
pub(crate) const BISECTIONS: usize = 50;

/// Cavity, pump, tubes and vessels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PumpModel {
    /// Volume of the cavity at 150 mmHg, ml (published: 0.6 to 11.4).
    pub volume_150_mmhg_ml: f64,
    /// Pressure at which the walls part, Pa (published median 40 mmHg).
    pub parting_pa: f64,
    /// Volume over which the pressure rises to the parting pressure, ml.
    pub parting_ml: f64,
    /// The roller pump's largest flow, ml/s (800 ml/min).
    pub max_flow_ml_s: f64,
    /// What it delivers from one roller to the next, ml. 4: assumed a tube of 7 mm bore (38.5 mm²) and three rollers on a radius of 50 mm (105 mm apart).
    pub stroke_ml: f64,
    /// By how much less it delivers while a roller leaves the tube, ml, at most half a stroke; 0: it does not beat. 0.34: half of what the tube above holds
    /// along the chord of 17.6 mm in which a roller of 9 mm radius flattens it (assumed).
    pub lift_ml: f64,
    /// Compliance of the tube from the roller to the sheath, ml/Pa. 1e-4: assumed 2.5 m of the tube above, 1.6 mm of soft PVC (6 MPa) thick, by Lamé.
    pub tube_ml_pa: f64,
    /// The pump runs at full flow when the pressure is this far below the set pressure, Pa.
    pub band_pa: f64,
    /// Largest pressure that the pump obeys, Pa (150 mmHg).
    pub max_set_pa: f64,
    /// Pressure at the roller at most, Pa; the tube's resistance takes its part.
    pub max_delivery_pa: f64,
    /// Conductance of the fully open inflow valve and tube, ml/(s·Pa).
    pub inflow_ml_s_pa: f64,
    /// Conductance of the fully open outflow valve and tube, ml/(s·Pa).
    pub outflow_ml_s_pa: f64,
    /// Suction at the outflow, Pa below the atmosphere.
    pub suction_pa: f64,
    /// Leak past the sheath through the cervix, ml/(s·Pa).
    pub leak_ml_s_pa: f64,
    /// Pressure in the veins that medium enters, Pa (10 mmHg).
    pub venous_pa: f64,
    /// Conductance of fully open veins, ml/(s·Pa).
    pub intravasation_ml_s_pa: f64,
    /// Conductance of a perforation of size 1, ml/(s·Pa), into the abdomen at 0 Pa.
    pub perforation_ml_s_pa: f64,
    /// Alarm: pressure above the set pressure by this, Pa.
    pub pressure_alarm_pa: f64,
    /// Alarm: so much is missing, ml; `None`: what ACOG Committee Opinion 800 says of the medium, 1 000 ml of hypotonic and 2 500 ml of isotonic.
    pub deficit_alarm_ml: Option<f64>,
    /// Alarm: loss (not seen at the outflow) faster than this, ml/s (300 ml/min).
    pub loss_alarm_ml_s: f64,
    /// Alarm: loss faster by this than all veins and the sheath's leak together can take at the pressure, ml/s (60 ml/min).
    pub hole_alarm_ml_s: f64,
    /// What a container of medium holds, ml (a bag of 3 l).
    pub container_ml: f64,
    /// Alarm: no more than this is left in the container, ml (at 300 ml/min enough for 20 s).
    pub container_alarm_ml: f64,
}

impl Default for PumpModel {
    fn default() -> Self {
        Self {
            volume_150_mmhg_ml: 8.0,
            parting_pa: 40.0 * PA_PER_MMHG,
            parting_ml: 0.5,
            max_flow_ml_s: 800.0 / 60.0,
            stroke_ml: 4.0,
            lift_ml: 0.34,
            tube_ml_pa: 1e-4,
            band_pa: 1_000.0,
            max_set_pa: 150.0 * PA_PER_MMHG,
            max_delivery_pa: 40_000.0,
            inflow_ml_s_pa: 5e-4,
            outflow_ml_s_pa: 5e-4,
            suction_pa: 0.0,
            leak_ml_s_pa: 0.0,
            venous_pa: 10.0 * PA_PER_MMHG,
            intravasation_ml_s_pa: 2e-4,
            perforation_ml_s_pa: 2e-3,
            pressure_alarm_pa: 20.0 * PA_PER_MMHG,
            deficit_alarm_ml: None,
            loss_alarm_ml_s: 5.0,
            hole_alarm_ml_s: 1.0,
            container_ml: 3_000.0,
            container_alarm_ml: 100.0,
        }
    }
}

/// What the operator and the tissue tell the pump. All zero: everything shut.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PumpInput {
    /// Set pressure, Pa.
    pub set_pa: f32,
    /// Limit of the flow, ml/min; 0 stops the pump.
    pub flow_limit_ml_min: f32,
    /// Inflow valve, 0 shut to 1 open.
    pub inflow_valve: f32,
    /// Outflow valve, 0 shut to 1 open.
    pub outflow_valve: f32,
    /// Open veins, 0 none to 1 all of the model's conductance.
    pub open_veins: f32,
    /// Perforation, 0 none to 1.
    pub perforation: f32,
    /// What takes room in the cavity beside the medium, ml, more than when its curve was taken: an instrument. Negative: tissue that was there is gone.
    pub displaced_ml: f32,
}

impl PumpInput {
    pub(crate) fn tame(&mut self) -> u32 {
        let mut count = 0;
        tame(&mut self.set_pa, 0.0, 1e5, 0.0, &mut count);
        tame(&mut self.flow_limit_ml_min, 0.0, 1e4, 0.0, &mut count);
        for part in [&mut self.inflow_valve, &mut self.outflow_valve, &mut self.open_veins, &mut self.perforation] {
            tame(part, 0.0, 1.0, 0.0, &mut count);
        }
        tame(&mut self.displaced_ml, -MOST_DISPLACED_ML, MOST_DISPLACED_ML, 0.0, &mut count);
        count
    }
}

/// Integrators of pump and cavity, ml, each the mean over a beat. What a power loss must not lose.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PumpState {
    /// Medium (and blood) in the cavity.
    pub cavity_ml: f64,
    /// Medium that the pump delivered: how far its roller head has turned, too.
    pub in_ml: f64,
    /// What came back through the outflow.
    pub out_ml: f64,
    /// Medium that entered the vessels.
    pub intravasated_ml: f64,
    /// Medium lost past the sheath.
    pub leaked_ml: f64,
    /// Medium lost through a perforation.
    pub perforated_ml: f64,
    /// Blood that entered the cavity.
    pub bled_ml: f64,
}

impl PumpState {
    /// Deficit as the clinic counts it: delivered − returned, ml.
    pub fn deficit_ml(&self) -> f64 {
        self.in_ml - self.out_ml
    }
    /// What left the cavity and did not come back, ml.
    fn lost_ml(&self) -> f64 {
        self.intravasated_ml + self.leaked_ml + self.perforated_ml
    }
    /// The counters' balance, ml: 0 but for rounding, from an empty cavity on.
    pub fn imbalance_ml(&self) -> f64 {
        self.in_ml + self.bled_ml - self.out_ml - self.intravasated_ml - self.leaked_ml - self.perforated_ml - self.cavity_ml
    }
}

/// Flows and pressure at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PumpReport {
    /// Pressure in the cavity above the atmosphere, Pa: what distends the tissue. In the report of a solver's step it has the beat in it, and is no more than
    /// 40 kPa.
    pub pressure_pa: f64,
    /// Mean flow in during the step, ml/s.
    pub in_ml_s: f64,
    /// Mean flow out during the step, ml/s.
    pub out_ml_s: f64,
    /// Mean flow of medium into vessels, ml/s.
    pub intravasation_ml_s: f64,
    /// Mean leak past the sheath, ml/s.
    pub leak_ml_s: f64,
    /// Mean loss through a perforation, ml/s.
    pub perforation_ml_s: f64,
    /// What the roller's beat adds to the flows, and has added to the pressure; nothing in the report of [`PumpModel::step`].
    pub beat: Beat,
    /// Alarms, each by its limit.
    pub alarms: Alarms,
    /// Those that go on if they stood before ([`Self::alarms_after`]).
    pub lasting: Alarms,
}

/// Flows at one pressure, ml/s.
#[derive(Clone, Copy)]
struct Flows {
    inward: f64,
    outward: f64,
    veins: f64,
    leak: f64,
    hole: f64,
}

impl Flows {
    fn net(&self) -> f64 {
        self.inward - self.outward - self.veins - self.leak - self.hole
    }
}

impl PumpModel {
    pub(crate) fn check(&self) -> Result<(), FlowError> {
        range("pump.volume_150_mmhg_ml", self.volume_150_mmhg_ml, 0.1, 1e3, "0.1 to 1000")?;
        range("pump.parting_pa", self.parting_pa, 0.0, 140.0 * PA_PER_MMHG, "0 to 18665")?;
        range("pump.parting_ml", self.parting_ml, 1e-3, 1e2, "1e-3 to 100")?;
        range("pump.max_flow_ml_s", self.max_flow_ml_s, 0.0, 100.0, "0 to 100")?;
        range("pump.stroke_ml", self.stroke_ml, 0.1, 100.0, "0.1 to 100")?;
        range("pump.lift_ml", self.lift_ml, 0.0, 0.5 * self.stroke_ml, "0 to half of stroke_ml")?;
        range("pump.tube_ml_pa", self.tube_ml_pa, 0.0, 1.0, "0 to 1")?;
        range("pump.band_pa", self.band_pa, 1.0, 1e5, "1 to 1e5")?;
        range("pump.max_set_pa", self.max_set_pa, 0.0, 1e5, "0 to 1e5")?;
        range("pump.max_delivery_pa", self.max_delivery_pa, 0.0, 1e6, "0 to 1e6")?;
        range("pump.suction_pa", self.suction_pa, 0.0, 1e5, "0 to 1e5")?;
        range("pump.venous_pa", self.venous_pa, 0.0, 1e5, "0 to 1e5")?;
        range("pump.pressure_alarm_pa", self.pressure_alarm_pa, 0.0, 1e5, "0 to 1e5")?;
        range("pump.deficit_alarm_ml", self.deficit_alarm_ml.unwrap_or(1.0), 1.0, 1e5, "1 to 1e5")?;
        range("pump.loss_alarm_ml_s", self.loss_alarm_ml_s, 0.0, 1e3, "0 to 1000")?;
        range("pump.hole_alarm_ml_s", self.hole_alarm_ml_s, 0.0, 1e3, "0 to 1000")?;
        range("pump.container_ml", self.container_ml, 100.0, 1e5, "100 to 1e5")?;
        range("pump.container_alarm_ml", self.container_alarm_ml, 0.0, 1e5, "0 to 1e5")?;
        let conductances = [self.inflow_ml_s_pa, self.outflow_ml_s_pa, self.leak_ml_s_pa, self.intravasation_ml_s_pa];
        for value in conductances.into_iter().chain([self.perforation_ml_s_pa]) {
            range("pump.…_ml_s_pa", value, 0.0, 1.0, "0 to 1")?;
        }
        Ok(())
    }

    /// The set pressure that the pump obeys, Pa: none above its range.
    pub(crate) fn set_pa(&self, input: &PumpInput) -> f64 {
        f64::from(input.set_pa).min(self.max_set_pa)
    }

    /// Whether it is asked for more than it obeys.
    pub(crate) fn is_asked_for_more(&self, input: &PumpInput) -> bool {
        f64::from(input.set_pa) - self.set_pa(input) > ROUNDING_PA
    }

    fn flows(&self, input: &PumpInput, volume_ml: f64) -> Flows {
        let pressure_pa = self.distended_pa(volume_ml, input.displaced_ml);
        let set_pa = self.set_pa(input);
        let limit_ml_s = (f64::from(input.flow_limit_ml_min) / 60.0).min(self.max_flow_ml_s);
        let wanted = limit_ml_s * ((set_pa - pressure_pa) / self.band_pa).clamp(0.0, 1.0);
        let tube = f64::from(input.inflow_valve) * self.inflow_ml_s_pa * (self.max_delivery_pa - pressure_pa).max(0.0);
        // An empty cavity has nothing to give: the last 0.05 ml throttle every way out.
        let filled = (volume_ml / 0.05).clamp(0.0, 1.0);
        Flows {
            inward: wanted.min(tube),
            outward: filled * f64::from(input.outflow_valve) * self.outflow_ml_s_pa * (pressure_pa + self.suction_pa),
            veins: filled * f64::from(input.open_veins) * self.intravasation_ml_s_pa * (pressure_pa - self.venous_pa).max(0.0),
            leak: filled * self.leak_ml_s_pa * pressure_pa,
            hole: filled * f64::from(input.perforation) * self.perforation_ml_s_pa * pressure_pa,
        }
    }

    /// One step of `dt_s` of the mean, with neutralised input; `bled_ml` is the blood that entered during the step.
    pub fn step(&self, state: &mut PumpState, input: &PumpInput, isotonic: bool, bled_ml: f64, dt_s: f64) -> PumpReport {
        let before = *state;
        let before_pa = self.distended_pa(state.cavity_ml, input.displaced_ml);
        state.cavity_ml += bled_ml;
        state.bled_ml += bled_ml;
        let parts = (dt_s / INNER_STEP_S).ceil().max(1.0);
        let h_s = dt_s / parts;
        for _ in 0..parts as usize {
            let flows = self.implicit(state.cavity_ml, input, h_s);
            state.cavity_ml = (state.cavity_ml + h_s * flows.net()).max(0.0);
            state.in_ml += h_s * flows.inward;
            state.out_ml += h_s * flows.outward;
            state.intravasated_ml += h_s * flows.veins;
            state.leaked_ml += h_s * flows.leak;
            state.perforated_ml += h_s * flows.hole;
        }
        let per_s = if dt_s > 0.0 { 1.0 / dt_s } else { 0.0 };
        let pressure_pa = self.distended_pa(state.cavity_ml, input.displaced_ml);
        let lost_ml_s = (state.lost_ml() - before.lost_ml()) * per_s;
        let [alarms, lasting] = self.alarms(state, input, isotonic, lost_ml_s, [before_pa, pressure_pa]);
        PumpReport {
            pressure_pa,
            in_ml_s: (state.in_ml - before.in_ml) * per_s,
            out_ml_s: (state.out_ml - before.out_ml) * per_s,
            intravasation_ml_s: (state.intravasated_ml - before.intravasated_ml) * per_s,
            leak_ml_s: (state.leaked_ml - before.leaked_ml) * per_s,
            perforation_ml_s: (state.perforated_ml - before.perforated_ml) * per_s,
            beat: Beat::default(),
            alarms,
            lasting,
        }
    }

    /// What is left in the container that hangs now, ml: each is as full as the first one was.
    pub fn container_left_ml(&self, state: &PumpState) -> f64 {
        self.container_ml - state.in_ml % self.container_ml
    }

    /// The flows at the end of a step of `h_s`: net(V) falls with V, so V = V₀ + h·net(V) has one root; bisection finds it.
    fn implicit(&self, volume_ml: f64, input: &PumpInput, h_s: f64) -> Flows {
        let mut low = 0.0;
        let mut high = volume_ml + h_s * self.max_flow_ml_s;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if volume_ml + h_s * self.flows(input, middle).net() > middle {
                low = middle;
            } else {
                high = middle;
            }
        }
        self.flows(input, 0.5 * (low + high))
    }
}
