//! What a stateful role goes on from when one successor after the other dies of the same state: the same state and the same input kill each of
//! them, and restarting alone would never end.
//!
//! A *doomed tenure* is one whose holder crashed or hung soon after it had taken the role. After [`MOST_DOOMED`] of them in a row the role
//! goes one rung down: the newest state, the newest state from before the trouble, an older one, and at last the tissue is held still.
//! A kill from outside dooms nobody, and a tenure that lasted wipes the count. What is held still is tried again, ever more rarely: the cause may have
//! been an input that is gone.

/// A holder that ends sooner was doomed, ns: it died in its first steps, or hung in them. One that hangs ends with its last beat, whenever it is found.
pub const DOOMED_NS: u64 = 500_000_000;
/// Doomed tenures in a row on one rung.
pub const MOST_DOOMED: u32 = 3;
/// A tenure that lasted this long ends the trouble, ns.
pub const TROUBLE_OVER_NS: u64 = 10_000_000_000;
/// How long a role is held still before the first try, ns: the force has long faded, and a person at the table has seen why. Doubled by each try
/// that fails.
pub const FIRST_HOLD_NS: u64 = 10_000_000_000;
/// Longest wait between two tries, ns: each costs two or three processes.
pub const MOST_HOLD_NS: u64 = 160_000_000_000;
/// How far before the trouble's begin each rung lies, ns.
const BACK_NS: [u64; 2] = [1_000_000_000, 10_000_000_000];

/// What the next founder of a role starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// The newest whole checkpoint.
    Newest,
    /// The newest whole checkpoint that is older than this time, ns; the first state if there is none.
    Before(u64),
    /// The same, and no step is made from it.
    Hold(u64),
    /// The same, and steps are made again from what was held.
    Again(u64),
}

/// One role's tenures.
#[derive(Clone, Copy, Debug)]
pub struct Ladder {
    holder: Option<(u32, u64)>,
    lives: bool,
    doomed: u32,
    rung: usize,
    trouble_ns: u64,
    /// The ground was changed, and nobody has looked since who holds the role.
    moved: bool,
    /// The present holder took the role before the new ground was known, so its end says nothing of it.
    early: bool,
    /// When what is held is tried again; 0 if that is not known yet.
    try_ns: u64,
    hold_ns: u64,
    /// Those whose streams the role reads were mistrusted in this trouble.
    pub(super) mistrusted: bool,
}

impl Default for Ladder {
    fn default() -> Ladder {
        let (holder, lives, doomed, rung, trouble_ns, moved, early) = (None, false, 0, 0, 0, false, false);
        Ladder { holder, lives, doomed, rung, trouble_ns, moved, early, try_ns: 0, hold_ns: FIRST_HOLD_NS, mistrusted: false }
    }
}

impl Ladder {
    /// Where it stands, as one word for the supervisor after this one: the rung, the doomed tenures on it, and the tries of what is held.
    pub fn word(&self) -> u32 {
        let tries = (self.hold_ns / FIRST_HOLD_NS).max(1).ilog2() as u8;
        u32::from_le_bytes([self.rung as u8, self.doomed as u8, tries, 0])
    }

    /// One that stands where a supervisor before this one said: its word, the time from before which founders go on, and whether the role is held
    /// still. What founders do counts for more than the word: who wrote it may have died before it did what follows from it.
    pub fn resumed(word: u32, before_ns: Option<u64>, is_held: bool, now_ns: u64) -> Ladder {
        let [rung, doomed, tries, _] = word.to_le_bytes();
        let (rungs, last_doomed) = (BACK_NS.len(), MOST_DOOMED - 1);
        let (rung, doomed) = match before_ns {
            _ if is_held => (rungs + 1, 0),
            None => (0, u32::from(doomed)),
            Some(_) if usize::from(rung) > rungs => (rungs, last_doomed), // one more death, and it is held
            Some(_) => (usize::from(rung).max(1), u32::from(doomed)),
        };
        let trouble_ns = before_ns.map_or(now_ns, |before_ns| before_ns.saturating_add(BACK_NS[rung.clamp(1, rungs) - 1]));
        let hold_ns = (FIRST_HOLD_NS << tries.min(8)).min(MOST_HOLD_NS);
        Ladder { rung, doomed: doomed.min(last_doomed), trouble_ns, hold_ns, ..Ladder::default() }
    }

