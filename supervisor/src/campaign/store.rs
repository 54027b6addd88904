//! The folder of a campaign's results. A line of `results.jsonl` is written when its fault is closed, so that a campaign that is interrupted,
//! or run in batches, goes on where it ended; faults of a station that was cut off come again ([`super::begun`]). One campaign at a time has the folder. Results
//! of another file, seed or plan are refused, never mixed; a plan of which nothing came gives way.

use super::begun::{Begun, Parted, of_plan, told_of_cut};
use super::draw::Plan;
use super::file::Campaign;
use super::origin::Origin;
use super::outcome::Outcome;
use super::results::{self, PLAN, RESULTS, STATIONS};
use super::station::StationOutcome;
use crate::settings::Refusal;
use hyst_exchange::whole;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ffi::OsStr;
use std::fs::{DirEntry, File, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// An open folder.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// Open, and locked, as long as this campaign has it.
    _lock: File,
    /// Made for this run alone, and removed at its end unless it is kept.
    passing: bool,
    /// Stations that were begun.
    begun: Vec<Begun>,
    /// Number of the next run.
    next_run: usize,
    /// Of stations that were cut off: their faults come again.
    cut: Vec<Outcome>,
    /// One for each fault that is through.
    pub outcomes: Vec<Outcome>,
    /// One for each run of a station.
    pub stations: Vec<StationOutcome>,
}

/// Exit code of a run that is not through.
const UNKNOWN: u8 = 3;
/// The file that says what runs a station, before its first fault.
const BEGUN: &str = "begun.jsonl";
/// Passing folders of one process id that are tried: each was kept by a campaign before this one.
const MOST_PASSING: usize = 1_000;

/// Makes a folder that nobody else has.
fn passing() -> Result<PathBuf, Refusal> {
    let named = |number: usize| std::env::temp_dir().join(format!("hystation-campaign-{}-{number}", std::process::id()));
    for path in (0..MOST_PASSING).map(named) {
        match std::fs::create_dir(&path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(Refusal::failed(format!("{}: {error}; give --report FOLDER", path.display()))),
        }
    }
    Err(Refusal::failed(format!("{} holds too many campaigns; remove some, or give --report FOLDER", named(0).display())))
}

fn refuse(path: &Path, what: &str) -> Refusal {
    Refusal::input(format!("--report {}: {what}", path.display()))
}

/// What could not be written: no promise is broken by that, and the run ends before it is through.
fn lost(path: &Path, why: &dyn std::fmt::Display) -> Refusal {
    Refusal { code: UNKNOWN, message: format!("{}: {why}; is the disk full?", path.display()) }
}

