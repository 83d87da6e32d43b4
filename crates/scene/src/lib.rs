//! What is shown: the mode, the transfer function, the threshold and window, the light, and where in the room it lies.
//!
//! A [`SceneFile`] is what a person writes (JSON, described by `docs/scene.schema.json`): almost everything may be left
//! out. [`SceneFile::resolve`] fills the gaps from the volume's own facts and gives a [`Scene`], in which every number
//! is there, finite and checked; only that is rendered.
//!
//! This crate knows no GPU and no network.

mod camera;
mod error;
mod file;
mod further;
mod labels;
mod light;
mod placement;
mod play;
mod preset;
mod transfer;

pub use camera::Camera;
pub use error::SceneError;
pub use file::{ChannelChoice, ChannelFacts, SceneFile, VolumeFacts, schema_json};
pub use further::{
    Further, FurtherFacts, FurtherVolume, MOST_VOLUMES, Registration, VolumeSource, VoxelKind,
};
pub use labels::{LabelEntry, LabelFacts, LabelLooks, LabelRef, LabelsFile, made_up_color};
pub use light::Headlight;
pub use placement::Placement;
pub use play::Play;
pub use preset::{Preset, PresetUnits};
pub use transfer::{HIGHEST_OPACITY_PER_MM, Optical, TransferFunction, TransferPoint};

/// How the samples along a ray become one pixel.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Emission and absorption with a transfer function: direct volume rendering.
    #[serde(alias = "dvr")]
    EmissionAbsorption,
    /// The surface where the value first crosses the threshold, lit by a headlight.
    Threshold,
    /// The mean value along the ray's way through the volume, mapped by the window to grey.
    XRay,
    /// The highest value along the ray, through the transfer function (or the window, where there is none).
    #[serde(alias = "mip")]
    Maximum,
    /// HoloM3D's cumulated mode: the threshold surface over the X-ray.
    Cumulated,
}

impl Mode {
    /// Every mode.
    pub const ALL: [Self; 5] =
        [Self::EmissionAbsorption, Self::Threshold, Self::XRay, Self::Maximum, Self::Cumulated];

    /// The name used in scene files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::EmissionAbsorption => "emission-absorption",
            Self::Threshold => "threshold",
            Self::XRay => "x-ray",
            Self::Maximum => "maximum",
            Self::Cumulated => "cumulated",
        }
    }
}

/// The values shown from black to white.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(from = "[f64; 2]", into = "[f64; 2]")]
#[schemars(with = "[f64; 2]")]
pub struct Window {
    /// Value shown black (transparent).
    pub low: f64,
    /// Value shown white; above `low`.
    pub high: f64,
}

impl Window {
    pub(crate) fn check(&self, field: &str) -> Result<(), SceneError> {
        for (end, value) in [("low", self.low), ("high", self.high)] {
            error::within(&format!("{field} {end}"), value, -1.0e12..=1.0e12, "a finite number within 1e12")?;
        }
        if self.low >= self.high {
            return Err(SceneError::Range {
                field: field.to_owned(),
                found: format!("[{}, {}]", self.low, self.high),
                expected: "[low, high] with low below high",
            });
        }
        Ok(())
    }

    /// Where a value lies in the window: 0 at or below `low`, 1 at or above `high`.
    #[must_use]
    pub fn fraction(&self, value: f64) -> f64 {
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }
}

impl From<[f64; 2]> for Window {
    fn from([low, high]: [f64; 2]) -> Self {
        Self { low, high }
    }
}

impl From<Window> for [f64; 2] {
    fn from(window: Window) -> Self {
        [window.low, window.high]
    }
}

/// What is shown, complete and checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Which channel of the volume is shown.
    pub channel: usize,
    /// How samples become a pixel.
    pub mode: Mode,
    /// Colour and opacity by value. In mode `maximum` its opacity is taken as it stands, not per millimetre.
    pub transfer: TransferFunction,
    /// What each label does to light, where the channel holds labels: then the transfer function is not looked at, and
    /// the mode is emission-absorption.
    pub labels: Option<LabelLooks>,
    /// Value of the surface in the modes `threshold` and `cumulated`.
    pub threshold: f64,
    /// Colour of that surface, RGB 0 to 1.
    pub surface_color: [f64; 3],
    /// Opacity of that surface, 0 to 1.
    pub surface_opacity: f64,
    /// Values from black to white in the modes `x-ray` and `cumulated`.
    pub window: Window,
    /// The light, if the picture is lit; threshold surfaces always are.
    pub light: Option<Headlight>,
    /// Where the volume lies in the room.
    pub placement: Placement,
    /// What stands behind, RGB 0 to 1. Black is transparent on an additive display.
    pub background: [f64; 3],
    /// Volumes shown together with the first, in mode `emission-absorption` only; hidden ones are not among them.
    pub further: Vec<Further>,
}
