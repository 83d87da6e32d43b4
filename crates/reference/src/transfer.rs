//! The transfer function as linear stretches between values.

use crate::Cubic;
use scene::{HIGHEST_OPACITY_PER_MM, Optical, TransferFunction, TransferPoint};

/// A transfer function cut where its formula changes: at its points, and where its opacity meets the highest there is.
#[derive(Clone, Debug)]
pub(crate) struct Stretches {
    /// Values at which one stretch ends and the next begins, rising; the later one holds at the value itself.
    knots: Vec<f64>,
    /// One more than knots: before the first, between them, after the last.
    stretches: Vec<Stretch>,
}

/// Colour and opacity as linear functions of the value.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    start: f64,
    at_start: Optical,
    color_slope: [f64; 3],
    opacity_slope: f64,
    /// Whether opacity is above 0 anywhere in it.
    visible: bool,
}

impl Stretches {
    pub(crate) fn of(function: &TransferFunction) -> Self {
        let points = limited(function.points());
        let knots = points.iter().map(|p| p.value).collect();
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return Self { knots, stretches: vec![Stretch::between(None, None)] };
        };
        let inner = points.windows(2).map(|pair| Stretch::between(Some(&pair[0]), Some(&pair[1])));
        let stretches = std::iter::once(Stretch::between(None, Some(first)))
            .chain(inner)
            .chain([Stretch::between(Some(last), None)])
            .collect();
        Self { knots, stretches }
    }

    /// The stretch that a value lies in.
    pub(crate) fn at(&self, value: f64) -> &Stretch {
        &self.stretches[self.number(value)]
    }

    /// Whether some value in `low..=high` may be visible; what is not is wholly transparent.
    pub(crate) fn is_visible_within(&self, low: f64, high: f64) -> bool {
        self.stretches[self.number(low)..=self.number(high)].iter().any(|s| s.visible)
    }

    /// Adds to `found` where a cubic with values in `low..=high` passes from one stretch to another.
    pub(crate) fn crossings(&self, cubic: &Cubic, low: f64, high: f64, found: &mut Vec<f64>) {
        let from = self.knots.partition_point(|&k| k < low);
        let to = self.knots.partition_point(|&k| k <= high);
        let mut previous = None;
        for &knot in &self.knots[from..to] {
            if previous != Some(knot) {
                cubic.crossings(knot, found);
            }
            previous = Some(knot);
        }
    }

    fn number(&self, value: f64) -> usize {
        self.knots.partition_point(|&k| k <= value)
    }
}

impl Stretch {
    fn between(low: Option<&TransferPoint>, high: Option<&TransferPoint>) -> Self {
        let Some(start) = low.or(high) else {
            return Self {
                start: 0.0,
                at_start: Optical::NOTHING,
                color_slope: [0.0; 3],
                opacity_slope: 0.0,
                visible: false,
            };
        };
        let end = high.unwrap_or(start);
        let width = end.value - start.value;
        // A stretch without width holds no value; one of the open ends is constant.
        let slope = |a: f64, b: f64| if width > 0.0 { (b - a) / width } else { 0.0 };
        Self {
            start: start.value,
            at_start: Optical { color: start.color, opacity_per_mm: start.opacity_per_mm },
            color_slope: std::array::from_fn(|i| slope(start.color[i], end.color[i])),
            opacity_slope: slope(start.opacity_per_mm, end.opacity_per_mm),
            visible: start.opacity_per_mm > 0.0 || end.opacity_per_mm > 0.0,
        }
    }

    /// Whether matter of this stretch does anything.
    pub(crate) fn is_visible(&self) -> bool {
        self.visible
    }

    /// What matter of this value does to light; the formula of this stretch, whatever the value.
    pub(crate) fn optical(&self, value: f64) -> Optical {
        let beyond = value - self.start;
        Optical {
            color: std::array::from_fn(|i| self.at_start.color[i] + self.color_slope[i] * beyond),
            opacity_per_mm: (self.at_start.opacity_per_mm + self.opacity_slope * beyond).max(0.0),
        }
    }
}

