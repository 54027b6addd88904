//! The clerk: an ordinary thread that sends the topology on change and to every newcomer, and answers those who ask for the objects'
//! appearance by rendezvous. The Main Loop never waits for either.

use crate::site::MAX_OBJECTS;
use crate::world::World;
use crossbeam::queue::ArrayQueue;
use hyst_engine::{Failure, Helper, Liar, Life};
use hyst_exchange::rendezvous::Server;
use hyst_exchange::{Links, Publisher, Rounds, system};
use hyst_messages::mischief::{Outlet, Thread};
use hyst_messages::stream::{AppearanceRecord, ObjectKind, ObjectRecord, message_bytes};
use hyst_messages::{Kind, MessageMut, Role, StreamHeader};
use hyst_scene::Look;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// How often newcomers are looked for, requests answered and changes sent, ns.
const INTERVAL_NS: u64 = 2_000_000;
/// Worlds that wait to be sent; of more the oldest is left out, because only the newest counts.
const WAITING: usize = 4;

/// Sections of a topology: objects, tets, owner of each tet, triangles, surface vertices at rest, wall triangles, 1 for each surface vertex on a wound,
/// nodes at rest; of the instrument, where it has surfaces from files, the vertices of the shaft's and then of the jaw's, their triangles, and how many
/// vertices and triangles are the shaft's.
pub const SECTIONS: usize = 11;

/// Worlds on their way between the Main Loop, which makes them, and the clerk.
///
/// They are freed by the Main Loop: an ordinary thread that frees one takes the lock of the memory that the Main Loop asks for its next one, and on full
/// cores may not be let run with it.
#[derive(Clone)]
struct Worlds {
    told: Arc<ArrayQueue<Arc<World>>>,
    sent: Arc<ArrayQueue<Arc<World>>>,
}

impl Worlds {
    fn new() -> Worlds {
        let queue = || Arc::new(ArrayQueue::new(WAITING));
        Worlds { told: queue(), sent: queue() }
    }

    /// The Main Loop's: hands over a world, in the place of the oldest where too many wait.
    fn tell(&self, world: &Arc<World>) {
        self.told.force_push(Arc::clone(world));
    }

    /// The Main Loop's: frees the worlds that have come back.
    fn free(&self) {
        std::iter::from_fn(|| self.sent.pop()).take(WAITING).for_each(drop);
    }

    /// The clerk's: goes on to the newest world that was handed over, and gives back those before it; false if there is none.
    fn take(&self, present: &mut Arc<World>) -> bool {
        let mut is_other = false;
        for newer in std::iter::from_fn(|| self.told.pop()).take(WAITING) {
            // Where the Main Loop has fetched none for so long that there is no place for more, it is freed here.
            let _ = self.sent.push(std::mem::replace(present, newer));
            is_other = true;
        }
        is_other
    }
}

/// Ends the clerk's thread when dropped.
pub struct Clerk {
    worlds: Worlds,
    stop: Arc<AtomicBool>,
    rounds: Rounds,
    handle: Option<std::thread::JoinHandle<()>>,
}

impl Drop for Clerk {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(handle) = self.handle.take() {
            let _ = handle.join(); // it has nothing to say at its end
        }
    }
}

/// The answer to whoever asks how the scene looks: the scope, then each object as the scene or else its kind says.
fn answer(world: &World) -> Vec<u8> {
    let look = |object: &ObjectRecord| {
        let origin = world.body.origin.get(object.id as usize)?;
        world.case.looks.get(*origin as usize).copied().flatten()
    };
    let objects = appearance(&world.objects, world.version, look);
    [bytemuck::bytes_of(&world.case.scope), bytemuck::cast_slice(&objects)].concat()
}

