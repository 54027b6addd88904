//! What is in use of the tissues' states where some of them, or their topologies, cannot be; and that in lock-step nobody waits for those.

use super::*;
use crate::engine::FlowEngine;
use hyst_engine::Stateful;
use hyst_exchange::roster::Tenure;
use hyst_exchange::stream::HeldService;
use hyst_exchange::usher::{Arrival, Inbox, Port, usher};
use hyst_exchange::{Links, OwnedPage, Publisher, Station};
use hyst_messages::page::hardware;
use hyst_messages::stream::{change_header, message_bytes};
use hyst_messages::{HardwareSample, MessageMut, Slot, StreamHeader, WALLS_KEPT};

const KINDS: [Kind; 2] = [Kind::TissueState, Kind::Topology];
/// Sections of a state of one node and one vertex, and of a topology of nothing.
const STATE: [usize; 4] = [8, 12, 12, 12];
const TOPOLOGY: [usize; 8] = [0; 8];
/// Those of one tet.
const STATE_OF_A_TET: [usize; 4] = [8, 48, 48, 12];
const TOPOLOGY_OF_A_TET: [usize; 8] = [0, 16, 4, 0, 0, 0, 0, 48];
/// One that cannot be: it has a mark for a vertex that it lacks.
const UNFIT: [usize; 8] = [0, 0, 0, 0, 0, 0, 4, 0];
/// Incarnations of the holder of the tissue's role and of its spare.
const HOLDER: u32 = 7;
const SPARE: u32 = 8;

/// A station on a virtual clock with the streams of two tissues.
struct Bench {
    keeping: OwnedPage,
    life: Life,
    /// Of each tissue the writers of its states and of its topologies.
    writers: [[Publisher; 2]; 2],
    _services: [[HeldService; 2]; 2],
    links: Links,
}

