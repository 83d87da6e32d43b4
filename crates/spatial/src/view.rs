//! Two eyes and what they see.

use crate::{Fov, Pose};
use glam::DVec3;

/// Where one eye is and what it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeView {
    /// The eye in the world.
    pub world_from_eye: Pose,
    /// Its field of view.
    pub fov: Fov,
}

/// Where two eyes are and what they see: left, then right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoView {
    /// Left eye, right eye.
    pub eyes: [EyeView; 2],
}

/// What of a headset does not change from frame to frame: where its eyes sit on the head, and their fields of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadGeometry {
    /// Eye poses on the head: left, right; metres.
    pub head_from_eye: [Pose; 2],
    /// Fields of view: left, right.
    pub fov: [Fov; 2],
}

impl HeadGeometry {
    /// Two parallel eyes `eye_distance_m` apart, both with `fov`.
    #[must_use]
    pub fn parallel(eye_distance_m: f64, fov: Fov) -> Self {
        let eye = |side: f64| Pose {
            position_m: DVec3::new(side * eye_distance_m / 2.0, 0.0, 0.0),
            ..Pose::IDENTITY
        };
        Self { head_from_eye: [eye(-1.0), eye(1.0)], fov: [fov, fov] }
    }

    /// What the two eyes see when the head is at `world_from_head`.
    #[must_use]
    pub fn view(&self, world_from_head: &Pose) -> StereoView {
        let eye = |i: usize| EyeView {
            world_from_eye: world_from_head.then(&self.head_from_eye[i]),
            fov: self.fov[i],
        };
        StereoView { eyes: [eye(0), eye(1)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn eyes_turn_with_the_head() {
        let geometry = HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.3).unwrap());
        let head = Pose {
            position_m: DVec3::new(1.0, 1.6, 2.0),
            orientation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
        };
        let view = geometry.view(&head);
        // Turned 90° to the left about +Y, the head's +X points along the world's -Z.
        let left_to_right = view.eyes[1].world_from_eye.position_m - view.eyes[0].world_from_eye.position_m;
        assert!((left_to_right - DVec3::new(0.0, 0.0, -0.064)).length() < 1e-12);
    }

    #[test]
    fn no_eye_distance_gives_equal_eyes() {
        let geometry = HeadGeometry::parallel(0.0, Fov::symmetric(0.5, 0.3).unwrap());
        let view = geometry.view(&Pose::IDENTITY);
        assert_eq!(view.eyes[0], view.eyes[1]);
    }
}
