//! A program that a benchmark starts: what it says is read beside it, so that it never waits for a reader, and its end is waited for with a bound.

use crate::proc::await_end;
use crate::remains;
use crate::settings::Refusal;
use hyst_exchange::Station;
use std::io::Read;
use std::process::{Child, ExitStatus};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// How long one may take that nothing else bounds, ns: each takes some tens of seconds at most, and what takes ten times as long hangs.
pub const MOST_NS: u64 = 600_000_000_000;
/// How long one that was killed may take to be gone, ns: tear-down of 1 GB took 0.2 s.
const GONE_WITHIN_NS: u64 = 3_000_000_000;
/// What it has said is there when it has ended; whom it left its output is not waited for any longer than this.
const READ_WITHIN: Duration = Duration::from_secs(1);
/// Most that is kept of what it says, bytes: the rows of a benchmark are some ten thousand.
const MOST_BYTES: usize = 1 << 20;

/// What a program says on one of its outputs.
pub struct Said(Receiver<Vec<u8>>);

impl Said {
    /// Reads until the last who has the output open is gone. Of one that has none, or where no thread is to be had, nothing is known.
    pub fn of(output: Option<impl Read + Send + 'static>) -> Said {
        let (tell, told) = channel();
        if let Some(output) = output {
            let _ = std::thread::Builder::new().name("said".into()).spawn(move || pass_on(output, &tell));
        }
        Said(told)
    }

    /// All of it until now, for who knows that the program has ended.
    pub fn text(&self) -> String {
        let deadline = Instant::now() + READ_WITHIN;
        let mut bytes = Vec::new();
        while let Ok(more) = self.0.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
            bytes.extend(more);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// Goes on to read when enough is kept: who writes must not wait.
fn pass_on(mut output: impl Read, tell: &Sender<Vec<u8>>) {
    let (mut chunk, mut kept) = ([0; 4096], 0);
    while let Ok(length @ 1..) = output.read(&mut chunk) {
        if kept < MOST_BYTES {
            kept += length;
            let _ = tell.send(chunk[..length].to_vec()); // nobody may want to know
        }
    }
}

/// Waits for the end of a program; one that does not end in time is killed, and has no status.
pub fn ends_within(child: &mut Child, limit_ns: u64) -> Option<ExitStatus> {
    let status = await_end(child, limit_ns);
    if status.is_none() {
        end(child);
    }
    status
}

/// Kills a program, if it has not ended, and waits until it is gone.
pub fn end(child: &mut Child) {
    let _ = child.kill(); // gone is as good
    await_end(child, GONE_WITHIN_NS);
}

/// The error of a program that did not end in time; `what` it was.
pub fn endless(what: &str, limit_ns: u64) -> Refusal {
    let limit_s = limit_ns / 1_000_000_000;
    Refusal::failed(format!("{what} did not end within {limit_s} s and was killed; `hystation doctor` may say why"))
}

/// A station of a benchmark: whoever of it is left when this is dropped is ended, and what is left is removed.
pub struct Place(pub Station);

impl Place {
    /// One of this name, of which nothing is there yet.
    pub fn named(name: &str) -> Result<Place, Refusal> {
        Station::named(name).map(Place).map_err(|e| Refusal::failed(e.to_string()))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if !self.0.leftovers().is_empty() {
            remains::end_all(&self.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Stdio};

    #[test]
    fn what_a_program_said_is_known_at_its_end_though_somebody_else_has_its_output_still() {
        let mut child = Command::new("sh")
            .args(["-c", "exec 3<&0; echo said; cat <&3 & exit 3"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let said = Said::of(child.stdout.take());
        // `cat` ends with what it reads from, which is held here: who waited for the end of the output would wait for good.
        let held = child.stdin.take();
        assert_eq!(ends_within(&mut child, MOST_NS).and_then(|status| status.code()), Some(3));
        assert_eq!(said.text(), "said\n");
        drop(held);
    }

    #[test]
    fn a_program_that_floods_its_output_ends_and_the_first_of_it_is_kept() {
        let script = format!("head -c {} /dev/zero", 3 * MOST_BYTES);
        let mut child = Command::new("sh").args(["-c", &script]).stdout(Stdio::piped()).spawn().unwrap();
        let said = Said::of(child.stdout.take());
        assert_eq!(ends_within(&mut child, MOST_NS).and_then(|status| status.code()), Some(0));
        assert!((MOST_BYTES..2 * MOST_BYTES).contains(&said.text().len()));
    }

    #[test]
    fn a_program_that_does_not_end_in_time_is_killed() {
        let mut child = Command::new("sleep").arg("600").spawn().unwrap();
        assert_eq!(ends_within(&mut child, 0), None);
        let status = child.try_wait().unwrap();
        assert_eq!(status.and_then(|status| status.signal()), Some(9), "{status:?}");
        assert!(endless("it", MOST_NS).message.contains("within 600 s"));
    }
}
