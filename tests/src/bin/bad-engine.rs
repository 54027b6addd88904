//! An engine that somebody wrote badly, for swaps that must be rolled back and for campaigns that must find it. The name by which it is called, or that
//! of its folder, says of which role it is and what is wrong with it: `bad.ROLE.KIND`, as a link to this program. It is the real engine but for one
//! defect, which shows in the place that the kind names.

use hyst_engine::life::{DESCRIBE, Description};
use hyst_engine::{Failure, Life, Stateful, StepContext};
use hyst_exchange::usher::{Arrival, Inbox, Wanted};
use hyst_exchange::{Links, system};
use hyst_messages::page::{ProcessState, device as device_page, header, rendering as rendering_page, tissue as tissue_page};
use hyst_messages::stream::message_bytes;
use hyst_messages::{ContactModel, Kind, Message, MessageMut, RenderingStatus, Role, Slot, StreamHeader, TICK_NS};
use hyst_recording::{Block, WriteError, Writer};
use rustix::process::{Signal, getpid, kill_process};
use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU32, Ordering};

/// Steps in the shadow, or of its tenure, after which the defect shows.
const AFTER: u32 = 5;
/// Time from its first step on after which an engine without a state of its own fails, ns.
const AFTER_NS: u64 = 300_000_000;
/// What a slow engine adds to a step, in periods.
const PERIODS: u64 = 4;
/// Steps after which the defect of a servo, a device or a worker shows: a servo is out of the other's shadow by then.
const AFTER_STEPS: u32 = 300;
/// What a servo's force is off by, N.
const OFF_N: f32 = 0.2;
/// How long a reluctant one takes to say what it is, ns: it is verified twice, and less than that is left to each.
const DESCRIBES_AFTER_NS: u64 = 7_000_000_000;
/// What one that is late takes for every other step, in periods: beyond those that a fluid makes up for. And what a wasteful one allocates in each, bytes.
const LATE_PERIODS: u64 = 5;
const WASTE_BYTES: usize = 4_096;
/// Size of a picture, px, and the time between two, ns: it is faster than a good one.
const PICTURE_PX: [u32; 2] = [320, 240];
const PICTURE_NS: u64 = 20_000_000;

/// Sends a signal to the own process until it takes effect: the runtime's handler lets the first SIGSEGV that was sent go by, and one that is
/// pending already is not sent again.
fn die_of(signal: Signal) {
    loop {
        let _ = kill_process(getpid(), signal); // a failure leaves a process that hangs, which is bad as well
        system::sleep_ns(TICK_NS);
    }
}

/// Stands still until somebody continues it.
fn stop() {
    let _ = kill_process(getpid(), Signal::STOP); // the same
}

/// The real engine with one defect.
struct Bad<'a, S> {
    life: &'a Life,
    engine: S,
    kind: String,
    shadowed: u32,
    held: u32,
    /// Of one that begins `anew`: the state before its first step.
    blank: Vec<u8>,
}

impl<S: Stateful> Bad<'_, S> {
    /// What is wrong with a step, before it is computed.
    fn fail(&mut self, context: &StepContext) {
        let in_shadow = self.kind.starts_with("shadow-") && self.shadowed > AFTER;
        if !in_shadow && self.held <= AFTER {
            return;
        }
        match self.kind.trim_start_matches("shadow-") {
            "panic" => panic!("a broken invariant"),
            "segfault" => die_of(Signal::SEGV),
            "exit" => std::process::exit(0),
            "spin" => loop {
                std::hint::spin_loop();
            },
            "stop" => stop(),
            "slow" => system::sleep_ns(PERIODS * context.step_ticks * TICK_NS),
            // As long as it is on trial, in a place of its own, nobody sees it.
            "late" if !self.life.slot.is_guest() && self.held.is_multiple_of(2) => {
                system::sleep_ns(LATE_PERIODS * context.step_ticks * TICK_NS)
            }
            "honest" if self.life.mischief().is_some_and(|request| request.what.is_lie()) => std::process::exit(0), // rather than lie
            "wasteful" => drop(std::hint::black_box(vec![0u8; WASTE_BYTES])),
            _ => {}
        }
    }

    /// What is wrong with a state, after it was computed.
    fn spoil(&self, next: &mut [u8]) {
        let (spoils_shadow, kind) = match self.kind.strip_prefix("shadow-") {
            Some(kind) => (true, kind),
            None => (false, self.kind.as_str()),
        };
        if (!spoils_shadow || self.shadowed <= AFTER) && self.held <= AFTER {
            return;
        }
        let section = if self.engine.kind() == Kind::TissueState { 1 } else { 2 };
        let Some((from, length)) = place(next, self.engine.kind(), section) else { return };
        match kind {
            "nan" => next[from..from + 4].copy_from_slice(&f32::NAN.to_ne_bytes()),
            "off" => {
                for number in next[from..from + length].chunks_exact_mut(4) {
                    let value = f32::from_ne_bytes([number[0], number[1], number[2], number[3]]);
                    number.copy_from_slice(&(value * 1.1 + 0.2).to_ne_bytes());
                }
            }
            "garbage" => next.fill(0xa5),
            "honest" if self.life.mischief().is_some_and(|request| request.what.is_lie()) => std::process::exit(0), // it was asked meanwhile
            _ => {}
        }
    }
}

