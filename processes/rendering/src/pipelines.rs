//! Shaders, layouts and pipelines: made once per device, shared by the stage and the renderer.
use wgpu::{BindingType as Bind, ShaderStages as At, TextureFormat as Format};

use crate::gpu::Gpu;

/// Linear light before the post passes.
pub(crate) const LIGHT: Format = Format::Rgba16Float;
/// The finished picture.
pub(crate) const PICTURE: Format = Format::Rgba8Unorm;
/// Depth of the scene pass.
pub(crate) const DEPTH: Format = Format::Depth32Float;

/// Scene pipelines by material class, fluid and translucency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Variant {
    pub metal: bool,
    pub fluid: bool,
    pub translucent: bool,
}

pub(crate) struct Pipelines {
    pub scene_layout: wgpu::BindGroupLayout,
    object_layout: wgpu::BindGroupLayout,
    shape_layout: wgpu::BindGroupLayout,
    pub post_layout: wgpu::BindGroupLayout,
    pub field_layout: wgpu::BindGroupLayout,
    scene: Vec<(Variant, wgpu::RenderPipeline)>,
    pub normals: wgpu::ComputePipeline,
    pub field: wgpu::ComputePipeline,
    pub shrink: wgpu::RenderPipeline,
    pub meter: wgpu::ComputePipeline,
    pub blur_across: wgpu::RenderPipeline,
    pub blur_down: wgpu::RenderPipeline,
    pub finish: wgpu::RenderPipeline,
    pub show: Option<(Format, wgpu::RenderPipeline)>,
}

impl Pipelines {
    /// `shown` is the format of a window's surface, if there is one.
    pub(crate) fn new(gpu: &Gpu, shown: Option<Format>) -> Self {
        let d = &gpu.device;
        let scene_layout = layout(d, "scene", &scene_entries());
        let object_layout = layout(d, "object", &[(At::VERTEX_FRAGMENT, uniform())]);
        let shape_layout = layout(d, "shape", &shape_entries());
        let post_layout = layout(d, "post", &post_entries());
        let field_layout = layout(d, "field", &field_entries());
        let scene_module = d.create_shader_module(wgpu::include_wgsl!("shaders/scene.wgsl"));
        let normals_module = d.create_shader_module(wgpu::include_wgsl!("shaders/normals.wgsl"));
        let post_module = d.create_shader_module(wgpu::include_wgsl!("shaders/post.wgsl"));
        let field_module = d.create_shader_module(wgpu::include_wgsl!("shaders/field.wgsl"));
        let scene_pipelines = pipeline_layout(d, &[&scene_layout, &object_layout]);
        let shape_pipelines = pipeline_layout(d, &[&shape_layout]);
        let post_pipelines = pipeline_layout(d, &[&post_layout]);
        let field_pipelines = pipeline_layout(d, &[&field_layout]);
        let screen = |entry, format| screen_pipeline(d, &post_pipelines, &post_module, entry, format);
        Self {
            scene: variants().map(|v| (v, scene_pipeline(gpu, &scene_pipelines, &scene_module, v))).collect(),
            normals: compute_pipeline(d, &shape_pipelines, &normals_module, "main"),
            field: compute_pipeline(d, &field_pipelines, &field_module, "main"),
            shrink: screen("shrink", LIGHT),
            meter: compute_pipeline(d, &post_pipelines, &post_module, "meter"),
            blur_across: screen("blur_across", LIGHT),
            blur_down: screen("blur_down", LIGHT),
            finish: screen("finish", PICTURE),
            show: shown.map(|format| (format, screen("show", format))),
            scene_layout,
            object_layout,
            shape_layout,
            post_layout,
            field_layout,
        }
    }

    pub(crate) fn scene(&self, wanted: Variant) -> &wgpu::RenderPipeline {
        let found = self.scene.iter().find(|(v, _)| *v == wanted);
        &found.unwrap_or(&self.scene[0]).1
    }

    pub(crate) fn object_group(&self, d: &wgpu::Device, uniform: &wgpu::Buffer) -> wgpu::BindGroup {
        group(d, &self.object_layout, &[uniform.as_entire_binding()])
    }

    /// positions, rest, triangles, first, incident, normals
    pub(crate) fn shape_group(&self, d: &wgpu::Device, buffers: [&wgpu::Buffer; 6]) -> wgpu::BindGroup {
        group(d, &self.shape_layout, &buffers.map(wgpu::Buffer::as_entire_binding))
    }
}

