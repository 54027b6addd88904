//! Verdicts by hand, of what is seen beside the misses: lies, what nobody noticed, swaps, steps of the force, stalls.

use super::notice::notice;
use super::tests::{TEXT, all_of, ended, of, setup, station, window};
use super::*;
use crate::campaign::bounds::Excess;
use crate::campaign::outcome::{Ending, SwapSeen};
use crate::campaign::text::text;
use crate::corrupt::Remains;
use crate::fault::Fault;

fn fault<'a>(outcomes: &'a mut [Outcome], cell: &str, number: usize) -> &'a mut Fault {
    of(outcomes, cell, number).fault.as_mut().unwrap()
}

#[test]
fn a_servo_that_lied_and_was_followed_breaks_the_promise() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    window(&mut outcomes, "kill haptic:active", 3).wrong = 2;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!((judgement.cells[0].verdict, judgement.cells[0].wrong, judgement.exit_code), (Verdict::Broken, 2, 1));
    assert!(judgement.cells[0].reasons[0].contains("the hand was given 2 forces"), "{:?}", judgement.cells[0].reasons);
}

#[test]
fn a_lie_that_nobody_found_is_broken_and_one_that_was_the_truth_did_not_show() {
    let cells = "[[cell]]\nkinds = [\"nan\", \"frozen\"]\ntargets = [\"device\", \"tissue:active\"]\ncount = 2\nfor = 2.0\nlimit_upper95 = 1.0\n";
    let judged = |cell: &str, touching: u32, by: &str, manifested: bool| {
        let (campaign, plan, mut outcomes) = setup(cells);
        of(&mut outcomes, cell, 0).touching = touching;
        let fault = fault(&mut outcomes, cell, 0);
        (fault.detected_by, fault.manifested) = (by.into(), manifested);
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        let figures = judgement.cells.iter().find(|figures| figures.name == cell).unwrap().clone();
        (figures.verdict == Verdict::Broken, figures.unfound.len(), figures.not_shown.len())
    };
    assert_eq!(judged("nan device for=2.0", 0, "", true), (true, 1, 0), "a NaN is never the truth");
    assert_eq!(judged("nan device for=2.0", 0, "hardware", true), (false, 0, 0));
    assert_eq!(judged("nan device for=2.0", 0, "", false), (false, 0, 1), "it said nothing");
    assert_eq!(judged("frozen device for=2.0", 3, "", true), (false, 0, 1), "no force, and none was due");
    assert_eq!(judged("frozen device for=2.0", 300, "", true), (true, 1, 0), "no force, and the tool touched");
    assert_eq!(judged("frozen tissue:active for=2.0", 0, "", true), (true, 1, 0), "its state is never the same");
}

