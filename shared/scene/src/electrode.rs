//! The loop electrode, ready to cut. The instrument's frame: tip at the origin, shaft along −z.

use crate::instrument::Rigid;

/// Pieces of the half ring: their middles lie half a hundredth of its radius inside it.
const PIECES: u32 = 16;

/// A loop electrode.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedLoop {
    /// Radius of the half ring, to the middle of the wire.
    pub radius_m: f32,
    /// Half the wire's diameter.
    pub wire_radius_m: f32,
    /// How far the ring stands before the tip when it is out.
    pub reach_m: f32,
    /// The half ring at extension 0: 17 points from +x over +y to −x.
    pub wire_m: Vec<[f32; 3]>,
}

impl LoadedLoop {
    /// The half ring when it has gone out so far.
    pub fn wire_at(&self, extension_m: f32) -> impl Iterator<Item = [f32; 3]> + '_ {
        self.wire_m.iter().map(move |&[x, y, z]| [x, y, z + extension_m])
    }
}

/// The loop of an instrument; `None` if the scene says so, or where the shaft is too thin for one.
pub(crate) fn electrode(rigid: &Rigid) -> Option<LoadedLoop> {
    let given = &rigid.electrode;
    let radius_m = given.radius_m.unwrap_or(rigid.diameter_m / 2.0 - given.wire_m);
    if given.reach_m <= 0.0 || radius_m < given.wire_m {
        return None;
    }
    let point = |index: u32| {
        let (sin, cos) = (std::f64::consts::PI * f64::from(index) / f64::from(PIECES)).sin_cos();
        [(radius_m * cos) as f32, (radius_m * sin) as f32, 0.0]
    };
    Some(LoadedLoop {
        radius_m: radius_m as f32,
        wire_radius_m: (given.wire_m / 2.0) as f32,
        reach_m: given.reach_m as f32,
        wire_m: (0..=PIECES).map(point).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Option<LoadedLoop> {
        electrode(&toml::from_str(&format!("name = \"scope\"\n{text}")).unwrap())
    }

    #[test]
    fn an_instrument_has_a_half_ring_that_fits_its_shaft_and_stands_to_plus_y() {
        let found = of("").unwrap();
        assert_eq!((found.radius_m, found.wire_radius_m, found.reach_m), (0.0022, 0.000_15, 0.012));
        assert_eq!(found.wire_m.len(), 17);
        for [x, y, z] in found.wire_at(0.005) {
            assert!((x.hypot(y) - 0.0022).abs() < 1e-9 && y > -1e-9 && z == 0.005, "{x} {y} {z}");
        }
        assert!((found.wire_m[0][0] - 0.0022).abs() < 1e-9 && (found.wire_m[8][1] - 0.0022).abs() < 1e-9);
    }

    #[test]
    fn the_scene_says_how_large_it_is_or_that_there_is_none() {
        let given = of("loop = { radius_m = 0.004, wire_m = 0.0005, reach_m = 0.02 }").unwrap();
        assert_eq!((given.radius_m, given.wire_radius_m, given.reach_m), (0.004, 0.000_25, 0.02));
        assert_eq!(of("loop = { reach_m = 0.0 }"), None);
        assert_eq!(of("diameter_m = 0.001"), None, "too thin");
    }
}
