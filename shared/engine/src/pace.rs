//! The paced loop: absolute time, wake-up latency and loop latency apart, an overrun counted once. In lock-step the sequencer sets the pace, but for
//! rendering, which steps with nobody and, where somebody wants to see it, shows what there is.

use crate::life::Life;
use crate::lockstep::LockMember;
use hyst_exchange::{allocation, system};
use hyst_messages::page::header;
use hyst_messages::{Role, TICK_NS};

/// Wakes its thread once a period, at a phase within the period's first tick.
#[derive(Debug)]
pub struct Pace<'a> {
    life: &'a Life,
    period_ticks: u64,
    phase_ns: u64,
    backlog: u64,
    tick: u64,
    woken_ns: u64,
    allocations: u64,
    by: By<'a>,
}

/// What sets the pace.
#[derive(Debug)]
enum By<'a> {
    /// The station's clock.
    Clock,
    /// The sequencer of a virtual clock.
    Sequencer(LockMember<'a>),
    /// The wall's time: it steps with nobody on a virtual clock.
    Wall,
}

/// Whether anybody asked to see what a station does on a virtual clock: else pictures would take its time for nothing.
fn is_shown(life: &Life) -> bool {
    life.is_replay() || life.settings.pictures.is_some() || !life.settings.headless
}

impl<'a> Pace<'a> {
    /// A loop that begins with the next period.
    pub fn new(life: &'a Life, period_ticks: u64, phase_ns: u64) -> Pace<'a> {
        let tick = life.tick() / period_ticks * period_ticks;
        let by = match () {
            () if !life.is_lockstep() => By::Clock,
            () if life.slot.role() == Role::Rendering && is_shown(life) => By::Wall,
            () => By::Sequencer(LockMember::new(life)),
        };
        let allocations = allocation::of_this_thread();
        Pace { life, period_ticks, phase_ns, backlog: 0, tick, woken_ns: 0, allocations, by }
    }

    /// Lets the loop be so many periods late and make up for them, one at once after the other; it skips only what is later.
    pub fn with_backlog(self, periods: u64) -> Pace<'a> {
        Pace { backlog: periods, ..self }
    }

    /// Changes the phase from the next period on.
    pub fn set_phase(&mut self, phase_ns: u64) {
        self.phase_ns = phase_ns;
    }

    /// Changes the period.
    pub fn set_period(&mut self, period_ticks: u64) {
        self.period_ticks = period_ticks;
        self.tick = self.tick / period_ticks * period_ticks;
    }

    /// Sleeps until the next period and gives its tick; `None` when the station stops. Periods that have passed are skipped, and the
    /// overrun is counted once.
    pub fn wait(&mut self) -> Option<u64> {
        match &mut self.by {
            By::Sequencer(lock) => self.tick = lock.wait(|| Ok(())).ok().flatten()?,
            _ if self.life.clock.stop_requested() => return None,
            By::Clock => self.wait_for_clock(),
            By::Wall => {
                system::sleep_until_ns(self.woken_ns + self.period_ticks * TICK_NS);
                (self.woken_ns, self.tick) = (system::now_ns(), self.life.tick());
            }
        }
        Some(self.tick)
    }

    fn wait_for_clock(&mut self) {
        let (clock, page) = (&self.life.clock, &self.life.page);
        let mut next = self.tick + self.period_ticks;
        let now = system::now_ns();
        let due = clock.start_of(next) + self.phase_ns;
        if now >= due + (self.backlog + 1) * self.period_ticks * TICK_NS {
            page.add64(header::OVERRUNS, 1);
            next = clock.tick_at(now.saturating_sub(self.phase_ns)) / self.period_ticks * self.period_ticks;
        }
        let due = clock.start_of(next) + self.phase_ns;
        system::sleep_until_ns(due);
        self.woken_ns = system::now_ns();
        page.count_latency(header::WAKEUP, self.woken_ns.saturating_sub(due));
        self.tick = next;
    }

    /// When the present period's thread was woken, ns.
    pub fn woken_ns(&self) -> u64 {
        self.woken_ns
    }

    /// Ends the step: loop latency, heartbeat, tick, and what the thread has allocated.
    pub fn end(&mut self) {
        if let By::Sequencer(lock) = &mut self.by {
            lock.join(self.tick);
            return;
        }
        let page = &self.life.page;
        let now = system::now_ns();
        page.count_latency(header::LOOP, now.saturating_sub(self.woken_ns));
        page.store64(header::HEARTBEAT_NS, now);
        page.store64(header::TICK, self.tick);
        page.add64(header::STEPS, 1);
        page.store64(header::ALLOCATIONS, allocation::of_this_thread() - self.allocations);
        page.store64(header::POOL_BLOCKS, allocation::blocks_of_this_thread());
    }
}
