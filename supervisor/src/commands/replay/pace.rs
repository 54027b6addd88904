//! How fast a replay was shown, by the tick that its station has come to: whoever asked for more than the machine manages is told what it managed.

use super::look::own_page;
use hyst_engine::settings::Replay;
use hyst_exchange::{Station, system};
use hyst_messages::TICK_NS;
use hyst_messages::page::station as layout;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two looks, ns.
const LOOK_NS: u64 = 5_000_000;
/// Of less than so many ticks no speed is said.
const LEAST_TICKS: u64 = 500;
/// Below this share of what was asked for it was slower than that.
const LEAST_SHARE: f64 = 0.95;

/// A tick, and when the station had come to it, ns.
type Seen = (u64, u64);

/// What was seen of the ticks that are shown.
#[derive(Debug, Default)]
struct Pace {
    first: Option<Seen>,
    /// The newest but one: when the newest was come to is not known, for nothing may follow it.
    before: Seen,
    newest: Seen,
}

impl Pace {
    fn see(&mut self, tick: u64, now_ns: u64) {
        if tick != self.newest.0 {
            self.first.get_or_insert((tick, now_ns));
            (self.before, self.newest) = (self.newest, (tick, now_ns));
        }
    }

    /// How many times as fast as it was recorded.
    fn reached(&self) -> Option<f64> {
        let (first, last) = (self.first?, self.before);
        let (ticks, time_ns) = (last.0.saturating_sub(first.0), last.1.saturating_sub(first.1));
        (ticks >= LEAST_TICKS && time_ns > 0).then(|| (ticks * TICK_NS) as f64 / time_ns as f64)
    }

    /// What is said of it, if it was slower than it was asked to be.
    fn words(&self, asked: f64) -> Option<String> {
        let reached = self.reached().filter(|reached| *reached < LEAST_SHARE * asked)?;
        Some(format!("shown at {reached:.2} times the recorded speed, not at {asked}: this machine computes no faster"))
    }
}

/// Looks until the replay is over; gives what is to be said of its speed.
pub fn watch(station: &Station, replay: Replay, is_over: &AtomicBool) -> Option<String> {
    let (mut page, mut pace) = (None, Pace::default());
    while !is_over.load(Ordering::Relaxed) {
        let tick = own_page(station, &mut page).map_or(0, |page| page.load64(layout::ENDED_TICK));
        if tick > replay.from_tick {
            pace.see(tick, system::now_ns());
        }
        system::sleep_ns(LOOK_NS);
    }
    pace.words(replay.speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `--speed 20` was 1.1 on two cores, and nobody said so.
    #[test]
    fn a_replay_that_was_slower_than_it_was_asked_to_be_is_told_how_fast_it_was() {
        let shown = |looks: u64| {
            let mut pace = Pace::default();
            (0..looks).for_each(|look| pace.see(9_000 + 11 * look, 7 + 10_000_000 * look));
            pace.see(9_000 + 11 * looks, 7 + 10_000_000 * looks);
            pace.see(9_001 + 11 * looks, 5_000_000_000 * looks); // its end, seen late
            pace
        };
        let slow = shown(100);
        let words = slow.words(20.0).unwrap();
        assert!(words.starts_with("shown at 1.10 times the recorded speed, not at 20: "), "{words}");
        assert_eq!([1.1, 1.15, 0.5].map(|asked| slow.words(asked)), [None, None, None], "as fast as it was asked to be");
        assert!(slow.words(1.2).is_some());
        assert_eq!([shown(40).words(20.0), Pace::default().words(20.0)], [None, None], "too short to say");
    }
}
