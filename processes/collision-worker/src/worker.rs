//! A Synchronized Process: its author writes one function, the test of a share. It reads the tissue's state and the hash in place, and
//! writes its hits in place.
//!
//! Promise: a release is always answered; what cannot be computed (the state has not come, say) is answered with nothing, what has more hits than there is
//! room for as that, and the coordinator computes it. Who sends a job or a topology that cannot be is named, and nothing is made of it: hits that are wrong for it
//! would be laid to whoever found them.

use hyst_contact::{
    Cull, Found, HITS_OF_A_POINT, HashRef, Hit, MOST_HITS_OF_SHARE, OwnContact, Points, Share, Split, Tissue, intersect,
    room_of_share,
};
use hyst_engine::lane::Follower;
use hyst_engine::{Failure, Helper, Helpers, Lies, Life, realtime};
use hyst_exchange::meeting::{ProcessMember, Release};
use hyst_exchange::roster::Roster;
use hyst_exchange::synchronized::synchronized_process;
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Held, Links, Publisher, ReadPage, Subscriber, allocation, system};
use hyst_messages::mischief::Outlet;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{ProcessState, header};
use hyst_messages::stream::message_bytes;
use hyst_messages::{Kind, Message, MessageMut, Role, StreamHeader, TICK_NS, TOO_MANY_HITS, job_hash, topology_is_sound};
use std::sync::Arc;

/// Room for so many nodes of tissue from the start; with more it grows once.
const USUAL_NODES: usize = 32_768;
/// And so many tets.
const USUAL_TETS: usize = 131_072;
/// How long the worker waits for a release before it looks for a new coordinator, ns.
const PATIENCE_NS: u64 = 2 * TICK_NS;
/// Tissues whose streams are read.
const TISSUES: usize = 3;

#[derive(Default)]
struct Source {
    /// Its page, unless the member follows it: then the member has it.
    page: Option<ReadPage>,
    states: Option<Subscriber>,
    jobs: Option<Subscriber>,
    state: Option<Held>,
    topologies: Option<Subscriber>,
    /// Its newest topology: that of a state comes from whoever made it, or made one of it.
    topology: Option<Held>,
}

struct Worker<'a> {
    life: &'a Life,
    publisher: Publisher,
    inbox: Inbox,
    roster: Roster,
    sources: [Source; TISSUES],
    /// The source whose page the member has.
    followed: Option<usize>,
    cull: Cull,
    hits: Vec<Hit>,
    tells: fn(usize) -> usize,
    lies: Lies,
}

/// Why nothing comes of a share.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Nothing {
    /// Something of what it is made of is not there.
    Absent,
    /// What this tissue has sent for it cannot be.
    Invalid(u32),
    /// There are more hits than there is room for, here or at the coordinator's.
    TooMany,
}

/// The whole life of a worker.
pub fn run(life: &Life) -> Result<(), Failure> {
    run_telling(life, |found| found)
}

/// The same of one that tells only so many of the hits that it has found: for whoever tries what becomes of a worker that leaves some out.
pub fn run_telling(life: &Life, tells: fn(usize) -> usize) -> Result<(), Failure> {
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let bytes = message_bytes(&[MOST_HITS_OF_SHARE * size_of::<Hit>(), size_of::<u64>()]);
    let publisher = links.publisher(Role::CollisionWorker, life.incarnation, Kind::Contacts, bytes)?;
    let interests =
        [Wanted::Page, Wanted::Stream(Kind::TissueState), Wanted::Stream(Kind::CollisionJob), Wanted::Stream(Kind::Topology)];
    let interests = interests.map(|wanted| (Role::Tissue, wanted)).to_vec();
    let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
    let mut helpers = Helpers::of([Helper::usher(inbox.rounds())]);
    let roster = Roster::open(&life.station)?;
    let mut worker = Worker {
        life,
        publisher,
        inbox,
        roster,
        sources: Default::default(),
        followed: None,
        cull: Cull::remembering(USUAL_NODES, USUAL_TETS, USUAL_NODES),
        hits: vec![Hit::default(); room_of_share(MOST_HITS_OF_SHARE)],
        tells,
        lies: Lies::new(life, bytes),
    };
    let mut member = ProcessMember::new(Arc::clone(&life.page));
    life.ports_are_open();
    // One that is said to be ready and cannot answer yet would be missed at every release.
    while !worker.can_answer(&member) && !life.clock.stop_requested() {
        worker.receive(&mut member);
        life.heartbeat();
        system::sleep_ns(TICK_NS);
    }
    realtime::go(life)?;
    life.page.set_state(ProcessState::Live);
    let allocations = allocation::of_this_thread();
    let worker = std::cell::RefCell::new(worker);
    let mut lane = Follower::default();
    // With no other core than the lane and one beside it, a share is done sooner in the tissue's place than it is brought to the other.
    let belongs = life.is_lockstep() && system::cores() == 2;
    let between = |member: &mut ProcessMember| {
        helpers.look(life);
        worker.borrow_mut().receive(member);
        lane.follow(life, belongs);
        life.heartbeat();
        !life.clock.stop_requested()
    };
    let step = |release: Release| {
        life.misbehave();
        let woken_ns = system::now_ns();
        // What cannot be computed is computed by the coordinator; the release is answered all the same.
        match worker.borrow_mut().share(release) {
            Ok(()) | Err(Nothing::TooMany) => {}
            Err(Nothing::Absent) => life.page.add64(header::INVALID, 1),
            Err(Nothing::Invalid(tissue)) => life.refuse(tissue, Distrust::Invalid),
        }
        life.drag(woken_ns);
        let page = &life.page;
        page.count_latency(header::LOOP, system::now_ns() - woken_ns);
        page.store64(header::VALUE_NS, system::now_ns());
        page.store64(header::TICK, life.clock.present_tick());
        page.add64(header::STEPS, 1);
        page.store64(header::ALLOCATIONS, allocation::of_this_thread() - allocations);
        page.store64(header::POOL_BLOCKS, allocation::blocks_of_this_thread());
    };
    synchronized_process(&mut member, PATIENCE_NS, between, step);
    Ok(())
}

