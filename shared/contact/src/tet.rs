//! The barycentric test of Teschner et al. 2003: β = A⁻¹(p − x0) with A = [x1−x0, x2−x0, x3−x0], inside if all β ≥ 0 and Σβ ≤ 1.
//!
//! The operations and their order are fixed here once, without fused multiply-add, so that the scalar test and the test in
//! lanes give the same bits on every instruction set. A point counts only inside the tet's own box too: rounding in a sliver
//! can then never accept a point that a search by box would not have looked at.

/// Tets of which six times the volume is below this fraction of the cube of their box's longest edge are flat: there rounding takes more than [`HAIR`] from a
/// weight, and so would put points in them that are beside them.
pub(crate) const FLAT: f32 = 1.0e-4;
/// What rounding may take from a weight in a tet that is not flat.
const HAIR: f32 = 0.01;

/// A tet made ready for testing points.
#[derive(Debug, Clone, Copy)]
pub struct TetTest {
    /// First corner, metres.
    pub x0: [f32; 3],
    /// Lower corner of the box, metres.
    pub lo: [f32; 3],
    /// Upper corner of the box, metres.
    pub hi: [f32; 3],
    /// Rows of A⁻¹: the gradients of the weights of corners 1, 2 and 3, 1/m.
    pub rows: [[f32; 3]; 3],
}

#[inline(always)]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The largest of some numbers without their signs: then their bits are in their order, and those of no number above all of them.
#[inline(always)]
pub(crate) fn most(numbers: impl Iterator<Item = f32>) -> f32 {
    f32::from_bits(numbers.fold(0, |most, number| most.max(number.abs().to_bits())))
}

