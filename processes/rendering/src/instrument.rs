//! The instrument on the stage: its shaft, where the hardware says that it is; on the shaft hang its loop electrode, on whose ring hang the arms, or its jaws.

use crate::scenery::Refused;
use glam::Quat;
use hyst_messages::stream::ScopeRecord;
use hyst_messages::{BUTTON_ENERGIZED, HardwareSample, Message, WireError};
use rendering::shapes::Shape;
use rendering::{Appearance, Material, RenderError, Stage, SurfaceMesh, shapes};

/// The tool's id on the stage, beyond all registration numbers.
pub const TOOL: u64 = 1 << 32;
/// Those of its loop electrode: the ring, which is bare and glows with current in it, and the arms, which are not.
const RING: u64 = TOOL + 1;
const ARMS: u64 = TOOL + 2;
/// Those of its jaws: on the side of +x, and of -x.
const JAWS: [u64; 2] = [TOOL + 5, TOOL + 6];
/// All of them.
#[cfg(test)]
pub const IDS: [u64; 5] = [TOOL, RING, ARMS, JAWS[0], JAWS[1]];
/// Length of the arms, m: farther than any loop reaches, so that they end in the sheath, behind the lens.
const ARM_M: f32 = 0.06;
/// A loop that is in lies this far behind the tip, in the sheath, m: behind the lens as well.
const SHEATHED_M: f32 = 0.02;
/// Vertices of wounds after which all but a third of a loop is crusted: one stroke makes some twenty to forty (assumed).
const CRUSTING_VERTICES: f32 = 40.0;
/// The scope until the tissue has said what the scene's is: 5 mm, 30° fore-oblique, and no loop.
const USUAL: ScopeRecord = ScopeRecord {
    oblique_rad: std::f32::consts::FRAC_PI_6,
    field_of_view_rad: std::f32::consts::FRAC_PI_2,
    periphery_ratio: rendering::USUAL_PERIPHERY_RATIO,
    light: 1.0,
    shaft_radius_m: 0.0025,
    shaft_length_m: 0.3,
    loop_radius_m: 0.0,
    loop_wire_radius_m: 0.0,
};

/// What is drawn of the instrument.
#[derive(Debug)]
pub struct Instrument {
    /// How it sees.
    pub scope: ScopeRecord,
    /// Surfaces from files: of the shaft, and of the jaw on the side of +x, closed.
    shaft: Shape,
    jaw: Shape,
    /// From the jaws' hinge to their tips, m.
    jaw_length_m: f32,
    /// Whether the loop is drawn as one with current in it.
    is_hot: bool,
    /// How much burnt tissue clings to it.
    eschar: f32,
}

/// The surfaces from files that a topology brings; `None` if its sections contradict each other, or a number is not finite.
fn surfaces(topology: &Message<'_>) -> Result<Option<[Shape; 2]>, WireError> {
    let (positions_m, triangles): (&[[f32; 3]], &[[u32; 3]]) = (topology.section(8)?, topology.section(9)?);
    let of_shaft: &[u32] = topology.section(10)?;
    let &[vertices, faces] = of_shaft else { return Ok(None) };
    let parts = positions_m.split_at_checked(vertices as usize).zip(triangles.split_at_checked(faces as usize));
    let is_finite = positions_m.as_flattened().iter().all(|value| value.is_finite());
    Ok(parts.filter(|_| is_finite).map(|((shaft_m, jaw_m), (of_shaft, of_jaw))| {
        [(shaft_m, of_shaft), (jaw_m, of_jaw)]
            .map(|(positions_m, triangles)| Shape { positions_m: positions_m.to_vec(), triangles: triangles.to_vec() })
    }))
}

/// The mirror image on the other side of x = 0.
fn mirrored(shape: &Shape) -> Shape {
    Shape {
        positions_m: shape.positions_m.iter().map(|[x, y, z]| [-x, *y, *z]).collect(),
        triangles: shape.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
    }
}

/// Where the loop's ring is, m before the tip, when it has gone out so far.
fn ring_m(extension_m: f32) -> f32 {
    if extension_m > 0.0 { extension_m.min(ARM_M) } else { -SHEATHED_M }
}

