//! Verdicts by hand, of what a fault may cost, of those that prove nothing, and of stations that end.

use super::tests::{TEXT, all_of, ended, of, setup, station, window};
use super::*;
use crate::campaign::outcome::Ending;
use crate::campaign::{html, junit, text};
use crate::fault::Fault;
use std::collections::BTreeMap;

#[test]
fn what_a_fault_may_cost_is_in_its_mean_and_not_in_its_bound() {
    let cells =
        "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:both\"]\ncount = 4\nlimit_upper95 = 1.0\nallowed_misses = 300\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for number in 0..4 {
        window(&mut outcomes, "kill haptic:both", number).missed = 92;
    }
    let figures = |outcomes: &[Outcome]| judge(&campaign, &plan, outcomes, &[station(&campaign)], None);
    let judgement = figures(&outcomes);
    let both = &judgement.cells[0];
    assert_eq!((both.mean_excess_misses, both.excess.unwrap().worse, both.allowed_misses), (Some(92.0), 0, 300));
    assert_eq!((both.excess_misses.clone(), both.beyond_misses.clone()), (vec![92; 4], vec![0; 4]));
    let said = text::text(&judgement);
    let row: Vec<&str> = said.lines().find(|line| line.starts_with("kill haptic:both")).unwrap().split_whitespace().collect();
    assert!(row.windows(2).any(|pair| pair == ["92.000<92.00", "300"]), "{said}");
    window(&mut outcomes, "kill haptic:both", 0).missed = 321;
    let judgement = figures(&outcomes);
    assert_eq!((judgement.cells[0].verdict, judgement.exit_code), (Verdict::Broken, 1), "a limit that can fail");
}

#[test]
fn a_miss_of_the_window_or_of_the_control_alone_is_no_notice() {
    let cells = "[[cell]]\nkinds = [\"no-files\"]\ntargets = [\"recorder\"]\ncount = 2\nfor = 0.5\nlimit_upper95 = 1.0\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for outcome in &mut outcomes {
        outcome.fault.as_mut().unwrap().detected_by = String::new();
    }
    outcomes[0].fault.as_mut().unwrap().control.as_mut().unwrap().missed = 3;
    outcomes[1].fault.as_mut().unwrap().window.as_mut().unwrap().missed = 3;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let figures = &judgement.cells[0];
    assert_eq!((figures.unnoticed.clone(), figures.excess, figures.manifested), (vec![0, 1], None, 0));
    assert_eq!(figures.excess_unnoticed.map(|excess| (excess.worse, excess.better)), Some((1, 1)));
}

#[test]
fn a_fault_that_came_to_one_alone_of_two_has_no_verdict_is_named_and_breaks_nothing() {
    let cells = "most_void = 1.0\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:both\"]\ncount = 4\nlimit_upper95 = 1.0\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    (outcomes[1].ending, outcomes[1].reason) = (Ending::Refused, "tissue:0 was hit alone".into());
    outcomes[1].fault.as_mut().unwrap().recovered_us = None;
    let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
    let both = &judgement.cells[0];
    assert_eq!((both.injected, both.without_verdict, both.not_shown.clone()), (3, 1, vec![1]));
    assert_eq!((both.verdict, judgement.exit_code), (Verdict::Held, 0), "{both:?}");
}

#[test]
fn a_second_fault_whose_first_did_not_show_has_no_verdict_and_is_named() {
    let cells =
        "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\nstates = [\"recovery\"]\ncount = 3\nlimit_upper95 = 1.0\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for (number, outcome) in outcomes.iter_mut().enumerate() {
        let own = outcome.fault.as_ref().unwrap();
        let first = Fault { injected_ns: own.injected_ns - 5, manifested: number != 1, ..own.clone() };
        outcome.with = Some(first);
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let figures = &judgement.cells[0];
    assert_eq!((figures.excess.unwrap().faults, figures.without_verdict, figures.first_not_shown.clone()), (2, 1, vec![1]));
    let line = "the first fault did not show, and the second has no verdict: fault 1";
    assert!(text::text(&judgement).contains(line) && html::html(&judgement, &outcomes, &[]).contains(line));
}

