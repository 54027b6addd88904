//! What a folder of results has of one fault: as it was drawn, as it came, its window beside its control, and what it comes to by itself, in the words of the
//! reports. Nothing is started, and nothing in the folder is changed.

use super::draw::{self, Plan};
use super::file::Campaign;
use super::judge::{Figures, of_one};
use super::outcome::Outcome;
use super::results::{self, Results};
use super::{repeat, say, text};
use crate::cli::CampaignArgs;
use crate::ledger::Window;
use crate::settings::Refusal;
use serde_json::json;
use std::path::Path;

/// Shows a fault; gives the exit code.
///
/// # Errors
/// The folder cannot be read, has the results of another plan, or none of this fault.
pub(super) fn run(index: usize, folder: &Path, campaign: &Campaign, args: &CampaignArgs) -> Result<u8, Refusal> {
    let plan = draw::plan(campaign, args.seed.unwrap_or(campaign.seed));
    let shown = find(index, folder, &plan, &args.file)?;
    if args.json {
        let Shown { outcome, figures, why, .. } = &shown;
        let json = json!({ "planned": plan.faults.get(index), "outcome": outcome, "figures": figures, "verdict": why });
        say(false, &format!("{json:#}\n"));
    } else {
        say(false, &shown.text(&plan));
    }
    Ok(0)
}

/// A fault that is through.
struct Shown {
    outcome: Outcome,
    /// Those of this fault alone.
    figures: Figures,
    verdict: &'static str,
    why: Vec<String>,
}

/// Reads what there is of it, and judges it among the others.
fn find(index: usize, folder: &Path, plan: &Plan, file: &Path) -> Result<Shown, Refusal> {
    let refuse = |what: String| Refusal::input(format!("--show {index}: {what}"));
    if index >= plan.faults.len() {
        return Err(refuse(format!("the plan has faults 0 to {}", plan.faults.len() - 1)));
    }
    let Results { campaign, plan: done, outcomes, stations, cut, .. } = results::read(folder, &[file.to_path_buf()])?;
    if done != *plan {
        return Err(refuse(format!("{} holds the results of another campaign, or of another seed", folder.display())));
    }
    let own = outcomes.iter().find(|outcome| outcome.index == index);
    let judged = own.and_then(|own| Some((own, of_one(&campaign, plan, &outcomes, &stations, own)?)));
    let Some((outcome, figures)) = judged else {
        let is_cut = cut.iter().any(|outcome| outcome.index == index);
        let why = if is_cut { "its station was cut off" } else { "nothing has come of it so far" };
        return Err(refuse(format!("it is not through: {why}")));
    };
    let (code, why) = repeat::conclude(Some(&figures), &[], &[], None);
    let verdict = match code {
        _ if !figures.judged => "not judged",
        0 => "held",
        1 => "BROKEN",
        _ => "UNKNOWN",
    };
    Ok(Shown { outcome: outcome.clone(), figures, verdict, why })
}

impl Shown {
    /// Its line of the plan, under the heading of that; the line that was printed as it was through; and what else is known.
    fn text(&self, plan: &Plan) -> String {
        let Shown { outcome, figures, verdict, why } = self;
        let is_its = |at: usize| at == 1 || at == outcome.index + 2;
        let planned = plan.text();
        let mut lines: Vec<String> =
            planned.lines().enumerate().filter(|(at, _)| is_its(*at)).map(|(_, line)| line.to_string()).collect();
        lines.push(text::line(outcome, plan.faults.len()));
        let fault = outcome.fault.as_ref();
        lines.push(of_window("window", fault.and_then(|fault| fault.window)));
        lines.push(of_window("control", fault.and_then(|fault| fault.control)));
        let besides = text::besides(figures);
        if !besides.is_empty() {
            lines.push(format!("what else came of it: {}", besides.join(", ")));
        }
        lines.extend(figures.collateral.iter().map(|line| format!("beside {line}")));
        let lists: [fn(&Figures) -> Option<String>; 5] =
            [text::aftermath, text::not_shown, text::first_not_shown, text::came_beside, text::unnoticed];
        lines.extend(lists.iter().filter_map(|said| said(figures)));
        if let Some(run) = outcome.run {
            lines.push(format!("its station: run-{run}.log, run-{run}.json, the line of run {run} in stations.jsonl"));
        }
        lines.push(format!("verdict: {verdict}; {}", why.join("; ")));
        lines.push(String::new());
        lines.join("\n")
    }
}

