//! How many swaps are judged, by windows that are made by hand; how a window is read from the hardware's ledger; which roles are meant.

use super::{ROLES, roles_of};
use hyst_exchange::ReadPage;
use hyst_messages::page::hardware::{LEDGER, WORDS};
use hyst_messages::{Applied, LedgerEntry};
use hystation::campaign::judge::Verdict;
use hystation::campaign::judge::pairs::{DEFAULT_LIMIT, Window, of_pairs};
use station_tests::paired::{Follower, how_many, judge, tally, words};

/// One of 3 s that lost so many ticks.
fn window(missed: u64) -> Window {
    Window { to_tick: 3_000, ticks: 3_000, missed, late: missed, ..Window::default() }
}

/// So many that lost nothing, nor did their controls.
fn lossless(count: usize) -> Vec<[Window; 2]> {
    vec![[window(0); 2]; count]
}

fn assert_says(text: &str, parts: &[&str]) {
    parts.iter().for_each(|part| assert!(text.contains(part), "{part:?} is not in {text}"));
}

#[test]
fn sixty_without_a_loss_hold_the_limit_and_fifty_say_how_many_it_takes() {
    assert_eq!(judge("swaps of haptic", &lossless(60), 0), Verdict::Held);
    let fifty = of_pairs("swaps of haptic", &lossless(50), 0, DEFAULT_LIMIT);
    assert_eq!(fifty.verdict, Verdict::Unknown);
    let least = how_many();
    let none = ["0 worse", "0 better", "0.000 each, with 95 % below 0.000"];
    assert_says(&words(&fifty), &["swaps of haptic: 50 made, 50 count", &least, "with 95 % below 0.05"]);
    assert_says(&words(&fifty), &none);
    let number: usize = least.split(' ').next().and_then(|word| word.parse().ok()).expect("a number");
    assert!((51..=60).contains(&number), "{least}");
}

#[test]
fn one_that_is_worse_and_one_that_is_better_are_told_with_what_they_lost() {
    let mut all = lossless(60);
    (all[7], all[9]) = ([window(3), window(1)], [window(0), window(1)]);
    let figures = of_pairs("swaps", &all, 0, DEFAULT_LIMIT);
    assert_eq!(figures.verdict, Verdict::Unknown);
    let lost = "lost 3 of 180000 ticks, and 0 void, their controls 2 of 180000, and 0";
    assert_says(&words(&figures), &["60 count", "1 worse than their controls, 1 better: a share of 0.000", "0.017 each", lost]);
    let parts = ["lost 0 of 3000 ticks, and 0 void, its control 1 of 3000", "so far 10 of 10 count, 1 worse, 1 better"];
    assert_says(&tally(&all[..10], 0), &parts);
    assert_eq!(tally(&[], 0), "none");
}

#[test]
fn those_of_the_device_are_worse_beyond_what_they_may_cost() {
    let all = [[window(21), window(0)]; 3];
    assert_says(&words(&of_pairs("d", &all, 20, DEFAULT_LIMIT)), &["3 worse", "and the 20 that each may cost: 1.000 each"]);
    assert_says(&words(&of_pairs("d", &all, 21, DEFAULT_LIMIT)), &["0 worse", "0 better", "0.000 each"]);
}

#[test]
fn a_window_counts_the_ticks_that_come_to_the_ledger_while_it_is_open_and_one_with_gaps_is_not_whole() {
    let path = std::path::PathBuf::from(format!("/dev/shm/hyst-test-{}-follower", std::process::id()));
    let page = hyst_exchange::page::create(&path, WORDS, 0, 1).expect("a page");
    let read = [(), ()].map(|()| ReadPage::open(&path, WORDS).expect("the page"));
    std::fs::remove_file(&path).expect("it stays mapped");
    let push = |tick: u64, kind: Applied, void: u32| {
        let entry = LedgerEntry { hardware_tick: tick, station_tick: tick, kind: kind as u32, void, ..LedgerEntry::default() };
        page.push(LEDGER, tick, &entry);
    };
    (0..10).for_each(|tick| push(tick, Applied::Held, 0));
    let [first, second] = read;
    let mut follower = Follower::new(first, 10);
    (10..20).for_each(|tick| push(tick, Applied::Fresh, 0));
    follower.follow();
    follower.follow();
    push(20, Applied::Held, 0);
    push(21, Applied::Zero, 1);
    push(22, Applied::Fresh, 1);
    let window = follower.until(23);
    assert_eq!((window.ticks, window.missed, window.late, window.voided), (11, 1, 2, 2));
    assert!((window.from_tick, window.to_tick) == (10, 23) && window.is_whole(), "{window:?}");
    let follower = Follower::new(second, 23);
    push(60, Applied::Fresh, 0);
    let window = follower.until(61);
    assert!(window.ticks == 1 && !window.is_whole(), "{window:?}");
}

#[test]
fn the_roles_that_are_named_are_swapped_in_their_order_and_another_name_is_refused() {
    assert_eq!(roles_of(None), Ok(ROLES.to_vec()));
    assert_eq!(roles_of(Some("tissue, haptic,haptic")), Ok(vec!["tissue", "haptic"]));
    assert_eq!(roles_of(Some("device,rendering")), Ok(vec!["rendering", "device"]));
    for wrong in ["", "tissue,", "hardware", "haptic tissue"] {
        assert!(roles_of(Some(wrong)).is_err_and(|reason| reason.contains("collision-worker, rendering")), "{wrong}");
    }
}
