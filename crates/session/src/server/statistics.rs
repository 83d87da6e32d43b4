//! What a session counts.

use super::ServerSession;
use std::time::Duration;

/// What a session has counted since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerCounters {
    /// Poses that were the newest when they came.
    pub poses_taken: u64,
    /// Poses that were older than one before them, or the same.
    pub poses_stale: u64,
    /// Poses whose numbers were none.
    pub poses_invalid: u64,
    /// Datagrams that came before the hello.
    pub datagrams_early: u64,
    /// Feedback that was older than one before it, or told of frames that were never sent.
    pub feedback_ignored: u64,
    /// Frames that were begun.
    pub frames_begun: u64,
    /// Frames that were given up between their beginning and the encoder's end.
    pub frames_abandoned: u64,
    /// Frames that were rendered and encoded.
    pub frames_rendered: u64,
    /// Frames that were encoded and not sent, because the headset could not have decoded them.
    pub frames_dropped: u64,
    /// Frames that were given to the network.
    pub frames_sent: u64,
    /// Those of them that were key frames.
    pub key_frames_sent: u64,
    /// Frames that the headset has completely.
    pub frames_completed: u64,
    /// Frames whose stream was reset because they were late, or hung on one that was.
    pub frames_reset: u64,
    /// Frames that were due and not begun because too many were under way.
    pub frames_skipped_for_network: u64,
    /// Frames that were due and not begun because the renderer or encoder was busy.
    pub frames_skipped_for_renderer: u64,
    /// Bytes of frames that were given to the network.
    pub bytes_sent: u64,
    /// Round trip to the headset, as it reports it, else the shortest time from sending a frame to hearing of its
    /// arrival; `None` before either.
    pub round_trip: Option<Duration>,
    /// Smoothed time from sending a frame to hearing of its arrival; `None` before the first.
    pub frame_round_trip: Option<Duration>,
    /// Frames that may be under way at a time.
    pub window: usize,
    /// Frames that are under way or being made.
    pub in_flight: usize,
}

impl ServerSession {
    /// What the session has counted since it began.
    #[must_use]
    pub fn counters(&self) -> ServerCounters {
        ServerCounters {
            round_trip: self.flow.round_trip(),
            frame_round_trip: self.flow.frame_round_trip(),
            window: self.flow.window(),
            in_flight: self.flow.in_flight() + self.pipeline.len(),
            ..self.counters
        }
    }

    /// What the encoder aims at from now on, in bits a second; told to the headset with the statistics.
    pub fn set_bitrate(&mut self, bitrate_bps: u32) {
        self.bitrate_bps = bitrate_bps;
    }

    pub(super) fn statistics_message(&self) -> wire::ServerStatistics {
        let counters = &self.counters;
        wire::ServerStatistics {
            frames_rendered: counters.frames_rendered,
            frames_sent: counters.frames_sent,
            frames_reset: counters.frames_reset,
            frames_skipped: counters.frames_skipped_for_network + counters.frames_skipped_for_renderer,
            quality: self.quality,
            bitrate_bps: self.bitrate_bps,
        }
    }
}
