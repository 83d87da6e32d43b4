//! The headset: the client's end of a connection, and a simulated headset that needs no hardware.
//!
//! - [`Headset`] connects, says hello, sends poses, and decodes every frame that it gets, on threads of a
//!   [`DecodePool`]. It is what an application for a real headset builds upon.
//! - [`SimulatedHeadset`] replays a recorded trace of head poses, checks that every frame is what was asked for, and
//!   keeps figures of each in a [`HeadsetRun`].
//! - [`load`] runs many of those in one process.
//!
//! This crate knows no volume, no scene and no renderer: of a picture it knows what the frame's header says.

mod check;
mod client;
mod clock;
mod decode;
mod display;
mod keep;
mod load;
mod model;
mod motion;
mod registration;
mod run;
mod simulated;
mod usage;

pub use check::{Checker, FrameFindings, PredictionError, SentPose, Violation};
pub use client::{DecodedFrame, Headset, HeadsetError, HeadsetEvent, HeadsetSettings};
pub use clock::HeadsetClock;
pub use decode::DecodePool;
pub use display::DisplayTiming;
pub use keep::{KeepError, KeepSettings, Kept, KeptRecording, PictureChoice, PictureSettings};
pub use load::{FailedHeadset, LoadRun, LoadSettings, load};
pub use model::{DeviceModel, ParseDeviceError};
pub use motion::TraceMotion;
pub use run::{
    ClockFacts, EndFacts, FrameRecord, FrameTimes, HeadsetRun, PathFacts, RunCounters, SampledFrame,
    SceneOutcome, SceneRequest, ServerStatisticsRecord, SessionFacts, ViolationCount,
};
pub use simulated::{Progress, SceneChange, SimulatedError, SimulatedHeadset, SimulatedSettings};
pub use usage::ProcessUsage;
