//! `holocast render`.

use crate::cli::Render;
use crate::commands::shown::{Shown, quality_named};
use crate::terminal::{say, tell};
use ::render::{
    DepthGridSize, FrameRenderer, Gpu, GpuTimes, Placed, SceneOnDevice, StereoPlan, StereoRequest,
    StillRenderer, VolumeOnDevice,
};
use anyhow::Context as _;
use spatial::{DVec3, EyeView, Fov, HeadGeometry, Pose};
use std::sync::Arc;
use std::time::{Duration, Instant};
use volume::Grid;

/// Size of a still that neither the scene nor the command line gives.
const DEFAULT_SIZE_PX: [u32; 2] = [1280, 720];
/// Vertical field of view of a still without a camera, radians.
const DEFAULT_FOV_Y: f64 = std::f64::consts::FRAC_PI_6;

pub(crate) fn run(arguments: &Render) -> anyhow::Result<()> {
    let mut quality = quality_named(&arguments.quality)?;
    quality.skip_empty = !arguments.no_skip;
    let shown = Shown::load(arguments.scene.as_deref(), arguments.volume.as_deref())?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let volume = Arc::new(VolumeOnDevice::upload(&gpu, &shown.loaded.volume, |_| {})?);
    let on_device = SceneOnDevice::new(&gpu, &volume, &shown.scene)?;
    let grid = volume.grid();

    let eye_size_px = arguments.size.map(|s| s.0).or(shown.file.size).unwrap_or(DEFAULT_SIZE_PX);
    let (placed, head, fov) = point_of_view(&shown, grid, eye_size_px)?;
    let eyes: Vec<EyeView> = if arguments.stereo {
        // Eyes are given in the unit of the space they look at: metres in the room, millimetres of the volume for a
        // scene's own camera.
        let unit_per_mm = if shown.file.camera.is_some() { 1.0 } else { 1.0e-3 };
        HeadGeometry::parallel(arguments.eye_distance_mm * unit_per_mm, fov).view(&head).eyes.to_vec()
    } else {
        vec![EyeView { world_from_eye: head, fov }]
    };
    let request = StereoRequest {
        eyes: &eyes,
        placed,
        eye_size_px,
        quality,
        step_mm: arguments.step_mm.or(shown.file.step_mm),
        depth_grid: DepthGridSize::default(),
    };
    let plan = StereoPlan::new(&request, grid, on_device.numbers())?;

    let still = StillRenderer::new(&gpu).render(&on_device, &plan)?;
    save(arguments, &still, &shown)?;
    let times = timed(&gpu, &on_device, &plan, arguments.frames)?;
    report(arguments, &gpu, &plan, &times)
}

/// Where the eyes are: the scene's camera in the volume's own millimetres, or before the hologram in the room.
fn point_of_view(
    shown: &Shown,
    grid: &Grid,
    [width, height]: [u32; 2],
) -> anyhow::Result<(Placed, Pose, Fov)> {
    if let Some(camera) = &shown.file.camera {
        let pose = camera.pose_mm().context("the scene's camera does not span a picture")?;
        return Ok((Placed::own_axes(grid), pose, camera.fov(width, height)?));
    }
    let placement = shown.scene.placement;
    let fov = Fov::from_vertical(DEFAULT_FOV_Y, f64::from(width) / f64::from(height))?;
    // Far enough that the volume's diagonal fills most of the picture's lower side.
    let size_m = grid.size_mm().length() / placement.volume_mm_per_world_m();
    let narrower = DEFAULT_FOV_Y.min(fov.right - fov.left);
    let centre = DVec3::from_array(placement.position_m);
    let at = centre + DVec3::new(0.25, 0.15, 1.0).normalize() * (size_m * 0.45 / (narrower / 2.0).tan());
    let pose = Pose::looking_at(at, centre, DVec3::Y).context("no point of view before the hologram")?;
    Ok((Placed::in_room(&placement, grid), pose, fov))
}

fn save(arguments: &Render, still: &::render::Still, shown: &Shown) -> anyhow::Result<()> {
    let [width, height] = still.eye_size_px;
    let mut picture = image::RgbImage::new(width * still.eye_count, height);
    for eye in 0..still.eye_count {
        let bytes = still.rgb8(eye as usize, shown.scene.background);
        let one = image::RgbImage::from_raw(width, height, bytes).context("a picture of its own size")?;
        image::imageops::replace(&mut picture, &one, i64::from(eye * width), 0);
    }
    picture.save(&arguments.out).with_context(|| format!("{}: cannot be written", arguments.out.display()))
}

/// Wall times of whole frames: submitted, drawn, converted, read back; and what the device says of each.
fn timed(
    gpu: &Arc<Gpu>,
    scene: &SceneOnDevice,
    plan: &StereoPlan,
    frames: usize,
) -> anyhow::Result<Vec<(Duration, Option<GpuTimes>)>> {
    let mut ring = FrameRenderer::new(gpu, 1)?;
    // The first frame makes buffers; it is not counted.
    drop(ring.submit(scene, plan)?.finish()?);
    (0..frames.max(1))
        .map(|_| {
            let begun = Instant::now();
            let frame = ring.submit(scene, plan)?.finish()?;
            Ok((begun.elapsed(), frame.gpu_times()))
        })
        .collect()
}

fn report(
    arguments: &Render,
    gpu: &Gpu,
    plan: &StereoPlan,
    times: &[(Duration, Option<GpuTimes>)],
) -> anyhow::Result<()> {
    let spread = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        (v.first().copied().unwrap_or_default(), v.get(v.len() / 2).copied().unwrap_or_default())
    };
    let ms = |d: Duration| d.as_secs_f64() * 1000.0;
    let (frame_min, frame_median) = spread(times.iter().map(|(t, _)| ms(*t)).collect());
    let device = |of: fn(&GpuTimes) -> Duration| {
        spread(times.iter().filter_map(|(_, g)| g.as_ref()).map(|g| ms(of(g))).collect())
    };
    let (raycast, convert) = (device(|g| g.raycast), device(|g| g.convert));
    let [width, height] = plan.output_size_px();
    if arguments.json {
        say(serde_json::to_string_pretty(&serde_json::json!({
            "picture": arguments.out, "adapter": gpu.adapter().name, "eye_size_px": [width, height],
            "eyes": plan.eye_count(), "quality": arguments.quality, "step_mm": plan.step_mm(),
            "frames": times.len(),
            "frame_ms_min": frame_min, "frame_ms_median": frame_median,
            "raycast_ms_min": raycast.0, "raycast_ms_median": raycast.1,
            "convert_ms_min": convert.0, "convert_ms_median": convert.1,
        }))?);
    } else {
        tell(format!("adapter   {}", gpu.adapter()));
        tell(format!(
            "picture   {} eye(s) of {width}x{height}, quality {}, step {:.4} mm",
            plan.eye_count(),
            arguments.quality,
            plan.step_mm()
        ));
        tell(format!(
            "frame     {frame_min:.2} ms least, {frame_median:.2} ms median of {} (with conversion and read-back)",
            times.len()
        ));
        tell(format!("ray-cast  {:.2} ms least, {:.2} ms median", raycast.0, raycast.1));
        tell(format!("convert   {:.2} ms least, {:.2} ms median", convert.0, convert.1));
        say(arguments.out.display());
    }
    Ok(())
}
