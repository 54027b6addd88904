//! A latency histogram of fixed size that lives in a station page: 8 buckets per octave from 128 ns to about 134 ms, so that a
//! sample is known to an eighth whatever its size, and counting costs a real-time thread one add.

/// Number of buckets: 20 octaves of 8.
pub const LATENCY_BUCKETS: usize = 160;
const FIRST_OCTAVE: u32 = 7;

/// The bucket of a latency in nanoseconds; what is beyond the last bucket counts in the last.
pub fn bucket_of_ns(latency_ns: u64) -> usize {
    let clamped = latency_ns.max(1 << FIRST_OCTAVE);
    let octave = 63 - clamped.leading_zeros();
    let eighth = (clamped >> (octave - 3)) as usize & 7;
    (((octave - FIRST_OCTAVE) as usize) * 8 + eighth).min(LATENCY_BUCKETS - 1)
}

/// Upper edge of a bucket in nanoseconds.
pub fn bucket_upper_ns(bucket: usize) -> u64 {
    let octave = FIRST_OCTAVE + (bucket / 8) as u32;
    (1u64 << octave) + ((bucket % 8) as u64 + 1) * (1u64 << (octave - 3))
}

/// The `fraction` percentile (0..=1) of a histogram in nanoseconds; 0 for an empty one. Within a bucket the samples are taken to be spread
/// evenly, so that two histograms can be compared more finely than by their buckets; the largest sample counts as its bucket's upper edge. Counts come
/// from another process's page: whatever they are, they add up.
pub fn percentile_ns(counts: &[u64], fraction: f64) -> u64 {
    let total: u128 = counts.iter().map(|count| u128::from(*count)).sum();
    if total == 0 {
        return 0;
    }
    let rank = ((total as f64 * fraction).ceil() as u128).clamp(1, total);
    let mut seen = 0;
    for (bucket, count) in counts.iter().map(|count| u128::from(*count)).enumerate() {
        if seen + count >= rank {
            let upper_ns = bucket_upper_ns(bucket);
            let lower_ns = bucket.checked_sub(1).map_or(0, bucket_upper_ns);
            return lower_ns + (u128::from(upper_ns - lower_ns) * (rank - seen) / count) as u64;
        }
        seen += count;
    }
    bucket_upper_ns(counts.len().saturating_sub(1))
}

/// What was counted since a histogram was looked at before; a page that was damaged meanwhile has counted nothing.
pub fn counted_since(now: &[u64; LATENCY_BUCKETS], before: &[u64; LATENCY_BUCKETS]) -> [u64; LATENCY_BUCKETS] {
    std::array::from_fn(|bucket| now[bucket].saturating_sub(before[bucket]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_latency_lies_in_its_bucket_to_an_eighth() {
        for latency_ns in [128u64, 200, 999, 12_345, 1_000_000, 33_333_333] {
            let upper = bucket_upper_ns(bucket_of_ns(latency_ns));
            assert!(upper > latency_ns && (upper as f64) <= latency_ns as f64 * 1.126, "{latency_ns} {upper}");
        }
        assert_eq!(bucket_of_ns(0), 0);
        assert_eq!(bucket_of_ns(u64::MAX), LATENCY_BUCKETS - 1);
    }

    #[test]
    fn percentiles_by_hand() {
        let mut counts = [0u64; LATENCY_BUCKETS];
        counts[bucket_of_ns(1_000)] = 99;
        counts[bucket_of_ns(1_000_000)] = 1;
        assert!(percentile_ns(&counts, 0.5) < 1_130);
        assert!(percentile_ns(&counts, 0.99) < 1_130);
        assert!(percentile_ns(&counts, 1.0) > 1_000_000);
        assert_eq!(percentile_ns(&[0; 4], 0.5), 0);
        // Whatever the page of another process holds.
        let flipped = [u64::MAX; LATENCY_BUCKETS];
        assert!(percentile_ns(&flipped, 0.5) <= percentile_ns(&flipped, 1.0));
        // One bucket: the samples lie evenly between its edges.
        let (bucket, mut counts) = (bucket_of_ns(500_000), [0u64; LATENCY_BUCKETS]);
        counts[bucket] = 4;
        let (lower_ns, upper_ns) = (bucket_upper_ns(bucket - 1), bucket_upper_ns(bucket));
        assert_eq!(
            [0.5, 0.75, 1.0].map(|share| percentile_ns(&counts, share)),
            [(lower_ns + upper_ns) / 2, (lower_ns + 3 * upper_ns) / 4, upper_ns]
        );
    }
}
