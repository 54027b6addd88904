//! What rendering reads of the others: the ushers' ports, the newest tissue state over all tissues, the pose and the pump.
//!
//! Messages are read in place, in the memory that their writer filled; they are held for one frame, a topology and
//! the fluid's state until the next one, and a state of the tissue for one frame more whose topology is under way.

use crate::looks::Looks;
use hyst_engine::{Failure, Helper, Helpers, Life, said_of_pump};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Held, Horizon, Links, ReadPage, StationPage, Subscriber};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{console, device, hardware, recorder, tissue};
use hyst_messages::{
    FluidStatus, HardwareSample, InputRecord, Kind, MAX_FLUID_STEP_TICKS, Message, Role, StreamHeader, TissueStatus,
    topology_is_sound,
};

/// Tissues, and fluids, whose streams are read: holder, spare and a newcomer on trial.
pub const REPLICAS: usize = 3;

/// The ports.
#[derive(Debug)]
pub struct Sources {
    inbox: Inbox,
    /// Its usher, which is looked at in each step.
    pub helpers: Helpers,
    /// Of tissue and fluid.
    horizons: [Horizon; 2],
    clock: StationPage,
    states: [Option<Subscriber>; REPLICAS],
    topologies: [Option<Subscriber>; REPLICAS],
    fields: [Option<Subscriber>; REPLICAS],
    held: [Option<Held>; REPLICAS],
    tissues: [Option<ReadPage>; REPLICAS],
    fluids: [Option<ReadPage>; REPLICAS],
    hardware: Option<ReadPage>,
    device: Option<ReadPage>,
    console: Option<ReadPage>,
    recorder: Option<ReadPage>,
    /// How objects look, by rendezvous.
    pub looks: Looks,
}

/// A sample, if it says where the scope is.
pub fn sound(sample: HardwareSample) -> Option<HardwareSample> {
    let pose = &sample.pose;
    pose.position_m.iter().chain(&pose.orientation).all(|value| value.is_finite()).then_some(sample)
}

/// The newest unread message over several streams, by epoch and tick; what `is_ahead` is no state of the role.
fn newest_of(streams: &[Option<Subscriber>], kind: Kind, is_ahead: impl Fn((u32, u64)) -> bool) -> Option<(StreamHeader, Held)> {
    let mut newest: Option<(StreamHeader, Held)> = None;
    for stream in streams.iter().flatten() {
        // A stream that fails has lost its writer; its successor's comes through the usher.
        let Ok(Some(held)) = stream.newest() else { continue };
        let Ok(header) = Message::parse(held.bytes(), kind).map(|message| *message.header()) else { continue };
        let key = |header: &StreamHeader| (header.epoch, header.tick);
        if header.is_shadow() || is_ahead(key(&header)) {
            continue;
        }
        if newest.as_ref().is_none_or(|(before, _)| key(&header) > key(before)) {
            newest = Some((header, held));
        }
    }
    newest
}

impl Sources {
    /// Asks the usher for everything that is of interest.
    pub fn open(life: &Life, links: Links) -> Result<Sources, Failure> {
        let interests = vec![
            (Role::Hardware, Wanted::Page),
            (Role::Device, Wanted::Page),
            (Role::Tissue, Wanted::Page),
            (Role::Tissue, Wanted::Stream(Kind::TissueState)),
            (Role::Tissue, Wanted::Stream(Kind::Topology)),
            (Role::Tissue, Wanted::Client(Kind::Appearance)),
            (Role::Fluid, Wanted::Page),
            (Role::Fluid, Wanted::Stream(Kind::FluidState)),
            (Role::Console, Wanted::Page),
            (Role::Recorder, Wanted::Page),
        ];
        let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
        Ok(Sources {
            helpers: Helpers::of([Helper::usher(inbox.rounds())]),
            inbox,
            horizons: [Horizon::open(&life.station, Role::Tissue)?, Horizon::open(&life.station, Role::Fluid)?],
            clock: life.station.open()?,
            states: Default::default(),
            topologies: Default::default(),
            fields: Default::default(),
            held: Default::default(),
            tissues: Default::default(),
            fluids: Default::default(),
            hardware: None,
            device: None,
            console: None,
            recorder: None,
            looks: Looks::default(),
        })
    }