#[test]
fn what_is_only_done_from_outside_is_in_no_bound_unless_it_was_noticed() {
    let cells = "[[pool]]\nname = \"all\"\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid:active\"]\ncount = 6\nwhere = \"link\"\n\
                 pool = \"all\"\nmay = [\"others-die\"]\n[[cell]]\nkinds = [\"no-files\"]\ntargets = [\"recorder\"]\ncount = 2\nfor = 0.5\npool = \"all\"\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    let corrupt = "corrupt fluid:active where=\"link\"";
    for outcome in &mut outcomes {
        let fault = outcome.fault.as_mut().unwrap();
        (fault.detected_by, fault.detected_us, fault.target) = (String::new(), None, "fluid:0".into());
    }
    fault(&mut outcomes, corrupt, 0).detected_by = "tissue:1".into();
    (fault(&mut outcomes, corrupt, 1).dead, fault(&mut outcomes, corrupt, 1).detected_by) = (true, "latch".into());
    let third = of(&mut outcomes, corrupt, 2);
    third.collateral.push(ended("rendering", "latch", third.since_ns() + 5));
    fault(&mut outcomes, corrupt, 3).remains = Some(Remains { written_over: 9, still_there: 7, gone: 0 });
    fault(&mut outcomes, corrupt, 4).remains = Some(Remains { written_over: 16, still_there: 0, gone: 0 });
    window(&mut outcomes, corrupt, 5).missed = 3;
    let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
    let figures = &judgement.cells[0];
    let noticed: Vec<(&str, usize)> = figures.noticed.iter().map(|(what, count)| (what.as_str(), *count)).collect();
    let expected = [
        "died, found by latch",
        "nobody, and the hand lost ticks",
        "others died",
        "still there, unread",
        "tissue:1",
        "written over by its owner",
    ];
    assert_eq!(noticed, expected.map(|what| (what, 1)));
    assert_eq!((figures.injected, figures.manifested, figures.unnoticed.len(), figures.without_verdict), (6, 3, 3, 0));
    assert_eq!((figures.died["fluid"], figures.died["rendering"], figures.seen["others died"]), (1, 1, 1));
    let of = |excess: Option<Excess>| excess.map(|excess| (excess.faults, excess.worse, excess.better));
    assert_eq!(of(figures.excess), Some((3, 0, 0)), "those that nobody noticed dilute nothing");
    assert_eq!(of(figures.excess_unnoticed), Some((3, 1, 0)), "what they cost the hand is judged apart");
    let quiet = &judgement.cells[1];
    assert_eq!((quiet.manifested, quiet.excess, quiet.verdict, quiet.noticed["nothing"]), (0, None, Verdict::Figures, 2));
    assert_eq!((judgement.pools[0].excess.unwrap().faults, judgement.pools[0].unnoticed.len()), (3, 5));
    let said = text(&judgement);
    let of_segment = said.lines().find(|line| line.starts_with("link ")).unwrap();
    assert!(of_segment.contains("still there, unread 1") && of_segment.contains("fluid 1, rendering 1"), "{said}");
    assert!(said.contains("done and not noticed: fault"), "{said}");
    let page = crate::campaign::html::html(&judgement, &outcomes, &[]);
    assert!(
        page.contains("<td>link</td><td>fluid:active</td>") && page.contains("rendering died (exit code 1, found by latch)"),
        "{page}"
    );
}

/// 72 of them, of which nobody knew, were the bound of what a full /dev/shm costs.
#[test]
fn a_full_shared_memory_in_which_nobody_wanted_room_is_in_no_bound() {
    let cells = "[[cell]]\nkinds = [\"shm-full\"]\ntargets = [\"recorder\"]\ncount = 3\nfor = 1.0\nlimit_upper95 = 1.0\nmay = [\"others-die\"]\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    for outcome in &mut outcomes {
        let fault = outcome.fault.as_mut().unwrap();
        (fault.detected_by, fault.detected_us) = (String::new(), None);
    }
    fault(&mut outcomes, "shm-full recorder for=1.0", 0).detected_by = "fluid:1".into();
    let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
    let figures = &judgement.cells[0];
    assert_eq!((figures.manifested, figures.unnoticed.len(), figures.excess.unwrap().faults), (1, 2, 1));
    assert_eq!((figures.noticed["fluid:1"], figures.noticed["nothing"], figures.segment.as_str()), (1, 2, "/dev/shm"));
}

/// A single tick in a window is the host's as often as the fault's; the same in every one of them is not.
#[test]
fn faults_that_nobody_noticed_and_that_all_cost_the_hand_a_tick_break_the_promise() {
    let cells = "[[cell]]\nkinds = [\"no-files\"]\ntargets = [\"recorder\"]\ncount = 40\nfor = 0.5\nlimit_upper95 = 0.05\n";
    let judged = |worse: usize| {
        let (campaign, plan, mut outcomes) = setup(cells);
        for (index, outcome) in outcomes.iter_mut().enumerate() {
            let fault = outcome.fault.as_mut().unwrap();
            (fault.detected_by, fault.detected_us) = (String::new(), None);
            fault.window.as_mut().unwrap().missed = u64::from(index < worse);
            fault.control.as_mut().unwrap().missed = 0;
        }
        let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
        (judgement.cells[0].verdict == Verdict::Broken, judgement.cells[0].reasons.join("; "))
    };
    let (is_broken, why) = judged(12);
    assert!(is_broken && why.contains("of 40 that nobody noticed: 0.3000"), "{why}");
    assert!(!judged(2).0, "{}", judged(2).1);
}

#[test]
fn a_state_that_began_anew_and_a_station_that_ended_are_noticed() {
    let (campaign, _, mut outcomes) = setup(TEXT);
    outcomes[0].after.founded_tick = 9;
    let blame = Blame::of(&campaign, &outcomes, &[]);
    let silent = Fault::default();
    assert_eq!(notice(&silent, blame.sequel(&outcomes[0]), false), (true, "a state began anew".into()));
    assert_eq!(notice(&silent, blame.sequel(&outcomes[1]), true), (true, "the station ended".into()));
    assert_eq!(notice(&silent, blame.sequel(&outcomes[1]), false), (false, "nothing".into()));
}

