//! The `collision-worker` process: one share of the intersection test each tick, a member of the Meeting Point. See [`worker`].

mod worker;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::CollisionWorker, worker::run)
}
