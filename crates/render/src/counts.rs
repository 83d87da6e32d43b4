//! What a picture takes, counted on the device.

use crate::Still;

/// What the rays of a picture looked at. Counted by the shaders themselves, each where it looks: by pipelines of their
/// own, so that those which make pictures are as they would be without.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rays that were cast, all of them in tiles that may see something: one a pixel, or fewer where pixels between rays
    /// are interpolated.
    pub rays: u64,
    /// Values looked at along the rays, those of crossings that are refined among them. With [`crate::Sampling::Cells`],
    /// voxel cells whose eight corners were read; of labels, voxels.
    pub samples: u64,
    /// Those of them that changed the pixel: matter that was not transparent, in an X-ray each, a new maximum, the place
    /// where a surface is met.
    pub contributed: u64,
    /// Gradients for light, six values each (with cells: one for each cell that may hold matter). Not among `samples`.
    pub gradients: u64,
}

impl Counts {
    /// Of a picture that a counting pipeline stored.
    pub(crate) fn of(still: &Still) -> Self {
        // Whole numbers below 2^24, which float32 holds: the most samples of a ray are fewer.
        still.rgba.iter().filter(|p| p[3] > 0.0).fold(Self::default(), |sum, p| Self {
            rays: sum.rays + 1,
            samples: sum.samples + p[0] as u64,
            contributed: sum.contributed + p[1] as u64,
            gradients: sum.gradients + p[2] as u64,
        })
    }
}
