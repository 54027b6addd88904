//! The partner of this crate's process tests: plays one side of a protocol and kills, aborts or stops itself at a named point.
//!
//! `exchange-partner ROLE STATION INCARNATION FATE [ARGUMENT]`. FATE is `live`, or `kill@POINT`, `abort@POINT`, `stop@POINT`, each with
//! `:N` for the Nth time that the point is passed. It says on stdout what it has done and waits on stdin for what to do next; the end
//! of its input is its end, and it never outlives the thread that started it.

use hyst_exchange::checkpoint::{CheckpointWriter, newest};
use hyst_exchange::meeting::{Coordinator, ProcessCoordinator, ProcessMember};
use hyst_exchange::rendezvous::{Client, Server};
use hyst_exchange::synchronized::synchronized_process;
use hyst_exchange::{Links, OwnedPage, Roster, Station, system};
use hyst_messages::page::{ProcessState, device, header};
use hyst_messages::{InputRecord, Kind, Role, Slot};
use rustix::process::{Signal, getpid, kill_process, set_parent_process_death_signal};
use std::io::{BufRead, Write};
use std::sync::Arc;

type Failure = Box<dyn std::error::Error>;

/// Bytes of the messages of `publish`.
const MESSAGE_BYTES: usize = 65_536;
/// Bytes of the states of `checkpoint`.
const CHECKPOINT_BYTES: usize = 4_096;
/// Ticks between them: so that older generations come about within some of them.
const CHECKPOINT_TICKS: u64 = 100;
/// How long one wait of a member or server lasts before it looks at everything again, ns.
const PATIENCE_NS: u64 = 50_000_000;

struct Part {
    station: Station,
    incarnation: u32,
    how: String,
    at: String,
    /// Passes of the point that are still survived.
    left: u32,
    argument: u32,
}

impl Part {
    fn point(&mut self, name: &str) {
        if self.at != name {
            return;
        }
        self.left -= 1;
        if self.left > 0 {
            return;
        }
        self.at.clear();
        match self.how.as_str() {
            "abort" => std::process::abort(),
            "stop" => signal_self(Signal::STOP),
            _ => signal_self(Signal::KILL),
        }
    }
    fn links(&self, name: &str) -> Result<Links, Failure> {
        Ok(Links::join(&self.station, &format!("{name}-{}", self.incarnation))?)
    }
    fn own(&self, role: Role) -> Result<Arc<OwnedPage>, Failure> {
        Ok(Arc::new(self.station.own_slot(Slot::first(role), self.incarnation)?))
    }
}

fn signal_self(signal: Signal) {
    let sent = kill_process(getpid(), signal);
    assert!(sent.is_ok(), "a process may signal itself");
}

fn say(what: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{what}")?;
    Ok(out.flush()?)
}

/// The next line of stdin; the end of the input ends the process.
fn heed() -> Result<String, Failure> {
    let mut line = String::new();
    if std::io::stdin().lock().read_line(&mut line)? == 0 {
        std::process::exit(0);
    }
    Ok(line.trim().to_string())
}

fn main() -> Result<(), Failure> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [role, station, incarnation, fate, rest @ ..] = arguments.as_slice() else {
        return Err("usage: exchange-partner ROLE STATION INCARNATION FATE [ARGUMENT]".into());
    };
    let (how, at) = fate.split_once('@').unwrap_or(("live", ""));
    let (at, left) = at.split_once(':').unwrap_or((at, "1"));
    let mut part = Part {
        station: Station::named(station)?,
        incarnation: incarnation.parse()?,
        how: how.to_string(),
        at: at.to_string(),
        left: left.parse()?,
        argument: rest.first().map_or(Ok(0), |text| text.parse())?,
    };
    match role.as_str() {
        "cells" => cells(&part),
        "checkpoint" => checkpoint(&part),
        "claim" => claim(&mut part),
        "contend" => contend(&part),
        "publish" => publish(&mut part),
        "found" => found(&part),
        "hold" => hold(&part),
        "serve" => serve(&mut part),
        "ask" => ask(&mut part),
        "member" => member(&mut part),
        "coordinate" => coordinate(&part),
        "newcomer" => newcomer(&mut part),
        other => Err(format!("no role {other}").into()),
    }
}

