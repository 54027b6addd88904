//! Stills of the organ in `assets/meshes`, or of a cavity made by formula, through the endoscope and from outside, with what they cost.
//!
//!     cargo run --release -p rendering --example still -- OUTPUT-FOLDER [FRAMES]
use std::{error::Error, path::Path};

use glam::{Quat, Vec3};
use rendering::{
    Appearance, Camera, Endoscope, External, FluidField, Gpu, Material, Overlay, PASS_NAMES, Prefer, Renderer, SHADED_SCALE,
    SurfaceMesh, Surroundings, View,
    shapes::{self, Shape},
};

const ORGAN: u64 = 1;
const POLYP: u64 = 2;
const SCOPE: u64 = 3;
const RING: u64 = 4;
const ARMS: u64 = 5;
/// From the tip back to the lens, and forward to the loop's ring, m.
const LENS_M: f32 = 0.004;
const RING_M: f32 = 0.012;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| "target/stills".into());
    let frames: usize = arguments.next().map_or(Ok(1), |n| n.parse())?;
    std::fs::create_dir_all(&folder)?;
    let began = std::time::Instant::now();
    let mut renderer = Renderer::new(Gpu::new(Prefer::Fastest)?, 640, 480)?;
    println!("{} ready after {:.0} ms", renderer.gpu().name(), began.elapsed().as_secs_f64() * 1e3);
    set_stage(&mut renderer)?;
    for still in stills() {
        let view = aim(&mut renderer, still)?;
        picture(&mut renderer, &view, still.name, &folder, frames)?;
        if still.name == "polyp" {
            bleed(&mut renderer)?;
            picture(&mut renderer, &view, "blood", &folder, frames)?;
            renderer.set_fluid(None)?;
        }
    }
    Ok(())
}

/// A picture to take: where the scope is, and who looks.
#[derive(Clone, Copy)]
struct Still {
    name: &'static str,
    insertion_m: f32,
    /// up, to the patient's right, about the axis
    turn_rad: [f32; 3],
    camera: Camera,
}

fn stills() -> [Still; 7] {
    let straight = Camera::Endoscope(Endoscope { oblique_rad: 0.0, ..Endoscope::default() });
    let held = |head_rad| Camera::Endoscope(Endoscope { head_rad, ..Endoscope::default() });
    let open = External::default();
    let glass = Camera::External(External { clip: None, tissue_alpha: 0.35, ..open });
    let still = |name, insertion_m, turn_rad, camera| Still { name, insertion_m, turn_rad, camera };
    [
        still("entry", 0.010, [0.0, 0.0, 0.0], straight),
        still("cavity", 0.024, [-0.10, -0.10, -1.0], held(1.0)),
        still("polyp", 0.032, [0.0, -0.02, -1.4], held(1.4)),
        still("loop", 0.036, [0.0, 0.0598, -1.555], held(0.0)),
        still("loop-external", 0.036, [0.0, 0.0598, -1.555], Camera::External(open)),
        still("external", 0.032, [-0.02, 0.08, 0.0], Camera::External(open)),
        still("glass", 0.032, [-0.02, 0.08, 0.0], glass),
    ]
}

fn set_stage(renderer: &mut Renderer) -> Result<(), rendering::RenderError> {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/meshes");
    let organ = read_obj(&assets.join("uterus-surface.obj")).unwrap_or_else(|| shapes::cavity(0.05, 80, 96));
    let growth = read_obj(&assets.join("polyp-surface.obj")).unwrap_or_else(|| shapes::ball([0.004, 0.0, 0.042], 0.004, 24, 32));
    put(renderer, ORGAN, &organ, Material::MucosaTissue)?;
    put(renderer, POLYP, &growth, Material::Polyp)?;
    let held = [mesh(&organ, Material::MucosaTissue), mesh(&growth, Material::Polyp)];
    let surroundings = Surroundings::of(&held);
    for (id, mesh) in [ORGAN, POLYP].into_iter().zip(&held) {
        renderer.stage().set_openness(id, &surroundings.openness(mesh))?;
    }
    put(renderer, SCOPE, &shapes::scope(0.0025, 0.30, 0.5), Material::Metal)?;
    put(renderer, RING, &shapes::loop_ring(0.0022, 0.000_15), Material::Metal)?;
    put(renderer, ARMS, &shapes::loop_arms(0.0022, 0.000_15, 0.06), Material::Metal)?;
    let metal = Appearance { external_only: true, ..Appearance::of(Material::Metal) };
    renderer.stage().set_appearance(SCOPE, metal)
}

