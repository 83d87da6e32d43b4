//! The steps of a series in time.

use crate::room::SceneChangeError;
use render::RenderError;
use std::error::Error;
use std::fmt;
use std::sync::Arc;
use volume::Volume;

/// Gives a step of a series, counted from 0.
pub type LoadStep = dyn Fn(u32) -> Result<Arc<Volume>, Box<dyn Error + Send + Sync>> + Send + Sync;

/// The series in time that a volume is a step of. Where its steps come from, who starts the server knows.
#[derive(Clone)]
pub struct Series {
    steps: u32,
    loaded: u32,
    load: Arc<LoadStep>,
}

impl Series {
    /// A series of so many `steps`, of which `loaded` is on the device; `load` gives the others. It is called on a thread of
    /// its own, one step at a time, and may take its time: the play leaves out what comes too late.
    #[must_use]
    pub fn new(steps: u32, loaded: u32, load: Arc<LoadStep>) -> Self {
        Self { steps, loaded, load }
    }

    /// How many there are.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Which of them the room began with.
    #[must_use]
    pub fn loaded(&self) -> u32 {
        self.loaded
    }

    pub(crate) fn load(&self, step: u32) -> Result<Arc<Volume>, StepError> {
        (self.load)(step).map_err(StepError::Load)
    }
}

impl fmt::Debug for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Series")
            .field("steps", &self.steps)
            .field("loaded", &self.loaded)
            .finish_non_exhaustive()
    }
}

/// Why a step is not shown.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StepError {
    #[error("{0}")]
    Load(Box<dyn Error + Send + Sync>),
    #[error("two steps are on the device already")]
    Full,
    #[error("it has {found:?} voxels, expected {expected:?} as the first has")]
    Dims { found: [u32; 3], expected: [u32; 3] },
    #[error(transparent)]
    Device(#[from] RenderError),
    #[error(transparent)]
    Scene(#[from] SceneChangeError),
}
