//! A frame: one stream with a header and an access unit.

use crate::bytes::{What, append, decode_all};
use crate::limits::{MAX_ACCESS_UNIT_BYTES, MAX_FRAME_BYTES, MAX_FRAME_HEADER_BYTES};
use crate::{DecodeError, EncodeError, EyeView};
use bincode::{Decode, Encode};

/// Bytes of the length prefix of a frame header.
const PREFIX_BYTES: usize = 4;
/// Where `depends_on` begins in a stream, and `sent_us` if that is none, as in `proto/wire.md`.
const DEPENDS_ON_AT: usize = 12;
const SENT_AT: usize = 181;

/// What goes before the access unit.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct FrameHeader {
    /// Rises with every frame, with gaps. Stays the first field.
    pub frame: u64,
    /// The frame that must have been decoded for this one to decode; `None` for a key frame.
    pub depends_on: Option<u64>,
    /// The scene that the picture shows.
    pub scene_revision: u32,
    /// Which volume of a series in time it shows, counted from 0; 0 where there is only one.
    pub time_step: u32,
    /// [`crate::PoseSample::sequence`] of the pose that the picture was made for.
    pub pose_sequence: u64,
    /// That pose's time: headset clock, microseconds.
    pub pose_sampled_at_us: u64,
    /// That pose's expected display time: headset clock, microseconds.
    pub display_at_us: u64,
    /// What the picture shows, left eye then right eye: where the eyes were predicted to be, not where the pose was.
    pub eyes: [EyeView; 2],
    /// When the picture passed through the server.
    pub stages: StageTimes,
    /// What was spent on it.
    pub quality: Quality,
    /// How far away what it shows is.
    pub depth: DepthGrid,
    /// Length of the access unit in bytes.
    pub access_unit_bytes: u32,
}

/// When a frame passed through the server: server clock, microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct StageTimes {
    /// The pose came in.
    pub pose_received_us: u64,
    /// The renderer began.
    pub render_started_us: u64,
    /// The renderer was done.
    pub rendered_us: u64,
    /// The picture was converted and read back.
    pub converted_us: u64,
    /// The encoder began.
    pub encode_started_us: u64,
    /// The encoder was done.
    pub encoded_us: u64,
    /// The frame was given to the network.
    pub sent_us: u64,
}

/// What the renderer spends on a picture.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Quality {
    /// Rendered pixels over coded pixels along one axis, 1 is all. The coded picture keeps its size.
    pub resolution_scale: f32,
    /// Length of a ray's step over that of the scene, 1 is as asked.
    pub step_scale: f32,
    /// 0 is none; higher is better light, at most what the scene asks for.
    pub shading: u8,
}

impl Default for Quality {
    fn default() -> Self {
        Self { resolution_scale: 1.0, step_scale: 1.0, shading: 0 }
    }
}

/// How far away what a picture shows is, coarsely: a grid over each eye's picture.
#[derive(Clone, Debug, Default, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct DepthGrid {
    /// Columns of one eye; 0 for no grid.
    pub columns: u16,
    /// Rows of one eye; 0 for no grid.
    pub rows: u16,
    /// Left eye, then right eye, each row by row from the upper left: distance from the eye along the ray through the
    /// cell's middle, in millimetres; 0 where nothing is seen.
    pub distances_mm: Vec<u16>,
}

/// A frame that was taken apart; the access unit is borrowed from the stream's bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<'a> {
    /// What goes before the access unit.
    pub header: FrameHeader,
    /// One H.264 access unit in Annex B form.
    pub access_unit: &'a [u8],
}

impl DepthGrid {
    fn is_filled(&self) -> bool {
        self.distances_mm.len() == 2 * usize::from(self.columns) * usize::from(self.rows)
    }
}

/// The whole content of a frame's stream: length of the header, header, access unit.
///
/// # Errors
/// If the header or the access unit is too large, the depth grid is not filled, or `access_unit_bytes` is wrong.
pub fn encode_frame(header: &FrameHeader, access_unit: &[u8]) -> Result<Vec<u8>, EncodeError> {
    let found = access_unit.len();
    if found > MAX_ACCESS_UNIT_BYTES {
        return Err(EncodeError::TooLarge {
            what: What::AccessUnit,
            bytes: found,
            max: MAX_ACCESS_UNIT_BYTES,
        });
    }
    if header.access_unit_bytes as usize != found {
        return Err(EncodeError::AccessUnitLength { stated: header.access_unit_bytes, found });
    }
    let DepthGrid { columns, rows, distances_mm } = &header.depth;
    if !header.depth.is_filled() {
        return Err(EncodeError::DepthGridSize { columns: *columns, rows: *rows, found: distances_mm.len() });
    }
    let mut out = Vec::with_capacity(512 + 2 * distances_mm.len() + found);
    out.extend([0; PREFIX_BYTES]);
    let length = append::<MAX_FRAME_HEADER_BYTES>(What::FrameHeader, header, &mut out)?;
    let length = u32::try_from(length).expect("the limit of a frame header fits 32 bits");
    out[..PREFIX_BYTES].copy_from_slice(&length.to_le_bytes());
    out.extend_from_slice(access_unit);
    Ok(out)
}

/// Sets [`StageTimes::sent_us`] in what [`encode_frame`] made: when a frame goes out is known only then, and it is encoded
/// before, by whoever has the time. Bytes that are no frame stay as they are.
pub fn stamp_sent(stream: &mut [u8], sent_us: u64) {
    // The option is a byte, and a number if that is 1.
    let dependency = match stream.get(DEPENDS_ON_AT) {
        Some(0) => 0,
        Some(1) => 8,
        _ => return,
    };
    let at = SENT_AT + dependency;
    if let Some(sent) = stream.get_mut(at..at + 8) {
        sent.copy_from_slice(&sent_us.to_le_bytes());
    }
}

