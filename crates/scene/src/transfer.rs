//! Colour and opacity by value.

use crate::error::{SceneError, within};

/// Most points of a transfer function.
const MOST_POINTS: usize = 256;

/// Opacity a millimetre is not taken nearer to 1 than this: 1 itself would be an infinite extinction. One millimetre of
/// such matter lets 2⁻²⁰ of the light through, a four-thousandth of the finest step of an 8-bit picture.
pub const HIGHEST_OPACITY_PER_MM: f64 = 1.0 - 1.0 / (1u32 << 20) as f64;

/// A knot of a transfer function. In a file: `[value, red, green, blue, opacity per millimetre]`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(from = "[f64; 5]", into = "[f64; 5]")]
#[schemars(with = "[f64; 5]")]
pub struct TransferPoint {
    /// The value (Hounsfield units, SUV, …) at which colour and opacity are given.
    pub value: f64,
    /// RGB, 0 to 1, as shown (not multiplied by opacity).
    pub color: [f64; 3],
    /// Opacity of one millimetre of this matter, 0 to 1.
    pub opacity_per_mm: f64,
}

impl From<[f64; 5]> for TransferPoint {
    fn from([value, red, green, blue, opacity_per_mm]: [f64; 5]) -> Self {
        Self { value, color: [red, green, blue], opacity_per_mm }
    }
}

impl From<TransferPoint> for [f64; 5] {
    fn from(p: TransferPoint) -> Self {
        [p.value, p.color[0], p.color[1], p.color[2], p.opacity_per_mm]
    }
}

/// What matter of one value does to light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optical {
    /// RGB, 0 to 1, not multiplied by opacity.
    pub color: [f64; 3],
    /// Opacity of one millimetre, 0 to 1.
    pub opacity_per_mm: f64,
}

impl Optical {
    /// Matter that does nothing.
    pub const NOTHING: Self = Self { color: [0.0; 3], opacity_per_mm: 0.0 };

    /// Extinction a millimetre, σ = -ln(1 - opacity), with the opacity held below [`HIGHEST_OPACITY_PER_MM`].
    #[must_use]
    pub fn extinction_per_mm(&self) -> f64 {
        -(-self.opacity_per_mm.min(HIGHEST_OPACITY_PER_MM)).ln_1p()
    }
}

/// Colour and opacity by value: linear between points, constant before the first and after the last; transparent
/// everywhere if there is no point. Two points of one value make a vertical edge: the later one holds at the value
/// itself.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(transparent)]
pub struct TransferFunction {
    points: Vec<TransferPoint>,
}

impl TransferFunction {
    /// Checks and takes points.
    ///
    /// # Errors
    /// If there are more than 256, a number is not finite or out of range, or values go down.
    pub fn new(points: Vec<TransferPoint>) -> Result<Self, SceneError> {
        let function = Self { points };
        function.check()?;
        Ok(function)
    }

    pub(crate) fn check(&self) -> Result<(), SceneError> {
        if self.points.len() > MOST_POINTS {
            return Err(SceneError::TransferLength { found: self.points.len(), max: MOST_POINTS });
        }
        for (index, p) in self.points.iter().enumerate() {
            within(
                &format!("transfer[{index}] value"),
                p.value,
                -1.0e12..=1.0e12,
                "a finite number within 1e12",
            )?;
            for c in p.color {
                within(&format!("transfer[{index}] colour"), c, 0.0..=1.0, "0 to 1")?;
            }
            within(&format!("transfer[{index}] opacity per mm"), p.opacity_per_mm, 0.0..=1.0, "0 to 1")?;
        }
        for (index, pair) in self.points.windows(2).enumerate() {
            if pair[1].value < pair[0].value {
                let (value, previous) = (pair[1].value, pair[0].value);
                return Err(SceneError::TransferOrder { index: index + 1, value, previous });
            }
        }
        Ok(())
    }

    /// The points, in the order of their values.
    #[must_use]
    pub fn points(&self) -> &[TransferPoint] {
        &self.points
    }

