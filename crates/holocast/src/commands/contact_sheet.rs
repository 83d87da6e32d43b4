//! `holocast contact-sheet`.

use crate::cli::{Chosen, ContactSheet, Kind};
use crate::commands::shown::{facts_of, load_options, quality_named};
use crate::commands::viewpoint::Viewpoint;
use crate::terminal::{progress, progress_done, say, tell};
use ::reference::Picture;
use ::render::{
    DepthGridSize, Gpu, Placed, Quality, SceneOnDevice, StereoPlan, StereoRequest, StillRenderer,
    VolumeOnDevice,
};
use anyhow::{Context as _, bail};
use report::{Sheet, Tile};
use scene::{Mode, Preset, Scene, SceneFile};
use spatial::{EyeView, Fov};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use volume::{Grid, LabelTable};
use volume_io::{LoadError, Loaded};

/// Folders below each other that are looked into: more is a loop of links.
const DEEPEST: usize = 32;
/// A pixel that is seen, for finding where the volume shows.
const SEEN: f32 = 0.04;
/// Of a tile's sides, what stays free around what is seen.
const MARGIN: f64 = 0.06;
/// Least part of the preview that is taken for the picture: a speck is not blown up.
const LEAST_PART: f64 = 0.08;

/// Part of its other sides below which a volume's thinnest side makes it a slab.
const THINNEST: f64 = 0.3;

/// What became of a volume.
struct Entry {
    name: String,
    tile: Tile,
    facts: serde_json::Value,
    failed: bool,
}

pub(crate) fn run(arguments: &ContactSheet) -> anyhow::Result<()> {
    let quality = quality_named(&arguments.quality)?;
    let gpu = Arc::new(Gpu::open(arguments.adapter.as_deref())?);
    let mut found = Vec::new();
    for path in &arguments.paths {
        let base = path.parent().unwrap_or(Path::new("")).to_owned();
        find(path, &base, 0, &mut found)?;
    }
    found.sort();
    let mut entries = Vec::new();
    let mut others = 0;
    for (i, (path, name)) in found.iter().enumerate() {
        progress(format!("{} of {}: {name}", i + 1, found.len()));
        match entry(&gpu, path, name, arguments, quality) {
            Some(entry) => entries.push(entry),
            None => others += 1,
        }
    }
    progress_done();
    if entries.is_empty() {
        bail!("no volume below {}", arguments.paths[0].display());
    }
    let failed = entries.iter().filter(|e| e.failed).count();
    let sheet = Sheet {
        tile_px: arguments.size.0,
        columns: arguments.columns,
        tiles: entries.iter().map(|e| e.tile.clone()).collect(),
    };
    std::fs::write(&arguments.out, sheet.to_png())
        .with_context(|| format!("{}: cannot be written", arguments.out.display()))?;
    tell(format!(
        "{} volumes, {failed} of them failed; {others} other files were passed over",
        entries.len()
    ));
    if arguments.json {
        let all: Vec<&serde_json::Value> = entries.iter().map(|e| &e.facts).collect();
        say(serde_json::to_string_pretty(&all)?);
    } else {
        say(arguments.out.display());
    }
    if failed > 0 {
        let names: Vec<&str> = entries.iter().filter(|e| e.failed).map(|e| e.name.as_str()).collect();
        bail!("{failed} volumes could not be shown: {}", names.join(", "));
    }
    Ok(())
}

/// Files below a path, and folders of DICOM files as one each, with their names from `base` on.
fn find(path: &Path, base: &Path, depth: usize, found: &mut Vec<(PathBuf, String)>) -> anyhow::Result<()> {
    let name = || path.strip_prefix(base).unwrap_or(path).display().to_string();
    if !path.is_dir() {
        found.push((path.to_owned(), name()));
        return Ok(());
    }
    if depth > DEEPEST {
        bail!("{}: more than {DEEPEST} folders below each other", path.display());
    }
    let unreadable = || format!("{}: cannot be read", path.display());
    let inside = std::fs::read_dir(path).with_context(unreadable)?;
    let mut inside: Vec<PathBuf> =
        inside.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>().with_context(unreadable)?;
    inside.sort();
    if inside.iter().any(|p| is_dicom(p)) {
        found.push((path.to_owned(), name()));
        inside.retain(|p| p.is_dir());
    }
    for path in inside {
        find(&path, base, depth + 1, found)?;
    }
    Ok(())
}

/// Whether a file has the mark of DICOM behind its preamble.
fn is_dicom(path: &Path) -> bool {
    let mut start = [0; 132];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    path.is_file() && read.is_ok() && &start[128..] == b"DICM"
}