/// Each of them took a minute, and nothing said for what.
#[test]
fn faults_that_waited_in_vain_or_were_skipped_have_no_verdict_and_are_told() {
    let cell = |target: &str, more: &str| format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"{target}\"]\ncount = 4\n{more}");
    let cells =
        "most_void = 1.0\nlimit_upper95 = 1.0\n".to_string() + &cell("fluid", "") + &cell("console", "states = [\"contact\"]\n");
    let (campaign, plan, mut outcomes) = setup(&cells);
    for number in 0..4 {
        let absent = of(&mut outcomes, "kill console in contact", number);
        (absent.fault, absent.ending) = (None, if number < 2 { Ending::NoState } else { Ending::Skipped });
    }
    let (skipped, suffered): (Vec<&Outcome>, Vec<&Outcome>) = outcomes.iter().partition(|it| it.ending == Ending::Skipped);
    let [skipped, faults] = [skipped, suffered].map(|these| these.iter().map(|it| it.index).collect::<Vec<usize>>());
    let station = StationOutcome { faults, skipped, ..station(&campaign) };
    let judged = |station: &StationOutcome| judge(&campaign, &plan, &outcomes, std::slice::from_ref(station), None);
    let judgement = judged(&station);
    let [fluid, console] = [0, 1].map(|index| &judgement.cells[index]);
    assert_eq!((fluid.verdict, console.verdict, judgement.exit_code), (Verdict::Held, Verdict::Unknown, 3));
    assert_eq!((console.injected, console.without_verdict, console.not_shown.len()), (0, 4, 4));
    assert_eq!((console.seen["no state"], console.seen["skipped"]), (2, 2));
    let said = text::text(&judgement);
    assert!(said.contains("no state 2, skipped 2") && said.contains("take a hand that brings it about"), "{said}");
    // One that ended before it had suffered anything is no broken promise, whatever was skipped.
    let trouble = "the station was not whole".to_string();
    let unhurt = judged(&StationOutcome { faults: vec![], trouble, ..station });
    assert_eq!((unhurt.exit_code, unhurt.broken.len()), (3, 0), "{:?}", unhurt.broken);
}

/// Of 36 kills of the servo that was alone 20 had no verdict, for the other's successor was warm: each of them cost the hand ticks, for that was in its shadow.
#[test]
fn a_servo_is_handed_over_until_its_successor_is_out_of_its_shadow_and_who_comes_later_is_named() {
    let judged = |role: &str, thread: &str, is_dead: bool, late_ns: u64| {
        let cell = format!("kinds = [\"kill\"]\ntargets = [\"{role}:active\"]\nstates = [\"handover\"]\ncount = 3\n");
        let first = format!("with = 'block {role}:active thread=\"{thread}\"'\nlimit_upper95 = 1.0\n");
        let (campaign, plan, mut outcomes) = setup(&format!("[[cell]]\n{cell}{first}"));
        for outcome in &mut outcomes {
            let own = outcome.fault.as_ref().unwrap();
            let injected_ns = own.injected_ns - 150_000_000 - late_ns; // it recovers after 150 ms
            let first = Fault { target: format!("{role}:0"), dead: is_dead, injected_ns, ..own.clone() };
            outcome.with = Some(first);
        }
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        let line = "the recovery, hand-over or swap was over, and it has no verdict: fault 0, 1, 2";
        let is_named = text::text(&judgement).contains(line);
        assert_eq!(html::html(&judgement, &outcomes, &[]).contains(line), is_named);
        let figures = &judgement.cells[0];
        assert_eq!((figures.without_verdict, figures.beside.len()), if is_named { (3, 3) } else { (0, 0) }, "{role} {late_ns}");
        is_named
    };
    let ends_ns = 20_000_000;
    assert_eq!([0, ends_ns, ends_ns + 1].map(|late_ns| judged("haptic", "drain", true, late_ns)), [false, false, true]);
    assert_eq!([0, 1].map(|late_ns| judged("haptic", "drain", false, late_ns)), [false, true], "without a successor");
    assert_eq!([0, 1].map(|late_ns| judged("fluid", "keeper", true, late_ns)), [false, true]);
}

