//! The plain data that the steps of a contact tick hand to one another. All of it is views of the caller's arrays.

use crate::ContactError;
use crate::error::same_length;
use bytemuck::{Pod, Zeroable};

/// A point found inside a tet. Plain old data: crosses process borders as it is.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct Hit {
    /// Index of the point among the points that were hashed.
    pub point: u32,
    /// Index of the tet that holds it.
    pub tet: u32,
    /// Barycentric weights of the tet's nodes at the point, each in [0, 1] up to rounding, sum 1.
    pub weights: [f32; 4],
}

/// Most hits of a point that there is room for, in the mean of all of them: two objects in which it lies.
pub const HITS_OF_A_POINT: usize = 2;
/// Most hits of a share that a worker tells, which are those of 4 096 points: the coordinator computes one with more.
pub const MOST_HITS_OF_SHARE: usize = 8192;

/// How much a step wrote and how much did not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[must_use]
pub struct Found {
    /// Entries written to the front of the output.
    pub count: usize,
    /// Entries that did not fit; 0 unless the output was too short.
    pub dropped: usize,
}

/// What is dealt out to the workers. The joined result is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// Equal sets of points, neighbours in space: each worker streams all tets past its points. The paper's way.
    Points,
    /// Equal sets of tets, dealt like cards: each worker streams its tets past all points. The station's way. Scales better, because
    /// reading the tets is the larger part of the work, and because a set of points may lie wholly outside of the tissue
    /// (`examples/contact_bench` times both).
    Tets,
}

/// One worker's part of the test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// Which share, below `count`.
    pub index: u32,
    /// Number of shares in all, at least 1.
    pub count: u32,
    /// What is dealt out; the same for all shares of a tick.
    pub split: Split,
}

impl Share {
    /// The one share that holds everything.
    pub const ALL: Share = Share { index: 0, count: 1, split: Split::Points };

    /// One of `of` parts of a share of tets, by a number that may be larger: together they are the share.
    pub fn part(self, number: u32, of: u32) -> Share {
        let of = of.max(1);
        Share { index: self.index + self.count * (number % of), count: self.count * of, split: self.split }
    }

    /// The half-open range of sorted points of this share among `len`; shares of points differ by at most one.
    ///
    /// # Errors
    /// [`ContactError::Share`] if the index is not below the count.
    pub fn points(self, len: usize) -> Result<(usize, usize), ContactError> {
        let Share { index, count, split } = self;
        if index >= count {
            return Err(ContactError::Share { index, count });
        }
        let at = |i: u32| (len as u128 * u128::from(i) / u128::from(count)) as usize;
        match split {
            Split::Points => Ok((at(index), at(index + 1))),
            Split::Tets => Ok((0, len)),
        }
    }

    /// First bundle of tets of this share and the step to its next.
    pub(crate) fn bundles(self) -> (usize, usize) {
        match self.split {
            Split::Points => (0, 1),
            Split::Tets => (self.index as usize, (self.count as usize).max(1)),
        }
    }
}

/// Whom the points belong to; parallel to the points that were hashed.
#[derive(Debug, Clone, Copy)]
pub struct Points<'a> {
    /// Object of each point.
    pub owner: &'a [u32],
    /// Tissue node that each point is, or [`crate::NONE`] for a point of a rigid object. Empty: no point is a node.
    pub node: &'a [u32],
    /// How a deformable's points meet its own tets; without it they do not.
    pub own: Option<OwnContact<'a>>,
}

/// How a deformable meets itself: a fold another fold, but no node what is beside it.
#[derive(Debug, Clone, Copy)]
pub struct OwnContact<'a> {
    /// Where the tissue's nodes are at rest, metres.
    pub rest_m: &'a [[f32; 3]],
    /// A node meets tissue that is farther from it than this at rest, metres, and never a tet that it is a corner of.
    pub beyond_m: f32,
    /// Points from this one on meet tets of their own object alone.
    pub only_from: u32,
}

