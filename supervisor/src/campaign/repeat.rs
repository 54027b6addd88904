//! One fault of a plan again, alone in a station of its own, at the tick and phase at which it was injected if the folder knows them, else at the drawn ones;
//! one in a swap after the same stage of it, so many ticks later, and at that phase; one in a hand-over so many ticks after that is seen. Judged as in its
//! campaign, but for the bounds, of which one fault says nothing: a tick that it lost is as often the host's, and breaks no promise.

use super::absent::Absent;
use super::cell::{Cell, State};
use super::draw::Entry;
use super::file::Campaign;
use super::judge::{Figures, Verdict, judge};
use super::outcome::{Ending, Outcome};
use super::runner::Runner;
use super::say;
use super::store::Store;
use crate::settings::Refusal;
use hyst_messages::TICK_NS;
use serde_json::json;

/// Farthest from the wanted phase, in the same tick, at which it is still the same fault, µs: a thread of real time that slept until then wakes sooner if nothing
/// keeps it (7 of 10 of 877 faults of four campaigns came within it, half of them within 50 us).
const MOST_OFF_US: i64 = 100;
/// In a swap the moment is bound to a stage of it, and in a hand-over to its beginning, µs: that is seen within a look of 5 ms, and what is to come at once takes
/// as long as the control socket and the supervisor's loop.
const MOST_OFF_IN_SWAP_US: i64 = 20_000;

impl Runner<'_> {
    /// Repeats a fault; gives the exit code.
    pub(super) fn repeat(&self, index: usize, store: &mut Store) -> Result<u8, Refusal> {
        let Some(drawn) = self.plan.faults.get(index) else { return Ok(2) }; // refused before
        let entry = again(drawn, store.outcomes.iter().find(|outcome| outcome.index == index));
        let files = store.folder().join(format!("only-{index}-run"));
        let mut found = None;
        let mut take = |outcome: Outcome| -> Result<(), Refusal> {
            found = Some(outcome);
            Ok(())
        };
        let station = self.lap(&[&entry], index, &files, &mut take, &mut Absent::default())?; // whatever came of others of its cell
        let cell = self.campaign.cell(&entry.cell);
        let (Some(outcome), Some(cell)) = (found, cell) else {
            let why = if station.trouble.is_empty() { "interrupted" } else { &station.trouble };
            return Err(Refusal { code: 3, message: format!("fault {index} was not injected: {why}") });
        };
        let judgement =
            judge(&unbound(self.campaign, cell), self.plan, std::slice::from_ref(&outcome), std::slice::from_ref(&station), None);
        let figures = judgement.cells.iter().find(|figures| figures.name == entry.cell && figures.arm == entry.arm);
        let off_us = off_us(&entry, cell, &outcome);
        let elsewhere = elsewhere(&entry, cell, &outcome);
        let (code, why) = conclude(figures, &judgement.broken, &judgement.unknown, elsewhere);
        let missing = if cell.swap.is_some() { "its swap did not come to the wanted stage" } else { "there was no hand-over" };
        let place = off_us.map_or(missing.into(), |us| format!("{us} us from the wanted moment"));
        say(self.json, &format!("fault {index}: {place}; {}\n", why.join("; ")));
        let json = json!({ "outcome": outcome, "off_us": off_us, "figures": figures, "station": station, "verdict": why, "exit_code": code });
        let json = serde_json::to_string_pretty(&json).map_err(|e| Refusal::failed(e.to_string()))?;
        store.write(&format!("only-{index}.json"), &json)?;
        if self.json {
            say(false, &format!("{json}\n"));
        }
        Ok(code)
    }
}

/// The fault as it was injected before, or as it was drawn.
fn again(drawn: &Entry, known: Option<&Outcome>) -> Entry {
    let mut entry = drawn.clone();
    let Some(known) = known.filter(|known| known.ending == Ending::Closed) else { return entry };
    if let Some((handed_tick, with)) = known.handed_tick.zip(known.with.as_ref()) {
        (entry.tick, entry.with_ticks) = (with.tick, known.tick.saturating_sub(handed_tick));
        return entry;
    }
    match known.swap.as_ref().map(|swap| swap.place_of(known.tick)) {
        Some(None) => {} // where it was is not known
        Some(place) => (entry.in_swap, entry.phase_us) = (place, known.injected_phase_us),
        None => {
            entry.phase_us = known.injected_phase_us;
            entry.tick = known.tick - if known.with.is_some() { entry.with_ticks.min(known.tick) } else { 0 };
        }
    }
    entry
}

