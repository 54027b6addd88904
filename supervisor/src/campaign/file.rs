//! A campaign's file: faults × targets × states with counts, limits and a seed; read and checked before anything is started, as its stations are
//! ([`super::fit`]).
//!
//! What kinds of faults there are, and what options they take, is said by [`crate::faultfile`] alone: what a cell says beyond its own keys is
//! handed to it.

use super::bounds::least_faults;
use super::cell::{self, Cell};
use crate::faultfile::MOST_FAULTS;
use crate::plan;
use crate::settings::{Refusal, check_set};
use hyst_scene::bounded;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Share of faults that may cost more than their controls and what they may, where a file says no other limit.
pub const DEFAULT_LIMIT: f64 = 0.05;
/// Share of faults that may be without a verdict, where a file says no other.
pub(super) const MOST_VOID: f64 = 0.2;
/// Longest pause between two faults that may be asked for, ticks: a minute.
const MOST_GAP_TICKS: u64 = 60_000;
/// Shortest: a fault's window and a control window fit in between; what a fault may do later is waited for beyond it.
const LEAST_GAP_TICKS: u64 = 450;
/// Largest file, bytes: a campaign is some dozens of lines.
pub(super) const MOST_BYTES: u64 = 1 << 20;

/// A campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign {
    /// Its name: the file's, without ending.
    pub name: String,
    /// Seed of the plan, unless the command line gives another.
    pub seed: u64,
    /// Fewest and most ticks from one fault to the next.
    pub gap_ticks: [u64; 2],
    /// Faults after which a fresh station is started; bounds how long a replay takes.
    pub faults_per_station: usize,
    /// Largest share of faults that may be without a verdict (the host stalled, no control window) before nothing can be said.
    pub most_void: f64,
    /// The stations.
    pub station: StationPart,
    /// Ways in which the stations are run, side by side.
    pub arms: Vec<Arm>,
    /// What is injected.
    pub cells: Vec<Cell>,
    /// Cells that are judged together.
    pub pools: Vec<Pool>,
    /// Hash of the file's text: results of another file are not continued.
    pub hash: u64,
    /// That text.
    pub text: String,
}

/// How the stations are run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StationPart {
    /// Scene or mesh, relative to the campaign's file; the embedded scene if absent.
    pub scene: Option<PathBuf>,
    /// Folder of the engines' binaries, relative to the campaign's file; those beside this program if absent.
    pub binaries: Option<PathBuf>,
    /// As for `run --hand`. Default: `script:press`.
    pub hand: Option<String>,
    /// As for `run --workers`. Default: as there.
    pub workers: Option<usize>,
    /// Record each session, and count what is missing in the file. Default: yes.
    pub record: Option<bool>,
    /// As for `run --set`.
    pub set: BTreeMap<String, String>,
}

/// One way of running the stations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Its name, of which there is one.
    pub name: String,
    /// Set in addition to the station's.
    #[serde(default)]
    pub set: BTreeMap<String, String>,
    /// In place of the station's: another build of the engines beside the first.
    #[serde(default)]
    pub binaries: Option<PathBuf>,
    /// Share of each cell's count that is injected in this arm, above 0 to 1. Default: 1.
    #[serde(default = "one")]
    pub share: f64,
    /// Whether the promises are judged here; else the figures stand beside the others. Default: true.
    #[serde(default = "yes")]
    pub judged: bool,
}

/// Cells that are judged together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pool {
    /// Its name.
    pub name: String,
    /// Limit of the one-sided upper 95 % bound of the faults with excess misses, per fault.
    pub limit_upper95: f64,
    /// So many of its faults must have a verdict. Default: 0.
    #[serde(default)]
    pub least: usize,
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

