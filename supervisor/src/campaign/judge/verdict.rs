//! The verdict that the figures of a cell or a pool give.

use super::figures::{Figures, Verdict};
use crate::campaign::bounds::{Excess, least_faults};
use crate::campaign::file::{Arm, Campaign};

/// Most reasons that are listed for a cell.
const MOST_REASONS: usize = 8;
/// Fewest faults of a cell of which one says that most have no verdict.
const LEAST_DONE: usize = 4;

/// A pool with fewer judged faults than it was to have proves nothing.
pub(super) fn enough(mut figures: Figures, least: usize, arm: &Arm) -> Figures {
    let judged = figures.excess_misses.len();
    if arm.judged && judged < least && figures.verdict == Verdict::Held {
        figures.verdict = Verdict::Unknown;
        figures.reasons.push(format!("{judged} faults have a verdict, at least {least} are to have one"));
    }
    figures
}

/// Why a bound within the limit holds nothing: the faults and their controls are not alike but for the fault, the faults not independent, or a few cost much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unlike {
    /// More void ticks are late in windows than in controls: a kind that stalls the kernel is not held by leaving out what it stalls.
    Stalls,
    /// The controls lose more.
    Controls,
    /// Those whose controls began in the same state do not hold the limit alone.
    States,
    /// Those that differ from their controls lie together in this station.
    Together(usize),
    /// However few are worse, they cost so many ticks that the mean of all need not be within the limit.
    Mean,
}

impl Unlike {
    pub(super) fn words(self, figures: &Figures) -> String {
        match self {
            Unlike::Stalls => "more void ticks are late in the faults' windows than in their controls".into(),
            Unlike::Controls => "the controls lose more than the windows with a fault: they are not alike".into(),
            Unlike::States => "those whose controls began in the same state do not hold the limit alone".into(),
            Unlike::Together(station) => {
                format!("those that differ from their controls lie together, most of them in station {station}")
            }
            Unlike::Mean => {
                let mean = figures.mean_beyond_misses();
                let bound = figures.mean_beyond_misses_upper95.unwrap_or(mean);
                format!("ticks beyond their controls' and what they may cost, per fault: {mean:.4}, with 95 % below {bound:.4}")
            }
        }
    }
}

/// Which of these keeps figures from holding a limit.
pub fn unlike(figures: &Figures, limit: f64) -> Option<Unlike> {
    let stalls = figures.excess_with_void.is_some_and(|excess| excess.lower95 > 0.0 && excess.upper95 > limit);
    let alike = figures.excess_alike.filter(|alike| least_faults(limit).is_some_and(|least| alike.faults >= least));
    let costs_much = figures.mean_beyond_misses_upper95.is_some_and(|bound| bound > limit);
    match () {
        () if stalls => Some(Unlike::Stalls),
        () if figures.excess.is_some_and(|excess| excess.upper95 < 0.0) => Some(Unlike::Controls),
        () if alike.is_some_and(|alike| alike.upper95 > limit) => Some(Unlike::States),
        () => figures.together_in.map(Unlike::Together).or(costs_much.then_some(Unlike::Mean)),
    }
}

/// The limit of the pool that judges a cell.
fn pool_limit(figures: &Figures, campaign: &Campaign) -> Option<f64> {
    let cell = campaign.cells.iter().find(|cell| cell.name == figures.name)?;
    campaign.pools.iter().find(|pool| cell.pool.as_ref() == Some(&pool.name)).map(|pool| pool.limit_upper95)
}

pub(super) fn said(of: &str, excess: &Excess) -> String {
    format!("{of}: {:.4}, one-sided 95 % bounds {:.4} and {:.4}", excess.mean, excess.lower95, excess.upper95)
}

/// Whether a larger share of its faults than this is without a verdict.
fn is_too_void(figures: &Figures, most_void: f64) -> bool {
    figures.without_verdict as f64 > most_void * figures.done() as f64
}

