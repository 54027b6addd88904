//! The mirror image of a scene, about planes through the pivot in which a straight scope lies: what it has on the patient's right is on the left, what it has
//! anterior is posterior, or both. Organ and pathology are mirrored together, with what holds them, the fluid's box, the limits of the hand and the movements of
//! the scripted ones; so a seat that holds in the scene holds in its image, and a movement meets there what it met. The instrument is not mirrored: left and
//! right it is its own image.
//!
//! Promise: no tet is inverted by it and no surface turned inside out; what is mirrored twice about a plane through the origin is as it was.

use crate::case::Place;
use crate::file::{Fixed, Hand, HandPose, Scene};
use hyst_mesh::{TetMesh, TriangleMesh};

/// Which are exchanged: left and right (x), anterior and posterior (y).
pub(crate) type Planes = [bool; 2];

/// Mirrors tets in their place; each keeps the sign of its volume.
pub(crate) fn tets(mesh: &mut TetMesh, pivot_m: [f32; 3], planes: Planes) {
    for axis in axes(planes) {
        points(&mut mesh.positions_m, axis, pivot_m[axis]);
        mesh.tets.iter_mut().for_each(|tet| tet.swap(1, 2));
    }
}

/// Mirrors a surface in its place; what was outside of it is outside.
pub(crate) fn surface(mesh: &mut TriangleMesh, pivot_m: [f32; 3], planes: Planes) {
    for axis in axes(planes) {
        points(&mut mesh.positions_m, axis, pivot_m[axis]);
        mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
}

/// Mirrors what a scene says of places and poses. Its meshes are mirrored once they are in their places.
pub(crate) fn scene(scene: &mut Scene, planes: Planes) {
    for axis in axes(planes) {
        let twice_m = 2.0 * scene.workspace.pivot_m[axis];
        let exchange = |min_m: &mut [f64; 3], max_m: &mut [f64; 3]| {
            (min_m[axis], max_m[axis]) = (twice_m - max_m[axis], twice_m - min_m[axis]);
        };
        for shape in scene.deformable.iter_mut().flat_map(|object| object.fixed.iter_mut().flatten()) {
            match shape {
                Fixed::Sphere { centre_m, .. } => centre_m[axis] = twice_m - centre_m[axis],
                Fixed::Box { min_m, max_m } => exchange(min_m, max_m),
                Fixed::BelowZM(_) | Fixed::AboveZM(_) | Fixed::OuterShell(_) => {}
            }
        }
        if let (Some(min_m), Some(max_m)) = (&mut scene.fluid.box_min_m, &mut scene.fluid.box_max_m) {
            exchange(min_m, max_m);
        }
        let limits = &mut scene.workspace;
        let opposite = |[low, high]: [f64; 2]| [-high, -low];
        if axis == 0 {
            (limits.yaw_deg, limits.roll_deg) = (opposite(limits.yaw_deg), opposite(limits.roll_deg));
        } else {
            limits.pitch_deg = opposite(limits.pitch_deg);
        }
        scene.hand.values_mut().for_each(|hand| movement(hand, axis));
    }
}

/// Mirrors the places of a case. One at an object is where that is, and a range of the insertion is its own image.
pub(crate) fn places(places: &mut [Place], pivot_m: [f64; 3], planes: Planes) {
    for centre_m in places.iter_mut().filter_map(|place| place.centre_m.as_mut()) {
        axes(planes).for_each(|axis| centre_m[axis] = 2.0 * pivot_m[axis] - centre_m[axis]);
    }
}

fn axes(planes: Planes) -> impl Iterator<Item = usize> {
    (0..2).filter(move |axis| planes[*axis])
}

fn points(positions_m: &mut [[f32; 3]], axis: usize, plane_m: f32) {
    positions_m.iter_mut().for_each(|point| point[axis] = 2.0 * plane_m - point[axis]);
}

/// Mirrors what a hand does. Left for right all turns the other way. Anterior for posterior, loop and optic look the other way, too, so the scope is rolled by half
/// a turn: to the side on which a hand that rolls to one side alone stays.
fn movement(hand: &mut Hand, axis: usize) {
    let half_turn_deg = if poses(hand).any(|pose| pose.roll_deg < 0.0) { -180.0 } else { 180.0 };
    for pose in poses(hand) {
        if axis == 0 {
            (pose.yaw_deg, pose.roll_deg) = (-pose.yaw_deg, -pose.roll_deg);
        } else {
            (pose.pitch_deg, pose.roll_deg) = (-pose.pitch_deg, half_turn_deg - pose.roll_deg);
        }
    }
}

fn poses(hand: &mut Hand) -> impl Iterator<Item = &mut HandPose> {
    let legs = hand.leg.iter_mut().map(|leg| &mut leg.to);
    hand.from.iter_mut().chain(&mut hand.through).chain(&mut hand.into).chain(legs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_embedded;
    use crate::pose::Pose;
    use glam::{DVec3, Vec3};

    const ALL: [Planes; 3] = [[true, false], [false, true], [true, true]];

    /// What a closed surface encloses; above 0 where its triangles look outwards.
    fn enclosed_m3(surface: &TriangleMesh) -> f64 {
        let corner = |vertex: u32| DVec3::from(surface.positions_m[vertex as usize].map(f64::from));
        surface.triangles.iter().map(|[a, b, c]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0).sum()
    }

    #[test]
    fn the_image_of_a_mesh_has_its_volume_no_inverted_tet_and_its_surface_outwards_and_that_of_the_image_is_the_mesh() {
        for object in &load_embedded().unwrap().objects {
            let before_m3 = (hyst_mesh::check(&object.mesh).volume_m3, enclosed_m3(&object.surface));
            assert!(before_m3.0 > 0.0 && before_m3.1 > 0.0, "{}: {before_m3:?}", object.name);
            for planes in ALL {
                let (mut mesh, mut skin) = (object.mesh.clone(), object.surface.clone());
                tets(&mut mesh, [0.0; 3], planes);
                surface(&mut skin, [0.0; 3], planes);
                let found = hyst_mesh::check(&mesh);
                assert!(found.inverted.is_empty() && found.flat.is_empty(), "{} {planes:?}", object.name);
                for (now, before) in [(found.volume_m3, before_m3.0), (enclosed_m3(&skin), before_m3.1)] {
                    assert!((now / before - 1.0).abs() < 1e-6, "{} {planes:?}: {now} m³, {before} m³ before", object.name);
                }
                assert_ne!((&mesh, &skin), (&object.mesh, &object.surface));
                tets(&mut mesh, [0.0; 3], planes);
                surface(&mut skin, [0.0; 3], planes);
                assert_eq!((&mesh, &skin), (&object.mesh, &object.surface), "{planes:?}");
            }
        }
    }

    #[test]
    fn a_scene_away_from_the_origin_is_mirrored_about_its_pivot() {
        let mut mesh = TetMesh { positions_m: vec![[0.5, 1.5, 3.0]], ..TetMesh::default() };
        tets(&mut mesh, [0.25, 1.0, 2.0], [true, true]);
        assert_eq!(mesh.positions_m, [[0.0, 0.5, 3.0]]);
        let mut scene = Scene::embedded_default().unwrap();
        scene.workspace.pivot_m = [0.25, 1.0, 2.0];
        scene.workspace.yaw_deg = [-10.0, 30.0];
        scene.fluid.box_min_m = Some([0.0, 0.5, 2.0]);
        scene.fluid.box_max_m = Some([1.0, 2.0, 3.0]);
        let (sphere, low) = (Fixed::Sphere { centre_m: [0.5, 1.5, 3.0], radius_m: 0.1 }, Fixed::BelowZM(0.1));
        let cuboid = Fixed::Box { min_m: [0.0, 0.5, 2.0], max_m: [1.0, 2.0, 3.0] };
        scene.deformable[0].fixed = Some(vec![sphere, cuboid, low.clone()]);
        let before = scene.clone();
        super::scene(&mut scene, [true, true]);
        let (sphere, cuboid) = (
            Fixed::Sphere { centre_m: [0.0, 0.5, 3.0], radius_m: 0.1 },
            Fixed::Box { min_m: [-0.5, 0.0, 2.0], max_m: [0.5, 1.5, 3.0] },
        );
        assert_eq!(scene.deformable[0].fixed, Some(vec![sphere, cuboid, low]));
        assert_eq!((scene.fluid.box_min_m, scene.fluid.box_max_m), (Some([-0.5, 0.0, 2.0]), Some([0.5, 1.5, 3.0])));
        assert_eq!((scene.workspace.yaw_deg, scene.workspace.pitch_deg), ([-30.0, 10.0], [-35.0, 35.0]));
        super::scene(&mut scene, [true, true]);
        assert_eq!(scene, before);
    }

    /// The instrument's own image is that about its plane x = 0: its loop stands to +y, its jaws open to both sides of x.
    #[test]
    fn a_mirrored_hand_has_the_instrument_where_its_image_is_and_rolls_no_further() {
        let pose = |pitch_deg, yaw_deg, roll_deg| HandPose { pitch_deg, yaw_deg, roll_deg, insertion_m: 0.03 };
        for roll_deg in [[0.0, 90.0], [-90.0, -20.0], [0.0, 0.0], [-90.0, 0.0], [180.0, 10.0]] {
            let to = [pose(3.0, -12.0, roll_deg[0]), pose(-7.0, 5.0, roll_deg[1])];
            let before = Hand { from: Some(to[0]), through: to.to_vec(), into: Some(to[1]), ..Hand::default() };
            for planes in ALL {
                let mut hand = before.clone();
                axes(planes).for_each(|axis| movement(&mut hand, axis));
                let ways = [(hand.from, before.from), (hand.into, before.into), (Some(hand.through[1]), Some(before.through[1]))];
                for (now, then) in ways.map(|(now, then)| (now.unwrap(), then.unwrap())) {
                    assert!(now.roll_deg.abs() <= 180.0, "{planes:?} {roll_deg:?}: {now:?}");
                    for [x, y, z] in [[0.0; 3], [0.001, 0.002, 0.012], [-0.002, 0.0, 0.005]] {
                        let is: Vec3 = Pose::from(&now).place([0.0; 3], [-x, y, z]).into();
                        let mut image = Pose::from(&then).place([0.0; 3], [x, y, z]);
                        axes(planes).for_each(|axis| image[axis] = -image[axis]);
                        // About both planes it is turned as a whole, and its own image is not asked for.
                        let turned: Vec3 = Pose::from(&now).place([0.0; 3], [x, y, z]).into();
                        let is = if planes == [true, true] { turned } else { is };
                        assert!(is.distance(image.into()) < 1e-6, "{planes:?} {roll_deg:?}: {is} is not {image:?}");
                    }
                }
                let turned_deg = |hand: &Hand| (hand.through[1].roll_deg - hand.through[0].roll_deg).abs();
                assert_eq!(turned_deg(&hand), turned_deg(&before), "{planes:?} {roll_deg:?}");
            }
        }
    }
}
