//! The intersection test, shared among the collision workers through the Meeting Point: the hash is built once, in place in shared memory,
//! and read in place; a share that is missing is computed here in the same step.

use crate::answers::{Refused, Row, share_of};
use crate::asking::Asking;
use crate::contacts;
use crate::points::ContactPoints;
use crate::world::World;
use hyst_contact::{
    Cull, Found, HashMut, HashRef, HashSizes, Hit, Layout, MOST_HITS_OF_SHARE, Points, Share, Split, Tissue, are_true,
    has_all_of, intersect, merge, room_of_share,
};
use hyst_engine::{Failure, Lies, Life, StepContext, lockstep};
use hyst_exchange::meeting::{Coordinator, Group, Outcome, ProcessCoordinator, members};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port};
use hyst_exchange::{Links, Loan, Publisher, ReadPage, Subscriber, system};
use hyst_messages::mischief::Outlet;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::header;
use hyst_messages::stream::message_bytes;
use hyst_messages::{Kind, MAX_WORKERS, MessageMut, Role, StreamHeader, job_hash};
use std::sync::Arc;

/// What a step waits for its workers at most, ns: several times what a share takes, a third of a tick.
const PATIENCE_NS: u64 = 300_000;

/// Parts of a share, of which one of one worker is computed here too in each step: whoever leaves hits out is found, where something was hit in the step
/// before at once, elsewhere within so many steps for each worker.
const PARTS: u32 = 16;

/// The coordinator's side.
pub struct Collision {
    workers: usize,
    asking: Asking,
    coordinator: ProcessCoordinator,
    jobs: Option<Publisher>,
    lies: Lies,
    contacts: [Option<Subscriber>; MAX_WORKERS],
    sizes: HashSizes,
    own_hash: Vec<u32>,
    shares: Vec<Vec<Hit>>,
    counts: Vec<usize>,
    hits: Vec<Hit>,
    /// Answers of each worker in a row that were not taken.
    rows: [Row; MAX_WORKERS],
    found: usize,
    /// Parts that were computed beside their worker so far, and the hits of the last one.
    parts: u32,
    part: Vec<Hit>,
    /// What is remembered of each share from step to step; of the parts, each of which is another one, nothing.
    culls: Vec<Cull>,
    cull_of_part: Cull,
    missing: u32,
    dropped: u32,
    copied_bytes: u64,
}

/// A job that has been written and not yet been tested.
pub struct Job {
    loan: Option<Loan>,
    begun_ns: u64,
}

#[cfg(test)]
impl Job {
    /// What the workers will read.
    pub fn bytes(&self) -> Option<&[u8]> {
        self.loan.as_ref().map(Loan::bytes)
    }
}

#[cfg(test)]
impl Collision {
    /// Leaves room for so many hits.
    pub fn cramp(&mut self, hits: usize) {
        self.hits.truncate(hits);
    }

    /// Fills every block that the next job can be lent, and makes sure of it.
    pub fn fill_loans(&self, points: usize, fill: impl Fn(&mut [u8])) {
        let jobs = self.jobs.as_ref().expect("the stream of the jobs is open");
        let bytes = message_bytes(&sections(points, self.sizes));
        let lend = || jobs.loan(bytes).expect("a loan");
        let mut filled = [lend(), lend()];
        filled.iter_mut().for_each(|loan| fill(loan.bytes_mut()));
        let want = filled[0].bytes().to_vec();
        drop(filled);
        assert!(lend().bytes() == want, "the next loan is not one of those that were filled");
    }
}

