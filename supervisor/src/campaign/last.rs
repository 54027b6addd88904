//! The last forces of a recording: what the hand was given before a station came to its end.

use crate::fault::WINDOW_TICKS;
use hyst_messages::AppliedRecord;
use std::collections::VecDeque;

/// The forces of the last ticks, as they were handed to the hardware.
#[derive(Debug, Default)]
pub(super) struct LastForces {
    /// Tick and N, ascending: at most a window of them, and the one before.
    ticks: VecDeque<(u64, [f32; 3])>,
}

impl LastForces {
    /// Takes a record; those of a recording come in the order of their ticks.
    pub(super) fn follow(&mut self, applied: &AppliedRecord) {
        if self.ticks.len() > WINDOW_TICKS as usize {
            self.ticks.pop_front();
        }
        self.ticks.push_back((applied.tick, applied.command.force_n));
    }

    /// Largest step from one tick to the next, N; `None` if no two ticks follow each other. One that is not finite is a step beyond every limit.
    pub(super) fn step_max_n(&self) -> Option<f64> {
        let pairs = self
            .ticks
            .iter()
            .zip(self.ticks.iter().skip(1))
            .filter(|((before, _), (tick, _))| before.checked_add(1) == Some(*tick));
        let steps = pairs.map(|((_, from), (_, to))| {
            let squares = from.iter().zip(to).map(|(from, to)| f64::from(to - from).powi(2)).sum::<f64>();
            if squares.is_finite() { squares.sqrt() } else { f64::MAX }
        });
        steps.reduce(f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step_n(forces_n: &[(u64, f32)]) -> Option<f64> {
        let mut last = LastForces::default();
        for (tick, x_n) in forces_n {
            let mut applied = AppliedRecord { tick: *tick, ..AppliedRecord::default() };
            applied.command.force_n = [*x_n, 0.0, 0.0];
            last.follow(&applied);
        }
        last.step_max_n()
    }

    #[test]
    fn the_last_steps_are_those_of_a_window_and_not_over_a_gap() {
        assert_eq!(step_n(&[(7, 1.0)]), None);
        assert_eq!(step_n(&[(7, 1.0), (8, 1.5), (9, 1.25)]), Some(0.5));
        assert_eq!(step_n(&[(7, 1.0), (9, 3.0), (10, 2.75)]), Some(0.25), "tick 8 is not there");
        assert_eq!(step_n(&[(7, 1.0), (8, f32::NAN)]), Some(f64::MAX));
        let long: Vec<(u64, f32)> = (0..1_000).map(|tick| (tick, if tick < 500 { 3.0 } else { 0.0 })).collect();
        assert_eq!((step_n(&long), step_n(&long[..700])), (Some(0.0), Some(3.0)), "500 ticks before the end, and 200");
    }
}
