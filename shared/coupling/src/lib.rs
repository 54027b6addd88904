//! The coupling between hand and tissue: everything that decides what force the hand feels, as pure functions.
//!
//! What it promises: a step reads a state and an input and returns the next state and an output. No clock, no file, no
//! randomness, no allocation, no panic on any input. The servo, the last hop, the choice and the watchdog use only
//! `+ − × ÷ √`, so the same input gives the same bits on every machine; the scripted hands use the platform's sine and
//! are the same bits on one machine (what they produce is recorded as input, so a replay does not depend on it).
//!
//! Conventions, everywhere in this crate:
//! - Frame: metres, right-handed, origin at the pivot in the cervix, +z along the cervical canal into the uterus, +y
//!   anterior, +x to the patient's right (right × anterior = cranial), which lies on the left of a picture with anterior up.
//! - A force is the force **on the hand** (and so on the scope), in newtons. Pressing along +z into a wall whose normal is
//!   −z gives a force along −z.
//! - One tick is 1 ms. Durations are counted in ticks where they are promises, in seconds where they are physics.
//! - States and parameters are `#[repr(C)]`, without hidden padding, and valid for any bit pattern (bytemuck `Pod`): they
//!   can be put into a shared page as they are, and a corrupt one is repaired, never trusted.
//!
//! The way of one tick, from hand to hand:
//! `hand_pose` or `hand_along` → `hand_dynamics` → (input record) → `servo_step` × 2 replicas → `valid_force`, `watch_step` → `choose` →
//! `energy_step` → `last_hop_step` → `hardware_step` → `hand_dynamics`.
//!
//! Sources: Zilles and Salisbury 1995 (god-object), Dahl 1968 (friction), Colgate and Schenkel 1997 (passivity of the sampled wall), Hannaford
//! and Ryu 2002 (passivity observer and controller), Moreau 1965 (the envelope that makes the way out unique).

pub mod choice;
pub mod contact;
pub mod energy;
pub mod hand;
pub mod hardware;
pub mod lasthop;
pub mod pose;
pub mod proxy;
pub mod script;
pub mod servo;
pub mod validity;
mod vector;

pub use choice::{Choice, choose};
pub use contact::{ContactModel, MAX_FRICTION, MAX_PLANES, Plane};
pub use energy::{EnergyParams, EnergyState, energy_step};
pub use hand::{HandModel, HandState, hand_dynamics};
pub use hardware::{HardwareParams, HardwareState, hardware_step};
pub use lasthop::{AppliedKind, LastHopParams, LastHopState, last_hop_step};
pub use pose::{DofLimits, Pose4, dof_from_pose, pose_from_dof};
pub use script::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, Hand, HandPose, HandScript, Leg, hand_along, hand_pose};
pub use servo::{SERVO_PASSIVITY, ServoInput, ServoOutput, ServoParams, ServoState, felt_of_medium_n, servo_step};
pub use validity::{
    ForceFault, ForceLimits, WatchInput, WatchParams, WatchState, WatchVerdict, input_digest, valid_force, watch_step,
};
