//! A scene and its volume, from the command line's two paths.

use crate::cli::Chosen;
use crate::terminal::{progress, progress_done, tell};
use ::render::Quality;
use anyhow::{Context as _, bail};
use scene::{Scene, SceneFile, VolumeFacts};
use std::path::{Path, PathBuf};
use std::sync::Arc;
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
    ) -> anyhow::Result<Self> {
        let file = match scene_path {
            Some(path) => read_scene(path)?,
            None => SceneFile::default(),
        };
        let volume_path = match (volume_path, &file.volume, scene_path) {
            (Some(path), _, _) => path.to_owned(),
            (None, Some(relative), Some(scene)) => scene.parent().unwrap_or(Path::new(".")).join(relative),
            _ => bail!("no volume: name one with --volume PATH, or in the scene"),
        };
        let loaded = load_volume(&volume_path, load_options(chosen))?;
        for note in &loaded.report.notes {
            tell(format!("note: {note}"));
        }
        let facts = VolumeFacts::of(&loaded.volume);
        let scene = file.resolve(&facts).with_context(|| match scene_path {
            Some(path) => path.display().to_string(),
            None => "the default scene".to_owned(),
        })?;
        Ok(Self { file, scene, facts, volume_path, loaded })
    }
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
    let Chosen { series, time, force } = chosen;
    LoadOptions { series: series.clone(), time: *time, force: *force, ..LoadOptions::default() }
}

/// Loads a volume and shows how far it is.
pub(crate) fn load_volume(path: &Path, mut options: LoadOptions) -> anyhow::Result<Loaded> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    options.progress = Some(Arc::new(move |part| progress(format!("loading {name}: {:.0} %", part * 100.0))));
    let loaded = volume_io::load(path, &options);
    progress_done();
    Ok(loaded?)
}
