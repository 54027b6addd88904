//! The pad as the kernel gives it: an input device, found by its path or as the first of its make.

use super::Source;
use super::make::{AXES, Event, Make, Ranges};
use evdev::{AbsoluteAxisCode, Device, KeyCode, RelativeAxisCode};
use hyst_exchange::system;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::io;
use std::os::fd::AsFd;
use std::path::PathBuf;

impl Source for Device {
    fn ranges(&self) -> Ranges {
        let infos = self.get_absinfo().into_iter().flatten();
        Ranges::new(infos.map(|(axis, info)| (axis.0, info.minimum(), info.maximum())))
    }

    fn next(&mut self, until_ns: Option<u64>) -> io::Result<Vec<Event>> {
        if let Some(until_ns) = until_ns
            && !speaks_by(self, until_ns)
        {
            return Ok(Vec::new());
        }
        let events = self.fetch_events()?;
        Ok(events.map(|event| Event { kind: event.event_type().0, code: event.code(), value: event.value() }).collect())
    }
}

/// What `--hand` names: the one at the path, or the first of its make.
pub fn find(make: Make, path: Option<&PathBuf>) -> Result<Device, String> {
    match path {
        Some(path) => {
            let no = |what: &str| format!("--hand {}: {}: {what}", make.name(), path.display());
            let device = Device::open(path).map_err(|error| match error.kind() {
                io::ErrorKind::NotFound | io::ErrorKind::PermissionDenied => no(&error.to_string()),
                _ => no("no input device"),
            })?;
            if is(make, &device) { Ok(device) } else { Err(no("an input device of another kind")) }
        }
        None => evdev::enumerate().map(|(_, device)| device).find(|device| is(make, device)).ok_or_else(|| {
            let name = make.name();
            format!("--hand {name}: no {name} among /dev/input/event*, or no right to read it (`usermod -aG input $USER`)")
        }),
    }
}

/// Whether a device is of a make.
fn is(make: Make, device: &Device) -> bool {
    let has_key = |key: KeyCode| device.supported_keys().is_some_and(|keys| keys.contains(key));
    let turns = |axis: u16| {
        device.supported_absolute_axes().is_some_and(|axes| axes.contains(AbsoluteAxisCode(axis)))
            || device.supported_relative_axes().is_some_and(|axes| axes.contains(RelativeAxisCode(axis)))
    };
    match make {
        Make::Gamepad => has_key(KeyCode::BTN_SOUTH) && turns(0) && turns(1),
        Make::SpaceMouse => has_key(KeyCode::BTN_0) && (0..AXES as u16).all(turns) && !has_key(KeyCode::BTN_SOUTH),
    }
}

/// Waits until there is something to read, or until a time, ns; whether there is. There is of one that is gone: that it is the reading says.
fn speaks_by(source: &impl AsFd, until_ns: u64) -> bool {
    let left_ns = until_ns.saturating_sub(system::now_ns());
    let left = Timespec { tv_sec: (left_ns / 1_000_000_000) as i64, tv_nsec: (left_ns % 1_000_000_000) as i64 };
    let mut asked = [PollFd::new(source, PollFlags::IN)];
    !matches!(poll(&mut asked, Some(&left)), Ok(0) | Err(Errno::INTR))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::os::unix::net::UnixStream;

    #[test]
    fn what_is_silent_is_waited_for_until_its_time_and_what_speaks_or_is_gone_is_read_however_late_it_is() {
        let (near, mut far) = UnixStream::pair().unwrap();
        let soon_ns = system::now_ns() + 2_000_000;
        assert!(!speaks_by(&near, soon_ns) && system::now_ns() >= soon_ns, "nobody has spoken");
        assert!(!speaks_by(&near, 0));
        far.write_all(b"x").unwrap();
        assert!(speaks_by(&near, 0));
        let (near, far) = UnixStream::pair().unwrap();
        drop(far);
        assert!(speaks_by(&near, 0), "it is gone");
    }
}
