//! Promise of the Main Loop about the limits of cutting: a sweep that is cut coarser than was asked for, or not at all, is counted in the state, and so by whoever
//! goes on from it; what there is room for is cut on. One that nobody could go on from in time is left out, and the tissue is what it was.

use super::*;
use crate::body::Body;
use crate::world::{CONTACT_STIFFNESS_N_M, Case};
use glam::Vec3;
use hyst_mesh::TetMesh;

/// What is left of the room for nodes, tets, vertices and triangles: less than a stroke through the polyp takes.
const LEFT: [usize; 4] = [2, 12, 3, 6];
/// A stiffness that no mesh bears in 32 substeps, N/m.
const UNBEARABLE_N_M: f64 = 1e8;

/// Nodes, tets, vertices and triangles of a body.
fn counts(body: &Body) -> [usize; 4] {
    [body.rest.positions_m.len(), body.rest.tets.len(), body.skin.rest_m.len(), body.skin.triangles.len()]
}

/// What came of a stroke.
struct Swept {
    core: Core,
    /// Cuts after the sweep that met a limit first.
    later: u32,
    /// By how much the body grew at most.
    grown: [usize; 4],
    rest: TetMesh,
    /// Whether it was said that a limit was met.
    is_said: bool,
    /// Objects of tissue that there are at the end.
    objects: usize,
}

/// The stroke of a hand with its current on, in so many ticks, in a world of a changed case.
fn swept(name: &str, cramp: impl FnOnce(&mut Case, &Body), ticks: u64, hand: impl Fn(&World, u64) -> InputRecord) -> Swept {
    let (station, pages, life, mut inbox) = begun(name);
    let (mut workshop, world) = Workshop::load(&life).unwrap();
    let world = workshop.cramp(world, cramp);
    let mut main = MainLoop::new(&life, workshop, world).unwrap();
    main.arrival(page_of(&station, Role::Device), &mut inbox);
    let whole = Arc::clone(&main.world);
    let mut now = first_state(&mut main);
    let (mut most, mut at_limit) = (counts(&whole.body), None);
    for tick in 1..=ticks {
        now = fed(&mut main, &pages[1], &now, &hand(&whole, tick));
        let (found, core) = (counts(&main.world.body), core_of(&now));
        most = std::array::from_fn(|of| most[of].max(found[of]));
        at_limit = at_limit.or((core.cut_limits > 0).then_some(core.cuts));
    }
    assert!(main.accepts(bytemuck::cast_slice(&now)), "{name}: it is gone on from");
    let core = core_of(&now);
    assert_eq!(main.status.cut_limits, core.cut_limits, "what the state counts is told");
    assert!(main.status.substeps > 0, "and so are the substeps");
    // Without current nothing is swept, and what was counted stays.
    let after = fed(&mut main, &pages[1], &now, &InputRecord { tick: ticks + 1, ..InputRecord::default() });
    assert_eq!(core_of(&after).cut_limits, core.cut_limits);
    let rest = main.world.body.rest.clone();
    let objects = rest.regions.iter().collect::<std::collections::BTreeSet<_>>().len();
    Swept {
        core,
        later: core.cuts - at_limit.unwrap_or(core.cuts),
        grown: std::array::from_fn(|of| most[of] - counts(&whole.body)[of]),
        rest,
        is_said: main.has_met_limit,
        objects,
    }
}

