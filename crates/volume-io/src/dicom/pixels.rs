//! From a frame in a file to samples in their place.

use super::codec;
use super::files::Files;
use super::object::{Fragment, Object, Pixels, damaged, unreadable};
use super::syntax::{self, Syntax};
use super::tags;
use crate::LoadError;
use crate::load::broken;
use crate::samples::ByteOrder;
use crate::source::{Part, read_full};
use crate::text::short;
use flate2::bufread::DeflateDecoder;
use std::io::{Read, Seek as _, SeekFrom};

/// Most bytes that are unpacked to reach the frames of a deflated file, each from the start: some minutes.
const MOST_UNPACKED: u128 = 64 << 30;

/// How the samples of an image are written (DICOM PS3.5, section 8).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Bits that a sample takes: 8, 16 or 32.
    pub(super) allocated: u32,
    /// Bits of them that are its number.
    pub(super) stored: u32,
    /// Bits below these.
    shift: u32,
    pub(super) signed: bool,
    /// Whether low values are meant to be bright.
    pub(super) low_is_bright: bool,
}

impl Layout {
    pub(super) fn of(file: &str, object: &Object) -> Result<Self, LoadError> {
        let wrong = |field: &str, expected: &str, found: &str| LoadError::field(file, field, expected, found);
        if object.syntax == Syntax::Unread {
            return Err(syntax::unread(file, &object.syntax_uid));
        }
        let short_of = |tag, field: &str| object.short(tag).ok_or_else(|| wrong(field, "a number", "none"));
        let samples = object.short(tags::SAMPLES_PER_PIXEL).unwrap_or(1);
        let photometric = object.top.text(tags::PHOTOMETRIC).unwrap_or_default();
        let low_is_bright = match photometric.as_str() {
            "MONOCHROME1" => true,
            "MONOCHROME2" | "" => false,
            _ => {
                let expected = "MONOCHROME1 or MONOCHROME2 (colours are not volumes)";
                return Err(wrong("Photometric Interpretation", expected, &short(&photometric)));
            }
        };
        if samples != 1 {
            return Err(wrong("Samples per Pixel", "1", &samples.to_string()));
        }
        let allocated = u32::from(short_of(tags::BITS_ALLOCATED, "Bits Allocated")?);
        if !matches!(allocated, 8 | 16 | 32) {
            return Err(wrong("Bits Allocated", "8, 16 or 32", &allocated.to_string()));
        }
        let stored = object.short(tags::BITS_STORED).map_or(allocated, u32::from);
        if !(1..=allocated).contains(&stored) {
            return Err(wrong("Bits Stored", &format!("1 to {allocated}"), &stored.to_string()));
        }
        let high = object.short(tags::HIGH_BIT).map_or(stored - 1, u32::from);
        if !(stored - 1..allocated).contains(&high) {
            return Err(wrong(
                "High Bit",
                &format!("{} to {}", stored - 1, allocated - 1),
                &high.to_string(),
            ));
        }
        Ok(Self {
            rows: short_of(tags::ROWS, "Rows")?.into(),
            columns: short_of(tags::COLUMNS, "Columns")?.into(),
            allocated,
            stored,
            shift: high + 1 - stored,
            signed: object.short(tags::PIXEL_REPRESENTATION) == Some(1),
            low_is_bright,
        })
    }

    /// Samples of a frame.
    pub(super) fn count(&self) -> usize {
        self.rows * self.columns
    }

    /// Lowest and highest number that a sample can be.
    pub(super) fn range(&self) -> [i64; 2] {
        if self.signed {
            let half = 1i64 << (self.stored - 1);
            [-half, half - 1]
        } else {
            [0, (1i64 << self.stored) - 1]
        }
    }

    /// The number in the bits of a sample.
    fn number(&self, bits: u32) -> i64 {
        let kept = i64::from(bits >> self.shift) & ((1i64 << self.stored) - 1);
        let sign = 1i64 << (self.stored - 1);
        if self.signed { (kept ^ sign) - sign } else { kept }
    }