/// Lets the member follow the holder of the tissue's role. The page of the one before stays with its source, since a role may come back to it;
/// it is given back only if a successor has the place.
fn follow(sources: &mut [Source], followed: &mut Option<usize>, member: &mut ProcessMember, holder: u32) -> Option<ReadPage> {
    if holder == member.follows() {
        return None;
    }
    let of_holder = |source: &Source| source.page.as_ref().is_some_and(|page| page.incarnation() == holder);
    let at = sources.iter().position(of_holder)?;
    let before = member.follow(sources[at].page.take()?);
    let place = followed.replace(at).filter(|place| sources[*place].page.is_none() && *place != at);
    match place {
        Some(place) => {
            sources[place].page = before;
            None
        }
        None => before,
    }
}

/// A job as it is read in place.
struct Job<'a> {
    header: StreamHeader,
    points_m: &'a [[f32; 3]],
    hash: HashRef<'a>,
    owner: &'a [u32],
    node: &'a [u32],
    /// From which point on they meet their own object alone, and from which distance on, m, as bits.
    own: [u32; 2],
}

/// The job in a message; `None` if it is none that can be: its table is of its points, each of which has an owner and a node.
fn job_of(bytes: &[u8]) -> Option<Job<'_>> {
    let message = Message::parse(bytes, Kind::CollisionJob).ok()?;
    let points_m: &[[f32; 3]] = message.section(0).ok()?;
    let hash = HashRef::in_words(message.section(1).ok()?).ok()?;
    let (owner, node): (&[u32], &[u32]) = (message.section(2).ok()?, message.section(3).ok()?);
    let &[only_from, beyond] = message.section::<u32>(4).ok()? else { return None };
    let is_whole = hash.is_of(points_m) && owner.len() == points_m.len() && node.len() == points_m.len();
    is_whole.then_some(Job { header: *message.header(), points_m, hash, owner, node, own: [only_from, beyond] })
}

/// How many hits are told of those that were found of so many points: all, or none where not all were kept, or an answer or the coordinator has no room for
/// them.
fn told(found: Found, points: usize) -> Result<usize, Nothing> {
    let is_all = found.dropped == 0 && found.count <= MOST_HITS_OF_SHARE.min(HITS_OF_A_POINT * points);
    if is_all { Ok(found.count) } else { Err(Nothing::TooMany) }
}

