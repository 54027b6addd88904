//! Which points of an object are joined by an edge.

/// Which points of an object are joined by an edge: how depth travels inward from the border of a contact.
#[derive(Debug, Clone, Default)]
pub struct PointGraph {
    starts: Vec<u32>,
    joined: Vec<u32>,
}

/// Makes counts, each behind an entry for which there is none, into the places at which their runs start.
fn sum_up(counts: &mut [u32]) {
    let mut sum = 0;
    for count in counts {
        sum += *count;
        *count = sum;
    }
}

impl PointGraph {
    /// From a list of edges, in any order and direction; edges to points that do not exist, loops and repeats are left out.
    pub fn from_edges(points: usize, edges: &[[u32; 2]]) -> PointGraph {
        PointGraph::of(points, edges.iter().copied())
    }

    /// The edges of a set of triangles.
    pub fn from_triangles(points: usize, triangles: &[[u32; 3]]) -> PointGraph {
        PointGraph::of(points, triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]))
    }

    /// Sorted by counting: first each edge is put to its higher end, then, those ends ascending, to its lower one, so that repeats come one after the other.
    fn of(points: usize, edges: impl Iterator<Item = [u32; 2]> + Clone) -> PointGraph {
        let real = edges.map(|[a, b]| (a.min(b) as usize, a.max(b) as usize)).filter(|(low, high)| low < high && *high < points);
        let mut low_starts = vec![0u32; points + 1];
        let (mut high_starts, mut starts) = (low_starts.clone(), low_starts.clone());
        real.clone().for_each(|(low, high)| {
            low_starts[high + 1] += 1;
            high_starts[low + 1] += 1;
        });
        sum_up(&mut low_starts);
        sum_up(&mut high_starts);
        let (mut lows, mut ends) = (vec![0u32; low_starts[points] as usize], low_starts.clone());
        real.for_each(|(low, high)| {
            lows[ends[high] as usize] = low as u32;
            ends[high] += 1;
        });
        let mut highs = vec![0u32; lows.len()];
        ends.copy_from_slice(&high_starts);
        for high in 0..points {
            let mut new_of_high = 0;
            for low in &lows[low_starts[high] as usize..low_starts[high + 1] as usize] {
                let low = *low as usize;
                let (start, end) = (high_starts[low] as usize, ends[low] as usize);
                // Written in any case, for every other edge is a repeat, and which of them no processor foresees. There is room for it at the end of its run.
                let is_new = u32::from((start == end) | (highs[end.saturating_sub(1)] != high as u32));
                highs[end] = high as u32;
                ends[low] += is_new;
                starts[low + 1] += is_new;
                new_of_high += is_new;
            }
            starts[high + 1] += new_of_high;
        }
        sum_up(&mut starts);
        // A point has got the lower ones that it is joined to, ascending, before its own turn comes.
        let (mut joined, mut next) = (vec![0u32; starts[points] as usize], starts.clone());
        for low in 0..points {
            for high in &highs[high_starts[low] as usize..ends[low] as usize] {
                for (from, to) in [(low, *high), (*high as usize, low as u32)] {
                    joined[next[from] as usize] = to;
                    next[from] += 1;
                }
            }
        }
        PointGraph { starts, joined }
    }

    /// This graph and behind its points those of another, with no edge between the two.
    pub fn followed_by(&self, other: &PointGraph) -> PointGraph {
        let (first, edges) = (self.points() as u32, self.joined.len() as u32);
        let mut both = self.clone();
        both.starts.resize(first as usize + 1, 0); // one without points may have no start either
        both.starts.extend(other.starts.iter().skip(1).map(|start| start + edges));
        both.joined.extend(other.joined.iter().map(|point| point + first));
        both
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The points joined to one point, ascending.
    pub fn joined(&self, point: u32) -> &[u32] {
        let at = |i: usize| self.starts.get(i).map_or(0, |&s| s as usize);
        self.joined.get(at(point as usize)..at(point as usize + 1)).unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::collections::BTreeSet;

    fn joined(graph: &PointGraph) -> Vec<Vec<u32>> {
        (0..graph.points() as u32).map(|point| graph.joined(point).to_vec()).collect()
    }

    #[test]
    fn a_graph_behind_another_has_the_edges_of_both_and_none_between() {
        let (line, triangle) = (PointGraph::from_edges(3, &[[0, 1], [1, 2]]), PointGraph::from_triangles(4, &[[0, 1, 3]]));
        let both = line.followed_by(&triangle);
        let expected = PointGraph::from_edges(7, &[[0, 1], [1, 2], [3, 4], [4, 6], [6, 3]]);
        assert_eq!(joined(&both), joined(&expected));
        assert_eq!(joined(&PointGraph::default().followed_by(&line)), joined(&line));
        assert_eq!(joined(&line.followed_by(&PointGraph::default())), joined(&line));
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 400,
            rng_seed: RngSeed::Fixed(11),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Few points, so that edges repeat and lead to points that do not exist; a triangle may have a point twice.
        #[test]
        fn each_point_is_joined_to_those_that_it_has_an_edge_to_once_and_in_order(
            triangles in vec([0..12u32, 0..12u32, 0..12u32], 0..40),
            points in 0..12usize,
        ) {
            let edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [c, b], [c, a]]).collect();
            let mut expected = vec![BTreeSet::new(); points];
            for [a, b] in edges.iter().copied().filter(|[a, b]| a != b && (*a.max(b) as usize) < points) {
                expected[a as usize].insert(b);
                expected[b as usize].insert(a);
            }
            let expected: Vec<Vec<u32>> = expected.into_iter().map(|ends| ends.into_iter().collect()).collect();
            prop_assert_eq!(&joined(&PointGraph::from_edges(points, &edges)), &expected);
            prop_assert_eq!(&joined(&PointGraph::from_triangles(points, &triangles)), &expected);
        }
    }
}
