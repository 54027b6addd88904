//! The instrument, and its collision points. Its own frame: tip at the origin, shaft along −z.

use crate::electrode::{LoadedLoop, electrode};
use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::instrument::{Rigid, RigidKind, Tip};
use crate::jaws::{LoadedJaws, load_jaws};
use crate::object::{MAX_TRIANGLES, unreadable};
use crate::source::Folder;
use crate::spread::{Spread, spread};
use glam::Vec3;
use hyst_mesh::TriangleMesh;

/// Share of the points that lie on the tip: it touches first and most often, so it is sampled about ten times as densely as the shaft.
const TIP_SHARE: f64 = 0.4;
/// Exponent that draws the shaft's points towards the tip.
const SHAFT_CROWDING: f64 = 1.5;
/// How much more densely the tip of a surface from a file is sampled than its shaft, and how far the tip goes back, in radii.
const TIP_DENSITY: f64 = 10.0;
const TIP_RADII: f32 = 1.0;
/// How far the foremost point of a surface from a file may be from the tip.
const TIP_SLACK_M: f32 = 1e-4;

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
    /// The unit vectors out of it there.
    pub outward: Vec<[f32; 3]>,
    /// Its surface, if it has one from a file.
    pub surface: Option<TriangleMesh>,
    /// The loop electrode, if it has one.
    pub electrode: Option<LoadedLoop>,
    /// Its jaws, if it has some.
    pub jaws: Option<LoadedJaws>,
}

impl LoadedRigid {
    /// How far its working element goes: a loop out, or jaws apart; 0 if it has neither.
    pub fn element_m(&self) -> f32 {
        let jaws_m = self.jaws.as_ref().map_or(0.0, |jaws| jaws.opening_m);
        self.electrode.as_ref().map_or(jaws_m, |electrode| electrode.reach_m)
    }
}

/// Reads an instrument.
pub(crate) fn load_rigid(
    rigid: &Rigid,
    index: usize,
    folder: &Folder,
    notes: &mut Vec<String>,
) -> Result<LoadedRigid, SceneError> {
    let key = format!("rigid[{index}]");
    let surface = match &rigid.mesh {
        Some(file) => Some(whole(rigid, file, &format!("{key}.mesh"), folder, notes)?),
        None => None,
    };
    let jaws = match &rigid.jaws {
        Some(jaws) => Some(load_jaws(jaws, &key, folder, notes)?),
        None => None,
    };
    let (points_m, outward) = match &surface {
        Some(surface) => on_surface(rigid, surface),
        None => collision_points(rigid),
    };
    Ok(LoadedRigid {
        name: rigid.name.clone(),
        kind: rigid.kind,
        tip: rigid.tip,
        radius_m: (rigid.diameter_m / 2.0) as f32,
        length_m: rigid.length_m as f32,
        collision_length_m: rigid.collision_length_m as f32,
        points_m,
        outward,
        surface,
        electrode: if jaws.is_none() { electrode(rigid) } else { None },
        jaws,
    })
}

/// The triangles of a file in metres.
pub(crate) fn read_surface(
    file: &str,
    scale_to_m: f64,
    key: &str,
    folder: &Folder,
    notes: &mut Vec<String>,
) -> Result<TriangleMesh, SceneError> {
    let (bytes, shown) = folder.mesh(key, file)?;
    let mut surface = hyst_mesh::read_triangles(&shown, &bytes).map_err(|error| unreadable(&error, key, &shown))?;
    let count = surface.triangles.len();
    if count > MAX_TRIANGLES {
        let what = format!("has {count} triangles, at most {MAX_TRIANGLES} are drawn");
        return Err(SceneError::new(Kind::TooLarge, key, what, "make it coarser").at(&shown));
    }
    surface.positions_m.as_flattened_mut().iter_mut().for_each(|place| *place *= scale_to_m as f32);
    let open = hyst_mesh::open_edges(&surface.triangles);
    if open > 0 {
        notes.push(format!("{shown}: the surface is not closed, {open} of its edges have one triangle only"));
    }
    Ok(surface)
}

