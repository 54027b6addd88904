//! What each slot did over the run, summed over its incarnations: steps, latencies, overruns, values refused, memory, processor time.
//! Kept in a file in the station's root, so that a supervisor that is restarted goes on from it.

use crate::growth::Growth;
use hyst_exchange::{ReadPage, Station, whole};
use hyst_messages::page::header;
use hyst_messages::{LATENCY_BUCKETS, Slot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Samples between two looks at the share of memory, which walks the process's page tables for some milliseconds.
const SHARE_EVERY: u64 = 8;

/// What is counted in a page's header.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Steps.
    pub steps: u64,
    /// Steps that ended after the next had to start.
    pub overruns: u64,
    /// Values refused as invalid, as stale or fenced, as frozen.
    pub refused: [u64; 3],
    /// Steps computed for another owner.
    pub substitutes: u64,
    /// Promotions.
    pub promotions: u64,
    /// Periods left to ordinary threads of the core.
    #[serde(default)]
    pub left: u64,
    /// Allocations on the real-time thread.
    pub allocations: u64,
    /// Small blocks that the real-time thread took from its own pool.
    #[serde(default)]
    pub pool_blocks: u64,
    /// Bytes written into streams, bytes copied beyond that.
    pub bytes: [u64; 2],
    /// Histogram of wake-up latencies.
    pub wakeup: Vec<u64>,
    /// Histogram of loop latencies.
    pub looping: Vec<u64>,
    /// Processor time, s.
    pub processor_s: f64,
    /// Time since it was ready, s.
    pub ready_s: f64,
    /// Steps since it was ready.
    pub ready_steps: u64,
}

impl Counters {
    fn read(page: &ReadPage) -> Counters {
        let mut wakeup = vec![0; LATENCY_BUCKETS];
        let mut looping = vec![0; LATENCY_BUCKETS];
        page.load64s(header::WAKEUP, &mut wakeup);
        page.load64s(header::LOOP, &mut looping);
        let word = |at| page.load64(at);
        Counters {
            steps: word(header::STEPS),
            overruns: word(header::OVERRUNS),
            refused: [word(header::INVALID), word(header::STALE), word(header::FROZEN)],
            substitutes: word(header::SUBSTITUTES),
            promotions: word(header::PROMOTIONS),
            left: word(header::LEFT),
            allocations: word(header::ALLOCATIONS),
            pool_blocks: word(header::POOL_BLOCKS),
            bytes: [word(header::STREAM_BYTES), word(header::COPIED_BYTES)],
            wakeup,
            looping,
            ..Counters::default()
        }
    }

    /// Whatever a page says whose bytes have flipped, which may be the largest number that there is.
    fn add(&mut self, other: &Counters) {
        let more = |sum: &mut u64, value: u64| *sum = sum.saturating_add(value);
        more(&mut self.steps, other.steps);
        more(&mut self.overruns, other.overruns);
        more(&mut self.substitutes, other.substitutes);
        more(&mut self.promotions, other.promotions);
        more(&mut self.left, other.left);
        more(&mut self.allocations, other.allocations);
        more(&mut self.pool_blocks, other.pool_blocks);
        more(&mut self.ready_steps, other.ready_steps);
        self.processor_s += other.processor_s;
        self.ready_s += other.ready_s;
        let pairs = self.refused.iter_mut().zip(other.refused).chain(self.bytes.iter_mut().zip(other.bytes));
        pairs.for_each(|(sum, value)| more(sum, value));
        for (sums, values) in [(&mut self.wakeup, &other.wakeup), (&mut self.looping, &other.looping)] {
            sums.resize(sums.len().max(values.len()), 0);
            sums.iter_mut().zip(values).for_each(|(sum, value)| more(sum, *value));
        }
    }
}

/// One slot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Account {
    /// Incarnations so far.
    pub incarnations: u32,
    /// Sum over the incarnations that are gone.
    past: Counters,
    /// The present incarnation.
    present: Counters,
    incarnation: u32,
    /// Time and steps at which it was ready.
    ready: Option<(u64, u64)>,
    /// Most resident memory, MiB.
    pub resident_mib: f64,
    /// Most memory with what is shared divided among its sharers, MiB.
    pub proportional_mib: f64,
    samples: u64,
    /// How often an incarnation was suspected to hang, and how often it was cleared of that.
    #[serde(default)]
    pub suspicions: [u64; 2],
    /// Most guilt of which an incarnation was cleared, ns.
    #[serde(default)]
    pub cleared_ns: u64,
}