/// A fault campaign: what is injected into stations of its own, how often, and what is promised.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Campaign")]
struct File {
    /// Seed of the plan: which fault comes when. Default: 0; `--seed` is taken before it.
    #[serde(default)]
    seed: u64,
    /// Fewest and most ticks from one fault to the next, 450 to 60 000. Default: [600, 1400].
    #[serde(default = "default_gap_ticks")]
    gap_ticks: [u64; 2],
    /// Faults after which a fresh station is started, 1 to 1000. Default: 100.
    #[serde(default = "default_faults_per_station")]
    faults_per_station: usize,
    /// Limit of each cell that states none and is in no pool: the share of its faults with excess misses, below which it has to lie with 95 %; -1 to 1, and
    /// one below 0 cannot be met. Default: 0.05.
    #[serde(default = "default_limit")]
    limit_upper95: f64,
    /// Largest share of faults that may be without a verdict (the host stalled, no control window), 0 to 1; above it nothing can be said. Default: 0.2.
    #[serde(default = "default_void")]
    most_void: f64,
    /// The stations.
    #[serde(default)]
    station: StationPart,
    /// Ways in which the stations are run, side by side. Default: one, called station.
    #[serde(default)]
    arm: Vec<Arm>,
    /// Cells that are judged together.
    #[serde(default)]
    pool: Vec<Pool>,
    /// What is injected: at least one.
    #[serde(default)]
    cell: Vec<cell::Group>,
}

fn default_gap_ticks() -> [u64; 2] {
    super::draw::GAP_TICKS
}

fn default_faults_per_station() -> usize {
    100
}

fn default_limit() -> f64 {
    DEFAULT_LIMIT
}

fn default_void() -> f64 {
    MOST_VOID
}

/// Reads and checks a campaign; the refusal says what cannot be, and how to write it.
pub fn read(path: &Path) -> Result<Campaign, Refusal> {
    let name = path.display().to_string();
    let refuse = |reason: String| Refusal::input(format!("campaign {name}: {reason}"));
    let text = bounded::text(path, MOST_BYTES).map_err(|e| refuse(format!("{e}; give the path of a readable text file")))?;
    let stem = path.file_stem().map_or_else(|| "campaign".into(), |stem| stem.to_string_lossy().into_owned());
    let mut campaign = parse(&stem, &text).map_err(refuse)?;
    let beside = |place: &mut PathBuf| -> Result<(), Refusal> {
        let joined = path.parent().unwrap_or(Path::new(".")).join(&*place);
        *place = std::path::absolute(&joined).map_err(|e| refuse(format!("{}: {e}", joined.display())))?;
        Ok(())
    };
    campaign.station.scene.iter_mut().try_for_each(beside)?;
    let folders = campaign.station.binaries.iter_mut().chain(campaign.arms.iter_mut().filter_map(|arm| arm.binaries.as_mut()));
    for folder in folders {
        beside(folder)?;
        let mut engines = plan::engines().map(|role| role.name());
        if let Some(absent) = engines.find(|name| !folder.join(name).is_file()) {
            return Err(refuse(format!("binaries {}: no {absent} there; a folder holds every engine", folder.display())));
        }
    }
    Ok(campaign)
}

/// The JSON schema of a campaign's file, derived from the types that read it.
pub fn schema_json() -> String {
    let schema = schemars::schema_for!(File);
    let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default(); // a schema always serializes
    text.push('\n');
    text
}

