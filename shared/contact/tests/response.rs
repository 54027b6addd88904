//! Forces balance, planes give the force of the contacts, paths do not tunnel, and a step allocates nothing.

mod common;

use common::{Capsule, Poke, TOOL, block, capsule};
use glam::{DVec3, Vec3};
use hyst_contact::*;

const MM: f32 = 1e-3;

const PARAMS: ResponseParams =
    ResponseParams { stiffness_n_m3: 2e7, damping_speed_m_s: 0.5, friction: 0.3, slip_speed_m_s: 1e-3, max_point_force_n: 1.0 };

/// A tool in the wall, its forces, and what they act on.
struct Scene {
    tool: Capsule,
    tip_m: [f32; 3],
    poke: Poke,
    contacts: Vec<ContactForce>,
    node_force_n: Vec<[f32; 3]>,
    wrench: Wrench,
}

fn press(tip_m: [f32; 3], velocity_m_s: [f32; 3]) -> Scene {
    let (positions_m, tets) = block([12, 12, 6], 2.0 * MM, [-12.0 * MM, -12.0 * MM, 0.0]);
    let tool = capsule(tip_m, 2.0 * MM, 30.0 * MM, 30, 16);
    let mut poke = Poke::new(positions_m, tets, &tool);
    let penetrations = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
    let nodes = poke.positions_m.len();
    let (velocities, still) = (vec![velocity_m_s; tool.points_m.len()], vec![[0.0; 3]; nodes]);
    let motion = Motion {
        points_m: &tool.points_m,
        point_velocity_m_s: &velocities,
        point_area_m2: &tool.area_m2,
        node_velocity_m_s: &still,
    };
    let mut contacts = vec![ContactForce::default(); penetrations.len()];
    let (mut node_force_n, mut wrenches) = (vec![[0.0; 3]; nodes], [Wrench::default()]);
    let mut out = ResponseOutput { node_force_n: &mut node_force_n, wrenches: &mut wrenches, contacts: &mut contacts };
    let rigids = [Rigid { owner: TOOL, reference_m: tip_m }];
    let found = respond(&penetrations, &poke.points(), &motion, &poke.tissue(), &rigids, &PARAMS, &mut out).unwrap();
    assert_eq!(found, Found { count: penetrations.len(), dropped: 0 });
    Scene { tool, tip_m, poke, contacts, node_force_n, wrench: wrenches[0] }
}

impl Scene {
    fn planes(&self, gaps: &[Gap]) -> PlaneSet {
        let input = PlaneInput {
            contacts: &self.contacts,
            gaps,
            owner: &self.poke.owner,
            point_area_m2: &self.tool.area_m2,
            tip_m: self.tip_m,
            tool: TOOL,
        };
        planes(&input, &PlaneParams { range_m: 2.0 * MM, stiffness_n_m3: PARAMS.stiffness_n_m3 })
    }

    fn gaps(&self) -> Vec<Gap> {
        let sizes = HashSizes::for_points(self.tool.points_m.len());
        let mut words = vec![0; sizes.words()];
        let mut table = HashMut::in_words(&mut words, sizes).unwrap();
        table.build(&self.tool.points_m, 2.0 * MM, Layout::Auto).unwrap();
        let mut gaps = vec![Gap::FAR; self.tool.points_m.len()];
        let (points, tissue) = (self.poke.points(), self.poke.tissue());
        find_gaps(&table.as_ref(), &points, &tissue, &self.poke.topology, 2.0 * MM, &mut gaps).unwrap();
        gaps
    }
}

fn sum(forces: impl Iterator<Item = [f32; 3]>) -> DVec3 {
    forces.map(|f| Vec3::from_array(f).as_dvec3()).sum()
}

#[test]
fn what_the_tool_receives_the_tissue_loses_force_and_moment() {
    for velocity in [[0.0; 3], [0.05, -0.02, 0.1], [0.0, 0.0, -0.2]] {
        let scene = press([0.3 * MM, 0.1 * MM, 4.0 * MM], velocity);
        let force = DVec3::from_array(scene.wrench.force_n);
        let on_nodes = sum(scene.node_force_n.iter().copied());
        assert!(force.length() > 0.05);
        assert!((force + on_nodes).length() < 2e-6 * force.length(), "{force} and {on_nodes}");
        let tip = Vec3::from_array(scene.tip_m).as_dvec3();
        let arm = |p: &[f32; 3]| Vec3::from_array(*p).as_dvec3() - tip;
        let nodes = scene.poke.positions_m.iter().zip(&scene.node_force_n);
        let moment: DVec3 = nodes.map(|(p, f)| arm(p).cross(Vec3::from_array(*f).as_dvec3())).sum();
        let torque = DVec3::from_array(scene.wrench.torque_n_m);
        assert!((moment + torque).length() < 1e-5 * force.length() * 0.01, "{moment} and {torque}");
    }
}