/// A process has one station at a time.
fn on_a_bench(body: impl FnOnce(&Bench, &Station)) {
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _one = ONE.lock();
    let station = Station::named(&format!("t{}-fluid-tissues", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    std::fs::write(station.settings(), "lockstep = true\n").unwrap();
    drop(station.create_slot(Slot::first(Role::Fluid), 1).unwrap());
    {
        let keeping = station.open_for_keeping().unwrap();
        keeping.store32(station::LOCKSTEP, 1);
        keeping.store64(station::NEXT_INCARNATION, 9);
        Roster::open(&station).unwrap().promote(Role::Tissue, Tenure::default(), HOLDER).unwrap();
        let life = Life::begin(station.name(), Slot::first(Role::Fluid), 1).unwrap();
        let links = Links::join(&station, "test").unwrap();
        let each = |tissue: u32| KINDS.map(|kind| links.create_service(Role::Tissue, tissue, kind).unwrap());
        let _services = [HOLDER, SPARE].map(each);
        let writer =
            |tissue: u32, kind: Kind| links.publisher(Role::Tissue, tissue, kind, message_bytes(&STATE_OF_A_TET)).unwrap();
        let writers = [HOLDER, SPARE].map(|tissue| KINDS.map(|kind| writer(tissue, kind)));
        body(&Bench { keeping, life, writers, _services, links }, &station);
    }
    station.wipe();
}

impl Bench {
    fn stream(&self, tissue: u32, kind: Kind) -> Subscriber {
        let stream = self.links.subscriber(Role::Tissue, tissue, kind).unwrap();
        stream.connect().unwrap();
        stream
    }

    /// A reader of both.
    fn tissues(&self) -> Tissues {
        let mut tissues = Tissues::new(&self.life).unwrap();
        for (index, tissue) in [HOLDER, SPARE].into_iter().enumerate() {
            for kind in KINDS {
                assert!(tissues.replace(index, kind, self.stream(tissue, kind)).is_none());
            }
        }
        tissues
    }

    /// The sequencer has seen the tissue's step to a tick, and begun the tick.
    fn has_stepped(&self, tick: u64) {
        [station::BEGUN_TICK, station::TISSUE_TICK].iter().for_each(|word| self.keeping.store64(*word, tick));
    }

    /// Of the first tissue or the second: a state whose node is so far away, with whatever is changed of its header.
    fn send(&self, tissue: usize, tick: u64, x_m: f32, change: impl FnOnce(&mut StreamHeader)) {
        let mut loan = self.writers[tissue][0].loan(message_bytes(&STATE)).unwrap();
        let incarnation = [HOLDER, SPARE][tissue];
        let header = StreamHeader { tick, epoch: 1, incarnation, topology_version: 1, ..StreamHeader::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::TissueState, header, &STATE).unwrap();
        (0..STATE.len()).for_each(|index| message.section::<u8>(index).unwrap().fill(0));
        message.section::<f32>(1).unwrap()[0] = x_m;
        change_header(loan.bytes_mut(), change);
        loan.send().unwrap();
    }

    fn send_topology(&self, tissue: usize, version: u32, sections: [usize; 8]) {
        let mut loan = self.writers[tissue][1].loan(message_bytes(&sections)).unwrap();
        let header = StreamHeader { topology_version: version, ..StreamHeader::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Topology, header, &sections).unwrap();
        (0..sections.len()).for_each(|index| message.section::<u8>(index).unwrap().fill(0));
        loan.send().unwrap();
    }

    /// Of the first tissue: the topology of one tet, which is held.
    fn send_topology_of_a_tet(&self) {
        let mut loan = self.writers[0][1].loan(message_bytes(&TOPOLOGY_OF_A_TET)).unwrap();
        let header = StreamHeader { topology_version: 1, ..StreamHeader::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::Topology, header, &TOPOLOGY_OF_A_TET).unwrap();
        (0..TOPOLOGY_OF_A_TET.len()).for_each(|index| message.section::<u8>(index).unwrap().fill(0));
        message.section::<[u32; 4]>(1).unwrap()[0] = [0, 1, 2, 3];
        loan.send().unwrap();
    }

    /// Of the first tissue: a state in which that has a corner at (x, x, x), from where its edges go so far along the axes.
    fn send_tet(&self, tick: u64, [x_m, edge_m]: [f32; 2]) {
        let mut loan = self.writers[0][0].loan(message_bytes(&STATE_OF_A_TET)).unwrap();
        let header = StreamHeader { tick, epoch: 1, incarnation: HOLDER, topology_version: 1, ..StreamHeader::default() };
        let mut message = MessageMut::format(loan.bytes_mut(), Kind::TissueState, header, &STATE_OF_A_TET).unwrap();
        (0..STATE_OF_A_TET.len()).for_each(|index| message.section::<u8>(index).unwrap().fill(0));
        let corners_m = message.section::<[f32; 3]>(1).unwrap();
        corners_m.fill([x_m; 3]);
        (0..3).for_each(|axis| corners_m[axis + 1][axis] += edge_m);
        loan.send().unwrap();
    }

    fn refused(&self) -> u64 {
        self.life.page.load64(header::INVALID)
    }
}

fn tick_in_use(tissues: &Tissues) -> Option<u64> {
    tissues.newest().map(|(state, _)| state.header().tick)
}

/// It stood the whole run still: the step waited for a state that it would never take.
#[test]
fn a_state_that_is_refused_has_come_and_the_one_before_stays_in_use_with_its_tick() {
    on_a_bench(|bench, station| {
        let mut tissues = bench.tissues();
        bench.send_topology(0, 1, TOPOLOGY);
        let mut after = |tick: u64, sent: &dyn Fn()| {
            bench.has_stepped(tick);
            sent();
            tissues.receive(&bench.life, 33);
            tissues.receive(&bench.life, 33);
            let reached = [tick, tick + 1].map(|tick| tissues.have_reached(tick));
            (tick_in_use(&tissues), reached, bench.refused())
        };
        let as_it_is = |_: &mut StreamHeader| ();
        assert_eq!(after(33, &|| bench.send(0, 33, 0.0, as_it_is)), (Some(33), [true, false], 0));
        assert_eq!(after(66, &|| ()), (Some(33), [false, false], 0), "it is on its way");
        assert_eq!(after(66, &|| bench.send(0, 66, 11.0, as_it_is)), (Some(33), [true, false], 1), "a node metres away");
        assert_eq!(after(99, &|| bench.send(0, 99, f32::NAN, as_it_is)), (Some(33), [true, false], 2));
        let foreign = |header: &mut StreamHeader| header.layout ^= 1;
        assert_eq!(after(132, &|| bench.send(1, 132, 0.0, foreign)), (Some(33), [false, false], 3), "no holder's, of no tick");
        assert_eq!(after(132, &|| bench.send(0, 132, 0.0, foreign)), (Some(33), [true, false], 4), "of the holder's last step");
        assert_eq!(after(165, &|| bench.send(0, 1 << 40, 0.0, as_it_is)), (Some(33), [true, false], 5), "nor for ever after");
        assert_eq!(after(198, &|| bench.send(0, 198, 0.0, as_it_is)), (Some(198), [true, false], 5), "the next good one is used");
        let beside = |header: &mut StreamHeader| header.epoch = 0;
        assert_eq!(after(231, &|| bench.send(0, 231, 0.0, beside)), (Some(198), [false, false], 5), "beside the role");
        let holder = Tenure { epoch: 1, incarnation: HOLDER };
        Roster::open(station).unwrap().promote(Role::Tissue, holder, HOLDER).unwrap();
        let of_second = |header: &mut StreamHeader| header.epoch = 2;
        assert_eq!(after(264, &|| bench.send(0, 264, 0.0, of_second)), (Some(264), [true, false], 5));
        assert_eq!(after(297, &|| bench.send(0, 297, 0.0, as_it_is)), (Some(264), [true, false], 5), "of the epoch before");
    });
}

#[test]
fn a_state_is_used_once_its_topology_is_there_and_is_refused_with_it() {
    on_a_bench(|bench, _| {
        let mut tissues = bench.tissues();
        let mut look = |tick: u64| {
            bench.has_stepped(tick);
            tissues.receive(&bench.life, 33);
            (tick_in_use(&tissues), tissues.have_reached(tick))
        };
        let of = |version: u32| move |header: &mut StreamHeader| header.topology_version = version;
        bench.send(0, 33, 0.0, of(1));
        assert_eq!(look(33), (None, false), "its topology is on its way");
        bench.send_topology(0, 1, TOPOLOGY);
        assert_eq!(look(33), (Some(33), true));
        bench.send(0, 66, 0.0, of(2));
        assert_eq!(look(66), (Some(33), false), "the walls stay as they were until then");
        bench.send_topology(0, 2, UNFIT);
        assert_eq!((look(66), bench.refused()), ((Some(33), true), 1), "and none comes");
        bench.send(0, 99, 0.0, of(3));
        assert_eq!(look(99), (Some(33), false), "of another version one may come");
        bench.send_topology(1, 3, TOPOLOGY);
        assert_eq!(look(99), (Some(99), true), "from whomever");
    });
}

/// It had none until a state of that version came, and the walls stood still meanwhile.
#[test]
fn a_state_in_use_keeps_its_topology_when_the_next_one_comes_first() {
    on_a_bench(|bench, _| {
        let mut tissues = bench.tissues();
        let mut look = |tick: u64| {
            bench.has_stepped(tick);
            tissues.receive(&bench.life, 33);
            let in_use = tissues.newest().map(|(state, topology)| (state.header().tick, topology.header().topology_version));
            in_use.unwrap_or_default()
        };
        let of = |version: u32| move |header: &mut StreamHeader| header.topology_version = version;
        bench.send_topology(0, 1, TOPOLOGY);
        bench.send(0, 33, 0.0, of(1));
        assert_eq!(look(33), (33, 1));
        bench.send_topology(0, 2, TOPOLOGY);
        assert_eq!(look(33), (33, 1), "its own");
        bench.send(0, 66, 0.0, of(1));
        assert_eq!(look(66), (66, 1), "one that was computed before the cut");
        bench.send(0, 99, 0.0, of(2));
        assert_eq!(look(99), (99, 2));
        // More of them than a stream lends at a time.
        for version in 3..12 {
            bench.send_topology(0, version, TOPOLOGY);
            assert_eq!(look(99), (99, 2), "when version {version} had come");
        }
        bench.send(0, 132, 0.0, of(1));
        assert_eq!(look(132), (99, 2), "what was left is kept no longer");
        bench.send(0, 165, 0.0, of(11));
        assert_eq!(look(165), (165, 11));
        bench.send_topology(0, 12, UNFIT);
        assert_eq!((look(165), bench.refused()), ((165, 11), 1));
    });
}

/// They passed for those of the state that left nothing of the cavity, and never grew old.
#[test]
fn walls_that_are_kept_are_as_old_as_the_state_that_they_were_made_from() {
    on_a_bench(|bench, _| {
        let mut engine = FlowEngine::new(&bench.life).unwrap();
        engine.tissues = bench.tissues();
        bench.send_topology_of_a_tet();
        let all_fluid = vec![0; engine.crew.solver().model().grid.cell_count()];
        let mut walls_tick = 0;
        let mut after = |tick: u64, tet: [f32; 2]| {
            bench.has_stepped(tick);
            bench.send_tet(tick, tet);
            engine.flaws = 0;
            walls_tick = engine.update_walls(walls_tick, &all_fluid).unwrap();
            (walls_tick, engine.flaws & WALLS_KEPT != 0)
        };
        // Metres away from the fluid's box, and so large that the box lies in it.
        let (away, over_all) = ([5.0, 1.0], [-1.0, 5.0]);
        assert_eq!(after(33, away), (33, false));
        assert_eq!(after(66, over_all), (33, true), "those of before");
        assert_eq!(after(99, over_all), (33, true), "and they grow old");
        assert_eq!(after(132, away), (132, false));
        assert!(!engine.has_said_kept, "the next time is said, too");
    });
}

#[test]
fn on_a_virtual_clock_the_fluid_steps_on_and_its_spare_has_in_use_what_it_has() {
    on_a_bench(|bench, station| {
        let page = station.create_slot(Slot::first(Role::Hardware), 3).unwrap();
        let mut inbox: Inbox = usher(station, None, 1, Vec::new()).unwrap();
        let [mut holder, mut spare] = [(); 2].map(|()| FlowEngine::new(&bench.life).unwrap());
        for engine in [&mut holder, &mut spare] {
            let slot = Slot::first(Role::Tissue);
            for kind in KINDS {
                let port = Port::Stream(kind, bench.stream(HOLDER, kind));
                engine.arrival(Arrival { slot, incarnation: HOLDER, port }, &mut inbox);
            }
            let hand = Port::Page(station.read_slot(Slot::first(Role::Hardware), 3).unwrap());
            engine.arrival(Arrival { slot: Slot::first(Role::Hardware), incarnation: 3, port: hand }, &mut inbox);
        }
        bench.send_topology(0, 1, TOPOLOGY);
        for (tick, x_m, in_use) in [(33, 0.0, 33), (66, 11.0, 33), (99, f32::INFINITY, 33), (132, 0.0, 132)] {
            bench.has_stepped(tick);
            page.write(hardware::SAMPLE, &HardwareSample { hardware_tick: tick, ..HardwareSample::default() });
            assert!(!holder.is_supplied(tick - 33, tick), "the state of {tick} has not come");
            bench.send(0, tick, x_m, |_| ());
            assert!(holder.is_supplied(tick - 33, tick), "{x_m} m at {tick}");
            spare.look();
            let both = [&holder, &spare].map(|engine| tick_in_use(&engine.tissues));
            assert_eq!(both, [Some(in_use); 2], "{x_m} m at {tick}");
        }
        drop((holder, spare, inbox));
    });
}
