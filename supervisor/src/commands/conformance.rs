//! `hystation conformance`: tells an engine's author what is wrong with it before a trainee's station does. The engine is verified, called with
//! arguments that it must refuse, and swapped into a private station of its own, whose every check it has to pass; there it is killed once, and has to come
//! back; its steps are looked at, whether it does wrong when it is asked to, and whether it withstands what others say wrong; then that station is stopped, how it
//! ends with it is looked at, and what is left of it is counted.
//!
//! Exit codes: 0 it conforms, 1 it does not, 2 it is no engine of that role, 3 this machine gave it no time to show what it is, or no station to show it in, or it
//! was interrupted: then that station is ended first.

mod driver;
mod lied_to;
mod own;
mod tries;

use super::INTERRUPTED;
use super::shielded::shielded;
use crate::settings::Refusal;
use crate::swap::{role_of, stated, verify};
use crate::view::{ProcessView, Viewer};
use hyst_exchange::{Station, system};
use hyst_messages::Role;
use serde::Serialize;
use std::fs::File;
use std::io::{Read, Seek};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

/// How long the private station may take to be whole: a start takes a second, on a busy machine a minute.
const WHOLE_WITHIN_NS: u64 = 120_000_000_000;
const LOOK_NS: u64 = 100_000_000;
/// What a driver of a device is called here, which is no engine and has checks of its own.
const DRIVER: &str = "driver";
/// How long the role may take to be whole again after its death.
const BACK_WITHIN_NS: u64 = 30_000_000_000;
/// What that is called.
const NO_TIME: &str = "gets time to show what it is";
/// Whether the engine before it was in time: where that was not, it is not known whether this one is.
const CAN_BE_LATE: &str = "can be told to be late";
const PASSES: &str = "passes its probation";
const COMES_BACK: &str = "comes back after its death";
/// How long an engine may take to refuse arguments: a loader on a busy machine.
const REFUSES_WITHIN_NS: u64 = 10_000_000_000;
/// How long the private station's guardian may take to end after `stop`, which has waited for it.
const ENDS_WITHIN_NS: u64 = 5_000_000_000;

/// One check.
#[derive(Debug, Serialize)]
struct Check {
    what: String,
    good: bool,
    why: String,
}

fn check(what: &str, result: Result<String, String>) -> Check {
    let good = result.is_ok();
    Check { what: what.to_string(), good, why: result.unwrap_or_else(|why| why) }
}

/// What the private station is like.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Its scene; the built-in one if there is none.
    pub scene: Option<&'a Path>,
    /// Its hand.
    pub hand: &'a str,
}

/// Checks an engine.
pub fn conformance(role: &str, binary: &Path, place: Place, json: bool) -> Result<u8, Refusal> {
    let binary = std::path::absolute(binary).map_err(|e| Refusal::input(format!("{}: {e}", binary.display())))?;
    if role == DRIVER {
        let found = shielded(|interrupted| driver::conformance(&binary, &|| interrupted.load(Ordering::SeqCst)))?;
        let checks = found.map_err(|refusal| match refusal.code {
            2 => refusal,
            _ => Refusal { code: 3, ..refusal }, // it says nothing of the driver
        })?;
        return Ok(tell(DRIVER, &binary, &checks, &[], "a station would not be safe with it", json));
    }
    let role = role_of(role).map_err(Refusal::input)?;
    let (checks, log) = shielded(|interrupted| tried(role, &binary, place, interrupted))??;
    Ok(tell(role.name(), &binary, &checks, &log, "a trainee's station would not be safe with it", json))
}

/// What was found of an engine that was asked what it is and then tried, and what it printed last. What is interrupted finds less, and nobody is told of it.
fn tried(role: Role, binary: &Path, place: Place, interrupted: &AtomicBool) -> Result<(Vec<Check>, Vec<String>), Refusal> {
    let mut checks = asked(binary, role, &|| interrupted.load(Ordering::SeqCst))?;
    if interrupted.load(Ordering::SeqCst) {
        return Ok((checks, Vec::new()));
    }
    let (found, log) = in_a_station(role, binary, place, interrupted)?;
    checks.extend(found);
    Ok((checks, log))
}

