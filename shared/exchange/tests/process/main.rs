//! The exchange between processes under the death of either partner: each test plays one side, and a partner process that is killed,
//! aborted or stopped at every point of the protocol plays the other. Each test runs in a process of its own with a station of its own.

mod cells;
mod checkpoints;
mod epochs;
mod leaks;
mod meeting;
mod rendezvous;
mod stream;
mod support;
mod usher;
