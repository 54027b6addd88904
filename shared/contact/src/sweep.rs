//! Continuous test: what a point went through between two steps, so that no point tunnels. What passes between two points is not seen.
//!
//! [`sweep`] looks at the paths of all points at once and is for steps in which something is fast; [`first_crossing`] looks along one way and is for the few
//! points that are to be followed. Segment against triangle after Möller and Trumbore 1997, with a slack at the edges so that no path slips between
//! neighbours. What is not finite crosses nothing.

use crate::ContactError;
use crate::error::same_length;
use crate::hash_read::HashRef;
use crate::topology::Topology;
use crate::types::Tissue;
use glam::Vec3;

/// Weights may be this far below zero: closes the seam between neighbours that rounding opens.
const SEAM: f32 = 1.0e-5;

/// Where a path crosses the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Index of the triangle.
    pub triangle: u32,
    /// Fraction of the path, 0 at its start, 1 at its end.
    pub fraction: f32,
    /// Weights of the triangle's corners.
    pub weights: [f32; 3],
    /// Unit normal, outward by the right-hand rule.
    pub normal: [f32; 3],
}

/// Whether a path goes into the tissue or out of it where it crosses the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// From the outer side of the triangle to the inner.
    In,
    /// From the inner side to the outer.
    Out,
}

/// What a sweep reads.
#[derive(Debug, Clone, Copy)]
pub struct SweepInput<'a> {
    /// The points where they are now.
    pub hash: &'a HashRef<'a>,
    /// Where the first of them were a step before, metres; those behind are not looked at.
    pub from_m: &'a [[f32; 3]],
    /// The tets as they are now.
    pub tissue: Tissue<'a>,
    /// Velocities of the nodes, m/s.
    pub velocity_m_s: &'a [[f32; 3]],
    /// The step, s.
    pub dt_s: f32,
    /// The surface.
    pub topology: &'a Topology,
    /// What came from farther away than this has jumped and not moved, metres.
    pub farthest_m: f32,
}

/// For each of the first points where its path in the step first goes into tissue; of equals the triangle of lowest index. A triangle that moves is
/// taken to move as its middle does, so where neighbours move differently a path may slip between them, and those beside it do not.
///
/// # Errors
/// [`ContactError::Length`] if arrays that belong together differ in length.
pub fn sweep(input: &SweepInput<'_>, entered: &mut [Option<Crossing>]) -> Result<(), ContactError> {
    let SweepInput { hash, from_m, tissue, topology, farthest_m, .. } = *input;
    same_length("crossings of points", from_m.len(), entered.len())?;
    same_length("velocities of nodes", tissue.positions_m.len(), input.velocity_m_s.len())?;
    entered.fill(None);
    let Some(cloud) = Cloud::of(hash, from_m, farthest_m) else { return Ok(()) };
    for (index, triangle) in topology.boundary.iter().enumerate() {
        let corners = triangle.map(|node| tissue.node(node));
        let moved = moved_m(input, triangle);
        let [a, b, c] = corners.map(Vec3::from);
        let grown = Vec3::splat((cloud.longest_m + moved.length()).min(farthest_m));
        let (low, high) = (a.min(b).min(c) - grown, a.max(b).max(c) + grown);
        let is_near = low.cmple(cloud.high).all() && high.cmpge(cloud.low).all();
        if !(is_near && low.is_finite() && high.is_finite()) {
            continue;
        }
        let of = |corner: Vec3| corner.to_array().map(|value| [value]);
        let (first, last) = hash.cells(&of(low), &of(high));
        let cell = |axes: [[i32; 1]; 3]| axes.map(|axis| axis[0]);
        hash.for_runs_in(cell(first), cell(last), |from, to| {
            for at in from..to {
                let (point, place) = (hash.id(at) as usize, Vec3::from(hash.position(at)));
                let Some(from) = from_m.get(point).map(|from| Vec3::from(*from) + moved) else { continue };
                let is_near = place.cmpge(low).all() && place.cmple(high).all() && from.distance(place) <= farthest_m;
                if is_near
                    && let Some(found) = crossing(from, place, &corners, index as u32, Sense::In)
                    && entered[point].is_none_or(|known| found.fraction < known.fraction)
                {
                    entered[point] = Some(found);
                }
            }
        });
    }
    Ok(())
}

