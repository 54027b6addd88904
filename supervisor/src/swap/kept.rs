//! The station's own copies of the engines that it was given. A developer who builds anew over the file that a swap named changes nothing in a station that
//! runs: what was verified is what starts, also after the next death, and what a swap is rolled back to is what ran before it.

use crate::campaign::draw::hash;
use crate::plan::Plan;
use crate::swap::Record;
use hyst_exchange::Station;
use rustix::fs::StatVfsMountFlags;
use std::path::{Path, PathBuf};

/// The file that says where a copy is from, beside it.
const FROM: &str = "from";

fn folder(station: &Station) -> PathBuf {
    station.root().join("engines")
}

/// Copies an engine into the station's root; gives the copy. Where nothing in there may be started, the engine stays where it is.
pub fn keep(station: &Station, binary: &Path) -> Result<PathBuf, String> {
    let refuse = |what: &Path, error: std::io::Error| format!("{}: {error}; look at `df /dev/shm`", what.display());
    let mounted = rustix::fs::statvfs(station.root()).map_err(|error| refuse(station.root(), error.into()))?;
    let Some(name) = binary.file_name().filter(|name| *name != FROM) else { return Ok(binary.to_path_buf()) };
    if mounted.f_flag.contains(StatVfsMountFlags::NOEXEC) {
        return Ok(binary.to_path_buf());
    }
    forget(station);
    let bytes = std::fs::read(binary).map_err(|error| format!("{}: {error}", binary.display()))?;
    let from = binary.as_os_str().as_encoded_bytes();
    let own = folder(station).join(format!("{:016x}-{:016x}", hash(from), hash(&bytes)));
    let copy = own.join(name);
    if copy.exists() {
        return Ok(copy);
    }
    // Into its place as a whole, and by that name only when it is all there.
    let next = own.with_extension("next");
    let make = || {
        let _ = std::fs::remove_dir_all(&next); // of one that was cut off
        std::fs::create_dir_all(&next)?;
        std::fs::write(next.join(name), &bytes)?; // what was read, whatever the file is by now
        std::fs::set_permissions(next.join(name), std::fs::metadata(binary)?.permissions())?;
        std::fs::write(next.join(FROM), from)?;
        std::fs::rename(&next, &own)
    };
    make().map_err(|error| {
        let _ = std::fs::remove_dir_all(&next);
        refuse(&own, error)
    })?;
    Ok(copy)
}

/// The file that a copy is from; the path itself if it is no copy.
pub fn name_of(path: &Path) -> PathBuf {
    let is_copy = path.ancestors().nth(2).is_some_and(|above| above.ends_with("engines"));
    let from = path.parent().filter(|_| is_copy).and_then(|folder| std::fs::read_to_string(folder.join(FROM)).ok());
    from.map_or_else(|| path.to_path_buf(), PathBuf::from)
}

/// Removes the copies that neither the plan nor the newest swap names.
fn forget(station: &Station) {
    let swapped = Plan::read(station).map(|plan| plan.swapped).unwrap_or_default();
    let record = Record::read(station).map(|record| [record.binary, record.before]);
    let needed: Vec<PathBuf> = swapped.into_values().chain(record.into_iter().flatten()).collect();
    for entry in std::fs::read_dir(folder(station)).into_iter().flatten().flatten() {
        let path = entry.path();
        if !needed.iter().any(|file| file.starts_with(&path)) {
            let _ = std::fs::remove_dir_all(path); // what stays goes with the station
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_stays_what_it_was_is_called_by_its_first_name_and_goes_when_nobody_needs_it() {
        let station = Station::named(&format!("t{}-kept", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let work = station.root().join("work");
        std::fs::create_dir(&work).unwrap();
        let mine = work.join("my-fluid");
        std::fs::write(&mine, "good").unwrap();
        let good = keep(&station, &mine).unwrap();
        assert_eq!(keep(&station, &mine).unwrap(), good, "the same is kept once");
        std::fs::write(&mine, "bad").unwrap();
        let mut plan =
            Plan { binaries: work.clone(), slots: vec![], swapped: Default::default(), end_tick: None, faults: vec![] };
        plan.swapped.insert("fluid".into(), good.clone());
        plan.write(&station).unwrap();
        let bad = keep(&station, &mine).unwrap();
        assert_ne!(good, bad);
        assert_eq!([&good, &bad].map(|copy| std::fs::read_to_string(copy).unwrap()), ["good", "bad"]);
        assert_eq!([&good, &bad].map(|copy| name_of(copy)), [mine.clone(), mine.clone()]);
        assert_eq!(name_of(&mine), mine, "no copy");
        plan.swapped.insert("fluid".into(), bad.clone());
        plan.write(&station).unwrap();
        std::fs::write(&mine, "better").unwrap();
        keep(&station, &mine).unwrap();
        assert!(!good.exists() && bad.exists(), "nobody runs the first any more");
        assert!(keep(&station, &work.join("absent")).unwrap_err().contains("absent"));
        station.wipe();
    }
}
