//! `hystation doctor`: is this machine fit for a station, and the cure for each thing that is not. Nothing is changed, and no device is opened.
//!
//! Each check is a function of a [`Machine`], whose files lie under a root, so that tests give it machines that are made up.

mod devices;
mod machine;
mod resources;
mod vulkan;

use super::shielded::shielded;
use crate::settings::Refusal;
use hyst_engine::verify::verify;
use hyst_messages::Role;
use rustix::fs::Access;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;

/// The linker of programs of this system; it lists what a library needs without running anything of it.
const LINKER: &str = "/lib64/ld-linux-x86-64.so.2";

/// How something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Good,
    /// A station runs, though worse.
    Weak,
    /// No station starts, or not the one that is set up.
    Bad,
}

/// One finding.
#[derive(Debug, Serialize)]
struct Finding {
    what: &'static str,
    state: State,
    found: String,
    /// What to do; `None` if it is good.
    cure: Option<String>,
}

impl Finding {
    fn good(what: &'static str, found: impl Into<String>) -> Finding {
        Finding { what, state: State::Good, found: found.into(), cure: None }
    }

    fn weak(what: &'static str, found: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { what, state: State::Weak, found: found.into(), cure: Some(cure.into()) }
    }

    fn bad(what: &'static str, found: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { state: State::Bad, ..Finding::weak(what, found, cure) }
    }
}

/// Where the checks look.
struct Machine<'a> {
    /// What stands before each path of a file.
    root: PathBuf,
    environment: BTreeMap<String, String>,
    /// Whether this user may read a file, or write it too.
    may: fn(&Path, Access) -> bool,
    /// Libraries that a library needs and that are not there.
    lacks: fn(&Path) -> Vec<String>,
    /// Why a file is no driver of a device.
    refuses: &'a dyn Fn(&Path) -> Option<String>,
}

impl<'a> Machine<'a> {
    /// This one.
    fn own(refuses: &'a dyn Fn(&Path) -> Option<String>) -> Machine<'a> {
        Machine {
            root: PathBuf::from("/"),
            environment: std::env::vars_os()
                .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
                .collect(),
            may: |path, access| rustix::fs::access(path, access).is_ok(),
            lacks,
            refuses,
        }
    }

    /// A path of the machine, as it lies under the root.
    fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        let path = path.as_ref();
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// A file's text; empty where there is none.
    fn text(&self, path: impl AsRef<Path>) -> String {
        std::fs::read(self.path(path)).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default()
    }

    /// The names in a folder, in the order of the alphabet; none where there is no such folder.
    fn names(&self, folder: impl AsRef<Path>) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort_unstable();
        names
    }

    /// What a link leads to, by its last name.
    fn linked(&self, link: impl AsRef<Path>) -> Option<String> {
        let target = std::fs::read_link(self.path(link)).ok()?;
        Some(target.file_name()?.to_string_lossy().into_owned())
    }

    /// A variable of the environment that says something.
    fn variable(&self, name: &str) -> Option<&str> {
        self.environment.get(name).map(String::as_str).filter(|value| !value.is_empty())
    }
}

/// What the linker does not find of what a library needs; nothing where it cannot be asked.
fn lacks(library: &Path) -> Vec<String> {
    let asked = Command::new(LINKER).arg(library).env("LD_TRACE_LOADED_OBJECTS", "1").stdin(Stdio::null()).output();
    let said = asked.map(|asked| String::from_utf8_lossy(&asked.stdout).into_owned()).unwrap_or_default();
    said.lines().filter_map(|line| Some(line.trim().strip_suffix("=> not found")?.trim().to_string())).collect()
}

/// Looks at the machine; exit code 1 if a station cannot run on it. As JSON: an array of `what`, `state` (good, weak, bad), `found` and `cure`.
pub fn doctor(json: bool) -> Result<u8, Refusal> {
    let findings = shielded(|interrupted| {
        let given_up = || interrupted.load(Ordering::SeqCst);
        findings(&Machine::own(&|path: &Path| verify(path, Role::Hardware, &given_up).err()))
    })?;
    if json {
        println!("{}", serde_json::to_string_pretty(&findings).map_err(|error| Refusal::failed(error.to_string()))?);
    } else {
        findings.iter().for_each(tell);
    }
    Ok(code(&findings))
}