#[test]
fn what_is_left_of_a_run_is_the_doing_of_its_own_faults_and_not_of_the_same_ones_in_another() {
    let (campaign, _, mut outcomes) = setup(TEXT);
    let left_by = |outcomes: &[Outcome]| {
        let of_run = |run: usize, leftovers: u64| StationOutcome { run, leftovers, ..all_of(&campaign, outcomes) };
        let stations = [of_run(1, 0), of_run(2, 7)];
        let blame = Blame::of(&campaign, outcomes, &stations);
        blame.leftovers(outcomes.last().unwrap().index)
    };
    assert_eq!(left_by(&outcomes), 7, "older results do not say of which run they are");
    for outcome in &mut outcomes {
        outcome.run = Some(1);
    }
    assert_eq!(left_by(&outcomes), 0);
}

/// Kept results of older builds have it: a stall of the host was the notice of bytes that nobody had read.
#[test]
fn one_that_was_late_and_lives_on_has_not_noticed_and_one_that_was_ended_for_it_has() {
    let (campaign, _, outcomes) = setup(TEXT);
    let blame = Blame::of(&campaign, &outcomes, &[]);
    let noticed = |by: &str, dead: bool| {
        let fault = Fault { detected_by: by.into(), dead, ..Fault::default() };
        notice(&fault, blame.sequel(&outcomes[0]), false)
    };
    assert_eq!(noticed("heartbeat", false), (false, "nothing".into()));
    assert_eq!(noticed("heartbeat", true), (true, "died, found by heartbeat".into()));
    assert_eq!(noticed("tissue:1", false), (true, "tissue:1".into()));
}

#[test]
fn a_fault_beside_its_swap_has_no_verdict() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for (number, ended_ms) in [(0, 5), (1, 900)] {
        let outcome = of(&mut outcomes, "kill haptic:active", number);
        let begun_ns = outcome.since_ns() - 50_000_000;
        outcome.swap = Some(SwapSeen { begun_ns, ended_ns: Some(begun_ns + ended_ms * 1_000_000), ..SwapSeen::default() });
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!(judgement.cells[0].without_verdict, 1, "the first swap ended 45 ms before its fault");
}

#[test]
fn a_kick_while_idle_is_not_excused_by_what_contact_does() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let kick = of(&mut outcomes, "kill haptic:active", 0).index;
    for outcome in outcomes.iter_mut().filter(|outcome| outcome.index != kick && outcome.index % 2 == 0) {
        outcome.before.contacts = 5;
        outcome.fault.as_mut().unwrap().control.as_mut().unwrap().force_step_max_n = 0.3;
    }
    window(&mut outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
    let mut code = |contacts| {
        of(&mut outcomes, "kill haptic:active", 0).before.contacts = contacts;
        judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).exit_code
    };
    assert_eq!((code(0), code(3)), (1, 0));
}

/// Where no control was free in the state of a fault, one in the other state stood in for it, and its steps excused kicks in the open.
#[test]
fn a_control_in_another_state_is_marked_and_excuses_its_own_state_alone() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let kick = of(&mut outcomes, "kill haptic:active", 0).index;
    for outcome in &mut outcomes {
        let (is_unlike, fault) = (outcome.index != kick && outcome.index % 2 == 0, outcome.fault.as_mut().unwrap());
        fault.window.as_mut().unwrap().contact = Some(false);
        let control = fault.control.as_mut().unwrap();
        (control.contact, control.force_step_max_n) = (Some(is_unlike), if is_unlike { 0.3 } else { 0.01 });
        fault.control_unlike = is_unlike;
        outcome.before.contacts = 5; // when the fault was asked for; where its window begins the tool had gone
    }
    let unlike = outcomes.iter().filter(|outcome| outcome.fault.as_ref().unwrap().control_unlike).count();
    window(&mut outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let marked: usize = judgement.cells.iter().filter_map(|cell| cell.seen.get("control in another state")).sum();
    assert_eq!((judgement.exit_code, marked), (1, unlike), "{judgement:?}");
    assert!(
        judgement.cells[0].reasons[0].contains("a force step of 0.200 N, 0.010 N without a fault"),
        "{:?}",
        judgement.cells[0]
    );
    window(&mut outcomes, "kill haptic:active", 0).contact = Some(true);
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).exit_code, 0, "at the wall it is no kick");
}

