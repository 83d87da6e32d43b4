//! The headlight.

use crate::error::{SceneError, within};

/// A light at the eye: how much of the colour is seen whatever the surface's direction, how much by its slope towards
/// the eye, and how much of the light itself is mirrored. Lit from both sides, as VTK does.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Headlight {
    /// Part of the colour seen without light, 0 to 1.
    pub ambient: f64,
    /// Part of the colour times the cosine between gradient and view, 0 to 1.
    pub diffuse: f64,
    /// White light mirrored: times the cosine to the `power`, 0 to 1.
    pub specular: f64,
    /// Sharpness of the highlight, 1 to 256.
    pub power: f64,
}

impl Default for Headlight {
    fn default() -> Self {
        Self { ambient: 0.15, diffuse: 0.65, specular: 0.2, power: 1.0 }
    }
}

impl Headlight {
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        within("light.ambient", self.ambient, 0.0..=1.0, "0 to 1")?;
        within("light.diffuse", self.diffuse, 0.0..=1.0, "0 to 1")?;
        within("light.specular", self.specular, 0.0..=1.0, "0 to 1")?;
        within("light.power", self.power, 1.0..=256.0, "1 to 256")?;
        Ok(())
    }

    /// A colour (RGB, 0 to 1) lit at an angle whose cosine between gradient and view is `cosine` (0 to 1; 0 where there
    /// is no gradient).
    #[must_use]
    pub fn lit(&self, color: [f64; 3], cosine: f64) -> [f64; 3] {
        let mirrored = if cosine > 0.0 { self.specular * cosine.powf(self.power) } else { 0.0 };
        color.map(|c| c * (self.ambient + self.diffuse * cosine) + mirrored)
    }
}
