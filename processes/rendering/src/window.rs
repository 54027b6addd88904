//! The window: shows pictures, and turns mouse and keyboard into movements of the hand.
//!
//! Promise: the thread that opens it pumps it, and is never blocked by that; another one may draw into its [`Pane`] meanwhile. No display, or a display that
//! goes away, is an error, never a panic that leaves this module. One case is out of its hands: if Xlib itself finds the connection broken, it ends the process with code 1 and one
//! line; the restarted process finds no display and goes on headless, which is the same path as a start without one.
//! What keys and mouse do is the table in `input`; keys that move the scope do so at a fixed speed while they are held.
mod pane;

use std::{sync::Arc, time::Duration};

use winit::{
    application::ApplicationHandler,
    dpi::{LogicalSize, PhysicalPosition, PhysicalSize, Size},
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, EventLoop},
    keyboard::{Key as Logical, KeyCode, PhysicalKey},
    platform::{
        modifier_supplement::KeyEventExtModifierSupplement,
        pump_events::{EventLoopExtPumpEvents, PumpStatus},
        x11::EventLoopBuilderExtX11,
    },
    window::{Fullscreen, Window as Native, WindowId},
};

use crate::{
    caught::caught,
    error::RenderError,
    gpu::one_line,
    input::{Key, MOTIONS, Mouse, PointerInput, button_bit, key_at, meant},
};

pub use pane::Pane;

/// Pixels of a touch pad's scroll that count as a notch.
const PX_PER_NOTCH: f64 = 40.0;

/// What a pump found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Status {
    /// the window is open; this is what the hand did
    Open(PointerInput),
    /// the user closed it
    Closed,
}

/// A window on the display.
pub struct Window {
    event_loop: Option<EventLoop<()>>, // none only while it is dropped
    app: App,
}

impl Drop for Window {
    fn drop(&mut self) {
        let (native, event_loop) = (self.app.native.take(), self.event_loop.take());
        // a display that is gone cannot be said goodbye to; that failure has been reported by pump
        let _ = guarded(|| drop(native));
        let _ = guarded(|| drop(event_loop));
    }
}

impl std::fmt::Debug for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Window").field("title", &self.app.title).field("size_px", &self.size_px()).finish_non_exhaustive()
    }
}

impl Window {
    /// Opens a window of `width_px` × `height_px`, each of which may be several of a fine display's. One per process: the windowing library makes no
    /// second event loop.
    ///
    /// # Errors
    /// [`RenderError::NoDisplay`].
    pub fn open(title: &str, width_px: u32, height_px: u32) -> Result<Self, RenderError> {
        Self::begin(App { title: title.into(), size: [width_px, height_px], ..App::default() })
    }

    /// Opens a window as large as one whose [`Window::size_px`] was this. One per process, too.
    ///
    /// # Errors
    /// [`RenderError::NoDisplay`].
    pub fn open_again(title: &str, size_px: [u32; 2]) -> Result<Self, RenderError> {
        Self::begin(App { title: title.into(), size: size_px, is_exact: true, ..App::default() })
    }

    fn begin(mut app: App) -> Result<Self, RenderError> {
        let mut event_loop = guarded(|| {
            EventLoop::builder().with_any_thread(true).build().map_err(|e| RenderError::NoDisplay(without_place(&e.to_string())))
        })??;
        guarded(|| event_loop.pump_app_events(Some(Duration::from_millis(200)), &mut app))?;
        if let Some(reason) = app.failed.take() {
            return Err(RenderError::NoDisplay(reason));
        }
        if app.native.is_none() {
            return Err(RenderError::NoDisplay("the display opened no window".into()));
        }
        Ok(Self { event_loop: Some(event_loop), app })
    }

    /// Takes what happened since the last call, without waiting. `elapsed_s` is the time since then, for keys that are held.
    ///
    /// # Errors
    /// [`RenderError::NoDisplay`] if the display went away; the window is of no more use.
    pub fn pump(&mut self, elapsed_s: f32) -> Result<Status, RenderError> {
        let app = &mut self.app;
        let Some(event_loop) = &mut self.event_loop else {
            return Ok(Status::Closed);
        };
        let status = guarded(|| event_loop.pump_app_events(Some(Duration::ZERO), app))?;
        match status {
            PumpStatus::Exit(code) if !app.closed => Err(RenderError::NoDisplay(format!("the display went away, code {code}"))),
            _ if app.closed => Ok(Status::Closed),
            _ => {
                let input = app.take_input(elapsed_s);
                if app.is_to_be_full(&input) != app.is_full {
                    self.fill(!self.app.is_full);
                }
                Ok(Status::Open(input))
            }
        }
    }

    /// Fills the screen, or no more. A display that refuses leaves the window as it is.
    pub fn fill(&mut self, is_full: bool) {
        self.app.is_full = is_full;
        let wanted = is_full.then_some(Fullscreen::Borderless(None));
        if let Some(window) = &self.app.native {
            let _ = guarded(|| window.set_fullscreen(wanted)); // of one that is gone pump speaks
        }
    }

    /// Whether it is to fill the screen.
    pub fn is_full(&self) -> bool {
        self.app.is_full
    }

    /// Inner size, px.
    pub fn size_px(&self) -> [u32; 2] {
        self.app.size // as last reported; asking a display that went away would end the process
    }

    /// What is drawn into.
    ///
    /// # Errors
    /// [`RenderError::NoDisplay`] if the window is closed.
    pub fn pane(&self) -> Result<Pane, RenderError> {
        let native = self.app.native.clone().ok_or_else(|| RenderError::NoDisplay("the window is closed".into()))?;
        Ok(Pane { native, refresh_hz: self.app.refresh_hz })
    }
}

