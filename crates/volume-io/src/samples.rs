//! Samples as they stand in a file, read as a stream straight into the type that holds them.
//!
//! uint8, int16, uint16 and float32 stay what they are. Other integers become the first of int16, uint16, float32 and
//! float64 that holds all of them without loss, float64 the first of the last two. Only integers beyond 2^53 are rounded.

use crate::source::read_full;
use crate::{LoadError, LoadOptions, load::broken};
use std::io::Read;
use volume::{Buffer, Voxels, single};

/// Bytes that are read and converted at a time: small enough for a core's cache. A multiple of every sample's size.
const CHUNK: usize = 256 << 10;
/// Chunks between two calls of the progress callback: 16 MiB.
const CHUNKS_A_CALL: usize = 64;
/// Samples that are widened before the memory of the narrow ones is given back: 8 MiB of them.
const WIDENED_AT_ONCE: usize = 4 << 20;
/// Largest finite float64 that is taken for a number: with any slope, and summed up over any volume, it stays finite.
const LARGEST: f64 = 1.0e150;

/// Types of samples in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StoredType {
    U8,
    I8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl StoredType {
    /// Bytes of a sample in the file.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Fewest bytes that a sample takes in memory.
    pub(crate) fn held_bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F32 | Self::F64 => 4,
            _ => 2,
        }
    }

    /// The name that files and people use.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::I64 => "int64",
            Self::U64 => "uint64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// Order of the bytes of a number in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    Little,
    Big,
}

/// A run of samples in a file.
pub(crate) struct Run<'a> {
    /// The file, for messages.
    pub(crate) file: &'a str,
    pub(crate) stored: StoredType,
    pub(crate) order: ByteOrder,
    /// Samples that the header promises; their bytes are known not to overflow.
    pub(crate) count: usize,
    /// Bytes that the data may hold at most, however the header lies: memory is taken for no more.
    pub(crate) holds_at_most: u64,
    /// What the data are unpacked from on the way, such as `gzip data`.
    pub(crate) packed: Option<&'static str>,
}

/// Samples as they are held, and what was lost on the way.
#[derive(Debug)]
pub(crate) struct Samples {
    pub(crate) voxels: Voxels,
    /// Largest difference between a finite stored number and the one that is held.
    pub(crate) worst_rounding: f64,
    /// Largest difference between a number that is held and the float32 that a device draws from.
    pub(crate) worst_as_single: f64,
    /// Finite numbers that were too large and became infinite.
    pub(crate) overflowed: usize,
}

impl Samples {
    fn exact(voxels: Voxels) -> Self {
        Self { voxels, worst_rounding: 0.0, worst_as_single: 0.0, overflowed: 0 }
    }

    /// Says what became of the samples of the file; `slope` is the value of one of their units.
    pub(crate) fn note(&self, stored: StoredType, slope: f64, notes: &mut Vec<String>) {
        let (stored, held_as) = (stored.name(), self.voxels.voxel_type().name());
        if self.worst_rounding > 0.0 {
            let rounding = self.worst_rounding * slope.abs();
            notes.push(format!(
                "{stored} in the file, held as {held_as}: values are rounded by at most {rounding:.3e}"
            ));
        } else if stored != held_as {
            notes.push(format!("{stored} in the file, held as {held_as} without loss"));
        }
        notes.extend(drawn_in_single(&self.voxels, self.worst_as_single * slope.abs()));
        if self.overflowed > 0 {
            notes.push(format!("{} values are beyond {LARGEST:e} and count as infinite", self.overflowed));
        }
    }
}

/// What a device loses of float64, for people.
pub(crate) fn drawn_in_single(voxels: &Voxels, rounding: f64) -> Option<String> {
    matches!(voxels, Voxels::F64(_)).then(|| {
        format!(
            "values are float64; a graphics device draws from float32 of them, off by at most {rounding:.3e}"
        )
    })
}

