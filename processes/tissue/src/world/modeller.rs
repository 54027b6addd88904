//! A thread that does on another core what a cut leaves to do while the one that steps does the rest: the tissue stands still meanwhile. First it binds the
//! surface for the eye, which takes longest of a cut, then it makes the model, which takes as long as the faces and the packing of the body. What holds a
//! cavity shut, which is known by the model, is made behind it where it is asked for.
//!
//! Promise: nobody waits for a job that has not been begun: on a busy machine the thread may come late, and then its job is taken back. It has the priority of who
//! waits for it, and has nothing to do where that one is an ordinary thread. What is made is the same, whoever makes it.

use super::model::model_of;
use super::surface::{Coming, SurfaceJob};
use super::{Case, Workshop};
use crate::body::Body;
use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use hyst_engine::Failure;
use hyst_exchange::system;
use hyst_mesh::TetMesh;
use hyst_tissue::{LooseSkin, Model, ModelMaker};
use parking_lot::Mutex;
use std::sync::Arc;
use std::time::Duration;

/// How long the thread may take to begin, and a job that has been begun: far longer than any does. Who waits for so long is taken for one that hangs long
/// before.
const WITHIN: Duration = Duration::from_secs(5);
/// Stack of the thread, bytes: locked memory is brought in whole.
const STACK_BYTES: usize = 512 << 10;

/// Something that the thread may do.
pub(super) trait Job {
    /// What comes of it.
    type Made;

    /// Does it.
    fn done(self) -> Self::Made;
}

/// The model of a body, with the forces that hold its cavity shut, N, where they were asked for; or why there is none.
type Made = Result<(Model, Option<Vec<[f32; 3]>>), Failure>;

/// What a model is to be made of.
pub(super) struct ModelJob {
    maker: Arc<Mutex<ModelMaker>>,
    case: Arc<Case>,
    first_substeps: u32,
    body: Arc<Body>,
    /// What holds the cavity shut is asked for.
    is_shut: bool,
}

impl ModelJob {
    /// That of a body, which needs no surface, with what holds its cavity shut or without.
    pub(super) fn of(workshop: &Workshop, body: &Arc<Body>, is_shut: bool) -> ModelJob {
        let Workshop { case, maker, first_substeps, .. } = workshop;
        let (maker, case, body) = (Arc::clone(maker), Arc::clone(case), Arc::clone(body));
        ModelJob { maker, case, first_substeps: *first_substeps, body, is_shut }
    }
}

impl Job for ModelJob {
    type Made = Made;

    fn done(self) -> Made {
        let (model, _) = model_of(&mut self.maker.lock(), &self.case, self.first_substeps, &self.body)?;
        let shut_n = self.is_shut.then(|| self.case.closing.shut_n(&model, &self.body));
        Ok((model, shut_n))
    }
}

/// Where jobs of a kind are given, one at a time.
struct Post<J: Job> {
    jobs: Sender<J>,
    /// The other end of that, by which a job is taken back.
    untaken: Receiver<J>,
    made: Receiver<J::Made>,
}

/// Where the thread finds them.
struct Desk<J: Job> {
    jobs: Receiver<J>,
    told: Sender<J::Made>,
}

/// Both ends for jobs of a kind.
fn post<J: Job>() -> (Post<J>, Desk<J>) {
    let ((jobs, untaken), (told, made)) = (bounded(1), bounded(1));
    (Post { jobs, untaken: untaken.clone(), made }, Desk { jobs: untaken, told })
}

impl<J: Job> Post<J> {
    /// Gives a job, and wakes who may do it; the job comes back where another one lies there.
    fn give(&self, job: J, wake: &Sender<()>) -> Result<Sent<J>, J> {
        self.jobs.try_send(job).map_err(TrySendError::into_inner)?;
        let _ = wake.try_send(()); // who has been woken already has yet to look
        Ok(Sent { untaken: self.untaken.clone(), made: self.made.clone(), is_ended: false })
    }
}

impl<J: Job> Desk<J> {
    /// Does the job that lies there, if there is one; false if nobody is left who would be told.
    fn serve(&self) -> bool {
        match self.jobs.try_recv() {
            Ok(job) => self.told.send(job.done()).is_ok(),
            Err(_) => true,
        }
    }
}

/// A job that was given.
#[derive(Debug)]
pub(super) struct Sent<J: Job> {
    untaken: Receiver<J>,
    made: Receiver<J::Made>,
    is_ended: bool,
}

impl<J: Job> Sent<J> {
    /// What comes of it. One that has not been begun is done here.
    pub(super) fn ended(mut self) -> J::Made {
        self.is_ended = true;
        match self.untaken.try_recv() {
            Ok(job) => job.done(),
            // Who went on after that would have a maker that nobody knows the state of, or no surface.
            Err(_) => self.made.recv_timeout(WITHIN).unwrap_or_else(|error| panic!("the thread that makes models: {error}")),
        }
    }
}

impl<J: Job> Drop for Sent<J> {
    /// Who goes on without it takes it back all the same: what came of it would be taken for what comes of the next one.
    fn drop(&mut self) {
        if !self.is_ended && self.untaken.try_recv().is_err() {
            let _ = self.made.recv_timeout(WITHIN); // one that has died tells nothing
        }
    }
}

