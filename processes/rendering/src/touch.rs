//! The thread that the window lives in: a hundred times a second it takes what mouse and keys did and tells the hardware, however slowly pictures come.
//!
//! Promise: a key that is let go of counts within two looks, and one that is held moves as far in a second as it is to, with one picture in a second as with
//! thirty. Nothing is told before the first picture is there. Whoever draws waits for nothing here but that the window opens, and that it goes.

use crate::geometry::Extent;
use crate::hand::Hand;
use crate::sources::sound;
use hyst_engine::Life;
use hyst_exchange::{OwnedPage, ReadPage, Station, StationError, StationPage, system};
use hyst_messages::page::{hardware, rendering as page};
use hyst_messages::{HardwareSample, Role, Slot};
use rendering::{Pane, PointerInput, RenderError, Status, Window};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Between two looks, ns: the hardware misses twenty of them before it takes the finger off the current.
const LOOK_NS: u64 = 10_000_000;
/// A display that has opened no window by then does not answer; one on a busy machine takes a second.
const OPENING: Duration = Duration::from_secs(10);

/// What the thread and whoever draws say to each other.
#[derive(Debug, Default)]
struct Shared {
    seen: Mutex<Seen>,
    /// There are pictures.
    is_shown: AtomicBool,
    /// The session is over: there is no current any more.
    is_over: AtomicBool,
    is_closing: AtomicBool,
}

/// What the thread has seen.
#[derive(Debug, Default)]
struct Seen {
    /// What the hand did since it was last asked for.
    input: PointerInput,
    extent: Extent,
    /// Why there is no window any more.
    gone: Option<String>,
}

impl Shared {
    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The window, as whoever draws has it.
#[derive(Debug)]
pub struct Touch {
    pane: Option<Pane>, // none only while it is dropped
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Touch {
    /// Has the window opened in its thread, or says why there is none.
    pub fn open(life: &Life, open: impl FnOnce() -> Result<Window, RenderError> + Send + 'static) -> Result<Touch, String> {
        let teller = Teller::new(Arc::clone(&life.page), &life.station).map_err(|error| error.to_string())?;
        let shared = Arc::new(Shared::default());
        let (tell, opened) = sync_channel(1);
        let of_thread = Arc::clone(&shared);
        let body = move || live(open, &tell, &of_thread, teller);
        let thread = std::thread::Builder::new().name("hand".into()).spawn(body);
        let thread = thread.map_err(|error| format!("no thread for the window ({error})"))?;
        let error = match opened.recv_timeout(OPENING) {
            Ok(Ok(pane)) => return Ok(Touch { pane: Some(pane), shared, thread: Some(thread) }),
            Ok(Err(error)) => error,
            Err(_) => RenderError::NoDisplay("it opens no window".into()),
        };
        shared.is_closing.store(true, Ordering::Release);
        Err(error.to_string())
    }

    /// What the hand did since the last call; `Err` with the reason if there is no window any more.
    pub fn input(&self) -> Result<PointerInput, String> {
        let mut seen = self.shared.seen();
        let input = seen.input;
        seen.input = PointerInput { buttons: input.buttons, held: input.held, ..PointerInput::default() };
        seen.gone.clone().map_or(Ok(input), Err)
    }

    /// Says that there are pictures, and whether the session is over.
    pub fn go_on(&self, is_over: bool) {
        self.shared.is_over.store(is_over, Ordering::Release);
        self.shared.is_shown.store(true, Ordering::Release);
    }

    /// How large it is, as long as there is a window.
    pub fn extent(&self) -> Option<Extent> {
        let seen = self.shared.seen();
        seen.gone.is_none().then_some(seen.extent)
    }

    /// What is drawn into.
    pub fn pane(&self) -> Option<&Pane> {
        self.pane.as_ref()
    }
}

impl Drop for Touch {
    fn drop(&mut self) {
        self.pane = None;
        self.shared.is_closing.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // it has nothing to say at its end
        }
    }
}

/// The thread's life: the window's, and of one that is gone until whoever draws has let go of it.
fn live(
    open: impl FnOnce() -> Result<Window, RenderError>,
    opened: &SyncSender<Result<Pane, RenderError>>,
    shared: &Shared,
    mut teller: Teller,
) {
    let mut window = match open() {
        Ok(window) => window,
        Err(error) => {
            let _ = opened.send(Err(error)); // whoever asked may have given up
            return;
        }
    };
    shared.seen().extent = extent(&window);
    if opened.send(window.pane()).is_err() {
        return;
    }
    let (mut last_ns, mut is_there) = (system::now_ns(), true);
    while !shared.is_closing.load(Ordering::Acquire) {
        let now_ns = system::now_ns();
        let elapsed_s = now_ns.saturating_sub(last_ns) as f32 * 1e-9;
        last_ns = now_ns;
        if is_there && let Err(reason) = look(&mut window, elapsed_s, shared, &mut teller) {
            teller.let_go();
            is_there = false;
            shared.seen().gone = Some(reason);
        }
        system::sleep_until_ns(now_ns + LOOK_NS);
    }
    teller.let_go();
}

/// Takes what the hand did, and tells it; `Err` with the reason if the window has just gone.
fn look(window: &mut Window, elapsed_s: f32, shared: &Shared, teller: &mut Teller) -> Result<(), String> {
    let input = match window.pump(elapsed_s) {
        Ok(Status::Open(input)) => input,
        Ok(Status::Closed) => return Err("the window was closed".into()),
        Err(error) => return Err(error.to_string()),
    };
    if shared.is_shown.load(Ordering::Acquire) {
        teller.tell(&input, shared.is_over.load(Ordering::Acquire));
    }
    let mut seen = shared.seen();
    (seen.input, seen.extent) = (seen.input.then(&input), extent(window));
    Ok(())
}

fn extent(window: &Window) -> Extent {
    Extent { size_px: window.size_px(), is_full: window.is_full() }
}

/// Tells the hardware what the hand wants, in the page's pointer cell, which nobody else writes.
struct Teller {
    page: Arc<OwnedPage>,
    station: Station,
    clock: StationPage,
    hardware: Option<ReadPage>,
    /// Whose page that is; 0 if it is to be looked for.
    incarnation: u32,
    hand: Hand,
}

impl Teller {
    fn new(page: Arc<OwnedPage>, station: &Station) -> Result<Teller, StationError> {
        let (clock, station) = (station.open()?, station.clone());
        Ok(Teller { page, station, clock, hardware: None, incarnation: 0, hand: Hand::default() })
    }

