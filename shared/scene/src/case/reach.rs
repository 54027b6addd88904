//! Whether the scope can come to where a goal wants it, within the limits of its scene's hand: the tip into a place, a landmark into the view. What else holds
//! a hand back, the walls and how far it rolls, is not looked at: refused is only what can never be. Where current is warned of is no goal: nobody has to come
//! there, and the loop, which counts there, reaches farther than the tip.
//!
//! The simulated hand takes the largest of the four limits of pitch and yaw for each of them, to either side; so does this. Of a device that is plugged in
//! counts what it states.

use super::brief::{Aim, Brief, Named, Region, sight};
use super::checks::wrong;
use super::file::{Case, Place};
use crate::error::SceneErrorKind as Kind;
use crate::file::{Scene, View, Workspace};
use crate::validate::Checked;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// What rounding may cost: a micrometre, a degree.
const SLACK_M: f64 = 1e-6;
const SLACK_RAD: f64 = 0.02;

/// How far a device brings the tip about the scene's pivot: least and greatest of each, of which the least is not above the greatest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// The pivot.
    pub pivot_m: [f64; 3],
    /// Pitch.
    pub pitch_rad: [f64; 2],
    /// Yaw.
    pub yaw_rad: [f64; 2],
    /// From pivot to tip.
    pub insertion_m: [f64; 2],
}

impl Brief {
    /// What the goals ask for that lies beyond a device, and by how much: a place by its name, a landmark that is seen from no nearer, a growth.
    pub fn beyond(&self, reach: &Reach) -> Vec<String> {
        let mut beyond = Vec::new();
        for Named { words, is } in self.goals.iter().flat_map(|goal| self.asked(&goal.is)) {
            let gap_m = short_m(reach, &is);
            let text = format!("{words} ({:.0} mm)", 1e3 * gap_m);
            if gap_m > SLACK_M && !beyond.contains(&text) {
                beyond.push(text);
            }
        }
        beyond
    }

    /// Where a goal wants the tip.
    fn asked(&self, aim: &Aim) -> Vec<Named<Region>> {
        let near =
            |words: &str, middle_m: [f64; 3], within_m| Named { words: words.to_owned(), is: Region::Ball(middle_m, within_m) };
        match aim {
            Aim::Visit { places, .. } => places.clone(),
            Aim::Look { landmarks, sight, .. } => landmarks.iter().map(|it| near(&it.words, it.is, sight.within_m)).collect(),
            Aim::Removed(_) | Aim::Piece(_) => {
                let within_m = self.pathology_sight.within_m;
                self.pathologies_m.iter().map(|middle_m| near("a growth", *middle_m, within_m)).collect()
            }
            Aim::Pressure { .. } | Aim::Stop { .. } | Aim::Staunch { .. } => Vec::new(),
        }
    }
}

/// How much nearer the tip would have to come, m; not above 0 where it comes.
fn short_m(reach: &Reach, region: &Region) -> f64 {
    match region {
        Region::Ball(centre_m, radius_m) => {
            let away_m = DVec3::from(*centre_m) - DVec3::from(reach.pivot_m);
            nearest_within([reach.pitch_rad, reach.yaw_rad], reach.insertion_m, away_m).1 - radius_m
        }
        Region::Insertion([from_m, to_m]) => (from_m - reach.insertion_m[1]).max(reach.insertion_m[0] - to_m),
    }
}

/// Checks each place whose middle, m, is known: where a goal has it visited the tip can come into it, where one has it looked at its middle can be seen.
pub(crate) fn reachable(case: &Case, scene: &Scene, middle_m: impl Fn(&Place) -> Option<[f64; 3]>) -> Checked {
    let limits = &scene.workspace;
    for (index, place) in case.place.iter().enumerate() {
        let Some(centre_m) = middle_m(place) else { continue };
        let away_m = DVec3::from(centre_m) - DVec3::from(limits.pivot_m);
        let mut surveys = case.goal.iter().filter_map(|goal| goal.look.as_ref()).filter(|look| look.places.contains(&place.name));
        let unseen = surveys.find_map(|look| out_of_sight(limits, &scene.view, away_m, look.within_m));
        let radius_m = place.radius_m.or(place.within_m).unwrap_or_default();
        let unreached = || out_of_reach(limits, away_m, radius_m).filter(|_| is_visited(case, &place.name));
        if let Some(what) = unseen.or_else(unreached) {
            let key = if place.object.is_some() { "object" } else { "centre_m" };
            return wrong(Kind::Contradiction, format!("place[{index}].{key}"), what, "move it, or widen the scene's workspace");
        }
    }
    Ok(())
}

