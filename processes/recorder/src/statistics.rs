//! What each process did in the last second, from the counters in its page.

use hyst_engine::Life;
use hyst_exchange::{ReadPage, StationPage};
use hyst_messages::page::header;
use hyst_messages::{LATENCY_BUCKETS, SLOTS, Slot, counted_since, percentile_ns};
use hyst_recording::ProcessSpell;
use std::collections::BTreeMap;

/// Ticks between two looks.
const INTERVAL_TICKS: u64 = 1_000;

/// The counters of a page.
#[derive(Clone, Copy)]
struct Counters {
    tick: u64,
    steps: u64,
    overruns: u64,
    wakeup: [u64; LATENCY_BUCKETS],
    looping: [u64; LATENCY_BUCKETS],
}

impl Counters {
    fn of(page: &ReadPage, tick: u64) -> Counters {
        let histogram = |at: usize| {
            let mut counts = [0; LATENCY_BUCKETS];
            page.load64s(at, &mut counts);
            counts
        };
        Counters {
            tick,
            steps: page.load64(header::STEPS),
            overruns: page.load64(header::OVERRUNS),
            wakeup: histogram(header::WAKEUP),
            looping: histogram(header::LOOP),
        }
    }

    /// What was done since.
    fn since(&self, before: &Counters, process: String, incarnation: u32) -> ProcessSpell {
        let us = |now: &[u64; LATENCY_BUCKETS], before: &[u64; LATENCY_BUCKETS], fraction: f64| {
            let ns = percentile_ns(&counted_since(now, before), fraction);
            if ns == 0 { f32::NAN } else { ns as f32 * 1e-3 }
        };
        ProcessSpell {
            tick: self.tick,
            process,
            incarnation,
            ticks: self.tick.saturating_sub(before.tick),
            steps: self.steps.saturating_sub(before.steps),
            overruns: self.overruns.saturating_sub(before.overruns),
            wakeup_p99_us: us(&self.wakeup, &before.wakeup, 0.99),
            loop_p50_us: us(&self.looping, &before.looping, 0.5),
            loop_p99_us: us(&self.looping, &before.looping, 0.99),
        }
    }
}

/// The pages, and what they had counted at the look before.
#[derive(Default)]
pub struct Statistics {
    next_tick: u64,
    seen: BTreeMap<usize, (ReadPage, Counters)>,
}

impl Statistics {
    /// What was done since the look before, if it is time; of an incarnation that is new, what it does from now on.
    pub fn take(&mut self, life: &Life) -> Vec<ProcessSpell> {
        let tick = life.tick();
        if tick < self.next_tick {
            return Vec::new();
        }
        self.next_tick = tick + INTERVAL_TICKS;
        (0..SLOTS).filter_map(Slot::from_number).filter_map(|slot| self.look(&life.clock, life, slot, tick)).collect()
    }

    fn look(&mut self, clock: &StationPage, life: &Life, slot: Slot, tick: u64) -> Option<ProcessSpell> {
        let incarnation = clock.incarnation(slot);
        if incarnation == 0 || clock.is_dead(slot) {
            self.seen.remove(&slot.number());
            return None;
        }
        if let Some((page, before)) = self.seen.get_mut(&slot.number())
            && page.incarnation() == incarnation
        {
            let now = Counters::of(page, tick);
            return Some(now.since(&std::mem::replace(before, now), slot.to_string(), incarnation));
        }
        let page = life.station.read_slot(slot, incarnation).ok()?; // supervisor and guardian have none
        let now = Counters::of(&page, tick);
        self.seen.insert(slot.number(), (page, now));
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::bucket_of_ns;

    #[test]
    fn a_spell_has_what_was_counted_in_it() {
        let mut before =
            Counters { tick: 1_000, steps: 500, overruns: 3, wakeup: [0; LATENCY_BUCKETS], looping: [0; LATENCY_BUCKETS] };
        before.looping[bucket_of_ns(9_000_000)] = 70;
        let mut now = Counters { tick: 2_000, steps: 1_499, overruns: 4, ..before };
        now.looping[bucket_of_ns(600_000)] = 999;
        let spell = now.since(&before, "tissue:0".into(), 7);
        assert_eq!((spell.tick, spell.ticks, spell.steps, spell.overruns, spell.incarnation), (2_000, 1_000, 999, 1, 7));
        assert!((550.0..680.0).contains(&spell.loop_p50_us) && spell.loop_p99_us < 680.0, "{spell:?}");
        assert!(spell.wakeup_p99_us.is_nan(), "it was not woken");
        // A page that was damaged meanwhile.
        let odd = before.since(&now, "tissue:0".into(), 7);
        assert_eq!((odd.ticks, odd.steps, odd.overruns), (0, 0, 0));
    }
}
