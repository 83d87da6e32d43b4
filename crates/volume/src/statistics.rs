//! What the values of a channel are: range, mean, histogram, percentiles.

use crate::{Channel, Voxels};
use rayon::prelude::*;

/// Bins of a histogram.
const BINS: usize = 256;
/// Samples that one task counts.
const CHUNK: usize = 1 << 20;

/// How often values fall into equal bins from the lowest to the highest value.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Value at the lower edge of the first bin.
    pub low: f64,
    /// Value at the upper edge of the last bin.
    pub high: f64,
    /// Samples in each of the equal bins.
    pub counts: Vec<u64>,
}

/// What the values of a channel are. Values are after slope and intercept; samples that are not finite are left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Lowest value; 0 where there is no finite one.
    pub minimum: f64,
    /// Highest value; 0 where there is no finite one.
    pub maximum: f64,
    /// Mean value.
    pub mean: f64,
    /// Finite samples.
    pub count: u64,
    /// Values in 256 equal bins over the range.
    pub histogram: Histogram,
}

impl Statistics {
    /// Counts a channel, on all cores; two passes over the samples.
    #[must_use]
    pub fn of(channel: &Channel) -> Self {
        match &channel.voxels {
            Voxels::U8(v) => count(channel, v),
            Voxels::I16(v) => count(channel, v),
            Voxels::U16(v) => count(channel, v),
            Voxels::F32(v) => count(channel, v),
            Voxels::F64(v) => count(channel, v),
        }
    }

    /// The value below which `fraction` (0 to 1) of the samples lie, to within a bin of the histogram.
    #[must_use]
    pub fn percentile(&self, fraction: f64) -> f64 {
        let wanted = fraction.clamp(0.0, 1.0) * self.count as f64;
        let Histogram { low, high, counts } = &self.histogram;
        let width = (high - low) / counts.len() as f64;
        let mut below = 0.0;
        for (bin, &n) in counts.iter().enumerate() {
            let n = n as f64;
            if below + n >= wanted && n > 0.0 {
                return low + width * (bin as f64 + (wanted - below) / n);
            }
            below += n;
        }
        *high
    }
}

/// A stored sample as float64.
trait Sample: Copy + Sync {
    fn to_f64(self) -> f64;
}

macro_rules! sample {
    ($($t:ty)*) => { $(impl Sample for $t { fn to_f64(self) -> f64 { f64::from(self) } })* };
}
sample!(u8 i16 u16 f32 f64);

fn count<T: Sample>(channel: &Channel, samples: &[T]) -> Statistics {
    let (low, high, sum, number) = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            chunk
                .iter()
                .map(|s| s.to_f64())
                .filter(|s| s.is_finite())
                .fold((f64::INFINITY, f64::NEG_INFINITY, 0.0f64, 0u64), |(low, high, sum, number), s| {
                    (low.min(s), high.max(s), sum + s, number + 1)
                })
        })
        .reduce(
            || (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0),
            |a, b| (a.0.min(b.0), a.1.max(b.1), a.2 + b.2, a.3 + b.3),
        );
    if number == 0 {
        let histogram = Histogram { low: 0.0, high: 0.0, counts: vec![0; BINS] };
        return Statistics { minimum: 0.0, maximum: 0.0, mean: 0.0, count: 0, histogram };
    }
    let per_stored = if high > low { BINS as f64 / (high - low) } else { 0.0 };
    let mut counts = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut counts = vec![0u64; BINS];
            for s in chunk.iter().map(|s| s.to_f64()).filter(|s| s.is_finite()) {
                counts[(((s - low) * per_stored) as usize).min(BINS - 1)] += 1;
            }
            counts
        })
        .reduce(
            || vec![0; BINS],
            |mut a, b| {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                a
            },
        );
    let value = |stored: f64| channel.slope * stored + channel.intercept;
    let (mut minimum, mut maximum) = (value(low), value(high));
    if minimum > maximum {
        // A negative slope turns the order of values round.
        std::mem::swap(&mut minimum, &mut maximum);
        counts.reverse();
    }
    let mean = value(sum / number as f64);
    Statistics {
        minimum,
        maximum,
        mean,
        count: number,
        histogram: Histogram { low: minimum, high: maximum, counts },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ChannelKind;

    fn channel(voxels: Voxels, slope: f64, intercept: f64) -> Channel {
        Channel { name: "x".into(), kind: ChannelKind::Intensity, voxels, slope, intercept }
    }

    #[test]
    fn values_are_after_slope_and_intercept() {
        let s = Statistics::of(&channel(Voxels::I16(vec![0, 100, 200, 300].into()), 2.0, -1000.0));
        assert_eq!((s.minimum, s.maximum, s.mean, s.count), (-1000.0, -400.0, -700.0, 4));
        assert_eq!(s.histogram.counts.iter().sum::<u64>(), 4);
    }

    #[test]
    fn a_negative_slope_reverses_the_order() {
        let s = Statistics::of(&channel(Voxels::U8(vec![0, 0, 0, 255].into()), -1.0, 0.0));
        assert_eq!((s.minimum, s.maximum), (-255.0, 0.0));
        assert_eq!((s.histogram.counts[0], s.histogram.counts[255]), (1, 3));
    }

    #[test]
    fn percentiles_of_a_ramp() {
        let s = Statistics::of(&channel(Voxels::U16((0..=10_000).collect()), 1.0, 0.0));
        for p in [0.01, 0.25, 0.5, 0.99] {
            assert!((s.percentile(p) - 10_000.0 * p).abs() < 10_000.0 / 256.0, "{p}");
        }
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let s =
            Statistics::of(&channel(Voxels::F32(vec![f32::NAN, 1.0, f32::INFINITY, 3.0].into()), 1.0, 0.0));
        assert_eq!((s.minimum, s.maximum, s.mean, s.count), (1.0, 3.0, 2.0, 2));
        let none = Statistics::of(&channel(Voxels::F32(vec![f32::NAN; 5].into()), 1.0, 0.0));
        assert_eq!((none.minimum, none.maximum, none.count), (0.0, 0.0, 0));
        assert_eq!(none.percentile(0.5), 0.0);
    }

    #[test]
    fn a_constant_volume_has_one_bin() {
        let s = Statistics::of(&channel(Voxels::U8(vec![7; 10].into()), 1.0, 0.0));
        assert_eq!((s.minimum, s.maximum, s.histogram.counts[0]), (7.0, 7.0, 10));
    }
}
