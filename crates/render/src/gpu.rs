//! The device.

use crate::error::{OpenError, RenderError};
use crate::pipelines::Pipelines;
use wgpu::util::DeviceExt as _;

/// Most samples along the longest way through a volume: beyond, float32 cannot number them.
const MOST_SAMPLES: u32 = 1_048_576;

/// Storage textures of the shader that has most, `tiles.wgsl`; Vulkan and WebGPU promise 4.
pub(crate) const STORAGE_TEXTURES: u32 = 5;

/// What a person wants to know about an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterFacts {
    /// As the driver calls it.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// Discrete, integrated, virtual, CPU.
    pub kind: String,
    /// Whether it is a program that runs on the CPU.
    pub is_software: bool,
}

impl AdapterFacts {
    fn of(info: &wgpu::AdapterInfo) -> Self {
        Self {
            name: info.name.clone(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            kind: format!("{:?}", info.device_type).to_lowercase(),
            is_software: info.device_type == wgpu::DeviceType::Cpu,
        }
    }
}

impl std::fmt::Display for AdapterFacts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.kind, self.driver)
    }
}

/// An open device with its queue and pipelines.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) pipelines: Pipelines,
    pub(crate) has_timestamps: bool,
    adapter: AdapterFacts,
}

impl Gpu {
    /// The adapters of this machine.
    #[must_use]
    pub fn adapters() -> Vec<AdapterFacts> {
        enumerate().1.iter().map(|a| AdapterFacts::of(&a.get_info())).collect()
    }

    /// Opens the adapter whose name contains `name` (letter case aside), or else the best there is: discrete before
    /// integrated before software.
    ///
    /// # Errors
    /// If there is no adapter, none of that name, or it lacks what holocast needs.
    pub fn open(name: Option<&str>) -> Result<Self, OpenError> {
        let (_instance, adapters) = enumerate();
        if adapters.is_empty() {
            return Err(OpenError::NoAdapter);
        }
        let matches = |a: &wgpu::Adapter| {
            name.is_none_or(|n| a.get_info().name.to_lowercase().contains(&n.to_lowercase()))
        };
        let chosen = adapters.iter().filter(|a| matches(a)).min_by_key(|a| match a.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        });
        let Some(adapter) = chosen else {
            return Err(OpenError::NoSuchAdapter {
                wanted: name.unwrap_or_default().to_owned(),
                available: adapters.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", "),
            });
        };
        Self::open_adapter(adapter)
    }

    fn open_adapter(adapter: &wgpu::Adapter) -> Result<Self, OpenError> {
        let facts = AdapterFacts::of(&adapter.get_info());
        let needed = wgpu::Features::TEXTURE_FORMAT_16BIT_NORM | wgpu::Features::FLOAT32_FILTERABLE;
        let missing = needed - adapter.features();
        if !missing.is_empty() {
            return Err(OpenError::Lacks {
                adapter: facts.name,
                missing: format!("the features {missing:?}"),
            });
        }
        let storage_textures = adapter.limits().max_storage_textures_per_shader_stage;
        if storage_textures < STORAGE_TEXTURES {
            return Err(OpenError::Lacks {
                adapter: facts.name,
                missing: format!(
                    "storage textures: a shader writes to {STORAGE_TEXTURES}, and it allows {storage_textures}"
                ),
            });
        }
        let wanted = wgpu::Features::TIMESTAMP_QUERY;
        let features = needed | (wanted & adapter.features());
        let request = wgpu::DeviceDescriptor {
            label: Some("holocast"),
            required_features: features,
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&request))
            .map_err(|e| OpenError::Refused { adapter: facts.name.clone(), reason: e.to_string() })?;
        // Without this, wgpu panics where an error comes outside of a scope, such as a lost device: the frame that meets it
        // fails by its own time-out or result instead.
        device.on_uncaptured_error(std::sync::Arc::new(|error| tracing::error!("device: {error}")));
        let pipelines = Pipelines::new(&device);
        let has_timestamps = features.contains(wgpu::Features::TIMESTAMP_QUERY);
        Ok(Self { device, queue, pipelines, has_timestamps, adapter: facts })
    }

    /// What this device is.
    #[must_use]
    pub fn adapter(&self) -> &AdapterFacts {
        &self.adapter
    }

    /// Most voxels along one axis of a volume.
    #[must_use]
    pub fn longest_volume_axis(&self) -> u32 {
        self.device.limits().max_texture_dimension_3d
    }

    /// Most samples along a ray.
    pub(crate) fn most_samples(&self) -> u32 {
        // Mesa's software driver leaves the loops of a shader after 65 535 rounds in all, and says nothing.
        if self.adapter.is_software { 60_000 } else { MOST_SAMPLES }
    }

    /// A buffer, or an error with numbers where it would be larger than the device allows.
    pub(crate) fn buffer(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limits = self.device.limits();
        let mut max = limits.max_buffer_size;
        if usage.contains(wgpu::BufferUsages::STORAGE) {
            max = max.min(limits.max_storage_buffer_binding_size);
        }
        if bytes > max {
            return Err(RenderError::BufferTooLarge { what, bytes, max });
        }
        self.guarded(what, || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: bytes.next_multiple_of(4).max(16),
                usage,
                mapped_at_creation: false,
            })
        })
    }

    /// A texture of one or three dimensions with its content, which is small.
    pub(crate) fn small_texture(
        &self,
        what: &'static str,
        [width, height, depth]: [u32; 3],
        dimension: wgpu::TextureDimension,
        format: wgpu::TextureFormat,
        content: &[u8],
    ) -> Result<wgpu::TextureView, RenderError> {
        self.guarded(what, || {
            let texture = self.device.create_texture_with_data(
                &self.queue,
                &wgpu::TextureDescriptor {
                    label: Some(what),
                    size: wgpu::Extent3d { width, height, depth_or_array_layers: depth },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension,
                    format,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                    view_formats: &[],
                },
                wgpu::util::TextureDataOrder::LayerMajor,
                content,
            );
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        })
    }

    /// A sampler that interpolates and holds the nearest value outside.
    pub(crate) fn linear_sampler(&self) -> wgpu::Sampler {
        self.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("linear"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        })
    }

    /// Does something that may exhaust the device's memory, and says so if it did.
    pub(crate) fn guarded<T>(&self, what: &'static str, make: impl FnOnce() -> T) -> Result<T, RenderError> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validity = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let made = make();
        let invalid = pollster::block_on(validity.pop());
        let exhausted = pollster::block_on(memory.pop());
        match invalid.or(exhausted) {
            Some(error) => Err(RenderError::Device { what, reason: error.to_string() }),
            None => Ok(made),
        }
    }
}

fn enumerate() -> (wgpu::Instance, Vec<wgpu::Adapter>) {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // Validation layers and debug names cost time in every call.
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    (instance, adapters)
}
