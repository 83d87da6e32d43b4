//! How far the hologram seemed to be from where it is, by the age of the pose and the speed of the head.

use crate::{Distribution, FrameRecord};
use serde::{Deserialize, Serialize};

/// Where one class of ages ends and the next begins, in milliseconds.
pub(crate) const AGES_MS: [f64; 5] = [0.0, 20.0, 40.0, 60.0, 100.0];
/// Where one class of speeds ends and the next begins, in degrees a second.
pub(crate) const SPEEDS_DEG_PER_SEC: [f64; 5] = [0.0, 10.0, 30.0, 60.0, 120.0];

/// How far points of the hologram seemed to be from where they are when a picture was shown, without reprojection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// In pixels.
    pub px: Distribution,
    /// In degrees.
    pub deg: Distribution,
    /// By the age of the pose when the picture was shown, in milliseconds; classes without a frame are left out.
    pub by_age_ms: Vec<RegistrationClass>,
    /// By how fast the head turned, in degrees a second; classes without a frame are left out.
    pub by_speed_deg_per_sec: Vec<RegistrationClass>,
}

/// The frames of one class.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegistrationClass {
    /// The class begins here.
    pub from: f64,
    /// It ends before this; `None` for the last one, which has no end.
    pub below: Option<f64>,
    /// Displacement in pixels.
    pub px: Distribution,
    /// Displacement in degrees.
    pub deg: Distribution,
}

impl Registration {
    /// Of the frames for which it is known; `None` if there is none.
    pub(crate) fn of(frames: &[FrameRecord]) -> Option<Self> {
        let age = |frame: &FrameRecord| Some(frame.pose_to_shown_us as f64 * 1e-3);
        Some(Self {
            px: Distribution::of(frames.iter().filter_map(|frame| frame.registration_px))?,
            deg: Distribution::of(frames.iter().filter_map(|frame| frame.registration_deg))?,
            by_age_ms: classes(frames, &AGES_MS, age),
            by_speed_deg_per_sec: classes(frames, &SPEEDS_DEG_PER_SEC, |frame| frame.head_deg_per_sec),
        })
    }
}

fn classes(
    frames: &[FrameRecord],
    edges: &[f64],
    by: impl Fn(&FrameRecord) -> Option<f64>,
) -> Vec<RegistrationClass> {
    let class = |index: usize| {
        let (from, below) = (edges[index], edges.get(index + 1).copied());
        let belongs = |frame: &&FrameRecord| {
            by(frame).is_some_and(|value| value >= from && below.is_none_or(|below| value < below))
        };
        let of = |value: fn(&FrameRecord) -> Option<f64>| {
            Distribution::of(frames.iter().filter(belongs).filter_map(value))
        };
        Some(RegistrationClass {
            from,
            below,
            px: of(|frame| frame.registration_px)?,
            deg: of(|frame| frame.registration_deg)?,
        })
    };
    (0..edges.len()).filter_map(class).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_told_by_their_age_and_by_the_head_s_speed() {
        let frame = |age_us, speed, px: Option<f64>| FrameRecord {
            pose_to_shown_us: age_us,
            head_deg_per_sec: speed,
            registration_px: px,
            registration_deg: px.map(|px| px / 40.0),
            ..FrameRecord::default()
        };
        let frames = [
            frame(19_999, Some(5.0), Some(1.0)),
            frame(20_000, Some(10.0), Some(2.0)),
            frame(250_000, Some(500.0), Some(60.0)),
            frame(30_000, Some(5.0), None),
            frame(30_000, None, Some(4.0)),
        ];
        let found = Registration::of(&frames).unwrap();
        assert_eq!((found.px.count, found.px.max, found.deg.max), (4, 60.0, 1.5));
        let told = |classes: &[RegistrationClass]| -> Vec<_> {
            classes.iter().map(|class| (class.from, class.below, class.px.count)).collect()
        };
        assert_eq!(told(&found.by_age_ms), [(0.0, Some(20.0), 1), (20.0, Some(40.0), 2), (100.0, None, 1)]);
        let expected = [(0.0, Some(10.0), 1), (10.0, Some(30.0), 1), (120.0, None, 1)];
        assert_eq!(told(&found.by_speed_deg_per_sec), expected);
        assert_eq!(Registration::of(&frames[3..4]), None);
    }
}