/// What the bounds of figures say of a limit, of whose faults such a share may be without a verdict.
pub(super) fn by_limit(figures: &Figures, limit: f64, most_void: f64) -> Verdict {
    let bounds = [figures.excess, figures.excess_with_void, figures.excess_unnoticed];
    match figures.excess {
        _ if bounds.iter().flatten().any(|excess| excess.lower95 > limit) => Verdict::Broken,
        _ if is_too_void(figures, most_void) || !figures.unsure.is_empty() => Verdict::Unknown,
        Some(excess) if excess.upper95 <= limit && unlike(figures, limit).is_none() => Verdict::Held,
        _ => Verdict::Unknown,
    }
}

/// Gives the verdict. What never may happen is judged in the cells, once.
pub(super) fn conclude(mut figures: Figures, limit: Option<f64>, arm: &Arm, is_cell: bool, campaign: &Campaign) -> Figures {
    figures.limit_upper95 = limit;
    let is_wrong = is_cell && !figures.reasons.is_empty();
    if !is_cell {
        figures.unsure.clear();
    }
    let is_unsure = !figures.unsure.is_empty();
    figures.reasons.extend(figures.unsure.iter().cloned());
    let done = figures.done();
    // What is only done from outside need not be noticed; that it was not is said, where what it cost is known of more faults than nothing is known of.
    let known = figures.excess_unnoticed.map_or(0, |excess| excess.faults);
    let is_silent = is_cell && figures.manifested == 0 && figures.without_verdict > 0 && figures.without_verdict >= known;
    let is_half_judged = is_cell && done >= LEAST_DONE && 2 * figures.without_verdict > done;
    figures.verdict = match limit {
        _ if !arm.judged => Verdict::Figures,
        _ if is_wrong => Verdict::Broken,
        _ if is_cell
            && pool_limit(&figures, campaign).zip(figures.excess).is_some_and(|(limit, excess)| excess.is_far_above(limit)) =>
        {
            Verdict::Broken
        }
        _ if is_silent || is_half_judged => Verdict::Unknown,
        None if is_unsure => Verdict::Unknown,
        None => Verdict::Figures,
        Some(limit) => by_limit(&figures, limit, campaign.most_void),
    };
    if let (Some(limit), Some(excess), true) =
        (limit, figures.excess, figures.verdict != Verdict::Held && figures.verdict != Verdict::Figures)
    {
        let said_of_all = said("faults with excess misses, per fault", &excess);
        figures.reasons.push(format!("{said_of_all}, limit {limit}"));
        figures.reasons.extend(figures.excess_with_void.map(|excess| said("with void ticks", &excess)));
        figures.reasons.extend(figures.excess_alike.map(|excess| said("of those with a control in the same state", &excess)));
        figures.reasons.extend(unlike(&figures, limit).map(|unlike| unlike.words(&figures)));
    }
    if let (None, Verdict::Broken, Some(excess)) = (limit, figures.verdict, figures.excess.filter(|_| !is_wrong)) {
        figures.reasons.push(said("beyond doubt above its pool's limit, faults with excess misses, per fault", &excess));
    }
    let is_unknown = limit.is_some() && figures.verdict == Verdict::Unknown;
    let is_void = is_unknown && !is_silent && is_too_void(&figures, campaign.most_void);
    if is_half_judged || is_void {
        let silent = figures.without_verdict;
        let most = if is_void { format!(": more than most_void = {}", campaign.most_void) } else { String::new() };
        figures.reasons.push(format!("{silent} of its {done} faults have no verdict{most}"));
    }
    if let Some(excess) = figures.excess_unnoticed.filter(|_| limit.is_some() && figures.verdict != Verdict::Figures) {
        figures.reasons.push(said(&format!("of {} that nobody noticed", excess.faults), &excess));
    }
    if is_silent {
        figures.reasons.push("none of its faults showed: it proves nothing".into());
    } else if is_cell && done > 0 && figures.manifested == 0 && arm.judged {
        // It breaks nothing, and passes for nothing either.
        figures.reasons.push(format!("nobody noticed any of its {} faults: it proves nothing", figures.unnoticed.len()));
    }
    let surplus = figures.reasons.len().saturating_sub(MOST_REASONS);
    if surplus > 0 {
        figures.reasons.truncate(MOST_REASONS);
        figures.reasons.push(format!("… and {surplus} more"));
    }
    figures
}
