//! The case of a run, settled before anything starts: its anatomy is drawn from its seed, and a copy that names both lies in the station's root, from which
//! every engine and its successors draw the same. Whoever edits the case file meanwhile changes nothing.

use crate::cli::RunArgs;
use crate::commands::report;
use crate::settings::Refusal;
use hyst_assessment::judge_until;
use hyst_exchange::Station;
use hyst_scene::{Brief, Case, SettledCase, find_case, find_played_case};
use std::path::{Path, PathBuf};

/// A case as a recording has it.
#[derive(Clone, Debug)]
pub struct RecordedCase {
    /// Its text, with the seed and the whole path of its scene.
    pub text: String,
    /// The file that was named, absolute.
    pub file: Option<PathBuf>,
    /// The recording, and the tick after which it is done again, where that is not from the beginning.
    pub before: Option<(PathBuf, u64)>,
}

/// A case that can be run.
pub struct RunCase {
    /// The file that was named.
    pub file: Option<PathBuf>,
    /// What came of it.
    pub settled: SettledCase,
    /// A file of its text for as long as this lives: who is asked about its scene before there is a root reads it.
    pub beside: PathBuf,
    /// What a referee goes on from in a replay that begins later, as JSON: it has seen nothing of what was before.
    judged: Option<String>,
}

impl RunCase {
    /// The case of a run; `None` if it runs a scene.
    pub fn of(station: &Station, args: &RunArgs) -> Result<Option<RunCase>, Refusal> {
        let seed = seed(&args.station.set)?;
        let input = |error: hyst_scene::SceneError| Refusal::input(error.to_string());
        let beside = std::env::temp_dir().join(format!("hystation-{}-{}-case.toml", station.name(), std::process::id()));
        // In a replay the case was played, whoever names its file now.
        let find = if args.again.is_some() { find_played_case } else { find_case };
        let recorded = args.again.as_ref().and_then(|again| again.case.as_ref()).filter(|_| args.scene.is_none());
        let (file, settled) = match (recorded, &args.scene) {
            (Some(recorded), _) => {
                write(&beside, &recorded.text)?;
                let settled = find(&beside, seed);
                let _ = std::fs::remove_file(&beside); // written again below
                (recorded.file.clone(), settled.map_err(input)?)
            }
            (None, Some(path)) => (std::path::absolute(path).ok(), find(path, seed).map_err(input)?),
            (None, None) => (None, None),
        };
        let Some(settled) = settled else {
            return match seed {
                Some(seed) => {
                    Err(Refusal::input(format!("--set seed={seed}: a case alone has a seed; name one, or leave it out")))
                }
                None => Ok(None),
            };
        };
        let before = recorded.and_then(|recorded| recorded.before.as_ref());
        let judged = before.map(|(recording, tick)| judged_before(recording, &settled.brief, *tick)).transpose()?;
        write(&beside, &settled.text)?;
        Ok(Some(RunCase { file, settled, beside, judged }))
    }

    /// Puts the case into the root of a station that was founded.
    pub fn keep(&self, station: &Station) -> Result<(), Refusal> {
        let brief = serde_json::to_string(&self.settled.brief).map_err(|error| Refusal::failed(format!("case: {error}")))?;
        write(&station.case(), &self.settled.text)?;
        write(&station.brief(), &brief)?;
        self.judged.as_ref().map_or(Ok(()), |judged| write(&station.judged(), judged))
    }
}

impl Drop for RunCase {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.beside); // it has gone already
    }
}

/// Refuses to run until the end what has none, or has nobody who sees it.
pub fn check_end(args: &RunArgs, case: Option<&RunCase>) -> Result<(), Refusal> {
    let refused = |why: &str| Err(Refusal::input(format!("--until-end: {why}")));
    match case {
        _ if !args.until_end => Ok(()),
        None => refused("only a case has an end; name one"),
        Some(_) if args.station.set.iter().any(|pair| pair == "console=off") => {
            refused("it is the console that sees the end of a case; leave console=off out")
        }
        Some(case) if case.settled.brief.end.words().is_empty() => refused(
            "this case has no end: its goals end nothing (end.goals = false), and nothing else does; give it one, or leave --until-end out",
        ),
        Some(_) => Ok(()),
    }
}

