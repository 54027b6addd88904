//! Scenes for the tests of the Main Loop: some cells of a lattice as one object, six tets each, and the default instrument.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// Cells, their edges and the lowest corner, m.
pub struct Lattice {
    pub cells: [usize; 3],
    pub edge_m: [f32; 3],
    pub low_m: [f32; 3],
}

/// A scene's folder, which is gone however its test ends.
pub struct Folder(PathBuf);

impl Folder {
    /// The scene.
    pub fn scene(&self) -> PathBuf {
        self.0.join("scene.toml")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The cells that are there as an organ of a scene with the name of its test; `fixed` is what holds them, in the words of a scene.
pub fn scene(name: &str, lattice: &Lattice, is_there: impl Fn([usize; 3]) -> bool, fixed: &str) -> Folder {
    scene_of(name, "organ", lattice, is_there, fixed)
}

/// The same as an object of that kind.
pub fn scene_of(name: &str, kind: &str, lattice: &Lattice, is_there: impl Fn([usize; 3]) -> bool, fixed: &str) -> Folder {
    let folder = Folder(std::env::temp_dir().join(format!("t{}-lattice-{name}", std::process::id())));
    std::fs::create_dir_all(&folder.0).unwrap();
    let [nx, ny, nz] = lattice.cells;
    let all = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    let mut number: BTreeMap<[usize; 3], usize> = BTreeMap::new();
    let mut nodes = String::new();
    let mut node = |at: [usize; 3]| {
        let next = number.len();
        *number.entry(at).or_insert_with(|| {
            let place: [f32; 3] = std::array::from_fn(|axis| lattice.low_m[axis] + at[axis] as f32 * lattice.edge_m[axis]);
            nodes += &format!("{} {} {}\n", place[0], place[1], place[2]);
            next
        })
    };
    let orders =
        [([0, 1, 2], false), ([1, 2, 0], false), ([2, 0, 1], false), ([1, 0, 2], true), ([0, 2, 1], true), ([2, 1, 0], true)];
    let mut tets: Vec<[usize; 4]> = Vec::new();
    for cell in all.filter(|cell| is_there(*cell)) {
        // About the diagonal of each cell; half of the orders are of the other handedness.
        for (order, is_odd) in orders {
            let mut at: [usize; 3] = cell;
            let mut tet = [node(at); 4];
            for (corner, axis) in (1usize..).zip(order) {
                at[axis] += 1;
                tet[corner] = node(at);
            }
            if is_odd {
                tet.swap(2, 3);
            }
            tets.push(tet);
        }
    }
    let (count, cells) = (number.len(), tets.len());
    let corners: String = tets.iter().map(|[a, b, c, d]| format!("4 {a} {b} {c} {d}\n")).collect();
    let mesh = format!(
        "# vtk DataFile Version 3.0\nlattice\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {count} float\n{nodes}CELLS {cells} {}\n{corners}\
         CELL_TYPES {cells}\n{}",
        5 * cells,
        "10\n".repeat(cells)
    );
    std::fs::write(folder.0.join("lattice.vtk"), mesh).unwrap();
    let scene = format!(
        "version = 1\nname = \"{name}\"\n[[deformable]]\nname = \"lattice\"\nkind = \"{kind}\"\nmesh = \"lattice.vtk\"\nscale_to_m = 1.0\nfixed = [{fixed}]\n\
         [[rigid]]\nname = \"hysteroscope\"\nkind = \"hysteroscope\"\n"
    );
    std::fs::write(folder.scene(), scene).unwrap();
    folder
}
