//! How soon hangs are found: the promise is three periods of the engine, and a cell may name the bound that its median is held to.

use super::judge::Figures;
use crate::fault::{Fault, finder};

/// Fewest hangs that say something of a median.
const LEAST: usize = 5;

impl Figures {
    /// Adds a fault, if it was found by its silence. What died is found by its end, whenever the system comes to that.
    pub(super) fn take_hang(&mut self, fault: &Fault) {
        if fault.detected_by == finder::HEARTBEAT {
            self.hang_ms.extend(fault.detected_us.map(|us| us * 1e-3));
        }
    }

    /// Holds the median to a bound, ms.
    pub(super) fn bound_hangs(mut self, most_ms: Option<f64>) -> Figures {
        let median_ms = self.hang_ms.get(self.hang_ms.len() / 2).copied().filter(|_| self.hang_ms.len() >= LEAST);
        if let Some((median_ms, most_ms)) = median_ms.zip(most_ms).filter(|(median_ms, most_ms)| median_ms > most_ms) {
            self.reasons.push(format!("half of the hangs were found after more than {median_ms:.1} ms, limit {most_ms}"));
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_those_that_were_found_by_their_silence_is_held_to_the_bound() {
        let judged = |found: &[(&str, f64)], most_ms| {
            let mut figures = Figures::default();
            for (by, ms) in found {
                figures.take_hang(&Fault { detected_by: (*by).into(), detected_us: Some(ms * 1e3), ..Fault::default() });
            }
            figures.bound_hangs(most_ms).reasons
        };
        let slow =
            [("heartbeat", 3.0), ("heartbeat", 3.5), ("pidfd", 90.0), ("heartbeat", 5.0), ("heartbeat", 6.0), ("heartbeat", 9.0)];
        assert_eq!(judged(&slow, Some(5.0)), Vec::<String>::new());
        assert_eq!(judged(&slow, Some(4.9)), ["half of the hangs were found after more than 5.0 ms, limit 4.9"]);
        assert_eq!(judged(&slow[..5], Some(1.0)), Vec::<String>::new(), "four say nothing");
        assert_eq!(judged(&slow, None), Vec::<String>::new());
    }
}
