//! Whose state a servo goes on from, so that two servos that lost different ticks are equal to the bit again without a restart.
//!
//! A servo is *astray* when its state is not the one that the hand has felt: it lost ticks, or it is newborn and differs. It goes on from
//! the other's state at the tick before, as soon as that can be read, unless the other has no better claim. Of two that are both astray,
//! the one that the device follows is right, because its force is what the hand felt; without it, the one in the first slot. Who has said
//! nothing yet goes on from whoever has said the tick before, in the shadow or not.
//!
//! Which of that came about hangs on moments that no replay has. So what was not the usual is recorded, and in a replay each servo goes on from what the
//! recorded one went on from ([`replayed`]).

use hyst_coupling::{ServoParams, ServoState};
use hyst_messages::record::{FORCE_ASTRAY, FORCE_SHADOW};
use hyst_messages::{FROM_NOTHING, FROM_OTHER, FROM_OWN, ForceRecord, OriginRecord, Replayed};

/// Ticks without a word from the other replica after which nobody needs to wait for it.
pub const LONELY_TICKS: u64 = 5;

/// No servo makes more, N.
const MOST_FORCE_N: f32 = 100.0;

/// One of the two servos.
#[derive(Clone, Copy, Debug)]
pub struct Seat {
    /// Its incarnation.
    pub incarnation: u32,
    /// Its index among the servos.
    pub index: usize,
}

/// What is known of the other servo.
#[derive(Clone, Copy, Debug)]
pub struct Other {
    /// Who.
    pub seat: Seat,
    /// Its newest word.
    pub newest: ForceRecord,
    /// Its word of the tick before the present one.
    pub before: Option<ForceRecord>,
}

/// What a servo goes on from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// The state before the tick.
    pub state: ServoState,
    /// The tick after which somebody had it; 0 if nobody did.
    pub from_tick: u64,
    /// Whether that was the other.
    pub is_others: bool,
    /// Whether it is still not known to be the right one.
    pub astray: bool,
}

impl Origin {
    /// What is recorded of it where it is not the usual, the own state of the tick before; `servo` is the index of who goes on from it.
    pub fn record(&self, servo: usize, tick: u64) -> Option<OriginRecord> {
        let is_usual = !self.is_others && self.from_tick.checked_add(1) == Some(tick);
        let from_servo = if self.is_others { 1 - servo.min(1) } else { servo };
        let record = OriginRecord { tick, from_tick: self.from_tick, servo: servo as u32, from_servo: from_servo as u32 };
        (!is_usual).then_some(record)
    }
}

/// The servo's state in a record.
pub fn state_of(record: &ForceRecord) -> ServoState {
    ServoState::of_words(&record.servo_state)
}

/// Whether two records of one tick say the same, force and state, to the bit.
pub fn agree(a: &ForceRecord, b: &ForceRecord) -> bool {
    a.tick == b.tick && a.force_n.map(f32::to_bits) == b.force_n.map(f32::to_bits) && a.servo_state == b.servo_state
}

/// Whether a record says a force that can be, and the state of its own tick.
pub fn is_sound(params: &ServoParams, record: &ForceRecord) -> bool {
    let state = state_of(record);
    let norm = record.force_n.iter().map(|part| part * part).sum::<f32>().sqrt();
    norm <= MOST_FORCE_N && state.is_sound(params) && state.tick == record.tick
}

/// Whether the other, that says `word`, is right where the two differ.
fn leads(word: &ForceRecord, other: Seat, me: Seat, selected: u32) -> bool {
    if word.flags & (FORCE_SHADOW | FORCE_ASTRAY) == 0 || selected == other.incarnation {
        return true;
    }
    selected != me.incarnation && other.index < me.index
}