/// 168 kills and stops counted as if they had met a cut, of which none had come since the first strokes.
#[test]
fn a_fault_in_a_stroke_in_which_nothing_was_cut_has_not_shown() {
    let cells =
        "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\nstates = [\"cutting\"]\ncount = 3\nlimit_upper95 = 1.0\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for (number, outcome) in outcomes.iter_mut().enumerate() {
        outcome.after.cuts = outcome.before.cuts + u32::from(number != 1);
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let figures = &judgement.cells[0];
    assert_eq!((figures.excess.unwrap().faults, figures.manifested, figures.not_shown.clone()), (2, 2, vec![1]));
    assert!(text::text(&judgement).contains("no cut 1"));
}

#[test]
fn a_cell_of_which_nobody_noticed_anything_says_so_everywhere() {
    let cells = "[[pool]]\nname = \"all\"\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"console\"]\ncount = 2\nwhere = \"page\"\npool = \"all\"\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for outcome in &mut outcomes {
        outcome.fault.as_mut().unwrap().detected_by = String::new();
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let reason = "nobody noticed any of its 2 faults: it proves nothing";
    assert_eq!((judgement.cells[0].verdict, judgement.cells[0].reasons.clone()), (Verdict::Figures, vec![reason.to_string()]));
    let junit = junit::junit(&judgement);
    let case = junit.lines().find(|line| line.contains("name=\"corrupt console")).unwrap();
    assert!(case.contains(&format!("<skipped message=\"{reason}\"/>")), "it must not pass: {case}");
    let reports = [text::text(&judgement), html::html(&judgement, &outcomes, &[]), serde_json::to_string(&judgement).unwrap()];
    assert!(reports.iter().all(|report| report.contains(reason)), "{reports:?}");
}

/// Six of 24 were refused, and what became of the others counted as if nothing had come of any: the campaign had no verdict for it.
#[test]
fn what_nobody_noticed_is_said_to_be_so_although_some_were_refused_and_not_where_most_were() {
    let cells = "[[pool]]\nname = \"all\"\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"console\"]\ncount = 8\nwhere = \"page\"\npool = \"all\"\n";
    let judged = |spoiled: usize, spoil: fn(&mut Outcome)| {
        let (campaign, plan, mut outcomes) = setup(cells);
        for (number, outcome) in outcomes.iter_mut().enumerate() {
            outcome.fault.as_mut().unwrap().detected_by = String::new();
            if number < spoiled {
                spoil(outcome);
            }
        }
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        (judgement.cells[0].verdict, judgement.cells[0].reasons.clone())
    };
    let refused: fn(&mut Outcome) = |outcome| (outcome.fault, outcome.ending) = (None, Ending::Refused);
    let did_not_come: fn(&mut Outcome) = |outcome| outcome.fault.as_mut().unwrap().manifested = false;
    assert_eq!(judged(2, refused), (Verdict::Figures, vec!["nobody noticed any of its 6 faults: it proves nothing".to_string()]));
    assert_eq!(judged(2, did_not_come).0, Verdict::Figures);
    // Of as many nothing is known: of half of them, of most, of all.
    for spoil in [refused, did_not_come] {
        assert_eq!([4, 5, 8].map(|spoiled| judged(spoiled, spoil).0), [Verdict::Unknown; 3]);
    }
}

