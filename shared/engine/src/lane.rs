//! The lane of a lock-step station: the core on which all those run who step one after the other, since a wake on another core costs several times what one
//! on the own does. The sequencer takes it and says in the station's page which it is; everyone else follows.
//!
//! Promise: no two stations of a machine share a lane, whichever cores each of them may use. Who has it holds a name of the kernel's (an abstract socket),
//! which ends with its process and leaves nothing behind. A station that finds no core free runs wherever the kernel puts it; what it computes is the same.

use crate::life::Life;
use hyst_exchange::system;
use hyst_messages::page::station;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

/// The core that a station has taken, for as long as this lives.
#[derive(Debug)]
pub struct Lane {
    core: usize,
    _name: UnixListener,
}

impl Lane {
    /// Takes the first core that no other station has and ties the calling thread to it. `None` on a machine of one core, and where all are taken.
    pub fn take() -> Option<Lane> {
        let cores = system::cores();
        let mut free = (0..cores).filter(|_| cores > 1).filter_map(|core| {
            let name = SocketAddr::from_abstract_name(name_of(core)?).ok()?;
            Some(Lane { core, _name: UnixListener::bind_addr(&name).ok()? })
        });
        free.next().filter(|lane| system::pin_to_core(lane.core))
    }

    /// What the station's page says of it.
    pub fn word(lane: Option<&Lane>) -> u64 {
        lane.map_or(0, |lane| lane.core as u64 + 1)
    }
}

/// By the kernel's number: a station that may use other cores has another one by that index.
fn name_of(core: usize) -> Option<String> {
    Some(format!("hystation-lane-{}", system::core_number(core)?))
}

/// A thread that follows the lane of its station.
#[derive(Debug, Default)]
pub struct Follower {
    word: u64,
}

impl Follower {
    /// Ties the calling thread to the lane while it belongs there, and unties it when it does no longer.
    pub fn follow(&mut self, life: &Life, belongs: bool) {
        let word = if belongs { life.clock.page().load64(station::LANE) } else { 0 };
        if word == self.word {
            return;
        }
        self.word = word;
        // Where it is refused the thread runs wherever the kernel puts it.
        let _ = word.checked_sub(1).map_or_else(system::unpin, |core| system::pin_to_core(core as usize));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_have_the_same_lane_and_one_that_is_given_back_is_taken_again() {
        let (cores, mut taken) = (system::cores(), Vec::new());
        while let Some(lane) = Lane::take() {
            taken.push(lane);
        }
        let mut own: Vec<usize> = taken.iter().map(|lane| lane.core).collect();
        own.dedup();
        // Lock-step stations of the same machine may have some.
        assert!(taken.len() < cores + 1 && own.len() == taken.len(), "{own:?} of {cores}");
        let Some(last) = taken.pop() else { return };
        let core = last.core;
        assert_eq!(Lane::word(Some(&last)), core as u64 + 1);
        drop(last);
        // A child of another test has this one's files, the names too, until it has become another program.
        let deadline_ns = system::now_ns() + 60_000_000_000;
        let again = loop {
            match Lane::take() {
                None if system::now_ns() < deadline_ns => system::sleep_ns(1_000_000),
                again => break again,
            }
        };
        assert!(again.is_some_and(|lane| lane.core == core));
        assert!(system::unpin());
    }
}