/// Writes cell and ring of the device's page without a pause, for ever. Each record bears its number in every word.
fn cells(part: &Part) -> Result<(), Failure> {
    let page = part.own(Role::Device)?;
    let before = page.cell(device::INPUT).map_or(0, |(_, record)| record.tick);
    for number in before + 1.. {
        let mut record = InputRecord::default();
        bytemuck::cast_slice_mut::<InputRecord, u64>(std::slice::from_mut(&mut record)).fill(number);
        page.push(device::INPUTS, number, &record);
        page.write(device::INPUT, &record);
        if number == before + 1 {
            say("writing")?;
        }
    }
    Ok(())
}

/// Writes checkpoints of the tissue without a pause, for ever, behind the newest; each has its tick in every word.
fn checkpoint(part: &Part) -> Result<(), Failure> {
    let slot = Slot::first(Role::Tissue);
    let writer = CheckpointWriter::open(&part.station, slot, CHECKPOINT_BYTES)?;
    let before = newest(&part.station, Role::Tissue, CHECKPOINT_BYTES, u64::MAX, |_| true).0.map_or(0, |found| found.tick);
    let mut words = [0u64; CHECKPOINT_BYTES / 8];
    for tick in (before + CHECKPOINT_TICKS..).step_by(CHECKPOINT_TICKS as usize) {
        words.fill(tick);
        writer.write(1, tick, bytemuck::cast_slice(&words), true);
        if tick == before + CHECKPOINT_TICKS {
            say("writing")?;
        }
    }
    Ok(())
}

/// Takes the tissue's role at each line of input from whoever held it when the line came.
fn claim(part: &mut Part) -> Result<(), Failure> {
    let roster = Roster::open(&part.station)?;
    say("open")?;
    loop {
        heed()?;
        part.point("before-look");
        let from = roster.holder(Role::Tissue);
        say(&format!("saw {}", from.epoch))?;
        heed()?;
        part.point("before-claim");
        let taken = roster.promote(Role::Tissue, from, part.incarnation);
        part.point("after-claim");
        say(&taken.map_or_else(|found| format!("lost to {}", found.incarnation), |tenure| format!("holds {}", tenure.epoch)))?;
    }
}

/// Takes the tissue's role without a pause, for ever; notes each epoch that it has won in the ring of its page.
fn contend(part: &Part) -> Result<(), Failure> {
    let (roster, page) = (Roster::open(&part.station)?, part.own(Role::Device)?);
    say("contending")?;
    loop {
        let from = roster.holder(Role::Tissue);
        if let Ok(tenure) = roster.promote(Role::Tissue, from, part.incarnation) {
            page.push(device::INPUTS, tenure.epoch as u64, &InputRecord { tick: tenure.epoch as u64, ..InputRecord::default() });
        }
    }
}

/// Publishes one message for each line of input, the argument's number of bytes (default 64 KiB), filled with the message's number.
fn publish(part: &mut Part) -> Result<(), Failure> {
    let links = part.links("publish")?;
    let bytes = if part.argument == 0 { MESSAGE_BYTES } else { part.argument as usize };
    let publisher = links.publisher(Role::Tissue, part.incarnation, Kind::TissueState, bytes)?;
    say("open")?;
    for number in 1..=u8::MAX {
        heed()?;
        part.point("before-loan");
        let mut loan = publisher.loan(bytes)?;
        let (first, second) = loan.bytes_mut().split_at_mut(bytes / 2);
        first.fill(number);
        part.point("in-loan");
        second.fill(number);
        part.point("before-send");
        loan.send()?;
        part.point("after-send");
        say(&format!("sent {number}"))?;
    }
    Ok(())
}

/// Creates two services of a tissue, as a supervisor before it starts one, and holds them.
fn found(part: &Part) -> Result<(), Failure> {
    let links = part.links("found")?;
    let create = |kind| links.create_service(Role::Tissue, part.incarnation, kind);
    let _services = (create(Kind::TissueState)?, create(Kind::CollisionJob)?);
    say("created")?;
    heed().map(drop)
}

