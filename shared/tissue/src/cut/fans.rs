//! Whether the boundary at a node is a surface.

use super::refine::Work;

/// What the boundary is at a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fan {
    /// The node is inside.
    None,
    /// One closed fan of triangles.
    One,
    /// Anything else: no 2-manifold.
    Bad,
}

/// The other two nodes of each face at `node`, sorted, with the tet's place in the star: those of the same face one after the other, in any order.
pub fn faces_at(work: &Work, node: u32) -> Vec<([u32; 2], usize)> {
    let mut faces = Vec::with_capacity(3 * work.star.of(node).len());
    for (place, tet) in work.star.of(node).iter().enumerate() {
        let nodes = work.tissue.rest.tets[*tet as usize];
        let mut others = nodes.iter().copied().filter(|other| *other != node);
        let (Some(a), Some(b), Some(c)) = (others.next(), others.next(), others.next()) else { continue };
        faces.extend([[a, b], [b, c], [a, c]].map(|[a, b]| ([a.min(b), a.max(b)], place)));
    }
    // As one number each, which takes one comparison.
    faces.sort_unstable_by_key(|([a, b], _)| u64::from(*a) << 32 | u64::from(*b));
    faces
}

/// The boundary at a node.
pub fn fan(work: &Work, node: u32) -> Fan {
    fan_of(work.star.of(node).iter().map(|tet| work.tissue.rest.tets[*tet as usize]), node)
}

/// The boundary of some tets at a node that all of them have.
pub fn fan_of(tets: impl Iterator<Item = [u32; 4]>, node: u32) -> Fan {
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(3 * tets.size_hint().0);
    for nodes in tets {
        let mut others = nodes.into_iter().filter(|other| *other != node);
        let (Some(a), Some(b), Some(c)) = (others.next(), others.next(), others.next()) else { continue };
        edges.extend([[a, b], [b, c], [a, c]].map(|[a, b]| [a.min(b), a.max(b)]));
    }
    // As one number each, which takes one comparison.
    edges.sort_unstable_by_key(|[a, b]| u64::from(*a) << 32 | u64::from(*b));
    let edges: Vec<[u32; 2]> =
        edges.chunk_by(|left, right| left == right).filter(|same| same.len() == 1).map(|same| same[0]).collect();
    let Some(first) = edges.first() else { return Fan::None };
    // Round the fan: from each edge to the other one at its second end, until the first comes again.
    let (mut edge, mut end, mut steps) = (*first, first[1], 0);
    loop {
        let mut others = edges.iter().filter(|other| **other != edge && other.contains(&end));
        let (Some(next), None) = (others.next(), others.next()) else { return Fan::Bad };
        (edge, end, steps) = (*next, if next[0] == end { next[1] } else { next[0] }, steps + 1);
        if edge == *first || steps > edges.len() {
            return if steps == edges.len() { Fan::One } else { Fan::Bad };
        }
    }
}

impl Work<'_> {
    /// Whether a node is inside the tissue, of one region and of one material.
    pub fn is_inner(&self, node: u32) -> bool {
        let (regions, material) = (&self.tissue.rest.regions, &self.tissue.material);
        let mut of_star = self.star.of(node).iter().map(|tet| (regions[*tet as usize], material.get(*tet as usize)));
        let first = of_star.next();
        fan(self, node) == Fan::None && first.is_some() && of_star.all(|kind| Some(kind) == first)
    }
}
