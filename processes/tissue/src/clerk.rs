//! The clerk: an ordinary thread that sends the topology on change and to every newcomer, and answers those who ask for the objects'
//! appearance by rendezvous. The Main Loop never waits for either.

use crate::site::ObjectKind;
use crate::world::World;
use hyst_engine::{Failure, Life};
use hyst_exchange::rendezvous::Server;
use hyst_exchange::{Links, Publisher, system};
use hyst_messages::stream::{AppearanceRecord, ObjectRecord, message_bytes};
use hyst_messages::{Kind, MessageMut, Role, StreamHeader};
use hyst_scene::Look;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// How often newcomers are looked for and requests answered, ns.
const INTERVAL_NS: u64 = 10_000_000;

/// Sections of a topology: objects, tets, owner of each tet, triangles, surface vertices at rest, wall triangles.
pub const SECTIONS: usize = 6;

/// Ends the clerk's thread when dropped.
pub struct Clerk {
    stop: Arc<AtomicBool>,
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
    let objects = appearance(world.site.objects(), &world.looks);
    [bytemuck::bytes_of(&world.scope), bytemuck::cast_slice(&objects)].concat()
}

fn appearance(objects: &[ObjectRecord], looks: &[Option<Look>]) -> Vec<AppearanceRecord> {
    let one = |(index, object): (usize, &ObjectRecord)| {
        let (material, colour, roughness) = match object.kind {
            kind if kind == ObjectKind::Pathology as u32 => (1, [0.62, 0.16, 0.13], 0.30),
            kind if kind == ObjectKind::Tool as u32 => (3, [0.70, 0.71, 0.73], 0.25),
            _ => (0, [0.78, 0.34, 0.30], 0.35),
        };
        let look = looks.get(index).copied().flatten();
        let (colour, roughness) =
            look.map_or((colour, roughness), |look| (look.colour.map(|share| share as f32), look.roughness as f32));
        AppearanceRecord { id: object.id, material, colour, roughness, cut_age_ticks: 0, reserved: 0 }
    };
    objects.iter().enumerate().map(one).collect()
}

fn send_topology(publisher: &Publisher, world: &World, incarnation: u32) -> Result<(), Failure> {
    let model = &world.model;
    let mut rest = vec![[0.0; 3]; world.bindings.len()];
    hyst_tissue::surface_update(&world.bindings, model.tets(), model.rest_m(), &mut rest);
    let parts: [&[u8]; SECTIONS] = [
        bytemuck::cast_slice(world.site.objects()),
        bytemuck::cast_slice(model.tets()),
        bytemuck::cast_slice(&world.tet_owner),
        bytemuck::cast_slice(&world.triangles),
        bytemuck::cast_slice(&rest),
        bytemuck::cast_slice(&world.wall),
    ];
    let lengths = parts.map(<[u8]>::len);
    let mut loan = publisher.loan(message_bytes(&lengths))?;
    let header = StreamHeader { incarnation, topology_version: world.site.version(), ..Default::default() };
    let places = MessageMut::format(loan.bytes_mut(), Kind::Topology, header, &lengths)?.split();
    for (place, part) in places.into_iter().zip(parts) {
        place.copy_from_slice(part);
    }
    loan.send()?;
    Ok(())
}

impl Clerk {
    /// Sends the topology and begins to answer.
    pub fn start(life: &Life, links: &Links, world: &World) -> Result<Clerk, Failure> {
        let bytes = [
            size_of_val(world.site.objects()),
            size_of_val(world.model.tets()),
            world.tet_owner.len() * 4,
            world.triangles.len() * 12,
            world.bindings.len() * 12,
            world.wall.len() * 12,
        ];
        let publisher = links.publisher(Role::Tissue, life.incarnation, Kind::Topology, message_bytes(&bytes))?;
        send_topology(&publisher, world, life.incarnation)?;
        let mut server = links.server(Role::Tissue, life.incarnation, Kind::Appearance)?;
        let answer = answer(world);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let body = move || {
            while !stopped.load(Ordering::Acquire) {
                // A link that fails here fails for newcomers alone; their next look asks again.
                let _ = publisher.announce();
                let _ = server.serve(&mut |_request| answer.clone());
                system::sleep_ns(INTERVAL_NS);
            }
        };
        let handle = std::thread::Builder::new().name("clerk".into()).spawn(body)?;
        Ok(Clerk { stop, handle: Some(handle) })
    }
}
