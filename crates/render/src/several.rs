//! Several volumes of one patient in one picture: what is on the device for them beside what one volume needs. A scene of
//! one volume makes nothing of this.

use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::labels::SeenLabels;
use crate::layout::GpuStretch;
use crate::pipelines::{Features, RaycastPipelines, layout_of, make};
use crate::scene_on_device::looks_of;
use crate::shaders::{self, PartKind};
use crate::table::{ENTRIES, SeenValues, TableDomain, extinction_table, optical_table, stretches};
use crate::volume_on_device::{ChannelOnDevice, SharedVolume};
use bytemuck::{Pod, Zeroable};
use scene::{MOST_VOLUMES, Scene};
use spatial::{DAffine3, DVec3};
use std::sync::OnceLock;
use volume::Grid;
use wgpu::util::DeviceExt as _;

/// `Part` in `shaders/common/several.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
struct GpuPart {
    column_x: [f32; 3],
    value_scale: f32,
    column_y: [f32; 3],
    value_offset: f32,
    column_z: [f32; 3],
    table_scale: f32,
    shift: [f32; 3],
    table_offset: f32,
    dims: [f32; 3],
    first_stretch: u32,
    cells: [u32; 3],
    stretches: u32,
    gradient_x: [f32; 3],
    finest_mm: f32,
    gradient_y: [f32; 3],
    pad_1: u32,
    gradient_z: [f32; 3],
    pad_2: u32,
    light: [f32; 4],
    stored: [f32; 4],
}

/// Where the volumes of a scene lie, in the index space of the first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Together {
    pub(crate) count: usize,
    /// The borders: from texture coordinates, 0 to 1 over each volume.
    pub(crate) index_from_texture: [DAffine3; MOST_VOLUMES],
    /// The smallest voxel spacing of any.
    pub(crate) finest_mm: f64,
    /// No way through all of them is longer.
    pub(crate) longest_mm: f64,
    /// What each is.
    pub(crate) kinds: [Option<PartKind>; MOST_VOLUMES],
}

/// A volume that is shown, with the scene that it would be alone.
struct Part<'a> {
    channel: &'a ChannelOnDevice,
    grid: Grid,
    alone: Scene,
    /// What each label does to light, where it holds labels.
    looks: Option<Vec<GpuStretch>>,
}

/// What several volumes need on the device.
#[derive(Debug)]
pub(crate) struct Several {
    pub(crate) together: Together,
    pub(crate) volumes_group: wgpu::BindGroup,
    pub(crate) scene_group: wgpu::BindGroup,
}

impl Several {
    /// Works out what is seen of each volume; `None` for a scene that shows the first volume alone, or nothing.
    pub(crate) fn of(
        gpu: &Gpu,
        volumes: &[SharedVolume],
        scene: &Scene,
    ) -> Result<Option<Self>, RenderError> {
        let parts = parts_of(volumes, scene)?;
        if scene.further.is_empty() || parts.is_empty() {
            return Ok(None);
        }
        let first = volumes.first().map(|volume| volume.grid().clone());
        let Some(first) = first else { return Ok(None) };
        let layouts = gpu.pipelines.several(&gpu.device);
        let mut gpu_parts = [GpuPart::default(); MOST_VOLUMES];
        let (mut distances, mut tables) = (Vec::new(), Vec::new());
        let mut all_stretches = Vec::new();
        for (part, gpu_part) in parts.iter().zip(&mut gpu_parts) {
            let domain = TableDomain::of(&part.alone, part.channel.cells.whole());
            let own_stretches = match &part.looks {
                Some(looks) => looks.clone(),
                None => stretches(&part.alone),
            };
            *gpu_part = GpuPart {
                first_stretch: all_stretches.len() as u32,
                stretches: own_stretches.len() as u32,
                ..part.numbers(&first, domain)
            };
            all_stretches.extend(own_stretches);
            distances.push(part.distances(gpu, domain)?);
            tables.push(part.table(gpu, domain)?);
        }
        let read_only = |what: &'static str, usage, contents: &[u8]| {
            gpu.guarded(what, || {
                let descriptor = wgpu::util::BufferInitDescriptor { label: Some(what), contents, usage };
                gpu.device.create_buffer_init(&descriptor)
            })
        };
        let uniform =
            read_only("the volumes' numbers", wgpu::BufferUsages::UNIFORM, bytemuck::cast_slice(&gpu_parts))?;
        let stretches = read_only(
            "the scene's stretches",
            wgpu::BufferUsages::STORAGE,
            bytemuck::cast_slice(&all_stretches),
        )?;
        let sampler = gpu.linear_sampler();
        // A place that no volume takes holds the first one, at which nobody looks.
        let views = |of: &dyn Fn(usize) -> wgpu::TextureView| -> Vec<wgpu::TextureView> {
            (0..MOST_VOLUMES).map(|i| of(if i < parts.len() { i } else { 0 })).collect()
        };
        let voxels = views(&|i| parts[i].channel.view.clone());
        let distances = views(&|i| distances[i].clone());
        let tables = views(&|i| tables[i].clone());
        let view = |v| wgpu::BindingResource::TextureView(v);
        let sampler = || wgpu::BindingResource::Sampler(&sampler);
        let of_volumes: Vec<_> = std::iter::once(uniform.as_entire_binding())
            .chain(voxels.iter().map(view))
            .chain([sampler()])
            .collect();
        let of_scene: Vec<_> = distances
            .iter()
            .chain(&tables)
            .map(view)
            .chain([sampler(), stretches.as_entire_binding()])
            .collect();
        let group = |label, layout, resources: Vec<wgpu::BindingResource<'_>>| {
            let entries: Vec<_> = resources
                .into_iter()
                .zip(0..)
                .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            gpu.guarded("the volumes' bindings", || {
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some(label),
                    layout,
                    entries: &entries,
                })
            })
        };
        Ok(Some(Self {
            together: together(&first, &parts),
            volumes_group: group("volumes", &layouts.volumes_layout, of_volumes)?,
            scene_group: group("scene of several", &layouts.scene_layout, of_scene)?,
        }))
    }
}

