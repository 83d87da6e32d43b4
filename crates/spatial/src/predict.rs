//! Where a head will be: extrapolation from its last poses.

use crate::Pose;
use glam::{DQuat, DVec3};
use std::collections::VecDeque;

/// Time whose poses tell how a head moves: at 60 Hz the newest pose and three before it. Of 33, 50, 67 and 83 ms it had
/// the lowest error on five recorded walks (docs/registration.md).
const FITTED_SECS: f64 = 0.05;
/// A pose that is this much older still counts: clocks and timers are not even.
const SLACK_SECS: f64 = 0.004;
/// Where poses are farther apart than [`FITTED_SECS`], two that are no farther than this tell a velocity.
const LONGEST_STEP_SECS: f64 = 0.12;
/// Poses nearer than this to the one before are not kept, so that a flood of poses keeps its span.
const SHORTEST_STEP_SECS: f64 = 0.004;
/// Poses kept: the longest step in shortest steps.
const MAX_HISTORY: usize = 32;
/// How much of a bend in the head's way is believed: half of it lies between a straight line, which overshoots where a
/// head slows down, and the bend as it was measured, which makes noise of small jitter.
const BEND: f64 = 0.5;
/// A head keeps its acceleration for about this long.
const BEND_LASTS_SECS: f64 = 0.05;
/// A bend from poses so unevenly placed that this little of it is determined is none.
const LEAST_DETERMINED: f64 = 1e-6;
/// A head does not move faster than this, in metres a second: beyond, tracking has jumped.
const FASTEST_M_PER_SEC: f64 = 5.0;
/// A head does not turn faster than this, in radians a second (1 150° a second): beyond, tracking has jumped.
const FASTEST_RAD_PER_SEC: f64 = 20.0;

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

/// Foretells where a head will be from where it was. A straight line and a parabola are laid through the newest pose and,
/// by least squares, along those of the last 50 ms; the mean of the two is followed, the parabola's acceleration dying
/// away within another 50 ms. So a steady motion is carried on exactly, and one that slows down overshoots by less.
#[derive(Clone, Debug, Default)]
pub struct Predictor {
    newest: Option<PoseAt>,
    /// Poses before the newest, oldest first, spaced.
    history: VecDeque<PoseAt>,
}

impl Predictor {
    /// Takes the newest pose. One that is not later than those before makes them worthless: the clock has gone back.
    pub fn take(&mut self, pose: PoseAt) {
        if let Some(before) = self.newest.replace(pose) {
            self.remember(before);
        }
        if self.history.back().is_some_and(|before| before.time_secs >= pose.time_secs) {
            self.history.clear();
        }
    }

    /// Where the head will be so many seconds after the newest pose; `None` before there is one.
    #[must_use]
    pub fn predicted(&self, ahead_secs: f64) -> Option<Pose> {
        let newest = self.newest?;
        let steps = self.steps(&newest);
        let moved = |of: fn(&Step) -> DVec3| carried_on(&steps, of, ahead_secs);
        let turned = DQuat::from_scaled_axis(moved(|step| step.turn));
        Some(Pose {
            position_m: newest.pose.position_m + moved(|step| step.way_m),
            orientation: (turned * newest.pose.orientation).normalize(),
        })
    }

    fn remember(&mut self, pose: PoseAt) {
        if self.history.back().is_some_and(|last| pose.time_secs < last.time_secs + SHORTEST_STEP_SECS) {
            return;
        }
        if self.history.len() == MAX_HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(pose);
    }

    /// The poses that tell how the head moves, seen from the newest; none from before a gap or a jump.
    fn steps(&self, newest: &PoseAt) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut later = *newest;
        for pose in self.history.iter().rev() {
            let is_old = newest.time_secs - pose.time_secs > FITTED_SECS + SLACK_SECS;
            let motion = Motion::between(pose, &later);
            if (is_old && !steps.is_empty())
                || later.time_secs - pose.time_secs > LONGEST_STEP_SECS
                || motion.linear_m_per_sec.length() > FASTEST_M_PER_SEC
                || motion.angular_rad_per_sec.length() > FASTEST_RAD_PER_SEC
            {
                break;
            }
            // Over one second, so that it is the difference itself.
            let all = Motion::between(newest, &PoseAt { time_secs: newest.time_secs + 1.0, ..*pose });
            steps.push(Step {
                secs: pose.time_secs - newest.time_secs,
                way_m: all.linear_m_per_sec,
                turn: all.angular_rad_per_sec,
            });
            later = *pose;
        }
        steps
    }
}

/// An earlier pose as seen from the newest.
struct Step {
    /// Seconds, negative.
    secs: f64,
    /// Metres.
    way_m: DVec3,
    /// Axis times radians.
    turn: DVec3,
}

