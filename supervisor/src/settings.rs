//! From the command line to the station's settings, everything checked before anything starts.

use crate::case::RunCase;
use crate::cli::RunArgs;
use crate::faultfile::{self, Injection};
use crate::neighbours;
use crate::plan::{self, Plan};
use crate::recording::folder;
use hyst_engine::Settings;
use hyst_engine::settings::SET_KEYS;
use hyst_engine::verify::verify;
use hyst_exchange::Station;
use hyst_messages::{MAX_WORKERS, Role, TICK_NS};
use hyst_recording::Reader;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Whether the processes of a station that was founded are to be real time, as far as its settings can be read.
pub fn is_real_time(station: &Station) -> bool {
    of_founded(station).is_none_or(|settings| settings.switch("realtime", true).unwrap_or(true))
}

/// Whether a station that was founded does a recording again, as far as its settings can be read.
pub fn is_replay(station: &Station) -> bool {
    of_founded(station).is_some_and(|settings| settings.replay.is_some())
}

fn of_founded(station: &Station) -> Option<Settings> {
    let text = std::fs::read_to_string(station.settings()).ok()?;
    toml::from_str(&text).ok()
}

/// A command that is not done, with its exit code and a message that names the cure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Exit code.
    pub code: u8,
    /// What, where, what to do.
    pub message: String,
}

impl Refusal {
    /// Bad arguments or bad input.
    pub fn input(message: impl Into<String>) -> Refusal {
        Refusal { code: 2, message: message.into() }
    }
    /// Something that the system refused: for want of room it failed, for that comes back; whatever else it was will be so the next time.
    pub fn of_system(kind: ErrorKind, message: impl Into<String>) -> Refusal {
        match kind {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Refusal::failed(message),
            _ => Refusal::input(message),
        }
    }
    /// It was asked to stop before anything was started: that is good.
    pub fn stopped() -> Refusal {
        Refusal { code: 0, message: "asked to stop, and nothing was started".into() }
    }
    /// What came of it is lost.
    pub fn lost(message: impl Into<String>) -> Refusal {
        Refusal { code: 3, message: message.into() }
    }
    /// It failed.
    pub fn failed(message: impl Into<String>) -> Refusal {
        Refusal { code: 1, message: message.into() }
    }
}

fn absolute(path: &Path) -> Result<PathBuf, Refusal> {
    std::path::absolute(path).map_err(|e| Refusal::input(format!("{}: {e}", path.display())))
}

/// The settings and the plan of a run, of a case if there is one. Where the recording's folder was named they have that; its file is made with the station.
/// A driver is asked what it is until it is given up.
pub fn prepare(
    args: &RunArgs,
    station: &Station,
    case: Option<&RunCase>,
    given_up: &dyn Fn() -> bool,
) -> Result<(Settings, Plan), Refusal> {
    if !args.station.test_mode && std::env::var_os(crate::intent::DIES_AT).is_some() {
        return Err(Refusal::input(format!(
            "{}: it ends the supervisor, in test mode alone; unset it, or add --test-mode",
            crate::intent::DIES_AT
        )));
    }
    let mut settings = of_args(args, station, case)?;
    let by_hand = ["mouse", "gamepad", "spacemouse"].contains(&settings.hand.split(':').next().unwrap_or_default());
    if args.lockstep && by_hand {
        let reason = "a hand on a virtual clock is scripted; use script:press or idle";
        return Err(Refusal::input(format!("--lockstep --hand {}: {reason}", settings.hand)));
    }
    if let Some(file) = settings.recording() {
        settings.hand = format!("replay:{}", absolute(file)?.display());
    }
    let driver = args.driver.as_deref().map(|file| check_driver(args, file, given_up)).transpose()?;
    if let Some(driver) = &driver {
        settings.hand = format!("driver:{}", driver.display());
    } else {
        check_hand(&settings)?;
    }
    for pair in &args.station.set {
        let (key, value) =
            pair.split_once('=').ok_or_else(|| Refusal::input(format!("--set {pair}: write key=value\n{}", known_keys())))?;
        check_set(key, value)?;
        settings.set.insert(key.into(), value.into());
    }
    if args.lockstep {
        check_lockstep(&mut settings)?;
    }
    check_outputs(args, &settings)?;
    let faults = read_faults(args, station, settings.record.as_deref())?;
    let spares = settings.switch("spares", true).map_err(|e| Refusal::input(e.to_string()))?;
    let roles = args
        .roles
        .as_ref()
        .map(|names| names.iter().map(|name| known_role(name)).collect::<Result<Vec<Role>, _>>())
        .transpose()?;
    let binaries = match &args.station.binaries {
        Some(folder) => absolute(folder)?,
        None => own_folder()?,
    };
    let slots = plan::slots(&settings, spares, roles.as_deref());
    for fault in &faults {
        let at = |reason| format!("--faults: the fault of tick {}: {reason}", fault.tick);
        fault.check_in(&slots).map_err(|reason| Refusal::input(at(reason)))?;
    }
    let slots = slots.iter().map(ToString::to_string).collect();
    let swapped = driver.map(|driver| (Role::Hardware.name().to_string(), driver)).into_iter().collect();
    let plan = Plan { binaries, slots, swapped, state_bytes: 0, end_tick: end_tick(args), faults };
    let missing = plan.missing();
    if !missing.is_empty() {
        let list: Vec<String> = missing.iter().map(|path| path.display().to_string()).collect();
        return Err(Refusal::input(format!(
            "missing: {}; `./station build` makes all engines, or install the package again",
            list.join(", ")
        )));
    }
    Ok((settings, plan))
}

