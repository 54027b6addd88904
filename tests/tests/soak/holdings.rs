//! What a whole station has in files, shared memory and logs, and whether that grows.

use station_tests::Station;
use std::collections::BTreeMap;
use std::path::Path;

/// What it may have more in the second half of a run than in the first: files, MiB of shared memory. The least of each half is compared: a reader keeps
/// the last message of a writer that died, and with it the five files of that writer's service, until it has another one or dies itself.
const ALLOWED_FILES: u64 = 1;
const ALLOWED_MIB: f64 = 2.0;
/// What logs, journal and the list of faults may grow by for each death, KiB: a dozen lines, and the fault's own.
const ALLOWED_LOG_KIB: f64 = 4.0;

/// What a station has on disk and in shared memory.
#[derive(Default)]
pub struct Holdings {
    /// Files by their kind, which is the name with each number and hash replaced by a sign.
    files: BTreeMap<String, u64>,
    /// What they take, MiB.
    mib: f64,
    /// What logs, journal and list of faults hold, KiB.
    log_kib: f64,
}

impl Holdings {
    pub fn of(station: &Station) -> Holdings {
        let mut holdings = Holdings::default();
        let root = station.place();
        holdings.add_folder(root.root(), false);
        let own = root.prefix();
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&own) {
                holdings.add(&entry, false, station.name());
            }
        }
        holdings
    }

    fn add_folder(&mut self, folder: &Path, is_log: bool) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            self.add(&entry, is_log, "");
        }
    }

    fn add(&mut self, entry: &std::fs::DirEntry, is_log: bool, station: &str) {
        use std::os::unix::fs::MetadataExt;
        let Ok(data) = entry.metadata() else { return };
        let name = entry.file_name().to_string_lossy().replace(station, "");
        let is_log = is_log || name == "logs" || name.ends_with(".log") || name.ends_with(".jsonl");
        match (data.is_dir(), is_log) {
            (true, _) => self.add_folder(&entry.path(), is_log),
            (false, true) => self.log_kib += data.len() as f64 / 1024.0,
            (false, false) => {
                let kind: Vec<&str> = name.split(|c: char| c.is_ascii_hexdigit()).filter(|part| !part.is_empty()).collect();
                *self.files.entry(kind.join("#")).or_default() += 1;
                self.mib += data.blocks() as f64 * 512.0 / f64::from(1 << 20);
            }
        }
    }

    fn count(&self) -> u64 {
        self.files.values().sum()
    }

    fn kinds(&self) -> String {
        let kinds: Vec<String> = self.files.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        kinds.join(", ")
    }
}

/// What is wrong with the samples of a run, one after each death.
pub fn verdict(samples: &[Holdings]) -> Vec<String> {
    let [first, .., last] = samples else { return vec!["nobody has died".to_owned()] };
    let halves = samples.split_at(samples.len() / 2);
    let fewest = [halves.0, halves.1].map(|half| half.iter().min_by_key(|sample| sample.count()).unwrap_or(first));
    let least_mib = [halves.0, halves.1].map(|half| half.iter().map(|sample| sample.mib).fold(f64::MAX, f64::min));
    let log_kib = (last.log_kib - first.log_kib) / (samples.len() - 1) as f64;
    let counts = fewest.map(Holdings::count);
    println!(
        "least of the first and of the second half: {counts:?} files, {least_mib:.1?} MiB; {log_kib:.2} KiB of logs for each death"
    );
    let mut wrong = Vec::new();
    if counts[1] > counts[0] + ALLOWED_FILES {
        wrong.push(format!(
            "the station grew from {} files to {}: {}; {}",
            counts[0],
            counts[1],
            fewest[0].kinds(),
            fewest[1].kinds()
        ));
    }
    if least_mib[1] > least_mib[0] + ALLOWED_MIB {
        wrong.push(format!("the station's shared memory grew: {least_mib:.1?} MiB"));
    }
    if log_kib > ALLOWED_LOG_KIB {
        wrong.push(format!("logs grow by {log_kib:.2} KiB for each death"));
    }
    wrong
}
