//! Between the wire's float32 numbers and `spatial`'s checked float64 types.

use spatial::{DQuat, DVec3, EyeView, Fov, FovError, Pose, PoseError, StereoView};

pub(crate) fn pose_from_wire(pose: &wire::Pose) -> Result<Pose, PoseError> {
    Pose::checked(
        DVec3::from_array(pose.position_m.map(f64::from)),
        DQuat::from_array(pose.orientation_xyzw.map(f64::from)),
    )
}

pub(crate) fn fov_from_wire(fov: &wire::Fov) -> Result<Fov, FovError> {
    Fov::checked(fov.left_rad.into(), fov.right_rad.into(), fov.up_rad.into(), fov.down_rad.into())
}

#[expect(clippy::cast_possible_truncation, reason = "the wire carries float32: 0.1 mm at 1 km, 0.00001°")]
pub(crate) fn pose_to_wire(pose: &Pose) -> wire::Pose {
    wire::Pose {
        position_m: pose.position_m.to_array().map(|x| x as f32),
        orientation_xyzw: pose.orientation.to_array().map(|x| x as f32),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the wire carries float32")]
pub(crate) fn fov_to_wire(fov: &Fov) -> wire::Fov {
    wire::Fov {
        left_rad: fov.left as f32,
        right_rad: fov.right as f32,
        up_rad: fov.up as f32,
        down_rad: fov.down as f32,
    }
}

pub(crate) fn view_to_wire(view: &StereoView) -> [wire::EyeView; 2] {
    view.eyes.map(|eye| wire::EyeView {
        world_from_eye: pose_to_wire(&eye.world_from_eye),
        fov: fov_to_wire(&eye.fov),
    })
}

/// The view of a frame header, checked; `None` where it is no view.
pub(crate) fn view_from_wire(eyes: &[wire::EyeView; 2]) -> Option<StereoView> {
    let eye = |eye: &wire::EyeView| {
        Some(EyeView {
            world_from_eye: pose_from_wire(&eye.world_from_eye).ok()?,
            fov: fov_from_wire(&eye.fov).ok()?,
        })
    };
    Some(StereoView { eyes: [eye(&eyes[0])?, eye(&eyes[1])?] })
}