    /// Checks that `frames` are there, before memory is taken for them.
    pub(super) fn check_data(&self, file: &str, object: &Object, frames: usize) -> Result<(), LoadError> {
        match &object.pixels {
            Some(Pixels::Native { at, length }) => {
                let expected = (self.count() * frames) as u64 * u64::from(self.allocated / 8);
                if *length < expected {
                    let (file, what) = (file.to_owned(), "pixels");
                    return Err(LoadError::Truncated { file, what, expected, found: *length });
                }
                let unpacked = frames as u128 * (u128::from(*at) + u128::from(expected) / 2);
                if object.syntax.is_deflated() && unpacked > MOST_UNPACKED {
                    let (file, what) = (file.to_owned(), "the frames of a deflated file");
                    return Err(LoadError::TooLarge {
                        file,
                        what,
                        found: unpacked,
                        allowed: MOST_UNPACKED as u64,
                    });
                }
                Ok(())
            }
            Some(Pixels::Encapsulated { offsets, fragments }) => {
                frame_fragments(offsets, fragments, frames, 0).map(drop).ok_or_else(|| {
                    let found = format!("{} pieces and {} offsets", fragments.len(), offsets.len());
                    LoadError::field(file, "pixel data", format!("pieces of {frames} frames"), &found)
                })
            }
            None => Err(LoadError::field(file, "pixel data", "such an element", "none")),
        }
    }
}

/// What samples are held as.
pub(super) trait Held: bytemuck::Pod + Send + Sync {
    /// Bits of the type, if its bytes may be read from a file as they are.
    const BITS: Option<u32>;
    /// The number, or its value; the second result is what float32 of it would lose.
    fn of(number: i64, scale: [f64; 2]) -> (Self, f64);
    /// What float32 of it would lose.
    fn lost_as_single(self) -> f64;
    /// The number in the bits of a sample that was read as it is.
    fn trimmed(self, layout: &Layout) -> Self;
    /// Between two samples.
    fn mixed(self, other: Self, part: f64) -> Self;
}

macro_rules! held {
    ($t:ty, $unsigned:ty) => {
        impl Held for $t {
            const BITS: Option<u32> = Some(<$t>::BITS);
            fn of(number: i64, _: [f64; 2]) -> (Self, f64) {
                (number as $t, 0.0)
            }
            fn lost_as_single(self) -> f64 {
                0.0
            }
            fn trimmed(self, layout: &Layout) -> Self {
                layout.number(u32::from(self as $unsigned)) as $t
            }
            fn mixed(self, other: Self, part: f64) -> Self {
                let [a, b] = [self, other].map(f64::from);
                // Rounding stays between the two.
                (a + (b - a) * part).round() as $t
            }
        }
    };
}
held!(u8, u8);
held!(i16, u16);
held!(u16, u16);

impl Held for f64 {
    const BITS: Option<u32> = None;
    fn of(number: i64, [slope, intercept]: [f64; 2]) -> (Self, f64) {
        let value = slope * number as f64 + intercept;
        (value, value.lost_as_single())
    }
    fn lost_as_single(self) -> f64 {
        (f64::from(volume::single(self)) - self).abs()
    }
    fn trimmed(self, _: &Layout) -> Self {
        self
    }
    fn mixed(self, other: Self, part: f64) -> Self {
        self + (other - self) * part
    }
}

/// One frame of one file.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub(super) object: &'a Object,
    pub(super) frame: usize,
    /// Frames of the file.
    pub(super) frames: usize,
    pub(super) layout: Layout,
    /// Slope and intercept for samples that are held as values.
    pub(super) scale: [f64; 2],
}

