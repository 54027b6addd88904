//! What a driver in C has nothing for is set by the window's keys: of each control that, and nothing else, until the window has said something as the driver has it.

use super::compile;
use hyst_exchange::Station;
use hyst_messages::controls::*;
use hyst_messages::page::{hardware, rendering, station};
use hyst_messages::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls, HardwareSample, PointerRecord, Role, Slot};
use station_tests::{Folder, run};
use std::path::Path;
use std::process::Command;

/// A driver that says, for each set of what it lacks, what is in its sample after a second of ticks.
const SOURCE: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(int argc, char **argv) {
    static const uint32_t sets[] = {LACKS};
    static hyst_driver driver;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    hyst_statement statement = {.version = HYST_STATEMENT_VERSION, .rate_hz = 1000.0f, .max_force_n = 1.0f};
    hyst_state(&driver, &statement);
    for (size_t set = 0; set < sizeof sets / sizeof *sets; set++) {
        hyst_sample sample;
        for (int tick = 0; tick < 1000; tick++) {
            hyst_sample fresh = {
                .pose = hyst_pose_of(0.1f, 0.2f, 0.3f, 0.04f),
                .controls = {.buttons = HYST_ENERGIZED, .inflow_valve = 1.0f, .outflow_valve = 0.25f, .set_pressure_pa = 9000.0f, .light = 1.0f, .focus_m = 0.02f},
            };
            sample = fresh;
            hyst_from_window(&driver, &sample, sets[set]);
        }
        const hyst_controls *it = &sample.controls;
        printf("%u %u %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", sample.from_window, it->buttons, it->inflow_valve, it->outflow_valve, it->set_pressure_pa,
               it->light, it->loop_extension_m, it->focus_m, sample.pose.camera_roll_rad);
    }
    return hyst_end(&driver);
}
"#;
/// A driver that says what is in its sample under the key of the current at first, and once that is off or 20 s have passed.
const SILENT: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(int argc, char **argv) {
    static hyst_driver driver;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    hyst_statement statement = {.version = HYST_STATEMENT_VERSION, .rate_hz = 1000.0f, .max_force_n = 1.0f};
    hyst_state(&driver, &statement);
    uint64_t end_ns = hyst_now_ns() + 20000000000u;
    hyst_sample sample = {.pose = hyst_pose_of(0.1f, 0.2f, 0.3f, 0.04f)};
    hyst_from_window(&driver, &sample, HYST_WINDOW_CURRENT);
    uint32_t first = sample.controls.buttons;
    while (sample.controls.buttons != 0 && hyst_now_ns() < end_ns) {
        hyst_wait(&driver, 1000000);
        hyst_from_window(&driver, &sample, HYST_WINDOW_CURRENT);
    }
    printf("%u %u\n", first, sample.controls.buttons);
    return hyst_end(&driver);
}
"#;
/// What the driver of [`SOURCE`] has itself, and how its scope is turned, rad.
const OWN: Controls = Controls {
    buttons: BUTTON_ENERGIZED,
    inflow_valve: 1.0,
    outflow_valve: 0.25,
    set_pressure_pa: 9_000.0,
    light: 1.0,
    loop_extension_m: 0.0,
    focus_m: 0.02,
};
const ROLL_RAD: f32 = 0.3;
/// How far the header moves a loop, m.
const REACH_M: f32 = 0.012;
/// Each of what can be lacked, all of it, and nothing.
const LACKS: [u32; 11] = [
    0,
    WINDOW_HEAD,
    WINDOW_LOOP,
    WINDOW_CURRENT,
    WINDOW_INFLOW,
    WINDOW_OUTFLOW,
    WINDOW_PRESSURE,
    WINDOW_LIGHT,
    WINDOW_FOCUS,
    WINDOW_COAGULATION,
    WINDOW_ALL & !WINDOW_POSE,
];

/// A station that has the pages of a driver and of a window, and no process.
pub(super) struct Empty {
    pub(super) station: Station,
    next: u32,
}

impl Empty {
    pub(super) fn new(name: &str) -> Empty {
        let station = Station::named(&format!("{name}-{}", std::process::id())).expect("a name");
        station.wipe();
        station.found().expect("a station");
        Empty { station, next: 3 }
    }

    fn incarnation(&mut self) -> u32 {
        self.next += 1;
        self.next
    }

    /// Another life of the window, which has said this.
    fn say(&mut self, pointer: &PointerRecord) {
        let (slot, incarnation) = (Slot::first(Role::Rendering), self.incarnation());
        self.station.create_slot(slot, incarnation).expect("its page").write(rendering::POINTER, pointer);
        self.station
            .open_for_keeping()
            .expect("the station's page")
            .store32(station::SLOT_INCARNATION + slot.number(), incarnation);
    }

    /// Exit code, stdout and stderr of another life of a driver.
    pub(super) fn run(&mut self, program: &Path) -> (Option<i32>, String, String) {
        self.run_under(&[], program)
    }

