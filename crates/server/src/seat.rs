//! A headset's seat in the room: what the threads that serve it share.

use crate::quality::Rung;
use codec::{Complexity, Encoder, EncoderSettings, PlaneLayout, SettingsError, YuvPicture};
use render::FinishedFrame;
use session::{Device, FrameTicket, ServerCounters, ServerSession, ServerTime, StreamTerms};
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// A headset that has had no frame for so long does not load the device.
const PAUSED: Duration = Duration::from_secs(1);
/// Share of a new measurement in the smoothed time of a frame on the device.
const SMOOTHING: f64 = 0.2;

/// One headset, from its connection to its end.
#[derive(Debug)]
pub(crate) struct Seat {
    pub(crate) id: u64,
    pub(crate) peer: SocketAddr,
    session: Mutex<ServerSession>,
    stream: OnceLock<Stream>,
    /// Scenes that this headset has asked for and that are being made.
    pub(crate) scenes_in_making: AtomicUsize,
    /// Wakes the connection's task: there is something to send.
    pub(crate) wake: Notify,
}

/// What there is once the headset has said what it is.
pub(crate) struct Stream {
    pub(crate) device: Device,
    pub(crate) period: Duration,
    pub(crate) layout: PlaneLayout,
    pub(crate) encoder: Mutex<Encoder>,
    /// Frames that are read back and wait for an encoder, in order. At most two: the session makes no more.
    pub(crate) waiting: Mutex<VecDeque<EncodeJob>>,
    /// Whether a thread encodes for this headset, or is about to.
    pub(crate) is_encoding: AtomicBool,
    load: Mutex<Load>,
}

/// A frame for the encoder.
#[derive(Debug)]
pub(crate) struct EncodeJob {
    pub(crate) ticket: FrameTicket,
    pub(crate) frame: FinishedFrame,
    pub(crate) scene_revision: u32,
    pub(crate) time_step: u32,
    pub(crate) rung: Rung,
    pub(crate) lit: bool,
    pub(crate) render_started: ServerTime,
    pub(crate) rendered: ServerTime,
    pub(crate) converted: ServerTime,
}

/// What this headset's frames cost the device.
#[derive(Debug, Default)]
struct Load {
    /// Smoothed time of a frame on the device, seconds; `None` before the first.
    frame_secs: Option<f64>,
    /// When the last one was done.
    last: ServerTime,
}

/// How a headset fares, for people and tests.
#[derive(Clone, Debug)]
pub struct SeatSnapshot {
    /// The session's number.
    pub session: u64,
    /// Where it comes from.
    pub peer: SocketAddr,
    /// What it is; `None` before it has said so.
    pub device: Option<String>,
    /// What its session has counted.
    pub counters: ServerCounters,
}

/// A lock whose data are whole whatever panicked elsewhere: each change of them is one assignment or one call of a
/// state machine that checks its own invariants.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Seat {
    pub(crate) fn new(id: u64, peer: SocketAddr, session: ServerSession) -> Self {
        Self {
            id,
            peer,
            session: Mutex::new(session),
            stream: OnceLock::new(),
            scenes_in_making: AtomicUsize::new(0),
            wake: Notify::new(),
        }
    }

    /// The session. Held for the time of a call, never while something is waited for.
    pub(crate) fn session(&self) -> MutexGuard<'_, ServerSession> {
        locked(&self.session)
    }

    /// The stream, once the headset has said what it is.
    pub(crate) fn stream(&self) -> Option<&Stream> {
        self.stream.get()
    }

    /// Makes the encoder and says what will be sent.
    pub(crate) fn open_stream(
        &self,
        device: &Device,
        bits_per_pixel: f64,
    ) -> Result<StreamTerms, SettingsError> {
        let (width_px, height_px) = (device.eye_width_px * 2, device.eye_height_px);
        let pixels_a_second = f64::from(width_px) * f64::from(height_px) * f64::from(device.refresh_hz);
        let wanted = (pixels_a_second * bits_per_pixel).clamp(1.5e6, 60.0e6);
        let bitrate_bps = (wanted as u32).min(device.max_bitrate_bps).max(100_000);
        let settings = EncoderSettings {
            width_px,
            height_px,
            frames_per_second: device.refresh_hz,
            bitrate_bps,
            complexity: Complexity::Low,
        };
        let mut encoder = Encoder::new(settings)?;
        let stride = (width_px as usize).next_multiple_of(8);
        let no_size = SettingsError::Size { width_px, height_px };
        let layout = PlaneLayout::with_stride(width_px, height_px, stride).map_err(|_| no_size)?;
        // The encoder names its stream once it has made some of it. Nobody sees this frame.
        let named = encoder.encode(YuvPicture::black(layout).as_frame(), true);
        let codec = match (named, encoder.codec_string()) {
            (Ok(_), Some(codec)) => codec.to_owned(),
            _ => "avc1.42C02A".to_owned(),
        };
        let period = Duration::from_secs_f64(1.0 / f64::from(device.refresh_hz));
        let stream = Stream {
            device: device.clone(),
            period,
            layout,
            encoder: Mutex::new(encoder),
            waiting: Mutex::default(),
            is_encoding: AtomicBool::new(false),
            load: Mutex::default(),
        };
        // A session says hello once, so there is no stream yet.
        let _ = self.stream.set(stream);
        Ok(StreamTerms { width_px, height_px, refresh_hz: device.refresh_hz, bitrate_bps, codec })
    }

    pub(crate) fn snapshot(&self) -> SeatSnapshot {
        SeatSnapshot {
            session: self.id,
            peer: self.peer,
            device: self.stream().map(|s| s.device.name.clone()),
            counters: self.session().counters(),
        }
    }
}

impl std::fmt::Debug for Stream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stream")
            .field("device", &self.device)
            .field("load", &self.load)
            .finish_non_exhaustive()
    }
}

impl Stream {
    /// Part of the device's time that its frames take at the full rate, at their present quality; 0 while it has none.
    pub(crate) fn device_share(&self, now: ServerTime) -> f64 {
        let load = locked(&self.load);
        if now.since(load.last) > PAUSED {
            return 0.0;
        }
        load.frame_secs.unwrap_or_default() / self.period.as_secs_f64()
    }

    /// A frame has taken this long on the device, and was done now.
    pub(crate) fn took(&self, now: ServerTime, on_device: Duration) {
        let mut load = locked(&self.load);
        let new = on_device.as_secs_f64();
        load.frame_secs = Some(load.frame_secs.map_or(new, |old| old + SMOOTHING * (new - old)));
        load.last = now;
    }

    /// Frames will cost this times as much: what is known of the old ones is carried over.
    pub(crate) fn expect_cost(&self, times: f64) {
        let mut load = locked(&self.load);
        load.frame_secs = load.frame_secs.map(|secs| secs * times);
    }
}
