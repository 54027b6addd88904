//! The book of faults: when a fault began, that its whole window counts, where its control lies, and that its line is written.

use super::*;
use hyst_messages::page::station as layout;
use hyst_messages::{Applied, LedgerEntry};

/// A station of a test, which leaves nothing however that ends.
pub(crate) struct Wiped(Station);

impl std::ops::Deref for Wiped {
    type Target = Station;

    fn deref(&self) -> &Station {
        &self.0
    }
}

impl Drop for Wiped {
    fn drop(&mut self) {
        self.0.wipe();
    }
}

/// A station that was just founded, and its book of faults.
pub(crate) fn book(name: &str) -> (Wiped, Faults) {
    let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    let faults = Faults::new(&station, &[]).unwrap();
    (Wiped(station), faults)
}

/// A life begins in a slot, and this process is it: its page.
pub(crate) fn begin(station: &Station, page: &OwnedPage, slot: Slot, incarnation: u32) -> OwnedPage {
    let own = station.create_slot(slot, incarnation).unwrap();
    page.store32(layout::SLOT_PID + slot.number(), std::process::id());
    page.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
    own
}

#[test]
fn a_fault_from_outside_began_at_a_heartbeat_that_can_have_been() {
    let now_ns = 500_000_000_000;
    assert_eq!(begin_ns(now_ns - 7, now_ns), now_ns - 7);
    assert_eq!([0, u64::MAX].map(|beat_ns| begin_ns(beat_ns, now_ns)), [now_ns; 2], "never, and in the future");
    assert_eq!(begin_ns(1, now_ns), now_ns - 40_000_000_000, "the machine's whole life is no fault's window");
}

/// `hang-start haptic:active` of a campaign took 30 s. When its control of 30 s more had passed, 9 815 of its 30 092 ticks were left.
#[test]
fn a_long_fault_is_judged_on_its_whole_window_whenever_its_control_ends() {
    let (station, mut faults) = book("long");
    let fault = faults.start("hang-start", Slot::first(Role::Haptic), 7, 1_000);
    (fault.tick, fault.recovered_us) = (2_000, Some(30_071_149.0));
    let tell = |faults: &mut Faults, ticks: std::ops::Range<u64>| {
        for tick in ticks {
            let kind = if tick == 2_500 { Applied::Held } else { Applied::Fresh } as u32;
            let entry = LedgerEntry { hardware_tick: tick, station_tick: tick, force_tick: tick, kind, ..LedgerEntry::default() };
            faults.ledger.push(&entry, true);
        }
        faults.close(false, |_, _, has_control| has_control);
    };
    tell(&mut faults, 0..33_000);
    assert_eq!((faults.closed.len(), faults.open.faults.len()), (0, 1), "there is no control yet");
    let mut successor = Faults::new(&station, &[]).unwrap();
    assert_eq!(successor.open.faults, faults.open.faults, "a supervisor that comes after this one knows of it");
    tell(&mut successor, 0..64_000);
    let (window, control) = successor.closed[0].window.zip(successor.closed[0].control).unwrap();
    assert_eq!((window.ticks, window.missed, control.ticks, control.missed), (30_092, 1, 30_092, 0));
    assert!(control.from_tick >= window.to_tick + 300 && successor.ledger.window(2_000, 32_092).ticks < 30_092);
    assert_eq!((successor.closed[0].promise_held, successor.closed[0].late.len()), (Some(false), 1));
}

/// The line of a fault that filled /dev/shm was lost while its ballast was still being freed.
#[test]
fn a_fault_whose_line_cannot_be_written_is_closed_once_it_can() {
    let (station, mut faults) = book("line");
    faults.start("kill", Slot::first(Role::Fluid), 7, 1_000);
    let file = path(&station, "faults.jsonl");
    std::fs::create_dir(&file).unwrap(); // nobody writes into that
    let mut close = || {
        faults.close(false, |_, _, _| true);
        (faults.closed.len(), faults.open.faults.len())
    };
    assert_eq!(close(), (0, 1));
    std::fs::remove_dir(&file).unwrap();
    assert_eq!(close(), (1, 0));
    assert_eq!(std::fs::read_to_string(&file).unwrap().lines().count(), 1);
}