/// A window that began in the open and met tissue later was held against controls that met none, and what the electrode does there was a kick.
#[test]
fn a_step_is_held_against_those_in_its_own_state_whatever_its_window_began_in() {
    let judged = |open_n: f64, contact_n: f64, are_old: bool| {
        let (campaign, plan, mut outcomes) = setup(TEXT);
        for outcome in &mut outcomes {
            let (meets_tissue, fault) = (outcome.index % 2 == 0, outcome.fault.as_mut().unwrap());
            fault.window.as_mut().unwrap().contact = Some(false);
            let control = fault.control.as_mut().unwrap();
            control.contact = Some(meets_tissue);
            control.force_step_max_n = if meets_tissue { 0.1 } else { 0.01 };
            if !are_old {
                (control.open_step_max_n, control.contact_step_max_n) = (Some(0.01), meets_tissue.then_some(0.1));
            }
        }
        let hit = window(&mut outcomes, "kill haptic:active", 0);
        hit.force_step_max_n = open_n.max(contact_n);
        if !are_old {
            (hit.open_step_max_n, hit.contact_step_max_n) = (Some(open_n), Some(contact_n));
        }
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        (judgement.exit_code, judgement.cells[0].reasons.join("; "))
    };
    let broken = |(code, why): (u8, String), what: &str| {
        assert!(code == 1 && why.contains(&format!("a force step of {what}")), "{what}: {code} {why}");
    };
    assert_eq!(judged(0.01, 0.14, false), (0, String::new()));
    broken(judged(0.14, 0.01, false), "0.140 N, 0.010 N without a fault in the open");
    broken(judged(0.01, 0.16, false), "0.160 N, 0.100 N without a fault in contact");
    broken(judged(0.01, 0.14, true), "0.140 N, 0.010 N without a fault in the open");
}

#[test]
fn a_kind_that_stalls_the_kernel_is_not_held_by_leaving_out_what_it_stalls() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    // Six of a hundred, and none the other way: beyond chance, and not yet beyond the limit of 0.04 for sure.
    for number in 0..6 {
        window(&mut outcomes, "kill haptic:active", number).late = 3;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let figures = &judgement.cells[0];
    assert!(figures.excess.unwrap().upper95 <= 0.04 && figures.excess_with_void.unwrap().lower95 > 0.0, "{figures:?}");
    assert_eq!((figures.verdict, judgement.exit_code), (Verdict::Unknown, 3));
    // One or two a side are noise of the host.
    for number in 1..6 {
        window(&mut outcomes, "kill haptic:active", number).late = 0;
    }
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).cells[0].verdict, Verdict::Held);
}

#[test]
fn a_fault_without_a_control_is_looked_at_all_the_same() {
    let judged = |harm: fn(&mut Fault)| {
        let (campaign, plan, mut outcomes) = setup(TEXT);
        let fault = fault(&mut outcomes, "kill haptic:active", 0);
        fault.control = None;
        harm(fault);
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        (judgement.cells[0].verdict, judgement.cells[0].without_verdict, judgement.cells[0].reasons.join("; "))
    };
    assert_eq!(judged(|_| {}), (Verdict::Held, 1, String::new()));
    let (verdict, _, why) = judged(|fault| fault.window.as_mut().unwrap().wrong = 2);
    assert!(verdict == Verdict::Broken && why.contains("the hand was given 2 forces"), "{why}");
    let (verdict, _, why) = judged(|fault| fault.window.as_mut().unwrap().missed = 21);
    assert!(verdict == Verdict::Broken && why.contains("the hand lost 21 ticks"), "{why}");
}

#[test]
fn a_window_that_the_ledger_no_longer_held_is_no_verdict() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    window(&mut outcomes, "kill haptic:active", 0).to_tick = 300;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!((judgement.cells[0].without_verdict, judgement.cells[0].excess.unwrap().faults), (1, 99), "200 of 300 ticks");
}