#[inline(always)]
fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl TetTest {
    /// Prepares a tet; `None` if it is flat or has a corner that is not finite. Inverted tets are as good as others.
    #[inline(always)]
    pub fn new(x: &[[f32; 3]; 4]) -> Option<TetTest> {
        let (mut lo, mut hi) = (x[0], x[0]);
        for corner in &x[1..] {
            for axis in 0..3 {
                lo[axis] = min(lo[axis], corner[axis]);
                hi[axis] = max(hi[axis], corner[axis]);
            }
        }
        let (a, b, c) = (sub(x[1], x[0]), sub(x[2], x[0]), sub(x[3], x[0]));
        let rows = [cross(b, c), cross(c, a), cross(a, b)];
        let det = dot(a, rows[0]);
        let edge = max(max(hi[0] - lo[0], hi[1] - lo[1]), hi[2] - lo[2]);
        let scale = 1.0 / det;
        if det.abs() > FLAT * edge * edge * edge && scale.is_finite() && det.is_finite() {
            Some(TetTest { x0: x[0], lo, hi, rows: rows.map(|r| r.map(|v| v * scale)) })
        } else {
            None
        }
    }

    /// Weights of the four corners at any point, inside or not.
    #[inline(always)]
    pub fn weights_at(&self, p: [f32; 3]) -> [f32; 4] {
        let d = sub(p, self.x0);
        let (b1, b2, b3) = (dot(d, self.rows[0]), dot(d, self.rows[1]), dot(d, self.rows[2]));
        [1.0 - (b1 + b2 + b3), b1, b2, b3]
    }

    /// Weights of the four corners at a point inside, `None` outside and for NaN.
    #[inline(always)]
    pub fn weights(&self, p: [f32; 3]) -> Option<[f32; 4]> {
        let w = self.weights_at(p);
        let boxed = (0..3).all(|i| p[i] >= self.lo[i] && p[i] <= self.hi[i]);
        (boxed && w.iter().all(|&v| v >= 0.0)).then_some(w)
    }

    /// Gradient of one corner's weight, 1/m: it points away from the face opposite to that corner, into the tet.
    pub fn gradient(&self, corner: usize) -> [f32; 3] {
        match corner {
            0 => std::array::from_fn(|i| -(self.rows[0][i] + self.rows[1][i] + self.rows[2][i])),
            n => self.rows[(n - 1).min(2)],
        }
    }

    /// For each lane 1 if the point is inside, else 0.
    #[inline(always)]
    pub(crate) fn inside_lanes<const L: usize>(&self, x: &[f32; L], y: &[f32; L], z: &[f32; L]) -> [u32; L] {
        let mut inside = [0u32; L];
        for l in 0..L {
            let [b0, b1, b2, b3] = self.weights_at([x[l], y[l], z[l]]);
            let weighed = (b0 >= 0.0) & (b1 >= 0.0) & (b2 >= 0.0) & (b3 >= 0.0);
            let boxed = (x[l] >= self.lo[0])
                & (x[l] <= self.hi[0])
                & (y[l] >= self.lo[1])
                & (y[l] <= self.hi[1])
                & (z[l] >= self.lo[2])
                & (z[l] <= self.hi[2]);
            inside[l] = u32::from(weighed & boxed);
        }
        inside
    }

    /// For each lane 1 if the point may lie inside once it and the corners have come so far on each axis together, m, else 0. The weights in a sliver are not
    /// exact enough to tell: then 1 for all.
    #[inline(always)]
    pub(crate) fn near_lanes<const L: usize>(&self, [x, y, z]: [&[f32; L]; 3], margin_m: f32) -> [u32; L] {
        /// Of a sliver some height is a smaller share of its box than one in so many.
        const SLIVER: f32 = 12.0;
        let [r1, r2, r3] = self.rows;
        let gradients: [[f32; 3]; 4] = [[0, 1, 2].map(|axis| r1[axis] + r2[axis] + r3[axis]), r1, r2, r3];
        // How much a weight falls on such a way at most.
        let falls = gradients.map(|gradient| margin_m * (gradient[0].abs() + gradient[1].abs() + gradient[2].abs()));
        let sides = [0, 1, 2].map(|axis| self.hi[axis] - self.lo[axis]);
        let steepest = max(max(falls[0], falls[1]), max(falls[2], falls[3]));
        let is_whole = steepest * max(max(sides[0], sides[1]), sides[2]) <= SLIVER * margin_m;
        // Once for the weight now, and once for the one then.
        let least = falls.map(|fall| -(fall + 2.0 * HAIR));
        let mut near = [0u32; L];
        for l in 0..L {
            let [b0, b1, b2, b3] = self.weights_at([x[l], y[l], z[l]]);
            near[l] = u32::from(!is_whole | ((b0 >= least[0]) & (b1 >= least[1]) & (b2 >= least[2]) & (b3 >= least[3])));
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_what_may_come_in_on_such_a_way_and_of_a_sliver_everything() {
        let near = |corners: &[[f32; 3]; 4], points: [[f32; 3]; 4]| {
            let axis = |axis: usize| points.map(|point| point[axis]);
            TetTest::new(corners).unwrap().near_lanes([&axis(0), &axis(1), &axis(2)], 0.1)
        };
        let corner = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let beside = |x: f32| [x, 0.3, 0.3];
        assert_eq!(near(&corner, [beside(0.1), beside(-0.1), beside(-0.13), [f32::NAN; 3]]), [1, 1, 0, 0]);
        // The slope is met by a way on all three axes.
        assert_eq!(near(&corner, [0.43, 0.435, 0.445, 0.5].map(|at| [at; 3])), [1, 1, 0, 0]);
        assert_eq!(
            near(&[corner[1], corner[0], corner[2], corner[3]], [-0.1, -0.13, 0.1, 0.2].map(beside)),
            [1, 0, 1, 1],
            "inverted"
        );
        let needle = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2e-2, 0.0], [0.0, 0.0, 2e-2]];
        assert_eq!(near(&needle, [beside(0.5), [0.5, 9.0, 0.0], [-9.0; 3], [9.0; 3]]), [1; 4]);
    }
}
