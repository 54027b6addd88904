//! Promise of the judge: it compares what can be compared, and says what is wrong with a newcomer of which nothing can.

mod inputs;

use super::*;
use hyst_messages::stream::message_bytes;
use hyst_messages::{FluidStatus, MessageMut};

fn state(epoch: u32, incarnation: u32, tick: u64, pressure_pa: f32) -> Vec<u8> {
    let sections = [size_of::<FluidStatus>(), 8, 16];
    let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
    let header = StreamHeader { epoch, incarnation, tick, step_ticks: 33, ..Default::default() };
    let mut message = MessageMut::format(bytes, Kind::FluidState, header, &sections).unwrap();
    let status = FluidStatus { pressure_pa, ..Default::default() };
    message.section::<u8>(0).unwrap().copy_from_slice(bytemuck::bytes_of(&status));
    bytemuck::cast_slice(&memory).to_vec()
}

#[test]
fn states_of_one_tick_are_compared_whoever_comes_first_and_only_one_of_them_is_the_roles() {
    let mut pairs = Pairs::default();
    pairs.take(Kind::FluidState, &state(4, 6, 33, 9_000.0), 17);
    pairs.take(Kind::FluidState, &state(0, 17, 66, 9_000.0), 17);
    assert_eq!(pairs.seen.compared, 0, "nothing of the same tick");
    pairs.take(Kind::FluidState, &state(4, 6, 66, 9_100.0), 17);
    pairs.take(Kind::FluidState, &state(0, 17, 33, 9_000.0), 17);
    assert_eq!((pairs.seen.compared, pairs.seen.outside), (2, 0));
    assert!((pairs.seen.worst - 0.1).abs() < 1e-6, "{:?}", pairs.seen);
    for tick in [99, 132, 165] {
        pairs.take(Kind::FluidState, &state(5, 17, tick, 12_000.0), 17);
        pairs.take(Kind::FluidState, &state(0, 6, tick, 9_000.0), 17);
    }
    assert_eq!((pairs.seen.compared, pairs.seen.outside, pairs.seen.ratio), (5, 3, 3.0));
    assert!(pairs.seen.text.starts_with("pressure differ by 3.000e3 Pa"), "{}", pairs.seen.text);
    pairs.take(Kind::FluidState, &state(5, 17, 198, 9_000.0), 17);
    pairs.take(Kind::FluidState, &state(6, 6, 198, 12_000.0), 17);
    assert_eq!(pairs.seen.compared, 5, "two states of the role in different epochs are not for the judge");
    pairs.take(Kind::FluidState, &state(0, 6, 198, 9_000.0), 17);
    assert_eq!((pairs.seen.compared, pairs.seen.outside), (6, 0));
    assert!(pairs.waiting.len() <= MOST_WAITING);
}

/// A newcomer that copied the header of the state it went on from counted as the old engine: after a minute it could not be compared, and one that sent states
/// under both names agreed with itself.
#[test]
fn a_newcomer_whose_states_name_another_writer_is_out_of_tolerance_whatever_else_it_sends() {
    let [old, own] = WRITERS;
    let (mut alone, mut both) = (Pairs::default(), Pairs::default());
    for turn in 1..=30 {
        let copied = state(4, old, 33 * turn, 9_000.0);
        for pairs in [&mut alone, &mut both] {
            pairs.hear(Kind::FluidState, &copied, own, own);
        }
        both.hear(Kind::FluidState, &state(SHADOW_EPOCH, own, 33 * turn, 9_000.0), own, own);
        assert_eq!(both.seen().good, turn - 1, "with itself it is not compared");
        let Seen { outside, good, text, .. } = alone.seen();
        let is_told = text.starts_with("its state names another incarnation, 6, than its own, which is 17");
        assert!(is_told && (outside, good) == (turn, 0), "{text}");
        both.hear(Kind::FluidState, &state(4, old, 33 * turn, 9_000.0), old, own);
    }
    assert!(both.seen().good == 30 && both.seen().has_too_many_bad(), "of each two one is: {:?}", both.seen());
    let mut damaged = Pairs::default();
    for turn in 1..=3 {
        damaged.hear(Kind::FluidState, &state(4, own, 33 * turn, 12_000.0), old, own);
        damaged.hear(Kind::FluidState, &state(SHADOW_EPOCH, own, 33 * turn, 9_000.0), own, own);
    }
    assert_eq!((damaged.seen().compared, damaged.seen().outside), (0, 0), "a header of the old engine's may have flipped");
}

