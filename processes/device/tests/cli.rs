//! Promise of the processes: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;

#[test]
fn bad_arguments_of_the_device_are_refused() {
    cli::engine(env!("CARGO_BIN_EXE_device"), "device", "device");
}

#[test]
fn bad_arguments_of_the_hardware_are_refused() {
    cli::engine(env!("CARGO_BIN_EXE_hardware"), "hardware", "hardware");
}
