//! Golden pictures: what the passes make of eight fixed stages, at a low resolution, beside what they made when somebody last looked at it.
//!
//! Compared are the mean colours of blocks, within a tolerance: another driver, which rounds otherwise and puts an edge half a pixel aside, passes; a light
//! that is off, a tool, a wound, a cloud that is missing does not. `HYSTATION_GOLDEN=write` writes the pictures anew, to be looked at before they are kept.
mod stand;

use rendering::{
    Appearance, Bubbles, Camera, Endoscope, External, FluidField, Gpu, Material, Prefer, Renderer, SurfaceMesh, View,
    shapes::{self, Shape},
};
use stand::*;
use std::path::PathBuf;

const SIZE_PX: [usize; 2] = [96, 72];
/// Side of a block, px.
const BLOCK: usize = 4;
/// What a picture may be apart from the golden one, of 255: the mean over all blocks and colours, and the block of which 99 in 100 are nearer.
/// The smooth edges of a GPU come to 0.5 and 13, and what is missing to twice the tolerance at least (the tests print both).
const TOLERANCE: Apart = Apart { mean: 1.0, p99: 16.0 };
const POLYP: u64 = 3;
const ARMS: u64 = 4;
const GAS: u64 = 5;

/// A picture: sets the stage, whole or without what the picture is about.
struct Still {
    name: &'static str,
    set: fn(&mut Renderer, bool) -> View,
}

const STILLS: [Still; 8] = [
    Still { name: "cavity", set: cavity },
    Still { name: "contact", set: contact },
    Still { name: "wound", set: wound },
    Still { name: "myoma", set: myoma },
    Still { name: "blood", set: blood },
    Still { name: "chip", set: chip },
    Still { name: "external", set: external },
    Still { name: "oblique", set: oblique },
];

fn walls(r: &mut Renderer) -> Shape {
    let shape = shapes::cavity(0.045, 40, 48);
    put(r, CAVITY, &shape, Material::MucosaTissue);
    shape
}

/// The cavity with a polyp; or with the light off.
fn cavity(r: &mut Renderer, is_whole: bool) -> View {
    walls(r);
    put(r, POLYP, &shapes::ball([0.004, -0.003, 0.032], 0.003, 16, 24), Material::Polyp);
    View { light: if is_whole { 1.0 } else { 0.0 }, ..through_scope() }
}

/// The loop, with current in it, presses into the wall; or the wall is pressed by nothing.
fn contact(r: &mut Renderer, is_whole: bool) -> View {
    let mut pressed = walls(r).positions_m;
    for [x, y, z] in pressed.iter_mut().filter(|point| point[1] > 0.0) {
        let far = (*x / 0.004).powi(2) + ((*z - 0.028) / 0.004).powi(2);
        *y += 0.0015 * (1.0 - far).max(0.0);
    }
    r.stage().update_positions(CAVITY, &pressed).expect("as many as before");
    if is_whole {
        put(r, TOOL, &shapes::loop_ring(0.003, 0.0004), Material::Metal);
        put(r, ARMS, &shapes::loop_arms(0.003, 0.0004, 0.06), Material::Metal);
        r.stage().set_appearance(TOOL, Appearance { glow: 1.0, ..Appearance::of(Material::Metal) }).expect("it is there");
        for part in [TOOL, ARMS] {
            r.stage().set_pose(part, [0.0, 0.0045, 0.028], [0.0, 0.0, 0.0, 1.0]).expect("it is there");
        }
    }
    through_scope()
}

/// A wound across the upper wall, and coagulated spots on the lower one and on a growth; or neither.
fn wound(r: &mut Renderer, is_whole: bool) -> View {
    let shape = walls(r);
    let is_cut = |[x, y, z]: [f32; 3]| is_whole && y > 0.001 && x.abs() < 0.005 && (0.018..0.036).contains(&z);
    let raw: Vec<u32> = shape.positions_m.iter().map(|point| u32::from(is_cut(*point))).collect();
    let appearance = Appearance::of(Material::MucosaTissue);
    let mesh = SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw: &raw, appearance };
    r.stage().set_object(CAVITY, mesh).expect("a sound mesh");
    put(r, POLYP, &shapes::ball([-0.004, -0.003, 0.030], 0.0025, 16, 24), Material::Polyp);
    // Twice as wide as the largest about a vessel, so that they fill blocks of the picture.
    let all_m = [[0.003, -0.0063, 0.024, 0.004], [-0.003, -0.0062, 0.022, 0.004], [-0.0034, -0.0025, 0.0276, 0.004]];
    let spots_m: &[[f32; 4]] = if is_whole { &all_m } else { &[] };
    for id in [CAVITY, POLYP] {
        r.stage().set_spots(id, spots_m).expect("it is there");
    }
    through_scope()
}