/// Its line says when it had beaten last: a little before it was killed, when the fault before was the newest.
#[test]
fn a_keeper_that_had_beaten_before_it_was_killed_was_ended_by_that() {
    let cells =
        "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"rendering\", \"supervisor+guardian\"]\ncount = 1\nlimit_upper95 = 1.0\n";
    let judged = |beat_before_ns: u64, told_us: f64| {
        let (campaign, plan, mut outcomes) = setup(cells);
        let (first_ns, killed_ns) = (10_000_000_000, 20_000_000_000);
        for (cell, at_ns) in [("kill rendering", first_ns), ("kill supervisor+guardian", killed_ns)] {
            of(&mut outcomes, cell, 0).fault.as_mut().unwrap().injected_ns = at_ns;
        }
        let mut line = ended("guardian", "supervisor", killed_ns - beat_before_ns);
        line.detected_us = Some(told_us);
        let mut station = all_of(&campaign, &outcomes);
        station.external.push(line);
        let judgement = judge(&campaign, &plan, &outcomes, &[station], None);
        judgement.cells.iter().map(|cell| cell.seen.get("others died").copied().unwrap_or(0)).sum::<usize>()
    };
    assert_eq!(judged(30_000_000, 50_000.0), 0, "killed 30 ms after its last beat, told 20 ms later");
    assert_eq!(judged(30_000_000, 20_000.0), 1, "told before it was killed: another end");
}

#[test]
fn a_guardian_that_dies_of_its_supervisors_death_is_seen() {
    let judged = |cell: &str, target: &str| {
        let cells =
            "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"supervisor\", \"supervisor+guardian\"]\ncount = 1\nlimit_upper95 = 1.0\n";
        let (campaign, plan, mut outcomes) = setup(cells);
        let hurt = of(&mut outcomes, cell, 0);
        let line = ended(target, "pidfd", hurt.since_ns() + 1);
        hurt.collateral.push(line);
        let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
        judgement.cells.iter().find(|figures| figures.name == cell).unwrap().collateral.len()
    };
    assert_eq!(judged("kill supervisor", "guardian"), 1);
    assert_eq!(judged("kill supervisor", "supervisor"), 0, "its own line");
    assert_eq!(["supervisor", "guardian"].map(|target| judged("kill supervisor+guardian", target)), [0, 0]);
}

#[test]
fn the_last_forces_of_a_station_that_ended_are_judged() {
    let cells = "most_void = 1.0\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid:active\"]\ncount = 2\nwhere = \"link\"\n\
                 may = [\"station-ends\"]\n";
    let judged = |last_step_max_n: Option<f64>| {
        let (campaign, plan, mut outcomes) = setup(cells);
        (outcomes[1].fault, outcomes[1].ending) = (None, Ending::Open);
        let trouble = "the station ended by itself".to_string();
        let ended = StationOutcome { trouble, last_step_max_n, exit_code: None, ..all_of(&campaign, &outcomes) };
        let judgement = judge(&campaign, &plan, &outcomes, &[ended], None);
        let unknown = judgement.cells[0].seen.get("ended, last forces not recorded").copied();
        (judgement.exit_code, judgement.cells[0].step_max_n[0], unknown, judgement.cells[0].reasons.join("; "))
    };
    assert_eq!(judged(Some(0.2)), (0, 0.2, None, String::new()), "the hardware's own ramp");
    let (code, _, _, why) = judged(Some(1.5));
    assert!(code == 1 && why.contains("a force step of 1.500 N before the station's end"), "{why}");
    assert_eq!(judged(None), (0, 0.0, Some(1), String::new()), "said, and no verdict");
}

