//! Promises of the process: bad arguments are one message and exit code 2; the page answers who has the token, at an address that outlives the process;
//! a port that is taken is no obstacle, and no stranger keeps others out. The test founds the station; there is no supervisor, and the page says so.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;

use hyst_engine::Address;
use hyst_exchange::{OwnedPage, Station, system};
use hyst_messages::page::{ProcessState, station as layout};
use hyst_messages::{Role, Slot};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::process::{Child, Command};

const BINARY: &str = env!("CARGO_BIN_EXE_console");

/// Looks within which something must have come, 2 ms apart at least: a minute on a machine that does nothing else.
const LOOKS: usize = 30_000;
/// Seats that the page has.
const SEATS: usize = 32;
/// What every answer says beside its content: so that the token is told to nobody, and the answer kept, framed and loaded by nobody.
const SEALS: [&str; 5] = [
    "referrer-policy: no-referrer",
    "cache-control: no-store",
    "x-frame-options: DENY",
    "x-content-type-options: nosniff",
    "cross-origin-resource-policy: same-origin",
];

fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    for _ in 0..LOOKS {
        if holds() {
            return;
        }
        system::sleep_ns(2_000_000);
    }
    panic!("waited for long enough: {what}");
}

/// A station without any other process.
struct Stage {
    station: Station,
    keeper: OwnedPage,
    child: Option<Child>,
}

impl Stage {
    fn new(name: &str, port: u16) -> Stage {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let keeper = station.open_for_keeping().unwrap();
        std::fs::write(station.settings(), format!("[set]\nconsole_port = \"{port}\"\n")).unwrap();
        Stage { station, keeper, child: None }
    }
    /// Where what consoles say is kept.
    fn log(&self) -> std::path::PathBuf {
        self.station.root().join("said")
    }
    /// Starts a console; gives its address once it is live.
    fn start(&mut self, incarnation: u32) -> Address {
        let slot = Slot::first(Role::Console);
        self.station.create_slot(slot, incarnation).unwrap();
        let words = ["--station", self.station.name(), "--slot", "console", "--incarnation", &incarnation.to_string()];
        let log = std::fs::File::options().create(true).append(true).open(self.log()).unwrap();
        self.child = Some(Command::new(BINARY).args(words).stderr(log).spawn().unwrap());
        self.keeper.store32(layout::SLOT_DEAD + slot.number(), 0);
        self.keeper.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
        self.keeper.bump_and_wake(layout::CHANGES);
        let page = self.station.read_slot(slot, incarnation).unwrap();
        wait_until("it is live", || {
            let ended = self.child.as_mut().and_then(|child| child.try_wait().ok()).flatten();
            assert!(ended.is_none() && page.state() != ProcessState::Failed, "{ended:?}: {}", page.last_words());
            page.state() == ProcessState::Live
        });
        Address::read(&self.station).unwrap()
    }
    fn kill(&mut self) {
        let mut child = self.child.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        self.keeper.store32(layout::SLOT_DEAD + Slot::first(Role::Console).number(), 1);
    }
    fn stop(&mut self) -> Option<i32> {
        self.keeper.store32(layout::STOP, 1);
        self.keeper.bump_and_wake(layout::CHANGES);
        self.child.take().unwrap().wait().unwrap().code()
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
        self.station.wipe();
    }
}

/// A connection on which that was sent.
fn open(port: u16, words: &str) -> TcpStream {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap();
    stream.write_all(words.as_bytes()).unwrap();
    stream
}