    /// What matter of this value does to light.
    #[must_use]
    pub fn at(&self, value: f64) -> Optical {
        let after = self.points.partition_point(|p| p.value <= value);
        let as_is = |p: &TransferPoint| Optical { color: p.color, opacity_per_mm: p.opacity_per_mm };
        match (after.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(after)) {
            (None, None) => Optical::NOTHING,
            (Some(only), None) | (None, Some(only)) => as_is(only),
            (Some(low), Some(high)) => {
                let f = (value - low.value) / (high.value - low.value);
                let mix = |a: f64, b: f64| a + (b - a) * f;
                Optical {
                    color: std::array::from_fn(|i| mix(low.color[i], high.color[i])),
                    opacity_per_mm: mix(low.opacity_per_mm, high.opacity_per_mm),
                }
            }
        }
    }

    /// The values over which this function changes: first and last point, `None` without points.
    #[must_use]
    pub fn value_range(&self) -> Option<(f64, f64)> {
        Some((self.points.first()?.value, self.points.last()?.value))
    }

    /// Whether some value in `low..=high` is not wholly transparent.
    #[must_use]
    pub fn is_visible_within(&self, low: f64, high: f64) -> bool {
        let inside = |p: &&TransferPoint| low <= p.value && p.value <= high;
        self.at(low).opacity_per_mm > 0.0
            || self.at(high).opacity_per_mm > 0.0
            || self.points.iter().filter(inside).any(|p| p.opacity_per_mm > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn function(points: &[[f64; 5]]) -> TransferFunction {
        TransferFunction::new(points.iter().map(|&p| p.into()).collect()).unwrap()
    }

    #[test]
    fn linear_between_and_constant_outside() {
        let f = function(&[[0.0, 0.0, 0.0, 0.0, 0.2], [10.0, 1.0, 0.5, 0.0, 0.6]]);
        assert!((f.at(5.0).opacity_per_mm - 0.4).abs() < 1e-15);
        assert_eq!(f.at(5.0).color, [0.5, 0.25, 0.0]);
        assert_eq!(f.at(-100.0).opacity_per_mm, 0.2);
        assert_eq!(f.at(100.0).opacity_per_mm, 0.6);
    }

    #[test]
    fn a_vertical_edge_belongs_to_its_upper_side() {
        let f = function(&[[0.0, 0.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0, 0.0], [5.0, 1.0, 1.0, 1.0, 1.0]]);
        assert_eq!(f.at(5.0f64.next_down()).opacity_per_mm, 0.0);
        assert_eq!(f.at(5.0).opacity_per_mm, 1.0);
    }

    #[test]
    fn no_point_is_transparent_and_one_is_constant() {
        assert_eq!(function(&[]).at(3.0), Optical::NOTHING);
        assert_eq!(function(&[[7.0, 1.0, 0.0, 0.0, 0.5]]).at(-3.0).opacity_per_mm, 0.5);
    }

    #[test]
    fn full_opacity_has_a_finite_extinction_and_tiny_opacity_keeps_its_digits() {
        let sigma = |o| Optical { color: [0.0; 3], opacity_per_mm: o }.extinction_per_mm();
        assert!((sigma(1.0) - 20.0 * std::f64::consts::LN_2).abs() < 1e-9);
        assert!((sigma(1e-12) / 1e-12 - 1.0).abs() < 1e-9);
        assert_eq!(sigma(0.0), 0.0);
    }

    #[test]
    fn a_band_between_two_samples_is_visible() {
        let f = function(&[
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [100.0, 1.0, 1.0, 1.0, 0.0],
            [101.0, 1.0, 1.0, 1.0, 0.5],
            [102.0, 1.0, 1.0, 1.0, 0.0],
        ]);
        assert!(f.is_visible_within(0.0, 255.0));
        assert!(!f.is_visible_within(0.0, 100.0));
        assert!(!f.is_visible_within(102.0, 255.0));
        assert!(f.is_visible_within(101.5, 101.5));
    }

    #[test]
    fn refuses_disorder_and_what_is_no_number() {
        let new = |p: &[[f64; 5]]| TransferFunction::new(p.iter().map(|&p| p.into()).collect()).unwrap_err();
        assert!(matches!(
            new(&[[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0]]),
            SceneError::TransferOrder { index: 1, .. }
        ));
        assert!(matches!(new(&[[f64::NAN, 0.0, 0.0, 0.0, 0.0]]), SceneError::Range { .. }));
        assert!(matches!(new(&[[0.0, 0.0, 0.0, 0.0, 1.5]]), SceneError::Range { .. }));
        assert!(matches!(new(&vec![[0.0; 5]; 257]), SceneError::TransferLength { found: 257, .. }));
    }
}
