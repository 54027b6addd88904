//! Whether a file is an engine that may be started in a station: looked at before anything of the station is touched. It is asked what it is
//! (`--describe`), as an ordinary process and for a bounded time; what it says must be of this role, layout and interface, word for word.

use crate::life::{DESCRIBE, Description};
use hyst_exchange::system;
use hyst_messages::Role;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// What a program has said is there when it has ended.
const READ_WITHIN: Duration = Duration::from_secs(1);
/// How long an engine may take to say what it is: a loader on a busy machine.
const ANSWER_WITHIN_NS: u64 = 10_000_000_000;
/// How long a process that was killed may take to be gone, ns: tear-down of 1 GB takes 0.2 s.
const GONE_WITHIN_NS: u64 = 5_000_000_000;
/// Between two looks whether a child has ended, ns.
const BETWEEN_LOOKS_NS: u64 = 5_000_000;
/// Longest answer that is read, bytes.
const MOST_BYTES: u64 = 4 * 1024;
/// Most characters of its complaint that are quoted.
const MOST_CHARACTERS: usize = 200;
/// First bytes of a program of this system.
const ELF: [u8; 4] = *b"\x7fELF";

/// Bytes of the head of a 64-bit ELF file.
const HEAD_BYTES: usize = 64;

/// How long a program is at least, by its head: the table of its sections comes last, after what a start needs.
fn least_bytes(head: &[u8; HEAD_BYTES]) -> u64 {
    let short = |at: usize| u64::from(u16::from_le_bytes([head[at], head[at + 1]]));
    let table = u64::from_le_bytes(std::array::from_fn(|index| head[0x28 + index]));
    table.saturating_add(short(0x3a) * short(0x3c))
}

/// Checks a file; the error says what is wrong with it. Where that is given up meanwhile the process that was asked what it is is ended, as one that does not
/// answer: it leads a process group of its own, which no Ctrl-C reaches, and would outlive whoever asked.
pub fn verify(path: &Path, role: Role, given_up: &dyn Fn() -> bool) -> Result<Description, String> {
    let name = path.display();
    let found = std::fs::metadata(path).map_err(|error| format!("{name}: {error}"))?;
    if !found.is_file() {
        return Err(format!("{name} is no file; name the engine's binary"));
    }
    if found.permissions().mode() & 0o111 == 0 {
        return Err(format!("{name} may not be executed; `chmod +x {name}`"));
    }
    let mut head = [0u8; HEAD_BYTES];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut head));
    if read.is_err() || !head.starts_with(&ELF) {
        return Err(format!("{name} is no program of this machine (no ELF file); name the engine's binary"));
    }
    if least_bytes(&head) > found.len() {
        return Err(format!("{name} is truncated: {} bytes of at least {}; is it damaged?", found.len(), least_bytes(&head)));
    }
    let said = ask(path, given_up)?;
    let description: Description = serde_json::from_str(said.trim())
        .map_err(|error| format!("{name} {DESCRIBE} does not say what it is ({error}); is it an engine?"))?;
    agrees(&description, &Description::of(role)).map_err(|reason| format!("{name} {reason}"))?;
    Ok(description)
}

/// Whether an engine says of itself what is wanted.
pub fn agrees(said: &Description, wanted: &Description) -> Result<(), String> {
    let cure = "build it from the sources that the station was built from";
    if said.engine_of != wanted.engine_of {
        return Err(format!("is an engine of {:?}, not of {:?}", said.engine_of, wanted.engine_of));
    }
    if said.role != wanted.role {
        return Err(format!("is a {}, not a {}", said.role, wanted.role));
    }
    if (said.layout, &said.layout_hash) != (wanted.layout, &wanted.layout_hash) {
        return Err(format!(
            "has layout {}/{}, the station has {}/{}; {cure}",
            said.layout, said.layout_hash, wanted.layout, wanted.layout_hash
        ));
    }
    if said.interface != wanted.interface {
        return Err(format!("has interface {}, the station has {}; {cure}", said.interface, wanted.interface));
    }
    Ok(())
}

