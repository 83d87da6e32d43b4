//! A distribution, told by a few of its numbers.

use serde::{Deserialize, Serialize};

/// Count, mean, percentiles and extremes of samples, exact: computed from all of them, not from a sketch.
/// In the unit of the samples. There is no distribution of no samples: [`Distribution::of`] gives `None`.
///
/// A percentile is the *nearest rank*: the smallest sample that at least `p` percent of the samples do not exceed. It is
/// always one of the samples; nothing is interpolated. The p99 of fewer than 100 samples is their maximum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distribution {
    /// How many samples.
    pub count: u64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Half of the samples are not above this.
    pub p50: f64,
    /// 95 % of the samples are not above this.
    pub p95: f64,
    /// 99 % of the samples are not above this.
    pub p99: f64,
    /// The largest sample.
    pub max: f64,
    /// The smallest sample.
    pub min: f64,
}

impl Distribution {
    /// The distribution of `samples`, in any order. Samples that are not finite are left out. `None` if none is left.
    #[must_use]
    pub fn of(samples: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = samples.into_iter().filter(|sample| sample.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        Some(Self {
            count: sorted.len() as u64,
            // Near the largest float64 a sum may leave the range; a mean never leaves the samples.
            mean: (sorted.iter().sum::<f64>() / sorted.len() as f64).clamp(min, max),
            p50: nearest_rank(&sorted, 50),
            p95: nearest_rank(&sorted, 95),
            p99: nearest_rank(&sorted, 99),
            max,
            min,
        })
    }

    /// As [`Distribution::of`], of whole numbers such as microseconds.
    #[must_use]
    pub fn of_whole(samples: impl IntoIterator<Item = i64>) -> Option<Self> {
        Self::of(samples.into_iter().map(|sample| sample as f64))
    }

    /// The same distribution in a unit of which `factor` make one of this; `factor` is positive. For microseconds in
    /// milliseconds: `times(1e-3)`.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            count: self.count,
            mean: self.mean * factor,
            p50: self.p50 * factor,
            p95: self.p95 * factor,
            p99: self.p99 * factor,
            max: self.max * factor,
            min: self.min * factor,
        }
    }
}

/// The nearest rank of `sorted`, which is not empty: the sample at ⌈percent · n / 100⌉, counted from 1.
pub(crate) fn nearest_rank(sorted: &[f64], percent: usize) -> f64 {
    let rank = (percent * sorted.len()).div_ceil(100);
    sorted[rank.clamp(1, sorted.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(samples: &[f64], [p50, p95, p99]: [f64; 3]) {
        let found = Distribution::of(samples.iter().copied()).unwrap();
        assert_eq!([found.p50, found.p95, found.p99], [p50, p95, p99], "of {samples:?}");
    }

    #[test]
    fn percentiles_are_nearest_ranks() {
        let up_to = |n: u32| (1..=n).map(f64::from).collect::<Vec<_>>();
        check(&up_to(100), [50.0, 95.0, 99.0]);
        check(&up_to(101), [51.0, 96.0, 100.0]);
        check(&up_to(20), [10.0, 19.0, 20.0]);
        check(&[7.0], [7.0, 7.0, 7.0]);
        // The textbook's example of the nearest rank.
        check(&[50.0, 15.0, 40.0, 20.0, 35.0], [35.0, 50.0, 50.0]);
    }

    #[test]
    fn count_mean_and_extremes_are_exact() {
        let found = Distribution::of_whole([3, -1, 10]).unwrap();
        assert_eq!((found.count, found.mean, found.min, found.max), (3, 4.0, -1.0, 10.0));
    }

    #[test]
    fn nothing_has_no_distribution() {
        assert_eq!(Distribution::of([]), None);
        assert_eq!(Distribution::of([f64::NAN, f64::INFINITY]), None);
    }
}
