//! Whether the kernel killed a process because memory was short. Who is told only of a SIGKILL cannot know; the kernel counts how often it has done so.

use crate::policy::Exit;

/// What the kernel had counted at the last look.
#[derive(Debug)]
pub struct OutOfMemory {
    kills: Option<u64>,
}

impl OutOfMemory {
    /// From now on.
    pub fn watch() -> OutOfMemory {
        OutOfMemory { kills: read() }
    }

    /// The exit with its cause, where a SIGKILL came with a kill for want of memory since the last look. Somebody else's process may have been that one:
    /// then a kill from outside counts as a process's own death.
    pub fn blame(&mut self, exit: Exit) -> Exit {
        if exit != Exit::Signal(9) { exit } else { self.blame_by(exit, read()) }
    }

    fn blame_by(&mut self, exit: Exit, kills: Option<u64>) -> Exit {
        let before = std::mem::replace(&mut self.kills, kills);
        if before.zip(kills).is_some_and(|(before, now)| now > before) { Exit::OutOfMemory } else { exit }
    }
}

/// Processes that the kernel has killed for want of memory, in a control group's or the machine's.
fn read() -> Option<u64> {
    count(&std::fs::read_to_string("/proc/vmstat").ok()?)
}

fn count(vmstat: &str) -> Option<u64> {
    vmstat.lines().find_map(|line| line.strip_prefix("oom_kill ")?.trim().parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kill_is_blamed_on_memory_if_the_kernel_counted_one_meanwhile() {
        let mut memory = OutOfMemory { kills: Some(3) };
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(3)), Exit::Signal(9));
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(4)), Exit::OutOfMemory);
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(4)), Exit::Signal(9), "each kill once");
        assert_eq!(memory.blame_by(Exit::Signal(9), None), Exit::Signal(9), "a kernel that does not say");
        assert_eq!(memory.blame(Exit::Signal(11)), Exit::Signal(11));
        assert_eq!(count("nr_free_pages 12\noom_kill 7\noom_killer 9\n"), Some(7));
        assert_eq!(count("nr_free_pages 12\n"), None);
    }
}