/// How much burnt tissue clings to a loop in a scene with these wounds: 1 for each surface vertex on one. What it has cut is all there, so that a rendering
/// that is restarted shows the same.
fn crust(raw: &[u32]) -> f32 {
    let cut = raw.iter().filter(|raw| **raw != 0).count();
    1.0 - (-(cut as f32) / CRUSTING_VERTICES).exp()
}

/// How far a jaw of a length is turned when the tips are so far apart, rad.
fn turn_rad(apart_m: f32, length_m: f32) -> f32 {
    if apart_m > 0.0 && length_m > 0.0 { (apart_m / (2.0 * length_m)).min(1.0).asin() } else { 0.0 }
}

impl Instrument {
    /// The usual one, on a stage.
    pub fn new(stage: &mut Stage) -> Result<Instrument, RenderError> {
        let mut instrument = Instrument {
            scope: USUAL,
            shaft: Shape::default(),
            jaw: Shape::default(),
            jaw_length_m: 0.0,
            is_hot: false,
            eschar: 0.0,
        };
        instrument.set(stage)?;
        Ok(instrument)
    }

    /// Takes over what the tissue says of its optic and its loop.
    pub fn dress(&mut self, stage: &mut Stage, scope: ScopeRecord) -> Result<(), RenderError> {
        if std::mem::replace(&mut self.scope, scope) != scope {
            self.set(stage)?;
        }
        Ok(())
    }

    /// Takes over what a topology's wounds leave on the loop, and the surfaces that it brings; those of one that makes no sense are left out.
    pub fn rebuild(&mut self, stage: &mut Stage, topology: &Message<'_>) -> Result<(), Refused> {
        let eschar = crust(topology.section(6)?);
        if std::mem::replace(&mut self.eschar, eschar).to_bits() != eschar.to_bits() && self.scope.loop_radius_m > 0.0 {
            stage.set_appearance(RING, self.wire())?;
        }
        let Some([shaft, jaw]) = surfaces(topology)? else { return Ok(()) };
        if (&self.shaft, &self.jaw) != (&shaft, &jaw) {
            self.jaw_length_m = jaw.positions_m.iter().map(|place| place[2]).fold(0.0, f32::max);
            (self.shaft, self.jaw) = (shaft, jaw);
            self.set(stage)?;
        }
        Ok(())
    }

    fn set(&mut self, stage: &mut Stage) -> Result<(), RenderError> {
        self.is_hot = false;
        let scope = &self.scope;
        let metal = Appearance::of(Material::Metal);
        let rod = shapes::scope(scope.shaft_radius_m, scope.shaft_length_m, scope.oblique_rad);
        let shaft = if self.shaft.triangles.is_empty() { &rod } else { &self.shaft };
        put(stage, TOOL, None, shaft, Appearance { external_only: true, ..metal })?;
        if scope.loop_radius_m > 0.0 {
            let (radius_m, wire_m) = (scope.loop_radius_m, scope.loop_wire_radius_m);
            put(stage, RING, Some(TOOL), &shapes::loop_ring(radius_m, wire_m), self.wire())?;
            put(stage, ARMS, Some(RING), &shapes::loop_arms(radius_m, wire_m, ARM_M), insulation())?;
        } else {
            stage.remove_object(RING); // and the arms with it
        }
        if self.jaw.triangles.is_empty() {
            for jaw in JAWS {
                stage.remove_object(jaw);
            }
            return Ok(());
        }
        put(stage, JAWS[0], Some(TOOL), &self.jaw, metal)?;
        put(stage, JAWS[1], Some(TOOL), &mirrored(&self.jaw), metal)
    }

