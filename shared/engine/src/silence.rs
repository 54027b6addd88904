//! For how long somebody has shown no sign of life, as judged by one who may itself not be let run: only time in which the judge looked counts, so that
//! a pause of the whole machine condemns nobody.

/// The silence of one, as another sees it.
#[derive(Clone, Copy, Debug)]
pub struct Silence {
    sign: u64,
    looked_ns: u64,
    silent_ns: u64,
    most_ns: u64,
}

impl Silence {
    /// Begins now. Of the time between two looks at most `most_ns` counts: a few times what lies between them where nobody is kept waiting.
    pub fn new(now_ns: u64, most_ns: u64) -> Silence {
        Silence { sign: 0, looked_ns: now_ns, silent_ns: 0, most_ns }
    }

    /// Looks at a word that is another one after each sign of life; gives for how long it has been the same, ns.
    pub fn look(&mut self, now_ns: u64, sign: u64) -> u64 {
        let passed_ns = now_ns.saturating_sub(self.looked_ns).min(self.most_ns);
        self.silent_ns = if sign == self.sign { self.silent_ns + passed_ns } else { 0 };
        (self.sign, self.looked_ns) = (sign, now_ns);
        self.silent_ns
    }

    /// What the last look gave, ns.
    pub fn ns(&self) -> u64 {
        self.silent_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_shows_no_sign_is_silent_and_a_pause_of_the_machine_is_no_silence() {
        const LOOK_NS: u64 = 5_000_000;
        let mut now_ns = 1_000_000_000_000;
        let mut silence = Silence::new(now_ns, 2 * LOOK_NS);
        let mut pass = |passed_ns: u64, sign: u64| {
            now_ns += passed_ns;
            silence.look(now_ns, sign)
        };
        assert!((1..3_000).all(|sign| pass(LOOK_NS, sign) == 0));
        assert_eq!((0..50).map(|_| pass(3_600_000_000_000, 3_000)).max(), Some(49 * 2 * LOOK_NS), "nobody was let run for hours");
        assert_eq!(pass(LOOK_NS, 3_001), 0);
        assert_eq!((1..=1_000).map(|_| pass(LOOK_NS, 3_001)).last(), Some(1_000 * LOOK_NS));
    }
}
