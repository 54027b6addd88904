//! A thread that makes the model of what a cut has left while the one that steps makes the faces and packs the body: the tissue stands still meanwhile, and the
//! model takes as long as the rest.
//!
//! Promise: nobody waits for a thread that has not begun. It has the class and the priority of who waits for it; but on a busy machine it may come late, and then
//! its job is taken back. What is made is the same, whoever makes it.

use super::model::model_of;
use super::{Case, Workshop};
use crate::body::Body;
use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use hyst_engine::Failure;
use hyst_exchange::system;
use hyst_tissue::{Model, ModelMaker, ModelReport};
use parking_lot::Mutex;
use std::sync::Arc;

/// Stack of the thread, bytes: locked memory is brought in whole.
const STACK_BYTES: usize = 512 << 10;

/// The model of a body, or why there is none.
type Made = Result<(Model, ModelReport), Failure>;

/// What a model is to be made of.
pub(super) struct Job {
    maker: Arc<Mutex<ModelMaker>>,
    case: Arc<Case>,
    first_substeps: u32,
    body: Arc<Body>,
}

impl Job {
    /// That of a body.
    pub(super) fn of(workshop: &Workshop, body: &Arc<Body>) -> Job {
        let Workshop { case, maker, first_substeps, .. } = workshop;
        Job { maker: Arc::clone(maker), case: Arc::clone(case), first_substeps: *first_substeps, body: Arc::clone(body) }
    }

    /// Does it.
    pub(super) fn done(self) -> Made {
        model_of(&mut self.maker.lock(), &self.case, self.first_substeps, &self.body)
    }
}

/// The thread. It ends once this is dropped.
pub(super) struct Modeller {
    jobs: Sender<Job>,
    /// The other end of that, by which a job is taken back.
    untaken: Receiver<Job>,
    made: Receiver<Made>,
    thread_id: i32,
    priority: i32,
}

impl Modeller {
    /// Starts it; `None` where there is no core for it, or the system gives no thread.
    pub(super) fn start() -> Option<Modeller> {
        if system::places() < 2 {
            return None;
        }
        let ((jobs, untaken), (told, made), (names, named)) = (bounded(1), bounded(1), bounded(1));
        let taken: Receiver<Job> = untaken.clone();
        let body = move || {
            system::unpin(); // where that is refused it takes turns with its caller, who takes the job back
            let _ = names.send(system::thread_id()); // to who waits for it
            for job in taken {
                if told.send(job.done()).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("modeller".into()).stack_size(STACK_BYTES).spawn(body).ok()?;
        Some(Modeller { jobs, untaken, made, thread_id: named.recv().ok()?, priority: 0 })
    }

    /// Has it do a job, and does something else meanwhile; and then the job, too, if it has not begun it.
    pub(super) fn both<T>(&mut self, job: Job, meanwhile: impl FnOnce() -> T) -> (Made, T) {
        let priority = system::own_priority();
        if std::mem::replace(&mut self.priority, priority) != priority {
            // Where that is refused it is an ordinary thread, which is late at worst.
            if priority > 0 {
                system::hasten(self.thread_id, priority)
            } else {
                system::demote(self.thread_id)
            };
        }
        let refused = self.jobs.try_send(job).err().map(TrySendError::into_inner);
        let other = meanwhile();
        let made = match refused.or_else(|| self.untaken.try_recv().ok()) {
            Some(job) => job.done(),
            // Who goes on after that has a maker in its midst that nobody knows the state of.
            None => self.made.recv().unwrap_or_else(|_| panic!("the thread that makes models has died")),
        };
        (made, other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{World, load_scene};
    use hyst_tissue::Isa;

    fn opened() -> (Workshop, World) {
        Workshop::open(&load_scene(None).unwrap(), Isa::detect()).unwrap()
    }

    #[test]
    fn a_model_is_the_same_whoever_makes_it_and_a_job_that_nobody_begins_is_taken_back() {
        let (mut workshop, world) = opened();
        let (body, model) = (Arc::new(world.body.clone()), workshop.make(world.body.clone()).unwrap().model);
        let mut modeller = Modeller::start();
        for _ in 0..3 {
            let Some(modeller) = &mut modeller else { return };
            let (made, other) = modeller.both(Job::of(&workshop, &body), || 7);
            assert!(made.unwrap().0 == model && other == 7);
        }
        // One that is never let run.
        let ((jobs, untaken), (_told, made)) = (bounded(1), bounded(1));
        let mut stopped = Modeller { jobs, untaken, made, thread_id: 0, priority: system::own_priority() };
        let (made, _) = stopped.both(Job::of(&workshop, &body), || ());
        assert!(made.unwrap().0 == model);
        workshop.modeller = None;
        assert!(workshop.make_sound(world.body, None, &mut || ()).unwrap().model == model);
    }

    #[test]
    #[should_panic(expected = "has died")]
    fn who_waits_for_one_that_dies_does_too() {
        let (workshop, world) = opened();
        let ((jobs, untaken), (told, made)) = (bounded(1), bounded::<Made>(1));
        let taken = untaken.clone();
        let mut dying = Modeller { jobs, untaken, made, thread_id: 0, priority: system::own_priority() };
        let _ = dying.both(Job::of(&workshop, &Arc::new(world.body.clone())), || drop((taken.recv(), told)));
    }
}