impl Collision {
    /// For the workers of the station.
    pub fn new(life: &Life, world: &World) -> Result<Collision, Failure> {
        let workers = life.settings.workers.min(MAX_WORKERS);
        let room = &world.case.room;
        let cull = || Cull::remembering(room.nodes, room.tets, world.points.tool + room.nodes);
        let mut collision = Collision {
            workers,
            asking: Asking::new(life)?,
            coordinator: ProcessCoordinator::new(Arc::clone(&life.page)),
            jobs: None,
            lies: Lies::new(life, 0),
            contacts: Default::default(),
            sizes: HashSizes::for_points(0),
            own_hash: Vec::new(),
            shares: vec![Vec::new(); workers.max(1)],
            counts: vec![0; workers.max(1)],
            hits: Vec::new(),
            rows: Default::default(),
            found: 0,
            parts: 0,
            part: Vec::new(),
            culls: (0..workers.max(1)).map(|_| cull()).collect(),
            cull_of_part: Cull::for_nodes(room.nodes),
            missing: 0,
            dropped: 0,
            copied_bytes: 0,
        };
        collision.take_world(world);
        Ok(collision)
    }

    /// Makes room for the points of another world.
    pub fn take_world(&mut self, world: &World) {
        let room = contacts::max_hits(world);
        self.sizes = world.points.table_sizes();
        self.own_hash.resize(self.sizes.words(), 0);
        self.shares.iter_mut().for_each(|share| share.resize(room_of_share(room), Hit::default()));
        self.counts.fill(0);
        self.hits.resize(room, Hit::default());
        self.part.resize(room, Hit::default());
        self.found = 0;
    }

    /// Opens the stream of the jobs, with room for those of every world that cuts may make of this one.
    pub fn open(&mut self, life: &Life, links: &Links, world: &World) -> Result<(), Failure> {
        if self.workers > 0 {
            let points = world.points.tool + world.case.room.nodes;
            let bytes = message_bytes(&sections(points, HashSizes::for_points(points)));
            self.jobs = Some(links.publisher(Role::Tissue, life.incarnation, Kind::CollisionJob, bytes)?);
            self.lies = Lies::new(life, bytes);
        }
        Ok(())
    }

