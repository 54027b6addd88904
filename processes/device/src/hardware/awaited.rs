//! Whom the sequencer waits for although it steps nobody there: what it has done may be so many ticks behind the virtual clock, and no more.

use hyst_engine::Life;
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::{header, recorder};
use hyst_messages::{Role, Slot};

/// Ticks that the recorder may be behind: half of what the device's ring keeps.
const RECORDER_LAG_TICKS: u64 = 2_000;
/// For how long one that gets no further is waited for, ns: a recorder's disk may be full to the end, and a machine may have nothing that draws.
const PATIENCE_NS: u64 = 10_000_000_000;

/// Somebody who is waited for.
#[derive(Debug)]
pub struct Awaited {
    role: Role,
    lag_ticks: u64,
    page: Option<ReadPage>,
    reached: Reached,
}

/// The newest tick of what is done, and when it was seen to move.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Reached {
    tick: u64,
    at_ns: u64,
}

impl Awaited {
    /// Those of a station's settings: the recorder, if it records, and rendering, if pictures go into a folder. Each of these is to be there, however
    /// long it takes to draw.
    pub fn of(life: &Life) -> Vec<Awaited> {
        let settings = &life.settings;
        let every_ticks = settings.picture_every_ticks().unwrap_or(1_000); // who draws refuses what is none
        let recorder = settings.record.as_ref().map(|_| (Role::Recorder, RECORDER_LAG_TICKS));
        let rendering = settings.pictures.as_ref().map(|_| (Role::Rendering, every_ticks));
        let awaited = |(role, lag_ticks)| Awaited { role, lag_ticks, page: None, reached: Reached::default() };
        recorder.into_iter().chain(rendering).map(awaited).collect()
    }

    /// Whether the clock has to wait before it goes beyond a tick: not for one who has stood still for as long as he is waited for.
    pub fn is_behind(&mut self, life: &Life, tick: u64) -> bool {
        if tick < self.reached.tick + self.lag_ticks {
            return false;
        }
        let slot = Slot::first(self.role);
        let incarnation = life.clock.incarnation(slot);
        if self.page.as_ref().is_none_or(|page| page.incarnation() != incarnation) {
            self.page = life.station.read_slot(slot, incarnation).ok();
        }
        let done_tick = self.page.as_ref().map_or(0, |page| done_tick(self.role, page));
        self.reached = self.reached.or(done_tick, system::now_ns());
        self.reached.holds_back(tick, self.lag_ticks, system::now_ns())
    }
}

/// Up to which tick somebody has done what he is waited for.
fn done_tick(role: Role, page: &ReadPage) -> u64 {
    match role {
        Role::Recorder => page.cell(recorder::STATUS).map_or(0, |(_, status)| status.last_tick),
        _ => page.load64(header::TICK),
    }
}

impl Reached {
    /// The newer of this and what is done by now.
    fn or(self, done_tick: u64, now_ns: u64) -> Reached {
        let is_first = self.at_ns == 0;
        if done_tick > self.tick || is_first { Reached { tick: done_tick.max(self.tick), at_ns: now_ns } } else { self }
    }

    fn holds_back(self, tick: u64, lag_ticks: u64, now_ns: u64) -> bool {
        tick >= self.tick + lag_ticks && now_ns.saturating_sub(self.at_ns) < PATIENCE_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_who_is_too_far_behind_is_waited_for_as_long_as_he_gets_on() {
        let mut reached = Reached::default().or(0, 1);
        assert!(!reached.holds_back(249, 250, 2) && reached.holds_back(250, 250, 2), "nothing is done yet");
        reached = reached.or(240, 400_000_000);
        assert!(!reached.holds_back(400, 250, 400_000_001) && reached.holds_back(490, 250, 400_000_001));
        let late_ns = 400_000_000 + PATIENCE_NS;
        reached = reached.or(240, late_ns);
        assert!(reached.holds_back(490, 250, late_ns - 1) && !reached.holds_back(490, 250, late_ns), "he stands still");
        assert!(reached.or(241, late_ns).holds_back(491, 250, late_ns), "he was slow");
        assert_eq!(reached.or(3, late_ns), reached, "a successor begins anew");
    }
}
