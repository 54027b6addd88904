//! Whether faults are alike from station to station, and a bound on the ticks that one costs: what befalls one station falls on many of its faults, so that
//! stations, and not faults, are what is drawn.

use crate::campaign::draw::Draw;

/// Fewest pairs that differ, and fewest for each station, of which their spread tells: of fewer a single station is soon far off.
const LEAST_DIFFERING: usize = 10;
/// Standard deviations beyond which a spread is no chance: one in a thousand.
const FAR: f64 = 3.09;
/// Fewest stations by which alone the mean of what a fault costs is bounded: fewer may be alike by chance.
const ENOUGH_STATIONS: usize = 10;
/// Fewest stations by which it is bounded at all: what two differ by says nothing of a third, of which one may have had a handful of faults.
const LEAST_STATIONS: usize = 3;
/// Samples of the bootstrap.
const SAMPLES: usize = 2_000;
/// Seed of its draws: the same outcomes give the same bound.
const SEED: u64 = 20;

/// Whether the faults that differ from their controls lie together in some stations more than chance has it, by their chi-squared statistic over the stations
/// (its cube root is nearly normal: Wilson and Hilferty, "The distribution of chi-square", PNAS 1931). `stations` has of each its faults, and how many of them
/// differ. The station that has the most beyond its share, of those in the list.
pub fn together(stations: &[(usize, usize)]) -> Option<usize> {
    let here: Vec<usize> = (0..stations.len()).filter(|at| stations[*at].0 > 0).collect();
    let total = |of: fn(&(usize, usize)) -> usize| here.iter().map(|at| of(&stations[*at])).sum::<usize>();
    let (faults, differ) = (total(|station| station.0), total(|station| station.1));
    if here.len() < 3 || differ < LEAST_DIFFERING.max(2 * here.len()) || differ == faults {
        return None;
    }
    let share = differ as f64 / faults as f64;
    let beyond = |at: usize| {
        let (faults, differ) = stations[at];
        let variance = faults as f64 * share * (1.0 - share);
        (differ as f64 - faults as f64 * share) / variance.sqrt()
    };
    let freedom = (here.len() - 1) as f64;
    let chi_squared: f64 = here.iter().map(|at| beyond(*at) * beyond(*at)).sum();
    let spread = 2.0 / (9.0 * freedom);
    let deviations = ((chi_squared / freedom).cbrt() - (1.0 - spread)) / spread.sqrt();
    let most = here.into_iter().max_by(|a, b| beyond(*a).total_cmp(&beyond(*b)));
    most.filter(|_| deviations > FAR)
}

/// Below this lies, with some 95 %, the mean of what a fault costs, ticks: the 95th percentile of the means of as many stations drawn from these, each with all
/// its faults (Efron, "Bootstrap methods: another look at the jackknife", Annals of Statistics 1979); of fewer than ten stations no less than that of as many
/// faults, each drawn by itself, and of fewer than three that alone. It is approximate, and rather too low than too high where a few costs are large: what none
/// of them had is in no sample, so that it is 0, and no bound, where none cost anything. `None` of fewer than two faults.
pub fn mean_upper95(stations: &[Vec<i64>]) -> Option<f64> {
    let here: Vec<(i64, usize)> =
        stations.iter().map(|costs| (costs.iter().sum(), costs.len())).filter(|(_, faults)| *faults > 0).collect();
    let by_stations = drawn_upper95(&here);
    if here.len() >= ENOUGH_STATIONS {
        return by_stations;
    }
    let faults: Vec<(i64, usize)> = stations.iter().flatten().map(|cost| (*cost, 1)).collect();
    by_stations.filter(|_| here.len() >= LEAST_STATIONS).into_iter().chain(drawn_upper95(&faults)).reduce(f64::max)
}

/// The 95th percentile of the means of as many as these drawn from them, each with its cost, ticks, and the number of its faults. `None` of fewer than two.
fn drawn_upper95(of: &[(i64, usize)]) -> Option<f64> {
    if of.len() < 2 {
        return None;
    }
    let mut draw = Draw::new(SEED);
    let last = of.len() as u64 - 1;
    let mut means: Vec<f64> = (0..SAMPLES)
        .map(|_| {
            let drawn = (0..of.len()).map(|_| of[draw.between(0, last) as usize]);
            let (cost, faults) = drawn.fold((0, 0), |(cost, faults), one| (cost + one.0, faults + one.1));
            cost as f64 / faults as f64
        })
        .collect();
    means.sort_by(f64::total_cmp);
    means.get(SAMPLES * 95 / 100).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As in a campaign of which 62 of the 95 pairs that differed lay in one station.
    #[test]
    fn one_bad_station_is_seen_and_chance_is_not() {
        assert_eq!(together(&[(100, 5), (100, 6), (100, 4), (0, 0), (100, 62)]), Some(4));
        assert_eq!(together(&[(100, 5), (100, 6), (100, 4), (100, 9)]), None);
        assert_eq!(together(&[(100, 0), (100, 0), (100, 3)]), None, "too few to tell");
        assert_eq!(together(&[(10, 10), (10, 10), (10, 10)]), None);
        let mut draw = Draw::new(7);
        let seen = (0..1_000).filter(|_| {
            let of_one = |draw: &mut Draw| (0..60).filter(|_| draw.between(0, 9) == 0).count();
            let stations: Vec<(usize, usize)> = (0..12).map(|_| (60, of_one(&mut draw))).collect();
            together(&stations).is_some()
        });
        assert!(seen.count() <= 5, "one in a thousand");
    }

    #[test]
    fn the_mean_is_bounded_by_its_stations() {
        assert_eq!(mean_upper95(&[vec![1, 1], vec![1], vec![], vec![1, 1, 1]]), Some(1.0));
        assert_eq!((mean_upper95(&[vec![5, 9]]), mean_upper95(&[vec![5], vec![]])), (Some(9.0), None));
        // A second station that had two faults: half of all samples of two stations have no other.
        let two = [[vec![1; 30], vec![0; 68]].concat(), vec![1, 0]];
        assert!(mean_upper95(&two).is_some_and(|bound| bound < 0.4), "{:?}", mean_upper95(&two));
        // Of ten stations one lost 40 ticks of ten faults: it is drawn 0 to 4 times in nearly all samples, at least three times in 7 % of them.
        let mut stations = vec![vec![0; 10]; 10];
        stations[3][7] = 40;
        let bound = mean_upper95(&stations).unwrap();
        assert!((0.8..=1.2).contains(&bound), "{bound}: the mean is 0.4");
        assert_eq!(mean_upper95(&stations), Some(bound));
    }

    /// Three stations that had lost as much as each other bounded the mean by itself.
    #[test]
    fn of_few_stations_the_larger_bound_is_that_of_the_mean() {
        // Of sixty faults three cost 3 ticks: six or more are drawn in 8 % of the samples, seven in 3 %.
        let alike = vec![[vec![3], vec![0; 19]].concat(); 3];
        assert!((mean_upper95(&alike).unwrap() - 0.3).abs() < 1e-9, "{:?}", mean_upper95(&alike));
        // The one that lost all is drawn three times in one sample of 27, and twice in six of them.
        let together = [vec![0; 20], vec![0; 20], vec![1; 20]];
        assert!((mean_upper95(&together).unwrap() - 2.0 / 3.0).abs() < 1e-9, "{:?}", mean_upper95(&together));
        let many = vec![[vec![3], vec![0; 19]].concat(); ENOUGH_STATIONS];
        assert!((mean_upper95(&many).unwrap() - 0.15).abs() < 1e-9, "they are enough");
    }
}
