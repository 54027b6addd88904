//! Whether there is room in shared memory for one more process. One that starts without it dies where it touches what there is not, and so does everybody who
//! connects to it meanwhile: a full /dev/shm and one death cost a fluid, its spare, both workers and the pictures.

use hyst_exchange::{Station, system};
use hyst_messages::Role;

const MIB: u64 = 1 << 20;

/// There is too little.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("/dev/shm has {} MiB free, and it takes {}; look at `df /dev/shm`", free >> 20, needed >> 20)]
pub struct NoRoom {
    free: u64,
    needed: u64,
}

/// What a process of a role takes from its start on, bytes, in the default scene (`ls -ls /dev/shm`, 2026-11-29: 157, 38, 6 and 3 MiB): all of its segments. Who has
/// pages alone needs next to nothing.
const fn taken_bytes(role: Role) -> u64 {
    match role {
        Role::Tissue => 160 * MIB,
        Role::Fluid => 40 * MIB,
        Role::Rendering => 8 * MIB,
        Role::CollisionWorker => 4 * MIB,
        _ => MIB,
    }
}

fn judge(role: Role, free: u64) -> Result<(), NoRoom> {
    let needed = taken_bytes(role);
    if free < needed { Err(NoRoom { free, needed }) } else { Ok(()) }
}

/// Looks for room for a process of a role; a system that does not say how much there is has enough.
pub(super) fn look(station: &Station, role: Role) -> Result<(), NoRoom> {
    system::free_bytes(station.root()).map_or(Ok(()), |free| judge(role, free))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_more_than_there_is_does_not_start_and_all_of_a_station_have_room_in_what_it_asks_for() {
        let said = judge(Role::Tissue, 100 * MIB).unwrap_err().to_string();
        assert_eq!(said, "/dev/shm has 100 MiB free, and it takes 160; look at `df /dev/shm`");
        assert_eq!([Role::Fluid, Role::Haptic].map(|role| judge(role, 100 * MIB)), [Ok(()); 2]);
        assert!(judge(Role::Device, 0).is_err());
        let all: u64 = Role::ALL.into_iter().map(|role| 2 * taken_bytes(role)).sum();
        assert!(all + taken_bytes(Role::Tissue) <= crate::guardian::NEEDED_BYTES, "{all}");
    }
}