#[test]
fn a_newcomer_whose_states_are_right_and_whose_contact_model_has_no_planes_is_out_of_tolerance() {
    let mut pairs = Pairs::default();
    let model = |epoch: u32, incarnation: u32, state_tick: u64, plane_count: u32| {
        let mut model = ContactModel { epoch, incarnation, state_tick, plane_count, ..ContactModel::default() };
        (model.planes[0].stiffness_n_m, model.planes[0].normal) = (400.0, [0.0, 0.0, 1.0]);
        model
    };
    pairs.take(Kind::FluidState, &state(4, 6, 33, 9_000.0), 17);
    pairs.take(Kind::FluidState, &state(0, 17, 33, 9_000.0), 17);
    for tick in 40..43 {
        pairs.take_model(model(4, 6, tick, 1), 17);
        pairs.take_model(model(0, 17, tick, 1), 17);
    }
    assert_eq!((pairs.seen().compared, pairs.seen().outside, pairs.felt.compared), (1, 0, 3));
    for tick in 43..46 {
        pairs.take_model(model(0, 17, tick, 0), 17);
        pairs.take_model(model(4, 6, tick, 1), 17);
    }
    let seen = pairs.seen();
    assert_eq!((seen.compared, seen.outside), (1, 3));
    assert!(seen.worst > 1.0 && seen.text.starts_with("contact force differ by"), "{seen:?}");
    pairs.take_model(model(4, 6, 46, 1), 17);
    pairs.take_model(model(5, 17, 46, 0), 17);
    assert_eq!(pairs.felt.compared, 6, "both are of the role: not for the judge");
}

#[test]
fn a_newcomer_that_leapt_over_ticks_is_compared_again_once_that_is_forgotten() {
    let mut pairs = Pairs::default();
    pairs.take(Kind::FluidState, &state(4, 6, 0, 9_000.0), 17);
    let mut both = |epoch: u32, tick: u64| {
        pairs.take(Kind::FluidState, &state(epoch, 17, tick, 12_000.0), 17);
        pairs.take(Kind::FluidState, &state(0, 6, tick, 9_000.0), 17);
        pairs.seen.compared
    };
    assert_eq!(both(5, 33), 1, "its first epoch begins without a leap");
    assert_eq!(both(5, 66), 2);
    assert_eq!(both(6, 66 + 33), 3, "an epoch of its own, and no tick is missing");
    let leapt = 99 + 66;
    assert_eq!(both(7, leapt), 3, "it leapt");
    assert_eq!(both(7, leapt + FORGET_TICKS - 1), 3);
    assert_eq!(both(7, leapt + FORGET_TICKS), 4);
    assert_eq!(both(7, leapt + FORGET_TICKS + 33), 5);
    let far = leapt + FORGET_TICKS + 33 + 33 * (LOST + 1);
    assert_eq!(both(7, far), 5, "the old engine leapt");
    assert_eq!(both(7, far + FORGET_TICKS), 6);
}

/// The old engine's states of before a pause lay far behind those of after it: for a quarter of a second nothing was compared then.
#[test]
fn a_pause_in_which_the_newcomer_has_given_the_role_back_is_no_leap() {
    let mut pairs = Pairs::default();
    let compared = |pairs: &mut Pairs, epoch: u32, tick: u64| {
        pairs.take(Kind::FluidState, &state(SHADOW_EPOCH, 6, tick, 9_000.0), 17);
        pairs.take(Kind::FluidState, &state(epoch, 17, tick, 9_000.0), 17);
        pairs.seen.compared
    };
    pairs.take(Kind::FluidState, &state(4, 6, 33, 9_000.0), 17);
    assert_eq!(compared(&mut pairs, 5, 66), 1);
    let last = 33 * (3 * LOST);
    for tick in (99..=last).step_by(33) {
        pairs.take(Kind::FluidState, &state(6, 6, tick, 9_000.0), 17);
    }
    assert_eq!(compared(&mut pairs, 7, last + 33), 2);
}

