//! A camera for stills.

use crate::error::{SceneError, within};
use spatial::{DVec3, Fov, Pose};

/// Where a still is taken from, in the volume's own millimetres: along its stored axes, no orientation applied, the
/// centre of the first voxel at the origin.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The eye, millimetres.
    pub eye: [f64; 3],
    /// The point in the middle of the picture, millimetres.
    pub target: [f64; 3],
    /// What is up in the picture.
    pub up: [f64; 3],
    /// Total vertical field of view in degrees.
    pub fov_y_deg: f64,
}

impl Camera {
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        for (name, v) in [("camera.eye", self.eye), ("camera.target", self.target), ("camera.up", self.up)] {
            for x in v {
                within(name, x, -1.0e9..=1.0e9, "finite, within 1e9 mm")?;
            }
        }
        within("camera.fov_y_deg", self.fov_y_deg, 0.1..=170.0, "0.1 to 170 degrees")?;
        if self.pose_mm().is_none() {
            return Err(SceneError::Range {
                field: "camera".into(),
                found: "an eye on its target, or looking along 'up'".into(),
                expected: "eye, target and up that span a picture",
            });
        }
        Ok(())
    }

    /// The camera as a pose whose positions are millimetres along the volume's own axes; `None` where eye, target and
    /// up do not span a picture.
    #[must_use]
    pub fn pose_mm(&self) -> Option<Pose> {
        Pose::looking_at(
            DVec3::from_array(self.eye),
            DVec3::from_array(self.target),
            DVec3::from_array(self.up),
        )
    }

    /// The field of view for a picture of `width_px` by `height_px` square pixels.
    ///
    /// # Errors
    /// If the picture is so wide that its edge lies beyond 85° off the axis.
    pub fn fov(&self, width_px: u32, height_px: u32) -> Result<Fov, spatial::FovError> {
        Fov::from_vertical(self.fov_y_deg.to_radians(), f64::from(width_px) / f64::from(height_px))
    }
}
