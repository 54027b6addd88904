//! The stage as the tissue's messages describe it: a topology makes the objects, a state moves them straight from the message's memory.
//!
//! Promise: a message whose ranges, indices or numbers make no sense changes nothing.

use crate::instrument::{Instrument, TOOL};
use crate::looks;
use hyst_messages::stream::{AppearanceRecord, ObjectKind, ObjectRecord, ScopeRecord};
use hyst_messages::{Kind, Message, SealRecord, WireError};
use rendering::{Appearance, MAX_OBJECTS, Material, RenderError, Stage, SurfaceMesh, Surroundings, ostia};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};
use std::ops::Range;

/// That of the bubbles.
pub const BUBBLES: u64 = TOOL + 3;
/// That of the flakes in the medium.
pub const MOTES: u64 = TOOL + 4;
/// That of the planes of the contact model.
pub const CONTACTS: u64 = TOOL + 7;
/// That of the force on the hand.
pub const FORCE: u64 = TOOL + 8;
/// Radius of the spot about a vessel that is sealed, m: as far from its mouth as the loop may have touched it, and half a millimetre more (assumed).
const SPOT_M: f32 = 2e-3;
/// Vertices of an object up to which it is looked anew how open it is about each when a cut has changed another object: some milliseconds. A larger one keeps
/// what was found when it was made.
const MOST_ANEW: usize = 50_000;
const ORGAN: u32 = ObjectKind::Organ as u32;
const PATHOLOGY: u32 = ObjectKind::Pathology as u32;
const FREE_PIECE: u32 = ObjectKind::FreePiece as u32;
const RIGID_TOOL: u32 = ObjectKind::Tool as u32;

/// Why a message was left out.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// The frame or a section.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// Ranges that contradict each other.
    #[error("object {object}: {what} {first}..{first}+{count} of {have}; the writer's topology is broken")]
    Range {
        /// Registration number.
        object: u32,
        /// Vertices or triangles.
        what: &'static str,
        /// First.
        first: u32,
        /// How many.
        count: u32,
        /// How many there are.
        have: usize,
    },
    /// Another number of vertices, or of what there is one of for each, than the topology has.
    #[error("{got} entries for surface vertices, the topology has {expected}")]
    Length {
        /// In the message.
        got: usize,
        /// In the topology.
        expected: usize,
    },
    /// A number that is not finite.
    #[error("surface vertex {0} is not finite; the writer is broken and must be restarted")]
    NotFinite(usize),
    /// The stage refused it.
    #[error(transparent)]
    Stage(#[from] RenderError),
}

/// Refusals of one kind of message, one after the other.
#[derive(Debug, Default)]
pub struct Refusals(bool);

impl Refusals {
    /// Takes whether a message was refused; gives whether that is to be said: the first of a row is.
    pub fn is_news(&mut self, refused: bool) -> bool {
        !std::mem::replace(&mut self.0, refused) && refused
    }
}

/// One object of a topology with triangles in the numbering of its own vertices.
#[derive(Debug, PartialEq)]
struct Part {
    id: u64,
    kind: u32,
    vertices: Range<usize>,
    triangles: Vec<[u32; 3]>,
}

/// What the topology says, and the looks.
#[derive(Debug)]
pub struct Scenery {
    /// The instrument.
    pub instrument: Instrument,
    /// Writer and version of the topology on the stage.
    topology: Option<(u32, u32)>,
    surfaces: Vec<(u64, Range<usize>)>,
    /// Of what each of its objects on the stage was made, as [`print_of`] gives it.
    prints: BTreeMap<u64, u64>,
    tools: Vec<u64>,
    /// Where the mouths of an organ were when it was first put on the stage: no cut moves them.
    mouths: BTreeMap<u64, [[f32; 4]; 2]>,
    /// What the tissue last answered of each object's look: it stays when a cut makes the objects anew.
    looks: BTreeMap<u64, Appearance>,
    vertices: usize,
    /// Where what is held is coagulated, as [`Stage::set_spots`] takes it, and the objects that are held.
    spots: Vec<[f32; 4]>,
    held: Vec<u64>,
}

fn range(record: &ObjectRecord, what: &'static str, [first, count]: [u32; 2], have: usize) -> Result<Range<usize>, Refused> {
    let end = first as usize + count as usize;
    if end > have {
        return Err(Refused::Range { object: record.id, what, first, count, have });
    }
    Ok(first as usize..end)
}

/// The drawn objects of a topology; tools have no surface of their own.
fn parts(records: &[ObjectRecord], triangles: &[[u32; 3]], vertices: usize) -> Result<Vec<Part>, Refused> {
    let mut parts = Vec::with_capacity(records.len());
    for record in records.iter().filter(|record| record.kind != RIGID_TOOL) {
        let own = range(record, "vertices", record.vertices, vertices)?;
        let mine = &triangles[range(record, "triangles", record.triangles, triangles.len())?];
        // A triangle with a vertex of another object gets a number that the stage refuses.
        let rebased = mine.iter().map(|corners| corners.map(|corner| corner.wrapping_sub(own.start as u32))).collect();
        parts.push(Part { id: record.id as u64, kind: record.kind, vertices: own, triangles: rebased });
    }
    Ok(parts)
}

