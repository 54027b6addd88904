//! Verdicts by hand.

use super::*;
use crate::campaign::outcome::Ending;
use crate::campaign::text::text;
use crate::campaign::{draw, file};
use crate::fault::Fault;
use crate::ledger::Window;

pub(super) const TEXT: &str = "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.5\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 100\n\
                    limit_upper95 = 0.04\npool = \"all\"\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"device\"]\ncount = 4\nlimit_upper95 = 0.7\n";

pub(super) fn setup(text: &str) -> (Campaign, Plan, Vec<Outcome>) {
    let campaign = file::parse("t", text).unwrap();
    let plan = draw::plan(&campaign, 1);
    let outcomes = plan.faults.iter().map(|entry| {
        let injected_ns = 1_000_000_000 * (entry.index as u64 + 1);
        let window = Some(Window { ticks: 200, ..Window::default() });
        let fault = Fault {
            manifested: true,
            injected_ns,
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
        (outcome.before.tissue_tick, outcome.after.tissue_tick) = (5, 6);
        outcome
    });
    let outcomes = outcomes.collect();
    (campaign, plan, outcomes)
}

pub(super) fn station(campaign: &Campaign) -> StationOutcome {
    StationOutcome {
        arm: campaign.arms[0].name.clone(),
        reported: true,
        exit_code: Some(0),
        control_step_max_n: 0.01,
        ..StationOutcome::default()
    }
}

/// The station that had all of them, in the order of their ticks.
pub(super) fn all_of(campaign: &Campaign, outcomes: &[Outcome]) -> StationOutcome {
    StationOutcome { faults: outcomes.iter().map(|outcome| outcome.index).collect(), ..station(campaign) }
}

/// What the station tells of a process that ended at a time although nobody hurt it.
pub(super) fn ended(target: &str, by: &str, at_ns: u64) -> Fault {
    let (kind, exit, detected_us) = ("external".into(), "exit code 1".into(), Some(0.0));
    Fault {
        kind,
        target: target.into(),
        exit,
        detected_us,
        injected_ns: at_ns,
        dead: true,
        detected_by: by.into(),
        ..Fault::default()
    }
}

pub(super) fn of<'a>(outcomes: &'a mut [Outcome], cell: &str, number: usize) -> &'a mut Outcome {
    outcomes.iter_mut().filter(|outcome| outcome.cell == cell).nth(number).unwrap()
}

pub(super) fn window<'a>(outcomes: &'a mut [Outcome], cell: &str, number: usize) -> &'a mut Window {
    of(outcomes, cell, number).fault.as_mut().unwrap().window.as_mut().unwrap()
}

#[test]
fn without_a_miss_every_promise_is_held() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let verdicts: Vec<Verdict> = judgement.cells.iter().chain(&judgement.pools).map(|figures| figures.verdict).collect();
    assert_eq!((verdicts, judgement.exit_code), (vec![Verdict::Held; 3], 0), "{judgement:?}");
    let haptic = &judgement.cells[0];
    assert_eq!((haptic.injected, haptic.manifested, haptic.detected_by["pidfd"]), (100, 100, 100));
    assert_eq!((haptic.detected_ms[99], haptic.recovered_ms[0], haptic.excess.unwrap().worse), (2.0, 150.0, 0));
}

#[test]
fn a_burst_counts_once_and_the_device_may_lose_its_twenty() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    window(&mut outcomes, "kill haptic:active", 3).missed = 20;
    for number in 0..4 {
        window(&mut outcomes, "kill device", number).missed = 20;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!(judgement.cells[0].excess.unwrap().worse, 1);
    assert_eq!(judgement.cells[0].verdict, Verdict::Unknown, "one of 100: up to 0.047 is possible");
    assert_eq!((judgement.cells[1].verdict, judgement.exit_code), (Verdict::Held, 3));
    window(&mut outcomes, "kill device", 0).missed = 21;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!(judgement.cells[1].excess.unwrap().worse, 1);
}

#[test]
fn misses_beyond_doubt_break_the_promise_and_so_does_a_limit_that_cannot_be_met() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        window(&mut outcomes, "kill haptic:active", number).missed = 1;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!(
        (judgement.cells[0].verdict, judgement.pools[0].verdict, judgement.exit_code),
        (Verdict::Broken, Verdict::Held, 1)
    );
    let (campaign, plan, outcomes) = setup(&TEXT.replace("0.7", "-1.0"));
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).cells[1].verdict, Verdict::Broken);
}

