//! The instrument's surfaces, for those who draw it.

use hyst_scene::LoadedRigid;

/// What of an instrument has a surface from a file: the shaft and then the jaw on the side of +x, closed. Triangles number the vertices of their own surface.
#[derive(Default)]
pub struct Metal {
    /// Vertices, m.
    pub positions_m: Vec<[f32; 3]>,
    /// Triangles.
    pub triangles: Vec<[u32; 3]>,
    /// How many vertices and triangles are the shaft's.
    pub of_shaft: [u32; 2],
}

impl Metal {
    /// That of a scene's instrument.
    pub fn of(rigid: &LoadedRigid) -> Metal {
        let shaft = rigid.surface.iter();
        let of_shaft = shaft.clone().map(|shaft| [shaft.positions_m.len() as u32, shaft.triangles.len() as u32]).next();
        let mut metal = Metal { of_shaft: of_shaft.unwrap_or_default(), ..Metal::default() };
        for surface in shaft.chain(rigid.jaws.iter().map(|jaws| &jaws.surface)) {
            metal.positions_m.extend_from_slice(&surface.positions_m);
            metal.triangles.extend_from_slice(&surface.triangles);
        }
        metal
    }
}
