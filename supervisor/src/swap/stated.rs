//! What an engine of each role may differ by before a swap to it is undone, as whoever judges it goes by it and as a person reads it.

use hyst_messages::{Role, kinds_of, tolerance};

/// What a servo's force may differ by from the other's for the same tick, N: what the hand feels of a step is 0.05 N.
pub const SERVO_FORCE_N: f32 = 0.05;
/// What the motors' force may differ by from that of the servo which the device says it follows, N, and as a share of it: a driver's motors may be off by
/// 10 % and 0.02 N.
pub(super) const MOTORS_FORCE_N: f64 = 0.05;
pub(super) const MOTORS_FORCE_SHARE: f64 = 0.15;
/// For how long there may be no new picture, ns: a busy machine keeps rendering off for seconds, and nobody agrees meanwhile.
pub(super) const STILL_NS: u64 = 8_000_000_000;
/// The same of a recorder, whose looks are not put off either: the device keeps 4.1 s for the one that takes its place again, and a good one that is rolled
/// back because it was not let run is swapped in again at no loss.
pub(super) const STILL_RECORDER_NS: u64 = 1_500_000_000;
/// Ticks that may not be on disk yet: about as many as the device keeps for a recorder.
pub(super) const MOST_BEHIND_TICKS: u64 = 4_096;
/// How old a console's figures may be, ticks: it asks the supervisor once in a second.
pub(super) const MOST_AGE_TICKS: f64 = 5_000.0;

/// The tolerance of a role, as a person reads it.
pub fn stated(role: Role) -> Vec<String> {
    let seconds = |ns: u64| ns as f64 * 1e-9;
    let line = match role {
        Role::Tissue | Role::Fluid => return kinds_of(role).iter().flat_map(|kind| tolerance::stated(*kind)).collect(),
        Role::Haptic => format!("each part of its force within {SERVO_FORCE_N} N of the other servo's for the same tick"),
        Role::CollisionWorker => "each hit true to the last bit, and none missing".into(),
        Role::Device => format!(
            "the motors' force within {MOTORS_FORCE_N} N and {} % of the followed servo's, but for its ramps and its slew limit",
            100.0 * MOTORS_FORCE_SHARE
        ),
        Role::Rendering => format!(
            "at least every {} s a new picture, of the newest state, of more than one colour, and another while the scope moves",
            seconds(STILL_NS)
        ),
        Role::Recorder => format!(
            "each tick as it was made, with what the one before wrote beside them; what the file held stays; it grows at least \
             every {} s, and at most {MOST_BEHIND_TICKS} ticks are not in it",
            seconds(STILL_RECORDER_NS)
        ),
        Role::Console => format!("the figures of its page at most {} s old", MOST_AGE_TICKS * 1e-3),
        Role::Hardware | Role::Supervisor | Role::Guardian => return Vec::new(),
    };
    vec![line]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_engine_has_its_tolerance_stated_with_its_numbers() {
        let said = |role: Role, words: &str| {
            let lines = stated(role);
            assert!(lines.iter().any(|line| line.contains(words)), "{}: {lines:?}", role.name());
        };
        said(Role::Tissue, "positions within 0.0005 m");
        said(Role::Fluid, "pressure within 1000 Pa");
        said(Role::Haptic, "within 0.05 N");
        said(Role::Device, "within 0.05 N and 15 %");
        said(Role::Rendering, "every 8 s");
        said(Role::Recorder, "every 1.5 s, and at most 4096 ticks");
        said(Role::Console, "at most 5 s old");
        said(Role::CollisionWorker, "to the last bit");
    }
}
