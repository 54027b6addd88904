//! The supervisor: it takes events (deaths, late heartbeats, requests, time), asks the policy, and does what the policy says. It links no
//! simulation. Engines do not depend on its life: a supervisor that is restarted adopts those that it finds.

mod accounting;
mod complaint;
mod distrust;
mod effects;
mod flood;
mod kept;
mod mourning;
mod reach;
mod resume;
mod rights;
mod roles;
mod standstill;
pub mod trial;

use crate::accounts::Accounts;
use crate::clean::Cleaner;
use crate::control::{self, Request};
use crate::fault::Death;
use crate::faults::Faults;
use crate::journal;
use crate::lockstep::Permit;
use crate::name;
use crate::oom::OutOfMemory;
use crate::plan::{Plan, PlanError};
use crate::policy::{self, Event, Exit, State};
use crate::spawn::{self, Spawner};
use crate::standstill::Progress;
use crate::swap::judge::Seen;
use crate::view::Viewer;
use crate::watch::{Notice, Watch};
use hyst_engine::realtime::{DEVICE_RETURNS_PRIORITY, SUPERVISOR_PRIORITY};
use hyst_exchange::{LinkError, OwnedPage, Roster, Station, StationError, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Longest wait of the main loop: a stop, an injection or a due restart is seen this soon.
const PERIOD: Duration = Duration::from_millis(5);
/// Between two answers while somebody else waits for one: a flood of requests leaves pictures and flow their cores.
const ANSWER_PAUSE_NS: u64 = 4_000_000;
/// Between two readings of the hardware's ledger, which holds 16 s, and two looks at what the engines have printed.
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
    /// From the judge of a newcomer.
    Judged {
        /// The newcomer.
        incarnation: u32,
        /// What was seen so far.
        seen: Seen,
    },
    /// That judge has ended.
    JudgeEnded {
        /// The newcomer.
        incarnation: u32,
    },
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
    permit: Option<Permit>,
    progress: Progress,
    holders: roles::Holders,
    kept: kept::Kept,
    complaint: complaint::Complaint,
    /// What the device states of its workspace was held against the case.
    is_reach_known: bool,
    memory: OutOfMemory,
    slots: Vec<Slot>,
    next_ledger_ns: u64,
    next_accounts_ns: u64,
    /// The next part of the accounts, from 0, while they are under way.
    accounting: Option<usize>,
    /// Requests that wait until no notice does.
    asked: VecDeque<(Request, Sender<String>)>,
    /// When the last one was answered.
    answered_ns: u64,
    /// Who is not trusted, and what others say of them.
    distrusted: distrust::Distrusted,
    /// The swap that is under way; the way into the own inbox, for its judge; those who die for it.
    trial: Option<trial::Trial>,
    tell_self: Sender<Input>,
    dismissed: BTreeSet<u32>,
    /// Who was found to flood its log.
    flooding: BTreeSet<u32>,
    /// The engines are to be real time, and which rights to that were refused.
    real_time: bool,
    refused: u64,
}

