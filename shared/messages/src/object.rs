//! The objects that a topology message tells of.

use bytemuck::{Pod, Zeroable};

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ObjectKind {
    /// It stays.
    Organ = 0,
    /// It is to be removed.
    Pathology = 1,
    /// It has come free and floats.
    FreePiece = 2,
    /// An instrument.
    Tool = 3,
}

/// One object in a topology message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ObjectRecord {
    /// Name, UTF-8, zero-padded.
    pub name: [u8; 32],
    /// An [`ObjectKind`].
    pub kind: u32,
    /// Registration number with the Site Manager.
    pub id: u32,
    /// Lowest node and number of nodes, which lie together as long as nothing has been cut.
    pub nodes: [u32; 2],
    /// Lowest tet and number of tets, likewise.
    pub tets: [u32; 2],
    /// First surface vertex and number of surface vertices.
    pub vertices: [u32; 2],
    /// First triangle and number of triangles.
    pub triangles: [u32; 2],
}

impl ObjectRecord {
    /// Whether it has come free and floats.
    pub fn is_free_piece(&self) -> bool {
        self.kind == ObjectKind::FreePiece as u32
    }
}
