//! What the console reads of the engines, in place: rendering's pictures while somebody looks, the fluid's and the hardware's pages. Its usher opens
//! them.

use crate::look::Pump;
use crate::picture::Picture;
use hyst_engine::{Failure, Life};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Links, ReadPage, Subscriber};
use hyst_messages::page::{fluid, hardware, header};
use hyst_messages::{Kind, Role};

/// Fluids: holder, spare and a newcomer on trial.
const FLUIDS: usize = Role::Fluid.slots().1;

/// The ports.
#[derive(Debug)]
pub struct Sources {
    inbox: Inbox,
    pictures: Option<Subscriber>,
    fluids: [Option<ReadPage>; FLUIDS],
    hardware: Option<ReadPage>,
}

impl Sources {
    /// Asks the usher for everything that is of interest.
    pub fn open(life: &Life) -> Result<Sources, Failure> {
        let links = Links::join(&life.station, &life.slot.to_string())?;
        let interests =
            vec![(Role::Rendering, Wanted::Stream(Kind::Picture)), (Role::Fluid, Wanted::Page), (Role::Hardware, Wanted::Page)];
        let inbox = usher(&life.station, Some(links), life.incarnation, interests)?;
        Ok(Sources { inbox, pictures: None, fluids: Default::default(), hardware: None })
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
        let index = arrival.slot.index().min(FLUIDS - 1);
        match (arrival.slot.role(), arrival.port) {
            (Role::Rendering, Port::Stream(_, stream)) => self.pictures.replace(stream).map(Departure::Stream),
            (Role::Fluid, Port::Page(page)) => self.fluids[index].replace(page).map(Departure::Page),
            (Role::Hardware, Port::Page(page)) => self.hardware.replace(page).map(Departure::Page),
            _ => None, // none was asked for
        }
    }

    /// What the newest of the fluids says of the pump, and the hardware of what is set.
    pub fn pump(&self) -> Option<Pump> {
        let statuses = self.fluids.iter().flatten().filter_map(|page| page.cell(fluid::STATUS)).map(|(_, status)| status);
        let newest = statuses.filter(|status| status.state_tick > 0).max_by_key(|status| (status.epoch, status.state_tick))?;
        let sample = self.hardware.as_ref().and_then(|page| page.cell(hardware::SAMPLE)).map(|(_, sample)| sample);
        Pump::new(&newest, sample.as_ref())
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
