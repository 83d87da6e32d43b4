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
    /// Where a step has more than [`Self::refined_above`] to see at either end, it is gone in so many parts: 1, 2, 4, 8
    /// or 16; 1 for never. Emission-absorption only, and not looked at with [`Sampling::Cells`].
    pub refined_parts: u32,
    /// The opacity of a step above which it is refined, 0 to 1.
    pub refined_above: f64,
    /// A ray ends when less than this part of the light comes through: the error is at most this, in units of full
    /// brightness. With [`Sampling::Cells`], matter between two knots of the transfer function is integrated to this too.
    pub least_transmittance: f64,
    /// Samples that follow the first that is seen, within so many voxels and at least within its step, are lit alike, at
    /// their weighted mean. Not looked at with [`Sampling::Cells`].
    pub light_span_voxels: f64,
    /// They end with the one with which they have taken more than this part of all light, 0 to 1; 0: each sample by itself.
    pub light_weight: f64,
    /// Rays of every other pixel of every other row are cast first. Where four neighbours of them differ by no more than
    /// this, in red, green, blue and opacity, the three pixels between them are interpolated; 0 to 1, and 0 to cast a ray
    /// for each pixel. Not looked at where labels or several volumes are shown.
    pub interpolated_below: f64,
    /// Who interpolates.
    pub sampling: Sampling,
    /// Whether surfaces and maxima are solved cell by cell, whoever interpolates where matter is summed: one that lies
    /// between two samples is lost, and no step that is as fast finds as many.
    pub solves_surfaces: bool,
    /// Whether empty space is skipped; off only to measure what it brings.
    pub skip_empty: bool,
}

impl Quality {
    /// For a machine that has little to give.
    pub const DRAFT: Self = Self {
        step_voxels: 1.5,
        refined_parts: 2,
        refined_above: 0.05,
        least_transmittance: 1.0 / 64.0,
        light_span_voxels: 4.0,
        light_weight: 1.0,
        interpolated_below: 1.0 / 16.0,
        solves_surfaces: false,
        ..Self::BALANCED
    };
    /// Steps of a voxel and nothing else: what refined steps and solved surfaces are measured against, no level of its own.
    pub const PLAIN: Self = Self {
        step_voxels: 1.0,
        refined_parts: 1,
        light_span_voxels: 0.0,
        light_weight: 0.0,
        solves_surfaces: false,
        ..Self::BALANCED
    };
    /// Steps of three eighths of a voxel, and quarters of them where there is something to see; light for each sixty-fourth
    /// of what is seen, and at least for each voxel; surfaces and maxima without steps.
    pub const BALANCED: Self = Self {
        resolution_scale: 1.0,
        step_voxels: 0.375,
        refined_parts: 4,
        refined_above: 0.01,
        least_transmittance: 1.0 / 256.0,
        light_span_voxels: 1.0,
        light_weight: 1.0 / 64.0,
        interpolated_below: 0.0,
        sampling: Sampling::Hardware,
        solves_surfaces: true,
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

    /// The same with steps so many times as long; from twice on with no more care than [`Self::DRAFT`] takes, pixels between
    /// rays included, but not with less light.
    #[must_use]
    pub fn coarser(self, step_scale: f64) -> Self {
        let step_voxels = (self.step_voxels * step_scale).min(64.0);
        if step_scale < 2.0 || self.sampling == Sampling::Cells {
            return Self { step_voxels, ..self };
        }
        Self {
            step_voxels,
            refined_parts: self.refined_parts.min(Self::DRAFT.refined_parts),
            refined_above: self.refined_above.max(Self::DRAFT.refined_above),
            interpolated_below: self.interpolated_below.max(Self::DRAFT.interpolated_below),
            solves_surfaces: false,
            ..self
        }
    }

    /// The numbers of a quality by name, as [`Self::with`] takes them.
    pub const NUMBERS: [&'static str; 8] = [
        "resolution_scale",
        "step_voxels",
        "refined_parts",
        "refined_above",
        "least_transmittance",
        "light_span_voxels",
        "light_weight",
        "interpolated_below",
    ];

    /// The same with another number of that name; `None` if there is none. Whether the number is in its range is said when
    /// a frame is planned.
    #[must_use]
    pub fn with(mut self, name: &str, number: f64) -> Option<Self> {
        match name {
            "resolution_scale" => self.resolution_scale = number,
            "step_voxels" => self.step_voxels = number,
            // What is no whole number becomes none that is allowed.
            "refined_parts" => self.refined_parts = if number.fract() == 0.0 { number as u32 } else { 0 },
            "refined_above" => self.refined_above = number,
            "least_transmittance" => self.least_transmittance = number,
            "light_span_voxels" => self.light_span_voxels = number,
            "light_weight" => self.light_weight = number,
            "interpolated_below" => self.interpolated_below = number,
            _ => return None,
        }
        Some(self)
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_coarser_takes_no_more_care_than_draft_and_what_takes_no_steps_stays_as_true() {
        let coarser = Quality::BALANCED.coarser(4.0);
        assert_eq!(coarser.step_voxels, Quality::DRAFT.step_voxels);
        assert_eq!(coarser.interpolated_below, Quality::DRAFT.interpolated_below);
        assert_eq!(coarser.refined_parts, Quality::DRAFT.refined_parts);
        assert_eq!(coarser.light_weight, Quality::BALANCED.light_weight);
        assert_eq!(Quality::BALANCED.coarser(1.0), Quality::BALANCED);
        // Somebody who asked for more than draft's carelessness keeps it.
        let careless = Quality { interpolated_below: 0.5, ..Quality::BALANCED };
        assert_eq!(careless.coarser(2.0).interpolated_below, 0.5);
        for level in [Quality::FINE, Quality::EXACT] {
            assert_eq!(level.coarser(4.0), Quality { step_voxels: 4.0 * level.step_voxels, ..level });
        }
    }
}
