//! The supervisor: it takes events (deaths, late heartbeats, requests, time), asks the policy, and does what the policy says. It links no
//! simulation. Engines do not depend on its life: a supervisor that is restarted adopts those that it finds.

mod effects;

use crate::accounts::Accounts;
use crate::clean::Cleaner;
use crate::control::{self, Request};
use crate::faults::Faults;
use crate::journal;
use crate::plan::{Plan, PlanError};
use crate::policy::{self, Event, Exit, State};
use crate::spawn::{self, Spawner};
use crate::view::Viewer;
use crate::watch::{Notice, Watch};
use hyst_exchange::{LinkError, OwnedPage, Station, StationError, system};
use hyst_messages::page::{ProcessState, header, station as layout};
use hyst_messages::{Role, Slot};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Longest wait of the main loop: a stop, an injection or a due restart is seen this soon.
const PERIOD: Duration = Duration::from_millis(5);
/// Between two readings of the hardware's ledger, which holds 16 s.
const LEDGER_NS: u64 = 100_000_000;
/// Between two readings of all pages for the accounts and the report.
const ACCOUNTS_NS: u64 = 1_000_000_000;
/// How long engines may take to stop: they promise 200 ms.
pub const STOP_NS: u64 = 2_000_000_000;

/// Why the supervisor cannot work.
#[derive(Debug, thiserror::Error)]
pub enum SuperviseError {
    /// The station.
    #[error(transparent)]
    Station(#[from] StationError),
    /// The plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A thread or socket.
    #[error("supervisor of station {0}: {1}; look at the limits of processes and files (`hystation doctor`)")]
    System(String, std::io::Error),
}

/// What the main loop takes.
#[derive(Debug)]
pub enum Input {
    /// From the watching thread.
    Notice(Notice),
    /// From the control socket, with the way back.
    Request(Request, Sender<String>),
}

struct Supervisor {
    station: Station,
    page: Arc<OwnedPage>,
    spawner: Spawner,
    watch: Watch,
    policy: State,
    cleaner: Cleaner,
    viewer: Viewer,
    accounts: Accounts,
    faults: Faults,
    slots: Vec<Slot>,
    next_ledger_ns: u64,
    next_accounts_ns: u64,
    /// The incarnation that was last replaced because the device distrusts it.
    heeded: u32,
}

/// Supervises a station that was founded, until it stops. Gives the exit code.
pub fn supervise(station: &Station) -> Result<u8, SuperviseError> {
    let system_error = |e| SuperviseError::System(station.name().to_string(), e);
    let page = Arc::new(station.open_for_keeping()?);
    register(&page, Role::Supervisor);
    page.fetch_add64(layout::SUPERVISOR_STARTS, 1);
    let plan = Plan::read(station)?;
    let (tell, inbox) = channel::<Input>();
    let notices = tell.clone();
    let real_time = std::fs::read_to_string(station.settings())
        .ok()
        .and_then(|text| toml::from_str::<hyst_engine::Settings>(&text).ok())
        .is_none_or(|settings| settings.switch("realtime", true).unwrap_or(true));
    let watch = Watch::start(Arc::clone(&page), real_time, move |notice| {
        let _ = notices.send(Input::Notice(notice)); // the inbox lives as long as the process
    })
    .map_err(system_error)?;
    control::serve(station, tell).map_err(system_error)?;
    let slots = plan.slots();
    let mut supervisor = Supervisor {
        station: station.clone(),
        spawner: Spawner::new(station, Arc::clone(&page), plan.clone())?,
        policy: State::new(&slots),
        watch,
        cleaner: Cleaner::default(),
        viewer: Viewer::open(station)?,
        accounts: Accounts::read(station),
        faults: Faults::new(station, &plan.faults)?,
        slots,
        page,
        next_ledger_ns: 0,
        next_accounts_ns: 0,
        heeded: 0,
    };
    supervisor.start();
    Ok(supervisor.run(&inbox))
}

/// Says in the station page who this process is.
pub fn register(page: &OwnedPage, role: Role) {
    let (pid, at) = (std::process::id(), Slot::first(role).number());
    page.store64(layout::SLOT_START + at, system::process_start(pid).unwrap_or(0));
    page.store32(layout::SLOT_PID + at, pid);
    page.store32(layout::SLOT_DEAD + at, 0);
    match role {
        Role::Guardian => page.store64(layout::GUARDIAN_PID, pid as u64),
        _ => page.store64(layout::SUPERVISOR_PID, pid as u64),
    }
}

impl Supervisor {
    fn start(&mut self) {
        let mut adopted = Vec::new();
        for slot in self.slots.clone() {
            if let Some(ward) = self.spawner.adopt(slot) {
                adopted.push((slot, ward.incarnation));
                self.watch.add(ward);
            }
        }
        self.end_strays();
        let now_ns = system::now_ns();
        for slot in self.slots.clone() {
            let incarnation = self.viewer.page().incarnation(slot);
            if incarnation != 0 && !adopted.contains(&(slot, incarnation)) {
                // It died while nobody watched.
                let beat_ns = self.viewer.slot_page(slot).map_or(0, |page| page.load64(header::HEARTBEAT_NS));
                self.mourn(slot, incarnation, Exit::Unknown, now_ns, beat_ns);
                self.spawner.mark_dead(slot, incarnation);
                self.spawner.bury(slot, incarnation);
            }
        }
        if self.page.load64(layout::SUPERVISOR_STARTS) > 1 {
            journal::say(&self.station, &format!("the supervisor was restarted and adopted {} engines", adopted.len()));
            self.faults.supervisor_died(self.page.load64(layout::SUPERVISOR_NS), system::now_ns());
            self.cleaner.ask(system::now_ns());
        }
        let actions = policy::step(system::now_ns(), Event::Started { adopted }, &mut self.policy);
        self.act(actions);
    }

