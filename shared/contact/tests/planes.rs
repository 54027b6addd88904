//! Planes give the force of the contacts as it is felt at the tip, walls are known before they are met, and paths do not tunnel.

mod common;

use common::{Capsule, Poke, TOOL, block, capsule, force_of};
use glam::{DVec3, Vec3};
use hyst_contact::*;

const MM: f32 = 1e-3;
const STIFFNESS_N_M3: f32 = 2e7;
const PIVOT_M: [f32; 3] = [0.3 * MM, 0.1 * MM, -35.0 * MM];

/// A tool in the wall and the forces on it.
struct Scene {
    tool: Capsule,
    tip_m: [f32; 3],
    poke: Poke,
    contacts: Vec<ContactForce>,
    most_n_m: f32,
}

fn press(tip_m: [f32; 3]) -> Scene {
    let (positions_m, tets) = block([12, 12, 6], 2.0 * MM, [-12.0 * MM, -12.0 * MM, 0.0]);
    let tool = capsule(tip_m, 2.0 * MM, 30.0 * MM, 30, 16);
    let mut poke = Poke::new(positions_m, tets, &tool);
    let penetrations = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
    let contacts = penetrations.iter().map(|penetration| force_of(penetration, &tool, STIFFNESS_N_M3)).collect();
    Scene { tool, tip_m, poke, contacts, most_n_m: f32::INFINITY }
}

impl Scene {
    fn planes(&self, gaps: &[Gap]) -> PlaneSet {
        self.planes_about(None, gaps)
    }