/// Reads a run of samples.
pub(crate) fn read(
    reader: &mut impl Read,
    run: &Run<'_>,
    options: &LoadOptions,
) -> Result<Samples, LoadError> {
    macro_rules! kept {
        ($held:ident, $t:ty) => {
            match run.order {
                ByteOrder::Little => kept(reader, run, options, <$t>::from_le_bytes),
                ByteOrder::Big => kept(reader, run, options, <$t>::from_be_bytes),
            }
            .map(|v| Samples::exact(Voxels::$held(v)))
        };
    }
    macro_rules! integers {
        ($t:ty) => {
            match run.order {
                ByteOrder::Little => integers(reader, run, options, <$t>::from_le_bytes),
                ByteOrder::Big => integers(reader, run, options, <$t>::from_be_bytes),
            }
        };
    }
    match run.stored {
        StoredType::U8 => kept!(U8, u8),
        StoredType::I16 => kept!(I16, i16),
        StoredType::U16 => kept!(U16, u16),
        StoredType::F32 => kept!(F32, f32),
        StoredType::I8 => integers!(i8),
        StoredType::I32 => integers!(i32),
        StoredType::U32 => integers!(u32),
        StoredType::I64 => integers!(i64),
        StoredType::U64 => integers!(u64),
        StoredType::F64 => match run.order {
            ByteOrder::Little => doubles(reader, run, options, f64::from_le_bytes),
            ByteOrder::Big => doubles(reader, run, options, f64::from_be_bytes),
        },
    }
}

/// Samples that are held as they are stored.
fn kept<T: bytemuck::Pod, const N: usize>(
    reader: &mut impl Read,
    run: &Run<'_>,
    options: &LoadOptions,
    decode: impl Fn([u8; N]) -> T,
) -> Result<Buffer<T>, LoadError> {
    let mut samples = zeroed_buffer(run.file, fitting(run))?;
    let mut filled = 0;
    each_chunk(reader, run, options, |bytes| {
        let stored = bytes.as_chunks().0;
        // There is room for as many as the data may hold, and no more than that can have been read.
        for (sample, &bytes) in samples[filled..].iter_mut().zip(stored) {
            *sample = decode(bytes);
        }
        filled += stored.len();
        Ok(())
    })?;
    Ok(samples)
}

/// float64, held as float32 as long as that keeps every bit.
fn doubles(
    reader: &mut impl Read,
    run: &Run<'_>,
    options: &LoadOptions,
    decode: impl Fn([u8; 8]) -> f64,
) -> Result<Samples, LoadError> {
    let mut held = Narrowest::F32(reserve(run)?);
    let mut scratch = Vec::with_capacity(CHUNK / 8);
    let (mut worst_as_single, mut overflowed) = (0.0f64, 0);
    each_chunk(reader, run, options, |bytes| {
        scratch.clear();
        scratch.extend(bytes.as_chunks().0.iter().map(|&b| {
            let number = decode(b);
            if number.is_finite() && number.abs() > LARGEST {
                overflowed += 1;
                return number.signum() * f64::INFINITY;
            }
            number
        }));
        // What is no number is none in float32 either.
        let fits_f32 = |number: &f64| number.is_nan() || f64::from(*number as f32) == *number;
        held = match std::mem::replace(&mut held, Narrowest::I16(Vec::new())) {
            Narrowest::F32(v) if !scratch.iter().all(fits_f32) => Narrowest::F64(widened(v, run, options)?),
            fits => fits,
        };
        match &mut held {
            Narrowest::F64(v) => {
                let lost =
                    scratch.iter().filter(|n| n.is_finite()).map(|&n| (f64::from(single(n)) - n).abs());
                worst_as_single = lost.fold(worst_as_single, f64::max);
                v.extend(&scratch);
            }
            Narrowest::F32(v) => v.extend(scratch.iter().map(|&n| n as f32)),
            Narrowest::I16(_) | Narrowest::U16(_) => {}
        }
        Ok(())
    })?;
    Ok(Samples { voxels: held.into(), worst_rounding: 0.0, worst_as_single, overflowed })
}

