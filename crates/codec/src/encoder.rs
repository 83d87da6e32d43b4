//! Pictures in, access units out.

use crate::nal::{NalKind, kind, nal_ranges};
use crate::sps::{ChromaSiting, with_chroma_siting};
use crate::{AccessUnit, ParameterSetError, ParameterSets, YuvFrame};
use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, Profile, QpRange, RateControlMode,
    SpsPpsStrategy, TransferCharacteristics, UsageType, VuiConfig,
};
use openh264::formats::YUVSource;
use openh264_sys2::{
    ENCODER_OPTION, ENCODER_OPTION_BITRATE, ENCODER_OPTION_FRAME_RATE, ENCODER_OPTION_MAX_BITRATE,
    ENCODER_OPTION_TRACE_LEVEL, SBitrateInfo, SPATIAL_LAYER_0, SPATIAL_LAYER_ALL, WELS_LOG_QUIET,
};
use std::ffi::c_int;

/// Shortest side that openh264 encodes, in pixels.
const SHORTEST_SIDE_PX: u32 = 16;
/// Longest sides that openh264 encodes, in pixels, the longer and the shorter.
const LONGEST_SIDES_PX: [u32; 2] = [3840, 2160];
/// Within the limit of level 5.2 (288 Mbit/s), beyond which openh264 changes its mind about the level.
const BITRATE_BPS: std::ops::RangeInclusive<u32> = 10_000..=200_000_000;
/// openh264 keeps its rate by frames, so a rate outside of these has no meaning to it.
const FRAMES_PER_SECOND: std::ops::RangeInclusive<f32> = 1.0..=240.0;
/// The finest quantiser that rate control may choose is openh264's own limit. The coarsest is the standard's: by
/// default it stops at 42, and a frame that is too large is worse here than one that is too coarse.
const QUANTISER: QpRange = QpRange::new(12, 51);

/// How much work the encoder may spend on a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Complexity {
    /// Fastest.
    #[default]
    Low,
    /// Between the two.
    Medium,
    /// Best picture for the bits.
    High,
}

/// What an encoder is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderSettings {
    /// Width in pixels; even, at least 16.
    pub width_px: u32,
    /// Height in pixels; even, at least 16. Need not be a multiple of 16.
    pub height_px: u32,
    /// Frames a second that are going to be encoded: the bit rate divided by this is a frame's budget.
    pub frames_per_second: f32,
    /// Bits a second to aim at. Frames are never skipped to reach it, only coded more coarsely.
    pub bitrate_bps: u32,
    /// How much work to spend.
    pub complexity: Complexity,
}

/// Why an encoder cannot be made, or cannot be changed, as asked.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A side is odd, too short or too long.
    #[error(
        "cannot encode pictures of {width_px}x{height_px} pixels, expected even sides of at least 16 pixels, \
         at most 3840 for the longer and 2160 for the shorter"
    )]
    Size {
        /// Width as asked.
        width_px: u32,
        /// Height as asked.
        height_px: u32,
    },
    /// The frame rate is no number or out of range.
    #[error("cannot encode {frames_per_second} frames a second, expected 1 to 240")]
    FrameRate {
        /// Frames a second as asked.
        frames_per_second: f32,
    },
    /// The bit rate is out of range.
    #[error("cannot encode at {bitrate_bps} bit/s, expected 10 kbit/s to 200 Mbit/s")]
    BitRate {
        /// Bits a second as asked.
        bitrate_bps: u32,
    },
    /// openh264 refused.
    #[error("openh264 refused the settings with code {code}")]
    Library {
        /// openh264's own code.
        code: i64,
    },
}

/// Why a picture was not encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The picture has another size than the encoder was made for.
    #[error(
        "picture of {width_px}x{height_px} pixels for an encoder of {expected_width_px}x{expected_height_px}"
    )]
    Size {
        /// The picture's width.
        width_px: u32,
        /// The picture's height.
        height_px: u32,
        /// The encoder's width.
        expected_width_px: u32,
        /// The encoder's height.
        expected_height_px: u32,
    },
    /// openh264 failed. The encoder starts anew with the next picture, which is a key frame.
    #[error("openh264 failed to encode with code {code}")]
    Library {
        /// openh264's own code.
        code: i64,
    },
    /// openh264 gave no frame, although it was told never to skip one.
    #[error("openh264 skipped a frame")]
    Skipped,
    /// openh264 made a key frame whose parameter sets are missing or cannot be read.
    #[error("openh264 made a key frame that does not describe itself: {0}")]
    Undescribed(#[from] ParameterSetError),
}

