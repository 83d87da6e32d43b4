//! The samples of one channel.

use crate::buffer::Buffer;
use rayon::prelude::*;

/// Samples that one task looks at.
const CHUNK: usize = 1 << 20;

/// What the samples of a channel stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelKind {
    /// A measured quantity: values between samples are interpolated.
    Intensity,
    /// A number that names a structure: it is never interpolated.
    Label,
}

/// How a sample is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoxelType {
    /// Unsigned, 8 bits.
    U8,
    /// Signed, 16 bits.
    I16,
    /// Unsigned, 16 bits.
    U16,
    /// IEEE binary32.
    F32,
    /// IEEE binary64.
    F64,
}

impl VoxelType {
    /// Bytes of one sample.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The name that files and people use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// Stored samples, x fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub enum Voxels {
    /// Unsigned, 8 bits.
    U8(Buffer<u8>),
    /// Signed, 16 bits.
    I16(Buffer<i16>),
    /// Unsigned, 16 bits.
    U16(Buffer<u16>),
    /// IEEE binary32.
    F32(Buffer<f32>),
    /// IEEE binary64: what no other type holds without loss. A picture by a graphics device is drawn from float32 of it.
    F64(Buffer<f64>),
}

impl Voxels {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How they are stored.
    #[must_use]
    pub fn voxel_type(&self) -> VoxelType {
        match self {
            Self::U8(_) => VoxelType::U8,
            Self::I16(_) => VoxelType::I16,
            Self::U16(_) => VoxelType::U16,
            Self::F32(_) => VoxelType::F32,
            Self::F64(_) => VoxelType::F64,
        }
    }

    /// The stored number at a position in memory, before slope and intercept. Panics out of range, as a slice does.
    #[must_use]
    pub fn stored(&self, at: usize) -> f64 {
        match self {
            Self::U8(v) => f64::from(v[at]),
            Self::I16(v) => f64::from(v[at]),
            Self::U16(v) => f64::from(v[at]),
            Self::F32(v) => f64::from(v[at]),
            Self::F64(v) => v[at],
        }
    }

    /// The samples as they lie in memory, native byte order.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        match self {
            Self::U8(v) => v,
            Self::I16(v) => bytemuck::cast_slice(v),
            Self::U16(v) => bytemuck::cast_slice(v),
            Self::F32(v) => bytemuck::cast_slice(v),
            Self::F64(v) => bytemuck::cast_slice(v),
        }
    }
}

/// Samples on a grid and what they mean: `value = slope · stored + intercept`.
#[derive(Clone, Debug)]
pub struct Channel {
    /// What people call it: `ct`, `pet`, `labels`.
    pub name: String,
    /// Measured or named.
    pub kind: ChannelKind,
    /// The stored samples.
    pub voxels: Voxels,
    /// Value a stored unit; finite, not 0.
    pub slope: f64,
    /// Value of a stored 0; finite.
    pub intercept: f64,
}

/// The float32 nearest to a finite number; the largest of its sign for those beyond.
#[must_use]
pub fn single(number: f64) -> f32 {
    (number as f32).clamp(f32::MIN, f32::MAX)
}

/// Samples that were replaced because they are no numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NonFiniteCount {
    /// NaN, replaced by the lowest finite sample: shown as the emptiest thing there is.
    pub nan: usize,
    /// +∞, replaced by the highest finite sample.
    pub positive_infinity: usize,
    /// -∞, replaced by the lowest finite sample.
    pub negative_infinity: usize,
}

impl NonFiniteCount {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> usize {
        self.nan + self.positive_infinity + self.negative_infinity
    }

    fn plus(self, other: Self) -> Self {
        Self {
            nan: self.nan + other.nan,
            positive_infinity: self.positive_infinity + other.positive_infinity,
            negative_infinity: self.negative_infinity + other.negative_infinity,
        }
    }
}

