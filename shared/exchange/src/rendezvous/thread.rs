//! The Rendezvous between threads of one process.

use super::{Client, MAX_SERVED, RendezvousError, Server, check_length};
use crossbeam::channel::{Receiver, Sender, TryRecvError, TrySendError, bounded};
use std::sync::{Arc, Weak};

/// Requests that may wait for a server; a client that finds the queue full is told that the deadline has passed.
const WAITING: usize = 32;

struct Request {
    bytes: Vec<u8>,
    /// One request, one channel: the answer to an earlier request has nowhere to go.
    answer: Sender<Vec<u8>>,
}

/// The side that asks.
#[derive(Clone)]
pub struct ThreadClient {
    requests: Sender<Request>,
    open: Option<Receiver<Vec<u8>>>,
    /// Lives as long as the server: a request may outlast it in the queue.
    server: Weak<()>,
}

/// The side that answers.
pub struct ThreadServer {
    requests: Receiver<Request>,
    _life: Arc<()>,
}

/// A server and its first client; further clients are clones.
pub fn rendezvous() -> (ThreadClient, ThreadServer) {
    let (sender, receiver) = bounded(WAITING);
    let life = Arc::new(());
    let client = ThreadClient { requests: sender, open: None, server: Arc::downgrade(&life) };
    (client, ThreadServer { requests: receiver, _life: life })
}

impl Client for ThreadClient {
    fn begin(&mut self, request: &[u8]) -> Result<(), RendezvousError> {
        check_length(request)?;
        let (answer, open) = bounded(1);
        self.open = Some(open);
        self.requests.try_send(Request { bytes: request.to_vec(), answer }).map_err(|error| match error {
            TrySendError::Full(_) => RendezvousError::TimedOut,
            TrySendError::Disconnected(_) => RendezvousError::ServerGone,
        })
    }

    fn poll(&mut self) -> Result<Option<Vec<u8>>, RendezvousError> {
        match self.open.as_ref().map(Receiver::try_recv) {
            Some(Ok(answer)) => {
                self.open = None;
                Ok(Some(answer))
            }
            Some(Err(TryRecvError::Disconnected)) => Err(RendezvousError::ServerGone),
            Some(Err(TryRecvError::Empty)) if self.server.strong_count() == 0 => Err(RendezvousError::ServerGone),
            Some(Err(TryRecvError::Empty)) | None => Ok(None),
        }
    }
}

impl Server for ThreadServer {
    fn serve(&mut self, answer: &mut dyn FnMut(&[u8]) -> Vec<u8>) -> Result<usize, RendezvousError> {
        let mut served = 0;
        while served < MAX_SERVED {
            let Ok(request) = self.requests.try_recv() else { break };
            let bytes = answer(&request.bytes);
            check_length(&bytes)?;
            let _ = request.answer.try_send(bytes); // a client that has gone loses its answer, the server nothing
            served += 1;
        }
        Ok(served)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::now_ns;

    const SOON_NS: u64 = 5_000_000;
    const FAR: u64 = u64::MAX / 4;

    #[test]
    fn an_answer_belongs_to_the_request_it_was_made_for() {
        let (mut client, mut server) = rendezvous();
        client.begin(&[1]).unwrap();
        client.begin(&[2]).unwrap(); // gives the first up
        assert_eq!(server.serve(&mut |request| vec![request[0] * 10]), Ok(2));
        assert_eq!(client.poll(), Ok(Some(vec![20])));
        assert_eq!(client.poll(), Ok(None));
    }

    #[test]
    fn a_client_that_dies_at_any_point_costs_the_server_nothing() {
        let (mut client, mut server) = rendezvous();
        let mut other = client.clone();
        client.begin(&[1]).unwrap();
        drop(client); // dead between request and answer
        other.begin(&[2]).unwrap();
        assert_eq!(server.serve(&mut |request| request.to_vec()), Ok(2));
        assert_eq!(other.poll(), Ok(Some(vec![2])));
    }

    #[test]
    fn a_server_that_dies_at_any_point_gives_a_typed_answer() {
        let (mut client, server) = rendezvous();
        drop(server); // dead before the request
        assert_eq!(client.ask(&[1], FAR), Err(RendezvousError::ServerGone));
        let (mut client, server) = rendezvous();
        client.begin(&[1]).unwrap();
        drop(server); // dead with the request in its queue
        assert_eq!(client.poll(), Err(RendezvousError::ServerGone));
        let (mut client, mut server) = rendezvous();
        let asked = std::thread::scope(|scope| {
            scope.spawn(move || {
                // dead while it answers
                let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    server.serve_until(FAR, &mut |_| panic!("as the test wants"))
                }));
                assert!(caught.is_err());
            });
            client.ask(&[1], FAR)
        });
        assert_eq!(asked, Err(RendezvousError::ServerGone));
    }

    #[test]
    fn a_server_that_hangs_costs_the_client_its_own_deadline() {
        let (mut client, _server) = rendezvous();
        assert_eq!(client.ask(&[1], now_ns() + SOON_NS), Err(RendezvousError::TimedOut));
        assert_eq!(client.ask(&vec![0; super::super::MAX_BYTES + 1], FAR), Err(RendezvousError::TooLong(65537)));
    }
}
