//! The chain of states: the newest accepted one, held in place, whoever computed it.

use hyst_exchange::succession::{Key, supersedes};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port};
use hyst_exchange::{Held, LinkError, Subscriber, Tenure};
use hyst_messages::page::device::Distrust;
use hyst_messages::{Kind, Message, Slot, StreamHeader};

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
        accepts: impl Fn(&[u8], bool) -> bool,
        blame: impl Fn(u32, Distrust),
        lives: impl Fn(u32) -> bool,
    ) -> Refused {
        let mut refused = Refused::default();
        for link in &mut self.links {
            // A stream that fails is a stream without news; its writer's death is seen elsewhere.
            let Ok(Some(held)) = link.subscriber.newest() else { continue };
            let other = link.slot.map(|_| link.subscriber.incarnation());
            let blamed = |why| other.into_iter().for_each(|writer| blame(writer, why));
            let Ok(message) = Message::parse(held.bytes(), kind) else {
                refused.invalid += 1;
                blamed(Distrust::Invalid);
                continue;
            };
            let header = *message.header();
            if header.is_shadow() {
                let accepts = |state: &[u8]| accepts(state, other.is_none());
                if !extend_line(&mut self.line, self.guest, held, header, &fence, accepts) {
                    refused.invalid += 1;
                    blamed(Distrust::Invalid);
                }
                continue;
            }
            let key = (header.epoch, header.tick);
            // One stamp that is too high would make everything after it old.
            if (fence.is_ahead)(key) {
                refused.invalid += 1;
                blamed(Distrust::Invalid);
                continue;
            }
            if link.lags(&header, fence.holder) || key <= link.last {
                refused.stale += 1;
                blamed(Distrust::Still);
                continue;
            }
            link.last = key;
            if !supersedes(key, self.newest.is_some().then_some(self.key)) {
                // A substitute and the original carry the same key; that is not stale, and whichever came first counts.
                refused.stale += u64::from(header.epoch < self.key.0);
                continue;
            }
            if !accepts(held.bytes(), other.is_none()) {
                refused.invalid += 1;
                blamed(Distrust::Invalid);
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

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::usher::usher;
    use hyst_exchange::{Links, Publisher, Station};
    use hyst_messages::{MessageMut, Role};

    const KIND: Kind = Kind::FluidState;
    const ROUNDS: u64 = 40;

    /// A chain of one incarnation that reads the stream of the next one too, and both writers. A process has one station at a time.
    fn on_a_chain(own: u32, body: impl FnOnce(&mut Chain, &mut Inbox, [Publisher; 2])) {
        static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
        let _one = ONE.lock();
        let station = Station::named(&format!("t{}-chain", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        {
            let links = Links::join(&station, &format!("test-{own}")).unwrap();
            let both = [own, own + 1];
            let services = both.map(|incarnation| links.create_service(Role::Fluid, incarnation, KIND).unwrap());
            let writers = both.map(|incarnation| links.publisher(Role::Fluid, incarnation, KIND, bytes()).unwrap());
            let [own, other] = both.map(|incarnation| links.subscriber(Role::Fluid, incarnation, KIND).unwrap());
            other.connect().unwrap();
            let mut inbox: Inbox = usher(&station, None, 1, Vec::new()).unwrap();
            let mut chain = Chain::new(own).unwrap();
            let slot = Slot::new(Role::Fluid, 1).unwrap();
            chain.add(Arrival { slot, incarnation: both[1], port: Port::Stream(KIND, other) }, &mut inbox);
            body(&mut chain, &mut inbox, writers);
            drop((chain, inbox, services));
        }
        station.wipe();
    }

    fn bytes() -> usize {
        hyst_messages::stream::message_bytes(&[8])
    }

    fn send(writer: &Publisher, tick: u64, epoch: u32, incarnation: u32) {
        let mut loan = writer.loan(bytes()).unwrap();
        let header = StreamHeader { tick, epoch, incarnation, ..Default::default() };
        MessageMut::format(loan.bytes_mut(), KIND, header, &[8]).unwrap();
        loan.send().unwrap();
    }

    /// By a clock that is ahead of everything.
    fn fence(holder: Tenure) -> Fence<'static> {
        Fence { holder, is_ahead: &|_| false }
    }

    /// Holder and spare substitute each other's steps faster than the usher looks.
    #[test]
    fn states_that_alternate_between_two_living_writers_are_all_received() {
        on_a_chain(1, |chain, inbox, writers| {
            for tick in 1..=ROUNDS {
                let writer = (tick % 2) as usize;
                send(&writers[writer], tick, 1, writer as u32 + 1);
                chain.receive(KIND, inbox, fence(Tenure::default()), |_, _| true, |_, why| panic!("{why:?}"), |_| true);
                assert_eq!(chain.key(), (1, tick));
            }
        });
    }

    /// A reader that is as young as the lie has seen no other epoch of this writer: the roster knows better.
    #[test]
    fn a_holder_that_writes_under_an_epoch_before_its_own_is_blamed_by_a_newcomer_too() {
        on_a_chain(3, |chain, inbox, writers| {
            let mut blamed_at = |told: &dyn Fn(u64) -> u32, holds: &dyn Fn(u64) -> u32, ticks: std::ops::Range<u64>| {
                let blamed = std::cell::Cell::new(Vec::new());
                for tick in ticks {
                    let holder = Tenure { epoch: holds(tick), incarnation: 4 };
                    send(&writers[1], tick, told(tick), holder.incarnation);
                    let blame = |_, _| blamed.set([blamed.take(), vec![tick]].concat());
                    chain.receive(KIND, inbox, fence(holder), |_, _| true, blame, |_| true);
                }
                blamed.take()
            };
            assert_eq!(blamed_at(&|_| 8, &|_| 9, 1..4), vec![3], "the third of them");
            assert_eq!(blamed_at(&|_| 9, &|_| 9, 4..8), Vec::<u64>::new(), "it tells the truth again");
            let leaps = |tick: u64| 9 + tick as u32;
            assert_eq!(
                blamed_at(&leaps, &|tick| leaps(tick) + 1, 8..20),
                Vec::<u64>::new(),
                "each of its states was on its way when it took the role again"
            );
            assert_eq!(blamed_at(&|_| 8, &|_| 40, 20..22), vec![20, 21], "a stamp that goes back");
        });
    }
    /// One stamp far ahead, by a flipped bit: the states after it are taken as if it had never been.
    #[test]
    fn a_stamp_ahead_of_its_time_shuts_out_nothing_that_comes_after_it() {
        on_a_chain(1, |chain, inbox, writers| {
            for tick in 1..=ROUNDS {
                let (epoch, stamp) = match tick % 5 {
                    2 => (1 + (1 << 20), tick),
                    4 => (1, tick + (1 << 40)),
                    _ => (1, tick),
                };
                send(&writers[1], stamp, epoch, 2);
                let blamed = std::cell::Cell::new(None);
                let is_ahead = |key| hyst_exchange::succession::is_ahead(key, 1, tick, 1);
                let blame = |_, why| blamed.set(Some(why));
                let refused = chain.receive(
                    KIND,
                    inbox,
                    Fence { holder: Tenure { epoch: 1, incarnation: 2 }, is_ahead: &is_ahead },
                    |_, _| true,
                    blame,
                    |_| true,
                );
                let is_honest = (epoch, stamp) == (1, tick);
                assert_eq!((refused.invalid, blamed.get()), if is_honest { (0, None) } else { (1, Some(Distrust::Invalid)) });
                assert_eq!(chain.key() == (1, tick), is_honest, "{tick}");
            }
        });
    }

    /// The same of what an elder computes beside a newcomer on trial: the line took it, and grew no more.
    #[test]
    fn a_state_beside_the_role_that_is_ahead_of_its_time_does_not_end_the_line() {
        const BESIDE: u32 = hyst_messages::tolerance::SHADOW_EPOCH;
        on_a_chain(1, |chain, inbox, writers| {
            chain.expect_guest(2);
            let mut line_after = |incarnation: u32, tick: u64, epoch: u32| {
                send(&writers[incarnation as usize - 1], tick, epoch, incarnation);
                let is_ahead = |key| hyst_exchange::succession::is_ahead(key, 2, ROUNDS, 1);
                let fence = Fence { holder: Tenure { epoch: 2, incarnation: 2 }, is_ahead: &is_ahead };
                let refused = chain.receive(KIND, inbox, fence, |_, _| true, |_, _| {}, |_| true);
                (refused.invalid, chain.line().map(|line| line.tick))
            };
            assert_eq!(line_after(1, 1, 1), (0, None), "the role's state before the trial");
            assert_eq!(line_after(2, 2, 2), (0, Some(1)), "the newcomer has the role");
            assert_eq!(line_after(1, 2, BESIDE), (0, Some(2)));
            assert_eq!(line_after(1, 3 + (1 << 40), BESIDE), (1, Some(2)));
            assert_eq!(line_after(1, 3, BESIDE), (0, Some(3)), "and the line goes on");
            assert_eq!(line_after(2, 4, BESIDE), (0, Some(3)), "the newcomer's own is the judge's");
        });
    }
}
