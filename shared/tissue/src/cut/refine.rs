//! Makes the mesh fit the sheet: snaps nodes to it and bisects edges, until no edge leads from one side to the other.

use super::places::{Sides, at, corners, edge_of_number, number_of_edge, to_single};
use super::sheet::{Crossing, Sheet};
use super::stars::Stars;
use super::{CutOptions, CutReport, Cuttable};
use glam::{DMat3, DVec3};
use hyst_mesh::{quality, signed_volume};

/// An edge may cross a sheet so often that is bent (a loop twice): each round finds the first crossing of each edge that is left.
const ROUNDS: usize = 4;
/// A node that is marked lies on the sheet that crosses an edge of it if the two normals have this cosine at least: a loop's other side is another place.
const SAME_SHEET: f64 = 0.5;

/// A tissue while it is cut.
pub struct Work<'a> {
    pub tissue: &'a mut Cuttable,
    pub options: &'a CutOptions,
    /// Tets of each node.
    pub star: Stars,
    /// Nodes that no tet uses, the lowest last: they are used again.
    pub free: Vec<u32>,
    /// Tets that may touch the sheet, some more than once.
    near: Vec<u32>,
    /// Tets with three nodes on the sheet at least, once it is opened: a copy of a node is on it as the node is, so that they stay these.
    pub on_sheet: Vec<u32>,
    /// Tets that were given other nodes, or one of whose nodes has moved; some more than once, and some that are again what they were.
    pub touched: Vec<u32>,
}

/// An edge that crosses the sheet: its ends, the lower node first.
type Crossed = ([u32; 2], Crossing);

