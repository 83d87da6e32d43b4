//! The room: one scene that all headsets share.

use render::{Gpu, Quality, RenderError, SceneOnDevice, SharedVolume};
use scene::{FurtherFacts, SceneError, SceneFile, VolumeFacts};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

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
}

impl Volumes {
    /// A room of one volume.
    #[must_use]
    pub fn one(volume: SharedVolume, facts: VolumeFacts) -> Self {
        Self { on_device: vec![volume], facts, others: Vec::new() }
    }

    fn make(
        &self,
        gpu: &Arc<Gpu>,
        quality: &Quality,
        file: &SceneFile,
    ) -> Result<Arc<SceneOnDevice>, SceneChangeError> {
        let scene = file.resolve_among(&self.facts, &self.others)?;
        let scene = SceneOnDevice::of_several(gpu, &self.on_device, &scene)?;
        // What the ladder may come to needs other pipelines than what was asked for.
        for step_scale in [1.0, 2.0] {
            scene.prepare(&quality.coarser(step_scale))?;
        }
        Ok(Arc::new(scene))
    }
}

/// A scene and its number.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) scene: Arc<SceneOnDevice>,
    pub(crate) revision: u32,
}

/// One scene, changed as a whole: who draws takes the present one and is not held up while the next is made.
#[derive(Debug)]
pub(crate) struct Room {
    gpu: Arc<Gpu>,
    volumes: Volumes,
    quality: Quality,
    shown: RwLock<Shown>,
    /// Held while a scene is made, so that revisions follow the order of requests.
    making: Mutex<()>,
}

impl Room {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        volumes: Volumes,
        quality: Quality,
        file: &SceneFile,
    ) -> Result<Self, SceneChangeError> {
        let scene = volumes.make(gpu, &quality, file)?;
        Ok(Self {
            gpu: gpu.clone(),
            volumes,
            quality,
            shown: RwLock::new(Shown { scene, revision: 0 }),
            making: Mutex::new(()),
        })
    }

    /// The present scene.
    pub(crate) fn shown(&self) -> Shown {
        // A scene is swapped whole, so a panic elsewhere leaves a good one.
        self.shown.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Makes and shows another scene and lets `announce` tell its revision, before any later one; returns it. Takes as long as its pipeline takes to compile: not to be
    /// called where frames are made.
    pub(crate) fn change(&self, json: &str, announce: impl FnOnce(u32)) -> Result<u32, SceneChangeError> {
        let _in_order = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        let file = SceneFile::from_json(json)?;
        if let Some(volume) = &file.volume {
            return Err(SceneChangeError::Volume(volume.display().to_string()));
        }
        let scene = self.volumes.make(&self.gpu, &self.quality, &file)?;
        let revision = {
            let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
            *shown = Shown { scene, revision: shown.revision + 1 };
            shown.revision
        };
        announce(revision);
        Ok(revision)
    }
}
