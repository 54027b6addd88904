//! Where files lie for a while that are too large for memory: the second recording of a replay that is verified, and those of a benchmark.

use hyst_exchange::system;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// For such files, as <https://refspecs.linuxfoundation.org/FHS_3.0> has it: `/tmp` is memory on many machines.
const LARGE: &str = "/var/tmp";

/// Their folder: the one that is named for what is temporary, else the one for what is large.
pub fn folder() -> PathBuf {
    folder_for(std::env::var_os("TMPDIR"), Path::new(LARGE))
}

fn folder_for(named: Option<OsString>, large: &Path) -> PathBuf {
    let large = Some(large.to_owned()).filter(|large| large.is_dir());
    named.map(PathBuf::from).or(large).unwrap_or_else(std::env::temp_dir)
}

/// Why there is no room for so many bytes in a folder, and what helps; `None` if there is, or where the system does not say.
pub fn lacks_room(folder: &Path, bytes: u64) -> Option<String> {
    let free = system::free_bytes(folder).ok().filter(|free| *free < bytes)?;
    let [bytes_mb, free_mb] = [bytes, free].map(|bytes| bytes as f64 * 1e-6);
    let folder = folder.display();
    Some(format!(
        "{bytes_mb:.0} MB in {folder}, which has {free_mb:.0} MB left; make room there, or name another folder: TMPDIR=FOLDER"
    ))
}

/// The kind of file system that a folder lies on, as the kernel calls it.
pub fn file_system(folder: &Path) -> Option<String> {
    let mounts = std::fs::read_to_string("/proc/self/mounts").ok()?;
    file_system_in(&mounts, &folder.canonicalize().ok()?).map(str::to_string)
}

/// By the table of mounts: the one nearest to the folder, and of those in one place the last.
fn file_system_in<'a>(mounts: &'a str, folder: &Path) -> Option<&'a str> {
    let mount = |line: &'a str| {
        let mut words = line.split(' ').skip(1);
        Some((words.next()?, words.next()?))
    };
    let above = mounts.lines().filter_map(mount).filter(|(place, _)| folder.starts_with(place));
    above.max_by_key(|(place, _)| Path::new(place).components().count()).map(|(_, kind)| kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An hour of it was 0.8 GB of memory where `/tmp` is memory.
    #[test]
    fn what_is_large_lies_where_large_files_do_unless_another_folder_is_named() {
        let there = std::env::temp_dir();
        assert_eq!(folder_for(Some("/named".into()), &there), Path::new("/named"));
        assert_eq!(folder_for(None, &there), there);
        assert_eq!(folder_for(None, Path::new("/no/such/folder")), std::env::temp_dir());
    }

    /// A recording of 100 GB was done again into a disk that it filled, and the replay ended there.
    #[test]
    fn a_folder_without_room_is_named_with_what_it_has_left_and_one_of_which_nobody_knows_is_tried() {
        let folder = std::env::temp_dir();
        let why = lacks_room(&folder, u64::MAX).unwrap();
        assert!(why.starts_with("18446744073710 MB in ") && why.contains(" MB left; make room there"), "{why}");
        assert!(why.contains(&folder.display().to_string()) && why.ends_with("TMPDIR=FOLDER"), "{why}");
        assert_eq!([lacks_room(&folder, 0), lacks_room(Path::new("/no/such/folder"), u64::MAX)], [None, None]);
    }

    #[test]
    fn a_folder_is_of_the_file_system_that_is_mounted_nearest_above_it() {
        let mounts =
            "/dev/sda1 / ext4 rw 0 0\ntmpfs /tmp tmpfs rw 0 0\n/dev/sdb /var/tmp xfs rw 0 0\nnone /var/tmp overlay rw 0 0\nodd\n";
        let of = |folder: &str| file_system_in(mounts, Path::new(folder));
        assert_eq!(["/", "/tmp/a", "/tmpfs", "/var/tmp", "/var"].map(of), ["ext4", "tmpfs", "ext4", "overlay", "ext4"].map(Some));
        assert_eq!(file_system_in("", Path::new("/tmp")), None);
    }
}
