//! What the engines' own benchmarks have in common: their arguments, the machine that a figure belongs to, the form of the result.
//!
//! The result is `{machine, rows}`; latencies have the same form as in a run's report.

use hyst_exchange::machine;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// What a benchmark is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Which benchmark.
    pub what: String,
    /// Mesh or scene in place of the embedded scene.
    pub mesh: Option<PathBuf>,
    /// JSON instead of a table.
    pub json: bool,
}

/// Reads `WHAT [--mesh FILE] [--json]`.
///
/// # Errors
/// One sentence that names the argument and what is expected.
pub fn request(words: impl Iterator<Item = String>, known: &[&str], takes_mesh: bool) -> Result<Request, String> {
    let mut words = words;
    let expected = format!("expected {}{} [--json]", known.join("|"), if takes_mesh { " [--mesh FILE]" } else { "" });
    let what = words.next().filter(|word| known.contains(&word.as_str()));
    let Some(what) = what else { return Err(format!("no known benchmark named first; {expected}")) };
    let mut request = Request { what, mesh: None, json: false };
    while let Some(word) = words.next() {
        match word.as_str() {
            "--json" => request.json = true,
            "--mesh" if takes_mesh => {
                let file = words.next().ok_or_else(|| format!("--mesh without a file; {expected}"))?;
                request.mesh = Some(PathBuf::from(file));
            }
            other => return Err(format!("unknown argument {other:?}; {expected}")),
        }
    }
    Ok(request)
}

/// A row for a target: what was measured beside what it is to be.
pub fn target(name: &str, value: f64, limit: f64, at_least: bool) -> Value {
    let (bound, held) = if at_least { ("at least", value >= limit) } else { ("at most", value <= limit) };
    json!({ "arm": "target", "name": name, "value": value, "bound": bound, "limit": limit, "held": held })
}

/// A row for a target of which this machine can show nothing: neither held nor missed.
pub fn unjudged(name: &str, limit: f64, at_least: bool) -> Value {
    let mut row = target(name, f64::NAN, limit, at_least);
    row["held"] = Value::Null;
    row
}

/// The end of a benchmark: prints its rows, the targets as lines of their own, or says why there are none. Exit code 1 if a target is missed, 2 for a bad
/// input.
pub fn finish(program: &str, json: bool, rows: Result<Vec<Value>, String>) -> ExitCode {
    let rows = match rows {
        Ok(rows) => rows,
        Err(error) => {
            eprintln!("{program} bench: {error}");
            return ExitCode::from(2);
        }
    };
    let machine = machine::describe();
    if json {
        println!("{:#}", json!({ "machine": machine, "rows": rows }));
    } else {
        let (targets, figures): (Vec<&Value>, Vec<&Value>) = rows.iter().partition(|row| row["arm"] == "target");
        println!("{machine}");
        print!("{}", table(&figures));
        targets.iter().for_each(|target| println!("{}", line(target)));
    }
    ExitCode::from(u8::from(misses_a_target(&rows)))
}

fn misses_a_target(rows: &[Value]) -> bool {
    rows.iter().any(|row| row["held"] == false)
}

/// A target for people.
fn line(target: &Value) -> String {
    let text = |key: &str| target[key].as_str().unwrap_or_default().to_owned();
    let value = target["value"].as_f64().map_or("-".to_string(), |value| format!("{value:.3}"));
    let limit = target["limit"].as_f64().unwrap_or(f64::NAN);
    let held = target["held"].as_bool().map_or("not judged", |held| if held { "held" } else { "NOT HELD" });
    format!("{:<72} {value:>10}  {} {limit:>7}  {held}", text("name"), text("bound"))
}

/// Quantiles of samples, each divided by `unit_ns`; the samples are sorted on the way. Zeros without samples.
pub fn spread(samples_ns: &mut [u64], unit_ns: f64) -> Value {
    let mut at = |share: f64| quantile_ns(samples_ns, share) / unit_ns;
    json!({ "p50": at(0.5), "p99": at(0.99), "p999": at(0.999), "max": at(1.0) })
}

/// The sample below or at which a share of them lies; the samples are sorted on the way. 0 without samples.
pub fn quantile_ns(samples_ns: &mut [u64], share: f64) -> f64 {
    samples_ns.sort_unstable();
    let index = (share * samples_ns.len() as f64).ceil() as usize;
    samples_ns.get(index.saturating_sub(1)).map_or(0.0, |sample| *sample as f64)
}