/// Whether a goal has the tip come into a place.
pub(crate) fn is_visited(case: &Case, name: &str) -> bool {
    let mut visits = case.goal.iter().filter_map(|goal| goal.visit.as_ref());
    visits.any(|visit| visit.places.iter().any(|place| place == name))
}

/// How far the hand turns the scope, °: pitch and yaw alike, to either side.
fn tilt_deg(limits: &Workspace) -> f64 {
    limits.pitch_deg.iter().chain(&limits.yaw_deg).fold(0.0_f64, |most, angle| most.max(angle.abs()))
}

/// Why the tip cannot come so near to a point, m from the pivot; `None` where it can.
fn out_of_reach(limits: &Workspace, away_m: DVec3, radius_m: f64) -> Option<String> {
    let (_, gap_m) = nearest(limits, away_m);
    let (tilt_deg, [shortest_m, longest_m]) = (tilt_deg(limits), limits.insertion_m);
    let reach = format!("it reaches {shortest_m} to {longest_m} m, and turns by {tilt_deg}° at most in pitch and yaw");
    (gap_m > radius_m + SLACK_M).then(|| format!("the tip comes no nearer to its middle than {gap_m:.4} m: {reach}"))
}

/// Why a point, m from the pivot, cannot come into the inner half of the picture from so near; `None` where it can.
fn out_of_sight(limits: &Workspace, view: &View, away_m: DVec3, within_m: f64) -> Option<String> {
    let (axis, gap_m) = nearest(limits, away_m);
    if gap_m > within_m + SLACK_M {
        return Some(format!("the tip comes no nearer to it than {gap_m:.4} m, and it is to be looked at within {within_m} m"));
    }
    let [shortest_m, longest_m] = limits.insertion_m;
    let (far_m, along_m) = (away_m.length(), axis.dot(away_m));
    let across_m = away_m.reject_from_normalized(axis).length();
    // The angle between axis and point grows with the insertion and with the tilt away from the point, until the point is beside the tip: the least is where
    // the scope, turned to it as far as it goes, first is near enough. Where it starts behind that, the least is not known, and not above a right angle.
    let first_m = (along_m - (within_m.powi(2) - across_m.powi(2)).max(0.0).sqrt()).clamp(shortest_m, longest_m);
    let least_rad = across_m.atan2(along_m - first_m).min(FRAC_PI_2);
    // Beside what it cannot pass it sees most from the deepest insertion, as far off as may be (law of cosines).
    let cos = (far_m.powi(2) - longest_m.powi(2) - within_m.powi(2)) / (2.0 * longest_m * within_m);
    let most_rad = if far_m > longest_m { cos.clamp(-1.0, 1.0).acos() } else { PI };
    let sight = sight(view, within_m);
    let (from_rad, to_rad) = (sight.optic_rad - sight.within_rad, sight.optic_rad + sight.within_rad);
    let is_seen = least_rad <= to_rad + SLACK_RAD && most_rad >= from_rad - SLACK_RAD;
    let [least, most, from, to] = [least_rad, most_rad, from_rad.max(0.0), to_rad].map(f64::to_degrees);
    let off = format!("it lies {least:.0} to {most:.0}° off the scope's axis");
    (!is_seen).then(|| format!("{off}, and the inner half of the picture shows {from:.0} to {to:.0}°"))
}

/// The scope's axis, a unit vector, that brings the tip nearest to a point, m from the pivot, and how far they are apart then, m.
fn nearest(limits: &Workspace, away_m: DVec3) -> (DVec3, f64) {
    let tilt_rad = tilt_deg(limits).to_radians();
    nearest_within([[-tilt_rad, tilt_rad]; 2], limits.insertion_m, away_m)
}

