//! The beginnings of the programs that are started here, which are to stay in the system's memory. Whoever starts a process waits until that has a program of
//! its own: until the kernel has found the file, and has read its beginning, which says what else is to be mapped. The system takes back what was not used for
//! a while, and behind a build a disk takes seconds for it: the supervisor would see to nobody meanwhile, and be taken for one that hangs. So a thread, which
//! may wait for a disk, keeps the files open and reads their beginnings once a second.
//!
//! Promise: whoever starts a process never waits for this thread. Where the system takes back within a second what was read, he waits for the disk.

use crate::plan::Plan;
use crate::proc;
use hyst_exchange::system;
use std::collections::BTreeSet;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

/// A page of memory: a program's header, the list of its parts and the name of its loader are there.
const HEAD_BYTES: usize = 4096;
/// Between two looks, ns: whatever takes memory back takes what was not used for longer, some virtual machines' systems for a minute.
const LOOK_NS: u64 = 1_000_000_000;

/// Has a thread read the beginnings of a plan's programs as long as this process lives. Without one whoever starts a process waits for the disk. A newcomer's
/// program is a copy in memory.
pub(super) fn keep(plan: &Plan) {
    let programs = programs(plan);
    let _ = std::thread::Builder::new().name("heads".into()).spawn(move || read_on(&programs));
}

/// The engines', and this one, which is started as the judge of a newcomer and to clean up after it: its memory may not be locked.
fn programs(plan: &Plan) -> BTreeSet<PathBuf> {
    let engines = plan.slots().into_iter().map(|slot| plan.binary(slot.role()));
    engines.chain([PathBuf::from(proc::OWN_PROGRAM)]).collect()
}

fn read_on(programs: &BTreeSet<PathBuf>) {
    let files = open(programs);
    loop {
        read(&files);
        system::sleep_ns(LOOK_NS);
    }
}

/// Opens the programs that are there, once: what is open need not be looked for again, and where no file can be opened any more nothing changes.
fn open(programs: &BTreeSet<PathBuf>) -> Vec<File> {
    programs.iter().filter_map(|path| File::open(path).ok()).collect()
}

/// Reads the beginnings; gives how many there are.
fn read(files: &[File]) -> usize {
    let mut head = [0u8; HEAD_BYTES];
    files.iter().filter(|file| file.read_at(&mut head, 0).is_ok_and(|bytes| bytes > 0)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{Advice, fadvise};
    use rustix::io::{Errno, ReadWriteFlags, preadv2};
    use std::io::IoSliceMut;

    /// The program of a rendering, of which nobody had used the beginning for a minute, was read from the disk in the supervisor's loop.
    #[test]
    fn a_beginning_that_the_system_has_taken_back_is_there_again_after_a_look() {
        let path = std::env::temp_dir().join(format!("t{}-head", std::process::id()));
        std::fs::write(&path, [7u8; 2 * HEAD_BYTES]).unwrap();
        let files = open(&[path.clone(), PathBuf::from("/nowhere/at/all")].into());
        let [file] = &files[..] else { panic!("{files:?}") };
        file.sync_all().unwrap();
        fadvise(file, 0, None, Advice::DontNeed).unwrap();
        assert_eq!(read(&files), 1);
        // Of a file system that has no disk, or does not tell, another answer comes.
        let found = preadv2(file, &mut [IoSliceMut::new(&mut [0u8])], 0, ReadWriteFlags::NOWAIT);
        std::fs::remove_file(&path).unwrap();
        assert_ne!(found, Err(Errno::AGAIN));
    }

    /// Of a supervisor that was silent for 3 s in a swap a child was left that had no program of its own for two more.
    #[test]
    fn the_programs_are_this_one_and_those_of_the_roles_that_are_started_and_of_a_swapped_one_the_present_one() {
        let plan = Plan {
            binaries: "/x".into(),
            slots: ["device", "fluid:0", "fluid:1"].map(String::from).to_vec(),
            swapped: [("fluid".to_string(), PathBuf::from("/y/fluid"))].into(),
            state_bytes: 0,
            end_tick: None,
            faults: Vec::new(),
        };
        let found: Vec<PathBuf> = programs(&plan).into_iter().collect();
        assert_eq!(found, ["/proc/self/exe", "/x/device", "/y/fluid"].map(PathBuf::from));
        assert_eq!(read(&open(&[PathBuf::from(proc::OWN_PROGRAM)].into())), 1);
    }
}
