//! The ledger: what the hardware was told at each of its ticks, and whether the force was fresh: computed for the present station tick or
//! the one before. Entries wait for 64 ticks before they are written, so that a stall of the host that a canary reports late
//! still voids the ticks it covers.

use super::canary::Canaries;
use hyst_exchange::OwnedPage;
use hyst_messages::page::hardware::{LEDGER, TOTALS, Total};
use hyst_messages::{Applied, ForceCommand, LedgerEntry, TICK_NS, fnv_words};
use std::sync::Arc;

/// Ticks that an entry waits: longer than any stall seen (34 ms), so that the canaries have spoken.
const DELAY: usize = 64;

/// One tick as the firmware saw it.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// Tick of the hardware.
    pub hardware_tick: u64,
    /// Its time, ns.
    pub time_ns: u64,
    /// The station's tick at that time.
    pub station_tick: u64,
    /// The newest command.
    pub command: ForceCommand,
    /// No command has come since the last tick.
    pub silent: bool,
    /// Force of the motors, N.
    pub force_n: [f32; 3],
    /// The watchdog tripped in this tick.
    pub tripped: bool,
    /// The hardware's limit, N.
    pub max_force_n: f32,
}

/// The ledger's writer.
pub struct Ledger {
    page: Arc<OwnedPage>,
    canaries: Canaries,
    waiting: [LedgerEntry; DELAY],
    /// Entries ever put into `waiting`.
    count: usize,
    hash: u64,
    newest_force_tick: u64,
    last_force_n: [f32; 3],
}

/// Whether the force of a tick is fresh, held, on its way to zero, or none.
pub fn judge(judged: &Judged) -> Applied {
    let command = &judged.command;
    if command.tick == 0 {
        return Applied::Zero;
    }
    if command.kind == Applied::Fresh as u32 && command.force_tick + 1 >= judged.station_tick {
        return Applied::Fresh;
    }
    let zero = judged.force_n == [0.0; 3];
    match command.kind {
        kind if kind == Applied::Ramped as u32 && !zero => Applied::Ramped,
        kind if kind == Applied::Zero as u32 => Applied::Zero,
        _ if zero && judged.silent && judged.command.force_n != [0.0; 3] => Applied::Zero,
        _ => Applied::Held,
    }
}

impl Ledger {
    /// An empty ledger, to be written into the hardware's page.
    pub fn new(page: Arc<OwnedPage>, canaries: Canaries) -> Ledger {
        Ledger {
            page,
            canaries,
            waiting: [LedgerEntry::default(); DELAY],
            count: 0,
            hash: 0,
            newest_force_tick: 0,
            last_force_n: [0.0; 3],
        }
    }

    fn total(&self, total: Total, add: u64) {
        self.page.add64(TOTALS + total as usize, add);
    }

    /// Takes one tick; writes the one of [`DELAY`] ticks ago.
    pub fn write(&mut self, judged: &Judged) {
        let kind = judge(judged);
        let command = &judged.command;
        let length = judged.force_n.iter().map(|c| (*c as f64) * (*c as f64)).sum::<f64>().sqrt();
        // Written so that NaN counts as invalid.
        let valid = length <= judged.max_force_n as f64 * 1.001;
        self.total(Total::InvalidApplied, u64::from(!valid));
        if !judged.silent && command.kind == Applied::Fresh as u32 {
            self.total(Total::StaleApplied, u64::from(command.force_tick < self.newest_force_tick));
            self.newest_force_tick = self.newest_force_tick.max(command.force_tick);
        }
        self.total(Total::Trips, u64::from(judged.tripped));
        self.trace(judged);
        if self.count >= DELAY {
            self.commit(self.waiting[self.count % DELAY]);
        }
        self.waiting[self.count % DELAY] = LedgerEntry {
            hardware_tick: judged.hardware_tick,
            time_ns: judged.time_ns,
            station_tick: judged.station_tick,
            force_tick: command.force_tick,
            force_n: judged.force_n,
            kind: kind as u32,
            source_incarnation: command.source_incarnation,
            void: 0,
        };
        self.count += 1;
    }

    fn trace(&mut self, judged: &Judged) {
        let bits = judged.force_n.map(|c| c.to_bits() as u64);
        self.hash = fnv_words(self.hash, [bits[0] << 32 | bits[1], bits[2]]);
        self.page.store64(TOTALS + Total::TraceHash as usize, self.hash);
        let step = judged.force_n.iter().zip(self.last_force_n).map(|(a, b)| ((a - b) as f64).powi(2)).sum::<f64>().sqrt();
        self.last_force_n = judged.force_n;
        let place = TOTALS + Total::ForceStepMax as usize;
        if step > f64::from_bits(self.page.load64(place)) {
            self.page.store64(place, step.to_bits());
        }
    }

