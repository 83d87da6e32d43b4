//! What was found of one setting and one subject.

use crate::{Curve, Errors, Spread};

/// What was found of one setting and one subject.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Row {
    /// The subject's name.
    pub scene: String,
    /// Mode, and whether it is lit.
    pub kind: String,
    /// What it depends on, see [`crate::Subject::key`].
    pub key: String,
    /// Pixels across and down.
    pub size_px: [u32; 2],
    /// The curve that the setting belongs to.
    pub curve: Curve,
    /// The setting's name.
    pub setting: String,
    /// Distance of samples over the smallest voxel spacing; without meaning for `cells`.
    pub step_voxels: f64,
    /// The same, millimetres.
    pub step_mm: f64,
    /// `hardware`, `float32` or `cells`.
    pub sampling: String,
    /// Light left when a ray ends.
    pub least_transmittance: f64,
    /// Rays along a side over pixels along it.
    pub resolution_scale: f64,
    /// Whether empty space was skipped.
    pub skip_empty: bool,
    /// Frames that were timed.
    pub frames: usize,
    /// Submitted, drawn, converted to YUV and read back: milliseconds.
    pub frame_ms: Spread,
    /// Casting the rays by the device's clock, milliseconds; none if it has no clock.
    pub raycast_ms: Option<Spread>,
    /// How far the picture is from the exact one.
    pub errors: Errors,
}
