//! The heartbeat while a driver starts: opening a device and compiling its shaders takes about a second in which the loop cannot beat.

use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::page::header;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two beats, ns: well within the 200 ms that the supervisor is promised.
const INTERVAL_NS: u64 = 50_000_000;
/// A driver that has not started by then hangs: the beat ends, and the supervisor ends the process. Lavapipe takes about a second, a loaded
/// machine ten times as long.
const MAX_START_NS: u64 = 30_000_000_000;

/// Beats until it is dropped.
pub struct Pulse {
    over: Arc<AtomicBool>,
    handle: Option<std::thread::JoinHandle<()>>,
}

impl Pulse {
    /// Begins to beat.
    pub fn start(life: &Life) -> Result<Pulse, Failure> {
        let over = Arc::new(AtomicBool::new(false));
        let (ended, page) = (Arc::clone(&over), Arc::clone(&life.page));
        let until_ns = system::now_ns() + MAX_START_NS;
        let body = move || {
            while !ended.load(Ordering::Acquire) && system::now_ns() < until_ns {
                page.store64(header::HEARTBEAT_NS, system::now_ns());
                std::thread::park_timeout(std::time::Duration::from_nanos(INTERVAL_NS));
            }
        };
        let handle = std::thread::Builder::new().name("pulse".into()).spawn(body)?;
        Ok(Pulse { over, handle: Some(handle) })
    }
}

impl Drop for Pulse {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(handle) = self.handle.take() {
            handle.thread().unpark();
            let _ = handle.join(); // it has nothing to say at its end
        }
    }
}
