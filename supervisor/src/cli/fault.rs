//! The arguments of `fault`: one fault by hand, many by a campaign, or two campaigns beside each other.

use super::{codes, seconds};
use crate::moment::MOST_PHASE_US;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Faults on purpose.
#[derive(Debug, Subcommand)]
pub enum FaultCommand {
    /// List the kinds of faults, to whom each can be done, for how long, and what can be given with it.
    List {
        /// As JSON, with the options of each kind, and with places, outputs, threads and states.
        #[arg(long)]
        json: bool,
    },
    /// Do one fault, now or at a moment.
    #[command(after_help = codes::INJECT)]
    Inject(Box<InjectArgs>),
    /// Do many faults, by a plan drawn from a file and a seed, in stations of its own, and judge them.
    #[command(after_help = codes::CAMPAIGN)]
    Campaign(CampaignArgs),
    /// Compare the results of two campaigns: what each fault cost before and after a change. Nothing is started, and nothing is written.
    #[command(after_help = codes::COMPARE)]
    Compare(CompareArgs),
}

/// Arguments of `fault inject`.
#[derive(Clone, Debug, Args)]
pub struct InjectArgs {
    /// The kind; `fault list` has them all.
    pub kind: String,
    /// Who is hit: PROCESS, PROCESS:active, :spare, :both, :newcomer (of a swap) or :INDEX; supervisor, guardian or supervisor+guardian.
    pub target: String,
    /// How long it lasts: after that a stopped process is continued, and any other ends what it was asked to do. Default: until the process is replaced, or
    /// the fault undone by `fault inject undo`; `fault list` says it of each kind. slow, no-files, disk-full and shm-full need it; a kind that is done at once
    /// takes none.
    #[arg(long = "for", value_name = "TIME", value_parser = seconds)]
    pub for_s: Option<f64>,
    /// Do it at this tick of the station: a number, or +N for N ticks from now. At most an hour ahead. Default: now, or drawn from --seed.
    #[arg(long, group = "moment")]
    pub tick: Option<String>,
    /// With --tick or --state: this many µs after the tick has begun, 0 to 999; with --state, of the 40th tick after the station came into it. Default: drawn
    /// from --seed; without a seed 0, and with --state at once.
    #[arg(long = "phase", value_name = "US", requires = "moment")]
    #[arg(value_parser = clap::value_parser!(u32).range(0..=i64::from(MOST_PHASE_US)))]
    pub phase_us: Option<u32>,
    /// Do it when the station is in this state: idle, contact, cutting, recovery (somebody died and is not back), swap, or handover (who does a role's work is
    /// to be replaced, or was, and is not back); of one role alone: swap:ROLE, handover:ROLE.
    #[arg(long, group = "moment")]
    pub state: Option<String>,
    /// With --state: wait for it at most this long. Default: 1m.
    #[arg(long = "within", value_name = "TIME", requires = "state", value_parser = seconds)]
    pub within_s: Option<f64>,
    /// slow: each step takes this many times as long, 1 to 100; one of this and --extra is needed. Default: 1.
    #[arg(long)]
    pub factor: Option<f64>,
    /// slow: each step takes this much longer (500us, 2ms), on top of --factor. Default: 0.
    #[arg(long = "extra", value_name = "TIME", value_parser = seconds)]
    pub extra_s: Option<f64>,
    /// slow: the time that is added varies by this share of it, up and down, 0 to 1. Default: 0.
    #[arg(long)]
    pub jitter: Option<f64>,
    /// leak-memory: MiB per second. Default: 32. leak-files: files per second. Default: 60.
    #[arg(long)]
    pub rate: Option<f64>,
    /// crash-loop: how many successors die, 1 to 20. Default: 3.
    #[arg(long)]
    pub times: Option<u32>,
    /// nan, frozen and other lies: only in this output: state, cell (of its page), topology, job, force or appearance. Default: all that its steps publish.
    #[arg(long)]
    pub output: Option<String>,
    /// block: a thread that helps it: usher (meets newcomers), drain (of a servo), keeper (of checkpoints) or clerk (of a tissue). Default: that of its steps.
    #[arg(long)]
    pub thread: Option<String>,
    /// corrupt: where bytes flip: page, stream, link, checkpoint, station or roster.
    #[arg(long = "where", value_name = "PLACE")]
    pub place: Option<String>,
    /// corrupt: how many bytes flip. Default: 16.
    #[arg(long)]
    pub bytes: Option<u32>,
    /// Draw from it what is left open of the moment: the phase, and without --tick and --state the tick, 600 to 1400 ticks from now, as in a campaign without
    /// gap_ticks. What was drawn is printed, to be repeated with --tick and --phase. corrupt: its bytes are drawn from it, and not the moment. Default: nothing
    /// of the moment is drawn, and the bytes are drawn from another seed each time, which the events name.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Say whom it hit, and when, as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `fault campaign`.
#[derive(Clone, Debug, Args)]
pub struct CampaignArgs {
    /// The campaign (TOML); examples are in assets/campaigns.
    pub file: PathBuf,
    /// Seed of the plan. Default: the file's.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Folder of the results: report.html, report.txt, report.json, junit.xml, the plan, and a line for each fault and station. With the same folder the
    /// campaign goes on where it ended. Default: a folder that is removed at the end if the exit code is 0.
    #[arg(long, value_name = "FOLDER")]
    pub report: Option<PathBuf>,
    /// Print the plan, and do nothing else.
    #[arg(long)]
    pub plan: bool,
    /// Repeat this one fault of the plan, at the same tick and phase; one in a swap, as long after the same stage of it.
    #[arg(long, value_name = "N", conflicts_with_all = ["plan", "batch"])]
    pub only: Option<usize>,
    /// Show what the results have of this one fault of the plan, and do nothing else: as it was drawn and as it came, who found it, its window beside its
    /// control, and what it comes to by itself.
    #[arg(long, value_name = "N", requires = "report", conflicts_with_all = ["plan", "only", "batch"])]
    pub show: Option<usize>,
    /// Do this many faults at most; the next run with the same folder goes on. 0 only judges what there is.
    #[arg(long, value_name = "N", requires = "report")]
    pub batch: Option<usize>,
    /// Print nothing but JSON on stdout: the report; with --plan the plan, with --only what came of that fault, with --show what the results have of it.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `fault compare`.
#[derive(Clone, Debug, Args)]
pub struct CompareArgs {
    /// The results of the first campaign, as its --report named them.
    #[arg(value_name = "FOLDER")]
    pub first: PathBuf,
    /// Those of the second, of which it is said whether they are worse or better than the first.
    #[arg(value_name = "FOLDER")]
    pub second: PathBuf,
    /// The campaign's file, as it was then, of results that have no copy of it beside them; one of each folder may be given. Default: the copy.
    #[arg(long, value_name = "FILE")]
    pub file: Vec<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}
