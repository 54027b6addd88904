//! hyst-recording