fn aim(renderer: &mut Renderer, still: Still) -> Result<View, rendering::RenderError> {
    let [pitch, yaw, roll] = still.turn_rad;
    let q = Quat::from_rotation_y(yaw) * Quat::from_rotation_x(-pitch) * Quat::from_rotation_z(roll);
    let tip = q * Vec3::Z * still.insertion_m;
    let ring = tip + q * Vec3::Z * RING_M;
    renderer.stage().set_pose(SCOPE, tip.to_array(), q.to_array())?;
    renderer.stage().set_pose(RING, ring.to_array(), q.to_array())?;
    renderer.stage().set_pose(ARMS, ring.to_array(), q.to_array())?;
    let glow = if still.name.starts_with("loop") { 1.0 } else { 0.0 };
    renderer.stage().set_appearance(RING, Appearance { glow, ..Appearance::of(Material::Metal) })?;
    let mut view = View::new(still.camera);
    if let Camera::Endoscope(scope) = &mut view.camera {
        (scope.tip_m, scope.rotation) = ((tip - q * Vec3::Z * LENS_M).to_array(), q.to_array());
    }
    let lines = ["P  62 mmHg", "Q 210 ml/min", "D  85 ml", "T 00:04:12"].map(String::from).to_vec();
    view.overlay = Overlay { lines, sign: if still.name == "polyp" { "tissue replaced".into() } else { String::new() } };
    view.adaptation = 1.0;
    Ok(view)
}

fn bleed(renderer: &mut Renderer) -> Result<(), rendering::RenderError> {
    let density: Vec<f32> = (0..32 * 32 * 18).map(cloud).collect();
    let [min_m, max_m] = [[-0.012, -0.006, 0.035], [0.014, 0.006, 0.055]];
    renderer.set_fluid(Some(FluidField { dims: [32, 32, 18], min_m, max_m, density: &density, extinction_per_m: 500.0 }))
}

fn picture(renderer: &mut Renderer, view: &View, name: &str, folder: &str, frames: usize) -> Result<(), Box<dyn Error>> {
    for scale in if frames > 1 { &[1.0_f32, 0.75, 0.5, 0.375, 0.25][..] } else { &[1.0][..] } {
        let mut view = view.clone();
        // As the effort has it, which gives up the focus first, and the shadows before the last pixels.
        (view.quality.scale, view.quality.focus, view.quality.shadows) = (*scale, *scale == 1.0, *scale >= SHADED_SCALE);
        let mut all = Vec::new();
        for _ in 0..frames {
            all.push(renderer.render(&view)?);
        }
        all.sort_by(|a, b| a.total_ms.total_cmp(&b.total_ms));
        let s = all[all.len() / 2];
        let parts: Vec<String> = PASS_NAMES.iter().zip(s.passes_ms).map(|(n, ms)| format!("{n} {ms:.2}")).collect();
        println!(
            "{name:9} {:?} {:6.2} ms (record {:.2}; {}), {} triangles",
            s.inner_px,
            s.total_ms,
            s.encode_ms,
            parts.join(", "),
            s.triangles
        );
        if *scale == 1.0 {
            renderer.save_png(&Path::new(folder).join(format!("{name}.png")))?;
        }
    }
    Ok(())
}

fn cloud(cell: usize) -> f32 {
    let [x, y, z] = [cell % 32, cell / 32 % 32, cell / 1024].map(|i| i as f32);
    let [dx, dy, dz] = [(x - 20.0) / 7.0, (y - 15.0) / 8.0, (z - 8.0) / 4.0];
    (1.0 - dx * dx - dy * dy - dz * dz + 0.5 * (0.9 * x + 0.4 * z).sin() * (0.7 * y - 0.5 * z).cos()).max(0.0)
}

fn put(renderer: &mut Renderer, id: u64, shape: &Shape, material: Material) -> Result<(), rendering::RenderError> {
    renderer.stage().set_object(id, mesh(shape, material))
}

fn mesh(shape: &Shape, material: Material) -> SurfaceMesh<'_> {
    SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw: &[], appearance: Appearance::of(material) }
}

/// Vertices (millimetres in the file) and triangles of a Wavefront file; none if it cannot be read.
fn read_obj(path: &Path) -> Option<Shape> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut shape = Shape::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f32> = words.filter_map(|w| w.parse().ok()).collect();
                shape.positions_m.push([*p.first()?, *p.get(1)?, *p.get(2)?].map(|c| c * 1e-3));
            }
            Some("f") => {
                let t: Vec<u32> = words.filter_map(|w| w.split('/').next()?.parse().ok()).collect();
                shape.triangles.push([t.first()? - 1, t.get(1)? - 1, t.get(2)? - 1]);
            }
            _ => {}
        }
    }
    Some(shape)
}
