//! The report of a run, as JSON whose keys stay what they are, and the statistics of its faults.
//!
//! The supervisor hands it over in a file in the station's root once a second and at the end; the guardian adds what is left over after
//! everything has stopped, with the bounds of the excess and what promises were broken, and writes it where the user wants it.

mod arms;
mod promises;
mod swaps;

use crate::accounts::{Account, Accounts, Counters};
use crate::fault::Fault;
use crate::faults::Faults;
use crate::policy::State;
use crate::view::Viewer;
use arms::Arms;
use hyst_exchange::{Station, whole};
use hyst_messages::page::hardware::Total;
use hyst_messages::page::{device, fluid, rendering, tissue};
use hyst_messages::{Role, Slot, percentile_ns};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// The key under which stands what was broken.
pub(crate) const BROKEN: &str = "promises_broken";
/// Broken promises that are said one by one.
const MOST_SAID: usize = 8;

/// Leaves the report for the guardian.
pub fn hand_over(station: &Station, report: &Value) {
    let _ = whole::write(&station.report(), report.to_string().as_bytes()); // tried again in a second
}

/// The report that the supervisor handed over last, with the bounds of the excess and what promises were broken; one of nothing if there is none.
pub fn take(station: &Station) -> Value {
    let text = std::fs::read_to_string(station.report()).unwrap_or_default();
    let handed = serde_json::from_str::<Value>(&text).ok().filter(Value::is_object);
    let mut report = handed.unwrap_or_else(|| json!({}));
    arms::bound_all(&mut report);
    report[BROKEN] = json!(promises::broken(&report));
    report
}

/// p50, p99, p99.9 and the last bucket of a histogram in µs.
pub fn latency(counts: &[u64]) -> Value {
    let us = |fraction| percentile_ns(counts, fraction) as f64 * 1e-3;
    json!({ "p50": us(0.5), "p99": us(0.99), "p999": us(0.999), "max": us(1.0) })
}

fn process(account: &Account) -> Value {
    let total = account.total();
    let per_s = |value: f64| {
        if total.ready_s > 0.0 { value / total.ready_s } else { 0.0 }
    };
    json!({
        "rate_hz": per_s(total.ready_steps as f64),
        "cpu_percent": 100.0 * per_s(total.processor_s),
        "steps": total.steps,
        "overruns": total.overruns,
        "incarnations": account.incarnations,
        "wakeup_us": latency(&total.wakeup),
        "loop_us": latency(&total.looping),
        "rss_mib": account.resident_mib,
        "pss_mib": account.proportional_mib,
        "suspected": { "times": account.suspicions[0], "cleared": account.suspicions[1], "most_us": account.cleared_ns as f64 * 1e-3 },
        "refused": { "invalid": total.refused[0], "stale": total.refused[1], "frozen": total.refused[2] },
        "substitutes": total.substitutes,
        "left_periods": total.left,
        "promotions": total.promotions,
        "allocations": total.allocations,
        "pool_blocks": total.pool_blocks,
    })
}

