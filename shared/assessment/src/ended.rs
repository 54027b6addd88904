//! What ended a session, as a report, a page and a recording's successor name it.

use serde::{Deserialize, Serialize};

/// What ended a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndedBy {
    /// All goals were reached.
    Goals,
    /// The pump said that the wall is pierced.
    Perforation,
    /// The deficit.
    Deficit,
    /// The blood.
    Bleeding,
    /// The time.
    Time,
}

impl EndedBy {
    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            EndedBy::Goals => "all goals were reached",
            EndedBy::Perforation => "the wall was pierced",
            EndedBy::Deficit => "too much medium was missing",
            EndedBy::Bleeding => "too much blood was lost",
            EndedBy::Time => "the time was over",
        }
    }
}
