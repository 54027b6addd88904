//! The options of faults: what each kind takes, within which bounds, and what stands for one that is left out.

use super::{FaultKind, Injection, Keepers};
use hyst_messages::{Kind, Role, kinds_of};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `crash-loop`: successors that die if nobody says how many.
pub const DEFAULT_TIMES: u32 = 3;
/// `corrupt`: bytes that are flipped if nobody says how many.
pub const DEFAULT_BYTES: u32 = 16;

/// What leaks each second if nobody says how much: MiB or files. The bounds of `growth.rs` are passed within 1 to 16 s, in steps that it takes for a
/// leak.
pub fn default_rate(kind: FaultKind) -> f64 {
    if kind == FaultKind::LeakFiles { 60.0 } else { 32.0 }
}

/// Where bytes are flipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Place {
    /// The target's own page.
    Page,
    /// The segments that hold the messages of its streams.
    Stream,
    /// The connections of its streams to their readers.
    Link,
    /// The checkpoints of its slot.
    Checkpoint,
    /// The station's page.
    Station,
    /// The roster's page.
    Roster,
}

impl Place {
    /// All of them with their names.
    pub const ALL: [(Place, &'static str); 6] = [
        (Place::Page, "page"),
        (Place::Stream, "stream"),
        (Place::Link, "link"),
        (Place::Checkpoint, "checkpoint"),
        (Place::Station, "station"),
        (Place::Roster, "roster"),
    ];
    /// Its name.
    pub fn name(self) -> &'static str {
        Place::ALL.iter().find(|(place, _)| *place == self).map_or("", |(_, name)| name)
    }
    /// The place with this name.
    pub fn from_name(name: &str) -> Option<Place> {
        Place::ALL.iter().find(|(_, known)| *known == name).map(|(place, _)| *place)
    }
}

impl FaultKind {
    /// The options that it takes, as a file names them; `--` before them on the command line.
    pub fn options(self) -> Vec<&'static str> {
        let own: &[&str] = match self {
            FaultKind::Slow => &["factor", "extra", "jitter"],
            FaultKind::LeakMemory | FaultKind::LeakFiles => &["rate"],
            FaultKind::CrashLoop => &["times"],
            FaultKind::Corrupt => &["where", "bytes", "seed"],
            FaultKind::Block => &["thread"],
            kind if kind.is_lie() => &["output"],
            _ => &[],
        };
        let duration = self.takes_duration().then_some("for");
        duration.into_iter().chain(own.iter().copied()).collect()
    }
}

/// Whether it lies in the range, if it is given.
fn within<T: PartialOrd>(value: Option<T>, range: std::ops::RangeInclusive<T>) -> bool {
    value.is_none_or(|value| range.contains(&value))
}

