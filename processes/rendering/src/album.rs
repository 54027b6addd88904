//! Pictures on disk: one every so often, as PNG files numbered on from what the folder holds, or at the end of a film. A folder that takes no more is
//! said once.

use hyst_engine::Life;
use hyst_engine::settings::SetError;
use rendering::Renderer;
use std::path::PathBuf;

/// Writes pictures into a folder, if there is one.
#[derive(Debug)]
pub struct Album {
    folder: Option<PathBuf>,
    every_ticks: u64,
    due_tick: u64,
    next: u32,
    is_film: bool,
    said: bool,
}

/// The film's name in its folder.
const FILM: &str = "pictures.mjpeg";

/// The number in `picture-NNNNN.png`.
fn number_of(name: &str) -> Option<u32> {
    name.strip_prefix("picture-")?.strip_suffix(".png")?.parse().ok()
}

impl Album {
    /// The album that the settings ask for.
    pub fn open(life: &Life) -> Result<Album, SetError> {
        let every_s = life.settings.number("picture_every_s", 1.0, 0.02..=3600.0, "0.02 to 3600")?;
        let is_film = life.settings.word("picture_format", ["png", "mjpeg"], "png or mjpeg")? == "mjpeg";
        let folder = life.settings.pictures.clone();
        let mut album = Album { folder, every_ticks: (every_s * 1e3) as u64, due_tick: 0, next: 0, is_film, said: false };
        let Some(folder) = &album.folder else { return Ok(album) };
        if let Err(error) = std::fs::create_dir_all(folder) {
            life.say(&format!("--pictures {}: {error}; no pictures are written", folder.display()));
            album.folder = None;
            return Ok(album);
        }
        let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
        album.next = names.filter_map(|name| number_of(name.to_str()?)).max().map_or(0, |last| last.saturating_add(1));
        Ok(album)
    }

    /// Writes the present picture if it is time.
    pub fn keep(&mut self, life: &Life, tick: u64, renderer: &mut Renderer) {
        let Some(folder) = self.folder.as_ref().filter(|_| tick >= self.due_tick) else { return };
        self.due_tick = tick + self.every_ticks;
        let kept = match self.is_film {
            true => renderer.append_jpeg(&folder.join(FILM)),
            false => renderer.save_png(&folder.join(format!("picture-{:05}.png", self.next))),
        };
        match kept {
            Ok(()) => {
                self.next = self.next.saturating_add(1);
                self.said = false;
            }
            Err(error) if !self.said => {
                life.say(&format!("{error}; the station goes on, and the next picture is tried"));
                self.said = true;
            }
            Err(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pictures_of_an_album_count() {
        assert_eq!(number_of("picture-00041.png"), Some(41));
        for other in ["picture-.png", "picture-00041.png.part", "xpicture-1.png", "picture-99999999999.png", "holiday.png"] {
            assert_eq!(number_of(other), None, "{other}");
        }
    }
}
