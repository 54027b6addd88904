//! Verdicts by hand.

use super::*;
use crate::campaign::outcome::Ending;
use crate::campaign::text::text;
use crate::campaign::{draw, file};
use crate::fault::Fault;
use crate::ledger::Window;

const TEXT: &str = "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.5\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 100\n\
                    limit_upper95 = 0.04\npool = \"all\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"device\"]\ncount = 4\nlimit_upper95 = 0.7\n";

fn setup(text: &str) -> (Campaign, Plan, Vec<Outcome>) {
    let campaign = file::parse("t", text).unwrap();
    let plan = draw::plan(&campaign, 1);
    let outcomes = plan.faults.iter().map(|entry| {
        let window = Some(Window { ticks: 200, ..Window::default() });
        let fault = Fault {
            manifested: true,
            detected_by: "pidfd".into(),
            detected_us: Some(2_000.0),
            recovered_us: Some(150_000.0),
            promise_held: Some(true),
            active: true,
            window,
            control: window,
            ..Fault::default()
        };
        let mut outcome = Outcome { ending: Ending::Closed, fault: Some(fault), ..Outcome::of(entry) };
        (outcome.before.tissue_tick, outcome.after.tissue_tick) = (1, 2);
        outcome
    });
    let outcomes = outcomes.collect();
    (campaign, plan, outcomes)
}

fn station(campaign: &Campaign) -> StationOutcome {
    StationOutcome {
        arm: campaign.arms[0].name.clone(),
        reported: true,
        exit_code: Some(0),
        control_step_max_n: 0.01,
        ..StationOutcome::default()
    }
}

fn of<'a>(outcomes: &'a mut [Outcome], cell: &str, number: usize) -> &'a mut Outcome {
    outcomes.iter_mut().filter(|outcome| outcome.cell == cell).nth(number).unwrap()
}

fn window<'a>(outcomes: &'a mut [Outcome], cell: &str, number: usize) -> &'a mut Window {
    of(outcomes, cell, number).fault.as_mut().unwrap().window.as_mut().unwrap()
}

#[test]
fn without_a_miss_every_promise_is_held() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    let verdicts: Vec<Verdict> = judgement.cells.iter().chain(&judgement.pools).map(|figures| figures.verdict).collect();
    assert_eq!((verdicts, judgement.exit_code), (vec![Verdict::Held; 3], 0), "{judgement:?}");
    let haptic = &judgement.cells[0];
    assert_eq!((haptic.injected, haptic.manifested, haptic.detected_by["pidfd"]), (100, 100, 100));
    assert_eq!((haptic.detected_ms[99], haptic.recovered_ms[0], haptic.excess.unwrap().worse), (2.0, 150.0, 0));
}

#[test]
fn a_burst_counts_once_and_the_device_may_lose_its_twenty() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    window(&mut outcomes, "kill haptic:active", 3).missed = 40;
    for number in 0..4 {
        window(&mut outcomes, "kill device", number).missed = 20;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    assert_eq!(judgement.cells[0].excess.unwrap().worse, 1);
    assert_eq!(judgement.cells[0].verdict, Verdict::Unknown, "one of 100: up to 0.047 is possible");
    assert_eq!((judgement.cells[1].verdict, judgement.exit_code), (Verdict::Held, 3));
    window(&mut outcomes, "kill device", 0).missed = 21;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    assert_eq!(judgement.cells[1].excess.unwrap().worse, 1);
}

#[test]
fn misses_beyond_doubt_break_the_promise_and_so_does_a_limit_that_cannot_be_met() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        window(&mut outcomes, "kill haptic:active", number).missed = 1;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    assert_eq!(
        (judgement.cells[0].verdict, judgement.pools[0].verdict, judgement.exit_code),
        (Verdict::Broken, Verdict::Held, 1)
    );
    let (campaign, plan, outcomes) = setup(&TEXT.replace("0.7", "-1.0"));
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)]).cells[1].verdict, Verdict::Broken);
}

#[test]
fn what_a_fault_does_to_the_kernel_is_no_excuse() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        window(&mut outcomes, "kill haptic:active", number).late = 3;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    let haptic = &judgement.cells[0];
    assert_eq!((haptic.excess.unwrap().worse, haptic.excess_with_void.unwrap().worse), (0, 30));
    assert_eq!((haptic.verdict, judgement.pools[0].verdict), (Verdict::Broken, Verdict::Held));
    assert!(haptic.reasons.iter().any(|reason| reason.contains("with void ticks")), "{:?}", haptic.reasons);
}

