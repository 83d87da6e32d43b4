//! Which headset is simulated.

use session::Device;
use spatial::{Fov, FovError, HeadGeometry};
use std::fmt;
use std::str::FromStr;

/// Distance of the eyes, in metres.
const EYE_DISTANCE_M: f64 = 0.064;
/// Horizontal field of view of a headset that is given by its pixels alone, in degrees.
const DEFAULT_HORIZONTAL_DEG: f64 = 30.0;
/// Sides of one eye's picture that are accepted, in pixels: what a session takes.
const SIDE_PX: std::ops::RangeInclusive<u32> = 16..=4096;
/// Bits for a pixel that a headset asks for at most: 22 Mbit/s for HoloLens 1.
const BITS_PER_PIXEL: f64 = 0.2;

/// A headset's model, as it is named on a command line: `hololens1`, `hololens2`, or the pixels of one eye as `320x180`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceModel {
    /// 1268×720 pixels an eye, 30° by 17.5°.
    HoloLens1,
    /// 1440×936 pixels an eye, 43° by 29°.
    HoloLens2,
    /// So many pixels an eye, square ones, 30° wide.
    Pixels {
        /// Width of one eye's picture, even.
        width: u32,
        /// Height of one eye's picture, even.
        height: u32,
    },
}

/// Why a text names no headset.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParseDeviceError {
    /// It is neither a name nor a size.
    #[error(
        "unknown headset {found:?}, expected hololens1, hololens2 or WIDTHxHEIGHT of one eye, such as 320x180"
    )]
    Unknown {
        /// As it was given.
        found: String,
    },
    /// The video format halves both sides.
    #[error("eye picture of {width}x{height} pixels has an odd side, expected even ones")]
    Odd {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// The picture is too small or too large.
    #[error(
        "eye picture of {width}x{height} pixels, expected sides of {} to {}",
        SIDE_PX.start(),
        SIDE_PX.end()
    )]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// With square pixels, the picture is higher than an eye can see.
    #[error("eye picture of {width}x{height} pixels, {DEFAULT_HORIZONTAL_DEG}° wide: {source}")]
    Fov {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// What is wrong.
        source: FovError,
    },
}

impl DeviceModel {
    /// Width and height of one eye's picture, in pixels.
    #[must_use]
    pub fn eye_size_px(self) -> [u32; 2] {
        match self {
            Self::HoloLens1 => [1268, 720],
            Self::HoloLens2 => [1440, 936],
            Self::Pixels { width, height } => [width, height],
        }
    }

    /// The headset, to be told to a server. `refresh_hz` is 1 to 240.
    ///
    /// # Errors
    /// If the picture has no field of view that an eye can have.
    pub fn device(self, refresh_hz: f32) -> Result<Device, ParseDeviceError> {
        let [width, height] = self.eye_size_px();
        let fov = match self {
            Self::HoloLens1 => Fov::symmetric(30f64.to_radians(), 17.5f64.to_radians()),
            Self::HoloLens2 => Fov::symmetric(43f64.to_radians(), 29f64.to_radians()),
            Self::Pixels { .. } => {
                let half_width = (DEFAULT_HORIZONTAL_DEG / 2.0).to_radians().tan();
                let half_height = half_width * f64::from(height) / f64::from(width);
                Fov::symmetric(DEFAULT_HORIZONTAL_DEG.to_radians(), 2.0 * half_height.atan())
            }
        };
        let fov = fov.map_err(|source| ParseDeviceError::Fov { width, height, source })?;
        let bitrate_bps = BITS_PER_PIXEL * 2.0 * f64::from(width) * f64::from(height) * f64::from(refresh_hz);
        Ok(Device {
            name: self.to_string(),
            eye_width_px: width,
            eye_height_px: height,
            refresh_hz,
            geometry: HeadGeometry::parallel(EYE_DISTANCE_M, fov),
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the bounds")]
            max_bitrate_bps: bitrate_bps.clamp(1e6, 100e6) as u32,
        })
    }
}

impl FromStr for DeviceModel {
    type Err = ParseDeviceError;

