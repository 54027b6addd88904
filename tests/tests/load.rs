//! Priority inversion and starvation: what is less important costs the real-time roles nothing.

use rustix::process::Signal;
use station_tests::Station;
use std::process::{Child, Command, Stdio};

/// Ticks of each window. Windows with and without the load alternate, so that the host's noise falls on both.
const WINDOW_TICKS: u64 = 1_500;
/// Pairs of windows.
const PAIRS: usize = 4;
/// Share of the ticks that the load may cost more than the control windows lose: a starved servo loses all of them.
const ALLOWED: f64 = 0.01;

/// Ordinary processes that spin, ended when dropped.
struct Spinners(Vec<Child>);

impl Spinners {
    fn start(count: usize) -> Spinners {
        let spin = || Command::new("sh").args(["-c", "while :; do :; done"]).stdin(Stdio::null()).spawn().expect("sh");
        Spinners((0..count).map(|_| spin()).collect())
    }
}

impl Drop for Spinners {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn missed_in_window(station: &Station) -> (u64, u64) {
    let before = station.ledger();
    station.run_ticks(WINDOW_TICKS);
    let after = station.ledger();
    (after.0 - before.0, after.1 - before.1)
}

fn compare(station: &Station, mut begin: impl FnMut(&Station), mut end: impl FnMut(&Station)) {
    let (mut control, mut load) = ((0, 0), (0, 0));
    for _ in 0..PAIRS {
        let window = missed_in_window(station);
        control = (control.0 + window.0, control.1 + window.1);
        begin(station);
        let window = missed_in_window(station);
        load = (load.0 + window.0, load.1 + window.1);
        end(station);
    }
    println!("control: {} of {} ticks missed; with the load: {} of {}", control.1, control.0, load.1, load.0);
    let share = |(ticks, missed): (u64, u64)| missed as f64 / ticks.max(1) as f64;
    assert!(control.0 > 0 && load.0 > 0, "no ticks: {control:?} {load:?}\n{}", station.said());
    assert!(share(load) - share(control) <= ALLOWED, "control {control:?}, load {load:?}\n{}", station.said());
}

#[test]
fn ordinary_processes_that_spin_on_every_core_cost_the_hand_nothing() {
    let station = Station::start("spin", &["--hand", "script:press"]);
    let mut spinners = None;
    let cell = std::cell::RefCell::new(&mut spinners);
    compare(&station, |_| **cell.borrow_mut() = Some(Spinners::start(4)), |_| **cell.borrow_mut() = None);
    let ended = station.stop();
    ended.assert_clean();
    for process in ["hardware", "device", "haptic:0", "haptic:1"] {
        let allocations = ended.number(&format!("processes.{process}.allocations"));
        assert_eq!(allocations, 0.0, "{process}: allocations of the real-time thread since it became one");
    }
}

/// Rendering reads the tissue's state and holds samples of it; stopped, it is a stalled reader and a client that never fetches its answer.
#[test]
fn a_stalled_reader_and_client_costs_the_hand_nothing() {
    let station = Station::start("stall", &["--hand", "script:press"]);
    let stop = |station: &Station| station.signal(station.pid("rendering", true), Signal::STOP);
    let go_on = |station: &Station| {
        station.signal(station.pid("rendering", true), Signal::CONT);
        station.recover();
    };
    compare(&station, stop, go_on);
    station.stop().assert_clean();
}
