//! `hystation bench`: the engines' own benchmarks are theirs; `station` measures the station as a whole (see [`station`]), and `flow` beside its engine's
//! benchmark what a fine grid costs the Main Loop (see [`flow`]); `recording` measures what a recording costs and how fast it is read (see [`recording`]).

mod arm;
mod bare;
mod flow;
mod probe;
mod program;
mod recording;
mod rows;
mod station;
mod targets;

use super::large;
use crate::cli::WindowArgs;
use crate::settings::Refusal;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs a benchmark.
pub fn bench(what: &str, mesh: Option<&Path>, windows: WindowArgs, json: bool) -> Result<u8, Refusal> {
    if what != "recording" && windows != WindowArgs::default() {
        return Err(Refusal::input(format!("bench {what}: --pairs and --window are of bench recording; leave them out")));
    }
    match what {
        "tissue" | "contact" => sibling("tissue", &["bench", what], mesh, json),
        "flow" => flow::flow(mesh, json),
        "exchange" => sibling("exchange-bench", &[], mesh, json),
        "station" => station::station(mesh, json),
        "recording" => recording::recording(mesh, windows, json),
        _ => Err(Refusal::input(format!(
            "bench {what}: no such measurement; name tissue, contact, flow, exchange, recording or station"
        ))),
    }
}

/// A folder of temporary files, removed when dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// A folder of its own for a benchmark.
    pub fn new(what: &str) -> Result<Folder, Refusal> {
        let folder = large::folder().join(format!("hystation-bench-{what}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|e| Refusal::failed(format!("{}: {e}", folder.display())))?;
        Ok(Folder(folder))
    }
    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0); // of temporary files
    }
}

/// A program beside this one.
pub fn beside(binary: &str) -> Result<PathBuf, Refusal> {
    let own = std::env::current_exe().map_err(|e| Refusal::failed(format!("cannot find the folder of this program: {e}")))?;
    Ok(own.with_file_name(binary))
}

/// The error of a program that cannot be started.
pub fn not_started(path: &Path, error: &std::io::Error) -> Refusal {
    Refusal::input(format!("{}: {error}; `./station build` makes all programs, or install the package again", path.display()))
}

/// Becomes another binary of the station; returns only if it cannot.
fn sibling(binary: &str, words: &[&str], mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    use std::os::unix::process::CommandExt;
    let path = beside(binary)?;
    let mut command = Command::new(&path);
    command.args(words);
    if let Some(mesh) = mesh {
        command.arg("--mesh").arg(mesh);
    }
    if json {
        command.arg("--json");
    }
    Err(not_started(&path, &command.exec()))
}
