//! `holocast bench render`.

use crate::cli::{BenchRender, Chosen, Look, Size};
use crate::commands::accuracy::{chosen, scenes};
use crate::commands::shown::Shown;
use crate::commands::viewpoint::Viewpoint;
use crate::machine;
use crate::terminal::{progress, progress_done, say, tell};
use ::render::{Gpu, SceneOnDevice, VolumeOnDevice};
use anyhow::{Context as _, bail};
use report::{Axis, Plot, Point};
use scene::{Mode, Scene};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;
use sweep::{CostRow, FirstUse, Setting, Watched, cost, first_use};

/// Scale of the plot: two dots a point are sharp on every screen.
const PLOT_SCALE: u32 = 2;

pub(crate) fn run(arguments: &BenchRender) -> anyhow::Result<()> {
    if arguments.rounds == 0 {
        bail!("--rounds is 0, expected 1 or more");
    }
    let settings = chosen(sweep::cost_settings(), &arguments.setting)?;
    let scenes = scenes(&arguments.scene)?;
    fs::create_dir_all(&arguments.out)
        .with_context(|| format!("{}: cannot be made", arguments.out.display()))?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let mut rows = Vec::new();
    for (at, (name, path)) in scenes.iter().enumerate() {
        tell(format!("{} of {}: {name}", at + 1, scenes.len()));
        measure(arguments, &gpu, name, path, &settings, &mut rows).with_context(|| name.clone())?;
        // Each scene as soon as it is measured.
        write(arguments, &gpu, &rows, None)?;
    }
    let stall = match scenes.first() {
        Some((_, path)) => Some(stall(arguments, path)?),
        None => None,
    };
    let results = write(arguments, &gpu, &rows, stall.as_ref())?;
    if arguments.json {
        say(serde_json::to_string_pretty(&results)?);
    } else {
        print(&rows, stall.as_ref());
        say(arguments.out.join("render.json").display());
    }
    Ok(())
}

fn measure(
    arguments: &BenchRender,
    gpu: &Arc<Gpu>,
    name: &str,
    path: &Path,
    settings: &[Setting],
    rows: &mut Vec<CostRow>,
) -> anyhow::Result<()> {
    let shown = Shown::load(Some(path), None, &Chosen::default(), &Look::default())?;
    shown.check_alone("bench render").with_context(|| path.display().to_string())?;
    let volume = Arc::new(VolumeOnDevice::upload(gpu, &shown.loaded.volume, |_| {})?);
    let scene = SceneOnDevice::new(gpu, &volume, &shown.scene)?;
    for size in &arguments.size {
        let watched = watched(arguments, name, &shown, &scene, *size)?;
        for setting in settings {
            progress(format!("{name}: {}x{}, {}", size.0[0], size.0[1], setting.name));
            let row = cost(gpu, &watched, setting, arguments.rounds);
            progress_done();
            rows.push(row?);
        }
    }
    Ok(())
}

fn watched<'a>(
    arguments: &BenchRender,
    name: &'a str,
    shown: &Shown,
    scene: &'a SceneOnDevice,
    size: Size,
) -> anyhow::Result<Watched<'a>> {
    let Viewpoint { placed, eyes, eye_size_px } =
        Viewpoint::of(shown, scene.grid(), Some(size.0), Some(arguments.eye_distance_mm))?;
    let eyes = eyes.try_into().map_err(|_| anyhow::anyhow!("a pair has two eyes"))?;
    Ok(Watched { name, scene, placed, eyes, size_px: eye_size_px })
}

/// Frames of the first scene while two others of its volume, of modes that were not used yet, are made. On a device of its
/// own, which knows no pipeline.
fn stall(arguments: &BenchRender, path: &Path) -> anyhow::Result<FirstUse> {
    tell("the first use of other modes");
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let shown = Shown::load(Some(path), None, &Chosen::default(), &Look::default())?;
    shown.check_alone("bench render").with_context(|| path.display().to_string())?;
    let volume = Arc::new(VolumeOnDevice::upload(&gpu, &shown.loaded.volume, |_| {})?);
    let scene = SceneOnDevice::new(&gpu, &volume, &shown.scene)?;
    let size = arguments.size.first().copied().context("a size")?;
    let watched = watched(arguments, "first use", &shown, &scene, size)?;
    let balanced = chosen(sweep::cost_settings(), &["balanced".to_owned()])?.remove(0);
    let mut others =
        [Mode::Maximum, Mode::XRay, Mode::Threshold].into_iter().filter(|m| *m != shown.scene.mode);
    let mut other =
        || others.next().map(|mode| Scene { mode, ..shown.scene.clone() }).context("another mode");
    Ok(first_use(&gpu, &watched, &balanced, &volume, &other()?, &other()?)?)
}

