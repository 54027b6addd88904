//! Whether there is room in shared memory for one more process. One that starts without it dies where it touches what there is not, and so does everybody who
//! connects to it meanwhile: a full /dev/shm and one death cost a fluid, its spare, both workers and the pictures.

use crate::guardian::more_bytes_of_tissue;
use hyst_exchange::{Station, system};
use hyst_messages::Role;

const MIB: u64 = 1 << 20;
/// Less than this is as good as nothing, bytes: the largest file that a process reserves as a whole does not fit any more, a tissue's checkpoints (six of 1.02 MB
/// in the default scene).
pub const LEAST_FREE: u64 = 8 * MIB;

/// There is too little.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("/dev/shm has {} MiB free, and it takes {}; look at `df /dev/shm`", free >> 20, needed >> 20)]
pub struct NoRoom {
    free: u64,
    needed: u64,
}

/// What a process of a role takes from its start on, bytes: all of its segments and its page. In the default scene 157, 38, 6 and 3 MiB, and 1.6 MiB of a device
/// (`ls -ls /dev/shm`, 2026-11-29).
fn taken_bytes(role: Role, state_bytes: u64) -> u64 {
    match role {
        Role::Tissue => 160 * MIB + more_bytes_of_tissue(state_bytes),
        Role::Fluid => 40 * MIB,
        Role::Rendering => 8 * MIB,
        Role::CollisionWorker => 4 * MIB,
        _ => 2 * MIB,
    }
}

fn judge(role: Role, state_bytes: u64, free: u64) -> Result<(), NoRoom> {
    let needed = taken_bytes(role, state_bytes);
    if free < needed { Err(NoRoom { free, needed }) } else { Ok(()) }
}

/// Looks for room for a process of a role, where a state of the tissue has so many bytes of nodes and surface. A system that does not say how much there is has
/// enough. Several that start at once are each looked at alone: who then has none after all ends, and is started again.
pub(super) fn look(station: &Station, role: Role, state_bytes: u64) -> Result<(), NoRoom> {
    system::free_bytes(station.root()).map_or(Ok(()), |free| judge(role, state_bytes, free))
}

/// Whether so little is left for everybody that who lives may die of it. A system that does not say how much there is has enough.
pub fn is_full(station: &Station) -> bool {
    system::free_bytes(station.root()).is_ok_and(|free| free < LEAST_FREE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_more_than_there_is_does_not_start_and_all_of_a_station_have_room_in_what_it_asks_for() {
        let said = judge(Role::Tissue, 0, 100 * MIB).unwrap_err().to_string();
        assert_eq!(said, "/dev/shm has 100 MiB free, and it takes 160; look at `df /dev/shm`");
        assert_eq!([Role::Fluid, Role::Haptic].map(|role| judge(role, 0, 100 * MIB)), [Ok(()); 2]);
        assert!(judge(Role::Device, 0, 0).is_err());
        for state_bytes in [0, 41_000, 141_000] {
            let pairs = [Role::Tissue, Role::Fluid, Role::CollisionWorker, Role::Haptic];
            let single = [Role::Tissue, Role::Device, Role::Hardware, Role::Rendering, Role::Recorder, Role::Console];
            let of = |roles: &[Role]| roles.iter().map(|role| taken_bytes(*role, state_bytes)).sum::<u64>();
            let all = 2 * of(&pairs) + of(&single);
            assert!(all <= crate::guardian::needed_bytes(state_bytes), "{all}, of which one tissue follows another");
        }
        assert_eq!(judge(Role::Tissue, 141_000, 300 * MIB).unwrap_err().needed, 160 * MIB + 100_000 * 5_000 / 3);
    }
}
