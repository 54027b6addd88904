//! An engine that does nothing but what every engine must: it opens its page, becomes live, beats, and stops when asked. The tests of
//! the supervisor start it under every engine's name. `FAKE_ENGINE` in a file `fake` in its folder makes it misbehave:
//! `refuse ROLE` exits 2 at the start, `die ROLE` exits 1 at the start.

use hyst_exchange::{Roster, Station, system};
use hyst_messages::page::{ProcessState, device, hardware, header};
use hyst_messages::{Applied, LedgerEntry, Role, Slot};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value =
        |name: &str| arguments.iter().position(|word| word == name).and_then(|at| arguments.get(at + 1)).cloned().unwrap();
    let station = Station::named(&value("--station")).unwrap();
    let slot = Slot::parse(&value("--slot")).unwrap();
    let incarnation: u32 = value("--incarnation").parse().unwrap();
    let orders = std::path::Path::new(&arguments[0]).parent().map(|folder| folder.join("fake")).unwrap();
    let orders = std::fs::read_to_string(orders).unwrap_or_default();
    if orders.trim() == format!("refuse {}", slot.role().name()) {
        eprintln!("scene: the cavity is inside out");
        std::process::exit(2);
    }
    if orders.trim() == format!("die {}", slot.role().name()) {
        std::process::exit(1);
    }
    live(&station, slot, incarnation);
}

fn live(station: &Station, slot: Slot, incarnation: u32) {
    let page = station.own_slot(slot, incarnation).unwrap();
    let known = station.open().unwrap();
    let roster = Roster::open(station).unwrap();
    page.store64(header::PID, std::process::id() as u64);
    page.set_state(ProcessState::Warming);
    page.store64(header::HEARTBEAT_NS, system::now_ns());
    page.set_state(if slot.index() == 0 { ProcessState::Live } else { ProcessState::Warm });
    let mut hardware_tick = 0;
    while !known.stop_requested() {
        let now_ns = system::now_ns();
        let tick = known.tick_at(now_ns);
        page.store64(header::HEARTBEAT_NS, now_ns);
        page.store64(header::VALUE_NS, now_ns);
        page.store64(header::TICK, tick);
        page.add64(header::STEPS, 1);
        page.count_latency(header::WAKEUP, 5_000);
        match slot.role() {
            Role::Hardware => {
                while hardware_tick < tick {
                    hardware_tick += 1;
                    let entry = LedgerEntry {
                        hardware_tick,
                        station_tick: hardware_tick,
                        force_tick: hardware_tick,
                        kind: Applied::Fresh as u32,
                        ..Default::default()
                    };
                    page.push(hardware::LEDGER, hardware_tick, &entry);
                    page.add64(hardware::TOTALS, 1);
                    page.add64(hardware::TOTALS + 1, 1);
                }
            }
            Role::Device => {
                let first = Slot::first(Role::Haptic);
                page.store64(device::SELECTED, first.number() as u64);
                page.store64(device::SELECTED + 1, known.incarnation(first) as u64);
            }
            Role::Tissue | Role::Fluid if slot.index() == 0 => {
                let holder = roster.holder(slot.role());
                if holder.incarnation < incarnation {
                    let _ = roster.promote(slot.role(), holder, incarnation);
                }
            }
            _ => {}
        }
        system::sleep_ns(1_000_000);
    }
    page.set_state(ProcessState::Stopping);
}
