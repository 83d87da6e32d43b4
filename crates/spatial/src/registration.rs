//! Where a point seems to be when a picture is shown to an eye that is no longer where the picture was made for.

use crate::{EyeView, Pose};
use glam::{DVec2, DVec3};

/// How far a point seems to be from where it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Displacement {
    /// The angle between the two directions, in degrees.
    pub angle_deg: f64,
    /// The distance of the two places in the picture, in pixels.
    pub px: f64,
}

/// How far `point_in_world` seems to be from where it is, when the picture that was made for `rendered` is shown, as it is
/// and without reprojection, to the eye that has come to `shown`. Pictures are `size_px` wide and high and fill `shown`'s
/// field of view.
///
/// `None` where the eye at `shown` does not see the point: behind it, or outside its picture. Nobody sees such a point in
/// the wrong place.
#[must_use]
pub fn displacement(
    rendered: &EyeView,
    shown: &EyeView,
    point_in_world: DVec3,
    size_px: [u32; 2],
) -> Option<Displacement> {
    let truly_in_eye = in_eye(shown, point_in_world);
    let seemingly_in_eye = in_eye(rendered, point_in_world);
    let truly_px = place_px(shown, truly_in_eye, size_px)?;
    let [width, height] = size_px.map(f64::from);
    if !(0.0..=width).contains(&truly_px.x) || !(0.0..=height).contains(&truly_px.y) {
        return None;
    }
    // The eye that sees the picture takes a place in it for the direction of its own field of view.
    let seemingly_px = place_px(rendered, seemingly_in_eye, size_px)?;
    Some(Displacement {
        angle_deg: angle(truly_in_eye, seemingly_in_eye).to_degrees(),
        px: truly_px.distance(seemingly_px),
    })
}

fn in_eye(eye: &EyeView, point_in_world: DVec3) -> DVec3 {
    let Pose { position_m, orientation } = eye.world_from_eye;
    orientation.conjugate() * (point_in_world - position_m)
}

/// Where a point stands in an eye's picture, from its upper left corner; `None` for a point that is not ahead.
fn place_px(eye: &EyeView, point_in_eye: DVec3, size_px: [u32; 2]) -> Option<DVec2> {
    if point_in_eye.z >= 0.0 || point_in_eye.z.is_nan() {
        return None;
    }
    let [left, right, up, down] = eye.fov.tangents();
    let on_plane = DVec2::new(point_in_eye.x, point_in_eye.y) / -point_in_eye.z;
    let [width, height] = size_px.map(f64::from);
    Some(DVec2::new(width * (on_plane.x - left) / (right - left), height * (up - on_plane.y) / (up - down)))
}

/// The angle between two directions, in radians; keeps its digits where it is tiny.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fov;
    use glam::DQuat;

    const SIZE_PX: [u32; 2] = [1268, 720];
    const AHEAD: DVec3 = DVec3::new(0.0, 0.0, -2.0);

    fn at(position_m: DVec3, yaw: f64) -> EyeView {
        let fov = Fov::symmetric(30f64.to_radians(), 17.5f64.to_radians()).unwrap();
        EyeView { world_from_eye: Pose { position_m, orientation: DQuat::from_rotation_y(yaw) }, fov }
    }

    #[test]
    fn a_turn_displaces_everything_by_its_own_angle() {
        // 50 degrees a second for 50 ms, seen by HoloLens 1: 2.5 degrees, and by the tangent of it 103 pixels.
        let turned = 2.5f64.to_radians();
        let found = displacement(&at(DVec3::ZERO, 0.0), &at(DVec3::ZERO, turned), AHEAD, SIZE_PX).unwrap();
        assert!((found.angle_deg - 2.5).abs() < 1e-12, "{found:?}");
        let focal_px = 634.0 / 15f64.to_radians().tan();
        assert!((found.px - focal_px * turned.tan()).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn a_step_aside_displaces_near_points_more_than_far_ones() {
        let (before, after) = (at(DVec3::ZERO, 0.0), at(DVec3::new(0.02, 0.0, 0.0), 0.0));
        for distance_m in [0.5, 1.0, 4.0] {
            let point = DVec3::new(0.0, 0.0, -distance_m);
            let found = displacement(&before, &after, point, SIZE_PX).unwrap();
            assert!((found.angle_deg - (0.02 / distance_m).atan().to_degrees()).abs() < 1e-12);
            assert!((found.px - 634.0 / 15f64.to_radians().tan() * 0.02 / distance_m).abs() < 1e-9);
        }
        // Straight ahead, a step towards a point moves it nowhere.
        let nearer = at(DVec3::new(0.0, 0.0, -0.5), 0.0);
        assert_eq!(displacement(&before, &nearer, AHEAD, SIZE_PX), Some(Displacement::default()));
    }

    #[test]
    fn one_view_displaces_nothing() {
        let view = at(DVec3::new(0.3, 1.6, 0.2), 0.1);
        let found = displacement(&view, &view, view.world_from_eye.position_m + AHEAD, SIZE_PX).unwrap();
        assert_eq!(found, Displacement::default());
    }

    #[test]
    fn what_is_not_seen_is_not_displaced() {
        let (here, turned) = (at(DVec3::ZERO, 0.0), at(DVec3::ZERO, 0.3));
        assert_eq!(displacement(&here, &turned, AHEAD, SIZE_PX), None, "outside the picture");
        assert_eq!(displacement(&here, &here, -AHEAD, SIZE_PX), None, "behind");
        assert_eq!(displacement(&here, &here, DVec3::ZERO, SIZE_PX), None, "at the eye");
        assert_eq!(displacement(&here, &here, DVec3::NAN, SIZE_PX), None);
    }
}
