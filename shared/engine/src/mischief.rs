//! Engines that do wrong on request, so that a whole station can be tried against each promise. Nothing here acts outside of test mode, and
//! there it costs two loads in a step. And the word of distrust, with which one who reads another's output says that it is wrong.

mod lies;
mod start;
mod waste;

pub use lies::{Liar, Lies, Output};
pub(crate) use waste::attend;

use crate::life::Life;
use hyst_exchange::stall::stall;
use hyst_exchange::{OwnedPage, StationError, StationPage, system};
use hyst_messages::mischief::{Mischief, Request, Thread};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{header, station as layout};
use hyst_messages::{RefusedState, Slot, StreamHeader, TICK_NS};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The mark of a flawed state, in the second word of its header, which no role with a state uses.
pub const FLAWED: u32 = 0x666c_6177;
/// An entry that was not repeated for so long begins anew, ns.
const SERIES_NS: u64 = 50_000_000;

/// The words of a slot, as a request that holds now.
fn asked(
    clock: &StationPage,
    slot: Slot,
    read: impl FnOnce([u64; layout::MISCHIEF_WORDS]) -> Option<Request>,
) -> Option<Request> {
    let page = clock.page();
    if page.load32(layout::TEST_MODE) == 0 {
        return None;
    }
    let at = slot.number();
    let what = page.load64(layout::MISCHIEF + at);
    if what == 0 {
        return None;
    }
    let words = [what, page.load64(layout::MISCHIEF_UNTIL_NS + at), page.load64(layout::MISCHIEF_EXTENT + at)];
    read(words).filter(|request| request.until_ns == 0 || system::now_ns() < request.until_ns)
}

fn loses_a_loan(clock: &StationPage, page: &OwnedPage, slot: Slot, incarnation: u32) -> bool {
    let request = asked(clock, slot, |words| Request::from_words(words, incarnation));
    let asked = request.is_some_and(|request| request.what == Mischief::LeakLoans);
    if asked {
        page.fetch_add64(header::MISCHIEF, 1);
    }
    asked
}

impl Life {
    /// What this process is asked to do wrong now.
    pub fn mischief(&self) -> Option<Request> {
        asked(&self.clock, self.slot, |words| Request::from_words(words, self.incarnation))
    }

    /// Whether the next loan of this process's stream is to be lost; to be asked once in a step.
    pub fn loses_a_loan(&self) -> bool {
        loses_a_loan(&self.clock, &self.page, self.slot, self.incarnation)
    }

