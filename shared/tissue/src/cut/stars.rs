//! The tets at each node while a mesh is cut, in one list: every cut begins by filling it anew.

/// The tets at each node.
pub struct Stars {
    of_node: Vec<Place>,
    tets: Vec<u32>,
}

/// Where in the list the tets of a node begin, how many they are, and how many there is room for.
#[derive(Clone, Copy, Default)]
struct Place {
    start: usize,
    count: usize,
    room: usize,
}

/// Room of a node that had none when its first tet comes.
const FIRST_ROOM: usize = 8;

impl Stars {
    /// Of the nodes of a mesh; the tets of each are in their order.
    pub fn new(nodes: usize, tets: &[[u32; 4]]) -> Stars {
        // How many there are at each; then where the next one at each goes.
        let mut next = vec![0; nodes];
        tets.as_flattened().iter().for_each(|node| next[*node as usize] += 1);
        let mut all = 0;
        let place = |next: &mut usize| {
            let count = std::mem::replace(next, all);
            all += count;
            Place { start: *next, count, room: count }
        };
        let of_node = next.iter_mut().map(place).collect();
        // With room for the stars that outgrow theirs.
        let mut list = Vec::with_capacity(all + all / 4);
        list.resize(all, 0);
        for (tet, nodes) in (0..).zip(tets) {
            for node in nodes {
                let next = &mut next[*node as usize];
                list[*next] = tet;
                *next += 1;
            }
        }
        Stars { of_node, tets: list }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.of_node.len()
    }

    /// The tets of a node, in the order in which they came.
    pub fn of(&self, node: u32) -> &[u32] {
        let place = self.of_node[node as usize];
        &self.tets[place.start..place.start + place.count]
    }

    pub fn push(&mut self, node: u32, tet: u32) {
        let place = &mut self.of_node[node as usize];
        if place.count == place.room {
            let start = self.tets.len();
            self.tets.extend_from_within(place.start..place.start + place.count);
            (place.start, place.room) = (start, FIRST_ROOM.max(2 * place.count));
            self.tets.resize(start + place.room, 0);
        }
        self.tets[place.start + place.count] = tet;
        place.count += 1;
    }

    pub fn extend(&mut self, node: u32, tets: &[u32]) {
        tets.iter().for_each(|tet| self.push(node, *tet));
    }

    pub fn retain(&mut self, node: u32, is_kept: impl Fn(u32) -> bool) {
        let place = &mut self.of_node[node as usize];
        let all = place.start..place.start + place.count;
        place.count = 0;
        for index in all {
            let tet = self.tets[index];
            if is_kept(tet) {
                self.tets[place.start + place.count] = tet;
                place.count += 1;
            }
        }
    }

    pub fn sort(&mut self, node: u32) {
        let place = self.of_node[node as usize];
        self.tets[place.start..place.start + place.count].sort_unstable();
    }

    pub fn clear(&mut self, node: u32) {
        self.of_node[node as usize].count = 0;
    }

    /// Adds a node without tets.
    pub fn add_node(&mut self) {
        self.of_node.push(Place::default());
    }

    /// Takes the last node away.
    pub fn drop_node(&mut self) {
        self.of_node.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn they_are_what_a_list_for_each_node_is(
            tets in prop::collection::vec(prop::array::uniform4(0..12_u32), 0..30),
            changes in prop::collection::vec((0..6_u32, 0..12_u32, 0..40_u32), 0..60),
        ) {
            let mut stars = Stars::new(12, &tets);
            let mut lists: Vec<Vec<u32>> = vec![Vec::new(); 12];
            for (tet, nodes) in (0..).zip(&tets) {
                nodes.iter().for_each(|node| lists[*node as usize].push(tet));
            }
            for (change, node, tet) in changes {
                let list = &mut lists[node as usize];
                match change {
                    0 => {
                        list.clear();
                        stars.clear(node);
                    }
                    1 => {
                        list.retain(|other| other % 3 != tet % 3);
                        stars.retain(node, |other| other % 3 != tet % 3);
                    }
                    2 => {
                        list.sort_unstable();
                        stars.sort(node);
                    }
                    _ => {
                        list.extend([tet, tet + 1]);
                        stars.extend(node, &[tet, tet + 1]);
                    }
                }
                lists.push(vec![tet]);
                stars.add_node();
                stars.push(lists.len() as u32 - 1, tet);
                if change < 3 {
                    lists.pop();
                    stars.drop_node();
                }
                prop_assert_eq!(stars.nodes(), lists.len());
                prop_assert!((0..).zip(&lists).all(|(node, list)| stars.of(node) == &list[..]));
            }
        }
    }
}
