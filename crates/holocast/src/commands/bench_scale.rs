//! `holocast bench scale`.

use crate::cli::BenchScale;
use crate::commands::shown::load_volume;
use crate::machine;
use crate::terminal::{progress, progress_done, say, tell};
use ::render::{
    DepthGridSize, FrameRenderer, Gpu, Placed, SceneOnDevice, StereoPlan, StereoRequest, VolumeOnDevice,
};
use anyhow::{Context as _, bail};
use report::{Axis, Plot, Point};
use scene::{SceneFile, VolumeFacts};
use spatial::{DVec3, EyeView, Fov, Pose};
use std::fs;
use std::sync::Arc;
use std::time::{Instant, SystemTime};
use sweep::{ScaleOptions, Scaling, Setting, scaling};
use volume_io::LoadOptions;

const PLOT_SCALE: u32 = 2;
/// The occupied part that is held while other things are varied.
const OCCUPIED: f64 = 0.1;
/// Voxels along a side that are held.
const SIDE: u32 = 256;
/// An eye's pixels where many headsets watch.
const SESSION_SIZE_PX: [u32; 2] = [160, 90];
/// Bytes of memory that a voxel of 16 bits takes at most: the host's, the device's, and what stands by.
const BYTES_A_VOXEL: u64 = 5;

