//! Consistent penetration depth and direction (Heidelberger et al. 2004).
//!
//! The nearest face is a bad guide: deep inside a wall it is the wrong side, and it changes by leaps. So depth starts where the
//! object's own edges cross the tissue's surface (border points) and travels inward from point to point: every point leaves
//! through the surface where its object came in. Points that no border reaches (a body wholly inside) leave along the way of
//! the tick before, else along their object's retreat, else by the shortest of six ways.
//!
//! Promises: directions are unit vectors, depths lie in [0, `max_depth_m`], nothing is NaN, order of the output = order of the hits.
//! A crossing whose normal opposes the direction that the point had one tick before is not believed: it is the far side of a
//! wall that was pierced.

use crate::error::same_length;
use crate::penetrate_data::{Memory, Penetration, PenetrationInput, PenetrationParams, Source, Spared};
use crate::topology::{NONE, Normals};
use crate::types::{Found, Hit, Tissue};
use crate::walk::exit_along;
use crate::{ContactError, Exit};
use glam::Vec3;

/// Buffers of the step, sized for a mesh.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    first_hit: Vec<u32>,
    normals: Normals,
    found: Vec<Way>,
    wave: Vec<u32>,
    front: Vec<u32>,
    next: Vec<u32>,
}

/// A way out; wave [`NONE`] means not found yet.
#[derive(Debug, Clone, Copy, Default)]
struct Way {
    depth_m: f32,
    direction: Vec3,
    source: u32,
}

impl Workspace {
    /// For a bounded number of points, hits and nodes.
    pub fn new(points: usize, hits: usize, nodes: usize) -> Workspace {
        let mut work = Workspace::default();
        work.fit(points, hits, nodes);
        work
    }

    /// For other numbers of them, with what memory there is. A step reads nothing that it has not written.
    pub fn fit(&mut self, points: usize, hits: usize, nodes: usize) {
        self.first_hit.resize(points, NONE);
        self.normals.fit(nodes);
        self.found.resize(hits, Way::default());
        self.wave.resize(hits, NONE);
        for ring in [&mut self.front, &mut self.next] {
            ring.clear();
            ring.reserve(hits);
        }
    }
}

/// Gives each hit its depth and direction, in the order of the hits. `memory` holds one entry for each point, all zero at first.
///
/// Hits beyond the room in `work` or `out` are counted as dropped.
///
/// # Errors
/// [`ContactError::Length`] if arrays that belong together differ in length.
pub fn penetration(
    input: &PenetrationInput<'_>,
    params: &PenetrationParams<'_>,
    memory: &mut [Memory],
    work: &mut Workspace,
    out: &mut [Penetration],
) -> Result<Found, ContactError> {
    let points = input.points_m.len();
    input.points.check(points)?;
    input.tissue.check()?;
    same_length("memories of points", points, memory.len())?;
    same_length("points of the graph", points, input.graph.points())?;
    same_length("points of the workspace", points, work.first_hit.len())?;
    same_length("nodes of the workspace", input.tissue.positions_m.len(), work.normals.nodes())?;
    let room = input.hits.len().min(work.found.len()).min(out.len());
    let mut step = Step { input, params, hits: &input.hits[..room], memory, work };
    if room > 0 {
        step.prepare();
        step.border();
        step.inward();
        step.stranded();
    }
    for (place, (hit, way)) in out.iter_mut().zip(step.hits.iter().zip(&step.work.found)) {
        *place = Penetration {
            point: hit.point,
            tet: hit.tet,
            weights: hit.weights,
            depth_m: way.depth_m,
            direction: way.direction.to_array(),
            source: way.source,
        };
    }
    step.remember();
    Ok(Found { count: room, dropped: input.hits.len() - room })
}

struct Step<'a> {
    input: &'a PenetrationInput<'a>,
    params: &'a PenetrationParams<'a>,
    hits: &'a [Hit],
    memory: &'a mut [Memory],
    work: &'a mut Workspace,
}