/// That the stage will take all of it, before it is given any: an object that is refused in the middle would leave half a picture.
fn check_parts(parts: &[Part], others: usize) -> Result<(), RenderError> {
    if parts.len() + others > MAX_OBJECTS {
        return Err(RenderError::TooLarge { what: "objects", got: parts.len() + others, bound: MAX_OBJECTS });
    }
    for part in parts {
        let vertices = part.vertices.len();
        let is_outside = |corners: &[u32; 3]| corners.iter().any(|corner| *corner as usize >= vertices);
        if let Some(triangle) = part.triangles.iter().position(is_outside) {
            let vertex = part.triangles[triangle].into_iter().max().unwrap_or(0);
            return Err(RenderError::BadTriangle { object: part.id, triangle, vertex, vertices });
        }
    }
    Ok(())
}

/// What tells an object's triangles, places at rest and wounds from others: one that a cut elsewhere has left as it was is not made anew.
fn print_of(triangles: &[[u32; 3]], rest_m: &[[f32; 3]], raw: &[u32]) -> u64 {
    let parts: [&[u8]; 3] = [bytemuck::cast_slice(triangles), bytemuck::cast_slice(rest_m), bytemuck::cast_slice(raw)];
    let mut hasher = DefaultHasher::new();
    for bytes in parts {
        hasher.write_usize(bytes.len());
        hasher.write(bytes);
    }
    hasher.finish()
}

