//! The room: one scene that all headsets share.

use crate::playback::Playback;
use crate::seat::locked;
use crate::series::{Series, StepError};
use render::{Gpu, Quality, RenderError, SceneOnDevice, SharedVolume, VolumeOnDevice};
use scene::{FurtherFacts, SceneError, SceneFile, VolumeFacts};
use session::ServerTime;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use volume::Volume;

/// Why a scene is not shown.
#[derive(Debug, thiserror::Error)]
pub enum SceneChangeError {
    /// The scene is not valid for this volume.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It names a first volume; the room's volumes stay.
    #[error("the scene names the volume '{0}'; a room keeps its first volume, leave the field out")]
    Volume(String),
    /// The device has no room for it.
    #[error(transparent)]
    Device(#[from] RenderError),
}

/// The volumes that a room has for as long as it is there. Scenes choose among them; no other file is opened for one.
#[derive(Clone, Debug)]
pub struct Volumes {
    /// All of them on the device, the first first.
    pub on_device: Vec<SharedVolume>,
    /// What is in the first.
    pub facts: VolumeFacts,
    /// What is in the others, and what scenes call them.
    pub others: Vec<FurtherFacts>,
    /// The series in time that the first is a step of, if it is.
    pub series: Option<Series>,
}

impl Volumes {
    /// A room of one volume.
    #[must_use]
    pub fn one(volume: SharedVolume, facts: VolumeFacts) -> Self {
        Self { on_device: vec![volume], facts, others: Vec::new(), series: None }
    }

    fn make(
        &self,
        gpu: &Arc<Gpu>,
        quality: &Quality,
        file: &SceneFile,
    ) -> Result<Arc<SceneOnDevice>, SceneChangeError> {
        if let Some(play) = &file.play {
            play.check_among(self.series.as_ref().map(Series::steps))?;
        }
        let scene = file.resolve_among(&self.facts, &self.others)?;
        let scene = SceneOnDevice::of_several(gpu, &self.on_device, &scene)?;
        // What the ladder may come to needs other pipelines than what was asked for.
        for step_scale in [1.0, 2.0] {
            scene.prepare(&quality.coarser(step_scale))?;
        }
        Ok(Arc::new(scene))
    }

    /// The same with another step of the series for the first volume.
    fn with_step(&self, gpu: &Gpu, volume: &Volume) -> Result<Self, StepError> {
        let first = self.on_device.first().map(|first| first.grid().dims());
        let found = volume.grid().dims();
        if first != Some(found) {
            return Err(StepError::Dims { found, expected: first.unwrap_or_default() });
        }
        let mut next = Self { facts: self.facts.of_step(volume), ..self.clone() };
        next.on_device[0] = Arc::new(VolumeOnDevice::upload(gpu, volume, |_| {})?);
        Ok(next)
    }
}

/// A scene and its number.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) scene: Arc<SceneOnDevice>,
    pub(crate) revision: u32,
    /// Which step of the first volume's series, from 0.
    pub(crate) time_step: u32,
}

/// What is played, and its number: another one for each time that a play begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Played {
    pub(crate) playback: Playback,
    pub(crate) number: u32,
    /// The step that was on view when it began.
    pub(crate) on_view: u32,
}

/// A step that is ready to be shown, with the scene that it was made for.
pub(crate) struct PreparedStep {
    volumes: Volumes,
    scene: Arc<SceneOnDevice>,
    revision: u32,
    step: u32,
    play: u32,
}

/// What scenes are made of. Held while one is made, so that revisions follow the order of requests.
#[derive(Debug)]
struct Making {
    volumes: Volumes,
    file: SceneFile,
    play: Option<Played>,
    plays: u32,
}

/// One scene, changed as a whole: who draws takes the present one and is not held up while the next is made.
#[derive(Debug)]
pub(crate) struct Room {
    gpu: Arc<Gpu>,
    quality: Quality,
    shown: RwLock<Shown>,
    making: Mutex<Making>,
}

