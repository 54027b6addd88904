//! Promise of the tool's contacts: each moves as its point of the tool does, and knows where that is; and buffers fit every world.

use super::*;
use crate::tool::NOWHERE;
use crate::world::Workshop;
use hyst_contact::intersect_brute;
use hyst_tissue::Isa;

/// A step, s, which is not the shortest.
const SINCE_S: f32 = 2e-3;
/// The tool lies in the wall below, from its tip to near the pivot.
const PITCH_RAD: f32 = 0.35;
const INSERTION_M: f32 = 0.04;

fn world() -> World {
    Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap().1
}

/// Where the tool lies, turned on about the pivot and about its own axis.
fn pose(world: &World, pitch_rad: f32, roll_rad: f32) -> Pose {
    world.case.pose_of(&hyst_scene::Pose { pitch_rad, roll_rad, insertion_m: INSERTION_M, ..Default::default() })
}

/// Place and velocity of each contact of a tool that went from one pose to another in tissue at rest, m and m/s.
fn met(world: &World, [before, now]: [&Pose; 2]) -> Vec<(Vec3, Vec3)> {
    let (case, rest_m, stand) = (&world.case, &world.body.rest.positions_m[..], Stand::default());
    let mut points_m = vec![NOWHERE; world.points.len()];
    world.points.place(&case.tool, (now, stand), (rest_m, rest_m), &mut points_m);
    let sizes = world.points.table_sizes();
    let mut words = vec![0; sizes.words()];
    HashMut::in_words(&mut words, sizes).unwrap().build(&points_m, case.cell_m, Layout::Auto).unwrap();
    let hash = HashRef::in_words(&words).unwrap();
    let mut hits = vec![Hit::default(); max_hits(world)];
    let found = intersect_brute(&points_m, &world.points.view(rest_m), &tissue(world, rest_m), &mut hits).unwrap();
    let still = vec![[0.0; 3]; rest_m.len()];
    let passage = Passage { hash: &hash, velocities_m_s: &still, dt_s: SINCE_S };
    let (tip_m, orientation) = (now.position_m, now.orientation);
    let back = std::array::from_fn(|axis| case.pivot_m[axis] - tip_m[axis]);
    let tool = ToolMotion {
        points_m: &points_m,
        before: (before, stand),
        since_s: SINCE_S,
        way_share: 1.0,
        tip_m,
        back,
        orientation,
        spared: &[],
        soft_m: 0.0,
    };
    let mut contacts = Contacts::new(world);
    let mut memory = vec![Memory::default(); world.points.tool];
    contacts.meet(world, &hits[..found.count], (&tool, &passage), rest_m, (&mut memory, &[])).unwrap();
    let each = contacts.forces.iter().zip(&contacts.springs);
    each.map(|(force, spring)| {
        assert_eq!(force.place_m, points_m[force.point as usize]);
        (Vec3::from(force.place_m), Vec3::from(spring.velocity_m_s))
    })
    .collect()
}

#[test]
fn the_points_of_a_tool_that_turns_about_its_pivot_go_the_faster_the_farther_they_are_from_it() {
    let world = world();
    let [before, now] = [PITCH_RAD - 1e-3, PITCH_RAD].map(|pitch_rad| pose(&world, pitch_rad, 0.0));
    let (pivot, tip) = (Vec3::from(world.case.pivot_m), Vec3::from(now.position_m));
    let of_tip = (tip - Vec3::from(before.position_m)) / SINCE_S;
    let (axis, across) = ((tip - pivot).normalize(), of_tip.normalize());
    assert!((of_tip.length() / (1e-3 * INSERTION_M / SINCE_S) - 1.0).abs() < 0.01, "{of_tip}");
    let mut near = 0;
    let contacts = met(&world, [&before, &now]);
    for (place, velocity) in &contacts {
        let share = (*place - pivot).dot(axis) / INSERTION_M;
        let wanted_m_s = share * of_tip.length();
        assert!((velocity.dot(across) - wanted_m_s).abs() < 0.01 * of_tip.length(), "{share}: {velocity}, not {wanted_m_s} m/s");
        near += usize::from(share < 0.5);
    }
    assert!(contacts.len() > 100 && near > 10, "{near} of {} contacts are in the half at the pivot", contacts.len());
}

#[test]
fn the_points_of_a_tool_that_rolls_on_the_spot_go_around_its_axis() {
    const ROLL_RAD: f32 = 2e-3;
    let world = world();
    let [before, now] = [0.0, ROLL_RAD].map(|roll_rad| pose(&world, PITCH_RAD, roll_rad));
    let (pivot, tip) = (Vec3::from(world.case.pivot_m), Vec3::from(now.position_m));
    assert!(tip.distance(before.position_m.into()) < 1e-7, "the tip stays");
    let (axis, turns_rad_s) = ((tip - pivot).normalize(), ROLL_RAD / SINCE_S);
    let contacts = met(&world, [&before, &now]);
    let mut fastest_m_s = 0.0f32;
    for (place, velocity) in &contacts {
        let wanted = turns_rad_s * axis.cross(*place - pivot);
        assert!(velocity.distance(wanted) < 1e-4, "{velocity}, not {wanted} m/s");
        fastest_m_s = fastest_m_s.max(velocity.length());
    }
    // The instrument's radius is 2.5 mm.
    assert!(contacts.len() > 100 && (fastest_m_s - 2.5e-3).abs() < 1e-4, "{} contacts, {fastest_m_s} m/s", contacts.len());
}

