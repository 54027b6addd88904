//! Outputs that are wrong on request: records before they are written into a page, messages before they are sent.

use super::asked;
use crate::life::Life;
use bytemuck::Pod;
use hyst_exchange::{OwnedPage, StationError, StationPage};
use hyst_messages::mischief::{Mischief, Outlet, Request};
use hyst_messages::page::header;
use hyst_messages::stream::{change_header, kind_of};
use hyst_messages::{ContactModel, FluidStatus, ForceCommand, ForceRecord, Message, Slot, StreamHeader};
use std::ops::Range;
use std::sync::Arc;

/// How far stamps are ahead that are: within what roster and clock can reach one day.
const EPOCHS_AHEAD: u32 = 1_000;
const TICKS_AHEAD: u64 = 100_000;

/// A record that a process publishes in its page.
pub trait Output: Pod {
    /// Puts a number where it hurts.
    fn spoil(&mut self, number: f32);
    /// Takes the stamps of another one: what says when and by whom it was made.
    fn stamp_like(&mut self, other: &Self);
    /// Goes back to the epoch before, if it has one.
    fn go_back(&mut self) {}
    /// Takes stamps that are far ahead.
    fn run_ahead(&mut self);
}

impl Output for ForceRecord {
    fn spoil(&mut self, number: f32) {
        self.force_n[1] = number;
    }
    fn stamp_like(&mut self, other: &Self) {
        (self.tick, self.input_hash, self.flags) = (other.tick, other.input_hash, other.flags);
    }
    fn run_ahead(&mut self) {
        self.tick += TICKS_AHEAD;
    }
}

impl Output for ForceCommand {
    fn spoil(&mut self, number: f32) {
        self.force_n[1] = number;
    }
    fn stamp_like(&mut self, other: &Self) {
        let force_n = self.force_n;
        *self = ForceCommand { force_n, ..*other };
    }
    fn run_ahead(&mut self) {
        self.tick += TICKS_AHEAD;
    }
}

impl Output for ContactModel {
    fn spoil(&mut self, number: f32) {
        self.plane_count = self.plane_count.max(1);
        self.planes[0].normal = [0.0, 1.0, 0.0];
        (self.planes[0].point_m[0], self.planes[0].stiffness_n_m) = (number, number);
    }
    fn stamp_like(&mut self, other: &Self) {
        (self.epoch, self.incarnation) = (other.epoch, other.incarnation);
        (self.state_tick, self.input_tick) = (other.state_tick, other.input_tick);
    }
    fn go_back(&mut self) {
        self.epoch = self.epoch.saturating_sub(1);
    }
    fn run_ahead(&mut self) {
        (self.epoch, self.state_tick) = (self.epoch + EPOCHS_AHEAD, self.state_tick + TICKS_AHEAD);
    }
}

impl Output for FluidStatus {
    fn spoil(&mut self, number: f32) {
        (self.pressure_pa, self.deficit_ml) = (number, number as f64);
    }
    fn stamp_like(&mut self, other: &Self) {
        (self.epoch, self.incarnation, self.state_tick) = (other.epoch, other.incarnation, other.state_tick);
    }
    fn go_back(&mut self) {
        self.epoch = self.epoch.saturating_sub(1);
    }
    fn run_ahead(&mut self) {
        (self.epoch, self.state_tick) = (self.epoch + EPOCHS_AHEAD, self.state_tick + TICKS_AHEAD);
    }
}

/// What one output was when a request came: the content or the stamp that is told from then on.
#[derive(Debug, Default)]
pub struct Lies {
    old: Vec<u8>,
    of: Option<Request>,
}

impl Lies {
    /// For an output of at most so many bytes; outside of test mode nothing is kept.
    pub fn new(life: &Life, bytes: usize) -> Lies {
        Lies { old: Vec::with_capacity(if life.clock.test_mode() { bytes } else { 0 }), of: None }
    }

    /// The old output for a request; the first one is kept. `None` while there is nothing to tell.
    fn old(&mut self, request: &Request, now: &[u8]) -> Option<&[u8]> {
        if self.of != Some(*request) {
            if now.len() > self.old.capacity() {
                return None; // a real-time thread allocates nothing
            }
            self.old.clear();
            self.old.extend_from_slice(now);
            self.of = Some(*request);
        }
        (self.old.len() == now.len()).then_some(&self.old)
    }