    /// Takes what the usher has brought.
    pub fn welcome(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            let before = self.seat(arrival);
            if let Some(before) = before {
                self.inbox.retire(before);
            }
        }
    }

    fn seat(&mut self, arrival: Arrival) -> Option<Departure> {
        let index = arrival.slot.index().min(REPLICAS - 1);
        match (arrival.slot.role(), arrival.port) {
            (Role::Hardware, Port::Page(page)) => self.hardware.replace(page).map(Departure::Page),
            (Role::Device, Port::Page(page)) => self.device.replace(page).map(Departure::Page),
            (Role::Console, Port::Page(page)) => self.console.replace(page).map(Departure::Page),
            (Role::Recorder, Port::Page(page)) => self.recorder.replace(page).map(Departure::Page),
            (Role::Tissue, Port::Page(page)) => self.tissues[index].replace(page).map(Departure::Page),
            (Role::Fluid, Port::Page(page)) => self.fluids[index].replace(page).map(Departure::Page),
            (Role::Tissue, Port::Stream(Kind::TissueState, stream)) => self.states[index].replace(stream).map(Departure::Stream),
            (Role::Tissue, Port::Stream(Kind::Topology, stream)) => self.topologies[index].replace(stream).map(Departure::Stream),
            (Role::Fluid, Port::Stream(Kind::FluidState, stream)) => self.fields[index].replace(stream).map(Departure::Stream),
            (Role::Tissue, Port::Client(Kind::Appearance, client)) => {
                self.looks.replace(index, arrival.incarnation, client);
                None
            }
            _ => None,
        }
    }

    /// Whether somebody asks for pictures: the console for the operator's page, the recorder because something happened.
    pub fn want_pictures(&self, now_ns: u64) -> bool {
        let until_ns = |page: &Option<ReadPage>, at| page.as_ref().map_or(0, |page| page.load64(at));
        until_ns(&self.console, console::PICTURES_UNTIL_NS).max(until_ns(&self.recorder, recorder::PICTURES_UNTIL_NS)) > now_ns
    }

    /// The newest tissue state that was not yet read.
    pub fn state(&self) -> Option<(StreamHeader, Held)> {
        newest_of(&self.states, Kind::TissueState, self.ahead_of(0))
    }

    /// The newest state of the Flow Engine that was not yet read.
    pub fn field(&self) -> Option<(StreamHeader, Held)> {
        newest_of(&self.fields, Kind::FluidState, self.ahead_of(1))
    }

    /// What no state of tissue or fluid can be yet: a tissue's steps are shorter than a fluid's.
    fn ahead_of(&self, index: usize) -> impl Fn((u32, u64)) -> bool + '_ {
        move |key| self.horizons[index].is_passed_by(key, MAX_FLUID_STEP_TICKS, &self.clock)
    }

    /// The topology that states of this version belong to, from whichever tissue has sent it. One that cannot be stands in nobody's way: who sent it is named.
    pub fn topology(&mut self, life: &Life, version: u32) -> Option<&Held> {
        for (stream, held) in self.topologies.iter().zip(&mut self.held) {
            let Some(stream) = stream else { continue };
            match stream.newest() {
                Ok(Some(newest)) if topology_is_sound(newest.bytes()) => *held = Some(newest),
                Ok(Some(_)) => life.refuse(stream.incarnation(), Distrust::Invalid),
                _ => {}
            }
        }
        self.held.iter().flatten().find(|held| Message::topology(held.bytes(), version).is_some())
    }

    /// Where the scope is and what the hand sets, as the hardware measures it.
    pub fn sample(&self) -> Option<HardwareSample> {
        self.hardware.as_ref()?.cell(hardware::SAMPLE).and_then(|(_, sample)| sound(sample))
    }

    /// What the servos are asked: the planes near the tip, and the force that is applied; nothing that is not finite.
    pub fn felt(&self) -> Option<InputRecord> {
        let (_, input) = self.device.as_ref()?.cell(device::INPUT)?;
        let pose = &input.sample.pose;
        pose.position_m.iter().chain(&input.applied_n).all(|value| value.is_finite()).then_some(input)
    }

    /// How far the jaws were apart when they took hold of what they hold, m, as the newest of the tissues says; 0 for none.
    pub fn hold_m(&self) -> f32 {
        self.tissue().map(|status| status.hold_m).filter(|hold_m| hold_m.is_finite()).unwrap_or(0.0)
    }

    /// Sweeps of the loop that met a limit of the mesh so far, likewise.
    pub fn cut_limits(&self) -> u32 {
        self.tissue().map_or(0, |status| status.cut_limits)
    }

    fn tissue(&self) -> Option<TissueStatus> {
        let says = self.tissues.iter().flatten().filter_map(|page| page.cell(tissue::STATUS)).map(|(_, status)| status);
        says.max_by_key(|status| status.state_tick)
    }

    /// What the newest of the fluids says of the pump, as far as it can be.
    pub fn pump(&self) -> Option<FluidStatus> {
        said_of_pump(&self.fluids, &self.horizons[1], &self.clock)
    }
}