    /// The same for another thread of this process.
    pub fn loan_loser(&self) -> Result<impl Fn() -> bool + Send + 'static, StationError> {
        let (clock, page, slot, incarnation) = (self.station.open()?, Arc::clone(&self.page), self.slot, self.incarnation);
        Ok(move || loses_a_loan(&clock, &page, slot, incarnation))
    }

    /// What a thread beside the steps calls in each of its rounds: it waits there while it is asked to, and until it is to stop at most.
    pub fn staller(&self, thread: Thread) -> Result<impl Fn(&AtomicBool) + Send + 'static, StationError> {
        let (clock, page, slot, incarnation) = (self.station.open()?, Arc::clone(&self.page), self.slot, self.incarnation);
        Ok(move |stop: &AtomicBool| {
            stall(&clock, slot, incarnation, thread, stop, || {
                page.fetch_add64(header::MISCHIEF, 1);
            });
        })
    }

    /// What the role of this process suffers from, whoever of it was asked.
    fn curses(&self) -> impl Iterator<Item = Request> + '_ {
        let (page, role) = (self.clock.page(), self.slot.role());
        let asked = page.load32(layout::TEST_MODE) != 0;
        let of_slot = move |slot: Slot| {
            let at = slot.number();
            let words = [page.load64(layout::MISCHIEF + at), page.load64(layout::MISCHIEF_UNTIL_NS + at), 0];
            Request::lasting(words).filter(|request| request.until_ns == 0 || system::now_ns() < request.until_ns)
        };
        (0..role.slots().1).filter(move |_| asked).filter_map(move |index| Slot::new(role, index)).filter_map(of_slot)
    }

    /// Whether this process makes flawed states.
    fn is_poisoner(&self) -> bool {
        self.curses().any(|curse| curse.what == Mischief::Poison && curse.incarnation == self.incarnation)
    }

    /// Before a holder's step from a state: dies if it is one to die of.
    pub fn succumb(&self, state: &StreamHeader) {
        self.perish();
        let flawed = state.words[1] == FLAWED && self.curses().any(|curse| curse.what == Mischief::Poison) && !self.is_poisoner();
        if flawed {
            self.own_up();
            panic!("asked to, in test mode: of a flawed state");
        }
    }

    /// Before a step that each process of a role makes, from whatever state: dies if it is asked to do so in each.
    pub fn perish(&self) {
        if self.curses().any(|curse| curse.what == Mischief::Doom) {
            self.own_up();
            panic!("asked to, in test mode: in each step");
        }
    }

    /// The mark of the state that follows from a state with this mark.
    pub fn mark(&self, before: u32) -> u32 {
        if !self.is_poisoner() {
            return before;
        }
        self.own_up();
        FLAWED
    }

    /// Counts that it was done.
    fn own_up(&self) {
        self.page.add64(header::MISCHIEF, 1);
    }

    /// At the beginning of a step: whatever ends or holds up the thread.
    pub fn misbehave(&self) {
        let Some(request) = self.mischief().filter(|request| request.thread == Thread::Steps) else { return };
        match request.what {
            Mischief::Spin => {
                self.own_up();
                while self.mischief().is_some_and(|now| now.what == Mischief::Spin) {
                    std::hint::spin_loop();
                }
            }
            Mischief::Block => {
                self.own_up();
                while self.mischief() == Some(request) {
                    system::sleep_ns(TICK_NS);
                }
            }
            Mischief::ExitZero | Mischief::ExitOne => {
                self.own_up();
                std::process::exit(i32::from(request.what == Mischief::ExitOne));
            }
            Mischief::Panic => {
                self.own_up();
                panic!("asked to, in test mode");
            }
            _ => {}
        }
    }

    /// At the end of a step, before its output is published: makes the step longer, as a slower engine would be. Real time is burnt, not slept.
    pub fn drag(&self, begun_ns: u64) {
        let Some(request) = self.mischief().filter(|request| request.what == Mischief::Slow) else { return };
        self.own_up();
        let now_ns = system::now_ns();
        let taken_ns = now_ns.saturating_sub(begun_ns);
        let until_ns = now_ns + added_ns(&request, taken_ns, now_ns);
        while system::now_ns() < until_ns && !self.clock.stop_requested() {
            std::hint::spin_loop();
        }
    }

    /// Counts a value that is not taken, and says that its writer is not to be trusted.
    pub fn refuse(&self, writer: u32, why: Distrust) {
        let count = match why {
            Distrust::Still | Distrust::Missing => header::STALE,
            Distrust::Frozen => header::FROZEN,
            Distrust::Invalid | Distrust::Differs => header::INVALID,
        };
        self.page.add64(count, 1);
        self.distrust(writer, why);
    }

    /// Says in the page that another process's output is wrong, and why; the supervisor reads it.
    pub fn distrust(&self, incarnation: u32, why: Distrust) {
        self.accuse(incarnation, why as u64);
    }

    /// Says in the page which state of its own role this process has refused last, and why.
    pub(crate) fn name_refused(&self, refused: &RefusedState) {
        // From the end: whoever finds this one's writer there finds the rest of it.
        for (word, value) in refused.words().into_iter().enumerate().rev() {
            self.page.store64(header::REFUSED + word, value);
        }
    }

    /// Says in the page that a thread that helps this process stands still.
    pub(crate) fn name_helper(&self, thread: Thread) {
        self.accuse(self.incarnation, thread.standstill());
    }

    fn accuse(&self, incarnation: u32, why: u64) {
        let now_ns = system::now_ns();
        let page = &self.page;
        let known = (0..header::DISTRUSTED_ENTRIES).find(|index| page.load64(header::distrusted(*index)) as u32 == incarnation);
        let oldest = (0..header::DISTRUSTED_ENTRIES).min_by_key(|index| page.load64(header::distrusted(*index) + 2)).unwrap_or(0);
        let at = header::distrusted(known.unwrap_or(oldest));
        let fresh = known.is_some() && now_ns.saturating_sub(page.load64(at + 2)) <= SERIES_NS;
        // Who is late after it was refused is still the one that was refused, and when it was refused stands.
        let light = |why: u64| why == Distrust::Missing as u64 || why == Distrust::Differs as u64;
        if fresh && light(why) && !light(page.load64(at) >> 32) {
            return;
        }
        if !fresh {
            page.store64(at + 1, now_ns);
        }
        page.store64(at + 2, now_ns);
        page.store64(at, why << 32 | incarnation as u64);
    }
}

/// What a slow step takes beyond `taken_ns`; `seed` draws the jitter.
fn added_ns(request: &Request, taken_ns: u64, seed: u64) -> u64 {
    let longer_ns = taken_ns * (request.factor_percent as u64).saturating_sub(100) / 100 + request.extra_us as u64 * 1_000;
    // A share between −1 and 1 of the jitter.
    let drawn = hyst_messages::fnv_words(0, [seed]) % 2_001;
    let swing_ns = longer_ns as i128 * request.jitter_percent as i128 * (drawn as i128 - 1_000) / 100_000;
    (longer_ns as i128 + swing_ns).max(0) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_step_takes_its_factor_and_its_extra_and_varies_by_its_jitter() {
        let request = Request { factor_percent: 400, extra_us: 50, ..Request::of(Mischief::Slow, 1) };
        assert_eq!(added_ns(&request, 100_000, 5), 350_000, "four times 0.1 ms is 0.3 ms more");
        assert_eq!(added_ns(&Request { factor_percent: 0, extra_us: 0, ..request }, 100_000, 5), 0);
        let swinging = Request { jitter_percent: 50, ..request };
        let drawn: Vec<u64> = (0..500).map(|seed| added_ns(&swinging, 100_000, seed)).collect();
        assert!(drawn.iter().all(|ns| (175_000..=525_000).contains(ns)));
        assert!(drawn.iter().min() < Some(&200_000) && drawn.iter().max() > Some(&500_000));
    }
}
