//! `tissue bench tissue|contact [--mesh FILE] [--json]`: times the parts of a Main Loop step on one core, outside of any station.
//!
//! `tissue` gives a row for each instruction set, one for a cut by a straight wire, with all that is made anew for it in an open cavity (`whole`) and in one
//! that is shut (`whole_shut`), and one for a cut by the station's loop, at rest (`whole`) and in tissue that is bent (`whole_bent`); `contact` one for the
//! scene's tool and one for a tool of 1 000 points. Without a mesh the paper's three scenes follow ([`paper`]), and for `tissue` blocks from 1 080 to
//! 50 400 tets ([`linear`]), and those that other libraries are given with as few substeps as they have ([`equal`]). Targets are rows too, and a missed one is
//! exit code 1. `limit_ratio` is the time over that of reading every tet's corners once (once a substep for the deformation; a test that remembers which are
//! near looks at all of them in few steps); of the deformation `arithmetic` has the same for its operations ([`limit`]). `speedup` has the intersection test on
//! two threads, and beside it what two independent copies reach on this machine; `speedup_of_search` the same of a search through all tets in each step.

mod equal;
mod felt;
#[cfg(test)]
mod foreign;
#[cfg(test)]
mod hertz;
mod knife;
mod limit;
mod linear;
mod paper;
mod peer;
mod press;
mod strokes;

use hyst_engine::bench::{finish, quantile_ns, request, spread, target, unjudged, usual_ns};
use hyst_scene::{LoadedScene, collision_points};
use hyst_tissue::Isa;
use peer::{Peer, Took};
use press::{DEFORMATION, INTERSECTION, PHASES, Press, Record};
use serde_json::{Map, Value, json};
use std::process::ExitCode;

/// Longest time of one run, ns: the runs of a benchmark and the making of their models end within 80 s.
const RUN_NS: u64 = 2_000_000_000;
/// And of one beside which a peer does the same.
const PEER_NS: u64 = 2 * RUN_NS;
/// Points of the second tool: those of the comparison with other libraries.
const MANY_POINTS: u32 = 1_000;
/// Threads of the comparison.
const THREADS: usize = 2;
const US: f64 = 1e3;
/// How far from the converged solution force and displacement may be, as a share of its largest.
const MOST_APART: f64 = 0.05;
/// How many times as fast as a peer's bounding volumes the test is to be.
const LEAST_RATIO: f64 = 3.0;
/// How many times as fine the converged solution is, how many times as stiff the contacts beside which it is seen what they give way, and ticks of the hand
/// `press`, which has gone in by then.
const FINER: u32 = 4;
const STIFFER: f32 = 10.0;
const TRUTH_TICKS: usize = 1_000;
/// Longest cut with all that is made anew for it, ms: a tick.
const MOST_CUT_MS: f64 = 1.0;
/// What the targets for cuts say of what cuts: a straight wire, and the station's loop.
const BY_WIRE: &str = "with all that is made anew";
const BY_LOOP: &str = "by the station's loop";
/// Where other libraries are timed beside this one, and what is said where none does the same.
const PEERS: &str = "see tests/peers/beside.py";
const NO_PEERS: &str = "none is measured";

/// Runs the benchmark that the arguments name.
pub fn run(arguments: impl Iterator<Item = String>) -> ExitCode {
    let request = match request(arguments, &["tissue", "contact"], true) {
        Ok(request) => request,
        Err(error) => return finish("tissue", false, Err(error)),
    };
    let scene = crate::world::load_scene(request.mesh.as_deref()).map_err(|error| error.to_string());
    let is_tissue = request.what == "tissue";
    let rows = scene.and_then(|scene| {
        let mut rows = if is_tissue { tissue(&scene)? } else { contact(scene.clone())? };
        if request.mesh.is_none() {
            rows.extend(if is_tissue { paper::steps()? } else { paper::intersections()? });
            rows.extend(if is_tissue { [linear::rows(&scene)?, equal::rows(&scene)?].concat() } else { Vec::new() });
        }
        Ok(rows)
    });
    finish("tissue", request.json, rows)
}

