//! A scene on the device: its table, its cells to be seen, and the numbers every frame of it shares.

use crate::cells::{Counts, SeenRanges};
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::labels::{SeenLabels, looks_on_device};
use crate::layout::{GpuFrame, GpuStretch};
use crate::pipelines::Features;
use crate::several::{Several, Together};
use crate::table::{
    SeenValues, TABLE_WIDTH, TableDomain, extinction_table, optical_table, stretches, table_texture,
};
use crate::volume_on_device::{ChannelOnDevice, SharedVolume};
use crate::{DepthGridSize, FrameRenderer, Placed, Quality, StereoPlan, StereoRequest};
use scene::{Mode, Scene};
use spatial::{EyeView, Fov, Pose};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use wgpu::util::DeviceExt as _;

/// Steps whose tables are kept. A quality ladder has fewer rungs.
const TABLES_KEPT: usize = 16;

/// What every frame of a scene shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneNumbers {
    pub(crate) mode: Mode,
    pub(crate) lit: bool,
    /// Whether labels are shown.
    pub(crate) labels: bool,
    /// Whether skipping can bring something; the mean of a ray needs all of it.
    pub(crate) has_empty_cells: bool,
    /// Most samples along a ray that the device can take.
    pub(crate) most_samples: u32,
    pub(crate) frame: GpuFrame,
    /// Where the volumes lie, if there is more to show than the first alone.
    pub(crate) together: Option<Together>,
}

impl SceneNumbers {
    /// Whether rays are gone along in steps at a quality, so that longer ones make a picture cheaper; not from cell to cell,
    /// nor from label to label.
    #[must_use]
    pub fn takes_steps(&self, quality: &Quality) -> bool {
        let features = Features::of(self, quality);
        !features.cells && !features.labels
    }
}

/// A scene on the device. Made beside the frame loop, then handed to it whole: the old picture goes on meanwhile.
#[derive(Debug)]
pub struct SceneOnDevice {
    scene: Scene,
    gpu: Arc<Gpu>,
    pub(crate) volume: SharedVolume,
    numbers: SceneNumbers,
    domain: TableDomain,
    distances: wgpu::TextureView,
    acceleration_bytes: u64,
    /// The highest value of each cell, if the scene shows maxima.
    maxima: wgpu::TextureView,
    table_sampler: wgpu::Sampler,
    extinction: wgpu::Buffer,
    stretches: wgpu::Buffer,
    several: Option<Several>,
    bind_groups: Mutex<HashMap<[u64; 2], Arc<wgpu::BindGroup>>>,
}

impl SceneOnDevice {
    /// Works a scene out for a volume: the cells that can be seen and their distances. No voxel is read.
    ///
    /// # Errors
    /// If the volume has no such channel, the scene shows another volume too, or the device has no room.
    pub fn new(gpu: &Arc<Gpu>, volume: &SharedVolume, scene: &Scene) -> Result<Self, RenderError> {
        Self::of_several(gpu, std::slice::from_ref(volume), scene)
    }