/// Supervises a station that was founded, until it stops. Gives the exit code.
pub fn supervise(station: &Station) -> Result<u8, SuperviseError> {
    let (begun_ns, system_error) = (system::now_ns(), |e| SuperviseError::System(station.name().to_string(), e));
    let Some(_lock) = name::lock(station).map_err(system_error)? else {
        return Ok(0); // there is one
    };
    crate::proc::end_on_panic();
    let real_time = crate::settings::is_real_time(station);
    if real_time {
        system::become_fifo(SUPERVISOR_PRIORITY); // refused without rights: then whoever died is replaced when there is time for it
        system::lock_memory(); // before there are threads, whose stacks it would fill; refused: then it may wait for its own program's disk
    }
    let page = Arc::new(station.open_for_keeping()?);
    if Roster::restore_header(station)? {
        journal::say(station, journal::ROSTER_MENDED);
    }
    register(&page, Role::Supervisor);
    page.fetch_add64(layout::SUPERVISOR_STARTS, 1);
    let plan = Plan::read(station)?;
    let (tell, inbox) = channel::<Input>();
    let (notices, main_thread) = (tell.clone(), system::thread_id());
    let watch = Watch::start(Arc::clone(&page), real_time, move |notice| {
        if real_time && notice.is_end_of_device() {
            system::hasten(main_thread, DEVICE_RETURNS_PRIORITY); // until it has started another
        }
        let _ = notices.send(Input::Notice(notice)); // the inbox lives as long as the process
    })
    .map_err(system_error)?;
    control::serve(station, tell.clone()).map_err(system_error)?;
    let slots = plan.slots();
    let policy = State::new(&slots);
    let guests = Role::STATEFUL.into_iter().filter(|role| slots.iter().any(|slot| slot.role() == *role));
    let slots: Vec<Slot> = slots.iter().copied().chain(guests.filter_map(Slot::guest)).collect();
    let mut supervisor = Supervisor {
        station: station.clone(),
        spawner: Spawner::new(station, Arc::clone(&page), plan.clone())?,
        policy,
        watch,
        cleaner: Cleaner::new(real_time),
        viewer: Viewer::open(station)?,
        accounts: Accounts::read(station),
        faults: Faults::new(station, &plan.faults)?.among(plan.slots()),
        permit: Permit::new(&page, plan.end_tick),
        progress: Progress::new(crate::settings::is_replay(station), begun_ns),
        holders: roles::Holders::open(station)?,
        kept: kept::Kept::default(),
        complaint: complaint::Complaint::default(),
        is_reach_known: false,
        memory: OutOfMemory::watch(),
        slots,
        page,
        next_ledger_ns: 0,
        next_accounts_ns: 0,
        accounting: None,
        asked: VecDeque::new(),
        answered_ns: 0,
        distrusted: distrust::Distrusted::default(),
        trial: None,
        tell_self: tell,
        dismissed: BTreeSet::new(),
        flooding: BTreeSet::new(),
        real_time,
        refused: 0,
    };
    roles::resume(&supervisor.page, supervisor.viewer.page(), &mut supervisor.policy);
    supervisor.recall();
    supervisor.start(begun_ns);
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
    fn run(&mut self, inbox: &Receiver<Input>) -> u8 {
        let mut stop_since_ns = None;
        loop {
            let pause = Duration::from_nanos((self.answered_ns + ANSWER_PAUSE_NS).saturating_sub(system::now_ns()));
            match inbox.recv_timeout(if self.asked.is_empty() { PERIOD } else { pause }) {
                Ok(input) => self.take(input),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.answer_one(),
            }
            let now_ns = system::now_ns();
            self.page.store64(layout::SUPERVISOR_NS, now_ns);
            if self.watch.hangs(now_ns) {
                journal::say(
                    &self.station,
                    "the supervisor's watching thread hangs: the supervisor ends, and another one is started",
                );
                std::process::exit(1); // as one that was killed: nothing is taken from engines in an orderly way
            }
            if self.page.load32(layout::STOP) != 0 {
                let since_ns = *stop_since_ns.get_or_insert(now_ns);
                policy::step(now_ns, Event::StopRequested, &mut self.policy);
                if !self.policy.anyone_alive() || now_ns - since_ns > STOP_NS {
                    return self.finish();
                }
            }
            self.tend_guardian(now_ns);
            self.note_holders(now_ns);
            let actions = policy::step(now_ns, Event::Tick, &mut self.policy);
            self.act(actions);
            self.chores(now_ns);
        }
    }

    fn chores(&mut self, now_ns: u64) {
        self.faults.tend(now_ns, &mut self.viewer);
        if let Some(permit) = &mut self.permit {
            let is_needed = |slot: &Slot| !slot.is_guest() && !self.policy.is_given_up(*slot);
            let needed: Vec<Slot> = self.slots.iter().copied().filter(is_needed).collect();
            permit.tend(now_ns, &needed, &mut self.faults, &mut self.viewer);
        }
        if self.policy.is_stopping() {
            return;
        }
        self.cleaner.tend(&self.station, now_ns);
        self.heed(now_ns);
        self.tend_swap(now_ns);
        if now_ns >= self.next_ledger_ns {
            self.next_ledger_ns = now_ns + LEDGER_NS;
            self.faults.read_ledger(&mut self.viewer);
            self.heed_standstill(now_ns);
            self.heed_logs(now_ns);
        }
        self.measure_often(now_ns);
        if now_ns >= self.next_accounts_ns {
            self.next_accounts_ns = now_ns + ACCOUNTS_NS;
            self.accounting = self.accounting.or(Some(0));
        }
        if let Some(part) = self.accounting {
            self.accounting = self.account(now_ns, part).then_some(part + 1);
        }
    }

    /// Answers the request that has waited for longest.
    fn answer_one(&mut self) {
        if let Some((request, reply)) = self.asked.pop_front() {
            let _ = reply.send(self.answer(&request)); // who asked may have gone
            self.answered_ns = system::now_ns();
        }
    }

    fn take(&mut self, input: Input) {
        if self.page.load32(layout::STOP) != 0 {
            // Before the first death that the stop brings: a successor's empty page would take the place of the last one in the report.
            policy::step(system::now_ns(), Event::StopRequested, &mut self.policy);
        }
        match input {
            Input::Notice(Notice::Ready { slot, incarnation, at_ns }) => {
                let actions = policy::step(at_ns, Event::Ready { slot, incarnation }, &mut self.policy);
                self.faults.ready(slot, incarnation, at_ns);
                self.note_ready(slot);
                self.act(actions);
            }
            Input::Notice(Notice::Serves { slot, incarnation, at_ns }) => {
                let actions = policy::step(at_ns, Event::Serves { slot, incarnation }, &mut self.policy);
                self.act(actions);
            }
            Input::Notice(Notice::Suspected { slot, incarnation, at_ns }) => {
                self.accounts.suspected(slot);
                self.faults.suspected(slot, incarnation, at_ns);
            }
            Input::Notice(Notice::Cleared { slot, incarnation, guilt_ns }) => {
                self.accounts.cleared(slot, guilt_ns);
                self.faults.cleared(slot, incarnation);
            }
            Input::Notice(Notice::SaidDead { slot }) => self.note_said_dead(slot),
            Input::Notice(Notice::Late { slot, incarnation, at_ns, beat_ns, is_slow, doing }) => {
                self.note_late(slot, incarnation, [at_ns, beat_ns], (is_slow, &doing));
            }
            Input::Notice(Notice::Died { slot, incarnation, pid, at_ns, open_ns, beat_ns }) => {
                let exit = self.memory.blame(spawn::reap_in_slot(&self.page, slot, pid));
                self.died(slot, incarnation, exit, Death { at_ns, open_ns, beat_ns });
            }
            Input::Judged { incarnation, seen } => self.judged(incarnation, &seen),
            Input::JudgeEnded { incarnation } => self.judge_ended(incarnation),
            Input::Request(request, reply) => self.asked.push_back((request, reply)),
        }
    }

    /// Somebody is dead: it is told, and what follows from it is done; of the device, without which the hand has nobody, first done and then told.
    fn died(&mut self, slot: Slot, incarnation: u32, exit: Exit, death: Death) {
        self.spawner.mortality.pass("reaped");
        self.faults.look_at_the_dead(slot, incarnation, &mut self.viewer);
        self.note_holders(death.at_ns); // one that took the role and died since the last look held it
        let (is_urgent, is_dismissed) = (slot.role() == Role::Device, self.dismissed.remove(&incarnation));
        crate::intent::Intent::end_of(incarnation, &self.page);
        let is_mourned = !is_dismissed && !self.policy.is_stopping() && self.page.load32(layout::STOP) == 0;
        let words = self.words_of(slot, exit);
        self.note_end(slot, exit);
        if is_dismissed || is_mourned {
            self.sample(death.at_ns, slot, None);
            self.cleaner.ask(death.at_ns);
        }
        let tell = |this: &mut Supervisor| {
            // Its successor appends to the same file, and would be taken for who has flooded it.
            journal::keep_small(&this.station, &[slot]);
            match () {
                () if is_dismissed => this.faults.dismissed(slot, incarnation, exit, death.at_ns),
                () if is_mourned => this.mourn(slot, incarnation, exit, death, &words),
                () => {}
            }
        };
        if !is_urgent {
            tell(self);
        }
        let actions = policy::step(death.at_ns, Event::Died { slot, incarnation, exit }, &mut self.policy);
        self.page.store32(layout::SLOT_BOOKED + slot.number(), incarnation);
        self.act(actions);
        if is_urgent && self.real_time {
            system::become_fifo(SUPERVISOR_PRIORITY); // the watch had hastened this thread
        }
        if is_urgent {
            tell(self);
        }
    }

    fn answer(&mut self, request: &Request) -> String {
        match request {
            Request::Stop => {
                self.page.store32_and_wake(layout::STOP, 1);
                self.page.bump_and_wake(layout::CHANGES);
                control::good(serde_json::json!({}))
            }
            Request::Kinds => control::good(crate::faultfile::FaultKind::described()),
            Request::Status => control::good(serde_json::to_value(self.viewer.look()).unwrap_or_default()),
            Request::Report => {
                for slot in self.slots.clone() {
                    self.sample_and_measure(system::now_ns(), slot);
                }
                control::good(crate::report::build(&mut self.viewer, &self.accounts, &self.faults, &self.policy))
            }
            Request::Swap { role, binary } => match self.begin_swap(role, binary) {
                Ok(number) => control::good(serde_json::json!({ "number": number })),
                Err(reason) => control::bad(&reason),
            },
            Request::Fault(_) | Request::Suffered(_) if self.page.load32(layout::TEST_MODE) == 0 => {
                control::bad(crate::keepers::OUTSIDE_OF_TEST_MODE)
            }
            Request::Fault(injection) => control::struck(self.faults.inject(injection, &mut self.viewer)),
            Request::Suffered(suffered) => control::done(self.faults.suffered(suffered)),
        }
    }
}