#[test]
fn what_a_fault_does_to_the_kernel_is_no_excuse() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        window(&mut outcomes, "kill haptic:active", number).late = 3;
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let haptic = &judgement.cells[0];
    assert_eq!((haptic.excess.unwrap().worse, haptic.excess_with_void.unwrap().worse), (0, 30));
    assert_eq!((haptic.verdict, judgement.pools[0].verdict), (Verdict::Broken, Verdict::Held));
    assert!(haptic.reasons.iter().any(|reason| reason.contains("with void ticks")), "{:?}", haptic.reasons);
}

#[test]
fn what_never_may_happen_breaks_a_promise_at_once() {
    type Harm = fn(&mut [Outcome]);
    let harms: [(Harm, &str); 7] = [
        (|outcomes| of(outcomes, "kill haptic:active", 0).fault.as_mut().unwrap().recovered_us = None, "did not recover"),
        (|outcomes| of(outcomes, "kill haptic:active", 0).after.tissue_tick = 4, "tissue"),
        (|outcomes| of(outcomes, "kill haptic:active", 0).after.founded_tick = 7, "began anew"),
        (
            |outcomes| {
                let hurt = of(outcomes, "kill haptic:active", 0);
                hurt.collateral.push(ended("fluid:1", "pidfd", hurt.since_ns()));
            },
            "fluid:1 died (exit code 1, found by pidfd) too",
        ),
        (
            |outcomes| {
                let hurt = of(outcomes, "kill haptic:active", 0);
                hurt.collateral.push(ended("tissue:1", "heartbeat", hurt.since_ns()));
            },
            "tissue:1 hung and was ended",
        ),
        // Of the ten seconds before it the supervisor thinks otherwise.
        (|outcomes| window(outcomes, "kill haptic:active", 0).force_step_max_n = 0.2, "force step"),
        (|outcomes| window(outcomes, "kill haptic:active", 0).missed = 21, "the hand lost 21 ticks, 0 at most without a fault"),
    ];
    for (harm, word) in harms {
        let (campaign, plan, mut outcomes) = setup(TEXT);
        harm(&mut outcomes);
        let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
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
        StationOutcome { damage: vec!["byte 9: is none".into()], ..good.clone() },
        StationOutcome { missing_ticks: 1, ..good.clone() },
        StationOutcome { repeated_ticks: 1, ..good.clone() },
        StationOutcome { deficit_jumps: vec![(7, 1.0)], ..good.clone() },
        StationOutcome { faults: vec![0], trouble: "the station ended by itself".into(), ..good.clone() },
        StationOutcome { given_up: vec!["fluid:0".into()], ..good.clone() },
        StationOutcome { faults: vec![0, 1], lost: vec![(outcomes[1].tick + 10, outcomes[1].tick + 14)], ..good.clone() },
    ] {
        assert_eq!(judge(&campaign, &plan, &outcomes, std::slice::from_ref(&bad), None).exit_code, 1, "{bad:?}");
    }
    let starved = StationOutcome { faults: vec![0, 1], lost: vec![(1_000, 1_004)], exit_code: Some(3), ..good };
    assert_eq!(judge(&campaign, &plan, &outcomes, &[starved], None).exit_code, 3, "lost before any fault: not a fault's doing");
}

#[test]
fn too_much_void_is_no_verdict() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for number in 0..30 {
        let window = window(&mut outcomes, "kill haptic:active", number);
        (window.ticks, window.voided) = (50, 150);
    }
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!((judgement.cells[0].verdict, judgement.exit_code), (Verdict::Unknown, 3));
    assert!(judgement.void_share > 0.2 && judgement.unknown.len() == 1, "{judgement:?}");
}

