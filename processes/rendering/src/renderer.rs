//! One frame: normals, shadow, scene, focus, glow and exposure, lens and text; then the picture is read, written to a file, or shown.
//!
//! Promise: whatever the streams held, `render` ends within [`FRAME_LIMIT`] with a picture or with one error. Passes run in one submission.
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use crate::{
    camera::{Eye, View},
    caught::caught,
    error::RenderError,
    fluid::{Fluid, FluidField},
    gpu::{Gpu, one_line},
    overlay,
    pipelines::Pipelines,
    shadow::{Shadow, bindings},
    stage::Stage,
    targets::{PostBuffers, Sizes, Targets, solid, view},
    timing::{FOCUS_PASS, PASSES, Timer},
    uniforms::{Globals, Post, globals, post},
};

/// A frame that takes longer is given up: the device hangs. A software rasterizer that gets no core hangs as long as others work at real time, and
/// who would be started in its place compiled everything anew; the supervisor, who tells the two apart, does not wait so long.
pub const FRAME_LIMIT: Duration = Duration::from_secs(30);
/// Largest side of a picture, px.
pub const MAX_SIDE_PX: u32 = 4_096;

/// Texels per axis of the solids of noise.
const SOLID_SIDE: usize = 64;
/// The solids of noise that `build.rs` has made (`noise.rs`): four signed bytes per texel.
const SOLIDS: [&[u8]; 2] =
    [include_bytes!(concat!(env!("OUT_DIR"), "/fields")), include_bytes!(concat!(env!("OUT_DIR"), "/relief"))];
/// Levels of a solid, each half as wide as the one before.
const SOLID_LEVELS: u32 = SOLID_SIDE.ilog2() + 1;
// All levels together are 8/7 of the first, but for what is left at the last.
const _: () = assert!(SOLIDS[0].len() == 4 * ((8 * SOLID_SIDE.pow(3) - 1) / 7) && SOLIDS[1].len() == SOLIDS[0].len());

/// What a frame cost.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameStats {
    /// from the call to the finished picture, ms
    pub total_ms: f32,
    /// of that: handing over data and recording commands, ms
    pub encode_ms: f32,
    /// device time of the passes named by [`PASS_NAMES`](crate::PASS_NAMES), ms; zero where the device keeps no time
    pub passes_ms: [f32; PASSES],
    /// scene texels drawn
    pub inner_px: [u32; 2],
    /// triangles drawn
    pub triangles: u64,
}

/// The Vision Engine's drawing half. Fields and methods touch one device; a lost device loses all of it.
pub struct Renderer {
    pub(crate) gpu: Gpu,
    pub(crate) pipelines: Arc<Pipelines>,
    pub(crate) stage: Stage,
    shown_px: [u32; 2],
    pub(crate) targets: Targets,
    post: PostBuffers,
    globals: wgpu::Buffer,
    solids: [wgpu::TextureView; 2],
    samplers: [wgpu::Sampler; 2],
    pub(crate) scene_group: wgpu::BindGroup,
    pub(crate) shadow: Shadow,
    /// As the scene's, to draw the shadow's map with.
    pub(crate) lamp_group: wgpu::BindGroup,
    pub(crate) fluid: Fluid,
    pub(crate) fluid_shown: bool,
    pub(crate) timer: Option<Timer>,
    words: Box<[u32; overlay::WORDS]>,
    written: crate::Overlay,
    pub(crate) rgba: Vec<u8>,
    /// No more pictures are presented than the display shows.
    pub(crate) is_in_step: bool,
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("gpu", &self.gpu).field("stage", &self.stage).finish_non_exhaustive()
    }
}

