//! What a headset counts and averages.

use super::ClientSession;
use crate::time::HeadsetTime;
use std::time::Duration;
use wire::{ClientMessage, ClientStatistics};

/// What the headset's end has counted since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientCounters {
    /// Poses that were sent.
    pub poses_sent: u64,
    /// Frames that arrived whole.
    pub frames_received: u64,
    /// Bytes of those frames.
    pub bytes_received: u64,
    /// Frames that were decoded.
    pub frames_decoded: u64,
    /// Frames whose stream was reset, that hung on such a frame, or that did not decode.
    pub frames_lost: u64,
    /// Frames that arrived after a newer one had been delivered, or were passed over by a key frame.
    pub frames_stale: u64,
    /// Frames that were decoded after their expected display time.
    pub frames_late: u64,
    /// Pongs that answered no ping or could not be true.
    pub pongs_ignored: u64,
}

/// A mean and a maximum.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum_us: i64,
    count: u32,
    max_us: i64,
}

impl Mean {
    fn add(&mut self, micros: i64) {
        self.sum_us = self.sum_us.saturating_add(micros);
        self.max_us = if self.count == 0 { micros } else { self.max_us.max(micros) };
        self.count += 1;
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "for people, to a microsecond"
    )]
    fn mean_ms(&self) -> f32 {
        if self.count == 0 { 0.0 } else { (self.sum_us as f64 / f64::from(self.count) * 1e-3) as f32 }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "for people, to a microsecond"
    )]
    fn max_ms(&self) -> f32 {
        (self.max_us as f64 * 1e-3) as f32
    }
}

/// What is averaged between two statistics messages.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Averages {
    decode: Mean,
    pose_to_decoded: Mean,
    motion_to_photon: Mean,
}

impl Averages {
    pub(super) fn add_decode(&mut self, took: Duration) {
        self.decode.add(i64::try_from(took.as_micros()).unwrap_or(i64::MAX));
    }

    pub(super) fn add_pose_to_decoded(&mut self, micros: i64) {
        self.pose_to_decoded.add(micros);
    }

    pub(super) fn add_motion_to_photon(&mut self, micros: i64) {
        self.motion_to_photon.add(micros);
    }
}

impl ClientSession {
    /// What this end has counted since it began.
    #[must_use]
    pub fn counters(&self) -> ClientCounters {
        self.counters
    }

    pub(super) fn send_statistics(&mut self, now: HeadsetTime) {
        let averages = std::mem::take(&mut self.averages);
        let counters = &self.counters;
        let round_trip = self.pings.as_ref().and_then(|pings| pings.round_trip(now));
        self.send(&ClientMessage::Statistics(ClientStatistics {
            frames_received: counters.frames_received,
            frames_decoded: counters.frames_decoded,
            frames_lost: counters.frames_lost,
            frames_stale: counters.frames_stale,
            frames_late: counters.frames_late,
            decode_ms_mean: averages.decode.mean_ms(),
            pose_to_decoded_ms_mean: averages.pose_to_decoded.mean_ms(),
            pose_to_decoded_ms_max: averages.pose_to_decoded.max_ms(),
            motion_to_photon_ms_mean: averages.motion_to_photon.mean_ms(),
            round_trip_ms: round_trip.map_or(0.0, |time| time.as_secs_f32() * 1e3),
        }));
    }
}