/// Encodes pictures of one size. Single-threaded: encoders run side by side, not in parts.
pub struct Encoder {
    settings: EncoderSettings,
    library: openh264::encoder::Encoder,
    /// Whether the library holds a stream. Before its first picture it knows no size and takes no options.
    started: bool,
    codec_string: Option<String>,
}

impl Encoder {
    /// Makes an encoder. Its first access unit is a key frame; later ones are only if asked for.
    ///
    /// # Errors
    /// If the settings are out of the ranges that [`SettingsError`] names, or openh264 cannot be set up.
    pub fn new(settings: EncoderSettings) -> Result<Self, SettingsError> {
        check_size(settings.width_px, settings.height_px)?;
        check_frame_rate(settings.frames_per_second)?;
        check_bit_rate(settings.bitrate_bps)?;
        Ok(Self { settings, library: make(&settings)?, started: false, codec_string: None })
    }

    /// What the encoder is set to now.
    #[must_use]
    pub const fn settings(&self) -> EncoderSettings {
        self.settings
    }

    /// Encodes one picture, as a key frame if asked or if it is the stream's first.
    ///
    /// # Errors
    /// If the picture has another size, or openh264 fails.
    pub fn encode(
        &mut self,
        picture: YuvFrame<'_>,
        force_key_frame: bool,
    ) -> Result<AccessUnit, EncodeError> {
        let layout = picture.layout();
        let (width_px, height_px) = (layout.width_px(), layout.height_px());
        if (width_px, height_px) != (self.settings.width_px, self.settings.height_px) {
            return Err(EncodeError::Size {
                width_px,
                height_px,
                expected_width_px: self.settings.width_px,
                expected_height_px: self.settings.height_px,
            });
        }
        if force_key_frame && self.started {
            self.library.force_intra_frame();
        }
        let encoded = self.library.encode(&Planes(picture)).map_err(|error| error.native_code());
        let encoded = encoded.map(|stream| (stream.to_vec(), stream.frame_type()));
        let (bytes, frame_type) = match encoded {
            Ok(encoded) => encoded,
            Err(code) => {
                // After some errors the library has let go of its stream, and would fail for ever.
                self.library = make(&self.settings).map_err(|_| EncodeError::Library { code })?;
                self.started = false;
                return Err(EncodeError::Library { code });
            }
        };
        self.started = true;
        if bytes.is_empty() || matches!(frame_type, FrameType::Skip | FrameType::Invalid) {
            return Err(EncodeError::Skipped);
        }
        let key_frame = frame_type == FrameType::IDR;
        let bytes = if key_frame { sited(&bytes)? } else { bytes };
        if key_frame {
            self.codec_string = Some(ParameterSets::find(&bytes)?.sps.codec_string());
        }
        Ok(AccessUnit { bytes, key_frame })
    }

    /// Changes the bit rate from the next picture on. No key frame follows from it.
    ///
    /// # Errors
    /// If the bit rate is out of 10 kbit/s to 200 Mbit/s, or openh264 refuses it; the old one then stays.
    pub fn set_bitrate_bps(&mut self, bitrate_bps: u32) -> Result<(), SettingsError> {
        check_bit_rate(bitrate_bps)?;
        if self.started {
            let mut aim = SBitrateInfo { iLayer: SPATIAL_LAYER_ALL, iBitrate: bitrate_bps as c_int };
            let mut most = SBitrateInfo { iLayer: SPATIAL_LAYER_0, iBitrate: bitrate_bps as c_int };
            // The most may at no time be less than the aim: openh264 refuses that.
            if bitrate_bps > self.settings.bitrate_bps {
                self.set_option(ENCODER_OPTION_MAX_BITRATE, &mut most)?;
                self.set_option(ENCODER_OPTION_BITRATE, &mut aim)?;
            } else {
                self.set_option(ENCODER_OPTION_BITRATE, &mut aim)?;
                self.set_option(ENCODER_OPTION_MAX_BITRATE, &mut most)?;
            }
            self.settings.bitrate_bps = bitrate_bps;
        } else {
            self.restart_with(EncoderSettings { bitrate_bps, ..self.settings })?;
        }
        Ok(())
    }

