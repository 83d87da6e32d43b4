//! All that is known when a headset is done: plain data.

use crate::{Kept, Violation};
use serde::Serialize;
use session::{ClockOffset, ClosedBy, Disconnection, FrameTimeline, Stage};
use spatial::StereoView;
use std::collections::BTreeMap;
use wire::{ServerStatistics, Welcome};

/// Examples of one kind of violation that are kept.
const MAX_EXAMPLES: usize = 5;

/// What one simulated headset got. Times in seconds count from the run's origin, which the headsets of one run share.
#[derive(Clone, Debug, Serialize)]
pub struct HeadsetRun {
    /// Its name in the run.
    pub name: String,
    /// Its model.
    pub device: String,
    /// Width and height of one eye's picture, in pixels.
    pub eye_size_px: [u32; 2],
    /// The trace that it replayed.
    pub trace: String,
    /// Frames a second that it asked for.
    pub asked_hz: f64,
    /// When it sent its first pose, in seconds; `None` if it never was welcomed.
    pub started_at_secs: Option<f64>,
    /// From then until its goodbye, or the connection's end, in seconds; 0 if it never was welcomed.
    pub seconds: f64,
    /// What the server said of itself; `None` if it never was welcomed.
    pub session: Option<SessionFacts>,
    /// What was counted.
    pub counters: RunCounters,
    /// Frames that were not what was asked for, by kind ([`Violation::kind`]).
    pub violations: BTreeMap<&'static str, ViolationCount>,
    /// The server's clock against this headset's at the end; `None` if it was never measured.
    pub clock: Option<ClockFacts>,
    /// From a pose to the forecast display of its picture, at the end, in microseconds.
    pub display_lead_us: u64,
    /// How the network did.
    pub path: PathFacts,
    /// Names of the stages in [`FrameTimes::stages_us`].
    pub stage_names: Vec<&'static str>,
    /// Every decoded frame, in the order of decoding.
    pub frames: Vec<FrameRecord>,
    /// What the server said of the stream, and when.
    pub server_statistics: Vec<ServerStatisticsRecord>,
    /// The scenes that this headset asked for.
    pub scene_requests: Vec<SceneRequest>,
    /// Pictures that were put aside.
    #[serde(skip)]
    pub sampled: Vec<SampledFrame>,
    /// What was written to the disk.
    pub kept: Kept,
    /// How it ended.
    pub end: EndFacts,
}

/// What the server said of itself and its stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SessionFacts {
    /// Where it is.
    pub server_address: String,
    /// Its name for itself.
    pub server_name: String,
    /// The application protocol that was spoken.
    pub protocol: String,
    /// Names the session in the server's log.
    pub session_id: u64,
    /// The scene that was shown at the beginning.
    pub scene_revision: u32,
    /// Width and height of the coded picture, both eyes side by side, in pixels.
    pub stream_size_px: [u32; 2],
    /// Most pictures a second.
    pub refresh_hz: f64,
    /// Bits a second that the server began with.
    pub bitrate_bps: u32,
    /// RFC 6381 name of the codec.
    pub codec: String,
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RunCounters {
    /// Poses that were sent.
    pub poses_sent: u64,
    /// Poses that were not, because this process came too late for them.
    pub poses_skipped: u64,
    /// Frames that arrived whole.
    pub received: u64,
    /// Frames that were decoded.
    pub decoded: u64,
    /// Frames that were decoded after their forecast display time.
    pub late: u64,
    /// Frames that did not arrive whole, hung on one that did not, or did not decode.
    pub lost: u64,
    /// Streams that the server reset.
    pub streams_reset: u64,
    /// Frames that arrived after a newer one, or were passed over by a key frame.
    pub stale: u64,
    /// Frames that did not decode.
    pub undecodable: u64,
    /// Bytes of the frames that arrived whole, headers included.
    pub bytes_received: u64,
    /// Decoded frames whose view was not judged, because the trace jumped.
    pub at_jumps: u64,
    /// Decoded frames that do not say where something is seen.
    pub without_depth: u64,
}

/// How often a kind of violation came, with the first few in words.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ViolationCount {
    /// How often.
    pub count: u64,
    /// The first ones.
    pub examples: Vec<String>,
}

/// The server's clock against the headset's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ClockFacts {
    /// The server's clock minus the headset's, in microseconds.
    pub server_minus_headset_us: i64,
    /// The true offset lies within this many microseconds of it.
    pub error_us: u64,
}

/// How the network did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PathFacts {
    /// Round trip, in microseconds.
    pub rtt_us: u64,
    /// Shortest round trip, in microseconds.
    pub min_rtt_us: u64,
    /// Packets that this end sent.
    pub packets_sent: u64,
    /// Packets of this end that were lost.
    pub packets_lost: u64,
    /// UDP payload sent.
    pub bytes_sent: u64,
    /// UDP payload received.
    pub bytes_received: u64,
    /// Datagrams that this end gave up because the path was congested.
    pub datagrams_congested: u64,
}

