//! Access units in, pictures out.

use crate::{NalKind, PictureError, PlaneLayout, Sps, SpsError, YuvPicture, nal_units};
use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, DecoderConfig, Flush};
use openh264::formats::YUVSource;

/// Longest access unit that is looked at: more than the largest picture takes uncompressed.
const LONGEST_BYTES: usize = 16 << 20;

/// openh264 could not be set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("openh264 gave no decoder, with code {code}")]
pub struct DecoderError {
    /// openh264's own code.
    pub code: i64,
}

/// Why an access unit gave no picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// It is longer than any picture.
    #[error("access unit has {bytes} bytes, at most {LONGEST_BYTES} are decoded")]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// It holds no slice of a picture: it is garbage, or cut off before the first one.
    #[error("access unit of {bytes} bytes holds no slice of a picture")]
    NoSlice {
        /// Its length.
        bytes: usize,
    },
    /// It holds something that this project never sends.
    #[error("access unit holds a NAL unit of type {nal_type}, which is not supported")]
    Unsupported {
        /// The NAL unit's type.
        nal_type: u8,
    },
    /// Its sequence parameter set is refused.
    #[error(transparent)]
    Sps(#[from] SpsError),
    /// It refers to pictures that are not there: the stream has just begun, or an earlier access unit was damaged or
    /// lost. Ask for a key frame.
    #[error("access unit refers to earlier pictures, but no undamaged key frame came before it")]
    AwaitingKeyFrame,
    /// It is damaged, or refers to a picture that was lost. Nothing is shown until the next key frame.
    #[error("access unit is damaged (openh264 state {state:#x})")]
    Damaged {
        /// openh264's own state bits.
        state: i64,
    },
    /// The decoder gave no picture for it.
    #[error("access unit is incomplete: no picture came of it")]
    Incomplete,
    /// The decoder's picture has a size that the parameter set did not announce.
    #[error(
        "decoded {width_px}x{height_px} pixels, but the stream announced {expected_width_px}x{expected_height_px}"
    )]
    Size {
        /// The picture's width.
        width_px: usize,
        /// The picture's height.
        height_px: usize,
        /// The announced width.
        expected_width_px: u32,
        /// The announced height.
        expected_height_px: u32,
    },
    /// The stream's size is no 4:2:0 picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The decoder could not be set up anew after a damaged access unit.
    #[error(transparent)]
    Restart(#[from] DecoderError),
}

/// Decodes one stream: an access unit in, its picture out, at once.
pub struct Decoder {
    library: openh264::decoder::Decoder,
    /// What the last sequence parameter set announced.
    announced: Option<Sps>,
    /// Whether the last picture is there to refer to.
    intact: bool,
    /// Whether the library has failed. It then keeps more of the damage than a key frame clears: in one of some
    /// hundred damaged streams, the next undamaged key frame failed too. So it is made anew.
    spoiled: bool,
}

impl Decoder {
    /// Makes a decoder that waits for a key frame.
    ///
    /// # Errors
    /// If openh264 cannot be set up, which it never has failed to.
    pub fn new() -> Result<Self, DecoderError> {
        Ok(Self { library: make()?, announced: None, intact: false, spoiled: false })
    }

    /// Decodes one access unit (Annex B) to its picture, cropped to what the stream says is shown.
    ///
    /// Every access unit of a stream must be given, in order. After an error, pictures come again from the next key
    /// frame on: a picture that refers to a damaged one is never shown.
    ///
    /// # Errors
    /// If the access unit is too long, garbage, cut off, damaged, too large (checked before memory is taken), or refers
    /// to pictures that are not there.
    pub fn decode(&mut self, access_unit: &[u8]) -> Result<YuvPicture, DecodeError> {
        let key_frame = match self.inspect(access_unit) {
            Ok(key_frame) => key_frame,
            Err(error) => {
                self.intact = false;
                return Err(error);
            }
        };
        if !key_frame && !self.intact {
            return Err(DecodeError::AwaitingKeyFrame);
        }
        let Some(announced) = self.announced else {
            return Err(DecodeError::AwaitingKeyFrame);
        };
        if self.spoiled {
            self.library = make()?;
        }
        (self.intact, self.spoiled) = (false, true);
        let picture = match self.library.decode(access_unit) {
            Ok(Some(decoded)) => picture(&decoded, &announced)?,
            Ok(None) => return Err(DecodeError::Incomplete),
            Err(error) => return Err(DecodeError::Damaged { state: error.native_code() }),
        };
        (self.intact, self.spoiled) = (true, false);
        Ok(picture)
    }

