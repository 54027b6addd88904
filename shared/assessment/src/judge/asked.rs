//! Which goals a session asks for, and how many of them are reached.
//!
//! Two kinds wait for something that may never come. A `stop` is called for once something has called for it, and takes the place of the goals that are open. A
//! bleeding that is to be staunched may be prevented: where it has not begun 20 s after all others are reached, it is not waited for any more, and not called for.

use super::{GoalState, Judge};
use hyst_scene::Aim;

/// A bleeding is waited for so long after the other goals were reached, ticks: a wound bleeds at once, and needs a second for its first drops (assumption).
const SPARE_TICKS: u64 = 20_000;

impl Judge {
    /// Percent of the pathology that is removed; `None` without any, or as long as nothing is known.
    pub fn removed_percent(&self) -> Option<f64> {
        let of_ml = Some(self.brief.pathology_ml).filter(|ml| *ml > 0.0)?;
        Some((100.0 * self.removed_ml? / of_ml).clamp(0.0, 100.0))
    }

    /// Whether a goal was called for. To stop after something is nobody's goal who did not bring that about, and who did has no other one that is open; nor is to
    /// staunch a bleeding that was prevented.
    pub fn is_called_for(&self, index: usize) -> bool {
        let (Some(goal), Some(state)) = (self.brief.goals.get(index), self.goals.get(index)) else { return false };
        match goal.is {
            Aim::Stop { .. } => state.since_tick.is_some(),
            Aim::Staunch { .. } if self.is_spared(index) => false,
            _ => state.reached_tick.is_some() || !self.is_to_stop(),
        }
    }

    /// Whether a goal was called for and is not any more: something has called for a stop, which takes the place of those that are open.
    pub(crate) fn is_called_off(&self, index: usize) -> bool {
        let is_stop = self.brief.goals.get(index).is_none_or(|goal| matches!(goal.is, Aim::Stop { .. }));
        !is_stop && self.is_to_stop() && !self.is_called_for(index)
    }

    /// Whether a goal waits for a bleeding that has not begun.
    pub(crate) fn waits_for_blood(&self, index: usize) -> bool {
        let goal = self.brief.goals.get(index).zip(self.goals.get(index));
        goal.is_some_and(|(goal, state)| matches!(goal.is, Aim::Staunch { .. }) && is_waiting(&goal.is, state))
    }

    /// Whether the bleeding that a goal waits for has been waited for long enough.
    fn is_spared(&self, index: usize) -> bool {
        let others = self.brief.goals.iter().zip(&self.goals).filter(|(goal, state)| !is_waiting(&goal.is, state));
        // Of all others the last; none where one is open, or there is no other.
        let mut reached = others.map(|(_, state)| state.reached_tick);
        let last = reached.try_fold(None::<u64>, |last, tick| tick.map(|tick| last.max(Some(tick)))).flatten();
        self.waits_for_blood(index) && last.is_some_and(|tick| self.last_tick.saturating_sub(tick) >= SPARE_TICKS)
    }

    /// Whether something has called for a stop.
    pub(crate) fn is_to_stop(&self) -> bool {
        let mut goals = self.brief.goals.iter().zip(&self.goals);
        goals.any(|(goal, state)| matches!(goal.is, Aim::Stop { .. }) && state.since_tick.is_some())
    }

    /// How many goals of those that were called for are reached, and how many those are.
    pub(crate) fn tally(&self) -> (usize, usize) {
        let called_for = || self.goals.iter().enumerate().filter(|(index, _)| self.is_called_for(*index));
        (called_for().filter(|(_, goal)| goal.reached_tick.is_some()).count(), called_for().count())
    }

    /// Percent of what the goals that were called for ask for which is done, each by its weight; `None` if none was. Of one that is open counts what is removed
    /// of what it wants removed, and nothing of any other.
    pub fn done_percent(&self) -> Option<f64> {
        let goals = self.brief.goals.iter().zip(&self.goals).enumerate().filter(|(index, _)| self.is_called_for(*index));
        let (mut done, mut of) = (0.0, 0.0);
        for (_, (goal, state)) in goals {
            let counts = match goal.is {
                _ if state.reached_tick.is_some() => 1.0,
                Aim::Removed(_) => state.progress,
                _ => 0.0,
            };
            let weight = goal.weight.max(0.0);
            (done, of) = (done + weight * counts, of + weight);
        }
        (of > 0.0).then(|| 100.0 * done / of)
    }

    /// Whether the session was broken off: nothing of the case has ended it, and a goal is open.
    pub fn is_broken_off(&self) -> bool {
        let (reached, of) = self.tally();
        self.ended.is_none() && reached < of
    }

    /// Percent of the landmarks that the case names which were looked at; `None` without any.
    pub fn landmarks_percent(&self) -> Option<f64> {
        let counts = self.brief.goals.iter().zip(&self.goals).filter_map(|(goal, state)| match &goal.is {
            Aim::Look { landmarks, .. } => Some((state.places, landmarks.len())),
            _ => None,
        });
        let (seen, all) = counts.fold((0, 0), |(seen, all), (more, of)| (more.min(of) + seen, all + of));
        Some(all).filter(|all| *all > 0).map(|all| 100.0 * seen as f64 / all as f64)
    }
}

/// Whether a goal waits for something that has not come.
fn is_waiting(aim: &Aim, state: &GoalState) -> bool {
    match aim {
        Aim::Stop { .. } => state.since_tick.is_none(),
        Aim::Staunch { .. } => state.bled_tick.is_none() && state.reached_tick.is_none(),
        _ => false,
    }
}