#[test]
fn force_pushes_out_friction_holds_back_damping_resists_entering() {
    let tip = [0.3 * MM, 0.1 * MM, 2.0 * MM];
    let still = press(tip, [0.0; 3]);
    let entering = press(tip, [0.0, 0.0, 0.1]);
    let leaving = press(tip, [0.0, 0.0, -10.0]);
    let sliding = press(tip, [0.2, 0.0, 0.0]);
    assert!(still.wrench.force_n[2] < -0.01);
    assert!((entering.wrench.force_n[2] / still.wrench.force_n[2] - 1.2).abs() < 0.01);
    assert_eq!(leaving.wrench.force_n, [0.0; 3], "contact never pulls");
    let (across, along) = (sliding.wrench.force_n[0], sliding.wrench.force_n[2]);
    assert!((across / along - 0.3).abs() < 0.02, "friction {across} at normal force {along}");
}

#[test]
fn the_force_on_a_deformable_point_goes_to_its_node() {
    let (positions_m, tets) = block([1, 1, 1], 1.0, [0.0; 3]);
    let mut all = positions_m.clone();
    all.push([0.5, 0.4, 0.1]);
    let points = Points { owner: &[3], node: &[8], own: None };
    let tissue = Tissue { positions_m: &all, tets: &tets, tet_owner: &[1; 6] };
    let hit = common::hits(&all[8..], &points, &tissue, 0.5)[0];
    let penetration =
        Penetration { point: 0, tet: hit.tet, weights: hit.weights, depth_m: 0.1, direction: [0.0, 0.0, -1.0], source: 0 };
    let velocity = vec![[0.0; 3]; 9];
    let motion =
        Motion { points_m: &all[8..], point_velocity_m_s: &velocity[8..], point_area_m2: &[1e-7], node_velocity_m_s: &velocity };
    let mut node_force_n = vec![[0.0; 3]; 9];
    let mut out = ResponseOutput { node_force_n: &mut node_force_n, wrenches: &mut [], contacts: &mut [ContactForce::default()] };
    let found = respond(&[penetration, penetration], &points, &motion, &tissue, &[], &PARAMS, &mut out).unwrap();
    assert_eq!(found, Found { count: 1, dropped: 1 });
    assert!((node_force_n[8][2] + 0.2).abs() < 1e-6);
    assert!(sum(node_force_n.iter().copied()).length() < 1e-7);
}

#[test]
fn planes_give_the_tools_normal_force_and_the_residual_the_rest() {
    for depth_mm in [0.4f32, 2.0, 5.0] {
        for velocity in [[0.0; 3], [0.1, 0.05, 0.02]] {
            let scene = press([0.3 * MM, 0.1 * MM, depth_mm * MM], velocity);
            let set = scene.planes(&[]);
            let normal = sum(scene.contacts.iter().map(|c| c.direction.map(|d| d * c.normal_n)));
            let held = sum([set.force_n(scene.tip_m)].into_iter());
            assert!((held - normal).length() < 1e-5 * normal.length(), "{held} for {normal}");
            let whole = held + sum([set.residual_n].into_iter());
            assert!((whole - DVec3::from_array(scene.wrench.force_n)).length() < 1e-5 * normal.length());
            assert!(set.count >= 1 && set.count as usize <= MAX_PLANES);
            for plane in &set.planes[..set.count as usize] {
                assert!(plane.normal[2] < -0.9 && plane.stiffness_n_m > 0.0 && plane.damping_n_s_m >= 0.0);
            }
        }
    }
}

#[test]
fn planes_change_without_a_step_as_the_tool_moves() {
    let at = |i: usize| press([0.3 * MM, 0.1 * MM, (0.5 + 0.002 * i as f32) * MM], [0.0; 3]);
    let probe = |set: &PlaneSet, tip: [f32; 3]| Vec3::from_array(set.force_n(tip)).length();
    for i in 0..25 {
        let (a, b) = (at(i), at(i + 1));
        // The old planes, asked at the new pose, against the new planes there: the servo's error after one step of the tissue.
        let (old, new) = (probe(&a.planes(&[]), b.tip_m), probe(&b.planes(&[]), b.tip_m));
        assert!((old - new).abs() < 0.02 * new + 1e-3, "step {i}: {old} N became {new} N");
    }
}

