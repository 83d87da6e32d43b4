//! A volume on the device.

use crate::cells::CellRanges;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::labels;
use rayon::prelude::*;
use std::sync::Arc;
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// Bytes uploaded at a time: what the driver holds twice while it copies.
const SLAB_BYTES: usize = 8 << 20;

/// A volume on the device, shared by all who draw it.
pub type SharedVolume = Arc<VolumeOnDevice>;

/// The channels of a volume as 3-D textures in no less than the precision of the file, with the cells of each.
#[derive(Debug)]
pub struct VolumeOnDevice {
    grid: Grid,
    pub(crate) channels: Vec<ChannelOnDevice>,
}

/// One channel.
#[derive(Debug)]
pub(crate) struct ChannelOnDevice {
    pub(crate) name: String,
    /// The labels whose places voxels hold, in order, where the channel holds labels.
    pub(crate) labels: Option<Vec<i64>>,
    pub(crate) cells: CellRanges,
    pub(crate) voxel_bytes: u64,
    pub(crate) bind_group: wgpu::BindGroup,
    pub(crate) view: wgpu::TextureView,
    /// value = raw · value_scale + value_offset, raw as the texture gives it.
    pub(crate) value_scale: f64,
    pub(crate) value_offset: f64,
    /// As the shader's frame has it: what takes the texture's number to the stored one, and that to the value.
    pub(crate) stored: [f64; 4],
}

