//! What the passes of a frame write on the device.

use crate::StereoPlan;
use crate::error::RenderError;
use crate::gpu::Gpu;

/// Bytes of a pixel of the picture: four float32.
pub(crate) const PIXEL_BYTES: u64 = 16;

/// The picture, its depths, and what is made of them. Frames follow each other on the device, so one set serves all.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) picture: wgpu::Buffer,
    pub(crate) depth: wgpu::Buffer,
    pub(crate) planes: wgpu::Buffer,
    pub(crate) depth_grid: wgpu::Buffer,
    pub(crate) picture_group: wgpu::BindGroup,
    pub(crate) convert_group: wgpu::BindGroup,
    pub(crate) depth_group: wgpu::BindGroup,
}

impl Targets {
    /// Whether a plan's frame has room in them.
    pub(crate) fn hold(&self, plan: &StereoPlan) -> bool {
        self.picture.size() >= plan.rays() * PIXEL_BYTES
            && self.planes.size() >= plan.planes_bytes() as u64
            && self.depth_grid.size() >= plan.depth_grid_bytes() as u64
    }

    pub(crate) fn new(gpu: &Gpu, plan: &StereoPlan) -> Result<Self, RenderError> {
        use wgpu::BufferUsages as Usage;
        let out = Usage::STORAGE | Usage::COPY_SRC;
        let picture = gpu.buffer("the picture", plan.rays() * PIXEL_BYTES, out)?;
        let depth = gpu.buffer("the picture's depths", plan.rays() * 4, out)?;
        let planes = gpu.buffer("the picture's planes", plan.planes_bytes() as u64, out)?;
        let depth_grid = gpu.buffer("the grid of depths", plan.depth_grid_bytes() as u64, out)?;
        let group = |label, layout, buffers: &[&wgpu::Buffer]| {
            let entries: Vec<_> = buffers
                .iter()
                .enumerate()
                .map(|(i, b)| wgpu::BindGroupEntry { binding: i as u32, resource: b.as_entire_binding() })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(label),
                layout,
                entries: &entries,
            })
        };
        let pipelines = &gpu.pipelines;
        Ok(Self {
            picture_group: group("picture", &pipelines.picture_layout, &[&picture, &depth]),
            convert_group: group("convert", &pipelines.convert_layout, &[&picture, &planes]),
            depth_group: group("depth", &pipelines.depth_layout, &[&depth, &picture, &depth_grid]),
            picture,
            depth,
            planes,
            depth_grid,
        })
    }
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
