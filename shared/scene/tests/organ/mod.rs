//! Scenes of one organ and one instrument, and meshes for them as text.

use crate::folder::Folder;
use hyst_scene::{LoadedScene, SceneError, load};

impl Folder {
    /// Loads a scene of one deformable table and one instrument.
    pub fn load(&self, deformable: &str) -> Result<LoadedScene, SceneError> {
        self.load_with(deformable, "")
    }

    /// The same with more of the instrument.
    pub fn load_with(&self, deformable: &str, rigid: &str) -> Result<LoadedScene, SceneError> {
        let text = format!(
            "version = 1\nname = \"t\"\n[[deformable]]\nname = \"organ\"\n{deformable}\n[[rigid]]\nname = \"scope\"\n{rigid}\n"
        );
        load(&self.file("scene.toml", &text))
    }
}

/// A block of n³ cubes of six tets each as Gmsh 2.2, its side `side` units long, moved by `shift` on every axis.
pub fn block(n: u32, side: f64, shift: f64) -> String {
    let mut nodes = String::new();
    let id = |x: u32, y: u32, z: u32| 1 + x + (n + 1) * (y + (n + 1) * z);
    for z in 0..=n {
        for y in 0..=n {
            for x in 0..=n {
                let at = [x, y, z].map(|i| shift + side * f64::from(i) / f64::from(n));
                nodes += &format!("{} {} {} {}\n", id(x, y, z), at[0], at[1], at[2]);
            }
        }
    }
    let mut tets = String::new();
    let mut count = 0;
    for (x, y, z) in (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| (x, y, z)))) {
        for [i, j] in [[0, 1], [1, 0], [1, 2], [2, 1], [0, 2], [2, 0]] {
            let mut corner = [x, y, z];
            let mut tet = vec![id(x, y, z)];
            for axis in [i, j] {
                corner[axis] += 1;
                tet.push(id(corner[0], corner[1], corner[2]));
            }
            tet.push(id(x + 1, y + 1, z + 1));
            count += 1;
            tets += &format!("{count} 4 2 1 1 {} {} {} {}\n", tet[0], tet[1], tet[2], tet[3]);
        }
    }
    let nodes_count = (n + 1).pow(3);
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{nodes_count}\n{nodes}$EndNodes\n$Elements\n{count}\n{tets}$EndElements\n"
    )
}

/// A box as OBJ, from a corner to the other.
pub fn a_box([x, y, z]: [f64; 3], [u, v, w]: [f64; 3]) -> String {
    let corners = [[x, y, z], [u, y, z], [x, v, z], [u, v, z], [x, y, w], [u, y, w], [x, v, w], [u, v, w]];
    let vertices: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let quads = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    vertices + &quads.map(|[a, b, c, d]| format!("f {a} {b} {c}\nf {a} {c} {d}\n")).concat()
}
