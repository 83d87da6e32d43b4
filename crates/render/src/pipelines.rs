//! Pipelines, made for exactly what a scene uses.

use crate::scene_on_device::SceneNumbers;
use crate::several::{self, SeveralPipelines};
use crate::shaders::{self, PartKind};
use crate::table::ENTRIES;
use crate::{Quality, Sampling};
use scene::{MOST_VOLUMES, Mode};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Colour multiplied by opacity, and opacity.
pub(crate) const PICTURE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
/// A bit for each chunk of depth.
pub(crate) const MASK_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Luma of a ray, in steps of 8 bits.
pub(crate) const LUMA_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// What blue and red differ from it by.
pub(crate) const CHROMA_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;
/// Depth in millimetres.
pub(crate) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// What a scene uses of the ray-caster: the rest is not in its pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Features {
    pub(crate) mode: Mode,
    pub(crate) lit: bool,
    pub(crate) skip: bool,
    pub(crate) exact_filter: bool,
    /// Whether cells are solved instead of stepped through.
    pub(crate) cells: bool,
    /// Whether voxels hold labels, which are gone through one by one whatever the quality.
    pub(crate) labels: bool,
    /// Whether what is looked at is counted and stored instead of the picture.
    pub(crate) count: bool,
    /// Whether rays of every other pixel of every other row are cast first, and others where those differ.
    pub(crate) spread: bool,
    /// Whether the rays' values are read and summed and nothing else is done.
    pub(crate) bare: bool,
    /// Whether the ray-caster is made of a text from which all that is not used is cut out.
    pub(crate) cut: bool,
    /// What each volume is, where there is more to show than the first alone.
    pub(crate) parts: [Option<PartKind>; MOST_VOLUMES],
}

impl Features {
    /// What a scene uses at a quality.
    pub(crate) fn of(numbers: &SceneNumbers, quality: &Quality) -> Self {
        let shows_surfaces = matches!(numbers.mode, Mode::Threshold | Mode::Maximum | Mode::Cumulated);
        if let Some(together) = &numbers.together {
            // What is skipped and of which kind is said of each volume.
            return Self {
                lit: together.kinds.iter().flatten().any(|kind| kind.lit),
                exact_filter: quality.sampling == Sampling::Float32,
                cells: quality.sampling == Sampling::Cells,
                parts: together.kinds,
                ..Self::NONE
            };
        }
        Self {
            mode: numbers.mode,
            lit: numbers.lit && numbers.mode == Mode::EmissionAbsorption,
            skip: numbers.has_empty_cells,
            exact_filter: quality.sampling == Sampling::Float32 && !numbers.labels,
            cells: !numbers.labels
                && (quality.sampling == Sampling::Cells || (quality.solves_surfaces && shows_surfaces)),
            labels: numbers.labels,
            spread: quality.interpolated_below > 0.0 && !numbers.labels,
            ..Self::NONE
        }
    }

    /// Nothing that could be left out.
    const NONE: Self = Self {
        mode: Mode::EmissionAbsorption,
        lit: false,
        skip: false,
        exact_filter: false,
        cells: false,
        labels: false,
        count: false,
        spread: false,
        bare: false,
        cut: false,
        parts: [None; MOST_VOLUMES],
    };

    /// Reads along whole rays, with the device's own filter.
    pub(crate) fn bare() -> Self {
        Self { mode: Mode::XRay, bare: true, ..Self::NONE }
    }

    /// Layers of masks for each eye: one for each of several volumes, or one.
    pub(crate) fn mask_layers(self) -> u32 {
        self.parts.iter().flatten().count().max(1) as u32
    }

    /// Whether a tile's rays share what they skip; the maximum skips by what each ray has found so far.
    pub(crate) fn skips_by_tile(self) -> bool {
        self.skip && self.mode != Mode::Maximum
    }

    /// The mode's number in the shader.
    fn mode_number(self) -> f64 {
        match self.mode {
            Mode::EmissionAbsorption => 0.0,
            Mode::Threshold => 1.0,
            Mode::XRay => 2.0,
            Mode::Maximum => 3.0,
            Mode::Cumulated => 4.0,
        }
    }
}

/// The passes of a ray-cast.
#[derive(Debug)]
pub(crate) struct RaycastPipelines {
    /// Finds the tiles that may see something.
    pub(crate) tiles: wgpu::ComputePipeline,
    /// What is done before the rays that `cast` casts, if those are not all.
    pub(crate) spread: Option<SpreadPipelines>,
    /// Casts their rays.
    pub(crate) cast: wgpu::ComputePipeline,
}

