//! Engines that do wrong on request: the words in the station's page that ask them to, and what others have to say of them.

use crate::faultfile::{FaultKind, Helper, Injection, Output, default_rate};
use crate::view::Viewer;
use hyst_exchange::{OwnedPage, ReadPage, system};
use hyst_messages::mischief::{Mischief, Outlet, Request, Thread};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{header, station as layout};
use hyst_messages::{RefusedState, SLOTS, Slot};

/// What one process says of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Charge {
    /// Who says it.
    pub by: Slot,
    /// Of whom.
    pub incarnation: u32,
    /// A [`Distrust`].
    pub why: u64,
    /// Since when, ns.
    pub since_ns: u64,
    /// When last, ns.
    pub last_ns: u64,
}

impl Charge {
    /// Whether it is for this reason.
    pub fn is(&self, why: Distrust) -> bool {
        self.why == why as u64
    }
}

/// Asks the incarnation in a slot to do what the injection says; gives the end of it, 0 if there is none.
pub fn ask(page: &OwnedPage, slot: Slot, incarnation: u32, injection: &Injection, now_ns: u64) -> Option<u64> {
    let what = injection.kind.mischief()?;
    let until_ns = injection.for_s.map_or(0, |for_s| now_ns + (for_s * 1e9) as u64);
    // Memory is counted in KiB, files one by one.
    let each = if what == Mischief::LeakMemory { 1_024.0 } else { 1.0 };
    let rate_per_s = if what.is_waste() { (injection.rate.unwrap_or(default_rate(injection.kind)) * each) as u32 } else { 0 };
    let percent = |value: Option<f64>| (value.unwrap_or(0.0) * 100.0) as u16;
    let request = Request {
        what,
        incarnation,
        until_ns,
        factor_percent: percent(injection.factor),
        extra_us: (injection.extra_s.unwrap_or(0.0) * 1e6) as u32,
        jitter_percent: percent(injection.jitter),
        rate_per_s,
        outlet: injection.output.map_or(Outlet::Steps, Output::outlet),
        thread: injection.thread.map_or(Thread::Steps, Helper::thread),
    };
    let [word, until, extent] = request.words();
    let at = slot.number();
    end(page, slot); // so that nobody reads half of one request and half of another
    page.store64(layout::MISCHIEF_UNTIL_NS + at, until);
    page.store64(layout::MISCHIEF_EXTENT + at, extent);
    page.store64(layout::MISCHIEF + at, word);
    if what.is_waste() || request.thread == Thread::Usher {
        page.bump_and_wake(layout::CHANGES); // the thread that does it sleeps on this word
    }
    Some(until_ns)
}

/// Ends what a slot was asked to do.
pub fn end(page: &OwnedPage, slot: Slot) {
    page.store64(layout::MISCHIEF + slot.number(), 0);
}

/// Whether a slot was asked for what outlives who was asked: whoever reads what it wrote goes on dying of it until it ends.
pub fn outlives(page: &OwnedPage, slot: Slot) -> bool {
    let words =
        [layout::MISCHIEF, layout::MISCHIEF_UNTIL_NS, layout::MISCHIEF_EXTENT].map(|word| page.load64(word + slot.number()));
    Request::lasting(words).is_some()
}

/// How often the process in a slot has done wrong as it was asked to.
pub fn done(viewer: &mut Viewer, slot: Slot) -> u64 {
    viewer.slot_page(slot).map_or(0, |page| page.load64(header::MISCHIEF))
}

/// All that the living say: of others, and of themselves that a thread that helps them stands still, and which.
pub fn charges(viewer: &mut Viewer) -> (Vec<Charge>, Vec<(Charge, Thread)>) {
    let (mut of_others, mut of_themselves) = (Vec::new(), Vec::new());
    for by in (0..SLOTS).filter_map(Slot::from_number) {
        if viewer.page().pid(by) == 0 || viewer.page().is_dead(by) {
            continue;
        }
        let incarnation = viewer.page().incarnation(by);
        for charge in viewer.slot_page(by).into_iter().flat_map(|page| said(by, page)) {
            match Thread::of_standstill(charge.why) {
                None => of_others.push(charge),
                Some(thread) if charge.incarnation == incarnation => of_themselves.push((charge, thread)),
                Some(_) => {} // of another life
            }
        }
    }
    (of_others, of_themselves)
}

/// What a page says of others. A time that is not yet is of bytes that flipped: nobody is found by it, and of a series that goes on the newest word counts.
fn said(by: Slot, page: &ReadPage) -> impl Iterator<Item = Charge> + '_ {
    let entry = move |index: usize| {
        let at = header::distrusted(index);
        let word = page.load64(at);
        let (since_ns, last_ns) = (page.load64(at + 1), page.load64(at + 2));
        let now_ns = system::now_ns();
        let since_ns = if since_ns <= now_ns { since_ns } else { last_ns };
        (word != 0 && last_ns <= now_ns).then_some(Charge { by, incarnation: word as u32, why: word >> 32, since_ns, last_ns })
    };
    (0..header::DISTRUSTED_ENTRIES).filter_map(entry)
}