    /// Spoils a record of the page as the process was asked to.
    pub fn tell<T: Output>(&mut self, life: &Life, record: &mut T) {
        let Some(request) = life.mischief().filter(|request| lies_by(request, Outlet::Cell)) else { return };
        life.own_up();
        self.tell_of(&request, record);
    }

    fn tell_of<T: Output>(&mut self, request: &Request, record: &mut T) {
        let now = *record;
        let Some(old) = self.old(request, bytemuck::bytes_of(&now)).map(bytemuck::pod_read_unaligned::<T>) else { return };
        match request.what {
            Mischief::Frozen => {
                *record = old;
                record.stamp_like(&now);
            }
            Mischief::Stamp => record.stamp_like(&old),
            Mischief::Replay => *record = old,
            Mischief::Epoch => record.go_back(),
            Mischief::Ahead => record.run_ahead(),
            Mischief::Layout => {} // that of a page is said once, when it is opened
            what => record.spoil(number_of(what)),
        }
    }

    /// Spoils a message of that output in its loan as the process was asked to.
    pub fn tell_message(&mut self, life: &Life, by: Outlet, message: &mut [u8]) {
        let Some(request) = life.mischief().filter(|request| lies_by(request, by)) else { return };
        life.own_up();
        self.tell_message_of(&request, message);
    }

    fn tell_message_of(&mut self, request: &Request, message: &mut [u8]) {
        let Some(now) = header_of(message) else { return };
        let Some(old) = self.old(request, message) else { return };
        let then = header_of(old).unwrap_or_default();
        match request.what {
            Mischief::Frozen => {
                message.copy_from_slice(old);
                change_header(message, |header| *header = now);
            }
            Mischief::Stamp => change_header(message, |header| header.tick = then.tick),
            Mischief::Replay => message.copy_from_slice(old),
            Mischief::Epoch => {
                change_header(message, |header| *header = StreamHeader { epoch: now.epoch.saturating_sub(1), ..*header });
            }
            Mischief::Ahead => change_header(message, |header| {
                (header.epoch, header.tick) = (header.epoch + EPOCHS_AHEAD, header.tick + TICKS_AHEAD);
            }),
            // As an engine would send that was built from another source: everything else in it is right.
            Mischief::Layout => change_header(message, |header| header.layout = !header.layout),
            what => spoil_sections(message, number_of(what)),
        }
    }
}

/// Whether it asks for a lie by this output.
fn lies_by(request: &Request, by: Outlet) -> bool {
    request.what.is_lie() && request.outlet.covers(by)
}

/// The lies of a thread beside the steps, by one output.
#[derive(Debug)]
pub struct Liar {
    clock: StationPage,
    page: Arc<OwnedPage>,
    slot: Slot,
    incarnation: u32,
    by: Outlet,
    lies: Lies,
    /// What it was asked when it looked last.
    seen: Option<Request>,
}

impl Life {
    /// For another thread of this process, which publishes at most so many bytes at once by this output.
    pub fn liar(&self, by: Outlet, bytes: usize) -> Result<Liar, StationError> {
        let (clock, page, lies) = (self.station.open()?, Arc::clone(&self.page), Lies::new(self, bytes));
        Ok(Liar { clock, page, slot: self.slot, incarnation: self.incarnation, by, lies, seen: None })
    }
}

impl Liar {
    fn asked(&self) -> Option<Request> {
        let request = asked(&self.clock, self.slot, |words| Request::from_words(words, self.incarnation));
        request.filter(|request| lies_by(request, self.by))
    }

    /// Whether a lie has begun or ended since the last look: who publishes on change alone does so again.
    pub fn has_turned(&mut self) -> bool {
        let now = self.asked();
        std::mem::replace(&mut self.seen, now) != now
    }

    /// Spoils a message in its loan as the process was asked to.
    pub fn tell(&mut self, message: &mut [u8]) {
        let Some(request) = self.asked() else { return };
        self.page.fetch_add64(header::MISCHIEF, 1);
        self.lies.tell_message_of(&request, message);
    }