#[test]
fn a_fault_that_ended_its_station_was_injected_and_what_left_no_report_is_not_known() {
    let cells = "most_void = 1.0\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"corrupt\"]\ntargets = [\"fluid:active\"]\ncount = 2\nwhere = \"page\"\n\
                 may = [\"station-ends\"]\n";
    let (campaign, plan, mut outcomes) = setup(cells);
    (outcomes[1].fault, outcomes[1].ending) = (None, Ending::Open);
    let trouble = "the station ended by itself".to_string();
    let ended = StationOutcome { trouble, exit_code: None, ..all_of(&campaign, &outcomes) };
    let judged = |station: &StationOutcome| judge(&campaign, &plan, &outcomes, std::slice::from_ref(station), None);
    let judgement = judged(&ended);
    let figures = &judgement.cells[0];
    assert_eq!((figures.injected, figures.noticed["the station ended"], judgement.exit_code), (2, 1, 0), "{judgement:?}");
    let silent = judged(&StationOutcome { reported: false, ..ended.clone() });
    assert!(silent.exit_code == 3 && silent.unknown[0].contains("left no report"), "{silent:?}");
    // What it did to its file is excused, and what it did to the hand is not.
    assert_eq!(judged(&StationOutcome { damage: vec!["cut".into()], missing_ticks: 3, ..ended.clone() }).exit_code, 0);
    assert_eq!(judged(&StationOutcome { leftovers: 1, ..ended }).exit_code, 1);
}

#[test]
fn a_newcomer_that_was_hurt_on_trial_must_not_get_the_role_and_how_swaps_end_is_counted() {
    let cells = "most_void = 1.0\nlimit_upper95 = 1.0\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:newcomer\", \"fluid:active\"]\n\
                 states = [\"swap\"]\nswap = \"fluid\"\ncount = 3\n";
    let [newcomer, active] = ["newcomer", "active"].map(|which| format!("kill fluid:{which} in a swap of fluid"));
    let judged = |cell: &str, stage: &str, promoted: bool| {
        let (campaign, plan, mut outcomes) = setup(cells);
        for outcome in &mut outcomes {
            let since_ns = outcome.since_ns();
            outcome.swap = Some(SwapSeen {
                begun_ns: since_ns - 9,
                ended_ns: Some(since_ns + 9),
                stage: "ready".into(),
                promoted: Some(false),
                ..SwapSeen::default()
            });
        }
        let swap = of(&mut outcomes, cell, 0).swap.as_mut().unwrap();
        (swap.stage, swap.promoted) = (stage.into(), Some(promoted));
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
        let figures = judgement.cells.iter().find(|figures| figures.name == cell).unwrap().clone();
        (figures.reasons.join("; "), figures.seen.get("swap done").copied(), figures.seen["swap undone"])
    };
    let (why, ..) = judged(&newcomer, "agrees with the old engine", true);
    assert!(why.contains("was hurt on trial, and the swap was done all the same"), "{why}");
    let over = "its probation is over: the role is its own";
    assert_eq!(judged(&newcomer, over, true), (String::new(), Some(1), 2), "it had the role for good");
    assert_eq!(judged(&newcomer, "ready", false), (String::new(), None, 3));
    assert_eq!(judged(&active, "ready", true), (String::new(), Some(1), 2), "the old engine was hurt");
}

#[test]
fn reasons_that_are_left_out_are_numbered() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..11 {
        fault(&mut outcomes, "kill haptic:active", number).recovered_us = None;
    }
    let reasons = &judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).cells[0].reasons;
    assert_eq!(
        (reasons.len(), reasons[8].as_str()),
        (9, "… and 5 more"),
        "three of the faults and two of the bound: {reasons:?}"
    );
}

/// That a recording had lost ticks was said of a cell, and of none of its faults: what to do next had no number for --only.
#[test]
fn what_the_recording_lost_is_said_of_the_fault_that_it_was_lost_to() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let lost = vec![(outcomes[1].tick + 10, outcomes[1].tick + 14)];
    let station = StationOutcome { faults: vec![0, 1], lost, ..station(&campaign) };
    let judgement = judge(&campaign, &plan, &outcomes, &[station], None);
    let cell = judgement.cells.iter().find(|figures| figures.name == outcomes[1].cell).unwrap();
    assert_eq!((cell.verdict, cell.data_lost_ticks), (Verdict::Broken, 5));
    assert_eq!(cell.reasons[0], "fault 1: the recording lost 5 ticks");
    assert!(text(&judgement).contains("`--only 1` does that fault again"), "{}", text(&judgement));
}
