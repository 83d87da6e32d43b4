//! The stereo frame: what a scene looks like from two eyes.
//!
//! A frame is planned, then executed. [`StereoPlan`] is data: eyes, sizes, step, features; it is tested without a
//! device. [`FrameRenderer`] submits it to the GPU and gives back a [`FinishedFrame`]: YUV planes for the encoder, a
//! coarse depth grid, GPU times. [`StillRenderer`] gives the picture itself, in float32.
//!
//! What is drawn is defined in `docs/picture.md`; the shaders lie in `shaders/`. Cells of 8 voxels that hold nothing to
//! be seen are jumped over in whole samples, so that a picture with skipping equals one without it bit for bit.
//!
//! This crate knows no codec, no wire format, no network and reads no clock.

mod cells;
mod counts;
mod error;
mod frame;
mod gpu;
mod labels;
mod layout;
mod pipelines;
mod plan;
mod quality;
mod scene_on_device;
mod several;
mod shaders;
mod still;
mod table;
mod targets;
mod volume_on_device;

pub use counts::Counts;
pub use error::{OpenError, RenderError};
pub use frame::{FinishedFrame, FrameInFlight, FrameRenderer, GpuTimes};
pub use gpu::{AdapterFacts, Gpu};
pub use plan::{DepthGridSize, Placed, PlanError, StereoPlan, StereoRequest};
pub use quality::{Quality, Sampling};
pub use scene_on_device::{SceneNumbers, SceneOnDevice};
pub use still::{Still, StillRenderer};
pub use volume_on_device::{SharedVolume, VolumeOnDevice};