/// A myoma that is laid open on one side; or a polyp that is whole in its place.
fn myoma(r: &mut Renderer, is_whole: bool) -> View {
    walls(r);
    let growth = shapes::ball([0.001, -0.003, 0.030], 0.0045, 32, 48);
    let raw: Vec<u32> = growth.positions_m.iter().map(|point| u32::from(is_whole && point[0] > 0.001)).collect();
    let appearance = Appearance::of(if is_whole { Material::Myoma } else { Material::Polyp });
    let mesh = SurfaceMesh { triangles: &growth.triangles, rest_m: &growth.positions_m, raw: &raw, appearance };
    r.stage().set_object(POLYP, mesh).expect("a sound mesh");
    through_scope()
}

/// Blood clouds the left half; or the medium is clear.
fn blood(r: &mut Renderer, is_whole: bool) -> View {
    let view = cavity(r, true);
    let density: Vec<f32> = (0..16 * 16 * 16).map(|cell: usize| if cell % 16 >= 8 { 1.0 } else { 0.0 }).collect();
    let [min_m, max_m] = [[-0.016, -0.01, 0.015], [0.016, 0.01, 0.045]];
    let field = FluidField { dims: [16; 3], min_m, max_m, density: &density, extinction_per_m: 120.0 };
    r.set_fluid(is_whole.then_some(field)).expect("a sound field");
    view
}

/// A chip lies on the posterior wall and bubbles hang under the anterior one; or neither.
fn chip(r: &mut Renderer, is_whole: bool) -> View {
    walls(r);
    let mut gas = Bubbles::new(GAS);
    let parcels = [-3.0, -1.0, 1.5, 3.0].map(|x: f32| [1e-3 * x, 0.00428, 0.024 + 3e-4 * x.abs(), 2e-3]);
    if is_whole {
        gas.show(r.stage(), &parcels).expect("there is room");
        let mut piece = shapes::ball([0.0; 3], 0.0025, 16, 24);
        for [x, y, _] in &mut piece.positions_m {
            (*x, *y) = (1.4 * *x, 0.5 * *y);
        }
        put(r, POLYP, &piece, Material::Polyp);
        r.stage().set_pose(POLYP, [0.001, -0.004, 0.025], [0.0, 0.0, 0.0, 1.0]).expect("it is there");
    }
    through_scope()
}

/// The section from outside with the scope in it; or without the scope.
fn external(r: &mut Renderer, is_whole: bool) -> View {
    walls(r);
    if is_whole {
        put(r, TOOL, &shapes::scope(0.0025, 0.12, 0.5), Material::Metal);
        r.stage().set_pose(TOOL, [0.0, 0.0, 0.02], [0.0, 0.0, 0.0, 1.0]).expect("it is there");
    }
    View::new(Camera::External(External { eye_m: [0.080, 0.024, 0.030], ..External::default() }))
}

/// Two growths far from the middle of the default optic, which looks 30 degrees up and draws what is at its rim at half the size; or a lens without distortion.
fn oblique(r: &mut Renderer, is_whole: bool) -> View {
    walls(r);
    // At 34 and 37 of the 45 degrees between the line of sight and the rim.
    put(r, POLYP, &shapes::ball([0.006, 0.003, 0.024], 0.0015, 16, 24), Material::Polyp);
    put(r, ARMS, &shapes::ball([-0.003, -0.001, 0.028], 0.0015, 16, 24), Material::Myoma);
    let optic = Endoscope { tip_m: [0.0, 0.0, 0.015], ..Endoscope::default() };
    let distortion = if is_whole { optic.distortion } else { [0.0; 2] };
    View::new(Camera::Endoscope(Endoscope { distortion, ..optic }))
}

/// The picture of a still.
fn taken(r: &mut Renderer, still: &Still, is_whole: bool) -> Vec<u8> {
    let ids: Vec<u64> = r.stage().ids().collect();
    for id in ids {
        r.stage().remove_object(id);
    }
    r.set_fluid(None).expect("a clear medium");
    r.resize(SIZE_PX[0] as u32, SIZE_PX[1] as u32);
    let view = View { adaptation: 1.0, ..(still.set)(r, is_whole) };
    picture(r, &view)
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"))
}

/// The golden picture of this name.
fn golden(name: &str) -> Vec<u8> {
    let path = path(name);
    let file =
        std::fs::File::open(&path).unwrap_or_else(|error| panic!("{}: {error}; HYSTATION_GOLDEN=write makes it", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("it is small")];
    let info = reader.next_frame(&mut pixels).expect("a whole PNG");
    assert_eq!(([info.width as usize, info.height as usize], info.color_type), (SIZE_PX, png::ColorType::Rgba), "{name}");
    pixels
}

/// How far two pictures are apart, of 255.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Apart {
    mean: f32,
    p99: f32,
}

impl Apart {
    fn is_same(self) -> bool {
        self.mean <= TOLERANCE.mean && self.p99 <= TOLERANCE.p99
    }
}

