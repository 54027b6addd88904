//! The hand that holds the simulated device: it follows a script, the pointer in the window or a pad, and gives way to the force like a hand; or it does
//! what the hand of a recording did, whatever it feels. What a pad has no button for is set by the window's keys.

mod changes;

use super::pad::{Make, Pad};
use super::score::Score;
use changes::Changes;
use hyst_coupling::{DofLimits, HandModel, HandScript, HandState, Leg, Pose4, hand_along, hand_dynamics, hand_pose};
use hyst_engine::{Failure, Life};
use hyst_messages::controls::{FOCUS_M, WINDOW_ALL, WINDOW_HEAD, WINDOW_HEAD_FREE};
use hyst_messages::{
    BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, BUTTONS_CURRENT, Controls, FluidStatus, HardwareSample, PointerRecord,
    Pose, StepRecord,
};
use hyst_recording::Moment;
use hyst_scene::{HandLeg, LoadedHand, LoadedRigid, LoadedScene, PumpChange};
use std::path::Path;

/// Time that the hand rests before a script begins, s: the station is warm by then.
const REST_S: f64 = 1.0;
/// Time of a tick, s.
const TICK_S: f32 = 1e-3;
/// Speed of the loop electrode, m/s: a thumb pushes the working element of a resectoscope to its end in less than half a second.
const LOOP_SPEED_M_S: f32 = 0.030;
/// Speed of the camera head at most, rad/s: the other hand turns it.
const HEAD_SPEED_RAD_S: f32 = 3.0;
// The scripts' bits go into the records as they are.
const _: () = assert!(hyst_coupling::BUTTON_ENERGIZED == BUTTON_ENERGIZED && hyst_coupling::BUTTON_EXTENDED == BUTTON_EXTENDED);
const _: () = assert!(hyst_coupling::BUTTON_COAGULATING == BUTTON_COAGULATING);

enum Will {
    Idle,
    Pointer,
    Pad(Pad),
    Way(LoadedHand),
    Legs(Vec<Leg>),
    Script(HandScript),
    Score(Score),
}

/// The hand.
pub struct Hand {
    will: Will,
    rest: Pose4,
    /// Where the pointer last wanted the scope; while the window restarts, the hand stays there.
    pointed: Option<Pose4>,
    model: HandModel,
    state: HandState,
    controls: Controls,
    /// What the script still has to set of them; of who follows no script nothing.
    changes: Changes,
    /// When the script is through, s; one that begins anew never is.
    end_s: f64,
    /// How far the outflow valve is open while the hand rinses; `None` where the scene's script has the valve.
    rinsing_valve: Option<f32>,
    /// How far the loop electrode goes out or the jaws open, and how far it is or they are, m.
    loop_reach_m: f32,
    loop_extension_m: f32,
    /// Whether there is a loop that current can be in.
    has_loop: bool,
    /// How far the camera head is turned on the scope, rad. The other hand holds it where the horizon is wanted, however the scope turns in it.
    head_rad: f32,
    /// The horizon that is wanted: how far the head is turned in all, rad; of a head that is free how far it is on the scope.
    horizon_rad: f32,
    /// The head goes along with the scope until it is turned on it. A script's horizon is kept for it.
    is_head_free: bool,
    /// In a replay: the tick that [`Hand::again`] was asked for last is what it does.
    is_again: bool,
}

/// The hand at one tick.
pub struct Held {
    /// Where the scope is.
    pub pose: Pose,
    /// Velocity of its tip, m/s.
    pub velocity_m_s: [f32; 3],
    /// What the hand sets.
    pub controls: Controls,
    /// What of it comes from the window: [`HardwareSample::from_window`].
    pub from_window: u32,
    /// In a replay: the force that the motors made then, N.
    pub felt_n: Option<[f32; 3]>,
}

fn pose4(pose: &hyst_scene::Pose) -> Pose4 {
    Pose4 { pitch_rad: pose.pitch_rad, yaw_rad: pose.yaw_rad, roll_rad: pose.roll_rad, insertion_m: pose.insertion_m }
}

