//! Solid cells and how fast they move: the case's walls, and the tools as capsules; and what velocity shows inside of them.
//!
//! A face between a solid cell and another carries the solid's velocity. One between two solid cells, beside the fluid, carries the mirrored velocity, so that
//! half way between them, on the wall, the medium moves with it (no slip); the ghosts of the grid's own walls do the same ([`crate::walls`]). Between two steps
//! it carries the solid's, so that what the solid leaves starts from there and not from what was mirrored ([`crate::hold`]).

use crate::error::FlowError;
use crate::field::{Read, Write};
use crate::grid::{Grid, Layout, MAX_AXIS};
use crate::inputs::{Capsule, MAX_TOOLS, tame};
use crate::kernels::{max_abs, max_abs_where, wide};
use crate::rows;
use crate::solver::Solver;
use crate::transport::step;

/// No wall is faster, m/s: twice what a tool is thrust in with. Single nodes of tissue that is cut or snaps back are, for a millisecond, and move no medium.
const MAX_WALL_M_S: f32 = 1.0;

/// The case's walls.
pub(crate) struct Walls {
    /// Of each cell, x fastest: nonzero is solid.
    pub solid: Vec<u8>,
    /// Along x, y, z, of each solid cell, m/s; 0 of the others.
    velocity_m_s: [Vec<f32>; 3],
    /// Whether one of them moves.
    moves: bool,
}

impl Walls {
    pub fn new(cells: usize) -> Self {
        Self { solid: vec![0; cells], velocity_m_s: std::array::from_fn(|_| vec![0.0; cells]), moves: false }
    }

    /// Gives how many numbers were replaced.
    fn set(&mut self, solid: &[u8], velocity_m_s: Option<&[[f32; 3]]>) -> u32 {
        self.solid.copy_from_slice(solid);
        let Some(given) = velocity_m_s else {
            if std::mem::take(&mut self.moves) {
                self.velocity_m_s.iter_mut().for_each(|along| along.fill(0.0));
            }
            return 0;
        };
        self.moves = true;
        let mut replaced = 0;
        for (axis, along) in self.velocity_m_s.iter_mut().enumerate() {
            for ((along, given), solid) in along.iter_mut().zip(given).zip(solid) {
                let (mut v, counts) = (given[axis], *solid != 0);
                if counts {
                    tame(&mut v, -MAX_WALL_M_S, MAX_WALL_M_S, 0.0, &mut replaced);
                }
                *along = if counts { v } else { 0.0 };
            }
        }
        replaced
    }

    /// The velocity of the faces of padded layer `kk` that touch a wall; those on the sides of the grid stay at rest.
    fn give_faces(&self, layout: &Layout, kk: usize, faces: &mut [Write<'_>; 3]) {
        let [nx, ny, _] = layout.n;
        let strides = [1, nx, nx * ny];
        for (axis, (face, back)) in faces.iter_mut().zip(strides).enumerate() {
            let (plane, velocity, from) = (face.layer(kk), &self.velocity_m_s[axis], usize::from(axis == 0));
            if axis == 2 && kk == 1 {
                continue;
            }
            wide(
                #[inline(always)]
                || {
                    for j in usize::from(axis == 1)..ny {
                        let (o, first) = (layout.row(j), ((kk - 1) * ny + j) * nx);
                        let (here, there) = (first + from..first + nx, first + from - back..first + nx - back);
                        let solid = [&self.solid[here.clone()], &self.solid[there.clone()]];
                        rows::wall(&mut plane[o + from..o + nx], solid, [&velocity[here], &velocity[there]]);
                    }
                },
            );
        }
    }
}

/// A capsule in the grid: its box in cells, and the test of a point.
pub(crate) struct Tool<'a> {
    capsule: &'a Capsule,
    pub low: [usize; 3],
    pub high: [usize; 3],
}

impl<'a> Tool<'a> {
    fn new(grid: &Grid, capsule: &'a Capsule) -> Option<Self> {
        if capsule.radius_m <= 0.0 {
            return None;
        }
        let (a, b) = (grid.to_cells(capsule.a_m), grid.to_cells(capsule.b_m));
        let mut low = [0; 3];
        let mut high = [0; 3];
        for axis in 0..3 {
            let reach = capsule.radius_m / grid.spacing_m()[axis] + 1.0;
            low[axis] = (a[axis].min(b[axis]) - reach).max(0.0) as usize;
            high[axis] = ((a[axis].max(b[axis]) + reach).max(0.0) as usize + 1).min(grid.cells()[axis]);
        }
        (0..3).all(|axis| low[axis] < high[axis]).then_some(Self { capsule, low, high })
    }

    pub fn all(grid: &Grid, capsules: &'a [Capsule; MAX_TOOLS]) -> [Option<Self>; MAX_TOOLS] {
        capsules.each_ref().map(|capsule| Tool::new(grid, capsule))
    }

