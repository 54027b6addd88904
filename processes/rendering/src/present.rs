//! Where a finished picture goes: into memory, or onto the window; and from memory into a PNG file or to the end of a film.
use hyst_exchange::whole;
use std::{fs::OpenOptions, io::Write, path::Path};

use crate::{
    error::RenderError,
    gpu::one_line,
    passes::screen,
    pipelines::PICTURE,
    renderer::{MAX_SIDE_PX, Renderer},
    targets::view,
};

/// What became of a picture that was to be shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// it is on the window
    Yes,
    /// the window is hidden, minimised or was just resized; nothing is wrong
    Skipped,
}

/// Of a film's pictures, of 100.
const FILM_QUALITY: u8 = 85;

impl Renderer {
    /// The last picture: rows from the top, RGBA with 8 bits each (gamma 2.2), `size_px` wide and high, borrowed until the next call.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`].
    pub fn read_rgba(&mut self) -> Result<&[u8], RenderError> {
        let [width, height] = self.targets.sizes.shown;
        let row = 4 * width;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(padded) * u64::from(height);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let landing = crate::renderer::buffer(&self.gpu.device, size, usage);
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read") });
        encoder.copy_texture_to_buffer(
            self.targets.picture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &landing,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: Some(height) },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        encoder.map_buffer_on_submit(&landing, wgpu::MapMode::Read, .., |_| {});
        let submission = self.gpu.queue.submit([encoder.finish()]);
        self.wait(submission)?;
        let bytes = landing.get_mapped_range(..).map_err(|e| RenderError::DeviceLost(one_line(&e.to_string())))?;
        self.rgba.clear();
        for line in bytes.chunks_exact(padded as usize) {
            self.rgba.extend_from_slice(&line[..row as usize]);
        }
        Ok(&self.rgba)
    }

    /// Writes the last picture as [`save_png`] does.
    ///
    /// # Errors
    /// [`RenderError::Picture`], [`RenderError::DeviceLost`].
    pub fn save_png(&mut self, path: &Path) -> Result<(), RenderError> {
        let size_px = self.targets.sizes.shown;
        save_png(path, size_px, self.read_rgba()?)
    }

    /// Offers to present no more pictures than the display shows, before any is; gives whether that is asked for, because each waits for its turn there.
    pub fn keep_step(&mut self) -> bool {
        self.is_in_step = true;
        self.gpu.surface.as_ref().is_some_and(|surface| self.mode(surface) == wgpu::PresentMode::Fifo)
    }

    fn mode(&self, surface: &wgpu::Surface<'static>) -> wgpu::PresentMode {
        let offered = surface.get_capabilities(&self.gpu.adapter).present_modes;
        present_mode(&offered, self.gpu.is_software(), self.is_in_step)
    }

    /// Shows the last picture on the window that the device was opened with, as large as fits `width_px` × `height_px`.
    ///
    /// # Errors
    /// [`RenderError::NoSurface`] if there is no window or it cannot be drawn to, [`RenderError::NoDisplay`] if the display is gone.
    pub fn present(&mut self, width_px: u32, height_px: u32) -> Result<Shown, RenderError> {
        let size = [width_px, height_px];
        if size.contains(&0) {
            return Ok(Shown::Skipped);
        }
        let unfit = |reason: &str| RenderError::NoSurface { adapter: self.gpu.name(), reason: reason.into() };
        let surface = self.gpu.surface.as_ref().ok_or_else(|| unfit("no window was given"))?;
        let (format, pipeline) = self.pipelines.show.as_ref().ok_or_else(|| unfit("no common format"))?;
        let [width, height] = size.map(|n| n.min(MAX_SIDE_PX));
        let held = surface.get_configuration();
        if held.is_none_or(|c| [c.width, c.height] != [width, height]) {
            self.configure(surface, *format, width, height);
        }
        let frame = match surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => {
                return Ok(Shown::Skipped);
            }
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.configure(surface, *format, width, height);
                return self.gpu.check().map(|()| Shown::Skipped);
            }
            _ => {
                return Err(RenderError::NoDisplay("the window's surface is lost".into()));
            }
        };
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("show") });
        self.letterbox(&mut encoder, pipeline, &view(&frame.texture), [width, height]);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.queue.present(frame);
        self.gpu.check().map(|()| Shown::Yes)
    }

    fn letterbox(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::RenderPipeline,
        target: &wgpu::TextureView,
        window: [u32; 2],
    ) {
        let [w, h] = window.map(|n| n as f32);
        let [pw, ph] = self.targets.sizes.shown.map(|n| n as f32);
        let zoom = (w / pw).min(h / ph);
        let [fw, fh] = [(pw * zoom).min(w), (ph * zoom).min(h)];
        let mut pass = screen(encoder, target, None);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &self.targets.from_picture, &[]);
        pass.set_viewport(0.5 * (w - fw), 0.5 * (h - fh), fw, fh, 0.0, 1.0);
        pass.draw(0..3, 0..1);
    }

    fn configure(&self, surface: &wgpu::Surface<'static>, format: wgpu::TextureFormat, width: u32, height: u32) {
        if let Some(mut wanted) = surface.get_default_config(&self.gpu.adapter, width, height) {
            wanted.format = format;
            wanted.present_mode = self.mode(surface);
            wanted.desired_maximum_frame_latency = 1;
            surface.configure(&self.gpu.device, &wanted);
        }
    }
}

