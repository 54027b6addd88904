//! What a process has mapped of the files in shared memory, by /proc/PID/maps; and the touching of what is new in one's own.

use crate::system;
use std::path::PathBuf;

/// One mapping of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    /// First address.
    start: usize,
    /// The address after the last one.
    end: usize,
    /// As the kernel writes them: `rw-s`.
    pub rights: String,
    /// The file.
    pub path: PathBuf,
}

impl Mapping {
    /// A line of /proc/PID/maps; `None` for memory without a file.
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let (start, end) = words.next()?.split_once('-')?;
        let (start, end) = (usize::from_str_radix(start, 16).ok()?, usize::from_str_radix(end, 16).ok()?);
        let rights = words.next()?.to_string();
        let path = words.nth(3).filter(|path| path.starts_with('/'))?.into();
        Some(Self { start, end, rights, path })
    }
}

/// The files in /dev/shm that a process has mapped, whose names begin and end like this; none of a process that is gone or of somebody else.
pub fn of_process(pid: u32, beginning: &str, ending: &str) -> Vec<Mapping> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/maps")).unwrap_or_default();
    let is_wanted = |mapping: &Mapping| {
        let name = mapping.path.strip_prefix("/dev/shm").ok().and_then(|name| name.to_str());
        name.is_some_and(|name| name.starts_with(beginning) && name.ends_with(ending))
    };
    text.lines().filter_map(Mapping::parse).filter(is_wanted).collect()
}

/// What has been touched of the own mappings.
#[derive(Debug, Default)]
pub struct Touched(Vec<Mapping>);

/// Bytes that are touched under one hold of the lock of the memory map.
const TOUCHED_AT_ONCE: usize = 256 << 10;

impl Touched {
    /// Touches what this process has mapped of such files since it was last asked, a little at a time: its other threads find it in the memory map
    /// then. Gives how many mappings that were. Not on a real-time thread.
    pub fn touch_new(&mut self, beginning: &str, ending: &str) -> usize {
        let now = of_process(std::process::id(), beginning, ending);
        let mut count = 0;
        for Mapping { start, end, .. } in now.iter().filter(|mapping| !self.0.contains(mapping)) {
            for at in (*start..*end).step_by(TOUCHED_AT_ONCE) {
                system::populate(at, TOUCHED_AT_ONCE.min(end - at));
            }
            count += 1;
        }
        self.0 = now;
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_kernel_is_a_mapping_and_nonsense_is_none() {
        let line = "7f9b2cc76000-7f9b30000000 r--s 00000000 00:1a 4711                       /dev/shm/hyst0_a_x1.data";
        let (start, end) = (0x7f9b_2cc7_6000, 0x7f9b_3000_0000);
        assert_eq!(
            Mapping::parse(line),
            Some(Mapping { start, end, rights: "r--s".into(), path: "/dev/shm/hyst0_a_x1.data".into() })
        );
        for other in [
            "",
            "7f9b2cc76000-7f9b30000000 rw-p 00000000 00:00 0",
            "nonsense r--s 0 0 0 /dev/shm/x.data",
            "1-2 rw-p 0 0:0 0 [heap]",
        ] {
            assert_eq!(Mapping::parse(other), None, "{other}");
        }
    }

    #[test]
    fn what_is_new_is_touched_once() {
        let name = format!("hyst-test-mappings-{}", std::process::id());
        let path = PathBuf::from(format!("/dev/shm/{name}.data"));
        let first = crate::page::create(&path, 64, 0, 1).unwrap();
        let mut touched = Touched::default();
        assert_eq!((touched.touch_new(&name, ".data"), touched.touch_new(&name, ".data")), (1, 0));
        assert_eq!(touched.touch_new(&name, ".connection"), 0, "none of that kind");
        assert_eq!(of_process(std::process::id(), &name, ".data")[0].rights, "rw-s");
        drop(first);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(of_process(0, "", ""), Vec::new());
    }
}