/// The report as of now.
pub fn build(viewer: &mut Viewer, accounts: &Accounts, faults: &Faults, policy: &State) -> Value {
    let mut processes: Map<String, Value> =
        accounts.slots.iter().map(|(name, account)| (name.clone(), process(account))).collect();
    for role in Role::REPLICATED {
        let active = active_slot(viewer, faults, role);
        if let Some(row) = active.and_then(|slot| processes.get(&slot.to_string())).cloned() {
            processes.insert(role.name().into(), row);
        }
    }
    let status = Statuses::read(viewer);
    let ((not_injected, first), (swaps, left_out)) = (faults.not_injected(), faults.swaps_asked());
    json!({
        "processes": processes,
        "device": device(faults, withheld_ticks(viewer)),
        "faults": faults.all().map(|fault| serde_json::to_value(fault).unwrap_or_default()).collect::<Vec<_>>(),
        "faults_not_injected": { "count": not_injected, "first": first },
        "by_target": by_target(faults),
        "swaps": swaps,
        "swaps_left_out": left_out,
        "invalid_applied": faults.ledger.invalid_applied,
        "stale_applied": faults.ledger.stale_applied,
        "ledger_lost": faults.ledger.lost,
        "force_trace_hash": hash(total(faults, Total::TraceHash)),
        "state_hash": hash(status.state_hash),
        "fluid_state_hash": hash(status.fluid_hash),
        "fluid_deficit_ml": status.deficit_ml,
        "fluid_bled_ml": status.bled_ml,
        "fluid_open_vessels": status.open_vessels,
        "fluid_sealed_vessels": status.sealed_vessels,
        "removed_volume_ml": status.removed_volume_ml,
        "healthy_removed_ml": status.healthy_removed_ml,
        "washed_out": status.washed_out,
        "washed_out_ml": status.washed_out_ml,
        "taken_out": status.taken_out,
        "taken_out_ml": status.taken_out_ml,
        "cuts": status.cuts,
        "cut_limits": status.cut_limits,
        "corrections": status.corrections,
        "rss_mib": accounts.slots.values().map(|account| account.resident_mib).sum::<f64>(),
        "pss_mib": accounts.slots.values().map(|account| account.proportional_mib).sum::<f64>(),
        "copies": copies(accounts, &status),
        "given_up": policy.given_up().map(|slot| slot.to_string()).collect::<Vec<_>>(),
        "held": policy.held().map(Role::name).collect::<Vec<_>>(),
        "leftovers": { "processes": 0, "shared_memory": 0, "files": 0 },
    })
}

fn active_slot(viewer: &mut Viewer, faults: &Faults, role: Role) -> Option<Slot> {
    let incarnation = faults.active_incarnation(role);
    (0..role.slots().1).filter_map(|index| Slot::new(role, index)).find(|slot| viewer.page().incarnation(*slot) == incarnation)
}

fn hash(value: u64) -> String {
    format!("{value:016x}")
}

fn total(faults: &Faults, total: Total) -> u64 {
    faults.ledger.totals[total as usize]
}

/// Ticks at which the present device has applied a share of the chosen force only, for the energy that it would have given.
fn withheld_ticks(viewer: &mut Viewer) -> u64 {
    viewer.slot_page(Slot::first(Role::Device)).map_or(0, |page| page.load64(device::WITHHELD_TICKS))
}

fn device(faults: &Faults, withheld_ticks: u64) -> Value {
    let arms = Arms::of(faults.closed.iter().filter(|fault| !fault.may_be_felt()));
    let own = Arms::of(faults.closed.iter().filter(|fault| fault.target == Role::Device.name()));
    json!({
        "ticks": total(faults, Total::Ticks),
        "fresh": total(faults, Total::Fresh),
        "held": total(faults, Total::Held),
        "ramped": total(faults, Total::Ramped),
        "zero": total(faults, Total::Zero),
        "voided": total(faults, Total::Void),
        "withheld": withheld_ticks,
        "fault_window": arm(arms.fault),
        "control_window": arm(arms.control),
        "controls_shared": faults.closed.iter().filter(|fault| fault.control_shared).count(),
        "controls_unlike": faults.closed.iter().filter(|fault| fault.control_unlike).count(),
        "excess_per_fault": arms.excess(),
        "force_step_max_n": arms.step_n,
        "force_step_max_control_n": arms.control_step_n,
        "own_faults": { "count": own.excesses.len(), "excess_per_fault": own.excess() },
    })
}

/// One arm: what counted, what missed, and the share that is void because the host stalled.
fn arm([ticks, missed, voided]: [u64; 3]) -> Value {
    let void_share = voided as f64 / ((ticks + voided) as f64).max(1.0);
    json!({ "ticks": ticks, "missed": missed, "voided": voided, "void_share": void_share })
}

