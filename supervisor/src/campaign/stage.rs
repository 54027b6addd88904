//! The stages of a swap, from its beginning to its end, and where among them a fault comes: after which stage, and how long after it.

use super::draw::Draw;
use hyst_messages::Role;
use serde::{Deserialize, Serialize};

/// How far a swap has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// It was asked for: the newcomer starts, in the old engine's place where there is no other.
    Asked,
    /// The newcomer is ready: in the shadow of the old engine, or on probation in its place.
    Ready,
    /// It agrees with the old engine, and may take the role; a servo is followed at once.
    Agreed,
    /// It has the role, on probation.
    Holds,
    /// Its probation is over: the first of the other places is given to the new engine.
    Proven,
    /// That place is settled, and the next one is given up.
    Settling,
    /// All places are settled: the guest gives the role back.
    Settled,
    /// The role has gone back: the guest leaves.
    Returned,
}

impl Stage {
    const ALL: [Stage; 8] = [
        Stage::Asked,
        Stage::Ready,
        Stage::Agreed,
        Stage::Holds,
        Stage::Proven,
        Stage::Settling,
        Stage::Settled,
        Stage::Returned,
    ];
}

/// A place in a swap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// The stage that it follows.
    pub stage: Stage,
    /// So many ticks after it came to that stage; at once where that is nearer than a fault can be asked for.
    pub offset_ticks: u64,
}

/// The longest time after a stage of a role's swap that is drawn, ticks: less than the stage takes at least, where it is a shadow (1 s) or a probation (2 s, of a
/// fluid 4 s and more), and about as long as it takes where it is a start. After a stage that passes within some ms a fault comes at once. `None` where
/// the role's swaps have no such stage.
fn most_ticks(role: Role, stage: Stage) -> Option<u64> {
    const START: u64 = 150;
    const RESTART: u64 = 100;
    const PASSING: u64 = 20;
    const SHADOW: u64 = 900;
    const PROBATION: u64 = 1_900;
    const LONG_PROBATION: u64 = 3_900;
    use Role::{CollisionWorker, Device, Fluid, Haptic, Tissue};
    Some(match (stage, role) {
        (Stage::Asked, Haptic | CollisionWorker | Device) => PASSING,
        (Stage::Asked, _) => START,
        (Stage::Ready, Tissue | Fluid | Haptic) => SHADOW,
        (Stage::Ready, CollisionWorker | Device) | (Stage::Agreed, Haptic) | (Stage::Holds, Tissue) => PROBATION,
        (Stage::Ready, _) | (Stage::Holds, Fluid) => LONG_PROBATION,
        (Stage::Proven | Stage::Settling, Tissue | Fluid) => RESTART,
        (Stage::Agreed | Stage::Settled | Stage::Returned, Tissue | Fluid) => PASSING,
        (Stage::Proven, Haptic | CollisionWorker) => PASSING,
        _ => return None,
    })
}

impl Place {
    /// Draws a place, each stage as often as any other. The process that the swap brings is there from when it is ready, and sure to be until all places are settled.
    pub fn draw(role: Role, is_of_newcomer: bool, draw: &mut Draw) -> Place {
        let is_there = |stage: Stage| !is_of_newcomer || (Stage::Ready..=Stage::Settling).contains(&stage);
        let stages = Stage::ALL.into_iter().filter(|stage| is_there(*stage));
        let stages: Vec<(Stage, u64)> = stages.filter_map(|stage| Some((stage, most_ticks(role, stage)?))).collect();
        let (stage, most_ticks) = stages[draw.between(0, stages.len() as u64 - 1) as usize];
        Place { stage, offset_ticks: draw.between(0, most_ticks) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(role: Role, is_of_newcomer: bool) -> Vec<Stage> {
        let mut draw = Draw::new(1);
        let mut found: Vec<Stage> = (0..400).map(|_| Place::draw(role, is_of_newcomer, &mut draw).stage).collect();
        found.sort_by_key(|stage| *stage as u8);
        found.dedup();
        found
    }

    /// Of 160 faults none had come after the probation, when only the first steps of a swap's record were drawn from.
    #[test]
    fn every_stage_to_the_end_of_a_swap_is_drawn_and_a_newcomer_is_hurt_while_it_is_there() {
        use Stage::{Agreed, Asked, Proven, Ready};
        assert_eq!([drawn(Role::Tissue, false), drawn(Role::Fluid, false)], [Stage::ALL; 2]);
        assert_eq!(drawn(Role::Fluid, true), Stage::ALL[1..6]);
        assert_eq!(drawn(Role::Haptic, false), [Asked, Ready, Agreed, Proven]);
        assert_eq!(drawn(Role::CollisionWorker, true), [Ready, Proven]);
        for role in [Role::Device, Role::Rendering, Role::Recorder, Role::Console] {
            assert_eq!([drawn(role, false), drawn(role, true)], [vec![Asked, Ready], vec![Ready]]);
        }
    }
}