fn appearance(
    objects: &[ObjectRecord],
    topology_version: u32,
    look: impl Fn(&ObjectRecord) -> Option<Look>,
) -> Vec<AppearanceRecord> {
    let one = |object: &ObjectRecord| {
        let (kind, colour, roughness) = match object.kind {
            kind if kind == ObjectKind::Pathology as u32 || kind == ObjectKind::FreePiece as u32 => (1, [0.76, 0.33, 0.28], 0.25),
            kind if kind == ObjectKind::Tool as u32 => (3, [0.70, 0.71, 0.73], 0.25),
            _ => (0, [0.78, 0.34, 0.285], 0.30),
        };
        let look = look(object);
        let material = if kind == 1 && look.is_some_and(|look| look.myoma) { 2 } else { kind };
        let (colour, roughness) =
            look.map_or((colour, roughness), |look| (look.colour.map(|share| share as f32), look.roughness as f32));
        AppearanceRecord { id: object.id, material, colour, roughness, cut_age_ticks: 0, topology_version }
    };
    objects.iter().map(one).collect()
}

fn send_topology(publisher: &Publisher, world: &World, incarnation: u32, lies: &mut Liar) -> Result<(), Failure> {
    let (model, skin) = (&world.model, &world.body.skin);
    let raw: Vec<u32> = skin.raw.iter().map(|raw| u32::from(*raw)).collect();
    let parts: [&[u8]; SECTIONS] = [
        bytemuck::cast_slice(&world.objects),
        bytemuck::cast_slice(model.tets()),
        bytemuck::cast_slice(&world.body.rest.regions),
        bytemuck::cast_slice(&skin.triangles),
        bytemuck::cast_slice(&skin.rest_m),
        bytemuck::cast_slice(&world.wall),
        bytemuck::cast_slice(&raw),
        bytemuck::cast_slice(&world.body.rest.positions_m),
        bytemuck::cast_slice(&world.case.metal.positions_m),
        bytemuck::cast_slice(&world.case.metal.triangles),
        bytemuck::cast_slice(&world.case.metal.of_shaft),
    ];
    let lengths = parts.map(<[u8]>::len);
    let mut loan = publisher.loan(message_bytes(&lengths))?;
    let header = StreamHeader { incarnation, topology_version: world.version, ..Default::default() };
    let places = MessageMut::format(loan.bytes_mut(), Kind::Topology, header, &lengths)?.split();
    for (place, part) in places.into_iter().zip(parts) {
        place.copy_from_slice(part);
    }
    lies.tell(loan.bytes_mut());
    loan.send()?;
    Ok(())
}

/// Bytes of the greatest topology that can come of a world.
fn most_bytes(world: &World) -> usize {
    let room = &world.case.room;
    let objects = MAX_OBJECTS * size_of::<ObjectRecord>();
    // A body of tets has hardly more boundary faces than tets; twice as many are room for crumbs.
    message_bytes(&[
        objects,
        room.tets * 16,
        room.tets * 4,
        room.triangles * 12,
        room.vertices * 12,
        room.tets * 24,
        room.vertices * 4,
        room.nodes * 12,
        world.case.metal.positions_m.len() * 12,
        world.case.metal.triangles.len() * 12,
        size_of_val(&world.case.metal.of_shaft),
    ])
}

