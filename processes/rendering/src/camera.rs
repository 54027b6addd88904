//! Where the picture is taken from: the endoscope's lens at the scope's tip, or an eye outside for developers.
//!
//! Frame: the station's (metres, +z into the uterus, +y anterior, +x to the patient's right). The scope's pose is its tip and a unit
//! quaternion whose +z is the axis. A fore-oblique optic looks along the axis turned by its angle towards the scope's +y. The lens is a
//! radial polynomial of degree 4 in the picture's radius, r (1 + k1 r² + k2 r⁴) / (1 + k1 + k2); with the defaults the rim is drawn,
//! along the radius, at 52 % of the centre's size, as measured for rigid endoscopes.
//!
//! Focus is a thin lens: a point at distance z is seen as a disc of D |1/z - 1/s|, as an angle, if the lens of aperture D is set to s. A rigid
//! 30 degree endoscope is designed at F/6 for objects at 25 mm and +-40 degrees (Zhang et al., Acta Optica Sinica 38, 0222002, 2018); the
//! focal length of 1.2 mm, with which the field of 90 degrees is as wide as the rod lenses of a 4 mm optic, is assumed.
use glam::{Mat4, Quat, Vec3};
use hyst_messages::controls::{FOCUS_M, FOCUS_RANGE_M};

/// The periphery's size over the middle's of the usual optic.
pub const USUAL_PERIPHERY_RATIO: f32 = 0.52;

/// Coefficients of the radial polynomial r·(1 + k₁r² + k₂r⁴) with which the rim stands at `periphery_ratio` of the middle's size: the slope at the rim
/// is the inverse of the ratio times that in the middle.
pub fn distortion(periphery_ratio: f32) -> [f32; 2] {
    /// k₂ over k₁, as the usual optic has it.
    const SECOND: f32 = 0.2857;
    let first = (1.0 / periphery_ratio - 1.0) / (3.0 + 5.0 * SECOND);
    [first, SECOND * first]
}

/// The optic and how it is held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Endoscope {
    /// tip of the scope, m
    pub tip_m: [f32; 3],
    /// unit quaternion (x, y, z, w); its +z is the scope's axis
    pub rotation: [f32; 4],
    /// angle between axis and line of sight, rad; 30° is usual
    pub oblique_rad: f32,
    /// turn of the camera head against the scope, rad, clockwise seen by the surgeon; the notch turns the other way
    pub head_rad: f32,
    /// full angle that the round picture covers, rad
    pub field_of_view_rad: f32,
    /// distortion k1, k2
    pub distortion: [f32; 2],
    /// distance from the lens at which the picture is sharp, m
    pub focus_m: f32,
}

impl Default for Endoscope {
    fn default() -> Self {
        Self {
            tip_m: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
            oblique_rad: 30_f32.to_radians(),
            head_rad: 0.0,
            field_of_view_rad: 90_f32.to_radians(),
            distortion: distortion(USUAL_PERIPHERY_RATIO),
            focus_m: FOCUS_M,
        }
    }
}

/// An eye outside the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct External {
    /// the eye, m
    pub eye_m: [f32; 3],
    /// what it looks at, m
    pub target_m: [f32; 3],
    /// the picture's up, any length
    pub up: [f32; 3],
    /// vertical field of view, rad
    pub field_of_view_rad: f32,
    /// tissue with n·p > d is cut away, so that cavity and tool show; unit n and d in m
    pub clip: Option<([f32; 3], f32)>,
    /// opacity of uncut tissue, 0..=1
    pub tissue_alpha: f32,
}

impl Default for External {
    fn default() -> Self {
        Self {
            eye_m: [0.150, 0.045, 0.035],
            target_m: [0.0, 0.0, 0.022],
            up: [0.0, 1.0, 0.0],
            field_of_view_rad: 35_f32.to_radians(),
            clip: Some(([1.0, 0.0, 0.0], 0.0)),
            tissue_alpha: 1.0,
        }
    }
}