    /// The same for a scene of several volumes, in the order in which the scene counts them.
    ///
    /// # Errors
    /// If a volume is not there or has no such channel, a registration leaves no grid, or the device has no room.
    pub fn of_several(gpu: &Arc<Gpu>, volumes: &[SharedVolume], scene: &Scene) -> Result<Self, RenderError> {
        let volume = volumes.first().ok_or(RenderError::NoSuchVolume { volume: 0, volumes: 0 })?;
        let channels = volume.channels.len();
        let channel = volume
            .channels
            .get(scene.channel)
            .ok_or(RenderError::NoSuchChannel { channel: scene.channel, channels })?;
        let looks = looks_of(channel, scene)?;
        let data = channel.cells.whole();
        let domain = TableDomain::of(scene, data);
        // Any step shows the same values; only the opacity of a step differs.
        let seen = SeenValues::of(&scene.transfer, &optical_table(scene, domain, 1.0), domain);
        // The shader's value may err by some units of float32's last place.
        let slack = (data[1] - data[0]).max(data[0].abs()).max(data[1].abs()) * 1.0e-6;
        let distances = match scene.mode {
            _ if let Some(looks) = &looks => {
                let seen = SeenLabels::of(looks);
                channel.cells.distance_to_seen(&seen)
            }
            Mode::EmissionAbsorption => channel.cells.distance_to_seen(&seen),
            Mode::Threshold | Mode::Cumulated => {
                channel.cells.distance_to_seen(&SeenSurface { threshold: scene.threshold, slack })
            }
            Mode::XRay | Mode::Maximum => vec![0],
        };
        // What a mode does not look at is a texture of one cell.
        let (maxima, maxima_dims) = match scene.mode {
            Mode::Maximum => channel.cells.maxima(),
            _ => (vec![0.0], [1; 3]),
        };
        let has_empty_cells = match scene.mode {
            Mode::XRay => false,
            Mode::Maximum => true,
            _ => distances.iter().any(|&d| d > 0),
        };
        let acceleration_bytes =
            (channel.cells.bytes() + distances.len() + size_of_val(maxima.as_slice())) as u64;
        let distances_dims = if distances.len() == 1 { [1; 3] } else { channel.cells.dims };
        let texture = |what, dims: [usize; 3], format, content: &[u8]| {
            gpu.small_texture(what, dims.map(|d| d as u32), wgpu::TextureDimension::D3, format, content)
        };
        let distances = texture(
            "the distances of the scene's cells",
            distances_dims,
            wgpu::TextureFormat::R8Uint,
            &distances,
        )?;
        let maxima = texture(
            "the maxima of the scene's cells",
            maxima_dims,
            wgpu::TextureFormat::R32Float,
            bytemuck::cast_slice(&maxima),
        )?;
        let numbers = |what: &'static str, content: &[u8]| {
            gpu.guarded(what, || {
                gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                    label: Some(what),
                    contents: content,
                    usage: wgpu::BufferUsages::STORAGE,
                })
            })
        };
        let extinction =
            numbers("the scene's extinction", bytemuck::cast_slice(&extinction_table(scene, domain)))?;
        let stretches = looks.unwrap_or_else(|| stretches(scene));
        let stretches = numbers("the scene's stretches", bytemuck::cast_slice(&stretches))?;
        let frame = GpuFrame {
            stored: channel.stored.map(|x| x as f32),
            ..frame_numbers(scene, domain, channel.value_scale, channel.value_offset)
        };
        let several = Several::of(gpu, volumes, scene)?;
        let numbers = SceneNumbers {
            together: several.as_ref().map(|several| several.together),
            mode: scene.mode,
            lit: scene.light.is_some(),
            labels: scene.labels.is_some(),
            has_empty_cells,
            most_samples: gpu.most_samples(),
            frame,
        };
        Ok(Self {
            scene: scene.clone(),
            gpu: gpu.clone(),
            volume: volume.clone(),
            numbers,
            domain,
            distances,
            acceleration_bytes,
            maxima,
            table_sampler: gpu.linear_sampler(),
            extinction,
            stretches,
            several,
            bind_groups: Mutex::default(),
        })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Bytes of what is there to skip with: what the cells hold, on the host, and how far it is to one that is seen, or
    /// their maxima, on the device.
    #[must_use]
    pub fn acceleration_bytes(&self) -> u64 {
        self.acceleration_bytes
    }

    /// The volume's grid.
    #[must_use]
    pub fn grid(&self) -> &volume::Grid {
        self.volume.grid()
    }

    /// What every frame of it shares, for [`crate::StereoPlan::new`].
    #[must_use]
    pub fn numbers(&self) -> &SceneNumbers {
        &self.numbers
    }

    /// Compiles what frames of this quality need and casts a few rays, so that the first frame does not wait: software
    /// drivers translate a shader only when it first runs.
    ///
    /// # Errors
    /// If the device has no room or was lost.
    pub fn prepare(&self, quality: &Quality) -> Result<(), RenderError> {
        let eye = EyeView {
            world_from_eye: Pose::IDENTITY,
            fov: Fov { left: -0.1, right: 0.1, up: 0.1, down: -0.1 },
        };
        for resolution_scale in [1.0, 0.5] {
            let request = StereoRequest {
                eyes: &[eye; 2],
                placed: Placed::in_room(&self.scene.placement, self.grid()),
                // Neither side a power of two: some drivers translate a shader anew for those.
                eye_size_px: [24, 18],
                quality: Quality { resolution_scale, ..*quality },
                step_mm: None,
                depth_grid: DepthGridSize { columns: 1, rows: 1 },
            };
            let plan = StereoPlan::new(&request, self.grid(), &self.numbers).map_err(|e| {
                RenderError::Device { what: "the scene's first frame", reason: e.to_string() }
            })?;
            FrameRenderer::new(&self.gpu, 1)?.submit(self, &plan)?.finish()?;
        }
        Ok(())
    }

    /// Whether frames of this quality need nothing to be compiled that those of another scene do not need.
    #[must_use]
    pub fn is_drawn_as(&self, other: &Self, quality: &Quality) -> bool {
        Features::of(&self.numbers, quality) == Features::of(&other.numbers, quality)
    }

    /// What several volumes need, if there is more to show than the first alone.
    pub(crate) fn several(&self) -> Option<&Several> {
        self.several.as_ref()
    }

    pub(crate) fn volume_group(&self) -> &wgpu::BindGroup {
        &self.volume.channels[self.scene.channel].bind_group
    }

    /// Tables and distances, for steps of `step_mm` and of a part of it.
    pub(crate) fn scene_group(&self, step_mm: f64, part: f64) -> Result<Arc<wgpu::BindGroup>, RenderError> {
        // Bind groups are whole or absent, whatever panicked elsewhere.
        let mut kept = self.bind_groups.lock().unwrap_or_else(PoisonError::into_inner);
        let key = [step_mm, part].map(f64::to_bits);
        if let Some(found) = kept.get(&key) {
            return Ok(found.clone());
        }
        if kept.len() >= TABLES_KEPT {
            kept.clear();
        }
        let table = self.gpu.small_texture(
            "the scene's table",
            [TABLE_WIDTH as u32, 1, 1],
            wgpu::TextureDimension::D1,
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&table_texture(&self.scene, self.domain, step_mm, part)),
        )?;
        let group = Arc::new(self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &self.gpu.pipelines.scene_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&self.distances),
                },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&table) },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Sampler(&self.table_sampler),
                },
                wgpu::BindGroupEntry { binding: 3, resource: self.extinction.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 4, resource: self.stretches.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::TextureView(&self.maxima),
                },
            ],
        }));
        kept.insert(key, group.clone());
        Ok(group)
    }
}

