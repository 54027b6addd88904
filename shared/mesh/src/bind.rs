//! Binds a surface to a volume: each vertex follows the tet that contains it, or the nearest one, by barycentric weights.
//!
//! The nearest tet is exact (a bounding-volume tree with pruning); of equally near ones the lowest index counts. The distance from a
//! point to a triangle follows Ericson, “Real-Time Collision Detection” (2005), section 5.1.5.

use crate::check::FLAT_QUALITY;
use crate::geometry::{corners, quality, signed_volume};
use crate::types::{TetMesh, TriangleMesh};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// One vertex of a surface, bound to a tet: its position is the weighted sum of the tet's nodes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Binding {
    /// Index of the tet.
    pub tet: u32,
    /// Barycentric weights of its four nodes; their sum is 1. Outside the tet some are negative.
    pub weights: [f32; 4],
}

/// How well a surface fits its volume.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BindReport {
    /// Vertices that no tet contains, beyond rounding.
    pub outside: usize,
    /// The largest distance from such a vertex to its tet.
    pub max_outside_m: f32,
    /// The vertex that has it.
    pub farthest_vertex: u32,
    /// The largest weight by magnitude. Far above 1, the surface amplifies the motion of the tets.
    pub max_weight: f32,
    /// Tets that were too flat to bind to.
    pub flat_tets_avoided: usize,
}

/// Why a surface cannot be bound.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BindError {
    /// No tet has a volume.
    #[error("none of the {tets} tets has a volume to bind a surface to; repair the volume mesh first")]
    NoVolume {
        /// How many tets there are.
        tets: usize,
    },
    /// A vertex or node is not finite.
    #[error("{what} {index} has a coordinate that is no finite number; correct it in the file, or scale by a smaller factor")]
    NotFinite {
        /// `surface vertex` or `volume node`.
        what: &'static str,
        /// Which.
        index: u32,
    },
    /// A tet names a node that is not there.
    #[error("tet {tet} names a node that is not there; repair the volume mesh first")]
    OutOfRange {
        /// The tet.
        tet: u32,
    },
}

/// Binds every vertex of `surface` to a tet of `tets`, in the same unit and frame.
///
/// A vertex inside gets weights from 0 to 1; one outside is bound to the nearest tet with extrapolating weights, and counted.
///
/// # Errors
/// A [`BindError`] if there is no tet with a volume, a coordinate is not finite, or an index is out of range.
pub fn bind(surface: &TriangleMesh, tets: &TetMesh) -> Result<(Vec<Binding>, BindReport), BindError> {
    refuse_broken(surface, tets)?;
    let (usable, flat_tets_avoided) = usable_tets(tets)?;
    let extent = usable.iter().flat_map(|tet| tet.corners).fold(0.0_f64, |most, corner| most.max(corner.abs().max_element()));
    // Single-precision coordinates of a vertex on the boundary differ from it by this much.
    let rounding_m = 4.0 * f64::from(f32::EPSILON) * extent;
    let tree = Tree::new(usable);
    let mut report = BindReport { flat_tets_avoided, ..BindReport::default() };
    let mut bindings = Vec::with_capacity(surface.positions_m.len());
    let mut stack = Vec::new();
    for (vertex, position) in surface.positions_m.iter().enumerate() {
        let point = DVec3::from_array(position.map(f64::from));
        let (tet, distance_m) = tree.nearest(point, &mut stack);
        let weights = weights(tet.corners, point).map(|weight| weight as f32);
        if distance_m > rounding_m {
            report.outside += 1;
            if distance_m as f32 > report.max_outside_m {
                report.max_outside_m = distance_m as f32;
                report.farthest_vertex = vertex as u32;
            }
        }
        report.max_weight = weights.iter().fold(report.max_weight, |most, weight| most.max(weight.abs()));
        bindings.push(Binding { tet: tet.index, weights });
    }
    Ok((bindings, report))
}

/// Positions of a bound surface from those of the volume's nodes. Allocates nothing.
///
/// # Panics
/// If `out` is not as long as `bindings`, or a binding or a tet is out of range: bindings belong to one version of the topology.
pub fn evaluate(bindings: &[Binding], tets: &[[u32; 4]], positions_m: &[[f32; 3]], out_m: &mut [[f32; 3]]) {
    assert_eq!(bindings.len(), out_m.len(), "one output per binding");
    for (binding, out) in bindings.iter().zip(out_m) {
        let nodes = tets[binding.tet as usize];
        let mut sum = [0.0_f32; 3];
        for (node, weight) in nodes.iter().zip(binding.weights) {
            let position = positions_m[*node as usize];
            for axis in 0..3 {
                sum[axis] += weight * position[axis];
            }
        }
        *out = sum;
    }
}

fn refuse_broken(surface: &TriangleMesh, tets: &TetMesh) -> Result<(), BindError> {
    for (what, positions_m) in [("surface vertex", &surface.positions_m), ("volume node", &tets.positions_m)] {
        let broken = positions_m.iter().position(|position| position.iter().any(|c| !c.is_finite()));
        if let Some(index) = broken {
            return Err(BindError::NotFinite { what, index: index as u32 });
        }
    }
    let nodes = tets.positions_m.len();
    let broken = tets.tets.iter().position(|tet| tet.iter().any(|&node| node as usize >= nodes));
    broken.map_or(Ok(()), |tet| Err(BindError::OutOfRange { tet: tet as u32 }))
}