    /// Looks at the NAL units before the library does. Returns whether decoding can begin here.
    fn inspect(&mut self, access_unit: &[u8]) -> Result<bool, DecodeError> {
        let bytes = access_unit.len();
        if bytes > LONGEST_BYTES {
            return Err(DecodeError::TooLong { bytes });
        }
        let (mut slices, mut key_slices, mut announced) = (0, 0, None);
        for unit in nal_units(access_unit) {
            match unit.kind {
                NalKind::Slice => slices += 1,
                NalKind::KeySlice => key_slices += 1,
                NalKind::SequenceParameterSet => announced = Some(Sps::parse(unit.bytes)?),
                NalKind::PictureParameterSet | NalKind::Supplemental | NalKind::Delimiter => {}
                NalKind::Other(nal_type) => return Err(DecodeError::Unsupported { nal_type }),
            }
        }
        if slices + key_slices == 0 {
            return Err(DecodeError::NoSlice { bytes });
        }
        let key_frame = slices == 0;
        if let Some(sps) = announced {
            // Parameter sets come with key frames only; elsewhere they would change the stream under its references.
            if !key_frame {
                return Err(DecodeError::Unsupported { nal_type: 7 });
            }
            PlaneLayout::packed(sps.width_px, sps.height_px)?;
            self.announced = Some(sps);
        }
        Ok(key_frame)
    }
}

fn make() -> Result<openh264::decoder::Decoder, DecoderError> {
    let config = DecoderConfig::new().flush_after_decode(Flush::Flush);
    openh264::decoder::Decoder::with_api_config(OpenH264API::from_source(), config)
        .map_err(|error| DecoderError { code: error.native_code() })
}

/// Copies the library's picture, which lives until its next call, into a packed one.
fn picture(decoded: &DecodedYUV<'_>, announced: &Sps) -> Result<YuvPicture, DecodeError> {
    let (width_px, height_px) = decoded.dimensions();
    if (width_px, height_px) != (announced.width_px as usize, announced.height_px as usize) {
        return Err(DecodeError::Size {
            width_px,
            height_px,
            expected_width_px: announced.width_px,
            expected_height_px: announced.height_px,
        });
    }
    let layout = PlaneLayout::packed(announced.width_px, announced.height_px)?;
    let (y_stride, u_stride, v_stride) = decoded.strides();
    let mut bytes = Vec::with_capacity(layout.len_bytes());
    append_plane(&mut bytes, decoded.y(), y_stride, layout.y_stride(), width_px, height_px);
    append_plane(&mut bytes, decoded.u(), u_stride, layout.uv_stride(), width_px / 2, height_px / 2);
    append_plane(&mut bytes, decoded.v(), v_stride, layout.uv_stride(), width_px / 2, height_px / 2);
    Ok(YuvPicture::new(layout, bytes)?)
}

fn append_plane(
    bytes: &mut Vec<u8>,
    plane: &[u8],
    plane_stride: usize,
    stride: usize,
    width: usize,
    height: usize,
) {
    for row in plane.chunks(plane_stride).take(height) {
        bytes.extend_from_slice(&row[..width]);
        bytes.resize(bytes.len() + stride - width, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(access_unit: &[u8], expected: DecodeError) {
        assert_eq!(Decoder::new().unwrap().decode(access_unit), Err(expected));
    }

    #[test]
    fn what_is_no_access_unit_is_refused_before_the_library_sees_it() {
        check(&[], DecodeError::NoSlice { bytes: 0 });
        check(&[0xff; 100], DecodeError::NoSlice { bytes: 100 });
        check(&[0, 0, 0, 1, 0x41, 0x9a, 1], DecodeError::AwaitingKeyFrame);
        check(&[0, 0, 0, 1, 0x65, 0x88, 1], DecodeError::AwaitingKeyFrame);
        check(&[0, 0, 0, 1, 0x74, 1, 2], DecodeError::Unsupported { nal_type: 20 });
        check(&vec![0; LONGEST_BYTES + 1], DecodeError::TooLong { bytes: LONGEST_BYTES + 1 });
    }
}
