//! Where the recorder's data come from: the servos' force streams and what they went on from, the rings of the device's lives, the statuses of tissue and fluid,
//! rendering's pictures, and what the device on the desk states of itself.

use hyst_engine::{Failure, Helper, Helpers, Life};
use hyst_exchange::stream::READER_BUFFER;
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Links, ReadPage, Roster, Subscriber, system};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::{device, fluid, haptic, hardware, header, tissue};
use hyst_messages::{AppliedRecord, DeviceStatement, Kind, Message, OriginRecord, Role, Slot, StepRecord};
use hyst_recording::sequence::{self, RING_TICKS};
use hyst_recording::{Block, Collector, History, jpeg};
use std::cell::Cell;

/// How often the device's ring is looked at when the station stops, ns, and how often at most.
const LAST_LOOK_NS: u64 = 4_000_000;
const LAST_LOOKS: usize = 15;
/// Ticks between the newest force and the newest step that were written, at most.
const MISSED_TICKS: u64 = 400;
/// Looks without a new tick after which the device counts as stopped.
const QUIET_LOOKS: usize = 3;

/// The page of one life of the device.
struct DeviceLife {
    page: ReadPage,
    began: Cell<Option<u64>>,
}

impl History for DeviceLife {
    fn began(&self) -> Option<u64> {
        if self.began.get().is_none() {
            let end = self.end();
            let oldest = end.saturating_add(1).saturating_sub(RING_TICKS);
            self.began.set((oldest..end).find(|tick| self.read(*tick).is_some()));
        }
        self.began.get()
    }
    fn end(&self) -> u64 {
        self.page.ring_end(device::APPLIED)
    }
    fn read(&self, tick: u64) -> Option<AppliedRecord> {
        self.page.ring(device::APPLIED, tick)
    }
}

struct StatusPage {
    slot: Slot,
    incarnation: u32,
    page: ReadPage,
    seen: u64,
    /// The tick after the newest step of a tissue that was taken; of a servo the origins that were.
    next: u64,
}

impl StatusPage {
    fn note<T>(&mut self, number: u64, value: T) -> T {
        self.seen = number;
        value
    }

    /// The steps of a tissue that are new.
    fn steps(&mut self) -> impl Iterator<Item = StepRecord> + '_ {
        let end = if self.slot.role() == Role::Tissue { self.page.ring_end(tissue::STEPS) } else { 0 };
        let first = self.next.max(end.saturating_sub(tissue::STEPS.entries as u64));
        self.next = self.next.max(end);
        (first..end).filter_map(|tick| self.page.ring(tissue::STEPS, tick))
    }

    /// What answers of a servo went on from, if that is new, from a tick on.
    fn origins(&mut self, first_tick: u64) -> impl Iterator<Item = OriginRecord> + '_ {
        let end = if self.slot.role() == Role::Haptic { self.page.ring_end(haptic::ORIGINS) } else { 0 };
        let first = self.next.max(end.saturating_sub(haptic::ORIGINS.entries as u64));
        self.next = self.next.max(end);
        let found = (first..end).filter_map(|count| self.page.ring(haptic::ORIGINS, count));
        found.filter(move |origin| origin.can_be() && origin.tick >= first_tick)
    }
}

/// The records of a servo's message at a tick, if all of them can be.
fn records_of(message: &[u8], present: u64) -> Option<&[AppliedRecord]> {
    let records: &[AppliedRecord] = Message::parse(message, Kind::Force).ok()?.section(0).ok()?;
    records.iter().all(|record| record.can_be(present)).then_some(records)
}

/// All sources, and the next tick that is expected of them.
pub struct Gather {
    inbox: Inbox,
    helpers: Helpers,
    collector: Collector,
    lives: Vec<DeviceLife>,
    streams: Vec<(Slot, Subscriber)>,
    statuses: Vec<StatusPage>,
    pictures: Option<Subscriber>,
    hardware: Option<ReadPage>,
    /// Steps of tissues that have gone.
    steps: Vec<StepRecord>,
    /// Origins that wait for a tick with which they are written.
    origins: Vec<OriginRecord>,
    /// The tick from which on steps and origins are taken: a predecessor has written those before.
    first_step: u64,
}

impl Gather {
    /// Begins to look for the sources; goes on after `last_tick`.
    pub fn new(life: &Life, last_tick: Option<u64>) -> Result<Gather, Failure> {
        let links = Links::join(&life.station, &life.slot.to_string())?;
        // Pages first: they are opened at once, and a stream that takes its time to be opened holds up what comes after it.
        let interests = vec![
            (Role::Device, Wanted::Page),
            (Role::Tissue, Wanted::Page),
            (Role::Fluid, Wanted::Page),
            (Role::Hardware, Wanted::Page),
            (Role::Haptic, Wanted::Page),
            (Role::Haptic, Wanted::Stream(Kind::Force)),
            (Role::Rendering, Wanted::Stream(Kind::Picture)),
        ];
        let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
        let collector = Collector::after(last_tick);
        // It may have missed the steps of its last look; one that is written twice counts once.
        let first_step = last_tick.map_or(0, |tick| tick.saturating_sub(MISSED_TICKS));
        Ok(Gather {
            helpers: Helpers::of([Helper::usher(inbox.rounds())]),
            inbox,
            collector,
            lives: Vec::new(),
            streams: Vec::new(),
            statuses: Vec::new(),
            pictures: None,
            hardware: None,
            steps: Vec::new(),
            origins: Vec::new(),
            first_step,
        })
    }

