//! A station's names: abstract sockets that belong to one living process and go with it, leaving no file. The guardian's name is the station's;
//! the supervisor has one of its own, so that two never work at once.

use hyst_exchange::{Station, system};
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

/// Whose name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holder {
    /// The guardian's.
    Guardian,
    /// The supervisor's.
    Supervisor,
}

fn address(station: &Station, holder: Holder) -> std::io::Result<SocketAddr> {
    let suffix = match holder {
        Holder::Guardian => "",
        Holder::Supervisor => "/supervisor",
    };
    SocketAddr::from_abstract_name(format!("hystation-{}-{}{suffix}", system::user_id(), station.name()))
}

/// Takes a name for as long as the listener lives; `None` if somebody has it.
pub fn take(station: &Station, holder: Holder) -> std::io::Result<Option<UnixListener>> {
    match UnixListener::bind_addr(&address(station, holder)?) {
        Ok(listener) => {
            listener.set_nonblocking(true)?;
            Ok(Some(listener))
        }
        Err(error) if error.kind() == ErrorKind::AddrInUse => Ok(None),
        Err(error) => Err(error),
    }
}

/// Knocks at a name: a stand-in takes it as the request to make room.
pub fn knock(station: &Station, holder: Holder) -> std::io::Result<()> {
    UnixStream::connect_addr(&address(station, holder)?).map(drop)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_has_one_holder_and_is_free_when_he_is_gone() {
        let station = Station::named(&format!("t{}-name", std::process::id())).unwrap();
        let held = take(&station, Holder::Guardian).unwrap().unwrap();
        assert!(take(&station, Holder::Guardian).unwrap().is_none());
        assert!(take(&station, Holder::Supervisor).unwrap().is_some());
        assert!(!was_knocked(&held));
        knock(&station, Holder::Guardian).unwrap();
        assert!(was_knocked(&held) && !was_knocked(&held));
        drop(held);
        assert!(take(&station, Holder::Guardian).unwrap().is_some());
        assert!(knock(&station, Holder::Supervisor).is_err(), "nobody there");
    }
}
