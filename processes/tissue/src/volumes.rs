//! The volumes of the tets of one mesh at rest after the other. A cut changes some tens of tets: all others have the volume that they had.
//!
//! Promise: each is that of its tet to the last bit, whatever was known before.

use crate::body::Body;

/// What is known of one mesh, for the next one.
#[derive(Debug, Default)]
pub struct Volumes {
    tets: Vec<[u32; 4]>,
    /// Of each of them, m³.
    known_m3: Vec<f64>,
    /// Where the nodes lay, as bits.
    places: Vec<[u32; 3]>,
    /// Whether each node of the next mesh lies elsewhere.
    is_elsewhere: Vec<bool>,
}

impl Volumes {
    /// Begins with the mesh of a body.
    pub fn begin(&mut self, body: &Body) {
        let places: &[[u32; 3]] = bytemuck::cast_slice(&body.rest.positions_m);
        let is_elsewhere = |(node, place): (usize, &[u32; 3])| self.places.get(node) != Some(place);
        self.is_elsewhere.clear();
        self.is_elsewhere.extend(places.iter().enumerate().map(is_elsewhere));
    }

    /// The volume of a tet of it, m³. They are asked about one after the other, from the first on.
    pub fn of(&mut self, body: &Body, index: usize) -> f64 {
        let tet = body.rest.tets[index];
        let stays = |node: &u32| !self.is_elsewhere[*node as usize];
        if self.tets.get(index) == Some(&tet) && tet.iter().all(stays) {
            return self.known_m3[index];
        }
        let volume_m3 = body.volume_m3(tet);
        match (self.tets.get_mut(index), self.known_m3.get_mut(index)) {
            (Some(known), Some(known_m3)) => (*known, *known_m3) = (tet, volume_m3),
            _ => {
                self.tets.push(tet);
                self.known_m3.push(volume_m3);
            }
        }
        volume_m3
    }

    /// Ends with it: so many of its tets were asked about.
    pub fn end(&mut self, body: &Body, asked: usize) {
        self.tets.truncate(asked);
        self.known_m3.truncate(asked);
        self.places.clear();
        self.places.extend_from_slice(bytemuck::cast_slice(&body.rest.positions_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_mesh::TetMesh;

    /// All volumes of a mesh.
    fn asked(volumes: &mut Volumes, body: &Body) -> Vec<f64> {
        volumes.begin(body);
        let all_m3 = (0..body.rest.tets.len()).map(|index| volumes.of(body, index)).collect();
        volumes.end(body, body.rest.tets.len());
        all_m3
    }

    /// A body of these tets.
    fn of_tets(positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Body {
        let rest = TetMesh { positions_m: positions_m.to_vec(), tets: tets.to_vec(), regions: vec![0; tets.len()] };
        Body { rest, ..Body::default() }
    }

    #[test]
    fn what_is_known_is_not_made_again_and_is_forgotten_where_a_corner_moves() {
        let mut places_m = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3], [9.0; 3]];
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let mut volumes = Volumes::default();
        let made_m3 = asked(&mut volumes, &of_tets(&places_m, &tets));
        volumes.known_m3 = vec![7.0, 8.0];
        places_m[5] = [10.0; 3];
        assert_eq!(asked(&mut volumes, &of_tets(&places_m, &tets)), [7.0, 8.0], "a node that they do not have has moved");
        places_m[0] = [-1.0; 3];
        let moved_m3 = asked(&mut volumes, &of_tets(&places_m, &tets));
        assert!(moved_m3[0] > made_m3[0] && moved_m3[0] != 7.0 && moved_m3[1] == 8.0, "{moved_m3:?} of {made_m3:?}");
        let turned_m3 = asked(&mut volumes, &of_tets(&places_m, &[[0, 1, 3, 2], [1, 2, 3, 4]]));
        assert_eq!(turned_m3, [-moved_m3[0], 8.0], "it has the same nodes in another order");
    }

    #[test]
    fn a_volume_is_that_of_its_tet_whatever_was_known_before() {
        let mut state = 1u64;
        // Knuth's linear congruential generator for 64 bits.
        let mut below = move |most: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as u32 % most
        };
        let (mut volumes, mut places_m, mut tets) = (Volumes::default(), Vec::new(), Vec::new());
        for round in 0..300 {
            // Nodes come, go and move, and so do tets.
            places_m.resize(8 + below(4) as usize, [0.0; 3]);
            for _ in 0..below(3) {
                places_m[below(8) as usize] = [0; 3].map(|_| below(9) as f32);
            }
            tets.truncate(below(40) as usize);
            for _ in 0..below(6) {
                tets.push([0; 4].map(|_| below(8)));
            }
            if let Some(tet) = tets.first_mut() {
                *tet = [0; 4].map(|_| below(8));
            }
            let body = of_tets(&places_m, &tets);
            let expected: Vec<u64> = tets.iter().map(|tet| body.volume_m3(*tet).to_bits()).collect();
            let found: Vec<u64> = asked(&mut volumes, &body).into_iter().map(f64::to_bits).collect();
            assert_eq!(found, expected, "round {round}");
        }
    }
}
