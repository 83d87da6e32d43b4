//! One decoded frame.

use serde::{Deserialize, Serialize};

/// The names of the stages between a pose and its decoded picture, in the order in which they follow each other. Lower
/// case, words joined by `_`; given once for a run, so that a frame holds only numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct StageNames(Vec<String>);

impl StageNames {
    /// The names in order.
    pub fn new<Name: Into<String>>(names: impl IntoIterator<Item = Name>) -> Self {
        Self(names.into_iter().map(Into::into).collect())
    }

    /// The names in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &str> {
        self.0.iter().map(String::as_str)
    }

    /// How many stages there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// One frame that a headset decoded: where its time went, how large it was and how well it was rendered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// The frame's number in its session.
    pub frame: u64,
    /// When its picture was decoded, in seconds since the run began.
    pub decoded_at_secs: f64,
    /// How long each stage took, in microseconds, in the order of the run's [`StageNames`]. A stage that begins on one
    /// machine's clock and ends on another's can be negative, by as much as the two clocks disagree.
    pub stages_us: Vec<i64>,
    /// How wrong the offset between the two clocks may have been for this frame, in microseconds.
    pub clock_error_us: u64,
    /// Age of the pose when the renderer began, in microseconds.
    pub pose_age_at_render_us: i64,
    /// From the pose to the decoded picture, in microseconds. The stages sum to it exactly.
    pub pose_to_decoded_us: i64,
    /// How long after its predicted display time the picture was decoded, in microseconds; negative if it was in time.
    pub lateness_us: i64,
    /// Size of the access unit, in bytes.
    pub bytes: u64,
    /// Whether it can be decoded without the frames before it.
    pub key_frame: bool,
    /// Rendered width over the stream's width, in 0 to 1.
    pub resolution_scale: f64,
    /// Distance of samples along a ray, over the one at full quality.
    pub step_scale: f64,
    /// Distance between the head as predicted for the frame and as it was at the display time, in millimetres; `None`
    /// if the latter is not known.
    pub prediction_error_mm: Option<f64>,
    /// Angle between the two, in degrees; `None` as above.
    pub prediction_error_deg: Option<f64>,
    /// From the pose to when the picture was shown, in microseconds.
    #[serde(default)]
    pub pose_to_shown_us: i64,
    /// How fast the head turned meanwhile, in degrees a second; `None` if not known.
    pub head_deg_per_sec: Option<f64>,
    /// How far points of the hologram seemed to be from where they are when the picture was shown, without reprojection,
    /// in pixels; `None` if none was seen or that is not known.
    pub registration_px: Option<f64>,
    /// The same in degrees.
    pub registration_deg: Option<f64>,
}

impl FrameRecord {
    /// Whether the picture was decoded after its predicted display time.
    #[must_use]
    pub fn is_late(&self) -> bool {
        self.lateness_us > 0
    }
}