pub(crate) fn run(arguments: &BenchScale) -> anyhow::Result<()> {
    check(arguments)?;
    let setting = sweep::cost_settings().into_iter().find(|s| s.name == arguments.setting);
    let setting: Setting = setting.with_context(|| {
        let names: Vec<String> = sweep::cost_settings().into_iter().map(|s| s.name).collect();
        format!("no setting '{}'; there are: {}", arguments.setting, names.join(", "))
    })?;
    fs::create_dir_all(&arguments.out)
        .with_context(|| format!("{}: cannot be made", arguments.out.display()))?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let sizes_px: Vec<[u32; 2]> = arguments.sizes.iter().map(|s| s.0).collect();
    let held = *sizes_px.get(1).or(sizes_px.first()).context("--sizes names none")?;
    let options = ScaleOptions {
        setting,
        sizes_px,
        sides: arguments.sides.iter().copied().filter(|&side| fits(side)).collect(),
        occupied: arguments.occupied.clone(),
        sessions: arguments.sessions.clone(),
        rounds: arguments.rounds,
        held: (held, SIDE, OCCUPIED),
        session_size_px: SESSION_SIZE_PX,
    };
    let start_up = match arguments.start_up {
        0 => None,
        side if fits(side) => Some(start_up(arguments, &gpu, side, &options)?),
        _ => None,
    };
    let scaling = scaling(&gpu, &options, &|doing| progress(doing.to_owned()));
    progress_done();
    let scaling = scaling?;
    let machine = report::Machine { adapter: Some(gpu.adapter().to_string()), ..machine::facts() };
    let results = serde_json::json!({
        "format": "holocast bench scale 1",
        "command": command(arguments),
        "measured_at": humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        "machine": machine,
        "load_average": machine::load_average(),
        "setting": arguments.setting,
        "held": { "size_px": held, "side": SIDE, "occupied": OCCUPIED },
        "curves": scaling.curves,
        "volumes": scaling.volumes,
        "start_up": start_up,
    });
    let file = |name: &str, bytes: &[u8]| {
        let path = arguments.out.join(name);
        fs::write(&path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
    };
    file("scale.json", (serde_json::to_string_pretty(&results)? + "\n").as_bytes())?;
    let picture = Plot::many(&format!("How cost grows on {}", gpu.adapter().name), &plots(&scaling), 2);
    file("scale.png", &picture.to_png(PLOT_SCALE))?;
    file("scale.svg", picture.to_svg().as_bytes())?;
    if arguments.json {
        say(serde_json::to_string_pretty(&results)?);
    } else {
        print(&scaling, start_up.as_ref());
        say(arguments.out.join("scale.json").display());
    }
    Ok(())
}

fn check(arguments: &BenchScale) -> anyhow::Result<()> {
    if arguments.rounds == 0 {
        bail!("--rounds is 0, expected 1 or more");
    }
    if let Some(part) = arguments.occupied.iter().find(|part| !(0.0..=1.0).contains(*part)) {
        bail!("--occupied has {part}, expected 0 to 1");
    }
    if let Some(sessions) = arguments.sessions.iter().find(|n| !(1..=1000).contains(*n)) {
        bail!("--sessions has {sessions}, expected 1 to 1000");
    }
    if let Some(side) = arguments.sides.iter().chain([&arguments.start_up]).find(|side| **side > 4096) {
        bail!("{side} voxels along a side: expected at most 4096");
    }
    if arguments.sides.contains(&0) {
        bail!("--sides has 0, expected 1 or more");
    }
    Ok(())
}

/// Whether the memory that is free holds such a volume; says so if not.
fn fits(side: u32) -> bool {
    let needed = u64::from(side).pow(3) * BYTES_A_VOXEL;
    match machine::available_bytes() {
        Some(free) if needed > free => {
            tell(format!(
                "{side}³ voxels are left out: they need {} MB, {} are free",
                needed / 1_000_000,
                free / 1_000_000
            ));
            false
        }
        _ => true,
    }
}

/// From a volume's file, which the system has just written and so still holds, to its first frame.
#[derive(Debug, serde::Serialize)]
struct StartUp {
    side: u32,
    file_bytes: u64,
    load_ms: f64,
    upload_ms: f64,
    scene_ms: f64,
    prepare_ms: f64,
    first_frame_ms: f64,
    whole_ms: f64,
}

fn start_up(
    arguments: &BenchScale,
    gpu: &Arc<Gpu>,
    side: u32,
    options: &ScaleOptions,
) -> anyhow::Result<StartUp> {
    progress(format!("from file to first frame: {side}³ voxels"));
    let (voxels, header) = (arguments.out.join("phantom.raw"), arguments.out.join("phantom.json"));
    {
        let volume = sweep::phantom(side, OCCUPIED)?;
        let channel = volume.channels().first().context("a phantom has a channel")?;
        fs::write(&voxels, channel.voxels.as_bytes())
            .with_context(|| format!("{}: cannot be written", voxels.display()))?;
    }
    let spacing = 256.0 / f64::from(side);
    let endian = if cfg!(target_endian = "big") { "big" } else { "little" };
    let told = serde_json::json!({
        "endian": endian,
        "raw": "phantom.raw", "dims": [side, side, side], "type": "uint16", "spacing_mm": [spacing, spacing, spacing],
    });
    fs::write(&header, told.to_string())
        .with_context(|| format!("{}: cannot be written", header.display()))?;
    let file_bytes = fs::metadata(&voxels).map(|m| m.len())?;
    let ms = |since: Instant| since.elapsed().as_secs_f64() * 1000.0;
    let whole = Instant::now();
    let loaded = load_volume(&header, LoadOptions::default())?;
    let load_ms = ms(whole);
    let begun = Instant::now();
    let volume = Arc::new(VolumeOnDevice::upload(gpu, &loaded.volume, |_| {})?);
    let upload_ms = ms(begun);
    let begun = Instant::now();
    let json = r#"{"transfer": [[0, 0, 0, 0, 0], [500, 0, 0, 0, 0], [1000, 0.3, 0.5, 0.9, 0.0005], [3000, 1, 0.8, 0.5, 0.003]]}"#;
    let scene = SceneFile::from_json(json)?.resolve(&VolumeFacts::of(&loaded.volume))?;
    let scene = SceneOnDevice::new(gpu, &volume, &scene)?;
    let scene_ms = ms(begun);
    let begun = Instant::now();
    scene.prepare(&options.setting.quality)?;
    let prepare_ms = ms(begun);
    let begun = Instant::now();
    let middle = DVec3::splat(128.0);
    let eye = EyeView {
        world_from_eye: Pose::looking_at(DVec3::new(128.0, -480.0, 300.0), middle, DVec3::Z)
            .context("a view")?,
        fov: Fov::symmetric(0.5, 0.3)?,
    };
    let request = StereoRequest {
        eyes: &[eye; 2],
        placed: Placed::own_axes(volume.grid()),
        eye_size_px: options.held.0,
        quality: options.setting.quality,
        step_mm: None,
        depth_grid: DepthGridSize::default(),
    };
    let plan = StereoPlan::new(&request, volume.grid(), scene.numbers())?;
    drop(FrameRenderer::new(gpu, 1)?.submit(&scene, &plan)?.finish()?);
    let first_frame_ms = ms(begun);
    let whole_ms = ms(whole);
    // Only what it took was wanted.
    let _ = fs::remove_file(&voxels).and_then(|()| fs::remove_file(&header));
    progress_done();
    Ok(StartUp { side, file_bytes, load_ms, upload_ms, scene_ms, prepare_ms, first_frame_ms, whole_ms })
}

fn plots(scaling: &Scaling) -> Vec<Plot> {
    let plot = |over: &str| {
        let axis = Axis::log("relative to the first point");
        Plot::new(over.to_owned(), axis.clone(), axis)
    };
    scaling
        .curves
        .iter()
        .map(|curve| {
            let first = curve.points.first();
            let of = |value: &dyn Fn(&sweep::ScalePoint) -> f64| -> Vec<Point> {
                let unit = first.map_or(1.0, value);
                let x = first.map_or(1.0, |p| p.x);
                curve.points.iter().map(|p| Point::new(p.x / x, value(p) / unit)).collect()
            };
            plot(&curve.over).lines("time of a frame", of(&|p| p.frame_ms.median)).lines(
                "samples taken",
                of(&|p| p.samples as f64 * if curve.over == "sessions" { p.x } else { 1.0 }),
            )
        })
        .collect()
}

fn print(scaling: &Scaling, start_up: Option<&StartUp>) {
    for curve in &scaling.curves {
        let law = |law: Option<sweep::PowerLaw>| {
            law.map_or_else(|| "-".to_owned(), |l| format!("{:.2} (R² {:.3})", l.exponent, l.r_squared))
        };
        say(format!(
            "{}: time grows to the power {}, samples {}, time over samples {}",
            curve.over,
            law(curve.time),
            law(curve.samples),
            law(curve.time_over_samples)
        ));
        for p in &curve.points {
            say(format!(
                "  {:>12}  frame {:>8.1} ms ({:.1} to {:.1})  ray-cast {:>8.1} ms  {:>8.2} Msamples, {:.2} contribute",
                p.x,
                p.frame_ms.median,
                p.frame_ms.min,
                p.frame_ms.max,
                p.raycast_ms.median,
                p.samples as f64 / 1.0e6,
                p.contributed as f64 / 1.0e6
            ));
        }
    }
    for v in &scaling.volumes {
        say(format!(
            "{}³, {:.0} % occupied: upload {:.0} ms, {:.1} % more memory to skip with, change of transfer function {:.1} ms \
             ({:.1} to {:.1}) and {:.1} ms in the first frame",
            v.side,
            v.occupied * 100.0,
            v.upload_ms,
            v.acceleration_over_voxels * 100.0,
            v.change_ms.median,
            v.change_ms.min,
            v.change_ms.max,
            v.first_frame_extra_ms
        ));
    }
    if let Some(s) = start_up {
        say(format!(
            "from a file of {side}³ voxels to the first frame: {:.0} ms (load {:.0}, upload {:.0}, scene {:.0}, pipelines {:.0}, \
             frame {:.0})",
            s.whole_ms,
            s.load_ms,
            s.upload_ms,
            s.scene_ms,
            s.prepare_ms,
            s.first_frame_ms,
            side = s.side
        ));
    }
}

/// The command that repeats the run.
fn command(arguments: &BenchScale) -> String {
    let list = |items: Vec<String>| items.join(",");
    format!(
        "holocast bench scale --setting '{}' --sizes {} --sides {} --occupied {} --sessions {} --rounds {} --start-up {}",
        arguments.setting,
        list(arguments.sizes.iter().map(|s| format!("{}x{}", s.0[0], s.0[1])).collect()),
        list(arguments.sides.iter().map(ToString::to_string).collect()),
        list(arguments.occupied.iter().map(ToString::to_string).collect()),
        list(arguments.sessions.iter().map(ToString::to_string).collect()),
        arguments.rounds,
        arguments.start_up
    )
}
