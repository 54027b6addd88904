//! Two servos that lose ticks, are born anew and take each other's states, and their replay from what is recorded of that: without pages and clocks.

use super::*;
use hyst_messages::{ContactPlane, FROM_NOTHING, FROM_OTHER, FROM_OWN, OriginRecord, Replayed};
use std::collections::BTreeMap;

/// Ticks of a session.
const TICKS: u64 = 3_000;
const SEATS: [Seat; 2] = [Seat { incarnation: 5, index: 0 }, Seat { incarnation: 7, index: 1 }];

/// What a servo has answered, by tick.
type Said = BTreeMap<u64, ForceRecord>;

/// Numbers without end, the same each time.
struct Dice(u64);

impl Dice {
    fn below(&mut self, sides: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }

    fn servo(&mut self) -> usize {
        self.below(2) as usize
    }
}

/// A tip that goes in and out of a wall, so that each tick has another force, and energy, damper and proxy depend on all ticks before.
fn input(tick: u64, selected: usize) -> InputRecord {
    let depth_m = |tick: u64| 0.001 + 0.0008 * ((tick % 40) as f32 - 20.0).abs() / 20.0;
    let mut record = InputRecord { tick, selected_incarnation: u64::from(SEATS[selected].incarnation), ..Default::default() };
    (record.model.epoch, record.model.state_tick, record.model.plane_count) = (1, tick, 1);
    record.model.planes[0] =
        ContactPlane { point_m: [0.0; 3], stiffness_n_m: 400.0, normal: [0.0, 0.0, -1.0], damping_n_s_m: 0.5 };
    record.applied_n = [0.0, 0.0, -0.4 - 0.01 * (tick % 7) as f32];
    record.sample.pose.position_m = [0.0, 0.0, depth_m(tick)];
    record.sample.velocity_m_s = [0.0, 0.0, 1_000.0 * (depth_m(tick) - depth_m(tick - 1))];
    record
}

/// What one of the two sees of the other in a tick; its word of the tick before cannot always be had.
fn other(said: &[Said; 2], index: usize, tick: u64, is_read: bool) -> Option<Other> {
    let (_, newest) = said[1 - index].last_key_value()?;
    let before = said[1 - index].get(&(tick - 1)).copied().filter(|_| is_read);
    Some(Other { seat: SEATS[1 - index], newest: *newest, before })
}

/// What became of a session.
#[derive(Default)]
struct Session {
    /// The ticks that the device made, with whom it followed before and after.
    made: Vec<(u64, usize, usize)>,
    said: [Said; 2],
    /// What is recorded of the answers' origins, by tick and servo.
    origins: BTreeMap<(u64, usize), OriginRecord>,
}

impl Session {
    /// A session in which now and then the device, a servo or both at once are not let run, and a servo dies.
    fn record(seed: u64) -> Session {
        let (mut dice, mut session) = (Dice(seed), Session::default());
        let (mut last, mut away_until, mut stands_until, mut followed) = ([ForceRecord::default(); 2], [0; 2], 0, 0);
        for tick in 1..TICKS {
            if dice.below(60) == 0 {
                stands_until = tick + 1 + dice.below(5);
            }
            if tick < stands_until {
                continue;
            }
            if dice.below(25) == 0 {
                away_until = [tick + dice.below(9), tick + dice.below(9)];
            }
            if dice.below(40) == 0 {
                away_until[dice.servo()] = tick + dice.below(12);
            }
            if dice.below(100) == 0 {
                last[dice.servo()] = ForceRecord::default(); // a successor, who has said nothing yet
            }
            let (first, selected) = (dice.servo(), followed);
            for index in [first, 1 - first].into_iter().filter(|index| tick >= away_until[*index]) {
                let other = other(&session.said, index, tick, dice.below(8) > 0);
                let incarnation = SEATS[selected].incarnation;
                let from = accord::origin(&ServoParams::default(), SEATS[index], &last[index], other.as_ref(), tick, incarnation);
                session.origins.extend(from.record(index, tick).map(|origin| ((tick, index), origin)));
                last[index] = answer(&ServoParams::default(), &input(tick, selected), &from, false);
                session.said[index].insert(tick, last[index]);
            }
            let has_said = |index: usize| session.said[index].contains_key(&tick);
            followed = if !has_said(followed) && has_said(1 - followed) { 1 - followed } else { followed };
            session.made.push((tick, selected, followed));
        }
        session
    }