/// A window half of whose ticks were void was compared with a whole one.
#[test]
fn a_window_that_is_void_for_a_quarter_is_no_verdict_and_misses_are_those_of_as_many_ticks() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let first = window(&mut outcomes, "kill haptic:active", 0);
    (first.ticks, first.voided, first.missed) = (150, 50, 1);
    window(&mut outcomes, "kill haptic:active", 1).missed = 12;
    let control = of(&mut outcomes, "kill haptic:active", 1).fault.as_mut().unwrap().control.as_mut().unwrap();
    (control.ticks, control.voided, control.missed) = (160, 40, 10); // 12.5 of 200
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let haptic = &judgement.cells[0];
    let excess = haptic.excess.unwrap();
    assert_eq!((haptic.without_verdict, excess.faults, excess.worse, excess.better), (1, 99, 0, 0), "{haptic:?}");
}

#[test]
fn a_plan_that_is_not_through_is_neither_broken_nor_unknown() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    outcomes.truncate(10);
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).exit_code, 0);
}

#[test]
fn a_run_that_stopped_before_its_batch_was_through_says_nothing_and_why() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let none = judge(&campaign, &plan, &[], &[], Some("3 stations in a row came to nothing"));
    assert_eq!((none.exit_code, none.done), (3, 0));
    assert!(text(&none).contains("3 stations in a row came to nothing"), "{}", text(&none));
    assert_eq!(judge(&campaign, &plan, &outcomes[..10], &[station(&campaign)], Some("interrupted")).exit_code, 3);
}

#[test]
fn a_station_that_never_started_is_no_verdict_and_what_an_arm_beside_suffers_does_not_count() {
    let (campaign, plan, outcomes) = setup(TEXT);
    let troubled = StationOutcome { trouble: "not whole".into(), exit_code: Some(0), ..station(&campaign) };
    assert_eq!(judge(&campaign, &plan, &outcomes, std::slice::from_ref(&troubled), None).exit_code, 3);
    let both = format!("[[arm]]\nname = \"a\"\n[[arm]]\nname = \"b\"\njudged = false\n{TEXT}");
    let (campaign, plan, outcomes) = setup(&both);
    let beside = StationOutcome { arm: "b".into(), lost: vec![(1, 9)], stale_applied: 1, ..troubled };
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign), beside], None).exit_code, 0);
}

#[test]
fn a_fault_that_hit_whom_it_was_not_meant_for_is_no_verdict_and_a_pool_must_have_enough() {
    let (campaign, plan, mut outcomes) = setup(&TEXT.replace("name = \"all\"", "name = \"all\"\nleast = 100"));
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).pools[0].verdict, Verdict::Held);
    of(&mut outcomes, "kill haptic:active", 5).fault.as_mut().unwrap().active = false;
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    assert_eq!((judgement.cells[0].astray, judgement.cells[0].without_verdict), (1, 1));
    assert_eq!((judgement.pools[0].verdict, judgement.exit_code), (Verdict::Unknown, 3));
}

#[test]
fn one_control_that_stepped_far_excuses_nobody() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    of(&mut outcomes, "kill haptic:active", 7).fault.as_mut().unwrap().control.as_mut().unwrap().force_step_max_n = 3.0;
    window(&mut outcomes, "kill haptic:active", 0).force_step_max_n = 0.2;
    assert_eq!(judge(&campaign, &plan, &outcomes, &[station(&campaign)], None).exit_code, 1);
}

