//! The station's keeper: the guardian (`hystation run`), the supervisor that it starts, and the commands that look at a running station.
//! It links no simulation and no graphics: what can crash lives in the engines, each a process of its own.

pub mod accounts;
pub mod active;
pub mod clean;
pub mod cli;
pub mod commands;
pub mod control;
pub mod fault;
pub mod faultfile;
pub mod faults;
pub mod guardian;
pub mod journal;
pub mod ledger;
pub mod plan;
pub mod policy;
pub mod proc;
pub mod remains;
pub mod report;
pub mod settings;
pub mod spawn;
pub mod supervise;
pub mod view;
pub mod watch;
