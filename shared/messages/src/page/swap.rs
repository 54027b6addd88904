//! How far the trial of a newcomer is, one word for each role in the station page. The supervisor writes it; the processes of the role act on it.
//! Promise: every word has a meaning; nonsense means that there is no trial.

/// How far a trial is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Stage {
    /// There is none.
    #[default]
    None = 0,
    /// The newcomer computes what the holder computes, and nobody but the judge reads it.
    Shadow = 1,
    /// The newcomer may take the role once, between two steps; from then on those who had it before keep stepping the state that they had, and
    /// take the role back with it.
    Trial = 2,
    /// The newcomer has passed: those who had the role before follow it.
    Settled = 3,
    /// The newcomer is on its way out: as on trial, but it takes the role no more.
    Undone = 4,
}

/// The word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Swap {
    /// How far.
    pub stage: Stage,
    /// Incarnation of the newcomer.
    pub guest: u32,
}

impl Swap {
    /// As a word.
    pub fn word(self) -> u64 {
        (self.stage as u64) << 32 | self.guest as u64
    }
    /// From the word.
    pub fn from_word(word: u64) -> Swap {
        let stage = match word >> 32 {
            1 => Stage::Shadow,
            2 => Stage::Trial,
            3 => Stage::Settled,
            4 => Stage::Undone,
            _ => return Swap::default(),
        };
        Swap { stage, guest: word as u32 }
    }
    /// Whether those who had the role before the newcomer keep the state that they had.
    pub fn keeps_line(self) -> bool {
        matches!(self.stage, Stage::Trial | Stage::Undone)
    }
    /// Whether this incarnation is the newcomer and has passed: until it leaves, it is one of the role like the others.
    pub fn has_passed(self, newcomer: u32) -> bool {
        self.stage == Stage::Settled && self.guest == newcomer
    }
    /// Whether this incarnation is the newcomer and has the role on trial.
    pub fn is_on_trial(self, holder: u32) -> bool {
        self.keeps_line() && self.guest == holder
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_read_back_and_nonsense_is_no_trial() {
        for stage in [Stage::Shadow, Stage::Trial, Stage::Settled, Stage::Undone] {
            let swap = Swap { stage, guest: 9 };
            assert_eq!(Swap::from_word(swap.word()), swap);
            assert_eq!(swap.is_on_trial(9), stage == Stage::Trial || stage == Stage::Undone);
            assert!(!swap.is_on_trial(8));
        }
        for word in [0, 9, 5 << 32 | 9, u64::MAX] {
            assert_eq!(Swap::from_word(word), Swap::default());
        }
    }
}