    fn from_str(text: &str) -> Result<Self, ParseDeviceError> {
        let lower = text.trim().to_ascii_lowercase();
        match lower.as_str() {
            "hololens1" => return Ok(Self::HoloLens1),
            "hololens2" => return Ok(Self::HoloLens2),
            _ => {}
        }
        let size = lower
            .split_once(['x', '×'])
            .and_then(|(width, height)| Some((width.parse::<u32>().ok()?, height.parse::<u32>().ok()?)));
        let Some((width, height)) = size else {
            return Err(ParseDeviceError::Unknown { found: text.to_owned() });
        };
        if [width, height].iter().any(|side| !SIDE_PX.contains(side)) {
            return Err(ParseDeviceError::Size { width, height });
        }
        if [width, height].iter().any(|side| side % 2 != 0) {
            return Err(ParseDeviceError::Odd { width, height });
        }
        let model = Self::Pixels { width, height };
        model.device(60.0).map(|_| model)
    }
}

impl fmt::Display for DeviceModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::HoloLens1 => f.write_str("hololens1"),
            Self::HoloLens2 => f.write_str("hololens2"),
            Self::Pixels { width, height } => write!(f, "{width}x{height}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headsets_are_named_or_measured() {
        let check = |text: &str, expected: DeviceModel| {
            assert_eq!(text.parse(), Ok(expected), "{text}");
            assert_eq!(expected.to_string().parse(), Ok(expected), "its own name leads back");
        };
        check("hololens1", DeviceModel::HoloLens1);
        check("HoloLens2", DeviceModel::HoloLens2);
        check(" 320x180 ", DeviceModel::Pixels { width: 320, height: 180 });
        check("160X90", DeviceModel::Pixels { width: 160, height: 90 });
    }

    #[test]
    fn what_is_no_headset_is_said() {
        let check = |text: &str, expected: &str| {
            let error = text.parse::<DeviceModel>().unwrap_err().to_string();
            assert_eq!(error, expected, "{text}");
        };
        let unknown = |text: &str| {
            format!(
                "unknown headset {text:?}, expected hololens1, hololens2 or WIDTHxHEIGHT of one eye, such as 320x180"
            )
        };
        for text in ["", "quest", "320", "320x", "x180", "320x180x2", "-320x180", "3e2x180", "99999999999x2"]
        {
            check(text, &unknown(text));
        }
        check("321x180", "eye picture of 321x180 pixels has an odd side, expected even ones");
        check("320x181", "eye picture of 320x181 pixels has an odd side, expected even ones");
        check("0x0", "eye picture of 0x0 pixels, expected sides of 16 to 4096");
        check("4098x180", "eye picture of 4098x180 pixels, expected sides of 16 to 4096");
        assert!(matches!("16x4096".parse::<DeviceModel>(), Err(ParseDeviceError::Fov { .. })));
    }

    #[test]
    fn every_device_can_be_served() {
        for text in ["hololens1", "hololens2", "320x180", "16x16", "180x320", "4096x16"] {
            let device = text.parse::<DeviceModel>().unwrap().device(60.0).unwrap();
            assert_eq!(Device::checked(&device.to_wire()).unwrap().eye_width_px, device.eye_width_px);
        }
    }

    #[test]
    fn the_known_fields_of_view_are_those_of_the_devices() {
        let check = |model: DeviceModel, horizontal_deg: f64, vertical_deg: f64| {
            let fov = model.device(60.0).unwrap().geometry.fov[0];
            assert!((fov.right - fov.left - horizontal_deg.to_radians()).abs() < 1e-12);
            assert!((fov.up - fov.down - vertical_deg.to_radians()).abs() < 1e-12);
        };
        check(DeviceModel::HoloLens1, 30.0, 17.5);
        check(DeviceModel::HoloLens2, 43.0, 29.0);
        // Square pixels: the tangents are as the sides.
        let fov = DeviceModel::Pixels { width: 320, height: 180 }.device(60.0).unwrap().geometry.fov[0];
        let [left, right, up, down] = fov.tangents();
        assert!(((right - left) / (up - down) - 320.0 / 180.0).abs() < 1e-12);
    }
}
