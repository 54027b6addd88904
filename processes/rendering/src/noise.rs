//! Solid noise that tiles, from which the passes make glands, vessels and mottling. Made when this crate is built (`build.rs`), from no asset
//! and no clock: making it takes longer than all else of a start, and a rendering that is replaced is to be back in half a second.
//!
//! Gradient noise after Perlin, "Improving noise" (SIGGRAPH 2002), with a hash of our own on a lattice that wraps around.

use crate::hash::hash;

/// Texels per axis of a solid.
pub(crate) const SIDE: usize = 64;

/// Levels of a solid: each half as wide as the one before, down to a texel.
pub(crate) const LEVELS: usize = SIDE.ilog2() as usize + 1;

/// A solid and all its levels one after the other: each texel is the mean of eight of the level before, so that what is finer than a pixel is grey there and no
/// grain.
pub(crate) fn with_levels(texels: Vec<u8>) -> Vec<u8> {
    let (mut out, mut side, mut begin) = (texels, SIDE, 0);
    for _ in 1..LEVELS {
        let half = side / 2;
        let mut level = Vec::with_capacity(half * half * half * 4);
        for texel in 0..half * half * half {
            let at = [texel % half, texel / half % half, texel / (half * half)];
            for channel in 0..4 {
                let corner = |k: usize| {
                    let [x, y, z] = [2 * at[0] + (k & 1), 2 * at[1] + (k >> 1 & 1), 2 * at[2] + (k >> 2)];
                    i32::from(out[begin + 4 * ((z * side + y) * side + x) + channel] as i8)
                };
                let sum: i32 = (0..8).map(corner).sum();
                level.push((sum as f32 / 8.0).round() as i8 as u8);
            }
        }
        begin = out.len();
        side = half;
        out.extend(level);
    }
    out
}

/// Four fields per texel, each in -1..=1 as a signed byte: vessels, capillaries' spread, mottling, breaks.
pub(crate) fn fields() -> Vec<u8> {
    let octaves: [&[(u32, f32)]; 4] =
        [&[(4, 0.8), (8, 0.3)], &[(3, 0.7), (9, 0.55)], &[(3, 0.7), (6, 0.4), (14, 0.25)], &[(5, 0.9), (11, 0.3)]];
    let mut out = vec![0_u8; SIDE * SIDE * SIDE * 4];
    for (channel, parts) in octaves.iter().enumerate() {
        for (texel, value) in solid(parts, channel as u32 * 7_919).iter().enumerate() {
            out[texel * 4 + channel] = signed_byte(*value * 1.5);
        }
    }
    out
}

/// Slope (x, y, z) and height of a glandular surface, each in -1..=1 as a signed byte.
pub(crate) fn relief() -> Vec<u8> {
    let mut height = solid(&[(8, 0.9), (16, 0.35)], 101);
    for h in &mut height {
        *h = 1.0 - 3.0 * h.abs(); // billows: rounded glands with furrows between them
    }
    let at = |x: usize, y: usize, z: usize| height[(z % SIDE * SIDE + y % SIDE) * SIDE + x % SIDE];
    let mut out = Vec::with_capacity(SIDE * SIDE * SIDE * 4);
    for z in 0..SIDE {
        for y in 0..SIDE {
            for x in 0..SIDE {
                let slope = [
                    at(x + 1, y, z) - at(x + SIDE - 1, y, z),
                    at(x, y + 1, z) - at(x, y + SIDE - 1, z),
                    at(x, y, z + 1) - at(x, y, z + SIDE - 1),
                ];
                out.extend(slope.map(|s| signed_byte(s * 0.8)));
                out.push(signed_byte(at(x, y, z) * 0.8));
            }
        }
    }
    out
}

