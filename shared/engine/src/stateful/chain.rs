//! The chain of states: the newest accepted one, held in place, whoever computed it.

#[cfg(test)]
mod tests;

use hyst_exchange::succession::{Key, supersedes};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port};
use hyst_exchange::{Held, LinkError, Subscriber, Tenure};
use hyst_messages::page::device::Distrust;
use hyst_messages::{Kind, Message, Refusal, RefusedState, Slot, StreamHeader};

/// Streams of one role that may be read at once: own, and each slot's present and former incarnation.
const MAX_STREAMS: usize = 8;

/// States in a row under an epoch before its own, which stayed the same meanwhile, for which the holder is blamed: one may have been on its way when it
/// took the role, and one that leaps at every step takes it again each time.
const BEHIND_IN_A_ROW: u32 = 3;

/// What one look at the streams refused.
#[derive(Clone, Copy, Debug, Default)]
pub struct Refused {
    pub stale: u64,
    pub invalid: u64,
    /// The last one.
    pub last: Option<RefusedState>,
}

impl Refused {
    fn note(&mut self, incarnation: u32, header: StreamHeader, why: Refusal) {
        match why.distrust() {
            Distrust::Still => self.stale += 1,
            _ => self.invalid += 1,
        }
        let StreamHeader { tick, epoch, topology_version, .. } = header;
        self.last = Some(RefusedState { why, incarnation, tick, epoch, topology_version });
    }
}

/// What the states of the role can be.
pub struct Fence<'a> {
    /// Who holds it.
    pub holder: Tenure,
    /// What nobody can have made yet; asked after the state was found.
    pub is_ahead: &'a dyn Fn(Key) -> bool,
}

struct Link {
    slot: Option<Slot>,
    subscriber: Subscriber,
    /// Epoch and tick of its newest message: a writer's only ever rise.
    last: (u32, u64),
    /// The holder's epoch, and states in a row that came from it under an epoch before that.
    behind: (u32, u32),
}

impl Link {
    /// Whether the holder has written under an epoch before its own again and again.
    fn lags(&mut self, header: &StreamHeader, holder: Tenure) -> bool {
        let is_behind = header.incarnation == holder.incarnation && header.epoch < holder.epoch;
        let before = if self.behind.0 == holder.epoch { self.behind.1 } else { 0 };
        self.behind = (holder.epoch, if is_behind { before + 1 } else { 0 });
        self.behind.1 >= BEHIND_IN_A_ROW
    }

    /// Why a state cannot follow those before it, by its stamp: one that is too high would make everything after it old.
    fn flaw_of_stamp(&mut self, header: &StreamHeader, fence: &Fence) -> Option<Refusal> {
        let key = (header.epoch, header.tick);
        match () {
            () if (fence.is_ahead)(key) => Some(Refusal::Ahead),
            () if self.lags(header, fence.holder) => Some(Refusal::Behind),
            () if key <= self.last => Some(Refusal::Stamp),
            () => None,
        }
    }
}

/// The streams of a role's states and the newest state.
pub struct Chain {
    links: Vec<Link>,
    newest: Option<Held>,
    key: (u32, u64),
    writer: u32,
    /// The incarnation that has the role on trial, 0 if none has: the role's state before it is the beginning of the line.
    guest: u32,
    line: Option<Line>,
}

/// The role's state as it went on without the newcomer on trial.
pub struct Line {
    /// The state.
    pub held: Held,
    /// Its tick, epoch (that of the role, or none) and writer.
    pub tick: u64,
    pub epoch: u32,
    pub writer: u32,
}

