//! `hystation fault list`: the kinds, to whom each can be done, what it does and for how long, and what else can be said of a fault.

use crate::campaign::cell::State;
use crate::faultfile::{FaultKind, Helper, Output, Place};
use hyst_messages::Role;
use serde_json::{Value, json};

/// Most characters of a line.
const MOST_COLUMNS: usize = 120;

/// Why those who keep the station take so few.
const KEEPERS: &str = "Supervisor and guardian take what is done from outside: a signal, or a limit that is lowered (no-files and oom, there with --for; \
                       oom: it is lowered, and nobody asks them to take more). All else an engine does because it is asked to, in its steps or beside \
                       them; they make none, and are not asked.";

/// For people.
pub(super) fn text() -> String {
    let kinds = FaultKind::ALL.map(|(kind, name, _)| (name, kind.targets(), kind.told()));
    let width = kinds.iter().map(|(_, targets, _)| targets.len()).max().unwrap_or(0);
    let line = |name: &str, targets: &str, told: &str| row(&format!("{name:<11} {targets:<width$}  "), told);
    let mut text = line("kind", "of", "what it does, and for how long");
    text.extend(kinds.iter().map(|(name, targets, told)| line(name, targets, told)));
    text.push('\n');
    text.extend(foot().iter().map(|(name, said)| row(&format!("{name:<11} "), said)));
    text + "\n" + &row("", KEEPERS)
}

/// For programs.
pub(super) fn json() -> Value {
    json!({
        "kinds": FaultKind::described(),
        "places": names(&Place::ALL),
        "outputs": names(&Output::ALL),
        "threads": names(&Helper::ALL),
        "states": names(&State::ALL),
    })
}