/// Most time per tet and substep, ns, with the widest registers of this machine.
fn most_ns_per_tet(isa: Isa) -> Option<f64> {
    match isa {
        Isa::Baseline => None,
        Isa::Avx2 => Some(11.0),
        Isa::Avx512 => Some(8.0),
    }
}

fn tissue(scene: &LoadedScene) -> Result<Vec<Value>, String> {
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
        let mut press = Press::new(scene, isa, 1)?;
        let record = press.run(RUN_NS)?;
        let deformation_ns = quantile_ns(&mut record.phases_ns[DEFORMATION].clone(), 0.5);
        let tets = press.tets() as f64;
        let substeps = f64::from(record.substeps.max(1));
        let mut steps_ns = record.steps_ns(|_| true);
        let mut row = json!({
            "method": format!("explicit corotational, {}", isa.name()),
            "substeps": record.substeps,
            "ns_per_tet": quantile_ns(&mut steps_ns, 0.5) / tets,
            "ns_per_tet_and_substep": deformation_ns / tets / substeps,
            "limit_ratio": deformation_ns / (substeps * press.pass_ns() as f64),
            "speedup": { "1": 1.0 },
        });
        row["arithmetic"] = limit::arithmetic(isa, substeps, deformation_ns / tets / substeps);
        complete(&mut row, scene, &press, &record, |_| true);
        if isa == Isa::detect() {
            row["speedup"] = speedup(scene, Press::new, |_| true)?;
            let most_ns = most_ns_per_tet(isa);
            let value = row["ns_per_tet_and_substep"].as_f64().unwrap_or(f64::NAN);
            let name = format!("deformation with {}, ns per tet and substep", isa.name());
            targets.extend(most_ns.map(|most_ns| target(&name, value, most_ns, false)));
        }
        rows.push(row);
    }
    let (row, of_cuts) = knife(scene)?;
    rows.push(row);
    targets.extend(of_cuts);
    if let Some((row, of_cuts)) = electrode(scene)? {
        rows.push(row);
        targets.extend(of_cuts);
    }
    let truth = truth(scene)?;
    targets.extend(is_near(&truth));
    rows.push(truth);
    rows.push(softness(scene)?);
    rows.extend(targets);
    Ok(rows)
}

/// A row for how far the settings are from the solution that is converged in time.
fn truth(scene: &LoadedScene) -> Result<Value, String> {
    let method = format!("beside steps {FINER} times as short, without added mass");
    apart(scene, &method, || felt::apart(scene, [1, FINER], TRUTH_TICKS))
}

/// Rows for whether the force on the tool, what of it the hand is told and the displacement are near enough to those of the converged solution. A hand that
/// meets nothing shows none.
fn is_near(truth: &Value) -> [Value; 3] {
    ["force_apart", "told_apart", "displacement_apart"].map(|key| {
        let name = format!("{}, share of the largest", key.replace('_', " "));
        match truth[key].as_f64() {
            Some(share) => target(&name, share, MOST_APART, false),
            None => unjudged(&name, MOST_APART, false),
        }
    })
}

/// A row for what the contact gives way by itself: how far the force is from that of a contact which gives way next to nothing. It has no target: what is
/// said of convergence is said of the tissue, with the contact as it is.
fn softness(scene: &LoadedScene) -> Result<Value, String> {
    let method = format!("contacts beside such as are {STIFFER} times as stiff, both in steps {FINER} times as short");
    apart(scene, &method, || felt::softness(scene, FINER, STIFFER, TRUTH_TICKS))
}

/// A row for how far two runs are apart.
fn apart(scene: &LoadedScene, method: &str, runs: impl Fn() -> Result<felt::Apart, String>) -> Result<Value, String> {
    let begun_ns = hyst_exchange::system::now_ns();
    let apart = runs()?;
    let step_ns = (hyst_exchange::system::now_ns() - begun_ns) / TRUTH_TICKS as u64;
    Ok(json!({
        "scene": scene.scene.name,
        "method": method,
        "steps": TRUTH_TICKS,
        "step_us": spread(&mut [step_ns], US),
        "force_apart": apart.force,
        "told_apart": apart.told,
        "displacement_apart": apart.displacement,
        "force_max_n": apart.most_n,
        "told_max_n": apart.most_told_n,
        "displacement_max_m": apart.most_m,
        "peers": {},
        "peers_note": NO_PEERS,
    }))
}