impl Chain {
    /// Begins with the own stream: what this process publishes, it reads back in place.
    pub fn new(own: Subscriber) -> Result<Chain, LinkError> {
        own.connect()?;
        let mut links = Vec::with_capacity(MAX_STREAMS);
        links.push(Link { slot: None, subscriber: own, last: (0, 0), behind: (0, 0) });
        Ok(Chain { links, newest: None, key: (0, 0), writer: 0, guest: 0, line: None })
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
            self.links.push(Link { slot: Some(arrival.slot), subscriber, last: (0, 0), behind: (0, 0) });
        }
    }

    /// Takes the newest state of all streams: the highest (epoch, tick) that `accepts` agrees to, which is told whether it is the own. Who sends what is
    /// not, a stamp that does not rise or is ahead of its time, or again and again an epoch before the one in which he is the holder, is blamed.
    ///
    /// The state before is dropped here if its writer `lives`, as one of the same writer always is; the usher drops those of the dead, whose memory may
    /// be unmapped with them. It must not be asked for more: it is an ordinary thread that sleeps for 20 ms, a reader may hold four messages of a
    /// stream, and while holder and spare substitute each other's steps their states alternate. A fifth would not be received, and the step from the
    /// old one computed again: a stamp that stands still, for which healthy tissues were replaced.
    pub fn receive(
        &mut self,
        kind: Kind,
        inbox: &mut Inbox,
        fence: Fence,
        accepts: impl Fn(&[u8], bool) -> Result<(), Refusal>,
        blame: impl Fn(u32, Distrust),
        lives: impl Fn(u32) -> bool,
    ) -> Refused {
        let mut refused = Refused::default();
        for link in &mut self.links {
            // A stream that fails is a stream without news; its writer's death is seen elsewhere.
            let Ok(Some(held)) = link.subscriber.newest() else { continue };
            let (writer, is_own) = (link.subscriber.incarnation(), link.slot.is_none());
            let refuse = |refused: &mut Refused, header: StreamHeader, why: Refusal| {
                refused.note(writer, header, why);
                if !is_own {
                    blame(writer, why.distrust());
                }
            };
            let Ok(message) = Message::parse(held.bytes(), kind) else {
                refuse(&mut refused, StreamHeader::default(), Refusal::Unreadable);
                continue;
            };
            // Its stream says whose it is: what a newcomer sends that names an elder would be taken for the line, or for the role's.
            let header = StreamHeader { incarnation: writer, ..*message.header() };
            if header.is_shadow() {
                let accepts = |state: &[u8]| accepts(state, is_own).is_ok();
                if !extend_line(&mut self.line, self.guest, held, header, &fence, accepts) {
                    refuse(&mut refused, header, Refusal::Ahead);
                }
                continue;
            }
            let key = (header.epoch, header.tick);
            if let Some(why) = link.flaw_of_stamp(&header, &fence) {
                refuse(&mut refused, header, why);
                continue;
            }
            link.last = key;
            if !supersedes(key, self.newest.is_some().then_some(self.key)) {
                // A substitute and the original carry the same key; that is not stale, and whichever came first counts.
                refused.stale += u64::from(header.epoch < self.key.0);
                continue;
            }
            if let Err(why) = accepts(held.bytes(), is_own) {
                refuse(&mut refused, header, why);
                continue;
            }
            let before = self.newest.replace(held);
            if self.guest != 0 && header.incarnation == self.guest && self.writer != self.guest {
                let ((epoch, tick), writer) = (self.key, self.writer);
                (self.key, self.writer) = (key, header.incarnation);
                self.line = before.map(|held| Line { held, tick, epoch, writer });
                continue;
            }
            if self.writer != header.incarnation
                && let Some(before) = before
                && !lives(self.writer)
            {
                inbox.retire(Departure::Message(before));
            }
            (self.key, self.writer) = (key, header.incarnation);
            self.line = self.line.take().filter(|_| header.incarnation == self.guest); // else an elder has the role again, and it goes on there
        }
        refused
    }

    pub fn newest(&self) -> Option<&Held> {
        self.newest.as_ref()
    }

    /// From now on this incarnation has the role on trial; 0: nobody has.
    pub fn expect_guest(&mut self, guest: u32) {
        if self.guest != 0 && guest == 0 && self.writer != self.guest {
            self.line = None;
        }
        // The one that was on trial stays known while its states are the newest: whoever takes the role back needs the line.
        if guest != 0 || self.writer != self.guest {
            self.guest = guest;
        }
    }

    /// The trial is over, and the newcomer stays.
    pub fn end_line(&mut self) {
        self.line = None;
        self.guest = 0;
    }

    /// The line: its newest state.
    pub fn line(&self) -> Option<&Line> {
        self.line.as_ref()
    }

    /// The line, if the role's newest state is still that of the newcomer on trial: what is gone on from by whoever takes the role back.
    pub fn returning(&self) -> Option<&Line> {
        self.line.as_ref().filter(|_| self.guest != 0 && self.writer == self.guest)
    }

    /// The state that this process goes on from: the newest one, or the line's as long as that is what the role goes back to.
    pub fn base(&self) -> Option<&Held> {
        self.returning().map(|line| &line.held).or(self.newest())
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

/// Goes on with the line by a state that an elder has computed beside the role, if it grows by it; the guest's own is the judge's to read. False for one of a
/// tick that is far from being there: a line that took it would grow no more, and whoever takes the role back would go on from an old state.
fn extend_line(
    line: &mut Option<Line>,
    guest: u32,
    held: Held,
    header: StreamHeader,
    fence: &Fence,
    accepts: impl Fn(&[u8]) -> bool,
) -> bool {
    let grows = header.incarnation != guest && line.as_ref().is_some_and(|line| header.tick > line.tick);
    if grows && (fence.is_ahead)((header.epoch, header.tick)) {
        return false;
    }
    if grows && accepts(held.bytes()) {
        *line = Some(Line { held, tick: header.tick, epoch: header.epoch, writer: header.incarnation });
    }
    true
}