    /// Velocity of the capsule at a point inside it, m/s.
    pub fn velocity_at(&self, p: [f32; 3]) -> Option<[f32; 3]> {
        let c = self.capsule;
        let axis: [f32; 3] = std::array::from_fn(|n| c.b_m[n] - c.a_m[n]);
        let from: [f32; 3] = std::array::from_fn(|n| p[n] - c.a_m[n]);
        let dot = |x: &[f32; 3], y: &[f32; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
        let length2 = dot(&axis, &axis);
        let t = if length2 > 0.0 { (dot(&from, &axis) / length2).clamp(0.0, 1.0) } else { 0.0 };
        let off: [f32; 3] = std::array::from_fn(|n| from[n] - t * axis[n]);
        (dot(&off, &off) <= c.radius_m * c.radius_m)
            .then(|| std::array::from_fn(|n| c.velocity_a_m_s[n] + t * (c.velocity_b_m_s[n] - c.velocity_a_m_s[n])))
    }

    /// Calls `found(i, velocity)` for each cell of row (j, k) inside the tool.
    pub fn carve(&self, grid: &Grid, j: usize, k: usize, mut found: impl FnMut(usize, [f32; 3])) {
        if !(self.low[1]..self.high[1]).contains(&j) || !(self.low[2]..self.high[2]).contains(&k) {
            return;
        }
        for i in self.low[0]..self.high[0] {
            if let Some(v) = self.velocity_at(grid.centre_m([i, j, k])) {
                found(i, v);
            }
        }
    }

    /// Whether faces of padded layer `kk` can touch the tool: those of its own layers of cells, and those on top of its highest.
    fn reaches(&self, kk: usize) -> bool {
        (self.low[2] + 1..self.high[2] + 2).contains(&kk)
    }

    /// Gives the faces of padded layer `kk` that touch the tool its velocity; faces on the sides of the grid stay at rest.
    fn give_faces(&self, layout: &Layout, grid: &Grid, kk: usize, faces: &mut [Write<'_>; 3]) {
        let [nx, ny, _] = layout.n;
        for j in 0..ny {
            let o = layout.row(j);
            if kk >= 2 {
                let below = faces[2].layer(kk);
                self.carve(grid, j, kk - 2, |i, v| below[o + i] = v[2]);
            }
            self.carve(grid, j, kk - 1, |i, v| {
                for at in [i, i + 1].into_iter().filter(|at| (1..nx).contains(at)) {
                    faces[0].layer(kk)[o + at] = v[0];
                }
                for at in [j, j + 1].into_iter().filter(|at| (1..ny).contains(at)) {
                    faces[1].layer(kk)[layout.row(at) + i] = v[1];
                }
                if kk >= 2 {
                    faces[2].layer(kk)[o + i] = v[2];
                }
            });
        }
    }
}

impl Solver {
    /// Sets the solid cells of the case, which are at rest, x fastest, then y, then z; 0 is fluid, anything else solid. Between steps only.
    ///
    /// # Errors
    /// [`FlowError::Length`] if it is not one byte per cell; [`FlowError::PhaseConflict`] during a phase.
    pub fn set_mask(&self, solid: &[u8]) -> Result<(), FlowError> {
        self.set(solid, None).map(|_| ())
    }

    /// The same with the velocity of each cell, m/s, of which those of solid cells count; what is no number counts as 0, and what is
    /// faster than 1 m/s as that. Returns how many such numbers there were.
    ///
    /// # Errors
    /// As [`Self::set_mask`].
    pub fn set_walls(&self, solid: &[u8], velocity_m_s: &[[f32; 3]]) -> Result<u32, FlowError> {
        self.set(solid, Some(velocity_m_s))
    }

    fn set(&self, solid: &[u8], velocity_m_s: Option<&[[f32; 3]]>) -> Result<u32, FlowError> {
        let mut base = self.base.try_write().ok_or(FlowError::PhaseConflict)?;
        let want = base.solid.len();
        let lengths = [Some(("the mask", solid.len())), velocity_m_s.map(|given| ("the walls' velocity", given.len()))];
        match lengths.into_iter().flatten().find(|(_, got)| *got != want) {
            Some((what, got)) => Err(FlowError::Length { what, got, want }),
            None => Ok(base.set(solid, velocity_m_s)),
        }
    }

    /// Phase Mask: fluid (1) and solid (0) cells, the velocity of solid faces, and the largest Courant number per second.
    pub(crate) fn mask_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let base = self.base.try_read().ok_or(FlowError::PhaseConflict)?;
        let mut fluid = self.fluid.write(band)?;
        let mut faces = [self.face[0].write(band)?, self.face[1].write(band)?, self.face[2].write(band)?];
        let now = self.read_velocity(plan.roles.now)?;
        let grid = &self.model.grid;
        let tools = Tool::all(grid, &plan.inputs.tools);
        let [nx, ny, _] = layout.n;
        let mut row = [0.0f32; MAX_AXIS];
        let row = &mut row[..nx];
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            *sum = Default::default();
            let plane = fluid.layer(kk);
            for j in 0..ny {
                let from = ((kk - 1) * ny + j) * nx;
                for (r, &solid) in row.iter_mut().zip(&base.solid[from..from + nx]) {
                    *r = if solid == 0 { 1.0 } else { 0.0 };
                }
                for tool in tools.iter().flatten() {
                    tool.carve(grid, j, kk - 1, |i, _| row[i] = 0.0);
                }
                let o = layout.row(j);
                if !rows::are_same(&plane[o..o + nx], row) {
                    sum.count += 1;
                    plane[o..o + nx].copy_from_slice(row);
                }
            }
            for face in &mut faces {
                face.layer(kk).fill(0.0);
            }
            if base.moves {
                base.give_faces(layout, kk, &mut faces);
            }
            for tool in tools.iter().flatten() {
                tool.give_faces(layout, grid, kk, &mut faces);
            }
            // What faces within solids show is no flow. Where no solid moves they are at rest.
            let plane = &*fluid.layer(kk);
            let moves = base.moves || tools.iter().flatten().any(|tool| tool.reaches(kk));
            for ((now, face), h) in now.iter().zip(&mut faces).zip(grid.spacing_m()) {
                let face = &*face.layer(kk);
                let most = wide(
                    #[inline(always)]
                    || {
                        let flow = max_abs_where(now.layer(kk), plane);
                        if moves { flow.max(max_abs(face)) } else { flow }
                    },
                );
                sum.top = sum.top.max(most / h);
            }
        }
        Ok(())
    }

