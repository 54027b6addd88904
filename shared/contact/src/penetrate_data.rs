//! What the penetration step reads and writes.

use crate::graph::PointGraph;
use crate::topology::Topology;
use crate::types::{Hit, Points, Tissue};
use bytemuck::{Pod, Zeroable};

/// How far inside a hit point is and which way out. Plain old data.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct Penetration {
    /// Index of the point.
    pub point: u32,
    /// The tet that holds it.
    pub tet: u32,
    /// Weights of the tet's nodes at the point.
    pub weights: [f32; 4],
    /// Depth along the direction, metres, at least 0.
    pub depth_m: f32,
    /// Unit vector along which the point leaves the tissue.
    pub direction: [f32; 3],
    /// Where depth and direction come from: a [`Source`] as a number.
    pub source: u32,
}

/// Where depth and direction come from.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Own edges cross the surface.
    Border = 0,
    /// From points nearer to the border.
    Inward = 1,
    /// No border in reach.
    Fallback = 2,
    /// On the far side of what it went through: from the face that it went in by. The caller's ([`crate::first_crossing`]).
    Held = 3,
}

/// A point's direction and depth in the tick before, and what its friction was then; all zero: it had none. State that goes with the tissue's.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct Memory {
    /// Object of the tet that the point was in.
    pub owner: u32,
    /// Unit vector out of the tissue, or zero.
    pub direction: [f32; 3],
    /// How deep it was along that, metres.
    pub depth_m: f32,
    /// How far it has gone along the tissue before what it sticks to, metres: who computes forces writes it, and it is kept for as long as the point is in that
    /// object, and pressed. Of two objects a point remembers the one that it came into first; the other lets go of it in each step.
    pub bent_m: [f32; 3],
}

/// The way back for points of an object that is wholly inside: for a tool, from its tip along the shaft to the pivot.
#[derive(Debug, Clone, Copy)]
pub struct Retreat {
    /// Object of the points.
    pub owner: u32,
    /// Direction; any length.
    pub direction: [f32; 3],
}

/// Bounds and fallbacks.
#[derive(Debug, Clone, Copy)]
pub struct PenetrationParams<'a> {
    /// Depths are cut here, metres: about the thickness of the wall.
    pub max_depth_m: f32,
    /// Ways back, one for each rigid object.
    pub retreats: &'a [Retreat],
    /// What of the hits nobody is to remember.
    pub spared: Spared<'a>,
}

/// Objects that some points lie in and do not meet, as jaws do what they hold.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spared<'a> {
    /// The first of these points, and the one after the last.
    pub points: [u32; 2],
    /// Numbers of the objects.
    pub objects: &'a [u32],
}

impl Spared<'_> {
    /// Whether a point does not meet an object.
    pub fn holds(&self, point: u32, object: u32) -> bool {
        (self.points[0]..self.points[1]).contains(&point) && self.objects.contains(&object)
    }
}

/// What the step reads.
#[derive(Debug, Clone, Copy)]
pub struct PenetrationInput<'a> {
    /// All hits, sorted by point and tet, as [`crate::merge`] leaves them.
    pub hits: &'a [Hit],
    /// Positions of all points, metres.
    pub points_m: &'a [[f32; 3]],
    /// Whom the points belong to.
    pub points: Points<'a>,
    /// Edges between the points.
    pub graph: &'a PointGraph,
    /// The tets as they are now.
    pub tissue: Tissue<'a>,
    /// Their faces.
    pub topology: &'a Topology,
}
