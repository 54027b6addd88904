//! How clear the view was: from what the fluid's statuses say of the light that comes through the blood before the lens. Who says nothing of it, an older
//! recording or a lens that is in tissue, is left out.

/// From this share of the light on the view is clear: half of it, assumed. Over 20 mm that is a medium of which an eightieth is blood.
pub const CLEAR_SHARE: f64 = 0.5;

/// The view so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clarity {
    /// Ticks in which it is known.
    pub known_ticks: u64,
    /// Of them those with at least [`CLEAR_SHARE`] of the light.
    pub clear_ticks: u64,
    /// The longest time without that, ticks: until the view was clear again; what is not known in between is none of it.
    pub longest_ticks: u64,
    /// Ticks times the share of the light in them.
    light_ticks: f64,
    /// Ticks since the view was clear last.
    unclear_ticks: u64,
}

impl Clarity {
    /// So many ticks with a share of the light, 0 to 1.
    pub fn hold(&mut self, share: f64, ticks: u64) {
        self.known_ticks += ticks;
        self.light_ticks += share * ticks as f64;
        if share >= CLEAR_SHARE {
            self.clear_ticks += ticks;
            self.unclear_ticks = 0;
        } else {
            self.unclear_ticks += ticks;
            self.longest_ticks = self.longest_ticks.max(self.unclear_ticks);
        }
    }

    /// The mean share of the light; `None` if nothing is known.
    pub fn mean_share(&self) -> Option<f64> {
        (self.known_ticks > 0).then(|| self.light_ticks / self.known_ticks as f64)
    }

    /// The longest time without a clear view, ticks; `None` if nothing is known.
    pub fn longest_known_ticks(&self) -> Option<u64> {
        (self.known_ticks > 0).then_some(self.longest_ticks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_time_without_a_view_ends_only_with_a_clear_one() {
        let mut clarity = Clarity::default();
        assert_eq!((clarity.mean_share(), clarity.longest_known_ticks()), (None, None));
        for (share, ticks) in [(1.0, 100), (0.49, 30), (0.25, 50), (0.5, 10), (0.0, 60), (0.75, 50)] {
            clarity.hold(share, ticks);
        }
        assert_eq!((clarity.known_ticks, clarity.clear_ticks, clarity.longest_known_ticks()), (300, 160, Some(80)));
        let mean = (100.0 + 14.7 + 12.5 + 5.0 + 37.5) / 300.0;
        assert!(clarity.mean_share().is_some_and(|share| (share - mean).abs() < 1e-12), "{clarity:?}");
        clarity.hold(0.1, 81);
        assert_eq!(clarity.longest_ticks, 81, "one that goes on counts so far");
    }
}
