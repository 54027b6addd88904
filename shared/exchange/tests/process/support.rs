//! A station and partner processes for one test. Times are hang detectors only: generous, and never part of a promise.

use hyst_exchange::{OwnedPage, Station, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use rustix::process::{Pid, Signal, WaitIdOptions};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

const INNER: &str = "EXCHANGE_TEST_INNER";
/// A test that has not ended by then hangs.
const HANG: Duration = Duration::from_secs(240);
/// Far enough for every wait that is expected to end by itself, ns.
pub const LONG_NS: u64 = 60_000_000_000;

/// A deadline that no healthy partner misses, CLOCK_MONOTONIC ns.
pub fn far_ns() -> u64 {
    system::now_ns() + LONG_NS
}

struct Wiped(Station);
impl Drop for Wiped {
    fn drop(&mut self) {
        self.0.wipe();
    }
}

/// Runs the body of `test` in a process of its own, with a newly founded station, and asserts that wiping leaves nothing behind: the
/// configuration of iceoryx2 is global to a process, and so are file descriptors.
pub fn isolated<T>(test: T, body: impl FnOnce(&Station)) {
    isolated_after(test, &[], body);
}

/// The same with a /dev/shm of its own, of so many MiB. Nothing is tried where that needs rights that are not there.
pub fn isolated_in<T>(test: T, mib: u32, body: impl FnOnce(&Station)) {
    let mount = format!("mount -t tmpfs -o size={mib}m small /dev/shm");
    let own = |then: &str| ["unshare", "-m", "sh", "-c", &format!("{mount} && {then}")].map(String::from);
    let is_inner = std::env::var_os(INNER).is_some();
    let may = || Command::new("unshare").args(&own("true")[1..]).output().is_ok_and(|tried| tried.status.success());
    if is_inner || may() {
        isolated_after(test, &own("exec \"$0\" \"$@\""), body);
    } else {
        assert!(!rustix::process::geteuid().is_root(), "root may mount a file system");
    }
}

/// `before`: what is started with the test's own command behind it, and becomes that.
fn isolated_after<T>(_test: T, before: &[String], body: impl FnOnce(&Station)) {
    let path = std::any::type_name::<T>();
    let name = path.split_once("::").expect("a path").1;
    if std::env::var(INNER).is_ok_and(|inner| inner == name) {
        std::thread::spawn(|| {
            std::thread::sleep(HANG); // not a synchronization: the end of a test that hangs
            eprintln!("the test hangs");
            std::process::abort();
        });
        let station = Wiped(Station::named(&format!("t{}", std::process::id())).unwrap());
        station.0.wipe();
        station.0.found().unwrap();
        body(&station.0);
        station.0.wipe();
        assert_eq!(station.0.leftovers(), Vec::<std::path::PathBuf>::new());
        return;
    }
    let own = std::env::current_exe().unwrap();
    let mut inner = match before {
        [] => Command::new(own),
        [program, arguments @ ..] => {
            let mut inner = Command::new(program);
            inner.args(arguments).arg(own);
            inner
        }
    };
    let child = inner
        .args(["--exact", name, "--nocapture", "--test-threads=1"])
        .env(INNER, name)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let child = child.spawn().unwrap();
    let station = Wiped(Station::named(&format!("t{}", child.id())).unwrap());
    let output = child.wait_with_output().unwrap();
    drop(station); // what an aborted test left
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && said.contains("1 passed"), "{name}: {}\n{said}", output.status);
}

/// A partner process; killed and reaped when dropped.
pub struct Partner {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Partner {
    /// Starts the partner in a role; see `exchange-partner`.
    pub fn start(station: &Station, role: &str, incarnation: u32, fate: &str, argument: u32) -> Partner {
        let mut child = Command::new(env!("CARGO_BIN_EXE_exchange-partner"))
            .args([role, station.name(), &incarnation.to_string(), fate, &argument.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (input, output) = (child.stdin.take(), BufReader::new(child.stdout.take().unwrap()));
        Partner { child, input, output }
    }
    /// Waits for the next line and compares it.
    pub fn expect(&mut self, line: &str) {
        assert_eq!(self.hear(), line);
    }
    /// The next line; empty at the partner's end.
    pub fn hear(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        line.trim().to_string()
    }
    /// Tells it to go on; a partner that is already dead does not hear it.
    pub fn tell(&mut self, line: &str) {
        let _ = writeln!(self.input.as_mut().unwrap(), "{line}");
    }
    fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }
    /// Waits until it has killed itself, and reaps it.
    pub fn await_death(&mut self) {
        let status = self.child.wait().unwrap();
        assert!(!status.success(), "the partner should have died of a signal: {status}");
    }
    /// Kills it from outside, and reaps it.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
    /// Waits for its own end if its fate is one that it meets, and ends it otherwise.
    pub fn kill_or_await(&mut self, fate: &str) {
        if fate == "kill@before-request" { self.kill() } else { self.await_death() }
    }
    /// Stops it from outside, and waits until it stands.
    pub fn stop(&self) {
        rustix::process::kill_process(self.pid(), Signal::STOP).unwrap();
        self.await_stop();
    }
    /// Waits until it stands.
    pub fn await_stop(&self) {
        let stopped =
            rustix::process::waitid(rustix::process::WaitId::Pid(self.pid()), WaitIdOptions::STOPPED | WaitIdOptions::NOWAIT);
        assert!(stopped.unwrap().is_some_and(|status| status.stopped()), "the partner should stand");
    }
    /// Lets it go on.
    pub fn go_on(&self) {
        rustix::process::kill_process(self.pid(), Signal::CONT).unwrap();
    }
}

impl Drop for Partner {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Does what the supervisor does when a process takes a slot.
pub fn announce(keeper: &OwnedPage, slot: Slot, incarnation: u32) {
    keeper.store32(layout::SLOT_DEAD + slot.number(), 0);
    keeper.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
    keeper.bump_and_wake(layout::CHANGES);
}

/// Does what the supervisor does when it has reaped the process of a slot.
pub fn declare_dead(keeper: &OwnedPage, slot: Slot) {
    keeper.store32(layout::SLOT_DEAD + slot.number(), 1);
    keeper.bump_and_wake(layout::CHANGES);
}

/// The slot that partners in a role take.
pub fn slot(role: Role) -> Slot {
    Slot::first(role)
}

/// Numbers from a seed (splitmix64).
pub struct Seeded(pub u64);
impl Seeded {
    pub fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % bound
    }
}

/// Looks until `ready` gives something; a hang is ended by the test's own limit.
pub fn until<T>(mut ready: impl FnMut() -> Option<T>) -> T {
    loop {
        if let Some(value) = ready() {
            return value;
        }
        std::thread::yield_now();
    }
}
