//! What happened in a station between two looks at its pages. The pages are read from outside, so that a station of processes and one of
//! threads are measured by the same means, and neither knows.

use crate::proc;
use crate::view::Viewer;
use hyst_exchange::{ReadPage, system};
use hyst_messages::page::hardware::{TOTAL_COUNT, TOTALS};
use hyst_messages::page::{device, fluid, header, rendering, tissue};
use hyst_messages::{LATENCY_BUCKETS, RenderingStatus, Role, SLOTS, Slot};
use std::collections::BTreeMap;

/// Most by which the ends of steps may lie off the ends of a window, in mean steps: one at each end.
const MOST_CUT_STEPS: f64 = 2.0;

/// What one slot had counted.
#[derive(Clone, Debug, Default)]
struct Count {
    at_ns: u64,
    /// Its last heartbeat: the end of the last step that is counted.
    beat_ns: u64,
    incarnation: u32,
    steps: u64,
    overruns: u64,
    allocations: u64,
    substitutes: u64,
    promotions: u64,
    shares_missing: u64,
    wakeup: Vec<u64>,
    looping: Vec<u64>,
    motion: Vec<u64>,
}

/// What one process, or one engine in a process that holds several, did in a window or in several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spell {
    /// Length, s.
    pub seconds: f64,
    /// From the end of the last step before it to the end of the last step in it, s.
    pub stepping_s: f64,
    /// Steps; `None` for a process that has no page.
    pub steps: Option<u64>,
    /// Periods that were skipped.
    pub overruns: u64,
    /// Allocations on the engine's own thread.
    pub allocations: u64,
    /// Steps computed for another holder.
    pub substitutes: u64,
    /// Promotions.
    pub promotions: u64,
    /// Shares of the intersection test that were missing.
    pub shares_missing: u64,
    /// Histograms.
    pub wakeup: Vec<u64>,
    /// Histogram of loop latencies.
    pub looping: Vec<u64>,
    /// Histogram of the time from the hardware's sample to the picture that shows it; empty of who draws none.
    pub motion: Vec<u64>,
    /// Processor time of the process, s; `None` for one of several engines in it.
    pub processor_s: Option<f64>,
    /// Resident memory of the process, MiB.
    pub resident_mib: Option<f64>,
    /// SCHED_FIFO was granted.
    pub real_time: bool,
    /// What a process that draws said of its last picture.
    pub picture: Option<RenderingStatus>,
    /// How many times the fluid had halved its scene's grid.
    pub halvings: Option<u32>,
}

impl Spell {
    /// Steps per second; `None` without a page. A window cuts through a step at both ends, which is half a hertz of 30 in 2 s, so the time between
    /// the ends of steps counts; but if the last step ended long before the window, it is the window's time.
    pub fn rate_hz(&self) -> Option<f64> {
        let steps = self.steps.filter(|_| self.seconds > 0.0)? as f64;
        let cut = (self.stepping_s - self.seconds).abs() * steps <= MOST_CUT_STEPS * self.seconds;
        Some(steps / if cut && self.stepping_s > 0.0 { self.stepping_s } else { self.seconds })
    }
}

/// A window of one station.
#[derive(Clone, Debug, Default)]
pub struct Window {
    /// By name: `tissue:active`, `tissue:spare`, `collision-worker:0`, `device`, and of the processes that hold several, `process`.
    pub spells: BTreeMap<String, Spell>,
    /// Totals of the hardware's ledger.
    pub ledger: [u64; TOTAL_COUNT],
    /// Resident memory of all processes, MiB.
    pub resident_mib: f64,
    /// The same with what is shared divided among its sharers, MiB.
    pub proportional_mib: f64,
    /// Nobody died, and the tissue kept its holder.
    pub quiet: bool,
    /// Length of the tissue's steps, ticks; 0 if it does not say.
    pub tissue_step_ticks: u32,
    /// After the window rendering was killed: for how long there was no picture, s.
    pub pictures_back_s: Option<f64>,
}

