//! A frame that has arrived whole.

use crate::convert::view_from_wire;
use crate::time::HeadsetTime;
use spatial::StereoView;
use wire::{DecodeError, FrameHeader, decode_frame};

/// A frame that has arrived whole, in the order in which it is to be decoded.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedFrame {
    /// What the server says of it.
    pub header: FrameHeader,
    /// What the picture shows: where both eyes were predicted to be, checked.
    pub view: StereoView,
    /// When its last byte came.
    pub completed_at: HeadsetTime,
    /// The stream's content, of which the access unit is the end.
    stream: Vec<u8>,
}

/// Why a stream is no frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum FrameError {
    #[error(transparent)]
    Bytes(#[from] DecodeError),
    #[error("frame {frame} was rendered for a view with a pose or field of view that is none")]
    View { frame: u64 },
}

impl ReceivedFrame {
    pub(super) fn from_stream(now: HeadsetTime, stream: Vec<u8>) -> Result<Self, FrameError> {
        let header = decode_frame(&stream)?.header;
        let view = view_from_wire(&header.eyes).ok_or(FrameError::View { frame: header.frame })?;
        Ok(Self { header, view, completed_at: now, stream })
    }

    /// The H.264 access unit in Annex B form.
    #[must_use]
    pub fn access_unit(&self) -> &[u8] {
        let start = self.stream.len().saturating_sub(self.header.access_unit_bytes as usize);
        &self.stream[start..]
    }

    /// Bytes that came over the network for this frame.
    #[must_use]
    pub fn stream_bytes(&self) -> usize {
        self.stream.len()
    }

    #[cfg(test)]
    pub(super) fn for_test(number: u64, depends_on: Option<u64>, completed_at: HeadsetTime) -> Self {
        let fov = spatial::Fov::symmetric(0.5, 0.5).unwrap();
        let view = spatial::HeadGeometry::parallel(0.06, fov).view(&spatial::Pose::IDENTITY);
        let header = FrameHeader {
            frame: number,
            depends_on,
            scene_revision: 0,
            time_step: 0,
            pose_sequence: number,
            pose_sampled_at_us: 0,
            display_at_us: 0,
            eyes: crate::convert::view_to_wire(&view),
            stages: wire::StageTimes::default(),
            quality: wire::Quality::default(),
            depth: wire::DepthGrid::default(),
            access_unit_bytes: 0,
        };
        Self { header, view, completed_at, stream: Vec::new() }
    }
}
