//! The sequence parameter set: what a stream says about itself before its first picture.
//!
//! It is read here, and not by the decoder library alone, because a size must be refused before memory is taken for
//! it. Read are the fields of ITU-T H.264 section 7.3.2.1.1 up to the chroma locations of annex E; a stream that
//! uses what this project never sends (interlace, more than 8 bits, other than 4:2:0, scaling lists) is refused by name.
//!
//! It is also written anew, by [`with_chroma_siting`]: openh264 says nothing of where its chroma samples lie.

use crate::bits::{BitReader, BitWriter, Truncated, escaped, unescaped};
use std::ops::Range;

/// Largest picture that is decoded, in macroblocks of 16 by 16 pixels: the limit of level 5.2 (table A-1), 4096x2304.
const MOST_MACROBLOCKS: u64 = 36_864;
/// Longest side at that level, in macroblocks: the square root of eight times the limit (section A.3.1), 8688 pixels.
const MOST_MACROBLOCKS_A_SIDE: u64 = 543;
/// Most reference pictures that any stream may ask for (section A.3.1).
const MOST_REFERENCES: u32 = 16;

/// How colours are coded, from the stream's usability information (table E-3 to E-5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColourDescription {
    /// Whether luma spans 0 to 255 rather than 16 to 235.
    pub full_range: bool,
    /// Primaries; 1 is BT.709.
    pub primaries: u8,
    /// Transfer characteristics; 1 is BT.709.
    pub transfer: u8,
    /// Matrix; 1 is BT.709.
    pub matrix: u8,
}

/// Where chroma samples lie against luma samples (figure E-1): `chroma_sample_loc_type` 0 to 5.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChromaSiting(u8);

impl ChromaSiting {
    /// Beside the left column of the two, between their rows: what a stream means that does not say.
    pub const LEFT: Self = Self(0);
    /// In the middle of the two by two pixels that share the sample. What this project sends.
    pub const CENTRE: Self = Self(1);

    /// The standard's number, 0 to 5.
    #[must_use]
    pub const fn code(self) -> u8 {
        self.0
    }
}

/// A sequence parameter set, read and checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sps {
    /// Profile: 66 is baseline, 77 main, 100 high.
    pub profile_idc: u8,
    /// The byte of constraint flags; its second bit says "constrained baseline" with profile 66.
    pub constraints: u8,
    /// Ten times the level.
    pub level_idc: u8,
    /// Width of what is shown, in pixels.
    pub width_px: u32,
    /// Height of what is shown, in pixels. What is coded is a multiple of 16.
    pub height_px: u32,
    /// Reference pictures that the decoder must keep.
    pub reference_frames: u32,
    /// How colours are coded, where the stream says so.
    pub colour: Option<ColourDescription>,
    /// Where chroma samples lie, where the stream says so; else it means [`ChromaSiting::LEFT`].
    pub chroma_siting: Option<ChromaSiting>,
}

/// Why a sequence parameter set is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpsError {
    /// It ends within a field.
    #[error("sequence parameter set is cut off after {bytes} bytes")]
    Truncated {
        /// Its length.
        bytes: usize,
    },
    /// The NAL unit is of another kind.
    #[error("NAL unit of header {header:#04x} is no sequence parameter set")]
    NotOne {
        /// The first byte.
        header: u8,
    },
    /// A profile that this project never sends.
    #[error("profile {profile_idc} is not supported, expected 66 (baseline), 77 (main) or 100 (high)")]
    Profile {
        /// The profile as sent.
        profile_idc: u8,
    },
    /// A field has a value that the standard does not allow, or that this project never sends.
    #[error("sequence parameter set has {field} = {value}, expected {expected}")]
    Field {
        /// The field's name in the standard.
        field: &'static str,
        /// Its value.
        value: u32,
        /// What would be right.
        expected: &'static str,
    },
    /// The picture is too large to be decoded here.
    #[error(
        "stream has pictures of {width_px}x{height_px} pixels, the limit is {MOST_MACROBLOCKS} macroblocks \
         (4096x2304) and 8688 pixels a side"
    )]
    TooLarge {
        /// Coded width in pixels.
        width_px: u64,
        /// Coded height in pixels.
        height_px: u64,
    },
    /// Cropping leaves nothing.
    #[error("cropping leaves nothing of {width_px}x{height_px} pixels")]
    CroppedAway {
        /// Coded width in pixels.
        width_px: u32,
        /// Coded height in pixels.
        height_px: u32,
    },
}

