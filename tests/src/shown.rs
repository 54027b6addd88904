//! What a whole-station test could show of a promise about time. The machine that runs it may be shared and take the cores away for longer than any
//! deadline. So there are three outcomes. Broken: beyond the noise of its own controls a promise is not kept, in the mean or by one figure that no stall of
//! the host explains, and the test fails. Held. And not shown: too few windows count, or the noise hides the figure; that is printed, written where
//! `./station test` collects it for its summary, and fails nothing. What has nothing to do with time (wrong forces, processes, states) is asserted by the
//! tests themselves, whatever the machine did.

use std::io::Write;

/// The file to which what could not be shown is appended, a line each, if this is set.
const NOT_SHOWN: &str = "HYSTATION_NOT_SHOWN";

/// Ticks that a stall of the host may take from one window and not from its control, beyond what is void: up to some fifty were seen on two shared cores.
const STALL_TICKS: f64 = 100.0;

/// A promise about some figures, each of which is what a fault or a load cost beyond its control: about their mean, and about each alone.
#[derive(Clone, Copy, Debug)]
pub struct Promise {
    /// What the mean may be.
    pub allowed: f64,
    /// Figures that it takes to say so.
    pub least: usize,
    /// What one alone may be, whatever the mean says: few figures of which one is large know nothing of their mean.
    pub most: f64,
}

/// What some figures say of a promise.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    /// There are enough of them, and their mean is allowed.
    Held,
    /// Their mean is more, beyond doubt, or one of them is more than one may be.
    Broken,
    /// Neither.
    NotShown,
}

impl Promise {
    /// One about the ticks that are lost each time. One time may cost what is allowed and what a stall of the host takes; or as much more than allowed as the
    /// worst control of the same run lost, for so long a window.
    pub fn of_ticks(allowed: f64, least: usize, worst_control: f64) -> Promise {
        Promise { allowed, least, most: allowed + STALL_TICKS.max(worst_control) }
    }

    /// What figures say of it.
    pub fn outcome(&self, figures: &[f64]) -> Outcome {
        let has_one_beyond = figures.iter().any(|figure| *figure > self.most);
        if has_one_beyond || !figures.is_empty() && lower99_of_mean(figures) > self.allowed {
            Outcome::Broken
        } else if figures.len() >= self.least && mean(figures) <= self.allowed {
            Outcome::Held
        } else {
            Outcome::NotShown
        }
    }

    /// Fails if the figures of `what` break the promise; prints them.
    pub fn judge(&self, what: &str, figures: &[f64], said: impl FnOnce() -> String) {
        let (mean, lower) = (mean(figures), lower99_of_mean(figures));
        let words = format!(
            "{what}: {} figures count of {} wanted, {mean:.3} in the mean (99 %: {lower:.3} to {:.3}), {} allowed, {:.1} of one",
            figures.len(),
            self.least,
            2.0 * mean - lower,
            self.allowed,
            self.most
        );
        println!("{words}");
        match self.outcome(figures) {
            Outcome::Held => {}
            Outcome::Broken => panic!("{words}: {figures:?}\n{}", said()),
            Outcome::NotShown => not_shown(&words),
        }
    }

    /// Fails if one figure of `what` alone breaks the promise.
    pub fn assert_one(&self, what: &str, figure: f64, said: impl FnOnce() -> String) {
        assert!(figure <= self.most, "{what}: {figure:.1} by one alone, {:.1} at most\n{}", self.most, said());
    }
}

/// Says that this run did not show something, because of the machine, or because nobody has asked for what takes minutes.
pub fn not_shown(what: &str) {
    println!("NOT SHOWN: {what}");
    if let Some(path) = std::env::var_os(NOT_SHOWN) {
        let file = std::fs::File::options().append(true).create(true).open(path);
        let _ = file.and_then(|mut file| writeln!(file, "{what}")); // it was printed
    }
}

/// Mean of some figures, 0 of none.
pub fn mean(figures: &[f64]) -> f64 {
    figures.iter().sum::<f64>() / figures.len().max(1) as f64
}

/// The lower end of the 99 % interval of the mean of some figures: what the mean is at least, whatever the host did. 99, because a run of all tests judges
/// some forty such means. Few figures know little of their own spread: Student's t, and at least that of one figure that is 1 more than the others, since
/// misses are counted.
pub fn lower99_of_mean(figures: &[f64]) -> f64 {
    let (count, mean) = (figures.len().max(1) as f64, mean(figures));
    let variance = figures.iter().map(|figure| (figure - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    mean - student99(figures.len()) * (variance.max(1.0 / count) / count).sqrt()
}

/// Student's t of the two-sided 99 % interval for the mean of so many figures (quantiles of the t distribution, any statistics table).
fn student99(figures: usize) -> f64 {
    const T: [f64; 10] = [63.66, 63.66, 63.66, 9.925, 5.841, 4.604, 4.032, 3.707, 3.499, 3.355];
    match figures {
        0..10 => T[figures],
        10..20 => 3.250,
        20..60 => 2.861,
        _ => 2.662,
    }
}

/// How many more of two kinds there are than the same number of fair coins would explain (99 %): the lower end of their difference.
pub fn lower99_of_difference(more: f64, fewer: f64) -> f64 {
    more - fewer - 2.576 * (more + fewer).sqrt()
}
