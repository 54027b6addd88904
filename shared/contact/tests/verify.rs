//! What another worker says is taken only if it is true, and leaves out nothing that is known.

mod common;

use common::{TOOL, block, capsule};
use hyst_contact::*;

/// A tool in a block of tets, hashed; the room for hits.
struct Scene {
    points_m: Vec<[f32; 3]>,
    owner: Vec<u32>,
    node: Vec<u32>,
    nodes_m: Vec<[f32; 3]>,
    tets: Vec<[u32; 4]>,
    tet_owner: Vec<u32>,
    words: Vec<u32>,
}

impl Scene {
    fn new(tip_m: [f32; 3]) -> Scene {
        let (nodes_m, tets) = block([6, 6, 6], 0.01, [0.0; 3]);
        let points_m = capsule(tip_m, 0.004, 0.03, 8, 10).points_m;
        let count = points_m.len();
        let sizes = HashSizes::for_points(count);
        let mut words = vec![0; sizes.words()];
        HashMut::in_words(&mut words, sizes).unwrap().build(&points_m, 0.005, Layout::Auto).unwrap();
        let tet_owner = vec![0; tets.len()];
        Scene { points_m, owner: vec![TOOL; count], node: (0..count as u32).collect(), nodes_m, tets, tet_owner, words }
    }

    fn points(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &self.node, own: None }
    }

    fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.nodes_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }

    fn hits(&self, share: Share) -> Vec<Hit> {
        let mut hits = vec![Hit::default(); 4 * self.points_m.len()];
        let hash = HashRef::in_words(&self.words).unwrap();
        let found = intersect(share, &hash, &self.points(), &self.tissue(), &mut Cull::default(), &mut hits).unwrap();
        assert_eq!(found.dropped, 0);
        hits.truncate(found.count);
        hits
    }

    fn has_all(&self, candidates: &[Hit], hits: &[Hit], share: Share) -> bool {
        has_all_of(candidates, hits, share, &self.points_m, &self.points(), &self.tissue())
    }
}

fn shares(count: u32) -> impl Iterator<Item = Share> {
    (0..count).map(move |index| Share { index, count, split: Split::Tets })
}

#[test]
fn the_parts_of_a_share_are_the_share() {
    let scene = Scene::new([0.031, 0.029, 0.02]);
    for share in shares(3) {
        let whole = scene.hits(share);
        assert!(!whole.is_empty() && scene.has_all(&whole, &whole, share));
        let parts: Vec<Hit> = (0..5).flat_map(|number| scene.hits(share.part(number, 5))).collect();
        assert!(whole.iter().all(|hit| parts.contains(hit)), "every hit of the share is in one of its parts");
        for number in 0..12 {
            assert!(scene.has_all(&scene.hits(share.part(number, 5)), &whole, share), "part {number}");
        }
    }
}

#[test]
fn a_hit_that_is_left_out_is_missed_by_a_part_of_the_share_and_by_the_hits_of_the_step_before() {
    let scene = Scene::new([0.031, 0.029, 0.02]);
    let moved = Scene::new([0.0312, 0.029, 0.0201]);
    for share in shares(2) {
        let whole = scene.hits(share);
        for left_out in 0..whole.len() {
            let mut told = whole.clone();
            told.remove(left_out);
            let is_missed = (0..8).any(|number| !scene.has_all(&scene.hits(share.part(number, 8)), &told, share));
            assert!(is_missed, "hit {left_out} of {}", whole.len());
        }
        let before: Vec<Hit> = shares(2).flat_map(|share| moved.hits(share)).collect();
        assert!(
            scene.has_all(&before, &whole, share),
            "what was hit a step ago and is no longer, or by another share, is not asked for"
        );
        assert!(!scene.has_all(&before, &[], share), "one that tells nothing is found out at once");
    }
}

/// A layer whose far half is laid over the near one, half a thickness deep: nodes that meet their own object are checked as those of the tool are.
#[test]
fn a_hit_of_a_fold_is_true_where_the_two_places_were_apart_and_missed_where_it_is_left_out() {
    let (mut nodes_m, tets) = block([8, 2, 1], 1.0, [0.0; 3]);
    let rest_m = nodes_m.clone();
    for (node, rest) in nodes_m.iter_mut().zip(&rest_m).filter(|(_, rest)| rest[0] > 4.5) {
        *node = [8.0 - rest[0], rest[1], 1.5 - rest[2]];
    }
    let (owner, tet_owner) = (vec![0; nodes_m.len()], vec![0; tets.len()]);
    let node: Vec<u32> = (0..nodes_m.len() as u32).collect();
    let own = OwnContact { rest_m: &rest_m, beyond_m: 2.0, only_from: 0 };
    let points = Points { owner: &owner, node: &node, own: Some(own) };
    let tissue = Tissue { positions_m: &nodes_m, tets: &tets, tet_owner: &tet_owner };
    let sizes = HashSizes::for_points(nodes_m.len());
    let mut words = vec![0; sizes.words()];
    HashMut::in_words(&mut words, sizes).unwrap().build(&nodes_m, 1.0, Layout::Auto).unwrap();
    let mut hits = vec![Hit::default(); 4 * nodes_m.len()];
    for share in shares(2) {
        let found =
            intersect(share, &HashRef::in_words(&words).unwrap(), &points, &tissue, &mut Cull::default(), &mut hits).unwrap();
        let whole = &hits[..found.count];
        assert!(whole.len() > 3, "{whole:?}");
        assert!(are_true(whole, share, &nodes_m, &points, &tissue));
        assert!(has_all_of(whole, whole, share, &nodes_m, &points, &tissue));
        for left_out in 0..whole.len() {
            let mut told = whole.to_vec();
            told.remove(left_out);
            assert!(!has_all_of(whole, &told, share, &nodes_m, &points, &tissue), "hit {left_out}");
        }
        // With all beside each other none of them is a hit: neither true nor missed.
        let points = Points { own: Some(OwnContact { beyond_m: 9.0, ..own }), ..points };
        assert!(!are_true(whole, share, &nodes_m, &points, &tissue));
        assert!(has_all_of(whole, &[], share, &nodes_m, &points, &tissue));
    }
}

#[test]
fn candidates_and_hits_of_another_mesh_are_no_panic() {
    let scene = Scene::new([0.031, 0.029, 0.02]);
    let share = Share { index: 0, count: 1, split: Split::Tets };
    let whole = scene.hits(share);
    let wild = |point: u32, tet: u32| Hit { point, tet, weights: [f32::NAN; 4] };
    let candidates = [wild(u32::MAX, 0), wild(0, u32::MAX), wild(u32::MAX, u32::MAX)];
    assert!(scene.has_all(&candidates, &whole, share), "none of them is true");
    assert!(!scene.has_all(&whole, &[wild(whole[0].point, u32::MAX)], share));
}
