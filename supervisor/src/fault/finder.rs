//! What finds a fault, in the words of [`super::Fault::detected_by`], where it is no process and no thread that stands still.

/// A death: the latch of its main thread was open.
pub const LATCH: &str = "latch";
/// A death: the process has ended.
pub const PIDFD: &str = "pidfd";
/// It missed three of its periods.
pub const HEARTBEAT: &str = "heartbeat";
/// It works so much that it cannot be in time.
pub const PROCESSOR_TIME: &str = "processor time";
/// Its memory, or the number of its open files, grows and grows.
pub const GROWTH: &str = "growth";
/// It floods its log.
pub const FLOOD: &str = "flood";
/// Who reads it dies again and again.
pub const READERS: &str = "readers";
/// Its page says what cannot be.
pub const PAGE: &str = "page";
/// A swap was undone for it.
pub const SWAP: &str = "swap";

#[cfg(test)]
mod tests {
    use crate::faultfile::Helper;
    use hyst_messages::Role;

    /// Six of the words that a report may have stood nowhere, or on another page.
    #[test]
    fn the_handbook_has_each_word_for_what_finds_a_fault() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/handbook.md");
        let handbook = std::fs::read_to_string(path).unwrap();
        let row = handbook.lines().find(|line| line.starts_with("| `detected_by`, `detected_us` |")).unwrap();
        let own = include_str!("finder.rs").lines().filter_map(|line| line.strip_prefix("pub const ")?.split('"').nth(1));
        let own: Vec<&str> = own.collect();
        assert!([super::LATCH, super::SWAP].iter().all(|word| own.contains(word)), "{own:?}");
        let others = Helper::ALL.map(|(_, name)| name).into_iter().chain([Role::Supervisor, Role::Guardian].map(Role::name));
        for word in own.into_iter().chain(others) {
            assert!(row.contains(&format!("`{word}`")), "{word} is not in the handbook");
        }
    }
}