/// Casts every other ray of every other row, and finds between which of them more are needed.
#[derive(Debug)]
pub(crate) struct SpreadPipelines {
    pub(crate) first: wgpu::ComputePipeline,
    pub(crate) spread: wgpu::ComputePipeline,
    /// Counts what the first rays take, if that is asked.
    pub(crate) first_counted: Option<wgpu::ComputePipeline>,
}

/// Which rays a pipeline casts, as the shader numbers them.
#[derive(Clone, Copy, Debug)]
enum Rays {
    Each = 0,
    First = 1,
    Listed = 2,
}

/// Shader modules, layouts, and the pipelines made so far.
#[derive(Debug)]
pub(crate) struct Pipelines {
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) volume_layout: wgpu::BindGroupLayout,
    pub(crate) scene_layout: wgpu::BindGroupLayout,
    pub(crate) tiles_layout: wgpu::BindGroupLayout,
    pub(crate) picture_layout: wgpu::BindGroupLayout,
    pub(crate) tone_layout: wgpu::BindGroupLayout,
    pub(crate) convert_layout: wgpu::BindGroupLayout,
    pub(crate) depth_layout: wgpu::BindGroupLayout,
    pub(crate) spread_layout: wgpu::BindGroupLayout,
    /// Before `convert_scaled`: luma and chroma of each ray.
    pub(crate) tone: wgpu::ComputePipeline,
    pub(crate) convert: wgpu::ComputePipeline,
    pub(crate) convert_scaled: wgpu::ComputePipeline,
    pub(crate) depth: wgpu::ComputePipeline,
    raycast_module: wgpu::ShaderModule,
    raycast_layout: wgpu::PipelineLayout,
    tiles_module: wgpu::ShaderModule,
    tiles_pipeline_layout: wgpu::PipelineLayout,
    spread_module: wgpu::ShaderModule,
    spread_pipeline_layout: wgpu::PipelineLayout,
    raycast: Mutex<HashMap<Features, Arc<RaycastPipelines>>>,
    several: several::Lazily,
}

