//! Where a station begins: in a place that is empty, or by taking over one that lives without its guardian.

use super::copied::Copied;
use super::ended::remove_unbegun;
use super::needed_bytes;
use super::order::Order;
use super::room;
use crate::build::Beside;
use crate::case::RunCase;
use crate::cli::Again;
use crate::commands::check::Admitted;
use crate::limits::Limits;
use crate::name;
use crate::notify::Notifier;
use crate::plan::{Plan, PlanError};
use crate::recording::folder;
use crate::remains;
use crate::settings::Refusal;
use crate::supervise::register;
use hyst_engine::Settings;
use hyst_exchange::{OwnedPage, PageError, Station, StationError, checkpoint, system};
use hyst_messages::Role;
use hyst_messages::page::station as layout;
use std::io::ErrorKind;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

/// How long a stand-in may take to make room: it looks every 20 ms.
const ROOM_NS: u64 = 2_000_000_000;
/// Between two tries to have the name, or a dead supervisor's lock.
const TRY_NS: u64 = 10_000_000;
/// How long the threads of a supervisor that was killed may take to end beside its first one.
const LETS_GO_NS: u64 = 1_000_000_000;
/// How long the remains of a station that was asked to stop may take to do so.
const STOP_NS: u64 = 2_500_000_000;

/// The station's page, and whether the station lived already.
pub struct Ground {
    /// Its page.
    pub page: OwnedPage,
    /// What was asked for.
    pub order: Order,
    /// It was taken over, not founded.
    pub adopted: bool,
}

/// The station's name. A stand-in that holds it makes room; it may not have come to say that it is one, so that whoever of this user has the name is asked.
pub fn take_name(station: &Station) -> Result<UnixListener, Refusal> {
    let deadline_ns = system::now_ns() + ROOM_NS;
    let manager = Notifier::of_environment();
    loop {
        let taken = name::take(station).map_err(|e| Refusal::failed(format!("station name: {e}")))?;
        if let Some(listener) = taken {
            return Ok(listener);
        }
        // Before each knock: the end of a stand-in that speaks for the service must not be the service's.
        manager.say(&format!("MAINPID={}\n", std::process::id()));
        if let Some(user) = name::stranger(station) {
            let name = station.name();
            return Err(Refusal::input(format!("the name {name:?} is taken by a process of user {user}; give another --name")));
        }
        if system::now_ns() > deadline_ns {
            return Err(refused(station));
        }
        let _ = name::knock(station); // who has gone meanwhile need not hear it
        system::sleep_ns(TRY_NS);
    }
}

/// The name is not to be had. Where a guardian stays that is bad input; one that ends, begins, or takes longer to make room is none: a service tries again, which
/// it does not after code 2.
fn refused(station: &Station) -> Refusal {
    let name = station.name();
    let words = format!("a station named {name:?} is running; stop it (`hystation --name {name} stop`) or give another --name");
    let stands_in = Order::read(station).is_some_and(|order| order.stand_in);
    let stops = station.open().is_ok_and(|page| page.stop_requested());
    if remains::guardian(station).is_some() && !stands_in && !stops { Refusal::input(words) } else { Refusal::failed(words) }
}

/// What a station is to run.
pub struct Wanted<'a> {
    /// Its settings.
    pub settings: &'a Settings,
    /// Their recording is the folder of it: a station that is founded has a new file there, and one that lives goes on with its own.
    pub in_folder: bool,
    /// Its processes.
    pub plan: &'a Plan,
    /// Its case, if it runs one.
    pub case: Option<&'a RunCase>,
    /// What a replay is of.
    pub again: Option<&'a Again>,
}

/// Founds the station, or takes over the one of this name that lives, if it was started with the same settings. Room is waited for until it is given up.
pub fn settle(station: &Station, wanted: &Wanted<'_>, order: Order, given_up: &dyn Fn() -> bool) -> Result<Ground, Refusal> {
    if let Some(page) = living(station)? {
        same(station, wanted)?;
        register(&page, Role::Guardian);
        // The end of `--for` counts from when the station was first ready.
        let ready_ns = Order::read(station).and_then(|before| before.ready_ns);
        let order = Order { ready_ns, ..order };
        order.write(station);
        return Ok(Ground { page, order, adopted: true });
    }
    // Not of one that was taken over: that goes on in its own.
    wanted.settings.record.as_deref().filter(|_| !wanted.in_folder).map_or(Ok(()), folder::check_file)?;
    if !station.leftovers().is_empty() {
        if is_kept_unseen(station) {
            return Err(Refusal::input(format!(
                "a station named {:?} lives, and none of its processes can be seen from here, as where another container has the same /dev/shm; give \
                 another --name",
                station.name()
            )));
        }
        eprintln!("hystation: removing what a dead station named {:?} left", station.name());
        remove_unbegun(station, &Order::read(station).unwrap_or_default());
        station.wipe();
    }
    // Beside the look at the scene: both take a while, and are done before the station's clock runs.
    let build = wanted.settings.record.as_ref().map(|_| Beside::of(&wanted.plan.binaries));
    let admitted = crate::commands::check::admit(wanted.settings, wanted.plan, wanted.case)?;
    if let Some(hash) = wanted.again.map(|again| again.scene_hash).filter(|hash| *hash != admitted.hash) {
        let (was, is) = (format!("{hash:016x}"), format!("{:016x}", admitted.hash));
        return Err(Refusal::input(format!(
            "the recording is of another scene ({was}, this one is {is}); give the one that was recorded with --scene"
        )));
    }
    let page = found(station, wanted, &admitted, build, given_up)?;
    order.write(station);
    Ok(Ground { page, order, adopted: false })
}

