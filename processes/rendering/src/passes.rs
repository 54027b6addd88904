//! The passes of a frame, in their order: normals and field, shadow, scene, focus, glow and exposure, lens and text.
use crate::{
    camera::Eye,
    overlay::{COLUMNS, EDGE_PX},
    pipelines::{Class, Variant},
    renderer::Renderer,
    stage::{Material, Object},
    uniforms::glyph_px,
};

/// Threads per workgroup of the normals pass.
const GROUP: u32 = 64;
/// Vertices of the frame around the round field, as `scene.wgsl` makes them.
const MASK_VERTICES: u32 = 6 * 32;
/// When in the scene pass an object is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Round {
    /// What is opaque and seen as a whole.
    Whole,
    /// What is opaque and seen in halves.
    Halved,
    /// What all of that is seen through.
    Gas,
    /// Tissue through which all else is seen.
    Glass,
}

/// The rounds of the scene pass, and which side of a face is left out in each. What is not seen as a whole is seen in halves: what looks at the lens first,
/// so that the organ's outside is not coloured behind its inside.
const ROUNDS: [(Round, Option<wgpu::Face>); 5] = [
    (Round::Whole, None),
    (Round::Halved, Some(wgpu::Face::Back)),
    (Round::Halved, Some(wgpu::Face::Front)),
    (Round::Gas, Some(wgpu::Face::Back)),
    (Round::Glass, None),
];

impl Round {
    fn of(object: &Object, eye: &Eye) -> Self {
        match object.appearance.material {
            Material::Gas => Self::Gas,
            Material::Metal => Self::Whole,
            Material::MucosaTissue if eye.tissue_alpha < 0.999 => Self::Glass,
            _ if eye.round => Self::Halved,
            _ => Self::Whole,
        }
    }
}

fn class(object: &Object) -> Class {
    match object.appearance.material {
        Material::Metal => Class::Metal,
        Material::Gas => Class::Gas,
        _ => Class::Tissue,
    }
}

/// A scene is coarse from where so many times its side are at most so many times the picture's: then light becomes a picture before it is enlarged.
const COARSE: [u32; 2] = [8, 5];

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

    /// `is_begun`: the shadow's pass has begun what is timed as the scene; `has_lines`: the lines of the meshes are wanted.
    pub(crate) fn scene_pass(&self, encoder: &mut wgpu::CommandEncoder, eye: &Eye, [is_begun, has_lines]: [bool; 2]) -> u64 {
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
            timestamp_writes: self.timer.as_ref().map(|t| t.render(1, !is_begun, true)),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_bind_group(0, &self.scene_group, &[]);
        let mut triangles = 0;
        let seen = |o: &&Object| o.indices > 0 && !(eye.round && o.appearance.external_only);
        if eye.round {
            pass.set_pipeline(&self.pipelines.mask);
            pass.draw(0..MASK_VERTICES, 0..1);
        }
        for (round, hidden) in ROUNDS {
            // Pathology and tools, which have the higher numbers, lie before the organ.
            let due = |o: &&Object| Round::of(o, eye) == round;
            for object in self.stage.objects.values().rev().filter(seen).filter(due) {
                let translucent = round == Round::Glass;
                let fluid = self.fluid_shown && !translucent;
                let variant = Variant { class: class(object), fluid, outside: !eye.round, translucent, hidden };
                pass.set_pipeline(self.pipelines.scene(variant));
                object.draw(&mut pass);
                // The halves of an object are its faces once.
                triangles += if hidden == Some(wgpu::Face::Front) { 0 } else { u64::from(object.indices / 3) };
            }
        }
        if let Some(lines) = self.pipelines.lines.as_ref().filter(|_| has_lines && !eye.round) {
            pass.set_pipeline(lines);
            self.stage
                .objects
                .values()
                .filter(seen)
                .filter(|o| class(o) == Class::Tissue)
                .for_each(|object| object.draw(&mut pass));
        }
        triangles
    }

    /// What is out of focus, if there is time for it; says whether it was drawn.
    pub(crate) fn focus_pass(&self, encoder: &mut wgpu::CommandEncoder, eye: &Eye, wanted: bool) -> bool {
        let is_drawn = wanted && eye.focus.is_some();
        if is_drawn {
            self.screen_pass(
                encoder,
                &self.pipelines.defocus,
                &self.targets.soft,
                &self.targets.from_scene,
                Some((2, true, true)),
            );
        }
        is_drawn
    }

    pub(crate) fn glow_passes(&self, encoder: &mut wgpu::CommandEncoder, bloom: bool) {
        let (p, t) = (&self.pipelines, &self.targets);
        self.screen_pass(encoder, &p.shrink, &t.quarter, &t.from_scene, Some((3, true, !bloom)));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("meter"), timestamp_writes: None });
        pass.set_pipeline(&p.meter);
        pass.set_bind_group(0, &t.from_quarter, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        if bloom {
            self.screen_pass(encoder, &p.blur_across, &t.across, &t.from_quarter, None);
            self.screen_pass(encoder, &p.blur_down, &t.glow, &t.from_across, Some((3, false, true)));
        }
    }

    /// The picture, where the mask leaves one, and the text over it.
    pub(crate) fn finish_pass(&self, encoder: &mut wgpu::CommandEncoder, eye: &Eye, is_focused: bool, rows: usize) {
        let (t, p, [width, height]) = (&self.targets, &self.pipelines, self.targets.sizes.shown);
        let side = width.min(height);
        let is_coarse = eye.round && !is_focused && COARSE[0] * t.sizes.inner[0] <= COARSE[1] * side;
        if is_coarse {
            self.screen_pass(encoder, &p.tone, &t.toned, &t.to_picture, Some((4, true, false)));
        }
        let mut pass = screen(encoder, &t.picture_view, self.timer.as_ref().map(|timer| timer.render(4, !is_coarse, true)));
        if eye.round {
            pass.set_scissor_rect((width - side) / 2, (height - side) / 2, side, side);
        }
        if is_coarse {
            pass.set_pipeline(&p.plain);
            pass.set_bind_group(0, &t.from_toned, &[]);
        } else {
            pass.set_pipeline(&p.finish[usize::from(is_focused)]);
            pass.set_bind_group(0, &t.to_picture, &[]);
        }
        pass.draw(0..3, 0..1);
        if rows > 0 {
            let glyph_px = glyph_px(height as f32) as u32;
            let [wide, high] = [7 * COLUMNS, 11 * rows].map(|cells| EDGE_PX + glyph_px * cells as u32);
            pass.set_scissor_rect(0, 0, wide.min(width), high.min(height));
            pass.set_pipeline(&self.pipelines.text);
            pass.draw(0..3, 0..1);
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
