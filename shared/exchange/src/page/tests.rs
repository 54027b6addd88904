//! A page is read as it was written, and what is none is refused.

use super::*;
use hyst_messages::ForceRecord;
use hyst_messages::page::haptic;

struct Folder(PathBuf);
impl Folder {
    fn new(name: &str) -> Folder {
        let path = PathBuf::from(format!("/dev/shm/hyst-test-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}
impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_value_written_by_the_owner_is_read_by_another() {
    let folder = Folder::new("page");
    let path = folder.0.join("a.page");
    let owner = create(&path, haptic::WORDS, 2, 17).unwrap();
    let reader = ReadPage::open(&path, haptic::WORDS).unwrap();
    assert!(reader.cell(haptic::FORCE).is_none());
    let record = ForceRecord { tick: 5, force_n: [1.0, 2.0, 3.0], ..Default::default() };
    owner.write(haptic::FORCE, &record);
    assert_eq!(reader.cell(haptic::FORCE), Some((1, record)));
    assert_eq!(reader.incarnation(), 17);
    owner.last_words("thread 'main' panicked");
    assert_eq!(reader.last_words(), "thread 'main' panicked");
}

#[test]
fn a_foreign_short_or_missing_page_is_refused_and_a_second_owner_too() {
    let folder = Folder::new("foreign");
    let path = folder.0.join("a.page");
    assert!(matches!(ReadPage::open(&path, haptic::WORDS), Err(PageError::Refused { .. })));
    std::fs::write(&path, vec![7u8; page_bytes(haptic::WORDS)]).unwrap();
    assert!(matches!(ReadPage::open(&path, haptic::WORDS), Err(PageError::Foreign { .. })));
    std::fs::write(&path, [1, 2, 3]).unwrap();
    assert!(matches!(ReadPage::open(&path, haptic::WORDS), Err(PageError::Foreign { .. })));
    assert!(matches!(create(&path, haptic::WORDS, 2, 1), Err(PageError::Refused { .. })));
}
