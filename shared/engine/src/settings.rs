//! What an engine is started with: three words on its command line, and the station's settings from a file in its root.

use hyst_messages::controls::{FOCUS_M, FOCUS_RANGE_M};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The station's settings, written once by `hystation run`, read by every engine. TOML.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Scene or mesh file, absolute; the embedded scene if absent. Of a case the station's own copy.
    pub scene: Option<PathBuf>,
    /// The case file that was named, absolute.
    pub case: Option<PathBuf>,
    /// `mouse`, `gamepad`, `spacemouse`, `script:NAME`, `replay:FILE` or `idle`.
    pub hand: String,
    /// No window even if there is a display.
    pub headless: bool,
    /// Number of collision workers.
    pub workers: usize,
    /// Recording, absolute.
    pub record: Option<PathBuf>,
    /// Folder, absolute, into which rendering writes a picture every `set.picture_every_s` seconds (default 1).
    pub pictures: Option<PathBuf>,
    /// Faults may be injected.
    pub test_mode: bool,
    /// The station runs on a virtual clock.
    pub lockstep: bool,
    /// The station does again what the recording of `hand` says: of each tick the sample, the medium, and who stepped from what. In lock-step.
    pub replay: Option<Replay>,
    /// When the station was founded, s since 1970 (UTC); 0 where nobody said.
    #[serde(default)]
    pub begun_unix_s: u64,
    /// `--set key=value`, as given.
    pub set: BTreeMap<String, String>,
}

/// How a recording is shown again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replay {
    /// The tick after which it begins, from states that were recorded; 0: at the beginning.
    #[serde(default)]
    pub begin_tick: u64,
    /// Until this tick as fast as the machine manages.
    pub from_tick: u64,
    /// From there on so many times as fast as it was; 0: as fast as the machine manages.
    pub speed: f64,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            scene: None,
            case: None,
            hand: "script:press".into(),
            headless: false,
            workers: 2,
            record: None,
            pictures: None,
            test_mode: false,
            lockstep: false,
            replay: None,
            begun_unix_s: 0,
            set: BTreeMap::new(),
        }
    }
}

impl Settings {
    /// The recording that the hand follows, if it follows one.
    pub fn recording(&self) -> Option<&Path> {
        self.hand.strip_prefix("replay:").map(Path::new)
    }
}

/// A `--set` value that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("--set {key}={value}: expected {expected}")]
pub struct SetError {
    /// Key.
    pub key: String,
    /// Value found.
    pub value: String,
    /// What is allowed.
    pub expected: &'static str,
}

/// Keys that `--set` takes, each with what it takes and what it does.
pub const SET_KEYS: &[(&str, &str)] = &[
    ("realtime", "on or off: SCHED_FIFO, memory lock and cores (default on)"),
    ("isa", "baseline, avx2 or avx512: instruction set of the deformation (default: the best there is)"),
    (
        "tissue_step_ticks",
        "1, 2 or 4: step of the Main Loop in ticks (default: the shortest that the machine manages, and a longer one once it no longer does)",
    ),
    ("drift_ppm", "-500 to 500: drift of the simulated hardware's clock (default 20)"),
    ("picture_every_s", "0.02 to 3600: seconds between pictures on disk (default 1)"),
    ("picture_format", "png or mjpeg: a file for each picture on disk, or all in a film, pictures.mjpeg (default png)"),
    (
        "picture_size",
        "auto, 640x480, 1280x960 or 1920x1080: pixels of the pictures (default auto: 1920x1080 on a GPU, 640x480 in software)",
    ),
    (
        "picture_hz",
        "auto, 30, 60, 120 or 240: most pictures in a second (default auto: on a GPU and 4 cores as the display shows, else 30)",
    ),
    (
        "focus_mm",
        "3 to 100: how far from the lens the focus lies at first, or where a driver or a recording states none (default 20)",
    ),
    ("trainee", "1 to 60 letters: who trains, as the recording and its report name them (default: nobody)"),
    ("view", "endoscope or external: camera of the pictures (default endoscope)"),
    ("seed", "0 to 4294967295: what the anatomy of a case is drawn from (default: the case's own)"),
    ("spares", "on or off: a second haptic, tissue and fluid, which take over (default on)"),
    (
        "workers",
        "auto or always: ask the collision workers where that takes less time than to test alone, which is tried now and then, or in each step \
         (default auto; in lock-step and in test mode always)",
    ),
    ("fluid_threads", "1 to 8: Synchronized Threads of the Flow Engine (default half of the cores, at most 4)"),
    ("sound", "on or off: the terminal's bell when a warning of the case or an alarm of the pump begins (default on)"),
    ("console", "on or off: the operator's page in a browser (default on)"),
    ("console_port", "0 to 65535: port of that page on 127.0.0.1, 0 for any (default 8642; if it is taken, any)"),
];

