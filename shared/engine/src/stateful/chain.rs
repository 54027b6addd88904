//! The chain of states: the newest accepted one, held in place, whoever computed it.

use hyst_exchange::usher::{Arrival, Departure, Inbox, Port};
use hyst_exchange::{Held, LinkError, Subscriber};
use hyst_messages::{Kind, Message, Slot};

/// Streams of one role that may be read at once: own, and each slot's present and former incarnation.
const MAX_STREAMS: usize = 6;

/// What one look at the streams refused.
#[derive(Clone, Copy, Debug, Default)]
pub struct Refused {
    pub stale: u64,
    pub invalid: u64,
}

struct Link {
    slot: Option<Slot>,
    subscriber: Subscriber,
}

/// The streams of a role's states and the newest state.
pub struct Chain {
    links: Vec<Link>,
    newest: Option<Held>,
    key: (u32, u64),
    writer: u32,
}

impl Chain {
    /// Begins with the own stream: what this process publishes, it reads back in place.
    pub fn new(own: Subscriber) -> Result<Chain, LinkError> {
        own.connect()?;
        let mut links = Vec::with_capacity(MAX_STREAMS);
        links.push(Link { slot: None, subscriber: own });
        Ok(Chain { links, newest: None, key: (0, 0), writer: 0 })
    }

    pub fn wants(&self, arrival: &Arrival, kind: Kind) -> bool {
        matches!(arrival.port, Port::Stream(found, _) if found == kind)
    }

    /// Adds a newcomer's stream and retires its predecessor's.
    pub fn add(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let Port::Stream(_, subscriber) = arrival.port else { return };
        if let Some(at) = self.links.iter().position(|link| link.slot == Some(arrival.slot)) {
            let old = self.links.swap_remove(at);
            inbox.retire(Departure::Stream(old.subscriber));
        }
        if self.links.len() < MAX_STREAMS {
            self.links.push(Link { slot: Some(arrival.slot), subscriber });
        }
    }

    /// Takes the newest state of all streams: the highest (epoch, tick) that `accepts` agrees to.
    pub fn receive(&mut self, kind: Kind, inbox: &mut Inbox, accepts: impl Fn(&[u8]) -> bool) -> Refused {
        let mut refused = Refused::default();
        for link in &self.links {
            // A stream that fails is a stream without news; its writer's death is seen elsewhere.
            let Ok(Some(held)) = link.subscriber.newest() else { continue };
            let Ok(message) = Message::parse(held.bytes(), kind) else {
                refused.invalid += 1;
                continue;
            };
            let header = *message.header();
            let key = (header.epoch, header.tick);
            if key <= self.key && self.newest.is_some() {
                // A substitute and the original carry the same key; that is not stale, and whichever came first counts.
                refused.stale += u64::from(header.epoch < self.key.0);
                continue;
            }
            if !accepts(held.bytes()) {
                refused.invalid += 1;
                continue;
            }
            let before = self.newest.replace(held);
            if self.writer != header.incarnation
                && let Some(before) = before
            {
                inbox.retire(Departure::Message(before));
            }
            (self.key, self.writer) = (key, header.incarnation);
        }
        refused
    }

    pub fn newest(&self) -> Option<&Held> {
        self.newest.as_ref()
    }

    /// Incarnation that wrote the newest state.
    pub fn writer(&self) -> u32 {
        self.writer
    }

    /// Epoch and tick of the newest state.
    pub fn key(&self) -> (u32, u64) {
        self.key
    }
}
