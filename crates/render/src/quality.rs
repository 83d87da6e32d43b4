//! What a frame may cost.

/// Who interpolates between voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sampling {
    /// The device's filtering unit, which may carry as few as 8 fractional bits.
    Hardware,
    /// The shader, in float32, from eight fetched voxels.
    Float32,
    /// Nobody: the shader goes from voxel cell to voxel cell instead of stepping, and solves the field in each in float32.
    /// A step has no meaning then.
    Cells,
}

/// What a frame may cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Rays along each side of the picture over pixels along it, above 0 to 1.
    pub resolution_scale: f64,
    /// Distance of samples along a ray over the smallest voxel spacing; not looked at with [`Sampling::Cells`].
    pub step_voxels: f64,
    /// A ray ends when less than this part of the light comes through: the error is at most this, in units of full
    /// brightness. With [`Sampling::Cells`], matter between two knots of the transfer function is integrated to this too.
    pub least_transmittance: f64,
    /// Samples that follow the first that is seen, within so many voxels, are lit alike, at their weighted mean; 0: each by
    /// itself. Not looked at with [`Sampling::Cells`].
    pub light_span_voxels: f64,
    /// Who interpolates.
    pub sampling: Sampling,
    /// Whether empty space is skipped; off only to measure what it brings.
    pub skip_empty: bool,
}

impl Quality {
    /// For a machine that has little to give.
    pub const DRAFT: Self =
        Self { step_voxels: 2.0, least_transmittance: 1.0 / 64.0, light_span_voxels: 4.0, ..Self::BALANCED };
    /// A sample a voxel.
    pub const BALANCED: Self = Self {
        resolution_scale: 1.0,
        step_voxels: 1.0,
        least_transmittance: 1.0 / 256.0,
        light_span_voxels: 0.0,
        sampling: Sampling::Hardware,
        skip_empty: true,
    };
    /// Without steps, to an eighth of a step of 8 bits.
    pub const FINE: Self = Self {
        step_voxels: 0.5,
        least_transmittance: 1.0 / 2048.0,
        sampling: Sampling::Cells,
        ..Self::BALANCED
    };
    /// Without steps, exact up to the rounding of float32.
    pub const EXACT: Self = Self { step_voxels: 0.125, least_transmittance: 1.0e-5, ..Self::FINE };

    /// The levels by name, cheapest first.
    pub const LEVELS: [(&'static str, Self); 4] =
        [("draft", Self::DRAFT), ("balanced", Self::BALANCED), ("fine", Self::FINE), ("exact", Self::EXACT)];

    /// The names of the levels, for people who chose another.
    #[must_use]
    pub fn level_names() -> String {
        Self::LEVELS.map(|(name, _)| name).join(", ")
    }

    /// The level of that name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::LEVELS.iter().find(|(n, _)| *n == name).map(|(_, q)| *q)
    }
}