/// The exit code of what was found. Of an engine that could not be shown the most is not known, whatever else was found; of one whose lateness could not, if nothing
/// else is wrong with it.
fn code_of(checks: &[Check]) -> u8 {
    let is_bad = |of: &dyn Fn(&str) -> bool| checks.iter().any(|check| !check.good && of(&check.what));
    match () {
        () if is_bad(&|what| what == NO_TIME) => 3,
        () if is_bad(&|what| what != CAN_BE_LATE) => 1,
        () if is_bad(&|_| true) => 3,
        () => 0,
    }
}

/// Says what was found, and if something is bad what the engine has printed last; gives the exit code.
fn tell(role: &str, binary: &Path, checks: &[Check], log: &[String], else_what: &str, json: bool) -> u8 {
    let code = code_of(checks);
    let log: &[String] = if code == 0 { &[] } else { log };
    if json {
        let conforms = (code != 3).then_some(code == 0);
        let all = serde_json::json!({ "role": role, "binary": binary, "conforms": conforms, "checks": checks, "log": log });
        println!("{all:#}");
        return code;
    }
    for check in checks {
        println!("{}  {:<28} {}", if check.good { "good" } else { "BAD " }, check.what, check.why);
    }
    log.iter().for_each(|line| println!("log   {line}"));
    let verdict = match code {
        0 => "conforms".to_string(),
        1 => format!("does not conform; {else_what}"),
        _ => "this machine could not tell; try it again when it is less busy".to_string(),
    };
    println!("{}: {verdict}", binary.display());
    code
}

/// What an engine, or a driver of a device, is asked before it is started in earnest: what it is, and whether it refuses what makes no sense.
fn asked(binary: &Path, role: Role, given_up: &dyn Fn() -> bool) -> Result<Vec<Check>, Refusal> {
    let described = verify::verify(binary, role, given_up).map_err(Refusal::input)?;
    let layout = format!("layout {}/{}, interface {}", described.layout, described.layout_hash, described.interface);
    Ok(vec![check("says what it is", Ok(layout)), check("refuses bad arguments", refuses(binary, given_up))])
}

/// An engine whose arguments make no sense says so and ends with code 2; it does not begin to do something.
fn refuses(binary: &Path, given_up: &dyn Fn() -> bool) -> Result<String, String> {
    let station = format!("c{}-absent", std::process::id());
    let words = ["--station", &station, "--slot", "nonsense", "--incarnation", "1"];
    let mut child = Command::new(binary)
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .process_group(0)
        .spawn()
        .map_err(|error| error.to_string())?;
    match crate::proc::wait_unless(&mut child, REFUSES_WITHIN_NS, given_up) {
        Some(status) if status.code() == Some(2) => Ok("--slot nonsense: exit code 2".into()),
        Some(status) => Err(format!("--slot nonsense: {status}; it must be exit code 2 and a message on stderr")),
        None => Err("--slot nonsense: it does not end; it must be exit code 2".into()),
    }
}

/// The private station, ended when this is dropped.
struct Private<'a> {
    station: Station,
    child: Child,
    /// Nobody wants to know it any more.
    interrupted: &'a AtomicBool,
}

impl Private<'_> {
    fn is_given_up(&self) -> bool {
        self.interrupted.load(Ordering::SeqCst)
    }
}

impl Drop for Private<'_> {
    fn drop(&mut self) {
        if self.is_given_up() && matches!(self.child.try_wait(), Ok(None)) {
            // At whatever moment that is: its guardian knows what it has begun.
            crate::proc::signal(self.child.id(), rustix::process::Signal::INT);
            let _ = crate::proc::await_end(&mut self.child, ENDS_WITHIN_NS);
        }
        let _ = super::stop::stop(&self.station); // gone is as good
        let _ = crate::proc::wait_within(&mut self.child, ENDS_WITHIN_NS); // one that does not end is killed
    }
}

/// A file without a name, which is gone with whoever has it open, however that ends.
fn nameless(path: &Path) -> Result<File, Refusal> {
    let file = File::options().read(true).write(true).create_new(true).open(path);
    let file = file.and_then(|file| std::fs::remove_file(path).map(|()| file));
    file.map_err(|e| Refusal::failed(format!("{}: {e}", path.display())))
}

