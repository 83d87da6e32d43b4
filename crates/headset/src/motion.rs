//! Where the simulated head truly is.

use session::HeadsetTime;
use spatial::Pose;
use std::sync::Arc;
use std::time::Duration;
use trace::{Ending, Trace};

/// Step in which a stretch of a trace is looked through for a jump.
const STEP: Duration = Duration::from_millis(10);
/// Fastest that a head moves, in metres a second, and turns, in radians a second (1000°). What is faster is a jump in
/// the recording, such as where it begins anew.
const FASTEST_M_PER_SEC: f64 = 15.0;
const FASTEST_RAD_PER_SEC: f64 = 17.5;

/// A trace laid upon the headset's clock.
#[derive(Clone, Debug)]
pub struct TraceMotion {
    trace: Arc<Trace>,
    ending: Ending,
    began_at: HeadsetTime,
    offset_secs: f64,
}

impl TraceMotion {
    /// At `began_at` the head is where the trace is at `offset_secs`.
    #[must_use]
    pub fn new(trace: Arc<Trace>, ending: Ending, began_at: HeadsetTime, offset_secs: f64) -> Self {
        Self { trace, ending, began_at, offset_secs }
    }

    /// Where the head is at a time.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a microsecond stays exact for 285 years")]
    pub fn at(&self, time: HeadsetTime) -> Pose {
        let secs = time.micros_since(self.began_at) as f64 * 1e-6;
        self.trace.sample(self.offset_secs + secs, self.ending)
    }

    /// Whether the trace jumps between two times, as no head does and nobody can foresee.
    #[must_use]
    pub fn jumps_between(&self, from: HeadsetTime, to: HeadsetTime) -> bool {
        let mut time = from;
        let mut pose = self.at(time);
        while time < to {
            time = time + STEP;
            let next = self.at(time);
            let secs = STEP.as_secs_f64();
            if (next.position_m - pose.position_m).length() > FASTEST_M_PER_SEC * secs
                || next.angle_to(&pose) > FASTEST_RAD_PER_SEC * secs
            {
                return true;
            }
            pose = next;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::DVec3;

    #[test]
    fn the_end_of_a_walk_that_begins_anew_is_a_jump() {
        let walk = "0 0 1.6 0 0 0 0 1\n1 1 1.6 0 0 0 0 1\n2 2 1.6 0 0 0 0 1\n";
        let trace = Arc::new(Trace::parse("walk", walk.as_bytes()).unwrap());
        let at = |secs: f64| HeadsetTime::from_micros((secs * 1e6) as u64);
        let motion = |ending| TraceMotion::new(trace.clone(), ending, at(5.0), 0.5);
        let looped = motion(Ending::Loop);
        assert!((looped.at(at(6.0)).position_m - DVec3::new(1.5, 1.6, 0.0)).length() < 1e-9);
        assert!(!looped.jumps_between(at(5.0), at(6.4)));
        assert!(looped.jumps_between(at(6.4), at(6.6)));
        assert!(!motion(Ending::Hold).jumps_between(at(6.4), at(6.6)));
        assert!(!motion(Ending::PingPong).jumps_between(at(6.4), at(6.6)));
    }
}