/// A row for a cut by a straight wire: the step is a tick in which the wire moves. And whether cuts take no more than a tick with all that the Main Loop makes
/// anew for them.
fn knife(scene: &LoadedScene) -> Result<(Value, [Value; 2]), String> {
    let pass_ns = Press::new(scene, Isa::detect(), 1)?.pass_ns();
    let mut knife = knife::draw(scene, Isa::detect())?;
    let all_ns = |times: &[u64]| times.iter().sum::<u64>() as f64;
    let (cut_ns, model_ns, topology_ns) = (all_ns(&knife.cut_ns), all_ns(&knife.model_ns), all_ns(&knife.topology_ns));
    let sum_ns = (cut_ns + model_ns + topology_ns).max(1.0);
    let (ticks, changes, tets) = (knife.cut_ns.len(), knife.model_ns.len(), knife.tets[0]);
    let (whole, targets) = cuts(scene, &strokes::PLACES, MOST_CUT_MS, false)?;
    let (whole_shut, _) = cuts(scene, &strokes::PLACES, MOST_CUT_MS, true)?;
    let row = json!({
        "scene": scene.scene.name,
        "method": "a wire drawn through the pathology at 0.2 m/s",
        "tets": tets,
        "tets_after": knife.tets[1],
        "parts": knife.parts,
        "steps": ticks,
        "changes": changes,
        "step_us": spread(&mut knife.cut_ns, US),
        "ns_per_tet": cut_ns / (ticks * tets).max(1) as f64,
        "limit_ratio": cut_ns / ticks.max(1) as f64 / pass_ns as f64,
        "model_us": spread(&mut knife.model_ns, US),
        "topology_us": spread(&mut knife.topology_ns, US),
        "whole": whole,
        "whole_shut": whole_shut,
        "share": { "cut": cut_ns / sum_ns, "model": model_ns / sum_ns, "topology": topology_ns / sum_ns },
        "speedup": { "1": 1.0 },
        "peers": {},
        "peers_note": NO_PEERS,
    });
    Ok((row, targets))
}

/// A row for a cut by the station's loop, and whether it takes no more than a tick; `None` of a scene without a loop. What is judged is the tissue at rest. How
/// it is bent depends on the hand, and the one that presses does it elsewhere: that shows whether it makes a difference, and has no target.
fn electrode(scene: &LoadedScene) -> Result<Option<(Value, [Value; 2])>, String> {
    let turns_deg = &strokes::TURNS_DEG;
    let Some((whole, targets)) = cuts_by_loop(scene, turns_deg, MOST_CUT_MS, None)? else { return Ok(None) };
    let mut whole_bent = None;
    if scene.hand("press").is_some() {
        let bent_m = knife::pressed_m(scene, Isa::detect(), TRUTH_TICKS)?;
        whole_bent = cuts_by_loop(scene, turns_deg, MOST_CUT_MS, Some(&bent_m[..]))?.map(|(whole_bent, _)| whole_bent);
    }
    let hand = strokes::cutting_hand(scene).map(|hand| hand.name.as_str());
    let way = if hand.is_some() { "as the hand cuts with it" } else { "through the middle of the pathology" };
    let row = json!({
        "scene": scene.scene.name,
        "method": format!("the station's loop drawn {way}, tissue at rest (whole_bent: bent by the hand press)"),
        "hand": hand.unwrap_or("none that cuts"),
        "tets": tets(scene),
        "strokes": turns_deg.len(),
        "whole": whole,
        "whole_bent": whole_bent,
        "speedup": { "1": 1.0 },
        "peers": {},
        "peers_note": NO_PEERS,
    });
    Ok(Some((row, targets)))
}

/// Tets of all objects of a scene.
fn tets(scene: &LoadedScene) -> usize {
    scene.objects.iter().map(|object| object.mesh.tets.len()).sum()
}