/// Takes the newest message at each line of input and holds all of them.
fn hold(part: &Part) -> Result<(), Failure> {
    let links = part.links("hold")?;
    let subscriber = links.subscriber(Role::Tissue, part.incarnation, Kind::TissueState)?;
    subscriber.connect()?;
    say("open")?;
    let mut held = Vec::new();
    loop {
        heed()?;
        held.extend(subscriber.newest()?);
        say(&format!("holding {}", held.len()))?;
    }
}

/// Serves once for each line of input; the answer is the request, reversed, and the own incarnation behind it.
fn serve(part: &mut Part) -> Result<(), Failure> {
    let links = part.links("serve")?;
    let mut server = links.server(Role::Tissue, part.incarnation, Kind::Appearance)?;
    say("open")?;
    loop {
        let wait = heed()? == "wait";
        part.point("before-receive");
        let mut answer = |request: &[u8]| {
            part.point("in-answer");
            let mut bytes: Vec<u8> = request.iter().rev().copied().collect();
            bytes.extend(part.incarnation.to_le_bytes());
            bytes
        };
        let mut served = server.serve(&mut answer)?;
        while wait && served == 0 {
            served = server.serve_until(system::now_ns() + PATIENCE_NS, &mut answer)?;
        }
        part.point("after-answer");
        say(&format!("served {served}"))?;
    }
}

/// Asks once for each line of input.
fn ask(part: &mut Part) -> Result<(), Failure> {
    let links = part.links("ask")?;
    let mut client = links.client(Role::Tissue, part.argument, Kind::Appearance)?;
    say("open")?;
    loop {
        heed()?;
        part.point("before-request");
        client.begin(b"asked")?;
        say("asked")?;
        part.point("after-request");
        let answer = loop {
            match client.poll() {
                Ok(None) => system::sleep_ns(hyst_exchange::rendezvous::POLL_NS),
                Ok(Some(bytes)) => break format!("answer {}", bytes.len()),
                Err(error) => break format!("{error:?}"),
            }
        };
        part.point("after-answer");
        say(&answer)?;
    }
}

/// A Synchronized Process that follows the coordinator whose incarnation is the argument, in tissue's first slot.
fn member(part: &mut Part) -> Result<(), Failure> {
    let page = part.own(Role::CollisionWorker)?;
    let mut member = ProcessMember::new(page);
    member.follow(part.station.read_slot(Slot::first(Role::Tissue), part.argument)?);
    say("following")?;
    let part = std::cell::RefCell::new(part);
    let has_joined = std::cell::Cell::new(false);
    let between = |_: &mut ProcessMember| {
        if has_joined.take() {
            part.borrow_mut().point("after-join");
        }
        true
    };
    let step = |_| {
        part.borrow_mut().point("before-join");
        has_joined.set(true);
    };
    synchronized_process(&mut member, PATIENCE_NS, between, step);
    Ok(())
}

/// Releases, at each line of input, the member whose incarnation is the argument, and waits for it for ever.
fn coordinate(part: &Part) -> Result<(), Failure> {
    let mut coordinator = ProcessCoordinator::new(part.own(Role::Tissue)?);
    coordinator.seat(0, part.station.read_slot(Slot::first(Role::CollisionWorker), part.argument)?);
    say("seated")?;
    loop {
        heed()?;
        let outcome = coordinator.release(&[1], u64::MAX / 2);
        say(&format!("joined {}", outcome.joined))?;
    }
}

/// An engine in its start-up: opens its state stream, says so in its page, sends one message at each line of input.
fn newcomer(part: &mut Part) -> Result<(), Failure> {
    let page = part.own(Role::Tissue)?;
    page.set_state(ProcessState::Warming);
    part.point("before-ports");
    let links = part.links("newcomer")?;
    let publisher = links.publisher(Role::Tissue, part.incarnation, Kind::TissueState, 64)?;
    part.point("after-ports");
    page.store32(header::PORTS_OPEN, 1);
    say("open")?;
    loop {
        heed()?;
        publisher.announce()?;
        let mut loan = publisher.loan(64)?;
        loan.bytes_mut().fill(part.incarnation as u8);
        loan.send()?;
        say("sent")?;
    }
}