/// The volumes that are not transparent, the scene's first one first.
fn parts_of<'a>(volumes: &'a [SharedVolume], scene: &Scene) -> Result<Vec<Part<'a>>, RenderError> {
    let find = |volume: usize, channel: usize| -> Result<_, RenderError> {
        let of = volumes.get(volume).ok_or(RenderError::NoSuchVolume { volume, volumes: volumes.len() })?;
        let channels = of.channels.len();
        let channel = of.channels.get(channel).ok_or(RenderError::NoSuchChannel { channel, channels })?;
        Ok((of.grid(), channel))
    };
    let mut parts = Vec::new();
    let (grid, channel) = find(0, scene.channel)?;
    let alone = Scene { further: Vec::new(), ..scene.clone() };
    parts.push(Part::new(channel, grid.clone(), alone)?);
    for further in &scene.further {
        let (own, channel) = find(further.volume, further.channel)?;
        let alone = Scene {
            channel: further.channel,
            transfer: further.transfer.clone(),
            labels: further.labels.clone(),
            light: further.light,
            further: Vec::new(),
            ..scene.clone()
        };
        parts.push(Part::new(channel, further.grid(own)?, alone)?);
    }
    parts.retain(Part::is_seen);
    if parts.len() > MOST_VOLUMES {
        return Err(RenderError::TooManyVolumes { found: parts.len(), max: MOST_VOLUMES });
    }
    Ok(parts)
}

impl<'a> Part<'a> {
    fn new(channel: &'a ChannelOnDevice, grid: Grid, alone: Scene) -> Result<Self, RenderError> {
        let looks = looks_of(channel, &alone)?;
        Ok(Self { channel, grid, alone, looks })
    }

    fn kind(&self) -> PartKind {
        let many_labels = self.looks.as_ref().is_some_and(|looks| looks.len() > ENTRIES);
        PartKind { labels: self.looks.is_some(), many_labels, lit: self.alone.light.is_some() }
    }

    /// Whether it is not all transparent.
    fn is_seen(&self) -> bool {
        match &self.looks {
            Some(looks) => looks.iter().any(|look| look.opacity_from > 0.0),
            None => self.alone.transfer.points().iter().any(|p| p.opacity_per_mm > 0.0),
        }
    }