/// Takes the whole content of a frame's stream apart.
///
/// # Errors
/// If a limit is exceeded, the bytes end too early, the header is none, its depth grid is not filled, or the access
/// unit is not as long as the header says.
pub fn decode_frame(bytes: &[u8]) -> Result<Frame<'_>, DecodeError> {
    if bytes.len() > MAX_FRAME_BYTES {
        return Err(DecodeError::TooLarge {
            what: What::FrameStream,
            bytes: bytes.len(),
            max: MAX_FRAME_BYTES,
        });
    }
    let truncated = |missing| DecodeError::Truncated { what: What::FrameStream, found: bytes.len(), missing };
    let (prefix, rest) =
        bytes.split_first_chunk::<PREFIX_BYTES>().ok_or_else(|| truncated(PREFIX_BYTES - bytes.len()))?;
    let length = u32::from_le_bytes(*prefix) as usize;
    if length > MAX_FRAME_HEADER_BYTES {
        return Err(DecodeError::TooLarge {
            what: What::FrameHeader,
            bytes: length,
            max: MAX_FRAME_HEADER_BYTES,
        });
    }
    let (header, access_unit) =
        rest.split_at_checked(length).ok_or_else(|| truncated(length.saturating_sub(rest.len())))?;
    let header: FrameHeader = decode_all::<MAX_FRAME_HEADER_BYTES, _>(What::FrameHeader, header)?;
    let DepthGrid { columns, rows, distances_mm } = &header.depth;
    if !header.depth.is_filled() {
        return Err(DecodeError::DepthGridSize { columns: *columns, rows: *rows, found: distances_mm.len() });
    }
    let found = access_unit.len();
    if header.access_unit_bytes as usize != found {
        return Err(DecodeError::AccessUnitLength { stated: header.access_unit_bytes, found });
    }
    if found > MAX_ACCESS_UNIT_BYTES {
        return Err(DecodeError::TooLarge {
            what: What::AccessUnit,
            bytes: found,
            max: MAX_ACCESS_UNIT_BYTES,
        });
    }
    Ok(Frame { header, access_unit })
}

/// The frame's number, from the first bytes of its stream; `None` if fewer than 12 have come. A stream that was reset
/// may have told this much.
#[must_use]
pub fn frame_number_of_part(bytes: &[u8]) -> Option<u64> {
    let (_, rest) = bytes.split_first_chunk::<PREFIX_BYTES>()?;
    let (frame, _) = rest.split_first_chunk::<8>()?;
    Some(u64::from_le_bytes(*frame))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn a_frame_states_the_length_of_its_access_unit() {
        let header = samples::frame_header(3);
        assert_eq!(
            encode_frame(&header, &[0; 4]).unwrap_err(),
            EncodeError::AccessUnitLength { stated: 3, found: 4 }
        );
        let mut bytes = encode_frame(&header, &[7; 3]).unwrap();
        assert_eq!(decode_frame(&bytes).unwrap().access_unit, [7; 3]);
        bytes.pop();
        assert_eq!(decode_frame(&bytes).unwrap_err(), DecodeError::AccessUnitLength { stated: 3, found: 2 });
    }

    #[test]
    fn every_truncation_of_a_frame_is_an_error() {
        let bytes = encode_frame(&samples::frame_header(5), &[1; 5]).unwrap();
        for length in 0..bytes.len() {
            assert!(decode_frame(&bytes[..length]).is_err(), "cut after {length} bytes");
        }
    }

    #[test]
    fn a_depth_grid_is_filled_or_refused() {
        let mut header = samples::frame_header(0);
        header.depth = DepthGrid { columns: 2, rows: 2, distances_mm: vec![0; 7] };
        assert_eq!(
            encode_frame(&header, &[]).unwrap_err().to_string(),
            "depth grid has 7 distances, expected 2 × 2 × 2"
        );
        header.depth.distances_mm.push(9);
        let mut bytes = encode_frame(&header, &[]).unwrap();
        let columns_at = bytes.len() - 4 - 8 * 2 - 8 - 4;
        assert_eq!(bytes[columns_at..columns_at + 4], [2, 0, 2, 0]);
        bytes[columns_at] = 3;
        assert_eq!(
            decode_frame(&bytes).unwrap_err(),
            DecodeError::DepthGridSize { columns: 3, rows: 2, found: 8 }
        );
    }

    #[test]
    fn a_depth_grid_beyond_the_header_limit_is_refused() {
        let mut header = samples::frame_header(0);
        header.depth = DepthGrid { columns: 200, rows: 200, distances_mm: vec![0; 80_000] };
        assert!(matches!(
            encode_frame(&header, &[]),
            Err(EncodeError::TooLarge { what: What::FrameHeader, max: MAX_FRAME_HEADER_BYTES, .. })
        ));
    }

    #[test]
    fn a_header_that_announces_too_much_is_refused_before_it_comes() {
        let bytes = u32::MAX.to_le_bytes();
        assert!(matches!(decode_frame(&bytes), Err(DecodeError::TooLarge { what: What::FrameHeader, .. })));
    }

    #[test]
    fn the_number_is_read_from_the_beginning_of_a_stream() {
        let header = samples::frame_header(1);
        let bytes = encode_frame(&header, &[1]).unwrap();
        assert_eq!(frame_number_of_part(&bytes[..12]), Some(header.frame));
        assert_eq!(frame_number_of_part(&bytes[..11]), None);
    }
}
