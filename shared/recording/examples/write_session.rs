//! Writes a session of smooth made-up motion, says how much disk and time a second of it takes:
//! `cargo run --release -p hyst-recording --example write_session -- FILE.mcap [SECONDS]`.

use hyst_messages::{AppliedRecord, ForceCommand, HardwareSample, Pose};
use hyst_recording::{Block, Reader, Session, WriteError, Writer};
use std::time::{Duration, Instant};

fn record(tick: u64) -> AppliedRecord {
    let t = tick as f32 * 0.001;
    let pose = Pose {
        position_m: [0.01 * t.sin(), 0.008 * (1.3 * t).cos(), 0.05 + 0.003 * (2.1 * t).sin()],
        orientation: [0.1 * t.sin(), 0.1 * t.cos(), 0.02 * (3.0 * t).sin(), 0.98],
        pitch_rad: 0.2 * t.sin(),
        yaw_rad: 0.2 * t.cos(),
        roll_rad: 0.01 * t,
        insertion_m: 0.05 + 0.003 * (2.1 * t).sin(),
        ..Default::default()
    };
    let command =
        ForceCommand { tick, force_tick: tick, force_n: [t.sin(), 0.3 * t.cos(), (7.0 * t).sin()], ..Default::default() };
    let velocity_m_s = [0.01 * t.cos(), -0.0104 * (1.3 * t).sin(), 0.0063 * (2.1 * t).cos()];
    let sample = HardwareSample {
        hardware_tick: tick,
        time_ns: tick * 1_000_000,
        pose,
        velocity_m_s,
        force_n: command.force_n,
        ..Default::default()
    };
    AppliedRecord { tick, command, sample, model_tick: tick, model_epoch: 1, model_incarnation: 7, ..Default::default() }
}

fn main() -> Result<(), WriteError> {
    let mut arguments = std::env::args().skip(1);
    let path = std::path::PathBuf::from(arguments.next().unwrap_or_else(|| "session.mcap".into()));
    let seconds: u64 = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(10);
    let session = Session::from([("session".into(), "example".into())]);
    let mut writer = Writer::open(&path, &session)?;
    let mut spent = Duration::ZERO;
    for n in 0..5 * seconds {
        let block = Block { applied: (200 * n + 1..200 * n + 201).map(record).collect(), ..Block::default() };
        let start = Instant::now();
        writer.append(&block)?;
        spent += start.elapsed();
    }
    let bytes = writer.finish()?;
    let spent_ms = spent.as_secs_f64() * 1e3;
    let mut read = 0;
    let _ = Reader::open(&path).and_then(|mut reader| reader.each_block(1, |block| read += block.applied.len()));
    let per_second = bytes as f64 / seconds as f64 / 1e6;
    println!(
        "{seconds} s: {bytes} bytes, {per_second:.3} MB/s, {:.1} ms of work per second, {read} ticks read back",
        spent_ms / seconds as f64
    );
    Ok(())
}