impl Sps {
    /// Reads a NAL unit (with its header byte, without start code).
    ///
    /// # Errors
    /// If it is no sequence parameter set, is cut off, or describes a stream that this crate does not decode. Sizes
    /// are refused beyond level 5.2: 36 864 macroblocks, which is 4096 by 2304 pixels.
    pub fn parse(nal: &[u8]) -> Result<Self, SpsError> {
        let (_, raw) = opened(nal)?;
        read(&mut BitReader::new(&raw)).map(|(sps, _)| sps).map_err(|fault| fault.of(nal))
    }

    /// The stream's name in MIME types and player APIs, such as `avc1.42C020` (RFC 6381, section 3.3).
    #[must_use]
    pub fn codec_string(&self) -> String {
        format!("avc1.{:02X}{:02X}{:02X}", self.profile_idc, self.constraints, self.level_idc)
    }
}

/// The same sequence parameter set, as a NAL unit, that says where chroma samples lie.
///
/// # Errors
/// As [`Sps::parse`], or if it has no usability information to say it in.
pub(crate) fn with_chroma_siting(nal: &[u8], siting: ChromaSiting) -> Result<Vec<u8>, SpsError> {
    let (header, raw) = opened(nal)?;
    let mut reader = BitReader::new(&raw);
    let (_, said) = read(&mut reader).map_err(|fault| fault.of(nal))?;
    let said = said.ok_or(SpsError::Field {
        field: "vui_parameters_present_flag",
        value: 0,
        expected: "1: usability information, in which the siting of chroma is said",
    })?;
    let mut writer = BitWriter::default();
    let copy = |writer: &mut BitWriter, range: Range<usize>| {
        range.for_each(|at| writer.bit(raw[at / 8] >> (7 - at % 8) & 1 == 1));
    };
    copy(&mut writer, 0..said.start);
    writer.bit(true);
    // Of the top field and of the bottom field, which a progressive picture has too.
    writer.unsigned(siting.code().into());
    writer.unsigned(siting.code().into());
    // The rest with its stop bit, which is the last that is set: a NAL unit does not end in a zero byte.
    let end = raw
        .iter()
        .rposition(|&byte| byte != 0)
        .map_or(0, |last| 8 * (last + 1) - raw[last].trailing_zeros() as usize);
    copy(&mut writer, said.end..end);
    Ok([&[header][..], &escaped(&writer.into_bytes())].concat())
}

/// Header and raw payload of a NAL unit that is a sequence parameter set.
fn opened(nal: &[u8]) -> Result<(u8, Vec<u8>), SpsError> {
    let Some((&header, payload)) = nal.split_first() else {
        return Err(SpsError::Truncated { bytes: 0 });
    };
    if header & 0x9f != 7 {
        return Err(SpsError::NotOne { header });
    }
    Ok((header, unescaped(payload)))
}

enum Fault {
    Truncated,
    Refused(SpsError),
}

impl Fault {
    fn of(self, nal: &[u8]) -> SpsError {
        match self {
            Self::Truncated => SpsError::Truncated { bytes: nal.len() },
            Self::Refused(error) => error,
        }
    }
}

impl From<Truncated> for Fault {
    fn from(Truncated: Truncated) -> Self {
        Self::Truncated
    }
}

fn expect(field: &'static str, value: u32, allowed: bool, expected: &'static str) -> Result<u32, Fault> {
    if allowed { Ok(value) } else { Err(Fault::Refused(SpsError::Field { field, value, expected })) }
}