impl Channel {
    /// The value at a position in memory. Panics out of range, as a slice does.
    #[must_use]
    pub fn value(&self, at: usize) -> f64 {
        self.slope * self.voxels.stored(at) + self.intercept
    }

    /// Replaces samples that are NaN or infinite, and counts them. A channel without any finite sample becomes 0.
    pub fn replace_non_finite(&mut self) -> NonFiniteCount {
        match &mut self.voxels {
            Voxels::F32(samples) => replace_non_finite(samples),
            Voxels::F64(samples) => replace_non_finite(samples),
            Voxels::U8(_) | Voxels::I16(_) | Voxels::U16(_) => NonFiniteCount::default(),
        }
    }
}

/// On all cores; what is finite throughout is read once and not written.
fn replace_non_finite<T: Copy + From<f32> + Into<f64> + Send + Sync>(samples: &mut [T]) -> NonFiniteCount {
    let none = || (None, None, NonFiniteCount::default());
    // Of samples that are finite: what is compared as float64 is compared as it is.
    let pick = |a: Option<T>, b: Option<T>, is_better: fn(f64, f64) -> bool| match (a, b) {
        (Some(a), Some(b)) => Some(if is_better(b.into(), a.into()) { b } else { a }),
        (a, b) => a.or(b),
    };
    let lower = |a, b| pick(a, b, |x, y| x < y);
    let higher = |a, b| pick(a, b, |x, y| x > y);
    let (low, high, count) = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            chunk.iter().fold(none(), |(low, high, mut count), &sample| {
                let s: f64 = sample.into();
                if s.is_finite() {
                    return (lower(low, Some(sample)), higher(high, Some(sample)), count);
                }
                count.nan += usize::from(s.is_nan());
                count.positive_infinity += usize::from(s > 0.0);
                count.negative_infinity += usize::from(s < 0.0);
                (low, high, count)
            })
        })
        .reduce(none, |a, b| (lower(a.0, b.0), higher(a.1, b.1), a.2.plus(b.2)));
    if count.total() > 0 {
        let (low, high) = (low.unwrap_or(0.0.into()), high.unwrap_or(0.0.into()));
        for sample in samples.iter_mut() {
            let s: f64 = (*sample).into();
            if !s.is_finite() {
                // NaN is not above 0.
                *sample = if s > 0.0 { high } else { low };
            }
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floats(samples: &[f32]) -> Channel {
        Channel {
            name: "pet".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::F32(samples.to_vec().into()),
            slope: 1.0,
            intercept: 0.0,
        }
    }

    #[test]
    fn replaces_and_counts_what_is_no_number() {
        let mut c = floats(&[1.0, f32::NAN, -3.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN]);
        let count = c.replace_non_finite();
        assert_eq!(count, NonFiniteCount { nan: 2, positive_infinity: 1, negative_infinity: 1 });
        assert_eq!(c.voxels, Voxels::F32(vec![1.0, -3.0, -3.0, 1.0, -3.0, -3.0].into()));
    }

    #[test]
    fn of_float64_no_bit_is_lost() {
        let [low, high] = [-1.0e300 / 3.0, 1.0 + f64::EPSILON];
        let samples = vec![f64::INFINITY, low, f64::NAN, high, f64::NEG_INFINITY];
        let mut c = Channel { voxels: Voxels::F64(samples.into()), ..floats(&[]) };
        let expected = NonFiniteCount { nan: 1, positive_infinity: 1, negative_infinity: 1 };
        assert_eq!(c.replace_non_finite(), expected);
        assert_eq!(c.voxels, Voxels::F64(vec![high, low, low, high, low].into()));
        assert_eq!((c.value(3).to_bits(), c.voxels.as_bytes().len()), (high.to_bits(), 40));
    }

    #[test]
    fn nothing_but_nan_becomes_zero() {
        let mut c = floats(&[f32::NAN; 3]);
        assert_eq!(c.replace_non_finite().nan, 3);
        assert_eq!(c.voxels, Voxels::F32(vec![0.0; 3].into()));
    }
}
