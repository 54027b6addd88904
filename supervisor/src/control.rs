//! The control socket: a Unix stream in the station's root, for its user alone. One line of JSON asks, one line of JSON answers.
//!
//! Promise: whatever is sent, the answer is a line of JSON with a key `ok`; a line that is too long, a connection too many or a client
//! that sends nothing or does not read is ended; none of them holds another one or the supervisor, which only ever sees whole and valid requests.
//!
//! A command may be of another build than the supervisor that runs. A fault or a swap with a key that this one does not know is refused, and never done without
//! it; to answers keys are only ever added, and whoever asks takes what is missing for not said ([`crate::struck`]).

mod ask;

pub use ask::{NoAnswer, ask, ask_once};

use crate::faultfile::Injection;
use crate::keepers::Suffered;
use crate::struck::{NotDone, Struck};
use crate::supervise::Input;
use hyst_exchange::Station;
use rustix::event::{PollFd, PollFlags, Timespec};
use serde::{Deserialize, Serialize};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::{Duration, Instant};

/// Longest request or answer line that is accepted, bytes.
pub const MOST_BYTES: usize = 64 * 1024;
/// Clients that are waited for at the same time; the oldest makes room for a newcomer.
const MOST_CLIENTS: usize = 64;
/// Requests that the main loop may have at the same time: it takes deaths first, and these one at a time.
const MOST_ASKED: usize = 8;
/// Connections that are taken between two looks at those that wait.
const MOST_ACCEPTED: usize = 256;
/// A client that has not sent a line by then is ended.
const PATIENCE: Duration = Duration::from_secs(2);
/// The main loop answers within milliseconds.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// A client that has not taken its answer by then loses the rest of it.
const HEARD_WITHIN: Duration = Duration::from_secs(10);
/// Between two looks at the clients.
const LOOK: Duration = Duration::from_millis(5);

/// What can be asked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// The processes.
    Status,
    /// The report as it is now.
    Report,
    /// Stop everything.
    Stop,
    /// Inject a fault.
    Fault(Injection),
    /// Note what was done to one who keeps the station, by whoever asks.
    Suffered(Suffered),
    /// The kinds of faults that there are.
    Kinds,
    /// Put another engine in the place of a role's.
    Swap {
        /// The role.
        role: String,
        /// Its new binary, absolute; whoever asks has verified it.
        binary: std::path::PathBuf,
    },
}

/// An answer that carries a value.
pub fn good(value: serde_json::Value) -> String {
    serde_json::json!({ "ok": true, "value": value }).to_string()
}

/// An answer that carries an error.
pub fn bad(reason: &str) -> String {
    serde_json::json!({ "ok": false, "error": reason }).to_string()
}

/// An answer that carries why something was done by half. Who was built before there were such answers takes it for a refusal.
pub fn half(reason: &str) -> String {
    serde_json::json!({ "ok": false, "error": reason, "half": true }).to_string()
}

/// The answer to a fault.
pub fn struck(struck: Result<Struck, NotDone>) -> String {
    match struck {
        Ok(struck) => good(serde_json::json!(struck)),
        Err(NotDone { reason, is_half: true }) => half(&reason),
        Err(NotDone { reason, is_half: false }) => bad(&reason),
    }
}

/// The answer to something that is to be done.
pub fn done(done: Result<(), String>) -> String {
    done.map_or_else(|reason| bad(&reason), |()| good(serde_json::json!({})))
}

/// Starts the thread that serves the socket.
pub fn serve(station: &Station, tell: Sender<Input>) -> std::io::Result<()> {
    let path = station.control_socket();
    let _ = std::fs::remove_file(&path); // of a supervisor before this one
    let listener = UnixListener::bind(&path)?;
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
    listener.set_nonblocking(true)?;
    std::thread::Builder::new().name("control".into()).spawn(move || body(&listener, &tell))?;
    Ok(())
}

/// Whether this user, or root, is at the other end. The root of the station is closed to others too; this holds if somebody opens it.
pub fn is_own(stream: &UnixStream) -> bool {
    rustix::net::sockopt::socket_peercred(stream)
        .is_ok_and(|peer| peer.uid.as_raw() == hyst_exchange::system::user_id() || peer.uid.is_root())
}

struct Client {
    stream: UnixStream,
    since: Instant,
    stage: Stage,
}

/// How far a client is. Nobody is waited for in any of them: all are looked at in turn.
enum Stage {
    /// It has sent so much of its line.
    Asks(Vec<u8>),
    /// The main loop has its request.
    Waits(Receiver<String>),
    /// It has been told so many bytes of its answer.
    Hears(Vec<u8>, usize),
}

