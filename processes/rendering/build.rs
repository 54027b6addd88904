//! Makes the solids of noise, so that no start has to.

#[path = "src/hash.rs"]
mod hash;
#[path = "src/noise.rs"]
mod noise;

use std::path::Path;

fn main() -> std::io::Result<()> {
    for source in ["build.rs", "src/hash.rs", "src/noise.rs"] {
        println!("cargo:rerun-if-changed={source}");
    }
    let folder = std::env::var_os("OUT_DIR").ok_or(std::io::ErrorKind::NotFound)?;
    std::fs::write(Path::new(&folder).join("fields"), noise::with_levels(noise::fields()))?;
    std::fs::write(Path::new(&folder).join("relief"), noise::with_levels(noise::relief()))
}
