//! Why a state was refused by one of its own role. Each process says in its page which it refused last ([`crate::page::header::REFUSED`]), so that whoever is
//! told that a writer is not trusted is told for what.

use crate::mischief::Distrust;
use std::fmt;

/// Why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Refusal {
    /// Too short, of another kind or layout, or with sections that it does not have.
    Unreadable = 1,
    /// Its epoch is one that nobody has won, or its tick far from being there.
    Ahead = 2,
    /// Again and again under an epoch before the one in which its writer is the holder.
    Behind = 3,
    /// Its stamp does not rise.
    Stamp = 4,
    /// Its mesh is not that of the version which it names.
    Version = 5,
    /// Its mesh is none, or there is no room for it.
    Mesh = 6,
    /// Its sections have not the lengths that its mesh or its grid asks for.
    Sections = 7,
    /// A number in it is none, or out of range.
    Numbers = 8,
    /// It was not computed from the input that it names.
    Input = 9,
    /// Its reader does not say more.
    Unsound = 10,
    /// What it holds is of another tick than its stamp.
    OtherTick = 11,
}

impl Refusal {
    /// All of them.
    pub const ALL: [Refusal; 11] = [
        Refusal::Unreadable,
        Refusal::Ahead,
        Refusal::Behind,
        Refusal::Stamp,
        Refusal::Version,
        Refusal::Mesh,
        Refusal::Sections,
        Refusal::Numbers,
        Refusal::Input,
        Refusal::Unsound,
        Refusal::OtherTick,
    ];

    /// What its writer is distrusted for.
    pub fn distrust(self) -> Distrust {
        match self {
            Refusal::Behind | Refusal::Stamp => Distrust::Still,
            _ => Distrust::Invalid,
        }
    }

    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            Refusal::Unreadable => "it is no message of its kind and layout",
            Refusal::Ahead => "its epoch or its tick is ahead of its time",
            Refusal::Behind => "its epoch is one before its writer's",
            Refusal::Stamp => "its stamp does not rise",
            Refusal::Version => "its mesh is not that of its version",
            Refusal::Mesh => "its mesh is none, or has no room",
            Refusal::Sections => "its sections do not fit",
            Refusal::Numbers => "a number in it is none, or out of range",
            Refusal::Input => "it is not of the input that it names",
            Refusal::Unsound => "it is not sound",
            Refusal::OtherTick => "what it holds is of another tick than its stamp",
        }
    }
}

/// A state that was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusedState {
    /// Why.
    pub why: Refusal,
    /// Who wrote it.
    pub incarnation: u32,
    /// Its tick, as it says.
    pub tick: u64,
    /// Its epoch.
    pub epoch: u32,
    /// The version of its mesh.
    pub topology_version: u32,
}

/// Words of one.
pub const REFUSED_WORDS: usize = 3;

impl RefusedState {
    /// As words of a page.
    pub fn words(&self) -> [u64; REFUSED_WORDS] {
        let pair = |high: u32, low: u32| u64::from(high) << 32 | u64::from(low);
        [pair(self.why as u32, self.incarnation), self.tick, pair(self.epoch, self.topology_version)]
    }

    /// From the words, if they are one.
    pub fn from_words([who, tick, of]: [u64; REFUSED_WORDS]) -> Option<RefusedState> {
        let why = Refusal::ALL.into_iter().find(|why| *why as u64 == who >> 32)?;
        Some(RefusedState { why, incarnation: who as u32, tick, epoch: (of >> 32) as u32, topology_version: of as u32 })
    }
}

impl fmt::Display for RefusedState {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RefusedState { why, tick, epoch, topology_version, .. } = self;
        write!(to, "state {tick} of epoch {epoch}, mesh {topology_version:08x}: {}", why.text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_state_is_read_back_from_its_words_and_nonsense_is_none() {
        for why in Refusal::ALL {
            let state = RefusedState { why, incarnation: 7, tick: 1 << 40, epoch: 9, topology_version: u32::MAX - 1 };
            assert_eq!(RefusedState::from_words(state.words()), Some(state));
            let stands = [Refusal::Behind, Refusal::Stamp].contains(&why);
            assert_eq!(why.distrust(), if stands { Distrust::Still } else { Distrust::Invalid });
        }
        for who in [0, 7, 12 << 32 | 7, u64::MAX] {
            assert_eq!(RefusedState::from_words([who, 5, 5]), None);
        }
        let said = RefusedState { why: Refusal::Mesh, incarnation: 7, tick: 5_000, epoch: 9, topology_version: 0xab }.to_string();
        assert_eq!(said, "state 5000 of epoch 9, mesh 000000ab: its mesh is none, or has no room");
    }
}
