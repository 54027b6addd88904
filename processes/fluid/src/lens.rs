//! Where the lens looks, for how far one sees: some rays that stand for equal shares of its round picture.

use glam::{Quat, Vec3};
use hyst_flow::StateView;
use hyst_messages::HardwareSample;
use hyst_scene::LoadedScene;

/// Rings about the middle ray: how far out in the picture, as a share of its radius, and how many rays. With the one in the middle each stands for a thirteenth
/// of the picture: four for what lies within 0.62 of its radius around that, eight for the rest, each at the mean of the squares of its ring's ends.
const RINGS: [(f32, usize); 2] = [(0.48, 4), (0.83, 8)];
/// All rays.
const RAYS: usize = 1 + RINGS[0].1 + RINGS[1].1;
/// The least share of the light that is told: a view in which nothing is seen is none of which nothing is known.
const LEAST_SHARE: f32 = 1e-6;
/// The square of the length of what may be a unit quaternion of a driver that is not careful. Of a device that has measured nothing yet it is 0.
const UNIT: std::ops::RangeInclusive<f32> = 0.5..=2.0;

/// An optic.
pub struct Lens {
    /// Its rays in the frame of the scope, unit vectors.
    rays: [Vec3; RAYS],
}

/// Where it looks at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaze {
    eye_m: [f32; 3],
    rays: [[f32; 3]; RAYS],
}

impl Lens {
    /// That of a scene: fore-oblique towards the scope's +y. The lens's distortion is left out: a ray's angle goes as its place in the picture.
    pub fn of(scene: &LoadedScene) -> Lens {
        let view = &scene.scene.view;
        let (oblique_rad, half_rad) =
            (view.optic_angle_deg.to_radians() as f32, 0.5 * view.field_of_view_deg.to_radians() as f32);
        let turn = Quat::from_rotation_x(-oblique_rad);
        let ray = |off_rad: f32, around_rad: f32| {
            let (sin, cos) = off_rad.sin_cos();
            turn * Vec3::new(sin * around_rad.cos(), sin * around_rad.sin(), cos)
        };
        let mut rays = [ray(0.0, 0.0); RAYS];
        let of_ring = |(share, count): (f32, usize)| (0..count).map(move |at| (share, at as f32 / count as f32));
        for (place, (share, around)) in rays[1..].iter_mut().zip(RINGS.into_iter().flat_map(of_ring)) {
            *place = ray(share * half_rad, std::f32::consts::TAU * around);
        }
        Lens { rays }
    }

    /// Where it looks from the scope's pose; `None` if that is none.
    pub fn gaze(&self, sample: &HardwareSample) -> Option<Gaze> {
        let turn = Quat::from_array(sample.pose.orientation);
        let is_pose = UNIT.contains(&turn.length_squared()) && sample.pose.position_m.iter().all(|place| place.is_finite());
        is_pose.then(|| {
            let turn = turn.normalize();
            Gaze { eye_m: sample.pose.position_m, rays: self.rays.map(|ray| (turn * ray).to_array()) }
        })
    }
}

