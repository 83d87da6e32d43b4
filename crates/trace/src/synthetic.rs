//! Traces made by code: always the same, to the last bit.

use crate::{Format, Trace};
use spatial::{DQuat, DVec3, Pose, PoseAt};
use std::f64::consts::TAU;

/// Poses a second of a trace that moves: as many as the fastest headsets show.
const POSES_PER_SECOND: f64 = 90.0;
/// Shortest turn, in seconds.
const SHORTEST_PERIOD_SECS: f64 = 0.1;
/// Longest turn, in seconds; much more would not fit into a trace.
const LONGEST_PERIOD_SECS: f64 = 3600.0;

/// A walk round something, with the eyes on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// What is looked at; metres.
    pub centre_in_world: DVec3,
    /// Horizontal distance from it, in metres.
    pub radius_m: f64,
    /// How much higher than it the head is, in metres.
    pub height_m: f64,
    /// Seconds for one turn, leftwards about +Y; between 0.1 and 3600.
    pub period_secs: f64,
}

impl Trace {
    /// A head that does not move: one pose.
    #[must_use]
    pub fn still(pose: Pose) -> Self {
        Self {
            name: "still".to_owned(),
            format: Format::Synthetic,
            poses: vec![PoseAt { time_secs: 0.0, pose }],
            duplicates: 0,
        }
    }

    /// One turn round something, beginning on its +Z side. It ends where it began, so [`crate::Ending::Loop`] goes on
    /// without a jump.
    #[must_use]
    pub fn orbit(orbit: &Orbit) -> Self {
        let asked_secs = if orbit.period_secs.is_nan() { LONGEST_PERIOD_SECS } else { orbit.period_secs };
        let period_secs = asked_secs.clamp(SHORTEST_PERIOD_SECS, LONGEST_PERIOD_SECS);
        let steps = (period_secs * POSES_PER_SECOND).ceil();
        let pitch = (-orbit.height_m).atan2(orbit.radius_m);
        let pose_at = |step: u32| {
            let part = f64::from(step) / steps;
            // The last pose is the first, not what the sine of a whole turn gives.
            let turn = DQuat::from_rotation_y(if part < 1.0 { TAU * part } else { 0.0 });
            let pose = Pose {
                position_m: orbit.centre_in_world + turn * DVec3::new(0.0, orbit.height_m, orbit.radius_m),
                orientation: turn * DQuat::from_rotation_x(pitch),
            };
            PoseAt { time_secs: period_secs * part, pose }
        };
        Self {
            name: "orbit".to_owned(),
            format: Format::Synthetic,
            poses: (0..=steps as u32).map(pose_at).collect(),
            duplicates: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Ending;

    const ORBIT: Orbit = Orbit {
        centre_in_world: DVec3::new(0.0, 1.5, -2.0),
        radius_m: 2.0,
        height_m: 0.3,
        period_secs: 12.0,
    };

    #[test]
    fn an_orbit_looks_at_its_centre_all_the_time() {
        let trace = Trace::orbit(&ORBIT);
        for i in 0..1000 {
            let pose = trace.sample(f64::from(i) * 0.0171, Ending::Loop);
            let to_centre = (ORBIT.centre_in_world - pose.position_m).normalize();
            let off = (pose.orientation * DVec3::NEG_Z).angle_between(to_centre);
            assert!(off < 1e-4, "{off} rad off at step {i}");
            let up = pose.orientation * DVec3::Y;
            assert!(up.y > 0.9 && (pose.orientation * DVec3::X).y.abs() < 1e-12);
        }
    }

    #[test]
    fn an_orbit_loops_without_a_jump() {
        let trace = Trace::orbit(&ORBIT);
        assert!((trace.duration_secs() - 12.0).abs() < 1e-12);
        let [before, after] = [11.9999, 12.0001].map(|time_secs| trace.sample(time_secs, Ending::Loop));
        assert!(before.position_m.distance(after.position_m) < 1e-3);
        assert!(before.angle_to(&after) < 1e-3);
    }

    #[test]
    fn an_orbit_begins_in_front_and_goes_to_the_right_of_its_centre() {
        let trace = Trace::orbit(&ORBIT);
        assert_eq!(trace.poses()[0].pose.position_m, DVec3::new(0.0, 1.8, 0.0));
        let quarter = trace.sample(3.0, Ending::Hold).position_m;
        assert!((quarter - DVec3::new(2.0, 1.8, -2.0)).length() < 1e-9, "{quarter}");
    }

    #[test]
    fn made_traces_are_the_same_each_time_and_stand_still_where_asked() {
        assert_eq!(Trace::orbit(&ORBIT), Trace::orbit(&ORBIT));
        let still = Trace::still(Pose::IDENTITY);
        assert_eq!(still.duration_secs(), 0.0);
        for ending in [Ending::Hold, Ending::Loop, Ending::PingPong] {
            assert_eq!(still.sample(1e9, ending), Pose::IDENTITY);
        }
    }

    #[test]
    fn a_period_that_is_none_is_bounded() {
        for period_secs in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let trace = Trace::orbit(&Orbit { period_secs, ..ORBIT });
            assert!(trace.poses().len() <= 324_001, "{period_secs}");
            assert!(trace.sample(1.0, Ending::Loop).position_m.is_finite(), "{period_secs}");
        }
    }
}