/// One decoded frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameRecord {
    /// Its number.
    pub frame: u64,
    /// What it depends on; `None` for a key frame.
    pub depends_on: Option<u64>,
    /// The pose that it was made for.
    pub pose_sequence: u64,
    /// The scene that it shows.
    pub scene_revision: u32,
    /// Which volume of a series in time it shows, counted from 0.
    pub time_step: u32,
    /// When the pose was taken, in seconds.
    pub pose_sampled_at_secs: f64,
    /// When its picture was forecast to be shown, in seconds.
    pub display_at_secs: f64,
    /// When its picture was decoded, in seconds.
    pub decoded_at_secs: f64,
    /// How long after the forecast display that was, in microseconds; negative if before.
    pub lateness_us: i64,
    /// From the pose to the decoded picture, in microseconds.
    pub pose_to_decoded_us: i64,
    /// How long decoding took, in microseconds.
    pub decode_us: i64,
    /// Where the time went; `None` before the server's clock is known.
    pub times: Option<FrameTimes>,
    /// Bytes of the access unit.
    pub bytes: u64,
    /// Bytes of the whole stream, header included.
    pub stream_bytes: u64,
    /// Rendered pixels over coded pixels along one axis.
    pub resolution_scale: f32,
    /// Length of a ray's step over that of the scene.
    pub step_scale: f32,
    /// Light: 0 is none.
    pub shading: u8,
    /// From the view's head to where the head truly was at the display time, in millimetres; `None` if the pose is not
    /// known, or the trace jumped.
    pub prediction_error_mm: Option<f64>,
    /// The angle between the two, in degrees.
    pub prediction_error_deg: Option<f64>,
    /// From the pose to when the picture was shown: at its display time, or with the first display interval after it was
    /// decoded; in microseconds.
    pub pose_to_shown_us: i64,
    /// How fast the head turned in the tenth of a second after the pose, in degrees a second; `None` where the trace
    /// jumped.
    pub head_deg_per_sec: Option<f64>,
    /// How far the anchors of [`crate::SimulatedSettings::anchors_in_world`] seemed to be from where they are when the
    /// picture was shown, without reprojection: mean over those that were seen and both eyes, in pixels. `None` if none
    /// was seen or the trace jumped.
    pub registration_px: Option<f64>,
    /// The same in degrees.
    pub registration_deg: Option<f64>,
    /// How many rules the frame broke.
    pub violations: u32,
}

/// A decoded picture that was put aside, to be held against what should be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledFrame {
    /// The frame.
    pub frame: u64,
    /// The scene that it shows.
    pub scene_revision: u32,
    /// Which volume of a series in time it shows, counted from 0.
    pub time_step: u32,
    /// The view that it was made for, as its header says.
    pub rendered: StereoView,
    /// Where the eyes truly were when it was shown.
    pub seen_from: StereoView,
    /// Width and height of one eye's picture, in pixels.
    pub eye_size_px: [u32; 2],
    /// Red, green and blue of the left and of the right eye, three bytes a pixel, rows from the top.
    pub rgb8: [Vec<u8>; 2],
}

/// Where a frame's time went.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct FrameTimes {
    /// Each stage, in microseconds. They sum to [`FrameRecord::pose_to_decoded_us`].
    pub stages_us: [i64; Stage::ALL.len()],
    /// The age of the pose when the renderer began, in microseconds.
    pub pose_age_at_render_us: i64,
    /// How wrong the clock offset may have been, in microseconds.
    pub clock_error_us: u64,
}

/// What the server said of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ServerStatisticsRecord {
    /// When it came, in seconds.
    pub at_secs: f64,
    /// Frames that were rendered.
    pub frames_rendered: u64,
    /// Frames that were given to the network.
    pub frames_sent: u64,
    /// Frames whose stream was reset.
    pub frames_reset: u64,
    /// Frames that were due and not begun.
    pub frames_skipped: u64,
    /// Rendered pixels over coded pixels along one axis.
    pub resolution_scale: f32,
    /// Length of a ray's step over that of the scene.
    pub step_scale: f32,
    /// Light: 0 is none.
    pub shading: u8,
    /// Bits a second that the encoder aims at.
    pub bitrate_bps: u32,
}

/// A scene that was asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneRequest {
    /// When, in seconds.
    pub at_secs: f64,
    /// What came of it.
    pub outcome: SceneOutcome,
}

