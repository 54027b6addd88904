//! The thread that waits for the disk to keep what it took, so that the one that writes does not. It is asked one thing at a time.

use hyst_recording::{Disk, TickRange, WriteError, Writer};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// What the disk says when it is asked.
pub type Answer = Result<(), WriteError>;

/// The thread and the way to it.
pub struct Syncer {
    asks: Sender<Vec<TickRange>>,
    answers: Receiver<Answer>,
    thread: JoinHandle<()>,
    busy: bool,
}

impl Syncer {
    /// Starts the thread of a file.
    pub fn start(writer: &Writer) -> std::io::Result<Syncer> {
        let disk = writer.disk()?;
        let (asks, asked) = channel();
        let (answer, answers) = channel();
        let thread = std::thread::Builder::new().name("syncer".into()).spawn(move || serve(&disk, &asked, &answer))?;
        Ok(Syncer { asks, answers, thread, busy: false })
    }

    /// Whether the disk was asked and has not answered.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Has the disk asked to keep what was written so far, with these ticks in it; only if it is not busy.
    pub fn ask(&mut self, ranges: Vec<TickRange>) {
        self.busy = self.asks.send(ranges).is_ok();
    }

    /// What the disk has answered, if it has.
    pub fn answered(&mut self) -> Option<Answer> {
        let answer = self.answers.try_recv().ok()?;
        self.busy = false;
        Some(answer)
    }

    /// What the disk answers, however long that takes; `None` if it was not asked.
    pub fn wait(&mut self) -> Option<Answer> {
        if std::mem::replace(&mut self.busy, false) { self.answers.recv().ok() } else { None }
    }

    /// Ends the thread, and lets go of the file.
    pub fn end(self) {
        drop(self.asks);
        let _ = self.thread.join();
    }
}

/// Asks the disk until nobody asks any more.
fn serve(disk: &Disk, asked: &Receiver<Vec<TickRange>>, answer: &Sender<Answer>) {
    for ranges in asked {
        if answer.send(disk.keep(ranges)).is_err() {
            return;
        }
    }
}