impl Gaze {
    /// What a status says of the light before the lens: above 0 to 1, and 0 where the lens is in no medium.
    pub fn told(&self, view: &StateView<'_>) -> f32 {
        view.transmittance(self.eye_m, &self.rays).map_or(0.0, |share| share.max(LEAST_SHARE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_flow::{EXTINCTION_PER_M, FlowInputs, FlowModel, Grid, Port, PumpInput, SIGHT_M, Solver};

    /// The lens at a place, the scope turned so.
    fn sample(position_m: [f32; 3], turn: Quat) -> HardwareSample {
        let mut sample = HardwareSample::default();
        (sample.pose.position_m, sample.pose.orientation) = (position_m, turn.to_array());
        sample
    }

    fn lens(optic_angle_deg: f64) -> Lens {
        let mut scene = hyst_scene::load_embedded().unwrap();
        scene.scene.view = hyst_scene::View { optic_angle_deg, field_of_view_deg: 90.0, ..scene.scene.view };
        Lens::of(&scene)
    }

    #[test]
    fn a_fore_oblique_lens_looks_up_and_its_rays_lie_evenly_in_its_field() {
        let gaze = lens(30.0).gaze(&sample([0.0; 3], Quat::IDENTITY)).unwrap();
        let middle = Vec3::new(0.0, 0.5, 0.75_f32.sqrt());
        assert!(Vec3::from(gaze.rays[0]).distance(middle) < 1e-6, "{:?}", gaze.rays[0]);
        let off_deg = gaze.rays.map(|ray| Vec3::from(ray).angle_between(middle).to_degrees());
        for (off_deg, exact) in off_deg[1..].iter().zip([21.6; 4].into_iter().chain([37.35; 8])) {
            assert!((off_deg - exact).abs() < 0.05, "{off_deg}° of {exact}°");
        }
        let mean = gaze.rays.iter().map(|ray| Vec3::from(*ray)).sum::<Vec3>().normalize();
        assert!(mean.distance(middle) < 1e-5, "as many on each side: {mean}");
        // The light post swings the view.
        let half_turn = Quat::from_rotation_z(std::f32::consts::PI);
        let swung = lens(30.0).gaze(&sample([0.0; 3], half_turn)).unwrap();
        assert!(Vec3::from(swung.rays[0]).distance(Vec3::new(0.0, -0.5, middle.z)) < 1e-6, "{:?}", swung.rays[0]);
    }

    #[test]
    fn a_pose_that_is_none_has_no_gaze() {
        let (lens, good) = (lens(30.0), sample([0.0, 0.0, 0.03], Quat::IDENTITY));
        assert!(lens.gaze(&good).is_some());
        let bad: [fn(&mut HardwareSample); 4] = [
            |sample| sample.pose.orientation = [0.0; 4], // nothing was measured yet
            |sample| sample.pose.orientation = [f32::NAN; 4],
            |sample| sample.pose.orientation[2] = f32::INFINITY,
            |sample| sample.pose.position_m[1] = f32::NAN,
        ];
        for spoil in bad {
            let mut sample = good;
            spoil(&mut sample);
            assert_eq!(lens.gaze(&sample), None, "{:?}", sample.pose);
        }
    }

    /// Dye flows for a second into a box, half of it before the lens.
    #[test]
    fn what_a_lens_tells_is_what_the_solvers_blood_lets_through_and_in_a_wall_it_tells_nothing() {
        let grid = Grid::new([12; 3], [4e-3; 3], [0.0; 3]).unwrap();
        let solver = Solver::new(FlowModel::new(grid), 1).unwrap();
        let port = |x: f32, inflow| Port { centre_m: [x, 0.024, 0.024], radius_m: 0.024, share: 1.0, inflow, ..Port::default() };
        let mut inputs = FlowInputs { dt_s: 0.033, ..FlowInputs::default() };
        (inputs.ports[0], inputs.ports[1]) = (Port { dye: 0.5, ..port(2e-3, true) }, port(0.046, false));
        inputs.pump = PumpInput {
            inflow_valve: 1.0,
            outflow_valve: 1.0,
            set_pa: 9_000.0,
            flow_limit_ml_min: 800.0,
            ..PumpInput::default()
        };
        let mut block = vec![0u64; solver.state_bytes() / 8];
        let straight = lens(0.0).gaze(&sample([0.024, 0.024, 0.01], Quat::IDENTITY)).unwrap();
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        assert_eq!(straight.told(&StateView::new(bytemuck::cast_slice(&block)).unwrap()), 1.0, "no blood");
        for _ in 0..30 {
            solver.step_serial(&inputs).unwrap();
        }
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
        let most = view.density().iter().copied().fold(0.0, f32::max);
        let told = straight.told(&view);
        let least = (-EXTINCTION_PER_M * SIGHT_M * most).exp();
        assert!(told < 0.99 && told >= 0.99 * least, "{told}, at least {least}");
        assert_eq!(lens(0.0).gaze(&sample([-1.0, 0.0, 0.0], Quat::IDENTITY)).unwrap().told(&view), 0.0, "not in the medium");
    }
}