/// A volume's place on the sheet; `None` for a file that is no volume.
fn entry(
    gpu: &Arc<Gpu>,
    path: &Path,
    name: &str,
    arguments: &ContactSheet,
    quality: Quality,
) -> Option<Entry> {
    let short = short(name);
    match drawn(gpu, path, arguments, quality) {
        Ok(Drawn { rgb, line, preset, facts }) => Some(Entry {
            name: name.to_owned(),
            tile: Tile { rgb: Some(rgb), caption: vec![short, line, preset] },
            facts: serde_json::json!({ "volume": name, "shown": facts }),
            failed: false,
        }),
        Err(error) if is_no_volume(path, &error) => None,
        Err(error) => {
            // The path stands in the name.
            let why = format!("{error:#}").replace(&format!("{}: ", path.display()), "");
            tell(format!("{name}: {why}"));
            Some(Entry {
                name: name.to_owned(),
                tile: Tile { rgb: None, caption: vec![short, "not shown:".into(), why.clone()] },
                facts: serde_json::json!({ "volume": name, "failed": why }),
                failed: true,
            })
        }
    }
}

/// The file's own name; a folder's with that of the one it lies in, for series are called 001.
fn short(name: &str) -> String {
    let path = Path::new(name);
    let own = path.file_name().unwrap_or_default().to_string_lossy();
    match path.parent().and_then(Path::file_name) {
        Some(parent) if path.extension().is_none() => format!("{}/{own}", parent.to_string_lossy()),
        _ => own.into_owned(),
    }
}

/// Whether a file never was one: not what is damaged, or of a volume that cannot be loaded.
fn is_no_volume(path: &Path, error: &anyhow::Error) -> bool {
    match error.downcast_ref() {
        Some(LoadError::UnknownFormat { .. }) => true,
        // A header of raw voxels names them; other JSON lies about everywhere.
        Some(LoadError::Json { .. }) => {
            !std::fs::read_to_string(path).is_ok_and(|text| text.contains("\"raw\""))
        }
        // A picture of anything: one that is a slice atlas of another size than the usual has a JSON beside it.
        Some(_) => path.extension().is_some_and(|e| e == "png") && !path.with_extension("json").exists(),
        None => false,
    }
}

/// A picture and what its caption says.
struct Drawn {
    rgb: Vec<u8>,
    line: String,
    preset: String,
    facts: serde_json::Value,
}

fn drawn(gpu: &Arc<Gpu>, path: &Path, arguments: &ContactSheet, quality: Quality) -> anyhow::Result<Drawn> {
    let mut loaded = volume_io::load(path, &load_options(&Chosen::default()))?;
    let dims = loaded.volume.grid().dims();
    let is_guessed = match loaded.volume.channels() {
        [only] => only.kind == volume::ChannelKind::Intensity && only.looks_like_labels(dims),
        _ => false,
    };
    if is_guessed {
        let labels = Chosen { kind: Some(Kind::Label), ..Chosen::default() };
        loaded = volume_io::load(path, &load_options(&labels))?;
    }
    let facts = facts_of(&loaded, &LabelTable::default(), None);
    let of = &facts.channels[0];
    let preset = Preset::suggested(&facts, of);
    let slab = slab_axis(loaded.volume.grid()).filter(|_| of.labels.is_none());
    let file = match slab {
        // A surface of a few slices is a rim: their mean shows what they hold.
        Some(_) => SceneFile {
            mode: Some(Mode::XRay),
            window: Some(Preset::suggested_window(&facts, of)),
            ..SceneFile::default()
        },
        None => SceneFile { preset: Some(preset.to_owned()), ..SceneFile::default() },
    };
    let scene = file.resolve(&facts)?;
    let preset = if slab.is_some() { "mean of slices" } else { preset };
    let rgb = picture(gpu, &loaded, &scene, slab, arguments.size.0, quality)?;
    let [x, y, z] = dims;
    let modality = match (&facts.modality, preset) {
        (Some(modality), _) => modality.clone(),
        (None, "labels") if is_guessed => "labels, as it seems".to_owned(),
        (None, "labels") => "labels".to_owned(),
        (None, _) if Preset::suggested(&facts, of) == "bone" => "CT by its values".to_owned(),
        (None, _) => "modality unknown".to_owned(),
    };
    let mm = loaded.volume.grid().spacing_mm().to_array().map(|s| format!("{s:.2}")).join("×");
    Ok(Drawn {
        rgb,
        line: format!("{x}×{y}×{z}, {mm} mm"),
        preset: format!("{modality}; {preset}"),
        facts: serde_json::json!({ "dims": dims, "modality": facts.modality, "preset": preset }),
    })
}

