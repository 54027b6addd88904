//! The passes of a frame, in their order: normals and field, scene, glow and exposure, lens and text.
use crate::{
    camera::Eye,
    pipelines::Variant,
    renderer::Renderer,
    stage::{Material, Object},
};

/// Threads per workgroup of the normals pass.
const GROUP: u32 = 64;
/// Workgroups per row of a dispatch.
const GROUPS_PER_ROW: u32 = 32_768;

impl Renderer {
    pub(crate) fn shape_pass(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let timestamp_writes = self.timer.as_ref().map(|t| t.compute(0));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("normals"), timestamp_writes });
        self.fluid.convert(&mut pass, &self.pipelines);
        pass.set_pipeline(&self.pipelines.normals);
        for object in self.stage.objects.values_mut().filter(|o| o.moved) {
            object.moved = false;
            let groups = (object.vertices as u32).div_ceil(GROUP);
            pass.set_bind_group(0, &object.shape, &[]);
            pass.dispatch_workgroups(groups.min(GROUPS_PER_ROW), groups.div_ceil(GROUPS_PER_ROW), 1);
        }
    }

    pub(crate) fn scene_pass(&self, encoder: &mut wgpu::CommandEncoder, eye: &Eye) -> u64 {
        let samples = self.targets.samples.as_ref();
        let store = if samples.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: samples.unwrap_or(&self.targets.scene),
                depth_slice: None,
                resolve_target: samples.map(|_| &self.targets.scene),
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.targets.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            timestamp_writes: self.timer.as_ref().map(|t| t.render(1, true, true)),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_bind_group(0, &self.scene_group, &[]);
        let mut triangles = 0;
        let seen = |o: &&Object| o.indices > 0 && !(eye.round && o.appearance.external_only);
        for translucent in [false, true] {
            let is_translucent = |o: &&Object| o.appearance.material == Material::MucosaTissue && eye.tissue_alpha < 0.999;
            for object in self.stage.objects.values().filter(seen).filter(|o| is_translucent(o) == translucent) {
                let metal = object.appearance.material == Material::Metal;
                let fluid = self.fluid_shown && !translucent;
                pass.set_pipeline(self.pipelines.scene(Variant { metal, fluid, translucent }));
                pass.set_bind_group(1, &object.look, &[]);
                for (slot, points) in (0..).zip([&object.positions, &object.normals, &object.rest, &object.raw]) {
                    pass.set_vertex_buffer(slot, points.slice(..));
                }
                pass.set_index_buffer(object.triangles.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..object.indices, 0, 0..1);
                triangles += u64::from(object.indices / 3);
            }
        }
        triangles
    }

    pub(crate) fn glow_passes(&self, encoder: &mut wgpu::CommandEncoder, bloom: bool) {
        let (p, t) = (&self.pipelines, &self.targets);
        self.screen_pass(encoder, &p.shrink, &t.quarter, &t.from_scene, Some((2, true, !bloom)));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("meter"), timestamp_writes: None });
        pass.set_pipeline(&p.meter);
        pass.set_bind_group(0, &t.from_quarter, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        if bloom {
            self.screen_pass(encoder, &p.blur_across, &t.across, &t.from_quarter, None);
            self.screen_pass(encoder, &p.blur_down, &t.glow, &t.from_across, Some((2, false, true)));
        }
    }

    /// One triangle over the whole target. `stamp` is the timed pass and whether this begins and ends it.
    pub(crate) fn screen_pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &wgpu::RenderPipeline,
        target: &wgpu::TextureView,
        source: &wgpu::BindGroup,
        stamp: Option<(u32, bool, bool)>,
    ) {
        let stamps = stamp.and_then(|(pass, begin, end)| self.timer.as_ref().map(|t| t.render(pass, begin, end)));
        let mut pass = screen(encoder, target, stamps);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, source, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// A pass over a cleared target without depth.
pub(crate) fn screen<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    target: &wgpu::TextureView,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("screen"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
        })],
        depth_stencil_attachment: None,
        timestamp_writes,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}
