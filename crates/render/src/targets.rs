//! What the passes of a frame write on the device.

use crate::StereoPlan;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::pipelines::{DEPTH_FORMAT, PICTURE_FORMAT};

/// The picture, its depths, and what is made of them. Frames follow each other on the device, so one set serves all:
/// it is as large as the largest of them.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) picture: wgpu::Texture,
    pub(crate) depth: wgpu::Texture,
    pub(crate) planes: wgpu::Buffer,
    pub(crate) depth_grid: wgpu::Buffer,
    pub(crate) picture_group: wgpu::BindGroup,
    pub(crate) convert_group: wgpu::BindGroup,
    pub(crate) depth_group: wgpu::BindGroup,
}

/// How large targets must be for a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Needs {
    size_px: [u32; 2],
    eyes: u32,
    planes_bytes: u64,
    depth_grid_bytes: u64,
}

impl Needs {
    fn of(plan: &StereoPlan) -> Self {
        Self {
            size_px: plan.render_size_px(),
            eyes: plan.eye_count(),
            planes_bytes: plan.planes_bytes() as u64,
            depth_grid_bytes: plan.depth_grid_bytes() as u64,
        }
    }

    fn of_both(self, other: Self) -> Self {
        Self {
            size_px: std::array::from_fn(|i| self.size_px[i].max(other.size_px[i])),
            eyes: self.eyes.max(other.eyes),
            planes_bytes: self.planes_bytes.max(other.planes_bytes),
            depth_grid_bytes: self.depth_grid_bytes.max(other.depth_grid_bytes),
        }
    }
}

impl Targets {
    fn holds(&self) -> Needs {
        Needs {
            size_px: [self.picture.width(), self.picture.height()],
            eyes: self.picture.depth_or_array_layers(),
            planes_bytes: self.planes.size(),
            depth_grid_bytes: self.depth_grid.size(),
        }
    }

    /// Whether a plan's frame has room in them.
    pub(crate) fn hold(&self, plan: &StereoPlan) -> bool {
        let (holds, needs) = (self.holds(), Needs::of(plan));
        holds.size_px[0] >= needs.size_px[0]
            && holds.size_px[1] >= needs.size_px[1]
            && holds.eyes >= needs.eyes
            && holds.planes_bytes >= needs.planes_bytes
            && holds.depth_grid_bytes >= needs.depth_grid_bytes
    }

    /// Targets for a plan, and for all that `before` could hold.
    pub(crate) fn new(gpu: &Gpu, plan: &StereoPlan, before: Option<&Self>) -> Result<Self, RenderError> {
        let needs = Needs::of(plan).of_both(before.map(Self::holds).unwrap_or_default());
        let max = gpu.device.limits().max_texture_dimension_2d;
        if needs.size_px.iter().any(|&side| side > max) {
            return Err(RenderError::PictureTooLarge { size_px: needs.size_px, max });
        }
        let picture = layers(gpu, "the picture", &needs, PICTURE_FORMAT)?;
        let depth = layers(gpu, "the picture's depths", &needs, DEPTH_FORMAT)?;
        let out = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let planes = gpu.buffer("the picture's planes", needs.planes_bytes, out)?;
        let depth_grid = gpu.buffer("the grid of depths", needs.depth_grid_bytes, out)?;
        let array = wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        };
        let (picture_view, depth_view) = (picture.create_view(&array), depth.create_view(&array));
        let sampler = gpu.linear_sampler();
        let picture_binding = wgpu::BindingResource::TextureView(&picture_view);
        let depth_binding = wgpu::BindingResource::TextureView(&depth_view);
        let group = |label, layout, resources: &[wgpu::BindingResource<'_>]| {
            let entries: Vec<_> = resources
                .iter()
                .enumerate()
                .map(|(i, r)| wgpu::BindGroupEntry { binding: i as u32, resource: r.clone() })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(label),
                layout,
                entries: &entries,
            })
        };
        let pipelines = &gpu.pipelines;
        let picture_group =
            group("picture", &pipelines.picture_layout, &[picture_binding.clone(), depth_binding.clone()]);
        let sampler_binding = wgpu::BindingResource::Sampler(&sampler);
        let convert_group = group(
            "convert",
            &pipelines.convert_layout,
            &[picture_binding.clone(), sampler_binding, planes.as_entire_binding()],
        );
        let depth_group = group(
            "depth",
            &pipelines.depth_layout,
            &[depth_binding, picture_binding, depth_grid.as_entire_binding()],
        );
        Ok(Self { picture_group, convert_group, depth_group, picture, depth, planes, depth_grid })
    }
}

/// A texture with a layer for each eye.
fn layers(
    gpu: &Gpu,
    what: &'static str,
    needs: &Needs,
    format: wgpu::TextureFormat,
) -> Result<wgpu::Texture, RenderError> {
    use wgpu::TextureUsages as Usage;
    let [width, height] = needs.size_px;
    gpu.guarded(what, || {
        gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(what),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: needs.eyes },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: Usage::STORAGE_BINDING | Usage::TEXTURE_BINDING | Usage::COPY_SRC,
            view_formats: &[],
        })
    })
}

/// The bind group of a frame's numbers.
pub(crate) fn frame_group(gpu: &Gpu, uniform: &wgpu::Buffer) -> wgpu::BindGroup {
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("frame"),
        layout: &gpu.pipelines.frame_layout,
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }],
    })
}

/// Records the ray-cast of a plan.
pub(crate) fn record_raycast(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    scene: &crate::SceneOnDevice,
    plan: &StereoPlan,
    frame_group: &wgpu::BindGroup,
    targets: &Targets,
    timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>,
) -> Result<(), RenderError> {
    let scene_group = scene.scene_group(plan.step_mm())?;
    let pipeline = gpu.pipelines.raycast(&gpu.device, plan.features);
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some("raycast"),
        timestamp_writes: timestamps,
    });
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, frame_group, &[]);
    pass.set_bind_group(1, scene.volume_group(), &[]);
    pass.set_bind_group(2, &*scene_group, &[]);
    pass.set_bind_group(3, &targets.picture_group, &[]);
    let [width, height] = plan.render_size_px();
    pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), plan.eye_count());
    Ok(())
}
