//! The Meeting Point between processes (`meeting::process`) with what its users do around it (`tissue::collision`, `collision-worker::worker`):
//! jobs, shares, seats, replacements, and a coordinator that takes over.
//!
//! Promises: whoever is counted as joined has done the release; nobody works for a release that did not name it; each share of each tick is done
//! once, by the member in the seat or by the coordinator; a member that missed is not waited for before it has caught up; no wait is endless.

mod lead;
mod member;

use crate::search::{Model, Searched, Sights, search};

const SEATS: usize = 2;
/// Two members, and the replacement of the first.
const MEMBERS: usize = 3;
const COORDINATORS: usize = 2;
/// Releases of one coordinator that are told apart.
const RELEASES: usize = 8;

/// What could be written instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    None,
    /// `seat`: the seat's member before its release is cleared, so that a newcomer takes its predecessor's release for its own.
    SeatFirst,
    /// `named_in`: the seat's member is not read again.
    ReadOnce,
    /// `say_joined`: the bell before what was joined.
    BellFirst,
    /// `say_joined`: the coordinator in a word of its own, before the release.
    TwoWords,
    /// `has_joined`: whatever coordinator the join is for.
    AnyCoordinator,
    /// `release_group`: the release word before the seats' words.
    WakeFirst,
    /// `await_release`: the release word is read after the seat's, and slept on.
    LookThenNumber,
    /// `release_group`: one that missed is asked again.
    NoExclusion,
    /// `release_group`: a wait without a deadline.
    NoDeadline,
    /// `share_of`: whatever lies in the stream is the share.
    Unchecked,
    /// `test`: shares of those that have joined are not looked at again.
    JoinedIsDone,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Lead {
    /// Not promoted.
    Idle,
    /// `receive_ports`, `hash`: the beginning of a tick.
    Arrive,
    ClearSeat(usize),
    TakeSeat(usize),
    Readmit(usize),
    SendJob,
    Begin,
    Name(usize),
    Release,
    Word(usize),
    Join(usize),
    Late(usize),
    Wait(usize),
    Collect(usize),
    End,
    Dead,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
struct Seat {
    member: u8,
    excluded: bool,
    named: u8,
    /// Has missed and not caught up since: what `excluded` should say.
    owes: bool,
}

/// A coordinator: its page, and what it knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Coordinator {
    release: u8,
    share_member: [u8; SEATS],
    share_release: [u8; SEATS],
    job: u8,
    at: Lead,
    tick: u8,
    seats: [Seat; SEATS],
    group: u8,
    asked: u8,
    joined: u8,
    done: u8,
    late: bool,
    /// The bell as it was read, to be waited on.
    word: u8,
    /// Who was named for each release: remembered for the properties.
    named: [u8; RELEASES],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Follow {
    Between,
    Number,
    Seat(usize),
    Share(usize),
    Again(usize),
    Over(usize),
    Job(usize),
    Answer(usize),
    Say,
    Ring,
    Sleep,
    Dead,
    Unborn,
}

/// A member: its page and stream, and what it knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Member {
    /// Joins so far, modulo 8.
    bell: u8,
    /// Coordinator and release.
    joined: (u8, u8),
    /// Tick, coordinator, seat.
    contacts: (u8, u8, u8),
    at: Follow,
    follows: u8,
    number: u8,
    named: u8,
    seen: u8,
    job: u8,
    slept: bool,
    /// The last release of each coordinator that it has done: remembered for the properties.
    did: [u8; COORDINATORS],
}

#[derive(Clone, Copy, Debug, Hash)]
pub struct World {
    holder: u8,
    coordinators: [Coordinator; COORDINATORS],
    members: [Member; MEMBERS],
    is_replaced: bool,
    is_returned: bool,
    deaths: u8,
    sights: Sights,
}

/// A case of the model.
#[derive(Debug)]
pub struct Meeting {
    flaw: Flaw,
    seats: usize,
    coordinators: usize,
    /// Seats of each group, released one after another.
    groups: &'static [u8],
    ticks: u8,
    deaths: u8,
    /// Deadlines, patience, replacement and takeover happen; without them everybody joins.
    faults: bool,
    /// A member is replaced.
    replaces: bool,
    /// The coordinator that lost the role takes it again, from the other one, dead or alive.
    returns: bool,
}

const EXCLUDED: u64 = 1;
const READMITTED: u64 = 2;
const SLEPT: u64 = 4;
const REFUSED: u64 = 8;
const REPLACED: u64 = 16;
const ALL_JOINED: u64 = 32;
const TAKEN_OVER: u64 = 64;
const RETURNED: u64 = 128;

type Step = Result<World, String>;

fn bit(index: usize) -> u8 {
    1 << index
}