/// What to compute `tick` from; `last` is what this servo said last, `selected` the incarnation that the device follows.
pub fn origin(params: &ServoParams, me: Seat, last: &ForceRecord, other: Option<&Other>, tick: u64, selected: u32) -> Origin {
    let own = |astray| Origin { state: state_of(last), from_tick: last.tick, is_others: false, astray };
    let heard = other.filter(|other| other.newest.tick.saturating_add(LONELY_TICKS) > tick);
    let said = heard.map(|other| (other.before.unwrap_or(other.newest), other.seat));
    let before = heard.and_then(|other| other.before);
    let says_its_first = last.tick == 0 && before.is_some();
    let led = said.is_some_and(|(word, seat)| says_its_first || leads(&word, seat, me, selected));
    let whole = last.tick + 1 == tick && last.flags & FORCE_ASTRAY == 0;
    let newborn = last.flags & FORCE_SHADOW != 0 || last.tick == 0;
    let differs = newborn && before.is_some_and(|before| !agree(&before, last));
    if !led || (whole && !differs) {
        return own(false);
    }
    let sound =
        before.map(|before| state_of(&before)).filter(|state| state.is_sound(params) && state.tick.checked_add(1) == Some(tick));
    sound.map_or_else(|| own(true), |state| Origin { state, from_tick: state.tick, is_others: true, astray: false })
}

