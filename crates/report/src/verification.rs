//! Decoded pictures against the exact ones.

use crate::Distribution;
use crate::registration::{AGES_MS, SPEEDS_DEG_PER_SEC};
use serde::{Deserialize, Serialize};

/// Pictures of one headset that were held against the exact ones when the run was over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Verification {
    /// Each of them.
    pub frames: Vec<VerifiedFrame>,
    /// Pictures that were chosen and left out, because they show another scene than the one at the beginning, or a step
    /// that could not be had.
    pub skipped: u64,
    /// Why pictures of the scene at the beginning were left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
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
    /// From its pose to when it was shown, in milliseconds.
    pub age_ms: Option<f64>,
    /// How fast the head turned meanwhile, in degrees a second; `None` if not known.
    pub head_deg_per_sec: Option<f64>,
    /// How far points of the hologram seemed to be from where they are when it was shown, in pixels, as computed from the
    /// two views; `None` if none was seen or that is not known.
    pub registration_px: Option<f64>,
    /// The same in degrees.
    pub registration_deg: Option<f64>,
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
    /// By the age of the pose when the picture was shown, in milliseconds; classes without a picture are left out.
    pub by_age_ms: Vec<VerifiedClass>,
    /// By how fast the head turned, in degrees a second; classes without a picture are left out.
    pub by_speed_deg_per_sec: Vec<VerifiedClass>,
    /// Pictures that were chosen and left out, because they show another scene than the one at the beginning, or a step
    /// that could not be had.
    pub skipped: u64,
    /// Why pictures of the scene at the beginning were left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Each picture.
    pub frames: Vec<VerifiedFrame>,
}

/// The pictures of one class.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VerifiedClass {
    /// The class begins here.
    pub from: f64,
    /// It ends before this; `None` for the last one, which has no end.
    pub below: Option<f64>,
    /// How many there are.
    pub pictures: u64,
    /// As [`VerificationReport`] has them of all pictures.
    pub rendered_psnr_db: Option<Distribution>,
    /// The same.
    pub display_psnr_db: Option<Distribution>,
    /// The same.
    pub shown_offset_px: Option<Distribution>,
    /// Displacement of points, in pixels.
    pub registration_px: Option<Distribution>,
    /// The same in degrees.
    pub registration_deg: Option<Distribution>,
}

impl VerificationReport {
    pub(crate) fn of(verification: &Verification) -> Self {
        let frames: Vec<&VerifiedFrame> = verification.frames.iter().collect();
        let of = |value: fn(&VerifiedFrame) -> Option<f64>| distribution(&frames, value);
        Self {
            rendered_psnr_db: of(|frame| frame.at_rendered_pose.psnr_db),
            display_psnr_db: of(|frame| frame.at_display_pose.psnr_db),
            rendered_offset_px: of(|frame| frame.offset_px),
            shown_offset_px: of(|frame| frame.display_offset_px),
            by_age_ms: classes(&frames, &AGES_MS, |frame| frame.age_ms),
            by_speed_deg_per_sec: classes(&frames, &SPEEDS_DEG_PER_SEC, |frame| frame.head_deg_per_sec),
            skipped: verification.skipped,
            notes: verification.notes.clone(),
            frames: verification.frames.clone(),
        }
    }
}

fn distribution(frames: &[&VerifiedFrame], value: fn(&VerifiedFrame) -> Option<f64>) -> Option<Distribution> {
    Distribution::of(frames.iter().filter_map(|frame| value(frame)))
}

fn classes(
    frames: &[&VerifiedFrame],
    edges: &[f64],
    by: fn(&VerifiedFrame) -> Option<f64>,
) -> Vec<VerifiedClass> {
    let class = |index: usize| {
        let (from, below) = (edges[index], edges.get(index + 1).copied());
        let belongs = |frame: &&&VerifiedFrame| {
            by(frame).is_some_and(|value| value >= from && below.is_none_or(|below| value < below))
        };
        let here: Vec<&VerifiedFrame> = frames.iter().filter(belongs).copied().collect();
        (!here.is_empty()).then(|| VerifiedClass {
            from,
            below,
            pictures: here.len() as u64,
            rendered_psnr_db: distribution(&here, |frame| frame.at_rendered_pose.psnr_db),
            display_psnr_db: distribution(&here, |frame| frame.at_display_pose.psnr_db),
            shown_offset_px: distribution(&here, |frame| frame.display_offset_px),
            registration_px: distribution(&here, |frame| frame.registration_px),
            registration_deg: distribution(&here, |frame| frame.registration_deg),
        })
    };
    (0..edges.len()).filter_map(class).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_told_by_their_age_and_by_the_head_s_speed() {
        let frame = |age_ms, head_deg_per_sec, db: f64| VerifiedFrame {
            at_display_pose: PictureError { psnr_db: Some(db), ..PictureError::default() },
            registration_deg: Some(60.0 - db),
            age_ms: Some(age_ms),
            head_deg_per_sec,
            ..VerifiedFrame::default()
        };
        let frames =
            vec![frame(10.0, Some(3.0), 40.0), frame(19.9, Some(30.0), 30.0), frame(20.0, None, 20.0)];
        let found = VerificationReport::of(&Verification { frames, ..Verification::default() });
        let told = |classes: &[VerifiedClass]| -> Vec<_> {
            classes.iter().map(|c| (c.from, c.below, c.pictures, c.display_psnr_db.map(|d| d.min))).collect()
        };
        let by_age = [(0.0, Some(20.0), 2, Some(30.0)), (20.0, Some(40.0), 1, Some(20.0))];
        assert_eq!(told(&found.by_age_ms), by_age);
        let by_speed = [(0.0, Some(10.0), 1, Some(40.0)), (30.0, Some(60.0), 1, Some(30.0))];
        assert_eq!(told(&found.by_speed_deg_per_sec), by_speed);
        assert_eq!(found.by_age_ms[0].registration_deg.unwrap().max, 30.0);
        assert_eq!(found.by_age_ms[0].shown_offset_px, None);
    }
}
