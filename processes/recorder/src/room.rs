//! How much room the disk of the recording has left: asked on a thread of its own, because a disk that stands still answers that question as little as it
//! takes a block, and left in the station's root for whoever looks at the station. Promise: nobody waits for the disk.

use hyst_exchange::{Station, system, whole};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::time::Duration;

/// Between two questions.
const EVERY: Duration = Duration::from_secs(5);

/// The thread. It ends with this, or as soon as the disk has answered it.
pub struct Room {
    _ends: Sender<()>,
}

impl Room {
    /// Starts it, for a recording's file; `None` on a machine that has no thread for it, where nothing is told. One at a time: of who holds the file.
    pub fn watch(station: &Station, file: &Path) -> Option<Room> {
        let (ends, ended) = channel();
        let (folder, told) = (folder_of(file), station.room());
        std::thread::Builder::new().name("room".into()).spawn(move || serve(&folder, &told, &ended)).ok()?;
        Some(Room { _ends: ends })
    }
}

fn folder_of(file: &Path) -> PathBuf {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new(".")).to_path_buf()
}

fn serve(folder: &Path, told: &Path, ended: &Receiver<()>) {
    loop {
        let free_bytes = system::free_bytes(folder).ok();
        // While the disk was asked the recording may have gone to another recorder, or the station may have ended.
        if ended.try_recv() == Err(TryRecvError::Disconnected) {
            return;
        }
        tell(told, free_bytes);
        if ended.recv_timeout(EVERY) != Err(RecvTimeoutError::Timeout) {
            return;
        }
    }
}

/// What is known; what is not is taken away, and what cannot be told now is told the next time.
fn tell(told: &Path, free_bytes: Option<u64>) {
    let _ = match free_bytes {
        Some(free_bytes) => whole::write(told, free_bytes.to_string().as_bytes()),
        None => std::fs::remove_file(told),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_of_a_recordings_disk_is_told_and_is_not_told_any_more_once_nobody_knows_it() {
        let station = Station::named(&format!("t{}-room", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let room = Room::watch(&station, &station.root().join("a.mcap"));
        assert!(room.is_some());
        // One that nobody tells is waited for without end, which is ended from outside.
        let free = std::iter::repeat_with(|| std::fs::read_to_string(station.room())).find_map(Result::ok).unwrap();
        assert!(free.parse::<u64>().is_ok(), "{free:?}");
        drop(room);
        let other = station.root().join("other");
        tell(&other, Some(70));
        assert_eq!(std::fs::read_to_string(&other).unwrap(), "70");
        tell(&other, None);
        assert!(!other.exists(), "a disk that is gone has no room of which anybody knows");
        station.wipe();
    }

    #[test]
    fn a_file_without_a_folder_lies_in_the_one_where_the_recorder_is() {
        assert_eq!(folder_of(Path::new("a.mcap")), Path::new("."));
        assert_eq!(folder_of(Path::new("/x/a.mcap")), Path::new("/x"));
    }
}