fn by_target(faults: &Faults) -> Value {
    let mut groups: BTreeMap<String, Vec<&Fault>> = BTreeMap::new();
    for fault in &faults.closed {
        let role = Role::name_in(&fault.target);
        let indexed = Role::from_name(role).is_some_and(Role::is_indexed) && role != Role::CollisionWorker.name();
        let name = match (indexed, fault.active) {
            (false, _) => role.to_string(),
            (true, true) => format!("{role}:active"),
            (true, false) => format!("{role}:spare"),
        };
        groups.entry(name).or_default().push(fault);
    }
    let row = |group: &Vec<&Fault>| {
        let recovered: Vec<f64> = group.iter().filter_map(|fault| fault.recovered_us).collect();
        let mut excess = Arms::of(group.iter().copied()).excess();
        if let Some(object) = excess.as_object_mut() {
            object.insert("count".into(), json!(group.len()));
            object.insert("recovered".into(), json!(recovered.len()));
            object.insert("recovered_us_mean".into(), json!(recovered.iter().sum::<f64>() / (recovered.len() as f64).max(1.0)));
        }
        excess
    };
    Value::Object(groups.iter().map(|(name, group)| (name.clone(), row(group))).collect())
}

/// Whether a report that was taken shows a promise that is broken beyond doubt, or a force applied that must not be.
pub fn is_broken(report: &Value) -> bool {
    report[BROKEN].as_array().is_some_and(|all| !all.is_empty())
}

/// What was broken, in lines for people: the first of it, and how much more there is.
pub fn broken(report: &Value) -> Vec<String> {
    let all: Vec<&str> = report[BROKEN].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let more = all.len().saturating_sub(MOST_SAID);
    let rest = (more > 0).then(|| format!("and {more} more, under {BROKEN} of the report"));
    all.into_iter().take(MOST_SAID).map(|what| format!("a promise was broken: {what}")).chain(rest).collect()
}

/// One line for people.
pub fn summary(report: &Value) -> String {
    let device = &report["device"];
    if !device.is_object() {
        return "no supervisor has lived long enough to report anything".into();
    }
    let excess = &device["excess_per_fault"];
    let count = report["faults"].as_array().map_or(0, Vec::len);
    let misses = match excess["upper95"].as_f64() {
        _ if count == 0 => String::new(),
        Some(upper95) => format!(
            ", {} judged: {} lost more ticks than their controls and {} fewer, per fault {:.3} (one-sided 95 % bound {upper95:.3})",
            excess["faults"],
            excess["faults_with_excess"],
            excess["faults_with_fewer"],
            excess["mean"].as_f64().unwrap_or(0.0)
        ),
        None => ", none of them judged".into(),
    };
    let s = if count == 1 { "" } else { "s" };
    let left = match report["faults_not_injected"]["count"].as_u64().unwrap_or(0) {
        0 => String::new(),
        left => format!("; {left} of those asked for did not come about, see the report"),
    };
    let swaps = swaps::in_words(report);
    format!(
        "{} ticks: {} fresh, {} held, {} ramped, {} void; {count} fault{s}{misses}{left}{swaps}",
        device["ticks"], device["fresh"], device["held"], device["ramped"], device["voided"]
    )
}

/// Whether a process was lost for good, or a role is held still.
pub fn has_lost(report: &Value) -> bool {
    let any = |key: &str| report.get(key).and_then(Value::as_array).is_some_and(|all| !all.is_empty());
    any("given_up") || any("held")
}

#[derive(Clone, Copy, Debug, Default)]
struct Statuses {
    state_hash: u64,
    fluid_hash: u64,
    removed_volume_ml: f64,
    healthy_removed_ml: f64,
    cuts: u32,
    cut_limits: u32,
    corrections: u32,
    washed_out: u32,
    washed_out_ml: f32,
    taken_out: u32,
    taken_out_ml: f32,
    deficit_ml: f64,
    bled_ml: f64,
    open_vessels: u32,
    sealed_vessels: u32,
    copied_per_frame: Option<u64>,
}