    fn numbers(&self, first: &Grid, domain: TableDomain) -> GpuPart {
        let f32s = |v: DVec3| v.as_vec3().to_array();
        let own_from_first = self.grid.volume_from_index().inverse() * first.volume_from_index();
        let ChannelOnDevice { value_scale, value_offset, stored, cells, .. } = self.channel;
        let (table_scale, table_offset) = domain.raw_to_position(*value_scale, *value_offset);
        // Up to a common factor, as the frame has them for one volume: the largest entry becomes 1.
        let to_mm = self.grid.volume_from_index().matrix3.inverse().transpose();
        let largest = to_mm.to_cols_array().into_iter().fold(0.0f64, |a, x| a.max(x.abs()));
        let rows = (to_mm * (1.0 / largest)).transpose();
        let light = self.alone.light.unwrap_or_default();
        GpuPart {
            column_x: f32s(own_from_first.matrix3.x_axis),
            column_y: f32s(own_from_first.matrix3.y_axis),
            column_z: f32s(own_from_first.matrix3.z_axis),
            shift: f32s(own_from_first.translation),
            value_scale: *value_scale as f32,
            value_offset: *value_offset as f32,
            table_scale: table_scale as f32,
            table_offset: table_offset as f32,
            dims: self.grid.dims().map(|d| d as f32),
            cells: cells.dims.map(|d| d as u32),
            gradient_x: f32s(rows.x_axis),
            finest_mm: self.grid.spacing_mm().min_element() as f32,
            gradient_y: f32s(rows.y_axis),
            gradient_z: f32s(rows.z_axis),
            light: [light.ambient, light.diffuse, light.specular, light.power].map(|x| x as f32),
            stored: stored.map(|x| x as f32),
            ..GpuPart::default()
        }
    }

    fn distances(&self, gpu: &Gpu, domain: TableDomain) -> Result<wgpu::TextureView, RenderError> {
        let cells = &self.channel.cells;
        let distances = match &self.looks {
            Some(looks) => {
                let seen = SeenLabels::of(looks);
                cells.distance_to_seen(&seen)
            }
            None => {
                let table = optical_table(&self.alone, domain, 1.0);
                let seen = SeenValues::of(&self.alone.transfer, &table, domain);
                cells.distance_to_seen(&seen)
            }
        };
        gpu.small_texture(
            "the distances of a volume's cells",
            cells.dims.map(|d| d as u32),
            wgpu::TextureDimension::D3,
            wgpu::TextureFormat::R8Uint,
            &distances,
        )
    }

    /// Colour and extinction by value, which holds for every step, or by label.
    fn table(&self, gpu: &Gpu, domain: TableDomain) -> Result<wgpu::TextureView, RenderError> {
        let table: Vec<[f32; 4]> = match &self.looks {
            Some(looks) => {
                let of = |look: &GpuStretch| {
                    let [r, g, b] = look.color_from;
                    [r, g, b, look.opacity_to]
                };
                // Those that have no room in it are not looked up here.
                let rest = std::iter::repeat([0.0; 4]);
                looks.iter().map(of).chain(rest).take(ENTRIES).collect()
            }
            None => {
                let colors = optical_table(&self.alone, domain, 1.0);
                let extinctions = extinction_table(&self.alone, domain);
                let with = |(&[r, g, b, _], extinction): (&[f32; 4], f32)| [r, g, b, extinction];
                colors.iter().zip(extinctions).map(with).collect()
            }
        };
        gpu.small_texture(
            "a volume's table",
            [ENTRIES as u32, 1, 1],
            wgpu::TextureDimension::D1,
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&table),
        )
    }
}

