//! Promise of a cut: it refuses a tet without a volume where the wire goes alone, and knows each tet that it has changed.

use super::neighbourhood::tests::{TETS, lattice};
use super::wire::Motion;
use super::*;
use glam::DVec3;
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