/// What a program says of itself.
fn ask(path: &Path, given_up: &dyn Fn() -> bool) -> Result<String, String> {
    let name = path.display();
    let started = Command::new(path)
        .arg(DESCRIBE)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn();
    let mut child = started.map_err(|error| format!("{name} cannot be started: {error}; is it damaged?"))?;
    let complaint = head_of(child.stderr.take());
    let out = child.stdout.take();
    // A program that floods its output waits until it is killed; one that leaves its output to a child of its own is not waited for.
    let (tell, told) = channel();
    std::thread::spawn(move || {
        let mut text = String::new();
        let read = out.map(|out| out.take(MOST_BYTES).read_to_string(&mut text));
        let _ = tell.send(read.is_some_and(|read| read.is_ok()).then_some(text)); // nobody waits any more
    });
    let status = wait_unless(&mut child, ANSWER_WITHIN_NS, given_up);
    let text = told.recv_timeout(READ_WITHIN).ok().flatten();
    match status {
        None if matches!(child.try_wait(), Ok(None)) => {
            let pid = child.id();
            Err(format!("{name} {DESCRIBE} did not end and cannot be ended (process {pid}); does the disk that it is on answer?"))
        }
        None if given_up() => Err(format!("{name} {DESCRIBE} was given up before it had ended")),
        None => Err(format!("{name} {DESCRIBE} did not end within {} s; is it an engine?", ANSWER_WITHIN_NS / 1_000_000_000)),
        Some(status) if !status.success() => {
            let said = complaint.recv_timeout(READ_WITHIN).ok().and_then(|head| first_line(&head));
            let said = said.map_or(String::new(), |line| format!(" ({line})"));
            Err(format!("{name} {DESCRIBE} ended with {status}{said}; is it an engine?"))
        }
        Some(_) => text.ok_or_else(|| format!("{name} {DESCRIBE} says what is no text; is it an engine?")),
    }
}

/// What comes out of a pipe first. Whatever comes after that is taken and dropped: who writes more does not wait for anybody.
fn head_of(pipe: Option<impl Read + Send + 'static>) -> Receiver<Vec<u8>> {
    let (tell, told) = channel();
    std::thread::spawn(move || {
        let Some(mut pipe) = pipe else { return };
        let mut head = Vec::new();
        if pipe.by_ref().take(MOST_BYTES).read_to_end(&mut head).is_ok() {
            let _ = tell.send(head); // nobody waits any more
        }
        let _ = std::io::copy(&mut pipe, &mut std::io::sink()); // to its end
    });
    told
}

/// The first line that says something, as long as a person reads: a library that is not found, the words of a panic.
fn first_line(said: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(said);
    let line = text.lines().map(str::trim).find(|line| !line.is_empty())?;
    Some(line.chars().filter(|character| !character.is_control()).take(MOST_CHARACTERS).collect())
}

/// Waits for the end of a child that leads a process group of its own, with which whoever else is in the group is ended: what it has started. One that does not
/// end within `limit_ns` is killed with its whole group, since a child of it could hold a pipe open, and there is no status. One that the system does not let
/// end, as for a disk that does not answer, is left as it is.
pub fn wait_within(child: &mut Child, limit_ns: u64) -> Option<ExitStatus> {
    wait_unless(child, limit_ns, &|| false)
}

/// The same, and also killed as soon as it is given up.
pub fn wait_unless(child: &mut Child, limit_ns: u64, given_up: &dyn Fn() -> bool) -> Option<ExitStatus> {
    let status = await_unless(limit_ns, given_up, || ended_with_group(child));
    if status.is_none() {
        end_group(child.id());
        let _ = child.kill(); // it may have gone into another group
        let _ = await_end(child, GONE_WITHIN_NS);
    }
    status
}

/// Waits for the end of a child; `None` of one that has not ended within `limit_ns`, to which nothing is done.
pub fn await_end(child: &mut Child, limit_ns: u64) -> Option<ExitStatus> {
    await_unless(limit_ns, &|| false, || child.try_wait().ok().flatten())
}

/// Kills whoever is in the process group that a process leads or has led: what it has started, whatever that has become, unless it has left the group. To be
/// called before the leader is reaped, or when it has just ended: later its number may be that of others.
pub fn end_group(leader: u32) {
    // By 1 all processes would be meant.
    if let Some(group) = i32::try_from(leader).ok().and_then(Pid::from_raw).filter(|pid| !pid.is_init()) {
        let _ = kill_process_group(group, Signal::KILL); // gone is as good
    }
}

/// The status of a child that has ended, whose group is ended before it is reaped.
fn ended_with_group(child: &mut Child) -> Option<ExitStatus> {
    let asked = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    match waitid(WaitId::Pid(Pid::from_child(child)), asked) {
        Ok(None) => return None,
        Ok(Some(_)) => end_group(child.id()),
        Err(_) => {} // it was reaped before
    }
    child.try_wait().ok().flatten()
}

