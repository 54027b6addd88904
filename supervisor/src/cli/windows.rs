//! How often and how long `bench recording` measures.

use super::seconds;
use clap::Args;

/// Pairs of windows, and their length.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct WindowArgs {
    /// recording: how many pairs of windows, with a recording and without. Default: 7; to show a hundredth takes more.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=200))]
    pub pairs: Option<u32>,
    /// recording: length of a window, at most 1m, in whole rounds of the scripted hand (2s). Default: 10s, in which there are two checkpoints.
    #[arg(long = "window", value_name = "TIME", value_parser = window)]
    pub window_s: Option<f64>,
}

/// Longest window, s.
const MOST_WINDOW_S: f64 = 60.0;

fn window(text: &str) -> Result<f64, String> {
    let window_s = seconds(text)?;
    (window_s <= MOST_WINDOW_S).then_some(window_s).ok_or_else(|| format!("{text:?} is longer than a window may be, 1m"))
}

#[cfg(test)]
mod tests {
    use crate::cli::{Cli, Command, WindowArgs};
    use clap::Parser;

    fn windows(line: &str) -> Option<WindowArgs> {
        match Cli::try_parse_from(line.split_whitespace()).ok()?.command {
            Command::Bench { windows, .. } => Some(windows),
            _ => None,
        }
    }

    #[test]
    fn the_windows_of_a_benchmark_are_as_many_and_as_long_as_one_asks_for_within_bounds() {
        let asked = WindowArgs { pairs: Some(40), window_s: Some(30.0) };
        assert_eq!(windows("hystation bench recording --pairs 40 --window 30s"), Some(asked));
        assert_eq!(windows("hystation bench recording"), Some(WindowArgs::default()));
        for bad in ["--pairs 0", "--pairs 201", "--window 2m", "--window none"] {
            assert_eq!(windows(&format!("hystation bench recording {bad}")), None, "{bad}");
        }
    }
}
