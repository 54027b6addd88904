//! Samples, percentiles and ratios of things measured in turns.

use crate::Failure;
use hyst_exchange::system::now_ns;
use serde_json::{Value, json};

/// When the whole run must come to its end.
pub struct Budget {
    end_ns: u64,
}

impl Budget {
    /// So many seconds from now on.
    pub fn seconds(seconds: u64) -> Budget {
        Budget { end_ns: now_ns() + seconds * 1_000_000_000 }
    }
    fn is_spent(&self) -> bool {
        now_ns() >= self.end_ns
    }
}

/// What one side of a comparison took.
#[derive(Default)]
pub struct Samples {
    ns: Vec<f64>,
    block_p50_ns: Vec<f64>,
}

fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    let rank = ((sorted.len() as f64 * fraction).ceil() as usize).clamp(1, sorted.len().max(1));
    sorted.get(rank - 1).copied().unwrap_or(f64::NAN)
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values
}

impl Samples {
    fn percentiles_us(&self) -> [f64; 4] {
        let sorted = sorted(&self.ns);
        [0.5, 0.99, 0.999, 1.0].map(|fraction| percentile(&sorted, fraction) / 1e3)
    }
    /// Median over the blocks of the ratio of their medians: what a drift of the machine does to both sides cancels.
    pub fn ratio_to(&self, other: &Samples) -> f64 {
        let ratios: Vec<f64> = self.block_p50_ns.iter().zip(&other.block_p50_ns).map(|(own, raw)| own / raw).collect();
        percentile(&sorted(&ratios), 0.5)
    }
}

/// One operation; gives what it took, ns.
pub type Arm<'a> = &'a mut dyn FnMut() -> Result<f64, Failure>;

/// Runs the arms in turns: `blocks` blocks of `count` operations each, in reversed order every other time. The first tenth of a block
/// fills the caches again and does not count. A budget that is spent ends the run early, after whole blocks.
pub fn in_turns<const N: usize>(budget: &Budget, blocks: usize, count: usize, arms: [Arm; N]) -> Result<[Samples; N], Failure> {
    let mut samples: [Samples; N] = std::array::from_fn(|_| Samples::default());
    for block in 0..blocks {
        if block > 0 && budget.is_spent() {
            break;
        }
        for turn in 0..N {
            let at = if block % 2 == 0 { turn } else { N - 1 - turn };
            for _ in 0..count / 10 {
                arms[at]()?;
            }
            let mut block_ns = Vec::with_capacity(count);
            for _ in 0..count {
                block_ns.push(arms[at]()?);
            }
            samples[at].block_p50_ns.push(percentile(&sorted(&block_ns), 0.5));
            samples[at].ns.extend(block_ns);
        }
    }
    Ok(samples)
}

/// How long `operation` takes, ns.
pub fn timed(operation: impl FnOnce() -> Result<(), Failure>) -> Result<f64, Failure> {
    let begin_ns = now_ns();
    operation()?;
    Ok((now_ns() - begin_ns) as f64)
}

/// One comparison.
pub struct Row {
    primitive: String,
    beside: &'static str,
    us: [f64; 4],
    raw_us: [f64; 4],
    ratio: f64,
    limit_ratio: Option<f64>,
    n: usize,
}

impl Row {
    /// A primitive beside what it is made of; `limit_ratio` is the project's target, if it has one.
    pub fn new(primitive: String, beside: &'static str, own: &Samples, raw: &Samples, limit_ratio: Option<f64>) -> Row {
        let (us, raw_us) = (own.percentiles_us(), raw.percentiles_us());
        Row { primitive, beside, us, raw_us, ratio: own.ratio_to(raw), limit_ratio, n: own.ns.len() }
    }
    /// Whether the ratio is within its limit; `None` if it has none.
    pub fn is_held(&self) -> Option<bool> {
        self.limit_ratio.map(|limit| self.ratio <= limit)
    }
    /// The row as the reports have it.
    pub fn json(&self) -> Value {
        let percentiles = |[p50, p99, p999, max]: [f64; 4]| json!({ "p50": p50, "p99": p99, "p999": p999, "max": max });
        json!({
            "primitive": self.primitive, "beside": self.beside, "us": percentiles(self.us), "raw_us": percentiles(self.raw_us),
            "ratio": self.ratio, "limit_ratio": self.limit_ratio, "held": self.is_held(), "n": self.n,
        })
    }
}

/// The rows for people.
pub fn print(machine: &Value, rows: &[Row]) {
    println!("{machine}");
    println!(
        "{:<36} {:<26} {:>9} {:>9} {:>9} {:>9} {:>9} {:>7} {:>6}  held",
        "primitive", "beside", "p50 µs", "p99", "p99.9", "raw p50", "raw p99", "ratio", "limit"
    );
    for row in rows {
        let held = match row.is_held() {
            None => "",
            Some(true) => "yes",
            Some(false) => "NO",
        };
        let limit = row.limit_ratio.map_or(String::new(), |limit| format!("{limit:.2}"));
        println!(
            "{:<36} {:<26} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>7.3} {:>6}  {held}",
            row.primitive, row.beside, row.us[0], row.us[1], row.us[2], row.raw_us[0], row.raw_us[1], row.ratio, limit
        );
    }
}
