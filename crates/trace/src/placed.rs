//! Moving a whole trace: in front of a hologram, level, to scale.

use crate::Trace;
use spatial::{DQuat, DVec3, Pose};

/// Shortest mean of where a head's top points that still says where up is. A head that is upright half of the time and
/// upside down for the other has none.
const LEAST_UPRIGHT: f64 = 0.3;
/// Where a head looks up or down more steeply than by about 84°, its looking direction says nothing about its turn.
const LEAST_HORIZONTAL: f64 = 0.1;

/// Where a trace begins: from which side, and how far from what it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// What the first pose looks at, straight ahead; metres.
    pub target_in_world: DVec3,
    /// How far the first pose is from it, in metres.
    pub distance_m: f64,
    /// From which side, in radians about +Y: 0 from +Z, looking along -Z; a quarter turn from +X.
    pub azimuth_rad: f64,
}

impl Trace {
    /// The same motion elsewhere in the world: turned about the vertical and shifted, so that the first pose has
    /// `stand.target_in_world` straight ahead. Steps, pitch and roll stay as they were recorded: a head that began by
    /// looking down begins above the target.
    #[must_use]
    pub fn facing(&self, stand: &Stand) -> Self {
        let first = self.poses[0].pose;
        let turn = DQuat::from_rotation_y(stand.azimuth_rad - heading(&first));
        let ahead = turn * first.orientation * DVec3::NEG_Z;
        let position_m = stand.target_in_world - stand.distance_m * ahead;
        self.moved(|pose| Pose {
            position_m: position_m + turn * (pose.position_m - first.position_m),
            orientation: (turn * pose.orientation).normalize(),
        })
    }

    /// The same steps, by a head that keeps looking at `target_in_world`: of each turn away from it, heading and pitch
    /// apart, the sine times `most_rad` remains. So what was recorded stays in the motion, smooth and in proportion
    /// where it is small, but the target is never farther than `most_rad` from straight ahead either way. Roll stays.
    ///
    /// People who explore a room look everywhere: the target of [`Trace::facing`] is behind them at times. This is for
    /// those who look at one thing.
    #[must_use]
    pub fn attentive(&self, target_in_world: DVec3, most_rad: f64) -> Self {
        self.moved(|pose| {
            let [heading, pitch, roll] = angles(pose);
            let Some(straight) = Pose::looking_at(pose.position_m, target_in_world, DVec3::Y) else {
                return *pose; // on the target, or right below or above it
            };
            let [to_heading, to_pitch, _] = angles(&straight);
            let kept = |angle: f64, to_angle: f64| to_angle + most_rad * (angle - to_angle).sin();
            let orientation = DQuat::from_rotation_y(kept(heading, to_heading))
                * DQuat::from_rotation_x(kept(pitch, to_pitch))
                * DQuat::from_rotation_z(roll);
            Pose { orientation, ..*pose }
        })
    }

    /// The same motion, turned about the first pose's place so that the head's top points up on the average.
    /// A trace that has no such average stays as it is.
    pub(crate) fn levelled(&self) -> Self {
        let tops: DVec3 = self.poses.iter().map(|pose| pose.pose.orientation * DVec3::Y).sum();
        let mean = tops / self.poses.len() as f64;
        if mean.length() < LEAST_UPRIGHT {
            return self.clone();
        }
        let turn = DQuat::from_rotation_arc(mean.normalize(), DVec3::Y);
        let centre = self.poses[0].pose.position_m;
        self.moved(|pose| Pose {
            position_m: centre + turn * (pose.position_m - centre),
            orientation: (turn * pose.orientation).normalize(),
        })
    }

    /// Scales all positions about the origin.
    pub(crate) fn scale(&mut self, factor: f64) {
        for pose in &mut self.poses {
            pose.pose.position_m *= factor;
        }
    }

    fn moved(&self, move_pose: impl Fn(&Pose) -> Pose) -> Self {
        let mut trace = self.clone();
        for pose in &mut trace.poses {
            pose.pose = move_pose(&pose.pose);
        }
        trace
    }
}

/// Heading, pitch and roll in radians, so that the orientation is their turns about Y, then X, then Z.
fn angles(pose: &Pose) -> [f64; 3] {
    let (right, top, back) =
        (pose.orientation * DVec3::X, pose.orientation * DVec3::Y, pose.orientation * DVec3::Z);
    let pitch = (-back.y).clamp(-1.0, 1.0).asin();
    [back.x.atan2(back.z), pitch, right.y.atan2(top.y)]
}

