//! The intersection test, shared among the collision workers through the Meeting Point: the hash is built once, in place in shared memory,
//! and read in place; a share that is missing is computed here in the same step.

use crate::contacts;
use crate::world::World;
use hyst_contact::{HashMut, HashRef, HashSizes, Hit, Layout, Points, Share, Split, intersect, merge};
use hyst_engine::{Failure, Life, StepContext};
use hyst_exchange::meeting::{Coordinator, ProcessCoordinator, members};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port};
use hyst_exchange::{Held, Links, Loan, Publisher, Subscriber, system};
use hyst_messages::stream::message_bytes;
use hyst_messages::{Kind, MAX_WORKERS, Message, MessageMut, Role, StreamHeader};
use std::sync::Arc;

/// What a step waits for its workers at most, ns: several times what a share takes, a third of a tick.
const PATIENCE_NS: u64 = 300_000;

/// The coordinator's side.
pub struct Collision {
    workers: usize,
    coordinator: ProcessCoordinator,
    jobs: Option<Publisher>,
    contacts: [Option<Subscriber>; MAX_WORKERS],
    sizes: HashSizes,
    own_hash: Vec<u32>,
    shares: Vec<Vec<Hit>>,
    counts: Vec<usize>,
    hits: Vec<Hit>,
    found: usize,
    missing: u32,
    copied_bytes: u64,
}

/// A job that has been written and not yet been tested.
pub struct Job {
    loan: Option<Loan>,
}

impl Collision {
    /// For the workers of the station.
    pub fn new(life: &Life, world: &World) -> Collision {
        let sizes = HashSizes::for_points(world.tool.points_m.len());
        let workers = life.settings.workers.min(MAX_WORKERS);
        let room = contacts::max_hits(world);
        Collision {
            workers,
            coordinator: ProcessCoordinator::new(Arc::clone(&life.page)),
            jobs: None,
            contacts: Default::default(),
            sizes,
            own_hash: vec![0; sizes.words()],
            shares: vec![vec![Hit::default(); room]; workers.max(1)],
            counts: vec![0; workers.max(1)],
            hits: vec![Hit::default(); room],
            found: 0,
            missing: 0,
            copied_bytes: 0,
        }
    }

    fn sections(&self, points: usize) -> [usize; 3] {
        [points * 12, self.sizes.words() * 4, points * 4]
    }

    /// Opens the stream of the jobs.
    pub fn open(&mut self, life: &Life, links: &Links, points: usize) -> Result<(), Failure> {
        if self.workers > 0 {
            let bytes = message_bytes(&self.sections(points));
            self.jobs = Some(links.publisher(Role::Tissue, life.incarnation, Kind::CollisionJob, bytes)?);
        }
        Ok(())
    }

    /// Takes a worker's page or stream.
    pub fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let index = arrival.slot.index();
        match arrival.port {
            Port::Page(page) if index < self.workers => {
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

    /// Bytes copied in the last step beyond the one write into the loan.
    pub fn copied_bytes(&self) -> u64 {
        self.copied_bytes
    }

    /// Builds the hash of the tool's points: in a job in shared memory if there are workers and this step is theirs, else in own memory.
    pub fn hash(&mut self, context: &StepContext, points_m: &[[f32; 3]], owner: &[u32], cell_m: f32) -> Result<Job, Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let sections = self.sections(points_m.len());
        self.coordinator.readmit();
        let jobs = self.jobs.as_ref().filter(|_| context.holding && self.coordinator.present() != 0);
        let Some(jobs) = jobs else {
            self.copied_bytes = 0;
            let mut hash = HashMut::in_words(&mut self.own_hash, self.sizes).map_err(broken)?;
            hash.build(points_m, cell_m, Layout::Auto).map_err(broken)?;
            return Ok(Job { loan: None });
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
        message.section::<u32>(2)?.copy_from_slice(owner);
        let mut hash = HashMut::in_words(message.section::<u32>(1)?, self.sizes).map_err(broken)?;
        hash.build(points_m, cell_m, Layout::Auto).map_err(broken)?;
        // The coordinator keeps a copy of the table: it needs it after the job was sent, for missing shares and for the gaps.
        self.own_hash.copy_from_slice(message.section::<u32>(1)?);
        self.copied_bytes = 4 * self.own_hash.len() as u64;
        Ok(Job { loan: Some(loan) })
    }

    /// The table of this step.
    pub fn table(&self) -> Result<HashRef<'_>, Failure> {
        HashRef::in_words(&self.own_hash).map_err(|error| Failure::Broken(error.to_string()))
    }

    /// Runs the test; the hits are the same whoever computed them.
    pub fn test(
        &mut self,
        context: &StepContext,
        job: Job,
        points: &Points<'_>,
        world: &World,
        positions_m: &[[f32; 3]],
    ) -> Result<(), Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let tissue = contacts::tissue(world, positions_m);
        let hash = HashRef::in_words(&self.own_hash).map_err(broken)?;
        let count = self.shares.len();
        let mut done = 0u32;
        if let Some(loan) = job.loan {
            loan.send()?;
            let group = (1u32 << self.workers) - 1;
            let outcome = self.coordinator.release(&[group], system::now_ns() + PATIENCE_NS);
            for index in members(outcome.joined) {
                let expected = self.coordinator.incarnation_at(index);
                if let Some(held) = self.contacts[index].as_ref().and_then(|stream| stream.newest().ok()?)
                    && let Some(hits) = share_of(&held, context, expected, index, count, self.shares[index].len())
                {
                    self.shares[index][..hits.len()].copy_from_slice(hits);
                    self.counts[index] = hits.len();
                    done |= 1 << index;
                }
            }
            self.missing += group.count_ones() - done.count_ones();
        }
        for index in 0..count {
            if done & (1 << index) == 0 {
                let share = Share { index: index as u32, count: count as u32, split: Split::Tets };
                let found = intersect(share, &hash, points, &tissue, &mut self.shares[index]).map_err(broken)?;
                self.counts[index] = found.count;
            }
        }
        let mut parts: [&[Hit]; MAX_WORKERS] = [&[]; MAX_WORKERS];
        for (part, (share, count)) in parts.iter_mut().zip(self.shares.iter().zip(&self.counts)) {
            *part = &share[..*count];
        }
        self.found = merge(&parts[..count], &tissue, &mut self.hits).count;
        Ok(())
    }

    /// The hits of the last test.
    pub fn hits(&self) -> &[Hit] {
        &self.hits[..self.found]
    }
}

/// The hits of a worker's answer, if it is the answer to this job by the member that was released.
fn share_of<'a>(
    held: &'a Held,
    context: &StepContext,
    expected: u32,
    index: usize,
    count: usize,
    room: usize,
) -> Option<&'a [Hit]> {
    let message = Message::parse(held.bytes(), Kind::Contacts).ok()?;
    let header = message.header();
    let fits = header.tick == context.tick
        && header.epoch == context.tenure.epoch
        && header.incarnation == expected
        && header.words == [index as u32, count as u32];
    let hits: &[Hit] = message.section(0).ok()?;
    (fits && hits.len() <= room).then_some(hits)
}
