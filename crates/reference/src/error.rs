//! Why there is no exact picture.

/// Why there is no exact picture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReferenceError {
    /// The scene shows a channel that the volume lacks.
    #[error("the scene shows channel {wanted}, the volume has {found}")]
    NoSuchChannel {
        /// The channel's number, counted from 0.
        wanted: usize,
        /// Channels there are.
        found: usize,
    },
    /// The scene shows a volume that is not there.
    #[error("the scene shows volume {wanted}, there are {found}")]
    NoSuchVolume {
        /// The volume's number, counted from 0.
        wanted: usize,
        /// Volumes there are.
        found: usize,
    },
    /// A further volume's registration takes its grid out of what a grid may be.
    #[error("a further volume in register with the first: {0}")]
    Grid(#[from] volume::GridError),
    /// Samples are NaN or infinite; a loader replaces them.
    #[error("channel '{channel}' has {count} samples that are not finite: replace them first")]
    NotFinite {
        /// The channel's name.
        channel: String,
        /// How many.
        count: usize,
    },
    /// The scene takes measured values for labels, or labels for measured values.
    #[error(
        "the scene was resolved for another volume: channel '{channel}' is not of the kind that it shows"
    )]
    Kind {
        /// The channel's name.
        channel: String,
    },
    /// A picture without pixels.
    #[error("a picture of {width} by {height} pixels has none")]
    Empty {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// Eye, target and up do not span a picture.
    #[error("the camera's eye, target and up do not span a picture")]
    Camera,
    /// The eye or the placement has a number that is not finite, or rays have no direction in the volume.
    #[error("the eye and the placement give a ray from {origin:?} along {direction:?} (voxels): not a ray")]
    Ray {
        /// Its origin, voxel index.
        origin: [f64; 3],
        /// Its direction, voxels a millimetre.
        direction: [f64; 3],
    },
    /// The field of view is none.
    #[error(transparent)]
    Fov(#[from] spatial::FovError),
    /// Two pictures that are to be compared, or to stand side by side, differ in size.
    #[error("pictures of {}x{} and {}x{} pixels: expected two of one size", first.0, first.1, second.0, second.1)]
    Sizes {
        /// Width and height of the first.
        first: (u32, u32),
        /// Width and height of the second.
        second: (u32, u32),
    },
    /// A buffer does not hold the picture it is said to.
    #[error("{found} {what}, a picture of {width} by {height} has {expected}")]
    Length {
        /// What was counted.
        what: &'static str,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// How many there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
}