    /// The same again: both answer every tick that the device made, and are told this of it.
    fn again(&self, told: impl Fn(u64, usize) -> Replayed) -> [Said; 2] {
        let mut said = [Said::new(), Said::new()];
        for &(tick, selected, _) in &self.made {
            let state = |index: usize, of: u64| said[index].get(&of).map(accord::state_of);
            let answers = [0, 1].map(|index| {
                let last = said[index].last_key_value().map_or_else(ForceRecord::default, |(_, last)| *last);
                let (other, incarnation) = (other(&said, index, tick, true), SEATS[selected].incarnation);
                let rule = accord::origin(&ServoParams::default(), SEATS[index], &last, other.as_ref(), tick, incarnation);
                let told = accord::replayed(told(tick, index), tick, |of| state(index, of), |of| state(1 - index, of));
                answer(&ServoParams::default(), &input(tick, selected), &told.unwrap_or(rule), false)
            });
            for (said, answer) in said.iter_mut().zip(answers) {
                said.insert(tick, answer);
            }
        }
        said
    }

    /// What is told of an answer.
    fn told(&self, tick: u64, index: usize) -> Replayed {
        self.origins.get(&(tick, index)).map_or_else(Replayed::default, OriginRecord::replayed)
    }

    /// What is told of one where the recording has only how old the state was that the force went on from.
    fn told_by_age(&self, tick: u64) -> Replayed {
        let made = self.made.iter().find(|(made, ..)| *made == tick).copied();
        let lag = made.and_then(|(_, _, followed)| self.said[followed].get(&tick)).map_or(0, ForceRecord::lag);
        if lag > 1 { Replayed { from: FROM_OWN, lag: lag as u16 } } else { Replayed::default() }
    }

    /// How many answers are not done again to the bit.
    fn differences(&self, again: &[Said; 2]) -> usize {
        let pairs = self.said.iter().zip(again);
        pairs.map(|(was, is)| was.iter().filter(|(tick, was)| !accord::agree(was, &is[*tick])).count()).sum()
    }
}

/// The recording said only how old the state was that the force went on from, and both servos went on from their own of that tick.
#[test]
fn servos_that_lost_ticks_both_at_once_are_done_again_to_the_bit() {
    let mut seen: BTreeMap<u16, usize> = BTreeMap::new();
    for seed in 1..=8 {
        let session = Session::record(seed);
        assert!(session.said.iter().all(|said| said.len() as u64 > TICKS / 2), "{seed}");
        session.origins.values().for_each(|origin| *seen.entry(origin.replayed().from).or_default() += 1);
        let again = session.again(|tick, index| session.told(tick, index));
        assert_eq!(session.differences(&again), 0, "{seed}");
        let by_age = session.again(|tick, _| session.told_by_age(tick));
        assert!(session.differences(&by_age) > 0, "{seed}: nothing in it is hard");
    }
    assert!([FROM_OWN, FROM_OTHER, FROM_NOTHING].iter().all(|from| seen.get(from) > Some(&10)), "{seen:?}");
}

#[test]
fn what_is_told_and_cannot_be_had_is_taken_from_the_other_or_left_to_the_servo() {
    let state = |tick: u64, energy_j: f32| ServoState { tick, energy_j, ..ServoState::default() };
    let own = |tick: u64| (tick == 93).then(|| state(tick, 0.1));
    let others = |tick: u64| [93, 99].contains(&tick).then(|| state(tick, 0.2));
    let energy_j = |from, lag| accord::replayed(Replayed { from, lag }, 100, own, others).map(|from| from.state.energy_j);
    assert_eq!([energy_j(FROM_OWN, 7), energy_j(FROM_OTHER, 7), energy_j(FROM_OWN, 1)], [Some(0.1), Some(0.2), Some(0.2)]);
    assert_eq!([energy_j(FROM_OTHER, 1), energy_j(FROM_NOTHING, 0)], [Some(0.2), Some(0.0)]);
    assert_eq!([energy_j(0, 7), energy_j(FROM_OWN, 50), energy_j(FROM_OTHER, 101), energy_j(9, 7)], [None; 4]);
}