    /// Those of a tool that turns about a pivot.
    fn planes_about(&self, pivot_m: Option<[f32; 3]>, gaps: &[Gap]) -> PlaneSet {
        let input = PlaneInput {
            contacts: &self.contacts,
            gaps,
            points_m: &self.tool.points_m,
            owner: &self.poke.owner,
            point_area_m2: &self.tool.area_m2,
            tip_m: self.tip_m,
            pivot_m,
            tool: TOOL,
        };
        planes(&input, &PlaneParams { range_m: 2.0 * MM, stiffness_n_m3: STIFFNESS_N_M3, most_stiffness_n_m: self.most_n_m })
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
fn planes_give_the_tools_normal_force() {
    for depth_mm in [0.4f32, 2.0, 5.0] {
        let scene = press([0.3 * MM, 0.1 * MM, depth_mm * MM]);
        let set = scene.planes(&[]);
        let normal = sum(scene.contacts.iter().map(|c| c.direction.map(|d| d * c.normal_n)));
        let held = sum([set.force_n(scene.tip_m)].into_iter());
        assert!(normal.length() > 1e-3 && (held - normal).length() < 1e-5 * normal.length(), "{held} for {normal}");
        assert!(set.count >= 1 && set.count as usize <= MAX_PLANES);
        for plane in &set.planes[..set.count as usize] {
            assert!(plane.normal[2] < -0.9 && plane.stiffness_n_m > 0.0 && plane.damping_n_s_m > 0.0);
        }
    }
}

#[test]
fn planes_of_a_tool_that_turns_about_a_pivot_give_what_its_contacts_are_at_the_tip() {
    let mut scene = press([0.3 * MM, 0.1 * MM, 5.0 * MM]);
    // On one side of the tool alone, so that the wall turns it.
    let middle_m = scene.tip_m[0];
    scene.contacts.retain(|contact| contact.place_m[0] > middle_m);
    let normal = sum(scene.contacts.iter().map(|c| c.direction.map(|d| d * c.normal_n)));
    let place = |place_m: [f32; 3]| Vec3::from_array(place_m).as_dvec3();
    for pivot_m in [PIVOT_M, [10.0 * MM, -20.0 * MM, -30.0 * MM]] {
        let way = place(scene.tip_m) - place(pivot_m);
        let axis = way.normalize();
        // By its moment about the pivot, which the tip answers across the axis.
        let felt = |contact: &ContactForce| {
            let force = place(contact.direction) * f64::from(contact.normal_n);
            let moment = (place(contact.place_m) - place(pivot_m)).cross(force);
            axis * axis.dot(force) + moment.cross(axis) / way.length()
        };
        let wanted: DVec3 = scene.contacts.iter().map(felt).sum();
        let held = sum([scene.planes_about(Some(pivot_m), &[]).force_n(scene.tip_m)].into_iter());
        assert!((held - wanted).length() < 1e-4 * wanted.length(), "{held} for {wanted}");
        assert!((held - normal).length() > 5e-3 * normal.length(), "{held}, as without a lever");
    }
}

/// A servo has a bound on what it can make a hand feel; whatever the contacts' stiffness, their force is told in full.
#[test]
fn planes_are_nowhere_stiffer_than_their_bound_and_give_the_same_force() {
    for depth_mm in [-0.5f32, 0.1, 2.0, 5.0] {
        let mut scene = press([0.3 * MM, 0.1 * MM, depth_mm * MM]);
        let gaps = scene.gaps();
        let free = scene.planes(&gaps);
        let contacts_n_m = scene.planes(&[]).stiffness_n_m();
        let (own_n, own_n_m) = (sum([free.force_n(scene.tip_m)].into_iter()), free.stiffness_n_m());
        for most_n_m in [0.1, 0.5, 0.99].map(|share| share * own_n_m) {
            scene.most_n_m = most_n_m;
            let (set, bare) = (scene.planes(&gaps), scene.planes(&[]));
            let held = sum([set.force_n(scene.tip_m)].into_iter());
            assert!((held - own_n).length() < 1e-5 * own_n.length() + 1e-9, "{depth_mm} mm: {held} for {own_n}");
            assert!(set.stiffness_n_m() < 1.0001 * most_n_m, "{depth_mm} mm: {} of {most_n_m} N/m", set.stiffness_n_m());
            // Contacts leave a tenth for what is ahead, and have the rest.
            assert!(bare.stiffness_n_m() < 0.9001 * most_n_m, "{depth_mm} mm: {} of {most_n_m} N/m", bare.stiffness_n_m());
            let wanted_n_m = contacts_n_m.min(0.9 * most_n_m);
            assert!(bare.stiffness_n_m() >= 0.999 * wanted_n_m, "{depth_mm} mm: {} of {wanted_n_m} N/m", bare.stiffness_n_m());
        }
    }
}

#[test]
fn planes_change_without_a_step_as_the_tool_moves() {
    let at = |i: usize| press([0.3 * MM, 0.1 * MM, (0.5 + 0.002 * i as f32) * MM]);
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
    let scene = press([0.3 * MM, 0.1 * MM, -0.5 * MM]);
    assert!(scene.contacts.is_empty());
    let gaps = scene.gaps();
    assert!((gaps[0].distance_m - 0.5 * MM).abs() < 1e-6, "{:?}", gaps[0]);
    let set = scene.planes(&gaps);
    assert!(set.count > 0);
    assert_eq!(set.force_n(scene.tip_m), [0.0; 3]);
    let deeper = set.force_n([0.3 * MM, 0.1 * MM, 1.5 * MM]);
    assert!(deeper[2] < -1e-3, "the wall answers before the tissue does: {deeper:?}");
    let far = press([0.3 * MM, 0.1 * MM, -2.5 * MM]);
    assert_eq!(far.planes(&far.gaps()).count, 0);
}

#[test]
fn nonsense_makes_no_plane() {
    let mut scene = press([0.3 * MM, 0.1 * MM, 2.0 * MM]);
    assert!(scene.planes(&scene.gaps()).count > 0);
    let first = scene.contacts[0];
    let nonsense = [
        ContactForce { normal_n: f32::INFINITY, ..first },
        ContactForce { direction: [f32::NAN; 3], ..first },
        ContactForce { normal_n: f32::INFINITY, direction: [f32::NAN; 3], ..first },
    ];
    for broken in nonsense {
        scene.contacts[0] = broken;
        for pivot_m in [None, Some(PIVOT_M)] {
            let set = scene.planes_about(pivot_m, &scene.gaps());
            assert!(bytemuck::bytes_of(&set.planes).iter().all(|b| *b == 0) && set.count == 0, "{broken:?}: {set:?}");
        }
    }
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
    let scene = press([7.3 * MM, 0.1 * MM, -0.7 * MM]);
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

/// Who reads a plane refuses all of them where one is farther away than there is any use for.
#[test]
fn a_plane_that_would_be_far_away_is_near_and_has_the_same_force() {
    let one =
        ContactForce { owner: TOOL, direction: [0.0, 0.0, 1.0], normal_n: 1.0, stiffness_n_m: 0.5, ..ContactForce::default() };
    let input = PlaneInput {
        contacts: &[one],
        gaps: &[],
        points_m: &[],
        owner: &[],
        point_area_m2: &[],
        tip_m: [0.0; 3],
        pivot_m: None,
        tool: TOOL,
    };
    let set =
        planes(&input, &PlaneParams { range_m: 2.0 * MM, stiffness_n_m3: STIFFNESS_N_M3, most_stiffness_n_m: f32::INFINITY });
    assert!(set.count > 0, "there is none");
    for plane in &set.planes[..set.count as usize] {
        assert!(Vec3::from(plane.point_m).length() <= 0.1 + 1e-6, "{plane:?}");
    }
    let off_n = Vec3::from(set.force_n([0.0; 3])).distance(Vec3::Z);
    assert!(off_n < 1e-4, "{off_n} N");
}
