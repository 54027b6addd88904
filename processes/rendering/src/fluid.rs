//! The medium in the cavity as the picture needs it: a density of blood on a grid, seen along the ray.
use crate::{
    error::RenderError,
    gpu::Gpu,
    pipelines::{LIGHT, Pipelines, group},
    targets::{solid, view},
};

/// Cells of one field: far above the 128³ that the flow engine aims at.
pub const MAX_CELLS: usize = 4_194_304;

/// A field of density, borrowed for the call alone.
#[derive(Debug, Clone, Copy)]
pub struct FluidField<'a> {
    /// cells along x, y, z
    pub dims: [u32; 3],
    /// lowest corner of the grid's box, m
    pub min_m: [f32; 3],
    /// highest corner, m
    pub max_m: [f32; 3],
    /// density per cell, x fastest, 0 is clear; values that are not finite count as clear
    pub density: &'a [f32],
    /// extinction of green light at density 1, 1/m; that of red and blue is to it as in blood
    pub extinction_per_m: f32,
}

/// Density under which the medium is clear: with the extinction of blood as it is drawn a fiftieth of green light is lost over 2 cm, there and back.
pub const CLEAR: f32 = 2e-4;
/// How far from its middle a cell's density reaches, in cells, beside half of its own width: smoothing gives of it to the next one (`field.wgsl`), from
/// which it is interpolated to the one after that.
const REACH_CELLS: f32 = 1.5;
/// A box in which nothing lies.
const NOWHERE: [[f32; 4]; 2] = [[1.0; 4], [0.0; 4]];

/// Corners of the box about all cells in which there is blood, m, and as far as their density reaches.
fn where_any(field: &FluidField<'_>) -> [[f32; 4]; 2] {
    let [nx, ny, _] = field.dims.map(|cells| cells as usize);
    let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
    for (at, _) in field.density.iter().enumerate().filter(|(_, density)| **density > CLEAR) {
        for (axis, index) in [at % nx, at / nx % ny, at / (nx * ny)].into_iter().enumerate() {
            (low[axis], high[axis]) = (low[axis].min(index), high[axis].max(index));
        }
    }
    if low[0] == usize::MAX {
        return NOWHERE;
    }
    let place_m = |axis: usize, cells: f32| {
        let edge_m = (field.max_m[axis] - field.min_m[axis]) / field.dims[axis] as f32;
        field.min_m[axis] + cells * edge_m
    };
    let corner = |cells: [f32; 3]| [place_m(0, cells[0]), place_m(1, cells[1]), place_m(2, cells[2]), 0.0];
    [corner(low.map(|index| index as f32 - REACH_CELLS)), corner(high.map(|index| index as f32 + 1.0 + REACH_CELLS))]
}

/// The field on the device.
pub(crate) struct Fluid {
    dims: [u32; 3],
    density: wgpu::Buffer,
    convert: wgpu::BindGroup,
    pub view: wgpu::TextureView,
    pub min: [f32; 4],
    pub max: [f32; 4],
    /// Of green light at density 1, 1/m.
    pub extinction_per_m: f32,
    /// Corners of the box in which there is blood, m; of none the second lies before the first.
    pub where_any: [[f32; 4]; 2],
    pub changed: bool,
}

impl Fluid {
    /// A field of one clear cell, so that there is always something to bind.
    pub(crate) fn clear(gpu: &Gpu, pipelines: &Pipelines) -> Self {
        Self::sized(gpu, pipelines, [1; 3])
    }

    fn sized(gpu: &Gpu, pipelines: &Pipelines, dims: [u32; 3]) -> Self {
        let cells: u64 = dims.iter().map(|&n| u64::from(n)).product();
        let texture = solid(&gpu.device, dims, 1, LIGHT, wgpu::TextureUsages::STORAGE_BINDING);
        let view = view(&texture);
        let density = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("density"),
            size: 4 * cells,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let resources = [density.as_entire_binding(), wgpu::BindingResource::TextureView(&view)];
        let convert = group(&gpu.device, &pipelines.field_layout, &resources);
        Self {
            dims,
            density,
            convert,
            view,
            min: [0.0; 4],
            max: [0.0; 4],
            extinction_per_m: 0.0,
            where_any: NOWHERE,
            changed: false,
        }
    }

    /// Takes a new field; says whether the texture is another one, so that it must be bound anew.
    pub(crate) fn set(&mut self, gpu: &Gpu, pipelines: &Pipelines, field: &FluidField<'_>) -> Result<bool, RenderError> {
        let cells = field.dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d as usize)).unwrap_or(usize::MAX);
        let box_is_sane = (0..3).all(|a| (field.max_m[a] - field.min_m[a]).is_finite() && field.max_m[a] > field.min_m[a]);
        if cells != field.density.len() || cells == 0 || !box_is_sane || !field.extinction_per_m.is_finite() {
            return Err(RenderError::BadField { got: field.density.len(), dims: field.dims });
        }
        let longest = field.dims.iter().fold(0, |n, &d| n.max(d as usize));
        if cells > MAX_CELLS || longest > 512 {
            return Err(RenderError::TooLarge { what: "cells of the fluid field", got: cells, bound: MAX_CELLS });
        }
        let renewed = field.dims != self.dims;
        if renewed {
            *self = Self::sized(gpu, pipelines, field.dims);
        }
        gpu.queue.write_buffer(&self.density, 0, bytemuck::cast_slice(field.density));
        let ([x, y, z], [u, v, w]) = (field.min_m, field.max_m);
        self.min = [x, y, z, 0.0];
        self.max = [u, v, w, 0.0];
        self.extinction_per_m = field.extinction_per_m.clamp(0.0, 1.0e5);
        self.where_any = where_any(field);
        self.changed = true;
        Ok(renewed)
    }

    pub(crate) fn convert(&mut self, pass: &mut wgpu::ComputePass<'_>, pipelines: &Pipelines) {
        if std::mem::take(&mut self.changed) {
            let [x, y, z] = self.dims.map(|n| n.div_ceil(4));
            pass.set_pipeline(&pipelines.field);
            pass.set_bind_group(0, &self.convert, &[]);
            pass.dispatch_workgroups(x, y, z);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_blood_is_one_cell_and_a_half_wider_than_its_cells_and_that_of_none_is_none() {
        let mut density = [0.0; 60];
        let of = |density: &[f32]| {
            where_any(&FluidField { dims: [5, 4, 3], min_m: [0.0; 3], max_m: [0.05, 0.08, 0.09], density, extinction_per_m: 1.0 })
        };
        assert_eq!(of(&density), NOWHERE);
        density[5 * 4 + 5 + 2] = 0.5; // cell 2, 1, 1
        density[5 * 4 + 2 * 5 + 3] = f32::NAN;
        let [low, high] = of(&density);
        let close =
            |found: [f32; 4], wanted: [f32; 3]| found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-6);
        assert!(close(low, [0.005, -0.01, -0.015]) && close(high, [0.045, 0.07, 0.105]), "{low:?} {high:?}");
    }
}
