//! The kinds of faults: what each does, what the process is asked to do for it, and which processes it cannot be done to.

use super::Target;
use hyst_messages::Role;
use hyst_messages::mischief::Mischief;
use rustix::process::Signal;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// What is done to a process: from outside by a signal, or by the process itself because it is asked to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// SIGKILL.
    Kill,
    /// SIGSTOP, and SIGCONT after `for_s` seconds if it still lives.
    Stop,
    /// SIGCONT.
    Cont,
    /// SIGSEGV.
    Segfault,
    /// SIGABRT.
    Abort,
    /// The step's thread spins.
    Spin,
    /// The step's thread waits for ever.
    Block,
    /// Steps take longer.
    Slow,
    /// Ends with code 0.
    Exit0,
    /// Ends with code 1.
    Exit1,
    /// Panics.
    Panic,
    /// Publishes NaN.
    Nan,
    /// Publishes infinity.
    Inf,
    /// Publishes what is out of range.
    Range,
    /// Publishes the same content under new stamps.
    Frozen,
    /// Publishes new content under the same stamp.
    Stamp,
    /// Publishes an old output.
    Replay,
    /// Publishes under an epoch that is over.
    Epoch,
    /// Publishes messages of another layout.
    Layout,
    /// Publishes under stamps that are far ahead.
    Ahead,
    /// Publishes states that kill whoever else takes the role with them.
    Poison,
    /// Each holder of its role dies in its next step.
    Doom,
    /// Takes memory at a rate.
    LeakMemory,
    /// Opens files at a rate.
    LeakFiles,
    /// Loses the loans of its stream.
    LeakLoans,
    /// May have no more memory than it has, and wants more.
    Oom,
    /// May open no more files than it has open.
    NoFiles,
    /// SIGKILL, and its successor hangs in its start.
    HangStart,
    /// SIGKILL, and its successors die in their start.
    CrashLoop,
    /// Bytes are flipped in shared memory.
    Corrupt,
    /// The file system of the recording is full.
    DiskFull,
    /// /dev/shm is full.
    ShmFull,
    /// Ends what it was asked to do.
    Undo,
}

impl FaultKind {
    /// All kinds with what they do.
    pub const ALL: [(FaultKind, &'static str, &'static str); 33] = [
        (FaultKind::Kill, "kill", "SIGKILL: the process is gone at once"),
        (FaultKind::Stop, "stop", "SIGSTOP: it hangs; continued after --for, if it still lives"),
        (FaultKind::Cont, "cont", "SIGCONT: a stopped process goes on as a zombie of its former self"),
        (FaultKind::Segfault, "segfault", "SIGSEGV: a wild access"),
        (FaultKind::Abort, "abort", "SIGABRT: a broken invariant"),
        (FaultKind::Spin, "spin", "the thread of its steps runs on at its own priority"),
        (
            FaultKind::Block,
            "block",
            "the thread of its steps waits; its heartbeat stands still. Or a --thread that helps it (usher, drain, keeper, clerk): found by the engine \
             itself after 5 s, handed over and replaced",
        ),
        (FaultKind::Slow, "slow", "each step takes --factor times as long and --extra longer, give or take --jitter of that"),
        (FaultKind::Exit0, "exit0", "it ends with exit code 0, unasked"),
        (FaultKind::Exit1, "exit1", "it ends with exit code 1"),
        (FaultKind::Panic, "panic", "the thread of its steps panics"),
        (FaultKind::Nan, "nan", "it publishes NaN"),
        (FaultKind::Inf, "inf", "it publishes infinity"),
        (FaultKind::Range, "range", "it publishes numbers and indices far out of range"),
        (FaultKind::Frozen, "frozen", "it publishes the same output again and again, under stamps that go on"),
        (FaultKind::Stamp, "stamp", "its stamp stands still, while its output goes on"),
        (FaultKind::Replay, "replay", "it publishes an old output again and again, as it was"),
        (FaultKind::Epoch, "epoch", "it publishes under an epoch that is over"),
        (FaultKind::Ahead, "ahead", "it publishes under an epoch that nobody has won and a tick that is long to come"),
        (FaultKind::Layout, "layout", "its messages say that they are of another layout, as those of another build would"),
        (
            FaultKind::Poison,
            "poison",
            "its states are flawed from now on: whoever else takes the role with one of them dies of it",
        ),
        (
            FaultKind::Doom,
            "doom",
            "each holder of its role (haptic: each process) dies in its next step, whatever it goes on from",
        ),
        (
            FaultKind::LeakMemory,
            "leak-memory",
            "it takes --rate MiB of memory a second (32) and gives them back after --for; found as growth, handed over and replaced",
        ),
        (
            FaultKind::LeakFiles,
            "leak-files",
            "it opens --rate files a second (60) and closes them after --for; found as growth, handed over and replaced",
        ),
        (
            FaultKind::LeakLoans,
            "leak-loans",
            "it loans a block of its stream in each step and never sends it: soon there is none left to write into, and it ends",
        ),
        (
            FaultKind::Oom,
            "oom",
            "its memory is limited to what it has (RLIMIT_AS), and it takes more until the allocator gives up",
        ),
        (FaultKind::NoFiles, "no-files", "it can open no file more (RLIMIT_NOFILE), no newcomer's page and stream either"),
        (FaultKind::HangStart, "hang-start", "SIGKILL, and its successor hangs in its start"),
        (
            FaultKind::CrashLoop,
            "crash-loop",
            "SIGKILL, and its successors die in their start, --times of them (3); after 8 short lives in a row (recorder: 15) a slot is given up",
        ),
        (
            FaultKind::Corrupt,
            "corrupt",
            "--bytes bytes (16), drawn from --seed (another each time), are flipped in its --where: page, stream, link (its connections), \
             checkpoint, or in the station's page or roster",
        ),
        (
            FaultKind::DiskFull,
            "disk-full",
            "a ballast fills the file system of the recording and holds it full; at most 1 GiB may be free there. The recorder is hurt by it, and it is \
             booked as its fault",
        ),
        (
            FaultKind::ShmFull,
            "shm-full",
            "a ballast fills /dev/shm and holds it full, for all: the target only names whose fault it is booked as, and by whom `undo` finds it; at \
             most 1 GiB may be free there (`unshare -m`, a tmpfs of its own)",
        ),
        (FaultKind::Undo, "undo", "whatever was done to it for a time ends: what it was asked to do, a limit, a ballast"),
    ];
    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<FaultKind> {
        FaultKind::ALL.iter().find(|(_, known, _)| *known == name).map(|(kind, _, _)| *kind)
    }
    /// All kinds for who offers them to somebody: name, what it does, roles that can be its target, options, whether it needs a duration.
    pub fn described() -> Value {
        let described = |(kind, name, _): (FaultKind, &str, &str)| {
            let (targets, options) = (kind.roles(), kind.options());
            json!({ "name": name, "text": kind.told(), "targets": targets, "options": options, "needs_for": kind.needs_duration() })
        };
        FaultKind::ALL.into_iter().map(described).collect()
    }
    /// What it does, and for how long if nobody says so.
    pub fn told(self) -> String {
        let text = FaultKind::ALL.iter().find(|(kind, _, _)| *kind == self).map_or("", |(_, _, text)| text);
        format!("{text} ({})", self.without_duration())
    }