    fn commit(&self, mut entry: LedgerEntry) {
        // The force of a tick goes back to a pose of the tick before the last.
        let (from_ns, to_ns) = (entry.time_ns.saturating_sub(2 * TICK_NS), entry.time_ns + TICK_NS);
        entry.void = u32::from(self.canaries.stalled(from_ns, to_ns));
        self.total(Total::Ticks, 1);
        let total = match entry.kind {
            _ if entry.void != 0 => Total::Void,
            kind if kind == Applied::Fresh as u32 => Total::Fresh,
            kind if kind == Applied::Held as u32 => Total::Held,
            kind if kind == Applied::Ramped as u32 => Total::Ramped,
            _ => Total::Zero,
        };
        self.total(total, 1);
        self.page.push(LEDGER, entry.hardware_tick, &entry);
    }

    /// Writes what still waits, at the end.
    pub fn flush(&mut self) {
        let first = self.count.saturating_sub(DELAY);
        for at in first..self.count {
            self.commit(self.waiting[at % DELAY]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::canary::tests::canaries;
    use super::*;

    fn at(station_tick: u64, kind: Applied, force_tick: u64) -> Judged {
        let command = ForceCommand {
            tick: force_tick.max(1),
            force_tick,
            force_n: [1.0, 0.0, 0.0],
            kind: kind as u32,
            ..Default::default()
        };
        Judged {
            hardware_tick: 1,
            time_ns: 0,
            station_tick,
            command,
            silent: false,
            force_n: [1.0, 0.0, 0.0],
            tripped: false,
            max_force_n: 3.3,
        }
    }

    #[test]
    fn fresh_means_computed_for_this_tick_or_the_one_before() {
        assert_eq!(judge(&at(10, Applied::Fresh, 10)), Applied::Fresh);
        assert_eq!(judge(&at(10, Applied::Fresh, 9)), Applied::Fresh);
        assert_eq!(judge(&at(10, Applied::Fresh, 8)), Applied::Held);
        assert_eq!(judge(&at(10, Applied::Held, 10)), Applied::Held);
        assert_eq!(judge(&at(10, Applied::Ramped, 5)), Applied::Ramped);
        assert_eq!(judge(&Judged { command: ForceCommand::default(), ..at(10, Applied::Fresh, 10) }), Applied::Zero);
    }

    /// A ledger in a page of its own, with a canary that saw these stalls, ns.
    fn ledger(name: &str, seen: &[(u64, u64)]) -> Ledger {
        let path = format!("/dev/shm/hyst-test-{}-ledger-{name}", std::process::id());
        let page = hyst_exchange::page::create(path.as_ref(), hyst_messages::page::hardware::WORDS, 0, 1).unwrap();
        std::fs::remove_file(&path).unwrap(); // it stays mapped
        Ledger::new(Arc::new(page), canaries(&[seen]))
    }

    /// A tick that begins so many ms after 0, with the force for it, or with that of the tick before held.
    fn tick(ms: u64, is_fresh: bool) -> Judged {
        let kind = if is_fresh { Applied::Fresh } else { Applied::Held };
        Judged { hardware_tick: ms, time_ns: ms * TICK_NS, ..at(ms, kind, ms) }
    }

    #[test]
    fn a_tick_that_a_stall_meets_is_void_whether_its_force_was_fresh_or_not() {
        // It begins with the end of tick 9, and ends in the second tick before 12.
        let mut ledger = ledger("void", &[(10 * TICK_NS, 10 * TICK_NS + 300_000)]);
        for ms in 1..=20u64 {
            ledger.write(&tick(ms, ms.is_multiple_of(2)));
        }
        ledger.flush();
        let entries: Vec<LedgerEntry> = (1..=20).map(|key| ledger.page.ring(LEDGER, key).unwrap()).collect();
        let void: Vec<u64> = entries.iter().filter(|entry| entry.void != 0).map(|entry| entry.hardware_tick).collect();
        assert_eq!(void, [9, 10, 11, 12]);
        let total = |total: Total| ledger.page.load64(TOTALS + total as usize);
        assert_eq!([Total::Ticks, Total::Void, Total::Fresh, Total::Held].map(total), [20, 4, 8, 8]);
    }

    #[test]
    fn a_stall_that_a_canary_reports_late_still_voids_the_ticks_that_it_covered() {
        let mut ledger = ledger("late", &[]);
        let last = DELAY as u64;
        for ms in 1..=last {
            ledger.write(&tick(ms, true));
        }
        assert_eq!(ledger.page.load64(TOTALS + Total::Ticks as usize), 0, "each waits");
        ledger.canaries = canaries(&[&[(TICK_NS, last * TICK_NS)]]);
        ledger.write(&tick(last + 1, true));
        assert_eq!(ledger.page.ring(LEDGER, 1).map(|entry| (entry.hardware_tick, entry.void)), Some((1, 1)));
    }
}
