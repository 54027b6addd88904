//! Whether the kernel killed a process because memory was short. Who is told only of a SIGKILL cannot know; the kernel counts how often it has done so.

use crate::policy::Exit;

/// What the kernel had counted at the last two looks.
#[derive(Debug)]
pub struct OutOfMemory {
    older: Option<u64>,
    newer: Option<u64>,
}

impl OutOfMemory {
    /// From now on.
    pub fn watch() -> OutOfMemory {
        let kills = read();
        OutOfMemory { older: kills, newer: kills }
    }

    /// Looks, as the supervisor does once a second.
    pub fn look(&mut self) {
        self.older = std::mem::replace(&mut self.newer, read());
    }

    /// The exit with its cause, where a SIGKILL came with a kill for want of memory within the last one or two seconds. Somebody else's process may have
    /// been that one: then a kill from outside counts as a process's own death.
    pub fn blame(&mut self, exit: Exit) -> Exit {
        if !exit.is_kill() { exit } else { self.blame_by(exit, read()) }
    }

    fn blame_by(&mut self, exit: Exit, kills: Option<u64>) -> Exit {
        let before = self.older;
        (self.older, self.newer) = (kills, kills);
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
        let mut memory = OutOfMemory { older: Some(3), newer: Some(3) };
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(3)), Exit::Signal(9));
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(4)), Exit::OutOfMemory);
        assert_eq!(memory.blame_by(Exit::Signal(9), Some(4)), Exit::Signal(9), "each kill once");
        assert_eq!(memory.blame_by(Exit::Signal(9), None), Exit::Signal(9), "a kernel that does not say");
        assert_eq!(memory.blame(Exit::Signal(11)), Exit::Signal(11));
        let mut later = OutOfMemory { older: Some(0), newer: Some(0) };
        later.look();
        later.look();
        assert_eq!(later.blame_by(Exit::Signal(9), later.newer), Exit::Signal(9), "what was counted two looks ago is nobody's");
        assert_eq!(count("nr_free_pages 12\noom_kill 7\noom_killer 9\n"), Some(7));
        assert_eq!(count("nr_free_pages 12\n"), None);
    }
}