impl Step<'_> {
    fn prepare(&mut self) {
        self.work.normals.forget();
        self.work.first_hit.fill(NONE);
        for (i, hit) in self.hits.iter().enumerate().rev() {
            if let Some(first) = self.work.first_hit.get_mut(hit.point as usize) {
                *first = i as u32;
            }
        }
        self.work.wave[..self.hits.len()].fill(NONE);
        self.work.found[..self.hits.len()].fill(Way::default());
    }

    fn at(&self, point: u32) -> Vec3 {
        self.input.points_m.get(point as usize).map_or(Vec3::NAN, |p| Vec3::from_array(*p))
    }

    /// The hit of a point in tissue of one owner.
    fn hit_of(&self, point: u32, owner: u32) -> Option<usize> {
        let first = *self.work.first_hit.get(point as usize)? as usize;
        let same = self.hits.get(first..)?.iter().take_while(|h| h.point == point);
        same.enumerate().find(|(_, h)| self.input.tissue.owner(h.tet) == owner).map(|(k, _)| first + k)
    }

    fn remembered(&self, hit: &Hit) -> Option<Vec3> {
        let memory = self.memory.get(hit.point as usize)?;
        let direction = Vec3::from_array(memory.direction);
        (memory.owner == self.input.tissue.owner(hit.tet) && direction.is_finite())
            .then_some(direction)
            .and_then(Vec3::try_normalize)
    }

    fn exit(&mut self, hit: &Hit, to: Vec3) -> Option<Exit> {
        let (tissue, topology, from) = (self.input.tissue, self.input.topology, self.at(hit.point));
        let normals = &mut self.work.normals;
        exit_along(&tissue, topology, |node| normals.of(topology, tissue.positions_m, node), hit.tet, (from, to))
    }

    /// Border points: those with an edge to a point outside. Depth and direction are means over the crossings of these edges,
    /// weighted by 1/distance².
    fn border(&mut self) {
        self.work.front.clear();
        let (hits, graph) = (self.hits, self.input.graph);
        for (i, hit) in hits.iter().enumerate() {
            let (p, owner, before) = (self.at(hit.point), self.input.tissue.owner(hit.tet), self.remembered(hit));
            let (mut weight, mut depth, mut direction) = (0f32, 0f32, Vec3::ZERO);
            for &q in graph.joined(hit.point) {
                let to = self.at(q);
                if !to.is_finite() || self.hit_of(q, owner).is_some() {
                    continue;
                }
                let Some(exit) = self.exit(hit, to) else {
                    continue;
                };
                if before.is_some_and(|d| d.dot(exit.normal) < 0.0) {
                    continue;
                }
                let way = exit.point_m - p;
                let w = 1.0 / way.length_squared().max(NEAR_M * NEAR_M);
                weight += w;
                depth += w * way.dot(exit.normal);
                direction += w * exit.normal;
            }
            if weight > 0.0
                && let Some(direction) = steady(direction, weight)
            {
                let depth_m = self.bounded(depth / weight);
                self.work.found[i] = Way { depth_m, direction, source: Source::Border as u32 };
                self.work.wave[i] = 0;
                self.work.front.push(i as u32);
            }
        }
    }

    /// From the border inward, one ring of points after the other. A ring reads earlier rings only, so order does not matter.
    fn inward(&mut self) {
        let mut ring = 0u32;
        while !self.work.front.is_empty() {
            ring += 1;
            self.work.next.clear();
            for f in 0..self.work.front.len() {
                let hit = self.hits[self.work.front[f] as usize];
                let owner = self.input.tissue.owner(hit.tet);
                for &q in self.input.graph.joined(hit.point) {
                    if let Some(j) = self.hit_of(q, owner).filter(|&j| self.work.wave[j] == NONE) {
                        self.work.wave[j] = ring;
                        self.work.next.push(j as u32);
                    }
                }
            }
            for n in 0..self.work.next.len() {
                let i = self.work.next[n] as usize;
                self.work.found[i] = self.way_inward(i, ring);
            }
            let Workspace { front, next, .. } = &mut *self.work;
            std::mem::swap(front, next);
        }
    }

    fn way_inward(&self, i: usize, ring: u32) -> Way {
        let hit = self.hits[i];
        let (p, owner) = (self.at(hit.point), self.input.tissue.owner(hit.tet));
        let (mut weight, mut depth, mut direction, mut nearest) = (0f32, 0f32, Vec3::ZERO, (0f32, Vec3::Z));
        for &q in self.input.graph.joined(hit.point) {
            let Some(j) = self.hit_of(q, owner).filter(|&j| self.work.wave[j] < ring) else {
                continue;
            };
            let (way, known) = (self.at(q) - p, self.work.found[j]);
            let w = 1.0 / way.length_squared().max(NEAR_M * NEAR_M);
            weight += w;
            depth += w * (way.dot(known.direction) + known.depth_m);
            direction += w * known.direction;
            if w > nearest.0 {
                nearest = (w, known.direction);
            }
        }
        let direction = steady(direction, weight).unwrap_or(nearest.1);
        Way { depth_m: self.bounded(depth / weight), direction, source: Source::Inward as u32 }
    }

    /// Points that no border reached.
    fn stranded(&mut self) {
        for i in 0..self.hits.len() {
            if self.work.wave[i] == NONE {
                let hit = self.hits[i];
                let way = self.fallback(&hit);
                self.work.found[i] = way;
            }
        }
    }

    fn fallback(&mut self, hit: &Hit) -> Way {
        let owner = self.input.points.owner.get(hit.point as usize);
        let retreat = self.params.retreats.iter().find(|r| Some(&r.owner) == owner);
        let back = retreat.and_then(|r| Vec3::from_array(r.direction).try_normalize());
        let before = self.remembered(hit);
        let source = Source::Fallback as u32;
        for way in [before, back].into_iter().flatten() {
            if let Some(depth) = self.depth_along(hit, way) {
                return Way { depth_m: self.bounded(depth), direction: way, source };
            }
        }
        let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
        let mut best: Option<(f32, Vec3)> = None;
        for way in axes {
            if let Some(depth) = self.depth_along(hit, way)
                && best.is_none_or(|(least, _)| depth < least)
            {
                best = Some((depth, way));
            }
        }
        let (depth, direction) = best.unwrap_or((0.0, before.or(back).unwrap_or(Vec3::Z)));
        Way { depth_m: self.bounded(depth), direction, source }
    }

    /// Way to the surface along a unit vector, as far as four times the deepest depth.
    fn depth_along(&mut self, hit: &Hit, way: Vec3) -> Option<f32> {
        let p = self.at(hit.point);
        self.exit(hit, p + way * (4.0 * self.params.max_depth_m)).map(|exit| (exit.point_m - p).dot(way))
    }

    fn bounded(&self, depth_m: f32) -> f32 {
        let max = if self.params.max_depth_m > 0.0 { self.params.max_depth_m } else { 0.0 };
        if depth_m > 0.0 { depth_m.min(max) } else { 0.0 }
    }

    /// Keeps each point's direction for the next tick; a fallback keeps what was known before.
    fn remember(&mut self) {
        let (hits, tissue, found, spared) = (self.hits, &self.input.tissue, &self.work.found, &self.params.spared);
        let mut next = 0;
        for (point, memory) in self.memory.iter_mut().enumerate() {
            while next < hits.len() && (hits[next].point as usize) < point {
                next += 1;
            }
            let end = next + hits[next..].iter().take_while(|hit| hit.point as usize == point).count();
            let Some(h) = to_remember((&hits[next..end], &found[next..end]), tissue, spared, memory) else {
                *memory = Memory::default();
                continue;
            };
            let (owner, way) = (tissue.owner(hits[next + h].tet), found[next + h]);
            if way.source != Source::Fallback as u32 {
                let bent_m = if memory.owner == owner { memory.bent_m } else { [0.0; 3] };
                *memory = Memory { owner, direction: way.direction.to_array(), depth_m: way.depth_m, bent_m };
            } else if memory.owner != owner {
                *memory = Memory::default();
            } else {
                memory.depth_m = way.depth_m;
            }
        }
    }
}