    /// Ends processes of this station that no slot knows: a supervisor died between their spawn and their entry in the page.
    fn end_strays(&self) {
        let known = |living: &crate::remains::Living| living.name != "unregistered";
        for living in crate::remains::living(&self.station).iter().filter(|living| !known(living)) {
            crate::proc::demote_and_kill(living.pid);
            journal::say(&self.station, &format!("process {} belonged to no slot and was ended", living.pid));
        }
    }

    fn run(&mut self, inbox: &Receiver<Input>) -> u8 {
        let mut stop_since_ns = None;
        loop {
            match inbox.recv_timeout(PERIOD) {
                Ok(input) => self.take(input),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
            let now_ns = system::now_ns();
            self.page.store64(layout::SUPERVISOR_NS, now_ns);
            if self.page.load32(layout::STOP) != 0 {
                let since_ns = *stop_since_ns.get_or_insert(now_ns);
                policy::step(now_ns, Event::StopRequested, &mut self.policy);
                if !self.policy.anyone_alive() || now_ns - since_ns > STOP_NS {
                    return self.finish();
                }
            }
            let actions = policy::step(now_ns, Event::Tick, &mut self.policy);
            self.act(actions);
            self.chores(now_ns);
        }
    }

    fn chores(&mut self, now_ns: u64) {
        self.faults.tend(now_ns, &mut self.viewer);
        if self.policy.is_stopping() {
            return;
        }
        self.cleaner.tend(&self.station, now_ns);
        self.heed_the_device(now_ns);
        if now_ns >= self.next_ledger_ns {
            self.next_ledger_ns = now_ns + LEDGER_NS;
            self.faults.read_ledger(&mut self.viewer);
        }
        if now_ns >= self.next_accounts_ns {
            self.next_accounts_ns = now_ns + ACCOUNTS_NS;
            self.sample_all(now_ns);
            self.accounts.write(&self.station);
            self.faults.keep_open();
            self.hand_over();
        }
    }

    /// Replaces a servo whose output the device refused (not finite, out of range, for another input, frozen), as long as the device follows the
    /// other one. One that stands still is found by its heartbeat. One that only differs is not killed: two servos that lost different ticks
    /// to a stall differ in the last bits, and the device stays with the nearer.
    fn heed_the_device(&mut self, now_ns: u64) {
        use hyst_messages::page::device::{self, Distrust};
        for index in 0..Role::Haptic.slots().1 {
            let Some(slot) = Slot::new(Role::Haptic, index) else { continue };
            let Some(page) = self.viewer.slot_page(Slot::first(Role::Device)) else { return };
            let word = page.load64(device::DISTRUSTED + index);
            let (why, incarnation) = (word >> 32, word as u32);
            let refused = |why: u64| why == Distrust::Invalid as u64 || why == Distrust::Frozen as u64;
            let followed = page.load64(device::SELECTED_INCARNATION) as u32;
            let present = self.viewer.page().incarnation(slot) == incarnation && !self.viewer.page().is_dead(slot);
            if incarnation == 0 || incarnation == followed || !present || !refused(why) || self.heeded == incarnation {
                continue;
            }
            self.heeded = incarnation;
            journal::say(&self.station, &format!("{slot} is distrusted by the device (reason {why}) and is replaced"));
            self.faults.late(slot, incarnation, now_ns, now_ns, "device");
            self.act(vec![policy::Action::Kill { slot, incarnation }]);
        }
    }

    fn hand_over(&mut self) {
        let report = crate::report::build(&mut self.viewer, &self.accounts, &self.faults, &self.policy);
        crate::report::hand_over(&self.station, &report);
    }

    fn sample_all(&mut self, now_ns: u64) {
        for slot in self.slots.clone() {
            let (pid, dead) = (self.viewer.page().pid(slot), self.viewer.page().is_dead(slot));
            self.sample(now_ns, slot, (!dead).then_some(pid));
        }
    }

    fn sample(&mut self, now_ns: u64, slot: Slot, process: Option<u32>) {
        let incarnation = self.viewer.page().incarnation(slot);
        let Some(page) = self.viewer.slot_page(slot) else {
            return;
        };
        let ready = matches!(page.state(), ProcessState::Warm | ProcessState::Live | ProcessState::Stopping);
        self.accounts.sample(now_ns, slot, incarnation, page, process, ready);
    }

    fn take(&mut self, input: Input) {
        match input {
            Input::Notice(Notice::Ready { slot, incarnation, at_ns }) => {
                policy::step(at_ns, Event::Ready { slot, incarnation }, &mut self.policy);
                self.faults.ready(slot, incarnation, at_ns);
            }
            Input::Notice(Notice::Late { slot, incarnation, at_ns, beat_ns }) => {
                journal::say(
                    &self.station,
                    &format!("{slot} hangs (last heartbeat {} ms ago) and is killed", (at_ns - beat_ns.min(at_ns)) / 1_000_000),
                );
                self.faults.late(slot, incarnation, at_ns, beat_ns, "heartbeat");
                let actions = policy::step(at_ns, Event::HeartbeatLate { slot, incarnation }, &mut self.policy);
                self.act(actions);
            }
            Input::Notice(Notice::Died { slot, incarnation, pid, at_ns, beat_ns }) => {
                let exit = spawn::reap(pid);
                if !self.policy.is_stopping() && self.page.load32(layout::STOP) == 0 {
                    self.mourn(slot, incarnation, exit, at_ns, beat_ns);
                }
                let actions = policy::step(at_ns, Event::Died { slot, incarnation, exit }, &mut self.policy);
                self.act(actions);
            }
            Input::Request(request, reply) => {
                let _ = reply.send(self.answer(&request)); // who asked may have gone
            }
        }
    }

    fn mourn(&mut self, slot: Slot, incarnation: u32, exit: Exit, at_ns: u64, beat_ns: u64) {
        let words = self.viewer.slot_page(slot).map(|page| page.last_words()).unwrap_or_default();
        let words = if words.is_empty() { String::new() } else { format!(": {words}") };
        journal::say(&self.station, &format!("{slot} (incarnation {incarnation}) died, {exit}{words}"));
        self.sample(at_ns, slot, None);
        self.faults.died(slot, incarnation, exit, at_ns, beat_ns);
        self.page.fetch_add64(layout::SLOT_RESTARTS + slot.number(), 1);
        self.cleaner.ask(at_ns);
    }

    fn answer(&mut self, request: &Request) -> String {
        match request {
            Request::Stop => {
                self.page.store32_and_wake(layout::STOP, 1);
                self.page.bump_and_wake(layout::CHANGES);
                control::good(serde_json::json!({}))
            }
            Request::Status => control::good(serde_json::to_value(self.viewer.look()).unwrap_or_default()),
            Request::Report => {
                self.sample_all(system::now_ns());
                control::good(crate::report::build(&mut self.viewer, &self.accounts, &self.faults, &self.policy))
            }
            Request::Fault(injection) if self.page.load32(layout::TEST_MODE) != 0 => {
                match self.faults.inject(injection, &mut self.viewer) {
                    Ok(()) => control::good(serde_json::json!({})),
                    Err(reason) => control::bad(&reason),
                }
            }
            Request::Fault(_) => control::bad("faults are refused outside of test mode; start the station with --test-mode"),
        }
    }
}