impl Renderer {
    /// Pictures of `width_px` × `height_px` on this device. What is drawn for the first time takes longer, unless [`Renderer::make_rest`] was there before.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] if the device refuses a shader or a buffer.
    pub fn new(gpu: Gpu, width_px: u32, height_px: u32) -> Result<Self, RenderError> {
        let shown = gpu.surface.as_ref().and_then(|s| crate::present::format(s, &gpu.adapter));
        let pipelines = Arc::new(Pipelines::new(&gpu, shown));
        let d = &gpu.device;
        let words = Box::new(overlay::blank());
        let post = post_buffers(&gpu, &words[..]);
        let shown_px = [width_px, height_px].map(|n| n.clamp(16, MAX_SIDE_PX));
        let targets = Targets::new(&gpu, &pipelines, &post, Sizes { inner: shown_px, shown: shown_px });
        let globals = buffer(d, size_of::<Globals>() as u64, wgpu::BufferUsages::UNIFORM);
        let solids = SOLIDS.map(|texels| upload_solid(&gpu, texels));
        let samplers = [tiled_sampler(&gpu), sampler(d, wgpu::AddressMode::ClampToEdge)];
        let fluid = Fluid::clear(&gpu, &pipelines);
        let shadow = Shadow::new(d);
        let scene_group = scene_bindings(&gpu, &pipelines, &globals, &solids, &fluid, &samplers, &shadow);
        let textures = [&solids[0], &solids[1], &fluid.view, &shadow.blank];
        let lamp_group = bindings(d, &pipelines, &shadow.globals, textures, [&samplers[0], &samplers[1], &shadow.sampler]);
        let timer = Timer::new(d, &gpu.queue);
        let stage = Stage::new(&gpu, Arc::clone(&pipelines));
        gpu.check()?;
        Ok(Self {
            stage,
            shown_px,
            targets,
            post,
            globals,
            solids,
            samplers,
            scene_group,
            shadow,
            lamp_group,
            fluid,
            fluid_shown: false,
            timer,
            words,
            written: crate::Overlay::default(),
            rgba: Vec::new(),
            is_in_step: false,
            pipelines,
            gpu,
        })
    }

    /// Makes in a thread of its own what no picture has needed yet: other materials, the medium, the view from outside. Pictures go on meanwhile, and wait
    /// only for what they need themselves.
    ///
    /// # Errors
    /// The system's, if it gives no thread; then each is made by the first picture that needs it.
    pub fn make_rest(&self) -> std::io::Result<()> {
        let pipelines = Arc::clone(&self.pipelines);
        std::thread::Builder::new().name("pipelines".into()).spawn(move || pipelines.make_all()).map(drop)
    }