/// Whether a supervisor works on a station, seen or not: its lock is that of a file, and holds across containers. One that was killed is no living process any
/// more while its last threads still end, and lets go with the last of them.
fn is_kept_unseen(station: &Station) -> bool {
    let until_ns = system::now_ns() + LETS_GO_NS;
    while matches!(name::lock(station), Ok(None)) {
        if system::now_ns() >= until_ns {
            return true;
        }
        system::sleep_ns(TRY_NS);
    }
    false
}

/// The page of a station of which somebody lives; one that was asked to stop is helped to.
fn living(station: &Station) -> Result<Option<OwnedPage>, Refusal> {
    let living = remains::living(station);
    if living.is_empty() {
        return Ok(None);
    }
    match station.open_for_keeping() {
        Ok(page) if page.load32(layout::STOP) == 0 => return Ok(Some(page)),
        Ok(_) => remains::wait_until_gone(station, system::now_ns() + STOP_NS, || {}),
        Err(_) => false,
    };
    let killed = remains::kill_all(station, || {});
    if !killed.is_empty() {
        eprintln!("hystation: ended what was left of a station that was stopped: {}", killed.join(", "));
    }
    Ok(None)
}

/// Whether the station that lives was started with these settings.
fn same(station: &Station, wanted: &Wanted<'_>) -> Result<(), Refusal> {
    let (settings, plan) = (wanted.settings, wanted.plan);
    let text = std::fs::read_to_string(station.settings()).unwrap_or_default();
    let known: Option<Settings> = toml::from_str(&text).ok();
    let known = known.map(|known| as_wanted(known, wanted));
    // What was swapped meanwhile stays so, whoever keeps the station; how long a state is follows from the scene.
    let begun = Plan::read(station).ok();
    let begun = begun.map(|known| Plan { swapped: plan.swapped.clone(), state_bytes: plan.state_bytes, ..known });
    // A case that was edited since is another one.
    let is_same_case =
        wanted.case.is_none_or(|case| std::fs::read_to_string(station.case()).is_ok_and(|text| text == case.settled.text));
    if is_same_case && known.as_ref() == Some(settings) && begun.as_ref() == Some(plan) {
        return Ok(());
    }
    Err(Refusal::input(format!(
        "processes of a station named {0:?} still run without their guardian, with other settings; end them with `hystation --name {0} stop`, or \
         run with the same settings to take them over",
        station.name()
    )))
}

/// The settings of a station that lives, with what the command that takes it over does not name: it goes on from when it began, and with the file that was made
/// for it then.
fn as_wanted(known: Settings, wanted: &Wanted<'_>) -> Settings {
    let Settings { begun_unix_s, record: named, .. } = wanted.settings;
    let is_there = |folder: &PathBuf| known.record.as_deref().and_then(Path::parent) == Some(folder.as_path());
    let record = named.clone().filter(|folder| wanted.in_folder && is_there(folder)).or_else(|| known.record.clone());
    Settings { begun_unix_s: *begun_unix_s, record, ..known }
}

/// The settings of a station that begins now.
fn begun(wanted: &Wanted<'_>) -> Result<Settings, Refusal> {
    let begun_unix_s = hyst_exchange::machine::now_unix_s();
    let settings = wanted.settings;
    let record = match &settings.record {
        Some(folder) if wanted.in_folder => Some(folder::make_file(folder, settings, begun_unix_s)?),
        record => record.clone(),
    };
    Ok(Settings { begun_unix_s, record, ..settings.clone() })
}

fn found(
    station: &Station,
    wanted: &Wanted<'_>,
    scene: &Admitted,
    build: Option<Beside>,
    given_up: &dyn Fn() -> bool,
) -> Result<OwnedPage, Refusal> {
    let settings = wanted.settings;
    let copied = Copied::of(settings, wanted.case);
    let needed = needed_bytes(scene.state_bytes) + copied.bytes();
    room::await_room(needed, &Notifier::of_environment(), given_up)?;
    let begun = begun(wanted)?;
    let made = make(station, wanted, &begun, scene, build);
    if made.is_err() {
        station.wipe(); // nothing half-founded stays
        if let Some(file) = begun.record.filter(|_| wanted.in_folder) {
            let _ = std::fs::remove_file(file); // it is empty
        }
    }
    let page = made?;
    copied.lay(station, scene.hash);
    page.store64(layout::SCENE_HASH, scene.hash);
    page.store32(layout::WORKERS, settings.workers as u32);
    page.store32(layout::TEST_MODE, settings.test_mode as u32);
    page.store32(layout::LOCKSTEP, settings.lockstep as u32);
    register(&page, Role::Guardian);
    Ok(page)
}