/// What came of asking for a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneOutcome {
    /// No answer came.
    Unanswered,
    /// It is too large for a message.
    NotSent {
        /// How large, and how large it may be.
        reason: String,
    },
    /// The room shows it.
    Shown {
        /// Its number.
        revision: u32,
        /// When the answer came, in seconds.
        answered_at_secs: f64,
        /// When the first frame that shows it was decoded, in seconds; `None` if none was.
        first_frame_at_secs: Option<f64>,
    },
    /// The server refused it.
    Refused {
        /// Why.
        reason: String,
        /// When the answer came, in seconds.
        answered_at_secs: f64,
    },
}

/// How it ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct EndFacts {
    /// Who ended it: `us`, `peer` or `network`.
    pub by: &'static str,
    /// Why, for programs: the value of the close code.
    pub code: u32,
    /// Why, for people.
    pub reason: String,
}

impl HeadsetRun {
    /// Frames that were decoded, a second of its whole time; 0 if it never was welcomed.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a count of frames")]
    pub fn frames_per_second(&self) -> f64 {
        if self.seconds > 0.0 { self.frames.len() as f64 / self.seconds } else { 0.0 }
    }

    /// Bits of access units, a second of its whole time; 0 if it never was welcomed.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a count of bits")]
    pub fn bitrate_bps(&self) -> f64 {
        let bits: u64 = self.frames.iter().map(|frame| 8 * frame.bytes).sum();
        if self.seconds > 0.0 { bits as f64 / self.seconds } else { 0.0 }
    }

    /// Violations of all kinds.
    #[must_use]
    pub fn violation_count(&self) -> u64 {
        self.violations.values().map(|violations| violations.count).sum()
    }

    /// Whether it ended with a goodbye, from either side.
    #[must_use]
    pub fn ended_in_order(&self) -> bool {
        self.end.by != "network" && self.end.code == wire::CloseCode::Goodbye.value()
    }

    pub(crate) fn count_violation(&mut self, violation: &Violation) {
        let count = self.violations.entry(violation.kind()).or_default();
        count.count += 1;
        if count.examples.len() < MAX_EXAMPLES {
            count.examples.push(violation.to_string());
        }
    }
}

impl From<&Welcome> for SessionFacts {
    fn from(welcome: &Welcome) -> Self {
        let stream = &welcome.stream;
        Self {
            server_address: String::new(),
            server_name: welcome.server_name.clone(),
            protocol: String::from_utf8_lossy(wire::ALPN).into_owned(),
            session_id: welcome.session_id,
            scene_revision: welcome.scene_revision,
            stream_size_px: [stream.width_px, stream.height_px],
            refresh_hz: stream.refresh_hz.into(),
            bitrate_bps: stream.bitrate_bps,
            codec: stream.codec.clone(),
        }
    }
}

impl From<&FrameTimeline> for FrameTimes {
    fn from(timeline: &FrameTimeline) -> Self {
        Self {
            stages_us: timeline.stages().map(|(_, micros)| micros),
            pose_age_at_render_us: timeline.pose_age_at_render_us(),
            clock_error_us: timeline.clock_error_us,
        }
    }
}

impl From<ClockOffset> for ClockFacts {
    fn from(clock: ClockOffset) -> Self {
        Self { server_minus_headset_us: clock.server_minus_headset_us, error_us: clock.error_us }
    }
}

impl From<transport::Statistics> for PathFacts {
    fn from(statistics: transport::Statistics) -> Self {
        let micros = |time: std::time::Duration| u64::try_from(time.as_micros()).unwrap_or(u64::MAX);
        Self {
            rtt_us: micros(statistics.rtt),
            min_rtt_us: micros(statistics.min_rtt),
            packets_sent: statistics.packets_sent,
            packets_lost: statistics.packets_lost,
            bytes_sent: statistics.bytes_sent,
            bytes_received: statistics.bytes_received,
            datagrams_congested: statistics.datagrams_congested,
        }
    }
}

impl ServerStatisticsRecord {
    pub(crate) fn new(at_secs: f64, statistics: &ServerStatistics) -> Self {
        Self {
            at_secs,
            frames_rendered: statistics.frames_rendered,
            frames_sent: statistics.frames_sent,
            frames_reset: statistics.frames_reset,
            frames_skipped: statistics.frames_skipped,
            resolution_scale: statistics.quality.resolution_scale,
            step_scale: statistics.quality.step_scale,
            shading: statistics.quality.shading,
            bitrate_bps: statistics.bitrate_bps,
        }
    }
}

impl From<&Disconnection> for EndFacts {
    fn from(disconnection: &Disconnection) -> Self {
        let by = match disconnection.by {
            ClosedBy::Us => "us",
            ClosedBy::Peer => "peer",
            ClosedBy::Network => "network",
        };
        Self { by, code: disconnection.code.value(), reason: disconnection.reason.clone() }
    }
}
