//! Promise of the judge: a tick that both sides made of inputs of different ticks is held against nobody, and who uses another input again and again is
//! not taken.

use super::*;
use hyst_messages::stream::change_header;

/// Takes one side's state of a tick, made of an input of so many ticks before it.
fn take_state(pairs: &mut Pairs, side: usize, tick: u64, epoch: u32, back: u64) {
    let mut state = tissue([epoch, WRITERS[side], 1], tick, 4);
    change_header(&mut state, |header| header.input_tick = tick - back);
    pairs.take(Kind::TissueState, &state, WRITERS[1]);
}

/// Pairs compared, those in a row out of tolerance, and whether the two have parted, after a pair of a tick under these epochs. The old engine's contact
/// model has a plane, the newcomer's has so many.
fn after(pairs: &mut Pairs, tick: u64, epochs: [u32; 2], back: [u64; 2], planes: u32) -> (u64, u64, bool) {
    for side in [0, 1] {
        take_state(pairs, side, tick, epochs[side], back[side]);
    }
    for side in [0, 1] {
        let model = tissue_model([epochs[side], WRITERS[side], [1, planes][side]], tick, tick - back[side]);
        pairs.take_model(model, WRITERS[1]);
    }
    let Seen { compared, outside, leapt, .. } = pairs.seen();
    (compared, outside, leapt)
}

fn of_a_tissue() -> Pairs {
    Pairs { has_models: true, ..Pairs::default() }
}

#[test]
fn in_the_shadow_a_pair_of_other_inputs_is_not_compared_and_the_next_one_is() {
    let (mut pairs, epochs) = (of_a_tissue(), [4, SHADOW_EPOCH]);
    assert_eq!(after(&mut pairs, 16, epochs, [1, 1], 1), (1, 0, false));
    assert_eq!(after(&mut pairs, 32, epochs, [2, 1], 0), (1, 0, false), "the old engine was early");
    assert_eq!(after(&mut pairs, 48, epochs, [1, 2], 0), (1, 0, false), "the newcomer was early");
    assert_eq!(after(&mut pairs, 64, epochs, [1, 1], 0), (2, 1, false), "its own doing");
    assert_eq!(after(&mut pairs, 80, epochs, [3, 3], 0), (3, 2, false), "both used an old one: the device made no other");
}

/// One of the two has moved the scope a tick later, and a piece that floats may be elsewhere from then on.
#[test]
fn where_the_newcomer_has_the_role_two_that_used_other_inputs_for_a_tick_have_parted_as_by_a_leap() {
    let (mut pairs, epochs) = (of_a_tissue(), [SHADOW_EPOCH, 5]);
    assert_eq!(after(&mut pairs, 16, epochs, [1, 1], 1), (1, 0, false));
    assert_eq!(after(&mut pairs, 17, epochs, [1, 2], 0), (1, 0, true), "a tick of which no states are compared");
    let forgotten = 17 + FORGET_TICKS;
    for tick in (32..forgotten).step_by(16) {
        assert_eq!(after(&mut pairs, tick, epochs, [1, 1], 0), (1, 0, true), "{tick}");
    }
    let next = forgotten.next_multiple_of(16);
    assert_eq!(after(&mut pairs, next, epochs, [1, 1], 0), (2, 1, true));
    let (next, epochs) = (next + 16, [SHADOW_EPOCH, 6]);
    let begins = after(&mut pairs, next - 15, epochs, [1, 1], 1);
    assert_eq!((begins.1, begins.2), (0, false), "both go on from one state");
    assert_eq!(after(&mut pairs, next, epochs, [1, 1], 0), (3, 1, false), "that is the newcomer's alone");
}

#[test]
fn another_input_is_seen_of_an_old_engine_that_is_behind() {
    let mut pairs = of_a_tissue();
    (1..=33).for_each(|tick| take_state(&mut pairs, 1, tick, 5, 1));
    take_state(&mut pairs, 0, 1, SHADOW_EPOCH, 1);
    assert!(!pairs.seen().leapt);
    take_state(&mut pairs, 0, 2, SHADOW_EPOCH, 2);
    assert!(pairs.seen().leapt);
}

/// A model is in the page before its state is sent.
#[test]
fn a_contact_model_says_itself_of_which_input_it_is() {
    let mut pairs = of_a_tissue();
    let mut after = |tick: u64, back: u64| {
        pairs.take_model(tissue_model([SHADOW_EPOCH, 6, 1], tick, tick - 1), 17);
        pairs.take_model(tissue_model([5, 17, 0], tick, tick - back), 17);
        (pairs.felt.compared, pairs.felt.outside, pairs.has_leapt)
    };
    assert_eq!(after(40, 1), (1, 1, false));
    assert_eq!(after(41, 2), (1, 1, true));
    assert_eq!(after(41 + FORGET_TICKS, 1), (2, 2, true));
}

#[test]
fn a_newcomer_that_uses_old_inputs_again_and_again_agrees_in_nothing() {
    let most_compared = |epochs: [u32; 2], back: fn(u64) -> u64| {
        let mut pairs = of_a_tissue();
        (1..=60).map(|turn| after(&mut pairs, 16 * turn, epochs, [1, back(turn)], 1).0).max()
    };
    assert_eq!(most_compared([4, SHADOW_EPOCH], |_| 2), Some(0));
    assert_eq!(most_compared([SHADOW_EPOCH, 5], |_| 2), Some(0));
    // Where it has the role, six in a second are enough, as of leaps.
    assert_eq!(most_compared([SHADOW_EPOCH, 5], |turn| if turn % 10 == 1 { 2 } else { 1 }), Some(0));
    assert_eq!(most_compared([SHADOW_EPOCH, 5], |_| 1), Some(60));
}

/// A fluid's word names the tissue that its walls are of. Who is beside the role begins its step later, and knows a newer one.
#[test]
fn fluids_whose_walls_are_of_other_states_of_the_tissue_are_compared() {
    let mut pairs = Pairs::default();
    for (epoch, incarnation, input_tick, pressure_pa) in [(4, 6, 20, 9_000.0), (SHADOW_EPOCH, 17, 30, 12_000.0)] {
        let mut state = state(epoch, incarnation, 33, pressure_pa);
        change_header(&mut state, |header| header.input_tick = input_tick);
        pairs.take(Kind::FluidState, &state, 17);
    }
    assert_eq!((pairs.seen().compared, pairs.seen().outside), (1, 1));
}
