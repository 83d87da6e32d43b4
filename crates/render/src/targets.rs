//! What the passes of a frame write on the device.

use crate::StereoPlan;
use crate::error::RenderError;
use crate::gpu::Gpu;
use crate::pipelines::{CHROMA_FORMAT, DEPTH_FORMAT, LUMA_FORMAT, MASK_FORMAT, PICTURE_FORMAT};

/// Bytes of a list of work before its tiles or pixels: how many workgroups to dispatch, how many entries there are, and
/// how many workgroups where a ray of every other pixel of every other row is cast. A test compares the shaders.
pub(crate) const WORK_HEAD_BYTES: u64 = 28;
/// Where the second number of workgroups lies.
pub(crate) const FIRST_GROUPS_AT: u64 = 16;

/// The picture, its depths, and what is made of them. Frames follow each other on the device, so one set serves all:
/// it is as large as the largest of them.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) picture: wgpu::Texture,
    pub(crate) depth: wgpu::Texture,
    first_picture: wgpu::Texture,
    luma_of_rays: wgpu::Texture,
    masks: wgpu::Texture,
    pub(crate) planes: wgpu::Buffer,
    pub(crate) depth_grid: wgpu::Buffer,
    /// Workgroups to cast, as an indirect dispatch takes them, the number of tiles, and the tiles.
    work: wgpu::Buffer,
    /// The same for pixels.
    rest: wgpu::Buffer,
    tiles_group: wgpu::BindGroup,
    first_group: wgpu::BindGroup,
    spread_group: wgpu::BindGroup,
    rest_group: wgpu::BindGroup,
    pub(crate) picture_group: wgpu::BindGroup,
    pub(crate) tone_group: wgpu::BindGroup,
    pub(crate) convert_group: wgpu::BindGroup,
    pub(crate) depth_group: wgpu::BindGroup,
}

/// How large targets must be for a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Needs {
    size_px: [u32; 2],
    /// Rays that are cast before the others; one where there are none.
    first_px: [u32; 2],
    /// Rays whose luma and chroma are wanted; one where there is a ray for each pixel.
    toned_px: [u32; 2],
    tiles: [u32; 2],
    eyes: u32,
    mask_layers: u32,
    planes_bytes: u64,
    depth_grid_bytes: u64,
}

impl Needs {
    fn of(plan: &StereoPlan) -> Self {
        Self {
            size_px: plan.render_size_px(),
            first_px: if plan.features.spread {
                plan.render_size_px().map(|side| side.div_ceil(2))
            } else {
                [1; 2]
            },
            toned_px: if plan.is_scaled() { plan.render_size_px() } else { [1; 2] },
            tiles: plan.tiles(),
            eyes: plan.eye_count(),
            mask_layers: plan.eye_count() * plan.features.mask_layers(),
            planes_bytes: plan.planes_bytes() as u64,
            depth_grid_bytes: plan.depth_grid_bytes() as u64,
        }
    }

    fn of_both(self, other: Self) -> Self {
        Self {
            size_px: std::array::from_fn(|i| self.size_px[i].max(other.size_px[i])),
            first_px: std::array::from_fn(|i| self.first_px[i].max(other.first_px[i])),
            toned_px: std::array::from_fn(|i| self.toned_px[i].max(other.toned_px[i])),
            tiles: std::array::from_fn(|i| self.tiles[i].max(other.tiles[i])),
            eyes: self.eyes.max(other.eyes),
            mask_layers: self.mask_layers.max(other.mask_layers),
            planes_bytes: self.planes_bytes.max(other.planes_bytes),
            depth_grid_bytes: self.depth_grid_bytes.max(other.depth_grid_bytes),
        }
    }
}

impl Targets {
    fn holds(&self) -> Needs {
        Needs {
            size_px: [self.picture.width(), self.picture.height()],
            first_px: [self.first_picture.width(), self.first_picture.height()],
            toned_px: [self.luma_of_rays.width(), self.luma_of_rays.height()],
            tiles: [self.masks.width(), self.masks.height()],
            eyes: self.picture.depth_or_array_layers(),
            mask_layers: self.masks.depth_or_array_layers(),
            planes_bytes: self.planes.size(),
            depth_grid_bytes: self.depth_grid.size(),
        }
    }