    /// Takes a worker's page or stream.
    pub fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let index = arrival.slot.index();
        match arrival.port {
            Port::Page(page) if index < self.workers => {
                self.asking.welcome();
                if let Some(before) = self.coordinator.seat(index, page) {
                    inbox.retire(Departure::Page(before));
                }
            }
            Port::Stream(Kind::Contacts, stream) if index < self.workers => {
                if let Some(before) = self.contacts[index].replace(stream) {
                    inbox.retire(Departure::Stream(before));
                }
            }
            _ => {}
        }
    }

    /// Shares that the coordinator had to compute because a worker was missing, so far.
    pub fn missing(&self) -> u32 {
        self.missing
    }

    /// Hits that found no room in a share or in the whole, so far: more than two for each point, which only tissue that lies in itself all over has.
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Bytes copied in the last step beyond the one write into the loan.
    pub fn copied_bytes(&self) -> u64 {
        self.copied_bytes
    }

    /// Builds the hash of the points: in a job in shared memory if there are workers and this step is theirs, else in own memory.
    pub fn hash(
        &mut self,
        context: &StepContext,
        points_m: &[[f32; 3]],
        points: &ContactPoints,
        cell_m: f32,
    ) -> Result<Job, Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let (begun_ns, sections) = (system::now_ns(), sections(points_m.len(), self.sizes));
        self.coordinator.readmit();
        let is_shared = context.holding && self.asking.asks() && self.coordinator.present() != 0;
        let jobs = self.jobs.as_ref().filter(|_| is_shared);
        let Some(jobs) = jobs else {
            self.copied_bytes = 0;
            let mut hash = HashMut::in_words(&mut self.own_hash, self.sizes).map_err(broken)?;
            hash.build(points_m, cell_m, Layout::Auto).map_err(broken)?;
            return Ok(Job { loan: None, begun_ns });
        };
        let mut loan = jobs.loan(message_bytes(&sections))?;
        let header = StreamHeader {
            tick: context.tick,
            epoch: context.tenure.epoch,
            incarnation: context.tenure.incarnation,
            words: [self.workers as u32, context.state_writer],
            input_tick: context.state_epoch as u64,
            ..Default::default()
        };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::CollisionJob, header, &sections)?;
        message.section::<[f32; 3]>(0)?.copy_from_slice(points_m);
        message.section::<u32>(2)?.copy_from_slice(&points.owner);
        message.section::<u32>(3)?.copy_from_slice(&points.node);
        message.section::<u32>(4)?.copy_from_slice(&[points.own_from as u32, points.own_beyond_m.to_bits()]);
        let mut hash = HashMut::in_words(message.section::<u32>(1)?, self.sizes).map_err(broken)?;
        hash.build(points_m, cell_m, Layout::Auto).map_err(broken)?;
        // The coordinator keeps a copy of the table: it needs it after the job was sent, for missing shares and for the gaps.
        self.own_hash.copy_from_slice(message.section::<u32>(1)?);
        self.copied_bytes = 4 * self.own_hash.len() as u64;
        Ok(Job { loan: Some(loan), begun_ns })
    }

    /// The table of this step.
    pub fn table(&self) -> Result<HashRef<'_>, Failure> {
        HashRef::in_own_words(&self.own_hash).map_err(|error| Failure::Broken(error.to_string()))
    }

    /// Runs the test; the hits are the same whoever computed them. What a worker says is checked: it is true to the last bit and leaves out nothing that is
    /// known here, or it is computed here, and the worker is distrusted.
    pub fn test(
        &mut self,
        life: &Life,
        context: &StepContext,
        job: Job,
        points_m: &[[f32; 3]],
        world: &World,
        positions_m: &[[f32; 3]],
    ) -> Result<(), Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let (tissue, points) = (contacts::tissue(world, positions_m), &world.points.view(&world.body.rest.positions_m));
        let (hash, count) = (HashRef::in_own_words(&self.own_hash).map_err(broken)?, self.shares.len());
        let (mut done, mut said_full, was_shared, begun_ns) = (0u32, 0u32, job.loan.is_some(), job.begun_ns);
        if let Some(mut loan) = job.loan {
            self.lies.tell_message(life, Outlet::Job, loan.bytes_mut());
            loan.send()?;
            let group = (1u32 << self.workers) - 1;
            let resting = self.coordinator.resting();
            let outcome = release(&mut self.coordinator, life, group);
            let job_hash = job_hash(bytemuck::cast_slice(points_m));
            let (looked_at, number) = next_part(&mut self.parts, count);
            for index in members(outcome.joined) {
                let worker = self.coordinator.incarnation_at(index);
                let Some(held) = self.contacts[index].as_ref().and_then(|stream| stream.newest().ok()?) else { continue };
                let share = Share { index: index as u32, count: count as u32, split: Split::Tets };
                let part = if index == looked_at {
                    let part = share.part(number, PARTS);
                    intersect(part, &hash, points, &tissue, &mut self.cull_of_part, &mut self.part).map_err(broken)?.count
                } else {
                    0
                };
                let known = [&self.part[..part], &self.hits[..self.found]];
                let taken = share_of(held.bytes(), context, worker, share, job_hash).and_then(|hits| {
                    let place = self.shares[index].get_mut(..hits.len()).ok_or(Refused::Wrong(Distrust::Invalid))?;
                    place.copy_from_slice(hits); // checked where the worker cannot change it
                    let is_whole = are_true(place, share, points_m, points, &tissue)
                        && known.iter().all(|known| has_all_of(known, place, share, points_m, points, &tissue));
                    is_whole.then_some(hits.len()).ok_or(Refused::Wrong(Distrust::Invalid))
                });
                match taken {
                    Ok(found) => {
                        (self.counts[index], self.rows[index]) = (found, Row::default());
                        done |= 1 << index;
                    }
                    Err(why) => {
                        said_full |= u32::from(why == Refused::TooMany) << index;
                        self.rows[index].refuse(life, worker, why, world.version);
                    }
                }
            }
            for index in members(outcome.missing & group & !resting) {
                life.distrust(self.coordinator.incarnation_at(index), Distrust::Missing);
            }
            self.missing += group.count_ones() - done.count_ones();
        }
        self.compute_missing(life, (done, said_full), (points, &tissue), world.version)?;
        let mut parts: [&[Hit]; MAX_WORKERS] = [&[]; MAX_WORKERS];
        for (part, (share, count)) in parts.iter_mut().zip(self.shares.iter().zip(&self.counts)) {
            *part = &share[..*count];
        }
        let merged = merge(&parts[..count], &tissue, &mut self.hits);
        (self.found, self.dropped) = (merged.count, self.dropped.saturating_add(merged.dropped as u32));
        if context.holding {
            self.asking.note(was_shared, system::now_ns().saturating_sub(begun_ns));
        }
        Ok(())
    }

    /// Computes the shares that no worker has done. One that said falsely that a share has more hits than it can tell is of no use.
    fn compute_missing(
        &mut self,
        life: &Life,
        (done, said_full): (u32, u32),
        (points, tissue): (&Points<'_>, &Tissue<'_>),
        version: u32,
    ) -> Result<(), Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let (hash, count) = (HashRef::in_own_words(&self.own_hash).map_err(broken)?, self.shares.len());
        for index in (0..count).filter(|index| done & (1 << index) == 0) {
            let share = Share { index: index as u32, count: count as u32, split: Split::Tets };
            let (cull, hits) = (self.culls[index].of(version), &mut self.shares[index]);
            let found = intersect(share, &hash, points, tissue, cull, hits).map_err(broken)?;
            if said_full & (1 << index) != 0 && !is_full(&found, self.hits.len()) {
                life.page.add64(header::INVALID, 1);
                life.distrust(self.coordinator.incarnation_at(index), Distrust::Invalid);
            }
            self.counts[index] = found.count;
            self.dropped = self.dropped.saturating_add(found.dropped as u32);
        }
        Ok(())
    }

    /// The hits of the last test.
    pub fn hits(&self) -> &[Hit] {
        &self.hits[..self.found]
    }

    /// How many times tets near the points were looked for among all.
    #[cfg(test)]
    pub fn searches(&self) -> u64 {
        self.culls.iter().map(Cull::searches).sum()
    }
}

