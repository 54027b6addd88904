//! The window, if there is one to be had: `--headless`, no DISPLAY, or a display that refuses all lead to the same headless station.

use hyst_engine::Life;
use rendering::{PointerInput, Status, Window};
use std::cell::Cell;

/// Size of the picture and of the window at first, px: what the station is measured with.
pub const SIZE_PX: [u32; 2] = [640, 480];

thread_local! {
    static AT_THE_DISPLAY: Cell<bool> = const { Cell::new(false) };
}

/// The window or its absence.
#[derive(Debug)]
pub struct Display {
    window: Option<Window>,
}

/// The windowing library panics where a display fails; those panics are caught where they happen and must not end the process as others do.
fn spare_the_displays_panics() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !AT_THE_DISPLAY.get() {
            usual(info);
        }
    }));
}

fn at_the_display<T>(call: impl FnOnce() -> T) -> T {
    AT_THE_DISPLAY.set(true);
    let value = call();
    AT_THE_DISPLAY.set(false);
    value
}

impl Display {
    /// Opens the window, or says why the station goes on headless.
    pub fn open(life: &Life) -> Display {
        if life.settings.headless {
            return Display { window: None };
        }
        if std::env::var_os("DISPLAY").is_none_or(|name| name.is_empty()) {
            life.say("DISPLAY is not set: headless");
            return Display { window: None };
        }
        spare_the_displays_panics();
        let title = format!("hysteroscopy: {}", life.station.name());
        match at_the_display(|| Window::open(&title, SIZE_PX[0], SIZE_PX[1])) {
            Ok(window) => Display { window: Some(window) },
            Err(error) => {
                life.say(&format!("{error}; headless"));
                Display { window: None }
            }
        }
    }

    /// What the hand did since the last call; `Err` with the reason if the window has just gone, `Ok(None)` without one.
    pub fn pump(&mut self, elapsed_s: f32) -> Result<Option<PointerInput>, String> {
        let Some(window) = &mut self.window else { return Ok(None) };
        match at_the_display(|| window.pump(elapsed_s)) {
            Ok(Status::Open(input)) => Ok(Some(input)),
            Ok(Status::Closed) => Err("the window was closed".into()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// The window.
    pub fn window(&self) -> Option<&Window> {
        self.window.as_ref()
    }

    /// Goes on without; whatever drew into the window must be gone.
    pub fn close(&mut self) {
        let window = self.window.take();
        at_the_display(|| drop(window));
    }
}