/// A station at one moment.
#[derive(Debug, Default)]
pub struct Look {
    counts: BTreeMap<Slot, Count>,
    active: BTreeMap<Slot, bool>,
    /// Holder of the tissue's role.
    holder: u32,
    tissue_step_ticks: u32,
    processes: BTreeMap<u32, (String, f64, u64)>,
    engines: BTreeMap<Slot, u32>,
    ledger: [u64; TOTAL_COUNT],
}

fn count(page: &ReadPage, slot: Slot) -> Count {
    let mut wakeup = vec![0; LATENCY_BUCKETS];
    let mut looping = vec![0; LATENCY_BUCKETS];
    page.load64s(header::WAKEUP, &mut wakeup);
    page.load64s(header::LOOP, &mut looping);
    let missing = match slot.role() {
        Role::Tissue => page.cell(tissue::STATUS).map_or(0, |(_, status)| status.shares_missing as u64),
        _ => 0,
    };
    let mut motion = Vec::new();
    if slot.role() == Role::Rendering {
        motion.resize(LATENCY_BUCKETS, 0);
        page.load64s(rendering::MOTION, &mut motion);
    }
    Count {
        at_ns: system::now_ns(),
        beat_ns: page.load64(header::HEARTBEAT_NS),
        incarnation: page.incarnation(),
        steps: page.load64(header::STEPS),
        overruns: page.load64(header::OVERRUNS),
        allocations: page.load64(header::ALLOCATIONS),
        substitutes: page.load64(header::SUBSTITUTES),
        promotions: page.load64(header::PROMOTIONS),
        shares_missing: missing,
        wakeup,
        looping,
        motion,
    }
}

/// Looks at all slots of a station.
pub fn look(viewer: &mut Viewer) -> Look {
    let holders = [Role::Tissue, Role::Fluid].map(|role| viewer.holder(role));
    let mut look = Look { holder: holders[0], ..Look::default() };
    let selected = viewer.slot_page(Slot::first(Role::Device)).map_or(0, |page| page.load64(device::SELECTED_INCARNATION) as u32);
    for slot in (0..SLOTS).filter_map(Slot::from_number) {
        let pid = viewer.page().pid(slot);
        if pid == 0 {
            continue;
        }
        let time_s = proc::processor_s(pid).unwrap_or(0.0);
        look.processes.entry(pid).or_insert((slot.to_string(), time_s, system::now_ns()));
        let Some(page) = viewer.slot_page(slot) else { continue };
        look.engines.insert(slot, pid);
        look.active.insert(slot, page.incarnation() == selected || holders.contains(&page.incarnation()));
        look.counts.insert(slot, count(page, slot));
        if slot.role() == Role::Hardware {
            page.load64s(TOTALS, &mut look.ledger);
        }
        if slot.role() == Role::Tissue && page.incarnation() == look.holder {
            look.tissue_step_ticks = page.cell(tissue::STATUS).map_or(0, |(_, status)| status.step_ticks);
        }
    }
    look
}

/// `tissue:active` and `tissue:spare` for roles with a spare, else the slot's name.
fn name_of(slot: Slot, active: bool) -> String {
    let role = slot.role();
    if role.is_replicated() { format!("{}:{}", role.name(), if active { "active" } else { "spare" }) } else { slot.to_string() }
}

fn difference(after: &[u64], before: &[u64]) -> Vec<u64> {
    after.iter().zip(before).map(|(after, before)| after.saturating_sub(*before)).collect()
}

fn spell(before: &Count, after: &Count) -> Spell {
    Spell {
        seconds: (after.at_ns - before.at_ns) as f64 * 1e-9,
        stepping_s: after.beat_ns.saturating_sub(before.beat_ns) as f64 * 1e-9,
        steps: Some(after.steps.saturating_sub(before.steps)),
        overruns: after.overruns.saturating_sub(before.overruns),
        allocations: after.allocations.saturating_sub(before.allocations),
        substitutes: after.substitutes.saturating_sub(before.substitutes),
        promotions: after.promotions.saturating_sub(before.promotions),
        shares_missing: after.shares_missing.saturating_sub(before.shares_missing),
        wakeup: difference(&after.wakeup, &before.wakeup),
        looping: difference(&after.looping, &before.looping),
        motion: difference(&after.motion, &before.motion),
        ..Spell::default()
    }
}