/// It was waited for for a minute, and then it was said that it could not be compared in time.
#[test]
fn a_newcomer_whose_steps_never_meet_the_old_engines_is_told_so_and_one_whose_steps_do_is_compared() {
    let with_step = |mut bytes: Vec<u8>, step_ticks: u32| {
        hyst_messages::stream::change_header(&mut bytes, |header| header.step_ticks = step_ticks);
        bytes
    };
    let shown = |step_ticks: u32, changes_at: u64| {
        let mut pairs = Pairs::default();
        for turn in 0..40 {
            let (now, step) = (66 * turn, if turn < changes_at { step_ticks } else { 66 });
            pairs.take(Kind::FluidState, &with_step(state(4, 6, now, 9_000.0), 66), 17);
            pairs.take(Kind::FluidState, &with_step(state(0, 17, now + u64::from(step), 9_000.0), step), 17);
        }
        pairs.seen()
    };
    let apart = shown(33, u64::MAX);
    assert!(apart.outside >= 3 && apart.text.starts_with("its steps are of 33 ticks"), "{apart:?}");
    for (step_ticks, changes_at) in [(33, 20), (66, 0), (132, u64::MAX)] {
        let seen = shown(step_ticks, changes_at);
        assert!(seen.outside == 0 && seen.compared > 10, "{step_ticks}: {seen:?}");
    }
}

#[test]
fn a_newcomer_that_takes_the_role_late_has_leapt_too() {
    let mut pairs = Pairs::default();
    pairs.take(Kind::FluidState, &state(4, 6, 33, 9_000.0), 17);
    for (tick, compared) in [(33 + 66, 0), (33 + 66 + FORGET_TICKS, 1)] {
        pairs.take(Kind::FluidState, &state(5, 17, tick, 12_000.0), 17);
        pairs.take(Kind::FluidState, &state(0, 6, tick, 9_000.0), 17);
        assert_eq!(pairs.seen.compared, compared);
    }
}

/// A piece that floated was 2.5 mm from where it was in the old engine, which had lost other ticks, and a good tissue was blamed for that.
#[test]
fn what_is_out_of_tolerance_after_a_leap_is_said_to_be_so_until_both_go_on_from_one_state() {
    let mut pairs = Pairs::default();
    let mut after = |epochs: [u32; 2], tick: u64, pressure_pa: f32| {
        pairs.take(Kind::FluidState, &state(epochs[0], 6, tick, 9_000.0), 17);
        pairs.take(Kind::FluidState, &state(epochs[1], 17, tick, pressure_pa), 17);
        let Seen { outside, leapt, .. } = pairs.seen();
        (outside, leapt)
    };
    assert_eq!(after([4, SHADOW_EPOCH], 33, 9_000.0), (0, false));
    assert_eq!(after([SHADOW_EPOCH, 5], 66, 12_000.0), (1, false), "of this it cannot be said");
    assert_eq!(after([SHADOW_EPOCH, 5], 99, 9_000.0), (0, false));
    let leapt = 99 + 66;
    after([SHADOW_EPOCH, 6], leapt, 9_000.0);
    for outside in 1..=3 {
        let tick = leapt + FORGET_TICKS + 33 * outside;
        assert_eq!(after([SHADOW_EPOCH, 6], tick, 12_000.0), (outside, true));
    }
    let back = leapt + FORGET_TICKS + 33 * 4;
    assert_eq!(after([7, SHADOW_EPOCH], back, 9_000.0), (0, false));
    for outside in 1..=3 {
        let found = after([7, SHADOW_EPOCH], back + 33 * outside, 12_000.0);
        assert_eq!(found, (outside, false), "in the shadow nothing is excused");
    }
}

