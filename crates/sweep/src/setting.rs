//! What is tried.

use render::{Quality, Sampling};

/// Settings that differ in one thing: a curve of the plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// The named levels.
    Level,
    /// The step, with the device's own filter.
    StepHardware,
    /// The step, interpolated in float32.
    StepFloat32,
    /// The step, refined as `balanced` refines it.
    Refined,
    /// Cells instead of steps, in float32.
    Cells,
    /// The light that is left when a ray ends.
    EarlyEnd,
    /// Fewer rays than pixels.
    FewerRays,
    /// A level without skipping empty space.
    NoSkipping,
}

impl Curve {
    /// Every curve, in the order of the plot.
    pub const ALL: [Self; 8] = [
        Self::StepHardware,
        Self::StepFloat32,
        Self::Refined,
        Self::Cells,
        Self::EarlyEnd,
        Self::FewerRays,
        Self::NoSkipping,
        Self::Level,
    ];

    /// For people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Level => "named levels",
            Self::StepHardware => "step, device's filter",
            Self::StepFloat32 => "step, float32 filter",
            Self::Refined => "step, refined",
            Self::Cells => "cells, float32",
            Self::EarlyEnd => "early end",
            Self::FewerRays => "fewer rays",
            Self::NoSkipping => "no skipping",
        }
    }
}

/// A quality by name.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Which curve it is a point of.
    pub curve: Curve,
    /// Its own name, such as `fine` or `hardware step 0.5`.
    pub name: String,
    /// What is drawn with.
    pub quality: Quality,
}

/// All settings of a sweep. What the renderer learns to vary is tried by another line here.
#[must_use]
pub fn settings() -> Vec<Setting> {
    const STEPS: [f64; 6] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.125];
    let plain = Quality { least_transmittance: Quality::EXACT.least_transmittance, ..Quality::PLAIN };
    let mut all = Vec::new();
    let mut add = |curve, name: String, quality| all.push(Setting { curve, name, quality });
    for (name, quality) in Quality::LEVELS {
        add(Curve::Level, name.to_owned(), quality);
    }
    for step_voxels in STEPS {
        let quality = Quality { step_voxels, ..plain };
        add(Curve::StepHardware, format!("hardware step {step_voxels}"), quality);
    }
    for step_voxels in STEPS {
        let quality = Quality { step_voxels, sampling: Sampling::Float32, ..plain };
        add(Curve::StepFloat32, format!("float32 step {step_voxels}"), quality);
    }
    for step_voxels in [2.0, 1.0, 0.5, 0.25] {
        let Quality { refined_parts, refined_above, .. } = Quality::BALANCED;
        let quality = Quality { step_voxels, refined_parts, refined_above, ..plain };
        add(Curve::Refined, format!("refined step {step_voxels}"), quality);
    }
    for end in [256.0, 2048.0] {
        let quality = Quality { sampling: Sampling::Cells, least_transmittance: 1.0 / end, ..Quality::EXACT };
        add(Curve::Cells, format!("cells, end at 1/{end}"), quality);
    }
    // Steps so short that the early end is what errs.
    let to_the_end =
        Quality { step_voxels: 0.25, least_transmittance: 0.0, sampling: Sampling::Float32, ..plain };
    for end in [16.0, 64.0, 256.0, 1024.0, 4096.0] {
        let quality = Quality { least_transmittance: 1.0 / end, ..to_the_end };
        add(Curve::EarlyEnd, format!("end at 1/{end}"), quality);
    }
    add(Curve::EarlyEnd, "end at 0".to_owned(), to_the_end);
    for resolution_scale in [0.75, 0.5, 0.37, 0.25] {
        let quality = Quality { resolution_scale, ..Quality::BALANCED };
        add(Curve::FewerRays, format!("rays {resolution_scale}"), quality);
    }
    for (name, quality) in [("balanced", Quality::BALANCED), ("fine", Quality::FINE)] {
        let quality = Quality { skip_empty: false, ..quality };
        add(Curve::NoSkipping, format!("{name}, no skipping"), quality);
    }
    all
}

/// Settings whose cost is measured: the levels, and `balanced` and `draft` without each thing that makes them faster.
#[must_use]
pub fn cost_settings() -> Vec<Setting> {
    let setting = |curve, name: &str, quality| Setting { curve, name: name.to_owned(), quality };
    let level = |name, quality| setting(Curve::Level, name, quality);
    let b = Quality::BALANCED;
    vec![
        level("draft", Quality::DRAFT),
        setting(
            Curve::FewerRays,
            "draft, a ray a pixel",
            Quality { interpolated_below: 0.0, ..Quality::DRAFT },
        ),
        level("balanced", b),
        level("fine", Quality::FINE),
        setting(Curve::StepHardware, "balanced, not refined", Quality { refined_parts: 1, ..b }),
        setting(Curve::StepHardware, "a voxel a step", Quality::PLAIN),
        setting(Curve::NoSkipping, "balanced, no skipping", Quality { skip_empty: false, ..b }),
        setting(Curve::EarlyEnd, "balanced, no early end", Quality { least_transmittance: 0.0, ..b }),
        setting(Curve::StepFloat32, "balanced, float32 filter", Quality { sampling: Sampling::Float32, ..b }),
        setting(
            Curve::Level,
            "balanced, lit in groups",
            Quality { light_span_voxels: 4.0, light_weight: 1.0, ..b },
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_setting_has_a_name_of_its_own_and_every_curve_a_setting() {
        let all = settings();
        let names: BTreeSet<&str> = all.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names.len(), all.len());
        for curve in Curve::ALL {
            assert!(all.iter().any(|s| s.curve == curve), "{curve:?}");
        }
        for (name, _) in Quality::LEVELS {
            assert!(names.contains(name), "{name}");
        }
    }
}
