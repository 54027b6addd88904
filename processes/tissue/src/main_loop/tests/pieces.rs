//! Promise of the Main Loop about what has come free: it sinks, the flow carries it, and other tissue is in its way.

use super::*;
use crate::body::{Body, Piece};
use crate::knife::register_parts;
use glam::Vec3;
use hyst_mesh::component_of_each_tet;

/// Steps in which a piece is carried: two and a half times what the drag takes to bring it to the medium's speed.
const DRIFT: u64 = 500;
/// How fast the medium flows then, m/s.
const FLOW_M_S: f32 = 0.02;
/// How far from its stump it begins to sink, m.
const OFF_M: f32 = 0.004;

/// The state after some ticks, in which the tool is away and the medium flows with a velocity at one piece.
pub(super) fn flow(
    main: &mut MainLoop<'_>,
    device: &OwnedPage,
    mut now: Vec<u64>,
    flow: PieceFlow,
    ticks: std::ops::Range<u64>,
) -> Vec<u64> {
    let away = Pose { position_m: [0.0, 0.0, -0.2], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
    for tick in ticks {
        now = stepped(main, device, &now, tick, away, flow);
    }
    now
}

/// How fast a ball of a volume and of the default scene's tissue sinks in its medium so long after it was at rest, m/s: by the drag of Schiller and Naumann
/// (1935), 24/Re · (1 + 0.15 Re^0.687).
fn sinks_m_s(volume_m3: f64, ms: u32) -> f32 {
    let (tissue_kg_m3, medium_kg_m3, viscosity_m2_s) = (1_050.0, 1_000.0, 1e-6);
    let diameter_m = (6.0 * volume_m3 / std::f64::consts::PI).cbrt();
    let speed_m_s = (0..ms).fold(0.0_f64, |speed_m_s, _| {
        let reynolds = (speed_m_s * diameter_m / viscosity_m2_s).max(1e-6);
        let coefficient = 24.0 / reynolds * (1.0 + 0.15 * reynolds.powf(0.687));
        let drag_m_s2 = 0.75 * coefficient * medium_kg_m3 / tissue_kg_m3 * speed_m_s * speed_m_s / diameter_m;
        speed_m_s + 1e-3 * (9.806_65 * (1.0 - medium_kg_m3 / tissue_kg_m3) - drag_m_s2)
    });
    speed_m_s as f32
}

/// Share of a piece's nodes that lie in the organ's tets, and the middle of the piece.
pub(super) fn sunk(main: &MainLoop<'_>, now: &[u64], object: u32) -> (f32, Vec3) {
    let (positions, owner) = (positions(now), main.world.body.owners());
    let of_piece = positions.iter().zip(&owner).filter(|(_, of)| **of == Some(object));
    let points: Vec<[f32; 3]> = of_piece.map(|(place, _)| *place).collect();
    let inside = in_organ(&main.world, positions, &points);
    let middle = points.iter().map(|place| Vec3::from(*place)).sum::<Vec3>() / points.len() as f32;
    (inside.len() as f32 / points.len() as f32, middle)
}

/// Mean velocity of an object's nodes, m/s.
pub(super) fn velocity_m_s(main: &MainLoop<'_>, now: &[u64], object: u32) -> Vec3 {
    let message = Message::parse(bytemuck::cast_slice(now), Kind::TissueState).unwrap();
    let velocities: &[[f32; 3]] = message.section(2).unwrap();
    let owner = main.world.body.owners();
    let of = velocities.iter().zip(&owner).filter(|(_, of)| **of == Some(object)).map(|(velocity, _)| Vec3::from(*velocity));
    of.clone().sum::<Vec3>() / of.count() as f32
}

pub(super) fn middle_m(body: &Body, tet: usize) -> Vec3 {
    body.rest.tets[tet].iter().map(|node| Vec3::from(body.rest.positions_m[*node as usize])).sum::<Vec3>() * 0.25
}

/// Parts some tets of a body from all others: they get nodes of their own. Gives the objects that this made.
pub(super) fn part(world: &World, body: &mut Body, tets: &[usize]) -> Vec<Piece> {
    let mut copy = std::collections::BTreeMap::new();
    for tet in tets {
        for corner in 0..4 {
            let node = body.rest.tets[*tet][corner] as usize;
            body.rest.tets[*tet][corner] = *copy.entry(node).or_insert_with(|| {
                let (place, fixed) = (body.rest.positions_m[node], body.fixed[node]);
                body.rest.positions_m.push(place);
                body.fixed.push(fixed);
                body.fixed.len() as u32 - 1
            });
        }
    }
    let part_of_tet = component_of_each_tet(&body.rest);
    register_parts(&world.case, body, &part_of_tet).0
}

/// The body with the outer half of its polyp parted from the rest, that half's object, and the way from the one to the other.
fn halved(world: &World) -> (Body, u32, Vec3) {
    parted(world, 0.0)
}

/// The same with what of the polyp is farther out than its middle by so much.
pub(super) fn parted(world: &World, beyond_m: f32) -> (Body, u32, Vec3) {
    let mut body = world.body.clone();
    let polyp: Vec<usize> =
        (0..body.rest.tets.len()).filter(|tet| world.case.is_pathology(&body, body.rest.regions[*tet])).collect();
    let middle = |tets: &[usize]| tets.iter().map(|tet| middle_m(&world.body, *tet)).sum::<Vec3>() / tets.len() as f32;
    let root = world.attachments.iter().map(|held| Vec3::from(body.rest.positions_m[held.node as usize])).sum::<Vec3>()
        / world.attachments.len() as f32;
    let (centre, out) = (middle(&polyp), (middle(&polyp) - root).normalize());
    let outer: Vec<usize> = polyp.iter().copied().filter(|tet| (middle_m(&body, *tet) - centre).dot(out) > beyond_m).collect();
    let pieces = part(world, &mut body, &outer);
    assert_eq!(pieces.len(), 1, "{pieces:?}");
    assert!(!pieces[0].is_held && pieces[0].volume_m3 > 1e-9, "{pieces:?}");
    (body, pieces[0].object, out)
}

#[test]
fn what_is_free_goes_with_the_medium_and_the_wall_stops_it() {
    let (station, pages, life, mut inbox) = begun("drift");
    let mut main = engine(&station, &life, &mut inbox);
    let (body, object, out) = halved(&main.world);
    let world = main.workshop.make(body).unwrap();
    assert!(world.objects[object as usize].is_free_piece());
    main.take_world(world);
    let now = first_state(&mut main);
    let (buried, from) = sunk(&main, &now, object);
    assert_eq!(buried, 0.0, "half a polyp lies in the wall");

    // The medium rises as fast as the piece sinks, so that what is left is the way along.
    let rises_m_s = sinks_m_s(main.world.body.volume_of_m3(object), 10_000);
    let along = |speed_m_s: f32| PieceFlow { object, velocity_m_s: (out * speed_m_s + Vec3::Y * rises_m_s).to_array() };
    let now = flow(&mut main, &pages[1], now, along(FLOW_M_S), 1..DRIFT);
    let carried = velocity_m_s(&main, &now, object).dot(out) / FLOW_M_S;
    assert!((0.85..1.05).contains(&carried), "the piece has {carried} of the medium's speed");
    let wall = velocity_m_s(&main, &now, 0).length() / FLOW_M_S;
    assert!(wall < 0.05, "the organ has {wall} of the medium's speed");
    let core: Core = Message::parse(bytemuck::cast_slice(&now), Kind::TissueState).unwrap().record(0).unwrap();
    assert!(core.is_sane() && core.pieces[0].object == object);
    let mut wild = core;
    wild.pieces[1].velocity_m_s[2] = f32::NAN;
    assert!(!wild.is_sane());

    // Far more than from wall to wall.
    let fast_m_s = 0.1;
    let now = flow(&mut main, &pages[1], now, along(fast_m_s), DRIFT..3 * DRIFT);
    let (share, to) = sunk(&main, &now, object);
    let speed_m_s = velocity_m_s(&main, &now, object).dot(out);
    println!("carried by {:.1} mm, {:.0} % of the nodes in the wall, {speed_m_s} m/s", 1e3 * (to - from).length(), 100.0 * share);
    let free_m = DRIFT as f32 * 1e-3 * (FLOW_M_S + 2.0 * fast_m_s);
    assert!((to - from).length() < 0.5 * free_m && share < 0.3, "{share} of the piece is in the wall, {to} from {from}");
}

/// In a medium at rest it comes to the speed at which the drag bears its weight, straight down, and ends on the wall below.
#[test]
fn what_is_free_sinks_to_the_posterior_wall_and_stays_there() {
    let (station, pages, life, mut inbox) = begun("sinks");
    let mut main = engine(&station, &life, &mut inbox);
    let (body, object, out) = halved(&main.world);
    let world = main.workshop.make(body).unwrap();
    main.take_world(world);
    let mut now = first_state(&mut main);
    // Off its stump, where nothing is under it.
    let owner = main.world.body.owners();
    let first = (positions(&now).as_ptr() as usize - now.as_ptr() as usize) / 4;
    let words: &mut [f32] = bytemuck::cast_slice_mut(&mut now);
    for node in (0..owner.len()).filter(|node| owner[*node] == Some(object)) {
        (0..3).for_each(|axis| words[first + 3 * node + axis] += OFF_M * out[axis]);
    }
    let (_, from) = sunk(&main, &now, object);

    let volume_m3 = main.world.body.volume_of_m3(object);
    let now = flow(&mut main, &pages[1], now, PieceFlow::default(), 1..21);
    let speed = velocity_m_s(&main, &now, object);
    let (expected_m_s, last_m_s) = (sinks_m_s(volume_m3, 20), sinks_m_s(volume_m3, 10_000));
    println!("sinks with {speed} m/s after 20 ms, expected {expected_m_s}");
    assert!((speed.y / -expected_m_s - 1.0).abs() < 0.1 && speed.x.hypot(speed.z) < 0.3 * expected_m_s, "{speed}");

    let now = flow(&mut main, &pages[1], now, PieceFlow::default(), 21..1_500);
    let ((share, to), speed) = (sunk(&main, &now, object), velocity_m_s(&main, &now, object));
    println!("lies {:.1} mm below, {:.0} % of the nodes in the wall, {} m/s", 1e3 * (from - to).y, 100.0 * share, speed.length());
    assert!(from.y - to.y > 0.5e-3 && from.y - to.y < 1.4 * last_m_s, "{from} to {to}");
    assert!(speed.length() < 0.2 * last_m_s && share < 0.3, "{speed}, {share} of the piece is in the wall");
}
