//! One headset of a run: what is known of it, and what the report makes of that.

use crate::check::Check;
use crate::registration::Registration;
use crate::verification::{Verification, VerificationReport};
use crate::{Distribution, FrameRecord, StageNames};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What is known of one headset when the run is over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeadsetRun {
    /// Its name in the run; no two headsets share one.
    pub name: String,
    /// Its model, such as `hololens1`.
    pub device: String,
    /// Width and height of one eye's picture, in pixels.
    pub eye_size_px: [u32; 2],
    /// The pose trace that it replayed.
    pub trace: String,
    /// When it began to ask for frames, in seconds since the run began.
    pub started_at_secs: f64,
    /// For how long it asked for frames, in seconds.
    pub seconds: f64,
    /// Frames a second that it asked for.
    pub asked_hz: f64,
    /// Distance of samples along a ray at full quality, in the unit of its frames: 1.
    pub full_step_scale: f64,
    /// What was counted.
    pub counters: Counters,
    /// Frames that were decoded and were not what was asked for, by kind: size, order, view, black, ….
    pub violations: BTreeMap<String, u64>,
    /// Its clock against the server's; `None` if it was never measured.
    pub clock: Option<Clock>,
    /// Every decoded frame, in the order of decoding.
    pub frames: Vec<FrameRecord>,
    /// Pictures that were held against the exact ones; `None` if nobody asked for that.
    pub verification: Option<Verification>,
}

/// What was counted for one headset. What only the server counts is `None` if the server did not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Frames that the server rendered and encoded.
    pub rendered: Option<u64>,
    /// Frames that the server gave to the network.
    pub sent: Option<u64>,
    /// Frames whose stream the server reset because they were late.
    pub reset: Option<u64>,
    /// Frames that were due and that the server did not begin.
    pub skipped: Option<u64>,
    /// Frames that arrived whole.
    pub received: u64,
    /// Frames that were decoded.
    pub decoded: u64,
    /// Frames that were decoded after their predicted display time.
    pub late: u64,
    /// Frames that did not arrive whole, or hung on one that did not.
    pub lost: u64,
    /// Frames that arrived after a newer one and were not shown.
    pub stale: u64,
    /// Frames that arrived whole and did not decode.
    pub undecodable: u64,
}

/// A headset's clock against the server's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// The server's clock minus the headset's, in microseconds, at the run's end.
    pub server_minus_headset_us: i64,
    /// How wrong that may be, in microseconds.
    pub error_us: u64,
}

/// What one headset got.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadsetReport {
    /// Its name in the run.
    pub name: String,
    /// Its model.
    pub device: String,
    /// Width and height of one eye's picture, in pixels.
    pub eye_size_px: [u32; 2],
    /// The pose trace that it replayed.
    pub trace: String,
    /// When it began to ask for frames, in seconds since the run began.
    pub started_at_secs: f64,
    /// For how long it asked for frames, in seconds.
    pub seconds: f64,
    /// Frames a second that it asked for.
    pub asked_hz: f64,
    /// Frames a second that it decoded, late ones included. 0 if it never ran.
    pub achieved_hz: f64,
    /// Frames a second that it decoded in time for their display.
    pub in_time_hz: f64,
    /// What was counted.
    pub counters: Counters,
    /// Frames that were not what was asked for, by kind.
    pub violations: BTreeMap<String, u64>,
    /// Its clock against the server's.
    pub clock: Option<Clock>,
    /// Whether the frames' numbers hold together.
    pub check: Check,
    /// `None` if no frame was decoded.
    pub bit_rate: Option<BitRate>,
    /// `None` if no frame was decoded.
    pub quality: Option<QualityGivenUp>,
    /// Each stage, in order.
    pub stages: Vec<StageTimes>,
    /// From the pose to the decoded picture, in microseconds.
    pub pose_to_decoded_us: Option<Distribution>,
    /// Age of the pose when the renderer began, in microseconds.
    pub pose_age_at_render_us: Option<Distribution>,
    /// Decoding minus predicted display time, in microseconds; positive is late.
    pub lateness_us: Option<Distribution>,
    /// Time between one decoded frame and the next, in microseconds. Its maximum is the longest freeze.
    pub interval_us: Option<Distribution>,
    /// Size of access units, in bytes.
    pub frame_bytes: Option<Distribution>,
    /// Error of the predicted head position, in millimetres, over the frames for which it is known.
    pub prediction_error_mm: Option<Distribution>,
    /// Error of the predicted head orientation, in degrees, over the frames for which it is known.
    pub prediction_error_deg: Option<Distribution>,
    /// From the pose to when the picture was shown, in microseconds.
    pub pose_to_shown_us: Option<Distribution>,
    /// How far points of the hologram seemed to be from where they are, over the frames for which it is known.
    pub registration: Option<Registration>,
    /// Pictures that were held against the exact ones.
    pub verification: Option<VerificationReport>,
}

/// One stage over many frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// The stage's name.
    pub name: String,
    /// How long it took, in microseconds; `None` if no frame was decoded.
    pub us: Option<Distribution>,
}

/// Bits a second of a stream's access units; what the network adds is not counted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BitRate {
    /// Over the headset's whole time.
    pub mean_bps: f64,
    /// The nearest-rank p95 over its full seconds, counted from its beginning; the mean if there is none.
    pub p95_bps: f64,
}