/// In a replay: what the recorded answer to `tick` went on from. `None` if the servo knows by itself, and if that state is not there: `own` and `others` give
/// the states that the two have come to with their answers to a tick. Where one lacks it the other may have it: one of them is newborn, or an older
/// recording says only how old it was.
pub fn replayed(
    told: Replayed,
    tick: u64,
    own: impl Fn(u64) -> Option<ServoState>,
    others: impl Fn(u64) -> Option<ServoState>,
) -> Option<Origin> {
    let from_tick = tick.checked_sub(u64::from(told.lag))?;
    let origin = |state, is_others| Origin { state, from_tick, is_others, astray: false };
    let own = || own(from_tick).map(|state| origin(state, false));
    let others = || others(from_tick).map(|state| origin(state, true));
    match told.from {
        FROM_OWN => own().or_else(others),
        FROM_OTHER => others().or_else(own),
        FROM_NOTHING => Some(Origin { from_tick: 0, ..origin(ServoState::default(), false) }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ME: Seat = Seat { incarnation: 7, index: 1 };
    const PEER: Seat = Seat { incarnation: 5, index: 0 };

    fn said(tick: u64, energy_j: f32, flags: u32) -> ForceRecord {
        let state = ServoState { tick, energy_j, ramp: 1.0, running: 1, ..Default::default() };
        let mut record = ForceRecord { tick, flags, ..Default::default() };
        bytemuck::cast_slice_mut(&mut record.servo_state)[..size_of::<ServoState>()].copy_from_slice(bytemuck::bytes_of(&state));
        record
    }

    /// Energy of the state gone on from, and whether it is astray, for what this servo and the other said of the tick before.
    fn gone_on(last: ForceRecord, newest: ForceRecord, before: Option<ForceRecord>, selected: u32) -> (f32, bool) {
        let other = Other { seat: PEER, newest, before };
        let origin = origin(&ServoParams::default(), ME, &last, Some(&other), 100, selected);
        (origin.state.energy_j, origin.astray)
    }

    #[test]
    fn a_word_that_cannot_be_or_is_not_of_its_tick_is_none() {
        let params = ServoParams::default();
        let good = said(99, 0.1, 0);
        let with = |force_n: f32| {
            let mut record = good;
            record.force_n[1] = force_n;
            record
        };
        assert!(is_sound(&params, &good) && is_sound(&params, &with(1.0)));
        for force_n in [f32::NAN, f32::INFINITY, 1e9] {
            assert!(!is_sound(&params, &with(force_n)), "{force_n}");
        }
        let mut stands = good;
        stands.tick = 100;
        assert!(!is_sound(&params, &stands), "a state that stands still under a stamp that does not");
    }

    #[test]
    fn the_state_of_the_tick_before_is_found_although_the_present_one_is_written() {
        let (gap, now, before) = (said(90, 0.1, 0), said(100, 0.3, 0), said(99, 0.2, 0));
        assert_eq!(gone_on(gap, now, Some(before), 0), (0.2, false));
        assert_eq!(gone_on(gap, now, None, 0), (0.1, true), "not to be had: on with the own, and astray");
        let later = said(99, 0.1, FORCE_ASTRAY);
        assert_eq!(gone_on(later, now, Some(before), 0), (0.2, false), "as soon as it is to be had");
    }

    #[test]
    fn of_two_that_lost_ticks_the_one_that_is_not_selected_adopts() {
        let astray = said(99, 0.2, FORCE_ASTRAY);
        let mine = said(99, 0.1, FORCE_ASTRAY);
        assert_eq!(gone_on(mine, astray, Some(astray), PEER.incarnation), (0.2, false));
        assert_eq!(gone_on(mine, astray, Some(astray), ME.incarnation), (0.1, false), "the selected one is right");
        assert_eq!(gone_on(mine, astray, Some(astray), 0), (0.2, false), "nobody is selected: the first slot is right");
    }

    #[test]
    fn without_a_gap_a_difference_is_a_fault_and_nobody_adopts() {
        let (mine, theirs) = (said(99, 0.1, 0), said(99, 0.2, 0));
        assert_eq!(gone_on(mine, theirs, Some(theirs), PEER.incarnation), (0.1, false));
        let newborn = said(99, 0.1, FORCE_SHADOW);
        assert_eq!(gone_on(newborn, theirs, Some(theirs), 0), (0.2, false), "but a newborn does");
    }

    /// Both are newborn, the one that was followed is dead: whatever the device says of whom it follows, the history is the other's.
    #[test]
    fn who_has_said_nothing_yet_goes_on_from_another_in_the_shadow() {
        let theirs = said(99, 0.2, FORCE_SHADOW);
        let (first, second) = (Seat { index: 0, ..ME }, Seat { index: 1, ..PEER });
        let other = Other { seat: second, newest: theirs, before: Some(theirs) };
        for selected in [0, 3, first.incarnation, second.incarnation] {
            let from = origin(&ServoParams::default(), first, &ForceRecord::default(), Some(&other), 100, selected);
            assert_eq!((from.state.energy_j, from.astray), (0.2, false), "{selected} is selected");
        }
        let none_before = Other { newest: said(100, 0.2, FORCE_SHADOW), before: None, ..other };
        let from = origin(&ServoParams::default(), first, &ForceRecord::default(), Some(&none_before), 100, 0);
        assert_eq!((from.state.tick, from.astray), (0, false), "both begin");
    }

    #[test]
    fn a_word_of_the_last_tick_that_can_be_written_ends_nobody_who_hears_it() {
        let beyond = said(u64::MAX, 0.2, 0);
        assert_eq!(gone_on(said(99, 0.1, 0), beyond, Some(beyond), 0), (0.1, false));
        assert_eq!(
            gone_on(said(90, 0.1, 0), beyond, Some(beyond), 0),
            (0.1, true),
            "it lost ticks, and that is no state of them"
        );
    }

    #[test]
    fn a_state_that_is_not_sound_is_never_adopted() {
        let mine = said(99, 0.1, FORCE_ASTRAY);
        for bad in [said(99, f32::NAN, 0), said(99, 50.0, 0), ForceRecord { tick: 99, ..Default::default() }] {
            assert_eq!(gone_on(mine, bad, Some(bad), PEER.incarnation), (0.1, true));
        }
        let older = said(98, 0.2, 0);
        assert_eq!(gone_on(mine, older, Some(ForceRecord { tick: 99, ..older }), 0), (0.1, true), "a state of another tick");
    }

    #[test]
    fn who_is_alone_goes_on_alone() {
        let gap = said(90, 0.1, FORCE_ASTRAY);
        assert_eq!(gone_on(gap, said(95, 0.2, 0), None, PEER.incarnation), (0.1, false), "silent for five ticks");
        let alone = Origin { state: state_of(&gap), from_tick: 90, is_others: false, astray: false };
        assert_eq!(origin(&ServoParams::default(), ME, &gap, None, 100, 0), alone);
    }
}