    /// The newest sample of the hardware that there is.
    fn sample(&mut self) -> Option<HardwareSample> {
        let slot = Slot::first(Role::Hardware);
        let incarnation = self.clock.incarnation(slot);
        if incarnation != self.incarnation {
            // One that cannot be opened is tried again at the next look.
            self.hardware = self.station.read_slot(slot, incarnation).ok();
            self.incarnation = if self.hardware.is_some() { incarnation } else { 0 };
        }
        self.hardware.as_ref()?.cell(hardware::SAMPLE).and_then(|(_, sample)| sound(sample))
    }

    fn tell(&mut self, input: &PointerInput, is_over: bool) {
        let Some(sample) = self.sample().filter(|sample| sample.from_window != 0) else { return };
        self.hand.is_over = is_over;
        self.page.write(page::POINTER, &self.hand.follow(input, &sample));
    }

    fn let_go(&mut self) {
        if let Some(record) = self.hand.let_go() {
            self.page.write(page::POINTER, &record);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::controls::WINDOW_ALL;
    use hyst_messages::page::station as layout;
    use hyst_messages::{BUTTON_ENERGIZED, PointerRecord, Pose};
    use rendering::Key;

    /// Another life of the hardware, which holds the scope so deep, m.
    fn born(station: &Station, incarnation: u32, insertion_m: f32, from_window: u32) {
        let slot = Slot::first(Role::Hardware);
        let pose = Pose { insertion_m, ..Pose::default() };
        let sample = HardwareSample { pose, from_window, ..HardwareSample::default() };
        station.create_slot(slot, incarnation).unwrap().write(hardware::SAMPLE, &sample);
        station.open_for_keeping().unwrap().store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
    }

    #[test]
    fn what_is_told_goes_on_from_whatever_hardware_there_is_and_at_the_end_nobody_wants_current() {
        let station = Station::named(&format!("t{}-touch", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let own = Arc::new(station.create_slot(Slot::first(Role::Rendering), 9).unwrap());
        let mut teller = Teller::new(Arc::clone(&own), &station).unwrap();
        let said = || own.cell(page::POINTER).map(|(_, pointer): (u64, PointerRecord)| pointer);
        let key = PointerInput { held: Key::Energize.bit(), ..PointerInput::default() };
        teller.tell(&key, false);
        born(&station, 1, 0.04, 0);
        teller.tell(&key, false);
        teller.let_go();
        assert_eq!(said(), None, "nobody has a scope, and then one that takes nothing from a window");
        born(&station, 2, 0.05, WINDOW_ALL);
        teller.tell(&key, false);
        let first = said().unwrap();
        assert_eq!((first.sequence, first.target[3], first.controls.buttons), (1, 0.05, BUTTON_ENERGIZED));
        born(&station, 3, 0.10, WINDOW_ALL);
        teller.tell(&key, false);
        let next = said().unwrap();
        assert!(next.sequence == 2 && next.target[3] > 0.08, "it stays within reach of the scope: {next:?}");
        teller.tell(&key, true);
        assert_eq!(said().unwrap().controls.buttons, 0, "the session is over");
        teller.tell(&key, false);
        teller.let_go();
        assert_eq!(said().map(|pointer| (pointer.sequence, pointer.controls.buttons)), Some((5, 0)));
        station.wipe();
    }
}
