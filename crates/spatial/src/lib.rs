//! Poses, fields of view and stereo views.
//!
//! Spaces and units: `world` is the room, in metres, right-handed, +Y up, -Z forward, as in OpenXR. An `eye` looks
//! along its own -Z. A transform is named `world_from_eye`: it takes a point in eye space to world space.
//! All numbers are float64 here; what travels or goes to a GPU is rounded there.
//!
//! This crate knows no file, no wire format, no GPU and no network.

mod fov;
mod pose;
mod predict;
mod registration;
mod view;

pub use fov::{Fov, FovError};
pub use pose::{Pose, PoseError};
pub use predict::{Motion, PoseAt, Predictor};
pub use registration::{Displacement, displacement};
pub use view::{EyeView, HeadGeometry, StereoView};

/// Vectors and rotations in float64, re-exported so that the crates above agree on one version.
pub use glam::{DAffine3, DMat3, DMat4, DQuat, DVec2, DVec3};
