//! What a test did not try on this machine, where `./station test` collects it for its summary (`tests/src/shown.rs`): what a test that passes prints is not
//! seen.

use std::io::Write;

/// Says so.
pub fn not_shown(what: &str) {
    println!("NOT SHOWN: {what}");
    if let Some(path) = std::env::var_os("HYSTATION_NOT_SHOWN") {
        let file = std::fs::File::options().append(true).create(true).open(path);
        let _ = file.and_then(|mut file| writeln!(file, "{what}")); // it was printed
    }
}