/// The mean colours of a picture's blocks.
fn blocks(picture: &[u8]) -> Vec<[f32; 3]> {
    let [wide, high] = SIZE_PX.map(|px| px / BLOCK);
    let mut sums = vec![[0.0; 3]; wide * high];
    for (at, pixel) in picture.chunks_exact(4).enumerate() {
        let block = at / SIZE_PX[0] / BLOCK * wide + at % SIZE_PX[0] / BLOCK;
        for (sum, channel) in sums[block].iter_mut().zip(pixel) {
            *sum += f32::from(*channel) / (BLOCK * BLOCK) as f32;
        }
    }
    sums
}

fn apart(a: &[u8], b: &[u8]) -> Apart {
    let (a, b) = (blocks(a), blocks(b));
    let differences: Vec<[f32; 3]> = a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|c| (a[c] - b[c]).abs())).collect();
    let mean = differences.iter().flatten().sum::<f32>() / (3 * differences.len()) as f32;
    let mut most: Vec<f32> = differences.iter().map(|block| block.iter().copied().fold(0.0, f32::max)).collect();
    most.sort_by(f32::total_cmp);
    Apart { mean, p99: most[(99 * most.len()).div_ceil(100) - 1] }
}

#[test]
fn how_far_pictures_are_apart_by_hand() {
    let grey = vec![100_u8; 4 * SIZE_PX[0] * SIZE_PX[1]];
    assert_eq!(apart(&grey, &grey), Apart { mean: 0.0, p99: 0.0 });
    // One of the 432 blocks, and then six, are 60 brighter in red: 1 / 432 · 60 / 3 in the mean, and more than one in a hundred.
    let mut odd = grey.clone();
    let mut brighten = |block: usize| {
        for pixel in 0..BLOCK * BLOCK {
            odd[4 * (pixel / BLOCK * SIZE_PX[0] + block * BLOCK + pixel % BLOCK)] += 60;
        }
        apart(&grey, &odd)
    };
    let one = brighten(0);
    assert!((one.mean - 60.0 / (3.0 * 432.0)).abs() < 1e-3 && one.p99 == 0.0, "{one:?}");
    let six = (1..6).map(&mut brighten).last().unwrap();
    assert!((six.p99 - 60.0).abs() < 1e-3 && !six.is_same(), "{six:?}");
}

#[test]
fn the_pictures_are_the_golden_ones() {
    let Some(mut r) = renderer() else { return };
    let is_writing = std::env::var("HYSTATION_GOLDEN").is_ok_and(|value| value == "write");
    for still in &STILLS {
        let shot = taken(&mut r, still, true);
        if is_writing {
            r.save_png(&path(still.name)).expect("the folder is the repository's");
            eprintln!("written: {}; look at it", path(still.name).display());
        }
        let apart = apart(&golden(still.name), &shot);
        println!("{}: {apart:?}", still.name);
        let kept = std::env::temp_dir().join(format!("hystation-golden-{}.png", still.name));
        if !apart.is_same() {
            r.save_png(&kept).expect("a temporary file");
        }
        assert!(apart.is_same(), "{}: {apart:?}, at most {TOLERANCE:?}; it is in {}", still.name, kept.display());
    }
}

#[test]
fn what_a_picture_is_about_cannot_be_missing_from_it() {
    let Some(mut r) = renderer() else { return };
    for still in &STILLS {
        let apart = apart(&golden(still.name), &taken(&mut r, still, false));
        println!("{}, flawed: {apart:?}", still.name);
        assert!(apart.mean > 2.0 * TOLERANCE.mean || apart.p99 > 2.0 * TOLERANCE.p99, "{}, flawed: {apart:?}", still.name);
    }
}

#[test]
fn no_golden_picture_is_taken_for_another() {
    let all: Vec<Vec<u8>> = STILLS.iter().map(|still| golden(still.name)).collect();
    for (first, a) in all.iter().enumerate() {
        for (second, b) in all.iter().enumerate().filter(|(second, _)| *second != first) {
            assert!(!apart(a, b).is_same(), "{} and {}", STILLS[first].name, STILLS[second].name);
        }
    }
}

#[test]
fn a_device_that_smooths_its_edges_makes_the_golden_pictures_too() {
    if renderer().is_none() {
        return;
    }
    let gpu = Gpu::new(Prefer::Software).expect("the adapter of before").smooth(true);
    let mut r = Renderer::new(gpu, WIDTH, HEIGHT).expect("the software adapter takes several samples");
    for still in &STILLS {
        let apart = apart(&golden(still.name), &taken(&mut r, still, true));
        println!("{}, smooth: {apart:?}", still.name);
        assert!(apart != Apart { mean: 0.0, p99: 0.0 } && apart.is_same(), "{}, smooth: {apart:?}", still.name);
    }
}
