//! How the medium moves, as the Flow Engine's staggered grid has it (Harlow and Welch 1965): what carries the flakes in it.
//!
//! Promise: a place in a solid or outside of the grid has no velocity, nor has one beside a number that is none.
use glam::Vec3;

/// Velocities on a staggered grid, borrowed for the call alone.
#[derive(Debug, Clone, Copy)]
pub struct FlowField<'a> {
    /// cells along x, y, z
    pub dims: [u32; 3],
    /// lowest corner of the grid's box, m
    pub min_m: [f32; 3],
    /// edges of a cell, m
    pub spacing_m: [f32; 3],
    /// velocity along x, y and z on the low face of each cell, m/s, x fastest; on the high face of the last cell it is 0
    pub velocity_m_s: [&'a [f32]; 3],
    /// what each cell is, x fastest: 0 is medium, anything else solid
    pub solid: &'a [u8],
}

impl FlowField<'_> {
    /// Whether each cell has its values, and an extent.
    pub(crate) fn is_sound(&self) -> bool {
        let cells = self.dims.iter().try_fold(1_usize, |product, &count| product.checked_mul(count as usize));
        let lengths = self.velocity_m_s.map(<[f32]>::len);
        let has_values = cells.is_some_and(|cells| cells > 0 && self.solid.len() == cells && lengths == [cells; 3]);
        has_values && self.spacing_m.iter().all(|edge_m| edge_m.is_finite() && *edge_m > 0.0)
    }

    /// The shortest edge of a cell, m.
    pub(crate) fn edge_m(&self) -> f32 {
        Vec3::from_array(self.spacing_m).min_element()
    }

    /// Whether a place, m, lies in a cell of the medium.
    pub(crate) fn is_medium(&self, place_m: Vec3) -> bool {
        let place = self.in_cells(place_m);
        let [nx, ny, nz] = self.dims.map(|count| count as usize);
        let ends = Vec3::new(nx as f32, ny as f32, nz as f32);
        let is_inside = place.cmpge(Vec3::ZERO).all() && place.cmplt(ends).all();
        let [i, j, k] = place.to_array().map(|cells| cells as usize);
        is_inside && self.solid.get((k * ny + j) * nx + i).is_some_and(|solid| *solid == 0)
    }

    /// Velocity at a place, m: trilinear between the faces, m/s. `None` in a solid, outside of the grid, and beside what is no number.
    pub(crate) fn velocity_at(&self, place_m: Vec3) -> Option<Vec3> {
        if !self.is_medium(place_m) {
            return None;
        }
        let place = self.in_cells(place_m).to_array();
        let velocity_m_s = Vec3::from_array(std::array::from_fn(|component| self.component_at(component, place)));
        velocity_m_s.is_finite().then_some(velocity_m_s)
    }

    /// A place in cells, of which the first spans 0 to 1.
    fn in_cells(&self, place_m: Vec3) -> Vec3 {
        (place_m - Vec3::from_array(self.min_m)) / Vec3::from_array(self.spacing_m)
    }

    /// One component at a place in cells within the grid, m/s. Its faces lie at whole numbers along its own axis, at halves along the others.
    fn component_at(&self, component: usize, place: [f32; 3]) -> f32 {
        // The faces before and after the place along each axis, and their weights.
        let [along_x, along_y, along_z]: [[(usize, f32); 2]; 3] = std::array::from_fn(|axis| {
            let at = if axis == component { place[axis] } else { place[axis] - 0.5 };
            let (low, count) = (at.floor(), self.dims[axis] as f32);
            [(low, 1.0 - (at - low)), (low + 1.0, at - low)].map(|(index, weight)| {
                // The high face of the last cell is on the box's wall, where nothing moves; beyond the last centre all is as there.
                let is_wall = axis == component && index >= count;
                if is_wall { (0, 0.0) } else { (index.clamp(0.0, count - 1.0) as usize, weight) }
            })
        });
        let faces = self.velocity_m_s[component];
        let [nx, ny, _] = self.dims.map(|count| count as usize);
        let mut sum = 0.0;
        for (k, weight_z) in along_z {
            for (j, weight_y) in along_y {
                for (i, weight_x) in along_x {
                    let face = faces.get((k * ny + j) * nx + i).copied().unwrap_or(f32::NAN);
                    sum += weight_x * weight_y * weight_z * face;
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five by four by six cells of 1, 2 and 1.5 mm from a corner on, whose faces have the velocities of a function of their place in cells.
    fn faces(of: impl Fn(Vec3) -> Vec3) -> [Vec<f32>; 3] {
        std::array::from_fn(|component| {
            let on_face = |cell: usize| {
                let mut place = Vec3::new((cell % 5) as f32, (cell / 5 % 4) as f32, (cell / 20) as f32) + 0.5;
                place[component] -= 0.5;
                of(place)[component]
            };
            (0..120).map(on_face).collect()
        })
    }

    fn field<'a>(velocity: &'a [Vec<f32>; 3], solid: &'a [u8]) -> FlowField<'a> {
        let velocity_m_s = velocity.each_ref().map(Vec::as_slice);
        FlowField { dims: [5, 4, 6], min_m: [-0.002, 0.001, 0.010], spacing_m: [0.001, 0.002, 0.0015], velocity_m_s, solid }
    }

    fn place_m(cells: Vec3) -> Vec3 {
        Vec3::new(-0.002, 0.001, 0.010) + cells * Vec3::new(0.001, 0.002, 0.0015)
    }

    #[test]
    fn between_faces_a_velocity_that_grows_evenly_is_met() {
        let of = |cells: Vec3| Vec3::new(0.01 * cells.x + 0.02 * cells.z, 0.03 - 0.01 * cells.y, 0.005 * cells.x * cells.y);
        let (velocity, solid) = (faces(of), [0_u8; 120]);
        let field = field(&velocity, &solid);
        assert!(field.is_sound() && (field.edge_m() - 0.001).abs() < 1e-9);
        for cells in [Vec3::new(1.0, 1.5, 2.25), Vec3::new(2.7, 2.1, 3.9), Vec3::new(3.999, 2.5, 4.999), Vec3::splat(0.5)] {
            let found = field.velocity_at(place_m(cells)).unwrap();
            assert!(found.distance(of(cells)) < 1e-5, "{cells}: {found} and {}", of(cells));
        }
        // Half a cell before the box's wall, on which nothing goes through.
        let before_wall = field.velocity_at(place_m(Vec3::new(4.5, 1.5, 2.5))).unwrap();
        assert!((before_wall.x - 0.5 * of(Vec3::new(4.0, 1.5, 2.5)).x).abs() < 1e-5, "{before_wall}");
    }

    #[test]
    fn solids_what_is_outside_and_what_is_no_number_have_no_velocity() {
        let (mut velocity, mut solid) = (faces(|_| Vec3::ONE), [0_u8; 120]);
        solid[20 + 5 + 2] = 7; // cell 2, 1, 1
        let inside = place_m(Vec3::new(2.5, 1.5, 1.5));
        assert!(!field(&velocity, &solid).is_medium(inside) && field(&velocity, &solid).velocity_at(inside).is_none());
        let beside = place_m(Vec3::new(1.5, 1.5, 1.5));
        assert!(field(&velocity, &solid).velocity_at(beside).is_some_and(|found| found.distance(Vec3::ONE) < 1e-6));
        for outside in [Vec3::splat(-0.1), Vec3::new(2.0, 4.0, 1.0), Vec3::NAN, Vec3::splat(1e30), Vec3::INFINITY] {
            assert_eq!(field(&velocity, &solid).velocity_at(place_m(outside)), None, "{outside}");
        }
        for wild in [f32::NAN, f32::INFINITY] {
            velocity[1][20 + 5 + 1] = wild; // the low face of cell 1, 1, 1
            assert_eq!(field(&velocity, &solid).velocity_at(beside), None);
        }
    }

    #[test]
    fn a_field_whose_numbers_contradict_each_other_is_none() {
        let (velocity, solid) = (faces(|_| Vec3::ONE), [0_u8; 120]);
        let good = field(&velocity, &solid);
        let wrong = [
            FlowField { dims: [5, 4, 7], ..good },
            FlowField { dims: [u32::MAX; 3], ..good },
            FlowField { dims: [0, 4, 6], velocity_m_s: [&[]; 3], solid: &[], ..good },
            FlowField { solid: &solid[1..], ..good },
            FlowField { velocity_m_s: [good.velocity_m_s[0], &[], good.velocity_m_s[2]], ..good },
            FlowField { spacing_m: [0.001, 0.0, 0.001], ..good },
            FlowField { spacing_m: [0.001, f32::NAN, 0.001], ..good },
        ];
        assert!(good.is_sound() && wrong.iter().all(|field| !field.is_sound()));
    }
}