impl Store {
    /// Opens or makes the folder; without one, a passing one.
    pub fn open(folder: Option<&Path>, plan: &Plan) -> Result<Store, Refusal> {
        let path = match folder {
            Some(path) => std::path::absolute(path).map_err(|e| refuse(path, &e.to_string()))?,
            None => passing()?,
        };
        std::fs::create_dir_all(&path).map_err(|e| refuse(&path, &format!("{e}; give a folder that can be made")))?;
        let lock = File::open(&path).map_err(|e| refuse(&path, &e.to_string()))?;
        // Where a file system knows no locks, whoever calls has to take care.
        if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err(refuse(&path, "another campaign is at work in it; wait for its end, or give another folder"));
        }
        let text = serde_json::to_string_pretty(plan).map_err(|e| refuse(&path, &e.to_string()))?;
        let plan_file = path.join(PLAN);
        let is_there = |name: &str| std::fs::metadata(path.join(name)).is_ok_and(|file| file.len() > 0);
        let has_results = [RESULTS, STATIONS].into_iter().any(is_there);
        match std::fs::read_to_string(&plan_file) {
            Ok(known) if known == text => {}
            Ok(_) if has_results => {
                return Err(refuse(&path, "it holds the results of another campaign, or of another seed; give another folder"));
            }
            Err(_) if has_results => {
                return Err(refuse(&path, "it holds results without their plan.json; give another folder"));
            }
            // Nothing has come of the plan that lies there.
            _ => whole::write(&plan_file, text.as_bytes()).map_err(|e| refuse(&path, &e.to_string()))?,
        }
        let outcomes: Vec<Outcome> = lines(&path, RESULTS)?;
        let stations: Vec<StationOutcome> = lines(&path, STATIONS)?;
        let begun: Vec<Begun> = lines(&path, BEGUN)?;
        let runs = stations.iter().map(|station| station.run).chain(begun.iter().map(|begun| begun.run));
        let next_run = runs.chain(outcomes.iter().filter_map(|outcome| outcome.run)).max().map_or(0, |run| run.saturating_add(1));
        let Parted { through, cut } = of_plan(plan, outcomes, &stations);
        let (outcomes, passing) = (through, folder.is_none());
        Ok(Store { folder: path, _lock: lock, passing, begun, next_run, cut, outcomes, stations })
    }

    /// Has a passing folder outlive this run, if a station has left anything in it; says where it is.
    pub fn keep(&mut self) -> Option<&Path> {
        let is_of_plan = |name: &OsStr| name == PLAN || Path::new(name).extension().is_some_and(|end| end == "toml");
        let is_more = |entry: DirEntry| !is_of_plan(&entry.file_name());
        let has_more = std::fs::read_dir(&self.folder).is_ok_and(|entries| entries.flatten().any(is_more));
        let is_kept = self.passing && has_more;
        self.passing &= !has_more;
        is_kept.then_some(self.folder.as_path())
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The files of a run, without their endings.
    pub fn files(&self, run: usize) -> PathBuf {
        self.folder.join(format!("run-{run}"))
    }

    /// Keeps the campaign's file beside its results, without which nobody else can judge them ([`results::read`]). What has its name and another text stays.
    pub fn keep_file(&self, campaign: &Campaign) -> Result<(), Refusal> {
        if results::text_in(&self.folder, campaign.hash).is_some() {
            return Ok(());
        }
        let own = format!("{}.toml", campaign.name);
        let is_taken = self.folder.join(&own).exists();
        let name = if is_taken { format!("{}-{:016x}.toml", campaign.name, campaign.hash) } else { own };
        self.write(&name, &campaign.text)
    }

    /// What is to be said of faults whose station was cut off; `None` if there are none.
    pub fn told_of_cut(&self) -> Option<String> {
        told_of_cut(&self.cut)
    }

    /// Whether a fault is through.
    pub fn has(&self, index: usize) -> bool {
        self.outcomes.iter().any(|outcome| outcome.index == index)
    }

    /// Refuses to go on with another build than that of the results so far; what is through can be judged by any.
    pub fn check_build(&self, origin: &Origin) -> Result<(), Refusal> {
        let is_of_cut = |begun: &&Begun| self.cut.iter().any(|outcome| outcome.run == Some(begun.run));
        let of_cut = self.begun.iter().filter(is_of_cut).map(|begun| Some(&begun.origin));
        let mut all = self.stations.iter().map(|station| station.origin.as_ref()).chain(of_cut);
        let is_other = |known: &Option<&Origin>| !known.is_some_and(|known| known.is_same_build(origin));
        let Some(other) = all.find(is_other) else { return Ok(()) };
        let whose = other.map_or("a build that nobody noted".into(), |it| format!("build {} of {}", it.build, it.date));
        let what =
            format!("its results are of {whose}, this is build {}; go on with that one, or give another folder", origin.build);
        Err(refuse(&self.folder, &what))
    }

    /// Notes what runs a station that begins, and gives the number of its run. Recordings of those that were cut off go: they are not judged.
    pub fn begin(&mut self, station: usize, origin: &Origin) -> Result<usize, Refusal> {
        let has_ended = |run: usize| self.stations.iter().any(|station| station.run == run);
        for cut in self.begun.iter().filter(|begun| !has_ended(begun.run)) {
            let _ = std::fs::remove_file(self.files(cut.run).with_extension("mcap")); // there may be none
        }
        let begun = Begun { run: self.next_run, station, origin: origin.clone() };
        self.append(BEGUN, &begun)?;
        self.next_run = self.next_run.saturating_add(1);
        let run = begun.run;
        self.begun.push(begun);
        Ok(run)
    }

    /// Adds a fault.
    pub fn add(&mut self, outcome: Outcome) -> Result<(), Refusal> {
        self.append(RESULTS, &outcome)?;
        self.outcomes.push(outcome);
        Ok(())
    }

    /// Adds a run of a station.
    pub fn add_station(&mut self, station: StationOutcome) -> Result<(), Refusal> {
        self.append(STATIONS, &station)?;
        self.stations.push(station);
        Ok(())
    }

    fn append(&self, name: &str, line: &impl Serialize) -> Result<(), Refusal> {
        let path = self.folder.join(name);
        let text = serde_json::to_string(line).map_err(|e| lost(&path, &e))?;
        let file = std::fs::OpenOptions::new().append(true).create(true).open(&path);
        let written = file.and_then(|mut file| file.write_all(format!("{text}\n").as_bytes()).and_then(|()| file.sync_data()));
        written.map_err(|e| lost(&path, &e))
    }

    /// Writes a file of the report.
    pub fn write(&self, name: &str, text: &str) -> Result<(), Refusal> {
        let path = self.folder.join(name);
        whole::write(&path, text.as_bytes()).map_err(|e| lost(&path, &e))
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        if self.passing {
            let _ = std::fs::remove_dir_all(&self.folder); // in the system's folder for what passes
        }
    }
}

