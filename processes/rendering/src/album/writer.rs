//! The thread that writes pictures: a folder that hangs, on a share or a stick, holds up it alone.
//!
//! Promise: what is put here is written in its order; whoever puts it waits for nothing, and is to ask before whether there is room.

use super::{FILM, name_of};
use rendering::{RenderError, append_jpeg, save_png};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};

/// Pictures that wait for the folder at most, beside the one that is written: each has 8 MB on a GPU.
const WAITING: usize = 2;

/// A picture as it was read: rows from the top, RGBA with 8 bits each.
#[derive(Debug)]
pub struct Shot {
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// Its pixels.
    pub rgba: Vec<u8>,
}

/// Whoever puts pictures there.
#[derive(Debug)]
pub struct Writer {
    queue: SyncSender<Shot>,
    done: Receiver<Result<(), RenderError>>,
    under_way: usize,
}

impl Writer {
    /// Begins, in a film or with a file of this number.
    pub fn start(folder: PathBuf, is_film: bool, next: u32) -> std::io::Result<Writer> {
        let (queue, queued) = sync_channel(WAITING + 1);
        let (tell, done) = channel();
        let body = move || write(&folder, is_film, next, &queued, &tell);
        std::thread::Builder::new().name("album".into()).spawn(body)?;
        Ok(Writer { queue, done, under_way: 0 })
    }

    /// Whether there is room for another one.
    pub fn has_room(&self) -> bool {
        self.under_way <= WAITING
    }

    /// Gives it a picture, for which there is room.
    pub fn put(&mut self, shot: Shot) {
        self.under_way += usize::from(self.queue.try_send(shot).is_ok());
    }

    /// What has come of a picture, waiting for at most so long; `None` if nothing is known of a further one.
    pub fn heard(&mut self, within: Duration) -> Option<Result<(), RenderError>> {
        let heard = self.done.recv_timeout(within).ok()?;
        self.under_way -= 1;
        Some(heard)
    }

    /// Waits until everything is written, for at most so long; gives what has come of it, and how many pictures were not written by then.
    pub fn end(mut self, within: Duration) -> (Vec<Result<(), RenderError>>, usize) {
        let (end, mut all) = (Instant::now() + within, Vec::new());
        while self.under_way > 0 {
            let Some(heard) = self.heard(end.saturating_duration_since(Instant::now())) else { break };
            all.push(heard);
        }
        (all, self.under_way)
    }
}

fn write(folder: &Path, is_film: bool, mut next: u32, queued: &Receiver<Shot>, tell: &Sender<Result<(), RenderError>>) {
    for Shot { size_px, rgba } in queued {
        let kept = match is_film {
            true => append_jpeg(&folder.join(FILM), size_px, &rgba),
            false => save_png(&folder.join(name_of(next)), size_px, &rgba),
        };
        next = next.saturating_add(u32::from(kept.is_ok()));
        if tell.send(kept).is_err() {
            return; // nobody waits for it any more
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Longer than any folder takes that does take something.
    const LONG: Duration = Duration::from_secs(60);

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hystation-album-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder); // of a process that had this number and left it
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn shot() -> Shot {
        Shot { size_px: [16, 8], rgba: vec![90; 4 * 16 * 8] }
    }

    #[test]
    fn everything_that_was_put_is_written_at_the_end_and_what_is_no_picture_is_an_error_and_takes_no_number() {
        let folder = folder("written");
        let mut writer = Writer::start(folder.clone(), false, 7).unwrap();
        for shot in [shot(), Shot { rgba: vec![1, 2, 3], ..shot() }, shot()] {
            assert!(writer.has_room());
            writer.put(shot);
        }
        let (all, left) = writer.end(LONG);
        assert_eq!((all.iter().map(Result::is_ok).collect::<Vec<_>>(), left), (vec![true, false, true], 0));
        let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["picture-00007.png", "picture-00008.png"]);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A share that hung had window, keys and heartbeat hang with it.
    #[test]
    fn a_folder_that_hangs_holds_nobody_up_and_has_room_for_no_more_than_wait_for_it() {
        let folder = folder("hangs");
        // Whoever opens it waits for a reader, who never comes.
        let made = std::process::Command::new("mkfifo").arg(folder.join(FILM)).status();
        assert!(made.is_ok_and(|status| status.success()), "mkfifo, of coreutils");
        let mut writer = Writer::start(folder.clone(), true, 0).unwrap();
        let mut put = 0;
        for _ in 0..10 {
            if writer.has_room() {
                writer.put(shot());
                put += 1;
            }
        }
        assert_eq!(put, WAITING + 1);
        assert!(writer.heard(Duration::ZERO).is_none());
        let (all, left) = writer.end(Duration::ZERO);
        assert_eq!((all.len(), left), (0, WAITING + 1));
        // The reader comes after all: the thread has the folder no more, and can put no file into it while it is removed.
        assert!(!std::fs::read(folder.join(FILM)).unwrap().is_empty());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