/// The mean of all but the slowest thousandth, ns: of steps that are not alike, without what the machine did meanwhile.
pub fn usual_ns(samples_ns: &mut [u64]) -> f64 {
    samples_ns.sort_unstable();
    let usual = &samples_ns[..samples_ns.len() - samples_ns.len() / 1_000];
    usual.iter().sum::<u64>() as f64 / usual.len().max(1) as f64
}

/// One line for each key, one column for each row; nested keys are joined with a dot.
fn table(rows: &[&Value]) -> String {
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    for (column, row) in rows.iter().enumerate() {
        flatten("", row, &mut |key, text| {
            let found = lines.iter().position(|(known, _)| known == key);
            let at = found.unwrap_or_else(|| {
                lines.push((key.to_owned(), vec!["-".to_owned(); rows.len()]));
                lines.len() - 1
            });
            lines[at].1[column] = text;
        });
    }
    let cells = |line: &(String, Vec<String>)| line.1.iter().map(|cell| format!(" {cell:>22}")).collect::<String>();
    lines.iter().map(|line| format!("{:<26}{}\n", line.0, cells(line))).collect()
}

fn flatten(prefix: &str, value: &Value, out: &mut impl FnMut(&str, String)) {
    match value {
        Value::Object(members) if members.is_empty() => out(prefix, "none".into()),
        Value::Object(members) => {
            for (key, member) in members {
                let joined = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                flatten(&joined, member, out);
            }
        }
        Value::Number(number) if number.is_f64() => out(prefix, format!("{:.3}", number.as_f64().unwrap_or(f64::NAN))),
        Value::String(text) => out(prefix, text.clone()),
        other => out(prefix, other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_by_hand() {
        let mut samples: Vec<u64> = (1..=100).rev().collect();
        assert_eq!(spread(&mut samples, 10.0), json!({ "p50": 5.0, "p99": 9.9, "p999": 10.0, "max": 10.0 }));
        assert_eq!(quantile_ns(&mut [], 0.5), 0.0);
        let mut samples_ns: Vec<u64> = (0..2_000).map(|at| if at < 2 { 1_000_000 } else { at % 2 * 20 }).collect();
        assert_eq!((usual_ns(&mut samples_ns), usual_ns(&mut [7]), usual_ns(&mut [])), (10.0, 7.0, 0.0));
    }

    #[test]
    fn a_request_is_read_whole_or_refused() {
        let read = |line: &str, mesh| request(line.split_whitespace().map(String::from), &["a", "b"], mesh);
        let asked = read("b --mesh x.msh --json", true).unwrap();
        assert_eq!(asked, Request { what: "b".into(), mesh: Some("x.msh".into()), json: true });
        for (line, mesh) in
            [("", true), ("c", true), ("a --mesh", true), ("a --mesh x", false), ("a --fast", true), ("a b", true)]
        {
            assert!(read(line, mesh).is_err_and(|error| error.contains("expected a|b")), "{line}");
        }
    }

    #[test]
    fn a_table_has_every_key_of_every_row() {
        let text = table(&[&json!({ "a": { "p50": 1.5 }, "peers": {} }), &json!({ "b": "x" })]);
        let words: Vec<&str> = text.split_whitespace().collect();
        assert_eq!(words, ["a.p50", "1.500", "-", "peers", "none", "-", "b", "-", "x"]);
    }

    #[test]
    fn a_target_is_held_or_missed_and_says_so() {
        let rows = [target("fast enough", 0.5, 1.0, false), target("often enough", 5.0, 5.0, true), json!({ "b": "x" })];
        assert!(!misses_a_target(&rows) && line(&rows[0]).contains("at most") && line(&rows[1]).ends_with(" held"), "{rows:?}");
        for missed in [target("slow", 1.1, 1.0, false), target("rare", 4.9, 5.0, true), target("unknown", f64::NAN, 1.0, false)] {
            assert!(line(&missed).ends_with("NOT HELD"), "{missed}");
            assert!(misses_a_target(&[rows[0].clone(), missed]));
        }
        let never = unjudged("many cores", 2.0, true);
        assert!(line(&never).ends_with("not judged") && !misses_a_target(&[rows[0].clone(), never]), "neither held nor missed");
    }
}