impl External {
    /// The same eye turned by `turn_rad` about the target's vertical and raised by `rise_rad`, at such a share of its distance. The cut stands across the
    /// way to the eye as before, so that it shows what lies behind it.
    pub fn orbited(self, turn_rad: f32, rise_rad: f32, distance: f32) -> External {
        let target = Vec3::from(self.target_m);
        let away = Vec3::from(self.eye_m) - target;
        let turn = Quat::from_rotation_y(turn_rad);
        let level = (turn * Vec3::new(away.x, 0.0, away.z)).normalize_or(Vec3::X);
        let rise = (away.y.atan2(away.x.hypot(away.z)) + rise_rad).clamp(-1.5, 1.5);
        let eye = target + (level * rise.cos() + Vec3::Y * rise.sin()) * away.length() * distance;
        let clip = self.clip.map(|(n, d)| ((turn * Vec3::from(n)).to_array(), d));
        External { eye_m: eye.to_array(), clip, ..self }
    }
}

/// One of the two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// what the surgeon sees
    Endoscope(Endoscope),
    /// what a bystander with X-ray eyes sees
    External(External),
}

/// How a frame is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// where from
    pub camera: Camera,
    /// light of the lamp at the tip, or from outside of the one there: 1 is full
    pub light: f32,
    /// exposure compensation, 1 is what the camera head meters
    pub gain: f32,
    /// how fast metering follows, share per frame 0..=1; 1 is at once
    pub adaptation: f32,
    /// resolution and passes
    pub quality: crate::Quality,
    /// the lines of the meshes over them, from outside and where the device draws lines
    pub has_lines: bool,
    /// the strip of text
    pub overlay: crate::Overlay,
}

impl View {
    /// A view with full light and automatic exposure.
    pub fn new(camera: Camera) -> Self {
        Self {
            camera,
            light: 1.0,
            gain: 1.0,
            adaptation: 0.15,
            quality: crate::Quality::default(),
            has_lines: false,
            overlay: crate::Overlay::default(),
        }
    }
}

/// A camera in the form that the passes use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    pub view_proj: Mat4,
    pub eye_m: Vec3,
    pub light_m: Vec3,
    pub light_axis: Vec3,
    /// from the lamp to what it lights, m; used outside alone
    pub lamp_m: f32,
    pub round: bool,
    pub notch_rad: f32,
    pub distortion: [f32; 2],
    /// what blurs; from outside nothing does
    pub focus: Option<Focus>,
    pub clip: [f32; 4],
    pub tissue_alpha: f32,
}

/// The focus of an eye, for a picture of any size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Focus {
    /// `NEAR_M` over the distance that is sharp, 0..=1
    pub sharp: f32,
    /// radius of the disc of a point, as a share of the picture's side, for each unit that `NEAR_M` over its distance is off `sharp`
    pub spread: f32,
}

/// Aperture of the lens, m.
const APERTURE_M: f32 = 1.2e-3 / 6.0;
/// Nothing nearer is drawn, m: a lens that touches tissue sees red, not the inside of the wall.
pub(crate) const NEAR_M: f32 = 2.0e-4;
/// Nothing farther is drawn, m.
const FAR_M: f32 = 1.0;
/// From the lens to the middle of the light fibres, m, towards the scope's -y.
const LIGHT_OFFSET_M: f32 = 1.3e-3;

impl Camera {
    pub(crate) fn eye(&self, aspect: f32) -> Eye {
        match self {
            Self::Endoscope(scope) => scope.eye(),
            Self::External(outside) => outside.eye(aspect),
        }
    }
}

