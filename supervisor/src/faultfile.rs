//! Faults that are injected on purpose: what a file for `--faults` may say, and what a target means.

mod kind;
mod options;
mod output;
mod target;
mod thread;

pub use kind::FaultKind;
pub use options::{DEFAULT_BYTES, DEFAULT_TIMES, Place, default_rate};
pub use output::Output;
pub use target::{Aim, Keepers, Target, Which};
pub use thread::Helper;

use crate::moment::MOST_PHASE_US;
use hyst_messages::{Role, Slot};
use hyst_scene::bounded::{self, Unread};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most faults in one file: a campaign of a few hours.
pub const MOST_FAULTS: usize = 100_000;
/// Largest file, bytes: so many faults, each with every option that there is, have less.
const MOST_BYTES: u64 = 32 << 20;
/// Shortest and longest time that a fault may last, s: in less than a tick nobody does anything, and nothing would come of it.
const LASTS_S: std::ops::RangeInclusive<f64> = 0.001..=3_600.0;

/// One fault to come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Injection {
    /// What.
    pub kind: FaultKind,
    /// To whom.
    pub target: String,
    /// At which tick of the station; 0 means at once.
    pub tick: u64,
    /// Place in that tick, µs, 0 to 999.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub phase_us: u32,
    /// Ticks that it may cost the hand beyond its control, where it is to cost some, as the death of a servo that is alone. Default: 20 of the device, else none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed_misses: Option<u64>,
    /// Seconds until a stopped process is continued, or until it ends what it was asked to do.
    #[serde(default, rename = "for", skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// `slow`: a step takes so many times as long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub factor: Option<f64>,
    /// `slow`: and so many seconds longer.
    #[serde(default, rename = "extra", skip_serializing_if = "Option::is_none")]
    pub extra_s: Option<f64>,
    /// `slow`: what is added varies by this share of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter: Option<f64>,
    /// `leak-memory`: MiB per second; `leak-files`: files per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// `crash-loop`: how many successors die.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<u32>,
    /// What is a lie: by which output alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<Output>,
    /// `block`: which thread beside its steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thread: Option<Helper>,
    /// `corrupt`: where.
    #[serde(default, rename = "where", skip_serializing_if = "Option::is_none")]
    pub place: Option<Place>,
    /// `corrupt`: how many bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u32>,
    /// `corrupt`: what they are drawn from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

fn is_zero(value: &u32) -> bool {
    *value == 0
}

/// A file for `--faults`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultFile {
    /// Seed of what is drawn at random: which bytes a fault flips that names no seed of its own. Each gets another.
    #[serde(default)]
    pub seed: u64,
    /// The faults.
    #[serde(default)]
    pub fault: Vec<Injection>,
}

/// A fault file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FaultFileError {
    /// It cannot be read.
    #[error("fault file {0}: {1}; give the path of a readable file")]
    Read(String, Unread),
    /// It is not TOML of this form.
    #[error("fault file {0}: {1}")]
    Form(String, String),
    /// One of its faults is nonsense.
    #[error("fault file {file}: fault {number}: {reason}")]
    Fault {
        /// The file.
        file: String,
        /// From 1.
        number: usize,
        /// What is wrong.
        reason: String,
    },
}

impl Injection {
    /// A fault at once, without options.
    pub fn now(kind: FaultKind, target: &str) -> Injection {
        Injection {
            kind,
            target: target.into(),
            tick: 0,
            phase_us: 0,
            allowed_misses: None,
            for_s: None,
            factor: None,
            extra_s: None,
            jitter: None,
            rate: None,
            times: None,
            output: None,
            thread: None,
            place: None,
            bytes: None,
            seed: None,
        }
    }

    /// What is wrong with it, if anything.
    pub fn check(&self) -> Result<Aim, String> {
        let aim = Aim::parse(&self.target).ok_or_else(|| no_target(&self.target))?;
        if self.phase_us > MOST_PHASE_US {
            return Err(format!("phase_us = {}: microseconds in a tick, 0 to {MOST_PHASE_US}", self.phase_us));
        }
        if let Some(for_s) = self.for_s.filter(|for_s| !LASTS_S.contains(for_s)) {
            return Err(format!("for = {for_s}: seconds between 0.001, which is a tick, and 3600"));
        }
        match aim {
            Aim::Engines(target) => {
                let hindrance = self.kind.hindrance(target.role).or_else(|| self.misplaced(target.role));
                if let Some(reason) = hindrance.or_else(|| self.untold(target.role)).or_else(|| self.unhelped(target.role)) {
                    return Err(format!("{} {}: {reason}", self.kind.name(), self.target));
                }
                self.check_options()?;
            }
            Aim::Keepers(keepers) => self.check_of_keepers(keepers)?,
        }
        Ok(aim)
    }

    /// What is wrong with it in a station of these slots, if anything.
    pub fn check_in(&self, slots: &[Slot]) -> Result<Aim, String> {
        let aim = self.check()?;
        if aim.is_in(slots) {
            return Ok(aim);
        }
        let names: Vec<String> = slots.iter().map(Slot::to_string).collect();
        Err(format!("the station has no {}: it has {}", self.target, names.join(", ")))
    }

    /// Whether it comes about in the steps of its victim alone: one that makes none does nothing of it. A tissue tells its topology and how its objects look
    /// beside them, whoever has the role.
    pub fn is_of_steps(&self) -> bool {
        let is_beside = matches!(self.output, Some(Output::Topology | Output::Appearance));
        let is_lie = self.kind.is_lie() && !is_beside;
        is_lie || matches!(self.kind, FaultKind::Slow | FaultKind::Poison | FaultKind::LeakLoans)
    }