/// What each label of a channel does to light; `None` where it holds measured values.
pub(crate) fn looks_of(
    channel: &ChannelOnDevice,
    scene: &Scene,
) -> Result<Option<Vec<GpuStretch>>, RenderError> {
    match (&scene.labels, &channel.labels) {
        (Some(looks), Some(numbers)) => Ok(Some(looks_on_device(numbers, looks))),
        (None, None) => Ok(None),
        (_, labels) => Err(RenderError::Kind { channel: channel.name.clone(), labels: labels.is_some() }),
    }
}

/// A surface is seen where a cell reaches its value.
struct SeenSurface {
    threshold: f64,
    slack: f32,
}

impl SeenRanges for SeenSurface {
    fn before(&self, _: f32, _: f32) -> Counts {
        [0; 2]
    }

    fn through(&self, high: f32, _: f32) -> Counts {
        [u32::from(f64::from(high + self.slack) >= self.threshold), 0]
    }
}

fn frame_numbers(scene: &Scene, domain: TableDomain, value_scale: f64, value_offset: f64) -> GpuFrame {
    let rgb = |c: [f64; 3]| c.map(|x| x as f32);
    let light = scene.light.unwrap_or_default();
    let (table_scale, table_offset) = domain.raw_to_position(value_scale, value_offset);
    GpuFrame {
        value_scale: value_scale as f32,
        value_offset: value_offset as f32,
        table_scale: table_scale as f32,
        table_offset: table_offset as f32,
        threshold: scene.threshold as f32,
        light: [light.ambient, light.diffuse, light.specular, light.power].map(|x| x as f32),
        surface_color: rgb(scene.surface_color),
        surface_opacity: scene.surface_opacity as f32,
        background: rgb(scene.background),
        window_low: scene.window.low as f32,
        window_per_value: (1.0 / (scene.window.high - scene.window.low)) as f32,
        ..GpuFrame::default()
    }
}