impl Endoscope {
    fn eye(&self) -> Eye {
        let tip = finite(self.tip_m, Vec3::ZERO);
        let q = Quat::from_array(self.rotation);
        let q = if q.is_finite() && q.length_squared() > 1e-6 { q.normalize() } else { Quat::IDENTITY };
        let oblique = bounded(self.oblique_rad, -1.5, 1.5, 0.5);
        let sight = q * Vec3::new(0.0, oblique.sin(), oblique.cos());
        let up = q * Vec3::new(0.0, oblique.cos(), -oblique.sin());
        let head = bounded(self.head_rad, -1.0e3, 1.0e3, 0.0);
        let up = Quat::from_axis_angle(sight, head) * up;
        let half = 0.5 * bounded(self.field_of_view_rad, 0.2, 2.6, 1.57);
        let proj = glam::camera::rh::proj::directx::perspective(2.0 * half, 1.0, NEAR_M, FAR_M);
        Eye {
            view_proj: proj * glam::camera::rh::view::look_to_mat4(tip, sight, up),
            eye_m: tip,
            light_m: tip - q * Vec3::Y * LIGHT_OFFSET_M,
            light_axis: sight,
            lamp_m: 0.01,
            round: true,
            notch_rad: -head,
            distortion: self.distortion.map(|k| bounded(k, -0.2, 2.0, 0.0)),
            focus: Some(Focus {
                sharp: NEAR_M / bounded(self.focus_m, FOCUS_RANGE_M[0], FOCUS_RANGE_M[1], FOCUS_M),
                spread: 0.25 * APERTURE_M / (NEAR_M * half.tan()),
            }),
            clip: [0.0; 4],
            tissue_alpha: 1.0,
        }
    }
}

impl External {
    fn eye(&self, aspect: f32) -> Eye {
        let target = finite(self.target_m, Vec3::ZERO);
        let mut eye = finite(self.eye_m, Vec3::new(0.2, 0.0, 0.0));
        if eye.distance_squared(target) < 1e-10 {
            eye = target + Vec3::X * 0.1;
        }
        let sight = (target - eye).normalize();
        let mut up = finite(self.up, Vec3::Y);
        if up.cross(sight).length_squared() < 1e-12 {
            up = sight.any_orthogonal_vector();
        }
        let fov = bounded(self.field_of_view_rad, 0.05, 2.6, 0.6);
        let proj =
            glam::camera::rh::proj::directx::perspective(fov, aspect, eye.distance(target) * 0.02, eye.distance(target) * 20.0);
        let right = sight.cross(up).normalize();
        let clip = self.clip.map_or([0.0; 4], |(n, d)| {
            let n = finite(n, Vec3::ZERO).normalize_or_zero();
            [n.x, n.y, n.z, if d.is_finite() { d } else { 0.0 }]
        });
        let distance = eye.distance(target);
        let light = eye + (up.normalize() * 0.45 - right * 0.35) * distance;
        Eye {
            view_proj: proj * glam::camera::rh::view::look_to_mat4(eye, sight, up),
            eye_m: eye,
            light_m: light,
            light_axis: (target - light).normalize(),
            lamp_m: target.distance(light),
            round: false,
            notch_rad: 0.0,
            distortion: [0.0; 2],
            focus: None,
            clip,
            tissue_alpha: bounded(self.tissue_alpha, 0.0, 1.0, 1.0),
        }
    }
}

fn finite(v: [f32; 3], otherwise: Vec3) -> Vec3 {
    let v = Vec3::from(v);
    if v.is_finite() && v.length() < 10.0 { v } else { otherwise }
}