/// 59 of the 65 faults in a swap had their control in the same swap.
#[test]
fn no_control_lies_in_a_swap_and_a_fault_in_one_waits_for_its_end() {
    let (station, mut faults) = book("swaps");
    let page = station.open().unwrap();
    let hurt = |faults: &mut Faults, tick: u64| {
        let fault = faults.start("kill", Slot::first(Role::Fluid), 7, page.start_of(tick));
        (fault.tick, fault.recovered_us) = (tick, Some(100_000.0));
    };
    let tell = |faults: &mut Faults, ticks: std::ops::Range<u64>| {
        for tick in ticks {
            faults.ledger.push(&LedgerEntry { station_tick: tick, force_tick: tick, ..LedgerEntry::default() }, true);
        }
        faults.close(false, |_, is_through, has_waited| is_through && has_waited);
        faults.closed.iter().filter_map(|fault| fault.control).map(|it| (it.from_tick, it.to_tick)).collect::<Vec<_>>()
    };
    assert_eq!(tell(&mut faults, 0..6_000), []);
    faults.swap_begun(page.start_of(6_000)); // the first 5 000 ticks are start-up: five windows fit before it
    for tick in [7_000, 7_300, 7_600] {
        hurt(&mut faults, tick);
    }
    assert_eq!(tell(&mut faults, 6_000..14_000), [(5_800, 6_000), (5_600, 5_800), (5_400, 5_600)]);
    hurt(&mut faults, 13_900);
    assert_eq!(tell(&mut faults, 14_000..14_300).len(), 3, "the swap goes on, and with it what it may do to the hand");
    let mut successor = Faults::new(&station, &[]).unwrap();
    successor.swap_begun(page.start_of(6_000));
    successor.swap_ended(page.start_of(14_400));
    assert_eq!(successor.open.swaps.len(), 1, "the same one");
    hurt(&mut successor, 15_300);
    let controls = tell(&mut successor, 0..16_700);
    assert_eq!(controls[3..], [(14_701, 14_901), (15_100, 15_300)], "300 ticks after the swap, and the nearest to the other");
}

/// A control that began where a fault's window ended took the harm that came later for what is lost without any.
#[test]
fn what_a_fault_does_to_the_hand_later_is_in_no_control() {
    let (_station, mut faults) = book("later");
    let fault = faults.start("kill", Slot::first(Role::Fluid), 7, 1_000);
    (fault.tick, fault.recovered_us) = (5_200, Some(100_000.0));
    for tick in 0..6_500u64 {
        let kind = if (5_450..5_490).contains(&tick) { Applied::Held } else { Applied::Fresh } as u32;
        faults.ledger.push(&LedgerEntry { station_tick: tick, force_tick: tick, kind, ..LedgerEntry::default() }, true);
        faults.close(false, |fault, is_over, has_control| fault.recovered_us.is_some() && is_over && has_control);
        assert!(faults.closed.is_empty() || tick >= 5_699, "closed at {tick}");
    }
    let fault = &faults.closed[0];
    let (window, control, after) = (fault.window.unwrap(), fault.control.unwrap(), fault.aftermath.unwrap());
    assert_eq!((window.from_tick, window.to_tick, window.missed), (5_200, 5_400, 0));
    assert_eq!((after.from_tick, after.to_tick, after.missed), (5_400, 5_700, 40));
    assert_eq!((control.from_tick, control.to_tick, control.missed, fault.control_early), (5_000, 5_200, 0, false));
}

/// A fault that had not recovered reached for 200 ticks, and what it did to the hand later was the control of another one.
#[test]
fn no_control_lies_in_a_fault_that_is_not_over() {
    let (_station, mut faults) = book("goes-on");
    faults.start("leak-memory", Slot::first(Role::Fluid), 7, 1_000).tick = 6_000;
    let fault = faults.start("kill", Slot::first(Role::Recorder), 8, 1_000);
    (fault.tick, fault.recovered_us) = (7_000, Some(100_000.0));
    for tick in 0..7_600u64 {
        let kind = if (6_300..7_600).contains(&tick) { Applied::Held } else { Applied::Fresh } as u32;
        faults.ledger.push(&LedgerEntry { station_tick: tick, force_tick: tick, kind, ..LedgerEntry::default() }, true);
    }
    faults.close(false, |fault, is_over, has_control| fault.recovered_us.is_some() && is_over && has_control);
    let [closed] = &faults.closed[..] else { panic!("{:?}", faults.closed) };
    let (window, control) = closed.window.zip(closed.control).unwrap();
    assert_eq!((closed.kind.as_str(), window.missed), ("kill", 200));
    assert_eq!((control.from_tick, control.to_tick, control.missed), (5_800, 6_000, 0), "the one before it all");
    assert_eq!((closed.aftermath, faults.open.faults.len()), (None, 1), "what comes after it is the other's, which goes on");
}

#[test]
fn one_that_lies_is_not_found_by_being_late_nor_when_it_was_late() {
    let (_station, mut faults) = book("lies");
    let slots = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
    for (kind, slot) in ["nan", "spin"].into_iter().zip(slots) {
        faults.start(kind, slot, 7, 1_000_000);
        faults.suspected(slot, 7, 4_000_000);
    }
    let seen = |faults: &Faults| faults.all().map(|fault| (fault.manifested, fault.detected_us)).collect::<Vec<_>>();
    assert_eq!(seen(&faults), [(false, None), (true, Some(3_000.0))]);
    faults.late(slots[0], 7, 9_000_000, 9_000_000, "tissue:1");
    assert_eq!(seen(&faults)[0], (true, Some(8_000.0)));
}

