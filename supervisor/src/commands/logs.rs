//! `hystation logs`: what happened in a station, and what a process printed.

use super::no_station;
use crate::settings::Refusal;
use hyst_exchange::{Station, system};
use hyst_messages::Slot;
use std::io::{Read, Seek, Write};

const LOOK_NS: u64 = 200_000_000;
/// At most this much of the end of a log is shown, bytes.
const MOST_BYTES: u64 = 4 << 20;

/// Prints a log, and goes on printing if asked to until the station is gone.
pub fn logs(station: &Station, process: Option<&str>, follow: bool) -> Result<u8, Refusal> {
    if !station.root().is_dir() {
        return Err(no_station(station));
    }
    let path = match process {
        None => station.events(),
        Some(name) => {
            let slot = Slot::parse(name)
                .ok_or_else(|| Refusal::input(format!("{name:?} is no process; use a name that `status` shows")))?;
            station.log(slot)
        }
    };
    let Ok(mut file) = std::fs::File::open(&path) else {
        eprintln!("hystation: nothing was logged yet");
        return Ok(0);
    };
    let length = file.metadata().map_or(0, |data| data.len());
    let _ = file.seek(std::io::SeekFrom::Start(length.saturating_sub(MOST_BYTES))); // else from the start
    loop {
        let mut bytes = Vec::new();
        // One that was shortened is shown from its beginning.
        let length = file.metadata().map_or(0, |data| data.len());
        if file.stream_position().is_ok_and(|at| at > length) {
            let _ = file.rewind(); // else what is new is shown
        }
        Read::take(&mut file, MOST_BYTES)
            .read_to_end(&mut bytes)
            .map_err(|e| Refusal::failed(format!("{}: {e}", path.display())))?;
        if std::io::stdout().write_all(&bytes).and_then(|()| std::io::stdout().flush()).is_err()
            || !follow
            || !station.root().is_dir()
        {
            return Ok(0);
        }
        system::sleep_ns(LOOK_NS);
    }
}
