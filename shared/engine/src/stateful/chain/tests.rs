//! Promise of the chain: what follows is received, whoever writes it, and what cannot follow shuts nothing out and is told of.

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
            chain.receive(KIND, inbox, fence(Tenure::default()), |_, _| Ok(()), |_, why| panic!("{why:?}"), |_| true);
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
                chain.receive(KIND, inbox, fence(holder), |_, _| Ok(()), blame, |_| true);
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

/// Of a healthy tissue one state was refused, and nobody could say why.
#[test]
fn of_the_last_state_that_was_refused_it_is_said_why() {
    on_a_chain(1, |chain, inbox, writers| {
        let mut refused = |tick: u64, flaw: Option<Refusal>| {
            send(&writers[1], tick, 1, 2);
            let accepts = |_: &[u8], _: bool| flaw.map_or(Ok(()), Err);
            let refused = chain.receive(KIND, inbox, fence(Tenure::default()), accepts, |_, _| {}, |_| true);
            refused.last.map(|last| (last.why, last.tick))
        };
        assert_eq!(refused(1, None), None);
        assert_eq!(refused(2, Some(Refusal::Mesh)), Some((Refusal::Mesh, 2)));
        assert_eq!(refused(2, None), Some((Refusal::Stamp, 2)));
        assert_eq!(refused(3, None), None);
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
                |_, _| Ok(()),
                blame,
                |_| true,
            );
            let is_honest = (epoch, stamp) == (1, tick);
            let last = refused.last.map(|last| (last.why, last.incarnation, last.epoch, last.tick));
            assert_eq!(last, (!is_honest).then_some((Refusal::Ahead, 2, epoch, stamp)), "it is said which, and why");
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
            let refused = chain.receive(KIND, inbox, fence, |_, _| Ok(()), |_, _| {}, |_| true);
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

/// An elder took the step of a newcomer on trial, and kept it when it had the role back.
#[test]
fn who_had_the_role_goes_on_from_the_line_until_the_newcomer_has_passed() {
    const BESIDE: u32 = hyst_messages::tolerance::SHADOW_EPOCH;
    on_a_chain(1, |chain, inbox, writers| {
        let mut base_after = |chain: &mut Chain, incarnation: u32, tick: u64, epoch: u32| {
            send(&writers[incarnation as usize - 1], tick, epoch, incarnation);
            let holder = Tenure { epoch: 2, incarnation: 2 };
            chain.receive(KIND, inbox, fence(holder), |_, _| Ok(()), |_, _| {}, |_| true);
            let header = *Message::parse(chain.base()?.bytes(), KIND).ok()?.header();
            Some((header.incarnation, header.tick))
        };
        chain.expect_guest(2);
        assert_eq!(base_after(chain, 1, 1, 1), Some((1, 1)));
        assert_eq!(base_after(chain, 2, 5, 2), Some((1, 1)), "the newcomer's longer steps are its own");
        assert_eq!(base_after(chain, 1, 2, BESIDE), Some((1, 2)));
        assert_eq!(base_after(chain, 2, 9, 2), Some((1, 2)));
        chain.end_line();
        assert_eq!(base_after(chain, 2, 13, 2), Some((2, 13)), "it has passed");
    });
}

/// One that named the old engine had the role's states from then on, and the line was its own.
#[test]
fn whose_a_state_is_its_stream_says_and_not_its_stamp() {
    const BESIDE: u32 = hyst_messages::tolerance::SHADOW_EPOCH;
    on_a_chain(1, |chain, inbox, writers| {
        chain.expect_guest(2);
        let mut line_after = |incarnation: usize, tick: u64, epoch: u32| {
            send(&writers[incarnation - 1], tick, epoch, 1);
            let holder = Tenure { epoch: 2, incarnation: 2 };
            chain.receive(KIND, inbox, fence(holder), |_, _| Ok(()), |_, _| {}, |_| true);
            (chain.writer(), chain.line().map(|line| (line.tick, line.writer)))
        };
        assert_eq!(line_after(1, 1, 1), (1, None), "the role's state before the trial");
        assert_eq!(line_after(2, 2, 2), (2, Some((1, 1))), "the newcomer has the role");
        assert_eq!(line_after(2, 3, BESIDE), (2, Some((1, 1))), "its own is the judge's");
        assert_eq!(line_after(1, 2, BESIDE), (2, Some((2, 1))), "the line is the elder's");
    });
}