/// A case's text with another path of its scene; `None` of a text that is no case.
pub fn with_scene(text: &str, scene: &Path) -> Option<String> {
    let mut case = Case::parse(text, "the case").ok()?;
    case.scene = scene.to_str()?.to_owned();
    toml::to_string(&case).ok()
}

/// What the referee of a recorded session had kept at a tick, as JSON. It is computed by the brief of this run, by which its referee judges, too.
fn judged_before(recording: &Path, brief: &Brief, tick: u64) -> Result<String, Refusal> {
    let reader = report::open(recording)?;
    let judge = judge_until(reader, brief, tick, report::threads()).map_err(|error| Refusal::input(error.to_string()))?;
    serde_json::to_string(&judge).map_err(|error| Refusal::failed(format!("what was judged before: {error}")))
}

fn write(path: &Path, text: &str) -> Result<(), Refusal> {
    std::fs::write(path, text)
        .map_err(|error| Refusal::of_system(error.kind(), format!("{}: {error}; look at `df`", path.display())))
}

/// The seed among settings; the last one, if there are several.
///
/// # Errors
/// It is no whole number of 32 bits.
pub fn seed(set: &[String]) -> Result<Option<u32>, Refusal> {
    let Some(given) = set.iter().rev().find_map(|pair| pair.strip_prefix("seed=")) else { return Ok(None) };
    given.parse().map(Some).map_err(|_| Refusal::input(format!("--set seed={given}: expected a whole number, 0 to {}", u32::MAX)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Again;
    use hyst_engine::settings::Replay;

    /// A resection in glycine with the current that a case has where it names none, and a place 72° off the scope's axis at rest: both were accepted once.
    const PLAYED: &str = r#"version = 1
name = "older"
rung = "polyp"
task = "Do it."
scene = "SCENE"
seed = 7
[rules]
medium = "glycine"
[[place]]
name = "beside"
centre_m = [0.0285, 0.0, 0.0093]
radius_m = 0.005
[[goal]]
removed = { percent = 50.0 }
[[goal]]
visit = { places = ["beside"] }
[end]
time_s = 60.0
"#;

    #[test]
    fn a_recorded_case_is_played_again_by_rules_that_refuse_it_of_who_names_it_anew() {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/default.toml");
        let text = PLAYED.replace("SCENE", &scene.display().to_string());
        let file = std::env::temp_dir().join(format!("hystation-played-{}.toml", std::process::id()));
        std::fs::write(&file, &text).unwrap();
        let station = Station::named(&format!("played{}", std::process::id())).unwrap();
        let again = |case: Option<RecordedCase>| Again {
            replay: Replay { begin_tick: 0, from_tick: 0, speed: 1.0 },
            scene_hash: 0,
            case,
            states: Vec::new(),
            end_tick: 1,
        };
        let named = RunArgs { scene: Some(file.clone()), ..RunArgs::default() };
        let recorded = again(Some(RecordedCase { text, file: None, before: None }));
        let found = [
            RunArgs { again: Some(recorded), ..RunArgs::default() },
            RunArgs { again: Some(again(None)), ..named.clone() },
            named,
        ]
        .map(|args| RunCase::of(&station, &args).map(|case| case.map(|case| case.settled.brief.goals.len())));
        std::fs::remove_file(&file).unwrap();
        let [recorded, named_again, anew] = found;
        assert_eq!([recorded, named_again], [Ok(Some(2)), Ok(Some(2))]);
        assert!(anew.is_err_and(|refusal| refusal.code == 2 && refusal.message.contains("place[0].centre_m")));
    }
}