const FRESH: Member = Member {
    bell: 0,
    joined: (0, 0),
    contacts: (0, 0, 0),
    at: Follow::Unborn,
    follows: 1,
    number: 0,
    named: 0,
    seen: 0,
    job: 0,
    slept: false,
    did: [0; COORDINATORS],
};

impl Meeting {
    /// Deaths, a replacement (of the dead, or of a living one that is taken for dead), a takeover, patience.
    fn world(&self, world: &World, out: &mut Vec<(&'static str, Step)>) {
        let next = World { sights: Sights::default(), ..*world };
        if self.replaces && !world.is_replaced {
            let mut replaced = World { is_replaced: true, sights: Sights(REPLACED), ..next };
            replaced.members[MEMBERS - 1].at = Follow::Between;
            out.push(("a replacement is born", Ok(replaced)));
        }
        if self.coordinators == 2 && world.coordinators[1].at == Lead::Idle && world.coordinators[0].at != Lead::End {
            let mut taken = World { holder: 1, sights: Sights(TAKEN_OVER), ..next };
            taken.coordinators[1].at = Lead::Arrive;
            taken.coordinators[1].tick = world.coordinators[0].tick;
            out.push(("coordinator 1 takes over", Ok(taken)));
        }
        let [first, second] = world.coordinators.map(|lead| lead.at);
        if self.returns && !world.is_returned && world.holder == 1 && first == Lead::End && second != Lead::End {
            let mut returned = World { holder: 0, is_returned: true, sights: Sights(RETURNED), ..next };
            returned.coordinators[0].at = Lead::Arrive;
            returned.coordinators[0].tick = world.coordinators[1].tick;
            out.push(("coordinator 0 takes the role again", Ok(returned)));
        }
        if world.deaths >= self.deaths {
            return;
        }
        for member in (0..MEMBERS).filter(|at| !matches!(world.members[*at].at, Follow::Dead | Follow::Unborn)) {
            let mut dead = World { deaths: world.deaths + 1, ..next };
            // Its page and stream stay; what it knew is gone.
            let Member { bell, joined, contacts, did, .. } = world.members[member];
            dead.members[member] = Member { bell, joined, contacts, did, at: Follow::Dead, ..FRESH };
            out.push((["member 0 dies", "member 1 dies", "member 2 dies"][member], Ok(dead)));
        }
        // A coordinator's death ends the releases, and shows something only if another takes over.
        for lead in 0..self.coordinators {
            let another_comes = if lead == 0 { self.coordinators == 2 } else { self.returns && !world.is_returned };
            if another_comes && !matches!(world.coordinators[lead].at, Lead::Idle | Lead::Dead | Lead::End) {
                let mut dead = World { deaths: world.deaths + 1, ..next };
                dead.coordinators[lead].at = Lead::Dead;
                out.push((["coordinator 0 dies", "coordinator 1 dies"][lead], Ok(dead)));
            }
        }
    }
}

impl Model for Meeting {
    type State = World;

    fn first(&self) -> World {
        let idle = Coordinator {
            release: 0,
            share_member: [0; SEATS],
            share_release: [0; SEATS],
            job: 0,
            at: Lead::Idle,
            tick: 1,
            seats: [Seat::default(); SEATS],
            group: 0,
            asked: 0,
            joined: 0,
            done: 0,
            late: false,
            word: 0,
            named: [0; RELEASES],
        };
        let mut members = [FRESH; MEMBERS];
        members[..self.seats].iter_mut().for_each(|member| member.at = Follow::Between);
        let coordinators = [Coordinator { at: Lead::Arrive, ..idle }, idle];
        World { holder: 0, coordinators, members, is_replaced: false, is_returned: false, deaths: 0, sights: Sights::default() }
    }