impl OwnContact<'_> {
    /// Whether a place in a tet, given by the weights of its corners, was far enough from a node at rest that they may meet.
    fn is_far(&self, node: u32, tet: &[u32; 4], weights: &[f32; 4]) -> bool {
        let rest = |node: u32| self.rest_m.get(node as usize).copied().unwrap_or([f32::NAN; 3]);
        let corners = tet.map(rest);
        let away = |axis: usize| {
            let place: f32 = corners.iter().zip(weights).map(|(corner, weight)| weight * corner[axis]).sum();
            place - rest(node)[axis]
        };
        let squared: f32 = [away(0), away(1), away(2)].iter().map(|away| away * away).sum();
        squared > self.beyond_m * self.beyond_m
    }
}

impl Points<'_> {
    /// Checks the lengths against the number of points.
    pub(crate) fn check(&self, points: usize) -> Result<(), ContactError> {
        same_length("owners of points", points, self.owner.len())?;
        if self.node.is_empty() { Ok(()) } else { same_length("nodes of points", points, self.node.len()) }
    }

    /// The tissue node that a point is, if any.
    pub fn node_of(&self, point: u32) -> Option<u32> {
        self.node.get(point as usize).copied().filter(|&n| n != crate::NONE)
    }

    /// Whether a point may hit a tet that it lies in, at the place of some weights.
    #[inline(always)]
    pub fn may_hit(&self, point: u32, tet: &[u32; 4], tet_owner: u32, weights: &[f32; 4]) -> bool {
        // Most points of tissue lie in the tets that they are corners of, and hit none of them.
        if !self.may_ever_hit(point, tet, tet_owner) {
            return false;
        }
        let is_far = |own: &OwnContact<'_>| self.node_of(point).is_some_and(|node| own.is_far(node, tet, weights));
        self.owner.get(point as usize) != Some(&tet_owner) || self.own.as_ref().is_some_and(is_far)
    }

    /// Whether a point may hit a tet at any place in it.
    #[inline(always)]
    pub(crate) fn may_ever_hit(&self, point: u32, tet: &[u32; 4], tet_owner: u32) -> bool {
        match (self.owner.get(point as usize), &self.own) {
            (None, _) => false,
            (Some(&owner), own) if owner != tet_owner => own.is_none_or(|own| point < own.only_from),
            (Some(_), Some(_)) => self.node_of(point).is_some_and(|node| !tet.contains(&node)),
            (Some(_), None) => false,
        }
    }
}

/// The tets of all deformable objects, as they are now.
#[derive(Debug, Clone, Copy)]
pub struct Tissue<'a> {
    /// Node positions, metres.
    pub positions_m: &'a [[f32; 3]],
    /// Corners of each tet. An index out of range makes a tet that is never hit.
    pub tets: &'a [[u32; 4]],
    /// Object of each tet; parallel to `tets`.
    pub tet_owner: &'a [u32],
}

impl Tissue<'_> {
    /// Checks the lengths.
    pub(crate) fn check(&self) -> Result<(), ContactError> {
        same_length("owners of tets", self.tets.len(), self.tet_owner.len())
    }

    /// A node's position; NaN where there is no such node.
    #[inline(always)]
    pub(crate) fn node(&self, node: u32) -> [f32; 3] {
        self.positions_m.get(node as usize).copied().unwrap_or([f32::NAN; 3])
    }

    /// The four corners of a tet; NaN where there is no such tet or node.
    #[inline(always)]
    pub(crate) fn corners(&self, tet: u32) -> [[f32; 3]; 4] {
        self.tets.get(tet as usize).map_or([[f32::NAN; 3]; 4], |t| t.map(|n| self.node(n)))
    }

    /// The object of a tet; [`crate::NONE`] where there is no such tet.
    #[inline(always)]
    pub(crate) fn owner(&self, tet: u32) -> u32 {
        self.tet_owner.get(tet as usize).copied().unwrap_or(crate::NONE)
    }
}
