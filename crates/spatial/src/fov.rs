//! What one eye sees: an asymmetric field of view.

use glam::DVec3;

/// Widest half angle that is accepted, in radians: a total of 170° for a symmetric field.
const WIDEST_HALF_ANGLE: f64 = 85.0 * std::f64::consts::PI / 180.0;
/// Narrowest total angle that is accepted, in radians: 0.1°.
const NARROWEST_TOTAL: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// An asymmetric field of view, as in OpenXR: four angles from the viewing direction in radians.
/// `left` and `down` are negative for an eye that sees to its left and downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fov {
    /// Angle of the left edge, radians, negative to the left.
    pub left: f64,
    /// Angle of the right edge, radians.
    pub right: f64,
    /// Angle of the upper edge, radians.
    pub up: f64,
    /// Angle of the lower edge, radians, negative downwards.
    pub down: f64,
}

/// Why four angles from outside are not a field of view.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FovError {
    /// An angle is NaN or infinite.
    #[error("field of view {0:?} has an angle that is not finite")]
    NotFinite([f64; 4]),
    /// An edge lies at 90° or beyond, or so near that the picture plane degenerates.
    #[error("field of view has an edge at {angle_deg:.2}°, expected at most 85° from the viewing direction")]
    TooWide {
        /// The edge's angle in degrees.
        angle_deg: f64,
    },
    /// The field is empty or turned inside out.
    #[error("field of view spans {horizontal_deg:.3}° by {vertical_deg:.3}°, expected at least 0.1° each")]
    TooNarrow {
        /// Right minus left, in degrees.
        horizontal_deg: f64,
        /// Up minus down, in degrees.
        vertical_deg: f64,
    },
}

impl Fov {
    /// Checks four angles (radians: left, right, up, down) that came from outside.
    ///
    /// # Errors
    /// If an angle is not finite, an edge lies more than 85° off the axis, or the field spans less than 0.1°.
    pub fn checked(left: f64, right: f64, up: f64, down: f64) -> Result<Self, FovError> {
        let angles = [left, right, up, down];
        if angles.iter().any(|a| !a.is_finite()) {
            return Err(FovError::NotFinite(angles));
        }
        // A hair more than 85°, so that 85° survives a trip through float32.
        if let Some(angle) = angles.iter().find(|a| a.abs() > WIDEST_HALF_ANGLE * (1.0 + 1e-6)) {
            return Err(FovError::TooWide { angle_deg: angle.to_degrees() });
        }
        let (horizontal, vertical) = (right - left, up - down);
        if horizontal < NARROWEST_TOTAL || vertical < NARROWEST_TOTAL {
            return Err(FovError::TooNarrow {
                horizontal_deg: horizontal.to_degrees(),
                vertical_deg: vertical.to_degrees(),
            });
        }
        Ok(Self { left, right, up, down })
    }

    /// A field symmetric about the axis, from its total angles in radians.
    ///
    /// # Errors
    /// As [`Fov::checked`].
    pub fn symmetric(horizontal: f64, vertical: f64) -> Result<Self, FovError> {
        Self::checked(-horizontal / 2.0, horizontal / 2.0, vertical / 2.0, -vertical / 2.0)
    }

    /// A symmetric field with square pixels, from the total vertical angle in radians and width over height.
    ///
    /// # Errors
    /// As [`Fov::checked`].
    pub fn from_vertical(vertical: f64, aspect: f64) -> Result<Self, FovError> {
        let half_width = (vertical / 2.0).tan() * aspect;
        Self::symmetric(2.0 * half_width.atan(), vertical)
    }

    /// Tangents of the four edges (left, right, up, down): where they cut the plane at distance 1.
    #[must_use]
    pub fn tangents(&self) -> [f64; 4] {
        [self.left.tan(), self.right.tan(), self.up.tan(), self.down.tan()]
    }

    /// The point at distance 1 in front of the eye (z = -1, eye space, not normalised) that a pixel coordinate
    /// sees. `x` and `y` run from 0 to 1, from the upper left corner of the picture.
    #[must_use]
    pub fn ray(&self, x: f64, y: f64) -> DVec3 {
        let [left, right, up, down] = self.tangents();
        DVec3::new(left + (right - left) * x, up + (down - up) * y, -1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn refuses_what_no_eye_sees() {
        assert!(matches!(Fov::symmetric(0.0, 1.0), Err(FovError::TooNarrow { .. })));
        assert!(matches!(Fov::symmetric(PI, 1.0), Err(FovError::TooWide { .. })));
        assert!(matches!(Fov::symmetric(-1.0, 1.0), Err(FovError::TooNarrow { .. })));
        assert!(matches!(Fov::symmetric(f64::NAN, 1.0), Err(FovError::NotFinite(_))));
    }

    #[test]
    fn accepts_one_degree_and_one_hundred_and_seventy() {
        for degrees in [1.0f64, 170.0] {
            Fov::symmetric(degrees.to_radians(), degrees.to_radians()).unwrap();
        }
    }

    #[test]
    fn rays_meet_the_edges() {
        let fov = Fov::checked(-0.3, 0.5, 0.2, -0.4).unwrap();
        let upper_left = fov.ray(0.0, 0.0);
        assert!((upper_left.x.atan2(1.0) + 0.3).abs() < 1e-15);
        assert!((upper_left.y.atan2(1.0) - 0.2).abs() < 1e-15);
        let lower_right = fov.ray(1.0, 1.0);
        assert!((lower_right.x.atan2(1.0) - 0.5).abs() < 1e-15);
        assert!((lower_right.y.atan2(1.0) + 0.4).abs() < 1e-15);
    }

    #[test]
    fn square_pixels_from_a_vertical_angle() {
        let fov = Fov::from_vertical(30f64.to_radians(), 16.0 / 9.0).unwrap();
        let [left, right, up, down] = fov.tangents();
        assert!(((right - left) / (up - down) - 16.0 / 9.0).abs() < 1e-12);
    }
}
