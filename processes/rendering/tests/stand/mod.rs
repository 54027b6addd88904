//! What the picture tests share: a cavity on the software rasterizer at a low resolution.
//! Without Vulkan these tests fail, unless HYSTATION_NO_GPU=1 says that this machine is known to have none.
#![allow(dead_code, missing_docs)] // each test file uses a part of it

#[path = "../support/vulkan.rs"]
mod vulkan;

use rendering::{Appearance, Camera, Endoscope, External, Gpu, Material, Prefer, Renderer, SurfaceMesh, View, Without, shapes};

pub const WIDTH: u32 = 160;
pub const HEIGHT: u32 = 120;
pub const CAVITY: u64 = 1;
pub const TOOL: u64 = 2;

/// None where the machine is declared to have no Vulkan.
pub fn renderer() -> Option<Renderer> {
    lacking(Without::default())
}

/// The same, with tissue that lacks a part of its looks.
pub fn lacking(without: Without) -> Option<Renderer> {
    let gpu = vulkan::unless_declared_absent(Gpu::new(Prefer::Software))?;
    Some(Renderer::new(gpu.without(without), WIDTH, HEIGHT).expect("the software adapter takes every shader"))
}

pub fn put(r: &mut Renderer, id: u64, shape: &shapes::Shape, material: Material) {
    let mesh =
        SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw: &[], appearance: Appearance::of(material) };
    r.stage().set_object(id, mesh).expect("a sound mesh");
}

pub fn in_cavity() -> Option<(Renderer, shapes::Shape)> {
    let mut r = renderer()?;
    let cavity = shapes::cavity(0.045, 40, 48);
    put(&mut r, CAVITY, &cavity, Material::MucosaTissue);
    Some((r, cavity))
}

pub fn through_scope() -> View {
    let mut view = View::new(Camera::Endoscope(Endoscope { tip_m: [0.0, 0.0, 0.015], oblique_rad: 0.0, ..Endoscope::default() }));
    view.adaptation = 1.0;
    view
}

pub fn from_outside() -> View {
    View::new(Camera::External(External { clip: None, ..External::default() }))
}

/// A flat wall before the lens of [`straight`], across the line of sight, that reaches so far to each side.
pub fn wall(far_m: f32, half_m: f32) -> shapes::Shape {
    const CELLS: u32 = 8;
    let row = CELLS + 1;
    let at_m = |k: u32| half_m * (2.0 * k as f32 / CELLS as f32 - 1.0);
    let corners = (0..CELLS * CELLS).map(|cell| cell / CELLS * row + cell % CELLS);
    shapes::Shape {
        positions_m: (0..row * row).map(|k| [at_m(k % row), at_m(k / row), far_m]).collect(),
        triangles: corners.flat_map(|a| [[a, a + row, a + 1], [a + 1, a + row, a + row + 1]]).collect(),
    }
}

/// Puts up a shape on which the texture is the same all over: every vertex has the same place at rest.
pub fn put_plain(r: &mut Renderer, id: u64, shape: &shapes::Shape, appearance: Appearance) {
    let rest_m = vec![[0.010, 0.002, 0.003]; shape.positions_m.len()];
    let mesh = SurfaceMesh { triangles: &shape.triangles, rest_m: &rest_m, raw: &[], appearance };
    r.stage().set_object(id, mesh).expect("a sound mesh");
    r.stage().update_positions(id, &shape.positions_m).expect("as many as before");
}

/// Along +z from the origin, with nothing blurred and nothing glowing, metered at once.
pub fn straight() -> View {
    plain(Camera::Endoscope(Endoscope { oblique_rad: 0.0, ..Endoscope::default() }))
}

/// The same way from the same place, but as from outside: no lens, an exposure that stays, and a lamp to the upper left that lights what
/// is so far away. Its pixels look along [`ray`].
pub fn close_up(far_m: f32) -> View {
    let (eye_m, target_m, field_of_view_rad) = ([0.0; 3], [0.0, 0.0, far_m], 60_f32.to_radians());
    plain(Camera::External(External { eye_m, target_m, field_of_view_rad, clip: None, ..External::default() }))
}