/// The same of a hand that pitches and yaws within these angles, rad, and goes so far in, m.
fn nearest_within([pitch, yaw]: [[f64; 2]; 2], [shortest_m, longest_m]: [f64; 2], away_m: DVec3) -> (DVec3, f64) {
    // The nearest axis has the yaw of the point, or one of the outermost; of each yaw likewise.
    let candidates = |best_rad: f64, [least, most]: [f64; 2]| [best_rad.clamp(least, most), least, most];
    let axes = candidates(away_m.x.atan2(away_m.z), yaw).into_iter().flat_map(|yaw_rad: f64| {
        let (sin, cos) = yaw_rad.sin_cos();
        let pitch_rad = (-away_m.y).atan2(sin * away_m.x + cos * away_m.z);
        // R_y(yaw) · R_x(pitch) · z, as of a pose.
        let axis = |pitch_rad: f64| DVec3::new(sin * pitch_rad.cos(), -pitch_rad.sin(), cos * pitch_rad.cos());
        candidates(pitch_rad, pitch).map(axis)
    });
    let axis = axes.max_by(|a, b| a.dot(away_m).total_cmp(&b.dot(away_m))).unwrap_or(DVec3::Z);
    (axis, away_m.distance(axis * axis.dot(away_m).clamp(shortest_m, longest_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;

    fn limits() -> Workspace {
        Workspace { pitch_deg: [-20.0, 15.0], yaw_deg: [-25.0, 10.0], insertion_m: [0.01, 0.06], ..Workspace::default() }
    }

    /// Tips and axes of all poses that the hand comes to within the limits, a degree and a millimetre apart.
    fn poses() -> Vec<(DVec3, DVec3)> {
        let wide = |point: [f32; 3]| DVec3::from(point.map(f64::from));
        let mut all = Vec::new();
        for (pitch_deg, yaw_deg) in (-25_i16..=25).flat_map(|pitch| (-25_i16..=25).map(move |yaw| (pitch, yaw))) {
            for insertion_mm in 10_i16..=60 {
                let [pitch_rad, yaw_rad] = [pitch_deg, yaw_deg].map(|deg| f32::from(deg).to_radians());
                let pose = Pose { pitch_rad, yaw_rad, insertion_m: 0.001 * f32::from(insertion_mm), ..Pose::default() };
                all.push((wide(pose.tip_m([0.0; 3])), wide(pose.axis())));
            }
        }
        all
    }

    /// Points on all sides of the pivot.
    fn points() -> Vec<DVec3> {
        let steps = [-0.08, -0.04, 0.0, 0.04, 0.08];
        let of_x = |x: f64| steps.into_iter().flat_map(move |y| steps.into_iter().map(move |z| DVec3::new(x, y, z)));
        steps.into_iter().flat_map(of_x).collect()
    }

    #[test]
    fn no_pose_brings_the_tip_nearer_than_the_nearest() {
        let (limits, poses) = (limits(), poses());
        for point in points() {
            let (_, gap_m) = nearest(&limits, point);
            let found_m = poses.iter().map(|(tip, _)| tip.distance(point)).fold(f64::MAX, f64::min);
            assert!((-1e-6..1e-3).contains(&(found_m - gap_m)), "{point}: {found_m} m, and {gap_m} m");
        }
    }

    #[test]
    fn what_a_pose_sees_is_not_refused() {
        let (limits, poses, within_m) = (limits(), poses(), 0.04);
        for (optic_angle_deg, field_of_view_deg) in [(0.0, 60.0), (30.0, 90.0), (70.0, 90.0)] {
            let view = View { optic_angle_deg, field_of_view_deg, ..View::default() };
            let (mut seen, mut refused) = (0, 0);
            for point in points() {
                let is_refused = out_of_sight(&limits, &view, point, within_m).is_some();
                let is_seen = poses.iter().any(|(tip, axis)| {
                    let line = point - *tip;
                    let far_m = line.length();
                    let off_rad = f64::to_radians(optic_angle_deg) - line.angle_between(*axis);
                    far_m > 0.0 && far_m <= within_m && off_rad.abs() <= f64::to_radians(0.25 * field_of_view_deg)
                });
                assert!(!(is_seen && is_refused), "{optic_angle_deg}°: {point}");
                (seen, refused) = (seen + u32::from(is_seen), refused + u32::from(is_refused));
            }
            assert!(seen > 0 && refused > 0, "{optic_angle_deg}°: {seen} seen, {refused} refused");
        }
    }

    #[test]
    fn what_lies_beside_the_scope_or_straight_ahead_may_never_come_into_the_picture() {
        let default = Workspace::default();
        let refused = |point: DVec3, view: &View| out_of_sight(&default, view, point, 0.025).is_some();
        let (fore_oblique, sideways) = (View::default(), View { optic_angle_deg: 70.0, ..View::default() });
        // At a right angle to the axis at rest, 20 mm from the pivot: 55° off the axis that is turned to it as far as it goes.
        let [beside, ahead] = [DVec3::new(0.02, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.11)];
        assert_eq!([refused(beside, &fore_oblique), refused(beside, &sideways)], [true, false]);
        assert_eq!([refused(ahead, &fore_oblique), refused(ahead, &sideways)], [false, true]);
    }

    /// By hand: the middle of the cavity is a ball of 6 mm about 30 mm, the fundus at 50 mm is looked at from 25 mm, the canal is the first 10 mm.
    #[test]
    fn what_lies_beyond_a_device_is_named_with_how_much_it_lacks() {
        let brief = |case: &str| {
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/cases/{case}.toml"));
            crate::find_case(&path, None).unwrap().unwrap().brief
        };
        let whole = Reach { pivot_m: [0.0; 3], pitch_rad: [-0.6, 0.6], yaw_rad: [-0.6, 0.6], insertion_m: [0.0, 0.1] };
        let navigation = brief("navigation");
        assert_eq!(navigation.beyond(&whole), Vec::<String>::new());
        let named = |reach: Reach| {
            let beyond = navigation.beyond(&reach);
            ["middle (4 mm)", "middle (14 mm)", "fundus (5 mm)", "canal (10 mm)"]
                .map(|name| beyond.iter().any(|text| text == name))
        };
        assert_eq!(named(Reach { insertion_m: [0.0, 0.02], ..whole }), [true, false, true, false]);
        assert_eq!(named(Reach { insertion_m: [0.0, 0.02], pivot_m: [0.0, 0.0, -0.01], ..whole }), [false, true, false, false]);
        assert_eq!(named(Reach { insertion_m: [0.02, 0.1], ..whole }), [false, false, false, true]);
        let ahead = navigation.beyond(&Reach { yaw_rad: [0.0, 0.0], ..whole });
        assert_eq!(ahead[..2], ["free side (1 mm)", "polyp's side (1 mm)"], "6 mm to either side, in balls of 5");
        let shallow = brief("polyp").beyond(&Reach { insertion_m: [0.0, 0.005], ..whole });
        let growths = shallow.iter().filter(|text| text.starts_with("a growth (")).count();
        assert_eq!(growths, 1, "once, though two goals ask for it: {shallow:?}");
    }

    /// A case with a place at an object, and with what it does with that.
    fn case(does: &str) -> Case {
        let head = "version = 1\nname = \"x\"\nrung = \"polyp\"\ntask = \"x\"\nscene = \"x\"";
        let place = "[[place]]\nname = \"there\"\nobject = \"polyp\"\nwithin_m = 0.01";
        toml::from_str(&format!("{head}\n{place}\n{does}\n")).unwrap()
    }

    #[test]
    fn an_object_is_looked_for_where_it_was_drawn() {
        let scene = Scene::embedded_default().unwrap();
        let goals = [("visit", 0.075, true), ("visit", 0.09, false), ("look", 0.09, true), ("look", 0.1, false)];
        for (goal, far_m, is_good) in goals {
            let case = case(&format!("[[goal]]\n{goal} = {{ places = [\"there\"] }}"));
            let found = reachable(&case, &scene, |_| Some([0.0, 0.0, far_m])).map_err(|error| error.key);
            assert_eq!(found, if is_good { Ok(()) } else { Err("place[0].object".to_owned()) }, "{goal} {far_m}");
        }
    }

    #[test]
    fn current_is_warned_of_also_where_the_loop_alone_comes_and_a_place_of_no_goal_is_anywhere() {
        let scene = Scene::embedded_default().unwrap();
        let removes = "[[goal]]\nremoved = { percent = 5.0 }";
        for does in [format!("{removes}\n[[warning]]\ncurrent_in = \"there\""), removes.to_owned()] {
            assert_eq!(reachable(&case(&does), &scene, |_| Some([0.0, 0.0, 0.085])), Ok(()), "{does}");
        }
    }

    #[test]
    fn the_hand_turns_to_either_side_as_far_as_to_the_farthest() {
        let mut scene = Scene::embedded_default().unwrap();
        let visit = case("[[goal]]\nvisit = { places = [\"there\"] }");
        // 50 mm from the pivot, 30° to the patient's right, and posterior: 17 mm from where 10° lead to.
        for middle_m in [[0.025, 0.0, 0.0433], [0.0, -0.025, 0.0433]] {
            (scene.workspace.pitch_deg, scene.workspace.yaw_deg) = ([0.0, 5.0], [-35.0, 10.0]);
            assert_eq!(reachable(&visit, &scene, |_| Some(middle_m)), Ok(()), "{middle_m:?}");
            scene.workspace.yaw_deg = [-10.0, 10.0];
            assert!(reachable(&visit, &scene, |_| Some(middle_m)).is_err(), "{middle_m:?}");
        }
    }
}