fn body(listener: &UnixListener, tell: &Sender<Input>) {
    let mut clients: Vec<Client> = Vec::new();
    loop {
        for _ in 0..MOST_ACCEPTED {
            let Ok((stream, _)) = listener.accept() else { break };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            let is_own = is_own(&stream);
            let mut client = Client { stream, since: Instant::now(), stage: Stage::Asks(Vec::new()) };
            if !is_own {
                client.tell(&bad("this station belongs to another user"));
            }
            // Most have sent their line by now.
            if client.tend(tell, waiting(&clients) < MOST_ASKED) {
                if clients.len() >= MOST_CLIENTS {
                    // The one that has said nothing for longest, or is slow to hear; who waits for the main loop may have had done what it asks for.
                    let of = |is: fn(&Stage) -> bool| clients.iter().position(|client| is(&client.stage));
                    let silent = of(|stage| matches!(stage, Stage::Asks(_)));
                    match silent.or_else(|| of(|stage| matches!(stage, Stage::Hears(..)))) {
                        Some(at) => drop(clients.remove(at)),
                        None => continue,
                    }
                }
                clients.push(client);
            }
        }
        let mut waiting = waiting(&clients);
        clients.retain_mut(|client| {
            let waited = usize::from(matches!(client.stage, Stage::Waits(_)));
            let is_kept = client.tend(tell, waiting < MOST_ASKED);
            waiting = waiting + usize::from(matches!(client.stage, Stage::Waits(_))) - waited;
            is_kept
        });
        // Sockets and replies are looked at in turn; an answer of the main loop is there within a millisecond, and is not to wait for the usual look.
        std::thread::sleep(if waiting > 0 { LOOK / 5 } else { LOOK });
    }
}

/// Clients whose requests the main loop has.
fn waiting(clients: &[Client]) -> usize {
    clients.iter().filter(|client| matches!(client.stage, Stage::Waits(_))).count()
}

impl Client {
    /// Takes it as far as it goes now; false when it is done with. Its request stays with it unless it `may_ask`.
    fn tend(&mut self, tell: &Sender<Input>, may_ask: bool) -> bool {
        // Each stage is left at most once.
        loop {
            let is_over = match &mut self.stage {
                Stage::Asks(line) => match read_line(&mut self.stream, line) {
                    Ok(None) => return self.since.elapsed() < PATIENCE,
                    Ok(Some(end)) => match serde_json::from_slice::<Request>(&line[..end]) {
                        // Who has hung up meanwhile takes nobody's place.
                        Ok(_) if !may_ask => return !has_hung_up(&self.stream) && self.since.elapsed() < ANSWER_WITHIN,
                        Ok(request) => {
                            let (reply, inbox) = channel();
                            // If nobody is there to take it, the reply's end is dropped, and that is seen below.
                            let _ = tell.send(Input::Request(request, reply));
                            (self.stage, self.since) = (Stage::Waits(inbox), Instant::now());
                            None
                        }
                        Err(error) => Some(bad(&format!("not a request: {error}"))),
                    },
                    Err(LineError::TooLong) => Some(bad("the line is longer than 64 KiB")),
                    Err(LineError::Gone) => return false,
                },
                Stage::Waits(inbox) => match inbox.try_recv() {
                    Ok(answer) => Some(answer),
                    Err(TryRecvError::Empty) if self.since.elapsed() < ANSWER_WITHIN => return true,
                    Err(_) => Some(
                        serde_json::json!({ "ok": false, "error": "the supervisor is busy", "unanswered": true }).to_string(),
                    ),
                },
                Stage::Hears(answer, told) => match self.stream.write(&answer[*told..]) {
                    Ok(count) => {
                        *told += count;
                        if count == 0 || *told == answer.len() {
                            return false;
                        }
                        None
                    }
                    Err(error) if error.kind() == ErrorKind::Interrupted => None,
                    Err(error) => return error.kind() == ErrorKind::WouldBlock && self.since.elapsed() < HEARD_WITHIN,
                },
            };
            if let Some(answer) = is_over {
                self.tell(&answer);
            }
        }
    }

    fn tell(&mut self, answer: &str) {
        (self.stage, self.since) = (Stage::Hears(format!("{answer}\n").into_bytes(), 0), Instant::now());
    }
}

/// Whether nobody is at the other end any more; one that has only sent all that it had still listens.
fn has_hung_up(stream: &UnixStream) -> bool {
    let mut asked = [PollFd::new(stream, PollFlags::empty())];
    let polled = rustix::event::poll(&mut asked, Some(&Timespec::default()));
    polled.is_ok() && asked[0].revents().contains(PollFlags::HUP)
}

enum LineError {
    TooLong,
    Gone,
}

