//! The window, if there is one to be had: `--headless`, no DISPLAY, or a display that refuses all lead to the same headless station. It is as large as
//! that of the process before.

use crate::geometry::{Extent, Keeper, before, px_of};
use crate::touch::Touch;
use hyst_engine::Life;
use hyst_engine::settings::{SetError, Settings};
use hyst_exchange::Station;
use rendering::{Pane, PointerInput, RenderError, Window};

/// Size of the picture, and of the window at first, where a software driver draws, px: what the station is measured with.
const SOFTWARE_PX: [u32; 2] = [640, 480];
/// The same on a GPU.
const GPU_PX: [u32; 2] = [1_920, 1_080];

/// What the settings ask of the pictures; `None`: it follows from what draws and shows them.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Size, px.
    pub size_px: Option<[u32; 2]>,
    /// Most of them in a second.
    pub hz: Option<u32>,
    /// Focus where the device states none, m.
    pub focus_m: f32,
}

/// What the settings ask for.
pub fn asked(settings: &Settings) -> Result<Asked, SetError> {
    Ok(Asked { size_px: asked_px(settings)?, hz: asked_hz(settings)?, focus_m: settings.focus_m()? })
}

fn asked_hz(settings: &Settings) -> Result<Option<u32>, SetError> {
    let Some(value) = settings.set.get("picture_hz").filter(|value| *value != "auto") else { return Ok(None) };
    let hz = value.parse().ok().filter(|hz| [30, 60, 120, 240].contains(hz));
    let error = || SetError { key: "picture_hz".into(), value: value.clone(), expected: "auto, 30, 60, 120 or 240" };
    hz.map(Some).ok_or_else(error)
}

fn asked_px(settings: &Settings) -> Result<Option<[u32; 2]>, SetError> {
    let Some(value) = settings.set.get("picture_size").filter(|value| *value != "auto") else { return Ok(None) };
    let error = || SetError { key: "picture_size".into(), value: value.clone(), expected: "auto or WIDTHxHEIGHT" };
    px_of(value).map(Some).ok_or_else(error)
}

/// The size of the pictures, px.
pub fn size_px(asked_px: Option<[u32; 2]>, is_software: bool) -> [u32; 2] {
    asked_px.unwrap_or(if is_software { SOFTWARE_PX } else { GPU_PX })
}

/// The window or its absence.
#[derive(Debug, Default)]
pub struct Display {
    touch: Option<Touch>,
    /// It has the size of the window of the process before.
    is_sized: bool,
    keeper: Keeper,
}

impl Display {
    /// Opens the window, or says why the station goes on headless.
    pub fn open(life: &Life, asked_px: Option<[u32; 2]>) -> Display {
        if life.settings.headless {
            return Display::default();
        }
        if std::env::var_os("DISPLAY").is_none_or(|name| name.is_empty()) {
            life.say("DISPLAY is not set: headless");
            return Display::default();
        }
        let title = format!("hysteroscopy: {}", life.station.name());
        let [width, height] = asked_px.unwrap_or(SOFTWARE_PX);
        let before = before(&life.station);
        let open = move || {
            let Some(Extent { size_px, is_full }) = before else { return Window::open(&title, width, height) };
            let mut window = Window::open_again(&title, size_px)?;
            if is_full {
                window.fill(true);
            }
            Ok(window)
        };
        match Touch::open(life, open) {
            Ok(touch) => Display { touch: Some(touch), is_sized: before.is_some(), keeper: Keeper::after(before) },
            Err(reason) => {
                life.say(&format!("{reason}; headless"));
                Display::default()
            }
        }
    }

    /// What the hand did since the last call; `Err` with the reason if the window has just gone, `Ok(None)` without one.
    pub fn input(&self) -> Result<Option<PointerInput>, String> {
        self.touch.as_ref().map(Touch::input).transpose()
    }

    /// Says that there are pictures, so that the hand counts, and whether the session is over.
    pub fn go_on(&self, is_over: bool) {
        if let Some(touch) = &self.touch {
            touch.go_on(is_over);
        }
    }

    /// Makes the window as large as the pictures, unless its size is that of the process before; a display that refuses that shows them smaller.
    pub fn fit(&self, size_px: [u32; 2]) -> Result<(), RenderError> {
        let first = self.pane().filter(|_| !self.is_sized);
        first.map_or(Ok(()), |pane| pane.resize(size_px[0], size_px[1]))
    }

    /// Keeps the window's size for the process that follows.
    pub fn keep_size(&mut self, station: &Station, tick: u64) {
        if let Some(extent) = self.touch.as_ref().and_then(Touch::extent) {
            self.keeper.keep(station, tick, extent);
        }
    }

    /// What of the window is drawn into.
    pub fn pane(&self) -> Option<&Pane> {
        self.touch.as_ref().and_then(Touch::pane)
    }

    /// Inner size of the window, px, as long as there is one.
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.touch.as_ref().and_then(Touch::extent).map(|extent| extent.size_px)
    }

    /// Goes on without; whatever drew into the window must be gone.
    pub fn close(&mut self) {
        self.touch = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_and_rate_are_taken_as_asked_and_what_cannot_be_is_refused_by_its_key() {
        let asked = |key: &str, value: &str| {
            let settings = Settings { set: [(key.to_string(), value.to_string())].into(), ..Settings::default() };
            asked(&settings).map(|asked| (asked.size_px, asked.hz)).map_err(|error| error.to_string())
        };
        assert_eq!(asked("picture_hz", "auto"), Ok((None, None)));
        assert_eq!(asked("picture_hz", "120"), Ok((None, Some(120))));
        assert_eq!(asked("picture_size", "1280x960"), Ok((Some([1_280, 960]), None)));
        for value in ["", "0", "50", "-30", "fast", "1e9", "60.0"] {
            let said = asked("picture_hz", value).unwrap_err();
            assert!(said.contains(&format!("picture_hz={value}")) && said.contains("60, 120 or 240"), "{said}");
        }
        assert!(asked("picture_size", "7").unwrap_err().contains("picture_size=7"));
    }
}