#[test]
fn a_cut_that_found_no_room_is_counted_and_said_and_goes_on_along_what_is_there() {
    type Cramp = fn(&mut Case, &Body);
    let cramps: [(&str, Cramp); 4] = [
        ("nodes", |case, body| case.room.nodes = counts(body)[0] + LEFT[0]),
        ("tets", |case, body| case.room.tets = counts(body)[1] + LEFT[1]),
        ("vertices", |case, body| case.room.vertices = counts(body)[2] + LEFT[2]),
        ("triangles", |case, body| case.room.triangles = counts(body)[3] + LEFT[3]),
    ];
    let roomy = swept("roomy", |_, _| (), SWEEP, sweeping);
    println!("with room: {} cuts, {} limits, {:?} more", roomy.core.cuts, roomy.core.cut_limits, roomy.grown);
    for (of, (what, cramp)) in cramps.into_iter().enumerate() {
        let cramped = swept(&format!("few{of}"), cramp, SWEEP, sweeping);
        let (cuts, limits) = (cramped.core.cuts, cramped.core.cut_limits);
        println!("few {what}: {cuts} cuts, {} of them later, {limits} limits, {:?} more", cramped.later, cramped.grown);
        assert!(roomy.grown[of] > LEFT[of], "a stroke takes {} {what}: nothing was tried", roomy.grown[of]);
        assert!(cramped.grown[of] <= LEFT[of], "{} {what} more than there is room for", cramped.grown[of]);
        assert!(limits > roomy.core.cut_limits && limits > 0, "{what}: {limits}, with room {}", roomy.core.cut_limits);
        assert!(cramped.is_said, "{what}: it is said");
        assert!(cramped.later > 0, "{what}: nothing was cut any more");
        // Where the surface alone has no room the wound stays bare, and the tissue is cut as with it.
        assert!(of < 2 || cramped.rest == roomy.rest, "{what}: the tissue is cut in another way");
    }
}

/// How far beyond the polyp the wire ends, and its way begins, m; how far along +z the tip is from it, where it touches nothing; ticks of its way.
const BEYOND_M: f32 = 1.5e-3;
const ASIDE_M: f32 = -0.2;
const ACROSS: u64 = 80;

/// Where a straight wire is drawn across the middle of the polyp: its middle at the beginning and at the end, and the way from there to its end, m. It goes at
/// right angles to the way from the root outwards, so that what is beyond it comes free.
fn across(case: &Case, body: &Body) -> [Vec3; 3] {
    let (held, at) = (case.held(body), |node: u32| Vec3::from(body.rest.positions_m[node as usize]));
    let mean = |places: &[Vec3]| places.iter().sum::<Vec3>() / places.len() as f32;
    let roots: Vec<Vec3> = held.attachments.iter().map(|root| at(root.node)).collect();
    let tets = body.rest.tets.iter().zip(&body.rest.regions).filter(|(_, object)| case.is_pathology(body, **object));
    let nodes: Vec<Vec3> = tets.flat_map(|(tet, _)| tet.map(at)).collect();
    let centre = mean(&nodes);
    let out = (centre - mean(&roots)).normalize();
    let wire = out.any_orthonormal_vector();
    let reach_m = |along: Vec3| nodes.iter().map(|place| (*place - centre).dot(along).abs()).fold(0.0, f32::max) + BEYOND_M;
    let way = out.cross(wire);
    [centre - reach_m(way) * way, centre + reach_m(way) * way, reach_m(wire) * wire]
}

/// The hand that draws the loop of a case in which that is the wire of [`across`].
fn drawing(world: &World, tick: u64) -> InputRecord {
    let [from, to, _] = across(&world.case, &world.body);
    let mut record = sweeping(world, tick);
    record.sample.pose.position_m = (from.lerp(to, tick as f32 / ACROSS as f32) + ASIDE_M * Vec3::Z).to_array();
    record
}