#[test]
fn what_jumps_has_no_velocity_and_what_was_nowhere_neither() {
    let world = world();
    let now = pose(&world, PITCH_RAD, 0.0);
    let far = Pose { position_m: now.position_m.map(|part| part + 0.03), ..now };
    let contacts = met(&world, [&far, &now]);
    assert!(contacts.len() > 100 && contacts.iter().all(|(_, velocity)| *velocity == Vec3::ZERO));
    let through = |from_m: [f32; 3]| crate::through::velocity_m_s(from_m, [0.001, 0.0, 0.0], SINCE_S);
    assert_eq!([through(NOWHERE), through([f32::NAN; 3]), through([0.0; 3])], [[0.0; 3], [0.0; 3], [0.5, 0.0, 0.0]]);
    let swift = crate::through::velocity_m_s([0.0; 3], [0.01, 0.0, 0.0], SINCE_S);
    assert!((swift[0] - 2.0).abs() < 1e-6 && swift[1..] == [0.0; 2], "no hand is so fast: {swift:?}");
    assert_eq!(crate::through::velocity_m_s([0.0; 3], [0.001, 0.0, 0.0], f32::INFINITY), [0.0; 3]);
}

/// Just behind each face of the boundary, in a part that is thick there.
#[test]
fn a_way_back_that_leads_on_through_a_thick_part_is_none_and_one_that_leads_out_of_it_is_kept() {
    const BEHIND: f32 = 0.05;
    let (world, mut tried) = (world(), 0);
    let (topology, positions_m) = (&world.topology, &world.body.rest.positions_m[..]);
    let tissue = tissue(&world, positions_m);
    for (tet, behind) in (0..).zip(&topology.neighbours) {
        let faces: Vec<usize> = (0..4).filter(|face| behind[*face] == NONE).collect();
        let &[face] = &faces[..] else { continue };
        let weights = std::array::from_fn(|corner| if corner == face { BEHIND } else { (1.0 - BEHIND) / 3.0 });
        let place_m = gather(world.model.tets()[tet as usize], weights, positions_m).unwrap();
        let (depth_m, out) = own_face(&tissue, topology, tet, &weights, None).unwrap();
        let on = out.map(|part| -part);
        if leads_out(&tissue, topology, tet, (place_m, on, MAX_TISSUE_DEPTH_M)) {
            continue;
        }
        for before in [out, on] {
            let found = Penetration { tet, weights, depth_m: MAX_DEPTH_M, direction: before, ..Penetration::default() };
            let way = way_out(&world, &tissue, &found, place_m, Some(Vec3::from(before)));
            assert_eq!(way, (depth_m, out, true), "tet {tet}, {before:?}");
        }
        tried += 1;
    }
    assert!(tried > 100, "{tried} faces of thick parts");
}

/// Where it has passed a part, a loop that cuts met that by its whole way through.
#[test]
fn what_has_passed_a_part_pushes_it_back_before_itself_and_a_loop_that_cuts_does_not() {
    let world = world();
    let positions_m = world.model.rest_m();
    let nodes = world.model.tets()[0];
    let weights = [0.5, 0.25, 0.25, 0.0];
    let at = gather(nodes, weights, positions_m).map(Vec3::from).unwrap();
    let (direction, beyond_m) = (Vec3::Z, 1.5e-3);
    let points_m = vec![(at - beyond_m * direction).to_array(); world.points.len()];
    let depth_m = |point: usize, soft_m: f32| {
        let mut contacts = Contacts::new(&world);
        let source = Source::Held as u32;
        contacts.found[0] =
            Penetration { point: point as u32, tet: 0, weights, depth_m: beyond_m, direction: direction.to_array(), source };
        let tool = ToolMotion {
            points_m: &points_m,
            before: (&Pose::default(), Stand::default()),
            since_s: 1e-3,
            way_share: 1.0,
            tip_m: [0.0; 3],
            back: [0.0, 0.0, -1.0],
            orientation: [0.0, 0.0, 0.0, 1.0],
            spared: &[],
            soft_m,
        };
        contacts.spring(&world, &tool, (positions_m, &[]), 1);
        let spring = contacts.springs[0];
        spring.offset_m - Vec3::from(spring.normal).dot(at)
    };
    let of_loop = world.case.tool.shaft;
    let whole_m = beyond_m + AHEAD_M;
    for (point, soft_m, wanted_m) in [(0, 0.0, whole_m), (of_loop, 0.0, whole_m), (of_loop, MAX_LOOP_DEPTH_M, 0.0)] {
        let found_m = depth_m(point, soft_m);
        assert!((found_m - wanted_m).abs() < 1e-6, "point {point}, soft by {soft_m} m: {found_m} m, not {wanted_m}");
    }
}

#[test]
fn buffers_that_were_another_worlds_have_the_sizes_of_new_ones() {
    let scene = hyst_scene::load_embedded().unwrap();
    let (mut workshop, whole) = Workshop::open(&scene, Isa::detect()).unwrap();
    let without_polyp = workshop.make(whole.body.without(1)).unwrap();
    let sizes = |contacts: &Contacts| {
        let Contacts { memory, found, node_force_n, gaps, tool_table, .. } = contacts;
        [memory.len(), found.len(), node_force_n.len(), gaps.len(), tool_table.len()]
    };
    let mut contacts = Contacts::new(&whole);
    for world in [&without_polyp, &whole] {
        contacts.fit(world);
        assert_eq!(sizes(&contacts), sizes(&Contacts::new(world)));
    }
    assert_ne!(sizes(&contacts), sizes(&Contacts::new(&without_polyp)));
}
