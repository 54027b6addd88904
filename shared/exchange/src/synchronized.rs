//! Synchronized Thread and Synchronized Process hide the Meeting Point: an engine's author writes `step`, nothing else.

use crate::meeting::{Group, Member, ProcessMember, Release, ThreadCoordinator, threads};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Work that several threads share: part `index` of `count` of a phase. Called for every part of every phase, by one thread each.
pub trait SharedWork: Send + Sync + 'static {
    /// Computes one part.
    fn step(&self, phase: u32, index: usize, count: usize);
}

/// A crew of Synchronized Threads. The calling thread computes part 0 itself; a part whose thread died is computed by the caller.
#[derive(Debug)]
pub struct SynchronizedThreads<W: SharedWork> {
    work: Arc<W>,
    coordinator: ThreadCoordinator,
    handles: Vec<JoinHandle<()>>,
    phase: Arc<std::sync::atomic::AtomicU32>,
}

impl<W: SharedWork> SynchronizedThreads<W> {
    /// Starts `count − 1` threads beside the caller's.
    pub fn new(work: Arc<W>, count: usize, name: &str) -> std::io::Result<SynchronizedThreads<W>> {
        use std::sync::atomic::{AtomicU32, Ordering};
        let count = count.clamp(1, crate::meeting::MAX_MEMBERS);
        let (coordinator, members) = threads(count - 1);
        let phase = Arc::new(AtomicU32::new(0));
        let mut handles = Vec::with_capacity(count - 1);
        for (index, mut member) in members.into_iter().enumerate() {
            let (work, phase) = (Arc::clone(&work), Arc::clone(&phase));
            let body = move || {
                // Ends when the coordinator is dropped.
                while let Some(release) = member.await_release(u64::MAX / 2) {
                    work.step(phase.load(Ordering::Acquire), index + 1, count);
                    member.join(release);
                }
            };
            handles.push(std::thread::Builder::new().name(format!("{name}-{index}")).spawn(body)?);
        }
        Ok(SynchronizedThreads { work, coordinator, handles, phase })
    }

    /// Runs one phase on all threads and returns when all parts are done. Gives how many parts the caller had to compute for the dead.
    pub fn run(&mut self, phase: u32) -> u32 {
        let count = self.handles.len() + 1;
        let others: Group = (1 << self.handles.len()) - 1;
        if others == 0 {
            self.work.step(phase, 0, 1);
            return 0;
        }
        self.phase.store(phase, std::sync::atomic::Ordering::Release);
        let begun = self.coordinator.begin(others);
        self.work.step(phase, 0, count);
        // No deadline: a thread of the own process that hangs is the process hanging, which others detect and replace.
        let outcome = self.coordinator.finish(begun, u64::MAX / 2);
        for index in crate::meeting::members(outcome.missing) {
            self.work.step(phase, index + 1, count);
        }
        outcome.missing.count_ones()
    }
}

impl<W: SharedWork> Drop for SynchronizedThreads<W> {
    fn drop(&mut self) {
        self.coordinator = threads(0).0; // closes the old one, which ends the threads
        for handle in self.handles.drain(..) {
            let _ = handle.join(); // a thread that panicked has already been counted as dead
        }
    }
}

/// One Synchronized Process: waits for releases of its coordinator and calls `step` for each for as long as `between` says yes.
pub fn synchronized_process(
    member: &mut ProcessMember,
    patience_ns: u64,
    mut between: impl FnMut(&mut ProcessMember) -> bool,
    mut step: impl FnMut(Release),
) {
    while between(member) {
        if let Some(release) = member.await_release(crate::system::now_ns() + patience_ns) {
            step(release);
            member.join(release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    struct Sum {
        parts: Vec<AtomicU64>,
        dies: Option<usize>,
    }
    impl SharedWork for Sum {
        fn step(&self, phase: u32, index: usize, count: usize) {
            let dies = self.dies == Some(index) && std::thread::current().name().is_some_and(|name| name.starts_with("crew"));
            assert!(!dies, "a thread of the crew dies, as the test wants");
            for (at, part) in self.parts.iter().enumerate() {
                if at % count == index {
                    part.fetch_add(phase as u64, Ordering::Relaxed);
                }
            }
        }
    }

    fn sum(threads: usize, dies: Option<usize>) -> Vec<u64> {
        let work = Arc::new(Sum { parts: (0..20).map(|_| AtomicU64::new(0)).collect(), dies });
        let mut crew = SynchronizedThreads::new(Arc::clone(&work), threads, "crew").unwrap();
        for phase in 1..=100 {
            crew.run(phase);
        }
        work.parts.iter().map(|part| part.load(Ordering::Relaxed)).collect()
    }

    #[test]
    fn any_number_of_threads_does_all_parts_of_all_phases_once() {
        for threads in [1, 2, 3, 8] {
            assert_eq!(sum(threads, None), vec![5050; 20], "{threads} threads");
        }
    }

    #[test]
    fn the_part_of_a_thread_that_died_is_computed_by_the_caller() {
        assert_eq!(sum(3, Some(1)), vec![5050; 20]);
    }
}
