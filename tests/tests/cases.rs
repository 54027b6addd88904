//! Cases from their start to their report, each by scripted trainees that the case or its scene has: the ladder from access to the septum, and the complications,
//! which really happen and are handled well by one trainee and badly by another. In lock-step, so that the same comes of it every time.

use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, both, hystation, run};
use std::path::{Path, PathBuf};

const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker,recorder";

/// Two trainees at the same case, each for so long, of whom the report thinks the better of the first.
fn sessions(case: &str, trainees: [(&str, &str); 2]) -> [Value; 2] {
    sessions_of(&shipped(case), case, trainees)
}

fn sessions_of(file: &Path, case: &str, [(good, for_good), (bad, for_bad)]: [(&str, &str); 2]) -> [Value; 2] {
    let found = both(|| session_of(file, case, good, for_good), || session_of(file, case, bad, for_bad));
    let [of_good, of_bad] = found.each_ref().map(|report| report["score"].as_f64());
    assert!(of_good > of_bad, "{case}: {good} has {of_good:?}, {bad} {of_bad:?}");
    found
}

/// The file of a case that comes with the station.
fn shipped(case: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../assets/cases/{case}.toml"))
}

/// What the report says of a case that a hand does for so long.
fn session(case: &str, hand: &str, time: &str) -> Value {
    session_of(&shipped(case), case, hand, time)
}

