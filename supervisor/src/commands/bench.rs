//! `hystation bench`.
use crate::settings::Refusal;
use std::path::Path;
/// Bench.
pub fn bench(_what: &str, _mesh: Option<&Path>, _json: bool) -> Result<u8, Refusal> {
    super::not_here("bench")
}
