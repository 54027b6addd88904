//! What the lamp at the scope's tip does not reach: a map of how far its light goes, drawn from the lamp, and looked into by what is lit.
//!
//! The lamp lies a millimetre beside the lens, so that a shadow is seen where something stands off the wall behind it: the wire of a loop, a polyp, a
//! chip. What throws one is whatever is not the lining; the folds of that shade themselves by their slope. In the map its facets, which are flat, 2 to 3 mm
//! wide and lit as if they were round, would shade themselves where they turn away from the lamp, and what a fold throws a millimetre beside the lens is
//! a sliver. Outside the lamp is the room's.
use glam::Mat4;

use crate::{
    camera::Eye,
    pipelines::{DEPTH, Pipelines, group},
    renderer::{Renderer, buffer},
    stage::{Material, Object},
    targets::view,
    uniforms::Globals,
};

/// Side of the map, px: 0.3 mm of a wall at 20 mm.
const SIDE_PX: u32 = 256;
/// Half of the angle that the lamp lights, rad: to where its cone ends (cosine 0.42), and some.
const HALF_RAD: f32 = 1.15;
/// Width of a texel of it at a distance of one.
pub(crate) fn texel() -> f32 {
    2.0 * HALF_RAD.tan() / SIDE_PX as f32
}

/// Nothing nearer to the lamp throws a shadow, m, and nothing farther.
const RANGE_M: [f32; 2] = [5.0e-4, 0.12];

/// The map, and what its pass reads.
pub(crate) struct Shadow {
    pub map: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    /// The scene's uniforms as its pass has them: seen from the lamp.
    pub globals: wgpu::Buffer,
    /// Stands where the map does while that is drawn.
    pub blank: wgpu::TextureView,
}

impl Shadow {
    pub(crate) fn new(d: &wgpu::Device) -> Self {
        let texture = |side: u32| {
            view(&d.create_texture(&wgpu::TextureDescriptor {
                label: Some("shadow"),
                size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: DEPTH,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            }))
        };
        Self {
            map: texture(SIDE_PX),
            sampler: d.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare: Some(wgpu::CompareFunction::LessEqual),
                ..Default::default()
            }),
            globals: buffer(d, size_of::<Globals>() as u64, wgpu::BufferUsages::UNIFORM),
            blank: texture(1),
        }
    }
}

/// From the station's frame to the map of an eye's lamp.
pub(crate) fn lamp_view(eye: &Eye) -> Mat4 {
    let up = eye.light_axis.any_orthogonal_vector();
    let proj = glam::camera::rh::proj::directx::perspective(2.0 * HALF_RAD, 1.0, RANGE_M[0], RANGE_M[1]);
    proj * glam::camera::rh::view::look_to_mat4(eye.light_m, eye.light_axis, up)
}

/// Whether an object throws a shadow through the lens. Gas lets the light through, and what drifts is too small.
fn is_solid(object: &Object) -> bool {
    let look = &object.appearance;
    object.indices > 0
        && !look.external_only
        && !matches!(look.material, Material::MucosaTissue | Material::Gas | Material::Flake)
}

impl Renderer {
    /// Whether anything throws a shadow in a picture of this eye.
    pub(crate) fn has_shadows(&self, eye: &Eye) -> bool {
        eye.round && self.stage.objects.values().any(is_solid)
    }

    /// How far the lamp's light goes, drawn from the lamp. It is timed with the scene, whose pass comes next.
    pub(crate) fn shadow_pass(&self, encoder: &mut wgpu::CommandEncoder) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow"),
            color_attachments: &[],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.shadow.map,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: self.timer.as_ref().map(|timer| timer.render(1, true, false)),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&self.pipelines.shadow);
        pass.set_bind_group(0, &self.lamp_group, &[]);
        for object in self.stage.objects.values().filter(|object| is_solid(object)) {
            object.draw(&mut pass);
        }
    }
}

/// The scene's bindings for either pass.
pub(crate) fn bindings(
    d: &wgpu::Device,
    pipelines: &Pipelines,
    globals: &wgpu::Buffer,
    [noise, relief, fluid, map]: [&wgpu::TextureView; 4],
    [tiled, clamped, compared]: [&wgpu::Sampler; 3],
) -> wgpu::BindGroup {
    use wgpu::BindingResource::{Sampler, TextureView};
    let resources = [
        globals.as_entire_binding(),
        TextureView(noise),
        TextureView(relief),
        TextureView(fluid),
        Sampler(tiled),
        Sampler(clamped),
        TextureView(map),
        Sampler(compared),
    ];
    group(d, &pipelines.scene_layout, &resources)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Endoscope};

    #[test]
    fn the_map_has_what_the_lamp_lights_and_the_nearer_is_the_smaller_depth() {
        let scope = Endoscope { tip_m: [0.0, 0.0, 0.01], ..Endoscope::default() };
        let eye = Camera::Endoscope(scope).eye(1.0);
        let lamp = lamp_view(&eye);
        let place = |at_m: glam::Vec3| lamp.project_point3(at_m);
        let (near, far) = (place(eye.light_m + 0.005 * eye.light_axis), place(eye.light_m + 0.030 * eye.light_axis));
        assert!(near.truncate().length() < 1e-4 && far.truncate().length() < 1e-4, "{near} {far}");
        assert!(0.0 < near.z && near.z < far.z && far.z < 1.0, "{near} {far}");
        // The edge of the light's cone is inside of the map.
        let aside = eye.light_axis.any_orthogonal_vector();
        let edge = place(eye.light_m + 0.02 * (0.42 * eye.light_axis + (1.0_f32 - 0.42 * 0.42).sqrt() * aside));
        assert!(edge.x.abs() < 1.0 && edge.y.abs() < 1.0, "{edge}");
    }
}
