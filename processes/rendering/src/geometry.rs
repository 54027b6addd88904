//! The size of the window, from one process to the next: a window goes with the process that draws, and who has made it larger finds the next one as large.
//!
//! Promise: a size is written into the station's root once it has stood for a while, in one step; what is found there and is no size of a window is none.
//! Nobody waits for it: what is not written or read costs the next window its size, and nothing else.

use hyst_exchange::{Station, whole};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Sides that a window may have, px: a smaller one shows nothing, and no display has a larger one.
const SIDES_PX: RangeInclusive<u32> = 160..=8_192;
/// A size that has stood for so long is kept, ticks: none of those that a border goes through which the mouse draws, and none that ends the process at once.
const STANDS_TICKS: u64 = 500;

/// Width and height, px, as they are written: `1280x960`.
pub fn px_of(text: &str) -> Option<[u32; 2]> {
    let (width, height) = text.split_once('x')?;
    Some([width.parse().ok()?, height.parse().ok()?])
}

fn is_of_a_window(size_px: [u32; 2]) -> bool {
    size_px.iter().all(|side_px| SIDES_PX.contains(side_px))
}

fn file(station: &Station) -> PathBuf {
    station.root().join("window-size")
}

/// The size that the window of the process before had, px.
pub fn before_px(station: &Station) -> Option<[u32; 2]> {
    let text = std::fs::read_to_string(file(station)).ok()?;
    px_of(text.trim()).filter(|size_px| is_of_a_window(*size_px))
}

/// Keeps the size of a window for the process that follows.
#[derive(Debug, Default)]
pub struct Keeper {
    kept_px: [u32; 2],
    seen_px: [u32; 2],
    since_tick: u64,
}

impl Keeper {
    /// Takes the size that the window has, px.
    pub fn keep(&mut self, station: &Station, tick: u64, size_px: [u32; 2]) {
        if size_px != self.seen_px {
            (self.seen_px, self.since_tick) = (size_px, tick);
        }
        if size_px == self.kept_px || !is_of_a_window(size_px) || tick < self.since_tick + STANDS_TICKS {
            return;
        }
        self.kept_px = size_px;
        let [width, height] = size_px;
        // Refused, the next window has the size of before, or its first: no reason to stop drawing. It is tried again with the next size.
        let _ = whole::write(&file(station), format!("{width}x{height}\n").as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn founded(name: &str) -> Station {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        station
    }

    #[test]
    fn a_size_that_has_stood_for_a_while_is_the_successors_and_one_on_the_way_there_is_not() {
        let station = founded("size-kept");
        let mut keeper = Keeper::default();
        assert_eq!(before_px(&station), None, "nobody was before the first");
        let mut seen = Vec::new();
        for (tick, size_px) in [(0, [640, 480]), (499, [640, 480]), (500, [640, 480]), (900, [700, 500]), (1_399, [800, 600])] {
            keeper.keep(&station, tick, size_px);
            seen.push(before_px(&station));
        }
        let first = Some([640, 480]);
        assert_eq!(seen, [None, None, first, first, first]);
        keeper.keep(&station, 1_899, [800, 600]);
        assert_eq!(before_px(&station), Some([800, 600]));
        keeper.keep(&station, 2_000, [3, 2]);
        keeper.keep(&station, 9_000, [3, 2]);
        assert_eq!(before_px(&station), Some([800, 600]), "nothing would be seen in one of 3 x 2");
        station.wipe();
    }

    #[test]
    fn what_is_no_size_of_a_window_is_none() {
        let station = founded("size-none");
        for text in ["", "x", "800", "800x", "800x-600", "800x600x2", "159x600", "800x8193", "1e3x600", "99999999999x600"] {
            std::fs::write(file(&station), text).unwrap();
            assert_eq!(before_px(&station), None, "{text:?}");
        }
        std::fs::write(file(&station), [0xff, 0xfe]).unwrap();
        assert_eq!(before_px(&station), None, "it is no text");
        std::fs::write(file(&station), "160x8192\n").unwrap();
        assert_eq!(before_px(&station), Some([160, 8_192]));
        station.wipe();
    }

    #[test]
    fn a_root_that_takes_no_file_costs_the_size_and_nothing_else() {
        let station = founded("size-gone");
        station.wipe();
        let mut keeper = Keeper::default();
        for tick in [0, 500, 1_000] {
            keeper.keep(&station, tick, [800, 600]);
        }
        assert_eq!(before_px(&station), None);
    }
}
