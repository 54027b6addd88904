//! The instrument's collision points. Its own frame: tip at the origin, shaft along −z.

use crate::electrode::LoadedLoop;
use crate::file::{Rigid, RigidKind, Tip};

/// Share of the points that lie on the tip: it touches first and most often, so it is sampled about ten times as densely as the shaft.
const TIP_SHARE: f64 = 0.4;
/// Exponent that draws the shaft's points towards the tip.
const SHAFT_CROWDING: f64 = 1.5;

/// Where medium flows out at an instrument, in its radii: so far behind its tip, through the outer sheath, and within so much of there.
pub const OUTFLOW_RADII: [f32; 2] = [4.0, 2.0];

/// An instrument, ready for collision.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedRigid {
    /// Its name in the scene.
    pub name: String,
    /// What it is.
    pub kind: RigidKind,
    /// Form of its tip.
    pub tip: Tip,
    /// Half its outer diameter.
    pub radius_m: f32,
    /// Length that is drawn.
    pub length_m: f32,
    /// Length behind the tip that carries points.
    pub collision_length_m: f32,
    /// Collision points, the foremost one at the origin.
    pub points_m: Vec<[f32; 3]>,
    /// The loop electrode, if it has one.
    pub electrode: Option<LoadedLoop>,
}

/// The collision points of an instrument: `points` of them, the same for the same table.
pub fn collision_points(rigid: &Rigid) -> Vec<[f32; 3]> {
    let radius_m = rigid.diameter_m / 2.0;
    let golden_rad = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let on_tip = ((f64::from(rigid.points) * TIP_SHARE) as u32).max(1);
    let on_shaft = rigid.points - on_tip;
    let point = |radius_m: f64, behind_m: f64, index: u32| {
        let (sin, cos) = (golden_rad * f64::from(index)).sin_cos();
        [(radius_m * cos) as f32, (radius_m * sin) as f32, -behind_m as f32]
    };
    let tip = (0..on_tip).map(|index| {
        let share = f64::from(index) / f64::from(on_tip);
        match rigid.tip {
            // Equal steps along the axis are equal areas on a sphere.
            Tip::Round => point(radius_m * (1.0 - (1.0 - share).powi(2)).sqrt(), radius_m * share, index),
            Tip::Flat => point(radius_m * share.sqrt(), 0.0, index),
        }
    });
    let start_m = shoulder_m(rigid);
    let shaft = (0..on_shaft).map(|index| {
        let share = f64::from(index) / f64::from(on_shaft.max(2) - 1);
        point(radius_m, start_m + (rigid.collision_length_m - start_m) * share.powf(SHAFT_CROWDING), on_tip + index)
    });
    tip.chain(shaft).collect()
}

/// How far behind the tip the shaft has its full radius.
fn shoulder_m(rigid: &Rigid) -> f64 {
    match rigid.tip {
        Tip::Round => rigid.diameter_m / 2.0,
        Tip::Flat => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn scope(tip: Tip) -> Rigid {
        let mut rigid: Rigid = toml::from_str("name = \"scope\"").unwrap();
        rigid.tip = tip;
        rigid
    }

    #[test]
    fn points_lie_on_the_capsule_and_the_tip_is_the_densest_part() {
        let points = collision_points(&scope(Tip::Round));
        assert_eq!(points.len(), 400);
        assert_eq!(points[0], [0.0; 3]);
        for point in &points {
            let axis = Vec3::new(0.0, 0.0, point[2].min(-0.0025));
            assert!((Vec3::from(*point).distance(axis) - 0.0025).abs() < 1e-6, "{point:?}");
            assert!(point[2] <= 0.0 && point[2] >= -0.0351, "{point:?}");
        }
        let tip = points.iter().filter(|point| point[2] > -0.0025).count();
        assert_eq!(tip, 160);
    }
}
