//! A test bench: hand, two servos, last hop and hardware in one closed loop with a delay of one tick, against simple tissues.

use glam::Vec3;
use hyst_coupling::*;

/// One tick, s.
pub const DT_S: f32 = 1e-3;

/// A tissue: its contact model for a tip position.
pub type Tissue = fn(tip: Vec3, stiffness_n_m: f32) -> ContactModel;

/// A wall across the canal at z = 60 mm.
pub fn wall(_tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    ContactModel::new(&[Plane { point_m: [0.0, 0.0, 0.06], normal: [0.0, 0.0, -1.0], stiffness_n_m, damping_n_s_m: 0.5 }])
}

/// A spherical cavity of 15 mm about z = 50 mm: the tangent plane where the tip was seen.
pub fn cavity(tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    let centre = Vec3::new(0.0, 0.0, 0.05);
    let out = (tip - centre).normalize_or(Vec3::Z);
    let point_m = (centre + out * 0.015).to_array();
    ContactModel::new(&[Plane { point_m, normal: (-out).to_array(), stiffness_n_m, damping_n_s_m: 0.5 }])
}

/// A corner: wall and side wall at an acute angle, each given twice, slightly askew.
pub fn corner(_tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    let plane = |point_m: [f32; 3], normal: [f32; 3]| Plane { point_m, normal, stiffness_n_m, damping_n_s_m: 0.5 };
    ContactModel::new(&[
        plane([0.0, 0.0, 0.06], [0.0, 0.0, -1.0]),
        plane([0.0, 0.0, 0.0601], [0.001, 0.0, -1.0]),
        plane([0.004, 0.0, 0.05], [-0.8, 0.0, -0.6]),
        plane([0.0041, 0.0, 0.05], [-0.8, 0.001, -0.6]),
    ])
}

/// The closed loop.
pub struct Bench {
    pub hand_model: HandModel,
    pub hand: HandState,
    pub script: HandScript,
    pub servo_params: ServoParams,
    pub servos: [ServoState; 2],
    pub hop_params: LastHopParams,
    pub hop: LastHopState,
    pub hardware: HardwareState,
    /// The last hop's energy account, the least share of a force that it would have applied, and whether it is heeded.
    pub energy: EnergyState,
    pub least_share: f32,
    pub is_heeded: bool,
    /// Whether the input record holds the applied force.
    pub tells_applied: bool,
    pub tissue: Tissue,
    pub stiffness_n_m: f32,
    /// How far the tissue has moved by itself, m.
    pub moved_m: Vec3,
    /// The tissue makes a model every so many ticks, and it is that old when it arrives.
    pub cadence_ticks: u64,
    pub tick: u64,
    /// Force of the motors during the next tick, N.
    pub force: Vec3,
    /// What the servos said of the newest tick at which one computed, `SERVO_…` bits.
    pub flags: u32,
    models: Vec<ContactModel>,
}

impl Bench {
    pub fn new(hand: Hand, tissue: Tissue, stiffness_n_m: f32, cadence_ticks: u64) -> Self {
        let rest = Pose4 { insertion_m: 0.05, ..Pose4::default() };
        let into = Pose4 { pitch_rad: 0.02, yaw_rad: 0.08, insertion_m: 0.072, ..Pose4::default() };
        let hand_model = HandModel::default();
        Self {
            hand_model,
            hand: HandState::at_rest(&hand_model, &rest),
            script: HandScript::new(hand, rest, into),
            servo_params: ServoParams::default(),
            servos: [ServoState::default(); 2],
            hop_params: LastHopParams::default(),
            hop: LastHopState::default(),
            hardware: HardwareState::default(),
            energy: EnergyState::default(),
            least_share: 1.0,
            is_heeded: false,
            tells_applied: true,
            tissue,
            stiffness_n_m,
            moved_m: Vec3::ZERO,
            cadence_ticks,
            tick: 0,
            force: Vec3::ZERO,
            flags: 0,
            models: Vec::new(),
        }
    }

    /// The model that the servo sees at this tick and its age, ticks.
    pub fn model(&self) -> (ContactModel, u32) {
        let made = (self.tick - self.tick % self.cadence_ticks).saturating_sub(self.cadence_ticks);
        (self.models[made as usize], (self.tick - made) as u32)
    }

    /// One tick; the replicas in `alive` compute. Returns the motion of the tip, m, and what the last hop did.
    pub fn tick(&mut self, alive: [bool; 2]) -> (Vec3, AppliedKind) {
        let tip = Vec3::from_array(self.hand.tip_m);
        self.models.push(self.made(tip));
        let (model, model_age_ticks) = self.model();
        let input = ServoInput {
            tick: self.tick + 1,
            position_m: self.hand.tip_m,
            velocity_m_s: self.hand.velocity_m_s,
            dt_s: DT_S,
            model: &model,
            model_age_ticks,
            applied_n: self.tells_applied.then_some(self.hop.applied_n),
            medium_n: [0.0; 3],
        };
        let mut outputs = [None; 2];
        for replica in 0..2 {
            if alive[replica] {
                let (next, output) = servo_step(&self.servo_params, &self.servos[replica], &input);
                self.servos[replica] = next;
                valid_force(self.tick, self.tick, output.force_n, &ForceLimits::default()).expect("a valid force");
                self.flags = output.flags;
                outputs[replica] = Some(output.force_n);
            }
        }
        let choice = choose(self.hop.applied_n, outputs[0], outputs[1], 0);
        let (energy, share) = energy_step(&EnergyParams::default(), &self.energy, self.hand.tip_m, self.hop.applied_n, DT_S);
        (self.energy, self.least_share) = (energy, self.least_share.min(share));
        let share = if self.is_heeded { share } else { 1.0 };
        let wanted_n = choice.force_n.map(|force_n| force_n.map(|newton| newton * share));
        let (hop, applied, kind) = last_hop_step(&self.hop_params, &self.hop, wanted_n);
        self.hop = hop;
        let (hardware, force) = hardware_step(&HardwareParams::default(), &self.hardware, Some(applied));
        self.hardware = hardware;
        // The force of the tick before acts while this one is computed: a delay of one tick.
        let target = hand_pose(&self.script, self.tick as f64 * f64::from(DT_S)).pose;
        self.hand = hand_dynamics(&self.hand_model, &self.hand, &target, self.force.to_array(), DT_S);
        self.force = Vec3::from_array(force);
        self.tick += 1;
        (Vec3::from_array(self.hand.tip_m) - tip, kind)
    }

    /// A tick at which only the tissue computes: no device, so no input record.
    pub fn pass_tick(&mut self) {
        self.models.push(self.made(Vec3::from_array(self.hand.tip_m)));
        self.tick += 1;
    }

    /// The model of a tip position, where the tissue is now.
    fn made(&self, tip: Vec3) -> ContactModel {
        let mut model = (self.tissue)(tip, self.stiffness_n_m);
        for plane in &mut model.planes[..model.count as usize] {
            plane.point_m = (Vec3::from_array(plane.point_m) + self.moved_m).to_array();
        }
        model
    }

    /// `ticks` ticks with both replicas; returns the largest change of force per tick, N, and the largest force, N.
    pub fn run(&mut self, ticks: u64) -> (f32, f32) {
        let (mut step_n, mut most_n) = (0.0f32, 0.0f32);
        for _ in 0..ticks {
            let before = self.force;
            self.tick([true; 2]);
            step_n = step_n.max((self.force - before).length());
            most_n = most_n.max(self.force.length());
        }
        (step_n, most_n)
    }
}