impl VolumeOnDevice {
    /// Uploads a volume slab by slab; `progress` is told the part done, 0 to 1. The host's copy is not needed
    /// afterwards.
    ///
    /// # Errors
    /// If the volume is larger than a texture may be, has samples that are not finite, or the device has no room.
    pub fn upload(gpu: &Gpu, volume: &Volume, mut progress: impl FnMut(f64)) -> Result<Self, RenderError> {
        let grid = volume.grid().clone();
        let max = gpu.longest_volume_axis();
        if grid.dims().iter().any(|&d| d > max) {
            return Err(RenderError::VolumeTooLarge { dims: grid.dims(), max });
        }
        let count = volume.channels().len() as f64;
        let channels = volume
            .channels()
            .iter()
            .enumerate()
            .map(|(i, channel)| {
                ChannelOnDevice::upload(gpu, channel, &grid, |part| progress((i as f64 + part) / count))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { grid, channels })
    }

    /// Bytes of the voxels on the device, all channels.
    #[must_use]
    pub fn voxel_bytes(&self) -> u64 {
        self.channels.iter().map(|channel| channel.voxel_bytes).sum()
    }

    /// The volume's grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
}

impl ChannelOnDevice {
    fn upload(
        gpu: &Gpu,
        channel: &Channel,
        grid: &Grid,
        mut progress: impl FnMut(f64),
    ) -> Result<Self, RenderError> {
        let count = match &channel.voxels {
            Voxels::U8(_) | Voxels::I16(_) | Voxels::U16(_) => 0,
            Voxels::F32(v) => v.par_iter().filter(|s| !s.is_finite()).count(),
            Voxels::F64(v) => v.par_iter().filter(|s| !s.is_finite()).count(),
        };
        if count > 0 {
            return Err(RenderError::NotFinite { channel: channel.name.clone(), count });
        }
        let name = channel.name.clone();
        let placed;
        let (labels, channel) = match channel.kind {
            ChannelKind::Intensity => (None, channel),
            ChannelKind::Label => {
                let (numbers, places) = labels::places(channel)?;
                placed = places;
                (Some(numbers), &placed)
            }
        };
        let [width, height, depth] = grid.dims();
        // How stored numbers reach the shader: unorm formats as a part of their range.
        let is_widened = is_widened(gpu, channel);
        let (format, unit, shift) = match &channel.voxels {
            // 257 times as much of 65535 is the same part.
            Voxels::U8(_) if is_widened => (wgpu::TextureFormat::R16Unorm, 255.0, 0.0),
            Voxels::U8(_) => (wgpu::TextureFormat::R8Unorm, 255.0, 0.0),
            Voxels::U16(_) => (wgpu::TextureFormat::R16Unorm, 65535.0, 0.0),
            // Signed numbers shifted up: snorm would not tell -32768 from -32767.
            Voxels::I16(_) => (wgpu::TextureFormat::R16Unorm, 65535.0, -32768.0),
            Voxels::F32(_) | Voxels::F64(_) => (wgpu::TextureFormat::R32Float, 1.0, 0.0),
        };
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: depth };
        let texture = gpu.guarded("the volume's texture", || {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("volume"),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D3,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        })?;
        let stored_bytes = channel.voxels.voxel_type().bytes();
        let voxel_bytes = match &channel.voxels {
            Voxels::U8(_) if is_widened => 2,
            Voxels::F64(_) => 4,
            _ => stored_bytes,
        };
        let slice_voxels = width as usize * height as usize;
        let slices = (SLAB_BYTES / (slice_voxels * voxel_bytes)).clamp(1, depth as usize);
        let mut wide: Vec<u16> = Vec::new();
        let mut narrow: Vec<f32> = Vec::new();
        for z in (0..depth as usize).step_by(slices) {
            let count = slices.min(depth as usize - z);
            let range = z * slice_voxels..(z + count) * slice_voxels;
            let bytes: &[u8] = match &channel.voxels {
                Voxels::I16(v) => {
                    wide.clear();
                    wide.extend(v[range].iter().map(|&s| (i32::from(s) + 32768) as u16));
                    bytemuck::cast_slice(&wide)
                }
                Voxels::U8(v) if is_widened => {
                    wide.clear();
                    wide.extend(v[range].iter().map(|&s| u16::from(s) * 257));
                    bytemuck::cast_slice(&wide)
                }
                Voxels::F64(v) => {
                    narrow.clear();
                    narrow.extend(v[range].iter().map(|&s| volume::single(s)));
                    bytemuck::cast_slice(&narrow)
                }
                other => &other.as_bytes()[range.start * stored_bytes..range.end * stored_bytes],
            };
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y: 0, z: z as u32 },
                    aspect: wgpu::TextureAspect::All,
                },
                bytes,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(width * voxel_bytes as u32),
                    rows_per_image: Some(height),
                },
                wgpu::Extent3d { width, height, depth_or_array_layers: count as u32 },
            );
            // Sent and waited for, so that only one slab is held twice.
            gpu.queue.submit([]);
            gpu.device
                .poll(wgpu::PollType::wait_indefinitely())
                .map_err(|e| RenderError::Device { what: "the volume's upload", reason: e.to_string() })?;
            progress((z + count) as f64 / f64::from(depth));
        }
        let cells = CellRanges::of(channel, grid.dims(), filter_slack(channel, is_widened));
        let value_scale = channel.slope * unit;
        let value_offset = channel.slope * shift + channel.intercept;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let bind_group = Self::bind(gpu, &view)?;
        let integers = if matches!(channel.voxels, Voxels::F32(_) | Voxels::F64(_)) { 0.0 } else { unit };
        let stored = [integers, shift, channel.slope, channel.intercept];
        let voxel_bytes = (voxel_bytes * grid.voxel_count()) as u64;
        Ok(Self { name, labels, cells, voxel_bytes, bind_group, view, value_scale, value_offset, stored })
    }

    fn bind(gpu: &Gpu, view: &wgpu::TextureView) -> Result<wgpu::BindGroup, RenderError> {
        let sampler = gpu.linear_sampler();
        gpu.guarded("the volume's bindings", || {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume"),
                layout: &gpu.pipelines.volume_layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(view) },
                    wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
                ],
            })
        })
    }
}

/// Whether 8-bit voxels are held in 16 bits: software drivers filter 8-bit textures in 8-bit arithmetic, and the slopes of
/// a smooth volume become stairs. 16 bits they filter in float32, in the same time.
fn is_widened(gpu: &Gpu, channel: &Channel) -> bool {
    gpu.adapter().is_software && matches!(channel.voxels, Voxels::U8(_))
}

/// How far, in stored units, the filter may come to lie outside the eight voxels that it interpolates: a unit where 8-bit
/// textures are filtered in 8-bit arithmetic; other formats go through float32.
fn filter_slack(channel: &Channel, is_widened: bool) -> f64 {
    const FLOAT_ROUNDING: f64 = 1.0e-6;
    match &channel.voxels {
        Voxels::U8(_) if is_widened => 255.0 * FLOAT_ROUNDING,
        Voxels::U8(_) => 1.0,
        Voxels::I16(_) | Voxels::U16(_) => 65535.0 * FLOAT_ROUNDING,
        Voxels::F32(v) => {
            f64::from(v.iter().filter(|s| s.is_finite()).fold(0.0f32, |a, s| a.max(s.abs()))) * FLOAT_ROUNDING
        }
        Voxels::F64(v) => {
            f64::from(volume::single(v.iter().fold(0.0, |a, s| a.max(s.abs())))) * FLOAT_ROUNDING
        }
    }
}