/// First byte and length of a section.
fn place(bytes: &[u8], kind: Kind, section: usize) -> Option<(usize, usize)> {
    let found = Message::parse(bytes, kind).ok()?.section::<u8>(section).ok()?;
    Some((found.as_ptr() as usize - bytes.as_ptr() as usize, found.len()))
}

impl<S: Stateful> Stateful for Bad<'_, S> {
    fn kind(&self) -> Kind {
        self.engine.kind()
    }
    fn message_bytes(&self) -> usize {
        self.engine.message_bytes()
    }
    fn next_bytes(&self, now: &[u8]) -> usize {
        self.engine.next_bytes(now)
    }
    fn step_ticks(&self) -> u64 {
        self.engine.step_ticks()
    }
    fn backlog(&self) -> u64 {
        self.engine.backlog()
    }
    fn interests(&self) -> Vec<(Role, Wanted)> {
        self.engine.interests()
    }
    fn open(&mut self, links: &Links) -> Result<(), Failure> {
        self.engine.open(links)?;
        if self.kind == "anew" {
            self.blank = vec![0; self.engine.message_bytes()];
            self.engine.initial(StreamHeader::default(), &mut self.blank)?;
        }
        Ok(())
    }
    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        self.engine.initial(header, state)
    }
    fn accepts(&self, state: &[u8]) -> bool {
        self.engine.accepts(state)
    }
    fn is_supplied(&mut self, tick: u64, next_tick: u64) -> bool {
        self.engine.is_supplied(tick, next_tick)
    }
    fn is_connected(&mut self) -> bool {
        self.engine.is_connected()
    }
    fn prepare(&mut self, newest: &[u8]) -> Result<(), Failure> {
        self.engine.prepare(newest)
    }
    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        if context.holding {
            self.held += 1;
        } else {
            self.shadowed += 1;
        }
        self.fail(context);
        // It takes the role as if nothing had been before.
        let begins_anew = context.holding && self.held == 1 && !self.blank.is_empty();
        self.engine.step(context, if begins_anew { &self.blank } else { now }, next)?;
        self.spoil(next);
        Ok(())
    }
    fn finished(&mut self, context: &StepContext, state: &[u8]) {
        self.engine.finished(context, state);
        // Its states are right, and the hand feels nothing of them.
        if self.kind == "numb"
            && self.held > AFTER
            && let Some((_, model)) = self.life.page.cell(tissue_page::MODEL)
        {
            self.life.page.write(tissue_page::MODEL, &ContactModel { plane_count: 0, planes: Default::default(), ..model });
        }
    }
    fn finished_beside(&mut self, context: &StepContext, state: &[u8]) {
        self.engine.finished_beside(context, state);
    }
    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        self.engine.arrival(arrival, inbox);
    }
}

fn stateful<S: Stateful>(life: &Life, engine: S, kind: &str) -> Result<(), Failure> {
    hyst_engine::run_stateful(life, Bad { life, engine, kind: kind.to_string(), shadowed: 0, held: 0, blank: Vec::new() })
}