fn names<T>(all: &[(T, &'static str)]) -> Vec<&'static str> {
    all.iter().map(|(_, name)| *name).collect()
}

/// What stands below the kinds, by its name: who `all` are, how they are named, and what can be given with a fault.
fn foot() -> [(&'static str, String); 7] {
    let engines: Vec<&str> = Role::ALL.into_iter().filter(|role| role.is_engine()).map(Role::name).collect();
    let replicated = Role::REPLICATED.map(Role::name).join(", ");
    let lies: Vec<&str> = FaultKind::ALL.iter().filter(|(kind, _, _)| kind.is_lie()).map(|(_, name, _)| *name).collect();
    let mut options: Vec<String> = Vec::new();
    for option in FaultKind::ALL.iter().flat_map(|(kind, _, _)| kind.options()) {
        let option = format!("--{option}");
        if !options.contains(&option) {
            options.push(option);
        }
    }
    let all =
        format!("{}; supervisor and guardian where they are named, never hardware (the device on the desk)", engines.join(", "));
    let targets = format!(
        "ROLE or ROLE:active (who has its work), ROLE:INDEX, ROLE:newcomer (of a swap); of {replicated} :spare, :both; \
         supervisor+guardian"
    );
    [
        ("all", all),
        ("targets", targets),
        ("options", format!("{}; `fault inject --help` says more", options.join(" "))),
        ("outputs", format!("{} (--output, of {})", names(&Output::ALL).join(", "), lies.join(", "))),
        ("threads", format!("{} (--thread, of block)", names(&Helper::ALL).join(", "))),
        ("places", format!("{} (--where, of corrupt)", names(&Place::ALL).join(", "))),
        (
            "states",
            format!("{}, swap:ROLE, handover:ROLE (--state: as soon as the station is in it)", names(&State::ALL).join(", ")),
        ),
    ]
}

/// A text beside what stands before it, in lines of [`MOST_COLUMNS`] at most.
fn row(head: &str, text: &str) -> String {
    let indent = head.chars().count();
    let (mut row, mut column) = (head.to_string(), indent);
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if column > indent && column + 1 + length > MOST_COLUMNS {
            row.push('\n');
            row.push_str(&" ".repeat(indent));
            column = indent;
        }
        if column > indent {
            row.push(' ');
            column += 1;
        }
        row += word;
        column += length;
    }
    row + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::draw::GAP_TICKS;
    use crate::cli::Cli;
    use crate::faultfile::{DEFAULT_BYTES, DEFAULT_TIMES, default_rate};
    use clap::Parser;

    /// The text with one blank between two words, so that a break is none.
    fn flowing() -> String {
        text().split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Whom "all" leaves out, and what can be given with a fault, one read in the code.
    #[test]
    fn people_are_told_who_all_are_how_they_are_named_and_what_can_be_given_with_a_fault() {
        let (lines, said) = (text(), flowing());
        let long = lines.lines().find(|line| line.chars().count() > MOST_COLUMNS);
        assert_eq!(long, None);
        let of = |name: &str| lines.lines().find(|line| line.starts_with(&format!("{name} "))).unwrap_or_default();
        assert!(of("shm-full").contains(" all "), "{lines}");
        assert!(of("all").contains("device, haptic, tissue, fluid"), "{lines}");
        assert!(said.contains("supervisor and guardian where they are named, never hardware"), "{said}");
        for form in ["ROLE:active", "ROLE:INDEX", "ROLE:newcomer", ":spare", ":both", "supervisor+guardian"] {
            assert!(said.contains(form), "{form}: {said}");
        }
        for (row, listed) in [
            ("outputs", names(&Output::ALL)),
            ("threads", names(&Helper::ALL)),
            ("places", names(&Place::ALL)),
            ("states", names(&State::ALL)),
        ] {
            assert!(of(row).contains(&listed.join(", ")), "{row}: {lines}");
        }
        for (kind, _, _) in FaultKind::ALL {
            assert!(kind.options().iter().all(|option| said.contains(&format!("--{option}"))), "{}", kind.name());
        }
    }

    /// Only `stop` and what needs a time said so.
    #[test]
    fn it_is_said_of_each_kind_how_long_it_lasts_where_nobody_says_so() {
        let said = flowing();
        for (kind, name, _) in FaultKind::ALL {
            let told = kind.told();
            assert!(said.contains(&told), "{name}: {told}");
            let options = kind.options();
            assert_eq!(told.ends_with("(once)"), !options.contains(&"for"), "{told}");
            assert_eq!(told.ends_with("(needs --for)"), kind.needs_duration(), "{told}");
        }
        for (kind, words) in [
            (FaultKind::Stop, "(without --for until replaced or undone)"),
            (FaultKind::Frozen, "(without --for until replaced or undone)"),
            (FaultKind::Doom, "(without --for until undone)"),
            (FaultKind::CrashLoop, "(without --for until so many have died)"),
        ] {
            assert!(kind.told().ends_with(words), "{}", kind.told());
        }
    }

    #[test]
    fn the_help_of_inject_says_what_stands_for_what_is_left_out() {
        let help = Cli::try_parse_from(["hystation", "fault", "inject", "--help"]).unwrap_err().to_string();
        let help = help.split_whitespace().collect::<Vec<_>>().join(" "); // however it is wrapped
        let [memory, files] = [FaultKind::LeakMemory, FaultKind::LeakFiles].map(default_rate);
        for words in [
            "Default: until the process is replaced, or the fault undone".to_string(),
            format!("MiB per second. Default: {memory}. leak-files: files per second. Default: {files}"),
            format!("how many successors die, 1 to 20. Default: {DEFAULT_TIMES}"),
            format!("how many bytes flip. Default: {DEFAULT_BYTES}"),
            format!("the tick, {} to {} ticks from now", GAP_TICKS[0], GAP_TICKS[1]),
        ] {
            assert!(help.contains(&words), "{words}: {help}");
        }
    }

    #[test]
    fn a_text_goes_on_below_its_beginning_and_no_line_is_too_long() {
        assert_eq!(row("a  ", "b c"), "a  b c\n");
        let (long, word) = (row("a  ", &"word ".repeat(30)), "x".repeat(2 * MOST_COLUMNS));
        let lines: Vec<&str> = long.lines().collect();
        assert!(
            lines.len() == 2 && lines[1].starts_with("   word word") && lines.iter().all(|line| line.len() <= MOST_COLUMNS),
            "{long}"
        );
        assert_eq!(row("", &word), word + "\n", "one that does not fit is not broken");
    }

    #[test]
    fn programs_are_told_whom_each_kind_can_be_done_to_and_what_it_takes() {
        let listed = json();
        let kind = |name: &str| listed["kinds"].as_array().unwrap().iter().find(|kind| kind["name"] == name).cloned().unwrap();
        assert_eq!(kind("disk-full")["targets"], json!(["recorder"]));
        assert_eq!(
            (&kind("slow")["options"], &kind("slow")["needs_for"]),
            (&json!(["for", "factor", "extra", "jitter"]), &json!(true))
        );
        assert_eq!(kind("corrupt")["options"], json!(["where", "bytes", "seed"]));
        assert_eq!((&kind("nan")["options"], &kind("nan")["text"]), (&json!(["for", "output"]), &json!(FaultKind::Nan.told())));
        assert!(
            kind("kill")["targets"]
                .as_array()
                .is_some_and(|all| all.contains(&json!("guardian")) && all.contains(&json!("device")))
        );
        assert_eq!(listed["states"], json!(["any", "idle", "contact", "cutting", "recovery", "swap", "handover"]));
        assert_eq!((&listed["places"][0], &listed["outputs"][0]), (&json!("page"), &json!("state")));
        assert_eq!(listed["threads"], json!(["usher", "drain", "keeper", "clerk"]));
    }
}