#[test]
fn a_piece_for_which_there_is_no_number_is_burnt_and_the_sweep_met_a_limit() {
    let straight = |case: &mut Case, body: &Body| {
        let half = across(case, body)[2];
        let electrode = case.electrode.as_mut().expect("the default instrument has a loop");
        let from = Vec3::Z * (-ASIDE_M - electrode.reach_m);
        electrode.wire_m = [-half, Vec3::ZERO, half].map(|end| (from + end).to_array()).to_vec();
    };
    let roomy = swept("numbered", straight, ACROSS, drawing);
    let full = |case: &mut Case, body: &Body| {
        straight(case, body);
        case.room.objects = body.origin.len();
    };
    let cramped = swept("burnt", full, ACROSS, drawing);
    for (what, swept) in [("with", &roomy), ("without", &cramped)] {
        let Core { cuts, cut_limits, removed_volume_ml, largest_piece_ml, .. } = swept.core;
        let objects = swept.objects;
        println!("{what} numbers: {cuts} cuts, {cut_limits} limits, {objects} objects");
        println!("    {removed_volume_ml} ml removed, the largest piece {largest_piece_ml} ml");
    }
    assert!(roomy.objects > 2 && roomy.core.largest_piece_ml > 1e-3, "nothing came free: nothing was tried");
    assert_eq!((cramped.objects, cramped.core.largest_piece_ml), (2, 0.0), "what is burnt is no piece");
    assert!(cramped.core.cut_limits > roomy.core.cut_limits && cramped.is_said, "it is counted and said");
    let [removed_ml, burnt_ml] = [&roomy, &cramped].map(|swept| swept.core.removed_volume_ml);
    assert!((burnt_ml / removed_ml - 1.0).abs() < 0.1, "{burnt_ml} ml are removed, and {removed_ml} where it has a number");
}

#[test]
fn a_cut_of_which_no_model_is_fast_enough_is_left_out_and_counted_and_the_next_ones_are_made() {
    let (station, pages, life, mut inbox) = begun("stiff");
    let mut main = engine(&station, &life, &mut inbox);
    let whole = Arc::clone(&main.world);
    let mut now = first_state(&mut main);
    main.workshop.stiffen(UNBEARABLE_N_M);
    let why = main.made(whole.body.clone(), false).err().expect("no model can be made").to_string();
    assert!(why.contains("substeps would need"), "{why}");
    for tick in 1..=SWEEP / 2 {
        now = fed(&mut main, &pages[1], &now, &sweeping(&whole, tick));
        assert!(main.accepts(bytemuck::cast_slice(&now)), "state {tick}");
    }
    let refused = core_of(&now);
    println!("{} sweeps were refused", refused.cut_limits);
    assert!(refused.cut_limits > 1 && main.status.cut_limits == refused.cut_limits, "each is counted: {}", refused.cut_limits);
    assert!(main.has_refused && !main.has_met_limit, "and said");
    assert_eq!((refused.cuts, refused.removed_volume_ml, refused.healthy_removed_ml), (0, 0.0, 0.0));
    assert!(main.world.version == whole.version && main.world.words == whole.words, "the tissue is what it was");
    assert_eq!(main.status.substeps, whole.model.substeps(1e-3), "and takes no longer");
    main.workshop.stiffen(CONTACT_STIFFNESS_N_M);
    for tick in SWEEP / 2 + 1..=SWEEP {
        now = fed(&mut main, &pages[1], &now, &sweeping(&whole, tick));
    }
    assert!(core_of(&now).cuts > 0, "the hand goes on, and nothing is cut");
    drop(main);
}

/// Its maker alone went on from a mesh that all others refused: there was no spare, and no successor got a state.
#[test]
fn a_mesh_that_nobody_else_would_take_is_not_gone_on_from() {
    let (station, _pages, life, mut inbox) = begun("refused");
    let mut main = engine(&station, &life, &mut inbox);
    let (body, most) = (main.world.body.clone(), main.world.case.room.triangles);
    assert!(main.made(body.clone(), false).is_ok());
    let (mut crowded, mut nowhere) = (body.clone(), body);
    let triangle = crowded.skin.triangles[0];
    crowded.skin.triangles.resize(most + 1, triangle);
    nowhere.skin.rest_m[0][1] = f32::NAN;
    for body in [crowded, nowhere] {
        assert!(main.workshop.make(body.clone()).is_ok(), "a model can be made of it");
        assert!(main.made(body, false).is_err(), "and it is no body for anybody else");
    }
    drop(main);
}
