//! How open it is about each vertex: where a growth meets the wall, in the recesses to both sides and in the horns surfaces come close to one another, and
//! less light finds in (ambient occlusion).
//!
//! What a vertex has about it is looked up once, a little way off its surface along the normal, as Evans does ("Fast approximations for global illumination on
//! dynamic scenes", SIGGRAPH course 2006; from memory), in a grid of how much surface there is, smoothed over some millimetres. A plane has a known amount
//! there; what is more stands in the way of light, whichever way it lies.
//!
//! Promise: the same surfaces give the same bits, however they are meshed nearly the same shares, and no number or index in them a panic. It takes a fixed time
//! for the grid, and one that grows with vertices and triangles: a look into memory for each.

use glam::Vec3;

use super::{Stage, SurfaceMesh, share};
use crate::error::RenderError;

/// Edge of a cell, m, where they are not too many: what is nearer than some three of them takes light.
const CELL_M: f32 = 1.25e-3;
/// Cells at most: a larger organ's are wider. The default organ has 142 000.
const MOST_CELLS: usize = 1 << 18;
/// Empty cells on each side, so that nothing that is smoothed comes to the grid's edge.
const MARGIN: usize = 4;
/// Places that stand for the triangles at most: of more triangles one stands for some.
const MOST_PLACES: usize = 1 << 18;
/// Parts into which a triangle's edge is cut at most.
const MOST_PARTS: usize = 8;
/// How far off its surface a vertex looks, in cells.
const OFF_CELLS: f32 = 1.6;
/// What a plane has there, cell faces in a cell: 0.148 to 0.155 by how it lies to the grid.
const PLANE: f32 = 0.152;
/// So many planes are in nobody's way: the walls of a cavity are hardly bent.
const USUAL: f32 = 1.08;
/// How much darker it is for each plane more (by eye).
const FOR_EACH: f32 = 0.85;

/// How much surface there is in each cell about some surfaces.
#[derive(Debug)]
pub struct Surroundings {
    /// The middle of the first cell, m.
    first_m: Vec3,
    cell_m: f32,
    /// Along x, y and z.
    cells: [usize; 3],
    /// Cell faces in each of them, x fastest.
    faces: Vec<f32>,
}

/// Where a corner lies at rest, m, if it is there and a place.
fn place(mesh: &SurfaceMesh<'_>, corner: u32) -> Option<Vec3> {
    mesh.rest_m.get(corner as usize).map(|at_m| Vec3::from(*at_m)).filter(|at_m| at_m.abs().cmplt(Vec3::splat(10.0)).all())
}

/// Where the corners of a triangle lie, m, if none of them lies on a wound: at rest the sides of a cut lie on one another.
fn whole(mesh: &SurfaceMesh<'_>, corners: [u32; 3]) -> Option<[Vec3; 3]> {
    let is_raw = corners.iter().any(|corner| mesh.raw.get(*corner as usize).is_some_and(|raw| *raw != 0));
    let [a, b, c] = corners.map(|corner| place(mesh, corner));
    if is_raw { None } else { Some([a?, b?, c?]) }
}