/// The settings that the command line names, and its defaults; of a case the scene is the copy that the station will have.
fn of_args(args: &RunArgs, station: &Station, case: Option<&RunCase>) -> Result<Settings, Refusal> {
    let headless = args.station.headless || !has_display();
    let workers = args.station.workers.unwrap_or(Settings::default().workers);
    if workers > MAX_WORKERS {
        return Err(Refusal::input(format!("--workers {workers}: at most {MAX_WORKERS} are allowed")));
    }
    Ok(Settings {
        scene: match case {
            Some(_) => Some(station.case()),
            None => args.scene.as_deref().map(absolute).transpose()?,
        },
        case: case.and_then(|case| case.file.clone()),
        hand: hand_of(args, case.is_some(), headless)?,
        headless,
        workers,
        record: args.record.as_deref().map(absolute).transpose()?,
        pictures: args.station.pictures.as_deref().map(absolute).transpose()?,
        test_mode: args.station.test_mode,
        lockstep: args.lockstep,
        replay: args.again.as_ref().map(|again| again.replay),
        ..Settings::default()
    })
}

/// The hand that is named; else the mouse in a window, and where that cannot be a script. A case is somebody's session, in which no script may pass for them.
fn hand_of(args: &RunArgs, is_case: bool, headless: bool) -> Result<String, Refusal> {
    match &args.hand {
        Some(hand) => Ok(hand.clone()),
        None if !headless && !args.lockstep => Ok("mouse".into()),
        None if is_case && args.driver.is_none() => Err(Refusal::input(
            "a case needs somebody's hand, and there is no window that a mouse could be in: add --hand gamepad, --hand spacemouse or --driver FILE, run \
             it where there is a display, or name a script, --hand script:NAME (`hystation check CASE` lists them)",
        )),
        None => Ok("script:press".into()),
    }
}

/// The tick at which a station on a virtual clock ends.
fn end_tick(args: &RunArgs) -> Option<u64> {
    let of_time = args.for_s.filter(|_| args.lockstep).map(|for_s| ((for_s * 1e9) as u64 / TICK_NS).max(1));
    args.again.as_ref().map(|again| again.end_tick).or(of_time)
}

/// Whether there may be a window: it is one of X11, which a Wayland desktop serves through XWayland and then sets this, too.
fn has_display() -> bool {
    is_set("DISPLAY")
}

fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}

/// What is said of a station that runs headless and was not asked to.
pub fn why_headless() -> &'static str {
    why_headless_on(is_set("WAYLAND_DISPLAY"))
}

fn why_headless_on(wayland: bool) -> &'static str {
    if wayland {
        "there is no display: the station runs headless; its window is one of X11, which a Wayland desktop shows through XWayland: install xwayland and log in \
         again"
    } else {
        "there is no display: the station runs headless; set DISPLAY to see a window"
    }
}

/// The folder of this program, in which its engines lie.
pub fn own_folder() -> Result<PathBuf, Refusal> {
    let program = std::env::current_exe().map_err(|e| Refusal::failed(format!("cannot find the folder of this program: {e}")))?;
    Ok(program.parent().map(Path::to_path_buf).unwrap_or_default())
}

fn known_role(name: &str) -> Result<Role, Refusal> {
    Role::from_name(name)
        .ok_or_else(|| Refusal::input(format!("--roles {name}: no such role; use the names that `status` shows")))
}

