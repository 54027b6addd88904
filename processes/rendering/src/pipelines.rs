//! Shaders, layouts and pipelines: made once per device, shared by the stage and the renderer.
use std::{
    sync::{Arc, LazyLock},
    time::Instant,
};

use wgpu::{BindingType as Bind, ShaderStages as At, TextureFormat as Format};

use crate::{
    gpu::{Gpu, Without},
    layouts::{field_entries, object_entries, post_entries, scene_entries, shape_entries},
};

/// Linear light before the post passes.
pub(crate) const LIGHT: Format = Format::Rgba16Float;
/// The finished picture.
pub(crate) const PICTURE: Format = Format::Rgba8Unorm;
/// Depth of the scene pass.
pub(crate) const DEPTH: Format = Format::Depth32Float;

/// Pipelines that are made beside pictures take a fifth of a core: what draws and what computes is on the same ones.
const REST: u32 = 4;

/// What a device must have to draw the lines of meshes.
pub(crate) const LINES: wgpu::Features = wgpu::Features::POLYGON_MODE_LINE;

/// What a scene pipeline colours: `scene.wgsl` has a function for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Class {
    Tissue,
    Metal,
    Gas,
}

/// Scene pipelines by class, fluid, camera, translucency, and the side of a face that is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Variant {
    pub class: Class,
    pub fluid: bool,
    pub outside: bool,
    pub translucent: bool,
    pub hidden: Option<wgpu::Face>,
}

/// A pipeline that is made by whoever draws with it first, or by [`Pipelines::make_all`].
pub(crate) type Late<T> = LazyLock<T, Box<dyn FnOnce() -> T + Send>>;

/// What pipelines are made of.
struct Parts {
    device: wgpu::Device,
    samples: u32,
    without: Without,
    scene: Part,
    shape: Part,
    post: Part,
    field: Part,
    nothing: wgpu::PipelineLayout,
}

/// A shader and the layout of what it reads.
struct Part {
    layout: wgpu::PipelineLayout,
    module: wgpu::ShaderModule,
}

pub(crate) struct Pipelines {
    pub scene_layout: wgpu::BindGroupLayout,
    object_layout: wgpu::BindGroupLayout,
    shape_layout: wgpu::BindGroupLayout,
    pub post_layout: wgpu::BindGroupLayout,
    pub field_layout: wgpu::BindGroupLayout,
    scene: Vec<(Variant, Late<wgpu::RenderPipeline>)>,
    pub mask: Late<wgpu::RenderPipeline>,
    /// The lines of a mesh, where the device draws lines.
    pub lines: Option<Late<wgpu::RenderPipeline>>,
    /// What the lamp's light meets first.
    pub shadow: Late<wgpu::RenderPipeline>,
    pub normals: Late<wgpu::ComputePipeline>,
    pub field: Late<wgpu::ComputePipeline>,
    pub defocus: Late<wgpu::RenderPipeline>,
    pub shrink: Late<wgpu::RenderPipeline>,
    pub meter: Late<wgpu::ComputePipeline>,
    pub blur_across: Late<wgpu::RenderPipeline>,
    pub blur_down: Late<wgpu::RenderPipeline>,
    /// Without and with what is out of focus.
    pub finish: [Late<wgpu::RenderPipeline>; 2],
    /// The two that stand in for it where the scene is drawn coarsely.
    pub tone: Late<wgpu::RenderPipeline>,
    pub plain: Late<wgpu::RenderPipeline>,
    pub text: Late<wgpu::RenderPipeline>,
    pub show: Option<(Format, Late<wgpu::RenderPipeline>)>,
}

impl Pipelines {
    /// `shown` is the format of a window's surface, if there is one. Compiles the shaders; a pipeline is made when it is wanted.
    pub(crate) fn new(gpu: &Gpu, shown: Option<Format>) -> Self {
        let d = &gpu.device;
        let scene_layout = layout(d, "scene", &scene_entries());
        let object_layout = layout(d, "object", &object_entries());
        let shape_layout = layout(d, "shape", &shape_entries());
        let post_layout = layout(d, "post", &post_entries());
        let field_layout = layout(d, "field", &field_entries());
        let part = |groups: &[&wgpu::BindGroupLayout], shader| Part {
            layout: pipeline_layout(d, groups),
            module: d.create_shader_module(shader),
        };
        let parts = Arc::new(Parts {
            device: d.clone(),
            samples: gpu.samples,
            without: gpu.without,
            scene: part(&[&scene_layout, &object_layout], wgpu::include_wgsl!("shaders/scene.wgsl")),
            shape: part(&[&shape_layout], wgpu::include_wgsl!("shaders/normals.wgsl")),
            post: part(&[&post_layout], wgpu::include_wgsl!("shaders/post.wgsl")),
            field: part(&[&field_layout], wgpu::include_wgsl!("shaders/field.wgsl")),
            nothing: pipeline_layout(d, &[]),
        });
        let screen = |entry, format| late(&parts, move |parts| screen_pipeline(parts, entry, &[], format));
        let finish = |focused| late(&parts, move |parts| screen_pipeline(parts, "finish", &[("FOCUSED", focused)], PICTURE));
        Self {
            scene: variants().map(|v| (v, late(&parts, move |parts| scene_pipeline(parts, v)))).collect(),
            shadow: late(&parts, shadow_pipeline),
            mask: late(&parts, mask_pipeline),
            lines: gpu.draws_lines().then(|| late(&parts, line_pipeline)),
            normals: late(&parts, |parts| compute_pipeline(&parts.device, &parts.shape, "main")),
            field: late(&parts, |parts| compute_pipeline(&parts.device, &parts.field, "main")),
            defocus: screen("defocus", LIGHT),
            shrink: screen("shrink", LIGHT),
            meter: late(&parts, |parts| compute_pipeline(&parts.device, &parts.post, "meter")),
            blur_across: screen("blur_across", LIGHT),
            blur_down: screen("blur_down", LIGHT),
            finish: [0.0, 1.0].map(finish),
            tone: screen("tone", PICTURE),
            plain: screen("plain", PICTURE),
            text: late(&parts, text_pipeline),
            show: shown.map(|format| (format, screen("show", format))),
            scene_layout,
            object_layout,
            shape_layout,
            post_layout,
            field_layout,
        }
    }

