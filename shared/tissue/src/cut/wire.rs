//! Where the wire was in the tissue. Between two ticks both move: what the wire has cut through is what it was swept past in the tissue, so each
//! of its points is kept by the tet that it was in, and carried along.

use super::{Cuttable, DMat3, DVec3, at, corners, to_single};

/// A point of the wire, as the tissue saw it last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seat {
    /// The tet that it was in; `u32::MAX` for none.
    pub tet: u32,
    /// Weights of the tet's corners.
    pub weights: [f32; 4],
    /// Where it was, m: outside of the tissue it stays there.
    pub point_m: [f32; 3],
}

/// No tet.
const OUTSIDE: u32 = u32::MAX;

impl Cuttable {
    /// Where the points of the wire are now that the tissue has moved, m.
    pub(super) fn carried_wire(&self) -> Vec<[f32; 3]> {
        let carried = |seat: &Seat| {
            let tet = self.rest.tets.get(seat.tet as usize)?;
            let parts = corners(&self.position_m, *tet).into_iter().zip(seat.weights);
            let point = parts.map(|(corner, weight)| corner * f64::from(weight)).sum::<DVec3>();
            point.is_finite().then(|| to_single(point))
        };
        self.wire.iter().map(|seat| carried(seat).unwrap_or(seat.point_m)).collect()
    }

    /// Remembers where the wire is.
    pub(super) fn seat_wire(&mut self, wire: &[[f32; 3]]) {
        self.wire = wire.iter().map(|point| self.seat(*point)).collect();
    }

    fn seat(&self, point_m: [f32; 3]) -> Seat {
        let point = at(&[point_m], 0);
        let around = |tet: &[u32; 4]| {
            let low = tet.iter().map(|node| at(&self.position_m, *node)).fold(DVec3::MAX, DVec3::min);
            let high = tet.iter().map(|node| at(&self.position_m, *node)).fold(DVec3::MIN, DVec3::max);
            low.cmple(point).all() && high.cmpge(point).all()
        };
        let near = self.rest.tets.iter().enumerate().filter(|(_, tet)| around(tet));
        let mut inside = near.filter_map(|(index, tet)| Some((index, weights_in(corners(&self.position_m, *tet), point)?)));
        match inside.next() {
            Some((tet, weights)) => Seat { tet: tet as u32, weights, point_m },
            None => Seat { tet: OUTSIDE, weights: [0.0; 4], point_m },
        }
    }
}

/// The weights of the corners, if the point is inside.
fn weights_in([a, b, c, d]: [DVec3; 4], point: DVec3) -> Option<[f32; 4]> {
    let weights = DMat3::from_cols(b - a, c - a, d - a).inverse() * (point - a);
    let first = 1.0 - weights.element_sum();
    let all = [first, weights.x, weights.y, weights.z];
    all.iter().all(|weight| *weight >= 0.0).then(|| all.map(|weight| weight as f32))
}
