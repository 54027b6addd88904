//! `hystation fault inject undo`: what is done to an engine for a time ends at once, and the same process works as before.

use hyst_exchange::ReadPage;
use hyst_messages::Slot;
use hyst_messages::page::header;
use rustix::process::Signal;
use station_tests::{RECOVERY_LIMIT, Station, wait_for};

/// Longer than the test takes: it is not the time that ends it.
const FOR: &str = "--for 600s";
/// Steps in a row that were made well: half a second of a fluid's.
const WELL: u64 = 15;
/// Holders that give way to the one that is looked at: on a busy machine one that is late loses the role again.
const MOST_DEATHS: usize = 10;

/// A process, and what it counts in its page.
struct Victim {
    slot: String,
    pid: i32,
    page: ReadPage,
}

impl Victim {
    fn of(station: &Station, target: &str) -> Victim {
        let (slot, pid) = station.victim(target);
        let place = Slot::parse(&slot).expect("a slot");
        let page = station.place().read_slot(place, station.clock().incarnation(place)).expect("its page");
        assert_eq!(page.load64(header::PID), pid as u64, "{slot}");
        Victim { slot, pid, page }
    }

    /// Steps that it made, and steps that it made wrong because it was asked to.
    fn counts(&self) -> [u64; 2] {
        [header::STEPS, header::MISCHIEF].map(|word| self.page.load64(word))
    }

    /// Has it do wrong, and undoes it.
    fn hurt_and_undo(&self, station: &Station, kind: &str, options: &str) {
        let [_, before] = self.counts();
        station.inject(format!("{kind} {} {options}", self.slot).trim_end());
        let is_done = wait_for(RECOVERY_LIMIT, || (self.counts()[1] > before).then_some(()));
        assert!(is_done.is_some(), "{kind}: nothing was done\n{}", station.said());
        station.inject(&format!("undo {}", self.slot));
    }

    /// The same process makes the steps of its role, and none of them wrong. Who has the role of the fluid instead dies.
    fn assert_works(&self, station: &Station, what: &str) {
        let ([mut steps, mut wrong], mut deaths) = (self.counts(), 0);
        let works = wait_for(RECOVERY_LIMIT, || {
            let [made, done] = self.counts();
            let holder = if self.slot.starts_with("fluid") { station.holder("fluid").0 } else { self.pid };
            if holder != self.pid && deaths < MOST_DEATHS {
                station.signal_if_alive(holder, Signal::KILL);
                station.recover();
                deaths += 1;
            }
            if holder != self.pid || done != wrong {
                [steps, wrong] = [made, done];
            }
            (made >= steps + WELL).then_some(())
        });
        let is_there = station.has_process(self.pid);
        assert!(works.is_some() && is_there, "{what}: {:?} {}\n{}", self.counts(), station.status(), station.said());
        println!("{what}: {} works again, after {deaths} deaths of others", self.slot);
    }

    fn limits(&self) -> String {
        std::fs::read_to_string(format!("/proc/{}/limits", self.pid)).expect("its limits")
    }
}

#[test]
fn what_is_undone_is_over_at_once_and_the_same_process_works_as_before() {
    let station = Station::start("undone", &["--hand", "script:press", "--test-mode"]);
    // Its spare has the role by then; that one dies, and it has it again.
    let fluid = Victim::of(&station, "fluid:active");
    fluid.hurt_and_undo(&station, "spin", "");
    station.recover();
    fluid.assert_works(&station, "spin");
    fluid.hurt_and_undo(&station, "slow", &format!("--extra 3ms {FOR}"));
    fluid.assert_works(&station, "slow");

    // Who can open files again meets a newcomer.
    let device = Victim::of(&station, "device");
    let before = device.limits();
    station.inject(&format!("no-files device {FOR}"));
    assert_ne!(device.limits(), before, "no-files: nothing was done\n{}", station.said());
    station.inject("undo device");
    let is_back = wait_for(RECOVERY_LIMIT, || (device.limits() == before).then_some(()));
    assert!(is_back.is_some(), "{}\n{before}", device.limits());
    station.kill("haptic", false);
    let newest = station.processes("haptic").iter().filter_map(|row| row["incarnation"].as_u64()).max().expect("a servo");
    let page = format!("-{newest}.page");
    let maps = || std::fs::read_to_string(format!("/proc/{}/maps", device.pid)).unwrap_or_default();
    let meets = wait_for(RECOVERY_LIMIT, || maps().lines().any(|line| line.ends_with(&page)).then_some(()));
    assert!(meets.is_some(), "the device does not open {page}:\n{}\n{}", maps(), station.said());
    device.assert_works(&station, "no-files");

    let ended = station.stop();
    ended.assert_clean();
    for (kind, victim) in [("spin", &fluid), ("slow", &fluid), ("no-files", &device)] {
        let faults = ended.faults(kind);
        assert!(faults.len() == 1 && faults[0]["target"] == victim.slot.as_str(), "{kind}: {faults:?}");
        assert!(faults[0]["manifested"] == true && faults[0]["recovered_us"].is_number(), "{faults:?}");
    }
}