#[test]
fn what_never_may_happen_breaks_a_promise_at_once() {
    type Harm = fn(&mut [Outcome]);
    let harms: [(Harm, &str); 5] = [
        (|outcomes| of(outcomes, "kill haptic:active", 0).fault.as_mut().unwrap().recovered_us = None, "did not recover"),
        (|outcomes| of(outcomes, "kill haptic:active", 0).after.tissue_tick = 0, "tissue"),
        (|outcomes| of(outcomes, "kill haptic:active", 0).after.founded_tick = 7, "began anew"),
        (
            |outcomes| {
                let fluid = Fault { target: "fluid:1".into(), dead: true, detected_by: "pidfd".into(), ..Fault::default() };
                of(outcomes, "kill haptic:active", 0).collateral.push(fluid);
            },
            "fluid:1 died too",
        ),
        (
            |outcomes| {
                window(outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
                of(outcomes, "kill haptic:active", 0).fault.as_mut().unwrap().promise_held = Some(false);
            },
            "force step",
        ),
    ];
    for (harm, word) in harms {
        let (campaign, plan, mut outcomes) = setup(TEXT);
        harm(&mut outcomes);
        let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
        assert_eq!((judgement.cells[0].verdict, judgement.exit_code), (Verdict::Broken, 1), "{word}");
        assert!(judgement.cells[0].reasons.iter().any(|reason| reason.contains(word)), "{:?}", judgement.cells[0].reasons);
    }
    let (campaign, plan, outcomes) = setup(TEXT);
    let good = station(&campaign);
    for bad in [
        StationOutcome { stale_applied: 1, ..good.clone() },
        StationOutcome { invalid_applied: 1, ..good.clone() },
        StationOutcome { leftovers: 1, ..good.clone() },
        StationOutcome { reported: false, ..good.clone() },
        StationOutcome { exit_code: None, ..good.clone() },
        StationOutcome { exit_code: Some(3), ..good.clone() },
        StationOutcome { stale_models: 1, ..good.clone() },
        StationOutcome { stale_media: 1, ..good.clone() },
        StationOutcome { deficit_jumps: vec![(7, 1.0)], ..good.clone() },
        StationOutcome { faults: vec![0], trouble: "the station ended by itself".into(), ..good.clone() },
        StationOutcome { given_up: vec!["fluid:0".into()], ..good.clone() },
        StationOutcome { faults: vec![0, 1], lost: vec![(outcomes[1].tick + 10, outcomes[1].tick + 14)], ..good.clone() },
    ] {
        assert_eq!(judge(&campaign, &plan, &outcomes, std::slice::from_ref(&bad)).exit_code, 1, "{bad:?}");
    }
    let starved = StationOutcome { faults: vec![0, 1], lost: vec![(1_000, 1_004)], ..good };
    assert_eq!(judge(&campaign, &plan, &outcomes, &[starved]).exit_code, 3, "lost before any fault: not a fault's doing");
}

#[test]
fn too_much_void_is_no_verdict() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        let window = window(&mut outcomes, "kill haptic:active", number);
        (window.ticks, window.voided) = (50, 150);
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    assert_eq!((judgement.cells[0].verdict, judgement.exit_code), (Verdict::Unknown, 3));
    assert!(judgement.void_share > 0.2 && judgement.unknown.len() == 1, "{judgement:?}");
}

#[test]
fn a_plan_that_is_not_through_is_neither_broken_nor_unknown() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    outcomes.truncate(10);
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)]).exit_code, 0);
}

#[test]
fn a_station_that_never_started_is_no_verdict_and_what_an_arm_beside_suffers_does_not_count() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let troubled = StationOutcome { trouble: "not whole".into(), exit_code: Some(0), ..station(&campaign) };
    assert_eq!(judge(&campaign, &plan, &outcomes, std::slice::from_ref(&troubled)).exit_code, 3);
    let both = format!("[[arm]]\nname = \"a\"\n[[arm]]\nname = \"b\"\njudged = false\n{TEXT}");
    let (campaign, plan, outcomes) = setup(&both);
    let beside = StationOutcome { arm: "b".into(), lost: vec![(1, 9)], stale_applied: 1, ..troubled };
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign), beside]).exit_code, 0);
}

#[test]
fn a_fault_that_hit_whom_it_was_not_meant_for_is_no_verdict_and_a_pool_must_have_enough() {
    let (campaign, plan, mut outcomes) = setup(&TEXT.replace("name = \"all\"", "name = \"all\"\nleast = 100"));
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)]).pools[0].verdict, Verdict::Held);
    of(&mut outcomes, "kill haptic:active", 5).fault.as_mut().unwrap().active = false;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    assert_eq!((judgement.cells[0].astray, judgement.cells[0].without_verdict), (1, 1));
    assert_eq!((judgement.pools[0].verdict, judgement.exit_code), (Verdict::Unknown, 3));
}

