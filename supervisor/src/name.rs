//! Who may work on a station: its guardian has the station's name, an abstract socket that belongs to one living process and goes with it, leaving no file;
//! its supervisor has a lock on a file in the station's root, so that two never work at once. The name is there before the root is, and anybody on the
//! machine could take it; the root is closed to others.

use hyst_exchange::{Station, system};
use rustix::fd::OwnedFd;
use rustix::fs::FlockOperation;
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use std::fs::File;
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};

fn name_of(station: &Station) -> String {
    format!("hystation-{}-{}", system::user_id(), station.name())
}

/// A connection to whoever has the name; who does not take it at once is not waited for.
fn connect(station: &Station) -> std::io::Result<OwnedFd> {
    let socket = net::socket_with(AddressFamily::UNIX, SocketType::STREAM, SocketFlags::NONBLOCK | SocketFlags::CLOEXEC, None)?;
    net::connect(&socket, &SocketAddrUnix::new_abstract_name(name_of(station).as_bytes())?)?;
    Ok(socket)
}

/// Takes the station's name for as long as the listener lives; `None` if somebody has it.
pub fn take(station: &Station) -> std::io::Result<Option<UnixListener>> {
    match UnixListener::bind_addr(&SocketAddr::from_abstract_name(name_of(station))?) {
        Ok(listener) => {
            listener.set_nonblocking(true)?;
            Ok(Some(listener))
        }
        Err(error) if error.kind() == ErrorKind::AddrInUse => Ok(None),
        Err(error) => Err(error),
    }
}

/// Knocks at the name: a stand-in takes it as the request to make room.
pub fn knock(station: &Station) -> std::io::Result<()> {
    connect(station).map(drop)
}

/// The user whose process has the name, if it is another one. It is a knock too.
pub fn stranger(station: &Station) -> Option<u32> {
    let holder = net::sockopt::socket_peercred(connect(station).ok()?).ok()?.uid.as_raw();
    (holder != system::user_id()).then_some(holder)
}

/// Whether one of this user has knocked.
pub fn was_knocked(listener: &UnixListener) -> bool {
    // Bounded by the listener's queue.
    while let Ok((stream, _)) = listener.accept() {
        if crate::control::is_own(&stream) {
            return true;
        }
    }
    false
}

/// The supervisor's lock for as long as the file is open; `None` if somebody has it.
pub fn lock(station: &Station) -> std::io::Result<Option<File>> {
    let file = File::options().write(true).create(true).truncate(false).open(station.root().join("supervisor.lock"))?;
    match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(file)),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was given up is free at once, unless another test began a child at that moment: until it executes its program it has all that is open here.
    fn once_free<T>(attempt: impl Fn() -> Option<T>) -> Option<T> {
        let deadline_ns = system::now_ns() + 60_000_000_000;
        loop {
            match attempt() {
                None if system::now_ns() < deadline_ns => std::thread::yield_now(),
                taken => return taken,
            }
        }
    }

    #[test]
    fn a_name_has_one_holder_and_is_free_when_he_is_gone() {
        let station = Station::named(&format!("t{}-name", std::process::id())).unwrap();
        let held = take(&station).unwrap().unwrap();
        assert!(take(&station).unwrap().is_none());
        assert!(!was_knocked(&held));
        knock(&station).unwrap();
        assert!(was_knocked(&held) && !was_knocked(&held));
        assert_eq!(stranger(&station), None, "it is one of this user");
        drop(held);
        assert!(once_free(|| take(&station).unwrap()).is_some());
    }

    #[test]
    fn a_station_has_one_supervisor_and_its_lock_is_free_when_that_is_gone() {
        let station = Station::named(&format!("t{}-lock", std::process::id())).unwrap();
        std::fs::create_dir_all(station.root()).unwrap();
        let held = lock(&station).unwrap().unwrap();
        assert!(lock(&station).unwrap().is_none());
        drop(held);
        assert!(once_free(|| lock(&station).unwrap()).is_some());
        std::fs::remove_dir_all(station.root()).unwrap();
        assert!(lock(&station).is_err(), "no station, no lock");
    }
}