/// Integers of other sizes, held as the narrowest of int16, uint16, float32 and float64 that takes all of them.
fn integers<T: Integer, const N: usize>(
    reader: &mut impl Read,
    run: &Run<'_>,
    options: &LoadOptions,
    decode: impl Fn([u8; N]) -> T,
) -> Result<Samples, LoadError> {
    let mut held = Narrowest::I16(reserve(run)?);
    let mut scratch: Vec<T> = Vec::with_capacity(CHUNK / N);
    let mut negative = false;
    let (mut worst_rounding, mut worst_as_single) = (0.0f64, 0.0f64);
    each_chunk(reader, run, options, |bytes| {
        scratch.clear();
        scratch.extend(bytes.as_chunks().0.iter().map(|&b| decode(b)));
        let Some((&low, &high)) = scratch.iter().min().zip(scratch.iter().max()) else { return Ok(()) };
        negative |= low < T::default();
        let fit_f32 = || scratch.iter().all(|s| s.fits_f32());
        held = match std::mem::replace(&mut held, Narrowest::I16(Vec::new())) {
            Narrowest::I16(v) if !(low.fits_i16() && high.fits_i16()) => {
                if negative || !high.fits_u16() {
                    Narrowest::float(v, fit_f32(), run, options)?
                } else {
                    // No sample was negative: the same bits, and no copy.
                    Narrowest::U16(bytemuck::allocation::cast_vec(v))
                }
            }
            Narrowest::U16(v) if !(low.fits_u16() && high.fits_u16()) => {
                Narrowest::float(v, fit_f32(), run, options)?
            }
            Narrowest::F32(v) if !fit_f32() => Narrowest::F64(widened(v, run, options)?),
            fits => fits,
        };
        match &mut held {
            Narrowest::I16(v) => v.extend(scratch.iter().map(|s| s.as_i16())),
            Narrowest::U16(v) => v.extend(scratch.iter().map(|s| s.as_u16())),
            Narrowest::F32(v) => v.extend(scratch.iter().map(|s| s.as_f64() as f32)),
            Narrowest::F64(v) => v.extend(scratch.iter().map(|s| {
                let number = s.as_f64();
                worst_rounding = worst_rounding.max(s.rounding_as_f64());
                worst_as_single = worst_as_single.max((f64::from(single(number)) - number).abs());
                number
            })),
        }
        Ok(())
    })?;
    Ok(Samples { voxels: held.into(), worst_rounding, worst_as_single, overflowed: 0 })
}

