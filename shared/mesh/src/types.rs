//! The two meshes. They are plain arrays, so that they can be sent and shared as they are.

/// A tetrahedral mesh.
///
/// Promise of the readers: every index is in range, every coordinate is finite, `regions.len() == tets.len()`, there is at least
/// one tet. Orientation, shape and connectivity are whatever the file holds: see [`check`](crate::check()).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TetMesh {
    /// One position per node, in metres in the frame of the file. Straight from a reader the unit is still that of the file.
    pub positions_m: Vec<[f32; 3]>,
    /// Four node indices per tet. A tet `[a, b, c, d]` has a positive volume when `(b−a) × (c−a) · (d−a) > 0`.
    pub tets: Vec<[u32; 4]>,
    /// One region per tet: the physical group (of Gmsh, without one the volume's number), reference or attribute of the file, without its sign; 0 if it names
    /// none.
    pub regions: Vec<u32>,
}

/// A triangle mesh. Counter-clockwise seen from outside where the file follows the custom.
///
/// Promise of the readers: every index is in range, every coordinate is finite, there is at least one triangle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// One position per vertex, in metres in the frame of the file. Straight from a reader the unit is still that of the file.
    pub positions_m: Vec<[f32; 3]>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl TetMesh {
    /// Multiplies every coordinate by `metres_per_unit` (0.001 for a file in millimetres).
    ///
    /// A factor that is not finite, or that takes a coordinate out of range, leaves coordinates that are not finite; `check` and
    /// `repair` report them.
    pub fn scale_to_m(&mut self, metres_per_unit: f32) {
        scale(&mut self.positions_m, metres_per_unit);
    }
}

impl TriangleMesh {
    /// As [`TetMesh::scale_to_m`].
    pub fn scale_to_m(&mut self, metres_per_unit: f32) {
        scale(&mut self.positions_m, metres_per_unit);
    }
}

fn scale(positions_m: &mut [[f32; 3]], factor: f32) {
    for position in positions_m {
        *position = position.map(|coordinate| coordinate * factor);
    }
}
