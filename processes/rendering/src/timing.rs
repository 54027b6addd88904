//! Time per pass as the device counts it, where it can.

use crate::caught::caught;

/// Names of the passes that are timed apart, in the order of [`FrameStats::passes_ms`](crate::FrameStats).
pub use hyst_messages::PICTURE_PASSES as PASS_NAMES;

/// How many they are.
pub(crate) const PASSES: usize = PASS_NAMES.len();

/// The one of them that may be left out.
pub(crate) const FOCUS_PASS: usize = 2;

/// A begin and an end for every pass.
pub(crate) struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    period_ns: f32,
}

const BYTES: u64 = 16 * PASSES as u64;

impl Timer {
    /// None where the device keeps no time.
    pub(crate) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: Some("timer"), size: BYTES, usage, mapped_at_creation: false })
        };
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES as u32,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            period_ns: queue.get_timestamp_period(),
        })
    }

    /// Stamps of a render pass; `begin` and `end` say which of the pair it writes, so that several passes can count as one.
    pub(crate) fn render(&self, pass: u32, begin: bool, end: bool) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: begin.then_some(2 * pass),
            end_of_pass_write_index: end.then_some(2 * pass + 1),
        }
    }

    pub(crate) fn compute(&self, pass: u32) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        }
    }

    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..2 * PASSES as u32, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, BYTES);
    }

    /// Milliseconds per pass, of one that was left out those of the last time. To be called when the frame is done.
    pub(crate) fn read_ms(&self, device: &wgpu::Device) -> [f32; PASSES] {
        let mut out = [0.0; PASSES];
        self.readable.map_async(wgpu::MapMode::Read, .., |_| {});
        if !matches!(caught(|| device.poll(wgpu::PollType::Poll)), Ok(Ok(_))) {
            return out; // of a device that is lost: the next picture says so
        }
        if let Ok(bytes) = self.readable.get_mapped_range(..) {
            let stamps: Vec<u64> = bytes.chunks_exact(8).map(|b| b.try_into().map_or(0, u64::from_le_bytes)).collect();
            for (pass, ms) in out.iter_mut().enumerate() {
                let ticks = stamps[2 * pass + 1].saturating_sub(stamps[2 * pass]);
                *ms = ticks as f32 * self.period_ns * 1.0e-6;
            }
        }
        self.readable.unmap();
        out
    }
}
