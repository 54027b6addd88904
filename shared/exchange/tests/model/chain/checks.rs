//! What the search is to find in the chain of states, and what it must not.

use super::*;
use crate::search::{Searched, search};

fn searched(flaw: Flaw, (ticks, deaths, handed, misses): (u8, u8, u8, u32)) -> Result<Searched, String> {
    search(&Chain { flaw, ticks, deaths, handed, misses, lockstep: false })
}

/// The same of a role in lock-step, in which the supervisor gives no role away.
fn searched_in_lockstep(flaw: Flaw, (ticks, deaths): (u8, u8)) -> Result<Searched, String> {
    search(&Chain { flaw, ticks, deaths, handed: 0, misses: 2, lockstep: true })
}

#[test]
fn one_state_for_each_epoch_and_tick_and_no_reader_goes_back() {
    let mut sights = 0;
    for size in [(3, 1, 0, 2), (2, 2, 0, 2), (4, 0, 0, 3), (3, 0, 1, 2), (2, 1, 1, 2)] {
        let found = searched(Flaw::None, size).unwrap_or_else(|broken| panic!("{broken}"));
        println!("(ticks, deaths, handed, misses) {size:?}: {found:?}");
        sights |= found.sights;
    }
    assert_eq!(
        sights,
        SUBSTITUTE | LEAP | TAKEOVER | ZOMBIE | FENCED | SUCCESSOR | FOUNDER | HANDED,
        "not all was searched that should be"
    );
}

#[test]
fn every_flaw_is_found() {
    let cases = [
        (Flaw::HolderLeaps, (4, 0, 0, 3), "two states"),
        (Flaw::SpareBegins, (3, 0, 0, 2), "after (2, 2)"),
        (Flaw::OldClock, (3, 0, 0, 2), "after (2, 4)"),
        (Flaw::Store, (3, 1, 0, 2), "two states"),
        (Flaw::Anything, (3, 0, 0, 2), "after (1, 1)"),
        (Flaw::Trusting, (3, 0, 1, 2), "after"),
        (Flaw::Patient, (3, 1, 0, 2), "no way leads to an end"),
    ];
    for (flaw, size, expected) in cases {
        let broken = searched(flaw, size).expect_err("the search found nothing");
        assert!(broken.contains(expected), "{flaw:?}: {broken}");
    }
}

#[test]
fn in_lockstep_the_state_that_is_sent_again_leads_no_reader_back() {
    let mut sights = 0;
    for size in [(3, 1), (2, 2)] {
        let found = searched_in_lockstep(Flaw::None, size).unwrap_or_else(|broken| panic!("{broken}"));
        println!("in lock-step, (ticks, deaths) {size:?}: {found:?}");
        sights |= found.sights;
    }
    let all = AGAIN | TAKEOVER | SUCCESSOR;
    assert_eq!(sights & all, all, "not all was searched that should be");
    let broken = searched_in_lockstep(Flaw::Hasty, (3, 1)).expect_err("the search found nothing");
    assert!(broken.contains("after"), "{broken}");
}

/// The last look at the roster spares the readers work; what guards them is the order of the keys, for a zombie may stop right after that look.
#[test]
fn a_state_that_is_sent_without_a_last_look_at_the_roster_does_no_harm() {
    searched(Flaw::Unfenced, (4, 0, 0, 2)).unwrap_or_else(|broken| panic!("{broken}"));
}