    /// Makes what nobody has drawn with yet, so that the first to do so need not wait; rests after each for [`REST`] times as long as it took.
    pub(crate) fn make_all(&self) {
        let make = |force: &dyn Fn()| {
            let began = Instant::now();
            force();
            std::thread::sleep(REST * began.elapsed());
        };
        let late = [&self.mask, &self.shadow, &self.defocus, &self.shrink, &self.blur_across, &self.blur_down, &self.text];
        let last = self.finish.iter().chain([&self.tone, &self.plain]);
        for pipeline in self.scene.iter().map(|(_, pipeline)| pipeline).chain(late).chain(last).chain(&self.lines) {
            make(&|| _ = LazyLock::force(pipeline));
        }
        for pipeline in [&self.normals, &self.field, &self.meter] {
            make(&|| _ = LazyLock::force(pipeline));
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
    let (back, front) = (Some(wgpu::Face::Back), Some(wgpu::Face::Front));
    // Tissue is seen through the lens in halves, from outside as a whole; of a bubble its nearer half is seen.
    let seen = [
        (Class::Tissue, true, None),
        (Class::Tissue, false, back),
        (Class::Tissue, false, front),
        (Class::Metal, true, None),
        (Class::Metal, false, None),
        (Class::Gas, true, back),
        (Class::Gas, false, back),
    ];
    let opaque = |(class, outside, hidden), fluid| Variant { class, fluid, outside, translucent: false, hidden };
    let glass = Variant { translucent: true, ..opaque((Class::Tissue, true, None), false) };
    seen.into_iter().flat_map(move |of| [false, true].map(|fluid| opaque(of, fluid))).chain([glass])
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

/// What `make` makes of the parts, once it is wanted.
fn late<T>(parts: &Arc<Parts>, make: impl FnOnce(&Parts) -> T + Send + 'static) -> Late<T> {
    let parts = Arc::clone(parts);
    LazyLock::new(Box::new(move || make(&parts)))
}

fn compute_pipeline(d: &wgpu::Device, part: &Part, entry: &str) -> wgpu::ComputePipeline {
    d.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&part.layout),
        module: &part.module,
        entry_point: Some(entry),
        compilation_options: Default::default(),
        cache: None,
    })
}

/// A pipeline that draws objects of the stage with `scene.wgsl`.
fn mesh_pipeline(
    parts: &Parts,
    primitive: wgpu::PrimitiveState,
    depth_stencil: wgpu::DepthStencilState,
    samples: u32,
    fragment: Option<wgpu::FragmentState<'_>>,
) -> wgpu::RenderPipeline {
    let Part { layout, module } = &parts.scene;
    let attributes = attributes();
    let buffers = [0, 1, 2, 3, 4, 5].map(|location: usize| Some(points(&attributes[location])));
    parts.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: fragment.as_ref().and_then(|fragment| fragment.entry_point),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &buffers,
        },
        primitive,
        depth_stencil: Some(depth_stencil),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        fragment,
        multiview_mask: None,
        cache: None,
    })
}

/// What colours the texels of an object.
fn shaded<'a>(
    parts: &'a Parts,
    entry: &'a str,
    constants: &'a [(&'a str, f64)],
    targets: &'a [Option<wgpu::ColorTargetState>],
) -> Option<wgpu::FragmentState<'a>> {
    let compilation_options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
    Some(wgpu::FragmentState { module: &parts.scene.module, entry_point: Some(entry), compilation_options, targets })
}

/// Over what lies behind, whose alpha stays: by that the focus knows how far off it is.
const SEEN_THROUGH: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendState::ALPHA_BLENDING.color,
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
};

fn light_target(blend: Option<wgpu::BlendState>) -> [Option<wgpu::ColorTargetState>; 1] {
    [Some(wgpu::ColorTargetState { format: LIGHT, blend, write_mask: wgpu::ColorWrites::ALL })]
}