/// What there is about the surfaces that are held, one for each part: what has come free is not where it was at rest.
fn surroundings(parts: &[Part], meshes: &[SurfaceMesh<'_>]) -> Surroundings {
    let of_held = parts.iter().zip(meshes).filter(|(part, _)| part.kind != FREE_PIECE);
    let held: Vec<SurfaceMesh<'_>> = of_held.map(|(_, mesh)| *mesh).collect();
    Surroundings::of(&held)
}

fn usual(kind: u32) -> Appearance {
    Appearance::of(if matches!(kind, PATHOLOGY | FREE_PIECE) { Material::Polyp } else { Material::MucosaTissue })
}

fn check_finite(points_m: &[[f32; 3]]) -> Result<(), Refused> {
    let bad = points_m.iter().position(|point| !point.iter().all(|value| value.is_finite()));
    bad.map_or(Ok(()), |vertex| Err(Refused::NotFinite(vertex)))
}

impl Scenery {
    /// A stage with the tool alone.
    pub fn new(stage: &mut Stage) -> Result<Scenery, RenderError> {
        Ok(Scenery {
            instrument: Instrument::new(stage)?,
            topology: None,
            surfaces: Vec::new(),
            prints: BTreeMap::new(),
            tools: Vec::new(),
            mouths: BTreeMap::new(),
            looks: BTreeMap::new(),
            vertices: 0,
            spots: Vec::new(),
            held: Vec::new(),
        })
    }

    /// Whether the objects on the stage are those of this version, from this or any other writer.
    pub fn is_of(&self, version: u32) -> bool {
        self.topology.is_some_and(|(_, known)| known == version)
    }

    /// Makes the objects of a topology that are not on the stage as they are in it; gives the bytes that were copied to number the triangles by object.
    pub fn rebuild(&mut self, stage: &mut Stage, topology: &[u8]) -> Result<u64, Refused> {
        let message = Message::parse(topology, Kind::Topology)?;
        let records: &[ObjectRecord] = message.section(0)?;
        let rest_m: &[[f32; 3]] = message.section(4)?;
        check_finite(rest_m)?;
        let raw: &[u32] = message.section(6)?;
        if raw.len() != rest_m.len() {
            return Err(Refused::Length { got: raw.len(), expected: rest_m.len() });
        }
        let parts = parts(records, message.section(3)?, rest_m.len())?;
        check_parts(&parts, stage.ids().filter(|id| *id >= TOOL).count())?;
        let gone: Vec<u64> = stage.ids().filter(|id| *id < TOOL && !parts.iter().any(|part| part.id == *id)).collect();
        for id in gone {
            stage.remove_object(id);
            self.prints.remove(&id);
        }
        let meshes: Vec<SurfaceMesh<'_>> = parts.iter().map(|part| self.mesh(part, rest_m, raw)).collect();
        let surroundings = surroundings(&parts, &meshes);
        for (part, mesh) in parts.iter().zip(&meshes) {
            let print = print_of(mesh.triangles, mesh.rest_m, mesh.raw);
            let is_known = self.prints.get(&part.id) == Some(&print);
            if is_known {
                stage.set_appearance(part.id, mesh.appearance)?;
            } else {
                stage.set_object(part.id, *mesh)?;
                self.prints.insert(part.id, print);
            }
            if part.kind == FREE_PIECE {
                stage.set_openness(part.id, &vec![1.0; mesh.rest_m.len()])?;
            } else if !is_known || mesh.rest_m.len() <= MOST_ANEW {
                stage.set_openness(part.id, &surroundings.openness(mesh))?;
            }
            let mouths = if part.kind == ORGAN {
                *self.mouths.entry(part.id).or_insert_with(|| ostia(mesh.rest_m, mesh.raw, mesh.triangles))
            } else {
                [[0.0; 4]; 2]
            };
            stage.set_mouths(part.id, mouths)?;
            // What has come free has none, though it may have been held until now.
            let spots: &[[f32; 4]] = if part.kind == FREE_PIECE { &[] } else { &self.spots };
            stage.set_spots(part.id, spots)?;
        }
        self.instrument.rebuild(stage, &message)?;
        self.tools = records.iter().filter(|record| record.kind == RIGID_TOOL).map(|record| record.id as u64).collect();
        self.topology = Some((message.header().incarnation, message.header().topology_version));
        self.vertices = rest_m.len();
        self.held = parts.iter().filter(|part| part.kind != FREE_PIECE).map(|part| part.id).collect();
        self.surfaces = parts.iter().map(|part| (part.id, part.vertices.clone())).collect();
        Ok(parts.iter().map(|part| size_of_val(part.triangles.as_slice()) as u64).sum())
    }

    /// A part of a topology with these places and wounds, as the stage takes it.
    fn mesh<'a>(&self, part: &'a Part, rest_m: &'a [[f32; 3]], raw: &'a [u32]) -> SurfaceMesh<'a> {
        let (rest_m, raw) = (&rest_m[part.vertices.clone()], &raw[part.vertices.clone()]);
        let appearance = self.looks.get(&part.id).copied().unwrap_or_else(|| usual(part.kind));
        SurfaceMesh { triangles: &part.triangles, rest_m, raw, appearance }
    }

    /// Blanches what is held where vessels are coagulated: at places of the shape at rest, so that the spots move with the tissue. What floats has none.
    pub fn blanch(&mut self, stage: &mut Stage, seals: &[SealRecord]) {
        let spot = |seal: &SealRecord| {
            let [x, y, z] = seal.rest_m;
            [x, y, z, SPOT_M * seal.share.clamp(0.0, 1.0).sqrt()]
        };
        let spots = || seals.iter().filter(|seal| seal.share > 0.0).map(spot);
        if spots().eq(self.spots.iter().copied()) {
            return;
        }
        self.spots.clear();
        self.spots.extend(spots());
        for id in &self.held {
            let _ = stage.set_spots(*id, &self.spots); // what is not on the stage any more is left out
        }
    }

    /// Moves all surfaces to a state's; gives the bytes that were uploaded.
    pub fn follow(&mut self, stage: &mut Stage, state: &[u8]) -> Result<u64, Refused> {
        let points_m: &[[f32; 3]] = Message::parse(state, Kind::TissueState)?.section(3)?;
        if points_m.len() != self.vertices {
            return Err(Refused::Length { got: points_m.len(), expected: self.vertices });
        }
        check_finite(points_m)?;
        let mut uploaded = 0;
        for (id, vertices) in &self.surfaces {
            let mine = &points_m[vertices.clone()];
            stage.update_positions(*id, mine)?;
            uploaded += size_of_val(mine) as u64;
        }
        Ok(uploaded)
    }

    /// Gives scope and objects the looks that the tissue has answered with; what is not on the stage any more is left out. Of objects of another topology none
    /// is taken, and false given: there a piece may have the number that an instrument has here, or the other way about.
    pub fn dress(&mut self, stage: &mut Stage, scope: ScopeRecord, records: &[AppearanceRecord]) -> Result<bool, RenderError> {
        self.instrument.dress(stage, scope)?;
        if !records.iter().all(|record| self.has_number_of(record)) {
            return Ok(false);
        }
        for record in records {
            let is_tool = self.tools.contains(&(record.id as u64));
            let look = Appearance { external_only: is_tool, ..looks::appearance(record) };
            if !is_tool {
                self.looks.insert(record.id as u64, look);
            }
            let _ = stage.set_appearance(if is_tool { TOOL } else { record.id as u64 }, look);
        }
        Ok(true)
    }

    /// Whether what is on the stage has its numbers from the topology that a look is of; of a writer who does not say which that is, from any.
    fn has_number_of(&self, record: &AppearanceRecord) -> bool {
        self.topology.is_some_and(|(_, known)| [0, known].contains(&record.topology_version))
    }
}

#[cfg(test)]
mod tests;