impl Statuses {
    /// The newest status of tissue, fluid and rendering, of whoever is heard.
    fn read(viewer: &mut Viewer) -> Statuses {
        let mut found = Statuses::default();
        let (mut tissue_tick, mut fluid_key) = (0, (0, 0));
        for slot in heard(viewer, Role::Tissue) {
            let status = viewer.slot_page(slot).and_then(|page| page.cell(tissue::STATUS));
            if let Some((_, status)) = status.filter(|(_, status)| status.state_tick >= tissue_tick) {
                tissue_tick = status.state_tick;
                found.state_hash = status.state_hash;
                (found.removed_volume_ml, found.cuts) = (status.removed_volume_ml, status.cuts);
                found.healthy_removed_ml = status.healthy_removed_ml;
                (found.cut_limits, found.corrections) = (status.cut_limits, status.corrections);
                (found.washed_out, found.washed_out_ml) = (status.washed_out, status.washed_out_ml);
                (found.taken_out, found.taken_out_ml) = (status.taken_out, status.taken_out_ml);
            }
        }
        for slot in heard(viewer, Role::Fluid) {
            let status = viewer.slot_page(slot).and_then(|page| page.cell(fluid::STATUS));
            if let Some((_, status)) = status.filter(|(_, status)| (status.epoch, status.state_tick) >= fluid_key) {
                fluid_key = (status.epoch, status.state_tick);
                (found.deficit_ml, found.bled_ml) = (status.deficit_ml, status.bled_ml);
                (found.open_vessels, found.sealed_vessels) = (status.open_vessels, status.sealed_vessels);
                found.fluid_hash = status.state_hash;
            }
        }
        let status = viewer.slot_page(Slot::first(Role::Rendering)).and_then(|page| page.cell(rendering::STATUS));
        found.copied_per_frame = status.map(|(_, status)| status.copied_bytes);
        found
    }
}

/// The slots of a role whose word counts: its places, and last, so that it counts beside one as new, the guest's while it has the role in the midst of a
/// swap. A guest that only tries, or was sent away, may have said anything.
fn heard(viewer: &Viewer, role: Role) -> Vec<Slot> {
    let has_role = |slot: Slot| viewer.page().incarnation(slot) == viewer.holder(role);
    let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
    slots.filter(|slot| !slot.is_guest() || has_role(*slot)).collect()
}

