//! A window on a cavity made by formula, driven by mouse and keyboard; goes on headless when the display goes away.
//!
//!     cargo run --release -p rendering --example window -- [FRAMES]
use std::{
    error::Error,
    time::{Duration, Instant},
};

use glam::{Quat, Vec3};
use rendering::{
    Appearance, Camera, Endoscope, Gpu, Key, Material, Overlay, PointerInput, Prefer, RenderError, Renderer, Status, SurfaceMesh,
    View, Window, next_scale, shapes,
};

const BUDGET_MS: f32 = 33.0;

fn stocked(gpu: Gpu) -> Result<Renderer, RenderError> {
    let mut renderer = Renderer::new(gpu, 640, 480)?;
    let cavity = shapes::cavity(0.05, 80, 96);
    let appearance = Appearance::of(Material::MucosaTissue);
    renderer
        .stage()
        .set_object(1, SurfaceMesh { triangles: &cavity.triangles, rest_m: &cavity.positions_m, raw: &[], appearance })?;
    Ok(renderer)
}

/// Adds up what the hand did.
fn follow(at: &mut PointerInput, hand: &PointerInput) {
    at.pitch_rad += hand.pitch_rad;
    at.yaw_rad += hand.yaw_rad;
    at.roll_rad += hand.roll_rad;
    at.insertion_m = (at.insertion_m + hand.insertion_m).clamp(0.0, 0.045);
}

fn camera(at: &PointerInput) -> Camera {
    let q = Quat::from_rotation_y(-at.yaw_rad) * Quat::from_rotation_x(-at.pitch_rad) * Quat::from_rotation_z(at.roll_rad);
    let tip_m = (q * Vec3::Z * at.insertion_m).to_array();
    Camera::Endoscope(Endoscope { tip_m, rotation: q.to_array(), ..Endoscope::default() })
}

fn main() -> Result<(), Box<dyn Error>> {
    let frames: u32 = std::env::args().nth(1).map_or(Ok(u32::MAX), |n| n.parse())?;
    let mut window = Window::open("hysteroscopy", 640, 480).inspect_err(|e| eprintln!("{e}; going on headless")).ok();
    let gpu = window.as_ref().map_or_else(|| Gpu::new(Prefer::Fastest), |w| Gpu::with_window(Prefer::Fastest, &w.pane()?))?;
    println!("{}", gpu.name());
    let mut renderer = stocked(gpu)?;
    let mut at = PointerInput { insertion_m: 0.015, ..PointerInput::default() };
    let mut view = View::new(Camera::Endoscope(Endoscope::default()));
    let mut last = Instant::now();
    for frame in 0..frames {
        if let Some(open) = &mut window {
            match open.pump(last.elapsed().as_secs_f32()) {
                Ok(Status::Closed) => {
                    println!("closed after {frame} frames");
                    return Ok(());
                }
                Ok(Status::Open(hand)) => {
                    if hand != Default::default() {
                        println!("{hand:?}, help: {}", hand.was_pressed(Key::Help));
                    }
                    follow(&mut at, &hand);
                }
                Err(error) => {
                    println!("{error}; going on headless");
                    window = None;
                    renderer = stocked(Gpu::new(Prefer::Fastest)?)?;
                }
            }
        }
        last = Instant::now();
        view.camera = camera(&at);
        let stats = renderer.render(&view)?;
        let drawn = (view.quality.scale, view.quality.shadows);
        (view.quality.scale, view.quality.shadows) = next_scale(stats.total_ms, BUDGET_MS, drawn);
        view.overlay = Overlay {
            lines: vec![format!("{:.0} ms", stats.total_ms), format!("{} px", stats.inner_px[1])],
            sign: String::new(),
        };
        if let Some(open) = &window {
            let [width, height] = open.size_px();
            if let Err(error) = renderer.present(width, height) {
                println!("{error}; going on headless");
                window = None;
                renderer = stocked(Gpu::new(Prefer::Fastest)?)?;
            }
        }
        if frame % 100 == 0 {
            println!("frame {frame}: {stats:?}");
        }
        std::thread::sleep(Duration::from_millis(33).saturating_sub(last.elapsed()));
    }
    println!("done");
    Ok(())
}
