//! The size of the window, from one process to the next: a window goes with the process that draws, and who has made it larger, or had it fill the screen,
//! finds the next one so.
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

/// How large a window is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extent {
    /// Its inner size, px; as it is kept, of one that fills the screen, that to which it goes back.
    pub size_px: [u32; 2],
    /// It fills the screen.
    pub is_full: bool,
}

/// What is written behind the size of a window that fills the screen.
const FULL: &str = " full";

/// How large the window of the process before was.
pub fn before(station: &Station) -> Option<Extent> {
    let text = std::fs::read_to_string(file(station)).ok()?;
    let (size, is_full) = text.trim().strip_suffix(FULL).map_or((text.trim(), false), |size| (size, true));
    px_of(size).filter(|size_px| is_of_a_window(*size_px)).map(|size_px| Extent { size_px, is_full })
}

/// Keeps the size of a window for the process that follows.
#[derive(Debug, Default)]
pub struct Keeper {
    kept: Extent,
    seen: Extent,
    since_tick: u64,
}

impl Keeper {
    /// Goes on from the size that the process before has kept, if there was one.
    pub fn after(before: Option<Extent>) -> Keeper {
        Keeper { kept: before.unwrap_or_default(), ..Keeper::default() }
    }

    /// Takes how large the window is; of one that fills the screen the size that it has there.
    pub fn keep(&mut self, station: &Station, tick: u64, now: Extent) {
        let stays = now.is_full && is_of_a_window(self.kept.size_px);
        let now = Extent { size_px: if stays { self.kept.size_px } else { now.size_px }, ..now };
        if now != self.seen {
            (self.seen, self.since_tick) = (now, tick);
        }
        if now == self.kept || !is_of_a_window(now.size_px) || tick < self.since_tick + STANDS_TICKS {
            return;
        }
        self.kept = now;
        let [width, height] = now.size_px;
        let text = format!("{width}x{height}{}\n", if now.is_full { FULL } else { "" });
        // Refused, the next window has the size of before, or its first: no reason to stop drawing. It is tried again with the next size.
        let _ = whole::write(&file(station), text.as_bytes());
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

    fn framed(size_px: [u32; 2]) -> Extent {
        Extent { size_px, is_full: false }
    }

    fn before_px(station: &Station) -> Option<[u32; 2]> {
        before(station).map(|extent| extent.size_px)
    }

    #[test]
    fn a_window_that_fills_the_screen_is_followed_by_one_that_does_and_goes_back_to_the_size_it_had() {
        let station = founded("size-full");
        let (small, screen) = (framed([800, 600]), Extent { size_px: [1_920, 1_080], is_full: true });
        let mut keeper = Keeper::after(None);
        for (tick, extent) in [(0, small), (500, small), (600, screen), (1_100, screen)] {
            keeper.keep(&station, tick, extent);
        }
        let full = Extent { is_full: true, ..small };
        assert_eq!(before(&station), Some(full));
        let mut keeper = Keeper::after(before(&station));
        for tick in [0, 600] {
            keeper.keep(&station, tick, screen);
        }
        assert_eq!(before(&station), Some(full));
        // Back again; it has the size of the screen for a moment.
        for (tick, extent) in [(700, framed([1_920, 1_080])), (750, small), (1_250, small)] {
            keeper.keep(&station, tick, extent);
        }
        assert_eq!(before(&station), Some(small));
        station.wipe();
    }

    #[test]
    fn a_size_that_has_stood_for_a_while_is_the_successors_and_one_on_the_way_there_is_not() {
        let station = founded("size-kept");
        let mut keeper = Keeper::default();
        assert_eq!(before_px(&station), None, "nobody was before the first");
        let mut seen = Vec::new();
        for (tick, size_px) in [(0, [640, 480]), (499, [640, 480]), (500, [640, 480]), (900, [700, 500]), (1_399, [800, 600])] {
            keeper.keep(&station, tick, framed(size_px));
            seen.push(before_px(&station));
        }
        let first = Some([640, 480]);
        assert_eq!(seen, [None, None, first, first, first]);
        keeper.keep(&station, 1_899, framed([800, 600]));
        assert_eq!(before_px(&station), Some([800, 600]));
        keeper.keep(&station, 2_000, framed([3, 2]));
        keeper.keep(&station, 9_000, framed([3, 2]));
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
            keeper.keep(&station, tick, framed([800, 600]));
        }
        assert_eq!(before_px(&station), None);
    }
}