fn make(
    station: &Station,
    wanted: &Wanted<'_>,
    settings: &Settings,
    scene: &Admitted,
    build: Option<Beside>,
) -> Result<OwnedPage, Refusal> {
    let build = build.and_then(Beside::wait); // without one the recording names none
    station.found().map_err(unmade)?;
    let text = text_of(settings)?;
    let laid_down = |path: PathBuf, content: &[u8]| {
        std::fs::write(&path, content)
            .map_err(|e| Refusal::of_system(e.kind(), format!("{}: {e}; look at `df /dev/shm`", path.display())))
    };
    laid_down(station.settings(), text.as_bytes())?;
    laid_down(station.pivot(), &scene.pivot_m.map(f32::to_ne_bytes).concat())?;
    laid_down(station.pathology(), scene.pathology_ml.to_string().as_bytes())?;
    laid_down(Limits::path(station), Limits::own().text().as_bytes())?;
    build.map_or(Ok(()), |build| laid_down(station.build(), build.as_bytes()))?;
    let plan = Plan { state_bytes: scene.state_bytes, ..wanted.plan.clone() };
    plan.write(station).map_err(|e| match &e {
        PlanError::File { source, .. } => Refusal::of_system(source.kind(), e.to_string()),
        PlanError::Content { .. } => Refusal::input(e.to_string()),
    })?;
    wanted.case.map_or(Ok(()), |case| case.keep(station))?;
    let page = station.open_for_keeping().map_err(unmade)?;
    wanted.again.map_or(Ok(()), |again| begin_later(station, &page, again))?;
    Ok(page)
}

/// The settings as they are kept. Names of files are text there.
fn text_of(settings: &Settings) -> Result<String, Refusal> {
    toml::to_string(settings).map_err(|e| {
        Refusal::input(format!(
            "settings: {e}; the station keeps the names of scene, recording and pictures as UTF-8: start it where every folder above them has such a name"
        ))
    })
}

/// A station that the system refused to make.
fn unmade(error: StationError) -> Refusal {
    let kind = match &error {
        StationError::Root { source, .. } => source.kind(),
        StationError::Page(PageError::Refused { reason, .. }) => std::io::Error::from(*reason).kind(),
        StationError::Page(PageError::Foreign { .. }) | StationError::Name(_) => ErrorKind::InvalidInput,
    };
    Refusal::of_system(kind, error.to_string())
}

/// Lays down what a replay begins with that does not begin at the beginning, and sets its clock.
fn begin_later(station: &Station, page: &OwnedPage, again: &Again) -> Result<(), Refusal> {
    for state in &again.states {
        checkpoint::lay_first(station, state.role, &state.state).map_err(|e| {
            Refusal::of_system(e.kind(), format!("a state of the {}: {e}; look at `df /dev/shm`", state.role.name()))
        })?;
    }
    page.store64(layout::ENDED_TICK, again.replay.begin_tick);
    page.store64(layout::BEGUN_TICK, again.replay.begin_tick);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    /// What seemed to be left of a dead station, since its processes had numbers of another container's, was removed beneath it.
    #[test]
    fn a_station_whose_supervisor_has_its_lock_is_not_taken_for_dead() {
        let station = Station::named(&format!("t{}-unseen", std::process::id())).unwrap();
        station.wipe();
        assert!(!is_kept_unseen(&station), "there is none");
        station.found().unwrap();
        let _held = name::lock(&station).unwrap().unwrap();
        assert!(is_kept_unseen(&station));
        station.wipe();
    }

    /// By these lines the package's script knows that somebody trains.
    #[test]
    fn a_case_and_a_recording_have_a_line_each_in_what_is_laid_down_and_without_them_there_is_none() {
        let tells = |settings: Settings| {
            let is_one = |line: &str| line.split_whitespace().next().is_some_and(|key| ["case", "record"].contains(&key));
            text_of(&settings).unwrap().lines().filter(|line| is_one(line)).count()
        };
        let file = || Some(PathBuf::from("/a/b"));
        let all = Settings { case: file(), record: file(), ..Settings::default() };
        assert_eq!([tells(Settings::default()), tells(all)], [0, 2]);
    }

    #[test]
    fn a_name_that_is_no_text_is_bad_input_and_one_with_blanks_and_umlauts_is_kept() {
        let of = |name: &[u8]| {
            let record = Some(Path::new("/home/a").join(OsStr::from_bytes(name)));
            text_of(&Settings { record, ..Settings::default() }).map(|text| toml::from_str::<Settings>(&text).unwrap().record)
        };
        let refusal = of(b"M\xfcller/a.mcap").unwrap_err();
        assert!(refusal.code == 2 && refusal.message.contains("UTF-8: start it where"), "{}", refusal.message);
        assert_eq!(of("Frau Müller/a b.mcap".as_bytes()), Ok(Some(PathBuf::from("/home/a/Frau Müller/a b.mcap"))));
    }
}