fn session_of(file: &Path, case: &str, hand: &str, time: &str) -> Value {
    let folder = Folder::new(&format!("case-{case}-{hand}"));
    let recording = folder.path("session.mcap");
    // A name has 24 letters.
    let station = format!("k{}-{}{}", std::process::id(), &case[..2], &hand[..2]);
    let mut command = hystation();
    command.args(["--name", &station, "run"]).arg(file).args(["--headless", "--lockstep", "--hand", &format!("script:{hand}")]);
    // Nobody dies here, and who would take over costs time.
    command.args(["--roles", ROLES, "--for", time, "--record", &recording, "--set", "spares=off"]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{case} {hand}: {said}");
    let (code, report, said) = run(hystation().args(["report", &recording, "--json", "-"]));
    assert_eq!(code, Some(0), "{case} {hand}: {said}");
    let report: Value = serde_json::from_str(&report).unwrap();
    // So that who weighs a metric finds what trainees come to.
    let scored = report["metrics"].as_array().unwrap().iter().filter(|metric| metric["score"].is_number());
    let scored: Vec<String> = scored.map(|it| format!("{} {} ({})", it["key"], it["value"], it["score"])).collect();
    println!("{case} {hand}: {} of 100; {}; {:#}", report["score"], scored.join(", "), report["case"]);
    report
}

/// A metric's raw value, and its score.
fn metric(report: &Value, key: &str) -> (f64, Option<f64>) {
    let found = report["metrics"].as_array().unwrap().iter().find(|metric| metric["key"] == key);
    let found = found.unwrap_or_else(|| panic!("no {key}"));
    (found["value"].as_f64().unwrap_or_else(|| panic!("{key}: {found}")), found["score"].as_f64())
}

fn goal(report: &Value, index: usize) -> &str {
    report["case"]["goals"][index]["state"].as_str().unwrap()
}

/// The resection is nobody's goal any more who had to stop.
fn assert_nothing_else_is_asked(report: &Value) {
    let called_for = |index: usize| report["case"]["goals"][index]["called_for"].as_bool();
    assert_eq!((called_for(0), called_for(1)), (Some(true), Some(false)), "{}", report["case"]);
    assert_eq!((goal(report, 1), report["case"]["goals"][1]["called_off"].as_bool()), ("open", Some(true)));
}

fn ended_by(report: &Value) -> Option<&str> {
    report["case"]["ended"]["by"].as_str()
}

/// How often a warning fell.
fn warned(report: &Value, words: &str) -> u64 {
    let warnings = report["case"]["warnings"].as_array().unwrap();
    let found = warnings.iter().find(|warning| warning["words"] == words);
    found.unwrap_or_else(|| panic!("no warning {words:?}: {warnings:?}"))["count"].as_u64().unwrap()
}

/// Whether all goals were reached before the session was over.
fn assert_all_reached(report: &Value) {
    let goals = report["case"]["goals"].as_array().unwrap();
    assert!(goals.iter().all(|goal| goal["state"] == "reached") && ended_by(report) == Some("goals"), "{}", report["case"]);
}

#[test]
fn a_scripted_trainee_looks_into_both_horns_and_takes_the_septum_down_without_current_at_the_fundus() {
    // Beside it the rungs on which nothing is cut.
    let [septum, others] = both(
        || vec![session("septum", "divide", "38s")],
        || {
            vec![
                // On a slow machine the fluid takes longer steps, and reaches the goal later.
                session("distension", "distends", "40s"),
                session("access", "looks", "18s"),
                session("navigation", "visits", "24s"),
            ]
        },
    );
    others.iter().for_each(assert_all_reached);
    let report = &septum[0];
    assert_eq!([goal(report, 0), goal(report, 1)], ["reached", "reached"]);
    assert_eq!(ended_by(report), Some("goals"));
    assert!(metric(report, "pathology").0 >= 9.0 && metric(report, "cuts").0 >= 20.0, "{}", report["case"]);
    assert_eq!(warned(report, "current at the fundus: the septum ends here"), 0);
}

#[test]
fn a_polyp_is_taken_off_at_its_base_after_a_chip_of_it_and_a_chip_alone_is_a_biopsy() {
    let [polyp, biopsy] = both(|| session("polyp", "resects", "24s"), || session("biopsy", "polyp", "9s"));
    assert_all_reached(&polyp);
    assert!(metric(&polyp, "pathology").0 >= 80.0, "{}", polyp["case"]);
    let chip_s = polyp["case"]["goals"][1]["at_s"].as_f64();
    assert!(chip_s < polyp["case"]["goals"][2]["at_s"].as_f64(), "the chip comes first: {}", polyp["case"]);
    assert_eq!(warned(&polyp, "force above 1.65 N"), 0);
    assert_all_reached(&biopsy);
}

/// Its script has little more than it needs, and takes 103 s of a virtual clock that runs hardly faster than a real one: `HYSTATION_CASES=all` tries it.
#[test]
fn a_myoma_is_sliced_off_as_far_as_its_case_asks() {
    if !std::env::var("HYSTATION_CASES").is_ok_and(|which| which == "all") {
        return not_shown("whether the myoma's script reaches its goals, which takes minutes: HYSTATION_CASES=all has it tried");
    }
    let myoma = session("myoma", "slices", "112s");
    assert_all_reached(&myoma);
    assert!(metric(&myoma, "pathology").0 >= 45.0, "{}", myoma["case"]);
}

/// The same polyp, as large and as far from the middle as its scene has it: its chip comes off on the patient's left as it does on the right, and its trainee
/// goes where it hangs.
#[test]
fn a_polyp_that_a_seed_has_mirrored_gives_its_chip_to_the_same_trainee() {
    let folder = Folder::new("case-sides");
    let text = with_whole_paths(&std::fs::read_to_string(shipped("polyp")).unwrap());
    let case = |changes: &[(&str, &str)]| {
        changes.iter().fold(text.clone(), |text, (from, to)| {
            assert!(text.contains(from), "{from}");
            text.replace(from, to)
        })
    };
    let home = [("seed = 1\n", "seed = 4\n"), ("size = [0.85, 1.1]\nshift_m = [0.0, 0.003]\n", "")];
    let mirrored = folder.write("mirrored.toml", &case(&home));
    let never = folder.write("never.toml", &case(&[home[0], home[1], ("mirror = [\"side\"]", "")]));
    let [left, right] = both(
        || session_of(Path::new(&mirrored), "polyp", "polyp", "14s"),
        || session_of(Path::new(&never), "unmirrored", "polyp", "14s"),
    );
    for (report, is_mirrored) in [(&left, true), (&right, false)] {
        assert_eq!([goal(report, 0), goal(report, 1)], ["reached", "reached"], "mirrored: {is_mirrored}");
        assert!(metric(report, "pathology").0 > 1.0, "{}", report["case"]);
        let drawn = report["case"]["drawn"].as_array().unwrap();
        assert_eq!(drawn.iter().any(|one| one.as_str().unwrap().starts_with("mirrored")), is_mirrored, "{drawn:?}");
    }
}

#[test]
fn a_loose_piece_is_brought_out_by_who_closes_the_jaws_on_it() {
    let [good, bad] = sessions("retrieval", [("fetch", "10s"), ("misses", "10s")]);
    assert_eq!((goal(&good, 0), ended_by(&good)), ("reached", Some("goals")));
    assert_eq!((goal(&bad, 0), ended_by(&bad)), ("open", None));
    assert!(metric(&good, "brought_out").0 > 0.05 && metric(&bad, "brought_out").0 == 0.0, "{good}");
    assert!(metric(&good, "pathology").0 > 99.0 && metric(&bad, "pathology").0 == 0.0, "{} {}", good["case"], bad["case"]);
}

#[test]
fn a_perforation_is_made_and_who_stops_in_time_is_told_from_who_goes_on() {
    let [good, bad] = sessions("perforation", [("stops", "36s"), ("goes-on", "42s")]);
    for report in [&good, &bad] {
        assert!(warned(report, "the pump's alarm “perforation”") >= 1, "the wall is pierced");
        assert_nothing_else_is_asked(report);
    }
    assert_eq!((goal(&good, 0), ended_by(&good)), ("reached", Some("goals")));
    assert_eq!(goal(&bad, 0), "missed");
    assert_eq!((metric(&good, "goals").0, metric(&bad, "goals").0), (100.0, 0.0));
    assert!(metric(&bad, "deficit").0 > metric(&good, "deficit").0);
    assert!(metric(&good, "goals").1 > metric(&bad, "goals").1);
}

#[test]
fn a_bleeding_is_staunched_by_who_raises_the_pressure_and_goes_on_under_who_looks_on() {
    let [good, bad] = sessions("bleeding", [("staunches", "23s"), ("looks-on", "23s")]);
    for report in [&good, &bad] {
        assert_eq!(goal(report, 0), "reached", "a chip is cut, and it bleeds");
        assert!(metric(report, "bled").0 > 0.2);
    }
    assert_eq!((goal(&good, 1), ended_by(&good)), ("reached", Some("goals")));
    assert_eq!((goal(&bad, 1), ended_by(&bad)), ("open", None));
    assert!(metric(&bad, "bled").0 > metric(&good, "bled").0);
    assert_eq!(warned(&good, "pressure above 100 mmHg"), 0);
}

#[test]
fn medium_is_lost_into_the_vessels_and_who_shuts_the_inflow_is_told_from_who_looks_on() {
    // 40 ml in place of 100, which take a minute.
    let (folder, case) = (Folder::new("case-overload"), "fluid-overload");
    let text = with_whole_paths(&std::fs::read_to_string(shipped(case)).unwrap());
    let sooner = text.replace("100.0", "40.0").replace("50.0", "20.0").replace("50 ml", "20 ml");
    let file = PathBuf::from(folder.write("sooner.toml", &sooner));
    let [good, bad] = sessions_of(&file, case, [("watches", "36s"), ("looks-on", "54s")]);
    for report in [&good, &bad] {
        assert!(warned(report, "20 ml of glycine are missing") == 1);
        assert_nothing_else_is_asked(report);
    }
    assert_eq!((goal(&good, 0), ended_by(&good)), ("reached", Some("goals")));
    assert_eq!(goal(&bad, 0), "missed");
    assert_eq!((metric(&good, "goals").0, metric(&bad, "goals").0), (100.0, 0.0));
    assert!(metric(&bad, "deficit").0 > metric(&good, "deficit").0 + 20.0);
}

/// A shipped case's text, for a file that lies elsewhere.
fn with_whole_paths(text: &str) -> String {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    text.replace("../scenes", &scenes.display().to_string())
}

/// The navigation case, over four seconds after the hand has moved.
fn short_case(folder: &Folder) -> String {
    let text = with_whole_paths(&std::fs::read_to_string(shipped("navigation")).unwrap());
    folder.write("short.toml", &text.replace("time_s = 240.0", "time_s = 4.0"))
}

/// In real time, where the console judges. `--for` is what ends it if its session does not.
#[test]
fn a_station_that_is_to_end_with_its_session_says_how_it_ended_and_does() {
    let folder = Folder::new("case-end");
    let case = short_case(&folder);
    let (station, page) = (format!("e{}", std::process::id()), "console_port=0");
    let report = folder.path("report.json");
    let roles = "hardware,device,haptic,tissue,fluid,collision-worker,console";
    let mut command = hystation();
    command.args(["--name", &station, "run", &case, "--headless", "--hand", "script:press", "--roles", roles, "--set", page]);
    command.args(["--until-end", "--for", "120s", "--report", &report]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("the session is over after 4.0 s: the time was over; 0 of 2 goals reached"), "{said}");
    let report: Value = serde_json::from_str(&folder.read("report.json")).unwrap();
    let ticks = report["device"]["ticks"].as_u64().unwrap_or_else(|| panic!("{report}"));
    assert!((4_000..100_000).contains(&ticks), "it ran for {ticks} ticks");
}

#[test]
fn a_check_shows_a_case_of_another_seed_and_a_scene_has_none() {
    let check = |words: &[&str]| run(hystation().args(["check", "--json"]).args(words));
    let case = shipped("polyp").display().to_string();
    let (code, told, said) = check(&[&case, "--set", "seed=7"]);
    let report: Value = serde_json::from_str(&told).unwrap_or_else(|error| panic!("{error}: {told}{said}"));
    assert_eq!((code, report["case"]["seed"].as_u64(), report["origin"].as_str()), (Some(0), Some(7), Some(case.as_str())));
    let (code, _, said) = check(&["--set", "seed=7"]);
    assert!(code == Some(2) && said.contains("a case alone has a seed"), "{code:?} {said}");
}

#[test]
fn what_has_no_end_or_nobody_who_sees_it_cannot_be_run_until_then() {
    let folder = Folder::new("case-endless");
    let case = short_case(&folder);
    let ends = "time_s = 4.0\nperforation = true";
    let text = folder.read("short.toml");
    assert!(text.contains(ends), "{text}");
    let endless = folder.write("endless.toml", &text.replace(ends, "goals = false"));
    for arguments in [
        &["--until-end"][..],
        &[&case, "--until-end", "--set", "console=off"],
        &[&case, "--until-end", "--lockstep"],
        &[&endless, "--until-end", "--hand", "idle"],
    ] {
        let mut command = hystation();
        command.args(["--name", &format!("f{}", std::process::id()), "run", "--headless", "--for", "2s"]).args(arguments);
        let (code, _, said) = run(&mut command);
        assert!(code == Some(2) && said.contains("--until-end"), "{arguments:?}: {said}");
    }
}