    /// The incarnation that holds the role, 0 if none was seen.
    pub fn holder(&self) -> u32 {
        self.holder.map_or(0, |(incarnation, _)| incarnation)
    }

    /// How often it went back in this trouble, being held still included.
    pub fn went_back(&self) -> usize {
        self.rung
    }

    /// Whether the role is held still.
    pub fn is_held(&self) -> bool {
        self.rung > BACK_NS.len()
    }

    /// Somebody holds the role, or still holds it after the ground was changed.
    pub fn holds(&mut self, now_ns: u64, incarnation: u32) {
        if self.holder() != incarnation {
            self.holder = Some((incarnation, now_ns));
            self.lives = true;
            self.early = self.moved;
        }
        self.moved = false;
    }

    /// The holder died, of what had ended it at `ended_ns`; `by_itself`: it crashed or hung; `was_ready`: it had made a step before. Gives the new ground
    /// if the role goes a rung down.
    pub fn holder_died(&mut self, now_ns: u64, ended_ns: u64, by_itself: bool, was_ready: bool) -> Option<Ground> {
        let (_, since_ns) = self.holder?;
        self.lives = false;
        let early = std::mem::take(&mut self.early);
        if self.is_held() {
            return None;
        }
        if was_ready && ended_ns.saturating_sub(since_ns) >= DOOMED_NS {
            self.doomed = 0;
        } else if by_itself && !early {
            if self.doomed == 0 && self.rung == 0 {
                self.trouble_ns = since_ns;
            }
            self.doomed += 1;
        }
        if self.doomed < MOST_DOOMED {
            return None;
        }
        self.doomed = 0;
        self.rung += 1;
        self.moved = true;
        if !self.is_held() {
            return Some(Ground::Before(self.before_ns(self.rung)));
        }
        self.try_ns = now_ns + self.hold_ns;
        Some(Ground::Hold(self.before_ns(BACK_NS.len())))
    }

    /// Time has passed: the trouble is over, or what is held still is tried again.
    pub fn wait(&mut self, now_ns: u64) -> Option<Ground> {
        let (incarnation, since_ns) = self.holder.filter(|_| self.lives)?;
        if self.is_held() {
            if self.try_ns == 0 {
                self.try_ns = now_ns + self.hold_ns;
            }
            if now_ns < self.try_ns {
                return None;
            }
            // One more death, and it is held again.
            let (rung, doomed) = (BACK_NS.len(), MOST_DOOMED - 1);
            let hold_ns = (2 * self.hold_ns).min(MOST_HOLD_NS);
            *self = Ladder { holder: Some((incarnation, now_ns)), rung, doomed, hold_ns, ..*self };
            return Some(Ground::Again(self.before_ns(BACK_NS.len())));
        }
        if self.rung == 0 || now_ns.saturating_sub(since_ns) < TROUBLE_OVER_NS {
            return None;
        }
        *self = Ladder { holder: self.holder, lives: true, ..Ladder::default() };
        Some(Ground::Newest)
    }