/// The state for which one of its own role distrusts its writer, if this is of such a one.
pub fn refused(viewer: &mut Viewer, charge: &Charge) -> Option<RefusedState> {
    let page = viewer.slot_page(charge.by)?;
    let words = std::array::from_fn(|word| page.load64(header::REFUSED + word));
    RefusedState::from_words(words).filter(|state| state.incarnation == charge.incarnation && charge.is(state.why.distrust()))
}

/// Whether lateness tells of a fault of this kind; of what nobody asked for it does.
pub fn is_found_by_lateness(kind: &str) -> bool {
    FaultKind::from_name(kind).is_none_or(FaultKind::is_found_by_lateness)
}

/// When and by whom an incarnation was first found out after a time, in what it was asked to do, or what was done to it. That it is late, or differs from another
/// that may be the one that is wrong, tells nobody that it lies, nor that its bytes flipped, or that it can open no file: it may be the host's doing.
pub fn first_after(charges: &[Charge], kind: &str, incarnation: u32, after_ns: u64) -> Option<(u64, Slot)> {
    let is_told = |charge: &Charge| [Distrust::Invalid, Distrust::Still, Distrust::Frozen].iter().any(|why| charge.is(*why));
    let counts = |charge: &&Charge| is_found_by_lateness(kind) || is_told(charge);
    let of = charges.iter().filter(|charge| charge.incarnation == incarnation && charge.last_ns >= after_ns).filter(counts);
    // A series that began before the fault is noise of the host; its newest word is not.
    of.map(|charge| (if charge.since_ns >= after_ns { charge.since_ns } else { charge.last_ns }, charge.by)).min()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::{begin, book};
    use hyst_messages::{Refusal, Role};

    #[test]
    fn who_is_late_is_not_found_to_lie_nor_to_have_been_hurt_from_outside() {
        let [tissue, device] = [Role::Tissue, Role::Device].map(Slot::first);
        let charge = |by, why, since_ns| Charge { by, incarnation: 7, why: why as u64, since_ns, last_ns: since_ns + 5 };
        let mut charges = vec![charge(tissue, Distrust::Missing, 1_000), charge(tissue, Distrust::Differs, 1_100)];
        let kinds = ["nan", "frozen", "corrupt", "no-files", "shm-full", "slow", "spin", "block", "poison"];
        let found = |charges: &[Charge]| kinds.map(|kind| first_after(charges, kind, 7, 900));
        let late = Some((1_000, tissue));
        assert_eq!(found(&charges), [None, None, None, None, None, late, late, late, late]);
        for why in [Distrust::Invalid, Distrust::Still, Distrust::Frozen] {
            charges.truncate(2);
            charges.push(charge(device, why, 2_000));
            let told = Some((2_000, device));
            assert_eq!(found(&charges), [told, told, told, told, told, late, late, late, late]);
        }
    }

    /// Of a healthy tissue a state was refused, and nobody could say why.
    #[test]
    fn a_charge_has_the_state_that_was_refused_and_no_other_writers() {
        let (station, _faults) = book("refused");
        let page = station.open_for_keeping().unwrap();
        let by = Slot::first(Role::Tissue);
        let own = begin(&station, &page, by, 7);
        let mut viewer = Viewer::open(&station).unwrap();
        let mut of = |incarnation: u32, why: Distrust| {
            refused(&mut viewer, &Charge { by, incarnation, why: why as u64, since_ns: 1, last_ns: 2 })
        };
        assert_eq!(of(8, Distrust::Invalid), None, "it has refused none");
        let state = RefusedState { why: Refusal::Mesh, incarnation: 8, tick: 5_000, epoch: 3, topology_version: 9 };
        state.words().into_iter().enumerate().for_each(|(word, value)| own.store64(header::REFUSED + word, value));
        assert_eq!([8, 9].map(|incarnation| of(incarnation, Distrust::Invalid)), [Some(state), None]);
        assert_eq!([Distrust::Still, Distrust::Missing].map(|why| of(8, why)), [None; 2]);
    }

    /// A campaign of flipped bytes said of three faults that they were found after 300 000 years.
    #[test]
    fn nobody_is_found_by_a_time_that_is_not_yet() {
        let (station, _faults) = book("charges");
        let page = station.open_for_keeping().unwrap();
        let (device, at) = (Slot::first(Role::Device), header::distrusted(0));
        let own = begin(&station, &page, device, 7);
        let mut viewer = Viewer::open(&station).unwrap();
        let mut counted = |since_ns: u64, last_ns: u64| {
            own.store64(at, u64::from(8u32) | (Distrust::Invalid as u64) << 32);
            own.store64(at + 1, since_ns);
            own.store64(at + 2, last_ns);
            charges(&mut viewer).0.iter().map(|charge| charge.since_ns).collect::<Vec<_>>()
        };
        let now_ns = system::now_ns();
        let ahead_ns = now_ns | 1 << 62;
        assert_eq!(counted(now_ns - 5, now_ns), [now_ns - 5]);
        assert_eq!(counted(ahead_ns, now_ns), [now_ns], "who is told of goes on");
        assert!(counted(now_ns, ahead_ns).is_empty());
    }
}
