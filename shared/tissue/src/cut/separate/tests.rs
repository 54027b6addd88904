//! Promise of opening faces: it spoils no node, is undone to the last node where it would, and takes the faces that lie on the sheet.

use super::*;
use crate::cut::{CutOptions, Cuttable};
use hyst_mesh::TetMesh;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Orders of the axes along which six tets of a cube lead from one of its corners to the opposite one.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
/// Cells of a block along each edge.
const CELLS: u32 = 2;

/// A block of tets, of which these shares tell which are left out: what is left may touch itself in edges and nodes.
fn block(shares: &[u8]) -> Cuttable {
    let node = |[x, y, z]: [u32; 3]| (z * (CELLS + 1) + y) * (CELLS + 1) + x;
    let cells = (0..CELLS.pow(3)).map(|cell| [cell % CELLS, cell / CELLS % CELLS, cell / CELLS / CELLS]);
    let of_cell = |low: [u32; 3]| {
        ORDERS.map(|order| {
            let mut place = low;
            let ends = order.map(|axis| {
                place[axis] += 1;
                node(place)
            });
            [node(low), ends[0], ends[1], ends[2]]
        })
    };
    let mut shares = shares.iter().cycle();
    let tets: Vec<[u32; 4]> = cells.flat_map(of_cell).filter(|_| shares.next() > Some(&0)).collect();
    let positions_m = vec![[0.0; 3]; (CELLS + 1).pow(3) as usize];
    Cuttable::at_rest(TetMesh { positions_m, regions: vec![0; tets.len()], tets })
}

/// The parts of a node's star, by the ways that lead from tet to tet through all faces at the node but these.
fn parts_of_star(work: &Work, node: u32, faces: &[Face]) -> Vec<Vec<u32>> {
    let nodes = |tet: u32| work.tissue.rest.tets[tet as usize];
    let are_joined = |one: u32, other: u32| {
        let mut common: Vec<u32> = nodes(one).into_iter().filter(|node| nodes(other).contains(node)).collect();
        common.sort_unstable();
        common.len() == 3 && common.contains(&node) && !faces.iter().any(|face| face[..] == common[..])
    };
    let (mut left, mut parts) = (work.star.of(node).to_vec(), Vec::new());
    while let Some(first) = left.first().copied() {
        let (mut part, mut next) = (vec![first], 0);
        while let Some(tet) = part.get(next).copied() {
            next += 1;
            let is_new = |other: &u32| !part.contains(other) && are_joined(tet, *other);
            let beyond: Vec<u32> = left.iter().copied().filter(is_new).collect();
            part.extend(beyond);
        }
        parts.push(left.iter().copied().filter(|tet| part.contains(tet)).collect());
        left.retain(|tet| !part.contains(tet));
    }
    parts
}

/// The faces between two tets, sorted.
fn inner_faces(work: &Work) -> Vec<Face> {
    let mut faces: Vec<Face> = (0..work.tissue.rest.tets.len() as u32).flat_map(|tet| work.faces_of(tet)).collect();
    faces.sort_unstable();
    faces.dedup();
    faces.retain(|face| work.tets_at(face).is_some());
    faces
}

fn bad_nodes(work: &Work) -> Vec<u32> {
    (0..work.star.nodes() as u32).filter(|node| fan(work, *node) == Fan::Bad).collect()
}

