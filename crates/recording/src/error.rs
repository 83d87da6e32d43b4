//! What can go wrong with a recording.

use std::path::PathBuf;
use std::time::Duration;

/// Why a recording could not be made, continued or finished.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file system refused.
    #[error("cannot {action} {}", path.display())]
    File {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The first access unit is no key frame: nothing could be shown of it.
    #[error("recording begins with an access unit that is no key frame")]
    NoKeyFrame,
    /// A key frame's parameter sets are missing or refused.
    #[error(transparent)]
    ParameterSets(#[from] codec::ParameterSetError),
    /// The access unit holds no slice of a picture.
    #[error("access unit of {bytes} bytes holds no slice of a picture")]
    NoSlice {
        /// Its length.
        bytes: usize,
    },
    /// The access unit is too long for its length field.
    #[error("access unit of {bytes} bytes, at most {} can be recorded", u32::MAX)]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// The picture is not shown later than the one before.
    #[error("picture shown at {found:?} follows one shown at {previous:?}, expected a later time")]
    NotLater {
        /// When the one before was shown.
        previous: Duration,
        /// When this one is.
        found: Duration,
    },
    /// More than thirteen hours lie between two pictures.
    #[error(
        "picture shown at {found:?} follows one shown at {previous:?}, expected less than 13 hours between them"
    )]
    TooLate {
        /// When the one before was shown.
        previous: Duration,
        /// When this one is.
        found: Duration,
    },
    /// An earlier write failed.
    #[error("recording {} was given up when it could not be written", path.display())]
    GivenUp {
        /// The file that is not going to be.
        path: PathBuf,
    },
    /// There is nothing to finish.
    #[error("recording holds no picture")]
    Empty,
    /// The file's index could not be written down.
    #[error("cannot describe the recording {}", path.display())]
    Index {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: mp4_atom::Error,
    },
}
