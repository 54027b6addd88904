//! Promise of a cut: it refuses a tet without a volume where the wire goes alone, knows each tet that it has changed, and leaves nothing of the surface for the
//! eye between two parts.

use super::neighbourhood::tests::{TETS, lattice};
use super::places::at;
use super::wire::Motion;
use super::*;
use glam::DVec3;
use hyst_mesh::Binding;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

#[test]
fn a_tet_without_a_volume_is_refused_where_the_wire_goes_and_nowhere_else() {
    let whole = Cuttable::at_rest(lattice(&[true; TETS]));
    let wire = |z: f32| [[-1.0, 0.5, z], [4.0, 0.5, z]];
    let drawn = |tissue: &mut Cuttable| {
        cut(tissue, &wire(-0.1), &CutOptions::default()).and_then(|_| cut(tissue, &wire(0.4), &CutOptions::default()))
    };
    assert!(drawn(&mut whole.clone()).unwrap().has_changed_mesh());
    for (tet, is_near) in [(0, true), (TETS - 1, false)] {
        let mut inverted = whole.clone();
        inverted.rest.tets[tet].swap(0, 1);
        let before = inverted.rest.clone();
        match drawn(&mut inverted) {
            Ok(report) => assert!(!is_near && report.has_changed_mesh(), "tet {tet}"),
            Err(error) => assert!(is_near && error == CutError::BadTet { tet } && inverted.rest == before, "{error}"),
        }
    }
}

/// Two tets apart from each other, and a triangle on a face of the second one of which a corner follows the first one.
#[test]
fn a_triangle_between_parts_comes_to_one_and_leaves_no_vertex_behind_also_where_its_object_is_not_near() {
    let tet_m = |x: f32| [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]];
    let apart = |regions: Vec<u32>| {
        let positions_m = [tet_m(0.0), tet_m(3.0)].concat();
        TetMesh { positions_m, tets: vec![[0, 1, 2, 3], [4, 5, 6, 7]], regions }
    };
    let bound = |tet: u32, weights: [f32; 4]| Binding { tet, weights };
    let whole = Skin {
        rest_m: vec![[3.0, 0.0, 0.0], [3.0, 1.0, 0.0], [4.0, 0.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2]],
        bindings: vec![
            bound(0, [-2.0, 3.0, 0.0, 0.0]),
            bound(1, [0.0, 0.0, 1.0, 0.0]),
            bound(1, [0.0, 1.0, 0.0, 0.0]),
            bound(0, [1.0, 0.0, 0.0, 0.0]),
            bound(0, [0.0, 0.0, 1.0, 0.0]),
        ],
        raw: vec![false; 5],
    };
    // Without room: none is needed but for a vertex that another triangle keeps.
    let options = CutOptions { max_vertices: 5, ..CutOptions::default() };
    for (regions, tet) in [(vec![0, 0], 1), (vec![0, 1], 0)] {
        let rest = apart(regions);
        let mut skin = whole.clone();
        assert_eq!(skin.part_by(&rest, &[0, 1], &options), 0);
        assert_eq!((&skin.triangles, &skin.rest_m), (&whole.triangles, &whole.rest_m));
        assert_eq!(skin.bindings[..3].iter().map(|binding| binding.tet).collect::<Vec<u32>>(), [tet; 3]);
        for (placed, rest_m) in skin.place(&rest.tets, &rest.positions_m).into_iter().zip(&skin.rest_m) {
            assert!(at(&[placed], 0).distance(at(&[*rest_m], 0)) < 1e-5, "{placed:?} is not at {rest_m:?}");
        }
    }
    let rest = apart(vec![0, 0]);
    let mut kept = Skin { triangles: vec![[0, 1, 2], [0, 3, 4]], ..whole };
    assert_eq!((kept.clone().part_by(&rest, &[0, 1], &options), kept.part_by(&rest, &[0, 1], &CutOptions::default())), (1, 0));
    assert_eq!(kept.triangles, [[5, 1, 2], [0, 3, 4]]);
    assert_eq!((kept.bindings[0].tet, kept.bindings[5].tet), (0, 1));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(5), failure_persistence: None, ..ProptestConfig::default() })]

    /// By sheets of two triangles, one after the other, through a lattice of which some tets are left out.
    #[test]
    fn no_tet_has_changed_that_was_not_touched(
        is_there in prop::collection::vec(prop::bool::weighted(0.9), TETS),
        sheets in prop::collection::vec(prop::array::uniform4(prop::array::uniform3(-1.0..4.0_f64)), 1..4),
    ) {
        let mut tissue = Cuttable::at_rest(lattice(&is_there));
        for ends in sheets {
            let [a, b, c, d] = ends.map(DVec3::from_array);
            let sheet = Sheet::of(&Motion { from_m: vec![a, b], to_m: vec![c, d], ways: vec![DVec3::X; 2] });
            let (before_m, before) = (tissue.rest.positions_m.clone(), tissue.rest.tets.clone());
            let (options, mut report) = (CutOptions::default(), CutReport::default());
            let near = sheet.near(&tissue);
            let mut work = Work::new(&mut tissue, &options, near);
            work.refine(&sheet, &mut report);
            work.open(&mut report);
            let touched = work.touched;
            let all = (0..tissue.rest.tets.len() as u32).collect();
            let expected = changed(&before_m, &before, all, &tissue.rest);
            prop_assert_eq!(changed(&before_m, &before, touched, &tissue.rest), expected);
        }
    }
}