/// The campaign with this cell alone, without a bound.
fn unbound(campaign: &Campaign, cell: &Cell) -> Campaign {
    let cell = Cell { limit_upper95: None, pool: None, found_ms: None, ..cell.clone() };
    Campaign { cells: vec![cell], pools: Vec::new(), most_void: 1.0, ..campaign.clone() }
}

/// How far from the wanted moment it came, µs: of the station's time, or of the time since its swap came to the stage, or its hand-over was seen; `None` if that
/// never was.
fn off_us(entry: &Entry, cell: &Cell, outcome: &Outcome) -> Option<i64> {
    let us = |tick: u64, phase_us: u32| (tick * TICK_NS / 1_000) as i64 + i64::from(phase_us);
    if cell.state == State::Handover {
        // At once, and at no phase that was wanted.
        return Some(us(outcome.tick, 0) - us(outcome.handed_tick? + entry.with_ticks, 0));
    }
    let (was, wanted) = match entry.in_swap {
        Some(wanted) => (outcome.swap.as_ref()?.place_of(outcome.tick)?.offset_ticks, wanted.offset_ticks),
        None => (outcome.tick, wanted_tick(entry, cell)),
    };
    Some(us(was, outcome.injected_phase_us) - us(wanted, entry.phase_us))
}

/// Why it is not the same fault, in words: it came in another tick, or at another phase of it; in a swap, so long after its stage. `None` if it is the same.
fn elsewhere(entry: &Entry, cell: &Cell, outcome: &Outcome) -> Option<String> {
    let course = match cell.state {
        State::Swap => Some("swap"),
        State::Handover => Some("hand-over"),
        _ => None,
    };
    let wanted = match course {
        Some(course) => format!("at most {} ms from the wanted moment of its {course}", MOST_OFF_IN_SWAP_US / 1_000),
        None => format!("in the same tick, at most {MOST_OFF_US} us from the wanted phase"),
    };
    let is_same = off_us(entry, cell, outcome).is_some_and(|off_us| match course {
        Some(_) => off_us.abs() <= MOST_OFF_IN_SWAP_US,
        None => wanted_tick(entry, cell) == outcome.tick && off_us.abs() <= MOST_OFF_US,
    });
    (!is_same)
        .then(|| format!("it was not repeated: that takes a fault {wanted}; try again, on a machine that has nothing else to do"))
}

/// The tick in which a fault that is in no swap and no hand-over is to come.
fn wanted_tick(entry: &Entry, cell: &Cell) -> u64 {
    entry.tick + if cell.with.is_some() { entry.with_ticks } else { 0 }
}

