//! A tissue on trial while the electrode cuts: it cuts nothing, has the role again in the next pause, and is blamed for nothing.

use hyst_messages::page::Stage;
use hyst_messages::{Role, Slot};
use hystation::policy::{Action, Cause, Event, Exit, GIVE_BACK_WITHIN_NS, Reason, SHADOW_WITHIN_NS, State, probation_ns, step};

const ROLE: Role = Role::Tissue;
const NEWCOMER: u32 = 3;
const AGREED: Event = Event::Agreed { incarnation: NEWCOMER };
const CUTS: Event = Event::Cuts { incarnation: NEWCOMER };
/// To whom had the role before.
const BACK: Action = Action::HandOver { role: ROLE, incarnation: 1 };

/// What has a newcomer give the role back, drawn by 0 or 1.
pub fn one_of(incarnation: u32, drawn: u64) -> Event {
    if drawn == 0 { Event::Cuts { incarnation } } else { parted(incarnation) }
}

fn parted(incarnation: u32) -> Event {
    Event::Parted { incarnation, reason: Reason::new(Cause::OutOfTolerance, "a piece is elsewhere") }
}

fn slots() -> [Slot; 3] {
    [0, 1, 2].map(|index| Slot::new(ROLE, index).unwrap())
}

fn holds(incarnation: u32) -> Event {
    Event::Holds { role: ROLE, incarnation }
}

fn told(stage: Stage) -> Action {
    Action::Told { role: ROLE, stage, incarnation: NEWCOMER }
}

/// A newcomer that has been in the shadow since 3 ns, and on probation since 5 ns.
fn on_probation() -> State {
    let [first, second, guest] = slots();
    let mut state = State::new(&[first, second]);
    step(0, Event::Started { adopted: vec![(first, 1), (second, 2)], warming: Vec::new() }, &mut state);
    step(0, holds(1), &mut state);
    step(1, Event::SwapAsked { slot: guest, incumbent: 1 }, &mut state);
    step(2, Event::Spawned { slot: guest, incarnation: NEWCOMER }, &mut state);
    step(3, Event::Ready { slot: guest, incarnation: NEWCOMER }, &mut state);
    assert_eq!(step(4, AGREED, &mut state), [told(Stage::Trial)]);
    assert_eq!(step(5, holds(NEWCOMER), &mut state), []);
    state
}

/// Why it is undone, if it is.
fn cause_of(actions: &[Action]) -> Option<Cause> {
    actions.iter().find_map(|action| if let Action::Retreat { reason, .. } = action { Some(reason.cause) } else { None })
}

#[test]
fn a_tissue_gives_the_role_back_for_as_long_as_something_is_cut_and_the_time_that_it_had_it_counts() {
    let (mut state, half_ns) = (on_probation(), probation_ns(ROLE) / 2);
    assert_eq!(step(5 + half_ns, CUTS, &mut state), [BACK]);
    assert_eq!(step(6 + half_ns, CUTS, &mut state), []);
    assert_eq!(step(6 + half_ns, Event::Tick, &mut state), [BACK], "until somebody has it");
    assert_eq!(step(7 + half_ns, holds(1), &mut state), [told(Stage::Shadow)]);
    assert_eq!(step(8 + half_ns, CUTS, &mut state), [], "the old engine does");
    let again_ns = 9 + 3 * half_ns;
    assert_eq!(step(again_ns, AGREED, &mut state), [told(Stage::Trial)]);
    for (event, at_ns) in
        [(holds(NEWCOMER), again_ns), (Event::Touched { incarnation: NEWCOMER }, again_ns), (AGREED, again_ns + half_ns)]
    {
        assert_eq!(step(at_ns, event, &mut state), []);
    }
    let mut is_settled = |now_ns: u64| step(now_ns, Event::Tick, &mut state).contains(&Action::Adopt { role: ROLE });
    assert_eq!([half_ns - 1, half_ns].map(|more_ns| is_settled(again_ns + more_ns)), [false, true]);
}

/// By the third stroke it had missed its steps again and again.
#[test]
fn no_stroke_is_a_loss_and_a_hand_that_leaves_no_pause_ends_the_swap() {
    let mut state = on_probation();
    for now_ns in (10..).step_by(10).take(20) {
        assert_eq!(step(now_ns, CUTS, &mut state), [BACK]);
        assert_eq!(step(now_ns + 1, holds(1), &mut state), [told(Stage::Shadow)]);
        assert_eq!(step(now_ns + 2, AGREED, &mut state), [told(Stage::Trial)]);
        assert_eq!(step(now_ns + 3, holds(NEWCOMER), &mut state), []);
    }
    step(1_000, CUTS, &mut state);
    step(1_001, holds(1), &mut state);
    assert_eq!(step(3 + SHADOW_WITHIN_NS, Event::Tick, &mut state), []);
    let actions = step(4 + SHADOW_WITHIN_NS, Event::Tick, &mut state);
    assert_eq!(cause_of(&actions), Some(Cause::NotCompared), "all pauses together: {actions:?}");
}

#[test]
fn a_tissue_that_goes_another_way_each_time_is_undone_and_one_of_which_it_did_once_is_not() {
    let mut state = on_probation();
    for now_ns in [10, 20, 30] {
        assert_eq!(step(now_ns, parted(NEWCOMER), &mut state), [BACK]);
        assert!(state.swap().is_some_and(|swap| swap.is_given_back()));
        assert_eq!(step(now_ns + 1, holds(1), &mut state), [told(Stage::Shadow)]);
        step(now_ns + 2, AGREED, &mut state);
        step(now_ns + 3, holds(NEWCOMER), &mut state);
    }
    assert!(state.swap().is_some_and(|swap| !swap.is_given_back()));
    let actions = step(40, parted(NEWCOMER), &mut state);
    let Some(Action::Retreat { reason, .. }) = actions.first() else { panic!("{actions:?}") };
    assert_eq!((reason.cause, &reason.text[..]), (Cause::OutOfTolerance, "a piece is elsewhere, again and again"));
}

#[test]
fn where_nobody_takes_the_role_back_the_newcomer_cuts() {
    let mut state = on_probation();
    assert_eq!(step(6, CUTS, &mut state), [BACK]);
    assert_eq!(step(7 + GIVE_BACK_WITHIN_NS, Event::Tick, &mut state), []);
    assert_eq!(step(8 + GIVE_BACK_WITHIN_NS, CUTS, &mut state), [BACK], "it is on probation as before");
    let mut state = on_probation();
    for (slot, incarnation) in [(slots()[0], 1), (slots()[1], 2)] {
        step(6, Event::Died { slot, incarnation, exit: Exit::Signal(9) }, &mut state);
    }
    assert_eq!(step(7, CUTS, &mut state), []);
}

#[test]
fn one_that_dies_while_it_gives_the_role_back_is_undone_as_ever() {
    let mut state = on_probation();
    step(6, CUTS, &mut state);
    let actions = step(7, Event::Died { slot: slots()[2], incarnation: NEWCOMER, exit: Exit::Signal(11) }, &mut state);
    assert_eq!(cause_of(&actions), Some(Cause::Died));
    assert_eq!(actions.last(), Some(&Action::EndSwap { role: ROLE, promoted: false }));
}
