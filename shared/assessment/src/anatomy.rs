//! What lies behind the way of the tip: the scene as it was before anything moved, organs cut through the pivot, pathologies in outline.

use crate::way::Side;
use hyst_scene::{DeformableKind, LoadedScene};

/// Most cut triangles of one side: a finer surface is drawn no better by more of them, and the page is read in a browser.
const MOST_CUTS: usize = 20_000;

/// The anatomy from each side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Anatomy {
    pub(crate) sides: [Drawn; 2],
}

/// What is drawn from one side, mm to the right and up.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Drawn {
    /// Where the surfaces of organs are cut.
    pub(crate) cuts_mm: Vec<[[f64; 2]; 2]>,
    /// Outlines of pathologies.
    pub(crate) shapes_mm: Vec<Vec<[f64; 2]>>,
}

impl Anatomy {
    /// Of a scene.
    pub fn of(scene: &LoadedScene) -> Anatomy {
        Anatomy { sides: [Side::Left, Side::Front].map(|side| drawn(scene, side)) }
    }
}

fn drawn(scene: &LoadedScene, side: Side) -> Drawn {
    let mut drawn = Drawn::default();
    let plane_m = side.depth_m(scene.workspace.pivot_m);
    for object in &scene.objects {
        let points_m = &object.surface.positions_m;
        if object.kind == DeformableKind::Pathology {
            drawn.shapes_mm.push(hull(points_m.iter().map(|point| side.of(*point)).collect()));
            continue;
        }
        let corner = |index: &u32| points_m.get(*index as usize).copied();
        for triangle in &object.surface.triangles {
            let [Some(a), Some(b), Some(c)] = [&triangle[0], &triangle[1], &triangle[2]].map(corner) else { continue };
            drawn.cuts_mm.extend(cut([a, b, c], plane_m, side));
        }
    }
    drawn.cuts_mm = thinned(drawn.cuts_mm, MOST_CUTS);
    drawn
}

/// Of so many the most that are drawn, from all of them alike: the first alone were half of an organ.
fn thinned<T: Copy>(all: Vec<T>, most: usize) -> Vec<T> {
    if all.len() <= most { all } else { (0..most).map(|at| all[at * all.len() / most]).collect() }
}

/// Where a triangle is cut by the plane; a corner on it counts to one side, so that each edge is cut once or not at all.
fn cut(corners: [[f32; 3]; 3], plane_m: f32, side: Side) -> Option<[[f64; 2]; 2]> {
    let mut ends = [0, 1, 2].into_iter().filter_map(|at| {
        let (from, to) = (corners[at], corners[(at + 1) % 3]);
        let [before_m, after_m] = [from, to].map(|corner| f64::from(side.depth_m(corner)) - f64::from(plane_m));
        let share = ((before_m < 0.0) != (after_m < 0.0)).then(|| before_m / (before_m - after_m))?;
        let (from, to) = (side.of(from), side.of(to));
        Some([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])))
    });
    Some([ends.next()?, ends.next()?])
}

/// The convex hull, in order (Andrew's monotone chain).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let turns_left = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while chain.len() > 1 && !turns_left(chain[chain.len() - 2], chain[chain.len() - 1], point) {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop(); // the first of the other half
        chain
    };
    let mut all = half(&mut points.iter().copied());
    all.extend(half(&mut points.iter().rev().copied()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_through_the_plane_is_cut_in_two_points_and_one_beside_it_not_at_all() {
        let through = [[-0.001, 0.0, 0.0], [0.001, 0.0, 0.010], [0.001, 0.002, 0.0]];
        let tidy = |ends: [[f64; 2]; 2]| ends.map(|end| end.map(|mm| (1e3 * mm).round() * 1e-3));
        assert_eq!(cut(through, 0.0, Side::Left).map(tidy), Some([[5.0, 0.0], [0.0, 1.0]]));
        assert_eq!(cut(through, 0.005, Side::Left), None);
        let touching = [[0.0, 0.0, 0.0], [0.001, 0.0, 0.010], [0.001, 0.002, 0.0]];
        assert_eq!(cut(touching, 0.0, Side::Left), None, "a corner on the plane is no cut");
    }

    #[test]
    fn of_more_cuts_than_are_drawn_some_are_of_each_part_of_the_organ() {
        assert_eq!(thinned((0..8).collect(), 4), [0, 2, 4, 6]);
        assert_eq!(thinned((0..5).collect(), 4), [0, 1, 2, 3]);
        assert_eq!(thinned((0..4).collect(), 4), [0, 1, 2, 3]);
    }

    #[test]
    fn the_hull_of_a_square_has_its_corners_alone() {
        let square = vec![[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [1.0, 0.0], [0.0, 0.0]];
        assert_eq!(hull(square), [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]);
        assert_eq!(hull(Vec::new()), Vec::<[f64; 2]>::new());
    }

    #[test]
    fn the_cavity_of_the_default_scene_is_as_deep_and_wide_as_it_was_made_and_the_polyp_sits_on_the_right() {
        let scene = hyst_scene::load_embedded().unwrap();
        let Anatomy { sides: [left, front] } = Anatomy::of(&scene);
        let extent = |drawn: &Drawn, axis: usize| {
            let values = || drawn.cuts_mm.iter().flatten().map(|point| point[axis]);
            values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
        };
        assert!(extent(&left, 0) > 60.0 && extent(&front, 1) > extent(&left, 1), "a uterus is wider than it is thick");
        assert!(left.cuts_mm.len() > 50 && front.cuts_mm.len() > 50);
        assert!(
            front.shapes_mm.len() == 1 && front.shapes_mm[0].iter().all(|[_, right_mm]| *right_mm > -3.0),
            "{:?}",
            front.shapes_mm
        );
    }
}