/// Whether a share has more hits than a worker tells where there is room for so many in all.
fn is_full(found: &Found, room: usize) -> bool {
    found.dropped > 0 || found.count > MOST_HITS_OF_SHARE.min(room)
}

/// Which share a part is computed of beside its worker in this step, and the part's number in it.
fn next_part(parts: &mut u32, shares: usize) -> (usize, u32) {
    *parts = parts.wrapping_add(1);
    (*parts as usize % shares, *parts / shares as u32)
}

/// Bytes of a job's sections: points, hash, owner and node of each point; from which point on they meet their own object alone, and from which distance at
/// rest on, m, as bits.
fn sections(points: usize, sizes: HashSizes) -> [usize; 5] {
    [points * 12, sizes.words() * 4, points * 4, points * 4, 8]
}

/// Releases the workers. In lock-step those that are warm, until each has joined or is lost.
fn release(coordinator: &mut ProcessCoordinator, life: &Life, group: Group) -> Outcome {
    let now_ns = system::now_ns();
    if !life.is_lockstep() {
        return coordinator.release(&[group], now_ns + PATIENCE_NS);
    }
    let lost = |page: &ReadPage| {
        life.heartbeat();
        lockstep::is_lost(&life.clock, page)
    };
    coordinator.release_unless(group & coordinator.ready(), now_ns + lockstep::PATIENCE_NS, &lost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_full_where_a_worker_has_no_room_for_its_hits() {
        let is = |count: usize, dropped: usize| is_full(&Found { count, dropped }, 2 * MOST_HITS_OF_SHARE);
        assert_eq!([is(0, 0), is(MOST_HITS_OF_SHARE, 0), is(MOST_HITS_OF_SHARE + 1, 0), is(10, 1)], [false, false, true, true]);
        // The share itself has more room than that, and the worker tells no more than there is for all.
        assert_eq!([200, 201].map(|count| is_full(&Found { count, dropped: 0 }, 200)), [false, true]);
    }
}
