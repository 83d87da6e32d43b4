//! Position and orientation of a rigid body.

use glam::{DAffine3, DQuat, DVec3};

/// How far a quaternion's length may be from 1 before it is taken for garbage rather than for rounding.
const UNIT_LENGTH_TOLERANCE: f64 = 0.1;
/// Farthest a position may lie from the origin of the world, in metres. A headset does not leave the building.
const FARTHEST_M: f64 = 1.0e4;

/// Where a body is and how it is turned: `world_from_body`, metres and a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Origin of the body in the world, in metres.
    pub position_m: DVec3,
    /// Rotation that takes body axes to world axes; unit length.
    pub orientation: DQuat,
}

/// Why six numbers from outside are not a pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A coordinate is NaN or infinite.
    #[error("pose position {0} has a coordinate that is not finite")]
    PositionNotFinite(DVec3),
    /// A coordinate is farther from the origin than any room is large.
    #[error("pose position {position} lies farther than {FARTHEST_M} m from the origin")]
    PositionTooFar {
        /// The position as received, in metres.
        position: DVec3,
    },
    /// A component of the quaternion is NaN or infinite.
    #[error("pose orientation {0} has a component that is not finite")]
    OrientationNotFinite(DQuat),
    /// The quaternion is not a rotation: its length is not near 1.
    #[error("pose orientation has length {length}, expected 1 within {UNIT_LENGTH_TOLERANCE}")]
    OrientationNotUnit {
        /// The length as received.
        length: f64,
    },
}

impl Pose {
    /// The body at the world's origin, looking along -Z.
    pub const IDENTITY: Self = Self { position_m: DVec3::ZERO, orientation: DQuat::IDENTITY };

    /// Checks numbers that came from outside and makes the quaternion exactly unit.
    ///
    /// # Errors
    /// If a number is not finite, the position is out of any room, or the quaternion's length is not within 0.1 of 1.
    pub fn checked(position_m: DVec3, orientation: DQuat) -> Result<Self, PoseError> {
        if !position_m.is_finite() {
            return Err(PoseError::PositionNotFinite(position_m));
        }
        if position_m.abs().max_element() > FARTHEST_M {
            return Err(PoseError::PositionTooFar { position: position_m });
        }
        if !orientation.is_finite() {
            return Err(PoseError::OrientationNotFinite(orientation));
        }
        let length = orientation.length();
        if (length - 1.0).abs() > UNIT_LENGTH_TOLERANCE {
            return Err(PoseError::OrientationNotUnit { length });
        }
        Ok(Self { position_m, orientation: orientation.normalize() })
    }

    /// A pose at `eye` that looks at `target` with `up` upwards, all in one space.
    /// `None` where they do not span a frame (eye on the target, or looking along `up`).
    #[must_use]
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Option<Self> {
        let backward = (eye - target).try_normalize()?;
        let right = up.cross(backward).try_normalize()?;
        let up = backward.cross(right);
        Some(Self {
            position_m: eye,
            orientation: DQuat::from_mat3(&glam::DMat3::from_cols(right, up, backward)).normalize(),
        })
    }

    /// This pose as a transform from body to world.
    #[must_use]
    pub fn world_from_body(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.orientation, self.position_m)
    }

    /// The pose of `child`, given in this body's space, in the world.
    #[must_use]
    pub fn then(&self, child: &Self) -> Self {
        Self {
            position_m: self.position_m + self.orientation * child.position_m,
            orientation: (self.orientation * child.orientation).normalize(),
        }
    }

    /// The pose a part of the way to `other`: positions linearly, orientations along the shorter great arc.
    /// `fraction` 0 is this pose, 1 is `other`.
    #[must_use]
    pub fn interpolated(&self, other: &Self, fraction: f64) -> Self {
        Self {
            position_m: self.position_m.lerp(other.position_m, fraction),
            orientation: self.orientation.slerp(other.orientation, fraction).normalize(),
        }
    }

    /// The angle between two orientations, in radians, 0 to π.
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        // 2·atan2(|v|, |w|) keeps its digits for tiny angles, where acos(w) has none left.
        let between = self.orientation.conjugate() * other.orientation;
        2.0 * between.xyz().length().atan2(between.w.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn refuses_what_is_no_pose() {
        let here = DVec3::ZERO;
        let bad = |q| Pose::checked(here, q).unwrap_err();
        assert!(matches!(bad(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)), PoseError::OrientationNotUnit { .. }));
        assert!(matches!(bad(DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0)), PoseError::OrientationNotUnit { .. }));
        assert!(matches!(bad(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0)), PoseError::OrientationNotFinite(_)));
        assert!(matches!(
            bad(DQuat::from_xyzw(f64::INFINITY, 0.0, 0.0, 1.0)),
            PoseError::OrientationNotFinite(_)
        ));
        let at = |p| Pose::checked(p, DQuat::IDENTITY).unwrap_err();
        assert!(matches!(at(DVec3::new(0.0, f64::NAN, 0.0)), PoseError::PositionNotFinite(_)));
        assert!(matches!(at(DVec3::new(0.0, 2.0e4, 0.0)), PoseError::PositionTooFar { .. }));
    }

    #[test]
    fn mends_a_quaternion_that_was_rounded() {
        let rounded = DQuat::from_xyzw(0.0, 0.707, 0.0, 0.707);
        let pose = Pose::checked(DVec3::ZERO, rounded).unwrap();
        assert!((pose.orientation.length() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn looking_at_puts_the_target_straight_ahead() {
        let pose = Pose::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 1.0, 0.5), DVec3::Y).unwrap();
        let ahead = pose.orientation * DVec3::NEG_Z;
        assert!((ahead - DVec3::new(-5.0, -1.0, -2.5).normalize()).length() < 1e-12);
        assert!(Pose::looking_at(DVec3::ZERO, DVec3::Y, DVec3::Y).is_none());
        assert!(Pose::looking_at(DVec3::ZERO, DVec3::ZERO, DVec3::Y).is_none());
    }

    #[test]
    fn angle_keeps_its_digits_when_tiny() {
        let turned = Pose { orientation: DQuat::from_rotation_y(1e-9), ..Pose::IDENTITY };
        assert!((Pose::IDENTITY.angle_to(&turned) - 1e-9).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn interpolation_meets_both_ends(x in -5.0..5.0f64, yaw in -3.0..3.0f64, pitch in -1.5..1.5f64) {
            let a = Pose::IDENTITY;
            let b = Pose {
                position_m: DVec3::new(x, 1.0, -x),
                orientation: DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch),
            };
            prop_assert!(a.interpolated(&b, 0.0).angle_to(&a) < 1e-12);
            prop_assert!(a.interpolated(&b, 1.0).angle_to(&b) < 1e-7);
            prop_assert!((a.interpolated(&b, 1.0).position_m - b.position_m).length() < 1e-12);
        }
    }
}
