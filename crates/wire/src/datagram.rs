//! Datagrams: what is worthless when late and therefore never sent again.

use crate::bytes::{What, append, decode_all};
use crate::limits::MAX_DATAGRAM_BYTES;
use crate::{DecodeError, Pose};
use bincode::{Decode, Encode};

/// What a headset sends as datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub enum ClientDatagram {
    /// Where the head is.
    Pose(PoseSample),
    /// Asks for the server's time.
    Ping(Ping),
    /// What has arrived.
    Feedback(Feedback),
}

/// What the server sends as datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub enum ServerDatagram {
    /// The answer to a ping.
    Pong(Pong),
}

/// Where the head is, and when the picture made for it is expected to be seen.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct PoseSample {
    /// Rises with every sample; the highest wins.
    pub sequence: u64,
    /// When the head was there: headset clock, microseconds.
    pub sampled_at_us: u64,
    /// When the picture is expected to be shown: headset clock, microseconds.
    pub display_at_us: u64,
    /// The head in the world.
    pub world_from_head: Pose,
}

/// Asks for the server's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Ping {
    /// Rises with every ping.
    pub sequence: u64,
    /// Headset clock, microseconds.
    pub sent_at_us: u64,
    /// What the headset has learnt from the pongs so far; `None` before the first.
    pub clock: Option<ClockReport>,
}

/// How a headset's clock stands to the server's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct ClockReport {
    /// Server clock minus headset clock, microseconds.
    pub server_minus_headset_us: i64,
    /// Round trip of the ping that this was learnt from, microseconds.
    pub round_trip_us: u32,
}

/// What has arrived. Every feedback says all, so that a lost one is made good by the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Feedback {
    /// Rises with every feedback; the highest wins.
    pub sequence: u64,
    /// Highest number of a frame that has arrived whole; `None` before the first.
    pub newest_completed: Option<u64>,
    /// The 64 frames before that one: bit i is set if frame `newest_completed - 1 - i` has arrived whole.
    pub completed_before: u64,
    /// Highest number of a frame that was decoded; `None` before the first.
    pub newest_decoded: Option<u64>,
    /// The decoder can only go on with a key frame.
    pub key_frame_needed: bool,
}

/// The answer to a [`Ping`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Pong {
    /// [`Ping::sequence`].
    pub sequence: u64,
    /// [`Ping::sent_at_us`]: headset clock, microseconds.
    pub ping_sent_at_us: u64,
    /// When the ping came in: server clock, microseconds.
    pub received_at_us: u64,
    /// When this left: server clock, microseconds.
    pub sent_at_us: u64,
}

impl Feedback {
    /// Whether this says that `frame` has arrived whole. A frame more than 64 before the newest is not known to have.
    #[must_use]
    pub fn is_completed(&self, frame: u64) -> bool {
        match self.newest_completed {
            Some(newest) if frame == newest => true,
            Some(newest) if frame < newest && newest - frame <= 64 => {
                self.completed_before >> (newest - frame - 1) & 1 == 1
            }
            _ => false,
        }
    }

    /// Marks `frame` as arrived whole.
    pub fn set_completed(&mut self, frame: u64) {
        match self.newest_completed {
            Some(newest) if frame <= newest => {
                if frame < newest && newest - frame <= 64 {
                    self.completed_before |= 1 << (newest - frame - 1);
                }
            }
            Some(newest) => {
                let by = u32::try_from(frame - newest).unwrap_or(u32::MAX);
                self.completed_before = self.completed_before.checked_shl(by).unwrap_or(0);
                if by <= 64 {
                    self.completed_before |= 1 << (by - 1);
                }
                self.newest_completed = Some(frame);
            }
            None => self.newest_completed = Some(frame),
        }
    }
}

impl ClientDatagram {
    /// The datagram's bytes, far fewer than [`MAX_DATAGRAM_BYTES`].
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        bytes(self)
    }

    /// The message of which `bytes` are all the bytes.
    ///
    /// # Errors
    /// If the bytes are too many, too few, or no message.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        decode_all::<MAX_DATAGRAM_BYTES, _>(What::Datagram, bytes)
    }
}

impl ServerDatagram {
    /// The datagram's bytes, far fewer than [`MAX_DATAGRAM_BYTES`].
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        bytes(self)
    }

    /// The message of which `bytes` are all the bytes.
    ///
    /// # Errors
    /// If the bytes are too many, too few, or no message.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        decode_all::<MAX_DATAGRAM_BYTES, _>(What::Datagram, bytes)
    }
}

fn bytes(message: &impl Encode) -> Vec<u8> {
    let mut out = Vec::with_capacity(64);
    append::<MAX_DATAGRAM_BYTES>(What::Datagram, message, &mut out)
        .expect("datagrams have a fixed size far below the limit");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn nothing_is_completed_before_the_first_frame() {
        assert!(!Feedback::default().is_completed(0));
    }

    proptest! {
        #[test]
        fn the_mask_remembers_the_sixty_four_frames_before_the_newest(
            frames in prop::collection::vec(0u64..200, 1..60),
        ) {
            let mut feedback = Feedback::default();
            let mut completed = BTreeSet::new();
            for frame in frames {
                feedback.set_completed(frame);
                completed.insert(frame);
                let newest = *completed.last().unwrap();
                // A frame that fell out of the mask stays out, so only what was inside all along is compared.
                completed.retain(|&frame| newest - frame <= 64);
                for frame in 0..220 {
                    prop_assert_eq!(feedback.is_completed(frame), completed.contains(&frame), "frame {}", frame);
                }
            }
        }
    }
}