impl Worker<'_> {
    /// Whether it follows the holder of the tissue's role, and has all that a release of his is answered from.
    fn can_answer(&self, member: &ProcessMember) -> bool {
        let holder = self.roster.holder(Role::Tissue).incarnation;
        let has_all = |source: &Source| source.states.is_some() && source.jobs.is_some() && source.topology.is_some();
        holder != 0 && member.follows() == holder && self.followed.is_some_and(|at| has_all(&self.sources[at]))
    }

    fn receive(&mut self, member: &mut ProcessMember) {
        while let Some(arrival) = self.inbox.take() {
            self.arrival(arrival);
        }
        for source in &mut self.sources {
            // Whose it was may be dead, and the last message of a stream is unmapped with it: not on this thread.
            let newest = source.topologies.as_ref().and_then(|stream| Some((stream.incarnation(), stream.newest().ok()??)));
            let Some((tissue, held)) = newest else { continue };
            let before = if topology_is_sound(held.bytes()) {
                source.topology.replace(held)
            } else {
                self.life.refuse(tissue, Distrust::Invalid);
                Some(held)
            };
            if let Some(before) = before {
                self.inbox.retire(Departure::Message(before));
            }
        }
        let holder = self.roster.holder(Role::Tissue).incarnation;
        if let Some(before) = follow(&mut self.sources, &mut self.followed, member, holder) {
            self.inbox.retire(Departure::Page(before));
        }
    }

    fn arrival(&mut self, arrival: Arrival) {
        let Some(source) = self.sources.get_mut(arrival.slot.index()) else { return };
        if matches!(arrival.port, Port::Stream(Kind::TissueState, _))
            && let Some(state) = source.state.take()
        {
            self.inbox.retire(Departure::Message(state)); // or the first state of the new stream would drop it, in a step
        }
        let before = match arrival.port {
            Port::Page(page) => source.page.replace(page).map(Departure::Page),
            Port::Stream(Kind::TissueState, stream) => source.states.replace(stream).map(Departure::Stream),
            Port::Stream(Kind::CollisionJob, stream) => source.jobs.replace(stream).map(Departure::Stream),
            Port::Stream(Kind::Topology, stream) => source.topologies.replace(stream).map(Departure::Stream),
            _ => None,
        };
        if let Some(before) = before {
            self.inbox.retire(before);
        }
    }

    /// The share of a release: the job of the coordinator that released, and the state that the job is about.
    fn share(&mut self, release: Release) -> Result<(), Nothing> {
        for source in &mut self.sources {
            if let Some(held) = source.states.as_ref().and_then(|stream| stream.newest().ok()?) {
                source.state = Some(held);
            }
        }
        let of_coordinator =
            |source: &&Source| source.jobs.as_ref().is_some_and(|jobs| jobs.incarnation() == release.coordinator);
        let jobs = self.sources.iter().find(of_coordinator).and_then(|source| source.jobs.as_ref());
        let held = jobs.and_then(|jobs| jobs.newest().ok()?).ok_or(Nothing::Absent)?;
        let job = job_of(held.bytes()).ok_or(Nothing::Invalid(release.coordinator))?;
        let (header, about) = (job.header, job_hash(bytemuck::cast_slice(job.points_m)));
        let share = Share { index: release.index as u32, count: header.words[0], split: Split::Tets };
        match self.found(&job, share.index).ok_or(Nothing::Absent).and_then(|found| told(found, job.points_m.len())) {
            Ok(count) => self.answer(header, share, (self.tells)(count).min(count), about).ok_or(Nothing::Absent),
            Err(why) => {
                // Of none of its shares: so that the coordinator does not take it for an answer to another job.
                let count = if why == Nothing::TooMany { TOO_MANY_HITS } else { 0 };
                self.answer(header, Share { count, ..share }, 0, about).ok_or(Nothing::Absent)?;
                Err(why)
            }
        }
    }

    /// What is found in a share of a job, in the state that it is about.
    fn found(&mut self, job: &Job<'_>, index: u32) -> Option<Found> {
        let about = |held: &&Held| {
            Message::parse(held.bytes(), Kind::TissueState).is_ok_and(|state| {
                let (state, job) = (state.header(), &job.header);
                (state.tick, state.epoch as u64, state.incarnation) == (job.tick, job.input_tick, job.words[1])
            })
        };
        let state = self.sources.iter().filter_map(|source| source.state.as_ref()).find(about)?;
        let state = Message::parse(state.bytes(), Kind::TissueState).ok()?;
        let version = state.header().topology_version;
        let mut topologies = self.sources.iter().filter_map(|source| source.topology.as_ref());
        let topology = topologies.find_map(|held| Message::topology(held.bytes(), version))?;
        let share = Share { index, count: job.header.words[0], split: Split::Tets };
        let tissue =
            Tissue { positions_m: state.section(1).ok()?, tets: topology.section(1).ok()?, tet_owner: topology.section(2).ok()? };
        let [only_from, beyond] = job.own;
        let own = OwnContact { rest_m: topology.section(7).ok()?, beyond_m: f32::from_bits(beyond), only_from };
        let points = Points { owner: job.owner, node: job.node, own: Some(own) };
        intersect(share, &job.hash, &points, &tissue, self.cull.of(version), &mut self.hits).ok()
    }

    /// The hits, and which points they are of: hits that stand still while the tool moves are not taken for new ones.
    fn answer(&mut self, job: StreamHeader, share: Share, count: usize, job_hash: u64) -> Option<()> {
        let sections = [count * size_of::<Hit>(), size_of::<u64>()];
        let bytes = message_bytes(&sections);
        if self.life.loses_a_loan() {
            self.publisher.lose(bytes);
        }
        // Without a block to write into there will never be an answer again: a successor has all of them.
        let mut loan = self.publisher.loan(bytes).unwrap_or_else(|error| panic!("{error}"));
        let header = StreamHeader {
            tick: job.tick,
            epoch: job.epoch,
            incarnation: self.life.incarnation,
            words: [share.index, share.count],
            ..Default::default()
        };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Contacts, header, &sections).ok()?;
        message.section::<Hit>(0).ok()?.copy_from_slice(&self.hits[..count]);
        message.section::<u64>(1).ok()?.fill(job_hash);
        self.lies.tell_message(self.life, Outlet::State, loan.bytes_mut());
        loan.send().ok()?;
        self.life.page.add64(header::STREAM_BYTES, bytes as u64);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_contact::{HashMut, HashSizes, Layout};
    use hyst_exchange::Station;
    use hyst_messages::Slot;

    /// What such a job is answered with is not what its coordinator finds, and the worker would be replaced for it.
    #[test]
    fn a_job_whose_table_is_of_other_points_or_in_which_one_has_no_owner_is_none() {
        let points_m = [[0.0f32, 0.0, 0.01], [0.0, 0.001, 0.01], [0.002, 0.0, 0.012]];
        let sizes = HashSizes::for_points(points_m.len());
        let is_taken = |owners: usize, change: fn(&mut MessageMut<'_>)| {
            let sections = [36, 4 * sizes.words(), 4 * owners, 12, 8];
            let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            let mut message = MessageMut::format(bytes, Kind::CollisionJob, StreamHeader::default(), &sections).unwrap();
            message.section::<[f32; 3]>(0).unwrap().copy_from_slice(&points_m);
            let mut table = HashMut::in_words(message.section::<u32>(1).unwrap(), sizes).unwrap();
            table.build(&points_m, 0.002, Layout::Auto).unwrap();
            change(&mut message);
            job_of(bytemuck::cast_slice(&memory)).is_some()
        };
        assert!(is_taken(3, |_| ()), "a good one");
        assert!(!is_taken(2, |_| ()), "a point of nobody");
        assert!(!is_taken(3, |it| it.section::<f32>(0).unwrap()[4] = f32::NAN));
        assert!(!is_taken(3, |it| it.section::<f32>(0).unwrap()[8] = 0.5));
        assert!(!is_taken(3, |it| it.section::<u32>(1).unwrap()[0] = f32::NAN.to_bits()), "no table");
    }

    /// It was answered as if what the job is about had not come, for which a worker is replaced after half a second, and so is its successor.
    #[test]
    fn a_share_with_more_hits_than_there_is_room_for_is_told_as_that() {
        let told = |count, dropped| told(Found { count, dropped }, 100);
        assert_eq!([told(0, 0), told(200, 0)], [Ok(0), Ok(200)]);
        assert_eq!([told(201, 0), told(MOST_HITS_OF_SHARE, 1), told(10, 1)], [Err(Nothing::TooMany); 3]);
        let of_many = |count| super::told(Found { count, dropped: 0 }, MOST_HITS_OF_SHARE);
        let [most, more] = [MOST_HITS_OF_SHARE, MOST_HITS_OF_SHARE + 1].map(of_many);
        assert_eq!((most, more), (Ok(MOST_HITS_OF_SHARE), Err(Nothing::TooMany)));
    }

    #[test]
    fn the_records_of_a_share_are_those_that_the_documents_say() {
        assert_eq!(hyst_messages::contents::record_bytes(Kind::Contacts), [size_of::<Hit>(), size_of::<u64>()]);
    }

    #[test]
    fn a_role_that_comes_back_to_the_holder_before_is_followed_again() {
        let station = Station::named(&format!("t{}-follow", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = |role, index| Slot::new(role, index).unwrap();
        let page = |index: usize, incarnation: u32| {
            station.create_slot(slot(Role::Tissue, index), incarnation).unwrap();
            Some(station.read_slot(slot(Role::Tissue, index), incarnation).unwrap())
        };
        let own = station.create_slot(slot(Role::CollisionWorker, 0), 9).unwrap();
        let mut member = ProcessMember::new(Arc::new(own));
        let mut sources: [Source; TISSUES] = Default::default();
        let mut followed = None;
        (sources[0].page, sources[1].page) = (page(0, 1), page(1, 2));
        for holder in [1, 2, 1, 1, 2, 1] {
            assert!(follow(&mut sources, &mut followed, &mut member, holder).is_none());
            assert_eq!(member.follows(), holder);
        }
        // A successor in the slot of the one that is followed: the page of the dead is given back.
        sources[0].page = page(0, 3);
        assert!(follow(&mut sources, &mut followed, &mut member, 2).is_some_and(|before| before.incarnation() == 1));
        assert!(follow(&mut sources, &mut followed, &mut member, 3).is_none());
        // One that nobody knows yet is not followed, and nothing is lost.
        assert!(follow(&mut sources, &mut followed, &mut member, 4).is_none());
        assert_eq!(member.follows(), 3);
        station.wipe();
    }
}