fn leg(leg: &HandLeg) -> Leg {
    let button = |is_pressed: bool, bit: u32| if is_pressed { bit } else { 0 };
    let current = button(leg.is_energized, BUTTON_ENERGIZED) | button(leg.is_coagulating, BUTTON_COAGULATING);
    let buttons = current | button(leg.is_extended, BUTTON_EXTENDED);
    Leg { to: pose4(&leg.to), time_s: leg.time_s, buttons, is_rinsing: leg.is_rinsing }
}

/// The script's time at a tick, s.
fn script_s(tick: u64) -> f64 {
    (tick as f64 * 1e-3 - REST_S).max(0.0)
}

fn will(scene: &LoadedScene, hand: &str, begin_tick: u64) -> Result<Will, Failure> {
    let names = || scene.hands.iter().map(|hand| hand.name.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(file) = hand.strip_prefix("replay:") {
        return Ok(Will::Score(Score::open(Path::new(file), begin_tick)?));
    }
    let (word, place) = hand.split_once(':').map_or((hand, None), |(word, place)| (word, Some(place)));
    if let Some(make) = Make::from_name(word) {
        return Pad::open(make, place).map(Will::Pad);
    }
    match hand {
        "idle" | "script:idle" => Ok(Will::Idle),
        "mouse" => Ok(Will::Pointer),
        other => {
            let name = other.strip_prefix("script:").ok_or_else(|| {
                Failure::Input(format!("--hand {other}: use script:NAME, replay:FILE, mouse, gamepad, spacemouse or idle"))
            })?;
            let found = scene.hand(name).ok_or_else(|| Failure::Input(format!("--hand {other}: this scene has {}", names())))?;
            if !found.legs.is_empty() {
                return Ok(Will::Legs(found.legs.iter().map(leg).collect()));
            }
            match (name, hyst_coupling::Hand::by_name(name), found.way.first(), found.way.last()) {
                ("polyp", Some(script), Some(from), Some(into)) => {
                    Ok(Will::Script(HandScript::new(script, pose4(from), pose4(into))))
                }
                _ => Ok(Will::Way(found.clone())),
            }
        }
    }
}

impl Hand {
    /// The hand that the settings ask for, in the settings' scene.
    pub fn of(life: &Life) -> Result<Hand, Failure> {
        let scene = hyst_scene::load_or_embedded(life.scene().as_deref());
        let scene = scene.map_err(|error| Failure::Input(error.to_string()))?;
        life.admit_scene(scene.hash)?;
        let mut hand = Hand::in_scene(&scene, &life.settings.hand, life.settings.replay.map_or(0, |replay| replay.begin_tick))?;
        if let Will::Score(score) = &mut hand.will {
            score.waits = life.is_lockstep();
        }
        hand.is_again = life.is_replay();
        hand.controls.focus_m = life.settings.focus_m()?;
        Ok(hand)
    }

    /// A hand by its name, as the settings give it, in a scene; that of a recording goes on after a tick of it.
    fn in_scene(scene: &LoadedScene, name: &str, begin_tick: u64) -> Result<Hand, Failure> {
        let space = &scene.workspace;
        let tilt_rad = space.pitch_rad.iter().chain(&space.yaw_rad).fold(0.0f32, |most, angle| most.max(angle.abs()));
        let model = HandModel {
            pivot_m: space.pivot_m,
            limits: DofLimits {
                tilt_rad,
                roll_rad: space.roll_rad[1].abs().max(space.roll_rad[0].abs()),
                min_insertion_m: space.insertion_m[0].max(0.001),
                max_insertion_m: space.insertion_m[1],
            },
            ..HandModel::default()
        };
        let will = will(scene, name, begin_tick)?;
        let rest = match &will {
            Will::Way(hand) => pose4(hand.way.first().unwrap_or(&scene.rest)),
            Will::Legs(legs) => legs.last().map_or(pose4(&scene.rest), |leg| leg.to),
            Will::Script(script) => script.rest,
            Will::Idle | Will::Pointer | Will::Pad(_) | Will::Score(_) => pose4(&scene.rest),
        };
        let controls = Controls {
            inflow_valve: 1.0,
            outflow_valve: 0.3,
            set_pressure_pa: scene.fluid.set_pressure_pa,
            light: 1.0,
            focus_m: FOCUS_M,
            ..Controls::default()
        };
        let script = name.strip_prefix("script:").and_then(|name| scene.hand(name));
        let own = script.map(|hand| &hand.changes).filter(|changes| !changes.is_empty());
        let changes: &[PumpChange] = own.unwrap_or(&scene.fluid.changes);
        let is_somebodys = matches!(will, Will::Pointer | Will::Pad(_));
        let follows_script = !is_somebodys && !matches!(will, Will::Score(_));
        let instrument = scene.rigid.first();
        Ok(Hand {
            will,
            rest,
            pointed: None,
            state: HandState::at_rest(&model, &rest),
            model,
            controls,
            changes: Changes::of(if follows_script { changes } else { &[] }),
            end_s: script.filter(|hand| hand.is_once).map_or(f64::INFINITY, |hand| hand.period_s),
            rinsing_valve: changes.iter().all(|change| change.outflow_valve.is_none()).then_some(1.0),
            loop_reach_m: instrument.map_or(0.0, LoadedRigid::element_m),
            loop_extension_m: 0.0,
            has_loop: instrument.is_some_and(|rigid| rigid.electrode.is_some()),
            head_rad: -rest.roll_rad,
            horizon_rad: 0.0,
            is_head_free: scene.is_head_free && is_somebodys,
            is_again: false,
        })
    }

    /// How far the scope can be moved.
    pub fn limits(&self) -> DofLimits {
        self.model.limits
    }

    /// What the operator is to be told of what holds the scope; nothing while all is well.
    pub fn complaint(&self) -> &'static str {
        match &self.will {
            Will::Pad(pad) => pad.complaint(),
            _ => "",
        }
    }

    /// In a replay: what was recorded of a tick, which the hand then does, and the tissue's steps that come before it. Asked for ascending ticks.
    pub fn again(&mut self, tick: u64) -> (Moment, Vec<StepRecord>) {
        match &mut self.will {
            Will::Score(score) => score.at(tick),
            _ => Default::default(),
        }
    }

    /// Whether the script waits for what the pump says: then it is to be told that, before each step.
    pub fn is_waiting(&self) -> bool {
        self.changes.is_waiting()
    }

    /// Takes what the pump says at a tick.
    pub fn see(&mut self, tick: u64, status: &FluidStatus) {
        self.changes.see(script_s(tick), status);
    }

    /// Sets what the script has come to.
    fn change(&mut self, time_s: f64) {
        while let Some(change) = self.changes.due(time_s) {
            let or = |value: Option<f64>, before: f32| value.map_or(before, |value| value as f32);
            self.controls = Controls {
                set_pressure_pa: or(change.set_pressure_pa, self.controls.set_pressure_pa),
                inflow_valve: or(change.inflow_valve, self.controls.inflow_valve),
                outflow_valve: or(change.outflow_valve, self.controls.outflow_valve),
                ..self.controls
            };
        }
    }

    /// What the window gives: everything, what a pad has nothing for, or nothing.
    fn given(&self) -> u32 {
        let given = match &self.will {
            Will::Pointer => WINDOW_ALL,
            Will::Pad(pad) => pad.lacks,
            _ => 0,
        };
        if self.is_head_free && given & WINDOW_HEAD != 0 { given | WINDOW_HEAD_FREE } else { given }
    }

    /// Sets what the pad has nothing for as the window's keys say; until there is a window it stays as it is.
    fn heed(&mut self, pointer: Option<&PointerRecord>) {
        let Some(pointer) = pointer.filter(|pointer| pointer.sequence > 0) else { return };
        let Will::Pad(pad) = &self.will else { return };
        let lacks = pad.lacks;
        self.controls.take(&pointer.controls, lacks);
        let [.., horizon_rad] = pointer.target;
        if lacks & WINDOW_HEAD != 0 && horizon_rad.is_finite() {
            self.horizon_rad = horizon_rad;
        }
    }

    /// The other hand keeps the horizon where it is wanted, or only turns the head on the scope.
    fn turn_head(&mut self) {
        let kept_rad = if self.is_head_free { 0.0 } else { self.state.pose.roll_rad };
        let head_rad = self.horizon_rad - kept_rad;
        if head_rad.is_finite() {
            let most_rad = HEAD_SPEED_RAD_S * TICK_S;
            self.head_rad += (head_rad - self.head_rad).clamp(-most_rad, most_rad);
        }
    }

    /// One tick of the hand, pushed by the force of the motors, N.
    pub fn step(&mut self, tick: u64, force_n: [f32; 3], pointer: Option<&PointerRecord>) -> Held {
        let time_s = script_s(tick);
        let (mut buttons, mut rinsing_valve) = (0, None);
        self.change(time_s);
        self.heed(pointer);
        let target = match &mut self.will {
            Will::Score(score) => {
                // Before its script begins the hand is where it will begin.
                let sample = if self.is_again || time_s == 0.0 { score.sample() } else { score.next_sample() };
                let HardwareSample { pose, velocity_m_s, controls, force_n, .. } = sample;
                return Held { pose, velocity_m_s, controls, from_window: 0, felt_n: self.is_again.then_some(force_n) };
            }
            Will::Idle => self.rest,
            _ if time_s >= self.end_s => self.rest,
            Will::Way(hand) => pose4(&hand.pose_at(time_s)),
            Will::Legs(legs) => {
                let wanted = hand_along(legs, time_s);
                buttons = wanted.buttons;
                rinsing_valve = self.rinsing_valve.filter(|_| wanted.is_rinsing);
                wanted.pose
            }
            Will::Script(script) => {
                let wanted = hand_pose(script, time_s);
                buttons = wanted.buttons;
                wanted.pose
            }
            Will::Pad(pad) => {
                self.horizon_rad += pad.head_rad_s() * TICK_S;
                let (pose, pressed) = pad.step(&self.state.pose, &mut self.controls, TICK_S);
                buttons = pressed;
                pose
            }
            Will::Pointer => match pointer.filter(|pointer| pointer.sequence > 0) {
                Some(pointer) => {
                    self.controls = pointer.controls;
                    buttons = pointer.controls.buttons;
                    let [pitch_rad, yaw_rad, roll_rad, insertion_m, horizon_rad] = pointer.target;
                    self.horizon_rad = horizon_rad;
                    *self.pointed.insert(Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m })
                }
                None => self.pointed.unwrap_or(self.rest),
            },
        };
        self.state = hand_dynamics(&self.model, &self.state, &target, force_n, TICK_S);
        let out_m = if buttons & BUTTON_EXTENDED != 0 { self.loop_reach_m } else { 0.0 };
        let most_m = LOOP_SPEED_M_S * TICK_S;
        self.loop_extension_m += (out_m - self.loop_extension_m).clamp(-most_m, most_m);
        self.turn_head();
        let buttons = if self.has_loop { buttons } else { buttons & !BUTTONS_CURRENT };
        self.controls = Controls { buttons, loop_extension_m: self.loop_extension_m, ..self.controls };
        let pose = &self.state.pose;
        Held {
            pose: Pose {
                position_m: self.state.tip_m,
                pitch_rad: pose.pitch_rad,
                orientation: self.state.orientation,
                yaw_rad: pose.yaw_rad,
                roll_rad: pose.roll_rad,
                insertion_m: pose.insertion_m,
                camera_roll_rad: self.head_rad,
            },
            velocity_m_s: self.state.velocity_m_s,
            controls: Controls { outflow_valve: rinsing_valve.unwrap_or(self.controls.outflow_valve), ..self.controls },
            from_window: self.given(),
            felt_n: None,
        }
    }
}

#[cfg(test)]
mod tests;
