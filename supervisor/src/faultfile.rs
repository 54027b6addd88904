//! Faults that are injected on purpose: what a file for `--faults` may say, and what a target means.

use hyst_messages::{Role, Slot};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most faults in one file: a campaign of a few hours.
pub const MOST_FAULTS: usize = 100_000;

/// What is done to a process. Each comes from outside, by a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
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
}

impl FaultKind {
    /// All kinds with what they do.
    pub const ALL: [(FaultKind, &'static str, &'static str); 5] = [
        (FaultKind::Kill, "kill", "SIGKILL: the process is gone at once"),
        (FaultKind::Stop, "stop", "SIGSTOP: it hangs; continued after --for, if it still lives (default: never)"),
        (FaultKind::Cont, "cont", "SIGCONT: a stopped process goes on as a zombie of its former self"),
        (FaultKind::Segfault, "segfault", "SIGSEGV: a wild access"),
        (FaultKind::Abort, "abort", "SIGABRT: a broken invariant"),
    ];
    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<FaultKind> {
        FaultKind::ALL.iter().find(|(_, known, _)| *known == name).map(|(kind, _, _)| *kind)
    }
    /// Its name.
    pub fn name(self) -> &'static str {
        FaultKind::ALL.iter().find(|(kind, _, _)| *kind == self).map_or("", |(_, name, _)| name)
    }
}

/// Which process of a role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// The one that does the role's work now.
    Active,
    /// One that does not.
    Spare,
    /// This one.
    Slot(Slot),
}

/// A target as on the command line: `haptic:active`, `tissue:spare`, `collision-worker:1`, `device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    /// Role.
    pub role: Role,
    /// Which of them.
    pub which: Which,
}

impl Target {
    /// Reads a target; an indexed role without a word after the colon means the active one.
    pub fn parse(text: &str) -> Option<Target> {
        let (name, which) = text.split_once(':').unwrap_or((text, "active"));
        let role = Role::from_name(name).filter(|role| !matches!(role, Role::Hardware | Role::Guardian | Role::Supervisor))?;
        let which = match which {
            "active" => Which::Active,
            "spare" if role.is_indexed() => Which::Spare,
            index => Which::Slot(Slot::new(role, index.parse().ok()?)?),
        };
        Some(Target { role, which })
    }
}

/// One fault to come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Injection {
    /// What.
    pub kind: FaultKind,
    /// To whom.
    pub target: String,
    /// At which tick of the station; 0 means at once.
    pub tick: u64,
    /// Seconds until a stopped process is continued.
    #[serde(default, rename = "for", skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
}

/// A file for `--faults`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultFile {
    /// Seed of whatever is drawn at random.
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
    Read(String, std::io::Error),
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
    /// What is wrong with it, if anything.
    pub fn check(&self) -> Result<Target, String> {
        let target = Target::parse(&self.target).ok_or_else(|| {
            format!(
                "target {:?}: write PROCESS, PROCESS:active, PROCESS:spare or PROCESS:INDEX, as `status` names them",
                self.target
            )
        })?;
        match self.for_s {
            Some(for_s) if !(0.0..=3_600.0).contains(&for_s) => Err(format!("for = {for_s}: seconds between 0 and 3600")),
            _ => Ok(target),
        }
    }
}

/// Reads and checks a fault file; the faults come back in the order of their ticks.
pub fn read(path: &Path) -> Result<FaultFile, FaultFileError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|e| FaultFileError::Read(name.clone(), e))?;
    parse(&name, &text)
}

fn parse(name: &str, text: &str) -> Result<FaultFile, FaultFileError> {
    let mut file: FaultFile = toml::from_str(text).map_err(|e| FaultFileError::Form(name.into(), e.to_string()))?;
    if file.fault.len() > MOST_FAULTS {
        return Err(FaultFileError::Form(name.into(), format!("{} faults, at most {MOST_FAULTS} are allowed", file.fault.len())));
    }
    for (index, fault) in file.fault.iter().enumerate() {
        fault.check().map_err(|reason| FaultFileError::Fault { file: name.into(), number: index + 1, reason })?;
    }
    file.fault.sort_by_key(|fault| fault.tick);
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_read_and_the_hardware_is_none() {
        let haptic_1 = Slot::new(Role::Haptic, 1).unwrap();
        assert_eq!(Target::parse("haptic:1"), Some(Target { role: Role::Haptic, which: Which::Slot(haptic_1) }));
        assert_eq!(Target::parse("device"), Some(Target { role: Role::Device, which: Which::Active }));
        assert_eq!(Target::parse("tissue:spare"), Some(Target { role: Role::Tissue, which: Which::Spare }));
        for bad in ["hardware", "haptic:2", "haptic:x", "", "device:spare", "guardian"] {
            assert_eq!(Target::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_fault_file_is_sorted_and_nonsense_is_named() {
        let good = "seed = 41\n[[fault]]\nkind = \"stop\"\ntarget = \"tissue:active\"\ntick = 900\nfor = 0.5\n\
                    [[fault]]\nkind = \"kill\"\ntarget = \"haptic:active\"\ntick = 300\n";
        let file = parse("f", good).unwrap();
        assert_eq!(file.fault.iter().map(|fault| fault.tick).collect::<Vec<_>>(), [300, 900]);
        assert_eq!((file.seed, file.fault[1].for_s), (41, Some(0.5)));
        let bad_target = parse("f", &good.replace("haptic:active", "heptic")).unwrap_err().to_string();
        assert!(bad_target.contains("fault 2") && bad_target.contains("heptic"), "{bad_target}");
        assert!(parse("f", &good.replace("tick = 300", "tock = 300")).unwrap_err().to_string().contains("tock"));
        assert!(parse("f", &good.replace("\"kill\"", "\"melt\"")).is_err());
        assert!(parse("f", &good.replace("for = 0.5", "for = nan")).is_err());
    }
}