    fn steps(&self, state: &World, out: &mut Vec<(&'static str, Step)>) {
        for (me, name) in LEADS.iter().enumerate() {
            out.extend(self.lead(state, me).into_iter().map(|next| (*name, next)));
        }
        for (me, name) in ["member 0", "member 1", "member 2"].iter().enumerate() {
            out.extend(self.member(state, me).into_iter().map(|next| (*name, next)));
        }
        self.world(state, out);
    }

    /// With a deadline, a coordinator that lives can always go on by itself.
    fn holds(&self, state: &World, steps: &[&'static str]) -> Result<(), String> {
        let waits = |at: Lead| !matches!(at, Lead::Idle | Lead::End | Lead::Dead);
        let stuck = (0..COORDINATORS).find(|me| waits(state.coordinators[*me].at) && !steps.contains(&LEADS[*me]));
        match stuck.filter(|_| self.faults) {
            Some(me) => Err(format!("coordinator {me} can do nothing but wait for others")),
            None => Ok(()),
        }
    }

    fn is_end(&self, state: &World) -> bool {
        let [first, second] = state.coordinators.map(|lead| lead.at);
        let is_over = matches!(second, Lead::End | Lead::Dead) || second == Lead::Idle && first == Lead::End;
        matches!(first, Lead::End | Lead::Dead) && is_over
    }

    fn sights(&self, state: &World) -> u64 {
        state.sights.0
    }
}

const LEADS: [&str; COORDINATORS] = ["coordinator 0", "coordinator 1"];
const BOTH: &[u8] = &[0b11];
const ONE_BY_ONE: &[u8] = &[0b01, 0b10];
const ONE: &[u8] = &[0b01];

/// Nothing happens to anybody; one seat or two, in one group or two.
const fn calm(flaw: Flaw, seats: usize, groups: &'static [u8]) -> Meeting {
    Meeting { flaw, seats, coordinators: 1, groups, ticks: 3, deaths: 0, faults: false, replaces: false, returns: false }
}

/// One coordinator; deaths, deadlines, and a replacement in the first seat.
const fn crew(flaw: Flaw, seats: usize, groups: &'static [u8], ticks: u8, deaths: u8) -> Meeting {
    Meeting { flaw, seats, coordinators: 1, groups, ticks, deaths, faults: true, replaces: true, returns: false }
}

/// One seat, and a coordinator that takes over from a dead or living one.
const fn takeover(flaw: Flaw, ticks: u8, deaths: u8) -> Meeting {
    Meeting { flaw, seats: 1, coordinators: 2, groups: ONE, ticks, deaths, faults: true, replaces: true, returns: false }
}

/// The same, and the first one takes the role again; the member stays.
const fn there_and_back(flaw: Flaw, ticks: u8, deaths: u8) -> Meeting {
    Meeting { replaces: false, returns: true, ..takeover(flaw, ticks, deaths) }
}

/// Both seats, whose members stay, and a coordinator that takes over.
const fn takeover_of_two(flaw: Flaw, groups: &'static [u8], deaths: u8) -> Meeting {
    Meeting { seats: 2, groups, replaces: false, ..takeover(flaw, 1, deaths) }
}

/// Searches a case, and tells how large it was.
fn searched(case: &Meeting) -> Searched {
    let found = search(case).unwrap_or_else(|broken| panic!("{broken}"));
    println!("{case:?}: {found:?}");
    assert!(found.states > 100 && found.ends > 0);
    found
}

#[test]
fn no_share_is_lost_and_no_wait_is_endless() {
    const F: Flaw = Flaw::None;
    for case in [calm(F, 1, ONE), calm(F, 2, BOTH), calm(F, 2, ONE_BY_ONE)] {
        assert_eq!(searched(&case).sights, ALL_JOINED, "something happened to somebody");
    }
    let mut sights = 0;
    for case in [
        crew(F, 1, ONE, 3, 2),
        crew(F, 2, BOTH, 1, 1),
        crew(F, 2, BOTH, 2, 1),
        crew(F, 2, ONE_BY_ONE, 1, 1),
        takeover(F, 1, 1),
        there_and_back(F, 2, 1),
        takeover_of_two(F, ONE_BY_ONE, 1),
    ] {
        sights |= searched(&case).sights;
    }
    let all = EXCLUDED | READMITTED | SLEPT | REFUSED | REPLACED | ALL_JOINED | TAKEN_OVER | RETURNED;
    assert_eq!(sights, all, "not all was searched that should be");
}

#[test]
fn every_flaw_is_found() {
    let by_crew = |flaw| crew(flaw, 1, ONE, 3, 1);
    let cases = [
        (by_crew(Flaw::SeatFirst), "did not name it"),
        (by_crew(Flaw::ReadOnce), "did not name it"),
        (calm(Flaw::BellFirst, 1, ONE), "no way leads to an end"),
        (there_and_back(Flaw::TwoWords, 2, 0), "has not done the release"),
        (takeover(Flaw::AnyCoordinator, 2, 0), "has not done the release"),
        (calm(Flaw::WakeFirst, 1, ONE), "no way leads to an end"),
        (calm(Flaw::LookThenNumber, 1, ONE), "no way leads to an end"),
        (by_crew(Flaw::NoExclusion), "before its member has caught up"),
        (by_crew(Flaw::NoDeadline), "can do nothing but wait"),
        (takeover(Flaw::Unchecked, 2, 0), "gives the share"),
        (takeover(Flaw::JoinedIsDone, 2, 0), "is lost"),
    ];
    for (case, expected) in cases {
        let broken = search(&case).expect_err("the search found nothing");
        assert!(broken.contains(expected), "{case:?}: {broken}");
    }
}
