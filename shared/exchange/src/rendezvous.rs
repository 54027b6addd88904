//! The Rendezvous: a client asks to exchange information without knowing the state of the server; the server answers when it is ready
//! (Tuchschmid et al. 2006, section 3). Two forms with one interface: threads (crossbeam channels) and processes (iceoryx2
//! request-response, polled).
//!
//! Guarantees. The client waits until its own deadline and no longer, and gets a typed answer. A server that dies gives `TimedOut` or
//! `ServerGone`; one that was restarted never saw the request, so the client asks again. A client that dies costs the server one dropped
//! answer. An answer to an earlier request of the same client is never taken for the present one. It costs nothing while nobody asks.

mod process;
mod thread;

pub use process::{HeldRendezvous, ProcessClient, ProcessServer};
pub use thread::{ThreadClient, ThreadServer, rendezvous};

/// Most bytes of a request or an answer.
pub const MAX_BYTES: usize = 64 * 1024;
/// Requests that one call of `serve` answers at most, so that a flood of clients cannot hold a server.
pub const MAX_SERVED: usize = 8;
/// Pause between two looks of a waiting client, ns: well under a tick, and no load to speak of.
pub const POLL_NS: u64 = 200_000;

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RendezvousError {
    /// The deadline has passed.
    #[error("no answer within the client's deadline; ask again")]
    TimedOut,
    /// There is no server, or it went away.
    #[error("the server is gone; ask its successor")]
    ServerGone,
    /// Longer than [`MAX_BYTES`].
    #[error("message of {0} bytes, at most {MAX_BYTES} are allowed; send the bulk as a stream")]
    TooLong(usize),
    /// The link failed.
    #[error("rendezvous failed: {0}")]
    Link(String),
}

/// The side that asks.
pub trait Client {
    /// Puts a request; an earlier one that is still open is given up.
    fn begin(&mut self, request: &[u8]) -> Result<(), RendezvousError>;
    /// The answer to the present request, if it is there.
    fn poll(&mut self) -> Result<Option<Vec<u8>>, RendezvousError>;
    /// Asks and waits until the deadline (CLOCK_MONOTONIC ns).
    fn ask(&mut self, request: &[u8], deadline_ns: u64) -> Result<Vec<u8>, RendezvousError> {
        self.begin(request)?;
        loop {
            if let Some(answer) = self.poll()? {
                return Ok(answer);
            }
            let now = crate::system::now_ns();
            if now >= deadline_ns {
                return Err(RendezvousError::TimedOut);
            }
            crate::system::sleep_until_ns(deadline_ns.min(now + POLL_NS));
        }
    }
}

/// The side that answers.
pub trait Server {
    /// Answers what waits, at most [`MAX_SERVED`] requests, and returns how many; never blocks.
    fn serve(&mut self, answer: &mut dyn FnMut(&[u8]) -> Vec<u8>) -> Result<usize, RendezvousError>;
    /// Waits for at least one request until the deadline, and answers.
    fn serve_until(&mut self, deadline_ns: u64, answer: &mut dyn FnMut(&[u8]) -> Vec<u8>) -> Result<usize, RendezvousError> {
        loop {
            let served = self.serve(answer)?;
            let now = crate::system::now_ns();
            if served > 0 || now >= deadline_ns {
                return Ok(served);
            }
            crate::system::sleep_until_ns(deadline_ns.min(now + POLL_NS));
        }
    }
}

fn check_length(bytes: &[u8]) -> Result<(), RendezvousError> {
    if bytes.len() > MAX_BYTES { Err(RendezvousError::TooLong(bytes.len())) } else { Ok(()) }
}