/// The exit code, and why: 1 for what breaks a promise by itself in a campaign, too.
pub(super) fn conclude(
    figures: Option<&Figures>,
    broken: &[String],
    unknown: &[String],
    elsewhere: Option<String>,
) -> (u8, Vec<String>) {
    let is_broken = figures.is_some_and(|figures| figures.verdict == Verdict::Broken);
    let mut why: Vec<String> = broken.to_vec();
    why.extend(figures.into_iter().flat_map(|figures| figures.reasons.clone()));
    let excess = figures.and_then(|figures| figures.beyond_misses.first().copied());
    let lost = excess.filter(|excess| *excess > 0).map(|excess| {
        let ticks = if excess == 1 { "1 tick".into() } else { format!("{excess} ticks") };
        format!("{ticks} without a fresh force beyond its control's and what it may cost")
    });
    if is_broken || !broken.is_empty() {
        why.extend(lost);
        return (1, why);
    }
    why.extend(unknown.iter().cloned());
    why.extend(elsewhere);
    if excess.is_none() {
        why.push("it has no verdict".into());
    }
    let code = if why.is_empty() { 0 } else { 3 };
    let remark = "that breaks no promise by itself; whether it is the fault's doing a campaign says";
    why.extend(lost.map(|lost| format!("{lost}: {remark}")));
    if why.is_empty() {
        why.push("its promise held".into());
    }
    (code, why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::outcome::SwapSeen;
    use crate::campaign::{draw, file};
    use crate::fault::Fault;
    use crate::ledger::Window;

    const TEXT: &str = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"device\"]\ncount = 2\n\
                        [[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\nstates = [\"recovery\"]\ncount = 1\n";

    #[test]
    fn it_comes_again_where_it_came_and_only_the_same_tick_and_phase_are_the_same_moment() {
        let campaign = file::parse("t", TEXT).unwrap();
        let plan = draw::plan(&campaign, 1);
        for entry in &plan.faults {
            let cell = campaign.cell(&entry.cell).unwrap();
            assert_eq!(again(entry, None), *entry);
            let with = cell.with.as_ref().map(|_| crate::fault::Fault::default());
            let came = Outcome { tick: 90_000, injected_phase_us: 123, ending: Ending::Closed, with, ..Outcome::of(entry) };
            let again = again(entry, Some(&came));
            assert_eq!((off_us(&again, cell, &came), again.phase_us), (Some(0), 123), "{entry:?}");
            let at = |tick, injected_phase_us| Outcome { tick, injected_phase_us, ..came.clone() };
            assert_eq!(off_us(&again, cell, &at(90_002, 23)), Some(1_900));
            let is_same = |tick, phase_us| elsewhere(&again, cell, &at(tick, phase_us)).is_none();
            assert_eq!([is_same(90_000, 23), is_same(90_000, 223)], [true; 2], "{entry:?}");
            assert_eq!([is_same(90_000, 22), is_same(90_000, 224), is_same(90_001, 123)], [false; 3], "{entry:?}");
            let at_its_end = Entry { phase_us: 990, ..again.clone() };
            assert!(
                elsewhere(&at_its_end, cell, &at(90_001, 5)).is_some_and(|why| why.contains("in the same tick")),
                "15 us later"
            );
        }
    }

    #[test]
    fn in_a_swap_it_may_come_so_much_beside_the_same_time_after_its_stage() {
        let text =
            "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:spare\"]\nstates = [\"swap\"]\nswap = \"tissue\"\ncount = 1\n";
        let campaign = file::parse("t", text).unwrap();
        let plan = draw::plan(&campaign, 1);
        let (entry, cell) = (&plan.faults[0], &campaign.cells[0]);
        let place = entry.in_swap.unwrap();
        let why = |late_ticks: u64, is_known: bool| {
            let since = is_known.then_some((place.stage, 70_000));
            let swap = Some(SwapSeen { since, ..SwapSeen::default() });
            elsewhere(entry, cell, &Outcome { tick: 70_000 + place.offset_ticks + late_ticks, swap, ..Outcome::of(entry) })
        };
        assert_eq!([why(0, true), why(20, true)], [None, None]);
        assert!([why(21, true), why(0, false)].iter().flatten().all(|why| why.contains("at most 20 ms")));
        assert!(why(21, true).is_some() && why(0, false).is_some(), "nobody knows where it came");
    }

    #[test]
    fn in_a_hand_over_it_may_come_so_much_beside_the_same_time_after_that_was_seen_whenever_it_was_found() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:active\"]\nstates = [\"handover\"]\ncount = 1\n";
        let campaign = file::parse("t", text).unwrap();
        let plan = draw::plan(&campaign, 1);
        let (entry, cell) = (&plan.faults[0], &campaign.cells[0]);
        let with = Some(crate::fault::Fault { tick: 61_000, ..Default::default() });
        let came = Outcome { tick: 67_030, handed_tick: Some(67_000), with, ending: Ending::Closed, ..Outcome::of(entry) };
        let again = again(entry, Some(&came));
        assert_eq!((again.tick, again.with_ticks), (61_000, 30));
        let why = |tick: u64, handed_tick| elsewhere(&again, cell, &Outcome { tick, handed_tick, ..came.clone() });
        assert_eq!([why(77_030, Some(77_000)), why(67_050, Some(67_000))], [None, None], "it was found later");
        assert!([why(67_051, Some(67_000)), why(67_030, None)].iter().flatten().all(|why| why.contains("of its hand-over")));
        assert!(why(67_051, Some(67_000)).is_some() && why(67_030, None).is_some(), "nobody knows where it came");
    }

    #[test]
    fn one_that_came_at_another_moment_or_has_no_verdict_is_no_verdict_and_what_is_broken_is() {
        let figures = |excess: &[i64], verdict| Figures { beyond_misses: excess.to_vec(), verdict, ..Figures::default() };
        let code = |figures: &Figures, broken: &[String], is_elsewhere: bool| {
            conclude(Some(figures), broken, &[], is_elsewhere.then(|| "it was not repeated".into())).0
        };
        let held = figures(&[0], Verdict::Figures);
        assert_eq!([false, true].map(|is_elsewhere| code(&held, &[], is_elsewhere)), [0, 3]);
        assert_eq!(code(&figures(&[], Verdict::Figures), &[], false), 3);
        assert_eq!([false, true].map(|is_elsewhere| code(&figures(&[0], Verdict::Broken), &[], is_elsewhere)), [1, 1]);
        assert_eq!(code(&held, &["2 stale forces were applied".into()], false), 1, "its station is looked at too");
    }

    /// One tick of the host's noise was a promise that is broken beyond doubt, at whatever moment the fault came.
    #[test]
    fn a_tick_or_two_more_than_the_control_break_no_promise_and_are_said() {
        let said = |lost: i64, verdict, elsewhere: Option<&str>| {
            let figures = Figures { beyond_misses: vec![lost], verdict, ..Figures::default() };
            let (code, why) = conclude(Some(&figures), &[], &[], elsewhere.map(str::to_string));
            (code, why.join("; "))
        };
        assert_eq!(said(0, Verdict::Figures, None), (0, "its promise held".to_string()));
        assert_eq!(said(-3, Verdict::Figures, None), (0, "its promise held".to_string()));
        for (lost, words) in [(1, "1 tick without"), (2, "2 ticks without")] {
            let (code, why) = said(lost, Verdict::Figures, None);
            assert!(code == 0 && why.starts_with(words) && why.contains("breaks no promise by itself"), "{code}: {why}");
            let (code, why) = said(lost, Verdict::Figures, Some("it was not repeated"));
            assert!(code == 3 && why.starts_with("it was not repeated; ") && why.contains(words), "{code}: {why}");
        }
        assert_eq!(said(30, Verdict::Broken, None).0, 1);
    }

    /// What a single fault of a campaign may not cost, one that is repeated may not either: its window and its control are all that is known.
    #[test]
    fn what_breaks_a_promise_by_itself_in_a_campaign_does_so_alone() {
        let campaign = file::parse("t", TEXT).unwrap();
        let plan = draw::plan(&campaign, 1);
        let entry = plan.faults.iter().find(|entry| entry.cell == "kill device").unwrap();
        let cell = campaign.cell(&entry.cell).unwrap();
        let repeated = |missed: u64| {
            let control = Window { ticks: 200, ..Window::default() };
            let (window, control) = (Some(Window { missed, ..control }), Some(control));
            let recovered_us = Some(9_000.0);
            let fault = Fault { manifested: true, active: true, recovered_us, window, control, ..Fault::default() };
            let outcome = Outcome { ending: Ending::Closed, fault: Some(fault), ..Outcome::of(entry) };
            let judgement = judge(&unbound(&campaign, cell), &plan, &[outcome], &[], None);
            let figures = judgement.cells.iter().find(|figures| figures.name == entry.cell);
            conclude(figures, &judgement.broken, &judgement.unknown, None)
        };
        // Twenty are what each death of a device may cost, and twenty more than that what any single fault may.
        assert_eq!([20, 21, 40].map(|missed| repeated(missed).0), [0, 0, 0]);
        assert!(repeated(21).1[0].starts_with("1 tick without"), "{:?}", repeated(21).1);
        let (code, why) = repeated(41);
        assert!(code == 1 && why[0].contains("the hand lost 41 ticks"), "{why:?}");
    }

    #[test]
    fn the_device_may_lose_its_twenty_when_it_is_repeated_and_no_bound_is_asked_of_one() {
        let campaign = file::parse("t", TEXT).unwrap();
        let alone = unbound(&campaign, &campaign.cells[0]);
        assert_eq!((alone.cells.len(), alone.cells[0].limit_upper95, alone.cells[0].allowed_misses), (1, None, 20));
    }
}
