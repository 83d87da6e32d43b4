//! A scene and its volumes, from the command line's two paths.

use crate::cli::{Chosen, Kind, Look};
use crate::terminal::{progress, progress_done, tell};
use ::render::Quality;
use anyhow::{Context as _, bail};
use colour_io::Imported;
use scene::{Further, FurtherFacts, Preset, Scene, SceneFile, VolumeFacts, VolumeSource};
use spatial::DAffine3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use volume::{ChannelKind, LabelTable, Volume};
use volume_io::{LoadOptions, Loaded};

/// A scene file with the volume that it shows.
pub(crate) struct Shown {
    pub(crate) file: SceneFile,
    pub(crate) scene: Scene,
    pub(crate) facts: VolumeFacts,
    pub(crate) volume_path: PathBuf,
    pub(crate) loaded: Loaded,
    /// The volumes beside it, in the order in which the scene counts them.
    pub(crate) others: Vec<Loaded>,
    pub(crate) others_facts: Vec<FurtherFacts>,
}

impl Shown {
    /// Reads the scene (or takes the default one) and loads the volume named on the command line or in the scene, and
    /// those beside it that are shown.
    pub(crate) fn load(
        scene_path: Option<&Path>,
        volume_path: Option<&Path>,
        chosen: &Chosen,
        look: &Look,
    ) -> anyhow::Result<Self> {
        Self::load_with(scene_path, volume_path, chosen, look, true)
    }

    /// The same with hidden volumes too, for a scene that may change.
    pub(crate) fn load_all(
        scene_path: Option<&Path>,
        volume_path: Option<&Path>,
        chosen: &Chosen,
        look: &Look,
    ) -> anyhow::Result<Self> {
        Self::load_with(scene_path, volume_path, chosen, look, false)
    }

    fn load_with(
        scene_path: Option<&Path>,
        volume_path: Option<&Path>,
        chosen: &Chosen,
        look: &Look,
        shown_only: bool,
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
        let further_labels = further_labels(&mut file, shown_only, &beside_scene)?;
        let labels_of = |source: Option<&VolumeSource>| {
            let of_it = further_labels.iter().filter(|(of, _)| of.as_ref() == source);
            of_it.fold(LabelTable::default(), |all, (_, table)| all.with(table))
        };
        let facts = facts_of(&loaded, &labels_of(None).with(&labels), look.modality.as_deref());
        if let Some(imported) = imported {
            take_transfer(&mut file, &imported, &facts)?;
        }
        let (mut others, mut others_facts) = (Vec::new(), Vec::new());
        for source in file.further_sources(shown_only) {
            // What the command line says of series, time and kind it says of the first.
            let options = LoadOptions {
                series: source.series.clone(),
                force: chosen.force,
                kind: source.kind.map(ChannelKind::from),
                ..LoadOptions::default()
            };
            let loaded = load_volume(&beside_scene(&source.path), options)?;
            for note in &loaded.report.notes {
                tell(format!("note: {source}: {note}"));
            }
            others_facts
                .push(FurtherFacts { facts: facts_of(&loaded, &LabelTable::default(), None), source });
            others.push(loaded);
        }
        let scene = file.resolve_among(&facts, &others_facts).with_context(|| match scene_path {
            Some(path) => path.display().to_string(),
            None => "the default scene".to_owned(),
        })?;
        Ok(Self { file, scene, facts, volume_path, loaded, others, others_facts })
    }

    /// Refuses a scene that shows more than its first volume, for what measures scenes of one.
    pub(crate) fn check_alone(&self, what: &str) -> anyhow::Result<()> {
        if !self.scene.further.is_empty() {
            let found = self.scene.further.len() + 1;
            bail!("the scene has {found} volumes to show, {what} measures scenes of one");
        }
        Ok(())
    }

    /// The volumes beside the first.
    pub(crate) fn others(&self) -> Vec<&Volume> {
        self.others.iter().map(|loaded| &loaded.volume).collect()
    }

    /// All volumes, the first first.
    pub(crate) fn volumes(&self) -> Vec<&Volume> {
        std::iter::once(&self.loaded.volume).chain(self.others()).collect()
    }

    /// What each further volume that is shown is, in register with the first.
    pub(crate) fn in_register(&self) -> anyhow::Result<Vec<InRegister>> {
        let first = self.loaded.volume.grid();
        let volumes = self.volumes();
        let one = |further: &Further| {
            let volume = volumes.get(further.volume).context("a volume that is there")?;
            let grid = further.grid(volume.grid())?;
            Ok(InRegister {
                name: further.name.clone(),
                dims: grid.dims(),
                spacing_mm: grid.spacing_mm().to_array(),
                orientation: grid.orientation().0,
                is_moved: further.first_from_own != DAffine3::IDENTITY,
                share_within_first: further.share_within(first, volume.grid())?,
            })
        };
        self.scene.further.iter().map(one).collect()
    }

    /// Says what is shown together with what; nothing for one volume.
    pub(crate) fn tell_register(&self) -> anyhow::Result<()> {
        for further in self.in_register()? {
            tell(format!("with      {further}"));
            if further.share_within_first == 0.0 {
                tell(format!(
                    "note: {} and the first volume do not meet: are they of one patient and one visit?",
                    further.name
                ));
            }
        }
        Ok(())
    }
}

/// A further volume as it is shown: on its own grid, whatever the first volume's is.
#[derive(Debug, serde::Serialize)]
pub(crate) struct InRegister {
    name: String,
    dims: [u32; 3],
    spacing_mm: [f64; 3],
    orientation: String,
    /// Whether the scene gives it a registration.
    is_moved: bool,
    share_within_first: f64,
}

impl std::fmt::Display for InRegister {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([nx, ny, nz], [sx, sy, sz]) = (self.dims, self.spacing_mm);
        let place = if self.is_moved { "by the scene's registration" } else { "by patient coordinates" };
        write!(
            f,
            "{}: {nx}x{ny}x{nz} voxels of {sx:.3}x{sy:.3}x{sz:.3} mm, {}, not resampled; in register {place}, {:.0} % of it \
             within the first volume",
            self.name,
            self.orientation,
            self.share_within_first * 100.0
        )
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

/// The labels of files that further volumes name, by the file that those are read from; `None` for the first volume's.
fn further_labels(
    file: &mut SceneFile,
    shown_only: bool,
    beside_scene: &dyn Fn(&Path) -> PathBuf,
) -> anyhow::Result<Vec<(Option<VolumeSource>, LabelTable)>> {
    let mut found = Vec::new();
    for further in file.further_volumes.iter_mut().filter(|further| further.shown || !shown_only) {
        if let Some(path) = further.labels.as_mut().and_then(|labels| labels.file.take()) {
            found.push((further.source(), colour_io::load_labels(&beside_scene(&path))?));
        }
    }
    Ok(found)
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
    let window = SceneFile { labels: None, further_volumes: Vec::new(), ..file.clone() }
        .resolve(facts)
        .map(|scene| scene.window)?;
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
