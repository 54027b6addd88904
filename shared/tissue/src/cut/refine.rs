//! Makes the mesh fit the sheet: snaps nodes to it and bisects edges, until no edge leads from one side to the other.

use super::sheet::{Crossing, Sheet};
use super::{CutOptions, CutReport, Cuttable, DMat3, DVec3, at, corners, to_single};
use hyst_mesh::{quality, signed_volume};

/// An edge may cross a sheet so often that is bent (a loop twice): each round finds the first crossing of each edge that is left.
const ROUNDS: usize = 4;
/// A node that is marked lies on the sheet where it crosses if the two normals have this cosine at least: a loop's other side is another place.
const SAME_SHEET: f64 = 0.5;

/// A tissue while it is cut.
pub struct Work<'a> {
    pub tissue: &'a mut Cuttable,
    pub options: &'a CutOptions,
    /// Tets of each node.
    pub star: Vec<Vec<u32>>,
}

/// An edge that crosses the sheet: its ends, the lower node first.
type Crossed = ([u32; 2], Crossing);

impl<'a> Work<'a> {
    pub fn new(tissue: &'a mut Cuttable, options: &'a CutOptions) -> Work<'a> {
        let mut star = vec![Vec::new(); tissue.rest.positions_m.len()];
        for (tet, nodes) in tissue.rest.tets.iter().enumerate() {
            nodes.iter().for_each(|node| star[*node as usize].push(tet as u32));
        }
        Work { tissue, options, star }
    }

    /// Tets that have both nodes.
    fn around(&self, [a, b]: [u32; 2]) -> Vec<u32> {
        let has_b = |tet: &u32| self.tissue.rest.tets[*tet as usize].contains(&b);
        self.star[a as usize].iter().copied().filter(has_b).collect()
    }

    pub fn mark(&self, node: u32) -> DVec3 {
        at(&self.tissue.marks, node)
    }

    pub fn is_marked(&self, node: u32) -> bool {
        self.tissue.marks[node as usize] != [0.0; 3]
    }

    /// All crossings, by edge.
    fn crossings(&self, sheet: &Sheet) -> Vec<Crossed> {
        const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
        let place = |node: u32| at(&self.tissue.position_m, node);
        let near = self.tissue.rest.tets.iter().filter(|tet| sheet.is_near(&tet.map(place)));
        let ends = near.flat_map(|tet| EDGES.map(|[a, b]| [tet[a].min(tet[b]), tet[a].max(tet[b])]));
        let mut edges: Vec<[u32; 2]> = ends.collect();
        edges.sort_unstable();
        edges.dedup();
        let crosses = |edge: [u32; 2]| Some((edge, sheet.crossing(place(edge[0]), place(edge[1]))?));
        edges.into_iter().filter_map(crosses).collect()
    }

    pub fn refine(&mut self, sheet: &Sheet, report: &mut CutReport) {
        for _ in 0..ROUNDS {
            // Ends first: an end that is snapped spares the bisection of all the other edges that cross near it.
            for (edge, crossing) in self.crossings(sheet) {
                self.snap(edge, crossing, report);
            }
            let mut is_done = true;
            for (edge, crossing) in self.crossings(sheet) {
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

    /// Whether a node lies on the sheet where that has this normal.
    fn is_on(&self, node: u32, material_normal: DVec3) -> bool {
        self.is_marked(node) && self.mark(node).dot(material_normal) >= SAME_SHEET
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
        }
        self.put_mark(near, normal);
    }

    /// Bisects an edge that has no end on the sheet yet; or snaps the nearer end after all. Tells whether it was bisected.
    fn divide(&mut self, edge: [u32; 2], crossing: Crossing, report: &mut CutReport) -> bool {
        let around = self.around(edge);
        let normal = self.material_normal(&around, crossing.normal);
        if around.is_empty() || edge.iter().any(|end| self.is_on(*end, normal)) {
            return false;
        }
        let options = self.options;
        let has_room = self.tissue.rest.positions_m.len() < options.max_nodes
            && self.tissue.rest.tets.len() + around.len() <= options.max_tets;
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
            self.star[edge[1] as usize].retain(|other| other != tet);
            second.iter().for_each(|node| self.star[*node as usize].push(new));
            self.star[middle as usize].push(*tet);
        }
        middle
    }

    fn add_node(&mut self, [a, b]: [u32; 2], share: f64) -> u32 {
        let between = |points: &[[f32; 3]]| to_single(at(points, a).lerp(at(points, b), share));
        let tissue = &mut *self.tissue;
        let (rest, now, velocity) =
            (between(&tissue.rest.positions_m), between(&tissue.position_m), between(&tissue.velocity_m_s));
        tissue.rest.positions_m.push(rest);
        tissue.position_m.push(now);
        tissue.velocity_m_s.push(velocity);
        tissue.fixed.push(tissue.fixed[a as usize] && tissue.fixed[b as usize]);
        tissue.marks.push([0.0; 3]);
        self.star.push(Vec::new());
        (tissue.rest.positions_m.len() - 1) as u32
    }

    /// Moves an inner node along an edge onto the sheet, if all its tets stay good; the others only lend it their name.
    fn move_along(&mut self, node: u32, [a, b]: [u32; 2], share: f64) -> bool {
        if self.tissue.fixed[node as usize] || !self.is_inner(node) {
            return false;
        }
        let between = |points: &[[f32; 3]]| to_single(at(points, a).lerp(at(points, b), share));
        let rest = between(&self.tissue.rest.positions_m);
        let place = at(&[rest], 0);
        let star = &self.star[node as usize];
        let stays_good = |tet: &u32| {
            let nodes = self.tissue.rest.tets[*tet as usize];
            self.is_good(nodes.map(|other| if other == node { place } else { at(&self.tissue.rest.positions_m, other) }))
        };
        if !star.iter().all(stays_good) {
            return false;
        }
        let (now, velocity) = (between(&self.tissue.position_m), between(&self.tissue.velocity_m_s));
        let before = self.momentum_of_star(node);
        let tissue = &mut *self.tissue;
        tissue.rest.positions_m[node as usize] = rest;
        tissue.position_m[node as usize] = now;
        tissue.velocity_m_s[node as usize] = velocity;
        let after = self.momentum_of_star(node);
        self.push_star(node, (before.0 - after.0) / after.1);
        true
    }

    /// Momentum of the tets around a node in units of the density, m⁴/s, and their volume: a quarter of each tet belongs to each of its nodes.
    fn momentum_of_star(&self, node: u32) -> (DVec3, f64) {
        let mut sum = (DVec3::ZERO, 0.0);
        for tet in &self.star[node as usize] {
            let nodes = self.tissue.rest.tets[*tet as usize];
            let volume = signed_volume(corners(&self.tissue.rest.positions_m, nodes));
            sum.0 += nodes.iter().map(|node| at(&self.tissue.velocity_m_s, *node)).sum::<DVec3>() * (volume / 4.0);
            sum.1 += volume;
        }
        sum
    }

    /// Gives the tets around a node a velocity more. A node of the star's border belongs to it with a part of its mass only, and gets that part.
    fn push_star(&mut self, node: u32, more_m_s: DVec3) {
        let rest = &self.tissue.rest;
        let volume = |tet: &u32| signed_volume(corners(&rest.positions_m, rest.tets[*tet as usize]));
        let mut others: Vec<u32> = self.star[node as usize].iter().flat_map(|tet| rest.tets[*tet as usize]).collect();
        others.sort_unstable();
        others.dedup();
        let pushes: Vec<(u32, DVec3)> = others
            .into_iter()
            .map(|other| {
                let all: f64 = self.star[other as usize].iter().map(volume).sum();
                let in_star = |tet: &&u32| rest.tets[**tet as usize].contains(&node);
                let own: f64 = self.star[other as usize].iter().filter(in_star).map(volume).sum();
                (other, more_m_s * (own / all))
            })
            .collect();
        for (other, push) in pushes.into_iter().filter(|(_, push)| push.is_finite()) {
            self.tissue.velocity_m_s[other as usize] = to_single(at(&self.tissue.velocity_m_s, other) + push);
        }
    }
}

/// The end that a crossing is nearer to, and its distance as a share of the edge.
fn nearer([a, b]: [u32; 2], share: f64) -> (u32, f64) {
    if share <= 0.5 { (a, share) } else { (b, 1.0 - share) }
}