/// The lines of a file; half a line at the end, of a campaign that was killed while it wrote, is cut off. One that is there and cannot be read is no empty one:
/// its faults would be injected once more, and their lines mixed with those that nobody saw.
fn lines<T: DeserializeOwned>(folder: &Path, name: &str) -> Result<Vec<T>, Refusal> {
    let cure = "give another folder, or remove this one";
    let lines = results::lines(folder, name).map_err(|what| refuse(folder, &format!("{what}; {cure}")))?;
    if let Some(whole_bytes) = lines.whole_bytes {
        // In its place: hours of lines before it are not written once more, which a machine that loses power then might forget.
        let path = folder.join(name);
        let file = std::fs::OpenOptions::new().write(true).open(&path);
        let is_cut = file.and_then(|file| file.set_len(whole_bytes).and_then(|()| file.sync_data()));
        is_cut.map_err(|e| refuse(&path, &e.to_string()))?;
    }
    Ok(lines.found)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::campaign::{draw, file};
    use hyst_exchange::system;

    /// What is said of a folder that somebody has.
    const TAKEN: &str = "another campaign is at work";

    /// A folder that was closed before. A child that another thread began at that moment has its lock, too, until it executes its program.
    pub(crate) fn reopened(folder: &Path, plan: &Plan) -> Result<Store, Refusal> {
        let deadline_ns = system::now_ns() + 60_000_000_000;
        loop {
            match Store::open(Some(folder), plan) {
                Err(refused) if refused.message.contains(TAKEN) && system::now_ns() < deadline_ns => std::thread::yield_now(),
                opened => return opened,
            }
        }
    }

    /// A verdict named the logs of stations in a folder that was gone by then.
    #[test]
    fn a_passing_folder_goes_with_its_campaign_unless_it_is_kept_and_no_two_have_the_same() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 3\n";
        let campaign = file::parse("t", text).unwrap();
        let plan = draw::plan(&campaign, 1);
        let mut idle = Store::open(None, &plan).unwrap();
        let mut other = Store::open(None, &plan).unwrap();
        idle.keep_file(&campaign).unwrap();
        assert_ne!(idle.folder(), other.folder());
        std::fs::write(other.folder().join("run-0.log"), "what a station said").unwrap();
        let folders = [&idle, &other].map(|store| store.folder().to_path_buf());
        assert_eq!(
            (idle.keep(), other.keep()),
            (None, Some(folders[1].as_path())),
            "one in which no station has run is of no use"
        );
        drop((idle, other));
        assert_eq!(folders.each_ref().map(|folder| folder.is_dir()), [false, true]);
        std::fs::remove_dir_all(&folders[1]).unwrap();
        let mut named = reopened(&folders[0], &plan).unwrap();
        assert_eq!(named.keep(), None, "nobody has to be told where it is");
        drop(named);
        std::fs::remove_dir_all(&folders[0]).unwrap();
    }

    /// Whoever compares two folders has nothing else than what lies in them.
    #[test]
    fn a_folder_keeps_the_file_of_its_campaign_and_takes_no_other_for_it_nor_its_place() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 3\n";
        let campaign = file::parse("t", text).unwrap();
        let folder = std::env::temp_dir().join(format!("hystation-kept-{}", std::process::id()));
        let store = Store::open(Some(&folder), &draw::plan(&campaign, 1)).unwrap();
        let names = || {
            let mut names: Vec<String> =
                std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        };
        store.keep_file(&campaign).unwrap();
        store.keep_file(&campaign).unwrap();
        assert_eq!(names(), ["plan.json", "t.toml"]);
        assert_eq!(results::text_in(&folder, campaign.hash).as_deref(), Some(text));
        std::fs::write(folder.join("t.toml"), "seed = 9").unwrap();
        assert_eq!(results::text_in(&folder, campaign.hash), None);
        store.keep_file(&campaign).unwrap();
        let other = format!("t-{:016x}.toml", campaign.hash);
        assert_eq!(names(), ["plan.json", other.as_str(), "t.toml"]);
        assert_eq!(std::fs::read_to_string(folder.join("t.toml")).unwrap(), "seed = 9", "it is somebody's");
        assert_eq!(results::text_in(&folder, campaign.hash).as_deref(), Some(text));
        drop(store);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn results_outlive_a_kill_in_the_middle_of_a_line_and_are_not_mixed() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 3\n";
        let plan = draw::plan(&file::parse("t", text).unwrap(), 1);
        let folder = std::env::temp_dir().join(format!("hystation-store-{}", std::process::id()));
        let other = draw::plan(&file::parse("t", text).unwrap(), 2);
        Store::open(Some(&folder), &other).unwrap(); // nothing comes of it
        let mut store = reopened(&folder, &plan).unwrap();
        let build = |build: &str| Origin { build: build.into(), ..Origin::default() };
        let (own, another) = (build("f00"), build("bad"));
        assert!(store.check_build(&own).is_ok(), "nothing was run yet");
        store.add(Outcome::of(&plan.faults[1])).unwrap();
        store.add(Outcome::of(&plan.faults[0])).unwrap();
        let (origin, faults) = (Some(own.clone()), vec![1, 0]);
        store.add_station(StationOutcome { origin, faults, ..StationOutcome::default() }).unwrap();
        let results = folder.join("results.jsonl");
        let whole = std::fs::read_to_string(&results).unwrap();
        std::fs::write(&results, format!("{whole}{{\"index\":2,\"stat")).unwrap();
        let refused = Store::open(Some(&folder), &plan).unwrap_err();
        assert!(refused.code == 2 && refused.message.contains(TAKEN), "{}", refused.message);
        drop(store);
        let mut again = reopened(&folder, &plan).unwrap();
        assert_eq!((again.outcomes.len(), again.has(0), again.has(1), again.has(2)), (2, true, true, false));
        assert_eq!(std::fs::read_to_string(&results).unwrap(), whole);
        assert!(again.check_build(&own).is_ok());
        let refused = again.check_build(&another).unwrap_err();
        assert!(refused.code == 2 && refused.message.contains("its results are of build f00"), "{}", refused.message);
        again.add_station(StationOutcome::default()).unwrap();
        assert_eq!(again.check_build(&own).unwrap_err().code, 2, "of whom nobody knows");
        drop(again);
        assert_eq!(reopened(&folder, &other).unwrap_err().code, 2);
        std::fs::write(&results, whole.repeat(2)).unwrap();
        let mut both = reopened(&folder, &plan).unwrap();
        assert_eq!(both.outcomes.len(), 2, "two campaigns wrote them");
        std::fs::remove_file(&results).unwrap();
        std::fs::create_dir(&results).unwrap(); // it takes no line
        let unwritten = both.add(Outcome::of(&plan.faults[2])).unwrap_err();
        assert!(
            unwritten.code == 3 && unwritten.message.contains("results.jsonl"),
            "no promise is broken: {}",
            unwritten.message
        );
        std::fs::remove_dir(&results).unwrap();
        drop(both);
        std::fs::write(&results, "{}\n").unwrap();
        assert!(reopened(&folder, &plan).unwrap_err().message.contains("line 1"));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A byte that was no text any more, or a file that could not be read, made an empty one of it: all of its faults came once more.
    #[test]
    fn results_that_cannot_be_read_are_refused_and_half_a_character_at_the_end_is_half_a_line() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 3\n";
        let plan = draw::plan(&file::parse("t", text).unwrap(), 1);
        let folder = std::env::temp_dir().join(format!("hystation-unread-{}", std::process::id()));
        let mut store = Store::open(Some(&folder), &plan).unwrap();
        let reason = String::from("an exclamation mark of another script: \u{ff01}");
        store.add(Outcome { reason, ..Outcome::of(&plan.faults[0]) }).unwrap();
        store.add_station(StationOutcome { faults: vec![0], ..StationOutcome::default() }).unwrap();
        drop(store);
        let results = folder.join("results.jsonl");
        let whole = std::fs::read(&results).unwrap();
        let cut = whole.iter().position(|byte| *byte == 0xef).unwrap() + 1; // the first of the three bytes that it takes
        std::fs::write(&results, [&whole[..], &whole[..cut]].concat()).unwrap();
        assert_eq!(reopened(&folder, &plan).unwrap().outcomes.len(), 1);
        assert_eq!(std::fs::read(&results).unwrap(), whole);
        let mut flipped = whole.clone();
        flipped[cut] = 0xff;
        std::fs::write(&results, &flipped).unwrap();
        let refused = reopened(&folder, &plan).unwrap_err();
        assert!(refused.code == 2 && refused.message.contains("results.jsonl, line 1"), "{}", refused.message);
        assert_eq!(std::fs::read(&results).unwrap(), flipped, "it is as it was");
        std::fs::remove_file(&results).unwrap();
        std::fs::create_dir(&results).unwrap(); // nobody reads that, root neither
        let refused = reopened(&folder, &plan).unwrap_err();
        assert!(refused.code == 2 && refused.message.contains("results.jsonl: "), "{}", refused.message);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
