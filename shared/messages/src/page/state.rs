//! What a process says it is doing. Promise: every word has a meaning; nonsense means failed.

/// States of a process, as it says in [`header::STATE`](super::header::STATE).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ProcessState {
    /// Page made, process not yet there.
    Empty = 0,
    /// Connecting, mapping, touching.
    Warming = 1,
    /// A spare that follows.
    Warm = 2,
    /// Doing the role's work.
    Live = 3,
    /// On its way out because it was asked to.
    Stopping = 4,
    /// On its way out because it found itself broken or fenced.
    Failed = 5,
}

impl ProcessState {
    /// From the word in the page; nonsense is `Failed`.
    pub fn from_word(word: u32) -> ProcessState {
        [Self::Empty, Self::Warming, Self::Warm, Self::Live, Self::Stopping].get(word as usize).copied().unwrap_or(Self::Failed)
    }
    /// Whether it does the role's work or could at once.
    pub fn is_ready(self) -> bool {
        matches!(self, Self::Warm | Self::Live)
    }
    /// The word that people read.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "starting",
            Self::Warming => "warming",
            Self::Warm => "spare",
            Self::Live => "live",
            Self::Stopping => "stopping",
            Self::Failed => "failed",
        }
    }
}
