//! `holocast bench accuracy`.

use crate::cli::{BenchAccuracy, Chosen, Look};
use crate::commands::shown::Shown;
use crate::commands::viewpoint::Viewpoint;
use crate::machine;
use crate::terminal::{progress, progress_done, say, tell};
use ::render::Gpu;
use anyhow::{Context as _, bail};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;
use sweep::{LevelBounds, Options, Outcome, Row, Setting, Subject, Sweep};

/// Scale of the plots: two dots a point are sharp on every screen.
const PLOT_SCALE: u32 = 2;
/// Errors are told in steps of an 8-bit picture.
const STEPS: f64 = 255.0;

pub(crate) fn run(arguments: &BenchAccuracy) -> anyhow::Result<()> {
    let settings = chosen(sweep::settings(), &arguments.setting)?;
    let scenes = scenes(&arguments.scene)?;
    if arguments.frames == 0 {
        bail!("--frames is 0, expected 1 or more");
    }
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let options = Options { settings, frames: arguments.frames, program: sweep::this_program()? };
    let mut sweep = Sweep::open(&arguments.out, options)?;
    let mut rows = Vec::new();
    for (at, (name, path)) in scenes.iter().enumerate() {
        tell(format!("{} of {}: {name}", at + 1, scenes.len()));
        rows.extend(measured(arguments, &gpu, &mut sweep, name, path)?);
    }
    write(arguments, &gpu, rows)
}

/// All settings of a scene.
fn measured(
    arguments: &BenchAccuracy,
    gpu: &Arc<Gpu>,
    sweep: &mut Sweep,
    name: &str,
    path: &Path,
) -> anyhow::Result<Vec<Row>> {
    let shown = Shown::load(Some(path), None, &Chosen::default(), &Look::default())?;
    shown.check_alone("bench accuracy").with_context(|| path.display().to_string())?;
    let volume = &shown.loaded.volume;
    let Viewpoint { placed, eyes, eye_size_px } =
        Viewpoint::of(&shown, volume.grid(), Some(arguments.size.0), None)?;
    let eye = *eyes.first().context("a still has an eye")?;
    let subject = Subject { name, volume, scene: &shown.scene, placed, eye, size_px: eye_size_px };
    if sweep.has_changed(&subject) {
        tell(format!("note: {name} is not what it was when it was measured: it is measured anew"));
    }
    let rows = sweep.measure(gpu, &subject, &|p| {
        progress(format!("{}: {} ({:.0} %)", p.subject, p.doing, p.part * 100.0));
    });
    progress_done();
    rows.with_context(|| name.to_owned())
}

/// Those settings of all that have one of the names; all of them without a name.
pub(crate) fn chosen(all: Vec<Setting>, names: &[String]) -> anyhow::Result<Vec<Setting>> {
    if names.is_empty() {
        return Ok(all);
    }
    let one = |name: &String| {
        all.iter().find(|setting| setting.name == *name).cloned().with_context(|| {
            let there: Vec<&str> = all.iter().map(|setting| setting.name.as_str()).collect();
            format!("no setting '{name}'; there are: {}", there.join(", "))
        })
    };
    names.iter().map(one).collect()
}

/// Scene files by name. A folder stands for all scenes in it.
pub(crate) fn scenes(paths: &[PathBuf]) -> anyhow::Result<Vec<(String, PathBuf)>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = fs::read_dir(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let mut inside: Vec<PathBuf> = entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<Result<_, _>>()
            .with_context(|| format!("{}: cannot be read", path.display()))?;
        inside.retain(|file| file.extension().is_some_and(|extension| extension == "json"));
        inside.sort();
        if inside.is_empty() {
            bail!("{}: there is no scene (.json) in this folder", path.display());
        }
        files.extend(inside);
    }
    let mut names = BTreeSet::new();
    let mut named = Vec::new();
    for file in files {
        if named.iter().any(|(_, other)| *other == file) {
            bail!("{} is named twice", file.display());
        }
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        // Two scenes of one name are told apart by where they lie.
        let name = if names.contains(&stem) { file.display().to_string() } else { stem };
        names.insert(name.clone());
        named.push((name, file));
    }
    Ok(named)
}

fn write(arguments: &BenchAccuracy, gpu: &Gpu, rows: Vec<Row>) -> anyhow::Result<()> {
    let machine = report::Machine { adapter: Some(gpu.adapter().to_string()), ..machine::facts() };
    let measured_at = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let outcome = Outcome::new(command(arguments), measured_at, machine, rows);
    let file = |name: &str, bytes: &[u8]| {
        let path = arguments.out.join(name);
        fs::write(&path, bytes).with_context(|| format!("{}: cannot be written", path.display()))?;
        Ok::<_, anyhow::Error>(path)
    };
    let json = file("accuracy.json", outcome.to_json().as_bytes())?;
    file("accuracy.csv", outcome.to_csv().as_bytes())?;
    let title = format!("What a frame of {} costs on {}", size(arguments), gpu.adapter().name);
    for (name, label, error) in [
        ("max-error", "largest error beside doubt, 1/255", max_error as fn(&Row) -> f64),
        ("rmse", "RMSE beside doubt, 1/255", rmse),
    ] {
        let picture = outcome.picture(&title, label, error);
        file(&format!("{name}.png"), &picture.to_png(PLOT_SCALE))?;
        file(&format!("{name}.svg"), picture.to_svg().as_bytes())?;
    }
    if arguments.json {
        say(serde_json::to_string_pretty(&serde_json::json!({
            "results": json, "levels": outcome.levels(),
        }))?);
    } else {
        print(outcome.levels());
        say(json.display());
    }
    Ok(())
}

fn max_error(row: &Row) -> f64 {
    row.errors.beside_doubt.max_abs_error * STEPS
}

fn rmse(row: &Row) -> f64 {
    row.errors.beside_doubt.rmse * STEPS
}

/// What holds for the levels on every scene.
fn print(levels: &[LevelBounds]) {
    if levels.is_empty() {
        return;
    }
    say("worst of all scenes; errors in 255ths, beside pixels that have several right answers in float32");
    say("level     ms a frame  largest error (scene)          RMSE    PSNR dB  SSIM      in doubt");
    for level in levels {
        let psnr = level.psnr_db_beside_doubt.map_or_else(|| "equal".to_owned(), |psnr| format!("{psnr:.1}"));
        say(format!(
            "{:<9} {:>10.1}  {:>8.3} {:<20}  {:>6.3}  {:>7}  {:.6}  {:.3} %",
            level.level,
            level.frame_ms,
            level.max_abs_error_beside_doubt * STEPS,
            format!("({})", level.max_abs_error_beside_doubt_scene),
            level.rmse_beside_doubt * STEPS,
            psnr,
            level.ssim,
            level.part_in_doubt * 100.0
        ));
    }
}

fn size(arguments: &BenchAccuracy) -> String {
    let [width, height] = arguments.size.0;
    format!("{width}x{height}")
}

/// The command that repeats the run.
fn command(arguments: &BenchAccuracy) -> String {
    let scenes: Vec<String> = arguments.scene.iter().map(|path| path.display().to_string()).collect();
    let settings: String = arguments.setting.iter().map(|name| format!(" --setting '{name}'")).collect();
    format!(
        "holocast bench accuracy --scene {} --size {} --frames {}{settings}",
        scenes.join(" "),
        size(arguments),
        arguments.frames
    )
}
