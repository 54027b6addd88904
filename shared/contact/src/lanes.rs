//! Many tets made ready at once: boxes and rows of A⁻¹ in lanes, with the operations of [`TetTest::new`] in its order, so that
//! the bits are the same.

use crate::tet::{FLAT, TetTest, max, min};

/// Tets that are prepared at once.
pub(crate) const TETS: usize = 16;

type Lane = [f32; TETS];

/// Corners of some tets: `[axis][corner][lane]`, metres.
pub(crate) type Corners = [[Lane; 4]; 3];

/// Boxes of some tets, metres.
pub(crate) struct Boxes {
    pub lo: [Lane; 3],
    pub hi: [Lane; 3],
}

impl Boxes {
    #[inline(always)]
    pub fn of(x: &Corners) -> Boxes {
        let mut boxes = Boxes { lo: [[0.0; TETS]; 3], hi: [[0.0; TETS]; 3] };
        for (axis, [a, b, c, d]) in x.iter().enumerate() {
            for l in 0..TETS {
                boxes.lo[axis][l] = min(min(min(a[l], b[l]), c[l]), d[l]);
                boxes.hi[axis][l] = max(max(max(a[l], b[l]), c[l]), d[l]);
            }
        }
        boxes
    }

    /// Grown by so much on each side, m.
    #[inline(always)]
    pub fn grown(&self, by_m: f32) -> Boxes {
        let all = |lanes: &[Lane; 3], by_m: f32| lanes.map(|lane| lane.map(|at| at + by_m));
        Boxes { lo: all(&self.lo, -by_m), hi: all(&self.hi, by_m) }
    }
}

/// Some tets made ready for testing points.
pub(crate) struct Tests {
    rows: [[Lane; 3]; 3],
    sound: [u32; TETS],
}

#[inline(always)]
fn cross(a: &[Lane; 3], b: &[Lane; 3]) -> [Lane; 3] {
    let mut out = [[0.0; TETS]; 3];
    for (axis, out) in out.iter_mut().enumerate() {
        let (i, j) = ([1, 2, 0][axis], [2, 0, 1][axis]);
        for l in 0..TETS {
            out[l] = a[i][l] * b[j][l] - a[j][l] * b[i][l];
        }
    }
    out
}

impl Tests {
    #[inline(always)]
    pub fn of(x: &Corners, boxes: &Boxes) -> Tests {
        let mut edges = [[[0.0; TETS]; 3]; 3];
        for (e, edge) in edges.iter_mut().enumerate() {
            for (axis, lane) in edge.iter_mut().enumerate() {
                for l in 0..TETS {
                    lane[l] = x[axis][e + 1][l] - x[axis][0][l];
                }
            }
        }
        let [a, b, c] = &edges;
        let mut rows = [cross(b, c), cross(c, a), cross(a, b)];
        let mut sound = [0u32; TETS];
        let mut scale = [0.0; TETS];
        for l in 0..TETS {
            let det = a[0][l] * rows[0][0][l] + a[1][l] * rows[0][1][l] + a[2][l] * rows[0][2][l];
            let sides = [0, 1, 2].map(|axis| boxes.hi[axis][l] - boxes.lo[axis][l]);
            let edge = max(max(sides[0], sides[1]), sides[2]);
            scale[l] = 1.0 / det;
            let finite = (scale[l].abs() < f32::INFINITY) & (det.abs() < f32::INFINITY);
            sound[l] = u32::from((det.abs() > FLAT * edge * edge * edge) & finite);
        }
        for lane in rows.as_flattened_mut() {
            for l in 0..TETS {
                lane[l] *= scale[l];
            }
        }
        Tests { rows, sound }
    }

    /// One of the tets.
    #[inline(always)]
    pub fn get(&self, x: &Corners, boxes: &Boxes, l: usize) -> Option<TetTest> {
        let three = |v: &[Lane; 3]| [v[0][l], v[1][l], v[2][l]];
        (self.sound[l] != 0).then(|| TetTest {
            x0: [x[0][0][l], x[1][0][l], x[2][0][l]],
            lo: three(&boxes.lo),
            hi: three(&boxes.hi),
            rows: [three(&self.rows[0]), three(&self.rows[1]), three(&self.rows[2])],
        })
    }
}