fn tell(Finding { what, state, found, cure }: &Finding) {
    let mark = match state {
        State::Good => "good",
        State::Weak => "weak",
        State::Bad => "bad ",
    };
    println!("{mark}  {what:<16} {found}");
    if let Some(cure) = cure {
        println!("      {:<16} cure: {cure}", "");
    }
}

fn findings(machine: &Machine) -> Vec<Finding> {
    let mut findings = machine::findings(machine);
    findings.extend(resources::findings(machine));
    findings.push(vulkan::pictures(machine));
    findings.push(vulkan::display(machine));
    findings.extend(devices::findings(machine));
    findings
}

fn code(findings: &[Finding]) -> u8 {
    u8::from(findings.iter().any(|finding| finding.state == State::Bad))
}

#[cfg(test)]
mod made_up {
    use super::*;

    /// A machine of a test's own, with nothing on it; removed when it is dropped.
    pub struct MadeUp(pub Machine<'static>);

    impl MadeUp {
        pub fn new(name: &str) -> MadeUp {
            let root = std::env::temp_dir().join(format!("hystation-doctor-{}-{name}", std::process::id()));
            let _ = std::fs::remove_dir_all(&root); // of a test that was killed
            std::fs::create_dir_all(&root).unwrap();
            MadeUp(Machine {
                root,
                environment: BTreeMap::new(),
                may: |path, _| path.exists(),
                lacks: |_| Vec::new(),
                refuses: &|path: &Path| (!path.exists()).then(|| "is not there".to_string()),
            })
        }

        pub fn write(&self, path: &str, text: impl AsRef<[u8]>) {
            let path = self.0.path(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }

        pub fn link(&self, path: &str, target: &str) {
            let path = self.0.path(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::os::unix::fs::symlink(target, path).unwrap();
        }

        pub fn set(&mut self, name: &str, value: &str) {
            self.0.environment.insert(name.into(), value.into());
        }
    }

    impl Drop for MadeUp {
        fn drop(&mut self) {
            std::fs::remove_dir_all(&self.0.root).unwrap();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_weak_machine_runs_a_station_a_bad_one_does_not_and_programs_read_why() {
        let weak = || Finding::weak("Vulkan", "none", "install one");
        let bad = || Finding::bad("programs", "none", "build them");
        assert_eq!([code(&[Finding::good("cores", "4"), weak()]), code(&[weak(), bad()]), code(&[])], [0, 1, 0]);
        let said = serde_json::to_value([Finding::good("cores", "4"), bad()]).unwrap();
        let good = serde_json::json!({ "what": "cores", "state": "good", "found": "4", "cure": null });
        let bad = serde_json::json!({ "what": "programs", "state": "bad", "found": "none", "cure": "build them" });
        assert_eq!(said, serde_json::json!([good, bad]));
    }

    #[test]
    fn a_library_that_needs_what_is_not_there_is_told_and_one_that_can_be_loaded_is_not() {
        let own = std::env::current_exe().unwrap();
        assert_eq!(lacks(&own), Vec::<String>::new());
        // Wherever the name of what it needs stands, another of the same length.
        let (name, other) = (b"\0libc.so.6\0", b"\0libq.so.6\0");
        let mut bytes = std::fs::read(own).unwrap();
        let places: Vec<usize> = (0..bytes.len() - name.len()).filter(|at| bytes[*at..].starts_with(name)).collect();
        places.iter().for_each(|at| bytes[*at..at + name.len()].copy_from_slice(other));
        let path = std::env::temp_dir().join(format!("hystation-lacks-{}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        let said = lacks(&path);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(said, ["libq.so.6"]);
    }
}
