//! hyst-engine