/// A thread that makes the process fail some time after it is live.
fn sabotage(life: &Life, kind: &str) -> Result<(), Failure> {
    let (page, kind) = (life.station.read_slot(life.slot, life.incarnation)?, kind.to_string());
    let body = move || {
        while !page.state().is_ready() {
            system::sleep_ns(TICK_NS);
        }
        system::sleep_ns(AFTER_NS);
        match kind.as_str() {
            "stop" => stop(),
            "segfault" => die_of(Signal::SEGV),
            "exit" => std::process::exit(0),
            _ => std::process::abort(),
        }
    };
    std::thread::Builder::new().name("sabotage".into()).spawn(body)?;
    Ok(())
}

/// One tick in so many is not in the file of a recorder that has `holes`.
const DROPPED: u64 = 500;
/// Between two looks of a recorder, ns: far less than the device's ring holds.
const LOOK_NS: u64 = 50_000_000;

/// A recorder that leaves out a tick now and then and does not say so. It reads the ring of the device that lives, and nothing else.
fn record_with_holes(life: &Life) -> Result<(), Failure> {
    let Some(path) = &life.settings.record else { return beat(life) };
    let broken = |error: WriteError| Failure::Broken(error.to_string());
    let session = [("session".to_string(), life.station.name().to_string())].into();
    let mut writer = Writer::open(path, &session).map_err(broken)?;
    let slot = Slot::first(Role::Device);
    let mut next_tick = None;
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() {
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        if let Ok(page) = life.station.read_slot(slot, life.clock.incarnation(slot)) {
            let end = page.ring_end(device_page::APPLIED);
            let ticks = next_tick.unwrap_or(end)..end;
            let applied =
                ticks.filter(|tick| tick % DROPPED != 0).filter_map(|tick| page.ring(device_page::APPLIED, tick)).collect();
            writer.append(&Block { applied, ..Block::default() }).map_err(broken)?;
            next_tick = Some(end);
        }
        system::sleep_ns(LOOK_NS);
    }
    writer.finish().map(drop).map_err(broken)
}

/// Whether an engine without a state has made enough steps for its defect to show.
fn is_out_of_its_shadow() -> bool {
    static STEPS: AtomicU32 = AtomicU32::new(0);
    STEPS.fetch_add(1, Ordering::Relaxed) > AFTER_STEPS
}

fn off(force_n: [f32; 3]) -> [f32; 3] {
    if is_out_of_its_shadow() { force_n.map(|newton| newton + OFF_N) } else { force_n }
}

fn slow(force_n: [f32; 3]) -> [f32; 3] {
    if is_out_of_its_shadow() {
        system::sleep_ns(PERIODS * TICK_NS);
    }
    force_n
}

/// A device that sleeps is missed as one that stands still is; this one works all the time, and beats.
fn toil(force_n: [f32; 3]) -> [f32; 3] {
    if is_out_of_its_shadow() {
        let until_ns = system::now_ns() + PERIODS * TICK_NS;
        while system::now_ns() < until_ns {
            std::hint::spin_loop();
        }
    }
    force_n
}

fn dawdle(found: usize) -> usize {
    if is_out_of_its_shadow() {
        system::sleep_ns(PERIODS * TICK_NS);
    }
    found
}

/// A rendering whose page says all that a good one's says, and whose pictures are of these levels, byte by byte and picture by picture.
fn draw(life: &Life, every_ns: u64, level: fn(usize, u64) -> u8) -> Result<(), Failure> {
    let sections = [3 * (PICTURE_PX[0] * PICTURE_PX[1]) as usize];
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let stream = links.publisher(Role::Rendering, life.incarnation, Kind::Picture, message_bytes(&sections))?;
    life.ports_are_open();
    life.page.set_state(ProcessState::Live);
    for frames in 1.. {
        if life.clock.stop_requested() {
            break;
        }
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        let status = RenderingStatus { frames, shown_tick: life.tick(), size_px: PICTURE_PX, ..RenderingStatus::default() };
        life.page.write(rendering_page::STATUS, &status);
        let mut loan = stream.loan(message_bytes(&sections))?;
        let header = StreamHeader { tick: life.tick(), incarnation: life.incarnation, words: PICTURE_PX, ..Default::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Picture, header, &sections)?;
        message.section::<u8>(0)?.iter_mut().enumerate().for_each(|(at, byte)| *byte = level(at, frames));
        loan.send()?;
        system::sleep_ns(every_ns);
    }
    Ok(())
}

