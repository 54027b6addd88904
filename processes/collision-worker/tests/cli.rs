//! Promise of the process: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;

#[test]
fn bad_arguments_are_refused() {
    cli::engine(env!("CARGO_BIN_EXE_collision-worker"), "collision-worker:0", "collision-worker");
}