/// A driver of a device, which is verified before anything starts. The file itself is started, not a copy: it may need what lies beside it.
fn check_driver(args: &RunArgs, file: &Path, given_up: &dyn Fn() -> bool) -> Result<PathBuf, Refusal> {
    if args.lockstep {
        return Err(Refusal::input("--driver --lockstep: no device is moved on a virtual clock; leave one of them out"));
    }
    let file = absolute(file)?;
    verify(&file, Role::Hardware, given_up).map_err(|reason| match given_up() {
        true => Refusal::stopped(),
        false => Refusal::input(format!("--driver: {reason}; docs/driver.md says what a driver is")),
    })?;
    Ok(file)
}

fn check_hand(settings: &Settings) -> Result<(), Refusal> {
    let hand = settings.hand.clone();
    let bad = |reason: &str| Err(Refusal::input(format!("--hand {hand}: {reason}")));
    match hand.split_once(':') {
        None if hand == "idle" => Ok(()),
        None if hand == "mouse" && settings.headless => {
            bad("there is no window that the mouse could be in; use script:press, or run with a display")
        }
        None if ["mouse", "gamepad", "spacemouse"].contains(&hand.as_str()) => Ok(()),
        Some(("gamepad" | "spacemouse", path)) if path.starts_with('/') => Ok(()),
        Some(("script", name)) if !name.is_empty() => Ok(()),
        Some(("replay", file)) => match Reader::open(Path::new(file)) {
            Ok(_) => Ok(()),
            Err(error) => bad(&error.to_string()),
        },
        _ => bad(
            "write script:idle, script:press, script:explore, script:polyp, replay:FILE, mouse, gamepad, spacemouse (or gamepad:/dev/input/eventN) or idle",
        ),
    }
}

/// On a virtual clock nothing is real time and no clock drifts.
fn check_lockstep(settings: &mut Settings) -> Result<(), Refusal> {
    for (key, value) in [("realtime", "off"), ("drift_ppm", "0")] {
        if let Some(given) = settings.set.insert(key.into(), value.into()).filter(|given| given != value) {
            return Err(Refusal::input(format!("--lockstep --set {key}={given}: in lock-step it is {value}; leave it out")));
        }
    }
    Ok(())
}

fn check_outputs(args: &RunArgs, settings: &Settings) -> Result<(), Refusal> {
    let (record, in_folder) = (settings.record.as_deref(), args.record.as_deref().is_some_and(folder::is_folder));
    record.filter(|_| in_folder).map_or(Ok(()), folder::check)?;
    for (name, path) in [("--record", record.filter(|_| !in_folder)), ("--report", args.report.as_deref())] {
        let folder = path.map(|path| path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")));
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            return Err(Refusal::input(format!("{name}: folder {} does not exist; make it first", folder.display())));
        }
    }
    if let Some(folder) = &settings.pictures {
        std::fs::create_dir_all(folder)
            .map_err(|e| Refusal::input(format!("--pictures {}: {e}; give a folder that can be made", folder.display())))?;
    }
    Ok(())
}

fn read_faults(args: &RunArgs, station: &Station, record: Option<&Path>) -> Result<Vec<Injection>, Refusal> {
    let Some(path) = &args.station.faults else {
        return Ok(Vec::new());
    };
    if !args.station.test_mode {
        return Err(Refusal::input("--faults: faults are injected in test mode alone; add --test-mode"));
    }
    let faults = faultfile::read(path).map_err(|e| Refusal::input(e.to_string()))?.fault;
    for kind in faults.iter().map(|fault| fault.kind) {
        neighbours::check_begun(station, record, kind).map_err(|reason| Refusal::input(format!("--faults: {reason}")))?;
    }
    Ok(faults)
}

/// The keys that `--set` takes, one a line.
pub fn known_keys() -> String {
    let lines: Vec<String> = SET_KEYS.iter().map(|(key, text)| format!("  {key:<20} {text}")).collect();
    format!("known keys:\n{}", lines.join("\n"))
}