/// The library's message without the place in its source that it begins with.
fn without_place(text: &str) -> String {
    one_line(text.rsplit(".rs:").next().and_then(|t| t.split_once(": ")).map_or(text, |(_, message)| message))
}

/// The windowing library panics on some failures of the display; they become errors here.
fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, RenderError> {
    caught(call).map_err(RenderError::NoDisplay)
}

#[derive(Default)]
struct App {
    title: String,
    size: [u32; 2],
    /// The size to begin with is one of the display's own pixels.
    is_exact: bool,
    is_full: bool,
    refresh_hz: Option<f32>,
    native: Option<Arc<Native>>,
    failed: Option<String>,
    closed: bool,
    at: Option<PhysicalPosition<f64>>,
    input: PointerInput,
    /// What is held: the places, and what was meant when each went down.
    down: Vec<(KeyCode, KeyCode)>,
}

impl App {
    fn take_input(&mut self, elapsed_s: f32) -> PointerInput {
        let mut input = self.input;
        self.input = PointerInput { buttons: input.buttons, held: input.held, ..PointerInput::default() };
        let seconds = if elapsed_s.is_finite() { elapsed_s.clamp(0.0, 0.1) } else { 0.0 };
        for motion in &MOTIONS {
            let [back, forth] = motion.keys.map(|(_, key)| f32::from(u8::from(input.is_held(key))));
            *input.along(motion.axis) += (forth - back) * seconds * motion.per_s;
        }
        input
    }

    fn is_to_be_full(&self, input: &PointerInput) -> bool {
        (self.is_full ^ input.was_pressed(Key::FullScreen)) && !input.was_pressed(Key::Framed)
    }

    fn moved(&mut self, to: PhysicalPosition<f64>) {
        let Some(from) = self.at.replace(to) else { return };
        let [right_px, up_px] = [(to.x - from.x) as f32, (from.y - to.y) as f32];
        for motion in &MOTIONS {
            let (button, px) = match motion.mouse {
                Mouse::DragUp(button) => (button, up_px),
                Mouse::DragRight(button) => (button, right_px),
                Mouse::Wheel => continue,
            };
            if self.input.buttons & button_bit(button) != 0 {
                *self.input.along(motion.axis) += px * motion.per_step;
            }
        }
    }

    fn wheel(&mut self, notches: f32) {
        for motion in MOTIONS.iter().filter(|motion| motion.mouse == Mouse::Wheel) {
            *self.input.along(motion.axis) += notches * motion.per_step;
        }
    }

    fn button(&mut self, button: MouseButton, state: ElementState) {
        let bit = button_bit(button);
        if state.is_pressed() { self.input.buttons |= bit } else { self.input.buttons &= !bit }
    }

    fn key(&mut self, event: &KeyEvent) {
        let PhysicalKey::Code(place) = event.physical_key else { return };
        let bears = match event.key_without_modifiers() {
            Logical::Character(text) => Some(text),
            _ => None,
        };
        self.stroke(place, bears.as_deref(), event.state, event.repeat);
    }

    /// A key is let go as what it was pressed as, also where the layout is another one by then.
    fn stroke(&mut self, place: KeyCode, bears: Option<&str>, state: ElementState, is_repeat: bool) {
        let before = self.down.iter().position(|(down, _)| *down == place);
        let code = before.map_or_else(|| meant(place, bears), |at| self.down[at].1);
        match before {
            None if state.is_pressed() => self.down.push((place, code)),
            Some(_) if !state.is_pressed() => self.down.retain(|(down, _)| *down != place),
            _ => {}
        }
        self.press(code, state, is_repeat);
    }

    fn press(&mut self, code: KeyCode, state: ElementState, is_repeat: bool) {
        let Some(key) = key_at(code) else { return };
        if state.is_pressed() {
            self.input.pressed |= if is_repeat { 0 } else { key.bit() };
            self.input.held |= key.bit();
        } else {
            self.input.held &= !key.bit();
        }
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.native.is_none() {
            let [width, height] = self.size;
            let size = match self.is_exact {
                true => Size::from(PhysicalSize::new(width, height)),
                false => Size::from(LogicalSize::new(width, height)),
            };
            let wanted = Native::default_attributes().with_title(self.title.clone()).with_inner_size(size);
            match event_loop.create_window(wanted) {
                Ok(window) => {
                    let refresh_mhz = window.current_monitor().and_then(|monitor| monitor.refresh_rate_millihertz());
                    self.refresh_hz = refresh_mhz.map(|rate_mhz| rate_mhz as f32 * 1e-3);
                    self.native = Some(Arc::new(window));
                }
                Err(e) => self.failed = Some(one_line(&e.to_string())),
            }
        }
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::Resized(size) => self.size = size.into(),
            WindowEvent::CloseRequested | WindowEvent::Destroyed => self.closed = true,
            WindowEvent::CursorMoved { position, .. } => self.moved(position),
            WindowEvent::CursorLeft { .. } => self.at = None,
            WindowEvent::MouseInput { state, button, .. } => self.button(button, state),
            WindowEvent::MouseWheel { delta: MouseScrollDelta::LineDelta(_, y), .. } => self.wheel(y),
            WindowEvent::MouseWheel { delta: MouseScrollDelta::PixelDelta(p), .. } => self.wheel((p.y / PX_PER_NOTCH) as f32),
            WindowEvent::KeyboardInput { event, .. } => self.key(&event),
            WindowEvent::Focused(false) => {
                (self.input.held, self.input.buttons) = (0, 0);
                self.down.clear();
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests;
