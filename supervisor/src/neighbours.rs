//! Other stations that run on this machine, as far as they can be seen from here. All that a station makes bears its name, but cores, /dev/shm and disks are
//! everybody's, and what is filled for a fault of one is full for all.
//!
//! Seen are those whose roots lie where one's own does: one with a /dev/shm of its own is not, and that is not filled either. Of another user's it is known that
//! it runs, and neither where it records nor whether it is in test mode: it counts as one that trains.

use crate::faultfile::FaultKind;
use crate::remains::{self, Living};
use crate::shortage;
use hyst_exchange::{Station, system};
use hyst_messages::SLOTS;
use hyst_messages::page::station as layout;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Most that are named in a line.
const MOST_NAMED: usize = 4;
/// A supervisor that has not beaten for so long has ended, ns: it beats every few milliseconds, and one that hangs is replaced long before.
const SILENT_NS: u64 = 3_000_000_000;

/// A station that runs.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Neighbour {
    name: String,
    is_test: bool,
    /// The file systems of its root and of its recording, by the system's numbers, where they were asked for.
    disks: Vec<u64>,
}

/// Whose station has a root that is called so, and its name; `None` of what is no root.
pub fn owner_and_name(root: &str) -> Option<(u32, &str)> {
    let (owner, name) = root.strip_prefix("hystation-")?.split_once('-')?;
    Some((owner.parse().ok()?, name))
}

/// Whether the file system that is filled for a kind of fault of a station may be, for all that others have there; whatever fills none may be. Not for whoever
/// has no time: another one's disk may not answer.
pub fn check_for(station: &Station, kind: FaultKind) -> Result<(), String> {
    let ballast = shortage::ballast(station, kind);
    ballast.as_deref().and_then(Path::parent).map_or(Ok(()), |folder| check(folder, kind, Some(station)))
}

/// The same of a station that begins, with a fault of that kind in its schedule, and records into this file or folder. Where there is too much room to be filled
/// nobody is hurt, and nobody is asked.
pub fn check_begun(station: &Station, record: Option<&Path>, kind: FaultKind) -> Result<(), String> {
    let folder = match kind {
        FaultKind::ShmFull => station.root().parent(),
        FaultKind::DiskFull => record.and_then(|path| if path.is_dir() { Some(path) } else { path.parent() }),
        _ => None,
    };
    let filled = folder.filter(|folder| shortage::check_folder(folder, kind).is_ok());
    filled.map_or(Ok(()), |folder| check(folder, kind, Some(station)))
}

/// Refuses to fill the file system of a folder that another station has, too, unless that one is there to be tried as well. It waits for disks, as
/// [`check_for`].
pub fn check(folder: &Path, kind: FaultKind, own: Option<&Station>) -> Result<(), String> {
    disk_of(folder).map_or(Ok(()), |disk| check_among(&running(own, true), disk, kind))
}

fn check_among(others: &[Neighbour], disk: u64, kind: FaultKind) -> Result<(), String> {
    match others.iter().find(|other| !other.is_test && other.disks.contains(&disk)) {
        None => Ok(()),
        Some(other) => {
            let (kind, name, cure) = (kind.name(), &other.name, shortage::cure(kind));
            Err(format!("{kind}: station {name:?} runs on the same file system and is not in test mode; end it first, or {cure}"))
        }
    }
}

/// What whoever begins to hurt a station is told of those beside it that are not there for that; `None` if there are none. It waits for
/// nobody's disk.
pub fn warning(own: &Station) -> Option<String> {
    warning_of(&running(Some(own), false))
}

fn warning_of(others: &[Neighbour]) -> Option<String> {
    let train: Vec<&str> = others.iter().filter(|other| !other.is_test).map(|other| other.name.as_str()).collect();
    let more = if train.len() > MOST_NAMED { format!(" and {} more", train.len() - MOST_NAMED) } else { String::new() };
    let names = train[..train.len().min(MOST_NAMED)].join(", ");
    let shared = "faults here may cost time there, for cores, /dev/shm and disks are shared";
    (!train.is_empty()).then(|| format!("on the same machine, and not in test mode: {names}{more}; {shared}"))
}

/// Those who run, but for one's own, by their names, and with their disks if those are asked for.
fn running(own: Option<&Station>, with_disks: bool) -> Vec<Neighbour> {
    let folder = Station::named("default").ok().and_then(|station| station.root().parent().map(Path::to_path_buf));
    let entries = folder.and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten();
    let roots = entries.map(|entry| entry.path()).filter(|root| own.is_none_or(|own| own.root() != root));
    let mut found: Vec<Neighbour> = roots.filter_map(|root| neighbour(&root, with_disks)).collect();
    found.sort_by(|one, other| one.name.cmp(&other.name));
    found
}

