//! Decoded pictures against the exact ones.

use crate::Distribution;
use serde::{Deserialize, Serialize};

/// Pictures of one headset that were held against the exact ones when the run was over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Verification {
    /// Each of them.
    pub frames: Vec<VerifiedFrame>,
    /// Pictures that were chosen and left out, because they show another scene than the one at the beginning.
    pub skipped: u64,
}

/// One picture that was held against the exact ones.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VerifiedFrame {
    /// The frame's number in its session.
    pub frame: u64,
    /// Which volume of a series in time it shows, and was held against; counted from 0.
    #[serde(default)]
    pub time_step: u32,
    /// Against the exact picture of the view that it was made for: what renderer and codec did to it.
    pub at_rendered_pose: PictureError,
    /// Against the exact picture of where the eyes were when it was shown, without reprojection.
    pub at_display_pose: PictureError,
    /// By how many pixels it is shifted against the former; `None` where the pictures do not tell.
    pub offset_px: Option<f64>,
    /// By how many pixels it is shifted against the latter.
    pub display_offset_px: Option<f64>,
}

/// How far a picture is from another: both eyes, red, green and blue, from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// Peak signal to noise ratio, decibels; `None` where the pictures are equal.
    pub psnr_db: Option<f64>,
    /// Root of the mean square difference.
    pub rmse: f64,
    /// The largest difference.
    pub max_error: f64,
}

/// What verification found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VerificationReport {
    /// Peak signal to noise ratios against the exact pictures of the views that were rendered.
    pub rendered_psnr_db: Option<Distribution>,
    /// The same against those of the views at display time.
    pub display_psnr_db: Option<Distribution>,
    /// Shifts against the exact pictures of the views that were rendered, in pixels.
    pub rendered_offset_px: Option<Distribution>,
    /// The same against those of the views at display time.
    pub shown_offset_px: Option<Distribution>,
    /// Pictures that were chosen and left out, because they show another scene than the one at the beginning.
    pub skipped: u64,
    /// Each picture.
    pub frames: Vec<VerifiedFrame>,
}

impl VerificationReport {
    pub(crate) fn of(verification: &Verification) -> Self {
        let of = |value: fn(&VerifiedFrame) -> Option<f64>| {
            Distribution::of(verification.frames.iter().filter_map(value))
        };
        Self {
            rendered_psnr_db: of(|frame| frame.at_rendered_pose.psnr_db),
            display_psnr_db: of(|frame| frame.at_display_pose.psnr_db),
            rendered_offset_px: of(|frame| frame.offset_px),
            shown_offset_px: of(|frame| frame.display_offset_px),
            skipped: verification.skipped,
            frames: verification.frames.clone(),
        }
    }
}