/// Cuts by a straight wire as the Main Loop makes them, with all that is made anew for them, in strokes through some places, as [`judged`] tells them. In a
/// cavity that is shut also what holds it so is made, where it closes.
fn cuts(scene: &LoadedScene, places: &[f32], most_ms: f64, is_shut: bool) -> Result<(Value, [Value; 2]), String> {
    Ok(judged(scene, BY_WIRE, knife::whole(scene, Isa::detect(), places, is_shut)?, most_ms))
}

/// The same by the station's loop, in a stroke for each turn, at rest or where the tissue was bent to; `None` of a scene without a loop.
fn cuts_by_loop(
    scene: &LoadedScene,
    turns_deg: &[f32],
    most_ms: f64,
    bent_m: Option<&[[f32; 3]]>,
) -> Result<Option<(Value, [Value; 2])>, String> {
    let cuts = knife::by_loop(scene, Isa::detect(), turns_deg, bent_m)?;
    Ok(cuts.map(|cuts| judged(scene, BY_LOOP, cuts, most_ms)))
}

/// Cuts as they are told: how long they take, and of each stage half of them, how many there are, how many were refused, and of how many triangles a sweep
/// is. And whether half of them, and 95 of 100, take no longer than they may.
fn judged(scene: &LoadedScene, what: &str, cuts: knife::Cuts, most_ms: f64) -> (Value, [Value; 2]) {
    let tets = tets(scene);
    let knife::Cuts { whole_ns: mut times_ns, mut stages_ns, refused, swept_triangles } = cuts;
    let stage = |(name, times_ns): (&str, &mut Vec<u64>)| (name.to_owned(), json!(quantile_ns(times_ns, 0.5) / US));
    let stages_us: Map<String, Value> = knife::STAGES.into_iter().zip(&mut stages_ns).map(stage).collect();
    let mut us = spread(&mut times_ns, US);
    us["p95"] = json!(quantile_ns(&mut times_ns, 0.95) / US);
    let targets = [("of half of them", 0.5), ("of 95 in 100", 0.95)].map(|(of, share)| {
        // Without a cut nothing is shown.
        let whole_ms = if times_ns.is_empty() { f64::NAN } else { quantile_ns(&mut times_ns, share) / 1e6 };
        target(&format!("a cut of {tets} tets {what}, ms, {of}"), whole_ms, most_ms, false)
    });
    let count = times_ns.len();
    let told = json!({ "us": us, "stages_us": stages_us, "cuts": count, "refused": refused, "swept_triangles": swept_triangles });
    (told, targets)
}

/// The scene with a tool of so many points.
fn with_many_points(mut scene: LoadedScene) -> LoadedScene {
    if let (Some(mut tool), Some(rigid)) = (scene.scene.rigid.first().cloned(), scene.rigid.first_mut()) {
        tool.points = MANY_POINTS;
        (rigid.points_m, rigid.outward) = collision_points(&tool);
    }
    scene
}

fn contact(scene: LoadedScene) -> Result<Vec<Value>, String> {
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    let many = with_many_points(scene.clone());
    for scene in [scene, many] {
        let mut press = Press::new(&scene, Isa::detect(), 1)?;
        let record = press.run(RUN_NS)?;
        let mut tests_ns = record.steps_ns(|phase| phase <= INTERSECTION);
        let test_ns = usual_ns(&mut tests_ns);
        let mut row = json!({
            "method": "hash of the points, tets near them streamed past it",
            "test_us": spread(&mut tests_ns, US),
            "test_hz": 1e9 / test_ns,
            "ns_per_tet": test_ns / press.tets() as f64,
            "limit_ratio": test_ns / press.pass_ns() as f64,
            "brute_force_ratio": press.brute_ns()? as f64 / test_ns,
            "speedup": speedup(&scene, Press::new, |phase| phase == INTERSECTION)?,
        });
        complete(&mut row, &scene, &press, &record, |phase| phase != DEFORMATION && PHASES[phase] != "surface");
        let ratio = beside_peer(&mut row, &scene, test_ns)?;
        let name = format!("parry's BVH, refit and query, over the test of {} points", row["points"]);
        targets.push(target(&name, ratio, LEAST_RATIO, true));
        rows.push(row);
    }
    rows.extend(targets);
    Ok(rows)
}