    /// Changes the frame rate, and so each frame's share of the bit rate, from the next picture on.
    ///
    /// # Errors
    /// If the rate is out of 1 to 240 frames a second, or openh264 refuses it; the old one then stays.
    pub fn set_frames_per_second(&mut self, frames_per_second: f32) -> Result<(), SettingsError> {
        check_frame_rate(frames_per_second)?;
        if self.started {
            let mut rate = frames_per_second;
            self.set_option(ENCODER_OPTION_FRAME_RATE, &mut rate)?;
            self.settings.frames_per_second = frames_per_second;
        } else {
            self.restart_with(EncoderSettings { frames_per_second, ..self.settings })?;
        }
        Ok(())
    }

    /// The stream's name for players, such as `avc1.42C020`; known from the first key frame on.
    #[must_use]
    pub fn codec_string(&self) -> Option<&str> {
        self.codec_string.as_deref()
    }

    fn restart_with(&mut self, settings: EncoderSettings) -> Result<(), SettingsError> {
        self.library = make(&settings)?;
        self.settings = settings;
        Ok(())
    }

    fn set_option<T: OptionValue>(
        &mut self,
        option: ENCODER_OPTION,
        value: &mut T,
    ) -> Result<(), SettingsError> {
        match set_option(&mut self.library, option, value) {
            0 => Ok(()),
            code => Err(SettingsError::Library { code: i64::from(code) }),
        }
    }
}

/// The types that openh264's options used here point to. Private, so that no other type can be passed to it.
trait OptionValue {}
impl OptionValue for SBitrateInfo {}
impl OptionValue for f32 {}
impl OptionValue for c_int {}

/// Sets an option and gives the library's code, 0 for success.
#[expect(unsafe_code, reason = "openh264's safe interface has no options after the start")]
fn set_option<T: OptionValue>(
    library: &mut openh264::encoder::Encoder,
    option: ENCODER_OPTION,
    value: &mut T,
) -> c_int {
    // SAFETY: `raw_api` asks that no option be set that the wrapper relies on; it keeps no bit rate, frame rate or
    // trace level of its own between calls, only the picture size, which is not set here. `set_option` reads the
    // option's value through the pointer and keeps no pointer: `value` is borrowed, thus valid and aligned, for the
    // whole call. Its type is the one that each option reads: SBitrateInfo for the bit rates, float for the frame
    // rate, int for the trace level (codec_app_def.h, ENCODER_OPTION); the callers above pair them, and the trait
    // lets no other type in.
    unsafe { library.raw_api().set_option(option, std::ptr::from_mut(value).cast()) }
}

fn make(settings: &EncoderSettings) -> Result<openh264::encoder::Encoder, SettingsError> {
    let config = EncoderConfig::new()
        // For screens, openh264 insists on scene change detection, and with it on key frames that nobody asked for.
        .usage_type(UsageType::CameraVideoRealTime)
        .scene_change_detect(false)
        .intra_frame_period(IntraFramePeriod::from_num_frames(0))
        // Neither changed the error of a moving picture by 0.1 dB or its bits by 4 %, and both take a look at each
        // macroblock; background detection also leaves blocks stale by its own judgement.
        .adaptive_quantization(false)
        .background_detection(false)
        .skip_frames(false)
        .rate_control_mode(RateControlMode::Bitrate)
        .qp(QUANTISER)
        .bitrate(BitRate::from_bps(settings.bitrate_bps))
        .max_frame_rate(FrameRate::from_hz(settings.frames_per_second))
        .profile(Profile::Baseline)
        .sps_pps_strategy(SpsPpsStrategy::ConstantId)
        // The primaries and the matrix are BT.709's; the curve is sRGB's, as it is in every other picture of the scene.
        .vui(VuiConfig::bt709().transfer_characteristics(TransferCharacteristics::Srgb))
        .num_threads(1)
        .complexity(match settings.complexity {
            Complexity::Low => openh264::encoder::Complexity::Low,
            Complexity::Medium => openh264::encoder::Complexity::Medium,
            Complexity::High => openh264::encoder::Complexity::High,
        });
    let mut library = openh264::encoder::Encoder::with_api_config(OpenH264API::from_source(), config)
        .map_err(|error| SettingsError::Library { code: error.native_code() })?;
    // The wrapper quiets the library only after it has started, and it warns on starting without frame skipping.
    match set_option(&mut library, ENCODER_OPTION_TRACE_LEVEL, &mut WELS_LOG_QUIET.clone()) {
        0 => Ok(library),
        code => Err(SettingsError::Library { code: i64::from(code) }),
    }
}

