//! The graphics device: Vulkan through wgpu, on a GPU or on lavapipe, headless or with a window's surface.
//!
//! Promise: every failure is a typed error of one line; nothing in here panics when a driver is missing, an adapter refuses or a
//! device is lost, and where wgpu does so while it waits for one, that is caught (`caught.rs`). Errors that wgpu reports out of line are
//! kept and returned by the next call of [`Gpu::check`].
use std::sync::{Arc, Mutex};

use crate::error::RenderError;

/// Samples of a texel where edges are smooth: what every adapter must take.
const SAMPLES: u32 = 4;

/// Which adapter to take where there are several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prefer {
    /// a discrete GPU if there is one, else whatever there is
    Fastest,
    /// the software rasterizer (lavapipe): the same pictures on every machine of one driver version
    Software,
}

/// Parts of how tissue looks that are left out, for developers: what one of them does is what a picture without it lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Without {
    /// vessels, and the net of the finest ones
    pub vessels: bool,
    /// how uneven the wall is, and the film on it
    pub bump: bool,
    /// the wet film: its glints, and what it mirrors at a glance
    pub wet: bool,
    /// light that travels in the tissue: around an edge, and out at a limb
    pub softness: bool,
}

impl Without {
    /// By what `scene.wgsl` leaves each of them out.
    pub(crate) fn named(self) -> [(&'static str, bool); 4] {
        [("NO_VESSELS", self.vessels), ("NO_BUMP", self.bump), ("NO_WET", self.wet), ("NO_SOFT", self.softness)]
    }
}

/// An opened device. Cloning its parts is cheap; they refer to one device.
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) adapter: wgpu::Adapter,
    /// Kept with the surface: the surface of a window belongs to the instance that made it.
    pub(crate) surface: Option<wgpu::Surface<'static>>,
    /// Samples of a texel of the scene, whose edges are smooth with more than one.
    pub(crate) samples: u32,
    /// What its tissue lacks.
    pub(crate) without: Without,
    faults: Arc<Mutex<Option<String>>>,
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gpu").field("adapter", &self.name()).finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens a device without a window.
    ///
    /// # Errors
    /// [`RenderError::NoVulkan`], [`RenderError::NoDevice`].
    pub fn new(prefer: Prefer) -> Result<Self, RenderError> {
        let instance = instance();
        Self::open(&instance, prefer, None)
    }

    /// Opens a device that can draw into a window; to be dropped before that.
    ///
    /// # Errors
    /// As [`Gpu::new`], and [`RenderError::NoSurface`].
    pub fn with_window(prefer: Prefer, pane: &crate::window::Pane) -> Result<Self, RenderError> {
        let instance = instance();
        let surface = instance
            .create_surface(pane.handle())
            .map_err(|e| RenderError::NoSurface { adapter: "Vulkan".into(), reason: one_line(&e.to_string()) })?;
        Self::open(&instance, prefer, Some(surface))
    }

    fn open(instance: &wgpu::Instance, prefer: Prefer, surface: Option<wgpu::Surface<'static>>) -> Result<Self, RenderError> {
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            force_fallback_adapter: prefer == Prefer::Software,
            compatible_surface: surface.as_ref(),
            ..Default::default()
        }))
        .map_err(|e| RenderError::NoVulkan(one_line(e.to_string().split(';').next().unwrap_or_default())))?;
        let name = adapter.get_info().name;
        let wanted = (wgpu::Features::TIMESTAMP_QUERY | crate::pipelines::LINES) & adapter.features();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("rendering"),
            required_features: wanted,
            required_limits: wgpu::Limits::default(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        }))
        .map_err(|e| RenderError::NoDevice { adapter: name, reason: one_line(&e.to_string()) })?;
        let faults = Arc::new(Mutex::new(None));
        let (late, lost) = (Arc::clone(&faults), Arc::clone(&faults));
        device.on_uncaptured_error(Arc::new(move |e| note(&late, e.to_string())));
        // Whoever takes it away, a picture cannot be made any more; nobody is left to hear of it when this is dropped.
        device.set_device_lost_callback(move |reason, text| note(&lost, format!("device lost, {reason:?} {text}")));
        let samples = if is_software(&adapter) { 1 } else { SAMPLES };
        Ok(Self { device, queue, adapter, surface, samples, without: Without::default(), faults })
    }

    /// With smooth edges, or without: by itself a GPU draws them smooth, and a software driver, which has no time for it, does not.
    pub fn smooth(self, smooth: bool) -> Self {
        Self { samples: if smooth { SAMPLES } else { 1 }, ..self }
    }

    /// With tissue that lacks a part of its looks.
    pub fn without(self, without: Without) -> Self {
        Self { without, ..self }
    }

    /// Name and kind of the adapter, for the log.
    pub fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?}, {})", info.name, info.device_type, info.driver_info)
    }

    /// Whether pictures come from the processor, so that they compete with the engines.
    pub fn is_software(&self) -> bool {
        is_software(&self.adapter)
    }

    /// Whether it draws the lines of meshes, which a view may ask for.
    pub fn draws_lines(&self) -> bool {
        self.device.features().contains(crate::pipelines::LINES)
    }

    /// The first error that was reported since the last call.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] with the driver's words.
    pub fn check(&self) -> Result<(), RenderError> {
        let fault = self.faults.lock().map_or_else(|held| held.into_inner().take(), |mut held| held.take());
        fault.map_or(Ok(()), |text| Err(RenderError::DeviceLost(one_line(&text))))
    }
}

fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == wgpu::DeviceType::Cpu
}

fn instance() -> wgpu::Instance {
    let mut wanted = wgpu::InstanceDescriptor::new_without_display_handle();
    wanted.backends = wgpu::Backends::VULKAN;
    wanted.flags = wgpu::InstanceFlags::empty();
    wgpu::Instance::new(wanted)
}

fn note(faults: &Mutex<Option<String>>, text: String) {
    if let Ok(mut held) = faults.lock() {
        held.get_or_insert(text);
    }
}

/// A message of a driver on one line of at most 200 characters.
pub(crate) fn one_line(text: &str) -> String {
    let joined: Vec<&str> = text.split_whitespace().collect();
    joined.join(" ").chars().take(200).collect()
}
