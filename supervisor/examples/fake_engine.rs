//! An engine that does nothing but what every engine must: it opens its page, becomes live, beats, and stops when asked. The tests of
//! the supervisor start it under every engine's name. Lines of a file `fake` in its folder make it misbehave: `refuse ROLE` exits 2 at the
//! start, `die ROLE` exits 1 at the start, `doomed ROLE` crashes in the first steps of each tenure unless the role is held still, `leak ROLE`
//! takes more memory in each step, `files ROLE` opens more files, `floods ROLE` prints without end, `stands ROLE` says that its keeper stands still; these four in
//! the first slot. As a newcomer `accuses ROLE` refuses what the holder of its role says. `forks ROLE` starts another program, and leaves it to itself.

use hyst_engine::kept;
use hyst_engine::life::{DESCRIBE, Description};
use hyst_exchange::{OwnedPage, Roster, Station, StationPage, system};
use hyst_messages::mischief::{Distrust, Thread};
use hyst_messages::page::{ProcessState, device, hardware, header};
use hyst_messages::{Applied, LedgerEntry, Role, Slot};
use std::io::Write;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if arguments.get(1).is_some_and(|word| word == DESCRIBE) {
        let name = std::path::Path::new(&arguments[0]).file_name().unwrap_or_default().to_string_lossy().into_owned();
        println!("{}", serde_json::json!(Description::of(Role::from_name(&name).unwrap())));
        return;
    }
    let value =
        |name: &str| arguments.iter().position(|word| word == name).and_then(|at| arguments.get(at + 1)).cloned().unwrap();
    let station = Station::named(&value("--station")).unwrap();
    let slot = Slot::parse(&value("--slot")).unwrap();
    let incarnation: u32 = value("--incarnation").parse().unwrap();
    let program = kept::name_of(std::path::Path::new(&arguments[0])); // of a copy, the file that it is from
    let orders = program.parent().map(|folder| folder.join("fake")).unwrap();
    let orders = std::fs::read_to_string(orders).unwrap_or_default();
    let ordered = |what: &str| orders.lines().any(|line| line.trim() == format!("{what} {}", slot.role().name()));
    if ordered("refuse") {
        eprintln!("scene: the cavity is inside out");
        std::process::exit(2);
    }
    if ordered("die") {
        std::process::exit(1);
    }
    if ordered("forks") {
        // Who looks for it misses it where it cannot be started.
        let _ = std::process::Command::new("sleep").arg("600").stdin(std::process::Stdio::null()).spawn();
    }
    let [doomed, leaks, opens, floods, stands, accuses] = ["doomed", "leak", "files", "floods", "stands", "accuses"].map(ordered);
    live(&station, slot, incarnation, Vices { doomed, leaks, opens, floods, stands, accuses });
}

/// What it does wrong.
struct Vices {
    doomed: bool,
    leaks: bool,
    opens: bool,
    floods: bool,
    stands: bool,
    accuses: bool,
}

/// Memory that a leak takes in each step, bytes.
const LEAK_BYTES: usize = 32 << 10;
/// What one that floods prints in each step, bytes.
const FLOOD_BYTES: usize = 2 << 20;

/// Writes down that a tick's force was applied in time.
fn apply_fresh(page: &OwnedPage, tick: u64) {
    let fresh = Applied::Fresh as u32;
    let entry = LedgerEntry { hardware_tick: tick, station_tick: tick, force_tick: tick, kind: fresh, ..Default::default() };
    page.push(hardware::LEDGER, tick, &entry);
    page.add64(hardware::TOTALS, 1);
    page.add64(hardware::TOTALS + 1, 1);
}

/// What an engine with a state does in each step: it takes the role if nobody has it, and says whether it has it.
fn keep_role(page: &OwnedPage, (known, roster): (&StationPage, &Roster), (slot, incarnation): (Slot, u32), vices: &Vices) {
    let now_ns = system::now_ns();
    let tick = known.tick_at(now_ns);
    let holder = roster.holder(slot.role());
    let mut of_role = known.occupied(slot.role());
    let lives = of_role.any(|(other, known_as)| known_as == holder.incarnation && !known.is_dead(other));
    // As real engines do: the first slot founds a role, so that it is known who holds it.
    let may = holder.epoch > 0 || slot.index() == 0;
    if holder.is_sound(known.next_incarnation(), tick) && !lives && may {
        let _ = roster.promote(slot.role(), holder, incarnation);
    }
    let holds = roster.holder(slot.role()).incarnation == incarnation;
    // Whom it accuses it accuses before it is ready, too.
    let is_early = vices.accuses && page.load64(header::STEPS) < 500;
    page.set_state(match holds {
        true => ProcessState::Live,
        false if is_early => ProcessState::Warming,
        false => ProcessState::Warm,
    });
    if vices.doomed && holds && !known.is_held(slot.role()) {
        std::process::exit(101);
    }
    // Not before it is known who holds the role.
    if vices.stands && holds && slot.index() == 0 && page.load64(header::STEPS) > 500 {
        page.store64(header::distrusted(0) + 2, now_ns);
        page.store64(header::distrusted(0), Thread::Keeper.standstill() << 32 | u64::from(incarnation));
    }
    if vices.accuses && slot.is_guest() {
        page.store64(header::distrusted(0) + 2, now_ns);
        page.store64(header::distrusted(0), (Distrust::Invalid as u64) << 32 | u64::from(holder.incarnation));
    }
}

fn live(station: &Station, slot: Slot, incarnation: u32, vices: Vices) {
    let mut leaked: Vec<Vec<u8>> = Vec::new();
    let mut opened = Vec::new();
    let page = station.own_slot(slot, incarnation).unwrap();
    let known = station.open().unwrap();
    let roster = Roster::open(station).unwrap();
    page.store64(header::PID, std::process::id() as u64);
    page.set_state(ProcessState::Warming);
    page.store64(header::HEARTBEAT_NS, system::now_ns());
    page.set_state(match slot.index() {
        0 => ProcessState::Live,
        _ if vices.accuses => ProcessState::Warming,
        _ => ProcessState::Warm,
    });
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
                    apply_fresh(&page, hardware_tick);
                }
            }
            Role::Device => {
                let first = Slot::first(Role::Haptic);
                page.store64(device::SELECTED, first.number() as u64);
                page.store64(device::SELECTED + 1, known.incarnation(first) as u64);
            }
            Role::Tissue | Role::Fluid => {
                keep_role(&page, (&known, &roster), (slot, incarnation), &vices);
            }
            _ => {}
        }
        // A leak stops short of what would hurt the machine.
        if vices.leaks && slot.index() == 0 && leaked.len() < 16_000 {
            leaked.push(vec![1; LEAK_BYTES]);
        }
        // Not before it is known who holds the role, and no more than the machine has room for.
        if vices.floods && slot.index() == 0 && (500..580).contains(&page.load64(header::STEPS)) {
            let _ = std::io::stderr().write_all("x".repeat(FLOOD_BYTES).as_bytes()); // whether there is room for it or not
        }
        if vices.opens && slot.index() == 0 && tick.is_multiple_of(10) {
            opened.extend(std::fs::File::open("/dev/null"));
        }
        system::sleep_ns(1_000_000);
    }
    page.set_state(ProcessState::Stopping);
}