/// One fault each that makes others die, a state begin anew, the deficit jump, and the station end; told when the next fault comes, or by the station.
fn hurt_beyond(may: &str) -> Judgement {
    let (campaign, plan, mut outcomes) =
        setup(&TEXT.replace("targets = [\"haptic:active\"]\n", &format!("targets = [\"haptic:active\"]\nmay = [{may}]\n")));
    outcomes.sort_by_key(|outcome| (outcome.cell != "kill haptic:active", outcome.index)); // the first ones are of the cell that may
    let first_ns = outcomes[0].since_ns();
    outcomes[1].earlier.push(ended("fluid:1", "pidfd", first_ns + 9_000_000));
    for (number, outcome) in outcomes.iter_mut().enumerate() {
        (outcome.tick, outcome.before.founded_tick) = (1_000 * number as u64, if number < 3 { 0 } else { 2_500 });
        outcome.after.founded_tick = outcome.before.founded_tick;
        let window = outcome.fault.as_mut().unwrap().window.as_mut().unwrap();
        (window.from_tick, window.to_tick) = (outcome.tick, outcome.tick + 200);
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
    judge(&campaign, &plan, &outcomes, &[ended], None)
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
    for word in ["fluid:1 died (exit code 1, found by pidfd) too", "began anew", "ended by itself; fluid:0 did not come back"] {
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
    let judgement = judge(&campaign, &plan, &outcomes, &[station(&campaign)], None);
    let device = &judgement.cells[1];
    assert_eq!((device.verdict, device.not_shown.len(), judgement.exit_code), (Verdict::Unknown, 4, 3));
    assert!(device.reasons.iter().any(|reason| reason.contains("none of its faults showed")), "{:?}", device.reasons);
    assert!(text(&judgement).contains(&format!("kill device: nothing came of fault {silent}, ")), "{}", text(&judgement));
}

/// A line is read late where a control window is awaited: fault 262 of a campaign doomed the tissues, and 267, which stopped a fluid, was blamed for it.
#[test]
fn what_others_suffer_is_the_doing_of_the_fault_before_it_and_not_of_the_one_that_read_it() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let since_ns = |index: usize| 1_000_000_000 * (index as u64 + 1);
    outcomes[5].collateral.push(ended("tissue:1", "latch", since_ns(2) + 60_000_000));
    outcomes[6].earlier.push(ended("fluid:0", "heartbeat", since_ns(3) + 1));
    // It last beat 88 ms before the fault, and died of it 300 ms after that.
    outcomes[8].earlier.push(Fault { detected_us: Some(300_000.0), ..ended("fluid:1", "latch", since_ns(7) - 88_000_000) });
    // A servo that hung missed its first beat after its last one.
    outcomes[8].collateral.push(Fault { detected_us: Some(3_000.0), ..ended("haptic:1", "heartbeat", since_ns(8) - 500_000) });
    let blame = Blame::of(&campaign, &outcomes, &[]);
    assert!((0..104).all(|index| blame.sequel(&outcomes[index]).others().next().is_none()), "no run, no order");
    // One that nobody asked for again is in the report alone; the one that is in both is one.
    let last = ended("console", "latch", since_ns(103) + 5);
    let station = StationOutcome { external: vec![last, outcomes[5].collateral[0].clone()], ..all_of(&campaign, &outcomes) };
    let stations = [station];
    let blame = Blame::of(&campaign, &outcomes, &stations);
    let blamed: Vec<(usize, &str)> = outcomes
        .iter()
        .flat_map(|outcome| blame.sequel(outcome).others().map(move |other| (outcome.index, other.target.as_str())))
        .collect();
    assert_eq!(blamed, [(2, "tissue:1"), (3, "fluid:0"), (7, "fluid:1"), (8, "haptic:1"), (103, "console")]);
    let judgement = judge(&campaign, &plan, &outcomes, &stations, None);
    let said: Vec<&String> = judgement.cells.iter().flat_map(|cell| &cell.collateral).collect();
    assert!(
        said.len() == 5 && said.iter().any(|line| line.starts_with("fault 2: tissue:1 died (exit code 1, found by latch)")),
        "{said:?}"
    );
    assert!(text(&judgement).contains("fault 2: tissue:1 died"), "{}", text(&judgement));
}

#[test]
fn a_fault_that_was_injected_beside_one_that_was_refused_is_nobodys_harm() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    let orphan = Fault { kind: "kill".into(), ..ended("tissue:0", "latch", outcomes[3].since_ns() + 1) };
    outcomes[4].earlier.push(orphan.clone());
    (outcomes[3].fault, outcomes[3].ending) = (None, Ending::Refused);
    outcomes[3].with = Some(orphan);
    let stations = [all_of(&campaign, &outcomes)];
    let blame = Blame::of(&campaign, &outcomes, &stations);
    assert!(outcomes.iter().all(|outcome| blame.sequel(outcome).others().next().is_none()));
    assert_ne!(
        judge(&campaign, &plan, &outcomes, &stations, None).exit_code,
        1,
        "one is without a verdict, and nothing is broken"
    );
}

#[test]
fn a_death_before_any_fault_is_the_stations() {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    outcomes[0].earlier.push(ended("fluid:0", "latch", 7));
    let judgement = judge(&campaign, &plan, &outcomes, &[all_of(&campaign, &outcomes)], None);
    assert!(
        judgement.exit_code == 1 && judgement.broken[0].contains("fluid:0 died (exit code 1, found by latch) before any fault"),
        "{judgement:?}"
    );
}