impl Settings {
    /// A number set with `--set`, or the default.
    pub fn number(
        &self,
        key: &str,
        default: f64,
        range: std::ops::RangeInclusive<f64>,
        expected: &'static str,
    ) -> Result<f64, SetError> {
        let Some(value) = self.set.get(key) else { return Ok(default) };
        let number = value.parse::<f64>().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| SetError { key: key.into(), value: value.clone(), expected })
    }

    /// Ticks between two pictures that go into a folder.
    ///
    /// # Errors
    /// The setting is no such time.
    pub fn picture_every_ticks(&self) -> Result<u64, SetError> {
        let every_s = self.number("picture_every_s", 1.0, 0.02..=3600.0, "0.02 to 3600")?;
        Ok((every_s * 1e3) as u64)
    }

    /// Who trains, if that was said.
    pub fn trainee(&self) -> Result<Option<&str>, SetError> {
        let Some(value) = self.set.get("trainee") else { return Ok(None) };
        let is_name = (1..=60).contains(&value.chars().count()) && !value.chars().any(char::is_control);
        let refused = || SetError { key: "trainee".into(), value: value.clone(), expected: "1 to 60 letters" };
        if is_name { Ok(Some(value)) } else { Err(refused()) }
    }
    /// Where the focus of the camera head is set at first, m.
    pub fn focus_m(&self) -> Result<f32, SetError> {
        let [near_mm, far_mm] = FOCUS_RANGE_M.map(|m| f64::from(m * 1e3).round());
        let mm = self.number("focus_mm", f64::from(FOCUS_M * 1e3).round(), near_mm..=far_mm, "3 to 100")?;
        Ok((mm * 1e-3) as f32)
    }
    /// One of two words set with `--set`; the first is the default.
    pub fn word(&self, key: &str, words: [&'static str; 2], expected: &'static str) -> Result<&'static str, SetError> {
        let Some(value) = self.set.get(key) else { return Ok(words[0]) };
        let word = words.into_iter().find(|word| word == value);
        word.ok_or_else(|| SetError { key: key.into(), value: value.clone(), expected })
    }
    /// A switch set with `--set`: `on` or `off`.
    pub fn switch(&self, key: &str, default: bool) -> Result<bool, SetError> {
        let words = if default { ["on", "off"] } else { ["off", "on"] };
        self.word(key, words, "on or off").map(|word| word == "on")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trainee_has_a_name_of_one_line() {
        let named = |value: &str| Settings { set: [("trainee".into(), value.into())].into(), ..Settings::default() };
        assert_eq!(Settings::default().trainee().ok(), Some(None));
        assert_eq!(named("Dr. Ana Müller").trainee().ok(), Some(Some("Dr. Ana Müller")));
        for bad in ["", "a\nb", &"x".repeat(61)] {
            assert!(named(bad).trainee().is_err(), "{bad:?}");
        }
    }

    #[test]
    fn the_focus_is_set_in_millimetres_within_its_range() {
        let focus_m = |value: Option<&str>| {
            let set = value.map(|value| ("focus_mm".into(), value.into()));
            Settings { set: set.into_iter().collect(), ..Settings::default() }.focus_m().ok()
        };
        let values = [None, Some("8"), Some("3"), Some("100"), Some("2"), Some("NaN")];
        assert_eq!(values.map(focus_m), [Some(FOCUS_M), Some(0.008), Some(0.003), Some(0.1), None, None]);
    }
}