/// Where a pixel of [`close_up`] looks, of length 1.
pub fn ray([x, y]: [u32; 2]) -> glam::Vec3 {
    let wide = 30_f32.to_radians().tan() / (0.5 * HEIGHT as f32);
    let [right, down] = [x as f32 + 0.5 - 0.5 * WIDTH as f32, y as f32 + 0.5 - 0.5 * HEIGHT as f32];
    glam::Vec3::new(-right * wide, -down * wide, 1.0).normalize()
}

fn plain(camera: Camera) -> View {
    let mut view = View { adaptation: 1.0, ..View::new(camera) };
    (view.quality.bloom, view.quality.focus) = (false, false);
    view
}

/// Pixels at most so far from the middle.
pub fn middle([across, down]: [u32; 2]) -> impl Iterator<Item = [u32; 2]> + Clone {
    let rows = HEIGHT / 2 - down..HEIGHT / 2 + down;
    rows.flat_map(move |y| (WIDTH / 2 - across..WIDTH / 2 + across).map(move |x| [x, y]))
}

/// By how much a pixel is brighter than the mean of the box about it, which reaches so far to each side.
pub fn detail(picture: &[u8], channel: usize, [x, y]: [u32; 2], [across, down]: [u32; 2]) -> f32 {
    let places = (y - down..=y + down).flat_map(|y| (x - across..=x + across).map(move |x| (x, y)));
    let sum: i32 = places.map(|(x, y)| pixel(picture, x, y)[channel]).sum();
    pixel(picture, x, y)[channel] as f32 - sum as f32 / ((2 * across + 1) * (2 * down + 1)) as f32
}

/// Mean of a channel over some pixels.
pub fn mean(picture: &[u8], channel: usize, places: impl Iterator<Item = [u32; 2]>) -> f32 {
    let (sum, count) = places.fold((0, 0_i32), |(sum, count), [x, y]| (sum + pixel(picture, x, y)[channel], count + 1));
    sum as f32 / count.max(1) as f32
}

/// How steep a picture is in green from one pixel to the next on the right: the mean and the mean square.
pub fn steps(picture: &[u8], places: impl Iterator<Item = [u32; 2]>) -> [f32; 2] {
    let step = |[x, y]: [u32; 2]| (pixel(picture, x + 1, y)[1] - pixel(picture, x, y)[1]).abs() as f32;
    let all: Vec<f32> = places.map(step).collect();
    let count = all.len().max(1) as f32;
    [all.iter().sum::<f32>() / count, all.iter().map(|step| step * step).sum::<f32>() / count]
}

pub fn picture(r: &mut Renderer, view: &View) -> Vec<u8> {
    r.render(view).expect("a frame");
    r.read_rgba().expect("a picture").to_vec()
}

pub fn pixel(picture: &[u8], x: u32, y: u32) -> [i32; 3] {
    let at = 4 * (y * WIDTH + x) as usize;
    [picture[at], picture[at + 1], picture[at + 2]].map(i32::from)
}

/// Pixels of the round field, a little inside its rim, and pixels a little outside.
pub fn round_field() -> [Vec<(u32, u32)>; 2] {
    let radius = |x: u32, y: u32| {
        let [dx, dy] = [x as f32 + 0.5 - 0.5 * WIDTH as f32, y as f32 + 0.5 - 0.5 * HEIGHT as f32];
        dx.hypot(dy) / (0.5 * HEIGHT as f32)
    };
    let all = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    let outside = all.clone().filter(|&(x, y)| radius(x, y) > 1.02).collect();
    [all.filter(|&(x, y)| radius(x, y) < 0.85).collect(), outside]
}

pub fn changed(a: &[u8], b: &[u8]) -> usize {
    let differs = |(p, q): &(&[u8], &[u8])| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > 12);
    a.chunks_exact(4).zip(b.chunks_exact(4)).filter(differs).count()
}
