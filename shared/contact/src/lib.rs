//! Contact: which points lie in which tetrahedron, how deep, which way out, and what the hand feels of it.
//!
//! Promises: same input, same bits, whatever the number of workers, also where hits find no room, and whatever the instruction set; no panic and no NaN in
//! any result, whatever the input; nothing is allocated in a step (the buffers of a step are the caller's, or sized once).
//! Frame: metres, the station's frame. Every step is a pure function of its arguments.
//!
//! The order of one tick:
//! 1. [`HashMut::build`] hashes the points (the coordinator, in place in shared words),
//! 2. [`intersect`] tests one [`Share`] (each worker, with what its [`Cull`] remembers of the step before), [`merge`] joins the shares,
//! 3. [`penetration`] gives each hit point a depth and a way out; [`sweep`] and [`first_crossing`] find those that a fast step has brought past a thin part,
//! 4. the deformation makes forces of that, as laws of each of its substeps: it is no part of this crate, and gives them back as a [`ContactForce`] each,
//! 5. [`planes`] condenses the tool's contacts, as they are felt at its tip, to at most [`MAX_PLANES`] planes for the haptic servo,
//!    with [`find_gaps`] for the wall that the tool is about to meet.
//!
//! Papers: Teschner et al., VMV 2003 (spatial hashing, barycentric test); Heidelberger et al., VMV 2004 (consistent penetration
//! depth); Möller and Trumbore 1997 (segment against triangle); Platis and Theoharis 2003 (line against flat tetrahedron); Verlet
//! 1967 (neighbour list); Newman and Sproull 1973 (outcodes, of Cohen and Sutherland).

mod brute;
mod cull;
mod error;
mod flat;
mod force;
mod graph;
mod hash;
mod hash_read;
mod intersect;
mod lanes;
mod lever;
mod near;
mod outcodes;
mod penetrate;
mod penetrate_data;
mod planes;
mod shallow;
mod sink;
mod sweep;
mod tet;
mod topology;
mod types;
mod verify;
mod walk;

pub use brute::intersect_brute;
pub use cull::Cull;
pub use error::ContactError;
pub use force::ContactForce;
pub use graph::PointGraph;
pub use hash::{HashMut, HashSizes, LANES, Layout};
pub use hash_read::HashRef;
pub use intersect::intersect;
pub use near::{Gap, find_gaps};
pub use penetrate::{Workspace, penetration};
pub use penetrate_data::{Memory, Penetration, PenetrationInput, PenetrationParams, Retreat, Source, Spared};
pub use planes::{MAX_PLANES, Plane, PlaneInput, PlaneParams, PlaneSet, planes};
pub use shallow::own_face;
pub use sink::{merge, room_of_share};
pub use sweep::{Crossing, Sense, SweepInput, first_crossing, sweep, triangles_in_box};
pub use tet::TetTest;
pub use topology::{NONE, Topology, TopologyMaker};
pub use types::{Found, HITS_OF_A_POINT, Hit, MOST_HITS_OF_SHARE, OwnContact, Points, Share, Split, Tissue};
pub use verify::{are_true, has_all_of};
pub use walk::{Exit, leads_out};
