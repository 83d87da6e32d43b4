//! The headset's clock.

use session::HeadsetTime;
use std::time::{Duration, Instant};

/// What the clock shows at its origin. Not nothing, so that what lies shortly before it can be told too, such as the
/// server's times of a first frame.
const AT_ORIGIN: Duration = Duration::from_secs(10);

/// One headset's monotonic clock: microseconds since an origin.
#[derive(Clone, Copy, Debug)]
pub struct HeadsetClock {
    origin: Instant,
}

impl HeadsetClock {
    /// A clock that began 10 s before `origin`.
    #[must_use]
    pub fn new(origin: Instant) -> Self {
        Self { origin }
    }

    /// The time now.
    #[must_use]
    pub fn now(&self) -> HeadsetTime {
        self.at(Instant::now())
    }

    /// The time at an instant; the origin for those before it.
    #[must_use]
    pub fn at(&self, instant: Instant) -> HeadsetTime {
        HeadsetTime::default() + AT_ORIGIN + instant.saturating_duration_since(self.origin)
    }

    /// The instant of a time.
    #[must_use]
    pub fn instant(&self, time: HeadsetTime) -> Instant {
        self.origin + time.since(HeadsetTime::default() + AT_ORIGIN)
    }

    /// Seconds from the clock's origin to a time; negative before it.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a microsecond stays exact for 285 years")]
    pub fn secs_since_origin(&self, time: HeadsetTime) -> f64 {
        time.micros_since(HeadsetTime::default() + AT_ORIGIN) as f64 * 1e-6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_and_times_lead_to_each_other() {
        let origin = Instant::now();
        let clock = HeadsetClock::new(origin);
        let later = origin + Duration::from_micros(1_234_567);
        assert_eq!(clock.at(later).as_micros(), 11_234_567);
        assert_eq!(clock.instant(clock.at(later)), later);
        assert!((clock.secs_since_origin(clock.at(later)) - 1.234_567).abs() < 1e-12);
    }
}