fn together(first: &Grid, parts: &[Part<'_>]) -> Together {
    let mut index_from_texture = [DAffine3::IDENTITY; MOST_VOLUMES];
    let mut corners_mm = Vec::new();
    let mut finest_mm = f64::INFINITY;
    for (part, slot) in parts.iter().zip(&mut index_from_texture) {
        let mm_from_texture = part.grid.volume_from_index() * part.grid.index_from_texture();
        *slot = first.volume_from_index().inverse() * mm_from_texture;
        corners_mm.extend(corners(&mm_from_texture));
        finest_mm = finest_mm.min(part.grid.spacing_mm().min_element());
    }
    let apart = |a: &DVec3| corners_mm.iter().map(|b| a.distance(*b)).fold(0.0, f64::max);
    Together {
        count: parts.len(),
        index_from_texture,
        finest_mm,
        longest_mm: corners_mm.iter().map(apart).fold(0.0, f64::max),
        kinds: std::array::from_fn(|i| parts.get(i).map(Part::kind)),
    }
}

/// The corners of a volume's border.
pub(crate) fn corners(space_from_texture: &DAffine3) -> [DVec3; 8] {
    let corner = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
    std::array::from_fn(|i| space_from_texture.transform_point3(corner(i)))
}

impl Together {
    /// The corners of all borders, as index of the first volume.
    pub(crate) fn corners_in_index(&self) -> impl Iterator<Item = DVec3> {
        self.index_from_texture.iter().take(self.count).flat_map(corners)
    }
}

/// Layouts for several volumes, made when a scene first has them.
#[derive(Debug)]
pub(crate) struct SeveralPipelines {
    volumes_layout: wgpu::BindGroupLayout,
    scene_layout: wgpu::BindGroupLayout,
    tiles_layout: wgpu::PipelineLayout,
    cast_layout: wgpu::PipelineLayout,
}

/// Made at its first use.
pub(crate) type Lazily = OnceLock<SeveralPipelines>;

impl SeveralPipelines {
    /// `frame`, `tiles` and `picture` are the groups that all ray-casts share.
    pub(crate) fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        tiles: &wgpu::BindGroupLayout,
        picture: &wgpu::BindGroupLayout,
    ) -> Self {
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let texture = |sample_type, view_dimension| wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        let filtered = wgpu::TextureSampleType::Float { filterable: true };
        let voxels = texture(filtered, wgpu::TextureViewDimension::D3);
        let table = texture(filtered, wgpu::TextureViewDimension::D1);
        let cells = texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D3);
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let uniform = buffer(wgpu::BufferBindingType::Uniform);
        let read = buffer(wgpu::BufferBindingType::Storage { read_only: true });
        let volumes_layout =
            layout_of(device, "volumes", &[uniform, voxels, voxels, voxels, voxels, sampler]);
        let scene_layout = layout_of(
            device,
            "scene of several",
            &[cells, cells, cells, cells, table, table, table, table, sampler, read],
        );
        let pipeline_layout = |label, last| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &[frame, &volumes_layout, &scene_layout, last].map(Some),
                immediate_size: 0,
            })
        };
        Self {
            tiles_layout: pipeline_layout("several_tiles", tiles),
            cast_layout: pipeline_layout("several", picture),
            volumes_layout,
            scene_layout,
        }
    }

    /// The ray-caster for volumes of just these kinds.
    pub(crate) fn compile(&self, device: &wgpu::Device, features: Features) -> RaycastPipelines {
        let kinds: Vec<PartKind> = features.parts.into_iter().flatten().collect();
        let constants =
            [("EXACT_FILTER", f64::from(u8::from(features.exact_filter))), ("ENTRIES", ENTRIES as f64)];
        let module = |label, text: String| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(text.into()),
            })
        };
        let entry = if features.cells { "several_exact" } else { "several" };
        let tiles = module("several_tiles", shaders::several_tiles(kinds.len()));
        let cast = module("several", shaders::several(&kinds));
        RaycastPipelines {
            tiles: make(device, &tiles, &self.tiles_layout, "find", &[]),
            spread: None,
            cast: make(device, &cast, &self.cast_layout, entry, &constants),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    const VALUES: PartKind = PartKind { labels: false, many_labels: false, lit: false };

    #[test]
    fn a_part_lies_in_memory_as_the_shader_reads_it() {
        let module = naga::front::wgsl::parse_str(&shaders::several(&[VALUES; 2])).unwrap();
        let (_, part) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some("Part")).unwrap();
        let naga::TypeInner::Struct { members, span } = &part.inner else { panic!("Part is no struct") };
        let wgsl: Vec<_> = members.iter().map(|m| (m.name.clone().unwrap(), m.offset as usize)).collect();
        macro_rules! rust {
            ($($m:ident),*) => { vec![$((stringify!($m).to_owned(), offset_of!(GpuPart, $m))),*] };
        }
        let rust = rust!(
            column_x,
            value_scale,
            column_y,
            value_offset,
            column_z,
            table_scale,
            shift,
            table_offset,
            dims,
            first_stretch,
            cells,
            stretches,
            gradient_x,
            finest_mm,
            gradient_y,
            gradient_z,
            light,
            stored
        );
        assert_eq!((wgsl, *span as usize), (rust, size_of::<GpuPart>()));
    }

    #[test]
    fn the_shader_has_room_for_as_many_volumes_as_a_scene_may_show() {
        let text = shaders::several(&[VALUES; MOST_VOLUMES]);
        assert!(text.contains(&format!("array<Part, {MOST_VOLUMES}>")));
        assert!(text.contains(&format!("const CELL: f32 = {}.0;", crate::cells::CELL)));
    }

    #[test]
    fn one_volume_is_drawn_by_shaders_that_know_of_no_other() {
        for text in [shaders::RAYCAST, shaders::TILES] {
            let module = naga::front::wgsl::parse_str(text).unwrap();
            assert!(module.types.iter().all(|(_, t)| t.name.as_deref() != Some("Part")));
            assert!(module.overrides.iter().all(|(_, o)| o.name.as_deref() != Some("PARTS")));
        }
    }
}
