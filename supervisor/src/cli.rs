//! The command line.

mod again;
mod codes;
mod fault;
mod windows;

use clap::{Args, Parser, Subcommand};
use std::path::{Path, PathBuf};

pub use again::Again;
pub use fault::{CampaignArgs, CompareArgs, FaultCommand, InjectArgs};
pub use windows::WindowArgs;

/// A hysteroscopy training station: every engine is a process, and no single fault stops the hand from feeling the tissue.
#[derive(Debug, Parser)]
#[command(name = "hystation", version, after_help = codes::ALL)]
pub struct Cli {
    /// Name of the station. Stations of different names run side by side and never meet.
    #[arg(long, global = true, default_value = "default")]
    pub name: String,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a station in the foreground until Ctrl-C, `hystation stop`, the end of --for, or with --until-end that of the case.
    #[command(after_help = codes::RUN)]
    Run(Box<RunArgs>),
    /// Show the processes of a running station.
    Status {
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show the processes of a running station live, drawn anew twice a second.
    Top,
    /// Show what happened in a station, or what a process printed.
    Logs {
        /// A process as `status` names it. Default: the station's events.
        process: Option<String>,
        /// Go on printing what comes.
        #[arg(short, long)]
        follow: bool,
    },
    /// Stop a running station.
    Stop,
    /// Do harm on purpose, in a station that was started with --test-mode.
    Fault {
        /// What to do.
        #[command(subcommand)]
        command: FaultCommand,
    },
    /// Check a scene, a case or a mesh; nothing is started.
    Check {
        /// Scene or case (.toml), mesh, or the name of a case that came with the programs (polyp). Default: the built-in scene.
        file: Option<PathBuf>,
        /// Of a case, the anatomy of another seed than its own: seed=7.
        #[arg(long = "set", value_name = "seed=N")]
        set: Vec<String>,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Say whether this machine is fit, with the cure for each thing that is not.
    Doctor {
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Measure how fast the station is on this machine; the exit code is 1 if a target is not held.
    Bench {
        /// What to measure: tissue, contact, flow, exchange, recording or station.
        what: String,
        /// Mesh or scene to measure with. Default: the built-in scene.
        #[arg(long, value_name = "FILE")]
        mesh: Option<PathBuf>,
        /// How often and how long.
        #[command(flatten)]
        windows: WindowArgs,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Put another engine into a role while the station runs; a bad one is rolled back by itself.
    #[command(after_help = codes::SWAP)]
    Swap {
        /// The role: tissue, fluid, haptic, collision-worker, rendering, recorder, console or device.
        role: String,
        /// The engine's binary. To have the station's own engine again, name its file, which lies beside this program (/usr/lib/hystation/fluid of the package).
        binary: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Try an engine before a swap, or a driver before a session, in a private station, and say what is wrong with it.
    #[command(after_help = codes::CONFORMANCE)]
    Conformance {
        /// The role, as for `swap`; or driver.
        role: String,
        /// The engine's binary, or the driver's.
        binary: PathBuf,
        /// The scene of the private station. Default: the built-in one.
        #[arg(long, value_name = "FILE")]
        scene: Option<PathBuf>,
        /// The hand of the private station: script:polyp cuts, too.
        #[arg(long, default_value = "script:press")]
        hand: String,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Make the report of a recorded session, from the recording alone: raw values, scores, and what the station itself did.
    Report(ReportArgs),
    /// Do a recorded session again in the same engines: the same hand, the same forces, to the bit.
    Replay(ReplayArgs),
    /// The supervisor of a station; started by the guardian.
    #[command(hide = true)]
    Supervise {
        /// Station.
        #[arg(long)]
        station: String,
    },
    /// A stand-in for a guardian that died; started by the supervisor.
    #[command(hide = true)]
    StandIn {
        /// Station.
        #[arg(long)]
        station: String,
    },
    /// Compares a newcomer's states with the old engine's; started by the supervisor.
    #[command(hide = true)]
    Judge {
        /// Station.
        #[arg(long)]
        station: String,
        /// Role.
        #[arg(long)]
        role: String,
        /// The newcomer's incarnation.
        #[arg(long)]
        guest: u32,
        /// A rendering's predecessor drew pictures.
        #[arg(long)]
        draws: bool,
    },
    /// Notes what the newcomer of a recorder finds; started by the supervisor.
    #[command(hide = true)]
    Witness {
        /// Station.
        #[arg(long)]
        station: String,
    },
    /// Removes what dead processes left in the link; started by the supervisor.
    #[command(hide = true)]
    Clean {
        /// Station.
        #[arg(long)]
        station: String,
    },
}

impl Command {
    /// Whether a script reads what it says: JSON on stdout.
    pub fn is_json(&self) -> bool {
        match self {
            Command::Status { json }
            | Command::Check { json, .. }
            | Command::Doctor { json }
            | Command::Bench { json, .. }
            | Command::Swap { json, .. }
            | Command::Conformance { json, .. }
            | Command::Fault { command: FaultCommand::List { json } } => *json,
            Command::Fault { command: FaultCommand::Inject(args) } => args.json,
            Command::Fault { command: FaultCommand::Campaign(args) } => args.json,
            Command::Fault { command: FaultCommand::Compare(args) } => args.json,
            Command::Report(args) => args.json.as_deref() == Some(Path::new("-")), // else a file has it
            _ => false,
        }
    }
}

/// Arguments of `replay`.
#[derive(Clone, Debug, Args)]
pub struct ReplayArgs {
    /// The recording (MCAP), as `run --record` writes it.
    pub file: PathBuf,
    /// Compare every force and every state with what was recorded, to the bit, as fast as the machine manages; no pictures.
    #[arg(long)]
    pub verify: bool,
    /// Show it from this time on (2m): it begins at the checkpoint before, and hurries to it from there.
    #[arg(long = "from", value_name = "TIME", value_parser = seconds, conflicts_with = "verify")]
    pub from_s: Option<f64>,
    /// How many times as fast as it was, 0.01 to 100: 0.5 is half the speed. No faster than the machine manages.
    #[arg(long, value_name = "FACTOR", conflicts_with = "verify", value_parser = speed)]
    pub speed: Option<f64>,
    /// Another scene, or another case, than the recording has or names.
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Write a report of what the station itself did (JSON), as `run` does.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// As for `run`.
    #[command(flatten)]
    pub station: StationArgs,
}

/// Arguments of every command that starts a station.
#[derive(Clone, Debug, Default, Args)]
pub struct StationArgs {
    /// Open no window, even if there is a display.
    #[arg(long)]
    pub headless: bool,
    /// Write pictures (PNG, or one film with --set picture_format=mjpeg) into this folder.
    #[arg(long, value_name = "FOLDER")]
    pub pictures: Option<PathBuf>,
    /// Allow faults to be injected.
    #[arg(long)]
    pub test_mode: bool,
    /// Inject the faults of this file (TOML); needs --test-mode.
    #[arg(long, value_name = "FILE")]
    pub faults: Option<PathBuf>,
    /// Number of collision workers, 0 to 16. Default: 2.
    #[arg(long, value_name = "N")]
    pub workers: Option<usize>,
    /// A setting, such as seed=7 or trainee=Ana; may be given more than once. An unknown key lists the known ones.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Folder of the engines' binaries, for a station of another build. Default: that of this program.
    #[arg(long, value_name = "FOLDER")]
    pub binaries: Option<PathBuf>,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse::<f64>().ok().filter(|speed| (0.01..=100.0).contains(speed));
    speed.ok_or_else(|| format!("{text:?} is no speed between 0.01 and 100"))
}

/// Arguments of `report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArgs {
    /// The recording (MCAP), as `run --record` writes it.
    pub file: PathBuf,
    /// Write it as a page (HTML) that needs nothing beside it; where no file is named, beside the recording, by its name.
    #[arg(long, value_name = "FILE")]
    pub html: Option<Option<PathBuf>>,
    /// Write it for programs; `-` writes it to stdout, instead of the text.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the session over time, ten rows a second.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Compare with an earlier session, as a column; may be given up to 8 times.
    #[arg(long, value_name = "FILE")]
    pub compare: Vec<PathBuf>,
}

/// Arguments of `run`.
#[derive(Clone, Debug, Default, Args)]
pub struct RunArgs {
    /// Scene or case (.toml), mesh, or the name of a case that came with the programs (polyp). Default: the built-in scene.
    pub scene: Option<PathBuf>,
    /// Stop by itself this long after every process is ready: 30s, 2m, 500ms.
    #[arg(long = "for", value_name = "TIME", value_parser = seconds)]
    pub for_s: Option<f64>,
    /// Stop by itself when the session of the case is over; needs the operator's page, which judges that.
    #[arg(long, conflicts_with = "lockstep")]
    pub until_end: bool,
    /// Who moves the scope: mouse, gamepad, spacemouse, script:NAME, replay:FILE or idle. Default: the mouse where there is a window, else script:press;
    /// a case without a window has no default.
    #[arg(long)]
    pub hand: Option<String>,
    /// The driver of a haptic device, in the place of the simulated one (docs/driver.md).
    #[arg(long, value_name = "FILE", conflicts_with = "hand")]
    pub driver: Option<PathBuf>,
    /// Record the session (MCAP): into this file; or into a folder (ending in /, or there already), where the file is named by moment (UTC), scene or case,
    /// and trainee.
    #[arg(long, value_name = "PATH")]
    pub record: Option<PathBuf>,
    /// Write a report of what the station itself did (JSON) at the end.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Run on a virtual clock: the same forces to the bit, whatever dies; --for is virtual time.
    #[arg(long)]
    pub lockstep: bool,
    /// Only these roles, for tests of single engines.
    #[arg(long, hide = true, value_delimiter = ',')]
    pub roles: Option<Vec<String>>,
    /// No live table even on a terminal.
    #[arg(long, hide = true)]
    pub quiet: bool,
    /// Stop when the process of this id, which is to have started this one, has ended, however.
    #[arg(long, hide = true, value_name = "PID")]
    pub with_parent: Option<u32>,
    /// A folder for what it writes, made with the station and removed with it.
    #[arg(long, hide = true)]
    pub passing: Option<PathBuf>,
    /// What it shares with `replay`.
    #[command(flatten)]
    pub station: StationArgs,
    /// The recording of `hand` is done again, tick by tick.
    #[arg(skip)]
    pub again: Option<Again>,
}

/// Reads `30s`, `2m`, `500ms`, `1.5` as seconds.
pub fn seconds(text: &str) -> Result<f64, String> {
    let (number, factor) = match text {
        _ if text.ends_with("us") => (&text[..text.len() - 2], 1e-6),
        _ if text.ends_with("ms") => (&text[..text.len() - 2], 1e-3),
        _ if text.ends_with('s') => (&text[..text.len() - 1], 1.0),
        _ if text.ends_with('m') => (&text[..text.len() - 1], 60.0),
        _ if text.ends_with('h') => (&text[..text.len() - 1], 3600.0),
        _ => (text, 1.0),
    };
    let value = number.parse::<f64>().ok().map(|value| value * factor);
    value
        .filter(|value| (0.0..=86_400.0).contains(value))
        .ok_or_else(|| format!("{text:?} is no time between 0 and 24h; write 30s, 2m or 500ms"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_with_their_units_and_nonsense_is_refused() {
        assert_eq!([seconds("30s"), seconds("2m"), seconds("500ms"), seconds("1.5")], [Ok(30.0), Ok(120.0), Ok(0.5), Ok(1.5)]);
        for bad in ["", "s", "-1s", "nan", "25h", "1d", "ü"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn what_the_exit_codes_of_a_verdict_mean_stands_in_the_help() {
        for line in ["", "run", "swap", "conformance", "fault inject", "fault campaign", "fault compare"] {
            let words = format!("hystation {line} --help");
            let help = Cli::try_parse_from(words.split_whitespace()).unwrap_err().to_string();
            let help = help.split_whitespace().collect::<Vec<_>>().join(" "); // however it is wrapped
            assert!(["Exit codes: 0 ", "; 1 ", "; 2 ", "; 3 "].iter().all(|code| help.contains(code)), "{line}: {help}");
        }
    }

    #[test]
    fn the_command_line_of_the_design_is_accepted() {
        let line = "hystation --name a run scene.toml --headless --for 30s --hand script:press --record a.mcap --report r.json \
                    --lockstep --test-mode --faults f.toml --workers 3 --set isa=avx2 --set drift_ppm=3 --pictures out";
        let cli = Cli::try_parse_from(line.split_whitespace()).unwrap();
        let Command::Run(run) = cli.command else { panic!("not run") };
        assert_eq!((cli.name.as_str(), run.for_s, run.station.workers, run.station.set.len()), ("a", Some(30.0), Some(3), 2));
        for line in [
            "hystation status --json --name b",
            "hystation swap tissue ./x",
            "hystation fault inject stop haptic:active --for 2s",
            "hystation fault inject corrupt tissue:active --where stream --bytes 64 --seed 3",
            "hystation fault inject leak-memory fluid:both --rate 16 --for 500ms",
            "hystation fault inject crash-loop recorder --times 2",
            "hystation fault campaign kills.toml --seed 3 --report out --batch 50",
            "hystation fault campaign kills.toml --report out --show 17 --json",
            "hystation fault compare before after --file old.toml --file new.toml --json",
            "hystation check polyp --set seed=7 --json",
            "hystation bench station --json",
            "hystation report a.mcap --html",
            "hystation report a.mcap --html a.html --json - --csv a.csv --compare b.mcap --compare c.mcap",
            "hystation logs haptic:0 -f",
        ] {
            assert!(Cli::try_parse_from(line.split_whitespace()).is_ok(), "{line}");
        }
    }
}