/// The points with opacity held at the highest there is, and a point more wherever a line between two meets it.
fn limited(points: &[TransferPoint]) -> Vec<TransferPoint> {
    let mut limited: Vec<TransferPoint> = Vec::with_capacity(points.len());
    for (i, p) in points.iter().enumerate() {
        if let Some(before) = i.checked_sub(1).map(|i| &points[i]) {
            let (a, b) =
                (before.opacity_per_mm - HIGHEST_OPACITY_PER_MM, p.opacity_per_mm - HIGHEST_OPACITY_PER_MM);
            if a * b < 0.0 && p.value > before.value {
                let f = a / (a - b);
                let mix = |a: f64, b: f64| a + (b - a) * f;
                limited.push(TransferPoint {
                    value: mix(before.value, p.value),
                    color: std::array::from_fn(|c| mix(before.color[c], p.color[c])),
                    opacity_per_mm: HIGHEST_OPACITY_PER_MM,
                });
            }
        }
        limited.push(TransferPoint { opacity_per_mm: p.opacity_per_mm.min(HIGHEST_OPACITY_PER_MM), ..*p });
    }
    limited
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn function(points: &[[f64; 5]]) -> TransferFunction {
        TransferFunction::new(points.iter().map(|&p| p.into()).collect()).unwrap()
    }

    fn check(f: &TransferFunction, value: f64) {
        let (expected, found) = (f.at(value), Stretches::of(f).at(value).optical(value));
        assert!(
            (expected.opacity_per_mm.min(HIGHEST_OPACITY_PER_MM) - found.opacity_per_mm).abs() < 1e-12,
            "{value}: {expected:?} {found:?}"
        );
        for i in 0..3 {
            assert!((expected.color[i] - found.color[i]).abs() < 1e-12, "{value}");
        }
    }

    #[test]
    fn stretches_are_the_function_itself() {
        let f = function(&[
            [0.0, 0.0, 0.2, 1.0, 0.2],
            [10.0, 1.0, 0.5, 0.0, 1.0],
            [10.0, 0.3, 0.3, 0.3, 0.0],
            [20.0, 0.0, 0.0, 0.0, 0.7],
        ]);
        for value in [-5.0, 0.0, 3.0, 9.999, 9.999_999_9, 10.0, 12.0, 20.0, 25.0] {
            check(&f, value);
        }
        check(&function(&[]), 1.0);
        check(&function(&[[3.0, 0.1, 0.2, 0.3, 0.4]]), 1.0);
    }

    #[test]
    fn opacity_stays_below_one_and_its_kink_is_a_knot() {
        let f = function(&[[0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0, 1.0]]);
        let stretches = Stretches::of(&f);
        assert_eq!(stretches.knots.len(), 3);
        assert!((stretches.knots[1] - HIGHEST_OPACITY_PER_MM).abs() < 1e-15);
        assert!(stretches.at(1.0).optical(1.0).opacity_per_mm <= HIGHEST_OPACITY_PER_MM);
    }

    proptest! {
        #[test]
        fn what_the_function_shows_is_not_skipped(
            values in prop::collection::vec((-10..10i32, 0..3i32), 0..6), a in -11..11i32, b in -11..11i32
        ) {
            let mut values = values;
            values.sort_by_key(|v| v.0);
            let points = values
                .iter()
                .map(|&(v, o)| [f64::from(v), 0.5, 0.5, 0.5, f64::from(o) / 3.0].into())
                .collect();
            let f = TransferFunction::new(points).unwrap();
            let (low, high) = (a.min(b), a.max(b));
            let seen = Stretches::of(&f).is_visible_within(f64::from(low), f64::from(high));
            // Opacity is linear between whole numbers here, so that quarters meet all that is seen.
            for quarter in 4 * low..=4 * high {
                let value = f64::from(quarter) / 4.0;
                prop_assert!(seen || f.at(value).opacity_per_mm == 0.0, "{value} is seen in {low}..={high}");
            }
        }
    }
}