    /// How long it lasts without a duration.
    fn without_duration(self) -> &'static str {
        match self {
            _ if self.needs_duration() => "needs --for",
            _ if !self.takes_duration() => "once",
            FaultKind::Poison | FaultKind::Doom => "without --for until undone",
            FaultKind::Oom | FaultKind::LeakLoans => "without --for until it ends or is undone",
            FaultKind::HangStart => "without --for until that one is found: after 30 s, an ordinary process after 180 s",
            FaultKind::CrashLoop => "without --for until so many have died",
            _ => "without --for until replaced or undone",
        }
    }

    /// What the process is asked to do itself.
    pub fn mischief(self) -> Option<Mischief> {
        Some(match self {
            FaultKind::Spin => Mischief::Spin,
            FaultKind::Block => Mischief::Block,
            FaultKind::Slow => Mischief::Slow,
            FaultKind::Exit0 => Mischief::ExitZero,
            FaultKind::Exit1 => Mischief::ExitOne,
            FaultKind::Panic => Mischief::Panic,
            FaultKind::Nan => Mischief::Nan,
            FaultKind::Inf => Mischief::Inf,
            FaultKind::Range => Mischief::Range,
            FaultKind::Frozen => Mischief::Frozen,
            FaultKind::Stamp => Mischief::Stamp,
            FaultKind::Replay => Mischief::Replay,
            FaultKind::Epoch => Mischief::Epoch,
            FaultKind::Layout => Mischief::Layout,
            FaultKind::Ahead => Mischief::Ahead,
            FaultKind::Poison => Mischief::Poison,
            FaultKind::Doom => Mischief::Doom,
            FaultKind::LeakMemory => Mischief::LeakMemory,
            FaultKind::LeakFiles => Mischief::LeakFiles,
            FaultKind::LeakLoans => Mischief::LeakLoans,
            FaultKind::Oom => Mischief::Exhaust,
            FaultKind::HangStart => Mischief::HangStart,
            FaultKind::CrashLoop => Mischief::CrashStart,
            _ => return None,
        })
    }

    /// The signal that it is, or that it begins with.
    pub fn signal(self) -> Option<Signal> {
        Some(match self {
            FaultKind::Kill | FaultKind::HangStart | FaultKind::CrashLoop => Signal::KILL,
            FaultKind::Stop => Signal::STOP,
            FaultKind::Cont => Signal::CONT,
            FaultKind::Segfault => Signal::SEGV,
            FaultKind::Abort => Signal::ABORT,
            _ => return None,
        })
    }

    /// Whether it must have an end that is given with it, because it neither ends by itself nor is ended by a replacement.
    pub fn needs_duration(self) -> bool {
        matches!(self, FaultKind::Slow | FaultKind::NoFiles | FaultKind::DiskFull | FaultKind::ShmFull)
    }

    /// Why a process of this role cannot do it; `None` if it can.
    pub(crate) fn hindrance(self, role: Role) -> Option<&'static str> {
        if self == FaultKind::DiskFull && role != Role::Recorder {
            return Some("what is filled is the file system of the recording; its target is recorder");
        }
        let what = self.mischief()?;
        match role {
            Role::Device | Role::Rendering | Role::Recorder | Role::Console if what == Mischief::LeakLoans => {
                Some("it has no stream that it writes in each step")
            }
            Role::Rendering if what.is_lie() => Some("its pictures are for the eye alone: nobody computes from them"),
            Role::Recorder | Role::Console if what.is_lie() => Some("it publishes nothing that another process computes from"),
            Role::Haptic if what == Mischief::Doom => None, // all of them compute from the same input
            _ if what.is_lasting() && !role.is_stateful() => Some("it has no state that a successor goes on from"),
            Role::Device | Role::Haptic if what == Mischief::Epoch => Some("its output has no epoch"),
            Role::Device | Role::Haptic if what == Mischief::Layout => {
                Some("its output lies in its page, whose layout is checked once, before anybody follows it")
            }
            _ => None,
        }
    }

    /// Whether a time can be given with it: it lasts, and ends by itself when that is over.
    pub(crate) fn takes_duration(self) -> bool {
        use FaultKind::{Abort, Cont, Corrupt, Exit0, Exit1, Kill, Panic, Segfault, Undo};
        !matches!(self, Kill | Cont | Segfault | Abort | Exit0 | Exit1 | Panic | Corrupt | Undo)
    }

    /// Whether it publishes what is not so.
    pub fn is_lie(self) -> bool {
        self.mischief().is_some_and(Mischief::is_lie)
    }

    /// Whether it is done to a process, or to all of them, and none need notice.
    pub fn is_done_from_outside(self) -> bool {
        matches!(self, FaultKind::Corrupt | FaultKind::NoFiles | FaultKind::ShmFull)
    }

    /// Whether lateness tells of it: not of a lie, for who lies may be in time, and not of what is done from outside, which makes nobody late by itself, so that
    /// each stall of the host would tell of it.
    pub fn is_found_by_lateness(self) -> bool {
        !self.is_lie() && !self.is_done_from_outside()
    }

    /// Whether it is a limit of its victim that is lowered.
    pub fn is_limit(self) -> bool {
        matches!(self, FaultKind::Oom | FaultKind::NoFiles)
    }

    /// Whether those who keep the station may be hurt so: it is done to them from outside, since they do nothing that they are asked to.
    pub(super) fn is_for_keepers(self) -> bool {
        self.is_limit() || self.signal().is_some() && self.mischief().is_none()
    }

    /// The names of those who can be its target.
    fn roles(self) -> Vec<&'static str> {
        let engines = Role::ALL.into_iter().filter(|role| Target::parse(role.name()).is_some());
        let keepers = [Role::Supervisor, Role::Guardian].into_iter().filter(|_| self.is_for_keepers());
        engines.filter(|role| self.hindrance(*role).is_none()).chain(keepers).map(Role::name).collect()
    }

    /// Who can be its target, in words: as few names as say it.
    pub fn targets(self) -> String {
        let engines = Role::ALL.into_iter().filter(|role| Target::parse(role.name()).is_some());
        let (can, cannot): (Vec<Role>, Vec<Role>) = engines.partition(|role| self.hindrance(*role).is_none());
        let names = |roles: &[Role]| roles.iter().map(|role| role.name()).collect::<Vec<_>>().join(", ");
        match () {
            () if self.is_for_keepers() => "all, supervisor, guardian".into(), // what is done from outside hinders nobody
            () if cannot.is_empty() => "all".into(),
            () if cannot.len() < can.len() => format!("all but {}", names(&cannot)),
            () => names(&can),
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        FaultKind::ALL.iter().find(|(kind, _, _)| *kind == self).map_or("", |(_, name, _)| name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_said_to_whom_a_kind_can_be_done() {
        for (kind, expected) in [
            (FaultKind::Kill, "all, supervisor, guardian"),
            (FaultKind::NoFiles, "all, supervisor, guardian"),
            (FaultKind::HangStart, "all"),
            (FaultKind::ShmFull, "all"),
            (FaultKind::DiskFull, "recorder"),
            (FaultKind::Nan, "all but rendering, recorder, console"),
            (FaultKind::LeakLoans, "haptic, tissue, fluid, collision-worker"),
            (FaultKind::Poison, "tissue, fluid"),
            (FaultKind::Doom, "haptic, tissue, fluid"),
        ] {
            assert_eq!(kind.targets(), expected, "{}", kind.name());
        }
    }

    #[test]
    fn who_is_named_as_a_target_can_be_one_and_who_is_not_cannot() {
        for (kind, name, _) in FaultKind::ALL {
            let said = kind.targets();
            for role in Role::ALL.into_iter().filter(|role| Target::parse(role.name()).is_some()) {
                let is_named = said.split([' ', ',']).any(|word| word == role.name());
                assert_eq!(is_named != said.starts_with("all"), kind.hindrance(role).is_none(), "{name} {}: {said}", role.name());
            }
        }
    }
}
