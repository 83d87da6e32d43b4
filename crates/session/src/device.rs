//! What a headset is, checked.

use crate::convert::{fov_from_wire, fov_to_wire, pose_from_wire, pose_to_wire};
use spatial::{FovError, HeadGeometry, PoseError};

/// Longest name of a device, in bytes.
pub const MAX_NAME_BYTES: usize = 64;
/// Sizes of one eye's picture along one side that are accepted, in pixels.
const SIDE_PX: std::ops::RangeInclusive<u32> = 16..=4096;
/// Refresh rates that are accepted, in pictures a second.
const REFRESH_HZ: std::ops::RangeInclusive<f32> = 1.0..=240.0;
/// Farthest that an eye may sit from the head's origin, in metres.
const FARTHEST_EYE_M: f64 = 1.0;

/// A headset that can be served.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// For people.
    pub name: String,
    /// Width of one eye's picture in pixels, even.
    pub eye_width_px: u32,
    /// Height of one eye's picture in pixels, even.
    pub eye_height_px: u32,
    /// Pictures that the display shows a second.
    pub refresh_hz: f32,
    /// Eyes on the head, metres, and what they see.
    pub geometry: HeadGeometry,
    /// Most bits a second that the headset wants.
    pub max_bitrate_bps: u32,
}

/// Why a device description cannot be served.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeviceError {
    /// The name is too long for a log line.
    #[error("device name has {found} bytes, expected at most {MAX_NAME_BYTES}")]
    Name {
        /// Its length in bytes.
        found: usize,
    },
    /// The picture is too small, too large, or has an odd side that 4:2:0 cannot halve.
    #[error("eye picture is {width}×{height} pixels, expected even sides of {} to {}", SIDE_PX.start(), SIDE_PX.end())]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// The refresh rate is none.
    #[error("refresh rate is {found} Hz, expected {} to {}", REFRESH_HZ.start(), REFRESH_HZ.end())]
    Refresh {
        /// As received.
        found: f32,
    },
    /// The pose of an eye on the head is none.
    #[error("{} eye: {source}", side(*eye))]
    Pose {
        /// 0 left, 1 right.
        eye: usize,
        /// What is wrong.
        source: PoseError,
    },
    /// An eye sits too far from the head.
    #[error("{} eye: lies {found} m from the head, expected at most {FARTHEST_EYE_M}", side(*eye))]
    EyeTooFar {
        /// 0 left, 1 right.
        eye: usize,
        /// Metres from the head's origin.
        found: f64,
    },
    /// The field of view of an eye is none.
    #[error("{} eye: {source}", side(*eye))]
    Fov {
        /// 0 left, 1 right.
        eye: usize,
        /// What is wrong.
        source: FovError,
    },
}

fn side(eye: usize) -> &'static str {
    if eye == 0 { "left" } else { "right" }
}

impl Device {
    /// Checks a description that came from outside.
    ///
    /// # Errors
    /// If a number is out of its range; the error says what was expected and what was found.
    pub fn checked(description: &wire::DeviceDescription) -> Result<Self, DeviceError> {
        let wire::DeviceDescription { name, eye_width_px, eye_height_px, refresh_hz, eyes, max_bitrate_bps } =
            description;
        if name.len() > MAX_NAME_BYTES {
            return Err(DeviceError::Name { found: name.len() });
        }
        let (width, height) = (*eye_width_px, *eye_height_px);
        if [width, height].iter().any(|side| !SIDE_PX.contains(side) || side % 2 != 0) {
            return Err(DeviceError::Size { width, height });
        }
        if !REFRESH_HZ.contains(refresh_hz) {
            return Err(DeviceError::Refresh { found: *refresh_hz });
        }
        let pose = |eye: usize| {
            let pose = pose_from_wire(&eyes[eye].head_from_eye)
                .map_err(|source| DeviceError::Pose { eye, source })?;
            let found = pose.position_m.length();
            if found > FARTHEST_EYE_M { Err(DeviceError::EyeTooFar { eye, found }) } else { Ok(pose) }
        };
        let fov =
            |eye: usize| fov_from_wire(&eyes[eye].fov).map_err(|source| DeviceError::Fov { eye, source });
        Ok(Self {
            name: name.clone(),
            eye_width_px: width,
            eye_height_px: height,
            refresh_hz: *refresh_hz,
            geometry: HeadGeometry { head_from_eye: [pose(0)?, pose(1)?], fov: [fov(0)?, fov(1)?] },
            max_bitrate_bps: *max_bitrate_bps,
        })
    }

    /// The description that a hello carries.
    #[must_use]
    pub fn to_wire(&self) -> wire::DeviceDescription {
        let eye = |eye: usize| wire::EyeGeometry {
            head_from_eye: pose_to_wire(&self.geometry.head_from_eye[eye]),
            fov: fov_to_wire(&self.geometry.fov[eye]),
        };
        wire::DeviceDescription {
            name: self.name.clone(),
            eye_width_px: self.eye_width_px,
            eye_height_px: self.eye_height_px,
            refresh_hz: self.refresh_hz,
            eyes: [eye(0), eye(1)],
            max_bitrate_bps: self.max_bitrate_bps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::Fov;

    fn description() -> wire::DeviceDescription {
        Device {
            name: "test".to_owned(),
            eye_width_px: 1268,
            eye_height_px: 720,
            refresh_hz: 60.0,
            geometry: HeadGeometry::parallel(0.064, Fov::symmetric(0.52, 0.3).unwrap()),
            max_bitrate_bps: 20_000_000,
        }
        .to_wire()
    }

    #[test]
    fn a_device_survives_the_wire() {
        let device = Device::checked(&description()).unwrap();
        assert_eq!(device.to_wire(), description());
    }

    #[test]
    fn what_cannot_be_served_is_said() {
        let check = |spoil: &dyn Fn(&mut wire::DeviceDescription), expected: &str| {
            let mut spoilt = description();
            spoil(&mut spoilt);
            assert_eq!(Device::checked(&spoilt).unwrap_err().to_string(), expected);
        };
        check(
            &|d| d.eye_width_px = 1267,
            "eye picture is 1267×720 pixels, expected even sides of 16 to 4096",
        );
        check(&|d| d.eye_height_px = 0, "eye picture is 1268×0 pixels, expected even sides of 16 to 4096");
        check(
            &|d| d.eye_width_px = 4098,
            "eye picture is 4098×720 pixels, expected even sides of 16 to 4096",
        );
        check(&|d| d.refresh_hz = 0.0, "refresh rate is 0 Hz, expected 1 to 240");
        check(&|d| d.refresh_hz = f32::NAN, "refresh rate is NaN Hz, expected 1 to 240");
        check(&|d| d.name = "x".repeat(65), "device name has 65 bytes, expected at most 64");
        check(
            &|d| d.eyes[1].head_from_eye.orientation_xyzw = [0.0; 4],
            "right eye: pose orientation has length 0, expected 1 within 0.1",
        );
        check(
            &|d| d.eyes[0].head_from_eye.position_m = [0.0, 2.0, 0.0],
            "left eye: lies 2 m from the head, expected at most 1",
        );
        check(
            &|d| d.eyes[0].fov.right_rad = d.eyes[0].fov.left_rad,
            "left eye: field of view spans 0.000° by 17.189°, expected at least 0.1° each",
        );
        check(
            &|d| d.eyes[0].fov.left_rad = -std::f32::consts::FRAC_PI_2,
            "left eye: field of view has an edge at -90.00°, expected at most 85° from the viewing direction",
        );
    }
}