    /// The same under another command, which runs its arguments.
    pub(super) fn run_under(&mut self, wrapper: &[&str], program: &Path) -> (Option<i32>, String, String) {
        let (slot, incarnation) = (Slot::first(Role::Hardware), self.incarnation());
        self.station.create_slot(slot, incarnation).expect("its page");
        let words = ["--station", self.station.name(), "--slot", "hardware", "--incarnation", &incarnation.to_string()];
        run(Command::new("env").args(wrapper).arg(program).args(words))
    }

    /// What another life of a driver writes on stdout.
    pub(super) fn live(&mut self, program: &Path) -> String {
        let (code, out, said) = self.run(program);
        assert_eq!(code, Some(0), "{said}");
        out
    }

    /// The newest sample of the life that was last.
    pub(super) fn sample(&self) -> HardwareSample {
        let page = self.station.read_slot(Slot::first(Role::Hardware), self.next).expect("its page");
        page.cell(hardware::SAMPLE).expect("a sample").1
    }

    /// What another life of the driver has in its samples, for each of [`LACKS`]: what it lacks, its controls, and how the head is turned, rad.
    fn samples(&mut self, program: &Path) -> Vec<(u32, Controls, f32)> {
        let out = self.live(program);
        let read = |line: &str| {
            let word: Vec<f32> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
            let [from, buttons, inflow_valve, outflow_valve, set_pressure_pa, light, loop_extension_m, focus_m, head_rad] =
                word[..]
            else {
                panic!("{line}");
            };
            let buttons = buttons as u32;
            let controls = Controls { buttons, inflow_valve, outflow_valve, set_pressure_pa, light, loop_extension_m, focus_m };
            (from as u32, controls, head_rad)
        };
        out.lines().map(read).collect()
    }
}

impl Drop for Empty {
    fn drop(&mut self) {
        self.station.wipe();
    }
}

#[test]
fn a_driver_in_c_takes_from_the_windows_keys_what_its_device_lacks_and_nothing_else() {
    let folder = Folder::new("driver-window");
    let lacks = LACKS.map(|bits| bits.to_string()).join(", ");
    let source = folder.write("window.c", &SOURCE.replace("{LACKS}", &format!("{{{lacks}}}")));
    let program = compile(&folder, "window", Path::new(&source), &[]);
    let mut empty = Empty::new("keys");
    let as_it_is: Vec<_> = LACKS.iter().map(|bits| (*bits, OWN, 0.0)).collect();
    assert_eq!(empty.samples(&program), as_it_is, "there is no window");
    empty.say(&PointerRecord::default());
    assert_eq!(empty.samples(&program), as_it_is, "the window has said nothing yet");

    let controls = Controls {
        buttons: BUTTON_EXTENDED | BUTTON_COAGULATING,
        inflow_valve: 0.0,
        outflow_valve: 0.75,
        set_pressure_pa: 5_000.0,
        light: 0.5,
        loop_extension_m: 0.09,
        focus_m: 0.008,
    };
    let said = PointerRecord { sequence: 1, target: [0.7, 0.7, 0.7, 0.07, 0.1], controls };
    empty.say(&said);
    for (bits, (from, found, head_rad)) in LACKS.into_iter().zip(empty.samples(&program)) {
        let mut expected = OWN;
        expected.take(&controls, bits);
        let (loop_m, horizon_rad) = (found.loop_extension_m, head_rad + ROLL_RAD);
        assert_eq!((from, Controls { loop_extension_m: 0.0, ..found }), (bits, expected), "{bits:#x}");
        let out_m = if bits & WINDOW_LOOP != 0 { REACH_M } else { 0.0 };
        let wanted_rad = if bits & WINDOW_HEAD != 0 { 0.1 } else { ROLL_RAD };
        assert!(
            (loop_m - out_m).abs() < 1e-6 && (horizon_rad - wanted_rad).abs() < 1e-6,
            "{bits:#x}: {loop_m} m, {horizon_rad} rad"
        );
    }

    let none = f32::NAN;
    let (inflow_valve, outflow_valve, set_pressure_pa, light, focus_m) = (none, -1.0, f32::INFINITY, 7.0, 20.0);
    let nonsense = Controls {
        buttons: BUTTON_ENERGIZED,
        inflow_valve,
        outflow_valve,
        set_pressure_pa,
        light,
        loop_extension_m: none,
        focus_m,
    };
    empty.say(&PointerRecord { target: [none; 5], controls: nonsense, ..said });
    assert_eq!(empty.samples(&program), as_it_is, "what cannot be set stays as it is");
}

/// A window that died while its key was held had the current of a driver on until another one spoke.
#[test]
fn a_driver_in_c_takes_no_current_from_a_window_that_has_fallen_silent() {
    let folder = Folder::new("driver-silent");
    let program = compile(&folder, "silent", Path::new(&folder.write("silent.c", SILENT)), &[]);
    let mut empty = Empty::new("silent");
    let controls = Controls { buttons: BUTTON_ENERGIZED, ..Controls::default() };
    empty.say(&PointerRecord { sequence: 1, controls, ..PointerRecord::default() });
    assert_eq!(empty.live(&program), format!("{BUTTON_ENERGIZED} 0\n"));
}
