//! `hystation bench`: the engines' own benchmarks are theirs; this one runs the station as a whole.
//!
//! `bench station` runs the default scene headless, once with two collision workers and once with none, each beside a bare paced loop of
//! the device's period and priority in the same run: what the bare loop suffers is the machine's, what is beyond it is the station's.

use crate::report::latency;
use crate::settings::Refusal;
use hyst_engine::realtime;
use hyst_exchange::system;
use hyst_messages::{LATENCY_BUCKETS, Role, TICK_NS, bucket_of_ns};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Length of each of the two runs, s: with start and stop both end within the 50 s that a benchmark may take.
const RUN_S: u32 = 15;
/// Name of the station.
fn name(workers: usize) -> String {
    format!("bench-{}-{workers}", std::process::id())
}

/// Runs a benchmark.
pub fn bench(what: &str, mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    match what {
        "tissue" | "contact" => sibling("tissue", &["bench", what], mesh, json),
        "flow" => sibling("fluid", &["bench", what], mesh, json),
        "exchange" => sibling("exchange-bench", &[], mesh, json),
        "station" => station(mesh, json),
        _ => Err(Refusal::input(format!("bench {what}: there are tissue, contact, flow, exchange and station"))),
    }
}

fn folder() -> Result<PathBuf, Refusal> {
    let program = std::env::current_exe().map_err(|e| Refusal::failed(format!("cannot find the folder of this program: {e}")))?;
    Ok(program.parent().map(Path::to_path_buf).unwrap_or_default())
}

/// Becomes another binary of the station; returns only if it cannot.
fn sibling(binary: &str, words: &[&str], mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    use std::os::unix::process::CommandExt;
    let path = folder()?.join(binary);
    let mut command = Command::new(&path);
    command.args(words);
    if let Some(mesh) = mesh {
        command.arg("--mesh").arg(mesh);
    }
    if json {
        command.arg("--json");
    }
    let error = command.exec();
    Err(Refusal::input(format!("{}: {error}; build all binaries into one folder with `cargo build --release`", path.display())))
}

fn station(mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    let mut rows = Vec::new();
    for workers in [2, 0] {
        rows.extend(one_run(workers, mesh)?);
    }
    let result = json!({ "machine": machine(), "rows": rows });
    if json {
        println!("{result:#}");
    } else {
        print(&result);
    }
    Ok(0)
}

fn machine() -> Value {
    let processor = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        processor.lines().find_map(|line| line.strip_prefix("model name")).map(|rest| rest.trim_start_matches([' ', '\t', ':']));
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    json!({ "cores": system::cores(), "processor": model.unwrap_or("unknown"), "kernel": kernel.trim() })
}

fn one_run(workers: usize, mesh: Option<&Path>) -> Result<Vec<Value>, Refusal> {
    let name = name(workers);
    let file = std::env::temp_dir().join(format!("{name}.json"));
    let program = std::env::current_exe().map_err(|e| Refusal::failed(e.to_string()))?;
    let mut command = Command::new(program);
    command.args([
        "--name",
        &name,
        "run",
        "--headless",
        "--quiet",
        "--for",
        &format!("{RUN_S}s"),
        "--workers",
        &workers.to_string(),
    ]);
    command.arg("--report").arg(&file).args(mesh).stdin(Stdio::null()).stdout(Stdio::null());
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let bare = std::thread::spawn(move || bare_loop(&stopped));
    let status = command.status();
    stop.store(true, Ordering::Release);
    let (bare_fifo, bare) = bare.join().unwrap_or((false, Vec::new()));
    let text = std::fs::read_to_string(&file).unwrap_or_default();
    let _ = std::fs::remove_file(&file); // it is in a temporary folder
    let code = status.map_err(|e| Refusal::failed(format!("bench station: {e}")))?.code().unwrap_or(1);
    let report: Value = serde_json::from_str(&text)
        .map_err(|_| Refusal { code: code.max(1) as u8, message: "bench station: the run gave no report".into() })?;
    Ok(rows(workers, code, &report, bare_fifo, &bare))
}

/// A loop of the device's period that does nothing: whether it was real time, and its wake-up latencies.
fn bare_loop(stop: &AtomicBool) -> (bool, Vec<u64>) {
    let fifo = realtime::priority(Role::Device).is_some_and(system::become_fifo);
    let mut counts = vec![0u64; LATENCY_BUCKETS];
    let mut next_ns = system::now_ns() + TICK_NS;
    while !stop.load(Ordering::Acquire) {
        system::sleep_until_ns(next_ns);
        let now_ns = system::now_ns();
        counts[bucket_of_ns(now_ns.saturating_sub(next_ns))] += 1;
        next_ns += TICK_NS;
        if next_ns < now_ns {
            next_ns = now_ns + TICK_NS;
        }
    }
    (fifo, counts)
}

fn rows(workers: usize, code: i32, report: &Value, bare_fifo: bool, bare: &[u64]) -> Vec<Value> {
    let mut rows = vec![
        json!({ "workers": workers, "name": "station", "exit_code": code, "rss_mib": report["rss_mib"], "pss_mib": report["pss_mib"],
            "copies": report["copies"], "device": report["device"] }),
        json!({ "workers": workers, "name": "bare loop", "real_time": bare_fifo, "rate_hz": 1000.0, "wakeup_us": latency(bare) }),
    ];
    for (name, process) in report["processes"].as_object().into_iter().flatten() {
        let mut row = process.clone();
        if let Some(object) = row.as_object_mut() {
            object.insert("workers".into(), json!(workers));
            object.insert("name".into(), json!(name));
        }
        rows.push(row);
    }
    rows
}

fn print(result: &Value) {
    println!("{}", result["machine"]);
    let number = |value: &Value| value.as_f64().map_or("-".to_string(), |value| format!("{value:.1}"));
    println!(
        "{:>7} {:<20} {:>9} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "workers", "process", "rate/Hz", "cpu/%", "wake p50", "p99", "p99.9", "max/us", "rss/MiB"
    );
    for row in result["rows"].as_array().into_iter().flatten() {
        let wake = &row["wakeup_us"];
        println!(
            "{:>7} {:<20} {:>9} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9}",
            row["workers"].to_string(),
            row["name"].as_str().unwrap_or("-"),
            number(&row["rate_hz"]),
            number(&row["cpu_percent"]),
            number(&wake["p50"]),
            number(&wake["p99"]),
            number(&wake["p999"]),
            number(&wake["max"]),
            number(&row["rss_mib"])
        );
    }
}
