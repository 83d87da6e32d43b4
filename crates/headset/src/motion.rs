//! Where the simulated head truly is.

use session::HeadsetTime;
use spatial::Pose;
use std::sync::Arc;
use trace::{Ending, Trace};

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
    pub fn at(&self, time: HeadsetTime) -> Pose {
        self.trace.sample(self.trace_secs(time), self.ending)
    }

    /// Whether the trace jumps between two times, as no head does and nobody can foresee.
    #[must_use]
    pub fn jumps_between(&self, from: HeadsetTime, to: HeadsetTime) -> bool {
        self.trace.jumps_between(self.trace_secs(from), self.trace_secs(to), self.ending)
    }

    #[expect(clippy::cast_precision_loss, reason = "a microsecond stays exact for 285 years")]
    fn trace_secs(&self, time: HeadsetTime) -> f64 {
        self.offset_secs + time.micros_since(self.began_at) as f64 * 1e-6
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
