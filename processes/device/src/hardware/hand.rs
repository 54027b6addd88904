//! The hand that holds the simulated device: it follows a script, or the pointer in the window, and gives way to the force like a hand.

use hyst_coupling::{DofLimits, HandModel, HandScript, HandState, Pose4, hand_dynamics, hand_pose};
use hyst_engine::{Failure, Life};
use hyst_messages::{Controls, PointerRecord, Pose};
use hyst_scene::{LoadedHand, LoadedScene};

/// Time that the hand rests before a script begins, s: the station is warm by then.
const REST_S: f64 = 1.0;

enum Will {
    Idle,
    Pointer,
    Way(LoadedHand),
    Script(HandScript),
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
}

/// The hand at one tick.
pub struct Held {
    /// Where the scope is.
    pub pose: Pose,
    /// Velocity of its tip, m/s.
    pub velocity_m_s: [f32; 3],
    /// What the hand sets.
    pub controls: Controls,
}

fn pose4(pose: &hyst_scene::Pose) -> Pose4 {
    Pose4 { pitch_rad: pose.pitch_rad, yaw_rad: pose.yaw_rad, roll_rad: pose.roll_rad, insertion_m: pose.insertion_m }
}

fn will(scene: &LoadedScene, hand: &str) -> Result<Will, Failure> {
    let names = || scene.hands.iter().map(|hand| hand.name.as_str()).collect::<Vec<_>>().join(", ");
    match hand {
        "idle" | "script:idle" => Ok(Will::Idle),
        "mouse" => Ok(Will::Pointer),
        other => {
            let name = other
                .strip_prefix("script:")
                .ok_or_else(|| Failure::Input(format!("--hand {other}: use script:NAME, mouse or idle")))?;
            let found = scene.hand(name).ok_or_else(|| Failure::Input(format!("--hand {other}: this scene has {}", names())))?;
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
        let scene = hyst_scene::load_or_embedded(life.settings.scene.as_deref());
        let scene = scene.map_err(|error| Failure::Input(error.to_string()))?;
        life.admit_scene(scene.hash)?;
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
        let will = will(&scene, &life.settings.hand)?;
        let rest = match &will {
            Will::Way(hand) => pose4(hand.way.first().unwrap_or(&scene.rest)),
            Will::Script(script) => script.rest,
            Will::Idle | Will::Pointer => pose4(&scene.rest),
        };
        let controls = Controls {
            inflow_valve: 1.0,
            outflow_valve: 0.3,
            set_pressure_pa: scene.fluid.set_pressure_pa,
            light: 1.0,
            ..Controls::default()
        };
        Ok(Hand { will, rest, pointed: None, state: HandState::at_rest(&model, &rest), model, controls })
    }

    /// One tick of the hand, pushed by the force of the motors, N.
    pub fn step(&mut self, tick: u64, force_n: [f32; 3], pointer: Option<&PointerRecord>) -> Held {
        let time_s = (tick as f64 * 1e-3 - REST_S).max(0.0);
        let mut buttons = 0;
        let target = match &self.will {
            Will::Idle => self.rest,
            Will::Way(hand) => pose4(&hand.pose_at(time_s)),
            Will::Script(script) => {
                let wanted = hand_pose(script, time_s);
                buttons = wanted.buttons;
                wanted.pose
            }
            Will::Pointer => match pointer.filter(|pointer| pointer.sequence > 0) {
                Some(pointer) => {
                    self.controls = pointer.controls;
                    buttons = pointer.controls.buttons;
                    let [pitch_rad, yaw_rad, roll_rad, insertion_m] = pointer.target;
                    *self.pointed.insert(Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m })
                }
                None => self.pointed.unwrap_or(self.rest),
            },
        };
        self.state = hand_dynamics(&self.model, &self.state, &target, force_n, 1e-3);
        self.controls.buttons = buttons;
        let pose = &self.state.pose;
        Held {
            pose: Pose {
                position_m: self.state.tip_m,
                pitch_rad: pose.pitch_rad,
                orientation: self.state.orientation,
                yaw_rad: pose.yaw_rad,
                roll_rad: pose.roll_rad,
                insertion_m: pose.insertion_m,
                camera_roll_rad: 0.0,
            },
            velocity_m_s: self.state.velocity_m_s,
            controls: self.controls,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_and_the_hand_mean_the_same_by_pitch_yaw_roll_and_insertion() {
        let pose = hyst_scene::Pose { pitch_rad: 0.2, yaw_rad: -0.3, roll_rad: 0.7, insertion_m: 0.06 };
        let (tip_m, orientation) = hyst_coupling::pose_from_dof([0.0, 0.01, 0.0], &pose4(&pose));
        for (a, b) in tip_m.iter().zip(pose.tip_m([0.0, 0.01, 0.0])) {
            assert!((a - b).abs() < 1e-6, "{tip_m:?}");
        }
        let dot: f32 = orientation.iter().zip(pose.orientation()).map(|(a, b)| a * b).sum();
        assert!(dot.abs() > 0.999_99, "{orientation:?} {:?}", pose.orientation());
    }
}