impl Room {
    pub(crate) fn new(
        now: ServerTime,
        gpu: &Arc<Gpu>,
        volumes: Volumes,
        quality: Quality,
        file: &SceneFile,
    ) -> Result<Self, SceneChangeError> {
        let scene = volumes.make(gpu, &quality, file)?;
        let time_step = volumes.series.as_ref().map_or(0, Series::loaded);
        let mut making = Making { volumes, file: SceneFile::default(), play: None, plays: 0 };
        making.shows(now, file, time_step);
        Ok(Self {
            gpu: gpu.clone(),
            quality,
            shown: RwLock::new(Shown { scene, revision: 0, time_step }),
            making: Mutex::new(making),
        })
    }

    /// The present scene.
    pub(crate) fn shown(&self) -> Shown {
        // A scene is swapped whole, so a panic elsewhere leaves a good one.
        self.shown.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Makes and shows another scene and lets `announce` tell its revision, before any later one; returns it. Takes as long as its pipeline takes to compile: not to be
    /// called where frames are made.
    pub(crate) fn change(
        &self,
        now: ServerTime,
        json: &str,
        announce: impl FnOnce(u32),
    ) -> Result<u32, SceneChangeError> {
        let mut making = locked(&self.making);
        let file = SceneFile::from_json(json)?;
        if let Some(volume) = &file.volume {
            return Err(SceneChangeError::Volume(volume.display().to_string()));
        }
        let scene = making.volumes.make(&self.gpu, &self.quality, &file)?;
        let (revision, time_step) = {
            let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
            *shown = Shown { scene, revision: shown.revision + 1, ..*shown };
            (shown.revision, shown.time_step)
        };
        making.shows(now, &file, time_step);
        announce(revision);
        Ok(revision)
    }

    /// What is played now.
    pub(crate) fn played(&self) -> Option<Played> {
        locked(&self.making).play
    }

    /// Brings a step to the device, beside the one on view, and makes its scene.
    pub(crate) fn prepare_step(
        &self,
        step: u32,
        play: u32,
        volume: &Volume,
    ) -> Result<PreparedStep, StepError> {
        let volumes = locked(&self.making).volumes.clone();
        let volumes = volumes.with_step(&self.gpu, volume)?;
        let making = locked(&self.making);
        let scene = volumes.make(&self.gpu, &self.quality, &making.file)?;
        Ok(PreparedStep { volumes, scene, revision: self.shown().revision, step, play })
    }

    /// Shows a step in the scene of this moment, unless its play is over. Gives back the volume that was on view, which is
    /// gone from the device when the last picture of it is made.
    pub(crate) fn show_step(&self, prepared: PreparedStep) -> Result<Option<SharedVolume>, StepError> {
        let PreparedStep { volumes, mut scene, revision, step, play } = prepared;
        let mut making = locked(&self.making);
        if making.play.is_none_or(|played| played.number != play) {
            return Ok(None);
        }
        if revision != self.shown().revision {
            scene = volumes.make(&self.gpu, &self.quality, &making.file)?;
        }
        let former = std::mem::replace(&mut making.volumes, volumes);
        let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
        *shown = Shown { scene, time_step: step, ..*shown };
        Ok(former.on_device.into_iter().next())
    }

    /// Stays at the step on view, whatever the scene says, until another scene says otherwise.
    pub(crate) fn stop_playing(&self, play: u32) {
        let mut making = locked(&self.making);
        if making.play.is_some_and(|played| played.number == play) {
            making.play = None;
        }
    }
}

impl Making {
    /// Another scene is on view. A play that it does not change goes on.
    fn shows(&mut self, now: ServerTime, file: &SceneFile, on_view: u32) {
        let former = std::mem::replace(&mut self.file, file.clone());
        if former.play == file.play && self.play.is_some() {
            return;
        }
        let steps = self.volumes.series.as_ref().map(Series::steps);
        self.play = file.play.zip(steps).map(|(play, steps)| {
            self.plays += 1;
            let from = play.from.unwrap_or(on_view);
            let playback = Playback::begin(now, play.steps_per_sec, from, steps);
            Played { playback, number: self.plays, on_view }
        });
    }
}
