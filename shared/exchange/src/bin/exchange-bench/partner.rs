//! The station of the benchmark, and the partner processes: this binary with other arguments.

use crate::Failure;
use crate::crews::{self, BARE_WORDS};
use hyst_exchange::meeting::ProcessMember;
use hyst_exchange::synchronized::synchronized_process;
use hyst_exchange::{OwnedPage, ReadPage, Station, system};
use hyst_messages::{Role, Slot};
use rustix::process::{Signal, set_parent_process_death_signal};
use std::process::{Child, Command};
use std::sync::Arc;

/// Priority of both sides of what waits for each other.
pub const PRIORITY: i32 = 20;
/// Incarnation of the coordinator.
pub const COORDINATOR: u32 = 1;
/// How long a partner waits before it looks whether it is still needed, ns.
pub const PATIENCE_NS: u64 = 1_000_000_000;

/// The station of the benchmark; wiped when dropped.
pub struct Site {
    /// The station.
    pub station: Station,
    /// Cores of the process before any thread was tied to one: the children of the tied count one core only.
    cores: usize,
}

impl Site {
    /// Founds a station that nobody else has.
    pub fn found() -> Result<Site, Failure> {
        let station = Station::named(&format!("bench-{}", std::process::id()))?;
        station.wipe();
        station.found()?;
        Ok(Site { station, cores: system::cores() })
    }
    /// Core of partner `index` of a crew: the first is not on core 0, the coordinator's, where there is another.
    pub fn core_of(&self, index: u32) -> u32 {
        (index + 1) % self.cores as u32
    }
    /// Starts a partner; its last argument is its core.
    pub fn partner(&self, role: &str, arguments: &[u32]) -> Result<Partner, Failure> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["partner", role, self.station.name()]).args(arguments.iter().map(u32::to_string));
        Ok(Partner { child: command.spawn()? })
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        self.station.wipe();
    }
}

/// A partner process; killed and reaped when dropped.
pub struct Partner {
    child: Child,
}

impl Drop for Partner {
    fn drop(&mut self) {
        let _ = self.child.kill(); // fails only if it has ended by itself
        let _ = self.child.wait();
    }
}

/// Plays a partner until it is killed.
pub fn play(role: &str, arguments: &[&str]) -> Result<(), Failure> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    let [station, numbers @ ..] = arguments else { return Err("a partner needs a station".into()) };
    let station = Station::named(station)?;
    let numbers: Vec<u32> = numbers.iter().map(|number| number.parse()).collect::<Result<_, _>>()?;
    let core = numbers.last().copied().unwrap_or(0);
    take_place(core); // the run's report says whether real time is granted
    match (role, numbers.as_slice()) {
        ("member", [incarnation, _]) => member(&station, *incarnation),
        ("bare-member", [page, count, _]) => {
            let (own, read) = bare_page(&station, *page)?;
            crews::bare_member(&own, &read, *count)
        }
        ("woken", [page, _]) => {
            let (own, read) = bare_page(&station, *page)?;
            crate::waits::woken(&own, &read)
        }
        _ => Err(format!("no partner {role}").into()),
    }
}

/// Ties the calling thread to a core and makes it real time; false where the class is refused. All crews are placed alike: left to the
/// scheduler, two equal crews of one run settle on different cores and differ by half.
pub fn take_place(core: u32) -> bool {
    let is_tied = system::pin_to_core(core as usize);
    system::become_fifo(PRIORITY) && is_tied
}

fn member(station: &Station, incarnation: u32) -> Result<(), Failure> {
    let page = station.own_slot(Slot::first(Role::CollisionWorker), incarnation)?;
    let mut member = ProcessMember::new(Arc::new(page));
    member.follow(station.read_slot(Slot::first(Role::Tissue), COORDINATOR)?);
    synchronized_process(&mut member, PATIENCE_NS, |_| true, |_| ());
    Ok(())
}

/// A page that several processes write: both views of it.
pub fn bare_page(station: &Station, page: u32) -> Result<(OwnedPage, ReadPage), Failure> {
    let path = station.root().join(format!("pages/bare-{page}.page"));
    if !path.exists() {
        hyst_exchange::page::create(&path, BARE_WORDS, 0, page)?;
    }
    Ok((OwnedPage::open(&path, BARE_WORDS)?, ReadPage::open(&path, BARE_WORDS)?))
}
