//! Starting an incarnation: number, page, services, process, and then the words in the station page that tell everyone. And its end:
//! the services are dropped and the page is removed, after the process was reaped.
//!
//! The services of an incarnation exist before its process does, and the supervisor holds them while it lives, so that a process that
//! dies while it starts cannot leave a service half-made.

mod heads;
mod room;
mod seat;

use crate::intent::{Deed, Intent, Mortality};
use crate::limits::Limits;
use crate::plan::{Plan, PlanError};
use crate::policy::Exit;
use crate::proc;
use crate::remains::Living;
use crate::watch::Ward;
use hyst_exchange::page::PageError;
use hyst_exchange::rendezvous::HeldRendezvous;
use hyst_exchange::stream::HeldService;
use hyst_exchange::{LinkError, Links, OwnedPage, Station, StationError, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Kind, Role, Slot, kinds_of};
pub use room::{LEAST_FREE, is_full};
use rustix::io::Errno;
use rustix::process::{PidfdFlags, WaitId, WaitIdOptions, WaitOptions, waitid};
use seat::Seat;
use std::collections::BTreeMap;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;

/// Why an incarnation could not be started.
#[derive(Debug, thiserror::Error)]
pub enum SpawnError {
    /// Its page.
    #[error("{0}: {1}")]
    Page(Slot, PageError),
    /// Its services.
    #[error("{0}: {1}")]
    Link(Slot, LinkError),
    /// Its process or log.
    #[error("{slot}: cannot start {path}: {source}; `./station build` makes all programs, or install the package again")]
    Process {
        /// Where.
        slot: Slot,
        /// The binary or log.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file system of the station's memory is too full for it.
    #[error("{0}: {1}")]
    Room(Slot, room::NoRoom),
    /// It was gone before it could be watched.
    #[error("{0}: the process was gone before it could be watched; look at its log")]
    Gone(Slot),
    /// The station.
    #[error(transparent)]
    Station(#[from] StationError),
}

impl SpawnError {
    /// Whether this process had no file descriptor left for it.
    pub fn is_want_of_files(&self) -> bool {
        match self {
            SpawnError::Page(_, error) => error.is_want_of_files(),
            SpawnError::Process { source, .. } => source.raw_os_error() == Some(Errno::MFILE.raw_os_error()),
            _ => false,
        }
    }
}

#[derive(Debug)]
enum Service {
    Stream(#[allow(dead_code, reason = "held, not used")] HeldService),
    Rendezvous(#[allow(dead_code, reason = "held, not used")] HeldRendezvous),
}

/// Starts another process of this very program, `subcommand --station NAME`, in a process group of its own and with the log of `role`: the
/// supervisor for its guardian, the stand-in of the guardian for the supervisor. With a priority it is real time from the beginning. It has the limits that the
/// station began with. Gives its process id; whoever starts it reaps it.
pub fn start_own(station: &Station, subcommand: &str, role: Role, priority: Option<i32>) -> std::io::Result<u32> {
    let log = std::fs::OpenOptions::new().append(true).create(true).open(station.log(Slot::first(role)))?;
    let mut command = proc::own_program();
    command.args([subcommand, "--station", station.name()]).process_group(0);
    command.stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
    start_as_begun(station, &mut command, priority).map(|child| child.id())
}

/// Starts a process with the limits that the station began with; with a priority it is real time from the beginning.
pub fn start_as_begun(station: &Station, command: &mut Command, priority: Option<i32>) -> std::io::Result<Child> {
    let child = match priority {
        Some(priority) => proc::start_at(priority, command)?,
        None => proc::start(command, false)?,
    };
    if let Some(limits) = Limits::of(station) {
        limits.give(child.id());
    }
    Ok(child)
}

/// How often the guardian is asked again how a process ended that it has reaped and not told of yet, and the time between, ns.
const MOST_ASKED_OF_GUARDIAN: u32 = 10;
const BETWEEN_ASKED_NS: u64 = 500_000;

/// Starts and buries incarnations.
#[derive(Debug)]
pub struct Spawner {
    station: Station,
    page: Arc<OwnedPage>,
    links: Links,
    plan: Plan,
    held: BTreeMap<(Slot, u32), Vec<Service>>,
    /// Who is in which slot, as it was entered or adopted.
    seats: BTreeMap<Slot, Seat>,
    /// What each process starts with, whatever this one may have by then.
    limits: Limits,
    /// The slot that starts from another binary than its role's, while a swap tries that.
    pub candidate: Option<(Slot, PathBuf)>,
    /// Where this supervisor is to die, if a test wants that.
    pub mortality: Mortality,
}

impl Spawner {
    /// Joins the station's link domain, and has the beginnings of the plan's programs kept in memory.
    pub fn new(station: &Station, page: Arc<OwnedPage>, plan: Plan) -> Result<Spawner, LinkError> {
        heads::keep(&plan);
        let links = Links::join(station, "supervisor")?;
        let mortality = Mortality::of(station);
        let limits = Limits::of(station).unwrap_or_else(Limits::own);
        let (held, seats) = (BTreeMap::new(), BTreeMap::new());
        Ok(Spawner { station: station.clone(), page, links, plan, held, seats, limits, candidate: None, mortality })
    }

    /// Starts a new incarnation in a slot whose last owner was reaped.
    pub fn spawn(&mut self, slot: Slot) -> Result<Ward, SpawnError> {
        let incarnation = self.page.fetch_add64(layout::NEXT_INCARNATION, 1) as u32;
        Intent { deed: Deed::Spawn, slot, incarnation }.declare(&self.page);
        self.mortality.pass("spawn-declared");
        let made = self.make(slot, incarnation);
        Intent::clear(&self.page);
        if made.is_err() {
            self.bury(slot, incarnation);
        }
        made
    }

    fn make(&mut self, slot: Slot, incarnation: u32) -> Result<Ward, SpawnError> {
        room::look(&self.station, slot.role(), self.plan.state_bytes).map_err(|no_room| SpawnError::Room(slot, no_room))?;
        drop(self.station.create_slot(slot, incarnation).map_err(|e| SpawnError::Page(slot, e))?);
        self.mortality.pass("spawn-paged");
        self.create_services(slot, incarnation)?;
        self.mortality.pass("spawn-served");
        self.start(slot, incarnation)
    }

    fn create_services(&mut self, slot: Slot, incarnation: u32) -> Result<(), SpawnError> {
        let mut services = Vec::new();
        for &kind in kinds_of(slot.role()) {
            let service = match kind {
                Kind::Appearance => self.links.create_rendezvous(slot.role(), incarnation, kind).map(Service::Rendezvous),
                _ => self.links.create_service(slot.role(), incarnation, kind).map(Service::Stream),
            };
            services.push(service.map_err(|e| SpawnError::Link(slot, e))?);
        }
        self.held.insert((slot, incarnation), services);
        Ok(())
    }

    fn start(&mut self, slot: Slot, incarnation: u32) -> Result<Ward, SpawnError> {
        let on_trial = self.candidate.as_ref().filter(|(trial, _)| *trial == slot).map(|(_, binary)| binary.clone());
        let binary = on_trial.unwrap_or_else(|| self.plan.binary(slot.role()));
        let log_path = self.station.log(slot);
        let fail = |path: &std::path::Path, source| SpawnError::Process { slot, path: path.display().to_string(), source };
        let log = crate::journal::open_log(&self.station, slot, incarnation).map_err(|e| fail(&log_path, e))?;
        let second = log.try_clone().map_err(|e| fail(&log_path, e))?;
        let spawned_ns = system::now_ns();
        // Without pre_exec the standard library uses posix_spawn, which does not copy this process, and waits until the other one has its own program: see `heads`.
        let mut command = Command::new(&binary);
        command
            .args(["--station", self.station.name(), "--slot", &slot.to_string(), "--incarnation", &incarnation.to_string()])
            // No layers that search for devices, and no threads of the software rasterizer beside its queue's: pictures give way to the
            // engines, and such a thread unlocks a fence that another may have freed (docs/faults.md).
            .envs([("LP_NUM_THREADS", "0"), ("NODEVICE_SELECT", "1")])
            .env(proc::MARK, proc::mark_of(&self.station, incarnation))
            .stdin(Stdio::null())
            .stdout(log)
            .stderr(second)
            .process_group(0);
        // Without these two the hand has nothing, or nobody who stands in.
        let in_a_hurry = [Role::Device, Role::Haptic].contains(&slot.role());
        let mut child = proc::start(&mut command, in_a_hurry).map_err(|e| fail(&binary, e))?;
        self.limits.give(child.id());
        self.mortality.pass("spawn-started");
        self.enter(slot, incarnation, child.id());
        self.mortality.pass("spawn-entered");
        // Nobody would see it die, and its slot would be filled again.
        self.watch(slot, incarnation, child.id(), spawned_ns).inspect_err(|_| {
            proc::end_group(child.id());
            let _ = child.kill().and_then(|()| child.wait()); // one that has ended already is as good
            self.mark_dead(slot, incarnation);
            self.page.store32(layout::SLOT_BOOKED + slot.number(), incarnation); // as a start that failed
        })
    }

    /// Says in the station page who is in the slot.
    pub fn enter(&mut self, slot: Slot, incarnation: u32, pid: u32) {
        // A child that has already exited is still a zombie of this process: it has no start time, but a pidfd.
        let seat = Seat { incarnation, pid, start: system::process_start(pid).unwrap_or(0) };
        seat.say(&self.page, slot);
        self.seats.insert(slot, seat);
    }

    /// Writes anew what the station page no longer says of who lives in the slots, as where a bit has flipped: by a wrong process id nobody could be ended or
    /// adopted, by a wrong incarnation everybody takes it for another. Gives where it had to.
    pub fn mend_seats(&self) -> Vec<Slot> {
        self.seats.iter().filter(|(slot, seat)| seat.mend(&self.page, **slot)).map(|(slot, _)| *slot).collect()
    }

    /// The process that was entered or adopted as this incarnation, if it lives: whatever the station page says of it by now.
    pub fn living(&self, slot: Slot, incarnation: u32) -> Option<Living> {
        self.seats.get(&slot).filter(|seat| seat.incarnation == incarnation)?.living(slot)
    }

    fn watch(&self, slot: Slot, incarnation: u32, pid: u32, spawned_ns: u64) -> Result<Ward, SpawnError> {
        let process = proc::pid(pid).ok_or(SpawnError::Gone(slot))?;
        let pidfd = rustix::process::pidfd_open(process, PidfdFlags::empty()).map_err(|error| self.unwatched(slot, error))?;
        let page = self.station.read_slot(slot, incarnation).map_err(|e| SpawnError::Page(slot, e))?;
        Ok(Ward::new(slot, incarnation, pid, pidfd, page, spawned_ns))
    }

    /// Why a process has no descriptor to be watched by.
    fn unwatched(&self, slot: Slot, error: Errno) -> SpawnError {
        if error != Errno::MFILE {
            return SpawnError::Gone(slot);
        }
        SpawnError::Process { slot, path: self.plan.binary(slot.role()).display().to_string(), source: error.into() }
    }

    /// Takes over an incarnation that a supervisor before this one started; `None` if it is not alive.
    pub fn adopt(&mut self, slot: Slot) -> Option<Ward> {
        let page = self.station.open().ok()?;
        let living = crate::remains::slot_alive(&page, slot.number())?;
        let incarnation = page.incarnation(slot);
        // Between the look at the page and the opening of its descriptor the id may have become somebody else's.
        let ward = self.watch(slot, incarnation, living.pid, system::now_ns()).ok().filter(|_| living.is_alive())?;
        let mut services = Vec::new();
        for &kind in kinds_of(slot.role()) {
            let service = match kind {
                Kind::Appearance => self.links.hold_rendezvous(slot.role(), incarnation, kind).map(Service::Rendezvous),
                _ => self.links.hold_service(slot.role(), incarnation, kind).map(Service::Stream),
            };
            services.extend(service.ok()); // not held means only that it goes with the engine
        }
        self.held.insert((slot, incarnation), services);
        self.seats.insert(slot, Seat { incarnation, pid: living.pid, start: living.start });
        Some(ward)
    }

    /// Says that the slot's incarnation is dead, if it is still the one in the slot.
    pub fn mark_dead(&mut self, slot: Slot, incarnation: u32) {
        let at = slot.number();
        // By a word that has flipped it would be nobody's death; and who is dead is not said to live again.
        if let Some(seat) = self.seats.get(&slot).copied().filter(|seat| seat.incarnation == incarnation) {
            seat.mend(&self.page, slot);
            self.seats.remove(&slot);
        }
        if self.page.load32(layout::SLOT_INCARNATION + at) == incarnation && self.page.load32(layout::SLOT_DEAD + at) == 0 {
            self.page.store32(layout::SLOT_DEAD + at, 1);
            self.page.bump_and_wake(layout::CHANGES);
        }
    }

    /// From now on the role's slots start from this binary; a supervisor that is restarted knows it from the plan.
    pub fn adopt_binary(&mut self, role: Role, binary: PathBuf) -> Result<(), PlanError> {
        self.candidate = None;
        self.plan.swapped.insert(role.name().to_string(), binary);
        self.plan.write(&self.station)
    }

    /// Says that nobody is in a slot, and that nobody is missed there.
    pub fn vacate(&mut self, slot: Slot) {
        let at = slot.number();
        self.seats.remove(&slot);
        self.page.store32(layout::SLOT_INCARNATION + at, 0);
        self.page.store32(layout::SLOT_PID + at, 0);
        self.page.store32(layout::SLOT_DEAD + at, 0);
        self.page.bump_and_wake(layout::CHANGES);
    }

    /// Drops the services of a dead incarnation and removes its page.
    pub fn bury(&mut self, slot: Slot, incarnation: u32) {
        Intent { deed: Deed::Bury, slot, incarnation }.declare(&self.page);
        self.mortality.pass("bury-declared");
        self.held.remove(&(slot, incarnation));
        let _ = std::fs::remove_file(self.station.slot_page(slot, incarnation)); // gone already is as good
        self.mortality.pass("bury-done");
        Intent::clear(&self.page);
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
}

/// Takes the exit status of a dead child.
pub fn reap(pid: u32) -> Exit {
    let reaped = proc::pid(pid).and_then(|pid| rustix::process::waitpid(Some(pid), WaitOptions::NOHANG).ok().flatten());
    reaped.map_or(Exit::Unknown, |(_, status)| exit_of(status.as_raw()))
}

/// Says in the station's page how a dead child that is in a slot has ended, for whoever is supervisor next, and ends what it had started. To be called before
/// it is reaped: after that nobody can ask, and the number of its group may be that of others.
pub fn note_exit(page: &OwnedPage, slot: usize, pid: u32) {
    let asked = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    let status = proc::pid(pid).and_then(|pid| waitid(WaitId::Pid(pid), asked).ok().flatten());
    if status.is_some() {
        proc::end_group(pid);
    }
    let raw = status.and_then(|it| it.terminating_signal().or_else(|| it.exit_status().map(|code| code << 8)));
    if let Some(raw) = raw {
        page.store64(layout::SLOT_EXIT + slot, layout::exit_word(pid, raw));
    }
}

/// How the process that is or was last in a slot ended. An adopted one is the guardian's child: until that has reaped it it is a zombie, and before or right
/// after that the guardian says how it ended.
pub fn reap_in_slot(page: &OwnedPage, slot: Slot, pid: u32) -> Exit {
    note_exit(page, slot.number(), pid);
    let own = reap(pid);
    let known = || layout::exit_of(page.load64(layout::SLOT_EXIT + slot.number()), pid);
    let told = || known().or_else(|| proc::status_of_zombie(pid)).or_else(known).map_or(Exit::Unknown, exit_of);
    let mut exit = if own == Exit::Unknown { told() } else { own };
    for _ in 0..MOST_ASKED_OF_GUARDIAN {
        if exit != Exit::Unknown {
            break;
        }
        system::sleep_ns(BETWEEN_ASKED_NS);
        exit = told();
    }
    exit
}

fn exit_of(status: i32) -> Exit {
    let status = ExitStatus::from_raw(status);
    match (status.code(), status.signal()) {
        (Some(code), _) => Exit::Code(code),
        (None, Some(signal)) => Exit::Signal(signal),
        (None, None) => Exit::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the page alone it was known.
    #[test]
    fn who_can_open_no_file_says_so_of_a_log_and_of_a_process_too() {
        let slot = Slot::first(Role::Fluid);
        let of = |errno: Errno| SpawnError::Process { slot, path: "fluid".into(), source: errno.into() }.is_want_of_files();
        assert_eq!([of(Errno::MFILE), of(Errno::NOENT), SpawnError::Gone(slot).is_want_of_files()], [true, false, false]);
    }
}