    /// The same for bytes without a header: a number at their beginning and in their middle.
    pub fn tell_numbers(&mut self, bytes: &mut [u8]) {
        let Some(request) = self.asked() else { return };
        self.page.fetch_add64(header::MISCHIEF, 1);
        spoil(bytes, number_of(request.what));
    }
}

fn header_of(message: &[u8]) -> Option<StreamHeader> {
    Some(*Message::parse(message, kind_of(message)?).ok()?.header())
}

/// A number that no output may hold.
fn number_of(what: Mischief) -> f32 {
    match what {
        Mischief::Nan => f32::NAN,
        Mischief::Inf => f32::INFINITY,
        _ => 1.0e9,
    }
}

/// Writes a number into each section, at its beginning and in its middle; where an index stands, its bits are one far out of range.
fn spoil_sections(message: &mut [u8], number: f32) {
    for index in 0..hyst_messages::stream::MAX_SECTIONS {
        let Some(range) = section_range(message, index) else { return };
        spoil(&mut message[range], number);
    }
}

fn spoil(bytes: &mut [u8], number: f32) {
    for at in [0, bytes.len() / 8 * 4] {
        if let Some(place) = bytes.get_mut(at..at + 4) {
            place.copy_from_slice(&number.to_ne_bytes());
        }
    }
}

