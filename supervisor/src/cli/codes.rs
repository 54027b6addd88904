//! What the exit codes mean, as the end of a command's `--help` says it.

/// Of this program.
pub const ALL: &str = "Exit codes: 0 good; 1 failed, or a promise broken; 2 bad arguments or input, and nothing was done; 3 finished or interrupted, and \
                       something was lost or is not known.";
/// Of `run`.
pub const RUN: &str = "Exit codes: 0 good; 1 it failed, or a promise was broken beyond doubt: by a single fault, whoever did it (a hand that had no force for \
                       longer than that fault may cost, a step of the force, a wrong force, nobody back in time), or by all of them together, and \
                       the last lines say by which; 2 bad arguments or input, and nothing was done; 3 finished or interrupted, and data or a \
                       process was lost.";
/// Of `swap`.
pub const SWAP: &str = "Exit codes: 0 the new engine has the role; 1 it was rolled back, or how it ended is not known; 2 it was refused, and nothing was \
                        disturbed; 3 this command was interrupted, and a swap that it has begun goes on.";
/// Of `conformance`.
pub const CONFORMANCE: &str = "Exit codes: 0 it conforms; 1 it does not; 2 it is no engine of that role, or there can be no such station; 3 this machine \
                               gave it no time to show what it is, or no station to show it in, or it was interrupted.";
/// Of `fault inject`.
pub const INJECT: &str = "Exit codes: 0 it was done; 1 it was done by half, nobody knows whether it was done, or the state did not come; 2 it was refused, \
                          and nobody is hurt; 3 it was interrupted, and has ended before its time.";
/// Of `fault campaign`.
pub const CAMPAIGN: &str = "Exit codes: 0 every promise held, or the batch is through and the plan is not; 1 a promise was broken; 2 a campaign that cannot \
                            be, or nothing to show; 3 of some promises nothing can be said, or the run stopped before its batch was through.";
/// Of `fault compare`.
pub const COMPARE: &str = "Exit codes: 0 nothing is worse beyond doubt; 1 something is; 2 one of the two cannot be read; 3 nothing can be compared: they have no \
                           pool and no cell in common of which faults have a verdict in both.";
