//! A display of its own for a window: an X server without a screen (Xvfb), with hands and eyes at it.

use crate::{Folder, RECOVERY_LIMIT, START_LIMIT, Station, run, wait_for};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// Colours by which a picture differs from an empty window.
const COLOURS: usize = 100;

/// A display without a screen.
#[derive(Debug)]
pub struct Display {
    server: Child,
    /// What DISPLAY is set to.
    pub name: String,
    folder: Folder,
}

impl Display {
    /// `None`, and said, if this machine cannot show a window.
    pub fn start() -> Option<Display> {
        let has =
            |program: &str| Command::new(program).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
        if std::env::var_os("HYSTATION_NO_GPU").is_some() || !has("Xvfb") || !has("xdotool") {
            eprintln!(
                "NOT TRIED: a window needs Vulkan, Xvfb and xdotool: sudo apt-get install mesa-vulkan-drivers xvfb xdotool"
            );
            return None;
        }
        let folder = Folder::new("display");
        let mut command = Command::new("Xvfb");
        let mut server = command
            .args(["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp", "-fbdir", &folder.path("")])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb");
        let mut number = String::new();
        BufReader::new(server.stdout.take().expect("it is piped")).read_line(&mut number).expect("the number of the display");
        Some(Display { server, name: format!(":{}", number.trim()), folder })
    }

    /// Hands and eyes at the display.
    pub fn xdotool(&self, words: &[&str]) -> Option<String> {
        let (code, text, _) = run(Command::new("xdotool").args(words).env("DISPLAY", &self.name));
        (code == Some(0)).then(|| text.trim().to_string())
    }

    /// The window of a station, focused, once it shows a picture.
    pub fn window(&self, station: &Station) -> String {
        let title = format!("hysteroscopy: {}", station.name());
        let found = wait_for(START_LIMIT, || {
            let window = self.xdotool(&["search", "--name", &title])?;
            (self.colours() >= COLOURS).then_some(window)
        });
        let window = found.unwrap_or_else(|| panic!("no window with a picture: {} colours\n{}", self.colours(), station.said()));
        assert!(self.xdotool(&["windowfocus", "--sync", &window]).is_some(), "the window takes no focus");
        window
    }

    /// Takes it away from whoever shows something on it.
    pub fn end(&mut self) {
        let _ = self.server.kill(); // dead already is as good
        let _ = self.server.wait();
    }

    /// Pixels of the screen; the server keeps it as an XWD file.
    fn pixels(&self) -> Vec<[u8; 3]> {
        let bytes = std::fs::read(self.folder.path("Xvfb_screen0")).unwrap_or_default();
        let word = |index: usize| {
            bytes.get(4 * index..4 * index + 4).map_or(0, |word| u32::from_be_bytes([word[0], word[1], word[2], word[3]]))
        };
        let begin = word(0) as usize + 12 * word(19) as usize; // the header, the colour map
        bytes.get(begin..).unwrap_or_default().chunks_exact(4).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    }

    /// Different colours on the screen.
    pub fn colours(&self) -> usize {
        self.pixels().into_iter().collect::<BTreeSet<_>>().len()
    }

    /// Pixels of a colour, red and blue in whichever order, give or take one step of each.
    pub fn count(&self, [red, green, blue]: [u8; 3]) -> usize {
        let is_near = |pixel: &[u8; 3], colour: [u8; 3]| pixel.iter().zip(colour).all(|(a, b)| a.abs_diff(b) <= 1);
        let is_it = |pixel: &&[u8; 3]| is_near(pixel, [red, green, blue]) || is_near(pixel, [blue, green, red]);
        self.pixels().iter().filter(is_it).count()
    }

    /// Presses a key once and waits for what it does.
    pub fn press(&self, station: &Station, key: &str, what: &str, is_done: impl Fn() -> bool) {
        assert!(self.xdotool(&["key", key]).is_some(), "{key} cannot be pressed");
        let done = wait_for(RECOVERY_LIMIT, || is_done().then_some(()));
        assert!(done.is_some(), "{key}: {what}\n{}", station.said());
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.end();
    }
}