/// Reads a frame into its place. Gives back the largest difference between a value that is held and float32 of it.
pub(super) fn read<T: Held>(files: &Files<'_>, from: Frame<'_>, place: &mut [T]) -> Result<f64, LoadError> {
    let Frame { object, frame, layout, .. } = from;
    let mut part = files.open(object.file)?;
    match (&object.pixels, object.syntax) {
        (Some(Pixels::Encapsulated { offsets, fragments }), Syntax::Encapsulated(compressed)) => {
            let pieces = frame_fragments(offsets, fragments, from.frames, frame).unwrap_or_default();
            // The file holds all of the pieces.
            let mut data = Vec::with_capacity(pieces.iter().map(|piece| piece.length as usize).sum());
            for piece in pieces {
                part.input.seek(SeekFrom::Start(piece.at)).map_err(|e| unreadable(&part, e))?;
                let read = (&mut part).take(piece.length.into()).read_to_end(&mut data);
                read.map_err(|e| unreadable(&part, e))?;
            }
            let size = [layout.columns, layout.rows];
            let samples = codec::decode(compressed, &data, size, layout.allocated)
                .map_err(|e| damaged(&part.name, codec::name(compressed), &e))?;
            drop(data);
            let layout = Layout { shift: 0, ..layout };
            Ok(convert(&samples.bytes, samples.bytes_a_sample, ByteOrder::Little, &layout, from.scale, place))
        }
        (Some(Pixels::Native { at, .. }), syntax) => {
            let bytes = layout.count() * (layout.allocated / 8) as usize;
            let at = at + (frame * bytes) as u64;
            let order = syntax.order();
            let native = order == ByteOrder::Little && cfg!(target_endian = "little");
            if native && T::BITS == Some(layout.allocated) {
                // The bytes of the file are the samples.
                fill(&mut part, object, at, bytemuck::cast_slice_mut(place))?;
                if layout.stored < layout.allocated {
                    place.iter_mut().for_each(|sample| *sample = sample.trimmed(&layout));
                }
                return Ok(0.0);
            }
            let mut raw = vec![0; bytes];
            fill(&mut part, object, at, &mut raw)?;
            Ok(convert(&raw, (layout.allocated / 8) as usize, order, &layout, from.scale, place))
        }
        _ => Err(LoadError::field(&part.name, "pixel data", "such an element", "none")),
    }
}

/// Reads bytes at a place of the data set.
fn fill(part: &mut Part<'_>, object: &Object, at: u64, bytes: &mut [u8]) -> Result<(), LoadError> {
    let found = if object.syntax.is_deflated() {
        let file = part.name.clone();
        part.input.seek(SeekFrom::Start(object.data_set_at)).map_err(|e| unreadable(part, e))?;
        let mut unpacked = DeflateDecoder::new(&mut part.input);
        let skipped = std::io::copy(&mut (&mut unpacked).take(at), &mut std::io::sink());
        skipped
            .and_then(|_| read_full(&mut unpacked, bytes))
            .map_err(|e| broken(&file, Some("deflated data set"), e))?
    } else {
        part.input.seek(SeekFrom::Start(at)).map_err(|e| unreadable(part, e))?;
        read_full(part, bytes).map_err(|e| unreadable(part, e))?
    };
    if found < bytes.len() {
        return Err(LoadError::Truncated {
            file: part.name.clone(),
            what: "pixels",
            expected: bytes.len() as u64,
            found: found as u64,
        });
    }
    Ok(())
}

fn convert<T: Held>(
    bytes: &[u8],
    bytes_a_sample: usize,
    order: ByteOrder,
    layout: &Layout,
    scale: [f64; 2],
    place: &mut [T],
) -> f64 {
    fn each<T: Held, const N: usize>(
        bytes: &[u8],
        layout: &Layout,
        scale: [f64; 2],
        place: &mut [T],
        bits: impl Fn([u8; N]) -> u32,
    ) -> f64 {
        let mut worst = 0.0f64;
        for (place, &sample) in place.iter_mut().zip(bytes.as_chunks().0) {
            let (held, lost) = T::of(layout.number(bits(sample)), scale);
            *place = held;
            worst = worst.max(lost);
        }
        worst
    }
    match (bytes_a_sample, order) {
        (1, _) => each(bytes, layout, scale, place, |b: [u8; 1]| b[0].into()),
        (2, ByteOrder::Little) => each(bytes, layout, scale, place, |b| u16::from_le_bytes(b).into()),
        (2, ByteOrder::Big) => each(bytes, layout, scale, place, |b| u16::from_be_bytes(b).into()),
        (_, ByteOrder::Little) => each(bytes, layout, scale, place, u32::from_le_bytes),
        (_, ByteOrder::Big) => each(bytes, layout, scale, place, u32::from_be_bytes),
    }
}

/// The pieces of a frame: one each, or all of them for a single one, or as the offsets say.
fn frame_fragments<'f>(
    offsets: &[u32],
    fragments: &'f [Fragment],
    frames: usize,
    frame: usize,
) -> Option<&'f [Fragment]> {
    if frames == 1 && !fragments.is_empty() {
        return Some(fragments);
    }
    if fragments.len() == frames {
        return fragments.get(frame..=frame);
    }
    if offsets.len() != frames {
        return None;
    }
    let place = |frame: usize| {
        let offset = u64::from(*offsets.get(frame)?);
        fragments.iter().position(|f| f.offset == offset)
    };
    let end = if frame + 1 < frames { place(frame + 1)? } else { fragments.len() };
    fragments.get(place(frame)?..end)
}