    fn before_ns(&self, rung: usize) -> u64 {
        self.trouble_ns.saturating_sub(BACK_NS[rung - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    /// A holder dies of what ended it at once.
    fn died(ladder: &mut Ladder, now_ns: u64, by_itself: bool, was_ready: bool) -> Option<Ground> {
        ladder.holder_died(now_ns, now_ns, by_itself, was_ready)
    }

    /// Holders from `first` on die soon after they took the role, until it is held; gives the grounds on the way.
    fn go_down(ladder: &mut Ladder, first: u32) -> Vec<Ground> {
        let mut grounds = Vec::new();
        for incarnation in first..first + 20 {
            let now_ns = (100 + incarnation as u64) * S;
            ladder.holds(now_ns, incarnation);
            grounds.extend(died(ladder, now_ns + 1_000_000, true, true));
            ladder.holds(now_ns + 2_000_000, incarnation);
        }
        grounds
    }

    #[test]
    fn successors_that_die_of_the_same_state_go_back_twice_and_are_then_held() {
        let mut ladder = Ladder::default();
        ladder.holds(S, 1);
        assert_eq!(died(&mut ladder, 100 * S, true, true), None, "the first had lasted");
        assert_eq!(go_down(&mut ladder, 2), [Ground::Before(101 * S), Ground::Before(92 * S), Ground::Hold(92 * S)]);
        assert!(ladder.is_held());
    }

    #[test]
    fn what_is_held_is_tried_again_ever_more_rarely_until_it_lasts() {
        let mut ladder = Ladder::default();
        go_down(&mut ladder, 1);
        let mut now_ns = 200 * S;
        assert_eq!(ladder.wait(now_ns), None, "nobody holds the role");
        for (incarnation, hold_s) in [(30, 10), (31, 20), (32, 40), (33, 80), (34, 160), (35, 160)] {
            ladder.holds(now_ns, incarnation);
            let tried = (1..1_000).find(|_| {
                now_ns += S / 2;
                ladder.wait(now_ns).is_some()
            });
            assert!(incarnation == 30 || tried == Some(2 * hold_s), "{tried:?} for {hold_s} s");
            assert!(!ladder.is_held());
            if incarnation < 35 {
                assert!(matches!(died(&mut ladder, now_ns, true, true), Some(Ground::Hold(_))), "one death and it is held again");
                ladder.holds(now_ns, incarnation);
            }
        }
        assert_eq!(ladder.wait(now_ns + TROUBLE_OVER_NS), Some(Ground::Newest));
    }

    /// With a supervisor that dies before each death of a holder, the way down is the same.
    #[test]
    fn a_supervisor_that_is_restarted_goes_on_counting() {
        let (mut ladder, mut grounds, mut before_ns) = (Ladder::default(), Vec::new(), None);
        for incarnation in 2..30 {
            let now_ns = 100 * S + incarnation as u64 * S / 10;
            ladder = Ladder::resumed(ladder.word(), before_ns, ladder.is_held(), now_ns);
            ladder.holds(now_ns, incarnation);
            if let Some(ground) = died(&mut ladder, now_ns + 1_000_000, true, true) {
                grounds.push(ground);
                before_ns = match ground {
                    Ground::Before(ns) | Ground::Hold(ns) | Ground::Again(ns) => Some(ns),
                    Ground::Newest => None,
                };
            }
        }
        assert!(
            matches!(grounds[..], [Ground::Before(a), Ground::Before(b), Ground::Hold(c)] if a == b + 9 * S && b == c),
            "{grounds:?}"
        );
        assert!(ladder.is_held());
    }

    #[test]
    fn a_word_that_says_more_than_was_done_and_nonsense_are_resumed_from_what_was_done() {
        let of = |rung: u8, doomed: u8| u32::from_le_bytes([rung, doomed, 0, 0]);
        let resumed = |word, before_ns, is_held| Ladder::resumed(word, before_ns, is_held, 500 * S);
        let at = |ladder: Ladder| (ladder.rung, ladder.doomed);
        assert_eq!(at(resumed(of(1, 0), None, false)), (0, 0), "the ground was not laid");
        assert_eq!(at(resumed(of(3, 0), Some(90 * S), false)), (2, 2), "it was not held yet: one more death");
        assert_eq!(at(resumed(of(0, 2), Some(90 * S), false)), (1, 2));
        assert_eq!(at(resumed(0, Some(90 * S), true)), (3, 0));
        for word in [u32::MAX, 0x8000_0001, 0x00ff_ff00] {
            let ladder = resumed(word, Some(u64::MAX), false);
            assert!(ladder.rung <= 2 && ladder.doomed < MOST_DOOMED && ladder.hold_ns <= MOST_HOLD_NS, "{ladder:?}");
        }
        let tried = Ladder { hold_ns: 4 * FIRST_HOLD_NS, rung: 2, doomed: 2, ..Ladder::default() };
        assert_eq!(resumed(tried.word(), Some(90 * S), false).hold_ns, 4 * FIRST_HOLD_NS);
    }

    #[test]
    fn what_a_supervisor_before_this_one_held_is_tried_again_from_the_same_state() {
        let mut ladder = Ladder::resumed(0, Some(92 * S), true, 150 * S);
        ladder.holds(200 * S, 7);
        assert_eq!(ladder.wait(200 * S), None);
        assert_eq!(ladder.wait(200 * S + FIRST_HOLD_NS), Some(Ground::Again(92 * S)));
        ladder.holds(211 * S, 8);
        assert_eq!(died(&mut ladder, 211 * S + 1, true, true), Some(Ground::Hold(92 * S)));
    }

    #[test]
    fn one_that_took_the_role_before_the_new_ground_was_known_says_nothing_of_it() {
        let mut ladder = Ladder::default();
        let die = |ladder: &mut Ladder, incarnation: u32| {
            ladder.holds(50 * S, incarnation);
            died(ladder, 50 * S + 1, true, true)
        };
        assert_eq!((1..=3).find_map(|incarnation| die(&mut ladder, incarnation)), Some(Ground::Before(49 * S)));
        assert_eq!((4..=6).find_map(|incarnation| die(&mut ladder, incarnation)), None, "4 was there already");
        assert_eq!(die(&mut ladder, 7), Some(Ground::Before(40 * S)));
        ladder.holds(50 * S + 1, 7); // looked at after the ground was written: still the dead one
        assert!(matches!((8..=10).find_map(|incarnation| die(&mut ladder, incarnation)), Some(Ground::Hold(_))));
    }

    /// An ordinary process that hangs is found after seconds; what it did as the holder it had done by its last beat.
    #[test]
    fn holders_that_hang_in_their_first_steps_are_doomed_however_late_they_are_found() {
        let mut ladder = Ladder::default();
        let mut hang = |incarnation: u32, worked_ns: u64| {
            let since_ns = 20 * u64::from(incarnation) * S;
            ladder.holds(since_ns, incarnation);
            ladder.holder_died(since_ns + worked_ns + 3 * S, since_ns + worked_ns, true, true)
        };
        assert_eq!((1..=3).find_map(|incarnation| hang(incarnation, 30_000_000)), Some(Ground::Before(19 * S)));
        let mut ladder = Ladder::default();
        let mut hang = |incarnation: u32| {
            let since_ns = 20 * u64::from(incarnation) * S;
            ladder.holds(since_ns, incarnation);
            ladder.holder_died(since_ns + 4 * S, since_ns + DOOMED_NS, true, true)
        };
        assert_eq!((1..=9).find_map(&mut hang), None, "they had worked for long enough");
    }

    #[test]
    fn kills_from_outside_doom_nobody_a_founder_that_was_never_ready_is_doomed_and_a_long_tenure_ends_the_trouble() {
        let mut ladder = Ladder::default();
        for incarnation in 1..100 {
            ladder.holds(incarnation as u64 * S, incarnation);
            assert_eq!(died(&mut ladder, incarnation as u64 * S + 1, false, true), None);
        }
        for incarnation in 100..103 {
            ladder.holds(incarnation as u64 * S, incarnation);
            let ground = died(&mut ladder, incarnation as u64 * S + 2 * DOOMED_NS, true, false); // on a machine that gave it no time
            assert_eq!(ground, (incarnation == 102).then_some(Ground::Before(99 * S)));
        }
        ladder.holds(102 * S, 102);
        ladder.holds(103 * S, 103);
        assert_eq!(ladder.wait(112 * S), None);
        assert_eq!(ladder.wait(113 * S), Some(Ground::Newest));
        assert_eq!(died(&mut ladder, 113 * S, true, true), None);
        ladder.holds(114 * S, 104);
        assert_eq!(died(&mut ladder, 114 * S + 1, true, true), None, "it counts from the start again");
    }
}
