//! Promise of the process: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;

#[test]
fn bad_arguments_of_the_engine_are_refused() {
    cli::engine(env!("CARGO_BIN_EXE_tissue"), "tissue:0", "tissue");
}

#[test]
fn bad_arguments_of_the_benchmark_are_refused() {
    let binary = env!("CARGO_BIN_EXE_tissue");
    for words in [&["bench"][..], &["bench", "none"], &["bench", "contact", "--fast"], &["bench", "contact", "more"]] {
        cli::refused(binary, words, "expected tissue|contact");
    }
    cli::refused(binary, &["bench", "tissue", "--mesh"], "--mesh without a file");
    cli::refused(binary, &["bench", "tissue", "--mesh", "/no/such/file.msh", "--json"], "/no/such/file.msh");
}