/// How far something that was 0 just now and `of` in each step will be after so many seconds.
fn carried_on(steps: &[Step], of: fn(&Step) -> DVec3, ahead_secs: f64) -> DVec3 {
    // Sums of t², t³, t⁴ and of t·y, t²·y: the normal equations of y = v·t and of y = v·t + c·t².
    let (mut t2, mut t3, mut t4) = (0.0, 0.0, 0.0);
    let (mut ty, mut tty) = (DVec3::ZERO, DVec3::ZERO);
    for step in steps {
        let t = step.secs;
        (t2, t3, t4) = (t2 + t * t, t3 + t * t * t, t4 + t * t * t * t);
        (ty, tty) = (ty + of(step) * t, tty + of(step) * (t * t));
    }
    if t2 <= 0.0 {
        return DVec3::ZERO;
    }
    let straight = ty / t2 * ahead_secs;
    let determinant = t2 * t4 - t3 * t3;
    if steps.len() < 2 || determinant <= LEAST_DETERMINED * t2 * t4 {
        return straight;
    }
    let velocity = (ty * t4 - tty * t3) / determinant;
    let half_acceleration = (tty * t2 - ty * t3) / determinant;
    // The acceleration dies away as exp(-t/τ): its second integral, t²/2 at first, grows like τ·t in the end.
    let faded = 1.0 - (-ahead_secs / BEND_LASTS_SECS).exp();
    let bent = velocity * ahead_secs
        + half_acceleration * (2.0 * BEND_LASTS_SECS * (ahead_secs - BEND_LASTS_SECS * faded));
    straight.lerp(bent, BEND)
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

    /// Poses each 60th of a second until 0, and how far the prediction is from the truth: metres and radians.
    fn off(motion: impl Fn(f64) -> Pose, ahead_secs: f64) -> (f64, f64) {
        let mut predictor = Predictor::default();
        for i in (0..10).rev() {
            let time_secs = -f64::from(i) / 60.0;
            predictor.take(PoseAt { time_secs, pose: motion(time_secs) });
        }
        let (predicted, truth) = (predictor.predicted(ahead_secs).unwrap(), motion(ahead_secs));
        (predicted.position_m.distance(truth.position_m), predicted.angle_to(&truth))
    }

    #[test]
    fn a_steady_motion_is_carried_on_exactly() {
        let axis = DVec3::new(0.3, 0.9, -0.2).normalize();
        let start = DQuat::from_rotation_x(0.4);
        for degrees_a_second in [0.0, 10.0, 50.0, 300.0, 900.0f64] {
            let steady = |t: f64| Pose {
                position_m: DVec3::new(1.0 - 0.7 * t, 1.6 + 0.1 * t, 0.4 * t),
                orientation: DQuat::from_axis_angle(axis, degrees_a_second.to_radians() * t) * start,
            };
            for ahead_secs in [0.0, 0.02, 0.05, 0.1] {
                let (metres, radians) = off(steady, ahead_secs);
                assert!(metres < 1e-12 && radians < 1e-9, "{degrees_a_second}°/s: {metres} m, {radians} rad");
            }
        }
    }

    #[test]
    fn a_head_that_slows_down_is_overshot_by_less_than_a_straight_line_does() {
        // From 100 degrees a second, braking at 500 a second squared.
        let braking = |t: f64| Pose {
            orientation: DQuat::from_rotation_y((100.0 * t - 250.0 * t * t).to_radians()),
            ..Pose::IDENTITY
        };
        let (_, found) = off(braking, 0.05);
        // A line through the last two poses misses the acceleration of half a step and of the time ahead.
        let straight = (250.0 * (0.05f64 * 0.05 + 0.05 / 60.0)).to_radians();
        assert!(found < 0.8 * straight, "{found} rad against {straight} rad");
    }

    #[test]
    fn what_was_before_a_jump_or_a_gap_is_forgotten() {
        let at = |time_secs: f64, x: f64| PoseAt {
            time_secs,
            pose: Pose { position_m: DVec3::new(x, 0.0, 0.0), ..Pose::IDENTITY },
        };
        let predicted_x = |poses: &[PoseAt]| {
            let mut predictor = Predictor::default();
            poses.iter().for_each(|pose| predictor.take(*pose));
            predictor.predicted(0.1).map(|pose| pose.position_m.x)
        };
        assert_eq!(predicted_x(&[]), None);
        assert_eq!(predicted_x(&[at(0.0, 1.0)]), Some(1.0));
        assert_eq!(predicted_x(&[at(0.0, 0.0), at(0.016, 2.0)]), Some(2.0), "a jump");
        assert_eq!(predicted_x(&[at(0.0, 0.0), at(0.5, 0.2)]), Some(0.2), "a gap");
        assert_eq!(predicted_x(&[at(1.0, 0.0), at(0.5, 0.2)]), Some(0.2), "a clock that goes back");
        let near = |found: Option<f64>, expected: f64| assert!((found.unwrap() - expected).abs() < 1e-9);
        near(predicted_x(&[at(0.0, 0.0), at(0.016, 9.0), at(0.032, 9.016)]), 9.116);
        near(predicted_x(&[at(0.0, 0.0), at(0.1, 0.1)]), 0.2);
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
