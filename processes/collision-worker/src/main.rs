//! The `collision-worker` process: one share of the intersection test each tick.

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::CollisionWorker, collision_worker::run)
}