/// The key frame with a sequence parameter set that says where chroma lies. openh264 cannot, and a stream that does not
/// say means another place: [`ChromaSiting::LEFT`].
fn sited(access_unit: &[u8]) -> Result<Vec<u8>, ParameterSetError> {
    let is_sps =
        |range: &std::ops::Range<usize>| kind(access_unit[range.start]) == NalKind::SequenceParameterSet;
    let range = nal_ranges(access_unit)
        .find(is_sps)
        .ok_or(ParameterSetError::Missing { bytes: access_unit.len() })?;
    let sps = with_chroma_siting(&access_unit[range.clone()], ChromaSiting::CENTRE)?;
    Ok([&access_unit[..range.start], &sps, &access_unit[range.end..]].concat())
}

fn check_size(width_px: u32, height_px: u32) -> Result<(), SettingsError> {
    let (shorter, longer) = (width_px.min(height_px), width_px.max(height_px));
    let even = width_px.is_multiple_of(2) && height_px.is_multiple_of(2);
    if even && shorter >= SHORTEST_SIDE_PX && longer <= LONGEST_SIDES_PX[0] && shorter <= LONGEST_SIDES_PX[1]
    {
        Ok(())
    } else {
        Err(SettingsError::Size { width_px, height_px })
    }
}

fn check_frame_rate(frames_per_second: f32) -> Result<(), SettingsError> {
    // A NaN lies in no range.
    if FRAMES_PER_SECOND.contains(&frames_per_second) {
        Ok(())
    } else {
        Err(SettingsError::FrameRate { frames_per_second })
    }
}

fn check_bit_rate(bitrate_bps: u32) -> Result<(), SettingsError> {
    if BITRATE_BPS.contains(&bitrate_bps) { Ok(()) } else { Err(SettingsError::BitRate { bitrate_bps }) }
}

/// A picture as the library wants to see it.
struct Planes<'a>(YuvFrame<'a>);

impl YUVSource for Planes<'_> {
    fn dimensions(&self) -> (usize, usize) {
        (self.0.layout().width_px() as usize, self.0.layout().height_px() as usize)
    }

    fn strides(&self) -> (usize, usize, usize) {
        let layout = self.0.layout();
        (layout.y_stride(), layout.uv_stride(), layout.uv_stride())
    }

    fn y(&self) -> &[u8] {
        self.0.y()
    }

    fn u(&self) -> &[u8] {
        self.0.u()
    }

    fn v(&self) -> &[u8] {
        self.0.v()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: EncoderSettings = EncoderSettings {
        width_px: 640,
        height_px: 180,
        frames_per_second: 60.0,
        bitrate_bps: 4_000_000,
        complexity: Complexity::Low,
    };

    #[test]
    fn refuses_sizes_that_cannot_be_encoded() {
        for (width_px, height_px) in [(641, 180), (640, 181), (14, 180), (640, 0), (3842, 720), (2400, 2400)]
        {
            let refused = Encoder::new(EncoderSettings { width_px, height_px, ..GOOD }).err();
            assert_eq!(refused, Some(SettingsError::Size { width_px, height_px }));
        }
        let error = Encoder::new(EncoderSettings { width_px: 641, ..GOOD }).err().unwrap().to_string();
        assert!(
            error.starts_with("cannot encode pictures of 641x180 pixels, expected even sides"),
            "{error}"
        );
    }

    #[test]
    fn refuses_rates_that_mean_nothing() {
        for frames_per_second in [0.0, -60.0, f32::NAN, f32::INFINITY, 1000.0] {
            let refused = Encoder::new(EncoderSettings { frames_per_second, ..GOOD }).err();
            assert!(matches!(refused, Some(SettingsError::FrameRate { .. })));
        }
        for bitrate_bps in [0, 9_999, u32::MAX] {
            let refused = Encoder::new(EncoderSettings { bitrate_bps, ..GOOD }).err();
            assert_eq!(refused, Some(SettingsError::BitRate { bitrate_bps }));
            let mut encoder = Encoder::new(GOOD).unwrap();
            assert_eq!(encoder.set_bitrate_bps(bitrate_bps), Err(SettingsError::BitRate { bitrate_bps }));
            assert_eq!(encoder.settings(), GOOD);
        }
    }
}