    /// Adds everything that is new to the block.
    pub fn take(&mut self, life: &Life, roster: &Roster, block: &mut Block) {
        self.helpers.look(life);
        while let Some(arrival) = self.inbox.take() {
            self.seat(arrival);
        }
        self.read_streams(life);
        let taken = self.collector.collect(&self.lives);
        block.events.extend(sequence::lost(life.tick(), &taken.lost));
        block.applied.extend(taken.records);
        block.lost.extend(taken.lost);
        block.unmade.extend(taken.unmade);
        self.forget_lives();
        self.read_statuses(roster, block);
    }

    /// Waits until the device has made its last tick; a fraction of the time that a process has to stop.
    pub fn wait_for_last(&self) {
        let Some(newest) = self.lives.last() else {
            return;
        };
        let (mut end, mut quiet) = (newest.end(), 0);
        for _ in 0..LAST_LOOKS {
            system::sleep_ns(LAST_LOOK_NS);
            quiet = if newest.end() == end { quiet + 1 } else { 0 };
            end = newest.end();
            if quiet >= QUIET_LOOKS {
                return;
            }
        }
    }

    fn seat(&mut self, arrival: Arrival) {
        let slot = arrival.slot;
        match arrival.port {
            Port::Stream(Kind::Picture, stream) => {
                if let Some(before) = self.pictures.replace(stream) {
                    self.inbox.retire(Departure::Stream(before));
                }
            }
            Port::Stream(_, stream) => {
                if let Some(at) = self.streams.iter().position(|(owner, _)| *owner == slot) {
                    self.inbox.retire(Departure::Stream(self.streams.swap_remove(at).1));
                }
                self.streams.push((slot, stream));
            }
            Port::Page(page) if slot.role() == Role::Hardware => {
                if let Some(before) = self.hardware.replace(page) {
                    self.inbox.retire(Departure::Page(before));
                }
            }
            // The life before is kept until its ring is read to its end.
            Port::Page(page) if slot.role() == Role::Device => self.lives.push(DeviceLife { page, began: Cell::new(None) }),
            Port::Page(page) => {
                if let Some(at) = self.statuses.iter().position(|status| status.slot == slot) {
                    let mut before = self.statuses.swap_remove(at);
                    self.steps.extend(before.steps());
                    self.origins.extend(before.origins(self.first_step));
                    self.inbox.retire(Departure::Page(before.page));
                }
                let next = if slot.role() == Role::Tissue { self.first_step } else { 0 };
                self.statuses.push(StatusPage { slot, incarnation: arrival.incarnation, page, seen: 0, next });
            }
            Port::Client(..) => {} // none was asked for
        }
    }

    /// What the newest life of the hardware states of itself, and which life that is; `None` before it has, or where it cannot be used.
    pub fn stated(&self) -> Option<(u32, DeviceStatement)> {
        let page = self.hardware.as_ref()?;
        let (_, stated) = page.cell(hardware::STATEMENT)?;
        stated.check().ok().map(|()| (page.incarnation(), stated))
    }

    /// Whether somebody draws.
    pub fn has_pictures(&self) -> bool {
        self.pictures.is_some()
    }

    /// The newest picture that was not yet read, as a JPEG, and its tick. A message that is none is counted.
    pub fn picture(&self, life: &Life) -> Option<(u64, Vec<u8>)> {
        // A stream that fails has lost its writer; its successor's comes through the usher.
        let held = self.pictures.as_ref()?.newest().ok()??;
        let picture = jpeg(held.bytes());
        if picture.is_none() {
            life.page.add64(header::INVALID, 1);
        }
        picture
    }

    fn read_streams(&mut self, life: &Life) {
        for (_, stream) in &self.streams {
            for _ in 0..=READER_BUFFER {
                let Ok(Some(held)) = stream.next() else { break };
                match records_of(held.bytes(), life.tick()) {
                    Some(records) => records.iter().for_each(|record| self.collector.offer(*record)),
                    // What was in it is in the device's ring too.
                    None => life.refuse(stream.incarnation(), Distrust::Invalid),
                }
            }
        }
    }

    /// Hands back the lives that are read to their end.
    fn forget_lives(&mut self) {
        let (Some(newest), Some(next)) = (self.lives.last(), self.collector.next()) else {
            return;
        };
        if self.lives.len() > 1 && newest.began().is_some_and(|began| next > began) {
            let keep = self.lives.len() - 1;
            for old in self.lives.drain(..keep) {
                self.inbox.retire(Departure::Page(old.page));
            }
        }
    }

    /// The newest statuses of those who hold the roles, and the steps of every tissue: a spare's may be the one that counted. What servos went on from is read
    /// after the ticks, so that of each tick which is there all is known that came to its force.
    fn read_statuses(&mut self, roster: &Roster, block: &mut Block) {
        block.steps.append(&mut self.steps);
        for status in &mut self.statuses {
            block.steps.extend(status.steps());
            self.origins.extend(status.origins(self.first_step));
            let role = status.slot.role();
            if role == Role::Haptic || roster.holder(role).incarnation != status.incarnation {
                continue; // a servo has no status
            }
            if role == Role::Tissue {
                let value = status.page.cell(tissue::STATUS).filter(|(number, _)| *number != status.seen);
                block.tissue.extend(value.map(|(number, value)| status.note(number, value)));
            } else {
                let value = status.page.cell(fluid::STATUS).filter(|(number, _)| *number != status.seen);
                block.fluid.extend(value.map(|(number, value)| status.note(number, value)));
            }
        }
        if !block.applied.is_empty() {
            block.origins.append(&mut self.origins);
        }
    }
}