/// Sends a request and reads the whole answer: every answer ends its connection.
fn ask(port: u16, request: &str) -> String {
    let mut stream = open(port, request);
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

fn get(address: &Address, path: &str) -> String {
    ask(address.port, &format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", address.port))
}

#[test]
fn bad_arguments_are_refused() {
    cli::engine(BINARY, "console", "console");
}

#[test]
fn the_page_has_the_same_address_after_a_kill_and_says_that_no_supervisor_answers() {
    let mut stage = Stage::new("again", 0);
    let first = stage.start(1);
    let page = get(&first, &format!("/?token={}", first.token));
    assert!(page.starts_with("HTTP/1.1 200 ") && page.contains("<!DOCTYPE html>") && page.ends_with("</html>\n"), "{page}");
    for refused in [get(&first, "/"), get(&first, "/metrics"), get(&first, "/nowhere"), get(&first, "/?token=0")] {
        assert!(refused.starts_with("HTTP/1.1 401 "), "{refused}");
    }
    let metrics = |address: &Address| get(address, &format!("/metrics?token={}", address.token));
    wait_until("it has asked", || metrics(&first).contains("hystation_supervisor_answers 0.0\n"));
    stage.kill();
    let second = stage.start(2);
    assert_eq!(second, first);
    assert!(metrics(&second).ends_with("# EOF\n"));
    assert_eq!(stage.stop(), Some(0));
}

#[test]
fn a_port_that_is_taken_is_no_obstacle_and_the_other_one_is_kept() {
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let mut stage = Stage::new("taken", port);
    let first = stage.start(1);
    assert_ne!(first.port, port);
    drop(taken);
    stage.kill();
    let second = stage.start(2);
    assert_eq!(second, first, "it goes on where it was");
    assert!(get(&second, &format!("/?token={}", second.token)).starts_with("HTTP/1.1 200 "));
    assert_eq!(stage.stop(), Some(0));
}

#[test]
fn it_listens_at_one_address_of_this_machine_hears_one_request_of_each_connection_and_seals_every_answer() {
    let mut stage = Stage::new("alone", 0);
    let address = stage.start(1);
    let Address { port, token } = &address;
    // Every 127.x.y.z is this machine, too: who listens everywhere would be found there.
    assert!(TcpStream::connect((Ipv4Addr::new(127, 0, 0, 2), *port)).is_err());
    let request = |line: &str| format!("{line} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n");
    let (refused, good) = (request("GET /?token=0"), request(&format!("GET /metrics?token={token}")));
    for answer in [&refused, &good].map(|request| ask(*port, &format!("{request}\r\n"))) {
        let head = answer.split("\r\n\r\n").next().unwrap_or_default();
        assert!(SEALS.iter().all(|seal| head.lines().any(|line| line == *seal)), "{head}");
    }
    // What follows is never taken for a request of its own, whoever is said to have sent what comes before, and however long that is said to be.
    for first in [
        format!("{refused}\r\n"),
        format!("{good}\r\n"),
        format!("{refused}Content-Length: 3\r\n\r\nabc"),
        format!("{refused}Content-Length: 9\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"),
    ] {
        let mut stream = open(*port, &format!("{first}{good}\r\n"));
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer); // who sends more than is heard may be cut off behind the answer
        assert_eq!(
            String::from_utf8_lossy(&answer).matches("HTTP/1.1 ").count(),
            1,
            "{first}: {}",
            String::from_utf8_lossy(&answer)
        );
    }
    assert_eq!(stage.stop(), Some(0));
}

/// Whoever could open connections kept all seats for 20 s each, without a token, and browsers that had one waited.
#[test]
fn who_shows_no_token_gives_his_seat_up_before_who_does_and_one_line_says_that_all_were_taken() {
    let mut stage = Stage::new("strangers", 0);
    let address = stage.start(1);
    let Address { port, token } = &address;
    let mut browser =
        open(*port, &format!("GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAuthorization: Bearer {token}\r\n\r\n"));
    browser.read_exact(&mut [0]).unwrap(); // it has its seat, and the stream of events goes on for 15 s
    let words = ["", "GET / HTTP/1.1\r\nHost: ", "GET /?token=0 HTTP/1.1\r\nHost: 127.0.0.1:1\r\nContent-Length: 9000\r\n"];
    let strangers: Vec<TcpStream> = words.into_iter().cycle().take(SEATS).map(|words| open(*port, words)).collect();
    let answer = get(&address, &format!("/?token={token}"));
    assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
    browser.set_nonblocking(true).unwrap();
    let ended = browser.read_to_end(&mut Vec::new()).map_err(|error| error.kind());
    assert_eq!(ended, Err(std::io::ErrorKind::WouldBlock), "a seat was free only when the browser had given its own up");
    drop(strangers);
    let said = || std::fs::read_to_string(stage.log()).unwrap();
    wait_until("a line says it", || said().contains("all 32 seats of the operator's page are taken"));
    assert_eq!(said().matches("seats").count(), 1, "{}", said());
    assert_eq!(stage.stop(), Some(0));
}