/// Where a section lies in its message.
fn section_range(message: &[u8], index: usize) -> Option<Range<usize>> {
    let section: &[u8] = Message::parse(message, kind_of(message)?).ok()?.section(index).ok()?;
    let start = section.as_ptr() as usize - message.as_ptr() as usize;
    Some(start..start + section.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::stream::{Kind, Message, MessageMut, WireError, message_bytes};

    fn lies() -> Lies {
        Lies { old: Vec::with_capacity(4096), of: None }
    }

    fn request(what: Mischief) -> Request {
        Request::of(what, 1)
    }

    fn force(tick: u64, newton: f32) -> ForceRecord {
        ForceRecord { tick, input_hash: tick, force_n: [0.0, newton, 0.0], ..ForceRecord::default() }
    }

    fn told(what: Mischief) -> Vec<(u64, f32)> {
        let mut lies = lies();
        let tell = |tick: u64| {
            let mut record = force(tick, tick as f32);
            lies.tell_of(&request(what), &mut record);
            (record.tick, record.force_n[1])
        };
        (5..8).map(tell).collect()
    }

    #[test]
    fn a_record_is_spoilt_as_its_name_says() {
        assert!(told(Mischief::Nan).iter().all(|(_, newton)| newton.is_nan()));
        assert!(told(Mischief::Inf).iter().all(|(_, newton)| newton.is_infinite()));
        assert!(told(Mischief::Range).iter().all(|(_, newton)| newton.abs() > 1e6));
        assert_eq!(told(Mischief::Frozen), [(5, 5.0), (6, 5.0), (7, 5.0)]);
        assert_eq!(told(Mischief::Stamp), [(5, 5.0), (5, 6.0), (5, 7.0)]);
        assert_eq!(told(Mischief::Replay), [(5, 5.0), (5, 5.0), (5, 5.0)]);
        let mut model = ContactModel { epoch: 4, ..Default::default() };
        lies().tell_of(&request(Mischief::Epoch), &mut model);
        assert_eq!(model.epoch, 3);
        lies().tell_of(&request(Mischief::Ahead), &mut model);
        assert_eq!((model.epoch, model.state_tick), (3 + EPOCHS_AHEAD, TICKS_AHEAD));
    }

    #[test]
    fn a_thread_beside_the_steps_lies_by_its_own_output_and_knows_when_that_begins_and_ends() {
        use hyst_exchange::{Station, system};
        use hyst_messages::Role;
        use hyst_messages::page::station as layout;
        let station = Station::named(&format!("t{}-liar", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        std::fs::write(station.settings(), "").unwrap();
        let slot = Slot::first(Role::Tissue);
        station.create_slot(slot, 4).unwrap();
        let life = Life::begin(station.name(), slot, 4).unwrap();
        let page = station.open_for_keeping().unwrap();
        page.store32(layout::TEST_MODE, 1);
        let ask = |outlet: Outlet, until_ns: u64| {
            let words = Request { outlet, until_ns, ..Request::of(Mischief::Nan, 4) }.words();
            let places = [layout::MISCHIEF, layout::MISCHIEF_UNTIL_NS, layout::MISCHIEF_EXTENT];
            places.into_iter().zip(words).for_each(|(place, word)| page.store64(place + slot.number(), word));
        };
        let mut liar = life.liar(Outlet::Appearance, 64).unwrap();
        let mut told = || {
            let mut numbers = [1.0f32; 4];
            liar.tell_numbers(bytemuck::cast_slice_mut(&mut numbers));
            (liar.has_turned(), numbers.map(f32::is_nan))
        };
        assert_eq!(told(), (false, [false; 4]));
        ask(Outlet::Steps, 0);
        assert_eq!(told(), (false, [false; 4]), "its steps lie, and it does not");
        ask(Outlet::Appearance, 0);
        assert_eq!([told(), told()], [true, false].map(|turned| (turned, [true, false, true, false])));
        let mut record = force(5, 5.0);
        Lies::new(&life, size_of::<ForceRecord>()).tell(&life, &mut record);
        assert_eq!(record, force(5, 5.0), "it lies, and its steps do not");
        ask(Outlet::Appearance, system::now_ns());
        assert_eq!([told(), told()], [true, false].map(|turned| (turned, [false; 4])));
        assert_eq!(life.page.load64(header::MISCHIEF), 2);
        station.wipe();
    }

    #[test]
    fn a_message_of_another_layout_is_one_that_nobody_reads() {
        let mut memory = vec![0u64; message_bytes(&[8]) / 8];
        MessageMut::format(bytemuck::cast_slice_mut(&mut memory), Kind::Contacts, StreamHeader::default(), &[8]).unwrap();
        lies().tell_message_of(&request(Mischief::Layout), bytemuck::cast_slice_mut(&mut memory));
        let refused = Message::parse(bytemuck::cast_slice(&memory), Kind::Contacts).unwrap_err();
        assert!(matches!(refused, WireError::Layout(found, own) if found == !own), "{refused}");
    }

    #[test]
    fn a_message_is_spoilt_as_its_name_says() {
        let sections = [8, 24];
        let tell = |what: Mischief| {
            let mut lies = lies();
            let mut seen = Vec::new();
            for tick in 5..8u64 {
                let mut memory = vec![0u64; message_bytes(&sections) / 8];
                let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
                let header = StreamHeader { tick, epoch: 3, ..Default::default() };
                let mut message = MessageMut::format(bytes, Kind::Contacts, header, &sections).unwrap();
                message.section::<f32>(1).unwrap().fill(tick as f32);
                lies.tell_message_of(&request(what), bytemuck::cast_slice_mut(&mut memory));
                let read = Message::parse(bytemuck::cast_slice(&memory), Kind::Contacts).unwrap();
                let values: &[f32] = read.section(1).unwrap();
                seen.push((read.header().tick, read.header().epoch, values[0], values[1]));
            }
            seen
        };
        assert_eq!(tell(Mischief::Frozen), [(5, 3, 5.0, 5.0), (6, 3, 5.0, 5.0), (7, 3, 5.0, 5.0)]);
        assert_eq!(tell(Mischief::Stamp), [(5, 3, 5.0, 5.0), (5, 3, 6.0, 6.0), (5, 3, 7.0, 7.0)]);
        assert_eq!(tell(Mischief::Replay), [(5, 3, 5.0, 5.0); 3]);
        assert_eq!(tell(Mischief::Epoch)[1], (6, 2, 6.0, 6.0));
        assert_eq!(tell(Mischief::Ahead)[1], (6 + TICKS_AHEAD, 3 + EPOCHS_AHEAD, 6.0, 6.0));
        assert!(tell(Mischief::Nan).iter().all(|told| told.2.is_nan()));
        assert!(tell(Mischief::Range).iter().all(|told| told.2 > 1e6));
    }
}
