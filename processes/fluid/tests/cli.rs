//! Promise of the process: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;

#[test]
fn bad_arguments_of_the_engine_are_refused() {
    cli::engine(env!("CARGO_BIN_EXE_fluid"), "fluid:0", "fluid");
}

#[test]
fn bad_arguments_of_the_benchmark_are_refused() {
    let binary = env!("CARGO_BIN_EXE_fluid");
    for words in [&["bench"][..], &["bench", "none"], &["bench", "flow", "--fast"], &["bench", "flow", "more"]] {
        cli::refused(binary, words, "expected flow");
    }
    cli::refused(binary, &["bench", "flow", "--mesh", "x.msh"], "--mesh");
}
