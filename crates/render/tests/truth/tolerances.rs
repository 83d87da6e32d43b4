//! How far a picture may be off, and why. No number was found by trying until tests passed: each follows from what it is
//! derived from. Those of `draft` alone are measured, since nothing is asked of it. What a level cannot hold is told by
//! name, here and in `docs/picture.md`.

use reference::Tolerance;

/// A step of an 8-bit channel.
pub(crate) const STEP_OF_8_BITS: f64 = 1.0 / 255.0;

/// Largest error of a channel at the level `exact`: half a step of 8 bits, so that the rounded picture is right or next
/// to it. What the method itself leaves: float32 rounds by 2⁻²⁴ some hundred times along a ray (1e-5); pieces are halved
/// until two rules agree to 1e-5, of which the finer one's own error is a small part; a ray ends at 1e-5 of the light.
pub(crate) const EXACT_COLOR: f64 = 0.5 * STEP_OF_8_BITS;

/// At the level `fine`: root of the mean square, and largest error. A ray ends at 1/2048 of the light, an eighth of a step
/// of 8 bits, and pieces are integrated to as much each; a ray has few pieces that are not far better.
pub(crate) const FINE_RMSE: f64 = 0.5 * STEP_OF_8_BITS;
pub(crate) const FINE_COLOR: f64 = 3.0 * STEP_OF_8_BITS;

/// At the level `balanced`, decibels: a mean square error of 1.4 steps of 8 bits, below what video coding adds.
pub(crate) const BALANCED_DB: f64 = 45.0;

/// At the level `draft`, decibels: what its worst pictures of the suite have, 22.4 and 16.9, rounded down. Measured, not
/// derived: all that is asked of it is that it be known (`docs/accuracy.md`). By what is shown: surfaces and maxima of noise
/// lose what lies between two samples. With a ray for each pixel the worst that is no noise has 24.8: these pictures are of
/// 64 by 36 pixels, and what lies between rays two pixels apart is much of them.
pub(crate) const DRAFT_DB: f64 = 22.0;
pub(crate) const DRAFT_NOISE_DB: f64 = 16.0;

/// Largest error of a depth where opacity is high, in voxels (of the smallest spacing). A headset reprojects by depth: at
/// half a metre, a quarter of a millimetre seen 64 mm beside is 0.2 of the 47 pixels that a degree has.
pub(crate) const DEPTH_VOXELS: f64 = 0.25;
/// Opacity from which on it is high.
pub(crate) const HIGH_OPACITY: f64 = 0.9;

/// Most pixels of a picture, as a part, in which a float32 ray may meet another right answer than the exact ray does. A
/// picture jumps along curves; float32 shifts a ray by up to 2⁻²⁰ of its length (`reference::Uncertainty`), which here is
/// some 1e-3 of a pixel. A picture of 64 x 36 pixels has at most some hundred pixels on such curves, each of which is
/// met so closely with a chance of 1e-3: one pixel is a lot, two are allowed.
pub(crate) const MOST_JUMPS: f64 = 2.0 / (64.0 * 36.0);

/// What a closed form is met to at the level `exact`, in colour and opacity: 1e-5 for the light that a ray ends with, 1e-5 for
/// each of a few pieces, 2⁻²⁴ for each of a hundred roundings.
pub(crate) const CLOSED_FORM: f64 = 5.0e-5;

/// What distances are met to, as a part of the distance from the eye to where a ray leaves the volume: 2⁻²⁰, as
/// `reference::Uncertainty::of_float32` has it.
pub(crate) const DISTANCE: f64 = 1.0 / 1_048_576.0;

/// What is asked of a picture at the level `exact`, with voxels of `voxel_mm`.
pub(crate) fn exact(voxel_mm: f64) -> Tolerance {
    Tolerance { color: EXACT_COLOR, depth_mm: DEPTH_VOXELS * voxel_mm, depth_from_opacity: HIGH_OPACITY }
}

/// The same at the level `fine`.
pub(crate) fn fine(voxel_mm: f64) -> Tolerance {
    Tolerance { color: FINE_COLOR, ..exact(voxel_mm) }
}

/// The same of depths alone, at the level `balanced`, whose colours are held as a whole.
pub(crate) fn balanced(voxel_mm: f64) -> Tolerance {
    Tolerance { color: f64::INFINITY, ..exact(voxel_mm) }
}