impl Account {
    /// Sum over all incarnations.
    pub fn total(&self) -> Counters {
        let mut total = self.past.clone();
        total.add(&self.present);
        total
    }
    fn turn(&mut self, incarnation: u32) {
        if self.incarnation != incarnation {
            let present = std::mem::take(&mut self.present);
            self.past.add(&present);
            self.incarnation = incarnation;
            self.incarnations += 1;
            self.ready = None;
        }
    }
}

/// All slots by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Accounts {
    /// By the slot's name.
    pub slots: BTreeMap<String, Account>,
    /// Who grows.
    #[serde(default)]
    pub growth: Growth,
}

impl Accounts {
    fn path(station: &Station) -> PathBuf {
        station.root().join("accounts.json")
    }
    /// The accounts that a supervisor before this one kept, or none.
    pub fn read(station: &Station) -> Accounts {
        let text = std::fs::read_to_string(Accounts::path(station)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }
    /// Keeps the accounts.
    pub fn write(&self, station: &Station) {
        if let Ok(text) = serde_json::to_string(self) {
            let _ = whole::write(&Accounts::path(station), text.as_bytes()); // tried again in a second
        }
    }

    /// An incarnation of the slot has missed three periods.
    pub fn suspected(&mut self, slot: Slot) {
        self.slots.entry(slot.to_string()).or_default().suspicions[0] += 1;
    }
    /// It beats again.
    pub fn cleared(&mut self, slot: Slot, guilt_ns: u64) {
        let account = self.slots.entry(slot.to_string()).or_default();
        account.suspicions[1] += 1;
        account.cleared_ns = account.cleared_ns.max(guilt_ns);
    }

    /// Reads a slot's page; `process` while it lives.
    pub fn sample(&mut self, now_ns: u64, slot: Slot, incarnation: u32, page: &ReadPage, process: Option<u32>, ready: bool) {
        let account = self.slots.entry(slot.to_string()).or_default();
        account.turn(incarnation);
        let mut counters = Counters::read(page);
        counters.processor_s = process.and_then(crate::proc::processor_s).unwrap_or(account.present.processor_s);
        counters.ready_s = account.present.ready_s;
        counters.ready_steps = account.present.ready_steps;
        if ready {
            let (since_ns, steps) = *account.ready.get_or_insert((now_ns, counters.steps));
            // Up to its last heartbeat: one that has stopped or died makes no more steps.
            let beat_ns = page.load64(header::HEARTBEAT_NS).clamp(since_ns, now_ns.max(since_ns));
            counters.ready_s = beat_ns.saturating_sub(since_ns) as f64 * 1e-9;
            counters.ready_steps = counters.steps.saturating_sub(steps);
        }
        account.present = counters;
        if let Some(process) = process {
            account.resident_mib = account.resident_mib.max(crate::proc::resident_mib(process).unwrap_or(0.0));
            account.samples += 1;
            if account.samples % SHARE_EVERY == SHARE_EVERY / 2 {
                account.proportional_mib = account.proportional_mib.max(crate::proc::proportional_mib(process).unwrap_or(0.0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_the_dead_are_kept_and_added() {
        let mut account = Account::default();
        account.turn(5);
        account.present = Counters { steps: 10, refused: [1, 2, 3], wakeup: vec![1, 0], ..Default::default() };
        account.turn(5);
        account.turn(9);
        account.present = Counters { steps: 4, refused: [1, 0, 0], wakeup: vec![0, 7], ..Default::default() };
        let total = account.total();
        assert_eq!((total.steps, total.refused, total.wakeup, account.incarnations), (14, [2, 2, 3], vec![1, 7], 2));
    }

    /// The supervisor died of each look at a page whose counters were all bits, until the station ended.
    #[test]
    fn the_largest_numbers_that_a_damaged_page_can_have_are_added_too() {
        let most = Counters {
            steps: u64::MAX,
            left: u64::MAX,
            refused: [u64::MAX; 3],
            bytes: [u64::MAX; 2],
            wakeup: vec![u64::MAX; 2],
            ..Default::default()
        };
        let account = Account { past: most.clone(), present: most.clone(), ..Default::default() };
        let total = account.total();
        assert_eq!((total.steps, total.refused, total.bytes), (u64::MAX, [u64::MAX; 3], [u64::MAX; 2]));
        assert_eq!(total.wakeup, most.wakeup);
    }
}
