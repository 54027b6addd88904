//! Where the results of a station come from: which programs, on which machine, on which day. Those of two builds are never mixed.

use super::file::Campaign;
use super::station::StationOutcome;
use crate::plan;
use crate::settings::{Refusal, own_folder};
use hyst_engine::Settings;
use hyst_exchange::machine;
use hyst_messages::fnv_words;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes of a program that are hashed at once.
const PART_BYTES: u64 = 1 << 20;

/// What ran a station.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Version of this program.
    pub version: String,
    /// Hash of the programs that are run: this one, and the engines of every arm.
    pub build: String,
    /// Processor.
    pub cpu: String,
    /// Cores.
    pub cores: u64,
    /// Release of the kernel.
    pub kernel: String,
    /// Day on which the station was started (UTC).
    pub date: String,
}

impl Origin {
    /// What a station that is started now is run by.
    pub fn here(campaign: &Campaign) -> Result<Origin, Refusal> {
        let programs = programs(campaign)?;
        let build = hash(&programs).map_err(|(path, e)| Refusal::failed(format!("{}: {e}; it is to be run", path.display())))?;
        let machine = machine::describe();
        let word = |key: &str| machine[key].as_str().unwrap_or_default().to_string();
        Ok(Origin {
            version: env!("CARGO_PKG_VERSION").into(),
            build: format!("{build:016x}"),
            cpu: word("cpu"),
            cores: machine["cores"].as_u64().unwrap_or(0),
            kernel: word("kernel"),
            date: word("date"),
        })
    }

    /// Whether both are of the same programs.
    pub fn is_same_build(&self, other: &Origin) -> bool {
        (&self.version, &self.build) == (&other.version, &other.build)
    }
}

/// This program and the engines of all arms, each once.
fn programs(campaign: &Campaign) -> Result<Vec<PathBuf>, Refusal> {
    let own = own_folder()?;
    let roles: BTreeSet<&str> =
        plan::slots(&Settings::default(), true, None).into_iter().map(|slot| slot.role().name()).collect();
    let folders: BTreeSet<&Path> = campaign.arms.iter().map(|arm| campaign.binaries(arm).unwrap_or(&own)).collect();
    let engines = folders.iter().flat_map(|folder| roles.iter().map(|role| folder.join(role)));
    let own_program = std::env::current_exe().map_err(|e| Refusal::failed(format!("cannot find this program: {e}")))?;
    Ok([own_program].into_iter().chain(engines).collect())
}

fn hash(programs: &[PathBuf]) -> Result<u64, (PathBuf, std::io::Error)> {
    let mut hash = 0;
    for path in programs {
        hash = hash_file(hash, path).map_err(|e| (path.clone(), e))?;
    }
    Ok(hash)
}

fn hash_file(mut hash: u64, path: &Path) -> std::io::Result<u64> {
    let mut file = File::open(path)?;
    let mut part = Vec::with_capacity(PART_BYTES as usize);
    loop {
        part.clear();
        let length = file.by_ref().take(PART_BYTES).read_to_end(&mut part)?;
        if length == 0 {
            return Ok(hash);
        }
        part.resize(length.next_multiple_of(8), 0);
        let words = part.chunks_exact(8).map(|word| word.iter().fold(0, |word, byte| word << 8 | u64::from(*byte)));
        hash = fnv_words(hash, words.chain([length as u64]));
    }
}

/// Stations that were run by one build on one machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Batch {
    /// By what, with the first day; `None` of those whose line does not say it.
    pub origin: Option<Origin>,
    /// Last day.
    pub last_date: String,
    /// How many.
    pub stations: usize,
}

impl Batch {
    fn has(&self, origin: Option<&Origin>) -> bool {
        let key = |origin: &Origin| Origin { date: String::new(), ..origin.clone() };
        self.origin.as_ref().map(key) == origin.map(key)
    }

    /// One line for people.
    pub fn words(&self) -> String {
        let Some(origin) = &self.origin else { return format!("runs of a build that nobody noted: {}", self.stations) };
        let Origin { version, build, cpu, cores, kernel, date } = origin;
        let days = if *date == self.last_date { date.clone() } else { format!("{date} to {}", self.last_date) };
        format!("runs of build {version} {build}, {days}, on {cpu}, {cores} cores, Linux {kernel}: {}", self.stations)
    }
}

/// By what all stations were run, in the order in which they were.
pub fn batches(stations: &[StationOutcome]) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    for station in stations {
        let origin = station.origin.as_ref();
        let last_date = origin.map_or(String::new(), |origin| origin.date.clone());
        match batches.iter_mut().find(|batch| batch.has(origin)) {
            Some(batch) => (batch.last_date, batch.stations) = (last_date, batch.stations + 1),
            None => batches.push(Batch { origin: origin.cloned(), last_date, stations: 1 }),
        }
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_byte_in_any_program_is_another_build_and_the_same_bytes_are_the_same_one() {
        let folder = std::env::temp_dir().join(format!("hystation-origin-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files = ["a", "b"].map(|name| folder.join(name));
        let of = |a: &[u8], b: &[u8]| {
            std::fs::write(&files[0], a).unwrap();
            std::fs::write(&files[1], b).unwrap();
            hash(&files).unwrap()
        };
        let long = vec![7; PART_BYTES as usize + 3];
        let mut other = long.clone();
        other[PART_BYTES as usize + 2] = 8;
        assert_eq!(of(&long, b"engine"), of(&long, b"engine"));
        let hashes: BTreeSet<u64> =
            [of(&long, b"engine"), of(&other, b"engine"), of(&long, b"engine\0"), of(&long, b"engin"), of(b"engine", &long)]
                .into();
        assert_eq!(hashes.len(), 5);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(hash(&files).unwrap_err().0, files[0]);
    }

    #[test]
    fn a_report_names_each_build_and_machine_once_with_its_days() {
        let of = |build: &str, date: &str| StationOutcome {
            origin: Some(Origin {
                version: "1.2.3".into(),
                build: build.into(),
                kernel: "6.1".into(),
                date: date.into(),
                ..Origin::default()
            }),
            ..StationOutcome::default()
        };
        let old = StationOutcome::default();
        let all = batches(&[old, of("f00", "2026-11-24"), of("f00", "2026-11-25"), of("bad", "2026-11-25")]);
        let words: Vec<String> = all.iter().map(Batch::words).collect();
        assert_eq!(words[0], "runs of a build that nobody noted: 1");
        assert!(
            words[1].starts_with("runs of build 1.2.3 f00, 2026-11-24 to 2026-11-25, on ") && words[1].ends_with(": 2"),
            "{words:?}"
        );
        assert!(words[2].starts_with("runs of build 1.2.3 bad, 2026-11-25, on ") && words.len() == 3, "{words:?}");
    }
}
