//! One fault of a campaign again: what is said of where it came is so, and in one of some tries it comes at its moment, if the machine lets it.

use super::{assert_nothing_left, campaign, results};
use serde_json::Value;
use station_tests::Folder;
use station_tests::shown::not_shown;

/// Tries of a repetition that is to come at its moment, and of a swap that is to come to its stage. Of ten faults of campaigns seven came within
/// [`MOST_OFF_US`] of theirs (`supervisor/src/campaign/repeat.rs`).
const TRIES: usize = 3;

/// In the same tick, and so far from its phase at most, it is the same fault, us.
const MOST_OFF_US: u64 = 100;

/// And one in a swap, so far at most from the same time after the same stage, us.
const MOST_OFF_IN_SWAP_US: i64 = 20_000;

fn number(value: &Value) -> i64 {
    value.as_i64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// Repeats a fault of the campaign in this folder: the exit code, what was found, and what was printed.
fn repeat(folder: &Folder, arguments: &[&str], index: usize) -> (Option<i32>, Value, String) {
    let (out, number, path) = (folder.path("out"), index.to_string(), folder.path(&format!("out/only-{index}.json")));
    let _ = std::fs::remove_file(&path); // what the try before this one found
    let mut arguments = arguments.to_vec();
    arguments.extend(["--report", out.as_str(), "--only", number.as_str()]);
    let (code, printed, said) = campaign(&arguments);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}\n{code:?} {printed}\n{said}"));
    let found = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}\n{printed}\n{said}"));
    (code, found, printed)
}

#[test]
fn one_fault_is_repeated_at_its_tick_and_phase() {
    let folder = Folder::new("campaign-only");
    let text = "gap_ticks = [450, 500]\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 2\n";
    let file = folder.write("one.toml", text);
    let plan = |seed: &str| campaign(&[&file, "--plan", "--seed", seed]).1;
    assert_eq!(plan("9"), plan("9"));
    assert_ne!(plan("9"), plan("10"));
    let printed: Value =
        serde_json::from_str(&campaign(&[&file, "--plan", "--json", "--seed", "9"]).1).expect("nothing but JSON");
    let is_repeated = (0..TRIES).any(|_| {
        let (code, found, said) = repeat(&folder, &[&file, "--seed", "9"], 1);
        let drawn: Value = serde_json::from_str(&folder.read("out/plan.json")).expect("JSON");
        let is_json = said.contains("\"exit_code\"");
        assert!(printed == drawn && !is_json, "programs get the plan, people no JSON: {printed:#}\n{said}");
        is_where_it_was_drawn(&drawn["faults"][1], code, &found, &said)
    });
    if !is_repeated {
        not_shown(&format!("a repetition of a fault at its drawn tick and phase: {TRIES} times it came later"));
    }
    assert!(!folder.as_path().join("out/results.jsonl").exists(), "a repetition is no result of the campaign");
    assert_nothing_left();
}

/// Whether a fault came at the moment for which it was drawn; that what is said of its place is so, and that no other place counts as a repetition.
fn is_where_it_was_drawn(drawn: &Value, code: Option<i32>, found: &Value, said: &str) -> bool {
    let outcome = &found["outcome"];
    assert_eq!(outcome["planned_tick"], drawn["tick"]);
    assert_eq!(outcome["fault"]["kind"], "kill", "{said}");
    // Where it came is what the station's own record says; on a machine that was busy at that very moment it is later, never earlier.
    let place = |tick: &Value, phase: &Value| 1_000 * tick.as_u64().unwrap_or(0) + phase.as_u64().unwrap_or(0);
    let (wanted, was) =
        (place(&outcome["planned_tick"], &outcome["phase_us"]), place(&outcome["tick"], &outcome["injected_phase_us"]));
    assert!(was >= wanted, "at {was} us, wanted {wanted} us");
    assert_eq!(found["off_us"].as_u64(), Some(was - wanted), "{found:#}");
    assert_eq!(code, found["exit_code"].as_i64().map(|code| code as i32), "{found:#}");
    let is_same = outcome["tick"] == outcome["planned_tick"] && was - wanted <= MOST_OFF_US;
    assert!(code != Some(0) || is_same, "another moment is no repetition: {found:#}");
    assert_eq!(said.contains("it was not repeated: that takes a fault in the same tick"), code != Some(1) && !is_same, "{said}");
    assert!(said.contains(&format!("{} us from the wanted moment", was - wanted)), "{said}");
    assert!(
        found["station"]["reported"] == true && found["figures"]["verdict"].is_string(),
        "its station is judged too: {found:#}"
    );
    is_same
}