    /// Whether a plan's frame has room in them.
    pub(crate) fn hold(&self, plan: &StereoPlan) -> bool {
        let (holds, needs) = (self.holds(), Needs::of(plan));
        holds.size_px[0] >= needs.size_px[0]
            && holds.size_px[1] >= needs.size_px[1]
            && holds.first_px[0] >= needs.first_px[0]
            && holds.first_px[1] >= needs.first_px[1]
            && holds.toned_px[0] >= needs.toned_px[0]
            && holds.toned_px[1] >= needs.toned_px[1]
            && holds.tiles[0] >= needs.tiles[0]
            && holds.tiles[1] >= needs.tiles[1]
            && holds.eyes >= needs.eyes
            && holds.mask_layers >= needs.mask_layers
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
        let picture = layers(gpu, "the picture", needs.size_px, needs.eyes, PICTURE_FORMAT)?;
        let depth = layers(gpu, "the picture's depths", needs.size_px, needs.eyes, DEPTH_FORMAT)?;
        // Mesa's software driver 22.3 reads nothing from an array of one integer texel.
        let tiles = needs.tiles.map(|side| side.max(2));
        let masks = layers(gpu, "the tiles' masks", tiles, needs.mask_layers, MASK_FORMAT)?;
        let work_bytes =
            WORK_HEAD_BYTES + 4 * u64::from(tiles[0]) * u64::from(tiles[1]) * u64::from(needs.eyes);
        let work = gpu.buffer(
            "the list of tiles",
            work_bytes,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
        )?;
        // Of every other pixel of every other row; the others may all be listed.
        let first_px = needs.first_px;
        let first_picture = layers(gpu, "the first rays' picture", first_px, needs.eyes, PICTURE_FORMAT)?;
        let first_depth = layers(gpu, "the first rays' depths", first_px, needs.eyes, DEPTH_FORMAT)?;
        let rest_bytes =
            WORK_HEAD_BYTES + 12 * u64::from(first_px[0]) * u64::from(first_px[1]) * u64::from(needs.eyes);
        let rest = gpu.buffer(
            "the list of pixels",
            rest_bytes,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
        )?;
        let luma_of_rays = layers(gpu, "the rays' luma", needs.toned_px, needs.eyes, LUMA_FORMAT)?;
        let chroma_of_rays = layers(gpu, "the rays' chroma", needs.toned_px, needs.eyes, CHROMA_FORMAT)?;
        let out = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let planes = gpu.buffer("the picture's planes", needs.planes_bytes, out)?;
        let depth_grid = gpu.buffer("the grid of depths", needs.depth_grid_bytes, out)?;
        let array = wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        };
        let (picture_view, depth_view) = (picture.create_view(&array), depth.create_view(&array));
        let (first_view, first_depth_view) =
            (first_picture.create_view(&array), first_depth.create_view(&array));
        let first_binding = wgpu::BindingResource::TextureView(&first_view);
        let first_depth_binding = wgpu::BindingResource::TextureView(&first_depth_view);
        let masks_view = masks.create_view(&array);
        let masks_binding = wgpu::BindingResource::TextureView(&masks_view);
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
        let tiles_group = group(
            "tiles",
            &pipelines.tiles_layout,
            &[
                masks_binding.clone(),
                work.as_entire_binding(),
                picture_binding.clone(),
                depth_binding.clone(),
                first_binding.clone(),
                first_depth_binding.clone(),
            ],
        );
        let cast = |picture: &wgpu::BindingResource<'_>,
                    depth: &wgpu::BindingResource<'_>,
                    work: &wgpu::Buffer| {
            let resources = [picture.clone(), depth.clone(), masks_binding.clone(), work.as_entire_binding()];
            group("picture", &pipelines.picture_layout, &resources)
        };
        let picture_group = cast(&picture_binding, &depth_binding, &work);
        let first_group = cast(&first_binding, &first_depth_binding, &work);
        let rest_group = cast(&picture_binding, &depth_binding, &rest);
        let spread_group = group(
            "spread",
            &pipelines.spread_layout,
            &[
                first_binding.clone(),
                first_depth_binding.clone(),
                picture_binding.clone(),
                depth_binding.clone(),
                work.as_entire_binding(),
                rest.as_entire_binding(),
            ],
        );
        let sampler_binding = wgpu::BindingResource::Sampler(&sampler);
        let (luma_view, chroma_view) = (luma_of_rays.create_view(&array), chroma_of_rays.create_view(&array));
        let luma_binding = wgpu::BindingResource::TextureView(&luma_view);
        let chroma_binding = wgpu::BindingResource::TextureView(&chroma_view);
        let tone_group = group(
            "tone",
            &pipelines.tone_layout,
            &[picture_binding.clone(), luma_binding.clone(), chroma_binding.clone()],
        );
        let convert_group = group(
            "convert",
            &pipelines.convert_layout,
            &[
                picture_binding.clone(),
                sampler_binding,
                planes.as_entire_binding(),
                luma_binding,
                chroma_binding,
            ],
        );
        let depth_group = group(
            "depth",
            &pipelines.depth_layout,
            &[depth_binding, picture_binding, depth_grid.as_entire_binding()],
        );
        Ok(Self {
            work,
            rest,
            tiles_group,
            first_group,
            spread_group,
            rest_group,
            picture_group,
            tone_group,
            convert_group,
            depth_group,
            picture,
            depth,
            first_picture,
            luma_of_rays,
            masks,
            planes,
            depth_grid,
        })
    }
}

