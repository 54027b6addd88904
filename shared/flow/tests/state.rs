//! The state as a message: a spare that loads it continues with the same bits; anything else is refused.

mod scene;

use hyst_flow::{FlowError, Solver, StateView, state_bytes};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const CELLS: [usize; 3] = [16, 14, 10];

fn after(steps: u32) -> Solver {
    let solver = scene::cavity(CELLS, 1);
    for step in 0..steps {
        solver.step_serial(&scene::inputs(step)).unwrap();
    }
    solver
}

#[test]
fn a_spare_continues_with_the_same_bits() {
    let incumbent = after(12);
    let block = scene::state(&incumbent);
    // The spare has lived another life before, with another mask and another number of bands.
    let spare = Solver::new(scene::model(CELLS), 2).unwrap();
    for step in 40..47 {
        spare.step_serial(&scene::inputs(step)).unwrap();
    }
    spare.load(bytemuck::cast_slice(&block)).unwrap();
    assert!(scene::state(&spare) == block, "load and store are inverse");
    for step in 12..30 {
        let (a, b) = (incumbent.step_serial(&scene::inputs(step)).unwrap(), spare.step_serial(&scene::inputs(step)).unwrap());
        assert_eq!(a, b, "the reports agree in step {step}");
        assert!(scene::state(&incumbent) == scene::state(&spare), "the states differ in step {step}");
    }
}

/// What a following spare does: in each tick it has nothing but the message of the last finished step. The walls change as tissue
/// does, the tool moves, and now and then a newborn takes the follower's place.
#[test]
fn a_substitute_for_any_step_has_the_bytes_of_the_original_that_kept_its_fields() {
    let original = scene::cavity(CELLS, 1);
    let mut follower = Solver::new(scene::model(CELLS), 3).unwrap();
    let whole = scene::ellipsoid(original.model().grid);
    for step in 0..150u32 {
        let before = scene::state(&original);
        if step % 25 == 24 {
            follower = Solver::new(scene::model(CELLS), 2).unwrap();
        }
        follower.load(bytemuck::cast_slice(&before)).unwrap();
        let mut mask = whole.clone();
        // A wall of tissue grows across the cavity layer by layer, parts it in two, and opens again.
        let grown = (step % 60).min(60 - step % 60) as usize / 3;
        for cell in (0..mask.len()).filter(|cell| cell % CELLS[0] == 11 && cell / CELLS[0] % CELLS[1] < grown) {
            mask[cell] = 1;
        }
        original.set_mask(&mask).unwrap();
        follower.set_mask(&mask).unwrap();
        let mut inputs = scene::inputs(step);
        inputs.ports[0].dye = 0.2;
        inputs.pump.outflow_valve = (step % 7) as f32 / 7.0;
        let (a, b) = (original.step_serial(&inputs).unwrap(), follower.step_serial(&inputs).unwrap());
        assert_eq!(a, b, "the reports agree in step {step}");
        assert!(scene::state(&original) == scene::state(&follower), "the states differ in step {step}");
    }
}

#[test]
fn counters_survive_a_restart() {
    let solver = after(60);
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let spare = Solver::new(scene::model(CELLS), 1).unwrap();
    spare.load(bytemuck::cast_slice(&block)).unwrap();
    let (pump, blood) = spare.counters().unwrap();
    assert_eq!((&pump, &blood), (view.pump(), view.blood()));
    assert!(pump.in_ml > 0.0 && blood.emitted > 0 && view.time().0 == 60);
}

#[test]
fn states_of_another_size_model_or_alignment_are_refused() {
    let solver = after(2);
    let mut block = scene::state(&solver);
    assert_eq!(block.len() * 8, state_bytes(&solver.model().grid, solver.model().blood.capacity));
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut block);
    assert!(matches!(solver.load(&bytes[..40]), Err(FlowError::Length { .. })));
    assert!(matches!(solver.load(&bytes[..bytes.len() - 8]), Err(FlowError::Length { .. })));
    assert!(matches!(solver.load(&bytes[1..]), Err(FlowError::Alignment)));
    assert!(matches!(solver.store(&mut bytes[8..]), Err(FlowError::Length { .. })));
    let other = Solver::new(scene::model([16, 14, 11]), 1).unwrap();
    assert!(matches!(other.load(bytes), Err(FlowError::State { field: "cells", .. })));
}

#[test]
fn values_that_are_not_finite_are_refused_even_under_a_good_checksum() {
    // A zombie's state may be well formed and still wrong: the speed in it is not a number.
    let solver = after(2);
    let mut block = scene::state(&solver);
    let before = block.clone();
    let words = block.len();
    block[words / 4] = u64::from_ne_bytes([0xff; 8]);
    let error = solver.load(bytemuck::cast_slice(&block)).unwrap_err();
    assert!(matches!(error, FlowError::State { field: "checksum", .. }), "{error}");
    // Repair the checksum as the writer would have: take what the error says it should be.
    let FlowError::State { want, .. } = error else { unreachable!() };
    block[1] = want;
    let error = solver.load(bytemuck::cast_slice(&block)).unwrap_err();
    assert!(matches!(error, FlowError::StateValue { .. }), "{error}");
    assert!(scene::state(&solver) == before, "a refused state changes nothing");
}

#[test]
fn a_view_of_the_form_alone_reads_the_same_and_refuses_what_is_of_another_form() {
    let solver = after(12);
    let mut block = scene::state(&solver);
    let whole = block.clone();
    let cells = CELLS.iter().product::<usize>();
    let checked = StateView::new(bytemuck::cast_slice(&whole)).unwrap();
    let framed = StateView::framed(bytemuck::cast_slice(&whole)).unwrap();
    assert_eq!((framed.grid(), framed.mask()), (checked.grid(), checked.mask()));
    for axis in 0..3 {
        assert!(framed.velocity_m_s(axis).len() == cells && framed.velocity_m_s(axis) == checked.velocity_m_s(axis));
    }
    // What lies in the arrays is for the reader to judge; in the checked view it is not.
    let words = block.len();
    block[words / 4] = u64::from_ne_bytes([0xff; 8]);
    assert!(StateView::new(bytemuck::cast_slice(&block)).is_err());
    let framed = StateView::framed(bytemuck::cast_slice(&block)).unwrap();
    assert!((0..3).any(|axis| framed.velocity_m_s(axis).iter().any(|value| value.is_nan())));
    for word in [0, 2, 3, 4] {
        let mut block = whole.clone();
        block[word] ^= 0x0001_0001;
        let found = StateView::framed(bytemuck::cast_slice(&block)).err();
        assert!(found.is_some(), "word {word}: magic, length, version and capacity, cells");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(3), failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn damaged_states_never_panic_and_never_pass(flips in prop::collection::vec((0usize..1_000_000, 1u64..), 1..4), header in any::<bool>()) {
        let solver = Solver::new(scene::model([4, 4, 3]), 1).unwrap();
        let good = scene::state(&solver);
        let mut block = good.clone();
        for (at, bits) in flips {
            let at = if header { at % 12 } else { at % block.len() };
            block[at] ^= bits;
        }
        if block != good {
            prop_assert!(solver.load(bytemuck::cast_slice(&block)).is_err());
        }
    }

    #[test]
    fn random_bytes_are_refused(words in prop::collection::vec(any::<u64>(), 0..400)) {
        let solver = Solver::new(scene::model([4, 4, 3]), 1).unwrap();
        prop_assert!(solver.load(bytemuck::cast_slice(&words)).is_err());
    }
}
