//! Pictures on disk: one every so often, as PNG files numbered on from what the folder holds, or at the end of a film. A folder that takes no more, or too
//! slowly, is said once.
//!
//! Promise: on the station's clock nobody waits for the folder: what it is too slow for is left out and counted. On a virtual clock, where each picture is
//! wanted and no hand waits, none is left out of a folder that goes on within seconds. At the end what was put there is written.

mod writer;

use hyst_engine::Life;
use hyst_engine::settings::SetError;
use rendering::{RenderError, Renderer};
use std::time::Duration;
use writer::{Shot, Writer};

/// Writes pictures into a folder, if there is one.
#[derive(Debug)]
pub struct Album {
    writer: Option<Writer>,
    every_ticks: u64,
    due_tick: u64,
    /// For how long a picture waits for its room in the folder.
    patience: Duration,
    left_out: u64,
    said: bool,
}

/// The film's name in its folder.
const FILM: &str = "pictures.mjpeg";
/// For how long a picture waits on a virtual clock: half the time that a process which draws is given to show a sign of life.
const PATIENCE: Duration = Duration::from_secs(2);
/// What is not written in this time at the end never will be; the supervisor gives two seconds for a stop.
const ENDING: Duration = Duration::from_secs(1);

/// The number in `picture-NNNNN.png`.
fn number_of(name: &str) -> Option<u32> {
    name.strip_prefix("picture-")?.strip_suffix(".png")?.parse().ok()
}

fn name_of(number: u32) -> String {
    format!("picture-{number:05}.png")
}

/// When the next picture is due after the one of this tick: so often in the mean as was asked for, though each waits for the next that is drawn; of a time in which
/// none was drawn nothing is made up for.
fn next_due(due_tick: u64, tick: u64, every_ticks: u64) -> u64 {
    let next = due_tick + every_ticks;
    if next > tick { next } else { tick + every_ticks }
}

impl Album {
    /// The album that the settings ask for.
    pub fn open(life: &Life) -> Result<Album, SetError> {
        let every_ticks = life.settings.picture_every_ticks()?;
        let is_film = life.settings.word("picture_format", ["png", "mjpeg"], "png or mjpeg")? == "mjpeg";
        let patience = if life.is_lockstep() { PATIENCE } else { Duration::ZERO };
        let mut album = Album { writer: None, every_ticks, due_tick: 0, patience, left_out: 0, said: false };
        let Some(folder) = &life.settings.pictures else { return Ok(album) };
        let next = || {
            let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
            names.filter_map(|name| number_of(name.to_str()?)).max().map_or(0, |last| last.saturating_add(1))
        };
        match std::fs::create_dir_all(folder).and_then(|()| Writer::start(folder.clone(), is_film, next())) {
            Ok(writer) => album.writer = Some(writer),
            Err(error) => life.say(&format!("--pictures {}: {error}; no pictures are written", folder.display())),
        }
        Ok(album)
    }

    /// Writes the present picture if it is time.
    pub fn keep(&mut self, life: &Life, tick: u64, renderer: &mut Renderer) {
        if self.writer.is_none() || tick < self.due_tick {
            return;
        }
        self.due_tick = next_due(self.due_tick, tick, self.every_ticks);
        if !self.make_room(life) {
            self.left_out += 1;
            if self.left_out == 1 {
                life.say("the folder takes pictures more slowly than they come: what it has no time for is left out");
            }
            return;
        }
        let size_px = renderer.size_px();
        match renderer.read_rgba() {
            Ok(rgba) => {
                let rgba = rgba.to_vec();
                if let Some(writer) = &mut self.writer {
                    writer.put(Shot { size_px, rgba });
                }
            }
            Err(error) => self.hear(life, Err(error)),
        }
    }

    /// Hears what has come of the pictures before; whether there is room for another one.
    fn make_room(&mut self, life: &Life) -> bool {
        while let Some(writer) = &mut self.writer {
            let within = if writer.has_room() { Duration::ZERO } else { self.patience };
            let Some(kept) = writer.heard(within) else { return writer.has_room() };
            self.hear(life, kept);
        }
        false
    }

    fn hear(&mut self, life: &Life, kept: Result<(), RenderError>) {
        match kept {
            Err(error) if !self.said => {
                life.say(&format!("{error}; the station goes on, and the next picture is tried"));
                self.said = true;
            }
            Err(_) => {}
            Ok(()) => self.said = false,
        }
    }

    /// Waits until what was put there is written.
    pub fn close(&mut self, life: &Life) {
        let Some(writer) = self.writer.take() else { return };
        let (all, unwritten) = writer.end(ENDING);
        all.into_iter().for_each(|kept| self.hear(life, kept));
        let left_out = self.left_out + unwritten as u64;
        if left_out > 0 {
            life.say(&format!("{left_out} pictures were left out: the folder did not take them in time"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of ten pictures in a second that were asked for, beside thirty that were drawn, there were seven and a half.
    #[test]
    fn pictures_are_as_many_as_were_asked_for_though_each_waits_for_one_that_is_drawn() {
        let of = |drawn_every: u64, every_ticks: u64| {
            let (mut due_tick, mut kept) = (0, Vec::new());
            for tick in (5_000..15_000).step_by(drawn_every as usize).filter(|tick| !(9_000..11_000).contains(tick)) {
                if tick >= due_tick {
                    due_tick = next_due(due_tick, tick, every_ticks);
                    kept.push(tick);
                }
            }
            kept
        };
        let kept = of(33, 100);
        assert!((78..=82).contains(&kept.len()), "{} in eight seconds", kept.len());
        assert!(
            kept.windows(2).all(|two| two[1] - two[0] >= 66),
            "none on the heels of another, not after a gap either: {kept:?}"
        );
        assert_eq!(of(33, 20).len(), (5_000..15_000).step_by(33).filter(|tick| !(9_000..11_000).contains(tick)).count());
    }

    #[test]
    fn only_pictures_of_an_album_count() {
        assert_eq!((number_of("picture-00041.png"), number_of(&name_of(41))), (Some(41), Some(41)));
        for other in ["picture-.png", "picture-00041.png.part", "xpicture-1.png", "picture-99999999999.png", "holiday.png"] {
            assert_eq!(number_of(other), None, "{other}");
        }
    }
}