/// The set, and the bits in which it says where chroma lies: one that is 0, or 1 and two codes. `None` where it has no
/// usability information.
fn read(reader: &mut BitReader<'_>) -> Result<(Sps, Option<Range<usize>>), Fault> {
    let profile_idc = reader.bits(8)? as u8;
    let constraints = reader.bits(8)? as u8;
    let level_idc = reader.bits(8)? as u8;
    let id = reader.unsigned()?;
    expect("seq_parameter_set_id", id, id <= 31, "at most 31")?;
    match profile_idc {
        66 | 77 => {}
        100 => read_high_profile(reader)?,
        _ => return Err(Fault::Refused(SpsError::Profile { profile_idc })),
    }
    let frame_number_bits = reader.unsigned()?;
    expect("log2_max_frame_num_minus4", frame_number_bits, frame_number_bits <= 12, "at most 12")?;
    read_order_count(reader)?;
    let reference_frames = reader.unsigned()?;
    expect("max_num_ref_frames", reference_frames, reference_frames <= MOST_REFERENCES, "at most 16")?;
    let _gaps_in_frame_num_value_allowed = reader.bit()?;
    let (width_px, height_px) = read_size(reader)?;
    let (mut colour, mut chroma_siting, mut said) = (None, None, None);
    if reader.bit()? {
        colour = read_colour(reader)?;
        let begin = reader.position_bits();
        chroma_siting = read_siting(reader)?;
        said = Some(begin..reader.position_bits());
    }
    let sps = Sps {
        profile_idc,
        constraints,
        level_idc,
        width_px,
        height_px,
        reference_frames,
        colour,
        chroma_siting,
    };
    Ok((sps, said))
}

fn read_high_profile(reader: &mut BitReader<'_>) -> Result<(), Fault> {
    let chroma = reader.unsigned()?;
    expect("chroma_format_idc", chroma, chroma == 1, "1 (4:2:0)")?;
    for field in ["bit_depth_luma_minus8", "bit_depth_chroma_minus8"] {
        let depth = reader.unsigned()?;
        expect(field, depth, depth == 0, "0 (8 bit)")?;
    }
    for field in ["qpprime_y_zero_transform_bypass_flag", "seq_scaling_matrix_present_flag"] {
        let flag = u32::from(reader.bit()?);
        expect(field, flag, flag == 0, "0")?;
    }
    Ok(())
}

fn read_order_count(reader: &mut BitReader<'_>) -> Result<(), Fault> {
    let kind = reader.unsigned()?;
    expect("pic_order_cnt_type", kind, kind <= 2, "0, 1 or 2")?;
    if kind == 0 {
        let bits = reader.unsigned()?;
        expect("log2_max_pic_order_cnt_lsb_minus4", bits, bits <= 12, "at most 12")?;
    } else if kind == 1 {
        let _delta_pic_order_always_zero = reader.bit()?;
        let _offset_for_non_ref_pic = reader.signed()?;
        let _offset_for_top_to_bottom_field = reader.signed()?;
        let cycle = reader.unsigned()?;
        expect("num_ref_frames_in_pic_order_cnt_cycle", cycle, cycle <= 255, "at most 255")?;
        for _ in 0..cycle {
            reader.signed()?;
        }
    }
    Ok(())
}

/// Width and height of what is shown, in pixels.
fn read_size(reader: &mut BitReader<'_>) -> Result<(u32, u32), Fault> {
    let wide = u64::from(reader.unsigned()?) + 1;
    let high = u64::from(reader.unsigned()?) + 1;
    let frames_only = u32::from(reader.bit()?);
    expect("frame_mbs_only_flag", frames_only, frames_only == 1, "1 (progressive)")?;
    // 2^32 by 2^32 macroblocks would overflow the product: the sides are looked at first.
    if wide > MOST_MACROBLOCKS_A_SIDE || high > MOST_MACROBLOCKS_A_SIDE || wide * high > MOST_MACROBLOCKS {
        return Err(Fault::Refused(SpsError::TooLarge { width_px: 16 * wide, height_px: 16 * high }));
    }
    let (width_px, height_px) = (16 * wide as u32, 16 * high as u32);
    let _direct_8x8_inference = reader.bit()?;
    let mut cropped = [0u64; 4];
    if reader.bit()? {
        for edge in &mut cropped {
            // In units of one chroma sample, which is two pixels either way.
            *edge = 2 * u64::from(reader.unsigned()?);
        }
    }
    let [left, right, top, bottom] = cropped;
    if left + right >= u64::from(width_px) || top + bottom >= u64::from(height_px) {
        return Err(Fault::Refused(SpsError::CroppedAway { width_px, height_px }));
    }
    Ok((width_px - (left + right) as u32, height_px - (top + bottom) as u32))
}

