//! What the console reads of the engines, in place: rendering's pictures while somebody looks, the pages of rendering, tissue, fluid and hardware, and of a station
//! with a case that of the device. Its usher opens them.

use crate::look::{Pictures, Tissue};
use crate::picture::Picture;
use crate::pump::Pump;
use hyst_engine::{Failure, Helper, Helpers, Life, said_of_pump};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Horizon, Links, ReadPage, Roster, StationPage, Subscriber, system};
use hyst_messages::page::{device, hardware, header, rendering, tissue};
use hyst_messages::{AppliedRecord, FluidStatus, Kind, Role, Shown, TissueStatus};

/// Fluids, and tissues: holder, spare and a newcomer on trial.
const FLUIDS: usize = Role::Fluid.slots().1;
const TISSUES: usize = Role::Tissue.slots().1;

/// The ports.
#[derive(Debug)]
pub struct Sources {
    inbox: Inbox,
    /// Its usher, which is looked at in each step.
    pub helpers: Helpers,
    pictures: Option<Subscriber>,
    rendering: Option<ReadPage>,
    /// Of the fluids.
    horizon: Horizon,
    clock: StationPage,
    fluids: [Option<ReadPage>; FLUIDS],
    /// The pressure, as it is shown.
    shown: Shown,
    hardware: Option<ReadPage>,
    /// With its incarnation.
    tissues: [Option<(u32, ReadPage)>; TISSUES],
    /// The life of the device, and before it the one before, of which the last ticks may not be read yet.
    devices: [Option<ReadPage>; 2],
}

impl Sources {
    /// Asks the usher for everything that is of interest: more of a session that is judged.
    pub fn open(life: &Life, is_judged: bool) -> Result<Sources, Failure> {
        let links = Links::join(&life.station, &life.slot.to_string())?;
        let mut interests = vec![
            (Role::Rendering, Wanted::Stream(Kind::Picture)),
            (Role::Rendering, Wanted::Page),
            (Role::Fluid, Wanted::Page),
            (Role::Hardware, Wanted::Page),
            (Role::Tissue, Wanted::Page),
        ];
        if is_judged {
            interests.push((Role::Device, Wanted::Page));
        }
        let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
        Ok(Sources {
            helpers: Helpers::of([Helper::usher(inbox.rounds())]),
            inbox,
            pictures: None,
            rendering: None,
            horizon: Horizon::open(&life.station, Role::Fluid)?,
            clock: life.station.open()?,
            fluids: Default::default(),
            shown: Shown::default(),
            hardware: None,
            tissues: Default::default(),
            devices: Default::default(),
        })
    }

    /// Takes what the usher has brought.
    pub fn welcome(&mut self) {
        while let Some(arrival) = self.inbox.take() {
            if let Some(before) = self.seat(arrival) {
                self.inbox.retire(before);
            }
        }
    }

    fn seat(&mut self, arrival: Arrival) -> Option<Departure> {
        let index = arrival.slot.index();
        match (arrival.slot.role(), arrival.port) {
            (Role::Rendering, Port::Stream(_, stream)) => self.pictures.replace(stream).map(Departure::Stream),
            (Role::Rendering, Port::Page(page)) => self.rendering.replace(page).map(Departure::Page),
            (Role::Fluid, Port::Page(page)) => self.fluids[index.min(FLUIDS - 1)].replace(page).map(Departure::Page),
            (Role::Hardware, Port::Page(page)) => self.hardware.replace(page).map(Departure::Page),
            (Role::Tissue, Port::Page(page)) => {
                let before = self.tissues[index.min(TISSUES - 1)].replace((arrival.incarnation, page));
                before.map(|(_, page)| Departure::Page(page))
            }
            (Role::Device, Port::Page(page)) => {
                let before = self.devices[1].replace(page);
                std::mem::replace(&mut self.devices[0], before).map(Departure::Page)
            }
            _ => None, // none was asked for
        }
    }

    /// What the newest of the fluids says, as far as it can be.
    pub fn fluid(&self) -> Option<FluidStatus> {
        said_of_pump(&self.fluids, &self.horizon, &self.clock)
    }

    /// What the tissue says that holds the role.
    pub fn tissue(&self, roster: &Roster) -> Option<TissueStatus> {
        let holder = roster.holder(Role::Tissue).incarnation;
        let (_, page) = self.tissues.iter().flatten().find(|(incarnation, _)| *incarnation == holder)?;
        page.cell(tissue::STATUS).map(|(_, status)| status)
    }

    /// What the newest of the tissues says.
    pub fn cutting(&self) -> Option<Tissue> {
        let says = self.tissues.iter().flatten().filter_map(|(_, page)| page.cell(tissue::STATUS)).map(|(_, status)| status);
        says.filter(|status| status.state_tick > 0).max_by_key(|status| status.state_tick).map(|status| Tissue::new(&status))
    }

    /// Gives the device's ticks from this one on, as far as its rings hold them.
    pub fn ticks(&self, from: u64, mut take: impl FnMut(&AppliedRecord)) {
        for page in self.devices.iter().flatten() {
            let end = page.ring_end(device::APPLIED);
            let oldest = end.saturating_sub(device::APPLIED.entries as u64);
            (oldest.max(from)..end).filter_map(|tick| page.ring(device::APPLIED, tick)).for_each(|record| take(&record));
        }
    }

    /// How many of the device's ticks from this one on its rings hold no more, and nobody gives.
    pub fn gone_ticks(&self, from: u64) -> u64 {
        let (mut gone, mut from) = (0, from);
        for page in self.devices.iter().flatten() {
            let end = page.ring_end(device::APPLIED);
            gone += end.saturating_sub(device::APPLIED.entries as u64).saturating_sub(from);
            from = from.max(end);
        }
        gone
    }

    /// What the newest of the fluids says of the pump at a tick, the pressure as the mean over a second, and the hardware of what is set.
    pub fn pump(&mut self, tick: u64) -> Option<Pump> {
        let newest = self.fluid()?;
        let shown = self.shown.show(&newest);
        let sample = self.hardware.as_ref().and_then(|page| page.cell(hardware::SAMPLE)).map(|(_, sample)| sample);
        Pump::new(&shown, sample.as_ref(), tick)
    }

    /// What rendering says of its pictures. Of one that died they are as old as they are.
    pub fn drawn(&self) -> Option<Pictures> {
        let page = self.rendering.as_ref()?;
        let (_, status) = page.cell(rendering::STATUS)?;
        Pictures::new(&status, page.load64(header::VALUE_NS), system::now_ns())
    }

    /// The newest picture that was not yet read. A message that is none is counted.
    pub fn picture(&self, life: &Life) -> Option<Picture> {
        // A stream that fails has lost its writer; its successor's comes through the usher.
        let held = self.pictures.as_ref()?.newest().ok()??;
        let picture = Picture::encode(held.bytes());
        if picture.is_none() {
            life.page.add64(header::INVALID, 1);
        }
        picture
    }
}