#[derive(Clone, Copy)]
struct Tet {
    index: u32,
    corners: [DVec3; 4],
}

impl Tet {
    fn bounds(&self) -> Bounds {
        let [a, b, c, d] = self.corners;
        Bounds { min: a.min(b).min(c).min(d), max: a.max(b).max(c).max(d) }
    }

    fn middle(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / 4.0
    }
}

/// The tets that are not flat; if all are, those with any volume. And how many were left out.
fn usable_tets(mesh: &TetMesh) -> Result<(Vec<Tet>, usize), BindError> {
    let all = || mesh.tets.iter().zip(0..).map(|(&tet, index)| Tet { index, corners: corners(&mesh.positions_m, tet) });
    let mut usable: Vec<Tet> = all().filter(|tet| quality(tet.corners) >= FLAT_QUALITY).collect();
    if usable.is_empty() {
        usable = all().filter(|tet| weights(tet.corners, tet.middle()).iter().all(|weight| weight.is_finite())).collect();
    }
    let avoided = mesh.tets.len() - usable.len();
    if usable.is_empty() { Err(BindError::NoVolume { tets: mesh.tets.len() }) } else { Ok((usable, avoided)) }
}

fn weights([a, b, c, d]: [DVec3; 4], point: DVec3) -> [f64; 4] {
    let volume = signed_volume([a, b, c, d]);
    let wb = signed_volume([a, point, c, d]) / volume;
    let wc = signed_volume([a, b, point, d]) / volume;
    let wd = signed_volume([a, b, c, point]) / volume;
    [1.0 - wb - wc - wd, wb, wc, wd]
}

/// Square of the distance from a point to a tet; 0 inside.
fn distance_squared(tet: &Tet, point: DVec3) -> f64 {
    if weights(tet.corners, point).iter().all(|&weight| weight >= 0.0) {
        return 0.0;
    }
    let [a, b, c, d] = tet.corners;
    [[a, b, c], [a, b, d], [a, c, d], [b, c, d]]
        .iter()
        .map(|&face| nearest_on_triangle(face, point).distance_squared(point))
        .fold(f64::INFINITY, f64::min)
}

fn nearest_on_triangle([a, b, c]: [DVec3; 3], point: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[derive(Clone, Copy)]
struct Bounds {
    min: DVec3,
    max: DVec3,
}

impl Bounds {
    fn distance_squared(&self, point: DVec3) -> f64 {
        point.clamp(self.min, self.max).distance_squared(point)
    }
}

/// Tets in a leaf: few enough that testing them costs no more than the boxes that would part them.
const LEAF_TETS: usize = 4;

struct Branch {
    bounds: Bounds,
    /// Range of its tets in the tree's order.
    range: (usize, usize),
    /// Its two children, if it is no leaf.
    children: Option<[usize; 2]>,
}

/// A bounding-volume tree, halved by the median along the longest side: its depth is the logarithm of the number of tets.
struct Tree {
    tets: Vec<Tet>,
    branches: Vec<Branch>,
}

impl Tree {
    fn new(tets: Vec<Tet>) -> Self {
        let count = tets.len();
        let mut tree = Tree { tets, branches: Vec::with_capacity(count) };
        tree.grow(0, count);
        tree
    }

    fn grow(&mut self, start: usize, end: usize) -> usize {
        let tets = &mut self.tets[start..end];
        let bounds = tets.iter().skip(1).fold(tets[0].bounds(), |sum, tet| {
            let next = tet.bounds();
            Bounds { min: sum.min.min(next.min), max: sum.max.max(next.max) }
        });
        let branch = self.branches.len();
        self.branches.push(Branch { bounds, range: (start, end), children: None });
        if end - start > LEAF_TETS {
            let axis = (bounds.max - bounds.min).max_position();
            let order = |tet: &Tet| (tet.middle()[axis], tet.index);
            let middle = (end - start) / 2;
            tets.select_nth_unstable_by(middle, |left, right| {
                let (left, right) = (order(left), order(right));
                left.0.total_cmp(&right.0).then(left.1.cmp(&right.1))
            });
            let children = [self.grow(start, start + middle), self.grow(start + middle, end)];
            self.branches[branch].children = Some(children);
        }
        branch
    }

    /// The nearest tet and its distance. `stack` is only working space.
    fn nearest(&self, point: DVec3, stack: &mut Vec<(f64, usize)>) -> (Tet, f64) {
        let mut best = (f64::INFINITY, self.tets[0]);
        stack.clear();
        stack.push((0.0, 0));
        while let Some((bound, branch)) = stack.pop() {
            if bound > best.0 {
                continue;
            }
            let branch = &self.branches[branch];
            let Some(children) = branch.children else {
                for tet in &self.tets[branch.range.0..branch.range.1] {
                    let distance = distance_squared(tet, point);
                    if distance < best.0 || (distance == best.0 && tet.index < best.1.index) {
                        best = (distance, *tet);
                    }
                }
                continue;
            };
            let mut near = children.map(|child| (self.branches[child].bounds.distance_squared(point), child));
            if near[0].0 < near[1].0 {
                near.swap(0, 1);
            }
            stack.extend(near); // the nearer one is taken first
        }
        (best.1, best.0.sqrt())
    }
}
