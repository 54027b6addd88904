//! What the guardian prints goes through a thread of its own: a terminal that is held (Ctrl-S) or a pipe that nobody reads holds whoever writes to it,
//! and a guardian that is held keeps nobody.
//!
//! Promise: to say something never waits. What finds no room is dropped, and how much that was is said when there is room again.

use hyst_exchange::system;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

/// Texts that wait to be printed.
const ROOM: usize = 256;
/// How long the end of a run waits until its last words are printed, ns.
const LAST_NS: u64 = 2_000_000_000;
/// Between two looks at that, ns.
const LOOK_NS: u64 = 1_000_000;

/// A text and where it goes.
enum Text {
    /// A line for people, to the standard error stream.
    Line(String),
    /// A whole screen, to the standard output.
    Screen(String),
    /// The terminal's bell, by the standard error stream.
    Bell,
}

/// The way to the thread.
pub struct Printer {
    texts: SyncSender<Text>,
    dropped: Arc<AtomicU64>,
    thread: JoinHandle<()>,
}

impl Printer {
    /// Starts the thread.
    pub fn start() -> std::io::Result<Printer> {
        Printer::start_to(std::io::stderr(), std::io::stdout())
    }

    fn start_to(lines: impl Write + Send + 'static, screen: impl Write + Send + 'static) -> std::io::Result<Printer> {
        let (texts, inbox) = sync_channel(ROOM);
        let dropped = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&dropped);
        let body = move || print(&inbox, &counted, lines, screen);
        let thread = std::thread::Builder::new().name("printer".into()).spawn(body)?;
        Ok(Printer { texts, dropped, thread })
    }

    /// Prints a line.
    pub fn say(&self, line: &str) {
        self.send(Text::Line(format!("hystation: {line}\n")));
    }

    /// Draws a screen.
    pub fn show(&self, screen: String) {
        self.send(Text::Screen(screen));
    }

    /// Rings the terminal's bell.
    pub fn ring(&self) {
        self.send(Text::Bell);
    }

    fn send(&self, text: Text) {
        // The thread has ended only if it panicked, which ends the process.
        if let Err(TrySendError::Full(Text::Line(_))) = self.texts.try_send(text) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits until everything is printed, as long as the last words of a run may take.
    pub fn finish(self) {
        drop(self.texts);
        let deadline_ns = system::now_ns() + LAST_NS;
        while !self.thread.is_finished() && system::now_ns() < deadline_ns {
            system::sleep_ns(LOOK_NS);
        }
    }
}

fn print(inbox: &Receiver<Text>, dropped: &AtomicU64, mut lines: impl Write, mut screen: impl Write) {
    // A terminal that has gone shows nothing.
    let mut write = |text: &Text| match text {
        Text::Line(line) => {
            let _ = lines.write_all(line.as_bytes()).and_then(|()| lines.flush());
        }
        Text::Screen(text) => {
            let _ = screen.write_all(text.as_bytes()).and_then(|()| screen.flush());
        }
        Text::Bell => {
            let _ = lines.write_all(b"\x07").and_then(|()| lines.flush());
        }
    };
    while let Ok(text) = inbox.recv() {
        write(&text);
        let count = dropped.swap(0, Ordering::Relaxed);
        if count > 0 {
            write(&Text::Line(format!("hystation: {count} lines were not printed, since nobody took those before them\n")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn who_says_more_than_is_read_does_not_wait_and_the_rest_is_counted() {
        let (mut reader, writer) = std::io::pipe().unwrap();
        let printer = Printer::start_to(writer, std::io::sink()).unwrap();
        let long = "x".repeat(4_096);
        let since_ns = system::now_ns();
        (0..4 * ROOM).for_each(|_| printer.say(&long)); // 4 MiB, and a pipe holds 64 KiB
        let read = std::thread::spawn(move || {
            let mut text = String::new();
            reader.read_to_string(&mut text).map(|_| text)
        });
        assert!(system::now_ns() - since_ns < 60_000_000_000, "it waited");
        printer.finish();
        let text = read.join().unwrap().unwrap();
        let printed = text.lines().filter(|line| line.ends_with("xxx")).count();
        let said: usize = text.lines().filter(|line| line.contains("were not printed")).map(first_number).sum();
        assert!(printed >= ROOM && said > 0, "{printed} printed");
        assert_eq!(printed + said, 4 * ROOM);
    }

    fn first_number(line: &str) -> usize {
        line.split(' ').find_map(|word| word.parse().ok()).unwrap_or(0)
    }
}