    /// The objects.
    pub fn stage(&mut self) -> &mut Stage {
        &mut self.stage
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Size of the shown picture, px.
    pub fn size_px(&self) -> [u32; 2] {
        self.shown_px
    }

    /// Another size for the shown picture, px; bounded to 16..=[`MAX_SIDE_PX`].
    pub fn resize(&mut self, width_px: u32, height_px: u32) {
        self.shown_px = [width_px, height_px].map(|n| n.clamp(16, MAX_SIDE_PX));
    }

    /// Blood or turbidity along the ray; `None` is a clear medium.
    ///
    /// # Errors
    /// [`RenderError::BadField`], [`RenderError::TooLarge`]; the field of before stays.
    pub fn set_fluid(&mut self, field: Option<FluidField<'_>>) -> Result<(), RenderError> {
        if let Some(field) = &field
            && self.fluid.set(&self.gpu, &self.pipelines, field)?
        {
            self.scene_group = scene_bindings(
                &self.gpu,
                &self.pipelines,
                &self.globals,
                &self.solids,
                &self.fluid,
                &self.samplers,
                &self.shadow,
            );
        }
        self.fluid_shown = field.is_some();
        Ok(())
    }

    /// Draws one frame and waits for it.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] if the device reports an error or does not finish in time.
    pub fn render(&mut self, view: &View) -> Result<FrameStats, RenderError> {
        let began = Instant::now();
        let [width, height] = self.shown_px;
        let eye = view.camera.eye(width as f32 / height as f32);
        self.fit(&eye, view.quality.scale);
        let has_shadows = view.quality.shadows && self.has_shadows(&eye);
        self.write_frame(view, &eye, has_shadows);
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        self.shape_pass(&mut encoder);
        if has_shadows {
            self.shadow_pass(&mut encoder);
        }
        let triangles = self.scene_pass(&mut encoder, &eye, [has_shadows, view.has_lines]);
        let is_focused = self.focus_pass(&mut encoder, &eye, view.quality.focus);
        self.glow_passes(&mut encoder, view.quality.bloom);
        self.finish_pass(&mut encoder, &eye, is_focused, view.overlay.rows());
        if let Some(timer) = &self.timer {
            timer.resolve(&mut encoder);
        }
        let submission = self.gpu.queue.submit([encoder.finish()]);
        let encode_ms = ms_since(began);
        self.wait(submission)?;
        let mut passes_ms = self.timer.as_ref().map_or([0.0; PASSES], |t| t.read_ms(&self.gpu.device));
        passes_ms[FOCUS_PASS] *= f32::from(u8::from(is_focused)); // stamps stay as they were where a pass is left out
        Ok(FrameStats { total_ms: ms_since(began), encode_ms, passes_ms, inner_px: self.targets.sizes.inner, triangles })
    }

    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), RenderError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(FRAME_LIMIT) };
        let waited = caught(|| self.gpu.device.poll(wait));
        // The driver's own words first: of work that a lost device has refused, who waits for it knows nothing but its number.
        self.gpu.check()?;
        match waited {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(RenderError::DeviceLost(one_line(&error.to_string()))),
            Err(text) => Err(RenderError::DeviceLost(text)),
        }
    }

    /// Makes the targets anew if the shown size, the scale or the kind of camera changed.
    fn fit(&mut self, eye: &Eye, scale: f32) {
        let scale = if scale.is_finite() { scale.clamp(0.1, 1.0) } else { 1.0 };
        let [w, h] = self.shown_px;
        let square = [w.min(h); 2];
        let inner = if eye.round { square } else { [w, h] }.map(|n| ((n as f32 * scale) as u32).max(16));
        let sizes = Sizes { inner, shown: self.shown_px };
        if sizes != self.targets.sizes {
            self.targets = Targets::new(&self.gpu, &self.pipelines, &self.post, sizes);
        }
    }

    fn write_frame(&mut self, view: &View, eye: &Eye, has_shadows: bool) {
        let queue = &self.gpu.queue;
        let light = if view.light.is_finite() { view.light.clamp(0.0, 10.0) } else { 1.0 };
        let own = globals(eye, light, &self.fluid, has_shadows);
        queue.write_buffer(&self.globals, 0, bytemuck::bytes_of(&own));
        queue.write_buffer(&self.shadow.globals, 0, bytemuck::bytes_of(&own.seen_from_lamp()));
        queue.write_buffer(&self.post.uniform, 0, bytemuck::bytes_of(&post(view, eye, self.targets.sizes)));
        if view.overlay != self.written {
            view.overlay.write(&mut self.words);
            queue.write_buffer(&self.post.glyphs, 0, bytemuck::cast_slice(&self.words[..]));
            self.written.clone_from(&view.overlay);
        }
        self.stage.flush(eye.tissue_alpha);
    }
}

fn ms_since(began: Instant) -> f32 {
    began.elapsed().as_secs_f32() * 1.0e3
}

