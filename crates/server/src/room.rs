//! The room: one scene that all headsets share.

use render::{Gpu, Quality, RenderError, SceneOnDevice, SharedVolume};
use scene::{SceneError, SceneFile, VolumeFacts};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// Why a scene is not shown.
#[derive(Debug, thiserror::Error)]
pub enum SceneChangeError {
    /// The scene is not valid for this volume.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It names a volume; the room's volume stays.
    #[error("the scene names the volume '{0}'; a room keeps its volume, leave the field out")]
    Volume(String),
    /// The device has no room for it.
    #[error(transparent)]
    Device(#[from] RenderError),
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
    volume: SharedVolume,
    facts: VolumeFacts,
    quality: Quality,
    shown: RwLock<Shown>,
    /// Held while a scene is made, so that revisions follow the order of requests.
    making: Mutex<()>,
}

impl Room {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        volume: &SharedVolume,
        facts: VolumeFacts,
        quality: Quality,
        file: &SceneFile,
    ) -> Result<Self, SceneChangeError> {
        let scene = make(gpu, volume, &facts, &quality, file)?;
        Ok(Self {
            gpu: gpu.clone(),
            volume: volume.clone(),
            facts,
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
        let scene = make(&self.gpu, &self.volume, &self.facts, &self.quality, &file)?;
        let revision = {
            let mut shown = self.shown.write().unwrap_or_else(PoisonError::into_inner);
            *shown = Shown { scene, revision: shown.revision + 1 };
            shown.revision
        };
        announce(revision);
        Ok(revision)
    }
}

fn make(
    gpu: &Arc<Gpu>,
    volume: &SharedVolume,
    facts: &VolumeFacts,
    quality: &Quality,
    file: &SceneFile,
) -> Result<Arc<SceneOnDevice>, SceneChangeError> {
    let scene = SceneOnDevice::new(gpu, volume, &file.resolve(facts)?)?;
    // What the ladder may come to needs other pipelines than what was asked for.
    for step_scale in [1.0, 2.0] {
        scene.prepare(&quality.coarser(step_scale))?;
    }
    Ok(Arc::new(scene))
}