/// A tissue's state of a mesh with so many nodes.
fn tissue([epoch, incarnation, mesh]: [u32; 3], tick: u64, nodes: usize) -> Vec<u8> {
    let sections = [8, 12 * nodes, 12 * nodes, 12];
    let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
    let header = StreamHeader { epoch, incarnation, tick, step_ticks: 1, topology_version: mesh, ..Default::default() };
    MessageMut::format(bytemuck::cast_slice_mut(&mut memory), Kind::TissueState, header, &sections).unwrap();
    bytemuck::cast_slice(&memory).to_vec()
}

/// The old engine, and the newcomer.
const WRITERS: [u32; 2] = [6, 17];

/// A tissue's contact model, with so many planes.
fn tissue_model([epoch, incarnation, plane_count]: [u32; 3], state_tick: u64, input_tick: u64) -> ContactModel {
    let mut model = ContactModel { epoch, incarnation, state_tick, input_tick, plane_count, ..ContactModel::default() };
    (model.planes[0].stiffness_n_m, model.planes[0].normal) = (400.0, [0.0, 0.0, 1.0]);
    model
}

/// What is seen after a pair of tissues under these epochs, with these meshes and as many more nodes; the old engine's contact model has a plane.
fn after_a_pair(pairs: &mut Pairs, tick: u64, epochs: [u32; 2], meshes: [u32; 2], planes: [u32; 2]) -> Seen {
    for side in [0, 1] {
        let state = tissue([epochs[side], WRITERS[side], meshes[side]], tick, 4 + meshes[side] as usize);
        pairs.take(Kind::TissueState, &state, WRITERS[1]);
    }
    for side in [0, 1] {
        pairs.take_model(tissue_model([epochs[side], WRITERS[side], planes[side]], tick, 0), WRITERS[1]);
    }
    pairs.seen()
}

/// A good tissue that took the role while the electrode cut was out of tolerance: it had lost other ticks than the old one, and had another mesh.
#[test]
fn of_a_tissue_that_has_the_role_nothing_is_compared_while_the_meshes_are_not_the_same() {
    let mut pairs = Pairs { has_models: true, ..Pairs::default() };
    let mut after = |turn: u64, meshes: [u32; 2], planes: [u32; 2]| {
        let seen = after_a_pair(&mut pairs, 16 * turn, [SHADOW_EPOCH, 5], meshes, planes);
        (seen.compared, seen.outside, seen.apart)
    };
    for turn in 1..=3 {
        assert_eq!(after(turn, [1, 1], [1, 1]), (turn, 0, 0));
    }
    for turn in 4..=60 {
        assert_eq!(after(turn, [1, 2], [1, 0]), (3, 0, turn as u32 - 3));
    }
    assert_eq!(after(61, [2, 2], [1, 1]), (4, 0, 0), "they have met again");
    assert_eq!(after(62, [2, 2], [1, 0]), (5, 1, 0), "and what differs is seen");
}

#[test]
fn in_the_shadow_one_mesh_that_is_another_tells_nothing_and_one_after_the_other_tells_all() {
    let seen_of = |is_alike: fn(u64) -> bool| {
        let (mut pairs, mut seen) = (Pairs { has_models: true, ..Pairs::default() }, Seen::default());
        for turn in 1..=60 {
            let own = if is_alike(turn) { 1 } else { 2 };
            seen = after_a_pair(&mut pairs, 16 * turn, [4, SHADOW_EPOCH], [1, own], [1, 1]);
        }
        seen
    };
    let now_and_then = seen_of(|turn| turn % 2 == 0);
    assert!(now_and_then.outside == 0 && now_and_then.compared >= 30 && now_and_then.apart == 0, "{now_and_then:?}");
    let never = seen_of(|_| false);
    assert!(never.outside >= 3 && never.text.starts_with("the mesh that it makes"), "{never:?}");
}

