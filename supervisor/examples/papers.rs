//! Writes the manual pages and the shells' completions of `hystation` into a folder, from the command line as it is parsed: `papers FOLDER`.

use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate_to};
use std::path::PathBuf;
use std::process::ExitCode;

fn write(folder: &PathBuf) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let command = hystation::cli::Cli::command;
    clap_mangen::generate_to(command().disable_help_subcommand(true), folder)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        generate_to(shell, &mut offered(&command()), "hystation", folder)?;
    }
    Ok(())
}

/// A command with what its help names. What that hides is the station's own, and the shells would offer it.
fn offered(command: &Command) -> Command {
    let arguments = command.get_arguments().filter(|argument| !argument.is_hide_set()).cloned();
    let inner = command.get_subcommands().filter(|inner| !inner.is_hide_set()).map(offered);
    let mut shown = Command::new(lasting(command.get_name())).args(arguments).subcommands(inner);
    if let Some(about) = command.get_about() {
        shown = shown.about(about.clone());
    }
    if let Some(version) = command.get_version() {
        shown = shown.version(lasting(version));
    }
    shown
}

/// A text that lasts as long as this program, which is how long a command wants it.
fn lasting(text: &str) -> &'static str {
    text.to_string().leak()
}

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: papers FOLDER");
        return ExitCode::from(2);
    };
    match write(&folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{}: {error}", folder.display());
            ExitCode::FAILURE
        }
    }
}