#[test]
fn a_tool_in_front_of_the_wall_has_a_plane_at_its_gap() {
    let scene = press([0.3 * MM, 0.1 * MM, -0.5 * MM], [0.0; 3]);
    assert!(scene.contacts.is_empty());
    let gaps = scene.gaps();
    assert!((gaps[0].distance_m - 0.5 * MM).abs() < 1e-6, "{:?}", gaps[0]);
    let set = scene.planes(&gaps);
    assert!(set.count > 0);
    assert_eq!(set.force_n(scene.tip_m), [0.0; 3]);
    let deeper = set.force_n([0.3 * MM, 0.1 * MM, 1.5 * MM]);
    assert!(deeper[2] < -1e-3, "the wall answers before the tissue does: {deeper:?}");
    let far = press([0.3 * MM, 0.1 * MM, -2.5 * MM], [0.0; 3]);
    assert_eq!(far.planes(&far.gaps()).count, 0);
}

#[test]
fn nonsense_makes_no_force_and_no_plane() {
    let scene = press([0.3 * MM, 0.1 * MM, 2.0 * MM], [f32::NAN, 0.0, 0.0]);
    assert_eq!(scene.wrench, Wrench::default());
    assert!(scene.node_force_n.iter().flatten().all(|v| *v == 0.0));
    let mut broken = scene.contacts.clone();
    broken[0] = ContactForce { normal_n: f32::INFINITY, owner: TOOL, direction: [f32::NAN; 3], ..broken[0] };
    let set = Scene { contacts: broken, ..scene }.planes(&[]);
    assert!(bytemuck::bytes_of(&set.planes).iter().all(|b| *b == 0));
}

#[test]
fn a_path_through_a_thin_wall_is_caught_wherever_it_passes() {
    let (positions_m, tets) = block([4, 4, 1], 1.0 * MM, [0.0; 3]);
    let topology = Topology::new(&tets, &vec![0; tets.len()], &positions_m).unwrap();
    let all = topology.boundary.len() as u32;
    let across = |from, to, sense| first_crossing(from, to, sense, &positions_m, &topology.boundary, 0..all);
    for i in 0..33 {
        for j in 0..33 {
            // Corners, edges and faces alike: eighths of a millimetre.
            let [x, y] = [i, j].map(|v| v as f32 * 0.125 * MM);
            let (from, to) = ([x, y, -5.0 * MM], [x, y, 9.0 * MM]);
            let crossing = across(from, to, Sense::In).unwrap();
            assert!(crossing.normal[2] < -0.99 && (crossing.fraction - 5.0 / 14.0).abs() < 1e-5);
            let crossing = across(from, to, Sense::Out).unwrap();
            assert!(crossing.normal[2] > 0.99 && (crossing.fraction - 6.0 / 14.0).abs() < 1e-5);
        }
    }
    let nan = [f32::NAN, 0.0, 0.0];
    assert_eq!(across(nan, [0.0; 3], Sense::In), None);
    assert_eq!(across([0.0, 0.0, -2.0], [0.0, 0.0, -1.0], Sense::In), None);
}

#[test]
fn gaps_are_those_of_every_triangle_tried() {
    let scene = press([7.3 * MM, 0.1 * MM, -0.7 * MM], [0.0; 3]);
    let gaps = scene.gaps();
    let corners = |tri: &[u32; 3]| tri.map(|n| Vec3::from_array(scene.poke.positions_m[n as usize]));
    let mut near = 0;
    for (p, gap) in scene.tool.points_m.iter().zip(&gaps) {
        let all = scene.poke.topology.boundary.iter().map(|tri| {
            let [a, b, c] = corners(tri);
            let shape = parry3d::shape::Triangle::new(a, b, c);
            let on = parry3d::query::PointQuery::project_local_point(&shape, Vec3::from_array(*p), false);
            on.point.distance(Vec3::from_array(*p))
        });
        let least = all.fold(f32::INFINITY, f32::min);
        if least < 2.0 * MM {
            near += 1;
            assert!((gap.distance_m - least).abs() < 1e-6, "{gap:?}, parry {least}");
        } else {
            assert_eq!(*gap, Gap::FAR);
        }
    }
    assert!(near > 20);
}
