//! hystation
fn main() {}
