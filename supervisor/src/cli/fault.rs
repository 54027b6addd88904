//! The arguments of `fault`: one fault by hand, or many by a campaign.

use super::{codes, seconds};
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Faults on purpose.
#[derive(Debug, Subcommand)]
pub enum FaultCommand {
    /// The kinds of faults.
    List {
        /// As JSON: kinds with whom they can be done to and their options, places and states.
        #[arg(long)]
        json: bool,
    },
    /// Inject a fault.
    #[command(after_help = codes::INJECT)]
    Inject(Box<InjectArgs>),
    /// Many faults by a plan drawn from a file and a seed, in stations of its own, with a verdict.
    #[command(after_help = codes::CAMPAIGN)]
    Campaign(CampaignArgs),
}

/// Arguments of `fault inject`.
#[derive(Clone, Debug, Args)]
pub struct InjectArgs {
    /// Kind, see `fault list`.
    pub kind: String,
    /// PROCESS, PROCESS:active, :spare, :both, :newcomer (of a swap) or :INDEX; supervisor, guardian or supervisor+guardian.
    pub target: String,
    /// After this time a stopped process is continued, or ends what it was asked to do.
    #[arg(long = "for", value_parser = seconds)]
    pub for_s: Option<f64>,
    /// Not now, but at this tick of the station: a number, or +N for N ticks from now. At most an hour ahead.
    #[arg(long, group = "moment")]
    pub tick: Option<String>,
    /// With --tick or --state: so many µs after the tick has begun, 0 to 999; with --state, 40 ticks after the station came into it.
    #[arg(long = "phase", requires = "moment", value_parser = clap::value_parser!(u32).range(0..1_000))]
    pub phase_us: Option<u32>,
    /// Not now, but when the station is in this state: idle, contact, cutting, recovery (somebody died and is not back), swap, or swap:ROLE.
    #[arg(long, group = "moment")]
    pub state: Option<String>,
    /// With --state: it is waited for so long at most. Default: 1m.
    #[arg(long = "within", requires = "state", value_parser = seconds)]
    pub within_s: Option<f64>,
    /// slow: a step takes so many times as long, 1 to 100.
    #[arg(long)]
    pub factor: Option<f64>,
    /// slow: and so much longer: 500us, 2ms.
    #[arg(long = "extra", value_parser = seconds)]
    pub extra_s: Option<f64>,
    /// slow: what is added varies by this share of it, 0 to 1.
    #[arg(long)]
    pub jitter: Option<f64>,
    /// leak-memory: MiB per second; leak-files: files per second.
    #[arg(long)]
    pub rate: Option<f64>,
    /// crash-loop: how many successors die, 1 to 20.
    #[arg(long)]
    pub times: Option<u32>,
    /// nan, frozen and the like: by which of its outputs alone: state, cell (of its page), topology, job, force or appearance. Default: all that its steps publish.
    #[arg(long)]
    pub output: Option<String>,
    /// block: not the thread of its steps, but usher (who meets newcomers), drain (of a servo), keeper (of checkpoints) or clerk (of a tissue).
    #[arg(long)]
    pub thread: Option<String>,
    /// corrupt: page, stream, link, checkpoint, station or roster.
    #[arg(long = "where")]
    pub place: Option<String>,
    /// corrupt: how many bytes.
    #[arg(long)]
    pub bytes: Option<u32>,
    /// corrupt: what they are drawn from. Default: another number each time, which the events say.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Whom it hit, and when, as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `fault campaign`.
#[derive(Clone, Debug, Args)]
pub struct CampaignArgs {
    /// The campaign (TOML); examples are in assets/campaigns.
    pub file: PathBuf,
    /// Seed of the plan, instead of the file's.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Folder of the results: results.jsonl, report.json, report.txt, junit.xml, report.html. The same folder again goes on where it ended. Without it they
    /// are in a folder that is removed at the end, unless the exit code is other than 0.
    #[arg(long)]
    pub report: Option<PathBuf>,
    /// Print the plan, and do nothing else.
    #[arg(long)]
    pub plan: bool,
    /// Repeat this one fault of the plan, at the same tick and phase; one in a swap so long after the same stage of it.
    #[arg(long, conflicts_with_all = ["plan", "batch"])]
    pub only: Option<usize>,
    /// At most so many faults in this run; the next run with the same folder goes on.
    #[arg(long, requires = "report")]
    pub batch: Option<usize>,
    /// On stdout nothing but JSON: the report; with --plan the plan, with --only what came of that fault.
    #[arg(long)]
    pub json: bool,
}
