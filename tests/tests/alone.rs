//! One of a role with a state that lies while its spare is being started: nobody else has a state of the role, and each newcomer would wait for one of the
//! liar's. It is ended, the role goes on from a checkpoint, and those whom it accuses meanwhile are left alone.

use hyst_messages::page::device;
use hyst_messages::{Role, Slot};
use station_tests::{RECOVERY_LIMIT, Station, wait_for};

/// What the device is to refuse: a number that is none, an index out of range, an epoch that nobody has won.
const LIES: [(&str, &str); 4] = [("tissue", "nan"), ("tissue", "range"), ("tissue", "ahead"), ("fluid", "nan")];
/// On a busy machine the lie may come once the newcomer is warm; then it is told again.
const TRIES: usize = 6;
const BETWEEN_TICKS: u64 = 420;
/// The device uses what is so fresh, ticks.
const FRESH_TICKS: u64 = 100;

/// How often the station has said that it ended one who was alone.
fn ended_alone(station: &Station) -> usize {
    station.said().matches("the role goes on from a checkpoint, for nobody else has a state of it").count()
}

/// How old is what the device uses of a role, ticks.
fn used_ticks(station: &Station, role: &str) -> Option<u64> {
    let slot = Slot::first(Role::Device);
    let page = station.place().read_slot(slot, station.clock().incarnation(slot)).ok()?;
    let input = page.ring(device::INPUTS, page.ring_end(device::INPUTS).checked_sub(1)?)?;
    let used = if role == "fluid" { input.medium_tick } else { input.model.state_tick };
    Some(input.tick.saturating_sub(used))
}

#[test]
fn one_that_lies_while_its_spare_is_started_gives_its_role_to_a_newcomer_all_the_same() {
    let station = Station::start("alone", &["--hand", "script:press", "--test-mode"]);
    for (role, kind) in LIES {
        let before = ended_alone(&station);
        for _ in 0..TRIES {
            station.run_ticks(BETWEEN_TICKS);
            station.inject(&format!("kill {role}:spare"));
            station.inject(&format!("{kind} {role}:active"));
            station.recover();
            if ended_alone(&station) > before {
                break;
            }
        }
        assert!(ended_alone(&station) > before, "{kind} {role}: never alone\n{}", station.said());
        let fresh = wait_for(RECOVERY_LIMIT, || used_ticks(&station, role).filter(|ticks| *ticks < FRESH_TICKS));
        assert!(fresh.is_some(), "{kind} {role}: the device uses nothing new\n{}", station.said());
    }
    assert!(!station.said().contains("collision-worker:0 is distrusted"), "{}", station.said());
    let ended = station.stop();
    ended.assert_clean();
    for kind in ["nan", "range", "ahead"] {
        for fault in ended.faults(kind) {
            assert!(fault["detected_us"].is_number() && fault["recovered_us"].is_number(), "{fault:#}\n{}", ended.said);
        }
    }
}
