//! A scene and its volume, from the command line's two paths.

use crate::cli::{Chosen, Kind, Look};
use crate::terminal::{progress, progress_done, tell};
use ::render::Quality;
use anyhow::{Context as _, bail};
use colour_io::Imported;
use scene::{Preset, Scene, SceneFile, VolumeFacts};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use volume::{ChannelKind, LabelTable};
use volume_io::{LoadOptions, Loaded};

/// A scene file with the volume that it shows.
pub(crate) struct Shown {
    pub(crate) file: SceneFile,
    pub(crate) scene: Scene,
    pub(crate) facts: VolumeFacts,
    pub(crate) volume_path: PathBuf,
    pub(crate) loaded: Loaded,
}

impl Shown {
    /// Reads the scene (or takes the default one) and loads the volume named on the command line or in the scene.
    pub(crate) fn load(
        scene_path: Option<&Path>,
        volume_path: Option<&Path>,
        chosen: &Chosen,
        look: &Look,
    ) -> anyhow::Result<Self> {
        let mut file = match scene_path {
            Some(path) => read_scene(path)?,
            None => SceneFile::default(),
        };
        let beside_scene =
            |relative: &Path| scene_path.and_then(Path::parent).unwrap_or(Path::new(".")).join(relative);
        if let Some(preset) = &look.preset {
            Preset::named(preset)?;
            file.preset = Some(preset.clone());
        }
        let labels = named_labels(&mut file, look, &beside_scene)?;
        let imported = named_transfer(&mut file, look, &beside_scene)?;
        let volume_path = match (volume_path, &file.volume, scene_path) {
            (Some(path), _, _) => path.to_owned(),
            (None, Some(relative), Some(scene)) => scene.parent().unwrap_or(Path::new(".")).join(relative),
            _ => bail!("no volume: name one with --volume PATH, or in the scene"),
        };
        let loaded = load_volume(&volume_path, load_options(chosen))?;
        for note in &loaded.report.notes {
            tell(format!("note: {note}"));
        }
        let facts = facts_of(&loaded, &labels, look.modality.as_deref());
        if let Some(imported) = imported {
            take_transfer(&mut file, &imported, &facts)?;
        }
        let scene = file.resolve(&facts).with_context(|| match scene_path {
            Some(path) => path.display().to_string(),
            None => "the default scene".to_owned(),
        })?;
        Ok(Self { file, scene, facts, volume_path, loaded })
    }
}

/// What a scene needs to know of a loaded volume. `labels` go before the volume's own; `modality` goes before the file's.
pub(crate) fn facts_of(loaded: &Loaded, labels: &LabelTable, modality: Option<&str>) -> VolumeFacts {
    VolumeFacts::of(&loaded.volume)
        .with_labels(&loaded.report.labels.with(labels))
        .with_modality(modality.map(str::to_uppercase).as_deref().or(loaded.report.modality.as_deref()))
}

/// The labels of the file that the command line names, else the scene.
fn named_labels(
    file: &mut SceneFile,
    look: &Look,
    beside_scene: &dyn Fn(&Path) -> PathBuf,
) -> anyhow::Result<LabelTable> {
    let of_scene = file.labels.as_mut().and_then(|labels| labels.file.take());
    let path = look.labels.clone().or_else(|| of_scene.map(|path| beside_scene(&path)));
    Ok(path.map(|path| colour_io::load_labels(&path)).transpose()?.unwrap_or_default())
}

/// The transfer function of the file that the command line names, else the scene: `FILE#NAME`, where it has several.
fn named_transfer(
    file: &mut SceneFile,
    look: &Look,
    beside_scene: &dyn Fn(&Path) -> PathBuf,
) -> anyhow::Result<Option<Imported>> {
    let of_scene = file.transfer_file.take();
    let (named, path): (_, &dyn Fn(&str) -> PathBuf) = match (&look.transfer, of_scene) {
        (Some(named), _) => (named.clone(), &|path| PathBuf::from(path)),
        (None, Some(named)) => (named, &|path| beside_scene(Path::new(path))),
        (None, None) => return Ok(None),
    };
    // A file may have a # in its name.
    let whole = path(&named);
    let (path, name) = match named.rsplit_once('#') {
        Some((before, name)) if !whole.exists() => (path(before), Some(name)),
        _ => (whole, None),
    };
    let imported = colour_io::load_transfer(&path, name)?;
    for note in &imported.notes {
        tell(format!("note: {}: {note}", path.display()));
    }
    Ok(Some(imported))
}

/// Puts an imported transfer function into the scene, and its light where the scene has none.
fn take_transfer(file: &mut SceneFile, imported: &Imported, facts: &VolumeFacts) -> anyhow::Result<()> {
    let window = SceneFile { labels: None, ..file.clone() }.resolve(facts).map(|scene| scene.window)?;
    file.transfer = Some(imported.over(window)?);
    file.light = file.light.or(imported.light);
    Ok(())
}

/// The quality level of that name.
pub(crate) fn quality_named(name: &str) -> anyhow::Result<Quality> {
    Quality::by_name(name)
        .with_context(|| format!("no quality '{name}'; there are: {}", Quality::level_names()))
}

/// A quality with some of its numbers changed.
pub(crate) fn tuned(quality: Quality, numbers: &[(String, f64)]) -> anyhow::Result<Quality> {
    numbers.iter().try_fold(quality, |quality, (name, number)| {
        let names = Quality::NUMBERS.join(", ");
        quality
            .with(name, *number)
            .with_context(|| format!("no number '{name}' in a quality; there are: {names}"))
    })
}

/// Reads a scene file.
pub(crate) fn read_scene(path: &Path) -> anyhow::Result<SceneFile> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    SceneFile::from_json(&text).with_context(|| path.display().to_string())
}

/// What the command line says about loading.
pub(crate) fn load_options(chosen: &Chosen) -> LoadOptions {
    let Chosen { series, time, force, kind } = chosen;
    let kind = kind.map(|kind| match kind {
        Kind::Intensity => ChannelKind::Intensity,
        Kind::Label => ChannelKind::Label,
    });
    LoadOptions { series: series.clone(), time: *time, force: *force, kind, ..LoadOptions::default() }
}

/// Loads a volume and shows how far it is.
pub(crate) fn load_volume(path: &Path, mut options: LoadOptions) -> anyhow::Result<Loaded> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    options.progress = Some(Arc::new(move |part| progress(format!("loading {name}: {:.0} %", part * 100.0))));
    let loaded = volume_io::load(path, &options);
    progress_done();
    Ok(loaded?)
}
