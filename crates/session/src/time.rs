//! Two clocks that cannot be mixed up, and the way from one to the other.

use std::time::Duration;

/// A moment of one clock. Arithmetic saturates, because some of these numbers come from the peer.
macro_rules! clock {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(u64);

        impl $name {
            /// The moment `micros` microseconds after the clock's own beginning.
            #[must_use]
            pub const fn from_micros(micros: u64) -> Self {
                Self(micros)
            }

            /// Microseconds since the clock's own beginning.
            #[must_use]
            pub const fn as_micros(self) -> u64 {
                self.0
            }

            /// Seconds since the clock's own beginning.
            #[must_use]
            #[expect(clippy::cast_precision_loss, reason = "a microsecond stays exact for 285 years")]
            pub fn as_secs(self) -> f64 {
                self.0 as f64 * 1e-6
            }

            /// The time from `earlier` to this moment; zero if it lies after this moment.
            #[must_use]
            pub const fn since(self, earlier: Self) -> Duration {
                Duration::from_micros(self.0.saturating_sub(earlier.0))
            }

            /// Microseconds from `other` to this moment, negative if it lies after this moment.
            #[must_use]
            pub fn micros_since(self, other: Self) -> i64 {
                let micros = i128::from(self.0) - i128::from(other.0);
                i64::try_from(micros).unwrap_or(if micros < 0 { i64::MIN } else { i64::MAX })
            }
        }

        impl std::ops::Add<Duration> for $name {
            type Output = Self;

            fn add(self, duration: Duration) -> Self {
                Self(self.0.saturating_add(u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)))
            }
        }

        impl std::ops::Sub<Duration> for $name {
            type Output = Self;

            fn sub(self, duration: Duration) -> Self {
                Self(self.0.saturating_sub(u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)))
            }
        }
    };
}

clock! {
    /// A moment of the server's monotonic clock, in microseconds.
    ServerTime
}

clock! {
    /// A moment of one headset's monotonic clock, in microseconds. It keeps nothing of another headset's clock.
    HeadsetTime
}

/// How one headset's clock stands to the server's, and how wrong that may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockOffset {
    /// Server clock minus headset clock, in microseconds.
    pub server_minus_headset_us: i64,
    /// The true offset lies within this many microseconds of it.
    pub error_us: u64,
}

impl ClockOffset {
    /// The same moment on the headset's clock; moments before its beginning become its beginning.
    #[must_use]
    pub fn to_headset(self, time: ServerTime) -> HeadsetTime {
        HeadsetTime(shifted(time.0, -i128::from(self.server_minus_headset_us)))
    }

    /// The same moment on the server's clock; moments before its beginning become its beginning.
    #[must_use]
    pub fn to_server(self, time: HeadsetTime) -> ServerTime {
        ServerTime(shifted(time.0, i128::from(self.server_minus_headset_us)))
    }
}

fn shifted(micros: u64, by: i128) -> u64 {
    u64::try_from((i128::from(micros) + by).max(0)).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_leads_there_and_back() {
        for server_minus_headset_us in [-5_000_000, 0, 7, 40_000_000] {
            let clock = ClockOffset { server_minus_headset_us, error_us: 0 };
            let there = clock.to_server(HeadsetTime::from_micros(9_000_000));
            assert_eq!(there.as_micros() as i64, 9_000_000 + server_minus_headset_us);
            assert_eq!(clock.to_headset(there).as_micros(), 9_000_000);
        }
    }

    #[test]
    fn absurd_moments_saturate() {
        let clock = ClockOffset { server_minus_headset_us: i64::MIN, error_us: 0 };
        assert_eq!(clock.to_server(HeadsetTime::from_micros(5)).as_micros(), 0);
        assert_eq!(clock.to_headset(ServerTime::from_micros(u64::MAX)).as_micros(), u64::MAX);
        let end = ServerTime::from_micros(u64::MAX);
        assert_eq!(end + Duration::MAX, end);
        assert_eq!(ServerTime::default() - Duration::MAX, ServerTime::default());
        assert_eq!(ServerTime::default().since(end), Duration::ZERO);
        assert_eq!(end.micros_since(ServerTime::default()), i64::MAX);
        assert_eq!(ServerTime::default().micros_since(end), i64::MIN);
    }
}
