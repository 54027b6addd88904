//! What systemd is told (`sd_notify`): a datagram to the socket that `NOTIFY_SOCKET` names. Without it, nothing is said.
//!
//! The protocol is that of sd_notify(3): lines of `KEY=value`. With `WATCHDOG_USEC` the guardian says at half that interval that it lives and
//! that its supervisor beats; systemd restarts it if it does not.

use hyst_exchange::system;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// The way to the service manager.
#[derive(Debug)]
pub struct Notifier {
    socket: Option<(UnixDatagram, SocketAddr)>,
    every_ns: Option<u64>,
    next_ns: u64,
}

impl Notifier {
    /// As the environment says.
    pub fn of_environment() -> Notifier {
        let text = |name: &str| std::env::var(name).ok();
        let every_ns =
            text("WATCHDOG_USEC").and_then(|us| us.parse::<u64>().ok()).filter(|us| *us > 0).map(|us| us.saturating_mul(500));
        let socket = text("NOTIFY_SOCKET").and_then(|path| Some((UnixDatagram::unbound().ok()?, address(&path)?)));
        if let Some((socket, _)) = &socket {
            let _ = socket.set_nonblocking(true); // a manager that does not read must not hold the guardian
        }
        Notifier { socket, every_ns, next_ns: 0 }
    }

    /// Whether there is a manager: this is a service.
    pub fn is_there(&self) -> bool {
        self.socket.is_some()
    }

    /// Says some lines.
    pub fn say(&self, lines: &str) {
        if let Some((socket, address)) = &self.socket {
            let _ = socket.send_to_addr(lines.as_bytes(), address); // a manager that has gone is told nothing
        }
    }

    /// Says that all is well, if that is due; `well` is asked only then.
    pub fn watchdog(&mut self, well: impl FnOnce() -> bool) {
        let now_ns = system::now_ns();
        let Some(every_ns) = self.every_ns.filter(|_| now_ns >= self.next_ns) else { return };
        self.next_ns = now_ns + every_ns;
        if well() {
            self.say("WATCHDOG=1\n");
        }
    }
}

fn address(path: &str) -> Option<SocketAddr> {
    match path.strip_prefix('@') {
        Some(name) => SocketAddr::from_abstract_name(name).ok(),
        None => SocketAddr::from_pathname(path).ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systemd_is_told_that_all_is_well_only_while_it_is_and_only_when_that_is_due() {
        let path = std::env::temp_dir().join(format!("notify-{}", std::process::id()));
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_nonblocking(true).unwrap();
        let address = address(path.to_str().unwrap()).unwrap();
        let mut notifier =
            Notifier { socket: Some((UnixDatagram::unbound().unwrap(), address)), every_ns: Some(u64::MAX / 4), next_ns: 0 };
        let told = || socket.recv(&mut [0; 64]).ok();
        notifier.watchdog(|| false);
        assert_eq!(told(), None, "the supervisor hangs");
        notifier.watchdog(|| unreachable!("it is not due"));
        notifier.next_ns = 0;
        notifier.watchdog(|| true);
        assert_eq!(told(), Some("WATCHDOG=1\n".len()));
        std::fs::remove_file(&path).unwrap();
    }
}
