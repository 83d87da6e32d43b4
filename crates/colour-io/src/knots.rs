//! Colour and opacity that are given at different values, as one transfer function.

use crate::ColourError;
use scene::{TransferFunction, TransferPoint};

/// Most points of a transfer function that a scene takes.
const MOST_POINTS: usize = 256;
/// Parts into which a stretch is cut whose opacity is curved when it is given for a millimetre.
const PARTS: usize = 8;

/// Values in rising order, linear between; two of one value are an edge.
#[derive(Clone, Debug, Default)]
pub(crate) struct Knots<const N: usize>(pub(crate) Vec<(f64, [f64; N])>);

impl<const N: usize> Knots<N> {
    /// Checks that values do not fall, and numbers lie in 0 to 1.
    pub(crate) fn checked(file: &str, what: &str, knots: Vec<(f64, [f64; N])>) -> Result<Self, ColourError> {
        let expected = "finite values in rising order, with numbers from 0 to 1";
        for (i, (value, numbers)) in knots.iter().enumerate() {
            let falls = i > 0 && *value < knots[i - 1].0;
            let is_wrong = !value.is_finite() || numbers.iter().any(|n| !(0.0..=1.0).contains(n));
            if falls || is_wrong {
                return Err(ColourError::wrong(file, what, expected, &format!("{value} {numbers:?}")));
            }
        }
        Ok(Self(knots))
    }

    /// What holds at a value: coming from below, or from it on.
    fn at(&self, value: f64, from_below: bool) -> [f64; N] {
        let after = self.0.partition_point(|k| if from_below { k.0 < value } else { k.0 <= value });
        match (after.checked_sub(1).and_then(|i| self.0.get(i)), self.0.get(after)) {
            (None, None) => [0.0; N],
            (Some(only), None) | (None, Some(only)) => only.1,
            (Some(low), Some(high)) => {
                let part = (value - low.0) / (high.0 - low.0);
                std::array::from_fn(|i| low.1[i] + (high.1[i] - low.1[i]) * part)
            }
        }
    }
}

/// One function of both. `unit_mm` is the length that opacities are given for: a length of matter with opacity a lets
/// (1 - a) through, so that a millimetre of it has 1 - (1 - a)^(1 / unit).
pub(crate) fn joined(
    file: &str,
    colors: &Knots<3>,
    opacities: &Knots<1>,
    unit_mm: f64,
) -> Result<TransferFunction, ColourError> {
    let of_knots = values(colors, opacities);
    let mut at: Vec<f64> = Vec::new();
    for (i, &value) in of_knots.iter().enumerate() {
        at.push(value);
        // Opacity is linear in the file; for another length it is curved between.
        let Some(&next) = of_knots.get(i + 1).filter(|_| unit_mm != 1.0) else { continue };
        if opacities.at(value, false) != opacities.at(next, true) {
            at.extend((1..PARTS).map(|k| value + (next - value) * k as f64 / PARTS as f64));
        }
    }
    // A function of that many knots has pieces short enough to be straight.
    let at = if at.len() * 2 > MOST_POINTS { of_knots } else { at };
    let per_mm =
        |opacity: f64| if unit_mm == 1.0 { opacity } else { -((-opacity).ln_1p() / unit_mm).exp_m1() };
    let mut points: Vec<TransferPoint> = Vec::new();
    for value in at {
        let side = |from_below: bool| TransferPoint {
            value,
            color: colors.at(value, from_below),
            opacity_per_mm: per_mm(opacities.at(value, from_below)[0]),
        };
        points.push(side(true));
        if side(false) != side(true) {
            points.push(side(false));
        }
    }
    TransferFunction::new(points).map_err(|source| ColourError::Function { file: file.to_owned(), source })
}

/// All values of both, each once.
fn values(colors: &Knots<3>, opacities: &Knots<1>) -> Vec<f64> {
    let mut all: Vec<f64> = colors.0.iter().map(|k| k.0).chain(opacities.0.iter().map(|k| k.0)).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knots<const N: usize>(of: &[(f64, [f64; N])]) -> Knots<N> {
        Knots::checked("test", "knots", of.to_vec()).unwrap()
    }

    #[test]
    fn colour_and_opacity_keep_their_own_knots() {
        let colors = knots(&[(0.0, [0.0; 3]), (100.0, [1.0; 3])]);
        let opacities = knots(&[(20.0, [0.0]), (50.0, [0.5]), (50.0, [0.9]), (60.0, [0.9])]);
        let f = joined("test", &colors, &opacities, 1.0).unwrap();
        assert_eq!(f.at(10.0).opacity_per_mm, 0.0);
        assert!((f.at(35.0).opacity_per_mm - 0.25).abs() < 1e-12);
        assert!((f.at(49.999_999).opacity_per_mm - 0.5).abs() < 1e-6);
        assert_eq!(f.at(50.0).opacity_per_mm, 0.9);
        assert!((f.at(75.0).color[0] - 0.75).abs() < 1e-12);
    }

    #[test]
    fn opacity_of_another_length_becomes_that_of_a_millimetre() {
        let colors = knots(&[(0.0, [1.0; 3])]);
        let opacities = knots(&[(0.0, [0.0]), (10.0, [0.75]), (20.0, [1.0])]);
        let f = joined("test", &colors, &opacities, 2.0).unwrap();
        for value in [0.0, 1.3, 5.0, 9.9, 10.0, 15.0] {
            let given: f64 = if value < 10.0 { 0.075 * value } else { 0.75 + 0.025 * (value - 10.0) };
            let of_two_mm = 1.0 - (1.0 - f.at(value).opacity_per_mm).powi(2);
            assert!((of_two_mm - given).abs() < 0.01, "{value}: {of_two_mm}, {given}");
        }
        assert_eq!(f.at(20.0).opacity_per_mm, 1.0);
    }

    #[test]
    fn falling_values_and_numbers_beyond_1_are_refused() {
        assert!(Knots::checked("test", "x", vec![(1.0, [0.0]), (0.0, [0.0])]).is_err());
        assert!(Knots::checked("test", "x", vec![(1.0, [1.5])]).is_err());
        assert!(Knots::checked("test", "x", vec![(f64::NAN, [0.5])]).is_err());
    }
}
