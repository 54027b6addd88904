//! Curves of fixed size, whatever the length of the recording: the least and the largest value of each of at most 1 024 equal spans of time, and
//! the way of the tip as at most 2 048 points. Whenever there is no more room, the spans are doubled.

use crate::motion::finite;

/// Most spans: as many as a page has pixels.
const BINS: usize = 1_024;
/// Most points of the way.
const POINTS: usize = 2_048;

/// A value over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// A span has 2 to the power of this ticks.
    shift: u32,
    bins: Vec<Option<[f64; 2]>>,
}

impl Series {
    /// Takes the value of a tick, counted from the recording's first; what is no number is left out.
    pub fn add(&mut self, tick: u64, value: f64) {
        if !value.is_finite() {
            return;
        }
        // At most 54 turns: then every tick is within.
        while tick >> self.shift >= BINS as u64 {
            self.bins = self.bins.chunks(2).map(|pair| pair.iter().copied().flatten().reduce(joined)).collect();
            self.shift += 1;
        }
        let at = (tick >> self.shift) as usize;
        if self.bins.len() <= at {
            self.bins.resize(at + 1, None);
        }
        let bin = &mut self.bins[at];
        *bin = Some(bin.map_or([value; 2], |span| joined(span, [value; 2])));
    }

    /// Ticks of a span.
    pub fn span_ticks(&self) -> u64 {
        1 << self.shift
    }

    /// The spans in which there is a value: number of the span, least and largest value.
    pub fn spans(&self) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
        self.bins.iter().enumerate().filter_map(|(at, bin)| bin.map(|span| (at, span)))
    }

    /// Least and largest value of all.
    pub fn range(&self) -> Option<[f64; 2]> {
        self.bins.iter().copied().flatten().reduce(joined)
    }
}

fn joined([low, high]: [f64; 2], [other_low, other_high]: [f64; 2]) -> [f64; 2] {
    [low.min(other_low), high.max(other_high)]
}

/// The way of the tip, m: a point every so many ticks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// A point is kept every 2 to the power of this ticks.
    shift: u32,
    wait: u64,
    points_m: Vec<[f32; 3]>,
}

impl Trace {
    /// Takes the tip in the next tick; what is no number is left out.
    pub fn add(&mut self, tip_m: [f32; 3]) {
        if finite(tip_m).is_none() {
            return;
        }
        if self.wait > 0 {
            self.wait -= 1;
            return;
        }
        self.wait = (1u64 << self.shift) - 1;
        self.points_m.push(tip_m);
        if self.points_m.len() == POINTS {
            self.points_m = self.points_m.iter().copied().step_by(2).collect();
            self.shift = (self.shift + 1).min(63);
        }
    }

    /// The points, in the order of time.
    pub fn points_m(&self) -> &[[f32; 3]] {
        &self.points_m
    }
}

/// What the page draws.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// Force on the hand, N.
    pub force_n: Series,
    /// Pivot to tip, m.
    pub insertion_m: Series,
    /// Pressure in the cavity, Pa.
    pub pressure_pa: Series,
    /// Deficit, ml.
    pub deficit_ml: Series,
    /// Volume removed, ml.
    pub removed_ml: Series,
    /// Share of the light that comes through the blood, 0 to 1.
    pub transmittance: Series,
    /// Where there is a value there was current in the loop.
    pub current: Series,
    /// Way of the tip.
    pub trace: Trace,
    /// Where the tip was at the largest force, m.
    pub peak_at_m: Option<[f32; 3]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_double_and_keep_the_least_and_the_largest() {
        let mut series = Series::default();
        for tick in 0..3_000 {
            series.add(tick, tick as f64);
        }
        series.add(3_000, f64::NAN);
        assert_eq!((series.span_ticks(), series.range()), (4, Some([0.0, 2_999.0])));
        let spans: Vec<_> = series.spans().collect();
        assert_eq!((spans.len(), spans[0], spans[749]), (750, (0, [0.0, 3.0]), (749, [2_996.0, 2_999.0])));
    }

    #[test]
    fn a_leap_to_the_end_of_time_costs_no_memory() {
        let mut series = Series::default();
        series.add(5, 1.0);
        series.add(u64::MAX, 2.0);
        assert!(series.bins.len() <= BINS && series.span_ticks() == 1 << 54);
        assert_eq!(series.spans().collect::<Vec<_>>(), [(0, [1.0; 2]), (BINS - 1, [2.0; 2])]);
    }

    #[test]
    fn the_way_is_thinned_evenly() {
        let mut trace = Trace::default();
        trace.add([f32::NAN, 0.0, 0.0]);
        (0..10_000).for_each(|tick| trace.add([tick as f32, 0.0, 0.0]));
        let points = trace.points_m();
        assert!(points.len() < POINTS && points.len() > POINTS / 2);
        assert!(points.windows(2).all(|pair| pair[1][0] - pair[0][0] == 8.0), "{:?}", &points[..9]);
    }
}