fn bounded(x: f32, low: f32, high: f32, otherwise: f32) -> f32 {
    if x.is_finite() { x.clamp(low, high) } else { otherwise }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projected(eye: &Eye, p: Vec3) -> Vec3 {
        eye.view_proj.project_point3(p)
    }

    #[test]
    fn a_fore_oblique_optic_has_its_line_of_sight_in_the_middle() {
        for degrees in [0.0_f32, 12.0, 30.0, 70.0] {
            let scope = Endoscope { oblique_rad: degrees.to_radians(), tip_m: [0.001, 0.002, 0.03], ..Endoscope::default() };
            let a = degrees.to_radians();
            let ahead = Vec3::from(scope.tip_m) + Vec3::new(0.0, a.sin(), a.cos()) * 0.02;
            let p = projected(&scope.eye(), ahead);
            assert!(p.x.abs() < 1e-4 && p.y.abs() < 1e-4 && (0.0..1.0).contains(&p.z), "{degrees}: {p}");
        }
    }

    #[test]
    fn anterior_is_up_and_the_patients_right_is_on_the_pictures_left() {
        let scope = Endoscope { oblique_rad: 0.0, ..Endoscope::default() };
        let eye = scope.eye();
        assert!(projected(&eye, Vec3::new(0.0, 0.004, 0.02)).y > 0.1);
        assert!(projected(&eye, Vec3::new(0.004, 0.0, 0.02)).x < -0.1);
    }

    #[test]
    fn the_light_post_swings_the_view_and_the_horizon_stays_with_the_head() {
        let half_turn = Quat::from_rotation_z(std::f32::consts::PI).to_array();
        let scope = Endoscope { rotation: half_turn, ..Endoscope::default() };
        let below = Vec3::new(0.0, -0.5, 0.75_f32.sqrt()) * 0.02;
        assert!(projected(&scope.eye(), below).truncate().length() < 1e-4);
        let held = Endoscope { head_rad: std::f32::consts::PI, ..scope };
        assert!(projected(&held.eye(), below + Vec3::Y * 0.003).y > 0.1, "up is up again once the head is turned back");
    }

    #[test]
    fn the_rim_stands_at_the_ratio_of_the_middle() {
        for ratio in [0.3, 0.52, 1.0] {
            let [first, second] = distortion(ratio);
            let slope_at_rim = 1.0 + 3.0 * first + 5.0 * second;
            assert!((1.0 / slope_at_rim - ratio).abs() < 1e-3, "{ratio}: {first} {second}");
        }
    }

    #[test]
    fn a_point_out_of_focus_is_a_disc_as_of_a_thin_lens() {
        // 0.2 mm of aperture, set to 20 mm: a point at 5 mm is a disc of 0.2 (1/5 - 1/20) = 0.03 rad, of the 2 to which the side of 90 degrees
        // stands, so its radius is 0.0075 of the side.
        let focus = Endoscope { focus_m: 0.020, ..Endoscope::default() }.eye().focus.unwrap();
        let radius = |at_m: f32| (NEAR_M / at_m - focus.sharp).abs() * focus.spread;
        assert!((radius(0.005) - 0.0075).abs() < 1e-5 && radius(0.020) < 1e-6, "{focus:?}");
        assert!(radius(1.0) < radius(0.010), "beyond the focus hardly anything is lost");
        assert_eq!(External::default().eye(1.33).focus, None);
    }

    #[test]
    fn an_eye_that_goes_round_looks_at_the_same_point_from_as_far_away_and_over_its_cut() {
        let usual = External::default();
        let target = Vec3::from(usual.target_m);
        for (turn_rad, rise_rad) in [(0.0, 0.0), (1.0, 0.3), (3.0, -0.5), (6.0, 9.0)] {
            let eye = usual.orbited(turn_rad, rise_rad, 0.5);
            let away = Vec3::from(eye.eye_m) - target;
            assert!((away.length() / Vec3::from(usual.eye_m).distance(target) - 0.5).abs() < 1e-4, "{turn_rad}");
            let (normal, _) = eye.clip.unwrap();
            assert!(Vec3::from(normal).dot(away) > 0.0, "{turn_rad}, {rise_rad}: it would look at the half that is left out");
        }
        assert!(Vec3::from(usual.orbited(0.0, 0.0, 1.0).eye_m).distance(Vec3::from(usual.eye_m)) < 1e-6);
    }

    #[test]
    fn no_camera_gives_a_matrix_that_is_not_finite() {
        let bad =
            Endoscope { tip_m: [f32::NAN; 3], rotation: [0.0; 4], field_of_view_rad: f32::INFINITY, ..Endoscope::default() };
        assert!(bad.eye().view_proj.is_finite());
        let bad = External { eye_m: [0.0; 3], target_m: [0.0; 3], up: [1.0, 0.0, 0.0], ..External::default() };
        assert!(bad.eye(1.33).view_proj.is_finite());
    }
}