/// How much picture was given up to hold the rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct QualityGivenUp {
    /// Share of frames, 0 to 1, that were rendered below the stream's resolution.
    pub below_full_resolution_share: f64,
    /// Mean of rendered width over the stream's width.
    pub mean_resolution_scale: f64,
    /// The least of it.
    pub min_resolution_scale: f64,
    /// Share of frames, 0 to 1, whose step was longer than at full quality.
    pub above_full_step_share: f64,
    /// The step at full quality.
    pub full_step_scale: f64,
    /// Mean step, over the one at full quality.
    pub mean_step_scale: f64,
    /// The longest step, over the one at full quality.
    pub max_step_scale: f64,
}

/// A run of eleven days. What says that it was longer is not counted second by second.
const LONGEST_SECS: f64 = 1e6;

/// Scales and steps travel as float32; a difference below this is that rounding.
const ROUNDING: f64 = 1e-6;

impl HeadsetReport {
    pub(crate) fn new(headset: &HeadsetRun, names: &StageNames) -> Self {
        let frames = &headset.frames;
        let distribution = |value: fn(&FrameRecord) -> i64| Distribution::of_whole(frames.iter().map(value));
        let in_time = headset.counters.decoded.saturating_sub(headset.counters.late);
        Self {
            name: headset.name.clone(),
            device: headset.device.clone(),
            eye_size_px: headset.eye_size_px,
            trace: headset.trace.clone(),
            started_at_secs: headset.started_at_secs,
            seconds: headset.seconds,
            asked_hz: headset.asked_hz,
            achieved_hz: rate(headset.counters.decoded, headset.seconds),
            in_time_hz: rate(in_time, headset.seconds),
            counters: headset.counters,
            violations: headset.violations.clone(),
            clock: headset.clock,
            check: Check::of(headset, names),
            bit_rate: BitRate::of(headset),
            quality: QualityGivenUp::of(headset),
            stages: stage_times(names, || frames.iter()),
            pose_to_decoded_us: distribution(|frame| frame.pose_to_decoded_us),
            pose_age_at_render_us: distribution(|frame| frame.pose_age_at_render_us),
            lateness_us: distribution(|frame| frame.lateness_us),
            interval_us: Distribution::of(
                frames.windows(2).map(|pair| (pair[1].decoded_at_secs - pair[0].decoded_at_secs) * 1e6),
            ),
            frame_bytes: Distribution::of(frames.iter().map(|frame| frame.bytes as f64)),
            prediction_error_mm: Distribution::of(
                frames.iter().filter_map(|frame| frame.prediction_error_mm),
            ),
            prediction_error_deg: Distribution::of(
                frames.iter().filter_map(|frame| frame.prediction_error_deg),
            ),
            pose_to_shown_us: distribution(|frame| frame.pose_to_shown_us),
            registration: Registration::of(frames),
            verification: headset.verification.as_ref().map(VerificationReport::of),
        }
    }
}

/// Every stage's distribution over the frames that `frames` begins to walk over again and again.
pub(crate) fn stage_times<'run, Frames>(names: &StageNames, frames: impl Fn() -> Frames) -> Vec<StageTimes>
where
    Frames: Iterator<Item = &'run FrameRecord>,
{
    let times = |stage: usize| frames().filter_map(move |frame| frame.stages_us.get(stage).copied());
    let stages = names.iter().enumerate();
    stages
        .map(|(stage, name)| StageTimes { name: name.to_owned(), us: Distribution::of_whole(times(stage)) })
        .collect()
}

fn rate(count: u64, seconds: f64) -> f64 {
    if seconds > 0.0 { count as f64 / seconds } else { 0.0 }
}

impl BitRate {
    fn of(headset: &HeadsetRun) -> Option<Self> {
        if headset.frames.is_empty() || headset.seconds <= 0.0 {
            return None;
        }
        let bits = |frame: &FrameRecord| frame.bytes as f64 * 8.0;
        let mean_bps = headset.frames.iter().map(bits).sum::<f64>() / headset.seconds;
        if !(1.0..LONGEST_SECS).contains(&headset.seconds) {
            return Some(Self { mean_bps, p95_bps: mean_bps });
        }
        let mut seconds = vec![0.0; headset.seconds as usize];
        for frame in &headset.frames {
            let second = frame.decoded_at_secs - headset.started_at_secs;
            if second >= 0.0
                && let Some(sum) = seconds.get_mut(second as usize)
            {
                *sum += bits(frame);
            }
        }
        let p95_bps = Distribution::of(seconds).map_or(mean_bps, |bits| bits.p95);
        Some(Self { mean_bps, p95_bps })
    }
}

impl QualityGivenUp {
    fn of(headset: &HeadsetRun) -> Option<Self> {
        let frames = &headset.frames;
        let scale = Distribution::of(frames.iter().map(|frame| frame.resolution_scale))?;
        let step = Distribution::of(frames.iter().map(|frame| frame.step_scale))?;
        let share = |lost: &dyn Fn(&FrameRecord) -> bool| {
            frames.iter().filter(|frame| lost(frame)).count() as f64 / frames.len() as f64
        };
        Some(Self {
            below_full_resolution_share: share(&|frame| frame.resolution_scale < 1.0 - ROUNDING),
            mean_resolution_scale: scale.mean,
            min_resolution_scale: scale.min,
            above_full_step_share: share(&|frame| frame.step_scale > headset.full_step_scale + ROUNDING),
            full_step_scale: headset.full_step_scale,
            mean_step_scale: step.mean,
            max_step_scale: step.max,
        })
    }
}