/// In the shadow it was good for a minute, beside which the two seconds for which it had the role were a small share.
#[test]
fn pairs_out_of_tolerance_are_counted_of_those_since_the_newcomer_has_the_role_or_has_it_no_more() {
    let mut pairs = Pairs::default();
    let mut after = |epochs: [u32; 2], tick: u64, is_bad: bool| {
        pairs.take(Kind::FluidState, &state(epochs[0], 6, tick, 9_000.0), 17);
        pairs.take(Kind::FluidState, &state(epochs[1], 17, tick, if is_bad { 12_000.0 } else { 9_000.0 }), 17);
        let Seen { compared, good, bad_of, .. } = pairs.seen();
        (compared, good, bad_of)
    };
    for turn in 1..=60 {
        assert_eq!(after([4, SHADOW_EPOCH], 33 * turn, turn == 1).2, [1, turn]);
    }
    for turn in 1..=30u64 {
        let bad = turn - turn / 3;
        assert_eq!(after([SHADOW_EPOCH, 5], 33 * (60 + turn), turn % 3 != 0), (60 + turn, 59 + turn / 3, [bad, turn]));
    }
    // One of the old engine's that comes late, and the newcomer's of that tick: both of the time before.
    pairs.take(Kind::FluidState, &state(5, 17, 33 * 91, 12_000.0), 17);
    assert!(pairs.seen().has_too_many_bad() && pairs.seen().flaw.starts_with("pressure differ by 3.000e3 Pa"));
    pairs.take(Kind::FluidState, &state(6, 6, 33 * 92, 9_000.0), 17);
    assert_eq!(pairs.seen().bad_of, [0, 0], "it has the role no more");
    pairs.take(Kind::FluidState, &state(SHADOW_EPOCH, 6, 33 * 91, 9_000.0), 17);
    assert_eq!((pairs.seen().compared, pairs.seen().good, pairs.seen().bad_of), (91, 69, [0, 0]));
    pairs.take(Kind::FluidState, &state(SHADOW_EPOCH, 17, 33 * 92, 9_000.0), 17);
    assert_eq!(pairs.seen().bad_of, [0, 1]);
}

#[test]
fn contact_models_that_are_out_of_tolerance_now_and_then_are_too_many_beside_states_that_are_right() {
    let mut pairs = Pairs { has_models: true, ..Pairs::default() };
    let mut seen = Seen::default();
    for turn in 1..=30 {
        seen = after_a_pair(&mut pairs, 16 * turn, [SHADOW_EPOCH, 5], [1, 1], [1, u32::from(turn % 3 == 0)]);
    }
    assert!(seen.has_too_many_bad() && seen.flaw.starts_with("contact force differ by"), "{seen:?}");
    assert_eq!((seen.compared, seen.good, seen.bad_of), (30, 10, [20, 30]));
    let few = [[2, 29], [2, 1_000], [3, 30], [10, 100], [0, 0]];
    assert!(few.into_iter().all(|bad_of| !are_too_many(bad_of)));
    assert!([[4, 30], [3, 29], [11, 100]].map(are_too_many) == [true, false, true]);
}

/// One of steps of four ticks that is more than 32 behind leaps over fewer states than a look that is late may lose of one whose steps are shorter.
#[test]
fn an_old_tissue_that_leaps_is_seen_to_whatever_the_length_of_its_steps() {
    for step_ticks in [1_u32, 2, 4] {
        let mut pairs = Pairs::default();
        let mut take = |tick: u32| {
            let mut elder = tissue([SHADOW_EPOCH, WRITERS[0], 1], u64::from(tick), 4);
            hyst_messages::stream::change_header(&mut elder, |header| header.step_ticks = step_ticks);
            pairs.take(Kind::TissueState, &elder, WRITERS[1]);
            pairs.seen().leapt
        };
        assert!(!take(40) && !take(40 + step_ticks) && !take(40 + 9 * step_ticks), "{step_ticks}: some were not seen");
        assert!(take(40 + 9 * step_ticks + 32 + step_ticks), "{step_ticks}");
    }
}
