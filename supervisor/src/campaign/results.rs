//! The results of a campaign as they lie in a folder, for one who changes nothing there: it may be write-protected. They are judged as by `--batch 0`,
//! whichever build made them: by the campaign's file, which lies beside them.

use super::begun::{Parted, of_plan};
use super::draw::{self, Plan};
use super::file::{self, Campaign, MOST_BYTES};
use super::fit;
use super::judge::{Judgement, judge};
use super::outcome::Outcome;
use super::station::StationOutcome;
use crate::settings::Refusal;
use hyst_scene::bounded;
use serde::de::DeserializeOwned;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The file that says what the results are of.
pub(super) const PLAN: &str = "plan.json";
/// The file with a line for each fault.
pub(super) const RESULTS: &str = "results.jsonl";
/// The file with a line for each run of a station.
pub(super) const STATIONS: &str = "stations.jsonl";
/// Largest plan, bytes: one of as many faults as a campaign may have is a sixth of that.
const MOST_PLAN_BYTES: u64 = 1 << 28;
/// Files that are looked at for the campaign's own: a folder of results has one.
const MOST_FILES: usize = 64;

/// What a folder has.
#[derive(Debug)]
pub struct Results {
    /// Where.
    pub folder: PathBuf,
    /// What was to be done.
    pub campaign: Campaign,
    /// Its plan.
    pub plan: Plan,
    /// One for each fault that is through.
    pub outcomes: Vec<Outcome>,
    /// One for each run of a station.
    pub stations: Vec<StationOutcome>,
    /// Of stations that were cut off.
    pub cut: Vec<Outcome>,
}

/// The lines of a file.
pub(super) struct Lines<T> {
    /// What the whole ones say.
    pub found: Vec<T>,
    /// If there is half a line at the end, which says nothing: the length of the file without it, bytes.
    pub whole_bytes: Option<u64>,
}

/// Reads a folder; the campaign's file is the one in it whose hash the plan has, else one of those `given`.
pub fn read(folder: &Path, given: &[PathBuf]) -> Result<Results, Refusal> {
    let refuse = |what: String| Refusal::input(format!("{}: {what}", folder.display()));
    let refuse_with_cure = |what: String| refuse(format!("{what}; give the folder of a campaign's results"));
    let found = std::fs::metadata(folder).map_err(|e| refuse_with_cure(e.to_string()))?;
    if !found.is_dir() {
        return Err(refuse_with_cure("it is no folder".into()));
    }
    let lock = File::open(folder).map_err(|e| refuse_with_cure(e.to_string()))?;
    if matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)) {
        return Err(refuse("a campaign is at work in it; wait for its end".into()));
    }
    let text = bounded::text(&folder.join(PLAN), MOST_PLAN_BYTES).map_err(|e| refuse_with_cure(format!("{PLAN}: {e}")))?;
    let plan: Plan = serde_json::from_str(&text).map_err(|e| refuse_with_cure(format!("{PLAN}: {e}")))?;
    let campaign = campaign_of(folder, &plan, given)?;
    let outcomes: Vec<Outcome> = lines(folder, RESULTS).map_err(refuse_with_cure)?.found;
    let stations: Vec<StationOutcome> = lines(folder, STATIONS).map_err(refuse_with_cure)?.found;
    let Parted { through, cut } = of_plan(&plan, outcomes, &stations);
    if through.is_empty() {
        return Err(refuse_with_cure("no fault of it is through".into()));
    }
    Ok(Results { folder: folder.to_path_buf(), campaign, plan, outcomes: through, stations, cut })
}

/// The campaign that a plan is of. Its scene, hand and engines are not asked for: nothing is started.
fn campaign_of(folder: &Path, plan: &Plan, given: &[PathBuf]) -> Result<Campaign, Refusal> {
    let hash = u64::from_str_radix(&plan.file_hash, 16).ok();
    let mut text = hash.and_then(|hash| text_in(folder, hash));
    for path in given {
        let refuse = |e: bounded::Unread| Refusal::input(format!("--file {}: {e}", path.display()));
        let other = bounded::text(path, MOST_BYTES).map_err(refuse)?;
        if text.is_none() && hash == Some(draw::hash(other.as_bytes())) {
            text = Some(other);
        }
    }
    let text = text.ok_or_else(|| {
        Refusal::input(format!(
            "{}: the file of its campaign {:?}, of hash {}, is not there; builds before this one kept no copy: give it with --file FILE, as \
             it was then",
            folder.display(),
            plan.campaign,
            plan.file_hash
        ))
    })?;
    file::parse(&plan.campaign, &text)
        .map_err(|reason| Refusal::input(format!("{}: campaign {}: {reason}", folder.display(), plan.campaign)))
}

/// The text of the file in a folder that has this hash, whatever its name is; what cannot be read is none.
pub(super) fn text_in(folder: &Path, hash: u64) -> Option<String> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let files = entries.filter(|path| path.extension().is_some_and(|end| end == "toml")).take(MOST_FILES);
    files.filter_map(|path| bounded::text(&path, MOST_BYTES).ok()).find(|text| draw::hash(text.as_bytes()) == hash)
}

/// The lines of a file, none of one that is not there; what is wrong with it, in words.
pub(super) fn lines<T: DeserializeOwned>(folder: &Path, name: &str) -> Result<Lines<T>, String> {
    let path = folder.join(name);
    let is_other = std::fs::metadata(&path).is_ok_and(|found| !found.is_file()); // nobody waits for a pipe
    if is_other {
        return Err(format!("{name}: it is no file"));
    }
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(format!("{name}: {error}")),
    };
    let length = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    let mut found = Vec::new();
    for (index, line) in bytes[..length].split_inclusive(|byte| *byte == b'\n').enumerate() {
        found.push(serde_json::from_slice(line).map_err(|e| format!("{name}, line {}: {e}", index + 1))?);
    }
    Ok(Lines { found, whole_bytes: (length < bytes.len()).then_some(length as u64) })
}

impl Results {
    /// As a campaign that does no more faults judges them.
    pub fn judgement(&self) -> Judgement {
        let mut judgement = judge(&self.campaign, &self.plan, &self.outcomes, &self.stations, None);
        fit::note_blind(&mut judgement, &self.campaign, &self.stations);
        judgement
    }
}