impl Clerk {
    /// Sends the topology and begins to answer.
    pub fn start(life: &Life, links: &Links, world: Arc<World>) -> Result<Clerk, Failure> {
        let bytes = most_bytes(&world);
        let publisher = links.publisher(Role::Tissue, life.incarnation, Kind::Topology, bytes)?;
        let (mut lies, mut false_looks) = (life.liar(Outlet::Topology, bytes)?, life.liar(Outlet::Appearance, 0)?);
        let (incarnation, stalls) = (life.incarnation, life.staller(Thread::Clerk)?);
        send_topology(&publisher, &world, incarnation, &mut lies)?;
        let mut server = links.server(Role::Tissue, life.incarnation, Kind::Appearance)?;
        let worlds = Worlds::new();
        let ways = worlds.clone();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let rounds = Rounds::default();
        let passed = rounds.clone();
        let body = move || {
            // The first world goes back, too: nothing else of this thread holds it.
            let (mut last, mut present) = (answer(&world), world);
            // For want of a block, while readers that starve or have died hold all: it is sent again until it comes through.
            let mut is_owed = false;
            while !stopped.load(Ordering::Acquire) {
                passed.pass();
                stalls(&stopped);
                // A link that fails here fails for newcomers alone; their next look asks again.
                let _ = publisher.announce();
                let _ = server.serve(&mut |_request| {
                    let mut told = last.clone();
                    false_looks.tell_numbers(&mut told);
                    told
                });
                // What changes only when something is cut is said again for a lie to be told, and once more when that is over.
                let has_turned = lies.has_turned();
                let is_other = ways.take(&mut present);
                if is_other {
                    last = answer(&present);
                }
                if is_other || has_turned || is_owed {
                    is_owed = send_topology(&publisher, &present, incarnation, &mut lies).is_err();
                }
                system::sleep_ns(INTERVAL_NS);
            }
        };
        let handle = std::thread::Builder::new().name("clerk".into()).spawn(body)?;
        Ok(Clerk { worlds, stop, rounds, handle: Some(handle) })
    }

    /// The clerk as its engine watches it.
    pub fn helper(&self) -> Helper {
        Helper::new(Thread::Clerk, self.rounds.clone())
    }

    /// Hands over a world whose topology is to be sent.
    pub fn tell(&self, world: &Arc<World>) {
        self.worlds.tell(world);
    }

    /// Frees the worlds that the clerk has done with.
    pub fn free(&self) {
        self.worlds.free();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Workshop;
    use hyst_tissue::Isa;

    /// The clerk freed it, with the allocator's lock: a spare that makes a mesh its own would wait for as long as the clerk is not let run.
    #[test]
    fn a_world_that_the_clerk_has_done_with_is_freed_by_who_made_it() {
        let scene = hyst_scene::load_embedded().unwrap();
        let (mut workshop, first) = Workshop::open(&scene, Isa::detect()).unwrap();
        let body = first.body.clone();
        let mut other = || Arc::new(workshop.make(body.clone()).unwrap());
        let (first, second, third) = (Arc::new(first), other(), other());
        let seen = [&first, &second, &third].map(Arc::downgrade);
        let lives = || seen.each_ref().map(|world| world.strong_count() > 0);
        let (worlds, mut present) = (Worlds::new(), first);
        assert!(!worlds.take(&mut present), "nothing was cut");
        worlds.tell(&second);
        worlds.tell(&third);
        drop((second, third));
        assert!(worlds.take(&mut present));
        assert_eq!(lives(), [true; 3], "the clerk has freed one");
        worlds.free();
        assert_eq!(lives(), [false, false, true], "the newest is what it sends");
    }

    #[test]
    fn a_growth_and_its_pieces_are_a_myoma_where_the_scene_says_so_and_nothing_else_is() {
        let kinds = [ObjectKind::Organ, ObjectKind::Pathology, ObjectKind::FreePiece, ObjectKind::Tool];
        let records: Vec<ObjectRecord> =
            (0..).zip(kinds).map(|(id, kind)| ObjectRecord { id, kind: kind as u32, ..ObjectRecord::default() }).collect();
        let materials = |myoma: Option<bool>| -> Vec<u32> {
            let look = myoma.map(|myoma| Look { colour: [0.25, 0.5, 0.75], roughness: 0.5, myoma });
            appearance(&records, 7, |_| look).iter().map(|record| record.material).collect()
        };
        assert_eq!([None, Some(false)].map(materials), [[0, 1, 1, 3], [0, 1, 1, 3]]);
        assert_eq!(materials(Some(true)), [0, 2, 2, 3]);
        let seen = appearance(&records, 7, |_| Some(Look { colour: [0.25, 0.5, 0.75], roughness: 0.5, myoma: true }));
        assert_eq!((seen[1].colour, seen[1].roughness), ([0.25, 0.5, 0.75], 0.5));
        assert!(seen.iter().all(|record| record.topology_version == 7), "whoever reads it knows of which world it is");
    }
}