/// The beginning of the usability information, up to the colour description.
fn read_colour(reader: &mut BitReader<'_>) -> Result<Option<ColourDescription>, Fault> {
    const EXTENDED_ASPECT_RATIO: u32 = 255;
    if reader.bit()? && reader.bits(8)? == EXTENDED_ASPECT_RATIO {
        let _width_and_height = reader.bits(32)?;
    }
    if reader.bit()? {
        let _overscan_appropriate = reader.bit()?;
    }
    if !reader.bit()? {
        return Ok(None);
    }
    let _video_format = reader.bits(3)?;
    let full_range = reader.bit()?;
    if !reader.bit()? {
        return Ok(None);
    }
    let mut code = || reader.bits(8).map(|code| code as u8);
    Ok(Some(ColourDescription { full_range, primaries: code()?, transfer: code()?, matrix: code()? }))
}

/// What follows the colour description, which is as far as it is read. Of a progressive picture the two fields lie alike.
fn read_siting(reader: &mut BitReader<'_>) -> Result<Option<ChromaSiting>, Fault> {
    if !reader.bit()? {
        return Ok(None);
    }
    let [top, _bottom] = [reader.unsigned()?, reader.unsigned()?];
    expect("chroma_sample_loc_type_top_field", top, top <= 5, "at most 5")?;
    Ok(Some(ChromaSiting(top as u8)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A sequence parameter set, field by field.
    #[derive(Default)]
    struct Written(BitWriter);

    impl Written {
        fn bits(mut self, count: u32, value: u32) -> Self {
            self.0.bits(count, value.into());
            self
        }

        fn unsigned(mut self, value: u32) -> Self {
            self.0.unsigned(value);
            self
        }

        /// A NAL unit with header, stop bit and emulation prevention.
        fn nal(mut self) -> Vec<u8> {
            self.0.bit(true);
            [&[0x67][..], &escaped(&self.0.into_bytes())].concat()
        }
    }

    /// Baseline, level 3.2, order count type 2, one reference frame, then the given size in macroblocks.
    fn up_to_size(wide: u32, high: u32) -> Written {
        Written::default()
            .bits(24, 0x42_c0_20)
            .unsigned(0)
            .unsigned(11)
            .unsigned(2)
            .unsigned(1)
            .bits(1, 0)
            .unsigned(wide - 1)
            .unsigned(high - 1)
            .bits(2, 0b11)
    }

    #[test]
    fn reads_the_size_less_its_cropping() {
        let nal =
            up_to_size(159, 45).bits(1, 1).unsigned(0).unsigned(4).unsigned(0).unsigned(0).bits(1, 0).nal();
        let sps = Sps::parse(&nal).unwrap();
        assert_eq!((sps.width_px, sps.height_px), (2536, 720));
        assert_eq!(sps.codec_string(), "avc1.42C020");
        assert_eq!(sps.colour, None);
    }

    #[test]
    fn refuses_sizes_before_any_memory_is_taken() {
        let size = |wide, high| Sps::parse(&up_to_size(wide, high).bits(2, 0).nal());
        assert!(size(256, 144).is_ok());
        assert!(matches!(size(257, 144), Err(SpsError::TooLarge { width_px: 4112, height_px: 2304 })));
        assert!(matches!(size(544, 1), Err(SpsError::TooLarge { .. })));
        assert!(matches!(size(u32::MAX, u32::MAX), Err(SpsError::TooLarge { .. })));
    }

    #[test]
    fn refuses_a_crop_that_leaves_nothing() {
        let crop = |right| {
            let nal =
                up_to_size(2, 2).bits(1, 1).unsigned(0).unsigned(right).unsigned(0).unsigned(0).bits(1, 0);
            Sps::parse(&nal.nal())
        };
        assert_eq!(crop(15).unwrap().width_px, 2);
        assert!(matches!(crop(16), Err(SpsError::CroppedAway { width_px: 32, height_px: 32 })));
        assert!(matches!(crop(u32::MAX - 1), Err(SpsError::CroppedAway { .. })));
    }

    #[test]
    fn refuses_what_is_never_sent() {
        assert!(matches!(
            Sps::parse(&Written::default().bits(24, 0xf4_00_20).unsigned(0).nal()),
            Err(SpsError::Profile { profile_idc: 244 })
        ));
        let ten_bit = Written::default().bits(24, 0x64_00_20).unsigned(0).unsigned(1).unsigned(2).nal();
        let error = Sps::parse(&ten_bit).unwrap_err();
        assert_eq!(
            error.to_string(),
            "sequence parameter set has bit_depth_luma_minus8 = 2, expected 0 (8 bit)"
        );
        assert_eq!(Sps::parse(&[0x68, 1]), Err(SpsError::NotOne { header: 0x68 }));
        assert_eq!(Sps::parse(&[]), Err(SpsError::Truncated { bytes: 0 }));
    }

    #[test]
    fn every_truncation_is_an_error() {
        let nal = up_to_size(40, 12).bits(1, 0).bits(1, 0).nal();
        assert!(Sps::parse(&nal).is_ok());
        for length in 0..nal.len() - 1 {
            assert!(Sps::parse(&nal[..length]).is_err(), "{length} of {} bytes", nal.len());
        }
    }

    /// BT.709 in limited range, then what is said of chroma, then `rest` bits of ones.
    fn with_usability(siting: impl FnOnce(Written) -> Written, rest: u32) -> Vec<u8> {
        let colour = up_to_size(40, 12).bits(1, 0).bits(1, 1).bits(2, 0).bits(1, 1).bits(5, 0b1_0101);
        siting(colour.bits(24, 0x01_01_01)).bits(rest, u32::MAX).nal()
    }

    #[test]
    fn the_siting_of_chroma_is_written_and_nothing_else_changes() {
        for rest in 0..32 {
            let said = |code| with_usability(|s: Written| s.bits(1, 1).unsigned(code).unsigned(code), rest);
            let unsaid = with_usability(|s| s.bits(1, 0), rest);
            assert_eq!(Sps::parse(&unsaid).unwrap().chroma_siting, None);
            assert_eq!(with_chroma_siting(&unsaid, ChromaSiting::CENTRE).unwrap(), said(1), "{rest}");
            assert_eq!(with_chroma_siting(&unsaid, ChromaSiting::LEFT).unwrap(), said(0), "{rest}");
            // What is said already is said anew, not twice.
            assert_eq!(with_chroma_siting(&said(5), ChromaSiting::CENTRE).unwrap(), said(1), "{rest}");
            assert_eq!(Sps::parse(&said(1)).unwrap().chroma_siting, Some(ChromaSiting::CENTRE));
        }
    }

    #[test]
    fn where_nothing_can_be_said_of_chroma_it_is_refused() {
        let without = up_to_size(40, 12).bits(2, 0).nal();
        let error = with_chroma_siting(&without, ChromaSiting::CENTRE).unwrap_err();
        assert!(error.to_string().contains("vui_parameters_present_flag = 0"), "{error}");
        let absurd = with_usability(|s| s.bits(1, 1).unsigned(6).unsigned(6), 3);
        assert!(matches!(Sps::parse(&absurd), Err(SpsError::Field { value: 6, .. })));
        assert!(with_chroma_siting(&[0x68, 1], ChromaSiting::CENTRE).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(0u8.., 0..80)) {
            let mut nal = vec![0x67, 66];
            nal.extend(bytes);
            if let Ok(sps) = Sps::parse(&nal) {
                prop_assert!(sps.width_px > 0 && sps.height_px > 0 && sps.width_px <= 8688);
            }
            if let Ok(written) = with_chroma_siting(&nal, ChromaSiting::CENTRE) {
                let expected = Sps { chroma_siting: Some(ChromaSiting::CENTRE), ..Sps::parse(&nal).unwrap() };
                prop_assert_eq!(Sps::parse(&written), Ok(expected));
            }
        }
    }
}