fn write(
    arguments: &BenchRender,
    gpu: &Gpu,
    rows: &[CostRow],
    stall: Option<&FirstUse>,
) -> anyhow::Result<serde_json::Value> {
    let machine = report::Machine { adapter: Some(gpu.adapter().to_string()), ..machine::facts() };
    let results = serde_json::json!({
        "format": "holocast bench render 1",
        "command": command(arguments),
        "measured_at": humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        "machine": machine,
        "load_average": machine::load_average(),
        "rows": rows,
        "first_use": stall,
    });
    let file = |name: &str, bytes: &[u8]| {
        let path = arguments.out.join(name);
        fs::write(&path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
    };
    file("render.json", (serde_json::to_string_pretty(&results)? + "\n").as_bytes())?;
    file("render.csv", csv(rows).as_bytes())?;
    let picture = plot(rows, &gpu.adapter().name).picture();
    file("render.png", &picture.to_png(PLOT_SCALE))?;
    file("render.svg", picture.to_svg().as_bytes())?;
    Ok(results)
}

/// Samples against time: the bare loop's points are the limit.
fn plot(rows: &[CostRow], adapter: &str) -> Plot {
    let plot = Plot::new(
        format!("What samples cost on {adapter}; the bare loop is the limit"),
        Axis::log("samples of both eyes, millions"),
        Axis::log("ray-cast, milliseconds"),
    );
    let millions = |samples: u64| samples as f64 / 1.0e6;
    let steps = || rows.iter().filter(|row| !row.solves_cells);
    let bare = steps().map(|row| Point::new(millions(row.bare_samples), row.bare_ms.median));
    let mut settings: Vec<&str> = Vec::new();
    for row in steps() {
        if !settings.contains(&row.setting.as_str()) {
            settings.push(&row.setting);
        }
    }
    settings.into_iter().fold(plot.scatter("bare loop of reads", bare), |plot, setting| {
        let points = steps()
            .filter(|row| row.setting == setting)
            .map(|row| Point::new(millions(row.samples), row.raycast_ms.median));
        plot.scatter(setting, points)
    })
}

fn csv(rows: &[CostRow]) -> String {
    let mut csv = "scene,kind,width,height,setting,step_mm,frames,frame_ms_min,frame_ms_median,frame_ms_max,raycast_ms_min,\
         raycast_ms_median,raycast_ms_max,convert_ms_median,rays,samples,contributed,gradients,bare_samples,bare_ms_median,\
         msamples_per_sec,bare_msamples_per_sec,rate_over_bare,taken_over_contributed,skippable,convert_over_raycast,\
         stereo_over_monos,over_cut_lower,over_cut,over_cut_upper\n"
        .to_owned();
    let known = |value: Option<f64>| value.map(|v| v.to_string()).unwrap_or_default();
    for row in rows {
        let fields = [
            // Names of files may hold anything.
            format!("\"{}\"", row.scene.replace('"', "\"\"")),
            format!("\"{}\"", row.kind),
            row.size_px[0].to_string(),
            row.size_px[1].to_string(),
            format!("\"{}\"", row.setting),
            row.step_mm.to_string(),
            row.frames.to_string(),
            row.frame_ms.min.to_string(),
            row.frame_ms.median.to_string(),
            row.frame_ms.max.to_string(),
            row.raycast_ms.min.to_string(),
            row.raycast_ms.median.to_string(),
            row.raycast_ms.max.to_string(),
            known(row.convert_ms.map(|ms| ms.median)),
            row.rays.to_string(),
            row.samples.to_string(),
            row.contributed.to_string(),
            row.gradients.to_string(),
            row.bare_samples.to_string(),
            row.bare_ms.median.to_string(),
            row.msamples_per_sec.to_string(),
            row.bare_msamples_per_sec.to_string(),
            known(row.rate_over_bare.map(|r| r.median)),
            known(row.taken_over_contributed),
            row.skippable.to_string(),
            known(row.convert_over_raycast),
            row.stereo_over_monos.median.to_string(),
            row.over_cut.lower.to_string(),
            row.over_cut.median.to_string(),
            row.over_cut.upper.to_string(),
        ];
        csv += &fields.join(",");
        csv.push('\n');
    }
    csv
}

fn print(rows: &[CostRow], stall: Option<&FirstUse>) {
    say(
        "both eyes; milliseconds are medians; taken: samples over those that contribute; rate: samples a second over those of a \
         bare loop of reads",
    );
    say(
        "scene                size      setting                     frame  ray-cast  convert  Msamples  taken  rate   \
         skippable  stereo/monos  /cut",
    );
    let known = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    for row in rows {
        say(format!(
            "{:<20} {:<9} {:<26} {:>6.1}  {:>8.1}  {:>7}  {:>8.2}  {:>5}  {:>5}  {:>8.0} %  {:>12.2}  {:>4.2}",
            row.scene,
            format!("{}x{}", row.size_px[0], row.size_px[1]),
            row.setting,
            row.frame_ms.median,
            row.raycast_ms.median,
            known(row.convert_ms.map(|ms| ms.median)),
            row.samples as f64 / 1.0e6,
            known(row.taken_over_contributed),
            known(row.rate_over_bare.map(|r| r.median)),
            row.skippable * 100.0,
            row.stereo_over_monos.median,
            row.over_cut.median,
        ));
    }
    if let Some(stall) = stall {
        say(format!(
            "another mode was ready after {:.0} ms; frames took {:.1} ms before, {:.1} ms meanwhile ({:.1} at most), its first \
             {:.2} times a later one ({:.1} times if it is not made ready)",
            stall.ready_ms,
            stall.before_ms.median,
            stall.meanwhile_ms.median,
            stall.meanwhile_ms.max,
            stall.first_over_after,
            stall.unprepared_first_over_after
        ));
    }
}

/// The command that repeats the run.
fn command(arguments: &BenchRender) -> String {
    let scenes: Vec<String> = arguments.scene.iter().map(|path| path.display().to_string()).collect();
    let sizes: String = arguments.size.iter().map(|s| format!(" --size {}x{}", s.0[0], s.0[1])).collect();
    let settings: String = arguments.setting.iter().map(|name| format!(" --setting '{name}'")).collect();
    format!(
        "holocast bench render --scene {}{sizes} --rounds {}{settings}",
        scenes.join(" "),
        arguments.rounds
    )
}