fn unwritten(path: &Path, reason: &str) -> RenderError {
    RenderError::Picture { path: path.display().to_string(), reason: one_line(reason) }
}

/// Writes a picture as [`Renderer::read_rgba`] gives it as PNG. The file appears whole or not at all.
///
/// # Errors
/// [`RenderError::Picture`].
pub fn save_png(path: &Path, [width, height]: [u32; 2], rgba: &[u8]) -> Result<(), RenderError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(|e| unwritten(path, &e.to_string()))?;
    writer.write_image_data(rgba).map_err(|e| unwritten(path, &e.to_string()))?;
    writer.finish().map_err(|e| unwritten(path, &e.to_string()))?;
    whole::write(path, &bytes).map_err(|e| unwritten(path, &e.to_string()))
}

/// Appends a picture to a film: JPEG after JPEG, which is what players call MJPEG. A film whose end was cut goes on after the cut.
///
/// # Errors
/// [`RenderError::Picture`].
pub fn append_jpeg(path: &Path, size_px: [u32; 2], rgba: &[u8]) -> Result<(), RenderError> {
    let [width, height] = size_px.map(|side| side as u16); // `MAX_SIDE_PX` at most
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, FILM_QUALITY);
    let encoded = encoder.encode(rgba, width, height, jpeg_encoder::ColorType::Rgba);
    encoded.map_err(|e| unwritten(path, &e.to_string()))?;
    let film = OpenOptions::new().create(true).append(true).open(path);
    film.and_then(|mut film| film.write_all(&bytes)).map_err(|e| unwritten(path, &e.to_string()))
}

/// A format of the surface that takes the finished picture as it is; gamma is in it already.
pub(crate) fn format(surface: &wgpu::Surface<'static>, adapter: &wgpu::Adapter) -> Option<wgpu::TextureFormat> {
    let formats = surface.get_capabilities(adapter).formats;
    let plain = formats.iter().find(|f| **f == PICTURE || **f == wgpu::TextureFormat::Bgra8Unorm);
    plain.or_else(|| formats.iter().find(|f| !f.is_srgb())).or(formats.first()).copied()
}

/// How pictures come onto the window. On a GPU whole ones: the newest at each of the display's, where that is offered, else each in its turn, if they are in
/// step with the display, for then nobody waits. Else, as those that the processor draws, at once, for the process paces itself.
fn present_mode(offered: &[wgpu::PresentMode], is_software: bool, is_in_step: bool) -> wgpu::PresentMode {
    match is_software {
        false if offered.contains(&wgpu::PresentMode::Mailbox) => wgpu::PresentMode::Mailbox,
        false if is_in_step => wgpu::PresentMode::Fifo,
        _ => wgpu::PresentMode::AutoNoVsync,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::PresentMode::{AutoNoVsync, Fifo, Immediate, Mailbox};

    #[test]
    fn a_gpus_pictures_are_not_torn_where_that_makes_nobody_wait_and_a_processors_come_at_once() {
        for offered in [&[Immediate, Mailbox, Fifo][..], &[Fifo, Mailbox]] {
            assert_eq!([false, true].map(|in_step| present_mode(offered, false, in_step)), [Mailbox; 2], "{offered:?}");
            assert_eq!([false, true].map(|in_step| present_mode(offered, true, in_step)), [AutoNoVsync; 2], "{offered:?}");
        }
        for offered in [&[Immediate, Fifo][..], &[Fifo], &[]] {
            assert_eq!(present_mode(offered, false, true), Fifo, "{offered:?}");
            assert_eq!(present_mode(offered, false, false), AutoNoVsync, "{offered:?}: more pictures than the display shows");
            assert_eq!(present_mode(offered, true, true), AutoNoVsync, "{offered:?}");
        }
    }
}