/// A bind group whose resources stand in the order of the layout's bindings.
pub(crate) fn group(
    d: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, r)| wgpu::BindGroupEntry { binding, resource: r.clone() }).collect();
    d.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

fn variants() -> impl Iterator<Item = Variant> {
    let bools = [false, true];
    let pairs = bools.into_iter().flat_map(move |metal| bools.map(|fluid| (metal, fluid)));
    let opaque = pairs.map(|(metal, fluid)| Variant { metal, fluid, translucent: false });
    opaque.chain([Variant { metal: false, fluid: false, translucent: true }])
}

fn uniform() -> Bind {
    Bind::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None }
}

fn storage(read_only: bool) -> Bind {
    Bind::Buffer { ty: wgpu::BufferBindingType::Storage { read_only }, has_dynamic_offset: false, min_binding_size: None }
}

fn texture(view_dimension: wgpu::TextureViewDimension) -> Bind {
    Bind::Texture { sample_type: wgpu::TextureSampleType::Float { filterable: true }, view_dimension, multisampled: false }
}

fn scene_entries() -> [(At, Bind); 6] {
    let solid = (At::FRAGMENT, texture(wgpu::TextureViewDimension::D3));
    let sampler = (At::FRAGMENT, Bind::Sampler(wgpu::SamplerBindingType::Filtering));
    [(At::VERTEX_FRAGMENT, uniform()), solid, solid, solid, sampler, sampler]
}

fn shape_entries() -> [(At, Bind); 6] {
    let read = (At::COMPUTE, storage(true));
    [read, read, read, read, read, (At::COMPUTE, storage(false))]
}

fn post_entries() -> [(At, Bind); 6] {
    let both = At::FRAGMENT | At::COMPUTE;
    let flat = (both, texture(wgpu::TextureViewDimension::D2));
    let sampler = (both, Bind::Sampler(wgpu::SamplerBindingType::Filtering));
    [(both | At::VERTEX, uniform()), flat, flat, sampler, (both, storage(false)), (both, storage(true))]
}

fn field_entries() -> [(At, Bind); 2] {
    let solid = Bind::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: LIGHT,
        view_dimension: wgpu::TextureViewDimension::D3,
    };
    [(At::COMPUTE, storage(true)), (At::COMPUTE, solid)]
}

fn layout(d: &wgpu::Device, label: &str, bindings: &[(At, Bind)]) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(bindings)
        .map(|(binding, &(visibility, ty))| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None })
        .collect();
    d.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn pipeline_layout(d: &wgpu::Device, groups: &[&wgpu::BindGroupLayout]) -> wgpu::PipelineLayout {
    let groups: Vec<_> = groups.iter().map(|g| Some(*g)).collect();
    d.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor { label: None, bind_group_layouts: &groups, immediate_size: 0 })
}

fn compute_pipeline(
    d: &wgpu::Device,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entry: &str,
) -> wgpu::ComputePipeline {
    d.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(layout),
        module,
        entry_point: Some(entry),
        compilation_options: Default::default(),
        cache: None,
    })
}

fn scene_pipeline(gpu: &Gpu, layout: &wgpu::PipelineLayout, module: &wgpu::ShaderModule, v: Variant) -> wgpu::RenderPipeline {
    let constants = [("METAL", f64::from(u8::from(v.metal))), ("FLUID", f64::from(u8::from(v.fluid)))];
    let (point, flag) = (wgpu::VertexFormat::Float32x3, wgpu::VertexFormat::Uint32);
    let formats = [point, point, point, flag];
    let attribute =
        |location: usize| wgpu::VertexAttribute { format: formats[location], offset: 0, shader_location: location as u32 };
    let attributes = [0, 1, 2, 3].map(|location| [attribute(location)]);
    let buffers = [0, 1, 2, 3].map(|location: usize| {
        let (array_stride, step_mode) = (formats[location].size(), wgpu::VertexStepMode::Vertex);
        Some(wgpu::VertexBufferLayout { array_stride, step_mode, attributes: &attributes[location] })
    });
    let blend = v.translucent.then_some(wgpu::BlendState::ALPHA_BLENDING);
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("scene"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &buffers,
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(!v.translucent),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: gpu.samples, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            targets: &[Some(wgpu::ColorTargetState { format: LIGHT, blend, write_mask: wgpu::ColorWrites::ALL })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn screen_pipeline(
    d: &wgpu::Device,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entry: &str,
    format: Format,
) -> wgpu::RenderPipeline {
    d.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(entry),
        layout: Some(layout),
        vertex: wgpu::VertexState { module, entry_point: Some("screen"), compilation_options: Default::default(), buffers: &[] },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