/// Reads what is there; gives where the line ends, once it does.
fn read_line(stream: &mut UnixStream, line: &mut Vec<u8>) -> Result<Option<usize>, LineError> {
    if let Some(end) = line.iter().position(|byte| *byte == b'\n') {
        return Ok(Some(end)); // it was not its turn yet
    }
    let mut buffer = [0u8; 4096];
    // At most one line's worth in one look.
    for _ in 0..=MOST_BYTES / buffer.len() {
        match stream.read(&mut buffer) {
            Ok(0) => return Err(LineError::Gone),
            Ok(count) => {
                line.extend_from_slice(&buffer[..count]);
                match line.iter().position(|byte| *byte == b'\n') {
                    Some(end) if end <= MOST_BYTES => return Ok(Some(end)),
                    None if line.len() <= MOST_BYTES => {}
                    _ => return Err(LineError::TooLong),
                }
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => break,
            Err(_) => return Err(LineError::Gone),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of an answer that no socket's buffer takes.
    const LARGE: usize = 4 << 20;

    fn raw(path: &std::path::Path, bytes: &[u8]) -> String {
        let mut stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let _ = stream.write_all(bytes); // a line that is too long is cut off in the middle
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[test]
    fn the_main_loop_never_has_more_than_a_few_requests_and_everybody_who_waits_gets_an_answer() {
        let station = Station::named(&format!("t{}-crowd", std::process::id())).unwrap();
        station.wipe();
        std::fs::create_dir(station.root()).unwrap();
        let (tell, inbox) = channel();
        serve(&station, tell).unwrap();
        let path = station.control_socket();
        // Half of them hang up: those beyond the few take nobody's place.
        let ask = |hangs_up: bool| {
            let mut stream = UnixStream::connect(&path).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            stream.write_all(b"{\"do\":\"report\"}\n").unwrap();
            (!hangs_up).then_some(stream)
        };
        let waiting: Vec<UnixStream> = (0..MOST_CLIENTS / 2).filter_map(|index| ask(index % 2 == 0)).collect();
        let answer_of = |mut stream: UnixStream| {
            let mut answer = String::new();
            stream.read_to_string(&mut answer).map(|_| answer)
        };
        let everybody = std::thread::spawn(move || waiting.into_iter().map(answer_of).collect::<Vec<_>>());
        let mut most = 0;
        // Until everybody has an answer, however long the thread that takes their requests gets no time.
        while !everybody.is_finished() {
            let mut asked = Vec::new();
            while let Ok(Input::Request(_, reply)) = inbox.recv_timeout(4 * LOOK) {
                asked.push(reply);
            }
            most = most.max(asked.len());
            asked.into_iter().for_each(|reply| drop(reply.send(good(serde_json::json!(1)))));
        }
        assert!((2..=MOST_ASKED).contains(&most), "{most}");
        for answer in everybody.join().unwrap() {
            assert!(answer.as_ref().is_ok_and(|answer| answer.contains("true")), "{answer:?}");
        }
        station.wipe();
    }

    #[test]
    fn garbage_gets_an_error_and_a_request_an_answer() {
        let station = Station::named(&format!("t{}-control", std::process::id())).unwrap();
        station.wipe();
        std::fs::create_dir(station.root()).unwrap();
        let (tell, inbox) = channel();
        serve(&station, tell).unwrap();
        let (say_asked, asked) = channel();
        std::thread::spawn(move || {
            for input in inbox {
                if let Input::Request(request, reply) = input {
                    let answer = match request {
                        Request::Report => good("x".repeat(LARGE).into()),
                        Request::Kinds => half("one of two"),
                        _ => good(serde_json::json!(request == Request::Status)),
                    };
                    let _ = reply.send(answer);
                    if request == Request::Report {
                        let _ = say_asked.send(());
                    }
                }
            }
        });
        let path = station.control_socket();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        // The last two are of a later build: it means something by that key, and must not be taken for one that does not.
        let garbage: [&[u8]; 7] = [
            b"\n",
            b"{}\n",
            b"\xff\xfe\n",
            b"{\"do\":\"dance\"}\n",
            b"{\"do\":\"fault\",\"kind\":1}\n",
            b"{\"do\":\"fault\",\"kind\":\"kill\",\"target\":\"fluid\",\"tick\":0,\"state\":\"idle\"}\n",
            b"{\"do\":\"swap\",\"role\":\"fluid\",\"binary\":\"/x\",\"when\":1}\n",
        ];
        for line in garbage {
            assert!(raw(&path, line).starts_with("{\"error\""), "{line:?}");
        }
        assert_eq!(ask_once(&station, &Request::Kinds), Err(NoAnswer::Half("one of two".into())));
        assert!(raw(&path, b"{\"do\":\"kinds\"}\n").contains("\"ok\":false"), "a refusal to whoever knows no halves");
        raw(&path, &vec![b'x'; MOST_BYTES * 2]);
        assert_eq!(ask(&station, &Request::Status), Ok(serde_json::json!(true)));
        let _idle: Vec<UnixStream> = (0..MOST_CLIENTS / 2).map(|_| UnixStream::connect(&path).unwrap()).collect();
        assert_eq!(ask(&station, &Request::Stop), Ok(serde_json::json!(false)), "idle clients hold nobody");
        // One who asks for what fills its socket many times over, and does not read.
        let mut deaf = UnixStream::connect(&path).unwrap();
        deaf.write_all(format!("{}\n", serde_json::to_string(&Request::Report).unwrap()).as_bytes()).unwrap();
        asked.recv().unwrap();
        // A server that waited for the deaf one would give it up in the end, and what is heard below would be cut off.
        assert_eq!(ask(&station, &Request::Stop), Ok(serde_json::json!(false)), "nor do deaf ones");
        let mut heard = String::new();
        deaf.read_to_string(&mut heard).unwrap();
        assert!(heard.len() > LARGE && heard.ends_with("}\n"), "who reads late gets the whole answer: {}", heard.len());
        station.wipe();
    }
}
