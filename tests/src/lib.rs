//! station-tests
