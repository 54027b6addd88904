//! Continuous test: where the path of a fast point first crosses the surface, so that nothing tunnels between two steps.
//!
//! Segment against triangle after Möller and Trumbore 1997, with a slack at the edges so that no path slips between neighbours.

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
    /// Whether the path goes from the outer side to the inner.
    pub entering: bool,
}

/// Fraction of the path and weights of the corners where a segment crosses a triangle; `None` for parallel, flat, or NaN.
pub fn segment_triangle(from_m: [f32; 3], to_m: [f32; 3], corners_m: &[[f32; 3]; 3]) -> Option<(f32, [f32; 3])> {
    let (from, way) = (Vec3::from_array(from_m), Vec3::from_array(to_m) - Vec3::from_array(from_m));
    let [a, b, c] = corners_m.map(Vec3::from_array);
    let (ab, ac) = (b - a, c - a);
    let p = way.cross(ac);
    let scale = 1.0 / ab.dot(p);
    let s = from - a;
    let q = s.cross(ab);
    let (u, v, t) = (s.dot(p) * scale, way.dot(q) * scale, ac.dot(q) * scale);
    let within = u >= -SEAM && v >= -SEAM && u + v <= 1.0 + SEAM && (0.0..=1.0).contains(&t);
    (scale.is_finite() && within).then_some((t, [1.0 - u - v, u, v]))
}

/// The first crossing of a path with a surface that stands still; of equals the triangle of lowest index.
///
/// For a moving surface pass the path relative to it. Cost: a box test per triangle; meant for the few points that move more
/// than a fraction of a tet in one step.
pub fn first_crossing(from_m: [f32; 3], to_m: [f32; 3], positions_m: &[[f32; 3]], triangles: &[[u32; 3]]) -> Option<Crossing> {
    let (from, to) = (Vec3::from_array(from_m), Vec3::from_array(to_m));
    let (lo, hi) = (from.min(to), from.max(to));
    let mut best: Option<Crossing> = None;
    for (i, tri) in triangles.iter().enumerate() {
        let corners = tri.map(|n| positions_m.get(n as usize).copied().unwrap_or([f32::NAN; 3]));
        let [a, b, c] = corners.map(Vec3::from_array);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        if low.cmpgt(hi).any() || high.cmplt(lo).any() {
            continue;
        }
        let Some((fraction, weights)) = segment_triangle(from_m, to_m, &corners) else {
            continue;
        };
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        if best.is_none_or(|known| fraction < known.fraction) {
            let entering = (to - from).dot(normal) < 0.0;
            best = Some(Crossing { triangle: i as u32, fraction, weights, normal: normal.to_array(), entering });
        }
    }
    best
}