/// The surface of a whole instrument: it ends at the tip, and is as thick and as long as an instrument.
fn whole(rigid: &Rigid, file: &str, key: &str, folder: &Folder, notes: &mut Vec<String>) -> Result<TriangleMesh, SceneError> {
    let surface = read_surface(file, rigid.scale_to_m, key, folder, notes)?;
    let foremost_m = surface.positions_m.iter().map(|place| place[2]).fold(f32::MIN, f32::max);
    let widest_m = surface.positions_m.iter().map(|place| place[0].hypot(place[1])).fold(0.0, f32::max);
    let longest_m = surface.positions_m.iter().map(|place| -place[2]).fold(0.0, f32::max);
    let refused = |what: String, cure: &str| Err(SceneError::new(Kind::Size, key, what, cure).at(file));
    if foremost_m.abs() > TIP_SLACK_M {
        let what = format!("its foremost point is at z = {foremost_m:.3e} m, and the tip is at z = 0");
        return refused(what, "move it so that it ends at z = 0, its shaft along -z, and set scale_to_m");
    }
    if widest_m > 0.1 || longest_m > 1.0 || longest_m < rigid.diameter_m as f32 {
        let what = format!("it reaches {widest_m:.3e} m to the side and {longest_m:.3e} m back");
        return refused(what, "set scale_to_m: an instrument is at most 1 m long and 0.1 m wide, and longer than its diameter");
    }
    Ok(surface)
}

/// Points on a surface, as far back as it can touch.
fn on_surface(rigid: &Rigid, surface: &TriangleMesh) -> Spread {
    let (tip_m, last_m) = (TIP_RADII * (rigid.diameter_m / 2.0) as f32, rigid.collision_length_m as f32);
    spread(surface, rigid.points, |middle: Vec3| match -middle.z {
        behind_m if behind_m <= tip_m => TIP_DENSITY,
        behind_m if behind_m <= last_m => 1.0,
        _ => 0.0,
    })
}

/// The collision points of an instrument without a surface of its own, and the unit vectors out of it there: `points` of them, the same for the same table.
pub fn collision_points(rigid: &Rigid) -> Spread {
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
    let points_m: Vec<[f32; 3]> = tip.chain(shaft).collect();
    let outward = points_m.iter().map(|point| outward_at(rigid, Vec3::from(*point)).to_array()).collect();
    (points_m, outward)
}

/// Out of the shaft at one of its points: a capsule, or a cylinder with a flat end.
fn outward_at(rigid: &Rigid, point: Vec3) -> Vec3 {
    let middle_z = match rigid.tip {
        Tip::Round => point.z.min(-(rigid.diameter_m / 2.0) as f32),
        Tip::Flat if point.z >= 0.0 => return Vec3::Z,
        Tip::Flat => point.z,
    };
    (point - Vec3::Z * middle_z).normalize_or_zero()
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

    fn scope(tip: Tip) -> Rigid {
        let mut rigid: Rigid = toml::from_str("name = \"scope\"").unwrap();
        rigid.tip = tip;
        rigid
    }

    #[test]
    fn points_lie_on_the_capsule_and_the_tip_is_the_densest_part() {
        let (points, outward) = collision_points(&scope(Tip::Round));
        assert_eq!((points.len(), outward.len()), (400, 400));
        assert_eq!((points[0], outward[0]), ([0.0; 3], [0.0, 0.0, 1.0]));
        for (point, outward) in points.iter().zip(&outward) {
            let axis = Vec3::new(0.0, 0.0, point[2].min(-0.0025));
            assert!((Vec3::from(*point).distance(axis) - 0.0025).abs() < 1e-6, "{point:?}");
            let out = (Vec3::from(*point) - axis) / 0.0025;
            assert!(out.distance(Vec3::from(*outward)) < 1e-3, "{point:?} {outward:?}");
            assert!(point[2] <= 0.0 && point[2] >= -0.0351, "{point:?}");
        }
        let tip = points.iter().filter(|point| point[2] > -0.0025).count();
        assert_eq!(tip, 160);
    }
}
