//! The room: one scene that all headsets share.

use crate::seat::locked;
use crate::series::{Series, StepError};
use render::{Gpu, Quality, RenderError, SceneOnDevice, SharedVolume, VolumeOnDevice};
use scene::{FurtherFacts, SceneError, SceneFile, VolumeFacts};
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
    /// The series in time that the first is a step of, if it is. A play goes on to its third step when the first is gone
    /// from the device: whoever else keeps it holds the play up.
    pub series: Option<Series>,
}

impl Volumes {
    /// A room of one volume.
    #[must_use]
    pub fn one(volume: SharedVolume, facts: VolumeFacts) -> Self {
        Self { on_device: vec![volume], facts, others: Vec::new(), series: None }
    }

    /// A scene that is ready to be drawn: what it needs is compiled, unless it is what the scene on view needs too.
    fn make(
        &self,
        gpu: &Arc<Gpu>,
        quality: &Quality,
        file: &SceneFile,
        on_view: Option<&SceneOnDevice>,
    ) -> Result<Arc<SceneOnDevice>, SceneChangeError> {
        if let Some(play) = &file.play {
            play.check_among(self.series.as_ref().map(Series::steps))?;
        }
        let scene = file.resolve_among(&self.facts, &self.others)?;
        let scene = SceneOnDevice::of_several(gpu, &self.on_device, &scene)?;
        // What the ladder may come to needs other pipelines than what was asked for.
        for step_scale in [1.0, 2.0] {
            let quality = quality.coarser(step_scale);
            if !on_view.is_some_and(|on_view| scene.is_drawn_as(on_view, &quality)) {
                scene.prepare(&quality)?;
            }
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
        let mut next = Self { facts: self.facts.with_step(volume), ..self.clone() };
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

/// What is to be played, and its number: another one for each time that a play begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Play {
    pub(crate) number: u32,
    pub(crate) steps_per_sec: f64,
    /// Its first step.
    pub(crate) from: u32,
    /// Whether that was on view already when it was asked for.
    pub(crate) is_on_view: bool,
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
    play: Option<Play>,
    plays: u32,
    /// The step that was on view before the present one.
    former: Option<SharedVolume>,
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
        gpu: &Arc<Gpu>,
        volumes: Volumes,
        quality: Quality,
        file: &SceneFile,
    ) -> Result<Self, SceneChangeError> {
        let scene = volumes.make(gpu, &quality, file, None)?;
        let time_step = volumes.series.as_ref().map_or(0, Series::loaded);
        let mut making = Making { volumes, file: SceneFile::default(), play: None, plays: 0, former: None };
        making.shows(file, time_step);
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

    /// Makes and shows another scene and lets `announce` tell its revision, before any later one; returns it. Takes as long
    /// as its pipeline takes to compile: not to be called where frames are made.
    pub(crate) fn change(&self, json: &str, announce: impl FnOnce(u32)) -> Result<u32, SceneChangeError> {
        let mut making = locked(&self.making);
        let file = SceneFile::from_json(json)?;
        if let Some(volume) = &file.volume {
            return Err(SceneChangeError::Volume(volume.display().to_string()));
        }
        let scene = making.volumes.make(&self.gpu, &self.quality, &file, None)?;
        let former = self.swap(|shown| Shown { scene, revision: shown.revision + 1, ..*shown });
        let revision = former.revision + 1;
        making.shows(&file, former.time_step);
        announce(revision);
        drop(making);
        drop(former);
        Ok(revision)
    }

    /// Shows something else. What was on view is given back, so that nobody who draws waits until it is freed.
    fn swap(&self, next: impl FnOnce(&Shown) -> Shown) -> Shown {
        let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
        let next = next(&shown);
        std::mem::replace(&mut *shown, next)
    }

    /// What is to be played now.
    pub(crate) fn play(&self) -> Option<Play> {
        locked(&self.making).play
    }

    /// Takes the step before the present one off the device, unless a picture of it is still being made. Returns whether it
    /// is gone. Not to be called where frames are made: freeing takes its time.
    pub(crate) fn former_step_is_gone(&self) -> bool {
        let mut making = locked(&self.making);
        // Nobody takes another one: it is in no scene but those that are being drawn.
        let gone = making.former.take_if(|former| Arc::strong_count(former) == 1);
        let is_gone = making.former.is_none();
        drop(making);
        drop(gone);
        is_gone
    }

    /// Brings a step to the device, beside the one on view, and makes its scene.
    ///
    /// # Errors
    /// [`StepError::Full`] while the step before the present one is still there.
    pub(crate) fn prepare_step(
        &self,
        step: u32,
        play: u32,
        volume: &Volume,
    ) -> Result<PreparedStep, StepError> {
        let volumes = {
            let making = locked(&self.making);
            if making.former.is_some() {
                return Err(StepError::Full);
            }
            making.volumes.clone()
        };
        // Scenes are changed meanwhile.
        let volumes = volumes.with_step(&self.gpu, volume)?;
        let making = locked(&self.making);
        let shown = self.shown();
        let scene = volumes.make(&self.gpu, &self.quality, &making.file, Some(&shown.scene))?;
        Ok(PreparedStep { volumes, scene, revision: shown.revision, step, play })
    }

    /// Shows a step in the scene of this moment, unless its play is over. The one that was on view stays on the device until
    /// [`Self::former_step_is_gone`].
    pub(crate) fn show_step(&self, prepared: PreparedStep) -> Result<(), StepError> {
        let PreparedStep { volumes, mut scene, revision, step, play } = prepared;
        let mut making = locked(&self.making);
        if making.play.is_none_or(|now| now.number != play) {
            return Ok(());
        }
        let on_view = self.shown();
        if revision != on_view.revision {
            scene = volumes.make(&self.gpu, &self.quality, &making.file, Some(&on_view.scene))?;
        }
        drop(on_view);
        making.former = making.volumes.on_device.first().cloned();
        making.volumes = volumes;
        let former = self.swap(|shown| Shown { scene, time_step: step, ..*shown });
        drop(making);
        drop(former);
        Ok(())
    }

    /// Stays at the step on view, whatever the scene says, until another scene says otherwise.
    pub(crate) fn stop_playing(&self, play: u32) {
        let mut making = locked(&self.making);
        if making.play.is_some_and(|now| now.number == play) {
            making.play = None;
        }
    }
}

impl Making {
    /// Another scene is on view. A play that it does not change goes on.
    fn shows(&mut self, file: &SceneFile, on_view: u32) {
        let former = std::mem::replace(&mut self.file, file.clone());
        if former.play == file.play && self.play.is_some() {
            return;
        }
        let is_series = self.volumes.series.is_some();
        self.play = file.play.filter(|_| is_series).map(|play| {
            self.plays += 1;
            let from = play.from.unwrap_or(on_view);
            let is_on_view = from == on_view;
            Play { number: self.plays, steps_per_sec: play.steps_per_sec, from, is_on_view }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::DVec3;
    use volume::{Channel, ChannelKind, Grid, Voxels};

    fn step(value: u8) -> Volume {
        let channel = Channel {
            name: "ct".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8(vec![value; 64].into()),
            slope: 1.0,
            intercept: 0.0,
        };
        Volume::new(Grid::axis_aligned([4; 3], DVec3::ONE).unwrap(), vec![channel]).unwrap()
    }

    fn playing() -> Room {
        let gpu = Arc::new(Gpu::open(None).unwrap());
        let first = step(0);
        let series = Series::new(3, 0, Arc::new(|at| Ok(Arc::new(step(at as u8)))));
        let on_device = Arc::new(VolumeOnDevice::upload(&gpu, &first, |_| {}).unwrap());
        let volumes = Volumes { series: Some(series), ..Volumes::one(on_device, VolumeFacts::of(&first)) };
        let file = SceneFile::from_json(r#"{"play": {"steps_per_sec": 5}}"#).unwrap();
        Room::new(&gpu, volumes, Quality::BALANCED, &file).unwrap()
    }

    #[test]
    fn a_third_step_comes_to_the_device_when_no_picture_of_the_first_is_made_any_more() {
        let room = playing();
        let play = room.play().unwrap().number;
        let being_drawn = room.shown();
        assert!(room.former_step_is_gone());
        room.show_step(room.prepare_step(1, play, &step(1)).unwrap()).unwrap();
        assert_eq!(room.shown().time_step, 1);
        assert!(!room.former_step_is_gone());
        assert!(matches!(room.prepare_step(2, play, &step(2)), Err(StepError::Full)));
        drop(being_drawn);
        assert!(room.former_step_is_gone());
        room.show_step(room.prepare_step(2, play, &step(2)).unwrap()).unwrap();
        assert_eq!(room.shown().time_step, 2);
    }

    #[test]
    fn a_step_that_was_made_for_a_play_that_is_over_is_not_shown() {
        let room = playing();
        let play = room.play().unwrap().number;
        let prepared = room.prepare_step(1, play, &step(1)).unwrap();
        room.change("{}", |_| {}).unwrap();
        assert_eq!(room.play(), None);
        room.show_step(prepared).unwrap();
        assert_eq!((room.shown().time_step, room.shown().revision), (0, 1));
    }

    #[test]
    fn a_step_is_shown_in_the_scene_of_this_moment_and_a_scene_that_plays_alike_goes_on() {
        let room = playing();
        let play = room.play().unwrap();
        let prepared = room.prepare_step(1, play.number, &step(1)).unwrap();
        room.change(r#"{"mode": "maximum", "play": {"steps_per_sec": 5}}"#, |_| {}).unwrap();
        assert_eq!(room.play(), Some(play));
        room.show_step(prepared).unwrap();
        let shown = room.shown();
        assert_eq!((shown.time_step, shown.revision), (1, 1));
        assert_eq!(shown.scene.scene().mode, scene::Mode::Maximum);
    }
}