/// Reads and checks a campaign's text.
pub fn parse(name: &str, text: &str) -> Result<Campaign, String> {
    let file: File = toml::from_str(text).map_err(|e| e.to_string())?;
    check(&file)?;
    let arms = if file.arm.is_empty() { vec![default_arm()] } else { file.arm };
    cell::names("[[arm]] name", arms.iter().map(|arm| &arm.name))?;
    arms.iter().try_for_each(check_arm)?;
    let (mut cells, mut faults): (Vec<Cell>, usize) = (Vec::new(), 0);
    for (index, group) in file.cell.into_iter().enumerate() {
        let refuse = |reason: String| format!("cell {}: {reason}", index + 1);
        faults = faults.saturating_add(group.faults(&arms).map_err(refuse)?);
        if faults > MOST_FAULTS {
            return Err(refuse(format!("{faults} faults with those before it, at most {MOST_FAULTS} are allowed")));
        }
        cells.extend(group.cells(file.limit_upper95, &file.pool).map_err(refuse)?);
    }
    let campaign = Campaign {
        name: name.to_string(),
        seed: file.seed,
        gap_ticks: file.gap_ticks,
        faults_per_station: file.faults_per_station,
        most_void: file.most_void,
        station: file.station,
        arms,
        cells,
        pools: file.pool,
        hash: super::draw::hash(text.as_bytes()),
        text: text.to_string(),
    };
    for cell in &campaign.cells {
        for arm in campaign.arms.iter().filter(|arm| arm.count(cell) > 0) {
            cell.check_in(arm, &campaign).map_err(|reason| format!("cell {}: {reason}", cell.name))?;
        }
    }
    if let Some(cell) = twice(&campaign.cells) {
        return Err(format!("cell {:?} is there twice; give its counts in one", cell.name));
    }
    (faults > 0).then_some(campaign).ok_or_else(|| "it injects nothing; add a [[cell]] with kinds, targets and a count".into())
}

/// The first whose name another before it has.
fn twice(cells: &[Cell]) -> Option<&Cell> {
    let mut seen = BTreeSet::new();
    cells.iter().find(|cell| !seen.insert(&cell.name))
}

fn default_arm() -> Arm {
    Arm { name: "station".into(), set: BTreeMap::new(), binaries: None, share: 1.0, judged: true }
}

fn check(file: &File) -> Result<(), String> {
    let [least, most] = file.gap_ticks;
    if !(LEAST_GAP_TICKS <= least && least <= most && most <= MOST_GAP_TICKS) {
        return Err(format!(
            "gap_ticks = [{least}, {most}]: two numbers of ticks, ascending, between {LEAST_GAP_TICKS} (a fault's window and a control \
             window) and {MOST_GAP_TICKS}"
        ));
    }
    if !(1..=1_000).contains(&file.faults_per_station) {
        return Err(format!("faults_per_station = {}: 1 to 1000", file.faults_per_station));
    }
    if !(0.0..=1.0).contains(&file.most_void) {
        return Err(format!("most_void = {}: a share between 0 and 1", file.most_void));
    }
    cell::check_limit(file.limit_upper95)?;
    cell::names("[[pool]] name", file.pool.iter().map(|pool| &pool.name))?;
    for pool in &file.pool {
        cell::check_limit(pool.limit_upper95).map_err(|reason| format!("pool {:?}: {reason}", pool.name))?;
        if pool.name.is_empty() {
            return Err("pool \"\": each has a name of its own".into());
        }
    }
    check_sets(&file.station.set)
}

fn check_sets(set: &BTreeMap<String, String>) -> Result<(), String> {
    set.iter().try_for_each(|(key, value)| check_set(key, value).map_err(|refusal| refusal.message))
}

fn check_arm(arm: &Arm) -> Result<(), String> {
    if arm.name.is_empty() {
        return Err("arm \"\": each has a name of its own".into());
    }
    if !(arm.share > 0.0 && arm.share <= 1.0) {
        return Err(format!("arm {:?}: share = {}: above 0, at most 1", arm.name, arm.share));
    }
    check_sets(&arm.set).map_err(|reason| format!("arm {:?}: {reason}", arm.name))
}

impl Campaign {
    /// The cell of a name.
    pub fn cell(&self, name: &str) -> Option<&Cell> {
        self.cells.iter().find(|cell| cell.name == name)
    }