/// The station of a root, if it runs.
fn neighbour(root: &Path, with_disks: bool) -> Option<Neighbour> {
    let named = root.file_name()?.to_str()?;
    let (owner, name) = owner_and_name(named)?;
    let disks_of = |recording: Option<PathBuf>| -> Vec<u64> {
        let folders = [Some(root.to_path_buf()), recording].into_iter().flatten().filter(|_| with_disks);
        folders.filter_map(|folder| disk_of(&folder)).collect()
    };
    if owner != system::user_id() {
        return is_taken(named).then(|| Neighbour { name: name.into(), is_test: false, disks: disks_of(None) });
    }
    let station = Station::named(name).ok()?;
    let page = station.open().ok()?;
    let process = (0..SLOTS).find_map(|slot| remains::slot_alive(&page, slot));
    // Of one in another container no process is seen from here.
    let beats = || system::now_ns().saturating_sub(page.page().load64(layout::SUPERVISOR_NS)) < SILENT_NS;
    if process.is_none() && !beats() {
        return None;
    }
    let ballast = shortage::ballast(&station, FaultKind::DiskFull).filter(|_| with_disks); // it lies where the recording does
    let recording = ballast.as_deref().and_then(Path::parent).map(|folder| seen_by(process.as_ref(), folder));
    Some(Neighbour { name: name.into(), is_test: page.test_mode(), disks: disks_of(recording) })
}

/// A folder as a process sees it, for whom something else may be mounted there; as it is from here of one that is not seen.
fn seen_by(process: Option<&Living>, folder: &Path) -> PathBuf {
    let root = process.map(|process| PathBuf::from(format!("/proc/{}/root", process.pid)));
    let seen = root.map(|root| root.join(folder.strip_prefix("/").unwrap_or(folder)));
    seen.filter(|seen| disk_of(seen).is_some()).unwrap_or_else(|| folder.into())
}

fn disk_of(path: &Path) -> Option<u64> {
    std::fs::metadata(path).ok().map(|data| data.dev())
}

/// Whether somebody has the name of a station, whose root bears it: an abstract socket.
fn is_taken(root: &str) -> bool {
    let sockets = std::fs::read("/proc/net/unix").unwrap_or_default();
    let is_it = |line: &str| line.split_whitespace().next_back().and_then(|name| name.strip_prefix('@')) == Some(root);
    String::from_utf8_lossy(&sockets).lines().any(is_it)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::book;
    use crate::supervise::register;
    use hyst_engine::Settings;
    use hyst_messages::Role;
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::net::{SocketAddr, UnixListener};

    /// A test station filled the memory, and the disk, of one that trained.
    #[test]
    fn who_runs_beside_a_station_is_seen_with_its_mode_and_its_file_systems() {
        let ([(own, _), (other, _)], disk) = (["near-own", "near"].map(book), |path: &Path| disk_of(path).unwrap());
        let page = other.open_for_keeping().unwrap();
        let seen = || running(Some(&*own), true).into_iter().find(|it| it.name == other.name());
        assert_eq!(seen(), None, "nobody lives there");
        page.store64(layout::SUPERVISOR_NS, system::now_ns() + SILENT_NS); // also where the machine stands for long
        assert!(seen().is_some(), "it beats, and has its processes in another container");
        page.store64(layout::SUPERVISOR_NS, 0);
        register(&page, Role::Guardian);
        let (name, temp) = (other.name().to_string(), std::env::temp_dir());
        let mut expected = Neighbour { name, is_test: false, disks: vec![disk(other.root())] };
        assert_eq!(seen().as_ref(), Some(&expected));
        let settings = Settings { record: Some(temp.join("session.mcap")), ..Settings::default() };
        std::fs::write(other.settings(), toml::to_string(&settings).unwrap()).unwrap();
        page.store32(layout::TEST_MODE, 1);
        (expected.is_test, expected.disks) = (true, vec![disk(other.root()), disk(&temp)]);
        assert_eq!(seen().as_ref(), Some(&expected));
        let quick = running(Some(&*own), false).into_iter().find(|it| it.name == other.name());
        assert_eq!(quick, Some(Neighbour { disks: Vec::new(), ..expected }), "nobody's disk is waited for");
        assert!(running(Some(&*other), true).iter().all(|it| it.name != other.name()), "of one's own nobody is told");
    }

    #[test]
    fn what_another_one_trains_on_is_not_filled_and_what_one_has_that_is_tried_is() {
        let of = |name: &str, is_test: bool, disks: &[u64]| Neighbour { name: name.into(), is_test, disks: disks.to_vec() };
        let others = [of("second", true, &[7, 9]), of("third", false, &[7, 8])];
        let refused = |disk: u64, kind: FaultKind| check_among(&others, disk, kind).err();
        assert_eq!([9, 5].map(|disk| refused(disk, FaultKind::ShmFull)), [None, None]);
        for (disk, kind, cure) in [(7, FaultKind::ShmFull, "unshare -m"), (8, FaultKind::DiskFull, "--record FOLDER")] {
            let reason = refused(disk, kind).unwrap();
            let head = format!("{}: station \"third\" runs on the same file system", kind.name());
            assert!(reason.starts_with(&head) && reason.contains(cure), "{reason}");
        }
        let line = warning_of(&others).unwrap();
        assert!(line.contains(": third; ") && !line.contains("second"), "{line}");
        assert_eq!(warning_of(&others[..1]), None);
        let many: Vec<Neighbour> = (0..9).map(|index| of(&format!("n{index}"), false, &[])).collect();
        assert!(warning_of(&many).unwrap().contains(": n0, n1, n2, n3 and 5 more; "));
    }

    #[test]
    fn a_name_is_taken_while_somebody_listens_under_it() {
        let root = format!("hystation-77-near-{}", std::process::id());
        assert_eq!((owner_and_name(&root).map(|(owner, _)| owner), is_taken(&root)), (Some(77), false));
        let _listener = UnixListener::bind_addr(&SocketAddr::from_abstract_name(&root).unwrap()).unwrap();
        assert!(is_taken(&root));
    }
}