/// Checks a value against what its key's text says it takes: `A to B: …`, `A to B letters: …`, or `a, b or c: …`.
pub fn check_set(key: &str, value: &str) -> Result<(), Refusal> {
    let Some((_, text)) = SET_KEYS.iter().find(|(known, _)| *known == key) else {
        return Err(Refusal::input(format!("--set {key}: no such key\n{}", known_keys())));
    };
    let takes = text.split(':').next().unwrap_or(text);
    let (bounds, is_text) = takes.strip_suffix(" letters").map_or((takes, false), |bounds| (bounds, true));
    let fits = match bounds.split_once(" to ").map(|(low, high)| (low.trim().parse::<f64>(), high.trim().parse::<f64>())) {
        Some((Ok(low), Ok(high))) if is_text => {
            (low..=high).contains(&(value.chars().count() as f64)) && !value.chars().any(char::is_control)
        }
        Some((Ok(low), Ok(high))) => value.parse::<f64>().is_ok_and(|value| (low..=high).contains(&value)),
        _ => takes.replace(" or ", ", ").split(", ").any(|word| word.trim() == value),
    };
    if fits { Ok(()) } else { Err(Refusal::input(format!("--set {key}={value}: expected {takes}"))) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;

    #[test]
    fn what_the_system_refuses_for_want_of_room_is_no_bad_input() {
        let code = |kind: ErrorKind| Refusal::of_system(kind, "no").code;
        assert_eq!([ErrorKind::StorageFull, ErrorKind::QuotaExceeded].map(code), [1, 1]);
        assert_eq!([ErrorKind::PermissionDenied, ErrorKind::NotFound, ErrorKind::ReadOnlyFilesystem].map(code), [2, 2, 2]);
        assert_eq!(std::io::Error::from(rustix::io::Errno::NOSPC).kind(), ErrorKind::StorageFull);
    }

    /// A session of somebody who had come by ssh, or of a service, was recorded in which a script had moved.
    #[test]
    fn a_case_in_which_nobody_has_a_hand_is_refused_and_no_script_takes_their_place() {
        let hand = |words: &[&str], is_case| {
            let line = ["hystation", "run", "polyp", "--headless"].iter().chain(words).copied();
            let Command::Run(args) = Cli::try_parse_from(line).unwrap().command else { panic!("not run") };
            hand_of(&args, is_case, args.station.headless).map_err(|refusal| (refusal.code, refusal.message.contains("--driver")))
        };
        assert_eq!([hand(&[], true), hand(&["--lockstep"], true)], [Err((2, true)), Err((2, true))]);
        assert_eq!(hand(&["--hand", "gamepad"], true), Ok("gamepad".into()));
        assert_eq!(hand(&["--hand", "script:resects"], true), Ok("script:resects".into()));
        assert!(hand(&["--driver", "./driver"], true).is_ok(), "the driver takes its place");
        assert_eq!(hand(&[], false), Ok("script:press".into()), "a scene is nobody's session");
        let seen = RunArgs::default();
        assert_eq!(hand_of(&seen, true, false), Ok("mouse".into()));
        assert_eq!(hand_of(&RunArgs { lockstep: true, ..seen }, true, false).map_err(|refusal| refusal.code), Err(2));
    }

    /// On a desktop of Wayland alone a station had the mouse for its hand and no window, and said so nowhere.
    #[test]
    fn why_there_is_no_window_is_told_with_what_that_desktop_lacks() {
        let told = [false, true].map(why_headless_on);
        assert!(told.iter().all(|told| told.starts_with("there is no display: the station runs headless; ")), "{told:?}");
        assert!(told[0].contains("DISPLAY") && told[1].contains("XWayland: install xwayland"), "{told:?}");
    }

    #[test]
    fn set_takes_what_the_keys_say_and_nothing_else() {
        for (key, value) in
            [("realtime", "off"), ("isa", "avx2"), ("tissue_step_ticks", "4"), ("drift_ppm", "-20.5"), ("fluid_threads", "3")]
        {
            assert_eq!(check_set(key, value), Ok(()), "{key}={value}");
        }
        assert_eq!(check_set("trainee", "Ana Müller"), Ok(()));
        let long = "x".repeat(61);
        for (key, value) in [
            ("trainee", ""),
            ("trainee", "a\nb"),
            ("trainee", &long),
            ("realtime", "maybe"),
            ("isa", "sse9"),
            ("tissue_step_ticks", "3"),
            ("drift_ppm", "900"),
            ("drift_ppm", "nan"),
            ("view", ""),
        ] {
            assert_eq!(check_set(key, value).unwrap_err().code, 2, "{key}={value}");
        }
        assert!(
            check_set("colour", "red").unwrap_err().message.contains("tissue_step_ticks"),
            "an unknown key lists the known ones"
        );
    }
}