    /// Puts it where the hardware says that it is, with all that hangs on it; a loop that cuts glows (one that coagulates keeps up no arc), and jaws that hold
    /// something are as far apart as when they took hold of it, `hold_m`.
    pub fn hold(&mut self, stage: &mut Stage, sample: &HardwareSample, hold_m: f32) -> Result<(), RenderError> {
        let (pose, controls) = (&sample.pose, &sample.controls);
        stage.set_pose(TOOL, pose.position_m, pose.orientation)?;
        if !self.jaw.triangles.is_empty() {
            let opened_rad = turn_rad(controls.loop_extension_m.max(hold_m), self.jaw_length_m);
            for (jaw, opened_rad) in JAWS.into_iter().zip([opened_rad, -opened_rad]) {
                stage.set_pose(jaw, [0.0; 3], Quat::from_rotation_y(opened_rad).to_array())?;
            }
        }
        if self.scope.loop_radius_m <= 0.0 {
            return Ok(());
        }
        stage.set_pose(RING, [0.0, 0.0, ring_m(controls.loop_extension_m)], Quat::IDENTITY.to_array())?;
        let is_hot = controls.buttons & BUTTON_ENERGIZED != 0 && controls.loop_extension_m > 0.0;
        if std::mem::replace(&mut self.is_hot, is_hot) != is_hot {
            stage.set_appearance(RING, self.wire())?;
        }
        Ok(())
    }

    /// Tungsten wire that has cut before: dull, or each facet of so thin a wire would glint for itself.
    fn wire(&self) -> Appearance {
        let glow = if self.is_hot { 1.0 } else { 0.0 };
        Appearance { roughness: 0.85, glow, eschar: self.eschar, ..Appearance::of(Material::Metal) }
    }
}

/// What the arms are sheathed in.
fn insulation() -> Appearance {
    Appearance { base_colour: [0.80, 0.78, 0.62], roughness: 0.9, ..Appearance::of(Material::Metal) }
}

/// Puts a part on the stage, where it hangs on another one or on none.
fn put(stage: &mut Stage, id: u64, on: Option<u64>, shape: &Shape, appearance: Appearance) -> Result<(), RenderError> {
    stage.set_object(id, SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw: &[], appearance })?;
    stage.hang(id, on)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_loop_that_is_in_lies_in_the_sheath_and_one_that_is_out_before_the_tip() {
        assert_eq!([0.0, 0.000_03, 0.012, 9.0].map(ring_m), [-SHEATHED_M, 0.000_03, 0.012, ARM_M]);
        assert_eq!(ring_m(f32::NAN), -SHEATHED_M);
    }

    #[test]
    fn a_loop_is_crusted_the_more_the_more_it_has_cut() {
        let after = |cut: usize| crust(&[vec![0_u32; 900], vec![1; cut]].concat());
        assert_eq!([crust(&[]), after(0)], [0.0, 0.0]);
        let [first, many] = [30, 600].map(after);
        assert!(0.3 < first && first < 0.7 && 0.99 < many && many <= 1.0, "{first} {many}");
    }

    #[test]
    fn jaws_are_turned_until_their_tips_are_as_far_apart_as_it_is_said() {
        for apart_m in [0.0, 0.004, 0.008] {
            let tip = Quat::from_rotation_y(turn_rad(apart_m, 0.009)) * Vec3::new(0.0, 0.0, 0.009);
            assert!((2.0 * tip.x - apart_m).abs() < 1e-6, "{apart_m}: {tip}");
        }
        assert_eq!([f32::NAN, -1.0].map(|apart_m| turn_rad(apart_m, 0.009)), [0.0, 0.0]);
        assert!(turn_rad(1.0, 0.009) <= std::f32::consts::FRAC_PI_2 && turn_rad(0.004, 0.0) == 0.0);
    }

    #[test]
    fn the_other_jaw_is_a_mirror_image_and_not_inside_out() {
        let jaw = shapes::ball([0.002, 0.0, 0.004], 0.001, 8, 12);
        let volume6 = |shape: &Shape| -> f32 {
            let place = |vertex: u32| Vec3::from(shape.positions_m[vertex as usize]);
            shape.triangles.iter().map(|[a, b, c]| place(*a).dot(place(*b).cross(place(*c)))).sum()
        };
        let other = mirrored(&jaw);
        assert!(volume6(&jaw) > 0.0 && (volume6(&other) / volume6(&jaw) - 1.0).abs() < 1e-4);
        assert!(other.positions_m.iter().all(|place| place[0] < 0.0));
    }
}
