//! Why a swap is undone: the cause, which a program goes by, and the words, which a person reads.

use serde::{Deserialize, Serialize};

/// Of what kind a reason is; `docs/engine.md` has them all for an engine's author.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// It could not be started, or did not become ready.
    NotReady,
    /// It died.
    Died,
    /// It did not beat, although it could have.
    Hung,
    /// What it makes is out of its role's tolerance.
    OutOfTolerance,
    /// Who reads it refuses what it says.
    Refused,
    /// Who reads it has no answer from it in time, although it was let run.
    Late,
    /// It makes too few steps, although it was let run.
    Slow,
    /// It missed steps, and somebody else took the role or kept it.
    Missed,
    /// It left too little to compare, or whoever compares it dies of what it says.
    NotCompared,
    /// It took the role before it might.
    Unasked,
    /// It grows, floods its log, or a thread that helps it stands still.
    Unfit,
    /// The supervisor died meanwhile.
    Interrupted,
    /// The machine left it no time or no room to show what it is, or nobody to judge it; or the hand left it no time, which cut or pressed all the while.
    NoTime,
}

impl Cause {
    /// Whether it speaks of the newcomer. One that was undone for another reason may be swapped in again.
    pub fn speaks_of_newcomer(self) -> bool {
        !matches!(self, Cause::Interrupted | Cause::NoTime)
    }
}

/// Why a swap is undone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// Of what kind it is.
    pub cause: Cause,
    /// In words.
    pub text: String,
}

impl Reason {
    /// A reason.
    pub fn new(cause: Cause, text: impl Into<String>) -> Reason {
        Reason { cause, text: text.into() }
    }
}
