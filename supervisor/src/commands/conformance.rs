//! `hystation conformance`: tells an engine's author what is wrong with it before a trainee's station does. The engine is verified, called with
//! arguments that it must refuse, and swapped into a private station of its own, whose every check it has to pass; then that station is stopped,
//! and what is left of it is counted.
//!
//! Exit codes: 0 it conforms, 1 it does not, 2 it is no engine of that role, 3 this machine gave it no time to show what it is.

use super::swap::swap_and_wait;
use crate::settings::Refusal;
use crate::swap::{role_of, verify};
use hyst_exchange::{Station, system};
use hyst_messages::{Kind, Role, kinds_of, tolerance};
use serde::Serialize;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// How long the private station may take to be whole: a start takes a second, on a busy machine a minute.
const WHOLE_WITHIN_NS: u64 = 120_000_000_000;
const LOOK_NS: u64 = 100_000_000;
/// How often it is swapped in if the machine gives it no time.
const TRIES: usize = 3;
/// What that is called.
const NO_TIME: &str = "gets time to show what it is";
/// How long an engine may take to refuse arguments: a loader on a busy machine.
const REFUSES_WITHIN_NS: u64 = 10_000_000_000;

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

/// Checks an engine.
pub fn conformance(role: &str, binary: &Path, json: bool) -> Result<u8, Refusal> {
    let role = role_of(role).map_err(Refusal::input)?;
    let binary = std::path::absolute(binary).map_err(|e| Refusal::input(format!("{}: {e}", binary.display())))?;
    let described = verify::verify(&binary, role).map_err(Refusal::input)?;
    let layout = format!("layout {}/{}, interface {}", described.layout, described.layout_hash, described.interface);
    let mut checks = vec![check("says what it is", Ok(layout)), check("refuses bad arguments", refuses(&binary))];
    checks.extend(in_a_station(role, &binary)?);
    let good = checks.iter().all(|check| check.good);
    let is_shown = checks.iter().all(|check| check.good || check.what != NO_TIME);
    let code = if is_shown { u8::from(!good) } else { 3 };
    if json {
        let conforms = is_shown.then_some(good);
        println!("{:#}", serde_json::json!({ "role": role.name(), "binary": binary, "conforms": conforms, "checks": checks }));
        return Ok(code);
    }
    for check in &checks {
        println!("{}  {:<28} {}", if check.good { "good" } else { "BAD " }, check.what, check.why);
    }
    let verdict = match code {
        0 => "conforms",
        1 => "does not conform; a swap would be rolled back",
        _ => "this machine is too busy to tell; try it again when it is not",
    };
    println!("{}: {verdict}", binary.display());
    Ok(code)
}

/// An engine whose arguments make no sense says so and ends with code 2; it does not begin to do something.
fn refuses(binary: &Path) -> Result<String, String> {
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
    match crate::proc::wait_within(&mut child, REFUSES_WITHIN_NS) {
        Some(status) if status.code() == Some(2) => Ok("--slot nonsense: exit code 2".into()),
        Some(status) => Err(format!("--slot nonsense: {status}; it must be exit code 2 and a message on stderr")),
        None => Err("--slot nonsense: it does not end; it must be exit code 2".into()),
    }
}

/// The private station, ended when this is dropped.
struct Private {
    station: Station,
    child: Child,
}

impl Drop for Private {
    fn drop(&mut self) {
        let _ = super::stop::stop(&self.station); // gone is as good
        let _ = self.child.wait();
    }
}

fn in_a_station(role: Role, binary: &Path) -> Result<Vec<Check>, Refusal> {
    let name = format!("conformance-{}", std::process::id());
    let station = Station::named(&name).map_err(|e| Refusal::failed(e.to_string()))?;
    let program = std::env::current_exe().map_err(|e| Refusal::failed(e.to_string()))?;
    let folder = std::env::temp_dir().join(&name);
    std::fs::create_dir_all(&folder).map_err(|e| Refusal::failed(format!("{}: {e}", folder.display())))?;
    let mut command = Command::new(program);
    command.args(["--name", &name, "run", "--headless", "--quiet", "--with-parent", "--hand", "script:press"]);
    if role == Role::Recorder {
        command.arg("--record").arg(folder.join("session.mcap"));
    }
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0).spawn();
    let child = child.map_err(|e| Refusal::failed(format!("cannot start a private station: {e}")))?;
    let private = Private { station, child };
    let checks = swap_in(role, binary, &private.station);
    let station = private.station.clone();
    drop(private);
    let _ = std::fs::remove_dir_all(&folder); // it is in the system's folder for such things
    let mut checks = checks?;
    let left = station.leftovers();
    let nothing = if left.is_empty() { Ok("no process, no shared memory, no file".into()) } else { Err(format!("{left:?}")) };
    checks.push(check("leaves nothing behind", nothing));
    Ok(checks)
}

fn swap_in(role: Role, binary: &Path, station: &Station) -> Result<Vec<Check>, Refusal> {
    let deadline_ns = system::now_ns() + WHOLE_WITHIN_NS;
    let whole = || {
        let plan = crate::plan::Plan::read(station).ok()?;
        let mut viewer = crate::view::Viewer::open(station).ok()?;
        plan.slots().into_iter().all(|slot| viewer.says_ready(slot)).then_some(())
    };
    while whole().is_none() {
        if system::now_ns() >= deadline_ns {
            return Err(Refusal::failed("the private station did not start; try `hystation run` and `hystation doctor`"));
        }
        system::sleep_ns(LOOK_NS);
    }
    let mut record = swap_and_wait(station, role.name(), binary)?;
    for _ in 1..TRIES {
        if record.promoted == Some(false) && record.got_no_time() {
            record = swap_and_wait(station, role.name(), binary)?;
        }
    }
    if record.promoted == Some(false) && record.got_no_time() {
        return Ok(vec![check(NO_TIME, Err(record.reason))]);
    }
    let told = |text: &str| record.steps.iter().find(|step| step.what.contains(text));
    let ready = told("ready, and").map(|step| format!("after {:.0} ms", step.at_ms)).ok_or(record.reason.clone());
    let mut checks = vec![check("becomes ready", ready)];
    if let Some(kind) = kinds_of(role).first().filter(|kind| matches!(kind, Kind::TissueState | Kind::FluidState)) {
        let compared = told("states compared").map(|step| step.what.clone()).ok_or(record.reason.clone());
        checks.push(check("agrees with the old engine", compared));
        checks.extend(tolerance::stated(*kind).into_iter().map(|text| check("  tolerance", Ok(text))));
    }
    let proven = if record.promoted == Some(true) { Ok("nobody had a reason to doubt it".into()) } else { Err(record.reason) };
    checks.push(check("passes its probation", proven));
    Ok(checks)
}