pub(crate) fn buffer(d: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    d.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

fn post_buffers(gpu: &Gpu, words: &[u32]) -> PostBuffers {
    let d = &gpu.device;
    let glyphs = buffer(d, size_of_val(words) as u64, wgpu::BufferUsages::STORAGE);
    gpu.queue.write_buffer(&glyphs, 0, bytemuck::cast_slice(words));
    PostBuffers {
        uniform: buffer(d, size_of::<Post>() as u64, wgpu::BufferUsages::UNIFORM),
        exposure: buffer(d, 16, wgpu::BufferUsages::STORAGE),
        glyphs,
        sampler: sampler(d, wgpu::AddressMode::ClampToEdge),
    }
}

fn sampler(d: &wgpu::Device, mode: wgpu::AddressMode) -> wgpu::Sampler {
    d.create_sampler(&wgpu::SamplerDescriptor {
        address_mode_u: mode,
        address_mode_v: mode,
        address_mode_w: mode,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

/// For solids that tile: on a GPU between two of their levels, in software the nearer one, which costs half as many texels.
fn tiled_sampler(gpu: &Gpu) -> wgpu::Sampler {
    let mipmap_filter = if gpu.is_software() { wgpu::MipmapFilterMode::Nearest } else { wgpu::MipmapFilterMode::Linear };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        address_mode_u: wgpu::AddressMode::Repeat,
        address_mode_v: wgpu::AddressMode::Repeat,
        address_mode_w: wgpu::AddressMode::Repeat,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter,
        ..Default::default()
    })
}

fn upload_solid(gpu: &Gpu, texels: &[u8]) -> wgpu::TextureView {
    let dims = [SOLID_SIDE as u32; 3];
    let texture = solid(&gpu.device, dims, SOLID_LEVELS, wgpu::TextureFormat::Rgba8Snorm, wgpu::TextureUsages::COPY_DST);
    let mut rest = texels;
    for mip_level in 0..SOLID_LEVELS {
        let side = dims[0] >> mip_level;
        let (level, after) = rest.split_at(4 * (side as usize).pow(3));
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * side), rows_per_image: Some(side) };
        let size = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: side };
        gpu.queue.write_texture(wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() }, level, layout, size);
        rest = after;
    }
    view(&texture)
}

fn scene_bindings(
    gpu: &Gpu,
    pipelines: &Pipelines,
    globals: &wgpu::Buffer,
    solids: &[wgpu::TextureView; 2],
    fluid: &Fluid,
    samplers: &[wgpu::Sampler; 2],
    shadow: &Shadow,
) -> wgpu::BindGroup {
    let textures = [&solids[0], &solids[1], &fluid.view, &shadow.map];
    bindings(&gpu.device, pipelines, globals, textures, [&samplers[0], &samplers[1], &shadow.sampler])
}

#[cfg(test)]
#[path = "../tests/support/vulkan.rs"]
mod vulkan;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Appearance, Camera, Endoscope, Material, Prefer, SurfaceMesh, shapes};

    const BALL: u64 = 1;

    /// `None` where the machine is declared to have no Vulkan.
    fn renderer() -> Option<Renderer> {
        let gpu = vulkan::unless_declared_absent(Gpu::new(Prefer::Software))?;
        Some(Renderer::new(gpu, 64, 48).expect("the software adapter takes every shader"))
    }

    /// wgpu treats a device that was taken back as one that its driver has lost: what was made with it is of no use, and no more is made.
    #[test]
    fn a_lost_device_is_one_line_from_the_next_picture_on_and_what_streams_in_meanwhile_panics_nobody() {
        let Some(mut renderer) = renderer() else { return };
        let ball = shapes::ball([0.0, 0.01, 0.02], 0.004, 8, 12);
        let appearance = Appearance::of(Material::Polyp);
        let mesh = SurfaceMesh { triangles: &ball.triangles, rest_m: &ball.positions_m, raw: &[], appearance };
        renderer.stage().set_object(BALL, mesh).unwrap();
        let view = View::new(Camera::Endoscope(Endoscope::default()));
        renderer.render(&view).unwrap();
        renderer.gpu().check().unwrap();

        renderer.gpu.device.destroy();
        // The loss is told once the last work is done.
        let done = wgpu::PollType::Wait { submission_index: None, timeout: Some(FRAME_LIMIT) };
        renderer.gpu.device.poll(done).unwrap();
        renderer.stage().update_positions(BALL, &ball.positions_m).unwrap();
        renderer.stage().set_object(BALL, mesh).unwrap();
        let error = renderer.render(&view).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, RenderError::DeviceLost(_)) && text.contains("device lost"), "{text}");
        assert!(text.contains("restart the rendering process") && text.lines().count() == 1, "{text}");
        // It stays lost.
        assert!(matches!(renderer.render(&view), Err(RenderError::DeviceLost(_))));
        assert!(matches!(renderer.read_rgba(), Err(RenderError::DeviceLost(_))));
    }
}
