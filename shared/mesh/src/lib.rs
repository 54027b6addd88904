//! Tetrahedral and triangle meshes: reading, checking, repairing, binding a surface to a volume.
//!
//! Pure: no file, no clock, no random number. A reader takes the bytes of a file and its name; the same bytes give the same mesh.
//! No input makes a reader panic, hang or ask for more memory than a fixed multiple of the input's own size.
//!
//! The usual way from a file to a simulation:
//! [`read_tets`] → [`TetMesh::scale_to_m`] → [`check`] (what is wrong) → [`repair`] (what was done about it) → [`boundary`] and
//! [`bind`] (what is drawn).
#![deny(unsafe_code)]

mod bind;
mod boundary;
mod check;
mod error;
mod formats;
mod geometry;
mod lists;
mod merge;
mod read;
mod repair;
mod text;
mod types;

pub use bind::{BindError, BindReport, Binding, bind, evaluate};
pub use boundary::{FACES, Surface, boundary, component_count, component_of_each_tet, component_of_each_triangle};
pub use check::{FLAT_QUALITY, ORGAN_SIZE_M, Report, check, open_edges};
pub use error::{Place, ReadError, ReadErrorKind};
pub use formats::tetgen::read_tetgen;
pub use geometry::{Unit, guess_unit, is_too_flat, quality, signed_volume};
pub use lists::{are_below, are_finite};
pub use read::{Format, TetFile, companion_name, detect, read_tet_file, read_tets, read_triangles};
pub use repair::{Repair, RepairError, Repaired, keep_tets, renumber, repair};
pub use types::{TetMesh, TriangleMesh};