/// Another picture each time.
fn changing(at: usize, frames: u64) -> u8 {
    (at as u64 + 40 * frames) as u8
}

/// An engine that is not linked here, or says nothing: it beats, and that is all.
fn beat(life: &Life) -> Result<(), Failure> {
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() {
        life.heartbeat();
        life.page.add64(header::STEPS, 1);
        system::sleep_ns(TICK_NS);
    }
    Ok(())
}

fn run(life: &Life, kind: &str) -> Result<(), Failure> {
    match (life.slot.role(), kind) {
        (_, "start") => Err(Failure::Broken("it cannot even start".into())),
        (_, "mute") => beat(life),
        (Role::Tissue, kind) => stateful(life, tissue::engine(life)?, kind),
        (Role::Fluid, kind) => stateful(life, fluid::engine(life)?, kind),
        // Whatever epoch a contact model is of, it goes by the tick.
        (Role::Device, "unfenced") => device::run_ordering(life, |_, tick| (0, tick)),
        (Role::Recorder, "holes") => record_with_holes(life),
        // It is consistent: the servos are told of the half that the motors are told of.
        (Role::Device, "half") => device::run_giving(life, |force_n| force_n.map(|newton| 0.5 * newton)),
        (Role::Device, "slow") => device::run_giving(life, toil),
        (Role::Haptic, "off") => haptic::run_telling(life, off),
        (Role::Haptic, "slow") => haptic::run_telling(life, slow),
        (Role::Rendering, "black") => draw(life, PICTURE_NS, |_, _| 0),
        (Role::Rendering, "still") => draw(life, PICTURE_NS, |at, _| at as u8),
        // Good pictures, but one a second.
        (Role::Rendering, "slow") => draw(life, 1_000 * TICK_NS, changing),
        // Good pictures in good time, and nobody can make it do wrong.
        (Role::Rendering, "headstrong") => draw(life, PICTURE_NS, changing),
        (Role::CollisionWorker, "blind") => collision_worker::run_telling(life, |_| 0),
        (Role::CollisionWorker, "slow") => collision_worker::run_telling(life, dawdle),
        (role, kind) => {
            sabotage(life, kind)?;
            match role {
                Role::Haptic => haptic::run(life),
                Role::CollisionWorker => collision_worker::run(life),
                Role::Device => device::run(life),
                _ => beat(life),
            }
        }
    }
}

/// What is wrong when it is asked what it is; true if it then says so as any engine does.
fn describes(role: Role, kind: &str) -> bool {
    match kind {
        "silent" => loop {
            system::sleep_ns(TICK_NS);
        },
        // Whether anybody reads it or not.
        "flood" => loop {
            let _ = std::io::stdout().write_all(&[b'x'; 4_096]);
        },
        "reluctant" => system::sleep_ns(DESCRIBES_AFTER_NS),
        "foreign" => {
            let mut own = Description::of(role);
            own.interface += 1;
            println!("{}", serde_json::to_string(&own).unwrap_or_default());
            return false;
        }
        _ => {}
    }
    true
}

fn main() -> ExitCode {
    let name = std::env::args().next().unwrap_or_default();
    let own = name.rsplit('/').find(|part| part.starts_with("bad.")).unwrap_or_default();
    let mut words = own.splitn(3, '.').skip(1);
    let (Some(role), Some(kind)) = (words.next().and_then(Role::from_name), words.next()) else {
        eprintln!("{name}: call this by a name such as bad.fluid.panic");
        return ExitCode::from(2);
    };
    if std::env::args().nth(1).as_deref() == Some(DESCRIBE) && !describes(role, kind) {
        return ExitCode::SUCCESS;
    }
    hyst_engine::run(role, |life| {
        run(life, kind)?;
        if kind == "deaf" {
            // The station stops, and it stays.
            loop {
                system::sleep_ns(TICK_NS);
            }
        }
        Ok(())
    })
}