impl Injection {
    /// Why a process of this role has nothing at the place; `None` if it has.
    pub(super) fn misplaced(&self, role: Role) -> Option<&'static str> {
        let has_stream = kinds_of(role).iter().any(|kind| *kind != Kind::Appearance);
        match self.place? {
            Place::Stream | Place::Link if !has_stream => Some("it has no stream of its own"),
            Place::Checkpoint if !role.is_stateful() => Some("it has no state, and so no checkpoint"),
            _ => None,
        }
    }

    /// Each option belongs to some kinds and has bounds.
    pub(super) fn check_options(&self) -> Result<(), String> {
        let kind = self.kind;
        let is_slow = kind == FaultKind::Slow;
        let is_leak = matches!(kind, FaultKind::LeakMemory | FaultKind::LeakFiles);
        let is_corrupt = kind == FaultKind::Corrupt;
        let most_rate = if kind == FaultKind::LeakFiles { 1_000.0 } else { 512.0 };
        let (factor, extra_s, jitter) = (self.factor, self.extra_s, self.jitter);
        let refuse = |text: &str| Err(text.to_string());
        match () {
            () if !is_slow && (factor, extra_s, jitter) != (None, None, None) => {
                refuse("factor, extra and jitter belong to slow")
            }
            () if !is_leak && self.rate.is_some() => refuse("rate belongs to leak-memory and leak-files"),
            () if !kind.is_lie() && self.output.is_some() => refuse(
                "output belongs to what is wrong in an output: nan, inf, range, frozen, stamp, replay, epoch, ahead and layout",
            ),
            () if kind != FaultKind::Block && self.thread.is_some() => refuse("thread belongs to block"),
            () if kind != FaultKind::CrashLoop && self.times.is_some() => refuse("times belongs to crash-loop"),
            () if !is_corrupt && (self.place, self.bytes, self.seed) != (None, None, None) => {
                refuse("where, bytes and seed belong to corrupt")
            }
            () if kind.needs_duration() && self.for_s.is_none() => Err(format!("{} needs a duration: for (--for)", kind.name())),
            () if !kind.takes_duration() && self.for_s.is_some() => {
                Err(format!("{} is done in an instant, and takes no duration; leave for (--for) out", kind.name()))
            }
            () if is_slow && factor.is_none() && extra_s.is_none() => refuse("slow needs a factor or an extra time"),
            () if is_corrupt && self.place.is_none() => {
                let places: Vec<&str> = Place::ALL.iter().map(|(_, name)| *name).collect();
                Err(format!("corrupt needs a place: where (--where) is one of {}", places.join(", ")))
            }
            () if !within(factor, 1.0..=100.0) => refuse("factor: a number from 1 to 100"),
            () if !within(extra_s, 0.0..=10.0) => refuse("extra: seconds between 0 and 10"),
            () if !within(jitter, 0.0..=1.0) => refuse("jitter: a share from 0 to 1"),
            // What is asked for is whole percent and whole microseconds.
            () if is_slow && factor.unwrap_or(1.0) < 1.01 && extra_s.unwrap_or(0.0) < 1e-6 => {
                refuse("slow by nothing: a factor of 1.01, or an extra time of 1 us, is the least that is felt")
            }
            () if !within(self.rate, 1.0..=most_rate) => Err(format!("rate: a number from 1 to {most_rate} per second")),
            () if !within(self.times, 1..=20) => refuse("times: a number from 1 to 20"),
            () if !within(self.bytes, 1..=1 << 20) => refuse("bytes: a number from 1 to 1048576"),
            () => Ok(()),
        }
    }

    /// What can be done to those who keep the station: what is done from outside, a signal or a limit that is lowered.
    pub(super) fn check_of_keepers(&self, keepers: Keepers) -> Result<(), String> {
        let kind = self.kind;
        let bare = Injection {
            tick: self.tick,
            phase_us: self.phase_us,
            for_s: self.for_s.filter(|_| kind.takes_duration()),
            ..Injection::now(kind, &self.target)
        };
        if !kind.is_for_keepers() || *self != bare {
            return Err(format!(
                "{} of {}: it takes kill, stop, cont, segfault, abort, no-files and oom, without options but for (--for) with stop, no-files \
                 and oom",
                kind.name(),
                self.target
            ));
        }
        let why = match kind {
            _ if self.for_s.is_some() => return Ok(()),
            kind if kind.is_limit() => "whoever lowers the limit puts it back",
            FaultKind::Stop if keepers == Keepers::Both => "nobody is left to continue or replace them",
            _ => return Ok(()),
        };
        Err(format!("{} of {} needs a duration: for (--for); {why}", kind.name(), self.target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::{Aim, Helper, Output};

    fn checked(kind: &str, target: &str, change: impl FnOnce(&mut Injection)) -> Result<Aim, String> {
        let mut injection = Injection::now(FaultKind::from_name(kind).unwrap(), target);
        change(&mut injection);
        injection.check()
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_reason() {
        let none = |_: &mut Injection| {};
        for (kind, target, words) in [
            ("leak-loans", "device", "no stream"),
            ("leak-loans", "console", "no stream"),
            ("nan", "console", "publishes nothing"),
            ("poison", "console", "no state"),
            ("disk-full", "tissue", "recorder"),
            ("disk-full", "recorder", "duration"),
            ("no-files", "tissue", "duration"),
            ("corrupt", "tissue", "where"),
            ("nan", "guardian", "kill, stop"),
            ("hang-start", "supervisor", "kill, stop"),
            ("stop", "supervisor+guardian", "duration"),
            ("kill", "heptic", "PROCESS:both"),
        ] {
            let reason = checked(kind, target, none).unwrap_err();
            assert!(reason.contains(words), "{kind} {target}: {reason}");
        }
        let good = [
            ("leak-files", "device"),
            ("leak-loans", "haptic"),
            ("oom", "recorder"),
            ("kill", "tissue:both"),
            ("block", "console"),
        ];
        for (kind, target) in good {
            assert!(checked(kind, target, none).is_ok(), "{kind} {target}");
        }
        for (kind, target) in [("nan", "rendering"), ("layout", "rendering")] {
            assert!(checked(kind, target, none).unwrap_err().contains("for the eye"), "{kind} {target}");
        }
    }

    /// A supervisor and a guardian replace each other when one of them stands; both together nobody replaces.
    #[test]
    fn those_who_keep_the_station_take_signals_and_limits() {
        let for_a_second = |it: &mut Injection| it.for_s = Some(1.0);
        for target in ["supervisor", "guardian", "supervisor+guardian"] {
            for kind in ["stop", "no-files", "oom"] {
                assert!(checked(kind, target, for_a_second).is_ok(), "{kind} {target}");
            }
            for kind in ["no-files", "oom"] {
                assert!(checked(kind, target, |_| ()).unwrap_err().contains("duration"), "{kind} {target}");
            }
            for kind in ["slow", "spin", "block", "leak-memory", "corrupt"] {
                assert!(checked(kind, target, for_a_second).unwrap_err().contains("it takes kill, stop"), "{kind} {target}");
            }
            assert_eq!(checked("stop", target, |_| ()).is_ok(), target != "supervisor+guardian", "{target}");
        }
    }

    #[test]
    fn a_duration_is_refused_by_what_is_done_in_an_instant() {
        for (kind, _, _) in FaultKind::ALL {
            let refused = checked(kind.name(), "recorder", |it| it.for_s = Some(1.0)).is_err_and(|why| why.contains("instant"));
            let instants = ["kill", "cont", "segfault", "abort", "exit0", "exit1", "panic", "corrupt", "undo"];
            let is_instant = instants.contains(&kind.name());
            // One that the recorder cannot do is refused for that.
            assert!(refused == is_instant, "{}", kind.name());
        }
        assert!(checked("kill", "guardian", |it| it.for_s = Some(1.0)).is_err());
    }

    #[test]
    fn each_option_belongs_to_its_kinds_and_has_bounds() {
        assert!(checked("kill", "tissue", |it| it.rate = Some(5.0)).unwrap_err().contains("leak-memory"));
        assert!(checked("kill", "tissue", |it| it.times = Some(5)).unwrap_err().contains("crash-loop"));
        assert!(checked("kill", "tissue", |it| it.seed = Some(5)).unwrap_err().contains("corrupt"));
        assert!(checked("leak-memory", "tissue", |it| it.rate = Some(f64::NAN)).is_err());
        let slow = |factor: Option<f64>, extra_s: Option<f64>| {
            checked("slow", "tissue", |it| (it.for_s, it.factor, it.extra_s, it.jitter) = (Some(1.0), factor, extra_s, Some(1.0)))
        };
        for (factor, extra_s) in [(Some(1.0), None), (None, Some(0.0)), (Some(1.004), Some(4e-7))] {
            assert!(slow(factor, extra_s).unwrap_err().contains("slow by nothing"), "{factor:?} {extra_s:?}");
        }
        assert!(slow(Some(1.01), None).is_ok() && slow(Some(1.0), Some(1e-6)).is_ok() && slow(None, Some(0.002)).is_ok());
        assert!(checked("crash-loop", "tissue", |it| it.times = Some(0)).is_err());
        assert!(checked("corrupt", "recorder", |it| it.place = Some(Place::Stream)).unwrap_err().contains("no stream"));
        assert!(checked("corrupt", "haptic", |it| it.place = Some(Place::Checkpoint)).unwrap_err().contains("no state"));
        assert!(checked("corrupt", "recorder", |it| it.place = Some(Place::Roster)).is_ok());
    }

    #[test]
    fn the_options_that_a_kind_is_said_to_take_are_those_that_it_takes() {
        type Set = fn(&mut Injection);
        let options: [(&str, Set); 11] = [
            ("for", |it| it.for_s = Some(1.0)),
            ("factor", |it| it.factor = Some(2.0)),
            ("extra", |it| it.extra_s = Some(0.001)),
            ("jitter", |it| it.jitter = Some(0.5)),
            ("rate", |it| it.rate = Some(10.0)),
            ("times", |it| it.times = Some(2)),
            ("output", |it| it.output = Some(Output::Cell)),
            ("thread", |it| it.thread = Some(Helper::Usher)),
            ("where", |it| it.place = Some(Place::Page)),
            ("bytes", |it| it.bytes = Some(8)),
            ("seed", |it| it.seed = Some(3)),
        ];
        for (kind, name, _) in FaultKind::ALL {
            let target = if kind == FaultKind::DiskFull { "recorder" } else { "tissue" };
            for (option, set) in options {
                let refused = checked(name, target, set).err().unwrap_or_default();
                let is_foreign = refused.contains("belong") || refused.contains("takes no duration");
                assert_eq!(kind.options().contains(&option), !is_foreign, "{name} {option}: {refused}");
            }
        }
    }

    #[test]
    fn a_file_may_say_whatever_the_command_line_may() {
        let text = "kind = \"corrupt\"\ntarget = \"fluid\"\ntick = 5\nwhere = \"checkpoint\"\nbytes = 9\nseed = 3\n";
        let injection: Injection = toml::from_str(text).unwrap();
        assert_eq!((injection.place, injection.bytes, injection.seed), (Some(Place::Checkpoint), Some(9), Some(3)));
        for (kind, name, _) in FaultKind::ALL {
            let text = format!("kind = \"{name}\"\ntarget = \"tissue\"\ntick = 1\n");
            assert_eq!(toml::from_str::<Injection>(&text).unwrap().kind, kind, "{name}");
        }
        assert!(Place::ALL.iter().all(|(place, name)| Place::from_name(name) == Some(*place)));
    }
}
