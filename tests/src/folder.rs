//! A folder of its own for a test, removed at its end whatever happened to the test.

use std::path::{Path, PathBuf};

/// A test's own folder of files, which goes with it.
#[derive(Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// An empty folder; two tests of one name in two processes do not meet.
    pub fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("station-test-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Folder(path)
    }

    /// Where it is.
    pub fn as_path(&self) -> &Path {
        &self.0
    }

    /// Path of one of its files, which need not exist.
    pub fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }

    /// A copy of the default scene with its meshes; gives its path.
    pub fn scene(&self) -> String {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/default.toml");
        let files = hyst_scene::sources(Some(&scene)).unwrap_or_else(|error| panic!("{error}"));
        hyst_scene::unpack(&files, &self.0).unwrap_or_else(|error| panic!("{error}")).display().to_string()
    }

    /// Writes a file and gives its path.
    pub fn write(&self, name: &str, text: &str) -> String {
        std::fs::write(self.0.join(name), text).unwrap_or_else(|error| panic!("{name}: {error}"));
        self.path(name)
    }

    /// The text of a file.
    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0); // a folder that stays hurts nobody
    }
}