/// What happened between two looks. The memory is read now.
pub fn window(viewer: &mut Viewer, before: &Look, after: &Look) -> Window {
    let tissue_step_ticks = after.tissue_step_ticks;
    let mut window = Window { quiet: before.holder == after.holder, tissue_step_ticks, ..Window::default() };
    for (sum, [after, before]) in window.ledger.iter_mut().zip(after.ledger.iter().zip(&before.ledger).map(|(a, b)| [a, b])) {
        *sum = after.saturating_sub(*before);
    }
    for (slot, count) in &after.counts {
        let Some(first) = before.counts.get(slot).filter(|first| first.incarnation == count.incarnation) else {
            window.quiet = false;
            continue;
        };
        let mut spell = spell(first, count);
        if let Some(page) = viewer.slot_page(*slot) {
            spell.real_time = page.load64(header::REAL_TIME) & 1 != 0;
            if slot.role() == Role::Rendering {
                let drawn = page.cell(rendering::STATUS).filter(|(_, status)| status.frames > 0);
                spell.picture = drawn.map(|(_, status)| status);
            }
            if slot.role() == Role::Fluid {
                spell.halvings = page.cell(fluid::STATUS).map(|(_, status)| status.halvings);
            }
        }
        window.spells.insert(name_of(*slot, before.active.get(slot) == Some(&true)), spell);
    }
    for (pid, (first_slot, time_s, at_ns)) in &after.processes {
        let Some((_, before_s, before_ns)) = before.processes.get(pid) else { continue };
        let resident_mib = proc::resident_mib(*pid).unwrap_or(0.0);
        window.resident_mib += resident_mib;
        window.proportional_mib += proc::proportional_mib(*pid).unwrap_or(0.0);
        let engines: Vec<Slot> = after.engines.iter().filter(|(_, of)| *of == pid).map(|(slot, _)| *slot).collect();
        let name = match engines.as_slice() {
            [] => first_slot.clone(),
            [slot] => name_of(*slot, before.active.get(slot) == Some(&true)),
            _ => "process".to_string(),
        };
        let spell = window.spells.entry(name).or_default();
        spell.seconds = if spell.steps.is_some() { spell.seconds } else { (at_ns - before_ns) as f64 * 1e-9 };
        spell.processor_s = Some(time_s - before_s);
        spell.resident_mib = Some(resident_mib);
    }
    window
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spell_is_what_was_counted_between_two_looks() {
        let before = Count { at_ns: 1_000_000_000, steps: 10, allocations: 3, looping: vec![5, 0], ..Count::default() };
        let after = Count { at_ns: 3_000_000_000, steps: 2_010, allocations: 3, looping: vec![7, 1_998], ..before.clone() };
        let spell = spell(&before, &after);
        assert_eq!((spell.rate_hz(), spell.allocations, spell.looping), (Some(1_000.0), 0, vec![2, 1_998]));
        assert_eq!(Spell::default().rate_hz(), None);
    }

    #[test]
    fn a_window_that_cuts_through_steps_has_the_rate_of_the_steps_and_one_of_an_engine_that_stopped_has_not() {
        let rate_hz = |steps: u64, stepping_s: f64| {
            let spell = Spell { seconds: 2.0, steps: Some(steps), stepping_s, ..Spell::default() };
            spell.rate_hz().unwrap()
        };
        assert!((rate_hz(60, 60.0 * 0.033) - 1.0 / 0.033).abs() < 1e-9, "steps of 33 ms, none skipped");
        assert!((rate_hz(59, 59.0 * 0.033) - 1.0 / 0.033).abs() < 1e-9, "the last one was late");
        assert!(rate_hz(59, 60.0 * 0.033) < 30.0, "one was skipped");
        assert_eq!(rate_hz(30, 30.0 * 0.033), 15.0, "it stood for the second half");
    }
}