#[test]
fn a_kind_that_showed_fewer_than_twenty_times_for_a_role_is_named() {
    let cells = TEXT.replace("count = 4", "count = 20");
    let (campaign, plan, mut outcomes) = setup(&cells);
    let few = |outcomes: &[Outcome]| judge(&campaign, &plan, outcomes, &[station(&campaign)], None);
    assert!(few(&outcomes).few.is_empty());
    of(&mut outcomes, "kill device", 3).fault.as_mut().unwrap().manifested = false;
    let judgement = few(&outcomes);
    let line = "arm station: kill of device: 19 of 20 showed, fewer than 20";
    assert_eq!(judgement.few, [line]);
    let reports = [text::text(&judgement), html::html(&judgement, &outcomes, &[]), junit::junit(&judgement)];
    assert!(reports.iter().all(|report| report.contains(line) && report.contains("changes no verdict")), "{reports:?}");
}

/// Of 98 beside which somebody died, so that they had somebody to open, each counted as that death alone, and as none of its own kind.
#[test]
fn a_fault_in_whose_recovery_another_comes_counts_for_its_own_kind_and_role_if_it_showed() {
    let cell = |kind: &str, count: usize, more: &str| {
        format!("[[cell]]\nkinds = [\"{kind}\"]\ntargets = [\"tissue:active\"]\ncount = {count}\n{more}\n")
    };
    let beside = |with: &str| cell("kill", 20, &format!("states = [\"recovery\"]\nwith = \"{with}\""));
    let firsts = ["no-files tissue:spare for=0.5", "shm-full console for=1.0", "slow fluid:active extra=0.1 for=0.5"];
    let text = cell("no-files", 2, "for = 0.5") + &cell("shm-full", 2, "for = 1.0") + &firsts.map(beside).concat();
    let (campaign, plan, mut outcomes) = setup(&text);
    let mut number = BTreeMap::<String, usize>::new();
    for outcome in &mut outcomes {
        let own = outcome.fault.as_mut().unwrap();
        let Some((_, with)) = outcome.cell.split_once(" from ") else {
            own.detected_by = String::new();
            continue;
        };
        let (kind, number) = (with.split(' ').next().unwrap_or_default(), number.entry(with.into()).or_default());
        let by = if kind == "no-files" { ["tissue:1", "heartbeat", ""][(*number).saturating_sub(16).min(2)] } else { "" };
        own.dead = true;
        let first = Fault { kind: kind.into(), injected_ns: own.injected_ns - 5_000_000, dead: false, ..own.clone() };
        outcome.with = Some(Fault { detected_by: by.into(), ..first });
        // Where there was no room nobody was back before there was some again, but for one.
        own.recovered_us = own.recovered_us.filter(|_| *number > 0).or(Some(40_000.0));
        *number += 1;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let lines = ["no-files of tissue: 17 of 22", "shm-full of all: 19 of 22"];
    assert_eq!(judgement.few, lines.map(|line| format!("arm station: {line} showed, fewer than 20")));
    let shown: Vec<usize> = judgement.cells.iter().map(|figures| figures.first_manifested).collect();
    assert_eq!(shown, [0, 0, 17, 19, 20], "one that is slow shows by itself, and is there for the other alone");
}

/// Of 49 pages whose bytes flipped 45 were read by nobody, and the links of the same processes hid it.
#[test]
fn bytes_that_nobody_reads_in_one_place_are_not_hidden_by_those_of_another() {
    let cell =
        |place: &str| format!("[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid:active\"]\ncount = 20\nwhere = \"{place}\"\n");
    let (campaign, plan, mut outcomes) = setup(&(cell("page") + &cell("link")));
    for outcome in outcomes.iter_mut().filter(|outcome| outcome.cell.contains("page")) {
        outcome.fault.as_mut().unwrap().detected_by = String::new();
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!(judgement.few, ["arm station: corrupt of fluid, page: 0 of 20 showed, fewer than 20"]);
}

/// Twelve NaNs in the jobs of a tissue stood behind those by all of its outputs, of which there were enough.
#[test]
fn lies_by_one_output_and_threads_that_help_are_counted_apart_from_those_of_the_whole_process() {
    let cell = |kind: &str, count: usize, option: &str| {
        format!("[[cell]]\nkinds = [\"{kind}\"]\ntargets = [\"tissue:active\"]\ncount = {count}\n{option}\n")
    };
    let all = [("nan", 24, ""), ("nan", 12, "output = \"job\""), ("block", 24, ""), ("block", 19, "thread = \"clerk\"")];
    let text: String = all.into_iter().map(|(kind, count, option)| cell(kind, count, option)).collect();
    let (campaign, plan, outcomes) = setup(&text);
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let lines = ["block of tissue, thread clerk: 19 of 19", "nan of tissue, output job: 12 of 12"];
    assert_eq!(judgement.few, lines.map(|line| format!("arm station: {line} showed, fewer than 20")));
}

#[test]
fn a_batch_that_is_void_as_a_whole_says_nothing_whatever_came_before_it() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let judged = |outcomes: &[Outcome]| judge(&campaign, &plan, outcomes, &[station(&campaign)], None);
    let code = |outcomes: &[Outcome], before: usize| judged(outcomes).after_batch(&judged(&outcomes[before..])).exit_code;
    for outcome in &mut outcomes[5..10] {
        outcome.fault.as_mut().unwrap().window.as_mut().unwrap().voided = 100;
    }
    assert_eq!(
        [code(&outcomes[..10], 5), code(&outcomes[..10], 4), code(&outcomes[..10], 10)],
        [3, 0, 0],
        "one alone has one; none was run"
    );
    assert_eq!(code(&outcomes, 104 - 5), judged(&outcomes).exit_code, "the plan is through");
    let silent = judged(&outcomes[..10]).after_batch(&judged(&outcomes[5..10]));
    assert!(text::text(&silent).contains("none of the 5 faults of this batch has a verdict"), "{}", text::text(&silent));
    outcomes[0].fault.as_mut().unwrap().recovered_us = None;
    assert_eq!(code(&outcomes[..10], 5), 1, "what is broken stays so");
}

/// Where nobody sees the host stand still its stalls broke promises beyond doubt: the hand had lost ticks, and the force had stepped as without a device.
#[test]
fn what_the_host_does_as_well_is_unknown_of_a_station_without_canaries_and_what_it_does_not_do_is_broken() {
    type Harm = fn(&mut [Outcome]);
    let of_one = |blind: bool, harm: Harm| {
        let (campaign, plan, mut outcomes) = setup(TEXT);
        harm(&mut outcomes);
        let station = StationOutcome { blind, ..all_of(&campaign, &outcomes) };
        let judgement = judge(&campaign, &plan, &outcomes, &[station], None);
        let figures = &judgement.cells[0];
        let is_said = figures.reasons.iter().any(|reason| reason.starts_with("fault ") && reason.contains("no canary ran"));
        (figures.verdict, judgement.exit_code, is_said)
    };
    let gap: Harm = |outcomes| window(outcomes, "kill haptic:active", 0).missed = 21;
    let step: Harm = |outcomes| window(outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
    for harm in [gap, step] {
        assert_eq!(of_one(false, harm), (Verdict::Broken, 1, false));
        assert_eq!(of_one(true, harm), (Verdict::Unknown, 3, true));
    }
    let kick: Harm = |outcomes| window(outcomes, "kill haptic:active", 0).force_step_max_n = 0.3;
    let gone: Harm = |outcomes| of(outcomes, "kill haptic:active", 0).fault.as_mut().unwrap().recovered_us = None;
    let many: Harm = |outcomes| (0..30).for_each(|number| window(outcomes, "kill haptic:active", number).missed = 1);
    for harm in [kick, gone, many] {
        assert_eq!(of_one(true, harm), (Verdict::Broken, 1, false));
    }
    let nothing: Harm = |_| ();
    assert_eq!(of_one(true, nothing), (Verdict::Held, 0, false), "that nothing of it is proof is said beside");
}
