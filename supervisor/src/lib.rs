//! The station's keeper: the guardian (`hystation run`), the supervisor that it starts, and the commands that look at a running station.
//! It links no simulation and no graphics: what can crash lives in the engines, each a process of its own.
//!
//! Public is what `main.rs`, the tests and the examples name; the compiler finds what nobody calls of the rest.

pub mod campaign;
pub mod cli;
pub mod commands;
pub mod control;
pub mod intent;
pub mod policy;
pub mod proc;

mod accounts;
mod active;
mod build;
mod case;
mod clean;
mod corrupt;
mod doing;
mod fault;
mod faultfile;
mod faults;
mod growth;
mod guardian;
mod interrupt;
mod journal;
mod keepers;
mod ledger;
mod limits;
mod lockstep;
mod mischief;
mod moment;
mod name;
mod neighbours;
mod notify;
mod oom;
mod plan;
mod recorded;
mod recording;
mod remains;
mod report;
mod settings;
mod shipped;
mod shortage;
mod spawn;
mod standstill;
mod struck;
mod supervise;
mod suspicion;
mod swap;
mod terminal;
mod toil;
mod view;
mod watch;

use std::io::Write;

/// Says a line on stderr. A terminal that has gone, as that of a line over SSH which was cut, takes none: who says it goes on all the same.
pub(crate) fn warn(line: &str) {
    let _ = writeln!(std::io::stderr(), "hystation: {line}");
}
