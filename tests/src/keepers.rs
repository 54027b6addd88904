//! Those who keep a station: guardian and supervisor are killed and come back, and the engines are looked at meanwhile as the kernel and the
//! station's pages have them, because nobody may be there who answers.

use crate::{RECOVERY_LIMIT, Station, wait_for};
use hyst_exchange::{StationPage, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, SLOTS, Slot};
use rustix::process::Signal;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A living engine: its slot, its process, and when that was started (clock ticks since boot). An id alone may be used again.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Engine {
    /// Name of the slot.
    pub name: String,
    /// Process id.
    pub pid: i32,
    /// Start.
    pub start: u64,
}

/// The engines of a station at some time, and what it had said by then of reasons to replace one.
#[derive(Debug)]
pub struct Census {
    /// The engines.
    pub engines: Vec<Engine>,
    reasons: Vec<String>,
}

impl Census {
    /// Every engine, but for those in `killed`, is still the process that it was, unless the station itself says that it had a reason to replace that one:
    /// on a busy machine one may hang, or be late. Gives how many those are.
    pub fn assert_untouched(&self, station: &Station, what: &str, killed: &[i32]) -> usize {
        let now = station.census();
        let is_gone = |engine: &&Engine| !killed.contains(&engine.pid) && !now.engines.contains(engine);
        let touched: Vec<&Engine> = self.engines.iter().filter(is_gone).collect();
        let reasons = &now.reasons[self.reasons.len()..];
        for engine in &touched {
            let of_it = reasons.iter().find(|line| line.contains(&format!(" {} ", engine.name)));
            let reason = of_it.unwrap_or_else(|| {
                panic!("{what}: {engine:?} is gone for no reason, {:?} live\n{}", now.engines, station.events())
            });
            println!("{what}: {} was replaced: {reason}", engine.name);
        }
        touched.len()
    }
}

impl Station {
    /// Who lives now.
    pub fn census(&self) -> Census {
        let is_reason = |line: &&str| [" hangs (", "is distrusted by", "is replaced: "].iter().any(|what| line.contains(what));
        let reasons = self.events().lines().filter(is_reason).map(str::to_string).collect();
        Census { engines: self.engines(), reasons }
    }

    /// The station's page.
    pub fn clock(&self) -> StationPage {
        self.place().open().expect("the station's page")
    }

    /// Where the station keeps its things.
    pub fn place(&self) -> hyst_exchange::Station {
        hyst_exchange::Station::named(self.name()).expect("a name")
    }

    /// Everything that the station has said to whom it may concern, whoever kept it.
    pub fn events(&self) -> String {
        std::fs::read_to_string(self.place().root().join("events.log")).unwrap_or_default()
    }

    /// Lets so many ticks pass by the station's own clock. Nothing is started for that, and nobody is asked.
    pub fn pass_ticks(&self, ticks: u64) {
        let clock = self.clock();
        let end = clock.present_tick() + ticks;
        let limit = RECOVERY_LIMIT + Duration::from_millis(2 * ticks);
        let passed = wait_for(limit, || (clock.present_tick() >= end).then_some(()));
        assert!(passed.is_some(), "the station's clock does not reach tick {end}");
    }

    /// Whoever lives in a slot, as the kernel knows it.
    fn living(&self, slot: Slot) -> Option<Engine> {
        let clock = self.clock();
        let (pid, known) = (clock.pid(slot), clock.page().load64(layout::SLOT_START + slot.number()));
        let start = system::process_start(pid).filter(|start| pid != 0 && *start == known)?;
        Some(Engine { name: slot.to_string(), pid: pid as i32, start })
    }

    /// Every living engine. Reads the station's page and /proc, so that it needs no supervisor.
    pub fn engines(&self) -> Vec<Engine> {
        let slots = (0..SLOTS).filter_map(Slot::from_number);
        let slots = slots.filter(|slot| !matches!(slot.role(), Role::Supervisor | Role::Guardian));
        slots.filter_map(|slot| self.living(slot)).collect()
    }

    /// The supervisor or the guardian, if it lives.
    pub fn keeper(&self, role: Role) -> Option<Engine> {
        self.living(Slot::first(role))
    }

    /// Process id of the `hystation run` that the test started last.
    pub fn own_pid(&self) -> i32 {
        self.child.id() as i32
    }

    /// Kills the guardian that the test started.
    pub fn kill_guardian(&mut self) {
        self.child.kill().expect("the guardian is ours");
        self.child.wait().expect("the guardian is ours");
    }

    /// Kills the supervisor, the guardian or both, whoever that is at present. Returns when they are dead.
    pub fn kill_keepers(&mut self, roles: &[Role]) {
        let victims: Vec<Engine> = roles.iter().map(|role| self.keeper(*role).unwrap_or_else(|| panic!("no {role:?}"))).collect();
        for victim in &victims {
            self.signal_if_alive(victim.pid, Signal::KILL); // dead of another cause is as good
        }
        let is_dead = |victim: &Engine| system::process_start(victim.pid as u32) != Some(victim.start);
        let dead = wait_for(RECOVERY_LIMIT, || victims.iter().all(is_dead).then_some(()));
        assert!(dead.is_some(), "{victims:?} do not end");
        let _ = self.child.try_wait(); // the one that the test started leaves no zombie
    }

    /// Waits until a supervisor that was started after so many others beats: then it has adopted the engines.
    pub fn wait_for_supervisor(&self, starts_before: u64) {
        let page = self.clock();
        let (word, began_ns) = (|at| page.page().load64(at), system::now_ns());
        let beats = || (word(layout::SUPERVISOR_STARTS) > starts_before && word(layout::SUPERVISOR_NS) > began_ns).then_some(());
        assert!(wait_for(RECOVERY_LIMIT, beats).is_some(), "no supervisor after {starts_before} of them\n{}", self.events());
    }

    /// How many supervisors were started so far.
    pub fn supervisor_starts(&self) -> u64 {
        self.clock().page().load64(layout::SUPERVISOR_STARTS)
    }

    /// Runs `hystation run` with the words of the first time: it takes over what lives of the station, also from a stand-in.
    pub fn run_again(&mut self) {
        let log = std::fs::File::options().append(true).create(true).open(self.folder().join("said"));
        self.child = guardian(&self.words, log.expect("a file for what the station says"));
        let own = self.own_pid();
        let keeps = || self.keeper(Role::Guardian).filter(|guardian| guardian.pid == own).map(|_| ());
        let keeps = wait_for(RECOVERY_LIMIT, keeps);
        assert!(keeps.is_some() && self.has_ended().is_none(), "the station was not taken over\n{}", self.said());
    }
}

/// Starts the words of a `hystation run`; its messages go to a file.
pub(crate) fn guardian(words: &[std::ffi::OsString], log: std::fs::File) -> Child {
    let (program, rest) = words.split_first().expect("a command");
    let mut command = Command::new(program);
    let command = command.args(rest).stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
    command.spawn().expect("target/release/hystation: run `./station build` first")
}