/// All triangles of that kind, or of so many one.
fn all_whole(meshes: &[SurfaceMesh<'_>], stride: usize) -> impl Iterator<Item = [Vec3; 3]> {
    meshes.iter().flat_map(move |mesh| mesh.triangles.iter().step_by(stride).filter_map(move |corners| whole(mesh, *corners)))
}

impl Surroundings {
    /// What there is about these surfaces: all that are held, for what floats is elsewhere than at rest.
    pub fn of(meshes: &[SurfaceMesh<'_>]) -> Self {
        let triangles: usize = meshes.iter().map(|mesh| mesh.triangles.len()).sum();
        let stride = triangles.div_ceil(MOST_PLACES).max(1);
        let most_parts = (MOST_PLACES / triangles.max(1)).isqrt().clamp(1, MOST_PARTS);
        let mut surroundings = Self::about(all_whole(meshes, stride).flatten());
        for corners_m in all_whole(meshes, stride) {
            surroundings.add(corners_m, most_parts, stride as f32);
        }
        surroundings.smooth();
        surroundings
    }

    /// An empty grid about these places.
    fn about(places_m: impl Iterator<Item = Vec3>) -> Self {
        let (low_m, high_m) = places_m.fold((Vec3::MAX, Vec3::MIN), |(low_m, high_m), at_m| (low_m.min(at_m), high_m.max(at_m)));
        let extent_m = (high_m - low_m).max(Vec3::ZERO);
        let cells_of = |cell_m: f32| (extent_m / cell_m).to_array().map(|cells| cells.ceil() as usize + 2 * MARGIN + 1);
        let mut cell_m = CELL_M;
        // A quarter wider each time: from a millimetre to some metres, as far apart as two places can be, in less than forty.
        while cells_of(cell_m).iter().product::<usize>() > MOST_CELLS {
            cell_m *= 1.25;
        }
        let cells = cells_of(cell_m);
        Self { first_m: low_m - MARGIN as f32 * cell_m, cell_m, cells, faces: vec![0.0; cells.iter().product()] }
    }

    /// The eight cells about a place and the share of each in it; none at the grid's edge and beyond.
    fn cells_about(&self, at_m: Vec3) -> Option<[(usize, f32); 8]> {
        let at = (at_m - self.first_m) / self.cell_m;
        let low = at.floor();
        let [nx, ny, nz] = self.cells;
        let last = Vec3::new(nx as f32, ny as f32, nz as f32) - 2.0;
        if !(low.cmpge(Vec3::ZERO).all() && low.cmple(last).all()) {
            return None;
        }
        let [x, y, z] = low.to_array().map(|cell| cell as usize);
        let [beyond, before] = [at - low, Vec3::ONE - (at - low)];
        Some(std::array::from_fn(|corner| {
            let is_beyond = [corner & 1, (corner >> 1) & 1, corner >> 2];
            let part = |axis: usize| if is_beyond[axis] == 1 { beyond[axis] } else { before[axis] };
            let cell = ((z + is_beyond[2]) * ny + y + is_beyond[1]) * nx + x + is_beyond[0];
            (cell, part(0) * part(1) * part(2))
        }))
    }

    /// Adds a triangle as the middles of its parts, so many times.
    fn add(&mut self, [a, b, c]: [Vec3; 3], most_parts: usize, times: f32) {
        let longest_m = (b - a).length().max((c - b).length()).max((a - c).length());
        let parts = ((longest_m / self.cell_m).ceil() as usize).clamp(1, most_parts);
        let area_m2 = 0.5 * (b - a).cross(c - a).length();
        let faces = times * area_m2 / (self.cell_m * self.cell_m * (parts * parts) as f32);
        for (i, j) in (0..parts).flat_map(|i| (0..parts - i).map(move |j| (i, j))) {
            // One that points as the whole does, and one upside down beside it, but in the last of a row.
            let is_last = i + j + 1 == parts;
            for third in if is_last { 1..2 } else { 1..3 } {
                let [u, v] = [i, j].map(|part| (part as f32 + third as f32 / 3.0) / parts as f32);
                for (cell, share) in self.cells_about(a + u * (b - a) + v * (c - a)).into_iter().flatten() {
                    self.faces[cell] += share * faces;
                }
            }
        }
    }

    /// Spreads what is in each cell over those about it: along each axis by two boxes of three cells, one after the other.
    fn smooth(&mut self) {
        let mut spread = vec![0.0; self.faces.len()];
        let [nx, ny, _] = self.cells;
        // What is read beyond the end of a row is the margin of the next one, and empty.
        for step in [1, nx, nx * ny] {
            let inner = self.faces.len() - 4 * step;
            let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|of| &self.faces[of * step..][..inner]);
            let pairs = a.iter().zip(e).zip(b.iter().zip(d)).zip(c);
            for (to, (((a, e), (b, d)), c)) in spread[2 * step..].iter_mut().zip(pairs) {
                *to = (a + e + 2.0 * (b + d) + 3.0 * c) / 9.0;
            }
            std::mem::swap(&mut self.faces, &mut spread);
        }
    }

    /// How open it is about each vertex of a surface, as [`Stage::set_openness`] takes it: 1 where nothing is near, and towards 0 the more there is.
    pub fn openness(&self, mesh: &SurfaceMesh<'_>) -> Vec<f32> {
        let mut normals = vec![Vec3::ZERO; mesh.rest_m.len()];
        for corners in mesh.triangles {
            let [Some(a), Some(b), Some(c)] = corners.map(|corner| place(mesh, corner)) else { continue };
            let normal = (b - a).cross(c - a);
            for corner in corners {
                normals[*corner as usize] += normal;
            }
        }
        let open = |(at_m, normal): (&[f32; 3], Vec3)| {
            let Some(normal) = normal.try_normalize() else { return 1.0 };
            let off_m = Vec3::from(*at_m) + OFF_CELLS * self.cell_m * normal;
            let faces: f32 = self.cells_about(off_m).into_iter().flatten().map(|(cell, share)| share * self.faces[cell]).sum();
            1.0 / (1.0 + FOR_EACH * (faces / PLANE - USUAL).max(0.0))
        };
        mesh.rest_m.iter().zip(normals).map(open).collect()
    }
}

impl Stage {
    /// How open it is about each vertex of an object, as [`Surroundings::openness`] gives it: where it is not, less light comes to. One that is no number is 1,
    /// as all are of an object that is new or made anew.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`], [`RenderError::WrongLength`]; the object stays as it was.
    pub fn set_openness(&mut self, id: u64, open: &[f32]) -> Result<(), RenderError> {
        let object = self.objects.get(&id).ok_or(RenderError::UnknownObject(id))?;
        if open.len() != object.vertices {
            return Err(RenderError::WrongLength { object: id, got: open.len(), expected: object.vertices });
        }
        let shares: Vec<f32> = open.iter().map(|open| share(*open, 1.0)).collect();
        if !shares.is_empty() {
            self.queue.write_buffer(&object.open, 0, bytemuck::cast_slice(&shares));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::stage::{Appearance, Material};

    /// Sides of a [`sheet`], m.
    const SIDE_M: f32 = 0.024;

    /// A square sheet of so many by so many squares from a corner along two axes, which looks along their cross product.
    fn sheet(corner_m: [f32; 3], along: [Vec3; 2], squares: u32) -> Shape {
        let row = squares + 1;
        let share = |step: u32| SIDE_M * step as f32 / squares as f32;
        let at_m = |vertex: u32| Vec3::from(corner_m) + share(vertex % row) * along[0] + share(vertex / row) * along[1];
        let corners = (0..squares * squares).map(|square| square / squares * row + square % squares);
        Shape {
            positions_m: (0..row * row).map(|vertex| at_m(vertex).to_array()).collect(),
            triangles: corners.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]).collect(),
        }
    }

    /// A floor that looks up, and a wall that stands on its edge at x = 12 mm and looks back over it.
    fn floor_and_wall(squares: u32) -> [Shape; 2] {
        let low_m = -0.5 * SIDE_M;
        [sheet([low_m, low_m, 0.0], [Vec3::X, Vec3::Y], squares), sheet([-low_m, low_m, 0.0], [Vec3::Z, Vec3::Y], squares)]
    }

    fn mesh<'a>(shape: &'a Shape, raw: &'a [u32]) -> SurfaceMesh<'a> {
        let appearance = Appearance::of(Material::MucosaTissue);
        SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw, appearance }
    }

    /// How open it is at the floor's places in the middle of y, this far from its edge at the wall, m.
    fn open_at<const N: usize>(floor: &Shape, about: &[SurfaceMesh<'_>], from_wall_m: [f32; N]) -> [f32; N] {
        let open = Surroundings::of(about).openness(&mesh(floor, &[]));
        from_wall_m.map(|from_m| {
            let meant_m = Vec3::new(0.5 * SIDE_M - from_m, 0.0, 0.0);
            let off_m = |vertex: &usize| Vec3::from(floor.positions_m[*vertex]).distance(meant_m);
            let vertex = (0..open.len()).min_by(|a, b| off_m(a).total_cmp(&off_m(b))).expect("it has vertices");
            assert!(off_m(&vertex) < 1e-6, "no vertex is at {meant_m}");
            open[vertex]
        })
    }

    #[test]
    fn a_plane_is_open_and_where_a_wall_stands_on_it_it_is_less_so_however_finely_both_are_meshed() {
        let shares = [8, 24, 360].map(|squares| {
            let [floor, wall] = floor_and_wall(squares);
            let (floor_mesh, wall_mesh) = (mesh(&floor, &[]), mesh(&wall, &[]));
            let alone = open_at(&floor, &[floor_mesh], [0.0, 0.003, 0.012]);
            assert_eq!(alone, [1.0; 3], "{squares} squares");
            open_at(&floor, &[floor_mesh, wall_mesh], [0.0, 0.003, 0.006, 0.012])
        });
        println!("{shares:?}");
        for [edge, near, beside, far] in shares {
            assert!((0.4..0.6).contains(&edge) && (0.7..0.9).contains(&near) && beside > 0.97 && far == 1.0, "{shares:?}");
        }
        let apart = |which: usize| (0..4).map(|at| (shares[which][at] - shares[0][at]).abs()).fold(0.0, f32::max);
        assert!(apart(1) < 0.03 && apart(2) < 0.03, "{shares:?}");
    }

    #[test]
    fn a_plane_that_lies_askew_has_what_a_plane_has() {
        let (along, up) = (Vec3::new(0.8, 0.36, 0.48), Vec3::new(0.0, 0.8, -0.6));
        let askew = sheet([0.001, 0.0, 0.0], [along, up], 12);
        let surroundings = Surroundings::of(&[mesh(&askew, &[])]);
        let middle_m = Vec3::from(askew.positions_m[6 * 13 + 6]) + OFF_CELLS * surroundings.cell_m * along.cross(up);
        let found: f32 =
            surroundings.cells_about(middle_m).unwrap().iter().map(|(cell, share)| share * surroundings.faces[*cell]).sum();
        assert!((found / PLANE - 1.0).abs() < 0.04, "{found}");
    }

    #[test]
    fn a_wound_stands_in_nobodys_way() {
        let [floor, wall] = floor_and_wall(8);
        let raw = vec![1; wall.positions_m.len()];
        assert_eq!(open_at(&floor, &[mesh(&floor, &[]), mesh(&wall, &raw)], [0.0, 0.003]), [1.0; 2]);
    }

    #[test]
    fn what_makes_no_sense_is_left_out_and_the_largest_surface_has_no_more_cells_than_there_may_be() {
        let [floor, wall] = floor_and_wall(8);
        let mut broken = floor.clone();
        broken.positions_m.extend([[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [1e30; 3]]);
        broken.triangles.extend([[0, 1, 81], [1, 2, 82], [2, 3, 83], [0, 1, 999]]);
        let open = Surroundings::of(&[mesh(&broken, &[]), mesh(&wall, &[])]).openness(&mesh(&broken, &[]));
        let sound = Surroundings::of(&[mesh(&floor, &[]), mesh(&wall, &[])]).openness(&mesh(&floor, &[]));
        assert!(open[..81] == sound && open[81..] == [1.0; 3], "{open:?}");
        assert_eq!(Surroundings::of(&[]).openness(&mesh(&floor, &[])), [1.0; 81]);
        let far = Shape { positions_m: vec![[-9.0; 3], [9.0, -9.0, 9.0], [9.0; 3]], triangles: vec![[0, 1, 2]] };
        let wide = Surroundings::of(&[mesh(&far, &[]), mesh(&floor, &[])]);
        assert!(wide.faces.len() <= MOST_CELLS && wide.cell_m > 0.1, "{} cells of {} m", wide.faces.len(), wide.cell_m);
        assert!(wide.openness(&mesh(&far, &[])).iter().all(|open| (0.0..=1.0).contains(open)));
    }
}
