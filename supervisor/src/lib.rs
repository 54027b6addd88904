//! The station's keeper: the guardian (`hystation run`), the supervisor that it starts, and the commands that look at a running station.
//! It links no simulation and no graphics: what can crash lives in the engines, each a process of its own.

pub mod accounts;
pub mod active;
pub mod campaign;
pub mod clean;
pub mod cli;
pub mod commands;
pub mod control;
pub mod corrupt;
pub mod fault;
pub mod faultfile;
pub mod faults;
pub mod growth;
pub mod guardian;
pub mod intent;
pub mod journal;
pub mod keepers;
pub mod ledger;
pub mod lockstep;
pub mod mischief;
pub mod moment;
pub mod name;
pub mod notify;
pub mod plan;
pub mod policy;
pub mod proc;
pub mod remains;
pub mod report;
pub mod settings;
pub mod shortage;
pub mod spawn;
pub mod supervise;
pub mod suspicion;
pub mod swap;
pub mod view;
pub mod watch;