impl<'a> Work<'a> {
    /// `near`: the tets that may touch the sheet.
    pub fn new(tissue: &'a mut Cuttable, options: &'a CutOptions, near: Vec<u32>) -> Work<'a> {
        let nodes = tissue.rest.positions_m.len();
        let star = Stars::new(nodes, &tissue.rest.tets);
        let free = (0..nodes as u32).rev().filter(|node| star.of(*node).is_empty()).collect();
        Work { tissue, options, star, free, near, on_sheet: Vec::new(), touched: Vec::new() }
    }

    /// Tets that have both nodes.
    fn around(&self, [a, b]: [u32; 2]) -> Vec<u32> {
        let has_b = |tet: &u32| self.tissue.rest.tets[*tet as usize].contains(&b);
        self.star.of(a).iter().copied().filter(has_b).collect()
    }

    pub fn mark(&self, node: u32) -> DVec3 {
        at(&self.tissue.marks, node).normalize_or_zero()
    }

    pub fn is_marked(&self, node: u32) -> bool {
        self.tissue.marks[node as usize] != [0.0; 3]
    }

    /// All crossings, by edge.
    fn crossings(&self, sheet: &Sheet) -> Vec<Crossed> {
        const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
        let position_m = &self.tissue.position_m;
        let mut edges: Vec<u64> = Vec::with_capacity(2 * self.near.len());
        for tet in &self.near {
            let nodes = self.tissue.rest.tets[*tet as usize];
            let sides = nodes.map(|node| sheet.sides(&position_m[node as usize]));
            let near = EDGES.into_iter().filter(|[a, b]| Sides::touch([sides[*a], sides[*b]]));
            edges.extend(near.map(|[a, b]| number_of_edge([nodes[a], nodes[b]])));
        }
        edges.sort_unstable();
        edges.dedup();
        let crosses = |edge: [u32; 2]| Some((edge, sheet.crossing(at(position_m, edge[0]), at(position_m, edge[1]))?));
        edges.into_iter().map(edge_of_number).filter_map(crosses).collect()
    }

    pub fn refine(&mut self, sheet: &Sheet, report: &mut CutReport) {
        for _ in 0..ROUNDS {
            let mut crossings = self.crossings(sheet);
            let moved_nodes = report.moved_nodes;
            // Ends first: an end that is snapped spares the bisection of all the other edges that cross near it.
            for (edge, crossing) in &crossings {
                self.snap(*edge, *crossing, report);
            }
            // Where no node has moved they are what they were.
            if report.moved_nodes > moved_nodes {
                crossings = self.crossings(sheet);
            }
            let mut is_done = true;
            for (edge, crossing) in crossings {
                is_done &= !self.divide(edge, crossing, report);
            }
            if is_done {
                return;
            }
        }
    }

    /// The sheet's normal in the shape at rest, at an edge: Fᵀ n, over the tets around it by their volumes.
    fn material_normal(&self, around: &[u32], normal: DVec3) -> DVec3 {
        let sides = |positions_m: &[[f32; 3]], tet: u32| {
            let [a, b, c, d] = corners(positions_m, self.tissue.rest.tets[tet as usize]);
            DMat3::from_cols(b - a, c - a, d - a)
        };
        let pulled_back = around.iter().map(|tet| {
            let (rest, now) = (sides(&self.tissue.rest.positions_m, *tet), sides(&self.tissue.position_m, *tet));
            (now * rest.inverse()).transpose() * normal * rest.determinant()
        });
        let sum: DVec3 = pulled_back.filter(|normal| normal.is_finite()).sum();
        sum.try_normalize().unwrap_or(normal)
    }

    /// Whether a node lies on the sheet that crosses an edge of it.
    fn is_on(&self, node: u32, material_normal: DVec3) -> bool {
        self.mark(node).dot(material_normal) >= SAME_SHEET
    }

    fn put_mark(&mut self, node: u32, material_normal: DVec3) {
        let sum = self.mark(node) + material_normal;
        self.tissue.marks[node as usize] = to_single(sum.try_normalize().unwrap_or(material_normal));
    }

    /// Snaps the nearer end to the sheet, if the edge crosses near enough to it.
    fn snap(&mut self, edge: [u32; 2], crossing: Crossing, report: &mut CutReport) {
        let (near, distance) = nearer(edge, crossing.share);
        if distance > self.options.snap_share {
            return;
        }
        let normal = self.material_normal(&self.around(edge), crossing.normal);
        if self.is_on(near, normal) {
            return;
        }
        report.snapped_nodes += 1;
        if !self.is_marked(near) && self.move_along(near, edge, crossing.share) {
            report.moved_nodes += 1;
            // It takes along tets that were clear of the sheet.
            self.near.extend(self.star.of(near));
            self.touched.extend(self.star.of(near));
        }
        self.put_mark(near, normal);
    }

    /// Bisects an edge that has no end on the sheet yet; or snaps the nearer end after all. Tells whether it was bisected.
    fn divide(&mut self, edge: [u32; 2], crossing: Crossing, report: &mut CutReport) -> bool {
        let around = self.around(edge);
        let normal = self.material_normal(&around, crossing.normal);
        if around.is_empty() || edge.into_iter().any(|end| self.is_on(end, normal)) {
            return false;
        }
        let options = self.options;
        let has_room = self.room() > 0 && self.tissue.rest.tets.len() + around.len() <= options.max_tets;
        if has_room && self.may_bisect(edge, &around, crossing.share) {
            let node = self.bisect(edge, &around, crossing.share);
            self.put_mark(node, normal);
            report.split_edges += 1;
            return true;
        }
        report.out_of_room += usize::from(!has_room);
        report.snapped_nodes += 1;
        self.put_mark(nearer(edge, crossing.share).0, normal);
        false
    }

    /// The two tets that a tet becomes.
    fn halves(&self, tet: u32, [a, b]: [u32; 2], middle: u32) -> [[u32; 4]; 2] {
        let nodes = self.tissue.rest.tets[tet as usize];
        [b, a].map(|old| nodes.map(|node| if node == old { middle } else { node }))
    }

    fn may_bisect(&self, edge: [u32; 2], around: &[u32], share: f64) -> bool {
        let rest_m = &self.tissue.rest.positions_m;
        let [a, b] = edge.map(|end| at(rest_m, end));
        if a.distance(b) < 2.0 * self.options.min_edge_m {
            return false;
        }
        let middle = at(&[to_single(a.lerp(b, share))], 0);
        around.iter().all(|tet| {
            let nodes = self.tissue.rest.tets[*tet as usize];
            [edge[1], edge[0]].into_iter().all(|old| {
                let corners = nodes.map(|node| if node == old { middle } else { at(rest_m, node) });
                self.is_good(corners)
            })
        })
    }

    fn is_good(&self, corners: [DVec3; 4]) -> bool {
        signed_volume(corners) > 0.0 && quality(corners) >= self.options.min_quality
    }

    /// Bisects an edge and all tets around it. Places, velocities and masses are as linear as the elements are: momentum is kept.
    fn bisect(&mut self, edge: [u32; 2], around: &[u32], share: f64) -> u32 {
        let middle = self.add_node(edge, share);
        for tet in around {
            let [first, second] = self.halves(*tet, edge, middle);
            let new = self.tissue.rest.tets.len() as u32;
            self.tissue.rest.tets[*tet as usize] = first;
            self.tissue.rest.tets.push(second);
            self.tissue.rest.regions.push(self.tissue.rest.regions[*tet as usize]);
            self.tissue.material.extend(self.tissue.material.get(*tet as usize).copied());
            self.near.push(new);
            self.touched.extend([*tet, new]);
            self.star.retain(edge[1], |other| other != *tet);
            second.iter().for_each(|node| self.star.push(*node, new));
            self.star.push(middle, *tet);
        }
        middle
    }

    /// Nodes that can still be added.
    pub fn room(&self) -> usize {
        self.free.len() + self.options.max_nodes.saturating_sub(self.star.nodes())
    }

    /// A node that no tet uses, as another one is; the caller has seen that there is room.
    pub fn copy_node(&mut self, node: u32) -> u32 {
        let copy = self.free.pop().unwrap_or(self.star.nodes() as u32);
        let tissue = &mut *self.tissue;
        for points in [&mut tissue.rest.positions_m, &mut tissue.position_m, &mut tissue.velocity_m_s, &mut tissue.marks] {
            let point = points[node as usize];
            match points.get_mut(copy as usize) {
                Some(old) => *old = point,
                None => points.push(point),
            }
        }
        let fixed = tissue.fixed[node as usize];
        match tissue.fixed.get_mut(copy as usize) {
            Some(old) => *old = fixed,
            None => tissue.fixed.push(fixed),
        }
        if copy as usize == self.star.nodes() {
            self.star.add_node();
        }
        copy
    }

    fn add_node(&mut self, [a, b]: [u32; 2], share: f64) -> u32 {
        let node = self.copy_node(a);
        let tissue = &mut *self.tissue;
        for points in [&mut tissue.rest.positions_m, &mut tissue.position_m, &mut tissue.velocity_m_s] {
            points[node as usize] = to_single(at(points, a).lerp(at(points, b), share));
        }
        tissue.fixed[node as usize] = tissue.fixed[a as usize] && tissue.fixed[b as usize];
        tissue.marks[node as usize] = [0.0; 3];
        node
    }

    /// Moves an inner node along an edge onto the sheet, if all its tets stay good; the others only lend it their name.
    fn move_along(&mut self, node: u32, [a, b]: [u32; 2], share: f64) -> bool {
        let keeps_place = self.tissue.keeps_place.get(node as usize).is_some_and(|keeps_place| *keeps_place);
        if keeps_place || self.tissue.fixed[node as usize] || !self.is_inner(node) {
            return false;
        }
        let between = |points: &[[f32; 3]]| to_single(at(points, a).lerp(at(points, b), share));
        let [rest, now] = [&self.tissue.rest.positions_m, &self.tissue.position_m].map(|points| between(points));
        let velocity = between(&self.tissue.velocity_m_s);
        // At rest it keeps its quality, and where it is now it turns no tet inside out.
        let stays_good = |tet: &u32| {
            let nodes = self.tissue.rest.tets[*tet as usize];
            let with = |points: &[[f32; 3]], moved: [f32; 3]| {
                nodes.map(|other| if other == node { at(&[moved], 0) } else { at(points, other) })
            };
            self.is_good(with(&self.tissue.rest.positions_m, rest))
                && (signed_volume(with(&self.tissue.position_m, now)) > 0.0
                    || signed_volume(corners(&self.tissue.position_m, nodes)) <= 0.0)
        };
        if !self.star.of(node).iter().all(stays_good) {
            return false;
        }
        let before = self.momentum_of_star(node);
        let tissue = &mut *self.tissue;
        tissue.rest.positions_m[node as usize] = rest;
        tissue.position_m[node as usize] = now;
        tissue.velocity_m_s[node as usize] = velocity;
        let lost = before - self.momentum_of_star(node);
        self.push_star(node, lost);
        true
    }

    /// Momentum of the tets around a node over the density, m⁴/s: a quarter of each tet belongs to each of its nodes.
    fn momentum_of_star(&self, node: u32) -> DVec3 {
        let of_tet = |tet: &u32| {
            let nodes = self.tissue.rest.tets[*tet as usize];
            let volume = signed_volume(corners(&self.tissue.rest.positions_m, nodes));
            nodes.iter().map(|node| at(&self.tissue.velocity_m_s, *node)).sum::<DVec3>() * (volume / 4.0)
        };
        self.star.of(node).iter().map(of_tet).sum()
    }

    /// Gives the free nodes around a node so much momentum over the density, m⁴/s, each by the mass that it has in the star.
    fn push_star(&mut self, node: u32, momentum: DVec3) {
        let rest = &self.tissue.rest;
        let volume = |tet: &u32| signed_volume(corners(&rest.positions_m, rest.tets[*tet as usize]));
        let mut others: Vec<u32> = self.star.of(node).iter().flat_map(|tet| rest.tets[*tet as usize]).collect();
        others.sort_unstable();
        others.dedup();
        others.retain(|other| !self.tissue.fixed[*other as usize]);
        let in_star = |tet: &&u32| rest.tets[**tet as usize].contains(&node);
        // A node's volume is a quarter of its tets': of all of them, and of those in the star.
        let volumes = others.iter().map(|other| {
            let star = self.star.of(*other);
            (star.iter().map(volume).sum::<f64>() / 4.0, star.iter().filter(in_star).map(volume).sum::<f64>() / 4.0)
        });
        let volumes: Vec<(f64, f64)> = volumes.collect();
        let in_all: f64 = volumes.iter().map(|(_, own)| own).sum();
        let pushes: Vec<(u32, DVec3)> =
            others.iter().zip(&volumes).map(|(other, (all, own))| (*other, momentum * (own / (all * in_all)))).collect();
        for (other, push) in pushes.into_iter().filter(|(_, push)| push.is_finite()) {
            self.tissue.velocity_m_s[other as usize] = to_single(at(&self.tissue.velocity_m_s, other) + push);
        }
    }
}

/// The end that a crossing is nearer to, and its distance as a share of the edge.
fn nearer([a, b]: [u32; 2], share: f64) -> (u32, f64) {
    if share <= 0.5 { (a, share) } else { (b, 1.0 - share) }
}