#[test]
fn one_control_that_stepped_far_excuses_nobody() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    of(&mut outcomes, "kill haptic:active", 7).fault.as_mut().unwrap().control.as_mut().unwrap().force_step_max_n = 3.0;
    window(&mut outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
    of(&mut outcomes, "kill haptic:active", 0).fault.as_mut().unwrap().promise_held = Some(false);
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)]).exit_code, 1);
}

/// One fault each that makes others die, a state begin anew, the deficit jump, and the station end; told when the next fault comes, or by the station.
fn hurt_beyond(may: &str) -> Judgement {
    let (campaign, plan, mut outcomes) =
        setup(&TEXT.replace("targets = [\"haptic:active\"]\n", &format!("targets = [\"haptic:active\"]\nmay = [{may}]\n")));
    outcomes.sort_by_key(|outcome| (outcome.cell != "kill haptic:active", outcome.index)); // the first ones are of the cell that may
    let dead = Fault { target: "fluid:1".into(), dead: true, detected_by: "pidfd".into(), ..Fault::default() };
    outcomes[1].earlier.push(dead);
    for (number, outcome) in outcomes.iter_mut().enumerate() {
        (outcome.tick, outcome.before.founded_tick) = (1_000 * number as u64, if number < 3 { 0 } else { 2_500 });
        outcome.after.founded_tick = outcome.before.founded_tick;
        outcome.fault.as_mut().unwrap().window.as_mut().unwrap().to_tick = outcome.tick + 200;
    }
    let faults: Vec<usize> = outcomes[..4].iter().map(|outcome| outcome.index).collect();
    let trouble = "the station ended by itself".to_string();
    let ended = StationOutcome {
        faults,
        trouble,
        exit_code: Some(3),
        given_up: vec!["fluid:0".into()],
        deficit_jumps: vec![(2_950, 1.0)],
        ..station(&campaign)
    };
    judge(&campaign, &plan, &outcomes, &[ended])
}

#[test]
fn what_a_cell_may_bring_about_is_counted_and_breaks_nothing() {
    let all = hurt_beyond("\"begin-anew\", \"others-die\", \"station-ends\"");
    let expected = [("began anew", 1), ("others died", 1), ("station ended", 1)];
    assert_eq!(all.cells[0].seen.iter().map(|(what, count)| (*what, *count)).collect::<Vec<_>>(), expected);
    assert_eq!(
        (all.cells[0].reasons.len(), all.broken.len(), all.exit_code),
        (0, 0, 0),
        "{:?} {:?}",
        all.cells[0].reasons,
        all.broken
    );
    assert!(text(&all).contains("began anew 1, others died 1, station ended 1"), "{}", text(&all));

    let none = hurt_beyond("");
    assert_eq!((none.cells[0].seen.len(), none.cells[0].verdict, none.exit_code), (3, Verdict::Broken, 1));
    for word in ["fluid:1 died too", "began anew", "ended by itself; fluid:0 did not come back"] {
        assert!(none.cells[0].reasons.iter().any(|reason| reason.contains(word)), "{word}: {:?}", none.cells[0].reasons);
    }
    for word in ["after 4 faults", "exit code is 3", "jumped by 1.000 ml at tick 2950"] {
        assert!(none.broken.iter().any(|reason| reason.contains(word)), "{word}: {:?}", none.broken);
    }
    let without = hurt_beyond("\"others-die\", \"station-ends\"");
    assert!(without.broken.len() == 1 && without.broken[0].contains("jumped"), "{:?}", without.broken);
    let of_faults = without.cells[0].reasons.iter().filter(|reason| reason.starts_with("fault "));
    assert_eq!(of_faults.count(), 1, "{:?}", without.cells[0].reasons);
}

#[test]
fn a_cell_of_which_nothing_came_proves_nothing_and_its_faults_are_named() {
    let (campaign, plan, mut outcomes) = setup(&TEXT.replace("limit_upper95 = 0.7", "limit_upper95 = 1.0"));
    for number in 0..4 {
        of(&mut outcomes, "kill device", number).fault.as_mut().unwrap().manifested = false;
    }
    let silent = of(&mut outcomes, "kill device", 0).index;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)]);
    let device = &judgement.cells[1];
    assert_eq!((device.verdict, device.not_shown.len(), judgement.exit_code), (Verdict::Unknown, 4, 3));
    assert!(device.reasons.iter().any(|reason| reason.contains("none of its faults showed")), "{:?}", device.reasons);
    assert!(text(&judgement).contains(&format!("kill device: nothing came of fault {silent}, ")), "{}", text(&judgement));
}
