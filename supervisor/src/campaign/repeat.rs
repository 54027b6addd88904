//! One fault of a plan again, alone in a station of its own, at the tick and phase at which it was injected if the folder knows them, else at the drawn ones;
//! one in a swap after the same stage of it, so many ticks later, and at that phase. Judged as in its campaign, but for the bounds, of which one fault says
//! nothing.

use super::cell::Cell;
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

/// Farthest from the wanted moment at which it is still the same fault, µs: a tick.
const MOST_OFF_US: i64 = (TICK_NS / 1_000) as i64;
/// The same in a swap, µs: its stage is seen within a look of 5 ms, and what is to come at once takes as long as the control socket and the supervisor's loop.
const MOST_OFF_IN_SWAP_US: i64 = 20_000;

impl Runner<'_> {
    /// Repeats a fault; gives the exit code.
    pub(super) fn repeat(&self, index: usize, store: &mut Store) -> Result<u8, Refusal> {
        let Some(drawn) = self.plan.faults.get(index) else { return Ok(2) }; // refused before
        let entry = again(drawn, store.outcomes.iter().find(|outcome| outcome.index == index));
        let files = store.folder().join(format!("only-{index}-run"));
        let mut found = None;
        let station = self.lap(&[&entry], index, &files, &mut |outcome| {
            found = Some(outcome);
            Ok(())
        })?;
        let cell = self.campaign.cell(&entry.cell);
        let (Some(outcome), Some(cell)) = (found, cell) else {
            let why = if station.trouble.is_empty() { "interrupted" } else { &station.trouble };
            eprintln!("hystation: fault {index} was not injected: {why}");
            return Ok(3);
        };
        let judgement =
            judge(&unbound(self.campaign, cell), self.plan, std::slice::from_ref(&outcome), std::slice::from_ref(&station), None);
        let figures = judgement.cells.iter().find(|figures| figures.name == entry.cell && figures.arm == entry.arm);
        let off_us = off_us(&entry, cell, &outcome);
        let most_off_us = if cell.swap.is_some() { MOST_OFF_IN_SWAP_US } else { MOST_OFF_US };
        let is_elsewhere = off_us.is_none_or(|off_us| off_us.abs() > most_off_us);
        let (code, why) = conclude(figures, &judgement.broken, &judgement.unknown, is_elsewhere);
        let place =
            off_us.map_or("its swap did not come to the wanted stage".into(), |us| format!("{us} us from the wanted moment"));
        say(self.json, &format!("fault {index}: {place}; {}\n", why.join("; ")));
        let json = json!({ "outcome": outcome, "off_us": off_us, "figures": figures, "station": station, "verdict": why, "exit_code": code });
        let json = serde_json::to_string_pretty(&json).map_err(|e| Refusal::failed(e.to_string()))?;
        store.write(&format!("only-{index}.json"), &json)?;
        say(false, &format!("{json}\n"));
        Ok(code)
    }
}

/// The fault as it was injected before, or as it was drawn.
fn again(drawn: &Entry, known: Option<&Outcome>) -> Entry {
    let mut entry = drawn.clone();
    let Some(known) = known.filter(|known| known.ending == Ending::Closed) else { return entry };
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

/// How far from the wanted moment it came, µs: of the station's time, or of the time since its swap came to the stage; `None` if it never did.
fn off_us(entry: &Entry, cell: &Cell, outcome: &Outcome) -> Option<i64> {
    let us = |tick: u64, phase_us: u32| (tick * TICK_NS / 1_000) as i64 + i64::from(phase_us);
    let (was, wanted) = match entry.in_swap {
        Some(wanted) => (outcome.swap.as_ref()?.place_of(outcome.tick)?.offset_ticks, wanted.offset_ticks),
        None => (outcome.tick, entry.tick + if cell.with.is_some() { entry.with_ticks } else { 0 }),
    };
    Some(us(was, outcome.injected_phase_us) - us(wanted, entry.phase_us))
}

/// The exit code, and why.
fn conclude(figures: Option<&Figures>, broken: &[String], unknown: &[String], is_elsewhere: bool) -> (u8, Vec<String>) {
    let is_broken = figures.is_some_and(|figures| figures.verdict == Verdict::Broken);
    let mut why: Vec<String> = broken.to_vec();
    why.extend(figures.into_iter().flat_map(|figures| figures.reasons.clone()));
    let excess = figures.and_then(|figures| figures.beyond_misses.first().copied());
    if let Some(excess) = excess.filter(|excess| *excess > 0) {
        why.push(format!("{excess} ticks without a fresh force beyond its control's and what it may cost"));
    }
    if is_broken || !broken.is_empty() || excess.is_some_and(|excess| excess > 0) {
        return (1, why);
    }
    why.extend(unknown.iter().cloned());
    if is_elsewhere {
        why.push("that is another moment than the wanted one".into());
    }
    if excess.is_none() {
        why.push("it has no verdict".into());
    }
    if why.is_empty() { (0, vec!["its promise held".into()]) } else { (3, why) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{draw, file};

    const TEXT: &str = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"device\"]\ncount = 2\n\
                        [[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\nstates = [\"recovery\"]\ncount = 1\n";

    #[test]
    fn it_comes_again_where_it_came_and_a_tick_beside_is_another_moment() {
        let campaign = file::parse("t", TEXT).unwrap();
        let plan = draw::plan(&campaign, 1);
        for entry in &plan.faults {
            let cell = campaign.cell(&entry.cell).unwrap();
            assert_eq!(again(entry, None), *entry);
            let with = cell.with.as_ref().map(|_| crate::fault::Fault::default());
            let came = Outcome { tick: 90_000, injected_phase_us: 123, ending: Ending::Closed, with, ..Outcome::of(entry) };
            let again = again(entry, Some(&came));
            assert_eq!((off_us(&again, cell, &came), again.phase_us), (Some(0), 123), "{entry:?}");
            let later = Outcome { tick: 90_002, injected_phase_us: 23, ..came.clone() };
            assert_eq!(off_us(&again, cell, &later), Some(1_900));
        }
    }

    #[test]
    fn one_that_came_at_another_moment_or_has_no_verdict_is_no_verdict_and_what_is_broken_is() {
        let figures = |excess: &[i64], verdict| Figures { beyond_misses: excess.to_vec(), verdict, ..Figures::default() };
        let code = |figures: &Figures, broken: &[String], is_elsewhere| conclude(Some(figures), broken, &[], is_elsewhere).0;
        let held = figures(&[0], Verdict::Figures);
        assert_eq!([false, true].map(|is_elsewhere| code(&held, &[], is_elsewhere)), [0, 3]);
        assert_eq!(code(&figures(&[], Verdict::Figures), &[], false), 3);
        assert_eq!(code(&figures(&[2], Verdict::Figures), &[], true), 1, "beyond what it may cost");
        assert_eq!(code(&figures(&[0], Verdict::Broken), &[], false), 1);
        assert_eq!(code(&held, &["2 stale forces were applied".into()], false), 1, "its station is looked at too");
    }

    #[test]
    fn the_device_may_lose_its_twenty_when_it_is_repeated_and_no_bound_is_asked_of_one() {
        let campaign = file::parse("t", TEXT).unwrap();
        let alone = unbound(&campaign, &campaign.cells[0]);
        assert_eq!((alone.cells.len(), alone.cells[0].limit_upper95, alone.cells[0].allowed_misses), (1, None, 20));
    }
}
