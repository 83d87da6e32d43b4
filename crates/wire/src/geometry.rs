//! Poses and fields of view as they travel: float32, metres, radians.

use bincode::{Decode, Encode};

/// Position and orientation of one thing in the space of another.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// x, y, z in metres.
    pub position_m: [f32; 3],
    /// Unit quaternion x, y, z, w.
    pub orientation_xyzw: [f32; 4],
}

/// An asymmetric field of view: angles of four edges from the viewing direction, in radians, as in OpenXR.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct Fov {
    /// Left edge, negative to the left.
    pub left_rad: f32,
    /// Right edge.
    pub right_rad: f32,
    /// Upper edge.
    pub up_rad: f32,
    /// Lower edge, negative downwards.
    pub down_rad: f32,
}

/// Where an eye sits on the head, and what it sees.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct EyeGeometry {
    /// The eye in the head's space.
    pub head_from_eye: Pose,
    /// Its field of view.
    pub fov: Fov,
}

/// Where an eye was when a picture was made for it, and what it saw.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
pub struct EyeView {
    /// The eye in the world.
    pub world_from_eye: Pose,
    /// Its field of view.
    pub fov: Fov,
}
