//! The machine that a figure belongs to: processor, cores, kernel, day. Every benchmark of the station describes it in these words. And the time of day.

use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

/// Year, month and day of a number of days since 1970-01-01 (Gregorian).
fn date_of(days: u64) -> (u64, u64, u64) {
    let is_leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let (mut year, mut left) = (1970, days);
    // Bounded by the years since 1970.
    while left >= 365 + u64::from(is_leap(year)) {
        left -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let months = [31, 28 + u64::from(is_leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while left >= months[month] {
        left -= months[month];
        month += 1;
    }
    (year, month as u64 + 1, left + 1)
}

/// Seconds since 1970 now.
pub fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// A number of seconds since 1970 as date and time (RFC 3339, UTC).
pub fn utc_of(unix_s: u64) -> String {
    let ((year, month, day), second) = (date_of(unix_s / 86_400), unix_s % 86_400);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", second / 3_600, second / 60 % 60, second % 60)
}

/// This machine today (UTC), as JSON: `cpu`, `cores`, `kernel`, `date`.
pub fn describe() -> Value {
    let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpuinfo.lines().find_map(|line| line.strip_prefix("model name")).and_then(|rest| rest.split_once(':'));
    let cpu = model.map_or("unknown", |(_, model)| model.trim());
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let (year, month, day) = date_of(now_unix_s() / 86_400);
    json!({
        "cpu": cpu, "cores": crate::system::cores(), "kernel": kernel.trim(), "date": format!("{year:04}-{month:02}-{day:02}"),
    })
}

#[cfg(test)]
mod tests {
    use super::{date_of, utc_of};

    #[test]
    fn times_by_hand() {
        assert_eq!(utc_of(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc_of(1_767_225_599), "2025-12-31T23:59:59Z");
        assert_eq!(utc_of(1_767_225_600 + 3_661), "2026-01-01T01:01:01Z");
    }

    #[test]
    fn dates_by_hand() {
        assert_eq!(date_of(0), (1970, 1, 1));
        assert_eq!(date_of(11_016), (2000, 2, 29));
        assert_eq!(date_of(11_017), (2000, 3, 1));
        assert_eq!(date_of(20_453), (2025, 12, 31));
        assert_eq!(date_of(20_454), (2026, 1, 1));
    }
}
