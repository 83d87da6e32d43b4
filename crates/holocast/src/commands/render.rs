//! `holocast render`.

use crate::cli::Render;
use crate::commands::shown::{Shown, quality_named, tuned};
use crate::commands::viewpoint::Viewpoint;
use crate::terminal::{progress, progress_done, say, tell};
use ::reference::{Picture, RaySetup, Reference};
use ::render::{
    DepthGridSize, FrameRenderer, Gpu, GpuTimes, SceneOnDevice, StereoPlan, StereoRequest, Still,
    StillRenderer, VolumeOnDevice,
};
use anyhow::{Context as _, bail};
use picture_io::Precision;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use volume::Volume;

pub(crate) fn run(arguments: &Render) -> anyhow::Result<()> {
    let outputs = Outputs::of(arguments)?;
    if arguments.reference { exact(arguments, &outputs) } else { approximate(arguments, &outputs) }
}

/// The renderer's picture.
fn approximate(arguments: &Render, outputs: &Outputs<'_>) -> anyhow::Result<()> {
    let mut quality = tuned(quality_named(&arguments.quality)?, &arguments.tune)?;
    quality.skip_empty = !arguments.no_skip;
    let shown = Shown::load(
        arguments.scene.as_deref(),
        arguments.volume.as_deref(),
        &arguments.chosen,
        &arguments.look,
    )?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    shown.tell_register()?;
    let upload = |volume: &Volume| Ok(Arc::new(VolumeOnDevice::upload(&gpu, volume, |_| {})?));
    let volumes: Vec<_> = shown.volumes().into_iter().map(upload).collect::<anyhow::Result<_>>()?;
    let on_device = SceneOnDevice::of_several(&gpu, &volumes, &shown.scene)?;
    let grid = on_device.grid();
    let view = viewpoint(arguments, &shown)?;
    let request = StereoRequest {
        eyes: &view.eyes,
        placed: view.placed,
        eye_size_px: view.eye_size_px,
        quality,
        step_mm: arguments.step_mm.or(shown.file.step_mm),
        depth_grid: DepthGridSize::default(),
    };
    let plan = StereoPlan::new(&request, grid, on_device.numbers())?;
    if arguments.step_mm.is_some() && !plan.takes_steps() {
        tell(format!("note: the level {} takes no steps here: --step-mm changes nothing", arguments.quality));
    }

    let still = StillRenderer::new(&gpu).render(&on_device, &plan)?;
    outputs.write(&picture_of(&still)?, shown.scene.background)?;
    let times = timed(&gpu, &on_device, &plan, arguments.frames)?;
    report(arguments, &gpu, &plan, &times)
}

/// The exact picture, without a GPU.
fn exact(arguments: &Render, outputs: &Outputs<'_>) -> anyhow::Result<()> {
    let shown = Shown::load(
        arguments.scene.as_deref(),
        arguments.volume.as_deref(),
        &arguments.chosen,
        &arguments.look,
    )?;
    shown.tell_register()?;
    let grid = shown.loaded.volume.grid();
    let reference = Reference::of_several(&shown.volumes(), &shown.scene)?;
    let view = viewpoint(arguments, &shown)?;
    let [width, height] = view.eye_size_px;
    let begun = Instant::now();
    let mut pictures = Vec::new();
    for (at, eye) in view.eyes.iter().enumerate() {
        let setup = RaySetup::new(grid, view.placed.index_from_world, *eye);
        let eyes = view.eyes.len();
        let told = move |p: ::reference::Progress| {
            let rows = p.rows * eyes;
            let done = p.rows * at + p.rows_done;
            progress(format!("the exact picture: {:.0} % of {rows} rows", done as f64 * 100.0 / rows as f64));
        };
        pictures.push(reference.picture(&setup, width, height, &told)?);
    }
    progress_done();
    let secs = begun.elapsed().as_secs_f64();
    outputs.write(&side_by_side(pictures)?, shown.scene.background)?;
    if arguments.json {
        say(serde_json::to_string_pretty(&serde_json::json!({
            "picture": arguments.out, "data": outputs.data, "reference": true,
            "eye_size_px": [width, height], "eyes": view.eyes.len(), "seconds": secs,
        }))?);
    } else {
        tell(format!(
            "picture   {} eye(s) of {width}x{height}, exact (float64), in {secs:.1} s",
            view.eyes.len()
        ));
        say(arguments.out.display());
    }
    Ok(())
}

fn viewpoint(arguments: &Render, shown: &Shown) -> anyhow::Result<Viewpoint> {
    let distance_mm = arguments.stereo.then_some(arguments.eye_distance_mm);
    Viewpoint::of(shown, shown.loaded.volume.grid(), arguments.size.map(|s| s.0), distance_mm)
}

/// The files that were asked for.
struct Outputs<'a> {
    png: Option<&'a Path>,
    data: Vec<&'a PathBuf>,
}

impl<'a> Outputs<'a> {
    /// Looks at names and folders, so that nobody waits for a picture that has nowhere to go.
    fn of(arguments: &'a Render) -> anyhow::Result<Self> {
        let mut outputs = Self { png: None, data: arguments.data.iter().collect() };
        let out = &arguments.out;
        match out.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("png") => outputs.png = Some(out),
            Some("npy") => outputs.data.push(out),
            _ => bail!("{}: cannot be written: expected a name that ends in .png or .npy", out.display()),
        }
        for path in outputs.data.iter().map(|p| p.as_path()).chain(outputs.png) {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            if folder.is_some_and(|folder| !folder.is_dir()) {
                bail!("{}: cannot be written: there is no such folder", path.display());
            }
        }
        Ok(outputs)
    }

    fn write(&self, picture: &Picture, background: [f64; 3]) -> anyhow::Result<()> {
        if let Some(path) = self.png {
            picture_io::save_png(path, picture, background)?;
        }
        for path in &self.data {
            picture_io::save_data(path, picture, Precision::Float32)?;
        }
        Ok(())
    }
}

fn picture_of(still: &Still) -> anyhow::Result<Picture> {
    let [width, height] = still.eye_size_px;
    let eyes = (0..still.eye_count as usize)
        .map(|eye| Picture::from_f32(width, height, still.eye(eye), still.eye_depth_mm(eye)));
    side_by_side(eyes.collect::<Result<_, _>>()?)
}

/// One picture of all eyes.
fn side_by_side(eyes: Vec<Picture>) -> anyhow::Result<Picture> {
    let mut eyes = eyes.into_iter();
    let first = eyes.next().context("a picture has an eye")?;
    Ok(eyes.try_fold(first, |all, eye| all.beside(&eye))?)
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
            "picture": arguments.out, "data": arguments.data, "adapter": gpu.adapter().name, "eye_size_px": [width, height],
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