/// The thread. It ends once this is dropped.
pub(super) struct Modeller {
    surfaces: Post<SurfaceJob>,
    models: Post<ModelJob>,
    wake: Sender<()>,
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
        let ((names, named), (wake, woken)) = (bounded(1), bounded(1));
        let ((surfaces, bind), (models, make)) = (post::<SurfaceJob>(), post::<ModelJob>());
        let body = move || {
            system::unpin(); // where that is refused it takes turns with its caller, who takes the job back
            let _ = names.send(system::thread_id()); // to who waits for it
            for () in woken {
                // The surface is asked for first, and given first.
                if !(bind.serve() && make.serve()) {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("modeller".into()).stack_size(STACK_BYTES).spawn(body).ok()?;
        Some(Modeller { surfaces, models, wake, thread_id: named.recv_timeout(WITHIN).ok()?, priority: 0 })
    }

    /// Has it bind a surface to a mesh at rest while the caller does something else. One that it may not be given is bound at once.
    pub(super) fn bind(&mut self, loose: LooseSkin, rest: &TetMesh) -> Coming {
        if self.is_as_urgent() {
            Coming::given(self.surfaces.give(SurfaceJob { loose, rest: rest.clone() }, &self.wake))
        } else {
            Coming::at_once(loose, rest)
        }
    }

    /// Has it make a model meanwhile. A job that it may not be given comes back, to be done behind all else.
    pub(super) fn make(&mut self, job: ModelJob) -> Result<Sent<ModelJob>, ModelJob> {
        if self.is_as_urgent() { self.models.give(job, &self.wake) } else { Err(job) }
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
impl Coming {
    /// One that nobody binds until it is asked for, as where the thread comes late.
    pub fn late(loose: LooseSkin, rest: &TetMesh) -> Coming {
        let ((surfaces, _), (wake, _)) = (post::<SurfaceJob>(), bounded(1));
        Coming::given(surfaces.give(SurfaceJob { loose, rest: rest.clone() }, &wake))
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
    fn without_thread(priority: i32) -> (Modeller, Desk<ModelJob>) {
        let ((surfaces, _), (models, make), (wake, _)) = (post(), post(), bounded(1));
        (Modeller { surfaces, models, wake, thread_id: 0, priority }, make)
    }

    /// What comes of a job that was given, or came back.
    fn ended(given: Result<Sent<ModelJob>, ModelJob>) -> Made {
        given.map_or_else(Job::done, Sent::ended)
    }

    #[test]
    fn a_model_is_the_same_whoever_makes_it_and_a_job_that_nobody_begins_is_taken_back() {
        let (mut workshop, world) = opened();
        let (body, alone) = (Arc::new(world.body.clone()), workshop.make(world.body.clone()).unwrap());
        let expected = (alone.model.clone(), Some(alone.shut_n().to_vec()));
        assert!(expected.1.iter().flatten().any(|force_n| *force_n != [0.0; 3]), "the default scene's cavity closes");
        let job = || ModelJob::of(&workshop, &body, true);
        let may_be_real_time = system::become_fifo(1);
        let (mut never, make) = without_thread(system::own_priority());
        let given = never.make(job());
        assert_eq!(make.jobs.len(), usize::from(may_be_real_time), "it is given");
        assert!(ended(given).unwrap() == expected && make.jobs.is_empty(), "and taken back");
        if may_be_real_time {
            let given = never.make(job());
            assert!(make.serve() && make.jobs.is_empty() && make.told.len() == 1);
            assert!(ended(given).unwrap() == expected && make.told.is_empty(), "another has made it");
        }
        if let Some(mut modeller) = Modeller::start() {
            for _ in 0..3 {
                assert!(ended(modeller.make(job())).unwrap() == expected);
            }
        }
        system::demote(0);
        let given = never.make(job());
        assert!(given.is_err() && make.jobs.is_empty(), "an ordinary thread gives it to nobody");
        assert!(ended(given).unwrap() == expected, "and does all by itself");
        workshop.modeller = None;
        for is_shut in [false, true] {
            let (sound, out_of_room) = workshop.make_sound(world.body.clone(), (None, None), is_shut, &mut || ()).unwrap();
            assert!(sound.model == expected.0 && sound.shut_n.get() == expected.1.as_ref().filter(|_| is_shut), "{is_shut}");
            assert!(sound.words == alone.words && out_of_room == 0, "it has the surface of its body");
        }
    }

    #[test]
    fn who_goes_on_without_what_was_asked_for_leaves_nothing_of_it_for_the_next() {
        let (workshop, world) = opened();
        let body = Arc::new(world.body);
        let ((models, make), (wake, woken)) = (post::<ModelJob>(), bounded(1));
        let give = |is_shut: bool| models.give(ModelJob::of(&workshop, &body, is_shut), &wake);
        drop(give(false));
        assert!(make.jobs.is_empty() && woken.len() == 1, "it is taken back");
        let given = give(false);
        assert!(make.serve());
        drop(given);
        let given = give(true);
        assert!(make.serve());
        assert!(ended(given).unwrap().1.is_some(), "what holds the cavity shut was asked for this time");
        let first = give(false);
        assert!(give(true).is_err(), "there is place for one");
        drop(first);
    }

    #[test]
    fn who_waits_for_one_that_dies_does_too() {
        if !system::become_fifo(1) {
            return; // an ordinary thread waits for none
        }
        let (workshop, world) = opened();
        let (mut dying, make) = without_thread(1);
        let body = Arc::new(world.body);
        let given = dying.make(ModelJob::of(&workshop, &body, false));
        drop((make.jobs.recv(), make));
        let dies = || drop(ended(given));
        let said = std::panic::catch_unwind(std::panic::AssertUnwindSafe(dies)).unwrap_err();
        assert!(said.downcast_ref::<String>().is_some_and(|said| said.contains("that makes models")), "{said:?}");
    }
}