/// Distances below this count as this in the weights, metres: a thousandth of the finest mesh.
const NEAR_M: f32 = 1.0e-6;

/// An object that a point lies in so much deeper than in another one it came into first, metres: more than depths differ by where it just touches both.
const FIRST_BY_M: f32 = 2.5e-4;

/// Which of the hits of a point is remembered: that in the object that it knows, else the first that has a sure way out; but one in an object that it came into
/// first, which it may leave by the far side while it is still in the other. What is known stays so where its way out is lost for a step. `None` if there are
/// none, but in objects that it does not meet.
fn to_remember((hits, ways): (&[Hit], &[Way]), tissue: &Tissue<'_>, spared: &Spared<'_>, memory: &Memory) -> Option<usize> {
    let is_met = |h: &usize| !spared.holds(hits[*h].point, tissue.owner(hits[*h].tet));
    let is_known = |h: &usize| memory.direction != [0.0; 3] && memory.owner == tissue.owner(hits[*h].tet);
    let is_sure = |h: &usize| ways[*h].source != Source::Fallback as u32;
    let met = (0..hits.len()).filter(is_met);
    let known = met.clone().find(is_known);
    if let Some(known) = known.filter(|known| !is_sure(known)) {
        return Some(known);
    }
    let first = known.or_else(|| met.clone().find(is_sure)).or_else(|| met.clone().next())?;
    let deepest = met.filter(is_sure).max_by(|a, b| ways[*a].depth_m.total_cmp(&ways[*b].depth_m));
    Some(deepest.filter(|h| ways[*h].depth_m > ways[first].depth_m + FIRST_BY_M).unwrap_or(first))
}

/// Mean of unit vectors from their weighted sum; `None` where they cancel.
fn steady(sum: Vec3, weight: f32) -> Option<Vec3> {
    let mean = sum / weight;
    (mean.is_finite() && mean.length_squared() > 1.0e-4).then(|| mean.normalize())
}