    /// Phase Mirror: what each face that touches a solid is to show: the solid's velocity, or within solids beside the fluid the mirrored one.
    pub(crate) fn mirror_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let fluid = self.fluid.read()?;
        for component in 0..3 {
            let (now, face) = (self.velocity[plan.roles.now][component].read()?, self.face[component].read()?);
            let mut held = self.held[component].write(band)?;
            for kk in layout.own(band) {
                let (out, face) = (held.layer(kk), face.layer(kk));
                let planes = Planes::new(layout, &fluid, &now, component, kk);
                wide(
                    #[inline(always)]
                    || {
                        for j in 0..layout.n[1] {
                            // Where all is fluid nothing is held; before the first cell along x is the grid's side, and that is at rest.
                            if spans.is_free_row(component, kk, j) {
                                continue;
                            }
                            let (o, near) = (layout.row(j), spans.near_row(kk, j));
                            let range = o + near.start..o + near.end;
                            // Far from the fluid no face is beside one that the medium goes through.
                            for far in [o..range.start, range.end..o + layout.n[0]] {
                                out[far.clone()].copy_from_slice(&face[far]);
                            }
                            let own = planes.own.map(|(plane, at)| &plane[range.start - at..range.end - at]);
                            let around = planes.around(range.start, range.len());
                            rows::mirror(&mut out[range.clone()], &face[range], own, &around);
                        }
                    },
                );
            }
        }
        Ok(())
    }
}

/// What lies on both sides of the faces of a component in a layer, and of those beside them across its own axis.
struct Planes<'a> {
    /// The plane of the cells after and before each face, and how far back in it they are.
    own: [(&'a [f32], usize); 2],
    /// Four ways: the planes of the cells after and before each face and of the velocity, and where in them they are, from the face itself.
    beside: [([&'a [f32]; 3], [isize; 3]); 4],
}

impl<'a> Planes<'a> {
    fn new(layout: &Layout, fluid: &'a Read<'_>, velocity: &'a Read<'_>, component: usize, kk: usize) -> Self {
        // Far enough from both ends that no step leaves it.
        let middle = layout.plane / 2;
        let (back_k, back) = step(component, kk, middle, layout.stride, false);
        let beside = std::array::from_fn(|way| {
            let axis = (component + 1 + way / 2) % 3;
            let (k, at) = step(axis, kk, middle, layout.stride, way % 2 == 1);
            let (back_k, back) = step(component, k, at, layout.stride, false);
            let from = |at: usize| at as isize - middle as isize;
            ([fluid.layer(k), fluid.layer(back_k), velocity.layer(k)], [from(at), from(back), from(at)])
        });
        Self { own: [(fluid.layer(kk), 0), (fluid.layer(back_k), middle - back)], beside }
    }

    /// The four rows beside `n` faces from `o` on.
    #[inline(always)]
    fn around(&self, o: usize, n: usize) -> [[&'a [f32]; 3]; 4] {
        self.beside.map(|(planes, from)| {
            std::array::from_fn(|row| {
                let at = o.wrapping_add_signed(from[row]);
                &planes[row][at..at + n]
            })
        })
    }
}