/// The points that are looked at: a box around them, and the longest way of one that has not jumped, m.
struct Cloud {
    low: Vec3,
    high: Vec3,
    longest_m: f32,
}

impl Cloud {
    /// `None` if there are none.
    fn of(hash: &HashRef<'_>, from_m: &[[f32; 3]], farthest_m: f32) -> Option<Cloud> {
        let mut cloud = Cloud { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, longest_m: 0.0 };
        for at in 0..hash.kept() {
            let place = Vec3::from(hash.position(at));
            let way_m = from_m.get(hash.id(at) as usize).map(|from| Vec3::from(*from).distance(place));
            if let Some(way_m) = way_m.filter(|way_m| *way_m <= farthest_m) {
                (cloud.low, cloud.high) = (cloud.low.min(place), cloud.high.max(place));
                cloud.longest_m = cloud.longest_m.max(way_m);
            }
        }
        (cloud.low.x <= cloud.high.x).then_some(cloud)
    }
}

/// The first crossing of a way with some triangles of a surface in one sense; of equals that which comes first.
pub fn first_crossing(
    from_m: [f32; 3],
    to_m: [f32; 3],
    sense: Sense,
    positions_m: &[[f32; 3]],
    triangles: &[[u32; 3]],
    among: impl Iterator<Item = u32>,
) -> Option<Crossing> {
    let (from, to) = (Vec3::from(from_m), Vec3::from(to_m));
    let mut best: Option<Crossing> = None;
    for index in among {
        let Some(triangle) = triangles.get(index as usize) else { continue };
        let corners = triangle.map(|node| positions_m.get(node as usize).copied().unwrap_or([f32::NAN; 3]));
        if let Some(found) = crossing(from, to, &corners, index, sense)
            && best.is_none_or(|known| found.fraction < known.fraction)
        {
            best = Some(found);
        }
    }
    best
}

/// Writes the triangles whose boxes meet a box, ascending; as many as there is room for.
pub fn triangles_in_box([low_m, high_m]: [[f32; 3]; 2], positions_m: &[[f32; 3]], triangles: &[[u32; 3]], out: &mut Vec<u32>) {
    let (low, high) = (Vec3::from(low_m), Vec3::from(high_m));
    out.clear();
    for (index, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|node| positions_m.get(node as usize).map_or(Vec3::NAN, |place| Vec3::from(*place)));
        let meets = a.min(b).min(c).cmple(high).all() && a.max(b).max(c).cmpge(low).all();
        if meets && out.len() < out.capacity() {
            out.push(index as u32);
        }
    }
}

/// How far the middle of a triangle came in the step, m.
fn moved_m(input: &SweepInput<'_>, triangle: &[u32; 3]) -> Vec3 {
    let velocity = |node: &u32| input.velocity_m_s.get(*node as usize).map_or(Vec3::NAN, |velocity| Vec3::from(*velocity));
    triangle.iter().map(velocity).sum::<Vec3>() * (input.dt_s / 3.0)
}

/// Where a way crosses a triangle in one sense.
fn crossing(from: Vec3, to: Vec3, corners_m: &[[f32; 3]; 3], triangle: u32, sense: Sense) -> Option<Crossing> {
    let (fraction, weights) = segment_triangle(from, to, corners_m)?;
    let [a, b, c] = corners_m.map(Vec3::from);
    let normal = (b - a).cross(c - a).try_normalize()?;
    let is_out = (to - from).dot(normal) > 0.0;
    ((sense == Sense::Out) == is_out).then_some(Crossing { triangle, fraction, weights, normal: normal.to_array() })
}

/// Fraction of the path and weights of the corners where a segment crosses a triangle; `None` for parallel, flat, or NaN.
fn segment_triangle(from: Vec3, to: Vec3, corners_m: &[[f32; 3]; 3]) -> Option<(f32, [f32; 3])> {
    let way = to - from;
    let [a, b, c] = corners_m.map(Vec3::from);
    let (ab, ac) = (b - a, c - a);
    let p = way.cross(ac);
    let scale = 1.0 / ab.dot(p);
    let s = from - a;
    let q = s.cross(ab);
    let (u, v, t) = (s.dot(p) * scale, way.dot(q) * scale, ac.dot(q) * scale);
    let within = u >= -SEAM && v >= -SEAM && u + v <= 1.0 + SEAM && (0.0..=1.0).contains(&t);
    (scale.is_finite() && within).then_some((t, [1.0 - u - v, u, v]))
}
