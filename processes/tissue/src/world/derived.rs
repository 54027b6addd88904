//! All that is made of a body beside its model, which takes as long.

use super::{Case, Held, World};
use crate::body::{Body, version_beside};
use crate::drift::Drifter;
use crate::knife::{Filled, Filling};
use crate::points::{ContactPoints, Telling};
use crate::site::object;
use crate::volumes::Volumes;
use hyst_contact::{Topology, TopologyMaker};
use hyst_engine::Failure;
use hyst_messages::stream::{ObjectKind, ObjectRecord};
use hyst_tissue::{Attachment, Model, Skin};
use std::sync::{Arc, OnceLock};

/// What a world has beside its body and the model of that.
pub(super) struct Derived {
    words: Vec<u32>,
    version: u32,
    topology: Topology,
    attachments: Vec<Attachment>,
    points: ContactPoints,
    wall: Vec<[u32; 3]>,
    objects: Vec<ObjectRecord>,
    filled: Filled,
    /// The surface of a body that has none yet.
    skin: Option<Skin>,
}

impl Derived {
    /// `come` gives the surface of a body that has none yet, and is asked once all is made that does without. Calls `passed` before that and behind it.
    pub(super) fn of(
        case: &Case,
        (faces, volumes): (&mut TopologyMaker, &mut Volumes),
        body: &Body,
        held: Option<Held>,
        come: impl FnOnce() -> Option<Skin>,
        passed: &mut impl FnMut(),
    ) -> Result<Derived, Failure> {
        let made = faces.make(&body.rest.tets, &body.rest.regions, &body.rest.positions_m);
        let topology = made.map_err(|error| Failure::Input(error.to_string()))?;
        let held = held.unwrap_or_else(|| case.held(body));
        let is_object_held = held.objects(body);
        let wall = wall(case, body, &topology, (&held.is_held, &is_object_held));
        let mut objects = objects(case, body, &is_object_held);
        let attachments = held.attachments;
        let mut points = ContactPoints::of(case, body, &topology, &objects, &attachments)?;
        passed();
        let come = come();
        let skin = come.as_ref().unwrap_or(&body.skin);
        count_surface(&mut objects, body, skin);
        passed();
        let words = body.pack_under(skin);
        let (mut filling, mut telling) = (Filling::of(case, body, &objects, volumes), Telling::of(body));
        let version = version_beside(&words, || {
            // Once for each block of words; what is left then is done at once.
            if !filling.add() {
                telling.ask();
            }
        });
        let filled = filling.ended();
        points.of_tets = telling.ended();
        Ok(Derived { words, version, topology, attachments, points, wall, objects, filled, skin: come })
    }

    /// The world of that body, with its model, and with the forces that hold its cavity shut where they are made already.
    pub(super) fn with(self, case: &Arc<Case>, mut body: Body, model: Model, shut_n: Option<Vec<[f32; 3]>>) -> World {
        let Derived { words, version, topology, attachments, points, wall, objects, filled, skin } = self;
        if let Some(skin) = skin {
            body.skin = skin;
        }
        World {
            case: Arc::clone(case),
            drifters: Drifter::of(&objects, &body, &case.bath, |object| case.density_of_kg_m3(&body, object)),
            is_organ_whole: case.closing.is_whole(&body),
            shut_n: shut_n.map_or_else(OnceLock::new, OnceLock::from),
            notes: Vec::new(),
            points,
            objects,
            version,
            filled,
            model,
            topology,
            attachments,
            wall,
            words,
            body,
        }
    }
}

/// The triangles on which the medium in the cavity presses, of a body of which some nodes and some objects are held. What is free swims in it, and is wetted on
/// its outside, too: pressed on one side alone it would be pushed away.
fn wall(case: &Case, body: &Body, topology: &Topology, (is_held, is_object_held): (&[bool], &[bool])) -> Vec<[u32; 3]> {
    let is_hollow = |owner: u32| case.hollow.get(case.origin(body, owner)).is_some_and(|hollow| *hollow);
    let is_wall = |(triangle, owner): &(&[u32; 3], &u32)| {
        is_hollow(**owner)
            && triangle.iter().all(|node| !is_held[*node as usize])
            && !(is_object_held[**owner as usize] && case.outside.has(body, **triangle))
    };
    let boundary = topology.boundary.iter().zip(&topology.boundary_owner);
    boundary.filter(is_wall).map(|(triangle, _)| *triangle).collect()
}

/// Calls for each run of things of one object: with the object, the place of the first of them, and how many they are.
fn runs(objects_of: impl Iterator<Item = Option<u32>>, mut note: impl FnMut(u32, u32, u32)) {
    let (mut of, mut first, mut end) = (None, 0, 0);
    for object in objects_of {
        if object != of {
            if let Some(before) = of {
                note(before, first, end - first);
            }
            (of, first) = (object, end);
        }
        end += 1;
    }
    if let Some(last) = of {
        note(last, first, end - first);
    }
}

/// Adds to the first place and the number of what an object has of something.
fn add([first, sum]: &mut [u32; 2], place: u32, number: u32) {
    *first = if *sum == 0 { place } else { *first };
    *sum += number;
}

/// Says of each object of a body, by its record, where it has its part of a surface.
fn count_surface(objects: &mut [ObjectRecord], body: &Body, skin: &Skin) {
    let of_vertex: Vec<u32> = skin.bindings.iter().map(|binding| body.rest.regions[binding.tet as usize]).collect();
    let of_triangle = skin.triangles.iter().map(|triangle| Some(of_vertex[triangle[0] as usize]));
    runs(of_triangle, |object, first, number| add(&mut objects[object as usize].triangles, first, number));
    runs(of_vertex.into_iter().map(Some), |object, first, number| add(&mut objects[object as usize].vertices, first, number));
}

/// The records of all objects of a body, of which some are held, and of the instruments; where each has its part of the surface is not in them yet.
fn objects(case: &Case, body: &Body, is_object_held: &[bool]) -> Vec<ObjectRecord> {
    let count = body.origin.len();
    let (mut tets, mut nodes) = (vec![[0u32; 2]; count], vec![[0u32; 2]; count]);
    let of_tets = body.rest.regions.iter().copied().map(Some);
    runs(of_tets, |object, first, number| add(&mut tets[object as usize], first, number));
    runs(body.owners().into_iter(), |object, first, number| add(&mut nodes[object as usize], first, number));
    let deformable = (0..count).map(|index| {
        let (name, kind) = &case.objects[body.origin[index] as usize];
        let is_of_scene = case.is_of_scene(index as u32);
        let name = if is_of_scene { name.clone() } else { format!("{name}, piece {}", index + 1 - case.objects.len()) };
        // An organ that nothing holds is still one; a pathology that nothing holds is a free piece from the beginning.
        let is_free = !(is_object_held[index] || is_of_scene && *kind == ObjectKind::Organ);
        let kind = if is_free { ObjectKind::FreePiece } else { *kind };
        ObjectRecord { nodes: nodes[index], tets: tets[index], ..object(&name, kind, index as u32) }
    });
    let rigid = case.rigid.iter().enumerate().map(|(index, name)| object(name, ObjectKind::Tool, (count + index) as u32));
    deformable.chain(rigid).collect()
}