fn copies(accounts: &Accounts, status: &Statuses) -> Value {
    let mut sum = Counters::default();
    for account in accounts.slots.values() {
        let total = account.total();
        sum.bytes[0] = sum.bytes[0].saturating_add(total.bytes[0]); // whatever a damaged page says
        sum.bytes[1] = sum.bytes[1].saturating_add(total.bytes[1]);
    }
    json!({ "bytes_per_frame": status.copied_per_frame.unwrap_or(0), "stream_bytes": sum.bytes[0], "copied_bytes": sum.bytes[1] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::{begin, book};
    use crate::ledger::Window;
    use hyst_exchange::{OwnedPage, Roster};
    use hyst_messages::{FluidStatus, TissueStatus};

    fn window(force_step_max_n: f64) -> Option<Window> {
        Some(Window { ticks: 200, force_step_max_n, ..Window::default() })
    }

    /// A report of a station that ended in the midst of a swap had what the engines of before said: the guest, who had the role, was not asked.
    #[test]
    fn a_guest_is_heard_while_it_has_the_role_and_not_before_or_after() {
        let (station, _faults) = book("report-guest");
        let (page, roster) = (station.open_for_keeping().unwrap(), Roster::open(&station).unwrap());
        let slots = |role: Role| [Slot::first(role), Slot::guest(role).unwrap()];
        let tissues = slots(Role::Tissue).into_iter().zip([5, 6]).map(|(slot, life)| begin(&station, &page, slot, life));
        let fluids = slots(Role::Fluid).into_iter().zip([7, 8]).map(|(slot, life)| begin(&station, &page, slot, life));
        let (tissues, fluids): (Vec<OwnedPage>, Vec<OwnedPage>) = (tissues.collect(), fluids.collect());
        for (index, state_tick) in [(0, 40), (1, 60)] {
            let (cuts, epoch) = (state_tick as u32, 1);
            tissues[index].write(tissue::STATUS, &TissueStatus { state_tick, cuts, ..TissueStatus::default() });
            let deficit_ml = state_tick as f64;
            fluids[index].write(fluid::STATUS, &FluidStatus { state_tick, epoch, deficit_ml, ..FluidStatus::default() });
        }
        let mut viewer = Viewer::open(&station).unwrap();
        let mut told = || {
            let status = Statuses::read(&mut viewer);
            (status.cuts, status.deficit_ml)
        };
        let hand_on = |role: Role, life: u32| roster.promote(role, roster.holder(role), life).unwrap();
        let mut seen = Vec::new();
        for lives in [[5, 7], [6, 8], [5, 7]] {
            Role::STATEFUL.into_iter().zip(lives).for_each(|(role, life)| assert_eq!(hand_on(role, life).incarnation, life));
            seen.push(told());
        }
        assert_eq!(seen, [(40, 40.0), (60, 60.0), (40, 40.0)]);
    }

    /// Of most of what a run says of itself it was written nowhere what it is.
    #[test]
    fn the_handbook_has_each_key_of_a_runs_report() {
        let handbook = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/handbook.md")).unwrap();
        let (_, section) = handbook.split_once("#### The keys of a run's report").unwrap();
        let (section, _) = section.split_once("\n### ").unwrap();
        let (station, faults) = book("report-keys");
        let mut viewer = Viewer::open(&station).unwrap();
        hand_over(&station, &build(&mut viewer, &Accounts::default(), &faults, &State::new(&[])));
        let report = take(&station);
        for part in [&report, &report["device"], &process(&Account::default())] {
            let keys = part.as_object().unwrap().keys();
            let unsaid: Vec<&String> = keys.filter(|key| !section.contains(&format!("`{key}`"))).collect();
            assert!(unsaid.is_empty(), "the handbook does not say what is {unsaid:?}");
        }
    }

    /// "excess misses per fault 0.000 (95 %: below 0.000)" was said of two faults.
    #[test]
    fn the_report_that_is_taken_has_bounds_and_its_line_says_them() {
        let station = Station::named(&format!("t{}-report", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let fault = Fault { target: "haptic:0".into(), window: window(0.0), control: window(0.0), ..Fault::default() };
        let said = |faults: &[Fault]| {
            let device = json!({ "excess_per_fault": Arms::of(faults.iter()).excess() });
            hand_over(&station, &json!({ "device": device, "faults": faults }));
            summary(&take(&station))
        };
        let lines = [said(&[fault.clone(), fault.clone()]), said(&[Fault { control: None, ..fault }])];
        let taken = [json!({ "stale_applied": 0 }), json!({ "stale_applied": 3 }), json!([])].map(|handed| {
            hand_over(&station, &handed);
            let report = take(&station);
            (is_broken(&report), broken(&report))
        });
        station.wipe();
        assert_eq!(taken[0], (false, vec![]));
        assert_eq!(taken[1], (true, vec!["a promise was broken: 3 stale forces were applied".to_string()]));
        assert_eq!(taken[2], taken[0], "what is no report says nothing");
        let many = broken(&json!({ BROKEN: vec!["force"; MOST_SAID + 2] }));
        assert_eq!((many.len(), many[MOST_SAID].as_str()), (MOST_SAID + 1, "and 2 more, under promises_broken of the report"));
        assert!(lines[0].contains("2 faults, 2 judged: 0 lost more ticks than their controls and 0 fewer"), "{lines:?}");
        assert!(lines[0].contains("per fault 0.000 (one-sided 95 % bound 0.779)"), "{lines:?}");
        assert!(lines[1].contains("1 fault, none of them judged"), "{lines:?}");
    }
}