/// Samples read so far, in the narrowest type that has been enough for them.
enum Narrowest {
    I16(Vec<i16>),
    U16(Vec<u16>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Narrowest {
    /// The same numbers as float32 if that is enough for what comes, else as float64.
    fn float<T: Copy + Into<f32> + Into<f64>>(
        narrow: Vec<T>,
        fit_f32: bool,
        run: &Run<'_>,
        options: &LoadOptions,
    ) -> Result<Self, LoadError> {
        Ok(if fit_f32 {
            Self::F32(widened(narrow, run, options)?)
        } else {
            Self::F64(widened(narrow, run, options)?)
        })
    }
}

impl From<Narrowest> for Voxels {
    fn from(narrowest: Narrowest) -> Self {
        match narrowest {
            Narrowest::I16(v) => Self::I16(v.into()),
            Narrowest::U16(v) => Self::U16(v.into()),
            Narrowest::F32(v) => Self::F32(v.into()),
            Narrowest::F64(v) => Self::F64(v.into()),
        }
    }
}

/// The same numbers in a wider type. Works from the end and gives the narrow ones back as it goes, so that both are never
/// there in full. There is room for all that are to come.
fn widened<T: Copy + Into<W>, W: bytemuck::Zeroable>(
    mut narrow: Vec<T>,
    run: &Run<'_>,
    options: &LoadOptions,
) -> Result<Vec<W>, LoadError> {
    options.check_size(run.file, run.count as u128 * size_of::<W>() as u128)?;
    // Zeroed by the system: its pages are not taken before they are written.
    let mut wide = zeroed::<W>(run.file, fitting(run))?;
    wide.truncate(narrow.len());
    while !narrow.is_empty() {
        let start = narrow.len().saturating_sub(WIDENED_AT_ONCE);
        for (wide, &narrow) in wide[start..].iter_mut().zip(&narrow[start..]) {
            *wide = narrow.into();
        }
        narrow.truncate(start);
        narrow.shrink_to_fit();
    }
    Ok(wide)
}

/// Hands the run's bytes to `take`, a chunk of whole samples at a time.
fn each_chunk(
    reader: &mut impl Read,
    run: &Run<'_>,
    options: &LoadOptions,
    mut take: impl FnMut(&[u8]) -> Result<(), LoadError>,
) -> Result<(), LoadError> {
    let total = run.count as u64 * run.stored.bytes() as u64;
    let mut buffer = vec![0; CHUNK];
    let (mut done, mut chunks) = (0, 0);
    while done < total {
        let wanted = (total - done).min(CHUNK as u64) as usize;
        let chunk = &mut buffer[..wanted];
        let found = read_full(reader, chunk).map_err(|e| broken(run.file, run.packed, e))?;
        if found < wanted {
            let found = done + found as u64;
            return Err(LoadError::Truncated {
                file: run.file.to_owned(),
                what: "voxels",
                expected: total,
                found,
            });
        }
        take(chunk)?;
        done += wanted as u64;
        chunks += 1;
        if chunks % CHUNKS_A_CALL == 0 || done == total {
            options.progressed((done as f64 / total as f64) as f32);
        }
    }
    Ok(())
}

/// Samples that the header promises and the data may hold.
fn fitting(run: &Run<'_>) -> usize {
    let may_hold = run.holds_at_most / run.stored.bytes() as u64;
    run.count.min(usize::try_from(may_hold).unwrap_or(usize::MAX))
}

/// Room for the samples. Pages are taken as they are written.
fn reserve<T>(run: &Run<'_>) -> Result<Vec<T>, LoadError> {
    let mut samples = Vec::new();
    samples.try_reserve_exact(fitting(run)).map_err(|_| no_memory::<T>(run.file, fitting(run)))?;
    Ok(samples)
}

/// Zeros that take no pages until they are written.
pub(crate) fn zeroed<T: bytemuck::Zeroable>(file: &str, count: usize) -> Result<Vec<T>, LoadError> {
    bytemuck::allocation::try_zeroed_vec(count).map_err(|()| no_memory::<T>(file, count))
}

/// Zeros for a whole volume.
pub(crate) fn zeroed_buffer<T: bytemuck::Pod>(file: &str, count: usize) -> Result<Buffer<T>, LoadError> {
    Buffer::zeroed(count).map_err(|_| no_memory::<T>(file, count))
}

fn no_memory<T>(file: &str, count: usize) -> LoadError {
    LoadError::NoMemory { file: file.to_owned(), bytes: count as u64 * size_of::<T>() as u64 }
}

/// An integer that may fit a narrower type.
trait Integer: Copy + Ord + Default {
    fn fits_i16(self) -> bool;
    fn fits_u16(self) -> bool;
    /// For those that fit.
    fn as_i16(self) -> i16;
    /// For those that fit.
    fn as_u16(self) -> u16;
    /// Whether float32 holds it without loss.
    fn fits_f32(self) -> bool;
    fn as_f64(self) -> f64;
    /// What float64 loses of it.
    fn rounding_as_f64(self) -> f64;
}

macro_rules! integer {
    ($($t:ty)*) => { $(impl Integer for $t {
        fn fits_i16(self) -> bool { i16::try_from(self).is_ok() }
        fn fits_u16(self) -> bool { u16::try_from(self).is_ok() }
        fn as_i16(self) -> i16 { self as i16 }
        fn as_u16(self) -> u16 { self as u16 }
        fn fits_f32(self) -> bool { (self as f32) as i128 == i128::from(self) }
        fn as_f64(self) -> f64 { self as f64 }
        fn rounding_as_f64(self) -> f64 {
            (i128::from(self) - (self as f64) as i128).unsigned_abs() as f64
        }
    })* };
}
integer!(i8 i32 u32 i64 u64);

#[cfg(test)]
mod tests {
    use super::*;

    fn read_all(stored: StoredType, order: ByteOrder, bytes: &[u8]) -> Samples {
        read_with(stored, order, bytes, &LoadOptions::default()).unwrap()
    }

    fn read_with(
        stored: StoredType,
        order: ByteOrder,
        bytes: &[u8],
        options: &LoadOptions,
    ) -> Result<Samples, LoadError> {
        let run = Run {
            file: "test",
            stored,
            order,
            count: bytes.len() / stored.bytes(),
            holds_at_most: bytes.len() as u64,
            packed: None,
        };
        read(&mut &bytes[..], &run, options)
    }

    fn ints(values: &[i32]) -> Samples {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        read_all(StoredType::I32, ByteOrder::Big, &bytes)
    }

    #[test]
    fn wide_integers_become_the_narrowest_that_takes_all() {
        assert_eq!(ints(&[-32768, 32767]).voxels, Voxels::I16(vec![-32768, 32767].into()));
        assert_eq!(ints(&[0, 65535, 3]).voxels, Voxels::U16(vec![0, 65535, 3].into()));
        assert_eq!(ints(&[-1, 65535]).voxels, Voxels::F32(vec![-1.0, 65535.0].into()));
        assert_eq!(ints(&[0, 65536]).voxels, Voxels::F32(vec![0.0, 65536.0].into()));
    }

    #[test]
    fn memory_is_refused_for_what_values_need_not_for_what_the_file_might_hold() {
        let read = |values: [i32; 3], max_bytes| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
            let options = LoadOptions { max_bytes, ..LoadOptions::default() };
            read_with(StoredType::I32, ByteOrder::Big, &bytes, &options)
        };
        assert!(read([0, 1, 2], 6).is_ok());
        assert!(read([0, 1 << 16, 2], 12).is_ok());
        for (values, found) in [([0, 1 << 16, 2], 12), ([0, (1 << 24) + 1, 2], 24)] {
            let Err(LoadError::TooLarge { found: told, .. }) = read(values, found - 1) else { panic!() };
            assert_eq!(told, u128::from(found));
        }
    }

    #[test]
    fn a_late_large_value_keeps_the_earlier_ones() {
        // Three chunks, so that each change of type happens after samples were stored.
        let mut values: Vec<i32> = (0..3 * (CHUNK as i32 / 4)).map(|i| i % 30_000).collect();
        values[CHUNK / 4] = 40_000;
        let as_u16: Vec<u16> = values.iter().map(|&v| v as u16).collect();
        assert_eq!(ints(&values).voxels, Voxels::U16(as_u16.into()));
        values[CHUNK / 2] = -5;
        let as_f32: Vec<f32> = values.iter().map(|&v| v as f32).collect();
        assert_eq!(ints(&values).voxels, Voxels::F32(as_f32.into()));
        values[0] = -7;
        let as_f32: Vec<f32> = values.iter().map(|&v| v as f32).collect();
        assert_eq!(ints(&values).voxels, Voxels::F32(as_f32.into()));
        values[CHUNK / 2 + 9] = i32::MAX;
        assert_eq!(ints(&values).voxels, Voxels::F64(values.iter().map(|&v| v.into()).collect()));
        values[CHUNK / 2] = 0;
        values[0] = 7;
        assert_eq!(ints(&values).voxels, Voxels::F64(values.iter().map(|&v| v.into()).collect()));
    }

    #[test]
    fn widening_many_steps_keeps_the_order() {
        let run = Run {
            file: "test",
            stored: StoredType::I32,
            order: ByteOrder::Little,
            count: 2 * WIDENED_AT_ONCE + 17,
            holds_at_most: u64::MAX,
            packed: None,
        };
        let narrow: Vec<i16> = (0..run.count).map(|i| (i % 30_011) as i16).collect();
        let wide: Vec<f32> = widened(narrow, &run, &LoadOptions::default()).unwrap();
        assert_eq!(wide.len(), run.count);
        assert!(wide.iter().enumerate().all(|(i, &w)| w == (i % 30_011) as f32));
    }

    #[test]
    fn what_float32_would_lose_is_held_as_float64() {
        let held = |stored, bytes: &[u8]| read_all(stored, ByteOrder::Little, bytes);
        assert_eq!(
            ints(&[1 << 24, -(1 << 24)]).voxels,
            Voxels::F32(vec![16_777_216.0, -16_777_216.0].into())
        );
        let odd = ints(&[(1 << 24) + 1, i32::MIN]);
        assert_eq!(odd.voxels, Voxels::F64(vec![16_777_217.0, -2_147_483_648.0].into()));
        assert_eq!((odd.worst_rounding, odd.worst_as_single), (0.0, 1.0));
        let beyond = held(StoredType::U64, &u64::MAX.to_le_bytes());
        assert_eq!((beyond.worst_rounding, beyond.worst_as_single), (1.0, 0.0));
        let third = held(StoredType::F64, &(1.0f64 / 3.0).to_le_bytes());
        assert_eq!(third.voxels, Voxels::F64(vec![1.0 / 3.0].into()));
        assert_eq!(third.worst_as_single, (f64::from(1.0f32 / 3.0) - 1.0 / 3.0).abs());
        let large = held(StoredType::F64, &1e100f64.to_le_bytes());
        assert_eq!((large.voxels, large.overflowed), (Voxels::F64(vec![1e100].into()), 0));
        let huge = held(StoredType::F64, &(-1e300f64).to_le_bytes());
        assert_eq!((huge.voxels, huge.overflowed), (Voxels::F32(vec![f32::NEG_INFINITY].into()), 1));
    }

    #[test]
    fn a_late_float64_keeps_the_earlier_ones() {
        // In the second chunk, after what is no number.
        let mut values: Vec<f64> = (0..CHUNK / 4).map(|i| i as f64 / 8.0).collect();
        values[3] = f64::INFINITY;
        let bytes = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let single = read_all(StoredType::F64, ByteOrder::Little, &bytes(&values)).voxels;
        assert_eq!(single, Voxels::F32(values.iter().map(|&v| v as f32).collect()));
        values[CHUNK / 8 + 7] = 0.1;
        let double = read_all(StoredType::F64, ByteOrder::Little, &bytes(&values)).voxels;
        assert_eq!(double, Voxels::F64(values.into()));
    }

    #[test]
    fn both_byte_orders_of_each_type() {
        fn check(stored: StoredType, big: &[u8], expected: &Voxels) {
            let little: Vec<u8> = big.chunks(stored.bytes()).flat_map(|c| c.iter().rev().copied()).collect();
            assert_eq!(read_all(stored, ByteOrder::Big, big).voxels, *expected);
            assert_eq!(read_all(stored, ByteOrder::Little, &little).voxels, *expected);
        }
        check(StoredType::U8, &[1, 255], &Voxels::U8(vec![1, 255].into()));
        check(StoredType::I8, &[1, 255], &Voxels::I16(vec![1, -1].into()));
        check(StoredType::I16, &[1, 2, 255, 254], &Voxels::I16(vec![258, -2].into()));
        check(StoredType::U16, &[1, 2, 255, 254], &Voxels::U16(vec![258, 65534].into()));
        check(StoredType::I32, &(-5i32).to_be_bytes(), &Voxels::I16(vec![-5].into()));
        check(StoredType::U32, &5u32.to_be_bytes(), &Voxels::I16(vec![5].into()));
        check(StoredType::I64, &(-5i64).to_be_bytes(), &Voxels::I16(vec![-5].into()));
        check(StoredType::U64, &5u64.to_be_bytes(), &Voxels::I16(vec![5].into()));
        check(StoredType::F32, &1.5f32.to_be_bytes(), &Voxels::F32(vec![1.5].into()));
        check(StoredType::F64, &1.5f64.to_be_bytes(), &Voxels::F32(vec![1.5].into()));
    }

    #[test]
    fn a_short_run_says_how_much_was_there() {
        let run = Run {
            file: "short",
            stored: StoredType::I16,
            order: ByteOrder::Little,
            count: usize::MAX / 4,
            holds_at_most: 7,
            packed: None,
        };
        let error = read(&mut &[0u8; 7][..], &run, &LoadOptions::default()).unwrap_err();
        assert!(matches!(error, LoadError::Truncated { found: 7, .. }), "{error}");
    }
}