fn signed_byte(x: f32) -> u8 {
    (x.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8
}

fn solid(octaves: &[(u32, f32)], seed: u32) -> Vec<f32> {
    let mut out = vec![0.0; SIDE * SIDE * SIDE];
    for &(cells, weight) in octaves {
        let lattice = Lattice::new(cells, seed);
        for (texel, value) in out.iter_mut().enumerate() {
            let place = [texel % SIDE, texel / SIDE % SIDE, texel / (SIDE * SIDE)];
            *value += weight * lattice.noise(place.map(|i| i as f32 / SIDE as f32));
        }
    }
    out
}

/// A hash per node of a lattice that wraps around, made once: hashing per texel would be most of the start-up.
struct Lattice {
    cells: u32,
    hashes: Vec<u32>,
}

impl Lattice {
    fn new(cells: u32, seed: u32) -> Self {
        let node = |i: u32| [i % cells, i / cells % cells, i / (cells * cells)];
        let hashes = (0..cells.pow(3)).map(|i| hash(node(i), seed ^ cells)).collect();
        Self { cells, hashes }
    }

    /// Noise at `p` in the unit cube.
    fn noise(&self, p: [f32; 3]) -> f32 {
        let q = p.map(|c| c * self.cells as f32);
        let base = q.map(|c| c as u32);
        let f = [0, 1, 2].map(|a| q[a] - base[a] as f32);
        let ease = f.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
        let mut sum = 0.0;
        for corner in 0..8_u32 {
            let bit = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let [x, y, z] = [0, 1, 2].map(|a| (base[a] + bit[a]) % self.cells);
            let away = [0, 1, 2].map(|a| f[a] - bit[a] as f32);
            let share = |a: usize| if bit[a] == 1 { ease[a] } else { 1.0 - ease[a] };
            let hash = self.hashes[((z * self.cells + y) * self.cells + x) as usize];
            sum += share(0) * share(1) * share(2) * slope(hash, away);
        }
        sum
    }
}

/// One of the twelve edge directions of a cube, dotted with `v`.
fn slope(h: u32, v: [f32; 3]) -> f32 {
    let (a, b) = match h % 3 {
        0 => (v[0], v[1]),
        1 => (v[1], v[2]),
        _ => (v[2], v[0]),
    };
    (if h & 0x100 == 0 { a } else { -a }) + (if h & 0x200 == 0 { b } else { -b })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solid_wraps_without_a_seam() {
        for cells in [3, 8] {
            let lattice = Lattice::new(cells, 5);
            let inside = lattice.noise([0.999_99, 0.3, 0.7]);
            let outside = lattice.noise([0.0, 0.3, 0.7]);
            assert!((inside - outside).abs() < 1e-3, "{cells}: {inside} {outside}");
        }
    }

    #[test]
    fn the_relief_slopes_as_its_heights_rise() {
        let relief = relief();
        let at = |x: usize, channel: usize| f32::from(relief[4 * (SIDE * 7 + x) + channel] as i8);
        let rises = (1..SIDE - 1).filter(|x| (at(x + 1, 3) - at(x - 1, 3)).abs() > 8.0);
        let (alike, all) = rises.fold((0, 0), |(alike, all), x| {
            let is_alike = (at(x + 1, 3) - at(x - 1, 3)) * at(x, 0) > 0.0;
            (alike + usize::from(is_alike), all + 1)
        });
        assert!(all > 10 && alike == all, "{alike} of {all}");
    }

    /// The last level is the mean of the whole, and the levels lie one after the other without a gap.
    #[test]
    fn each_level_holds_the_means_of_the_one_before() {
        let solid = relief();
        let mean = |channel: usize| {
            let values = solid.iter().skip(channel).step_by(4).map(|byte| f64::from(*byte as i8));
            values.sum::<f64>() / (solid.len() / 4) as f64
        };
        let means: Vec<f64> = (0..4).map(mean).collect();
        let levels = with_levels(solid.clone());
        assert_eq!(levels.len(), 4 * (0..LEVELS).map(|level| (SIDE >> level).pow(3)).sum::<usize>());
        assert_eq!(levels[..solid.len()], solid[..]);
        for (channel, mean) in means.iter().enumerate() {
            let last = f64::from(levels[levels.len() - 4 + channel] as i8);
            assert!((last - mean).abs() < 3.5, "channel {channel}: {last} for {mean}");
        }
    }

    #[test]
    fn each_field_is_balanced_and_varied() {
        let fields = fields();
        for channel in 0..4 {
            let values: Vec<f32> = fields.iter().skip(channel).step_by(4).map(|&b| f32::from(b as i8) / 127.0).collect();
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt();
            assert!(mean.abs() < 0.15 && spread > 0.2, "channel {channel}: mean {mean}, spread {spread}");
        }
    }
}