fn await_unless(limit_ns: u64, given_up: &dyn Fn() -> bool, mut ended: impl FnMut() -> Option<ExitStatus>) -> Option<ExitStatus> {
    let deadline_ns = system::now_ns() + limit_ns;
    loop {
        if let Some(status) = ended() {
            return Some(status);
        }
        if system::now_ns() >= deadline_ns || given_up() {
            return None;
        }
        system::sleep_ns(BETWEEN_LOOKS_NS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_engine_of_another_role_layout_or_interface_is_refused_and_told_apart() {
        let good = Description::of(Role::Fluid);
        assert_eq!(agrees(&good, &good), Ok(()));
        type Change = fn(&mut Description);
        let changes: [(Change, &str); 4] = [
            (|said| said.engine_of = "other".into(), "is an engine of \"other\""),
            (|said| said.role = "tissue".into(), "is a tissue, not a fluid"),
            (|said| said.layout_hash = "0".into(), "has layout"),
            (|said| said.interface += 1, "has interface"),
        ];
        for (change, expected) in changes {
            let mut said = good.clone();
            change(&mut said);
            let reason = agrees(&said, &good).unwrap_err();
            assert!(reason.contains(expected), "{reason}");
        }
    }

    /// A shell that leads a group and goes on with so many words after it has started another process, and the number of that one.
    fn with_started(goes_on: &str) -> (Child, u32) {
        use std::io::{BufRead, BufReader};
        let script = format!("sleep 600 & echo $!; {goes_on}");
        let mut command = Command::new("sh");
        command.args(["-c", &script]).stdin(Stdio::null()).stdout(Stdio::piped()).process_group(0);
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let started = line.trim().parse().unwrap();
        assert!(system::process_start(started).is_some(), "{started}");
        (child, started)
    }

    fn await_gone(started: u32) {
        let deadline_ns = system::now_ns() + 60_000_000_000;
        while system::process_start(started).is_some() {
            assert!(system::now_ns() < deadline_ns, "it was left");
            system::sleep_ns(BETWEEN_LOOKS_NS);
        }
    }

    /// A program that had said what it is and had ended left whatever it had started, twice for each swap.
    #[test]
    fn what_one_that_ends_by_itself_has_started_is_ended_with_it() {
        for (goes_on, code) in [("exit 0", 0), ("exit 3", 3)] {
            let (mut child, started) = with_started(goes_on);
            let status = wait_within(&mut child, u64::MAX / 4);
            assert_eq!(status.and_then(|status| status.code()), Some(code));
            await_gone(started);
            assert_eq!(wait_within(&mut child, 0), status, "it is known still");
        }
    }

    /// Ctrl-C while a file was asked what it is left its process, and all that it had started.
    #[test]
    fn who_is_given_up_is_ended_with_all_that_it_has_started() {
        let (mut child, started) = with_started("wait");
        assert_eq!(wait_unless(&mut child, u64::MAX / 4, &|| true), None);
        await_gone(started);
        let refused = verify(Path::new("/bin/cat"), Role::Fluid, &|| true).unwrap_err();
        assert!(refused.contains("is it an engine?") || refused.contains("was given up"), "{refused}");
    }

    /// It was waited for until it ended by itself: all that was killed was a group that it had left.
    #[test]
    fn one_that_leads_no_group_is_ended_as_well() {
        let mut child = Command::new("sleep").arg("600").stdin(Stdio::null()).spawn().unwrap();
        let (tell, told) = channel();
        std::thread::spawn(move || {
            let status = wait_within(&mut child, 0);
            tell.send((status, matches!(child.try_wait(), Ok(Some(_)))))
        });
        assert_eq!(told.recv_timeout(Duration::from_secs(60)), Ok((None, true)));
    }

    #[test]
    fn what_is_no_program_is_refused_before_it_is_started() {
        let folder = std::env::temp_dir().join(format!("verify-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let script = folder.join("script");
        let mark = folder.join("mark");
        std::fs::write(&script, format!("#!/bin/sh\ntouch {}\n", mark.display())).unwrap();
        assert!(verify(&script, Role::Fluid, &|| false).unwrap_err().contains("chmod +x"));
        std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
        assert!(verify(&script, Role::Fluid, &|| false).unwrap_err().contains("no ELF file"));
        assert!(!mark.exists(), "the script was run");
        assert!(verify(&folder, Role::Fluid, &|| false).unwrap_err().contains("is no file"));
        assert!(verify(&folder.join("absent"), Role::Fluid, &|| false).unwrap_err().contains("No such file"));
        assert!(verify(Path::new("/bin/true"), Role::Fluid, &|| false).unwrap_err().contains("is it an engine?"));
        // In whatever language it complains, the option that it does not know is in it. On a machine that stands still after its end nobody waits for that.
        let mut refused = String::new();
        let is_quoted = (0..10).any(|_| {
            refused = verify(Path::new("/bin/cat"), Role::Fluid, &|| false).unwrap_err();
            refused.matches(DESCRIBE).count() == 2 && refused.ends_with("is it an engine?")
        });
        assert!(is_quoted, "{refused}");
        assert_eq!(first_line(b"\n \x1b[1mno lib\xff\n and more").as_deref(), Some("[1mno lib\u{fffd}"));
        assert_eq!((first_line(b" \n"), first_line(&[b'x'; 999]).map(|line| line.len())), (None, Some(MOST_CHARACTERS)));
        let whole = std::fs::read("/bin/true").unwrap();
        let truncated = folder.join("truncated");
        std::fs::write(&truncated, &whole[..whole.len() - 1]).unwrap();
        std::fs::set_permissions(&truncated, std::fs::Permissions::from_mode(0o755)).unwrap();
        assert!(verify(&truncated, Role::Fluid, &|| false).unwrap_err().contains("is truncated"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