fn scene_pipeline(parts: &Parts, v: Variant) -> wgpu::RenderPipeline {
    let classes = [("METAL", v.class == Class::Metal), ("GAS", v.class == Class::Gas)];
    let kinds = classes.into_iter().chain([("FLUID", v.fluid), ("OUTSIDE", v.outside)]);
    let all = kinds.chain(parts.without.named());
    let constants: Vec<(&str, f64)> = all.map(|(name, is)| (name, f64::from(u8::from(is)))).collect();
    let blend = match v.class {
        Class::Gas => Some(SEEN_THROUGH),
        _ => v.translucent.then_some(wgpu::BlendState::ALPHA_BLENDING),
    };
    let targets = light_target(blend);
    let primitive = wgpu::PrimitiveState { cull_mode: v.hidden, ..Default::default() };
    let fragment = shaded(parts, "fragment", &constants, &targets);
    mesh_pipeline(parts, primitive, depth(!v.translucent), parts.samples, fragment)
}

/// Position, normal, rest, flag, openness and share of the lobes of a vertex, as `scene.wgsl` reads them, each from a buffer of its own.
fn attributes() -> [[wgpu::VertexAttribute; 1]; 6] {
    let (point, flag, share) = (wgpu::VertexFormat::Float32x3, wgpu::VertexFormat::Uint32, wgpu::VertexFormat::Float32);
    let formats = [point, point, point, flag, share, share];
    [0, 1, 2, 3, 4, 5]
        .map(|location: usize| [wgpu::VertexAttribute { format: formats[location], offset: 0, shader_location: location as u32 }])
}

fn points(attributes: &[wgpu::VertexAttribute; 1]) -> wgpu::VertexBufferLayout<'_> {
    let [attribute] = attributes;
    wgpu::VertexBufferLayout { array_stride: attribute.format.size(), step_mode: wgpu::VertexStepMode::Vertex, attributes }
}

/// The lines of a mesh, a little nearer than its faces, over them.
fn line_pipeline(parts: &Parts) -> wgpu::RenderPipeline {
    let bias = wgpu::DepthBiasState { constant: -2, slope_scale: -1.0, clamp: 0.0 };
    let primitive = wgpu::PrimitiveState { polygon_mode: wgpu::PolygonMode::Line, ..Default::default() };
    let targets = light_target(Some(wgpu::BlendState::ALPHA_BLENDING));
    let depth_stencil = wgpu::DepthStencilState { bias, ..depth(false) };
    mesh_pipeline(parts, primitive, depth_stencil, parts.samples, shaded(parts, "line", &[], &targets))
}

/// Depth alone, from the lamp. What faces the lamp steeply is taken a little farther away, so that nothing shades itself.
fn shadow_pipeline(parts: &Parts) -> wgpu::RenderPipeline {
    let bias = wgpu::DepthBiasState { constant: 2, slope_scale: 2.0, clamp: 0.0 };
    mesh_pipeline(parts, Default::default(), wgpu::DepthStencilState { bias, ..depth(true) }, 1, None)
}

fn depth(is_written: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH,
        depth_write_enabled: Some(is_written),
        depth_compare: Some(wgpu::CompareFunction::Less),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

/// What the round mask hides is not drawn: in front of everything there lies a frame without colour.
fn mask_pipeline(parts: &Parts) -> wgpu::RenderPipeline {
    let target = wgpu::ColorTargetState { format: LIGHT, blend: None, write_mask: wgpu::ColorWrites::empty() };
    let multisample = wgpu::MultisampleState { count: parts.samples, ..Default::default() };
    let Parts { device, nothing, scene, .. } = parts;
    plain_pipeline(device, nothing, &scene.module, ["frame", "nothing"], &[], target, (Some(depth(true)), multisample))
}

fn text_pipeline(parts: &Parts) -> wgpu::RenderPipeline {
    let blend = Some(wgpu::BlendState::ALPHA_BLENDING);
    let target = wgpu::ColorTargetState { format: PICTURE, blend, write_mask: wgpu::ColorWrites::COLOR };
    let Parts { device, post, .. } = parts;
    plain_pipeline(device, &post.layout, &post.module, ["screen", "text"], &[], target, (None, Default::default()))
}

fn screen_pipeline(parts: &Parts, entry: &str, constants: &[(&str, f64)], format: Format) -> wgpu::RenderPipeline {
    let Parts { device, post, .. } = parts;
    let entries = ["screen", entry];
    plain_pipeline(device, &post.layout, &post.module, entries, constants, format.into(), (None, Default::default()))
}

/// A pipeline without vertex buffers: `entries` of vertices and fragments.
fn plain_pipeline(
    d: &wgpu::Device,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entries: [&str; 2],
    constants: &[(&str, f64)],
    target: wgpu::ColorTargetState,
    (depth_stencil, multisample): (Option<wgpu::DepthStencilState>, wgpu::MultisampleState),
) -> wgpu::RenderPipeline {
    let [vertices, fragments] = entries.map(Some);
    d.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: fragments,
        layout: Some(layout),
        vertex: wgpu::VertexState { module, entry_point: vertices, compilation_options: Default::default(), buffers: &[] },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil,
        multisample,
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: fragments,
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
