//! What a driver in C that has just been started does with what stands in the `device` engine's page from before.

use super::compile;
use super::window::Empty;
use hyst_exchange::system;
use hyst_messages::page::{device, station};
use hyst_messages::{ForceCommand, Role, Slot};
use station_tests::Folder;
use std::path::Path;

/// A driver that says the largest force that its motors were to make in its first ticks, N, and how many commands it has refused.
const SOURCE: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(int argc, char **argv) {
    static hyst_driver driver;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    hyst_statement statement = {.version = HYST_STATEMENT_VERSION, .rate_hz = 1000.0f, .max_force_n = 3.0f};
    hyst_state(&driver, &statement);
    float force_n[3], most_n = 0.0f;
    for (int tick = 0; tick < 5; tick++) {
        hyst_take(&driver, force_n);
        most_n = fmaxf(most_n, hyst_length(force_n));
    }
    printf("%.9g %llu\n", most_n, (unsigned long long)hyst_load(&driver.own, HYST_INVALID));
    return hyst_end(&driver);
}
"#;
/// The life of the device engine, below those of the drivers.
const DEVICE: u32 = 2;

/// It followed a command however old it was: with the engine dead or stopped the hand got its last force at once.
#[test]
fn a_driver_in_c_that_is_started_anew_does_not_follow_what_was_commanded_long_ago() {
    let folder = Folder::new("driver-over");
    let program = compile(&folder, "over", Path::new(&folder.write("over.c", SOURCE)), &[]);
    let mut empty = Empty::new("over");
    let slot = Slot::first(Role::Device);
    let command =
        ForceCommand { tick: 1, force_tick: 1, force_n: [0.0, 2.0, 0.0], device_incarnation: DEVICE, ..ForceCommand::default() };
    empty.station.create_slot(slot, DEVICE).expect("its page").write(device::COMMAND, &command);
    let clock = empty.station.open_for_keeping().expect("the station's page");
    clock.store32(station::SLOT_INCARNATION + slot.number(), DEVICE);
    clock.store64(station::T0_NS, system::now_ns() - 1_000_000_000);
    assert_eq!(empty.live(&program), "0 0\n", "of a second ago, and the engine is not to blame");
    // A clock that has not begun stands at tick 0, for however long this machine takes.
    clock.store64(station::T0_NS, system::now_ns() + 600_000_000_000);
    assert_eq!(empty.live(&program), "2 0\n", "of now");
}
