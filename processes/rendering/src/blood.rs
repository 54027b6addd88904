//! The colour of blood in saline: what it takes of red, green and blue on its way, and what it scatters back. How much of it is drawn says [`hyst_flow::EXTINCTION_PER_M`].
//!
//! Absorption is that of oxygenated haemoglobin, 150 g/l as in whole blood of a haematocrit of 45 % (Prahl, "Tabulated molar extinction coefficient for
//! hemoglobin in water", 1999; 2.303 e x / 64 500), over bands of 20 nm (standard deviation) about 610, 540 and 460 nm, which stand for a camera's
//! three colours (assumed): of a layer that lets the e-th part of a band through 0.90, 19.9 and 25.0 to the millimetre. What scatters counts by its reduced
//! coefficient, for red cells scatter nearly all light ahead: 1.6 to the millimetre in all three (Bosschaart et al., Lasers in Medical Science 29, 2014;
//! from memory).

/// Extinction of undiluted blood, 1/m: red, green, blue.
const WHOLE_PER_M: [f32; 3] = [2_500.0, 21_500.0, 26_600.0];

/// Extinction of red, green and blue light, of that of green.
pub(crate) const SPECTRUM: [f32; 3] = [WHOLE_PER_M[0] / WHOLE_PER_M[1], 1.0, WHOLE_PER_M[2] / WHOLE_PER_M[1]];

/// What much blood gives back of the light that falls upon it, red, green, blue: that of a half space of albedo w that scatters to all sides alike, lit and
/// seen squarely, w H² / 8, with H = 3 / (1 + 2 √(1 - w)) (Hapke 1981).
pub(crate) const LIT: [f32; 3] = [0.150, 0.0098, 0.0079];

#[cfg(test)]
mod tests {
    use super::*;

    /// Reduced scattering, 1/mm.
    const SCATTERING_PER_MM: f64 = 1.6;
    /// Prahl's table: nm, and cm⁻¹/(mol/l) of oxygenated haemoglobin.
    const HBO2: [(f64, f64); 24] = [
        (430.0, 246_072.0),
        (440.0, 102_580.0),
        (450.0, 62_816.0),
        (460.0, 44_480.0),
        (470.0, 33_209.2),
        (480.0, 26_629.2),
        (490.0, 23_684.4),
        (500.0, 20_932.8),
        (510.0, 20_035.2),
        (520.0, 24_202.4),
        (530.0, 39_956.8),
        (540.0, 53_236.0),
        (550.0, 43_016.0),
        (560.0, 32_613.2),
        (570.0, 44_496.0),
        (580.0, 50_104.0),
        (590.0, 14_400.8),
        (600.0, 3_200.0),
        (610.0, 1_506.0),
        (620.0, 942.0),
        (630.0, 610.0),
        (640.0, 442.0),
        (650.0, 368.0),
        (660.0, 319.6),
    ];

    /// Absorption of a band, 1/mm: of the layer that lets the e-th part of it through.
    fn absorption_per_mm(middle_nm: f64) -> f64 {
        let passes = |layer_mm: f64| {
            let of = |&(nm, e): &(f64, f64)| {
                let weight = (-0.5 * ((nm - middle_nm) / 20.0_f64).powi(2)).exp();
                [weight * (-2.303 * e * 150.0 / 64_500.0 / 10.0 * layer_mm).exp(), weight]
            };
            let [left, all] = HBO2.iter().map(of).fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
            left / all
        };
        let (mut thin, mut thick) = (0.0, 10.0);
        for _ in 0..60 {
            let layer_mm = 0.5 * (thin + thick);
            if passes(layer_mm) > (-1.0_f64).exp() { thin = layer_mm } else { thick = layer_mm }
        }
        1.0 / thin
    }

    #[test]
    fn what_is_drawn_is_what_the_view_is_judged_by() {
        assert_eq!(hyst_flow::EXTINCTION_PER_M, 0.125 * WHOLE_PER_M[1], "an eighth is drawn");
    }

    #[test]
    fn extinction_and_colour_are_those_of_haemoglobin_and_red_cells() {
        for (channel, middle_nm) in [610.0, 540.0, 460.0].into_iter().enumerate() {
            let extinction_per_mm = absorption_per_mm(middle_nm) + SCATTERING_PER_MM;
            let written_per_mm = 1e-3 * f64::from(WHOLE_PER_M[channel]);
            assert!((written_per_mm / extinction_per_mm - 1.0).abs() < 0.02, "{middle_nm} nm: {extinction_per_mm} to the mm");
            let albedo = SCATTERING_PER_MM / extinction_per_mm;
            let lit = albedo * (3.0 / (1.0 + 2.0 * (1.0 - albedo).sqrt())).powi(2) / 8.0;
            assert!((f64::from(LIT[channel]) / lit - 1.0).abs() < 0.02, "{middle_nm} nm: {lit} comes back");
        }
    }
}