fn of_window(name: &str, window: Option<Window>) -> String {
    let Some(window) = window else { return format!("{name}: none") };
    let Window { from_tick, to_tick, ticks, voided, missed, wrong, force_step_max_n: step_n, .. } = window;
    let (last_tick, wrong) = (to_tick.saturating_sub(1), if wrong > 0 { format!(", {wrong} wrong") } else { String::new() });
    let counts = format!("{ticks} count, {voided} void, {missed} missed{wrong}");
    format!("{name}: ticks {from_tick} to {last_tick}: {counts}; largest force step {step_n:.3} N")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::file;
    use crate::campaign::outcome::Ending;
    use crate::campaign::station::StationOutcome;
    use crate::fault::Fault;
    use std::path::PathBuf;

    const TEXT: &str = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 3\n";

    /// The results of three faults, of which the first is through and lost so many ticks, and the second was in a station that was cut off.
    fn made(name: &str, missed: u64) -> (PathBuf, Plan) {
        let folder = std::env::temp_dir().join(format!("hystation-show-{name}-{}", std::process::id()));
        let campaign = file::parse("t", TEXT).unwrap();
        let plan = draw::plan(&campaign, 1);
        let control = Window { from_tick: 9_000, to_tick: 9_200, ticks: 200, ..Window::default() };
        let window = Window { missed, ..control };
        let fault = Fault {
            manifested: true,
            active: true,
            target: "haptic:1".into(),
            detected_by: "latch".into(),
            detected_us: Some(700.0),
            recovered_us: Some(150_000.0),
            window: Some(window),
            control: Some(control),
            ..Fault::default()
        };
        let through = Outcome { run: Some(4), ending: Ending::Closed, fault: Some(fault), ..Outcome::of(&plan.faults[0]) };
        let cut = Outcome { run: Some(5), index: 1, ..through.clone() };
        let arm = campaign.arms[0].name.clone();
        let (faults, exit_code) = (vec![0], Some(0));
        let station = StationOutcome { run: 4, arm, faults, reported: true, exit_code, ..StationOutcome::default() };
        let lines = [&through, &cut].map(|outcome| serde_json::to_string(outcome).unwrap() + "\n");
        // Not by a store, whose lock a child of another test may keep for some ms.
        std::fs::create_dir_all(&folder).unwrap();
        for (file, text) in [
            ("t.toml", TEXT.to_string()),
            ("plan.json", serde_json::to_string(&plan).unwrap()),
            ("results.jsonl", lines.concat()),
            ("stations.jsonl", serde_json::to_string(&station).unwrap() + "\n"),
        ] {
            std::fs::write(folder.join(file), text).unwrap();
        }
        (folder, plan)
    }

    #[test]
    fn a_fault_is_shown_as_it_was_drawn_as_it_came_and_what_it_comes_to_by_itself() {
        for (name, missed, verdict) in [
            ("held", 0, "verdict: held; its promise held"),
            ("noise", 1, "verdict: held; 1 tick without a fresh force beyond its control's"),
            ("broken", 21, "verdict: BROKEN; fault 0: the hand lost 21 ticks, 0 at most without a fault"),
        ] {
            let (folder, plan) = made(name, missed);
            let shown = find(0, &folder, &plan, &folder.join("t.toml")).unwrap_or_else(|refusal| panic!("{}", refusal.message));
            let said = shown.text(&plan);
            let drawn = plan.text().lines().nth(2).unwrap().to_string();
            for words in [
                drawn.as_str(),
                &text::line(&shown.outcome, 3),
                &format!("window: ticks 9000 to 9199: 200 count, 0 void, {missed} missed; largest force step 0.000 N"),
                "control: ticks 9000 to 9199: 200 count, 0 void, 0 missed",
                "run-4.log",
                verdict,
            ] {
                assert!(said.contains(words), "{words:?} is missing in\n{said}");
            }
            assert_eq!(said.lines().filter(|line| line.contains("kill haptic:active")).count(), 2, "of this fault alone: {said}");
            std::fs::remove_dir_all(&folder).unwrap();
        }
    }

    #[test]
    fn of_what_is_not_through_or_of_another_plan_nothing_is_shown() {
        let (folder, plan) = made("nothing", 0);
        let other = draw::plan(&file::parse("t", TEXT).unwrap(), 2);
        let nowhere = folder.join("nowhere");
        for (index, folder, plan, words) in [
            (1, &folder, &plan, "its station was cut off"),
            (2, &folder, &plan, "nothing has come of it so far"),
            (3, &folder, &plan, "the plan has faults 0 to 2"),
            (0, &folder, &other, "of another seed"),
            (0, &nowhere, &plan, "give the folder of a campaign's results"),
        ] {
            let Err(refused) = find(index, folder, plan, &folder.join("t.toml")) else { panic!("{index}: {words}") };
            assert!(refused.code == 2 && refused.message.contains(words), "{}", refused.message);
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