/// A stall of the host in the seconds of such a fault was its notice, and so the ticks that the stall took stood for what it costs.
#[test]
fn what_is_done_from_outside_is_not_found_by_lateness_and_is_by_an_end() {
    let (_station, mut faults) = book("outside");
    let slot = Slot::first(Role::Tissue);
    let kinds = ["corrupt", "no-files", "shm-full", "stop", "spin", "block", "slow"];
    for (incarnation, kind) in (1..).zip(kinds) {
        faults.start(kind, slot, incarnation, 1_000_000);
        faults.suspected(slot, incarnation, 4_000_000);
    }
    let found = |faults: &Faults| faults.all().map(|fault| (fault.detected_by.clone(), fault.detected_us)).collect::<Vec<_>>();
    let [nobody, late] = [(String::new(), None), ("heartbeat".to_string(), Some(3_000.0))];
    assert_eq!(found(&faults), [vec![nobody; 3], vec![late; 4]].concat());
    faults.late(slot, 1, 9_000_000, 9_000_000, "heartbeat");
    faults.died(slot, 2, Exit::Code(1), Death { at_ns: 5_000_000, open_ns: None, beat_ns: 4_000_000 });
    let [ended, died] = [("heartbeat", 8_000.0), ("pidfd", 4_000.0)].map(|(by, us)| (by.to_string(), Some(us)));
    assert_eq!(found(&faults)[..2], [ended, died]);
}

/// One that leaked was killed while it handed its role over: its leak went on in the book for 40 s after its successor was there. So did the spin of one that was
/// killed before anybody had found it.
#[test]
fn whatever_was_done_to_a_process_is_over_with_it_and_the_newest_fault_alone_has_its_death() {
    let (station, mut faults) = book("found");
    let slot = Slot::first(Role::Tissue);
    for (kind, incarnation) in [("leak-files", 7), ("spin", 6), ("leak-memory", 7)] {
        faults.start(kind, slot, incarnation, 1_000).asked = Some((0, 0));
    }
    faults.late(slot, 7, 2_000_000, 2_000_000, "growth");
    faults.start("kill", slot, 7, 3_000_000);
    faults.died(slot, 7, Exit::Signal(9), Death { at_ns: 3_001_000, open_ns: None, beat_ns: 2_999_000 });
    faults.ready(slot, 8, 9_000_000);
    let of = |fault: &Fault| (fault.kind.clone(), fault.detected_by.clone(), fault.dead, fault.recovered_us.is_some());
    let over: Vec<_> = faults.all().map(of).collect();
    let expected = [
        ("leak-files", "", true, true),
        ("spin", "", false, false), // of another life
        ("leak-memory", "growth", true, true),
        ("kill", "pidfd", true, true),
    ];
    assert_eq!(over, expected.map(|(kind, by, dead, is_over)| (kind.to_string(), by.to_string(), dead, is_over)));
    assert!(faults.all().all(|fault| fault.manifested != fault.detected_by.is_empty()), "what nobody saw has not come about");
    let said = std::fs::read_to_string(station.events()).unwrap();
    assert!(said.contains("fault leak-files of tissue:0 is over: it died of kill"), "{said}");
}

/// A successor that is hindered in its start dies of that, and a fault of its own was open for 40 s.
#[test]
fn what_was_done_to_a_successor_that_is_hindered_is_over_with_it_too() {
    let (_station, mut faults) = book("hindered");
    let slot = Slot::first(Role::Fluid);
    let death = |at_ns: u64| Death { at_ns, open_ns: None, beat_ns: at_ns };
    faults.start("crash-loop", slot, 7, 1_000).starts_left = Some(2);
    faults.died(slot, 7, Exit::Signal(9), death(2_000));
    faults.start("stop", slot, 8, 3_000);
    faults.died(slot, 8, Exit::Code(1), death(4_000));
    faults.ready(slot, 9, 9_000);
    let over: Vec<_> = faults.all().map(|fault| (fault.kind.as_str(), fault.dead, fault.recovered_us.is_some())).collect();
    assert_eq!(over, [("crash-loop", true, true), ("stop", true, true)]);
}

/// A fault in the last moments of a run was held against it, and one of which nobody had come back in 40 s was not: the ledger had forgotten its window.
#[test]
fn one_that_is_not_over_breaks_its_promise_once_its_time_is_and_not_when_the_run_ends_before() {
    let (_station, mut faults) = book("overdue");
    let now_ns = system::now_ns();
    let slot = Slot::first(Role::Recorder);
    let of_minute_ns = now_ns.saturating_sub(60_000_000_000);
    let of = [("kill", 1_000, None), ("kill", now_ns, None), ("kill", 1_000, Some(5.0)), ("hang-start", of_minute_ns, None)];
    for (kind, injected_ns, recovered_us) in of {
        let fault = faults.start(kind, slot, 7, injected_ns);
        (fault.dead, fault.recovered_us) = (true, recovered_us);
    }
    faults.close_all();
    let found: Vec<_> = faults.closed.iter().map(|fault| (fault.overdue, fault.promise_held)).collect();
    assert_eq!(found, [(true, Some(false)), (false, None), (false, None), (false, None)]);
}