/// What has a result is repeated where it came and not where it was drawn; in a swap that is so long after the same stage of it. A swap may be undone
/// before it comes to that stage, which harms nobody: then it is tried again.
#[test]
fn a_fault_that_has_a_result_is_repeated_where_it_came() {
    let folder = Folder::new("campaign-again");
    let text = "gap_ticks = [450, 500]\nmost_void = 1.0\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:spare\"]\ncount = 1\n\
                [[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:spare\"]\nstates = [\"swap\"]\nswap = \"collision-worker\"\ncount = 1\n";
    let (file, out) = (folder.write("again.toml", text), folder.path("out"));
    let in_swap = |outcome: &Value| outcome["cell"] == "kill fluid:spare in a swap of collision-worker";
    let whole = |outcome: &Value| !in_swap(outcome) || !outcome["swap"]["since"].is_null();
    let first = (0..TRIES).find_map(|_| {
        let (_, printed, said) = campaign(&[&file, "--report", &out]);
        let first = results(&folder);
        assert_eq!(first.len(), 2, "{printed}\n{said}");
        let found = first.iter().all(whole);
        if !found {
            std::fs::remove_dir_all(&out).expect("the report of a campaign");
        }
        found.then_some(first)
    });
    let Some(first) = first else { return not_shown(&format!("a repetition: {TRIES} swaps did not come to their stage")) };
    let drawn: Value = serde_json::from_str(&folder.read("out/plan.json")).expect("JSON");
    for before in &first {
        let index = number(&before["index"]) as usize;
        assert_eq!(before["planned_tick"], drawn["faults"][index]["tick"]);
        assert_eq!(in_swap(before), !before["swap"].is_null(), "{before:#}");
        let (code, shown, said) = campaign(&[&file, "--report", &out, "--show", &index.to_string()]);
        assert!(code == Some(0) && shown.contains("\nverdict: "), "{code:?} {shown}{said}");
        let is_repeated = (0..TRIES).any(|_| {
            let (code, found, _) = repeat(&folder, &[&file], index);
            let is_whole = whole(&found["outcome"]);
            assert!(is_whole || code != Some(0), "nobody knows where it came: {found:#}");
            is_whole && is_where_it_came(before, code, &found)
        });
        if !is_repeated {
            let cell = &before["cell"];
            not_shown(&format!("a repetition of {cell} at the moment at which it came: none of {TRIES} came there"));
        }
    }
    assert_eq!(results(&folder).len(), 2, "a repetition is no result of the campaign");
    assert!(!folder.as_path().join("out/swapped-collision-worker").exists(), "an engine lies among the results");
    assert_nothing_left();
}

/// Whether a fault came so long after the same stage of its swap, or at the same moment of its station; that what is said of that is so, and that no
/// other moment counts as a repetition.
fn is_where_it_came(before: &Value, code: Option<i32>, found: &Value) -> bool {
    let again = &found["outcome"];
    let us = |tick: i64, outcome: &Value| 1_000 * tick + outcome["injected_phase_us"].as_i64().unwrap_or(0);
    assert_eq!(again["planned_tick"], before["planned_tick"]);
    let (from, most_us, is_bound) = match &before["swap"]["since"] {
        Value::Null => ([0, 0], MOST_OFF_US as i64, true),
        since => {
            assert_eq!(again["swap"]["since"][0], since[0], "the same stage: {found:#}");
            ([number(&since[1]), number(&again["swap"]["since"][1])], MOST_OFF_IN_SWAP_US, false)
        }
    };
    let off_us = us(number(&again["tick"]) - from[1], again) - us(number(&before["tick"]) - from[0], before);
    assert_eq!(found["off_us"].as_i64(), Some(off_us), "{found:#}");
    let is_same = off_us.abs() <= most_us && (!is_bound || again["tick"] == before["tick"]);
    assert!(code != Some(0) || is_same, "another moment is no repetition: {found:#}");
    println!("{}: {off_us} us from where it came", before["cell"]);
    is_same
}
