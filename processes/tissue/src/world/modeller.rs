//! A thread that makes the model of what a cut has left while the one that steps makes the faces and packs the body: the tissue stands still meanwhile, and the
//! model takes as long as the rest. What holds a cavity shut, which is known by the model, is made behind it where it is asked for.
//!
//! Promise: nobody waits for a job that has not been begun: on a busy machine the thread may come late, and then its job is taken back. It has the priority of who
//! waits for it, and has nothing to do where that one is an ordinary thread. What is made is the same, whoever makes it.

use super::model::model_of;
use super::{Case, Workshop};
use crate::body::Body;
use crossbeam::channel::{Receiver, Sender, bounded};
use hyst_engine::Failure;
use hyst_exchange::system;
use hyst_tissue::{Model, ModelMaker};
use parking_lot::Mutex;
use std::sync::Arc;
use std::time::Duration;

/// How long the thread may take to begin, and a model that has been begun: far longer than any does. Who waits for so long is taken for one that hangs long before.
const WITHIN: Duration = Duration::from_secs(5);
/// Stack of the thread, bytes: locked memory is brought in whole.
const STACK_BYTES: usize = 512 << 10;

/// The model of a body, with the forces that hold its cavity shut, N, where they were asked for; or why there is none.
type Made = Result<(Model, Option<Vec<[f32; 3]>>), Failure>;

/// What a model is to be made of.
pub(super) struct Job {
    maker: Arc<Mutex<ModelMaker>>,
    case: Arc<Case>,
    first_substeps: u32,
    body: Arc<Body>,
    /// What holds the cavity shut is asked for.
    is_shut: bool,
}

impl Job {
    /// That of a body, with what holds its cavity shut or without.
    pub(super) fn of(workshop: &Workshop, body: &Arc<Body>, is_shut: bool) -> Job {
        let Workshop { case, maker, first_substeps, .. } = workshop;
        let (maker, case, body) = (Arc::clone(maker), Arc::clone(case), Arc::clone(body));
        Job { maker, case, first_substeps: *first_substeps, body, is_shut }
    }

    /// Does it.
    pub(super) fn done(self) -> Made {
        let (model, _) = model_of(&mut self.maker.lock(), &self.case, self.first_substeps, &self.body)?;
        let shut_n = self.is_shut.then(|| self.case.closing.shut_n(&model, &self.body));
        Ok((model, shut_n))
    }
}

/// The thread. It ends once this is dropped.
pub(super) struct Modeller {
    jobs: Sender<Job>,
    /// The other end of that, by which a job is taken back.
    untaken: Receiver<Job>,
    made: Receiver<Made>,
    thread_id: i32,
    /// The priority that it was given last, 0 for none.
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
        Some(Modeller { jobs, untaken, made, thread_id: named.recv_timeout(WITHIN).ok()?, priority: 0 })
    }

    /// Has it do a job, and does something else meanwhile; and then the job, too, if it has not begun it.
    pub(super) fn both<T>(&mut self, job: Job, meanwhile: impl FnOnce() -> T) -> (Made, T) {
        let kept =
            if self.is_as_urgent() { self.jobs.try_send(job).err().map(|refused| refused.into_inner()) } else { Some(job) };
        let other = meanwhile();
        let made = match kept.or_else(|| self.untaken.try_recv().ok()) {
            Some(job) => job.done(),
            // Who went on after that would have a maker that nobody knows the state of.
            None => self.made.recv_timeout(WITHIN).unwrap_or_else(|error| panic!("the thread that makes models: {error}")),
        };
        (made, other)
    }

    /// Whether the thread has the caller's priority. One that has none is given nothing to do: on full cores it would be waited for as long as others have the
    /// machine, and who sleeps for so long counts as one that hangs.
    fn is_as_urgent(&mut self) -> bool {
        let priority = system::own_priority();
        if priority > 0 && priority != self.priority && system::hasten(self.thread_id, priority) {
            self.priority = priority;
        }
        priority > 0 && priority == self.priority
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

    /// One whose thread the test stands for, as for a caller of this priority.
    fn without_thread(priority: i32) -> (Modeller, Receiver<Job>, Sender<Made>) {
        let ((jobs, untaken), (told, made)) = (bounded(1), bounded(1));
        (Modeller { jobs, untaken: untaken.clone(), made, thread_id: 0, priority }, untaken, told)
    }

    #[test]
    fn a_model_is_the_same_whoever_makes_it_and_a_job_that_nobody_begins_is_taken_back() {
        let (mut workshop, world) = opened();
        let (body, alone) = (Arc::new(world.body.clone()), workshop.make(world.body.clone()).unwrap());
        let expected = (alone.model.clone(), Some(alone.shut_n().to_vec()));
        assert!(expected.1.iter().flatten().any(|force_n| *force_n != [0.0; 3]), "the default scene's cavity closes");
        let job = || Job::of(&workshop, &body, true);
        let may_be_real_time = system::become_fifo(1);
        let (mut never, untaken, told) = without_thread(system::own_priority());
        let (made, other) = never.both(job(), || (untaken.len(), 7));
        assert!(made.unwrap() == expected && other == (usize::from(may_be_real_time), 7), "it is given, and taken back");
        if may_be_real_time {
            let begins = || told.send(untaken.recv().unwrap().done()).unwrap();
            let (made, ()) = never.both(job(), begins);
            assert!(made.unwrap() == expected && told.is_empty(), "another has made it");
        }
        if let Some(mut modeller) = Modeller::start() {
            for _ in 0..3 {
                assert!(modeller.both(job(), || ()).0.unwrap() == expected);
            }
        }
        system::demote(0);
        let (made, given) = never.both(job(), || untaken.len());
        assert!(made.unwrap() == expected && given == 0, "an ordinary thread does all by itself");
        workshop.modeller = None;
        for is_shut in [false, true] {
            let sound = workshop.make_sound(world.body.clone(), None, is_shut, &mut || ()).unwrap();
            assert!(sound.model == expected.0 && sound.shut_n.get() == expected.1.as_ref().filter(|_| is_shut), "{is_shut}");
        }
    }

    #[test]
    fn who_waits_for_one_that_dies_does_too() {
        if !system::become_fifo(1) {
            return; // an ordinary thread waits for none
        }
        let (workshop, world) = opened();
        let (mut dying, untaken, told) = without_thread(1);
        let body = Arc::new(world.body);
        let dies = || dying.both(Job::of(&workshop, &body, false), || drop((untaken.recv(), told))).1;
        let said = std::panic::catch_unwind(std::panic::AssertUnwindSafe(dies)).unwrap_err();
        assert!(said.downcast_ref::<String>().is_some_and(|said| said.contains("that makes models")), "{said:?}");
    }
}