/// A head's turn about +Y, in radians; 0 where it looks along -Z.
fn heading(pose: &Pose) -> f64 {
    let ahead = pose.orientation * DVec3::NEG_Z;
    if ahead.x.hypot(ahead.z) > LEAST_HORIZONTAL {
        (-ahead.x).atan2(-ahead.z)
    } else {
        let right = pose.orientation * DVec3::X;
        (-right.z).atan2(right.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ending, Format, Place, trace::Collector};
    use proptest::prelude::*;

    /// Two poses, the second a step of one metre along the first one's own -Z.
    fn step(first: Pose) -> Trace {
        let mut collector = Collector::new("step");
        let second = Pose { position_m: first.position_m + first.orientation * DVec3::NEG_Z, ..first };
        collector.push(Place::Line(1), 0.0, first).unwrap();
        collector.push(Place::Line(2), 1.0, second).unwrap();
        collector.finish(Format::Synthetic).unwrap()
    }

    #[test]
    fn the_hologram_is_ahead_at_its_distance_from_each_side() {
        let first = Pose {
            position_m: DVec3::new(-3.0, 0.2, 7.0),
            orientation: DQuat::from_rotation_y(2.0) * DQuat::from_rotation_x(-0.2),
        };
        let target_in_world = DVec3::new(0.0, 1.5, -2.0);
        for (azimuth_rad, side) in [(0.0, DVec3::Z), (std::f64::consts::FRAC_PI_2, DVec3::X)] {
            let stand = Stand { target_in_world, distance_m: 2.0, azimuth_rad };
            let placed = step(first).facing(&stand);
            let begin = placed.poses()[0].pose;
            let to_target = target_in_world - begin.position_m;
            assert!((to_target.length() - 2.0).abs() < 1e-12);
            assert!((begin.orientation * DVec3::NEG_Z - to_target / 2.0).length() < 1e-12);
            let from_target = (-to_target).with_y(0.0).normalize();
            assert!((from_target - side).length() < 1e-12, "{azimuth_rad}: {from_target}");
            // Half way into the step, the head is half a metre nearer.
            let later = placed.sample(0.5, Ending::Hold);
            assert!((later.position_m.distance(target_in_world) - 1.5).abs() < 1e-12);
        }
    }

    #[test]
    fn an_attentive_head_keeps_small_turns_in_proportion_and_never_looks_far_away() {
        let target_in_world = DVec3::new(0.0, 1.6, -2.0);
        let looking = |heading: f64, pitch: f64| {
            let orientation = DQuat::from_rotation_y(heading) * DQuat::from_rotation_x(pitch);
            let trace = Trace::still(Pose { position_m: DVec3::new(0.0, 1.6, 0.0), orientation });
            trace.attentive(target_in_world, 0.2).poses()[0].pose.orientation * DVec3::NEG_Z
        };
        let small = looking(0.1, 0.0).angle_between(DVec3::NEG_Z);
        assert!((small - 0.2 * 0.1f64.sin()).abs() < 1e-12, "{small}");
        for heading in [-3.1, -1.5, 0.5, 2.0, 3.1] {
            for pitch in [-1.5, 0.0, 1.2] {
                let off = looking(heading, pitch).angle_between(DVec3::NEG_Z);
                assert!(off < 0.2 * 1.4143, "{off} rad off for {heading}, {pitch}");
            }
        }
        // Past straight behind, where a heading jumps from π to -π, nothing jumps.
        let behind = [1e-4, -1e-4].map(|short| looking(std::f64::consts::PI - short, 0.0));
        assert!(behind[0].angle_between(behind[1]) < 1e-3);
    }

    #[test]
    fn a_head_that_looks_straight_down_is_placed_above() {
        let down =
            Pose { orientation: DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2), ..Pose::IDENTITY };
        let target_in_world = DVec3::new(0.0, 1.0, 0.0);
        let placed = step(down).facing(&Stand { target_in_world, distance_m: 0.5, azimuth_rad: 0.0 });
        assert!((placed.poses()[0].pose.position_m - DVec3::new(0.0, 1.5, 0.0)).length() < 1e-9);
        assert!(placed.poses()[0].pose.angle_to(&down) < 1e-9);
    }

    #[test]
    fn a_head_without_an_upright_mean_is_left_as_it_is() {
        let mut collector = Collector::new("tumbling");
        for (time_secs, roll) in [(0.0, 0.0), (1.0, std::f64::consts::PI)] {
            let pose = Pose { orientation: DQuat::from_rotation_z(roll), ..Pose::IDENTITY };
            collector.push(Place::Line(1), time_secs, pose).unwrap();
        }
        let trace = collector.finish(Format::Synthetic).unwrap();
        assert_eq!(trace.levelled(), trace);
    }

    proptest! {
        #[test]
        fn placing_keeps_the_motion_and_what_is_up(
            yaw in -3.0..3.0f64,
            pitch in -1.4..1.4f64,
            roll in -0.5..0.5f64,
            azimuth_rad in -3.0..3.0f64,
        ) {
            let orientation =
                DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(roll);
            let trace = step(Pose { position_m: DVec3::new(1.0, 1.6, 2.0), orientation });
            let stand = Stand { target_in_world: DVec3::new(0.0, 1.5, -2.0), distance_m: 2.0, azimuth_rad };
            let placed = trace.facing(&stand);
            let [from, to] = [&trace, &placed].map(|t| [t.poses()[0].pose, t.poses()[1].pose]);
            let step_before = from[1].position_m - from[0].position_m;
            let step_after = to[1].position_m - to[0].position_m;
            prop_assert!((step_before.length() - step_after.length()).abs() < 1e-12);
            prop_assert!((step_before.y - step_after.y).abs() < 1e-12);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let heights = [from, to].map(|poses| (poses[0].orientation * axis).y);
                prop_assert!((heights[0] - heights[1]).abs() < 1e-12);
            }
        }
    }
}
