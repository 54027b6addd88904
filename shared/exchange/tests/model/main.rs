//! The protocols between processes, searched exhaustively: every interleaving of every single access to a shared word, with a death allowed at
//! every step. A process that hangs, is stopped or is slow needs no step of its own: it is one that takes no step for as long as it likes.
//!
//! The search is our own (`search`, breadth first, so that a counterexample is a shortest one): the published checker for Rust brings a web
//! server with it, and what is asked here about endings (no state without a way to an end) it does not decide on graphs with cycles.
//! The decisions are the code's own (`meeting::rules`, `succession`); the order of the accesses is written out again, with the names of the
//! functions they stand in. Each flaw is a line that somebody could write in good faith; the search must find what it breaks.

mod chain;
mod meeting;
mod search;
