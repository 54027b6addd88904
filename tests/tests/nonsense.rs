//! What does not come from a well-meaning operator, in whole stations: nonsense in the roster's page while engines feel the tissue, and a flood of
//! requests and garbage on the control socket. Each is refused or mended, said, and costs the hand nothing.

use hyst_exchange::Roster;
use hyst_messages::page::{WORDS32, header, roster};
use hyst_messages::{Role, Slot};
use station_tests::beside::Beside;
use station_tests::windows::compare;
use station_tests::{RECOVERY_LIMIT, Station, wait_for};
use std::io::{Read, Write};
use std::os::unix::fs::FileExt;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Epochs that a mend and what follows it may take: a holder that lost ticks leaps, and a spare may take the role in between.
const MOST_EPOCHS_ON: u32 = 2_000;
/// Lines that one mend may take in the events, whatever was written.
const MOST_LINES: usize = 2;
/// Excess misses per word of nonsense: the servo reads no roster.
const ALLOWED: f64 = 0.1;
/// Words that must count for it.
const LEAST: usize = 6;
/// Threads that ask for the status all the time; that ask for a report and hang up; that send what is no request.
const ASKERS: [fn(&std::path::Path, &Flood); 6] = [ask, ask, ask, ask_and_hang_up, ask_and_hang_up, send_garbage];
/// Connections that a flood makes at least.
const FLOOD: u64 = 10_000;
/// The last epoch that there is.
const LAST_EPOCH: u64 = 0x7fff_ffff;

/// The roster's page as a file, which is what somebody who damages it has.
struct Page(std::fs::File);

impl Page {
    fn open(station: &Station) -> Page {
        Page(std::fs::File::options().read(true).write(true).open(station.place().roster_page()).expect("the roster's page"))
    }

    /// Writes into the word of a role: the 32-bit words come first in a page.
    fn write(&self, role: Role, word: u64) {
        let at = 4 * WORDS32 + 8 * (roster::OWNER + role as usize);
        self.0.write_all_at(&word.to_ne_bytes(), at as u64).expect("the page is reserved");
    }
}

fn holder(station: &Station, role: Role) -> (u32, u32) {
    let tenure = Roster::open(&station.place()).expect("the roster").holder(role);
    (tenure.epoch, tenure.incarnation)
}

/// The other incarnation of a role.
fn spare(station: &Station, role: Role) -> u32 {
    let (_, holds) = holder(station, role);
    let clock = station.clock();
    let mut others = clock.occupied(role).map(|(_, incarnation)| incarnation).filter(|incarnation| *incarnation != holds);
    others.next().expect("a spare")
}

/// When the holder of a role has sent its newest state, ns; 0 if the roster names nobody of the role.
fn sent_ns(station: &Station, role: Role) -> u64 {
    let (_, incarnation) = holder(station, role);
    let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
    let mut pages = slots.filter_map(|slot| station.place().read_slot(slot, incarnation).ok());
    pages.next().map_or(0, |page| page.load64(header::VALUE_NS))
}

/// The role is held by somebody of it, in an epoch that leaves room, and its state goes on.
fn assert_mended(station: &Station, role: Role, before: u32, word: u64) {
    let began_ns = hyst_exchange::system::now_ns();
    let good = || {
        let (epoch, _) = holder(station, role);
        (epoch > before && epoch < before + MOST_EPOCHS_ON && sent_ns(station, role) > began_ns).then_some(())
    };
    let what = || format!("{} {word:#x}: {:x?}, {before} before", role.name(), holder(station, role));
    assert!(wait_for(RECOVERY_LIMIT, good).is_some(), "{}\n{}", what(), station.events());
}

fn lines(station: &Station) -> usize {
    station.events().matches("which cannot be").count()
}

/// Words that cannot be, as the role is now: a promotion after the first led to an epoch that no station can have, for ever, and so did each mend.
fn nonsense(station: &Station, role: Role) -> Vec<u64> {
    let (epoch, holds) = holder(station, role);
    let (holds, spare) = (u64::from(holds), u64::from(spare(station, role)));
    vec![
        LAST_EPOCH << 32 | holds,
        LAST_EPOCH << 32 | spare,
        1 << 32 | spare,
        u64::from(epoch) << 32 | 9_999,
        u64::from(epoch) << 32,
        0x5eed_0000_dead_beef,
        u64::MAX,
        0,
    ]
}

/// The holder dies, another takes the role, and the station is whole.
fn assert_promotable(station: &Station, role: Role) {
    let (before, _) = holder(station, role);
    station.kill(role.name(), true);
    let (after, _) = holder(station, role);
    assert!(after > before && after < before + MOST_EPOCHS_ON, "{}: {before} before, {after} after", role.name());
}