/// What was found of an engine in a station of its own, and what it printed there last. The station is in test mode, so that the engine can be asked to do wrong.
fn in_a_station(role: Role, binary: &Path, place: Place, interrupted: &AtomicBool) -> Result<(Vec<Check>, Vec<String>), Refusal> {
    let name = format!("conformance-{}", std::process::id());
    let station = Station::named(&name).map_err(|e| Refusal::failed(e.to_string()))?;
    let program = std::env::current_exe().map_err(|e| Refusal::failed(e.to_string()))?;
    let folder = std::env::temp_dir().join(&name);
    let mut command = Command::new(program);
    let with_parent = format!("--with-parent={}", std::process::id());
    command.args(["--name", &name, "run", "--headless", "--quiet", &with_parent, "--test-mode", "--hand", place.hand]);
    command.arg("--passing").arg(&folder); // the station's to remove: this command may be killed
    if let Some(scene) = place.scene {
        command.arg(scene);
    }
    if role == Role::Recorder {
        command.arg("--record").arg(folder.join("session.mcap"));
    }
    let mut said = nameless(&folder.with_extension("said"))?;
    let lines = said.try_clone().map_err(|e| Refusal::failed(e.to_string()))?;
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(lines).process_group(0).spawn();
    let child = child.map_err(|e| Refusal::failed(format!("cannot start a private station: {e}")))?;
    let mut private = Private { station, child, interrupted };
    let checks = swap_in(role, binary, &mut private).map_err(|refusal| match refusal.code {
        2 => refusal,                        // of the file, or of what the station is to be like
        _ => Refusal { code: 3, ..refusal }, // it says nothing of the engine
    });
    let station = private.station.clone();
    let (log, ends) = (own::last_lines(&station, role), own::Ends::of(&station, role));
    drop(private);
    let mut words = String::new();
    let _ = said.rewind().and_then(|()| said.read_to_string(&mut words)); // without them the exit codes are what there is
    let mut checks = checks?;
    // Of one that was rolled back nobody is left to end.
    if checks.iter().any(|check| check.what == PASSES && check.good) {
        checks.push(check("ends with the station", ends.told(&words)));
    }
    checks.push(check("leaves nothing behind", left_behind(&station)));
    Ok((checks, log))
}

/// What is left of a station that has ended: its processes, and whatever an engine of it had started; segments and files.
fn left_behind(station: &Station) -> Result<String, String> {
    let processes = crate::remains::living(station).into_iter().map(|living| format!("process {} ({})", living.pid, living.name));
    let files = station.leftovers().into_iter().map(|path| path.display().to_string());
    let left: Vec<String> = processes.chain(files).collect();
    if left.is_empty() { Ok("no process, no shared memory, no file".into()) } else { Err(left.join(", ")) }
}

/// Whether each slot of the station has a process that works; the incarnations of a role.
fn whole(station: &Station, role: Role) -> Option<Vec<u32>> {
    let slots = crate::plan::Plan::read(station).ok()?.slots();
    let mut viewer = Viewer::open(station).ok()?;
    let incarnations = slots.iter().filter(|slot| slot.role() == role).map(|slot| viewer.page().incarnation(*slot)).collect();
    slots.into_iter().all(|slot| viewer.is_well(slot)).then_some(incarnations)
}

/// Waits until the private station is whole and `is_it` says so of the incarnations of the role; when that was.
fn wait_until(private: &mut Private, role: Role, within_ns: u64, is_it: impl Fn(&[u32]) -> bool) -> Result<u64, Refusal> {
    let begun_ns = system::now_ns();
    loop {
        let now_ns = system::now_ns();
        if private.is_given_up() {
            return Err(Refusal { code: INTERRUPTED, message: "interrupted".into() });
        }
        if whole(&private.station, role).is_some_and(|incarnations| is_it(&incarnations)) {
            return Ok(now_ns - begun_ns);
        }
        let hint = "try `hystation run` and `hystation doctor`";
        if let Ok(Some(status)) = private.child.try_wait() {
            if status.code() == Some(2) {
                return Err(Refusal::input(
                    "the private station refuses its scene or its hand; `hystation check SCENE` says why",
                ));
            }
            return Err(Refusal::failed(format!("the private station has ended ({status}); {hint}")));
        }
        if now_ns >= begun_ns + within_ns {
            return Err(Refusal::failed(format!(
                "the private station is not whole after {} s; {hint}",
                within_ns / 1_000_000_000
            )));
        }
        system::sleep_ns(LOOK_NS);
    }
}

