//! Where a head will be: extrapolation from its last poses.

use crate::Pose;
use glam::{DQuat, DVec3};

/// A pose and when it was taken, in seconds of any one clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseAt {
    /// Seconds, of the clock that all the poses of one motion share.
    pub time_secs: f64,
    /// The pose at that time.
    pub pose: Pose,
}

/// A body's velocity: constant, in the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Metres a second.
    pub linear_m_per_sec: DVec3,
    /// Axis times radians a second.
    pub angular_rad_per_sec: DVec3,
}

impl Motion {
    /// No motion.
    pub const REST: Self = Self { linear_m_per_sec: DVec3::ZERO, angular_rad_per_sec: DVec3::ZERO };

    /// The mean velocity from one pose to a later one; [`Motion::REST`] where no time lies between them.
    #[must_use]
    pub fn between(earlier: &PoseAt, later: &PoseAt) -> Self {
        let elapsed = later.time_secs - earlier.time_secs;
        if elapsed <= 0.0 || !elapsed.is_finite() {
            return Self::REST;
        }
        let mut turn = later.pose.orientation * earlier.pose.orientation.conjugate();
        if turn.w < 0.0 {
            turn = -turn; // the shorter way round
        }
        Self {
            linear_m_per_sec: (later.pose.position_m - earlier.pose.position_m) / elapsed,
            angular_rad_per_sec: turn.to_scaled_axis() / elapsed,
        }
    }

    /// `pose` after moving like this for `secs`.
    #[must_use]
    pub fn applied(&self, pose: &Pose, secs: f64) -> Pose {
        Pose {
            position_m: pose.position_m + self.linear_m_per_sec * secs,
            orientation: (DQuat::from_scaled_axis(self.angular_rad_per_sec * secs) * pose.orientation)
                .normalize(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_turn_is_predicted_exactly() {
        let at = |t: f64| PoseAt {
            time_secs: t,
            pose: Pose {
                position_m: DVec3::new(0.5 * t, 1.6, -0.2 * t),
                orientation: DQuat::from_rotation_y(0.9 * t),
            },
        };
        let predicted = Motion::between(&at(1.0), &at(1.02)).applied(&at(1.02).pose, 0.05);
        assert!(predicted.angle_to(&at(1.07).pose) < 1e-9);
        assert!((predicted.position_m - at(1.07).pose.position_m).length() < 1e-12);
    }

    #[test]
    fn opposite_quaternions_are_the_same_orientation() {
        let a = PoseAt { time_secs: 0.0, pose: Pose::IDENTITY };
        let b = PoseAt { time_secs: 0.1, pose: Pose { orientation: -DQuat::IDENTITY, ..Pose::IDENTITY } };
        assert!(Motion::between(&a, &b).angular_rad_per_sec.length() < 1e-9);
    }

    #[test]
    fn poses_at_one_instant_give_rest() {
        let a = PoseAt { time_secs: 1.0, pose: Pose::IDENTITY };
        assert_eq!(Motion::between(&a, &a), Motion::REST);
    }
}