    /// The engines that it is for; an error if it is for those who keep the station, whom the supervisor cannot be asked to hurt.
    pub fn engines(&self) -> Result<Target, String> {
        match self.check()? {
            Aim::Engines(target) => Ok(target),
            Aim::Keepers(_) => Err(format!(
                "{} is hurt from outside: by `hystation fault inject` or a campaign, not by a file for --faults",
                self.target
            )),
        }
    }
}

/// Why a name means nobody who can be hurt.
fn no_target(name: &str) -> String {
    if Role::name_in(name) == Role::Hardware.name() {
        return "hardware stands for the device on the desk, which keeps the ledger: it is no engine, and is not hurt; take device".into();
    }
    format!(
        "target {name:?}: write PROCESS, PROCESS:active, PROCESS:spare, PROCESS:both, PROCESS:newcomer or PROCESS:INDEX, for an engine as `status` \
         names them, or supervisor, guardian or supervisor+guardian"
    )
}

/// Reads and checks a fault file; the faults come back in the order of their ticks.
pub fn read(path: &Path) -> Result<FaultFile, FaultFileError> {
    let name = path.display().to_string();
    let text = bounded::text(path, MOST_BYTES).map_err(|e| FaultFileError::Read(name.clone(), e))?;
    parse(&name, &text)
}

fn parse(name: &str, text: &str) -> Result<FaultFile, FaultFileError> {
    let mut file: FaultFile = toml::from_str(text).map_err(|e| FaultFileError::Form(name.into(), e.to_string()))?;
    if file.fault.len() > MOST_FAULTS {
        return Err(FaultFileError::Form(name.into(), format!("{} faults, at most {MOST_FAULTS} are allowed", file.fault.len())));
    }
    for (index, fault) in file.fault.iter_mut().enumerate() {
        if fault.kind == FaultKind::Corrupt {
            fault.seed.get_or_insert(file.seed.wrapping_add(index as u64));
        }
        fault.engines().map_err(|reason| FaultFileError::Fault { file: name.into(), number: index + 1, reason })?;
    }
    file.fault.sort_by_key(|fault| fault.tick);
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_faults_that_is_no_file_or_too_large_is_refused() {
        let refusal = |path: &Path| read(path).unwrap_err().to_string();
        assert!(refusal(Path::new("/dev/null")).contains("it is a pipe or a device, not a file; give the path of"));
        let path = std::env::temp_dir().join(format!("hystation-faults-{}.toml", std::process::id()));
        std::fs::File::create(&path).unwrap().set_len(MOST_BYTES + 1).unwrap();
        assert!(refusal(&path).contains(&format!("it has more than {MOST_BYTES} bytes")));
        std::fs::write(&path, "seed = 41\n").unwrap();
        assert_eq!(read(&path).unwrap().seed, 41);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_fault_file_is_sorted_and_nonsense_is_named() {
        let good = "seed = 41\n[[fault]]\nkind = \"stop\"\ntarget = \"tissue:active\"\ntick = 900\nfor = 0.5\n\
                    [[fault]]\nkind = \"kill\"\ntarget = \"haptic:active\"\ntick = 300\n";
        let file = parse("f", good).unwrap();
        assert_eq!(file.fault.iter().map(|fault| fault.tick).collect::<Vec<_>>(), [300, 900]);
        assert_eq!((file.seed, file.fault[1].for_s), (41, Some(0.5)));
        let corrupt = "seed = 41\n[[fault]]\nkind = \"corrupt\"\ntarget = \"fluid\"\ntick = 5\nwhere = \"page\"\n";
        let seeds = |text: &str| parse("f", text).unwrap().fault.iter().map(|fault| fault.seed).collect::<Vec<_>>();
        let two = corrupt.to_string() + corrupt.trim_start_matches("seed = 41\n") + "seed = 7\n";
        assert_eq!(seeds(&two), [Some(41), Some(7)], "the file's seed is that of whoever names none");
        let bad_target = parse("f", &good.replace("haptic:active", "heptic")).unwrap_err().to_string();
        assert!(bad_target.contains("fault 2") && bad_target.contains("heptic"), "{bad_target}");
        for target in ["hardware", "hardware:0"] {
            let hardware = parse("f", &good.replace("haptic:active", target)).unwrap_err().to_string();
            assert!(hardware.contains("it is no engine, and is not hurt"), "{hardware}");
        }
        assert!(parse("f", &good.replace("tick = 300", "tock = 300")).unwrap_err().to_string().contains("tock"));
        assert!(parse("f", &good.replace("\"kill\"", "\"melt\"")).is_err());
        for time in ["nan", "0.0", "-0.0", "0.0009", "inf", "3600.1"] {
            let refused = parse("f", &good.replace("0.5", time)).unwrap_err().to_string();
            assert!(refused.contains("which is a tick"), "{time}: {refused}");
        }
        assert!(parse("f", &good.replace("0.5", "0.001")).is_ok());
        assert!(parse("f", &good.replace("for = 0.5", "phase_us = 1000")).is_err());
        let keeper = parse("f", &good.replace("haptic:active", "guardian")).unwrap_err().to_string();
        assert!(keeper.contains("fault inject"), "{keeper}");
    }
}
