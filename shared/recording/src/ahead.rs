//! A recording that is read from its beginning to its end: who asks for it reads the file and takes the blocks in its order, others unpack and decode them
//! ahead of it, each the next one that nobody has begun.
//!
//! Promise: the blocks, what is damaged and the end are those of [`Reader::next_block`], whatever the number of threads, but for the states of tissue and fluid,
//! which are looked at and not given. Memory does not grow with the recording: no more is read ahead than is said here. A thread that panics is the panic
//! of who reads.

use crate::block::Block;
use crate::decode::{Raw, States};
use crate::error::ReadError;
use crate::reader::{Damage, Reader};
use crate::unpack::Unpacker;
use crossbeam::channel::{Receiver, Sender, bounded};
use std::collections::VecDeque;
use std::io::{Read, Seek};

/// Most blocks that are decoded or wait for it, and bytes of them in the file: a block of the recorder's has some 0.1 MB there and some 1 MB decoded.
const AHEAD_BLOCKS: usize = 16;
const AHEAD_BYTES: usize = 4 << 20;
/// Bytes that are read at once: what lies between the messages of two blocks has some ten thousand.
const AT_ONCE_BYTES: usize = 16 << 10;

type Decoded = Result<Option<Block>, String>;

/// A record that is to be decoded, and where to.
struct Job {
    raw: Raw,
    to: Sender<Decoded>,
}

/// A record that is being decoded.
struct Awaited {
    at: u64,
    bytes: usize,
    /// What is damaged between the one before and this one.
    before: Vec<Damage>,
    from: Receiver<Decoded>,
}

impl<R: Read + Seek> Reader<R> {
    /// Gives every block to `take` in the file's order, but for the states in it, whatever the number of threads that decode them. After an error everything
    /// before it was given.
    pub fn each_block(&mut self, threads: usize, mut take: impl FnMut(Block)) -> Result<(), ReadError> {
        self.each_block_while(threads, |block| {
            take(block);
            true
        })
    }

    /// The same up to the block for which `take` says `false`; what may have been read behind it is not told.
    pub fn each_block_while(&mut self, threads: usize, mut take: impl FnMut(Block) -> bool) -> Result<(), ReadError> {
        self.read_ahead(AT_ONCE_BYTES);
        if threads <= 1 {
            while let Some(block) = self.next_with(States::Checked)? {
                if !take(block) {
                    break;
                }
            }
            return Ok(());
        }
        let (jobs, to_do) = bounded(AHEAD_BLOCKS);
        std::thread::scope(|scope| {
            let worker = |_| {
                let to_do = to_do.clone();
                scope.spawn(move || work(&to_do))
            };
            let workers: Vec<_> = (0..threads.min(AHEAD_BLOCKS)).map(worker).collect();
            drop(to_do);
            let read = self.hand_out(jobs, take);
            for worker in workers {
                worker.join().unwrap_or_else(|cause| std::panic::resume_unwind(cause));
            }
            read
        })
    }

    /// Reads the file, has its blocks decoded, and gives them in its order. It ends early if nobody wants more, or nobody decodes any more.
    fn hand_out(&mut self, jobs: Sender<Job>, mut take: impl FnMut(Block) -> bool) -> Result<(), ReadError> {
        let (mut awaited, mut bytes) = (VecDeque::<Awaited>::new(), 0);
        let mut end = None;
        loop {
            while end.is_none() && awaited.len() < AHEAD_BLOCKS && bytes < AHEAD_BYTES {
                let mut before = Vec::new();
                match self.next_raw(&mut before) {
                    Ok(Some(raw)) => {
                        let (to, from) = bounded(1);
                        let next = Awaited { at: raw.frame.at, bytes: raw.body.len(), before, from };
                        bytes += next.bytes;
                        awaited.push_back(next);
                        if jobs.send(Job { raw, to }).is_err() {
                            return Ok(());
                        }
                    }
                    Ok(None) => end = Some((before, Ok(()))),
                    Err(error) => end = Some((before, Err(error))),
                }
            }
            let Some(next) = awaited.pop_front() else { break };
            bytes -= next.bytes;
            self.note(next.before);
            match next.from.recv() {
                Ok(Ok(block)) => {
                    if !block.is_none_or(&mut take) {
                        return Ok(());
                    }
                }
                Ok(Err(reason)) => self.note([Damage { at: next.at, reason }]),
                Err(_) => return Ok(()),
            }
        }
        let (before, read) = end.unwrap_or((Vec::new(), Ok(())));
        self.note(before);
        read
    }
}

/// Decodes what is to do until there is nothing more, with room of its own.
fn work(to_do: &Receiver<Job>) {
    let mut unpacker = Unpacker::default();
    for Job { raw, to } in to_do {
        let _ = to.send(raw.decode(&mut unpacker, States::Checked)); // who has failed meanwhile waits for none
    }
}