/// [`Work::open_faces`] by asking all nodes of the faces in each round.
fn opened_by_all(work: &mut Work<'_>, mut faces: Vec<Face>, report: &mut CutReport) -> Vec<[u32; 2]> {
    let wanted = faces.len();
    for round in 0..ROUNDS {
        let partings: Vec<Parting> = nodes_of(&faces).into_iter().filter_map(|node| work.parting(node, &faces)).collect();
        if partings.is_empty() || round + 1 == ROUNDS {
            report.closed_faces += wanted;
            break;
        }
        let tets: Vec<Option<[u32; 2]>> = faces.iter().map(|face| work.tets_at(face)).collect();
        let nodes = work.star.nodes();
        let copies = work.part(&partings);
        let bad = work.spoilt_nodes(&partings, &copies);
        if bad.is_empty() {
            report.copied_nodes += copies.len();
            let opened = faces.iter().zip(tets).filter(|(face, _)| work.tets_at(face).is_none());
            let opened: Vec<[u32; 2]> = opened.filter_map(|(_, tets)| tets).collect();
            report.opened_faces += opened.len();
            report.closed_faces += wanted - opened.len();
            return opened;
        }
        work.join_again(&partings, &copies, nodes);
        faces = work.without(faces, &bad);
    }
    Vec::new()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(4), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nodes_are_spoilt_that_are_bad_with_the_copies_and_were_not_before(
        left_out in prop::collection::vec(0..12_u8, 48),
        opened in prop::collection::vec(0..10_u8, 96),
        share in 1..10_u8,
    ) {
        let (mut tissue, options) = (block(&left_out), CutOptions::default());
        let mut work = Work::new(&mut tissue, &options, Vec::new());
        let mut opened = opened.into_iter().cycle();
        let mut faces = inner_faces(&work);
        faces.retain(|_| opened.next() < Some(share));
        let (before, bad_before, nodes) = (work.tissue.rest.clone(), bad_nodes(&work), work.star.nodes());
        let partings: Vec<Parting> = nodes_of(&faces).into_iter().filter_map(|node| work.parting(node, &faces)).collect();
        let copies = work.part(&partings);
        let original = |node: u32| copies.iter().find(|[copy, _]| *copy == node).map_or(node, |[_, original]| *original);
        let mut expected: Vec<u32> = bad_nodes(&work).into_iter().map(original).collect();
        expected.retain(|node| !bad_before.contains(node));
        expected.sort_unstable();
        expected.dedup();
        prop_assert_eq!(work.spoilt_nodes(&partings, &copies), expected);
        work.join_again(&partings, &copies, nodes);
        prop_assert_eq!(&work.tissue.rest.tets, &before.tets);
        prop_assert_eq!(work.star.nodes(), nodes);
    }

    /// A node that was not parted is not asked again.
    #[test]
    fn what_is_opened_is_what_asking_all_nodes_in_each_round_opens(
        left_out in prop::collection::vec(0..12_u8, 48),
        wanted in prop::collection::vec(0..10_u8, 96),
        share in 1..10_u8,
    ) {
        let mut results = Vec::new();
        for asks_all in [false, true] {
            let (mut tissue, options, mut report) = (block(&left_out), CutOptions::default(), CutReport::default());
            let mut work = Work::new(&mut tissue, &options, Vec::new());
            let mut wanted = wanted.iter().cycle();
            let mut faces = inner_faces(&work);
            faces.retain(|_| wanted.next() < Some(&share));
            let opened =
                if asks_all { opened_by_all(&mut work, faces, &mut report) } else { work.open_faces(faces, &mut report) };
            results.push((opened, report, tissue));
        }
        prop_assert_eq!(&results[0], &results[1]);
    }

    #[test]
    fn faces_on_the_sheet_are_those_between_two_tets_whose_nodes_all_are(
        left_out in prop::collection::vec(0..12_u8, 48),
        is_marked in prop::collection::vec(any::<bool>(), 27),
    ) {
        let (mut tissue, options) = (block(&left_out), CutOptions::default());
        tissue.marks = is_marked.iter().map(|is_marked| [0.0, 0.0, f32::from(u8::from(*is_marked))]).collect();
        let mut work = Work::new(&mut tissue, &options, Vec::new());
        work.on_sheet = work.tets_on_sheet();
        let mut expected = inner_faces(&work);
        expected.retain(|face| face.iter().all(|node| is_marked[*node as usize]));
        let tets = |face: &Face| (*face, work.tets_at(face).expect("an inner face"));
        prop_assert_eq!(work.marked_faces(), expected.iter().map(tets).collect::<Vec<_>>());
    }

    #[test]
    fn a_star_is_parted_where_no_way_leads_through_a_face_that_stays_closed(
        left_out in prop::collection::vec(0..12_u8, 48),
        opened in prop::collection::vec(0..10_u8, 96),
        share in 1..10_u8,
    ) {
        let (mut tissue, options) = (block(&left_out), CutOptions::default());
        let work = Work::new(&mut tissue, &options, Vec::new());
        let mut opened = opened.into_iter().cycle();
        let mut faces = inner_faces(&work);
        faces.retain(|_| opened.next() < Some(share));
        for node in 0..work.star.nodes() as u32 {
            let mut parts = parts_of_star(&work, node, &faces).into_iter();
            let _ = parts.next(); // stays with the node
            let parts: Vec<Vec<u32>> = parts.collect();
            prop_assert_eq!(work.parting(node, &faces), (!parts.is_empty()).then_some((node, parts)));
        }
    }
}

/// The last node was taken away where no tet had used it: a sweep that changed nothing left a mark too few, and everybody refused the state with it.
#[test]
fn what_is_joined_again_has_as_many_nodes_as_before_also_where_no_tet_used_the_last_one() {
    let positions_m =
        vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [3.0, 3.0, 3.0]];
    let tets = vec![[0, 1, 2, 3], [4, 1, 3, 2]];
    let mut tissue = Cuttable::at_rest(TetMesh { positions_m, tets, regions: vec![0; 2] });
    let counts = |tissue: &Cuttable| {
        let points = [&tissue.rest.positions_m, &tissue.position_m, &tissue.velocity_m_s, &tissue.marks];
        (points.map(Vec::len), tissue.fixed.len(), tissue.rest.tets.clone())
    };
    let (before, options) = (counts(&tissue), CutOptions::default());
    let mut work = Work::new(&mut tissue, &options, vec![0, 1]);
    let stars = |work: &Work| (0..work.star.nodes() as u32).map(|node| work.star.of(node).to_vec()).collect::<Vec<_>>();
    let (star, free, nodes) = (stars(&work), work.free.clone(), work.star.nodes());
    let partings: Vec<Parting> = [1, 2, 3].into_iter().map(|node| (node, vec![vec![1]])).collect();
    let copies = work.part(&partings);
    assert_eq!(copies, [[5, 1], [6, 2], [7, 3]], "the two that no tet uses, and one more");
    work.join_again(&partings, &copies, nodes);
    assert_eq!((stars(&work), &work.free), (star, &free));
    assert_eq!(counts(&tissue), before);
}