    /// Limits that cannot be shown, in words: of too few faults, even if none of them costs anything. One of 0 or less is meant to fail.
    pub fn cannot_show(&self) -> Vec<String> {
        let mut found = Vec::new();
        let mut least_of = BTreeMap::new(); // by the bits of a limit: most cells have the same, and it is not found at once
        for arm in self.arms.iter().filter(|arm| arm.judged) {
            let mut look = |name: &str, limit: Option<f64>, faults: usize| {
                let least = limit.and_then(|limit| *least_of.entry(limit.to_bits()).or_insert_with(|| least_faults(limit)));
                let least = least.filter(|least| (1..*least).contains(&faults));
                if let Some((limit, least)) = limit.zip(least) {
                    found.push(format!(
                        "arm {}, {name}: {faults} faults cannot show a limit of {limit}, {least} can; give it a larger count or limit, or a pool",
                        arm.name
                    ));
                }
            };
            for cell in &self.cells {
                look(&cell.name, cell.limit_upper95, arm.count(cell));
            }
            for pool in &self.pools {
                let own = self.cells.iter().filter(|cell| cell.pool.as_deref() == Some(&pool.name));
                look(&format!("pool {}", pool.name), Some(pool.limit_upper95), own.map(|cell| arm.count(cell)).sum());
            }
        }
        found.extend(self.cannot_be_judged());
        found
    }
    /// Pools of which no fault can tell, or too few for what they ask, and a campaign in which no promise is judged, in words.
    fn cannot_be_judged(&self) -> Vec<String> {
        let mut found = Vec::new();
        let judged: Vec<&Arm> = self.arms.iter().filter(|arm| arm.judged).collect();
        if judged.is_empty() {
            found.push("no arm is judged: there are figures, and no promise that could be broken".into());
        }
        for Pool { name, least, .. } in &self.pools {
            let own: Vec<&Cell> = self.cells.iter().filter(|cell| cell.pool.as_ref() == Some(name)).collect();
            if own.is_empty() {
                found.push(format!("pool {name}: no cell is in it; write pool = {name:?} in a [[cell]]"));
            }
            for arm in &judged {
                let faults: usize = own.iter().map(|cell| arm.count(cell)).sum();
                if (1..*least).contains(&faults) {
                    found.push(format!(
                        "arm {}, pool {name}: {faults} faults, and at least {least} are to have a verdict; give it a larger count",
                        arm.name
                    ));
                }
            }
        }
        found.extend(self.cells.iter().filter(|cell| cell.is_of_idle_spare()).map(|cell| {
            format!(
                "cell {}: a spare makes only the steps that its holder misses, and until there is one nothing comes of it",
                cell.name
            )
        }));
        found
    }
    /// Faults in all arms; of more than can be counted the largest number.
    pub fn faults(&self) -> usize {
        let counts = self.arms.iter().flat_map(|arm| self.cells.iter().map(|cell| arm.count(cell)));
        counts.fold(0, usize::saturating_add)
    }
    /// Whether the promises are judged in the arm of this name.
    pub fn judges(&self, arm: &str) -> bool {
        self.arms.iter().any(|known| known.name == arm && known.judged)
    }
    /// The hand of its stations.
    pub fn hand(&self) -> &str {
        self.station.hand.as_deref().unwrap_or("script:press")
    }
    /// Whether its stations record.
    pub fn records(&self) -> bool {
        self.station.record.unwrap_or(true)
    }
    /// Folder of the engines of an arm; none is that of this program.
    pub fn binaries<'a>(&'a self, arm: &'a Arm) -> Option<&'a Path> {
        arm.binaries.as_deref().or(self.station.binaries.as_deref())
    }
    /// What is set in an arm.
    pub fn set(&self, arm: &Arm) -> BTreeMap<String, String> {
        let mut set = self.station.set.clone();
        set.extend(arm.set.clone());
        set
    }
}

impl Arm {
    /// Faults of a cell in this arm: at least one, if it is in this arm.
    pub fn count(&self, cell: &Cell) -> usize {
        self.count_among(&cell.arms, cell.count)
    }
    /// The same of one of so many that is in these arms; in all if none is named.
    pub(super) fn count_among(&self, arms: &[String], count: usize) -> usize {
        let is_in = arms.is_empty() || arms.contains(&self.name);
        if is_in { (count as f64 * self.share).ceil() as usize } else { 0 }
    }
}

#[cfg(test)]
#[path = "file_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "recovery_tests.rs"]
mod recovery_tests;

#[cfg(test)]
#[path = "states_tests.rs"]
mod states_tests;