/// Puts the peer beside a test that took so long, ns, in a press like its own; gives how many times as long the faster of its two kinds takes.
fn beside_peer(row: &mut Value, scene: &LoadedScene, test_ns: f64) -> Result<f64, String> {
    let mut press = Press::new(scene, Isa::detect(), 1)?;
    let mut peer = press.tested(|tissue, _, _| Peer::of(tissue, press.edge_m()));
    press.run_beside(PEER_NS, |press| press.tested(|tissue, points, points_m| peer.step(tissue, points, points_m)))?;
    let of = |took: Took| {
        let Took { margin_m, refit_ns, query_ns } = took;
        let ratio = (refit_ns + query_ns) / test_ns;
        (ratio, json!({ "margin_m": margin_m, "refit_us": refit_ns / US, "query_us": query_ns / US, "ratio": ratio }))
    };
    let [(fitting, fits), (wide, has_margin)] = peer.took().map(of);
    row["peers"] = json!({ "parry_bvh": fits, "parry_bvh_with_margin": has_margin });
    row["peers_note"] = json!("in the same press, on the same tets and points");
    Ok(fitting.min(wide))
}

/// What all rows have: the scene, the time of a step and the share of each phase, as far as it counts.
fn complete(row: &mut Value, scene: &LoadedScene, press: &Press, record: &Record, counts: impl Fn(usize) -> bool) {
    let mut steps_ns = record.steps_ns(&counts);
    let all_ns = steps_ns.iter().sum::<u64>().max(1) as f64;
    let chosen = (0..PHASES.len()).filter(|phase| counts(*phase));
    let share: Map<String, Value> =
        chosen.map(|phase| (PHASES[phase].into(), json!(record.total_ns(phase) as f64 / all_ns))).collect();
    row["scene"] = json!(scene.scene.name);
    row["hand"] = json!(press.hand());
    row["tets"] = json!(press.tets());
    let [shaft, of_tissue] = press.points();
    (row["points"], row["points_of_tissue"]) = (json!(shaft), json!(of_tissue));
    row["contacts_max"] = json!(record.contacts);
    row["steps"] = json!(steps_ns.len());
    row["step_us"] = spread(&mut steps_ns, US);
    row["share"] = Value::Object(share);
    row["peers"] = json!({});
    row["peers_note"] = json!(PEERS);
}

/// How a run is made: of a scene, with an instruction set, the test on so many threads.
type Make = fn(&LoadedScene, Isa, usize) -> Result<Press, String>;

/// The time of a step with the test on so many threads, ns, counting the phases that are chosen: the mean of all but the slowest thousandth, for few steps look
/// at all tets.
fn time_ns(scene: &LoadedScene, make: Make, threads: usize, counts: impl Fn(usize) -> bool) -> Result<f64, String> {
    let record = make(scene, Isa::detect(), threads)?.run(RUN_NS)?;
    Ok(usual_ns(&mut record.steps_ns(counts)).max(1.0))
}

/// How many times as much the chosen phases get done: with the test on several threads, and by as many independent copies. One thread
/// alone is measured in the same breath, so that all three see the same machine.
fn speedup(scene: &LoadedScene, make: Make, counts: impl Fn(usize) -> bool + Sync) -> Result<Value, String> {
    let time_ns = |threads: usize| time_ns(scene, make, threads, &counts);
    let alone_ns = time_ns(1)?;
    let shared_ns = time_ns(THREADS)?;
    let copies: Vec<Result<f64, String>> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..THREADS).map(|_| scope.spawn(|| time_ns(1))).collect();
        running.into_iter().map(|copy| copy.join().unwrap_or_else(|_| Err("a copy panicked".into()))).collect()
    });
    let mut together = 0.0;
    for copy_ns in copies {
        together += alone_ns / copy_ns?;
    }
    Ok(json!({ "1": 1.0, "2": alone_ns / shared_ns, "2_independent_copies": together, "alone_us": alone_ns / US }))
}
