//! The gas that a loop under current makes of the medium around it.

use crate::tools::out_m;
use glam::{Quat, Vec3};
use hyst_flow::GasSource;
use hyst_messages::HardwareSample;
use hyst_scene::LoadedLoop;

/// Gas that a loop under current makes, ml/s. Assumed; no published figure is used. Twenty parcels a second are seen as a string of bubbles.
const GAS_ML_S: f32 = 0.02;
/// Gas that one makes which coagulates, ml/s. Assumed: a quarter, since it dries tissue at less than the power that keeps up an arc.
const COAGULATION_ML_S: f32 = 0.005;

/// Where gas comes into being: at the middle of the loop, which is out and under current.
pub fn source(electrode: Option<&LoadedLoop>, sample: &HardwareSample) -> GasSource {
    let (controls, pose) = (&sample.controls, &sample.pose);
    let live = electrode.filter(|_| controls.has_current());
    let Some((electrode, out_m)) = live.and_then(|electrode| Some((electrode, out_m(electrode, controls)?))) else {
        return GasSource::default();
    };
    let middle = Vec3::new(0.0, electrode.radius_m, out_m);
    let place = Vec3::from(pose.position_m) + Quat::from_array(pose.orientation) * middle;
    let flow_ml_s = if controls.coagulates() { COAGULATION_ML_S } else { GAS_ML_S };
    GasSource { position_m: place.to_array(), flow_ml_s }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED};

    #[test]
    fn a_loop_boils_the_medium_where_it_is_while_it_is_out_and_under_current() {
        let scene = hyst_scene::load_embedded().unwrap();
        let electrode = scene.rigid[0].electrode.as_ref();
        let mut sample = HardwareSample::default();
        // A quarter turn about the scope's axis: the loop stands to −x.
        sample.pose.orientation = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2).to_array();
        sample.pose.position_m = [0.001, 0.002, 0.03];
        sample.controls.loop_extension_m = 0.01;
        sample.controls.buttons = BUTTON_ENERGIZED | BUTTON_EXTENDED;
        let gas = source(electrode, &sample);
        let radius_m = electrode.unwrap().radius_m;
        assert!(Vec3::from(gas.position_m).distance(Vec3::new(0.001 - radius_m, 0.002, 0.04)) < 1e-6, "{gas:?}");
        assert_eq!(gas.flow_ml_s, GAS_ML_S);
        sample.controls.buttons = BUTTON_COAGULATING | BUTTON_EXTENDED;
        assert_eq!(source(electrode, &sample), GasSource { flow_ml_s: COAGULATION_ML_S, ..gas });
        assert_eq!(source(None, &sample), GasSource::default(), "an instrument without a loop");
        for (buttons, extension_m) in [(BUTTON_EXTENDED, 0.01), (BUTTON_ENERGIZED, 0.01), (3, 0.0005), (3, f32::NAN)] {
            (sample.controls.buttons, sample.controls.loop_extension_m) = (buttons, extension_m);
            assert_eq!(source(electrode, &sample), GasSource::default(), "{buttons} {extension_m}");
        }
    }
}
