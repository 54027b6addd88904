//! What the picture tests share: a cavity on the software rasterizer at a low resolution.
//! Without Vulkan these tests fail, unless HYSTATION_NO_GPU=1 says that this machine is known to have none.
#![allow(dead_code, missing_docs)] // each test file uses a part of it
use rendering::{Appearance, Camera, Endoscope, External, Gpu, Material, Prefer, Renderer, SurfaceMesh, View, shapes};

pub const WIDTH: u32 = 160;
pub const HEIGHT: u32 = 120;
pub const CAVITY: u64 = 1;
pub const TOOL: u64 = 2;

/// None where the machine is declared to have no Vulkan.
pub fn renderer() -> Option<Renderer> {
    match Gpu::new(Prefer::Software) {
        Ok(gpu) => Some(Renderer::new(gpu, WIDTH, HEIGHT).expect("the software adapter takes every shader")),
        Err(error) if std::env::var("HYSTATION_NO_GPU").is_ok_and(|v| v == "1") => {
            eprintln!("not tested, HYSTATION_NO_GPU=1: {error}");
            None
        }
        Err(error) => panic!("{error} (or set HYSTATION_NO_GPU=1 where there is none)"),
    }
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