/// The volume from before it, as large as it shows.
fn picture(
    gpu: &Arc<Gpu>,
    loaded: &Loaded,
    scene: &Scene,
    slab: Option<usize>,
    size_px: [u32; 2],
    quality: Quality,
) -> anyhow::Result<Vec<u8>> {
    let grid = loaded.volume.grid();
    let on_device = Arc::new(VolumeOnDevice::upload(gpu, &loaded.volume, |_| {})?);
    let on_device = SceneOnDevice::new(gpu, &on_device, scene)?;
    let (placed, eye) = match slab {
        Some(axis) => Viewpoint::onto_slices(grid, scene, axis, size_px)?,
        None => Viewpoint::before(grid, scene, size_px)?,
    };
    let still = |eye: EyeView, size_px: [u32; 2], quality: Quality| -> anyhow::Result<_> {
        let request = StereoRequest {
            eyes: &[eye],
            placed: Placed { ..placed },
            eye_size_px: size_px,
            quality,
            step_mm: None,
            depth_grid: DepthGridSize::default(),
        };
        let plan = StereoPlan::new(&request, grid, on_device.numbers())?;
        Ok(StillRenderer::new(gpu).render(&on_device, &plan)?)
    };
    let preview = still(eye, size_px, Quality::DRAFT)?;
    let eye = EyeView { fov: fitted(eye.fov, preview.eye(0), size_px)?, ..eye };
    let drawn = still(eye, size_px, quality)?;
    let picture = Picture::from_f32(size_px[0], size_px[1], drawn.eye(0), drawn.eye_depth_mm(0))?;
    let rgba = picture.over(scene.background).to_rgba8();
    Ok(rgba.chunks_exact(4).flat_map(|p| &p[..3]).copied().collect())
}

/// The axis along which a volume is so thin that it is a stack of slices to look at, not a body.
fn slab_axis(grid: &Grid) -> Option<usize> {
    let size_mm = grid.size_mm().to_array();
    let thinnest = (0..3).min_by(|&a, &b| size_mm[a].total_cmp(&size_mm[b]))?;
    let others = (0..3).filter(|&axis| axis != thinnest);
    others.map(|axis| size_mm[axis]).all(|mm| size_mm[thinnest] < mm * THINNEST).then_some(thinnest)
}

/// The part of a field of view in which something is seen, with a margin, in the picture's shape.
fn fitted(fov: Fov, rgba: &[[f32; 4]], [width, height]: [u32; 2]) -> anyhow::Result<Fov> {
    let (mut low, mut high) = ([1.0f64; 2], [0.0f64; 2]);
    for (i, _) in rgba.iter().enumerate().filter(|(_, p)| p[3] > SEEN) {
        let (x, y) = (i as u32 % width, i as u32 / width);
        for (axis, (at, n)) in [(x, width), (y, height)].into_iter().enumerate() {
            low[axis] = low[axis].min(f64::from(at) / f64::from(n));
            high[axis] = high[axis].max(f64::from(at + 1) / f64::from(n));
        }
    }
    if low[0] >= high[0] {
        return Ok(fov);
    }
    // One part of both sides: pixels stay square.
    let part = (high[0] - low[0]).max(high[1] - low[1]).max(LEAST_PART) * (1.0 + 2.0 * MARGIN);
    let [left, right, up, down] = fov.tangents();
    let middle = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
    let across = |part_of: f64| left + (right - left) * part_of;
    let along = |part_of: f64| up + (down - up) * part_of;
    Ok(Fov::checked(
        across(middle[0] - part / 2.0).atan(),
        across(middle[0] + part / 2.0).atan(),
        along(middle[1] - part / 2.0).atan(),
        along(middle[1] + part / 2.0).atan(),
    )?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stack_of_few_slices_is_a_slab_and_a_body_is_none() {
        let grid = |mm: [f64; 3]| Grid::axis_aligned([10; 3], spatial::DVec3::from_array(mm)).unwrap();
        assert_eq!(slab_axis(&grid([1.0, 1.0, 0.2])), Some(2));
        assert_eq!(slab_axis(&grid([0.2, 2.0, 1.0])), Some(0));
        assert_eq!(slab_axis(&grid([1.0, 1.0, 0.5])), None);
    }

    #[test]
    fn a_field_of_view_shrinks_to_what_is_seen_and_keeps_its_shape() {
        let fov = Fov::symmetric(0.4, 0.3).unwrap();
        let mut rgba = vec![[0.0f32; 4]; 40 * 30];
        for y in 6..12 {
            for x in 20..24 {
                rgba[y * 40 + x] = [1.0; 4];
            }
        }
        let [left, right, up, down] = fitted(fov, &rgba, [40, 30]).unwrap().tangents();
        let [l, r, u, d] = fov.tangents();
        let part = 0.2 * (1.0 + 2.0 * MARGIN);
        assert!(((right - left) / (r - l) - part).abs() < 1e-9, "six of thirty rows, and the margins");
        assert!(((down - up) / (d - u) - part).abs() < 1e-9);
        assert!(((left + right) / 2.0 - (l + (r - l) * 22.0 / 40.0)).abs() < 1e-9);
        assert_eq!(fitted(fov, &vec![[0.0; 4]; 1200], [40, 30]).unwrap(), fov);
    }
}