/// A texture with a layer for each eye.
fn layers(
    gpu: &Gpu,
    what: &'static str,
    [width, height]: [u32; 2],
    eyes: u32,
    format: wgpu::TextureFormat,
) -> Result<wgpu::Texture, RenderError> {
    use wgpu::TextureUsages as Usage;
    gpu.guarded(what, || {
        gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(what),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: eyes },
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
    let (volume_group, scene_group) = match scene.several() {
        Some(several) => (&several.volumes_group, several.scene_group.clone()),
        None => (scene.volume_group(), (*scene.scene_group(plan.step_mm(), plan.step_part())?).clone()),
    };
    let pipelines = gpu.pipelines.raycast(&gpu.device, plan.features);
    encoder.clear_buffer(&targets.work, 0, Some(WORK_HEAD_BYTES));
    encoder.clear_buffer(&targets.rest, 0, Some(WORK_HEAD_BYTES));
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some("raycast"),
        timestamp_writes: timestamps,
    });
    pass.set_pipeline(&pipelines.tiles);
    pass.set_bind_group(0, frame_group, &[]);
    pass.set_bind_group(1, volume_group, &[]);
    pass.set_bind_group(2, &scene_group, &[]);
    pass.set_bind_group(3, &targets.tiles_group, &[]);
    let [columns, rows] = plan.tiles();
    pass.dispatch_workgroups(columns.div_ceil(8), rows.div_ceil(8), plan.eye_count());
    let cast = |pass: &mut wgpu::ComputePass<'_>,
                pipeline: &wgpu::ComputePipeline,
                into,
                work: (&wgpu::Buffer, u64)| {
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, volume_group, &[]);
        pass.set_bind_group(2, &scene_group, &[]);
        pass.set_bind_group(3, into, &[]);
        pass.dispatch_workgroups_indirect(work.0, work.1);
    };
    let Some(spread) = &pipelines.spread else {
        cast(&mut pass, &pipelines.cast, &targets.picture_group, (&targets.work, 0));
        return Ok(());
    };
    let first = (&targets.work, FIRST_GROUPS_AT);
    cast(&mut pass, &spread.first, &targets.first_group, first);
    pass.set_pipeline(&spread.spread);
    pass.set_bind_group(1, &targets.spread_group, &[]);
    pass.dispatch_workgroups_indirect(first.0, first.1);
    if let Some(counted) = &spread.first_counted {
        cast(&mut pass, counted, &targets.picture_group, first);
    }
    cast(&mut pass, &pipelines.cast, &targets.rest_group, (&targets.rest, 0));
    Ok(())
}
