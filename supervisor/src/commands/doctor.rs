//! `hystation doctor`.
use crate::settings::Refusal;
/// Doctor.
pub fn doctor() -> Result<u8, Refusal> {
    super::not_here("doctor")
}
