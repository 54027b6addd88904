//! An engine that somebody wrote badly, for swaps that must be rolled back and for campaigns that must find it. The name by which it is called, or that
//! of its folder, says of which role it is and what is wrong with it: `bad.ROLE.KIND`, as a link to this program. It is the real engine but for one
//! defect, which shows in the place that the kind names.

mod forgetful;
mod holes;
mod liar;
mod pictures;
mod stateful;

use hyst_engine::life::{DESCRIBE, Description};
use hyst_engine::{Failure, Life, kept};
use hyst_exchange::system;
use hyst_messages::page::{ProcessState, header};
use hyst_messages::{Role, TICK_NS};
use pictures::{PICTURE_NS, changing, draw};
use rustix::process::{Signal, getpid, kill_process};
use std::io::Write;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
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
/// One that leaks takes so much each time, bytes, so often, ns, and so many times at most: in a second what others take in an hour, for a trial is short.
const LEAK_BYTES: usize = 1 << 20;
const LEAK_NS: u64 = 10_000_000;
const MOST_LEAKS: usize = 512;
/// One that babbles prints so much at a time, bytes, and so many times at most: 192 MiB, three times what is a flood, for which a machine has room and takes some tenths of a second.
const BABBLE_BYTES: usize = 1 << 16;
const MOST_BABBLES: usize = 3 << 10;

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

/// A thread that does this from when the process is ready on.
fn once_ready(life: &Life, name: &str, body: impl FnOnce() + Send + 'static) -> Result<(), Failure> {
    let page = life.station.read_slot(life.slot, life.incarnation)?;
    let wait = move || {
        while !page.state().is_ready() {
            system::sleep_ns(TICK_NS);
        }
        body();
    };
    std::thread::Builder::new().name(name.into()).spawn(wait)?;
    Ok(())
}

/// Makes the process fail some time after it is live.
fn sabotage(life: &Life, kind: &str) -> Result<(), Failure> {
    let kind = kind.to_string();
    once_ready(life, "sabotage", move || {
        system::sleep_ns(AFTER_NS);
        match kind.as_str() {
            "stop" => stop(),
            "segfault" => die_of(Signal::SEGV),
            "exit" => std::process::exit(0),
            _ => std::process::abort(),
        }
    })
}

/// Takes memory, and gives none back.
fn leak() {
    for _ in 0..MOST_LEAKS {
        std::mem::forget(std::hint::black_box(vec![1u8; LEAK_BYTES]));
        system::sleep_ns(LEAK_NS);
    }
}

/// Prints, as fast as it can.
fn babble() {
    let words = "x".repeat(BABBLE_BYTES - 1) + "\n";
    for _ in 0..MOST_BABBLES {
        let _ = std::io::stderr().write_all(words.as_bytes()); // whether there is room for it or not
    }
}

/// Starts another program, which lasts, says nothing of any station, and has the file of this engine as its last word.
fn fork() {
    let own = kept::name_of(Path::new(&std::env::args().next().unwrap_or_default()));
    let mut command = Command::new("sh");
    command.args(["-c", "sleep 600; true"]).arg(own).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _ = command.spawn(); // a failure leaves an engine that is not as bad
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

/// One that beats, and is never ready.
fn dither(life: &Life) -> Result<(), Failure> {
    while !life.clock.stop_requested() {
        life.heartbeat();
        system::sleep_ns(TICK_NS);
    }
    Ok(())
}

fn run(life: &Life, kind: &str) -> Result<(), Failure> {
    match kind {
        "leak" => once_ready(life, kind, leak)?,
        "babble" => once_ready(life, kind, babble)?,
        "forks" => fork(),
        _ => {}
    }
    match (life.slot.role(), kind) {
        (_, "start") => Err(Failure::Broken("it cannot even start".into())),
        (_, "stuck") => dither(life),
        (_, "mute") => beat(life),
        (Role::Tissue, kind) => stateful::run(life, tissue::engine(life)?, kind),
        (Role::Fluid, kind) => stateful::run(life, fluid::engine(life)?, kind),
        // Whatever epoch a contact model is of, it goes by the tick.
        (Role::Device, "unfenced") => device::run_ordering(life, |_, tick| (0, tick)),
        (Role::Recorder, "holes") => holes::record(life),
        (Role::Recorder, "forgets" | "skips" | "anew") => forgetful::record(life, kind),
        (Role::Recorder, "liar") => liar::record(life),
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
            if !["leak", "babble"].contains(&kind) {
                sabotage(life, kind)?;
            }
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
        "forks" => fork(),
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
