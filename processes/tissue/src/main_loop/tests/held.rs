//! Promise of the Main Loop about what grows in the cavity: pushed aside it lies on the wall, and not in it.

use super::pieces::middle_m;
use super::*;
use crate::points::ContactPoints;
use glam::Vec3;

/// Ticks in which the tip goes from beside the polyp to as far on its other side, and stays there.
const PUSH: u64 = 900;
const STAY: u64 = 300;

/// How deep the polyp's free surface lies in the organ in the mean, m, at most, while the tip pushes it over from a side; `blind`: its nodes meet nobody.
fn pushed_into_the_wall(name: &str, blind: bool, towards: impl Fn(&World) -> (Vec3, Vec3)) -> f32 {
    let (station, pages, life, mut inbox) = begun(name);
    let mut main = engine(&station, &life, &mut inbox);
    let mut world = main.workshop.make(main.world.body.clone()).unwrap();
    let watched: Vec<u32> = world.points.node[world.points.tool..world.points.own_from].to_vec();
    assert!(watched.len() > 20, "{} nodes of the polyp may meet others", watched.len());
    let (from, to) = towards(&world);
    if blind {
        let tool = world.points.tool;
        let (owner, node) = (world.points.owner[..tool].to_vec(), world.points.node[..tool].to_vec());
        let (area_m2, graph) = (world.points.area_m2[..tool].to_vec(), world.case.tool.graph.clone());
        world.points = ContactPoints { organs_from: tool, own_from: tool, owner, node, area_m2, graph, ..world.points };
    }
    main.take_world(world);
    let mut now = first_state(&mut main);
    let mut most = 0.0f32;
    for tick in 1..=PUSH + STAY {
        let tip = from.lerp(to, tick.min(PUSH) as f32 / PUSH as f32);
        let pose = Pose { position_m: tip.to_array(), orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        now = stepped(&mut main, &pages[1], &now, tick, pose, PieceFlow::default());
        if tick % 25 == 0 {
            most = most.max(depth_in_organ_m(&main.world, &now, &watched));
        }
    }
    most
}

/// How deep some nodes lie in the tets of the first object in the mean, m: those outside count 0.
fn depth_in_organ_m(world: &World, now: &[u64], nodes: &[u32]) -> f32 {
    let positions = positions(now);
    let points: Vec<[f32; 3]> = nodes.iter().map(|node| positions[*node as usize]).collect();
    let inside = in_organ(world, positions, &points);
    let faces = world.topology.boundary.iter().zip(&world.topology.boundary_owner).filter(|(_, owner)| **owner == 0);
    let faces: Vec<[Vec3; 3]> = faces.map(|(face, _)| face.map(|node| Vec3::from(positions[node as usize]))).collect();
    let depth_m = |point: &u32| {
        let point = Vec3::from(points[*point as usize]);
        faces.iter().map(|face| distance_m(point, face)).fold(f32::MAX, f32::min)
    };
    inside.iter().map(depth_m).sum::<f32>() / points.len() as f32
}

/// Distance of a point from a triangle, m, by its nearest corner, edge or inside.
pub(super) fn distance_m(point: Vec3, &[a, b, c]: &[Vec3; 3]) -> f32 {
    let to_edge = |from: Vec3, to: Vec3| {
        let along = ((point - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        point.distance(from.lerp(to, along))
    };
    let edges_m = to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a));
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let is_over = [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).cross(point - *from).dot(normal) >= 0.0);
    if is_over { edges_m.min((point - a).dot(normal).abs()) } else { edges_m }
}

/// From one side of the polyp to the other, across the way out of the wall: the middle of the tip's way goes through the polyp's outer half.
fn across(world: &World, side: f32) -> (Vec3, Vec3) {
    let polyp: Vec<usize> = (0..world.body.rest.tets.len())
        .filter(|tet| world.case.is_pathology(&world.body, world.body.rest.regions[*tet]))
        .collect();
    let centre = polyp.iter().map(|tet| middle_m(&world.body, *tet)).sum::<Vec3>() / polyp.len() as f32;
    let size_m = polyp.iter().map(|tet| middle_m(&world.body, *tet).distance(centre)).fold(0.0, f32::max);
    let held = world.attachments.iter().map(|held| Vec3::from(world.body.rest.positions_m[held.node as usize]));
    let root = held.sum::<Vec3>() / world.attachments.len() as f32;
    let out = (centre - root).normalize();
    let way = out.cross(Vec3::Z).normalize() * side;
    let middle = centre + out * 0.3 * size_m;
    (middle - way * (size_m + 0.004), middle + way * 0.8 * size_m)
}

#[test]
fn what_grows_in_the_cavity_is_pushed_onto_the_wall_and_not_into_it() {
    for side in [1.0, -1.0] {
        let [blind, seeing] = [true, false].map(|blind| {
            let name = if blind { "blind" } else { "held" };
            pushed_into_the_wall(name, blind, |world| across(world, side))
        });
        assert!(blind > 0.8e-3, "side {side}: what meets nobody is {blind} m deep: it is not pushed at the wall");
        assert!(seeing < 0.35e-3 && seeing < 0.3 * blind, "side {side}: {seeing} m deep, {blind} m without contact");
        println!("side {side}: {:.2} mm deep in the wall without contact, {:.2} with it", 1e3 * blind, 1e3 * seeing);
    }
}