impl Pipelines {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let layout = |label: &str, entries: &[wgpu::BindingType]| layout_of(device, label, entries);
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let uniform = buffer(wgpu::BufferBindingType::Uniform);
        let read = buffer(wgpu::BufferBindingType::Storage { read_only: true });
        let write = buffer(wgpu::BufferBindingType::Storage { read_only: false });
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
        let frame_layout = layout("frame", &[uniform]);
        let volume_layout = layout("volume", &[voxels, sampler]);
        let scene_layout = layout("scene", &[cells, table, sampler, read, read, voxels]);
        let layers = wgpu::TextureViewDimension::D2Array;
        let written = |format| wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format,
            view_dimension: layers,
        };
        let picture = texture(filtered, layers);
        let masks = texture(wgpu::TextureSampleType::Uint, layers);
        let pixels = [written(PICTURE_FORMAT), written(DEPTH_FORMAT)];
        let tiles_layout =
            layout("tiles", &[written(MASK_FORMAT), write, pixels[0], pixels[1], pixels[0], pixels[1]]);
        let spread_layout = layout("spread", &[picture, picture, pixels[0], pixels[1], read, write]);
        let picture_layout =
            layout("picture", &[written(PICTURE_FORMAT), written(DEPTH_FORMAT), masks, read]);
        let tone_layout = layout("tone", &[picture, written(LUMA_FORMAT), written(CHROMA_FORMAT)]);
        let convert_layout = layout("convert", &[picture, sampler, write, picture, picture]);
        let depth_layout = layout("depth", &[picture, picture, write]);

        let pipeline_layout = |label: &str, groups: &[&wgpu::BindGroupLayout]| {
            let groups: Vec<_> = groups.iter().map(|&g| Some(g)).collect();
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &groups,
                immediate_size: 0,
            })
        };
        let module = |label: &str, text: &'static str| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(text.into()),
            })
        };
        let raycast_layout =
            pipeline_layout("raycast", &[&frame_layout, &volume_layout, &scene_layout, &picture_layout]);
        let tiles_pipeline_layout =
            pipeline_layout("tiles", &[&frame_layout, &volume_layout, &scene_layout, &tiles_layout]);
        let spread_pipeline_layout = pipeline_layout("spread", &[&frame_layout, &spread_layout]);
        let tone_pipeline_layout = pipeline_layout("tone", &[&frame_layout, &tone_layout]);
        let convert_pipeline_layout = pipeline_layout("convert", &[&frame_layout, &convert_layout]);
        let depth_pipeline_layout = pipeline_layout("depth", &[&frame_layout, &depth_layout]);
        let convert_module = module("convert", shaders::CONVERT);
        let depth_module = module("depth", shaders::DEPTH);
        let convert = |scaled: f64| {
            make(device, &convert_module, &convert_pipeline_layout, "convert", &[("SCALED", scaled)])
        };
        let tone_module = module("tone", shaders::TONE);
        Self {
            tone: make(device, &tone_module, &tone_pipeline_layout, "tone", &[]),
            convert: convert(0.0),
            convert_scaled: convert(1.0),
            depth: make(device, &depth_module, &depth_pipeline_layout, "reduce", &[]),
            raycast_module: module("raycast", shaders::RAYCAST),
            raycast_layout,
            tiles_module: module("tiles", shaders::TILES),
            tiles_pipeline_layout,
            spread_module: module("spread", shaders::SPREAD),
            spread_pipeline_layout,
            raycast: Mutex::new(HashMap::new()),
            several: several::Lazily::new(),
            frame_layout,
            volume_layout,
            scene_layout,
            tiles_layout,
            picture_layout,
            tone_layout,
            convert_layout,
            depth_layout,
            spread_layout,
        }
    }

    /// What ray-casts of several volumes share; made at its first use.
    pub(crate) fn several(&self, device: &wgpu::Device) -> &SeveralPipelines {
        let (frame, tiles, picture) = (&self.frame_layout, &self.tiles_layout, &self.picture_layout);
        self.several.get_or_init(|| SeveralPipelines::new(device, frame, tiles, picture))
    }

    /// The ray-caster for a combination of features; compiled at its first use.
    pub(crate) fn raycast(&self, device: &wgpu::Device, features: Features) -> Arc<RaycastPipelines> {
        // A panic elsewhere cannot leave a map of finished pipelines in a bad state.
        let lock = || self.raycast.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = lock().get(&features) {
            return found.clone();
        }
        // Compiled outside the lock: another thread that has its pipeline does not wait for this one.
        if features.parts[0].is_some() {
            let made = Arc::new(self.several(device).compile(device, features));
            return lock().entry(features).or_insert(made).clone();
        }
        let flag = |on: bool| if on { 1.0 } else { 0.0 };
        let constants = |rays: Rays, count: bool| {
            [
                ("MODE", features.mode_number()),
                ("LIT", flag(features.lit)),
                ("SKIP", flag(features.skip)),
                ("EXACT_FILTER", flag(features.exact_filter)),
                ("COUNT", flag(count)),
                ("RAYS", f64::from(rays as u32)),
                ("ENTRIES", ENTRIES as f64),
            ]
        };
        let entry = match features {
            Features { bare: true, .. } => "bare",
            Features { labels: true, .. } => "labels",
            Features { cells: true, .. } => "exact",
            _ => "raycast",
        };
        let all_of_the_way = matches!(features.mode, Mode::XRay | Mode::Maximum | Mode::Cumulated);
        let tile_constants = [
            ("SKIP", flag(features.skips_by_tile())),
            ("ALL_OF_THE_WAY", flag(all_of_the_way)),
            ("SPREAD", flag(features.spread)),
        ];
        let cast = |rays: Rays, count: bool| {
            let constants = constants(rays, count);
            let cut = features.cut.then(|| {
                device.create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some("raycast, cut"),
                    source: wgpu::ShaderSource::Wgsl(shaders::cut(shaders::RAYCAST, &constants).into()),
                })
            });
            let module = cut.as_ref().unwrap_or(&self.raycast_module);
            make(device, module, &self.raycast_layout, entry, &constants)
        };
        let spread = features.spread.then(|| {
            let (module, layout) = (&self.spread_module, &self.spread_pipeline_layout);
            SpreadPipelines {
                first: cast(Rays::First, false),
                spread: make(device, module, layout, "spread", &[("COUNT", flag(features.count))]),
                first_counted: features.count.then(|| cast(Rays::First, true)),
            }
        });
        let rays = if features.spread { Rays::Listed } else { Rays::Each };
        let made = Arc::new(RaycastPipelines {
            tiles: make(device, &self.tiles_module, &self.tiles_pipeline_layout, "find", &tile_constants),
            spread,
            cast: cast(rays, features.count),
        });
        lock().entry(features).or_insert(made).clone()
    }
}

/// A group of bindings, numbered as they come.
pub(crate) fn layout_of(
    device: &wgpu::Device,
    label: &str,
    entries: &[wgpu::BindingType],
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = entries
        .iter()
        .enumerate()
        .map(|(binding, &ty)| wgpu::BindGroupLayoutEntry {
            binding: binding as u32,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        })
        .collect();
    device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

pub(crate) fn make(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    entry_point: &str,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(layout),
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants,
            zero_initialize_workgroup_memory: false,
        },
        cache: None,
    })
}
