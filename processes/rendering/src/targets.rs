//! The textures that the passes draw into, sized for one inner and one shown resolution, and the bind groups that chain them.
use crate::gpu::Gpu;
use crate::pipelines::{DEPTH, LIGHT, PICTURE, Pipelines, group};

/// What a set of targets was made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// scene texels
    pub inner: [u32; 2],
    /// picture px
    pub shown: [u32; 2],
}

pub(crate) struct Targets {
    pub sizes: Sizes,
    pub scene: wgpu::TextureView,
    /// What the scene is drawn into where a texel has several samples, which are resolved into `scene`.
    pub samples: Option<wgpu::TextureView>,
    pub depth: wgpu::TextureView,
    pub soft: wgpu::TextureView,
    pub quarter: wgpu::TextureView,
    pub across: wgpu::TextureView,
    pub glow: wgpu::TextureView,
    /// The scene as a screen shows it, before it is enlarged.
    pub toned: wgpu::TextureView,
    pub picture: wgpu::Texture,
    pub picture_view: wgpu::TextureView,
    pub from_scene: wgpu::BindGroup,
    pub from_quarter: wgpu::BindGroup,
    pub from_across: wgpu::BindGroup,
    pub to_picture: wgpu::BindGroup,
    pub from_toned: wgpu::BindGroup,
    pub from_picture: wgpu::BindGroup,
}

/// Buffers that every post pass reads.
pub(crate) struct PostBuffers {
    pub uniform: wgpu::Buffer,
    pub exposure: wgpu::Buffer,
    pub glyphs: wgpu::Buffer,
    pub sampler: wgpu::Sampler,
}

impl Targets {
    pub(crate) fn new(gpu: &Gpu, pipelines: &Pipelines, post: &PostBuffers, sizes: Sizes) -> Self {
        let d = &gpu.device;
        let [half, small] = [2, 4].map(|part| sizes.inner.map(|n| (n / part).max(1)));
        let light = |size| view(&texture(d, size, LIGHT, 1));
        let (scene, soft, quarter, across, glow) = (light(sizes.inner), light(half), light(small), light(small), light(small));
        let dark = light([1, 1]);
        let depth = view(&texture(d, sizes.inner, DEPTH, gpu.samples));
        let samples = (gpu.samples > 1).then(|| view(&texture(d, sizes.inner, LIGHT, gpu.samples)));
        let toned = view(&texture(d, sizes.inner, PICTURE, 1));
        let picture = texture(d, sizes.shown, PICTURE, 1);
        let picture_view = view(&picture);
        let chain = |source: &wgpu::TextureView, glow: &wgpu::TextureView, soft: &wgpu::TextureView| {
            let resources = [
                post.uniform.as_entire_binding(),
                wgpu::BindingResource::TextureView(source),
                wgpu::BindingResource::TextureView(glow),
                wgpu::BindingResource::Sampler(&post.sampler),
                post.exposure.as_entire_binding(),
                post.glyphs.as_entire_binding(),
                wgpu::BindingResource::TextureView(soft),
            ];
            group(d, &pipelines.post_layout, &resources)
        };
        Self {
            sizes,
            from_scene: chain(&scene, &dark, &dark),
            from_quarter: chain(&quarter, &dark, &dark),
            from_across: chain(&across, &dark, &dark),
            to_picture: chain(&scene, &glow, &soft),
            from_toned: chain(&toned, &dark, &dark),
            from_picture: chain(&picture_view, &dark, &dark),
            scene,
            samples,
            depth,
            soft,
            quarter,
            across,
            glow,
            toned,
            picture,
            picture_view,
        }
    }
}

fn texture(d: &wgpu::Device, size: [u32; 2], format: wgpu::TextureFormat, samples: u32) -> wgpu::Texture {
    let readable = if format == PICTURE { wgpu::TextureUsages::COPY_SRC } else { wgpu::TextureUsages::empty() };
    let bound = if samples == 1 { wgpu::TextureUsages::TEXTURE_BINDING } else { wgpu::TextureUsages::empty() };
    d.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | bound | readable,
        view_formats: &[],
    })
}

pub(crate) fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A solid texture that tiles or holds a field.
pub(crate) fn solid(
    d: &wgpu::Device,
    dims: [u32; 3],
    levels: u32,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    d.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: dims[0], height: dims[1], depth_or_array_layers: dims[2] },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format,
        usage: usage | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}
