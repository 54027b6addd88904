//! The engines as threads of one process, which `hystation bench station` compares the station with: they do the same work there, all of
//! them, and leave nothing behind.

use hyst_exchange::{ReadPage, Station};
use hyst_messages::page::{hardware, header};
use hyst_messages::{Role, Slot};
use station_tests::{RECOVERY_LIMIT, START_LIMIT, STOP_LIMIT, wait_for};
use std::process::{Command, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_engines-as-threads");
/// All engines that are threads there.
const ENGINES: [(Role, usize); 6] =
    [(Role::Hardware, 1), (Role::Device, 1), (Role::Haptic, 2), (Role::Tissue, 2), (Role::Fluid, 2), (Role::CollisionWorker, 2)];
/// Steps that every engine must make.
const STEPS: u64 = 20;

fn page(station: &Station, slot: Slot) -> Option<ReadPage> {
    let incarnation = station.open().ok()?.incarnation(slot);
    station.read_slot(slot, incarnation).ok()
}

fn slots() -> impl Iterator<Item = Slot> {
    ENGINES.into_iter().flat_map(|(role, count)| (0..count).filter_map(move |index| Slot::new(role, index)))
}

#[test]
fn all_engines_work_as_threads_of_one_process_and_leave_nothing() {
    let station = Station::named(&format!("threads-{}", std::process::id())).unwrap();
    let mut child = Command::new(PROGRAM)
        .args(["--station", station.name()])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary is built with its tests");
    let is_ready = |slot: Slot| page(&station, slot).is_some_and(|page| page.state().is_ready());
    let ready = wait_for(START_LIMIT, || slots().all(is_ready).then_some(()));
    let steps = |slot: Slot| page(&station, slot).map_or(0, |page| page.load64(header::STEPS));
    let before: Vec<u64> = slots().map(steps).collect();
    let all = || slots().zip(&before).all(|(slot, before)| steps(slot) >= before + STEPS);
    let worked = wait_for(RECOVERY_LIMIT, || all().then_some(()));
    let fresh = page(&station, Slot::first(Role::Hardware))
        .map_or(0, |page| page.load64(hardware::TOTALS + hardware::Total::Fresh as usize));
    let pid = rustix::process::Pid::from_raw(child.id() as i32).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let ended = wait_for(STOP_LIMIT, || child.try_wait().ok().flatten());
    let _ = child.kill(); // only if it did not end, which fails below
    let left = station.leftovers();
    station.wipe();
    assert!(ready.is_some() && worked.is_some(), "steps before: {before:?}");
    assert!(fresh > 0, "no force has come to the hand");
    assert_eq!(ended.and_then(|status| status.code()), Some(0));
    assert_eq!(left, Vec::<std::path::PathBuf>::new());
}

#[test]
fn bad_arguments_are_refused_and_nothing_is_founded() {
    for (words, word) in
        [(&[][..], "--station"), (&["--station", "x", "--colour"], "--colour"), (&["--station", "NO SUCH"], "name")]
    {
        let output = Command::new(PROGRAM).args(words).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains(word), "{words:?}: {said}");
    }
}