/// Who does the role's work, as soon as the station is whole and somebody does.
fn active(role: Role, private: &mut Private) -> Result<ProcessView, String> {
    let deadline_ns = system::now_ns() + BACK_WITHIN_NS;
    loop {
        wait_until(private, role, BACK_WITHIN_NS, |_| true).map_err(|refusal| refusal.message)?;
        let view = Viewer::open(&private.station).map_err(|error| error.to_string())?.look();
        let is_it = |process: &ProcessView| process.active && Role::name_in(&process.name) == role.name();
        if let Some(active) = view.processes.into_iter().find(is_it) {
            return Ok(active);
        }
        if system::now_ns() >= deadline_ns {
            return Err("nobody does the role's work".into());
        }
        system::sleep_ns(LOOK_NS);
    }
}

/// Kills who does the role's work: one that has a spare of its own kind gives the role to that, any other is started again; and all are there again.
fn comes_back(role: Role, private: &mut Private) -> Result<String, String> {
    let ProcessView { pid, incarnation, .. } = active(role, private)?;
    crate::proc::signal(pid, rustix::process::Signal::KILL);
    let is_replaced = |incarnations: &[u32]| !incarnations.contains(&incarnation);
    let after_ns = wait_until(private, role, BACK_WITHIN_NS, is_replaced).map_err(|refusal| refusal.message)?;
    Ok(format!("whole again after {:.1} s", after_ns as f64 * 1e-9))
}

fn swap_in(role: Role, binary: &Path, private: &mut Private) -> Result<Vec<Check>, Refusal> {
    wait_until(private, role, WHOLE_WITHIN_NS, |_| true)?;
    let station = &private.station.clone();
    let late = own::late_share(station, role);
    let record = match tries::swapped(role, binary, private)? {
        Ok(record) => record,
        Err(why) => return Ok(vec![check(NO_TIME, Err(why))]),
    };
    let told = |text: &str| record.steps.iter().find(|step| step.what.contains(text));
    let ready = told("ready, and").map(|step| format!("after {:.0} ms", step.at_ms)).ok_or(record.reason.clone());
    let mut checks = vec![check("becomes ready", ready)];
    if role.is_stateful() {
        let compared = told("states compared").map(|step| step.what.clone()).ok_or(record.reason.clone());
        checks.push(check("agrees with the old engine", compared));
    }
    checks.extend(stated(role).into_iter().map(|text| check("  tolerance", Ok(text))));
    let is_proven = record.promoted == Some(true);
    let proven = if is_proven { Ok("nobody had a reason to doubt it".into()) } else { Err(record.reason) };
    checks.push(check(PASSES, proven));
    if is_proven {
        checks.push(check(COMES_BACK, comes_back(role, private)));
        checks.extend(own::steps(role, private, late));
        checks.extend(own::does_wrong(role, private));
        checks.extend(lied_to::withstands(role, private));
    }
    Ok(checks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_an_engine_could_not_be_shown_the_machine_could_not_tell_and_else_a_bad_check_tells() {
        let code = |checks: &[(&str, bool)]| {
            let found = |(what, is_good): &(&str, bool)| check(what, is_good.then(String::new).ok_or_else(String::new));
            code_of(&checks.iter().map(found).collect::<Vec<_>>())
        };
        let what_is_left = ("leaves nothing behind", false);
        assert_eq!([code(&[(PASSES, true)]), code(&[(PASSES, true), what_is_left]), code(&[(PASSES, false)])], [0, 1, 1]);
        assert_eq!([code(&[(NO_TIME, false)]), code(&[(PASSES, true), (NO_TIME, false), what_is_left])], [3, 3]);
        let untold = (CAN_BE_LATE, false);
        assert_eq!([code(&[(PASSES, true), untold]), code(&[(PASSES, true), untold, what_is_left])], [3, 1]);
    }

    /// It said that there was no process, and had looked for none.
    #[test]
    fn a_process_that_is_left_is_named_and_a_station_of_which_nothing_is_left_is_good() {
        let station = Station::named(&format!("t{}-left", std::process::id())).unwrap();
        assert_eq!(left_behind(&station), Ok("no process, no shared memory, no file".into()));
        let mut left =
            Command::new("sleep").arg("600").env(crate::proc::MARK, crate::proc::mark_of(&station, 7)).spawn().unwrap();
        let until_ns = system::now_ns() + 60_000_000_000;
        while left_behind(&station).is_ok() {
            assert!(system::now_ns() < until_ns, "it is not seen"); // at first it is not yet what it was started as
            system::sleep_ns(1_000_000);
        }
        assert_eq!(left_behind(&station), Err(format!("process {} (unregistered)", left.id())));
        left.kill().unwrap();
        left.wait().unwrap();
        assert!(left_behind(&station).is_ok());
    }
}
