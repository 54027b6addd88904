//! Whether a station has room in /dev/shm. Where the whole of it is too small it is so at the next start, too, until somebody enlarges it: bad input, after which
//! a service stays ended. Where others fill it, they may be gone the next moment: a start by hand fails at once, and a service waits a while and tries again.

use crate::notify::Notifier;
use crate::settings::Refusal;
use hyst_exchange::system;

/// How long a service waits before it fails, ns: so it is tried some seven times in a minute, and the unit gives up after ten.
const SERVICE_WAITS_NS: u64 = 8_000_000_000;
/// Between two looks, ns.
const LOOK_NS: u64 = 100_000_000;

/// What a file system has, bytes.
#[derive(Clone, Copy, Debug)]
struct Space {
    free: u64,
    all: u64,
}

impl Space {
    /// That of /dev/shm; `None` if the system does not say.
    fn now() -> Option<Space> {
        let disk = rustix::fs::statvfs("/dev/shm").ok()?;
        Some(Space { free: disk.f_bavail * disk.f_frsize, all: disk.f_blocks * disk.f_frsize })
    }

    /// Why a station that needs so many bytes does not start.
    fn refuses(self, needed: u64) -> Option<Refusal> {
        let [free_mib, all_mib, need_mib] = [self.free, self.all, needed].map(|bytes| bytes >> 20);
        let has = format!("/dev/shm has {free_mib} MiB free of {all_mib}, a station needs {need_mib}");
        let size = size_for(self.all.saturating_sub(self.free).saturating_add(needed));
        let enlarge = format!("enlarge it (`mount -o remount,size={size} /dev/shm`, docker: --shm-size={size})");
        match () {
            () if self.free >= needed => None,
            () if self.all < needed => Some(Refusal::input(format!("{has}; {enlarge}"))),
            () => Some(Refusal::failed(format!("{has}; remove files there (`ls -l /dev/shm`) or {enlarge}"))),
        }
    }
}

/// A size of /dev/shm in which there is room for so many bytes, as `mount` and docker take it.
pub fn size_for(bytes: u64) -> String {
    format!("{}g", bytes.div_ceil(1 << 30).max(1))
}

/// Waits for so many bytes if a service's manager is there, until it is given up, and else looks once.
///
/// # Errors
/// There is no room.
pub fn await_room(needed: u64, manager: &Notifier, given_up: &dyn Fn() -> bool) -> Result<(), Refusal> {
    let deadline_ns = system::now_ns() + if manager.is_there() { SERVICE_WAITS_NS } else { 0 };
    loop {
        let refusal = Space::now().and_then(|space| space.refuses(needed));
        if let Some(end) = comes_to(refusal, system::now_ns() >= deadline_ns, given_up()) {
            return end;
        }
        manager.say("STATUS=waits for room in /dev/shm\n");
        system::sleep_ns(LOOK_NS);
    }
}

/// What a look comes to; nothing while it is worth another one.
fn comes_to(refusal: Option<Refusal>, is_late: bool, is_given_up: bool) -> Option<Result<(), Refusal>> {
    match refusal {
        None => Some(Ok(())),
        Some(_) if is_given_up => Some(Err(Refusal::stopped())),
        Some(refusal) if refusal.code == 2 || is_late => Some(Err(refusal)),
        Some(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_small_as_a_whole_is_bad_input_and_what_others_fill_is_worth_another_try() {
        let code = |free_mib: u64, all_mib: u64| {
            let refusal = Space { free: free_mib << 20, all: all_mib << 20 }.refuses(608 << 20)?;
            let words = format!("/dev/shm has {free_mib} MiB free of {all_mib}, a station needs 608; ");
            assert!(refusal.message.starts_with(&words) && refusal.message.contains("remount"), "{}", refusal.message);
            assert_eq!(refusal.message.contains("ls -l"), refusal.code == 1, "{}", refusal.message);
            Some(refusal.code)
        };
        assert_eq!([code(608, 608), code(608, 1_024), code(1_024, 1_024)], [None; 3]);
        assert_eq!([code(64, 64), code(607, 607), code(0, 100)], [Some(2); 3]);
        assert_eq!([code(607, 608), code(0, 1_024)], [Some(1); 2]);
    }

    /// It waited on, and had failed, when it was long asked to stop.
    #[test]
    fn who_is_asked_to_stop_while_it_waits_for_room_ends_and_has_not_failed() {
        let code = |refusal: Option<Refusal>, is_late: bool, is_given_up: bool| {
            comes_to(refusal, is_late, is_given_up).map(|end| end.map_or_else(|refusal| refusal.code, |()| 7))
        };
        let full = |is_late: bool, is_given_up: bool| code(Some(Refusal::failed("full")), is_late, is_given_up);
        assert_eq!([full(false, false), full(true, false), full(false, true)], [None, Some(1), Some(0)]);
        assert_eq!(code(Some(Refusal::input("too small")), false, false), Some(2));
        assert_eq!([code(None, true, false), code(None, false, true)], [Some(7); 2], "there is room, and it begins");
    }

    /// To whom 5 GiB were lacking a cure of 1 GiB was named.
    #[test]
    fn the_size_that_is_named_is_one_in_which_the_station_has_room() {
        let cure = |free_mib: u64, all_mib: u64, needed_mib: u64| {
            Space { free: free_mib << 20, all: all_mib << 20 }.refuses(needed_mib << 20).unwrap().message
        };
        assert!(cure(64, 64, 608).contains("size=1g /dev/shm`, docker: --shm-size=1g"));
        assert!(cure(300, 1_024, 608).contains("size=2g"), "what others have there stays");
        assert!(cure(1_024, 1_024, 5_200).contains("size=6g"));
        assert_eq!([0, 1 << 30, (1 << 30) + 1].map(size_for), ["1g", "1g", "2g"]);
    }
}