#[test]
fn nonsense_in_the_roster_is_mended_once_and_said_and_the_role_lives_on() {
    let mut station = Station::start("nonsense", &["--hand", "script:press"]);
    let page = Page::open(&station);
    let mut cost = Beside::default();
    // The rules are the same for both: of the fluid's every third.
    for (role, every) in [(Role::Tissue, 1), (Role::Fluid, 3)] {
        for index in (0..nonsense(&station, role).len()).step_by(every) {
            cost.compare(&mut station, |station| {
                let ((before, _), said) = (holder(station, role), lines(station));
                let word = nonsense(station, role)[index];
                page.write(role, word);
                assert_mended(station, role, before, word);
                assert!(lines(station) <= said + MOST_LINES, "{word:#x}\n{}", station.events());
            });
        }
        assert_promotable(&station, role);
    }
    cost.judge("words of nonsense in the roster", ALLOWED, LEAST, &station);
    assert!(lines(&station) > 0, "it was said\n{}", station.events());
    // A supervisor that has just begun knows no tenure before the nonsense; the holder's page does.
    for word in [LAST_EPOCH << 32, 1 << 32] {
        let (before, holds) = holder(&station, Role::Tissue);
        let starts = station.supervisor_starts();
        station.kill_keepers(&[Role::Supervisor]);
        page.write(Role::Tissue, word | u64::from(holds));
        station.wait_for_supervisor(starts);
        assert_mended(&station, Role::Tissue, before, word);
    }
    assert_promotable(&station, Role::Tissue);
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
}

/// Whether a flood is to end, the connections that it made, and the whole answers that it got.
#[derive(Default)]
struct Flood {
    ends: AtomicBool,
    connections: AtomicU64,
    answers: AtomicU64,
}

impl Flood {
    /// A connection, unless it is over; none if there was no room for it.
    fn connect(&self, path: &std::path::Path) -> Option<Option<UnixStream>> {
        if self.ends.load(Ordering::Relaxed) {
            return None;
        }
        let stream = UnixStream::connect(path).ok();
        self.connections.fetch_add(u64::from(stream.is_some()), Ordering::Relaxed);
        Some(stream)
    }
}

/// Asks again and again.
fn ask(path: &std::path::Path, flood: &Flood) {
    while let Some(stream) = flood.connect(path) {
        let Some(mut stream) = stream else { continue };
        let mut text = String::new();
        let sent = stream.write_all(b"{\"do\":\"status\"}\n").and_then(|()| stream.read_to_string(&mut text));
        let is_whole = sent.is_ok() && text.starts_with('{') && text.ends_with("}\n") && text.contains("\"ok\":true");
        flood.answers.fetch_add(u64::from(is_whole), Ordering::Relaxed);
    }
}

/// Asks for the largest answer that there is, and is gone before it comes.
fn ask_and_hang_up(path: &std::path::Path, flood: &Flood) {
    while let Some(stream) = flood.connect(path) {
        let _ = stream.map(|mut stream| stream.write_all(b"{\"do\":\"report\"}\n"));
    }
}

/// Sends what is no request.
fn send_garbage(path: &std::path::Path, flood: &Flood) {
    let garbage: [&[u8]; 5] = [b"", b"{\"do\":", b"\xff\xfe\x00\n", b"{\"do\":\"status\",\"x\":1}\n", b"[[[[[[[[[[[[\n"];
    for line in garbage.iter().cycle() {
        match flood.connect(path) {
            Some(stream) => drop(stream.map(|mut stream| stream.write_all(line))),
            None => return,
        }
    }
}

/// Each valid request makes the supervisor look at every page of the station and write an answer; deaths come first.
#[test]
fn a_flood_of_requests_and_garbage_costs_the_engines_no_tick_and_no_process_and_who_dies_meanwhile_comes_back() {
    let station = Station::start("flood", &["--hand", "script:press"]);
    let (before, supervisor) = (station.census(), station.keeper(Role::Supervisor));
    let flood = Arc::new(Flood::default());
    let askers = std::cell::RefCell::new(Vec::new());
    let begin = |station: &Station| {
        flood.ends.store(false, Ordering::Relaxed);
        let path = station.place().control_socket();
        askers.borrow_mut().extend(ASKERS.map(|asker| {
            let (path, flood) = (path.clone(), Arc::clone(&flood));
            std::thread::spawn(move || asker(&path, &flood))
        }));
    };
    let end = |_: &Station| {
        flood.ends.store(true, Ordering::Relaxed);
        askers.borrow_mut().drain(..).for_each(|asker| asker.join().expect("an asker"));
    };
    compare("a flood of requests and garbage", &station, begin, end);
    before.assert_untouched(&station, "a flood of requests and garbage", &[]);
    begin(&station);
    let connections = || Some(flood.connections.load(Ordering::Relaxed)).filter(|connections| *connections >= FLOOD);
    assert!(wait_for(RECOVERY_LIMIT, connections).is_some(), "{:?} connections in all", flood.connections);
    for (role, active) in [("haptic", true), ("tissue", true), ("device", true), ("collision-worker", true)] {
        station.kill(role, active); // waits until another one is there
    }
    end(&station);
    println!("{:?} requests of {:?} connections were answered", flood.answers, flood.connections);
    assert!(flood.answers.load(Ordering::Relaxed) >= 10, "{:?}\n{}", flood.answers, station.events());
    assert_eq!(station.keeper(Role::Supervisor), supervisor, "{}", station.events());
    let ended = station.stop();
    ended.assert_clean();
    ended.assert_recorded();
}
